"""Which nozzles fire for how long: least total on-time for a wanted angular impulse.

A linear programme with three equations, solved by the simplex method for bounded variables
(Chvatal, Linear Programming, 1983, chapter 8); jet selection by linear programming: Crawford,
AIAA 69-845 (1969). Non-negative least squares would give the impulse, too, but not by the least
on-time.
"""

from __future__ import annotations

from math import inf

from .block import Vec3
from .vector import dot, inverse, mat_t_vec, mat_vec, scale, sub

# The errors are columns of the programme, too, and this is what they cost: a nozzle that gives less
# than 1e-5 of the strongest one's torque about an axis is not worth firing.
_ERROR_COST = 1e5
_ERRORS: tuple[Vec3, ...] = (
    (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0),
    (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0),
)  # fmt: skip
_TOLERANCE = 1e-8
_MOST_EXCHANGES = 100  # four are usual, 22 the most seen: an end, whatever rounding does


def least_on_times(torques: tuple[Vec3, ...], impulse: Vec3, longest: float) -> tuple[float, ...]:
    """The on-time x (s) of each nozzle, 0 <= x <= longest, for an angular impulse (N m s).

    minimise  sum x + k |e|_1,   sum x torque + e = impulse,   k large: an error e is left only
    where the nozzles cannot do better. At most three nozzles fire for a part of `longest`.
    """
    n = len(torques)
    strongest = max((abs(c) for torque in torques for c in torque), default=0.0)
    if strongest == 0.0:
        return (0.0,) * n
    columns = (*(scale(1.0 / strongest, torque) for torque in torques), *_ERRORS)
    cost, most = (1.0,) * n + (_ERROR_COST,) * 6, (longest,) * n + (inf,) * 6
    goal = scale(1.0 / strongest, impulse)
    basis = [n + k if goal[k] >= 0.0 else n + 3 + k for k in range(3)]
    full: set[int] = set()
    for exchange in range(_MOST_EXCHANGES + 1):
        p, q, r = (columns[j] for j in basis)
        to_basis = inverse((p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]))
        rest = goal
        for j in full:
            rest = sub(rest, scale(longest, columns[j]))
        values = mat_vec(to_basis, rest)
        price = mat_t_vec(to_basis, (cost[basis[0]], cost[basis[1]], cost[basis[2]]))
        entering = _entering(columns, cost, price, basis, full)
        if entering < 0 or exchange == _MOST_EXCHANGES:
            break
        falls = mat_vec(to_basis, columns[entering])
        if entering in full:
            falls = scale(-1.0, falls)
        room, leaving = most[entering], -1
        for i, fall in enumerate(falls):
            if abs(fall) <= _TOLERANCE:
                continue
            reach = max((values[i] - (0.0 if fall > 0.0 else most[basis[i]])) / fall, 0.0)
            if reach < room or (reach == room and leaving >= 0 and basis[i] < basis[leaving]):
                room, leaving = reach, i
        if entering in full:
            full.remove(entering)
        elif leaving < 0:
            full.add(entering)
        if leaving >= 0:
            if falls[leaving] < 0.0:
                full.add(basis[leaving])
            basis[leaving] = entering
    on_times = [longest if j in full else 0.0 for j in range(n)]
    for j, x in zip(basis, values, strict=True):
        if j < n:
            on_times[j] = min(max(x, 0.0), longest)
    return tuple(on_times)


def _entering(
    columns: tuple[Vec3, ...],
    cost: tuple[float, ...],
    price: Vec3,
    basis: list[int],
    full: set[int],
) -> int:
    """The first column whose change pays, or -1: the first, not the best, cannot cycle (Bland)."""
    for j, column in enumerate(columns):
        gain = dot(price, column) - cost[j]
        if (gain < -_TOLERANCE if j in full else gain > _TOLERANCE) and j not in basis:
            return j
    return -1
