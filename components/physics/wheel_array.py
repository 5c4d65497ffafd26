"""Compute with axial quantities of up to four actuators on axes fixed in the body.

The actuators are wheels or coils. The axes are the columns of a 3 x 4 matrix
(row-major, body frame); a column of zeros stands for an actuator that does not exist.
"""

from __future__ import annotations

from ..contract.block import Mat33, Mat34, Vec3, Vec4
from ..maths.vector import inverse

_NEGLIGIBLE = 1e-9  # ratio of two eigenvalues of A A' below which the smaller one is 0


def body_momentum(axes: Mat34, h: Vec4) -> Vec3:
    """Sum the axial quantities h in the body frame: A h."""
    a, b, c, d = h
    return (
        axes[0] * a + axes[1] * b + axes[2] * c + axes[3] * d,
        axes[4] * a + axes[5] * b + axes[6] * c + axes[7] * d,
        axes[8] * a + axes[9] * b + axes[10] * c + axes[11] * d,
    )


def pseudo_inverse(axes: Mat34) -> tuple[float, ...]:
    """Compute A^+ = A' (A A')^+ as 4 rows of 3.

    It gives least squares where the axes do not span the space.
    """
    rows = (axes[0:4], axes[4:8], axes[8:12])
    gram = tuple(
        0.0 + p[0] * q[0] + p[1] * q[1] + p[2] * q[2] + p[3] * q[3]
        for p in rows
        for q in rows
    )
    m = _gram_inverse(gram)  # type: ignore[arg-type]
    a, b, c = rows
    return tuple(
        0.0 + a[i] * m[j] + b[i] * m[3 + j] + c[i] * m[6 + j]
        for i in range(4)
        for j in range(3)
    )


def _gram_inverse(gram: Mat33) -> Mat33:
    """Compute the pseudo-inverse of a symmetric matrix without negative eigenvalues.

    Rank 2 has a null vector n, and G^+ = (G + tr n n')^-1 - n n' / tr, with n n' = adj
    G / tr adj G and tr = trace G; rank 1 is G = tr u u'.
    """
    a, b, c, _, d, e, _, _, f = gram
    adjugate = (
        d * f - e * e,
        c * e - b * f,
        b * e - c * d,
        c * e - b * f,
        a * f - c * c,
        b * c - a * e,
        b * e - c * d,
        b * c - a * e,
        a * d - b * b,
    )
    trace, minors = a + d + f, adjugate[0] + adjugate[4] + adjugate[8]
    determinant = a * adjugate[0] + b * adjugate[1] + c * adjugate[2]
    if trace == 0.0:
        return gram
    if minors <= _NEGLIGIBLE * trace * trace:
        return tuple(x / (trace * trace) for x in gram)  # type: ignore[return-value]
    if determinant > _NEGLIGIBLE * minors * trace:
        return inverse(gram)
    null = [x / minors for x in adjugate]
    full = inverse(tuple(g + trace * n for g, n in zip(gram, null, strict=True)))  # type: ignore[arg-type]
    return tuple(x - n / trace for x, n in zip(full, null, strict=True))  # type: ignore[return-value]


def wheel_torque(
    pinv: tuple[float, ...],
    axes: Mat34,
    absorbed_torque: Vec3,
    tau_body: Vec3,
    omega: Vec3,
    h: Vec4,
) -> Vec4:
    """Compute the torques on the rotors (N m) for a torque tau_body (N m) on the body.

    h' = A^+ (absorbed_torque - tau_body - omega x A h): the wheels take the external torque
    `absorbed_torque` and the gyroscopic torque of their own momentum (paper 004, eqs. 14-16,
    21).
    """
    hx, hy, hz = body_momentum(axes, h)
    x, y, z = omega
    return to_wheels(
        pinv,
        (
            absorbed_torque[0] - tau_body[0] - (y * hz - z * hy),
            absorbed_torque[1] - tau_body[1] - (z * hx - x * hz),
            absorbed_torque[2] - tau_body[2] - (x * hy - y * hx),
        ),
    )


def to_wheels(pinv: tuple[float, ...], v: Vec3) -> Vec4:
    """Distribute v to the wheels: A^+ v.

    These are the axial quantities of least norm whose body-frame sum is v or nearest to
    it.
    """
    x, y, z = v
    p = pinv
    return (
        p[0] * x + p[1] * y + p[2] * z,
        p[3] * x + p[4] * y + p[5] * z,
        p[6] * x + p[7] * y + p[8] * z,
        p[9] * x + p[10] * y + p[11] * z,
    )
