"""Solve linear programmes of least weighted effort with three equations.

The method is the dual simplex method: Chvatal, Linear Programming, 1983, chapters 8 and
10, with the long steps of Maros, Computational Techniques of the Simplex Method, 2003,
section 10.3. It uses plain floats, so that it runs in any host.

`simplex` is for few columns and allows errors at a cost; it proceeds exchange by
exchange, to 1e-8. This module handles hundreds of columns and equations that hold to
1e-12.
"""

from __future__ import annotations

from math import inf

from ..contract.block import BlockError, Vec3
from .vector import AXES, dot, inverse, mat_t_vec, mat_vec, norm, scale, sub

COLUMNS = 3600  # maximum number of columns
_FIT = 1e-12  # tolerance of the equations, relative to the goal (and to 1)
# A column that changes by less, relative to its length, counts as stationary.
_PIVOT = 1e-11
# Exchanges after which steps are short and the first candidate is taken, which cannot
# cycle (Bland); 5 to 10 are usual.
_LONG = 200
_MOST_EXCHANGES = 5000


def least_effort(
    columns: tuple[Vec3, ...],
    cost: tuple[float, ...],
    most: tuple[float, ...],
    goal: Vec3,
) -> tuple[float, ...] | None:
    """Solve the linear programme of least weighted effort for x, |x| <= most.

        minimise  sum cost |x|,   sum x column = goal

    The result is None where no x meets the goal. Columns and goal should be of the size
    of 1, and cost above 0. At most three |x| are neither 0 nor at `most`.

    The dual is a maximum over three prices y, with a kink where column.y = +-cost:
    there x changes from 0 to +-most. `side` is x / most where x is not in the basis.
    From y = 0, each exchange follows an edge across as many kinks as the objective
    rises. Initially the basis consists of three columns whose bound is 0.

    Raises
    ------
    BlockError
        If rounding prevents convergence, which has not been observed.
    """
    n = len(columns)
    side, rate, reach = [0.0] * COLUMNS, [0.0] * COLUMNS, [inf] * COLUMNS
    basis, kink = [-1, -2, -3], [0.0, 0.0, 0.0]
    tolerance = _FIT * max(norm(goal), 1.0)
    for exchange in range(_MOST_EXCHANGES):
        p, q, r = (columns[j] if j >= 0 else AXES[-1 - j] for j in basis)
        to_basis = inverse((p[0], q[0], r[0], p[1], q[1], r[1], p[2], q[2], r[2]))
        rest = goal
        for j in range(n):
            if side[j] != 0.0:
                rest = sub(rest, scale(side[j] * most[j], columns[j]))
        values = mat_vec(to_basis, rest)
        leaving, excess, turn = _leaving(
            values, tuple(basis), tuple(kink), most, tolerance, exchange < _LONG
        )
        if leaving < 0:
            return _solution(tuple(basis), values, tuple(side), most)
        basis_cost = (
            kink[0] * cost[basis[0]] if basis[0] >= 0 else 0.0,
            kink[1] * cost[basis[1]] if basis[1] >= 0 else 0.0,
            kink[2] * cost[basis[2]] if basis[2] >= 0 else 0.0,
        )
        price = mat_t_vec(to_basis, basis_cost)
        step = scale(turn, mat_t_vec(to_basis, AXES[leaving]))
        stiff = _PIVOT * norm(step)
        out = basis[leaving]
        if out >= 0:  # it stays at the bound that it exceeds: `most` or 0
            side[out] = turn if turn == kink[leaving] else 0.0
        for j in range(n):
            rate[j], reach[j] = dot(step, columns[j]), inf
            if (
                most[j] > 0.0
                and abs(rate[j]) > stiff * norm(columns[j])
                and (j == out or j not in basis)
            ):
                at = kink[leaving] * cost[j] if j == out else dot(price, columns[j])
                reach[j] = _way_to_kink(side[j], rate[j], cost[j], at)
        entering = _entering(
            n, side, rate, reach, cost, most, excess, tolerance, exchange < _LONG
        )
        if entering < 0:
            return None
        way = 1.0 if rate[entering] > 0.0 else -1.0
        basis[leaving] = entering
        kink[leaving] = way if side[entering] == 0.0 else -way
        side[entering] = 0.0
    raise BlockError(f"a linear programme has no end after {_MOST_EXCHANGES} exchanges")


def _leaving(
    values: Vec3,
    basis: tuple[int, ...],
    kink: tuple[float, ...],
    most: tuple[float, ...],
    tolerance: float,
    largest_first: bool,
) -> tuple[int, float, float]:
    """Find the basis variable that leaves: the one most outside 0 to `most`.

    Otherwise the first one (Bland). Returns its place in the basis, or -1; by how much
    it is outside; and 1 or -1, as it is above or below.
    """
    leaving, excess, turn = -1, tolerance, 0.0
    for i in range(3):
        edge = kink[i] * most[basis[i]] if basis[i] >= 0 else 0.0
        over, under = values[i] - max(edge, 0.0), min(edge, 0.0) - values[i]
        worst = max(over, under)
        better = (
            worst > excess
            if largest_first
            else (worst > tolerance and (leaving < 0 or basis[i] < basis[leaving]))
        )
        if better:
            leaving, excess, turn = i, worst, 1.0 if over > under else -1.0
    return leaving, excess, turn


def _way_to_kink(side: float, rate: float, cost: float, at: float) -> float:
    """Return the step after which a column's price, now `at`, is at its next kink."""
    way = 1.0 if rate > 0.0 else -1.0
    if side == way:
        return inf
    next_kink = way if side == 0.0 else -way
    return max((next_kink * cost - at) / rate, 0.0)


def _entering(
    n: int,
    side: list[float],
    rate: list[float],
    reach: list[float],
    cost: tuple[float, ...],
    most: tuple[float, ...],
    excess: float,
    tolerance: float,
    long_step: bool,
) -> int:
    """Find the column that enters, or return -1 where the objective rises for ever.

    A long step passes kinks as long as the objective still rises: by `excess` a unit,
    which must stay above `tolerance`. What it passes changes `side`.
    """
    while True:
        entering = 0
        for j in range(1, n):
            if reach[j] < reach[entering]:
                entering = j
        if reach[entering] == inf:
            return -1
        way = 1.0 if rate[entering] > 0.0 else -1.0
        excess -= most[entering] * abs(rate[entering])
        if excess <= tolerance or not long_step:
            return entering
        side[entering] += way
        if side[entering] == way:
            reach[entering] = inf
        else:
            reach[entering] += 2.0 * cost[entering] / abs(rate[entering])


def _solution(
    basis: tuple[int, ...],
    values: Vec3,
    side: tuple[float, ...],
    most: tuple[float, ...],
) -> tuple[float, ...]:
    """Assemble x: clipped basis values, and the others at 0 or +-most."""
    return tuple(
        min(max(values[basis.index(j)], -limit), limit)
        if j in basis
        else side[j] * limit
        for j, limit in enumerate(most)
    )
