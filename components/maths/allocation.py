"""Which nozzles fire for how long: least total on-time for a wanted angular impulse.

Jet selection by linear programming: Crawford, AIAA 69-845 (1969). Non-negative least
squares would give the impulse, too, but not by the least on-time.
"""

from __future__ import annotations

from ..contract.block import Vec3
from .simplex import least_cost
from .vector import norm, scale, sub

# An error costs so much that a nozzle which gives less than 1e-5 of the strongest one's
# torque about an axis is not worth firing.
_ERROR_COST = 1e5


def least_on_times(
    torques: tuple[Vec3, ...], impulse: Vec3, longest: float
) -> tuple[float, ...]:
    """The on-time x (s) of each nozzle, 0 <= x <= longest, for an angular impulse (N m
    s).

    minimise  sum x + k |e|_1,   sum x torque + e = impulse,   k large: an error e is left only
    where the nozzles cannot do better. At most three nozzles fire for a part of `longest`.
    """
    n = len(torques)
    strongest = max((abs(c) for torque in torques for c in torque), default=0.0)
    if strongest == 0.0:
        return (0.0,) * n
    columns = tuple(scale(1.0 / strongest, torque) for torque in torques)
    goal = scale(1.0 / strongest, impulse)
    return least_cost(columns, (1.0,) * n, (longest,) * n, goal, _ERROR_COST)


def gives(torques: tuple[Vec3, ...], direction: Vec3) -> bool:
    """Whether nozzles of these torques (N m) can give one along a unit vector, and none
    across."""
    strongest = max((abs(c) for torque in torques for c in torque), default=0.0)
    wanted = scale(1e-3 * strongest, direction)
    left = wanted
    for on_time, torque in zip(
        least_on_times(torques, wanted, 1.0), torques, strict=True
    ):
        left = sub(left, scale(on_time, torque))
    return norm(left) < 1e-3 * norm(wanted)
