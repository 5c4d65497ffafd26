"""Learn the largest torque of a thruster axis, as a share r of its known level.

A thruster gives a commanded impulse in full as long as its firing is shorter than the
sample. One that is weaker than known fires longer for the same impulse, so that nothing
is missing until its firing takes the whole sample:

    mean torque over a sample = min(|command|, r level)

Therefore small pulses say nothing about r, and a firing that tests r says nothing for
certain about coils and disturbances. The estimate of r begins with the prior of a
filter (`SPREAD_ACTUATOR`), is corrected by a firing that is cut short, as a Kalman
filter does with one state, and is bounded from below by each firing that is not. The
share that a plan may depend on is the estimate less one standard deviation, or what a
firing has already shown. For thrusters that have not fired it is one half.
"""

from __future__ import annotations

from math import sqrt

from .disturbance_learning import SPREAD_ACTUATOR

SIGNIFICANT = 3.0  # standard deviations of the error of a measured torque


def is_cut(command: float, torque: float, error: float) -> bool:
    """Return whether the mean torque of a sample is below its command.

    `command`, `torque` and `error`, the standard deviation of the measured torque, are
    shares of the level.
    """
    return torque < command - SIGNIFICANT * error


def is_tested(
    limit: float, deviation: float, bound: float, command: float, error: float
) -> bool:
    """Return whether a command is beyond what the thrusters should give for certain.

    limit is r, `deviation` its standard deviation, `bound` of `raise_bound`; `command`
    and `error` as of `is_cut`.
    """
    if deviation < 0.5 * SPREAD_ACTUATOR:
        return command > limit + SIGNIFICANT * deviation
    return command > max(limit - deviation, bound + SIGNIFICANT * error)


def correct(
    limit: float, deviation: float, torque: float, error: float
) -> tuple[float, float]:
    """Return r and its standard deviation after a firing that is cut.

    `torque` and `error` as of `is_cut`.
    """
    variance = deviation * deviation
    gain = variance / (variance + error * error)
    limit_after = limit + gain * (torque - limit)
    return min(max(limit_after, 0.0), 1.0), deviation * sqrt(1.0 - gain)


def raise_bound(bound: float, command: float, torque: float, error: float) -> float:
    """Return the largest share that a firing has shown; arguments as `is_cut`."""
    return max(bound, min(command, torque) - SIGNIFICANT * error)


def dependable(limit: float, deviation: float, bound: float) -> float:
    """Return the share of the level that a plan may depend on."""
    return min(max(limit - deviation, bound, 0.0), limit)
