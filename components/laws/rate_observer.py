"""Estimate the body's rate by a fixed-gain observer.

It uses magnetometer and tachometer alone. The model propagates the body's momentum p =
J_r omega (N m s, body; J_r without the wheel's spin inertia) and the field b (T, body)
from sample to sample,

    p' = m x b + tau - omega x (p + w),      b' = -omega x b,

m (A m2) the dipole, tau (N m) the wheel's torque on the body, w (N m s) the wheel's
momentum, body; then the measured field corrects both. The field's own rotation along
the orbit, 2e-3 rad/s, is taken for the body's; the part of omega along the field is
known by the coupling of the axes only.
"""

from __future__ import annotations

from ..contract.block import Mat33, Vec3
from ..maths.vector import add, cross, dot, mat_vec, rotation_about, scale, sub


def predict(
    omega: Vec3,
    b: Vec3,
    m: Vec3,
    tau: Vec3,
    wheel: Vec3,
    inertia: Mat33,
    inverse: Mat33,
    elapsed_time: float,
) -> tuple[Vec3, Vec3]:
    """Propagate (omega, b) over `elapsed_time` (s) with m and tau held.

    omega by the midpoint rule in four parts.
    """
    part = 0.25 * elapsed_time
    for k in range(4):
        now = sub(wheel, scale((k + 0.5) * part, tau))
        slope = _slope(omega, b, m, tau, now, inertia, inverse)
        middle = add(omega, scale(0.5 * part, slope))
        omega = add(
            omega, scale(part, _slope(middle, b, m, tau, now, inertia, inverse))
        )
        b = mat_vec(rotation_about(scale(-1.0, middle), part), b)
    return omega, b


def _slope(
    omega: Vec3,
    b: Vec3,
    m: Vec3,
    tau: Vec3,
    wheel: Vec3,
    inertia: Mat33,
    inverse: Mat33,
) -> Vec3:
    """Compute the angular acceleration (rad/s2, body)."""
    momentum = add(mat_vec(inertia, omega), wheel)
    return mat_vec(inverse, add(sub(cross(m, b), cross(omega, momentum)), tau))


def correct(
    omega: Vec3, b: Vec3, measured_field: Vec3, bandwidth: float, elapsed_time: float
) -> tuple[Vec3, Vec3]:
    """Correct (omega, b) by a measured field (T).

    The error across the field decays as a second-order system of this bandwidth (rad/s)
    with damping 1 / sqrt 2. With d = measured_field - b: b takes sqrt 2 bandwidth T of d,
    omega bandwidth^2 T (d x b) / |b|^2.
    """
    size2 = dot(measured_field, measured_field)
    if size2 == 0.0:
        return omega, b
    d = sub(measured_field, b)
    first = min(1.4142135623730951 * bandwidth * elapsed_time, 1.0)
    second = bandwidth * bandwidth * elapsed_time / size2
    return add(omega, scale(second, cross(d, b))), add(b, scale(first, d))
