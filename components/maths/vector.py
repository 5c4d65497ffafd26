"""Vectors of three and matrices of nine floats, as flat tuples (row-major).

Plain floats: at this size they are ten times faster than arrays. No units, no frames.
"""

from __future__ import annotations

from math import cos, sin, sqrt

from ..contract.block import Mat33, Vec3

ZERO: Vec3 = (0.0, 0.0, 0.0)
IDENTITY: Mat33 = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def add(a: Vec3, b: Vec3) -> Vec3:
    """a + b"""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    """a - b"""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(s: float, a: Vec3) -> Vec3:
    """s a"""
    return (s * a[0], s * a[1], s * a[2])


def dot(a: Vec3, b: Vec3) -> float:
    """a . b"""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vec3) -> float:
    """|a|"""
    return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def unit(a: Vec3) -> Vec3:
    """a / |a|; raises ZeroDivisionError for the zero vector."""
    return scale(1.0 / norm(a), a)


def cross(a: Vec3, b: Vec3) -> Vec3:
    """a x b"""
    ax, ay, az = a
    bx, by, bz = b
    return (ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def clip(a: Vec3, limit: float) -> Vec3:
    """Each component within +-limit."""
    return (
        min(max(a[0], -limit), limit),
        min(max(a[1], -limit), limit),
        min(max(a[2], -limit), limit),
    )


def mat_vec(m: Mat33, a: Vec3) -> Vec3:
    """m a"""
    x, y, z = a
    return (
        m[0] * x + m[1] * y + m[2] * z,
        m[3] * x + m[4] * y + m[5] * z,
        m[6] * x + m[7] * y + m[8] * z,
    )


def mat_t_vec(m: Mat33, a: Vec3) -> Vec3:
    """m' a"""
    x, y, z = a
    return (
        m[0] * x + m[3] * y + m[6] * z,
        m[1] * x + m[4] * y + m[7] * z,
        m[2] * x + m[5] * y + m[8] * z,
    )


def inverse(m: Mat33) -> Mat33:
    """The inverse; raises ZeroDivisionError when m is singular."""
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
    """exp([axis_rate x] t): turns a vector by |axis_rate| t about axis_rate
    (Rodrigues)."""
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
