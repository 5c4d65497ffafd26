"""Predict a thruster firing, learn from it and compensate it.

Ours. Body frame; torques in N m, impulses and momenta in N m s, inertia J in kg m2,
rates in rad/s. The total momentum is J omega + h with h that of the wheels.
"""

from __future__ import annotations

from math import copysign

from ..contract.block import Mat33, Vec3
from ..maths.vector import add, mat_vec, rotation_about, scale, sub


def overlap(start: float, duration: float, t: float, span: float) -> float:
    """Compute for how long (s) of [t, t + span] a firing lasts.

    The firing has a `duration` (s) and begins at `start` (s).
    """
    return max(min(start + duration, t + span) - max(start, t), 0.0)


def predicted_rate(
    omega: Vec3,
    h_before: Vec3,
    h: Vec3,
    impulse: Vec3,
    inertia: Mat33,
    inverse: Mat33,
    elapsed_time: float,
) -> Vec3:
    """Predict the rate (rad/s, body) after `elapsed_time` (s).

    The body had omega and wheels with h_before, gained an external impulse, and has
    wheels with h. J omega + h keeps its direction, so in the body it turns against the
    mean of the rates before and after, found in three rounds; half of the impulse turns
    with it.
    """
    half = scale(0.5, impulse)
    before = add(add(mat_vec(inertia, omega), h_before), half)
    after = omega
    for _ in range(3):
        turned_momentum = mat_vec(
            rotation_about(scale(0.5, add(omega, after)), -elapsed_time), before
        )
        after = mat_vec(inverse, sub(add(turned_momentum, half), h))
    return after


def kalman_gain(variance: float, noise: float) -> float:
    """Compute the weight of a measurement of this noise for this variance.

    noise is the standard deviation of the measurement, variance that of the estimate.
    """
    return variance / (variance + noise * noise)


def pulse_dipole(
    m: float, limit: float, pulse: float, period: float, duty: float
) -> float:
    """Compute the mean dipole (A m2) over a period (s) of a pulsed coil of +-limit.

    The command m is rounded to the nearest number of pulses (s), at most the fraction
    `duty` of the period.
    """
    most = int(duty * period / pulse + 1e-9)
    count = min(int(abs(m) / limit * period / pulse + 0.5), most)
    return copysign(count * pulse / period * limit, m)
