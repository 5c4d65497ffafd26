"""Estimate the effectiveness of coils and the gravity gradient in flight.

Over the time D (s) of an update the momentum H (N m s) of the whole craft changes by

    dH = s D T_GG + sum_j e_j D m_j (a_j x B) + noise,

in one set of axes, with T_GG (N m) of the law's model, m_j (A m2) the commanded dipole
of coil j, a_j its axis, B (T) the mean field of that time. A Kalman filter for a random
walk estimates x = (s, e_1 .. e_4) (1), one row of dH at a time:

    P += drift^2,   k = P c / (c'P c + noise^2),   x += k (dH - c'x),   P -= k c'P.

A coil is lost where e_j is below a half by `SURE` standard deviations. Fault detection
by a momentum balance is known: Willsky, Automatica 12 (1976) 601, surveys such methods;
it is not in paper 001.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

from ..contract.block import Mat34, Table, Vec3, Vec4
from ..maths import kalman
from ..maths.vector import ZERO, add, cross, scale

STATES = 5
# Initial x: gravity gradient as modelled, all coils fully effective.
FIRST: Table = (1.0, 1.0, 1.0, 1.0, 1.0)
SPREAD_GRAVITY, SPREAD_COIL = 0.3, 0.5  # Its standard deviations (1).
# A coil is lost where its effectiveness is SURE standard deviations below HALF, and
# works where it is as far above.
SURE, HALF = 3.0, 0.5
LEAST_SCALE, MOST_SCALE = 0.5, 2.0  # bounds of s as used
# Numbers in a row of the table of costates with a coil lost: a vector for each of four
# coils.
COSTATES = 12


def first_covariance() -> Table:
    """Return the initial covariance P (25 numbers, row-major)."""
    g, e = SPREAD_GRAVITY * SPREAD_GRAVITY, SPREAD_COIL * SPREAD_COIL
    return tuple(
        0.0 if i != j else (g if i == 0 else e)
        for i in range(STATES)
        for j in range(STATES)
    )


def passed_field(now: Vec3, before: Vec3, second: Vec3) -> Vec3:
    """Estimate the mean field (T) since the last sample from this and the last two.

    Axes do not turn; zero stands for a second one that does not exist. Adams and
    Moulton's weights.
    """
    if second == ZERO:
        return scale(0.5, add(now, before))
    newer = add(scale(5.0 / 12.0, now), scale(2.0 / 3.0, before))
    return add(newer, scale(-1.0 / 12.0, second))


def effects(
    elapsed_time: float, gravity: Vec3, axes: Mat34, coils: Vec4, b: Vec3
) -> Table:
    """Compute the matrix from x to dH, three rows of five (N m s).

    elapsed_time (s), gravity T_GG (N m), coils: their commanded dipoles (A m2), B (T), body.
    """
    g, f = scale(elapsed_time, gravity), scale(elapsed_time, b)
    p = scale(coils[0], cross((axes[0], axes[4], axes[8]), f))
    q = scale(coils[1], cross((axes[1], axes[5], axes[9]), f))
    r = scale(coils[2], cross((axes[2], axes[6], axes[10]), f))
    s = scale(coils[3], cross((axes[3], axes[7], axes[11]), f))
    return (
        g[0],
        p[0],
        q[0],
        r[0],
        s[0],
        g[1],
        p[1],
        q[1],
        r[1],
        s[1],
        g[2],
        p[2],
        q[2],
        r[2],
        s[2],
    )


def update(
    x: Table, p: Table, change: Vec3, effect: Table, noise: float, drift: float
) -> tuple[Table, Table]:
    """Return (x, P) after a momentum change (N m s).

    Parameters
    ----------
    x, p : Table
        State and covariance (row-major) before it.
    change : Vec3
        dH (N m s), in the axes of `effect`.
    effect : Table
        Matrix from x to dH, of `effects`.
    noise : float
        Standard deviation of dH (N m s).
    drift : float
        Standard deviation of the change of x from one update to the next (1).
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    product = [0.0] * STATES
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    for i in range(STATES):
        covariance[(STATES + 1) * i] += drift * drift
    for k in range(3):
        row = effect[STATES * k : STATES * k + STATES]
        for i in range(STATES):
            column = covariance[STATES * i : STATES * i + STATES]
            product[i] = _dot5(column, row)
        variance = _dot5(row, product) + noise * noise
        innovation = change[k] - _dot5(row, state)
        kalman.correct(state, covariance, product, innovation, variance, STATES)
    return tuple(state), tuple(covariance)


def find_lost_coil(x: Table, p: Table, was: int) -> int:
    """Return the number of the lost coil, from 1 on; 0: none.

    The previous result `was` holds until the opposite is certain.
    """
    worst = 1
    for j in range(2, STATES):
        if x[j] < x[worst]:
            worst = j
    spread = SURE * sqrt(max(p[(STATES + 1) * worst], 0.0))
    if x[worst] + spread < HALF:
        return worst
    return 0 if x[worst] - spread > HALF else was


def used_scale(x: Table) -> float:
    """Return s within its bounds."""
    return min(max(x[0], LEAST_SCALE), MOST_SCALE)


def shares(x: Table) -> Vec4:
    """Return the effectiveness e of the four coils, limited to 0 to 1."""
    return (_share(x[1]), _share(x[2]), _share(x[3]), _share(x[4]))


def _share(e: float) -> float:
    """Limit e to 0 to 1."""
    return min(max(e, 0.0), 1.0)


def _dot5(a: Sequence[float], b: Sequence[float]) -> float:
    """Compute the scalar product of two rows of five."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]
