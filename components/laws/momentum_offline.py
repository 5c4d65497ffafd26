"""Compute H_NOM of paper 001 and the preview's tables on the ground.

A course is a prediction for N samples of dt (s), in axes that do not turn: the means of
B (T) and T_GG (N m), and S (1), the weighting. H (N m s) is the total momentum, m (A
m2) the dipole, held over a sample: H_k+1 = H_k + dt (T_GG + m x B). It needs numpy and
scipy; no block imports it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
# Exponent of the wheels' momenta in `cheapest`; high, so that the largest dominate.
EXPONENT = 8


@dataclass(frozen=True)
class Course:
    """Predicted course of N samples.

    dt (s), field (N, 3), gravity (N, 3), weighting (N, 3, 3), and the matrices from H
    to wheel momenta at the samples' ends (N, wheels, 3).
    """

    dt: float
    field: Array
    gravity: Array
    weighting: Array
    to_wheels: Array

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
    built = np.vstack([np.zeros(3), np.cumsum(course.gravity * course.dt, axis=0)])
    wave = np.stack([np.cos(2.0 * rate * t), np.sin(2.0 * rate * t)], axis=1)
    form = np.hstack([np.ones((len(t), 1)), t[:, None], wave])
    part = np.linalg.lstsq(form, built, rcond=None)[0][2:]
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
    peak: float,
    start: Array,
) -> Optimum:
    """Find the course from `start` (N m s) of least cost.

        sum m' S^-1 m + H' diag(momentum_weight) H + peak_weight sum_i (h_i / peak)^EXPONENT

    over the samples, with m' S^-1 m the squared dipoles of the coils and h (N m s) the
    wheels' momenta; weights in 1/(T2 s2) and A2 m4, peak in N m s. By Newton's method:
    each step is a linear-quadratic problem.

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
        gained, now = value - cost(better), better
        value -= gained
        if gained <= 1e-7 * value:
            return now
    raise RuntimeError("the cheapest course: Newton's method did not converge")


def least_energy(
    course: Course, peak: float, start: Array, accuracy: float = 1e-3
) -> float | None:
    """Compute a lower bound of the coils' energy (A2 m4 s) over a course.

    The energy is the integral of the squared dipoles. The course begins at `start` (N m
    s) and keeps each wheel within +-peak (N m s) at all samples' ends. The bound is
    within `accuracy` (relative) of the minimum. None where no course within the limits
    is found.

    A convex quadratic programme, by a logarithmic barrier: with 2 n limits and the
    weight w of the barrier its optimum is at most 2 n w above the minimum.
    """
    inverse = np.linalg.inv(course.weighting)
    now = _course_within(course, peak, start)
    if now is None:
        return None

    def coils(x: Optimum) -> float:
        """Sum the squared dipoles of the coils over the samples (A2 m4)."""
        return float(np.einsum("ki,kij,kj->", x.dipole, inverse, x.dipole))

    def barrier_cost(x: Optimum, w: float) -> float:
        """Return the coils' sum and the barrier of weight w; inf outside the limits."""
        gap = peak * peak - wheels(course, x) ** 2
        return coils(x) - w * float(np.log(gap).sum()) if gap.min() > 0.0 else np.inf

    limits = course.to_wheels.shape[0] * course.to_wheels.shape[1] * 2
    w = 0.1 * coils(now) / limits
    while True:
        for _ in range(30):
            h = wheels(course, now)
            gap = peak * peak - h * h
            slope, bend = (
                2.0 * w * h / gap,
                2.0 * w * (peak * peak + h * h) / (gap * gap),
            )
            step = _newton(course, slope, bend, h, start, None)
            value, better = barrier_cost(now, w), now
            for halvings in range(27):
                trial = _between(now, step, 0.5**halvings)
                if barrier_cost(trial, w) <= value:
                    better = trial
                    break
            gained = value - barrier_cost(better, w)
            now = better
            if gained <= 0.01 * w * limits:
                break
        if w * limits <= accuracy * coils(now):
            return float(course.dt * (coils(now) - w * limits))
        w *= 0.2


def _course_within(course: Course, peak: float, start: Array) -> Optimum | None:
    """Return a course that keeps the wheels within +-peak (N m s), or None."""
    weight = 1e3
    while weight < 1e9:
        trial = cheapest(course, np.full(3, 1e3), weight, 0.8 * peak, start)
        if np.abs(wheels(course, trial)).max() < 0.999 * peak:
            return trial
        weight *= 10.0
    return None


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
    interpolated = np.empty((len(times), *values.shape[1:]))
    for first in range(0, len(values) - 1, period):
        part = slice(first, min(first + period, len(values) - 1) + 1)
        inside = (times >= grid[part][0] - 1e-9) & (times <= grid[part][-1] + 1e-9)
        interpolated[inside] = CubicSpline(grid[part], values[part])(times[inside])
    return interpolated


def wheels(course: Course, x: Optimum) -> Array:
    """Compute the wheels' momenta (N, wheels) N m s at the samples' ends."""
    return np.asarray(np.einsum("kwi,ki->kw", course.to_wheels, x.momentum[1:]))


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
    from scipy.linalg import solveh_banded  # takes a while to load

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
    costate = solveh_banded(bands, right.ravel()).reshape(count, 3)
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
