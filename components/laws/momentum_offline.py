"""Compute H_NOM of paper 001 and the preview's tables on the ground.

A course is a prediction for N samples of dt (s), in axes that do not turn: the means of
B (T) and T_GG (N m), and S (1), the weighting. H (N m s) is the total momentum, m (A
m2) the dipole, held over a sample: H_k+1 = H_k + dt (T_GG + m x B). It needs numpy and
scipy; no block imports it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import isfinite
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Exponent of the wheels' momenta in `cheapest`; high, so that the largest dominate.
EXPONENT = 8
AIM = 0.8  # share of a limit within which a first course is sought
# Weight of the power of all shares in the first descent, relative to the squared dipoles
# that take the limit of the wheels in a sample, and the number of descents, each with ten
# times the weight.
START_WEIGHT, APPROACHES = 1e-4, 14
EASE = 0.02  # by which limits are wider where a course is sought near given dipoles
LIGHT = 1e3  # 1/(T2 s2), weight of the momentum in such a descent


@dataclass(frozen=True)
class Course:
    """Predicted course of N samples.

    dt (s), field (N, 3), gravity (N, 3), weighting (N, 3, 3), the matrices from H to
    wheel momenta at the samples' ends (N, wheels, 3), and those from a dipole to the
    coils' (N, coils, 3).
    """

    dt: float
    field: Array
    gravity: Array
    weighting: Array
    to_wheels: Array
    to_coils: Array | None = None

    @property
    def effect(self) -> Array:
        """Return the effect of a dipole over each sample (N, 3, 3; T s).

        H_k+1 = ... + effect m.
        """
        return -self.dt * _skew(self.field)


@dataclass(frozen=True)
class Optimum:
    """Optimal course of the momentum, with its dipoles and costates.

    momentum (N + 1, 3) N m s, dipole (N, 3) A m2, costate (N, 3) A m2/T, with m = S (B
    x P).
    """

    momentum: Array
    dipole: Array
    costate: Array


def periodic_ends(course: Course, rate: float, period: int) -> Array:
    """Compute the profile's momentum at the ends of its periods (N m s).

    One row for each end, the start first. They lie on the motion of twice the orbital
    rate (rad/s) that gravity gradient alone leads to, which has mean zero; its secular
    part is left out.
    """
    t = course.dt * np.arange(len(course.gravity) + 1)
    momentum = np.vstack([np.zeros(3), np.cumsum(course.gravity * course.dt, axis=0)])
    wave = np.stack([np.cos(2.0 * rate * t), np.sin(2.0 * rate * t)], axis=1)
    form = np.hstack([np.ones((len(t), 1)), t[:, None], wave])
    part = np.linalg.lstsq(form, momentum, rcond=None)[0][2:]
    ends = np.append(np.arange(0, len(t) - 1, period), len(t) - 1)
    return np.asarray(wave[ends] @ part)


def profile(
    course: Course, ends: Array, period: int, start: Array
) -> tuple[Array, Array]:
    """Compute H_NOM at the samples' ends (N + 1, 3), and each period's condition.

    Consecutive open-loop solutions of `period` samples (paper 001, eqs. 2, 3 and Table
    1) lead from `start` to `ends`.
    """
    skew = _skew(course.field)
    product = skew.transpose(0, 2, 1) @ course.weighting @ skew
    rows, conditions = [np.asarray(start, float)], []
    for k, first in enumerate(range(0, len(product), period)):
        part = slice(first, first + period)
        gramian = product[part].sum(axis=0) * course.dt
        change = ends[k + 1] - rows[-1] - course.gravity[part].sum(axis=0) * course.dt
        torque = product[part] @ np.linalg.solve(gramian, change) + course.gravity[part]
        rows += list(rows[-1] + np.cumsum(torque * course.dt, axis=0))
        conditions.append(np.linalg.cond(gramian))
    return np.array(rows), np.array(conditions)


def cheapest(
    course: Course,
    momentum_weight: Array,
    peak_weight: float,
    peak: Array | float,
    start: Array,
) -> Optimum:
    """Find the course from `start` (N m s) of least cost.

        sum m' S^-1 m + H' diag(momentum_weight) H + peak_weight sum_i (h_i / peak)^EXPONENT

    over the samples, with m' S^-1 m the squared dipoles of the coils and h (N m s) the
    wheels' momenta; weights in 1/(T2 s2) and A2 m4, peak in N m s, of all samples or of
    each (N, 1). By Newton's method: each step is a linear-quadratic problem.

    Raises
    ------
    RuntimeError
        If Newton's method does not converge.
    """
    q = np.diag(np.asarray(momentum_weight, float))
    none = np.zeros((len(course.field), 3))
    flat = np.broadcast_to(np.linalg.inv(q), (len(none), 3, 3))
    now = _linear_quadratic(course, flat, none, start)
    if peak_weight == 0.0:
        return now
    inverse = np.linalg.inv(course.weighting)
    p = EXPONENT

    def cost(x: Optimum) -> float:
        """Compute the cost of a course."""
        h = x.momentum[1:]
        coils = np.einsum("ki,kij,kj->", x.dipole, inverse, x.dipole)
        large = ((wheels(course, x) / peak) ** p).sum()
        return float(coils + (h @ q * h).sum() + peak_weight * large)

    value = cost(now)
    for _ in range(60):
        h = wheels(course, now)
        slope = peak_weight * p / peak * (h / peak) ** (p - 1)
        bend = peak_weight * p * (p - 1) / peak**2 * (h / peak) ** (p - 2)
        step = _newton(course, slope, bend, h, start, q)
        share, better = 1.0, step
        while cost(better) > value and share > 1e-4:
            share *= 0.5
            better = _between(now, step, share)
        decrease, now = value - cost(better), better
        value -= decrease
        if decrease <= 1e-7 * value:
            return now
    raise RuntimeError("the cheapest course: Newton's method did not converge")


@dataclass(frozen=True)
class Limits:
    """Limits of a course: of each wheel at the samples' ends, and of each coil.

    peak (N, 1) N m s; dipole in A m2, inf without a limit.
    """

    peak: Array
    dipole: float

    def gaps(self, course: Course, x: Optimum) -> tuple[Array, Array]:
        """Return limit^2 - value^2 of wheels (N, wheels) and coils (N, coils)."""
        of_wheels = self.peak * self.peak - wheels(course, x) ** 2
        if not isfinite(self.dipole):
            return of_wheels, np.ones((len(of_wheels), 0))
        return of_wheels, self.dipole**2 - coils(course, x) ** 2

    def hold(self, course: Course, x: Optimum) -> bool:
        """Return whether a course is within the limits."""
        return all(gap.min(initial=1.0) > 0.0 for gap in self.gaps(course, x))


class LeastEnergy(NamedTuple):
    """Lower bound of the coils' energy (A2 m4 s), and by how much limits were wider."""

    energy: float
    ease: float


def least_energy(
    course: Course,
    limits: Limits,
    start: Array,
    dipoles: Array,
    accuracy: float = 1e-3,
) -> LeastEnergy | None:
    """Compute a lower bound of the coils' energy (A2 m4 s) over a course.

    The energy is the integral of the squared dipoles. The course begins at `start` (N m
    s) and keeps within the limits. The bound is within `accuracy` (relative) of the
    minimum. None where no course within the limits is found: where the coils reach
    their limit it is that of the given dipoles (N, 3; A m2), and the limits are wider by
    `EASE`.

    A convex quadratic programme, by a logarithmic barrier: with n two-sided limits and
    the weight w of the barrier its optimum is at most 2 n w above the minimum.
    """
    if limits.hold(course, _along(course, start, np.zeros_like(dipoles))):
        return LeastEnergy(0.0, 0.0)
    ease, now = 0.0, _course_within(course, limits, start)
    if now is None:
        ease, now = EASE, _along(course, start, dipoles)
        limits = Limits((1.0 + EASE) * limits.peak, (1.0 + EASE) * limits.dipole)
        if not limits.hold(course, now):
            return None
    count = 2 * sum(gap.size for gap in limits.gaps(course, now))
    w = 0.1 * _energy(course, now) / count
    while True:
        now = _descend(course, _Barrier(limits, w), start, now, 0.01 * w * count)
        energy = _energy(course, now)
        if w * count <= accuracy * energy:
            return LeastEnergy(course.dt * (energy - w * count), ease)
        w *= 0.2


class _Penalty(Protocol):
    """Cost of wheel momenta and dipoles, convex in each of them."""

    @property
    def limits(self) -> Limits:
        """Return the limits."""

    @property
    def weight(self) -> Array | None:
        """Return the weight (3, 3) 1/(T2 s2) of the momentum; None: without."""

    def total(self, course: Course, x: Optimum) -> float:
        """Return the cost of a course; inf where it has none."""

    def derivatives(self, values: Array, limit: Array | float) -> tuple[Array, Array]:
        """Return first and second derivative at values with +-limit."""


@dataclass(frozen=True)
class _Barrier:
    """Logarithmic barrier of weight w within limits."""

    limits: Limits
    w: float
    weight: None = None

    def total(self, course: Course, x: Optimum) -> float:
        gaps = self.limits.gaps(course, x)
        if min(gap.min(initial=1.0) for gap in gaps) <= 0.0:
            return np.inf
        return -self.w * sum(float(np.log(gap).sum()) for gap in gaps)

    def derivatives(self, values: Array, limit: Array | float) -> tuple[Array, Array]:
        square, gap = limit * limit, limit * limit - values**2
        slope = 2.0 * self.w * values / gap
        return slope, 2.0 * self.w * (square + values**2) / (gap * gap)


@dataclass(frozen=True)
class _Power:
    """Sum of the wheels' (value / limit)^EXPONENT with a weight, finite everywhere."""

    limits: Limits
    w: float
    weight: Array

    def total(self, course: Course, x: Optimum) -> float:
        h = x.momentum[1:]
        large = ((wheels(course, x) / self.limits.peak) ** EXPONENT).sum()
        return float(self.w * large + (h @ self.weight * h).sum())

    def derivatives(self, values: Array, limit: Array | float) -> tuple[Array, Array]:
        p, share = EXPONENT, values / limit
        bend = self.w * p * (p - 1) / limit**2 * share ** (p - 2)
        return self.w * p / limit * share ** (p - 1), bend


def _along(course: Course, start: Array, dipoles: Array) -> Optimum:
    """Return the course of given dipoles (N, 3; A m2)."""
    moves = course.dt * course.gravity
    moves = moves + np.einsum("kab,kb->ka", course.effect, dipoles)
    momentum = np.vstack([start, start + np.cumsum(moves, axis=0)])
    return Optimum(momentum, dipoles, np.zeros_like(dipoles))


def _course_within(course: Course, limits: Limits, start: Array) -> Optimum | None:
    """Return a course of little energy that keeps within the limits, or None."""
    now = _along(course, start, np.zeros((len(course.field), 3)))
    aims = Limits(AIM * limits.peak, np.inf)
    typical = float(np.mean(limits.peak**2)) / course.dt**2
    size = float((course.field**2).sum(axis=1).mean())
    weight = START_WEIGHT * typical / max(size, 1e-300)
    for _ in range(APPROACHES):
        penalty = _Power(aims, weight, LIGHT * np.eye(3))
        enough = 1e-3 * penalty.total(course, now)
        try:
            now = _descend(course, penalty, start, now, enough)
        except np.linalg.LinAlgError:  # so large a weight that rounding decides
            return None
        if limits.hold(course, now):
            return now
        weight *= 10.0
    return None


def _descend(
    course: Course, penalty: _Penalty, start: Array, now: Optimum, least: float
) -> Optimum:
    """Minimise the energy with a penalty until a step gains at most `least` (A2 m4)."""

    def cost(x: Optimum) -> float:
        """Return the cost of a course."""
        return _energy(course, x) + penalty.total(course, x)

    value = cost(now)
    for _ in range(30):
        step, better = _step(course, penalty, now, start), now
        for halvings in range(27):
            trial = _between(now, step, 0.5**halvings)
            if cost(trial) <= value:
                better = trial
                break
        decrease, now = value - cost(better), better
        value -= decrease
        if decrease <= least:
            break
    return now


def _energy(course: Course, x: Optimum) -> float:
    """Sum the squared dipoles of the coils over the samples (A2 m4)."""
    inverse = np.linalg.inv(course.weighting)
    return float(np.einsum("ki,kij,kj->", x.dipole, inverse, x.dipole))


def _step(course: Course, penalty: _Penalty, x: Optimum, start: Array) -> Optimum:
    """Minimise the quadratic model of energy and penalty around a course."""
    limits, h = penalty.limits, wheels(course, x)
    slope, bend = penalty.derivatives(h, limits.peak)
    if not isfinite(limits.dipole):
        return _newton(course, slope, bend, h, start, penalty.weight)
    assert course.to_coils is not None
    # with the penalty of the coils the cost of a dipole m is m' R m + 2 r . m
    m, to = coils(course, x), course.to_coils
    slope_of_coils, bend_of_coils = penalty.derivatives(m, limits.dipole)
    cost = np.linalg.inv(course.weighting)
    cost = cost + 0.5 * np.einsum("kca,kc,kcb->kab", to, bend_of_coils, to)
    weighting = np.linalg.inv(cost)
    r = 0.5 * np.einsum("kca,kc->ka", to, slope_of_coils - bend_of_coils * m)
    shift = np.einsum("kab,kb->ka", weighting, r)
    drift = np.einsum("kab,kb->ka", course.effect, shift) / course.dt
    shifted_course = replace(
        course, weighting=weighting, gravity=course.gravity - drift
    )
    optimum = _newton(shifted_course, slope, bend, h, start, penalty.weight)
    return replace(optimum, dipole=optimum.dipole - shift)


def feedback(course: Course, momentum_weight: Array) -> Array:
    """Compute the gain K (N, 3, 3; 1/(T2 s)) that holds a course.

    From each sample on, the cost of H' diag(momentum_weight) H and of the coils'
    squared dipoles is H'K H without disturbances.
    """
    count = len(course.field)
    weights = np.broadcast_to(
        np.diag(np.asarray(momentum_weight, float)), (count, 3, 3)
    )
    return _riccati(course, weights)


def at_rows(values: Array, dt: float, times: Array, period: int = 0) -> Array:
    """Interpolate values at k dt (rows, ...) to other times (s) by cubic splines.

    The splines end every `period` values; 0: one spline.
    """
    from scipy.interpolate import CubicSpline  # takes a while to load

    grid = dt * np.arange(len(values))
    if period == 0:
        return np.asarray(CubicSpline(grid, values)(times))
    at_times = np.empty((len(times), *values.shape[1:]))
    for first in range(0, len(values) - 1, period):
        part = slice(first, min(first + period, len(values) - 1) + 1)
        inside = (times >= grid[part][0] - 1e-9) & (times <= grid[part][-1] + 1e-9)
        at_times[inside] = CubicSpline(grid[part], values[part])(times[inside])
    return at_times


def wheels(course: Course, x: Optimum) -> Array:
    """Compute the wheels' momenta (N, wheels) N m s at the samples' ends."""
    return np.asarray(np.einsum("kwi,ki->kw", course.to_wheels, x.momentum[1:]))


def coils(course: Course, x: Optimum) -> Array:
    """Compute the coils' dipoles (N, coils) A m2 over the samples."""
    assert course.to_coils is not None
    return np.asarray(np.einsum("kca,ka->kc", course.to_coils, x.dipole))


def _between(a: Optimum, b: Optimum, share: float) -> Optimum:
    """Interpolate between two optima, linearly; the result obeys the course too."""
    return Optimum(
        a.momentum + share * (b.momentum - a.momentum),
        a.dipole + share * (b.dipole - a.dipole),
        a.costate + share * (b.costate - a.costate),
    )


def _newton(
    course: Course,
    slope: Array,
    bend: Array,
    h: Array,
    start: Array,
    weight: Array | None,
) -> Optimum:
    """Minimise a quadratic model of a cost of the wheels' momenta (N, wheels) around h.

    `slope` and `bend` are its first and second derivatives; `weight` (3, 3) is an
    additional one of H.
    """
    to = course.to_wheels
    if weight is None:
        # A wheel at its limit weighs 1e11 times as much as others. With singular values,
        # rounding does not give the inverse a negative eigenvalue.
        _, values, axes = np.linalg.svd(
            np.sqrt(0.5 * bend)[:, :, None] * to, full_matrices=False
        )
        inverse = np.einsum("kia,ki,kib->kab", axes, values**-2.0, axes)
    else:
        inverse = np.linalg.inv(
            weight + 0.5 * np.einsum("kwa,kw,kwb->kab", to, bend, to)
        )
    linear = 0.5 * np.einsum("kw,kwa->ka", slope - bend * h, to)
    return _linear_quadratic(course, inverse, linear, start)


def _linear_quadratic(
    course: Course, inverse: Array, linear: Array, start: Array
) -> Optimum:
    """Minimise sum m' S^-1 m + H_k+1' weights H_k+1 + 2 linear . H_k+1.

    The sum is over the samples k; `inverse` (N, 3, 3) is that of the weights. With P the
    costate (the multipliers of H_k+1 = H_k + dt gravity + effect m), m = S (B x P) and
    dt (weights H_k+1 + linear) = P_k+1 - P_k; so P obeys a block tridiagonal system
    without negative eigenvalues.
    """
    from scipy.linalg import solve_banded, solveh_banded  # takes a while to load

    count, dt, effect = len(course.field), course.dt, course.effect
    v, c = inverse / dt, np.einsum("kab,kb->ka", inverse, linear)
    diagonal = v + effect @ course.weighting @ effect.transpose(0, 2, 1) / dt
    diagonal[1:] += v[:-1]
    right = -dt * course.gravity - c
    right[0] -= start
    right[1:] += c[:-1]
    bands = np.zeros((6, 3 * count))  # upper: bands[5 + i - j, j] = matrix[i, j]
    for i in range(3):
        for j in range(3):
            if i <= j:
                bands[5 + i - j, j::3] = diagonal[:, i, j]
            bands[2 + i - j, 3 + j :: 3] = -v[:-1, i, j]
    try:
        costate = solveh_banded(bands, right.ravel())
    except np.linalg.LinAlgError:  # by rounding alone: elimination with pivots takes it
        lower = [np.append(bands[5 - i, i:], np.zeros(i)) for i in range(1, 6)]
        costate = solve_banded((5, 5), np.vstack([bands, lower]), right.ravel())
    costate = costate.reshape(count, 3)
    dipole = np.einsum("kab,kb->ka", course.weighting, np.cross(course.field, costate))
    moves = dt * course.gravity + np.einsum("kab,kb->ka", effect, dipole)
    momentum = np.vstack([start, start + np.cumsum(moves, axis=0)])
    return Optimum(momentum, dipole, costate)


def _riccati(course: Course, weights: Array) -> Array:
    """Compute K of the cost to go H'K H at the beginning of each sample."""
    count, effect = len(course.field), course.effect
    effort = course.dt * np.linalg.inv(course.weighting)
    weights = course.dt * weights
    solution, k_next = np.empty((count, 3, 3)), np.zeros((3, 3))
    for k in range(count - 1, -1, -1):
        ahead, e = k_next + weights[k], effect[k]
        through = e.T @ ahead
        k_next = ahead @ (
            np.eye(3) - e @ np.linalg.solve(effort[k] + through @ e, through)
        )
        k_next = solution[k] = 0.5 * (k_next + k_next.T)
    return solution


def _skew(b: Array) -> Array:
    """Build [B] of rows B: [B] v = B x v."""
    x, y, z = b.T
    o = np.zeros_like(x)
    return np.array([[o, -z, y], [z, o, -x], [-y, x, o]]).transpose(2, 0, 1)
