"""What a craft knows of a firing beforehand, what it learns from it, and how it stands
against it.

Ours. Body frame; torques in N m, impulses and momenta in N m s, inertia J in kg m2,
rates in rad/s. The total momentum is J omega + h with h that of the wheels.
"""

from __future__ import annotations

from math import copysign

from ..contract.block import Mat33, Vec3
from ..maths.vector import add, mat_vec, rotation_about, scale, sub


def overlap(start: float, duration: float, t: float, span: float) -> float:
    """For how long (s) of [t, t + span] a firing of `duration` (s) from `start` (s) on
    lasts."""
    return max(min(start + duration, t + span) - max(start, t), 0.0)


def predicted_rate(
    omega: Vec3,
    h_before: Vec3,
    h: Vec3,
    impulse: Vec3,
    inertia: Mat33,
    inverse: Mat33,
    elapsed: float,
) -> Vec3:
    """The rate after `elapsed` (s) of a body that had omega and wheels with h_before,
    gained an external impulse, and has wheels with h.

    J omega + h keeps its direction, so in the body it turns against the mean of the
    rates before and after, found in three rounds; half of the impulse turns with it.
    """
    half = scale(0.5, impulse)
    before = add(add(mat_vec(inertia, omega), h_before), half)
    after = omega
    for _ in range(3):
        turned = mat_vec(
            rotation_about(scale(0.5, add(omega, after)), -elapsed), before
        )
        after = mat_vec(inverse, sub(add(turned, half), h))
    return after


def kalman_gain(variance: float, noise: float) -> float:
    """The share of a measurement of this deviation that an estimate of this variance
    takes over."""
    return variance / (variance + noise * noise)


def pulsed(m: float, limit: float, pulse: float, period: float, duty: float) -> float:
    """The mean dipole (A m2) over a period (s) that a coil of +-limit makes of the
    command m, by pulses (s) whose number is rounded to the nearest, at most the share
    `duty` of the period."""
    most = int(duty * period / pulse + 1e-9)
    count = min(int(abs(m) / limit * period / pulse + 0.5), most)
    return copysign(count * pulse / period * limit, m)
