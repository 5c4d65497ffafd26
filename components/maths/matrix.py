"""Multiply, add and scale matrices of nine floats: flat tuples, row-major.

The functions know no units and no frames.
"""

from __future__ import annotations

from ..contract.block import Mat33, Vec3


def crossing(a: Vec3) -> Mat33:
    """Return the skew matrix [a x]."""
    return (0.0, -a[2], a[1], a[2], 0.0, -a[0], -a[1], a[0], 0.0)


def multiply(p: Mat33, q: Mat33) -> Mat33:
    """Multiply two matrices: p q."""
    a, b, c, d, e, f, g, h, i = p
    j, k, m, n, r, s, t, u, v = q
    return (
        a * j + b * n + c * t,
        a * k + b * r + c * u,
        a * m + b * s + c * v,
        d * j + e * n + f * t,
        d * k + e * r + f * u,
        d * m + e * s + f * v,
        g * j + h * n + i * t,
        g * k + h * r + i * u,
        g * m + h * s + i * v,
    )


def transpose(m: Mat33) -> Mat33:
    """Return the transpose m'."""
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


def add(p: Mat33, q: Mat33) -> Mat33:
    """Add two matrices: p + q."""
    return (
        p[0] + q[0],
        p[1] + q[1],
        p[2] + q[2],
        p[3] + q[3],
        p[4] + q[4],
        p[5] + q[5],
        p[6] + q[6],
        p[7] + q[7],
        p[8] + q[8],
    )


def subtract(p: Mat33, q: Mat33) -> Mat33:
    """Subtract two matrices: p - q."""
    return (
        p[0] - q[0],
        p[1] - q[1],
        p[2] - q[2],
        p[3] - q[3],
        p[4] - q[4],
        p[5] - q[5],
        p[6] - q[6],
        p[7] - q[7],
        p[8] - q[8],
    )


def add_square(m: Mat33, v: Vec3, weight: float, divisor: float = 1.0) -> Mat33:
    """Return m + weight v v' / divisor of a symmetric m, which stays so to the bit."""
    a, b, c = v
    xy, xz = m[1] + weight * a * b / divisor, m[2] + weight * a * c / divisor
    yz = m[5] + weight * b * c / divisor
    return (
        m[0] + weight * a * a / divisor,
        xy,
        xz,
        xy,
        m[4] + weight * b * b / divisor,
        yz,
        xz,
        yz,
        m[8] + weight * c * c / divisor,
    )


def scale(s: float, m: Mat33) -> Mat33:
    """Multiply a matrix by a number: s m."""
    return (
        s * m[0],
        s * m[1],
        s * m[2],
        s * m[3],
        s * m[4],
        s * m[5],
        s * m[6],
        s * m[7],
        s * m[8],
    )
