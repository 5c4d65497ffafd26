"""Plan coils and thrusters over a forecast of field and torque, by Newton's method.

Over intervals k of dt_k (s), with X (N m s) the wheels' momentum less its target, D_k
the change of it in the forecast, and actuators j with |u_kj| <= u_max,j, all in one
inertial frame:

    X_k+1 = X_k + D_k + sum_j g_kj u_kj

u is a dipole (A m2; g = e dt a x B) or an on-time (s; g = e tau). `plan_path` minimises

    J = sum_k dt_k [ sum_j r_j u_kj^2 / 2 + q |X_k+1|^2 / 2 + w_p sum_i (h_i / h_s)^16 ]

with h_i = a_ki . X_k+1 + b_i the momentum of wheel i. Each step expands J to second
order in X; actuators that stand at a bound and would not leave it are held there. The
rest follows from a backward sweep of 3 x 3 matrices (Riccati). The new u follows from a
forward sweep that feeds back what the bounds remove, with the step halved until J
falls. Any plan at which the iteration stops can therefore be flown and is better than
the first one.

`plan_unloading` minimises sum (r_j u_kj^2 / 2 + c_kj |u_kj|) + W |X_N|^2 / 2. There the
costate W X_N is the same for all intervals, so only three numbers are unknown: they
maximise a concave function, the dual, whose second derivative jumps where an actuator
leaves zero or reaches its bound. r is large at first. A step takes a running mean of the
Hessians, so that it allows for both sides of a jump, and its length is that at which
the dual along it is nearly largest. Steps that are only halved where the dual falls
leave 1.5 % of plans without convergence.

Bertsekas, SIAM J. Control Optim. 20 (1982) 221 (projected Newton); Tassa, Mansard,
Todorov, IEEE ICRA (2014) (the sweep with bounds). The peak as a high power is that of
the space telescope's preview.
"""

from __future__ import annotations

from math import sqrt
from typing import NamedTuple

from ..contract.block import Mat33, Table, Vec3
from ..maths import matrix
from ..maths.matrix import multiply, transpose
from ..maths.vector import (
    IDENTITY,
    ZERO,
    add,
    dot,
    mat_t_vec,
    mat_vec,
    norm,
    scale,
    sub,
)

Vectors = tuple[Vec3, ...]
Matrices = tuple[Mat33, ...]

INTERVALS = 64  # maximum number of intervals of a plan
PATH_INTERVALS = 40  # maximum number of intervals of a plan by `plan_path`
COILS = 3  # commands to coils in an interval
THRUSTERS = 3  # axes of thrusters
ACTUATORS = COILS + THRUSTERS
STEPS = 30  # maximum number of Newton steps of a plan by `plan_path`
HALVINGS = 12  # maximum number of halvings of a Newton step
TRIALS = 80  # maximum number of trials in each stage of `plan_unloading`
STAGES = (1000.0, 100.0, 10.0, 1.0)  # multiples of r, one after the other
SEARCHES = 8  # maximum number of trials along one step of `plan_unloading`
FLAT = 0.3  # A step ends where the slope of the dual is below this times its first one.
LEAST_PART = 0.2  # least part of the bracket by which a trial shortens it
RENEWED = 0.85  # weight of the newest Hessian in the mean that a step takes
CONVERGED = (
    1e-4  # A plan has converged where a step lowers J by less than this fraction.
)
POWER = 16.0  # of the wheels' momentum in J
NO_PLAN: Table = (0.0,) * (COILS * PATH_INTERVALS)
ZERO_MATRIX: Mat33 = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
_ROUNDING = 1e-15  # least part of a diagonal element that is left in `root`


def root(m: Mat33) -> Mat33:
    """Compute L with m = L L', lower triangular (Cholesky).

    m is symmetric and positive definite.
    """
    a = sqrt(m[0])
    b, c = m[3] / a, m[6] / a
    d = sqrt(max(m[4] - b * b, _ROUNDING * m[4]))
    e = (m[7] - c * b) / d
    return (
        a,
        0.0,
        0.0,
        b,
        d,
        0.0,
        c,
        e,
        sqrt(max(m[8] - c * c - e * e, _ROUNDING * m[8])),
    )


def inverse_of_lower(m: Mat33) -> Mat33:
    """Compute L^-1 of a lower triangular L."""
    a, b, c = 1.0 / m[0], 1.0 / m[4], 1.0 / m[8]
    d, e = -m[3] * a * b, -m[7] * b * c
    return (a, 0.0, 0.0, d, b, 0.0, -(m[6] * a + m[7] * d) * c, e, c)


class PathProblem(NamedTuple):
    """What `plan_path` plans: intervals, actuators and costs, in one inertial frame."""

    intervals: int  # their number
    start: Vec3  # X_0 (N m s)
    dt: Table  # lengths of the intervals (s)
    drift: Vectors  # D_k (N m s)
    effect: Vectors  # g_kj, COILS an interval (N m s by a unit of u)
    price: float  # r
    limits: Table  # u_max,j
    wheel_axes: Vectors  # a_ki, one of each wheel an interval
    offset: Table  # b_i (N m s)
    stiffness: float  # q
    peak: float  # w_p; 0: peaks have no cost
    peak_scale: float  # h_s (N m s)


class UnloadingProblem(NamedTuple):
    """What `plan_unloading` plans: intervals, actuators and costs, in one inertial frame."""

    intervals: int  # their number
    rest: Vec3  # X_0 + sum D, the momentum without the actuators (N m s)
    effect: Vectors  # g_kj, ACTUATORS an interval, coils first (N m s by a unit of u)
    price: float  # r of a second, and of a coil's whole dipole
    limits: Table  # the coils' whole dipoles (A m2)
    fee: Table  # c of the thrusters in each interval
    longest: Table  # u_max (s) of the thrusters, THRUSTERS an interval
    weight: float  # W


class Sweep(NamedTuple):
    """What a backward sweep gives the forward sweep, interval by interval.

    The change of X to second order: V_k = dX' P_k dX / 2 + p_k' dX, with
    M_k = P_k+1 + dt_k Q_k and m_k = p_k+1 + dt_k q_k of the cost's derivatives Q and q,
    and S_k = sum g g' / (r dt_k) over the actuators that are free.
    """

    free: Table  # COILS an interval: 1 where u may move, 0 where it stays at its limit
    hessian: Matrices  # M_k
    gradient: Vectors  # m_k
    transition: Matrices  # (1 + S_k M_k)^-1
    step: Vectors  # S_k m_k + sum g u over the free actuators (N m s)


def penalise_peaks(problem: PathProblem, peak: float, peak_scale: float) -> PathProblem:
    """Return the problem with the weight w_p = `peak` and h_s = `peak_scale` (N m s)."""
    return PathProblem(*problem[:-2], peak, peak_scale)


def path_cost_derivatives(problem: PathProblem, k: int, x: Vec3) -> tuple[Vec3, Mat33]:
    """Compute gradient and Hessian of the path's cost at X_k+1 = x (N m s).

    The cost is q |X|^2 / 2 + w_p sum (h_i / h_s)^16.
    """
    peak, peak_scale = problem.peak, problem.peak_scale
    gradient = scale(problem.stiffness, x)
    hessian = matrix.scale(problem.stiffness, IDENTITY)
    if peak > 0.0:
        for i in range(len(problem.offset)):
            axis = problem.wheel_axes[len(problem.offset) * k + i]
            s = (dot(axis, x) + problem.offset[i]) / peak_scale
            s2 = s * s
            s4 = s2 * s2
            s14 = s4 * s4 * s4 * s2
            first = POWER * peak / peak_scale * s14 * s
            second = POWER * (POWER - 1.0) * peak / (peak_scale * peak_scale) * s14
            gradient = add(gradient, scale(first, axis))
            hessian = matrix.add_square(hessian, axis, second)
    return gradient, hessian


def plan_path(
    problem: PathProblem, first: Table
) -> tuple[Table, Vec3, Vectors, int, bool]:
    """Plan dipoles u that minimise J, beginning with the plan `first`.

    Parameters
    ----------
    problem : PathProblem
        Intervals, actuators and costs.
    first : Table
        COILS values an interval (A m2); those beyond the limits are limited.

    Returns
    -------
    tuple
        u (A m2); the costate of the first interval, dJ / dX_1; X_1 .. X_count (N m s);
        the number of Newton steps; whether J converged.
    """
    u = [0.0] * (COILS * PATH_INTERVALS)
    trial_u = [0.0] * (COILS * PATH_INTERVALS)
    path: list[Vec3] = [ZERO] * PATH_INTERVALS
    trial_path: list[Vec3] = [ZERO] * PATH_INTERVALS
    cost = _follow_plan(problem, first, u, path)
    steps, has_converged = 0, False
    while steps < STEPS and not has_converged:
        steps += 1
        sweep = _sweep_backward(problem, u, path)
        fraction, trial_cost = 1.0, cost
        has_improved, is_flat = False, False
        for _ in range(HALVINGS):
            trial_cost = _sweep_forward(
                problem, fraction, sweep, u, path, trial_u, trial_path
            )
            if trial_cost < cost:
                has_improved = True
                break
            is_flat = is_flat or trial_cost - cost <= CONVERGED * CONVERGED * cost
            fraction *= 0.5
        if not has_improved:
            has_converged = is_flat
            break
        has_converged = cost - trial_cost <= CONVERGED * cost
        cost = trial_cost
        for i in range(COILS * problem.intervals):
            u[i] = trial_u[i]
        for k in range(problem.intervals):
            path[k] = trial_path[k]
    costate = ZERO
    for step_back in range(problem.intervals):
        k = problem.intervals - 1 - step_back
        slope, _ = path_cost_derivatives(problem, k, path[k])
        costate = add(costate, scale(problem.dt[k], slope))
    return tuple(u), costate, tuple(path), steps, has_converged


def _next_momentum(problem: PathProblem, k: int, x: Vec3, u: list[float]) -> Vec3:
    """Return X_k+1 (N m s) that follows from x = X_k and the plan u."""
    momentum = add(x, problem.drift[k])
    for j in range(COILS):
        i = COILS * k + j
        if u[i] != 0.0:
            momentum = add(momentum, scale(u[i], problem.effect[i]))
    return momentum


def _add_interval_cost(
    cost: float, problem: PathProblem, k: int, u: list[float], x: Vec3
) -> float:
    """Return `cost` plus that of interval k, with x = X_k+1 (N m s)."""
    for j in range(COILS):
        v = u[COILS * k + j]
        cost += problem.dt[k] * (0.5 * problem.price * v * v)
    path = 0.5 * problem.stiffness * dot(x, x)
    if problem.peak > 0.0:
        for i in range(len(problem.offset)):
            axis = problem.wheel_axes[len(problem.offset) * k + i]
            s = (dot(axis, x) + problem.offset[i]) / problem.peak_scale
            s2 = s * s
            s4 = s2 * s2
            s8 = s4 * s4
            path += problem.peak * s8 * s8
    return cost + problem.dt[k] * path


def _follow_plan(
    problem: PathProblem, first: Table, u: list[float], path: list[Vec3]
) -> float:
    """Fill `u` with the plan `first` within its limits, and `path`; return J."""
    cost, x = 0.0, problem.start
    for k in range(problem.intervals):
        for j in range(COILS):
            limit = problem.limits[j]
            i = COILS * k + j
            u[i] = min(max(first[i], -limit), limit)
        x = _next_momentum(problem, k, x, u)
        path[k] = x
        cost = _add_interval_cost(cost, problem, k, u, x)
    return cost


def _sweep_backward(problem: PathProblem, u: list[float], path: list[Vec3]) -> Sweep:
    """Expand J to second order about the plan u and minimise it from the end on.

    With b_k = sum g u over the free actuators,

        P_k = M_k (1 + S_k M_k)^-1,      p_k = (1 + S_k M_k)^-T m_k - P_k b_k.
    """
    free = [0.0] * (COILS * PATH_INTERVALS)
    hessians: list[Mat33] = [ZERO_MATRIX] * PATH_INTERVALS
    gradients: list[Vec3] = [ZERO] * PATH_INTERVALS
    transitions: list[Mat33] = [ZERO_MATRIX] * PATH_INTERVALS
    steps: list[Vec3] = [ZERO] * PATH_INTERVALS
    value_hessian, value_gradient = ZERO_MATRIX, ZERO
    costate = ZERO  # dJ / dX along the plan as it is
    for step_back in range(problem.intervals):
        k = problem.intervals - 1 - step_back
        slope, curvature = path_cost_derivatives(problem, k, path[k])
        slope = scale(problem.dt[k], slope)
        costate = add(costate, slope)
        gradient = add(value_gradient, slope)
        hessian = matrix.add(value_hessian, matrix.scale(problem.dt[k], curvature))
        for j in range(COILS):
            free[COILS * k + j] = _is_free(problem, k, j, u[COILS * k + j], costate)
        effect, offset = _sum_free_effects(problem, k, u, free)
        transition, value_hessian = _solve_interval(hessian, effect)
        hessians[k], gradients[k], transitions[k] = hessian, gradient, transition
        steps[k] = add(mat_vec(effect, gradient), offset)
        value_gradient = sub(
            mat_t_vec(transition, gradient), mat_vec(value_hessian, offset)
        )
    return Sweep(
        tuple(free),
        tuple(hessians),
        tuple(gradients),
        tuple(transitions),
        tuple(steps),
    )


def _is_free(problem: PathProblem, k: int, j: int, v: float, costate: Vec3) -> float:
    """Return 0.0 where actuator j is off, or J falls by leaving its limit; else 1.0."""
    limit = problem.limits[j]
    if limit <= 0.0:
        return 0.0
    slope = dot(problem.effect[COILS * k + j], costate)
    slope += problem.dt[k] * problem.price * v
    return 0.0 if abs(v) >= limit and v * slope < 0.0 else 1.0


def _sum_free_effects(
    problem: PathProblem, k: int, u: list[float], free: list[float]
) -> tuple[Mat33, Vec3]:
    """Return S_k = sum g g' / (r dt_k) and sum g u over the free actuators."""
    square, total = ZERO_MATRIX, ZERO
    w = 1.0 / (problem.dt[k] * problem.price)
    for j in range(COILS):
        i = COILS * k + j
        if free[i] != 0.0:
            effect = problem.effect[i]
            total = add(total, scale(u[i], effect))
            square = matrix.add_square(square, effect, w)
    return square, total


def _solve_interval(hessian: Mat33, effect: Mat33) -> tuple[Mat33, Mat33]:
    """Return (1 + S M)^-1 and M (1 + S M)^-1 for M = `hessian`, S = `effect`.

    With M = L L' and Z Z' = (1 + L' S L)^-1 they are L'^-1 Z Z' L' and L Z Z' L'.
    This form keeps precision in the directions in which M is small.
    """
    lower = root(hessian)
    upper = transpose(lower)
    scaled_effect = matrix.add(IDENTITY, multiply(upper, multiply(effect, lower)))
    z = inverse_of_lower(root(scaled_effect))
    product = multiply(z, upper)
    left_factor = transpose(multiply(z, inverse_of_lower(lower)))
    return multiply(left_factor, product), multiply(transpose(product), product)


def _sweep_forward(
    problem: PathProblem,
    fraction: float,
    sweep: Sweep,
    u: list[float],
    path: list[Vec3],
    new_u: list[float],
    new_path: list[Vec3],
) -> float:
    """Fill `new_u` and `new_path` with a plan a `fraction` of a Newton step on.

    A control u beyond its limit is set to the limit. The momentum then differs from the
    step's, and the next intervals correct the difference by feedback. Returns the cost
    J of the new plan; its unit is that of `price` u^2 dt.
    """
    cost, x = 0.0, problem.start
    change = ZERO
    for k in range(problem.intervals):
        ahead = sub(change, scale(fraction, sweep.step[k]))
        ahead = mat_vec(sweep.transition[k], ahead)
        costate = add(
            mat_vec(sweep.hessian[k], ahead), scale(fraction, sweep.gradient[k])
        )
        for j in range(COILS):
            i = COILS * k + j
            v = u[i]
            if sweep.free[i] != 0.0:
                pull = dot(problem.effect[i], costate) / (problem.dt[k] * problem.price)
                v -= fraction * v + pull
                v = min(max(v, -problem.limits[j]), problem.limits[j])
            new_u[i] = v
        x = _next_momentum(problem, k, x, new_u)
        new_path[k] = x
        change = sub(x, path[k])
        cost = _add_interval_cost(cost, problem, k, new_u, x)
    return cost


def plan_unloading(
    problem: UnloadingProblem, tolerance: float, stride: float
) -> tuple[Table, int, bool]:
    """Plan dipoles and on-times that lead the momentum to zero.

    Parameters
    ----------
    problem : UnloadingProblem
        What is planned.
    tolerance : float
        Between the end and the one that W implies (N m s).
    stride : float
        Limit of the costate's change in a step.

    Returns
    -------
    tuple
        u (A m2 and s); the number of steps; whether it converged to `tolerance`.
    """
    u = [0.0] * (ACTUATORS * INTERVALS)
    costate = ZERO
    steps, has_converged = 0, False
    for stage in STAGES:
        gradient, hessian = _evaluate_dual(problem, stage, costate, u)
        steps += 1
        mean_hessian = hessian
        nearest, least = costate, dot(gradient, gradient)
        trials, has_converged = 1, False
        while trials < TRIALS:
            has_converged = dot(gradient, gradient) <= tolerance * tolerance
            if has_converged:
                break
            inverse = inverse_of_lower(root(mean_hessian))
            step = mat_t_vec(inverse, mat_vec(inverse, gradient))
            # limited, as only the slope is known where no actuator is free
            step = scale(min(1.0, stride / max(norm(step), 1e-300)), step)
            slope = dot(gradient, step)
            begin, fraction = costate, 1.0
            low, low_slope, high, high_slope = 0.0, slope, 1.0, 0.0
            for _ in range(SEARCHES):
                costate = add(begin, scale(fraction, step))
                gradient, hessian = _evaluate_dual(problem, stage, costate, u)
                trials += 1
                steps += 1
                here = dot(gradient, step)
                if here < -FLAT * slope:
                    high, high_slope = fraction, here
                elif fraction < high and here > FLAT * slope:
                    low, low_slope = fraction, here
                else:
                    break
                secant = low_slope / (low_slope - high_slope)
                share = min(max(secant, LEAST_PART), 1.0 - LEAST_PART)
                fraction = low + (high - low) * share
            mean_hessian = matrix.add(
                matrix.scale(1.0 - RENEWED, mean_hessian),
                matrix.scale(RENEWED, hessian),
            )
            if dot(gradient, gradient) < least:
                nearest, least = costate, dot(gradient, gradient)
        if not has_converged:
            costate = nearest
    if not has_converged:
        gradient, _ = _evaluate_dual(problem, STAGES[3], costate, u)
    return tuple(u), steps, has_converged


def _evaluate_dual(
    problem: UnloadingProblem, stage: float, costate: Vec3, u: list[float]
) -> tuple[Vec3, Mat33]:
    """Fill `u` with the plan that a costate asks for; return derivatives of the dual.

    The dual is the concave function that the costate maximises. Returns its gradient
    (N m s), which is the end less the one that W implies, and its Hessian's opposite.
    """
    w = 1.0 / problem.weight
    gradient = sub(problem.rest, scale(w, costate))
    hessian = matrix.scale(w, IDENTITY)
    for i in range(ACTUATORS * problem.intervals):
        k, j = i // ACTUATORS, i % ACTUATORS
        if j < COILS:
            limit, deadband = problem.limits[j], 0.0
            unit = max(limit * limit, 1e-12)
        else:
            limit = problem.longest[THRUSTERS * k + j - COILS]
            deadband = problem.fee[k]
            unit = 1.0
        effect = problem.effect[i]
        pull = dot(effect, costate)
        excess = abs(pull) - deadband
        r = stage * (problem.price / unit)
        v = 0.0
        if excess > 0.0 and limit > 0.0:
            v = excess / r
            if v < limit:
                hessian = matrix.add_square(hessian, effect, 1.0, r)
            v = min(v, limit)
            v = -v if pull > 0.0 else v
            gradient = add(gradient, scale(v, effect))
        u[i] = v
    return gradient, hessian


def find_largest_momentum(problem: PathProblem, path: Vectors) -> float:
    """Find the largest momentum of a wheel (N m s) along X_1 .. X_count."""
    largest = 0.0
    for k in range(problem.intervals):
        for i in range(len(problem.offset)):
            a, b, c = problem.wheel_axes[len(problem.offset) * k + i]
            x = path[k]
            h = problem.offset[i] + a * x[0] + b * x[1] + c * x[2]
            largest = max(largest, abs(h))
    return largest
