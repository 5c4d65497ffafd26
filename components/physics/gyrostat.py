"""A rigid body with wheels: momentum and rate.

H_B = J_r omega + sum g_i h_i, with J_r = J - sum J_s,i g_i g_i' the inertia without the wheels'
axial part, g_i the wheels' axes and h_i = J_s,i (Omega_i + g_i . omega) their absolute axial
momenta. Body frame; J (kg m2) is the whole craft with the wheels locked.
"""

from __future__ import annotations

from math import sqrt

from ..contract.block import BlockError, Mat33, Mat34, Vec3, Vec4
from ..maths.vector import dot, inverse, mat_vec


def carrier_inertia(inertia: Mat33, axes: Mat34, inertia_wheel: Vec4) -> Mat33:
    """J_r = J - sum J_s g g' (kg m2)."""
    reduced = list(inertia)
    for i, j_s in enumerate(inertia_wheel):
        g = (axes[i], axes[4 + i], axes[8 + i])
        for row in range(3):
            for column in range(3):
                reduced[3 * row + column] -= j_s * g[row] * g[column]
    return tuple(reduced)  # type: ignore[return-value]


def inverse_inertia(inertia: Mat33) -> Mat33:
    """The inverse; raises BlockError when the matrix is not symmetric and positive."""
    a, b, c, d, e, f, g, h, i = inertia
    symmetric = max(abs(b - d), abs(c - g), abs(f - h)) <= 1e-9 * max(a, e, i)
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if not (symmetric and a > 0.0 and a * e - b * d > 0.0 and determinant > 0.0):
        raise BlockError("inertia (less the wheels' axial part) is not symmetric and positive")
    return inverse(inertia)


def rate(h_total: Vec3, h_wheels: Vec3, inverse_carrier: Mat33) -> Vec3:
    """omega (rad/s) from the total and the wheels' momentum (N m s), both in body."""
    return mat_vec(
        inverse_carrier,
        (h_total[0] - h_wheels[0], h_total[1] - h_wheels[1], h_total[2] - h_wheels[2]),
    )


def over_determinant(carrier: Mat33) -> Mat33:
    """J_r / det J_r (1/(kg m2)^2), for `nutation`."""
    a, b, c, d, e, f, g, h, i = carrier
    s = 1.0 / (a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g))
    return (s * a, s * b, s * c, s * d, s * e, s * f, s * g, s * h, s * i)


def nutation(h_total: Vec3, over_det: Mat33) -> float:
    """sqrt(l.J_r l / det J_r): how fast (rad/s) the total momentum l (N m s, body) nutates.

    The eigenvalue of l x J_r^-1, by which dl' = l x J_r^-1 dl + dl x omega.
    """
    return sqrt(dot(h_total, mat_vec(over_det, h_total)))
