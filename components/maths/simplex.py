"""Solve linear programmes with three equations by the bounded simplex method.

Chvatal, Linear Programming, 1983, chapter 8. Plain floats are ten times faster than a
library at this size and run in any host.
"""

from __future__ import annotations

from math import inf

from ..contract.block import Vec3
from .vector import ZERO, dot, inverse, mat_t_vec, mat_vec, scale, sub

_ERRORS: tuple[Vec3, ...] = (
    (1.0, 0.0, 0.0),
    (0.0, 1.0, 0.0),
    (0.0, 0.0, 1.0),
    (-1.0, 0.0, 0.0),
    (0.0, -1.0, 0.0),
    (0.0, 0.0, -1.0),
)
_TOLERANCE = 1e-8
# Four exchanges are usual, 22 the most observed; the limit guarantees an end whatever
# rounding does.
_MOST_EXCHANGES = 100


def least_cost(
    columns: tuple[Vec3, ...],
    cost: tuple[float, ...],
    most: tuple[float, ...],
    goal: Vec3,
    error_cost: float,
) -> tuple[float, ...]:
    """Solve the linear programme of least cost for x, 0 <= x <= most.

        minimise  sum cost x + error_cost |e|_1,   sum x column + e = goal

    At most three x are neither 0 nor at `most`. Columns should be of the size of 1 or
    be zero: a gain below 1e-8 counts as zero. The units are those of the caller.
    """
    n = len(columns)
    with_errors, price_of = columns + _ERRORS, cost + (error_cost,) * 6
    limit = most + (inf,) * 6
    basis = [n + k if goal[k] >= 0.0 else n + 3 + k for k in range(3)]
    full = [False] * (n + 6)
    values = ZERO
    for exchange in range(_MOST_EXCHANGES + 1):
        p, q, r = with_errors[basis[0]], with_errors[basis[1]], with_errors[basis[2]]
        to_basis = inverse((p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]))
        rest = goal
        for j in range(n + 6):
            if full[j]:
                rest = sub(rest, scale(limit[j], with_errors[j]))
        values = mat_vec(to_basis, rest)
        price = mat_t_vec(
            to_basis, (price_of[basis[0]], price_of[basis[1]], price_of[basis[2]])
        )
        entering = _entering(with_errors, price_of, price, tuple(basis), tuple(full))
        if entering < 0 or exchange == _MOST_EXCHANGES:
            break
        falls = mat_vec(to_basis, with_errors[entering])
        if full[entering]:
            falls = scale(-1.0, falls)
        room, leaving = limit[entering], -1
        for i, fall in enumerate(falls):
            if abs(fall) <= _TOLERANCE:
                continue
            reach = max(
                (values[i] - (0.0 if fall > 0.0 else limit[basis[i]])) / fall, 0.0
            )
            if reach < room or (
                reach == room and leaving >= 0 and basis[i] < basis[leaving]
            ):
                room, leaving = reach, i
        if full[entering]:
            full[entering] = False
        elif leaving < 0:
            full[entering] = True
        if leaving >= 0:
            if falls[leaving] < 0.0:
                full[basis[leaving]] = True
            basis[leaving] = entering
    x = [most[j] if full[j] else 0.0 for j in range(n)]
    for j, value in zip(basis, values, strict=True):
        if j < n:
            x[j] = min(max(value, 0.0), most[j])
    return tuple(x)


def _entering(
    columns: tuple[Vec3, ...],
    cost: tuple[float, ...],
    price: Vec3,
    basis: tuple[int, ...],
    full: tuple[bool, ...],
) -> int:
    """Find the first column whose change reduces the cost, or return -1.

    Taking the first column, not the best one, cannot cycle (Bland).
    """
    for j, column in enumerate(columns):
        gain = dot(price, column) - cost[j]
        if (gain < -_TOLERANCE if full[j] else gain > _TOLERANCE) and j not in basis:
            return j
    return -1
