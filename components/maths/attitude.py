"""Compute with unit quaternions, scalar last: v_B = C(q_BI) v_I.

Source: paper 004, eqs. 5-6. The product satisfies C(a (x) b) = C(a) C(b), and the
kinematics are q' = 1/2 Omega(omega) q with omega the rate of the left frame relative to
the right one, in the left frame.
"""

from __future__ import annotations

from math import atan2, cos, sin, sqrt

from ..contract.block import Mat33, Vec3, Vec4
from .vector import cross

IDENTITY_Q: Vec4 = (0.0, 0.0, 0.0, 1.0)


def product(a: Vec4, b: Vec4) -> Vec4:
    """Multiply two quaternions: a (x) b, first b, then a; C(a (x) b) = C(a) C(b)."""
    a1, a2, a3, a4 = a
    b1, b2, b3, b4 = b
    return (
        a4 * b1 + a3 * b2 - a2 * b3 + a1 * b4,
        -a3 * b1 + a4 * b2 + a1 * b3 + a2 * b4,
        a2 * b1 - a1 * b2 + a4 * b3 + a3 * b4,
        -a1 * b1 - a2 * b2 - a3 * b3 + a4 * b4,
    )


def inverse(q: Vec4) -> Vec4:
    """Return q^-1 of a unit quaternion: C(q^-1) = C(q)'."""
    return (-q[0], -q[1], -q[2], q[3])


def normalise(q: Vec4) -> Vec4:
    """Scale a quaternion to length 1: q / |q|."""
    s = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return (q[0] * s, q[1] * s, q[2] * s, q[3] * s)


def matrix(q: Vec4) -> Mat33:
    """Return the rotation matrix C(q): v_left = C(q) v_right."""
    x, y, z, w = q
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, xz, yz, xw, yw, zw = x * y, x * z, y * z, x * w, y * w, z * w
    return (
        xx - yy - zz + ww,
        2.0 * (xy + zw),
        2.0 * (xz - yw),
        2.0 * (xy - zw),
        -xx + yy - zz + ww,
        2.0 * (yz + xw),
        2.0 * (xz + yw),
        2.0 * (yz - xw),
        -xx - yy + zz + ww,
    )


def from_matrix(c: Mat33) -> Vec4:
    """Convert a rotation matrix to a quaternion with scalar >= 0.

    Shepperd's method: it divides by the largest component.
    """
    c11, c12, c13, c21, c22, c23, c31, c32, c33 = c
    trace = c11 + c22 + c33
    candidates = (c11, c22, c33, trace)
    k = max(range(4), key=candidates.__getitem__)
    if k == 3:
        q = (c23 - c32, c31 - c13, c12 - c21, 1.0 + trace)
    elif k == 0:
        q = (1.0 + c11 - c22 - c33, c12 + c21, c13 + c31, c23 - c32)
    elif k == 1:
        q = (c12 + c21, 1.0 - c11 + c22 - c33, c23 + c32, c31 - c13)
    else:
        q = (c13 + c31, c23 + c32, 1.0 - c11 - c22 + c33, c12 - c21)
    q = normalise(q)
    return q if q[3] >= 0.0 else (-q[0], -q[1], -q[2], -q[3])


def from_axes(x: Vec3, y: Vec3) -> Vec4:
    """Return the attitude of a frame by its first two axes, orthogonal unit vectors."""
    return from_matrix((*x, *y, *cross(x, y)))


def nearest(q: Vec4, before: Vec4) -> Vec4:
    """Return q or -q, the same attitude, whichever is nearer to `before`.

    A quaternion that is followed without jumps shows how the body turns.
    """
    a, b, c, d = q
    w, x, y, z = before
    same = a * w + b * x + c * y + d * z >= 0.0
    return q if same else (-a, -b, -c, -d)


def rotate(q: Vec4, v: Vec3) -> Vec3:
    """Rotate a vector from the right frame into the left one: C(q) v."""
    x, y, z, w = q
    vx, vy, vz = v
    tx, ty, tz = (
        2.0 * (y * vz - z * vy),
        2.0 * (z * vx - x * vz),
        2.0 * (x * vy - y * vx),
    )
    return (
        vx - w * tx + y * tz - z * ty,
        vy - w * ty + z * tx - x * tz,
        vz - w * tz + x * ty - y * tx,
    )


def rotate_back(q: Vec4, v: Vec3) -> Vec3:
    """Rotate a vector from the left frame into the right one: C(q)' v."""
    return rotate((-q[0], -q[1], -q[2], q[3]), v)


def propagate(q: Vec4, omega: Vec3, t: float) -> Vec4:
    """Propagate q over t (s) at the constant rate omega (rad/s, left frame).

    The result is exp(1/2 Omega t) q.
    """
    wx, wy, wz = omega
    rate = sqrt(wx * wx + wy * wy + wz * wz)
    if rate == 0.0:
        return q
    half = 0.5 * rate * t
    s = sin(half) / rate
    return normalise(product((wx * s, wy * s, wz * s, cos(half)), q))


def error_angle(q: Vec4, q_ref: Vec4) -> float:
    """Compute the angle (rad, 0 to pi) of the rotation between two attitudes."""
    x, y, z, w = product(q, inverse(q_ref))
    return 2.0 * atan2(sqrt(x * x + y * y + z * z), abs(w))
