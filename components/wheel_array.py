"""An array of up to four wheels: axes as the columns of a 3 x 4 matrix (row-major, body frame).

A column of zeros stands for a wheel that is not there.
"""

from __future__ import annotations

from .block import Mat34, Vec3, Vec4
from .vector import inverse


def body_momentum(axes: Mat34, h: Vec4) -> Vec3:
    """A h: the body-frame sum of the axial quantities h."""
    a, b, c, d = h
    return (
        axes[0] * a + axes[1] * b + axes[2] * c + axes[3] * d,
        axes[4] * a + axes[5] * b + axes[6] * c + axes[7] * d,
        axes[8] * a + axes[9] * b + axes[10] * c + axes[11] * d,
    )


def pseudo_inverse(axes: Mat34) -> tuple[float, ...]:
    """A^+ = A' (A A')^-1 as 4 rows of 3; raises ZeroDivisionError when the axes span no space."""
    rows = (axes[0:4], axes[4:8], axes[8:12])
    gram = tuple(sum(x * y for x, y in zip(p, q, strict=True)) for p in rows for q in rows)
    m = inverse(gram)  # type: ignore[arg-type]
    return tuple(
        sum(rows[k][i] * m[3 * k + j] for k in range(3)) for i in range(4) for j in range(3)
    )


def to_wheels(pinv: tuple[float, ...], v: Vec3) -> Vec4:
    """A^+ v: the axial quantities of least norm whose body-frame sum is v."""
    x, y, z = v
    p = pinv
    return (
        p[0] * x + p[1] * y + p[2] * z,
        p[3] * x + p[4] * y + p[5] * z,
        p[6] * x + p[7] * y + p[8] * z,
        p[9] * x + p[10] * y + p[11] * z,
    )
