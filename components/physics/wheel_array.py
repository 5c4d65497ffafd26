"""Compute with axial quantities of actuators on axes fixed in the body.

The actuators are wheels or coils. The axes are the columns of a matrix of three rows
(row-major, body frame); a column of zeros stands for an actuator that does not exist.
"""

from __future__ import annotations

from ..contract.block import Mat33, PerWheel, Vec3, Vec4, WheelColumns
from ..maths.vector import inverse

_NEGLIGIBLE = 1e-9  # ratio of two eigenvalues of A A' below which the smaller one is 0


def body_momentum(axes: WheelColumns, h: PerWheel) -> Vec3:
    """Sum the axial quantities h in the body frame: A h."""
    count = len(h)
    x, y, z = axes[0] * h[0], axes[count] * h[0], axes[2 * count] * h[0]
    for i in range(1, count):
        x += axes[i] * h[i]
        y += axes[count + i] * h[i]
        z += axes[2 * count + i] * h[i]
    return (x, y, z)


def pseudo_inverse(axes: WheelColumns) -> tuple[float, ...]:
    """Compute A^+ = A' (A A')^+, a row of 3 for each actuator.

    It gives least squares where the axes do not span the space.
    """
    count = len(axes) // 3
    gram = [0.0] * 9
    for j in range(3):
        for k in range(3):
            for i in range(count):
                gram[3 * j + k] += axes[count * j + i] * axes[count * k + i]
    m = _gram_inverse(tuple(gram))  # type: ignore[arg-type]
    return tuple(
        0.0
        + axes[i] * m[j]
        + axes[count + i] * m[3 + j]
        + axes[2 * count + i] * m[6 + j]
        for i in range(count)
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
    axes: WheelColumns,
    absorbed_torque: Vec3,
    tau_body: Vec3,
    omega: Vec3,
    h: PerWheel,
) -> PerWheel:
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


def to_wheels(pinv: tuple[float, ...], v: Vec3) -> PerWheel:
    """Distribute v to the wheels: A^+ v.

    These are the axial quantities of least norm whose body-frame sum is v or nearest to
    it.
    """
    x, y, z = v
    return tuple(
        pinv[3 * i] * x + pinv[3 * i + 1] * y + pinv[3 * i + 2] * z
        for i in range(len(pinv) // 3)
    )


def to_coils(pinv: tuple[float, ...], v: Vec3) -> Vec4:
    """Distribute v to four coils, as `to_wheels`."""
    a, b, c, d = to_wheels(pinv, v)
    return (a, b, c, d)


def null_part(axes: WheelColumns, pinv: tuple[float, ...], h: PerWheel) -> PerWheel:
    """Return what the wheels hold against each other: (1 - A^+ A) h."""
    least = to_wheels(pinv, body_momentum(axes, h))
    return tuple(x - y for x, y in zip(h, least, strict=True))
