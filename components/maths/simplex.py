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
        values = mat_vec(to_basis, _remainder(goal, with_errors, limit, tuple(full)))
        price = mat_t_vec(
            to_basis, (price_of[basis[0]], price_of[basis[1]], price_of[basis[2]])
        )
        entering = _entering(with_errors, price_of, price, tuple(basis), tuple(full))
        if entering < 0 or exchange == _MOST_EXCHANGES:
            break
        falls = mat_vec(to_basis, with_errors[entering])
        if full[entering]:
            falls = scale(-1.0, falls)
        leaving = _leaving(falls, values, tuple(basis), limit, limit[entering])
        if full[entering]:
            full[entering] = False
        elif leaving < 0:
            full[entering] = True
        if leaving >= 0:
            if falls[leaving] < 0.0:
                full[basis[leaving]] = True
            basis[leaving] = entering
    return _solution(tuple(basis), values, tuple(full), most)


def _remainder(
    goal: Vec3,
    columns: tuple[Vec3, ...],
    limit: tuple[float, ...],
    full: tuple[bool, ...],
) -> Vec3:
    """Return the goal less the columns that are at their limit."""
    rest = goal
    for j, column in enumerate(columns):
        if full[j]:
            rest = sub(rest, scale(limit[j], column))
    return rest


def _solution(
    basis: tuple[int, ...],
    values: Vec3,
    full: tuple[bool, ...],
    most: tuple[float, ...],
) -> tuple[float, ...]:
    """Assemble x: those of the basis limited, the others 0 or `most`."""
    x = [limit if full[j] else 0.0 for j, limit in enumerate(most)]
    for j, value in zip(basis, values, strict=True):
        if j < len(most):
            x[j] = min(max(value, 0.0), most[j])
    return tuple(x)


def _leaving(
    falls: Vec3,
    values: Vec3,
    basis: tuple[int, ...],
    limit: tuple[float, ...],
    step: float,
) -> int:
    """Find the place in the basis that reaches a bound first, before `step`, or -1.

    `falls` says by how much each of `values` falls in a unit of the entering variable.
    """
    leaving = -1
    for i, fall in enumerate(falls):
        if abs(fall) <= _TOLERANCE:
            continue
        bound = 0.0 if fall > 0.0 else limit[basis[i]]
        reach = max((values[i] - bound) / fall, 0.0)
        if reach < step or (
            reach == step and leaving >= 0 and basis[i] < basis[leaving]
        ):
            step, leaving = reach, i
    return leaving


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
