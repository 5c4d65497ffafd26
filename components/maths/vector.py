"""Compute with vectors of three and matrices of nine floats: flat, row-major tuples.

Plain floats are ten times faster than arrays at this size. The functions know no units
and no frames.
"""

from __future__ import annotations

from math import cos, sin, sqrt

from ..contract.block import Mat33, Table, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
AXES: tuple[Vec3, Vec3, Vec3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
IDENTITY: Mat33 = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def add(a: Vec3, b: Vec3) -> Vec3:
    """Add two vectors: a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    """Subtract two vectors: a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(s: float, a: Vec3) -> Vec3:
    """Multiply a vector by a number: s a."""
    return (s * a[0], s * a[1], s * a[2])


def inner(a: Table, b: Table) -> float:
    """Compute the inner product of vectors of any length."""
    total = a[0] * b[0]
    for i in range(1, len(a)):
        total += a[i] * b[i]
    return total


def dot(a: Vec3, b: Vec3) -> float:
    """Compute the scalar product a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vec3) -> float:
    """Compute the length |a|."""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def unit(a: Vec3) -> Vec3:
    """Normalise a vector: a / |a|.

    Raises
    ------
    ZeroDivisionError
        If a is the zero vector.
    """
    return scale(1.0 / norm(a), a)


def cross(a: Vec3, b: Vec3) -> Vec3:
    """Compute the cross product a x b."""
    ax, ay, az = a
    bx, by, bz = b
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def clip(a: Vec3, limit: float) -> Vec3:
    """Limit each component to +-limit."""
    return (
        min(max(a[0], -limit), limit),
        min(max(a[1], -limit), limit),
        min(max(a[2], -limit), limit),
    )


def mat_vec(m: Mat33, a: Vec3) -> Vec3:
    """Multiply a matrix and a vector: m a."""
    x, y, z = a
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


def mat_t_vec(m: Mat33, a: Vec3) -> Vec3:
    """Multiply a transposed matrix and a vector: m' a."""
    x, y, z = a
    return (
        m[0] * x + m[3] * y + m[6] * z,
        m[1] * x + m[4] * y + m[7] * z,
        m[2] * x + m[5] * y + m[8] * z,
    )


def inverse(m: Mat33) -> Mat33:
    """Compute the inverse of m.

    Raises
    ------
    ZeroDivisionError
        If m is singular.
    """
    a, b, c, d, e, f, g, h, i = m
    ca, cb, cc = e * i - f * h, f * g - d * i, d * h - e * g
    s = 1.0 / (a * ca + b * cb + c * cc)
    return (
        s * ca,
        s * (c * h - b * i),
        s * (b * f - c * e),
        s * cb,
        s * (a * i - c * g),
        s * (c * d - a * f),
        s * cc,
        s * (b * g - a * h),
        s * (a * e - b * d),
    )


def rotation_about(axis_rate: Vec3, t: float) -> Mat33:
    """Compute the rotation matrix exp([axis_rate x] t) (Rodrigues).

    It turns a vector by |axis_rate| t about axis_rate.
    """
    w = norm(axis_rate)
    if w == 0.0:
        return IDENTITY
    x, y, z = axis_rate[0] / w, axis_rate[1] / w, axis_rate[2] / w
    c, s = cos(w * t), sin(w * t)
    v = 1.0 - c
    return (
        c + x * x * v,
        x * y * v - z * s,
        x * z * v + y * s,
        y * x * v + z * s,
        c + y * y * v,
        y * z * v - x * s,
        z * x * v - y * s,
        z * y * v + x * s,
        c + z * z * v,
    )
