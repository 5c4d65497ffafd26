"""Select nozzles and on-times of least sum for a commanded angular impulse.

Jet selection by linear programming: Crawford, AIAA 69-845 (1969). Non-negative least
squares would also give the impulse, but not with the least on-time.
"""

from __future__ import annotations

from ..contract.block import Vec3
from .simplex import least_cost
from .vector import norm, scale, sub

# With this cost, a nozzle with less than 1e-5 of the strongest torque about an axis is
# not worth firing.
_ERROR_COST = 1e5


def least_on_times(
    torques: tuple[Vec3, ...], impulse: Vec3, longest: float
) -> tuple[float, ...]:
    """Compute the on-time (s) of each nozzle for an angular impulse (N m s).

        minimise  sum x + k |e|_1,   sum x torque + e = impulse,   0 <= x <= longest (s),   k large

    An error e is left only where the nozzles cannot do better. `torques` holds the
    torque of each nozzle (N m). At most three nozzles fire for a part of `longest`.
    """
    n = len(torques)
    strongest = max((abs(c) for torque in torques for c in torque), default=0.0)
    if strongest == 0.0:
        return (0.0,) * n
    columns = tuple(scale(1.0 / strongest, torque) for torque in torques)
    goal = scale(1.0 / strongest, impulse)
    return least_cost(columns, (1.0,) * n, (longest,) * n, goal, _ERROR_COST)


def gives(torques: tuple[Vec3, ...], direction: Vec3) -> bool:
    """Return whether nozzles of these torques (N m) can produce one along `direction`.

    The torque must have no component across `direction`, which is a unit vector.
    """
    strongest = max((abs(c) for torque in torques for c in torque), default=0.0)
    impulse = scale(1e-3 * strongest, direction)
    rest = impulse
    for on_time, torque in zip(
        least_on_times(torques, impulse, 1.0), torques, strict=True
    ):
        rest = sub(rest, scale(on_time, torque))
    return norm(rest) < 1e-3 * norm(impulse)
