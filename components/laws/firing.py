"""What a craft knows of a firing beforehand, and learns from it. Ours.

Body frame; torques in N m, momenta in N m s, inertia J in kg m2. The total momentum is J omega + h
with h that of the wheels.
"""

from __future__ import annotations

from ..contract.block import Mat33, Vec3
from ..maths.vector import add, mat_vec, rotation_about, scale, sub


def overlap(start: float, duration: float, t: float, span: float) -> float:
    """For how long (s) of [t, t + span] a firing of `duration` (s) from `start` (s) on lasts."""
    return max(min(start + duration, t + span) - max(start, t), 0.0)


def predicted_rate(
    omega: Vec3, h_before: Vec3, h: Vec3, impulse: Vec3, inertia: Mat33, inverse: Mat33,
    elapsed: float,
) -> Vec3:  # fmt: skip
    """The rate (rad/s) after `elapsed` seconds: J omega + h turns against the body, which turns at
    omega, and gains the external impulse (N m s); h is what the wheels were measured to have."""
    total = add(mat_vec(inertia, omega), add(h_before, scale(0.5, impulse)))
    turned = mat_vec(rotation_about(omega, -elapsed), total)
    return mat_vec(inverse, sub(add(turned, scale(0.5, impulse)), h))


def gain(variance: float, noise: float) -> float:
    """Of a scalar Kalman filter: the part of what was measured, with this deviation, that is taken
    over by an estimate of this variance."""
    measured = noise * noise
    return variance / (variance + measured) if variance > 0.0 else 0.0
