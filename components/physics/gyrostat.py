"""Compute momentum and rate of a rigid body with wheels.

H_B = J_r omega + sum g_i h_i, with J_r = J - sum J_s,i g_i g_i' the inertia without the
wheels' axial part, g_i the wheels' axes and h_i = J_s,i (Omega_i + g_i . omega) their
absolute axial momenta. Body frame; J (kg m2) is that of the whole craft with locked
wheels.
"""

from __future__ import annotations

from math import sqrt

from ..contract.block import BlockError, Mat33, PerWheel, Vec3, WheelColumns
from ..maths.vector import dot, inverse, mat_vec


def carrier_inertia(
    inertia: Mat33, axes: WheelColumns, inertia_wheel: PerWheel
) -> Mat33:
    """Compute the inertia J_r (kg m2) without the wheels' axial part.

    J_r = J - sum J_s g g'.
    """
    carrier, count = list(inertia), len(inertia_wheel)
    for i, j_s in enumerate(inertia_wheel):
        g = (axes[i], axes[count + i], axes[2 * count + i])
        for row in range(3):
            for column in range(3):
                carrier[3 * row + column] -= j_s * g[row] * g[column]
    return tuple(carrier)  # type: ignore[return-value]


def check_inertia(inertia: Mat33) -> None:
    """Check that a body can have this inertia (kg m2).

    With d V = rho dx dy dz, J = tr(S) 1 - S where S = int x x' dV has no negative
    eigenvalue, and S = tr(J) / 2 1 - J.

    Raises
    ------
    BlockError
        If the inertia is not symmetric, or its principal moments are not positive or break
        the triangle rule.
    """
    a, b, c, d, e, f, g, h, i = inertia
    small = 1e-9 * max(abs(a), abs(e), abs(i))
    for row, column, x, y in ((1, 2, b, d), (1, 3, c, g), (2, 3, f, h)):
        if abs(x - y) > small:
            raise BlockError(
                f"inertia[{row},{column}] = {x:g} and inertia[{column},{row}] = {y:g} kg m2: they "
                "must be equal; both are the negative product of inertia"
            )
    if not (a > 0.0 and a * e - b * d > 0.0 and _determinant(inertia) > 0.0):
        raise BlockError(
            f"inertia = {inertia} kg m2: its principal moments must be above 0"
        )
    half = 0.5 * (a + e + i)
    p, q, r = half - a + small, half - e + small, half - i + small
    spread: Mat33 = (p, -b, -c, -d, q, -f, -g, -h, r)
    minors = (p * q - b * d, p * r - c * g, q * r - f * h)
    tiny = 1e-9 * half * half
    if min(p, q, r) < 0.0 or min(minors) < -tiny or _determinant(spread) < -tiny * half:
        raise BlockError(
            f"inertia = {inertia} kg m2: no body has it; a principal moment is larger than the sum "
            "of the other two"
        )


def _determinant(m: Mat33) -> float:
    """Compute the determinant of a matrix."""
    a, b, c, d, e, f, g, h, i = m
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def inverse_inertia(inertia: Mat33) -> Mat33:
    """Compute the inverse of an inertia (1/(kg m2)).

    Raises
    ------
    BlockError
        If the matrix is not symmetric and positive definite.
    """
    a, b, c, d, e, f, g, h, i = inertia
    symmetric = max(abs(b - d), abs(c - g), abs(f - h)) <= 1e-9 * max(a, e, i)
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if not (symmetric and a > 0.0 and a * e - b * d > 0.0 and determinant > 0.0):
        raise BlockError(
            "inertia (less the wheels' axial part, by inertia_wheel: 0 where there is "
            "no wheel) is not symmetric and positive"
        )
    return inverse(inertia)


def rate(h_total: Vec3, h_wheels: Vec3, inverse_carrier: Mat33) -> Vec3:
    """Compute omega (rad/s) from the total and the wheels' momentum (N m s), body."""
    return mat_vec(
        inverse_carrier,
        (h_total[0] - h_wheels[0], h_total[1] - h_wheels[1], h_total[2] - h_wheels[2]),
    )


def over_determinant(carrier: Mat33) -> Mat33:
    """Compute J_r / det J_r (1/(kg m2)^2), for `nutation`."""
    a, b, c, d, e, f, g, h, i = carrier
    s = 1.0 / (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))
    return (s * a, s * b, s * c, s * d, s * e, s * f, s * g, s * h, s * i)


def nutation(h_total: Vec3, over_det: Mat33) -> float:
    """Compute the nutation rate (rad/s) of the total momentum l (N m s, body).

    sqrt(l.J_r l / det J_r) is the eigenvalue of l x J_r^-1, by which dl' = l x J_r^-1
    dl + dl x omega.
    """
    return sqrt(dot(h_total, mat_vec(over_det, h_total)))
