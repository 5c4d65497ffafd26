"""Find the least firing time for an angular impulse over a horizon.

The momentum of the craft in an inertial frame is the sum of impulses, so the dynamics
of a whole horizon are three linear equations, and the problem is a linear programme. It
needs numpy and HiGHS.
"""

from __future__ import annotations

from threading import Thread
from typing import NamedTuple

import highspy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
PATIENCE = 2.0  # s, for a solver that a signal has ended
LARGE = 20_000  # unknowns from which on a programme may take seconds


class Plan(NamedTuple):
    """Plan of firings and dipoles in each of n intervals."""

    on_time: Array  # (n, p) s, of each thruster
    dipole: Array  # (n, c), of each coil, relative to its limit, from -1 to 1
    seconds: float  # s, sum of on_time
    # (3,) s/(N m s): derivative of the least seconds by the commanded impulse
    price: Array


def least_firing(
    impulse: Array,
    thrust: Array,
    longest: Array,
    dipole: Array,
    dipole_cost: float = 0.0,
    patience: float = 0.0,
    limits_dipole: bool = True,
) -> Plan | None:
    """Find the plan of least firing time whose impulses add up to `impulse`.

        minimise  sum (1 - patience k / n) on_time + dipole_cost sum |share|
        sum on_time thrust + sum share dipole = impulse,  0 <= on_time <= longest,  |share| <= 1

    None where there is no such plan. All in one inertial frame: impulse (3,) N m s;
    thrust (n, p, 3) N m, the mean torque of thruster j over interval k; longest (n,) s;
    dipole (n, c, 3) N m s, the impulse of coil j over interval k at its full dipole,
    without a limit where not `limits_dipole`. `dipole_cost` (s) is the cost of a full dipole
    over one interval; a small value switches off dipoles that save nothing. A small
    `patience` delays firings that could as well be early.
    """
    n, p, _ = thrust.shape
    c = dipole.shape[1]
    torques, impulses = thrust.reshape(-1, 3).T, dipole.reshape(-1, 3).T
    # seconds on both sides, as the solver's tolerances are absolute
    strength = np.abs(torques).max()
    x, price = programme(
        np.concatenate(
            [
                np.repeat(1.0 - patience * np.arange(n) / n, p),
                np.full(2 * n * c, dipole_cost),
            ]
        ),
        np.concatenate([torques, impulses, -impulses], axis=1) / strength,
        impulse / strength,
        np.zeros(n * (p + 2 * c)),
        np.concatenate(
            [
                np.repeat(longest, p),
                np.full(2 * n * c, 1.0 if limits_dipole else np.inf),
            ]
        ),
    )
    if x is None or price is None:
        return None
    on_time, plus, minus = np.split(x, [n * p, n * (p + c)])
    return Plan(
        on_time.reshape(n, p),
        (plus - minus).reshape(n, c),
        float(on_time.sum()),
        price / strength,
    )


def _run_solver(solver: highspy.Highs, size: int) -> None:
    """Run a solver; one of a large programme in a thread, so that a signal ends it."""
    if size < LARGE:
        solver.run()
        return
    solver.HandleUserInterrupt = True
    thread = Thread(target=solver.run, daemon=True)
    thread.start()
    try:
        while thread.is_alive():
            thread.join(0.1)
    except BaseException:  # of a signal: the solver ends at its next iteration
        solver.cancelSolve()
        thread.join(PATIENCE)
        raise


def programme(
    cost: Array, rows: Array, goal: Array, least: Array, most: Array
) -> tuple[Array, Array] | tuple[None, None]:
    """Solve a linear programme: minimise cost x with rows x = wanted.

    least <= x <= most. Returns x (n,), and the derivative of the least cost by each of
    `goal` (m,); None, None where there is no solution. It calls the dual simplex
    method of HiGHS itself, as scipy's function for it takes 0.3 s to import.
    """
    m, n = rows.shape
    task = highspy.HighsLp()
    task.num_col_, task.num_row_ = n, m
    task.col_cost_, task.col_lower_, task.col_upper_ = cost, least, most
    task.row_lower_ = task.row_upper_ = goal
    column, row = np.nonzero(rows.T)
    task.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    task.a_matrix_.start_ = np.searchsorted(column, np.arange(n + 1))
    task.a_matrix_.index_ = row
    task.a_matrix_.value_ = rows.T[column, row]
    solver = highspy.Highs()
    for option, value in (
        ("output_flag", False),
        ("solver", "simplex"),
        ("threads", 1),
    ):
        solver.setOptionValue(option, value)
    solver.passModel(task)
    _run_solver(solver, n)
    if solver.getModelStatus() != highspy.HighsModelStatus.kOptimal:
        return None, None
    solution = solver.getSolution()
    return np.array(solution.col_value), np.array(solution.row_dual)
