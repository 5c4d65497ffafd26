"""What a law of momentum management learns in flight of its coils and of gravity
gradient.

Over the time D (s) of an update the momentum H (N m s) of the whole craft changes by

    dH = s D T_GG + sum_j e_j D m_j (a_j x B) + noise,

in one set of axes, T_GG (N m) as the law knows it, m_j (A m2) the dipole that coil j
was commanded, a_j its axis, B (T) the mean field of that time. x = (s, e_1 .. e_4) (1)
is estimated by a Kalman filter for a random walk, a row of dH at a time:

    P += drift^2,   k = P c / (c'P c + noise^2),   x += k (dH - c'x),   P -= k c'P.

A coil is lost where e_j is below a half by `SURE` standard deviations. Fault detection
by a momentum balance: known, Willsky, Automatica 12 (1976) 601, surveys its kin; not in
paper 001.
"""

from __future__ import annotations

from math import sqrt

from ..contract.block import Mat34, Table, Vec3, Vec4
from ..maths.vector import ZERO, add, cross, scale

STATES = 5
FIRST: Table = (1.0, 1.0, 1.0, 1.0, 1.0)
"""x before anything is known: gravity gradient as modelled, all coils whole."""
SPREAD_GRAVITY, SPREAD_COIL = 0.3, 0.5
"""Its standard deviations (1)."""
SURE, HALF = 3.0, 0.5
"""A coil is lost where its share is so many standard deviations below a half, whole
above it."""
LEAST_SCALE, MOST_SCALE = 0.5, 2.0
"""What of s is used."""
LOST = 12
"""Numbers in a row of the table of costates with a coil lost: a vector for each of four
coils."""


def first_covariance() -> Table:
    """P (25 numbers, row-major) before anything is known."""
    g, e = SPREAD_GRAVITY * SPREAD_GRAVITY, SPREAD_COIL * SPREAD_COIL
    return tuple(
        0.0 if i != j else (g if i == 0 else e)
        for i in range(STATES)
        for j in range(STATES)
    )


def passed_field(now: Vec3, before: Vec3, second: Vec3) -> Vec3:
    """The mean of the field (T) since the last sample, from this and the last two, in
    axes that do not turn; zero stands for a second one that there is not. Adams and
    Moulton's weights."""
    if second == ZERO:
        return scale(0.5, add(now, before))
    newer = add(scale(5.0 / 12.0, now), scale(2.0 / 3.0, before))
    return add(newer, scale(-1.0 / 12.0, second))


def effects(elapsed: float, gravity: Vec3, axes: Mat34, coils: Vec4, b: Vec3) -> Table:
    """What makes dH of x, three rows of five (N m s): elapsed (s), T_GG (N m), the
    dipoles that the coils were commanded (A m2) and B (T), body."""
    g, f = scale(elapsed, gravity), scale(elapsed, b)
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


def learnt(
    x: Table, p: Table, change: Vec3, rows: Table, noise: float, drift: float
) -> tuple[Table, Table]:
    """(x, P) after an update that changed the momentum by `change` (N m s), with the
    `rows` of `effects`; noise (N m s) of an update, drift (1) of x from one to the
    next."""
    walk = drift * drift
    p = tuple(
        p[STATES * i + j] + (walk if i == j else 0.0)
        for i in range(STATES)
        for j in range(STATES)
    )
    for k in range(3):
        c = rows[STATES * k : STATES * k + STATES]
        pc = tuple(_dot5(p[STATES * i : STATES * i + STATES], c) for i in range(STATES))
        size = _dot5(c, pc) + noise * noise
        miss = (change[k] - _dot5(c, x)) / size
        x = tuple(x[i] + pc[i] * miss for i in range(STATES))
        p = tuple(
            p[STATES * i + j] - pc[i] * pc[j] / size
            for i in range(STATES)
            for j in range(STATES)
        )
    return x, p


def lost(x: Table, p: Table, was: int) -> int:
    """The coil that is lost, from 1 on; 0: none. What was said stays until the opposite
    is sure."""
    worst = 1
    for j in range(2, STATES):
        if x[j] < x[worst]:
            worst = j
    spread = SURE * sqrt(max(p[(STATES + 1) * worst], 0.0))
    if x[worst] + spread < HALF:
        return worst
    return 0 if x[worst] - spread > HALF else was


def used_scale(x: Table) -> float:
    """s as far as it is used."""
    return min(max(x[0], LEAST_SCALE), MOST_SCALE)


def shares(x: Table) -> Vec4:
    """e of the four coils, from 0 to 1."""
    return (_share(x[1]), _share(x[2]), _share(x[3]), _share(x[4]))


def _share(e: float) -> float:
    return min(max(e, 0.0), 1.0)


def _dot5(a: Table, b: Table) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4]
