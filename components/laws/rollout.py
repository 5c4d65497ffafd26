"""Detumble by rollout: choose wheel torques by simulating many sequences to the end.

The model propagates the body's rate omega (rad/s), the field b (T) and the wheels'
momenta h_i (N m s) from step to step,

    J_r omega' = m x b - sum g_i u_i - omega x (J_r omega + sum g_i h_i),
    b' = -omega x b,      h_i' = u_i,

so the field is fixed in space and no attitude is needed. In each step every coil
follows the law m = K omega x b within its limit. Every wheel follows a torque of a
*sequence*, constant over each segment, and after it u_i = K_w g_i . omega within its
limit (`by_law`). The search is for the sequence after which every rate is soonest below
a limit. Torques that first turn the body about the wheels' axes swing momentum from
axes that the coils serve badly to those that the wheels take, which no law of the
present rate does.

The search draws sequences, keeps the best and draws about it, ever closer (random
search with shrinking spread; rollout: Bertsekas, Dynamic Programming and Optimal
Control, vol. 1, sec. 2.4). The law alone and the previous choice are always among the
candidates, so that in the model no choice is later than either. A sequence is dropped
once it has taken longer than the best.
"""

from __future__ import annotations

from math import inf
from typing import NamedTuple

from ..contract.block import Mat33, PerWheel, Table, Vec3, WheelColumns
from ..maths.noise import stream, uniform
from ..maths.vector import add, clip, cross, mat_vec, scale, sub
from ..physics.wheel_array import body_momentum
from .acquisition import all_coils, within

SEGMENTS = 4
_KEY = stream("rollout", "sequence", 0)
TURN = 0.25  # rad, rotation in a step up to which the model is trusted
# Torques are drawn up to this multiple of their limit, so that a third of them is at
# it.
_BEYOND = 1.5


class Model(NamedTuple):
    """Model of the craft, and the law that its coils and wheels follow."""

    carrier: Mat33  # J_r (kg m2, body)
    inverse: Mat33  # inverse of J_r (1/(kg m2))
    axes: WheelColumns  # columns: the wheels' axes, body; zero where there is no wheel
    m_limit: float  # A m2, of each coil
    torque_limit: PerWheel  # N m, of each wheel; 0 where there is none
    h_limit: float  # N m s, beyond which a wheel is not driven further
    gain: float  # K (A m2 s/T)
    gain_wheel: float  # K_w (N m s)
    rate_limit: float  # rad/s; detumbled: every rate is below it
    step: float  # s, of the model


class Sequence(NamedTuple):
    """Torques of the wheels over segments.

    The first segment began `elapsed_steps` ago.
    """

    torques: Table  # (SEGMENTS, wheels), N m, to each rotor
    segments: int  # number of segments in use, after which the law applies
    elapsed_steps: int  # steps since the first segment began


def none(model: Model) -> Sequence:
    """Return the sequence without torques: the law from now on."""
    return Sequence((0.0,) * (SEGMENTS * len(model.torque_limit)), 0, 0)


def by_law(model: Model, omega: Vec3) -> PerWheel:
    """Compute u_i = K_w g_i . omega within the limit (N m, to each rotor)."""
    g, count = model.axes, len(model.torque_limit)
    return tuple(
        within(
            model.gain_wheel
            * (g[i] * omega[0] + g[count + i] * omega[1] + g[2 * count + i] * omega[2]),
            model.torque_limit[i],
        )
        for i in range(count)
    )


def of_sequence(model: Model, torques: Table, segment: int) -> PerWheel:
    """Return the torques of a segment (N m)."""
    count = len(model.torque_limit)
    return tuple(torques[count * segment + i] for i in range(count))


def stop_overspeed(u: PerWheel, h: PerWheel, limit: float) -> PerWheel:
    """Return u without the torques that drive a wheel further beyond its limit."""
    return tuple(
        0.0 if abs(y) >= limit and x * y > 0.0 else x for x, y in zip(u, h, strict=True)
    )


def largest(omega: Vec3) -> float:
    """Return the largest rate of an axis (rad/s), in magnitude."""
    return max(abs(omega[0]), abs(omega[1]), abs(omega[2]))


def predict_cost(
    model: Model,
    omega: Vec3,
    b: Vec3,
    h: PerWheel,
    torques: Table,
    segments: int,
    elapsed_steps: int,
    length: int,
    horizon: int,
    best: float,
    fastest: float,
) -> float:
    """Simulate a sequence and count the steps until every rate is below its limit.

    Where the horizon comes first, the result is the horizon's steps plus the largest
    rate relative to the limit. It is infinite once it exceeds `best`, or a rate exceeds
    `fastest`.
    """
    plan_steps = segments * length - elapsed_steps
    for k in range(horizon):
        size = largest(omega) / model.rate_limit
        if size < 1.0:
            return k - 1.0 + size
        if k > best or largest(omega) > fastest:
            return inf
        m = clip(all_coils(omega, b, model.gain), model.m_limit)
        free = k >= plan_steps
        u = (
            by_law(model, omega)
            if free
            else of_sequence(model, torques, (k + elapsed_steps) // length)
        )
        u = stop_overspeed(u, h, model.h_limit)
        omega, b = propagate_step(model, omega, b, h, m, u)
        h = tuple(x + model.step * y for x, y in zip(h, u, strict=True))
    return horizon + largest(omega) / model.rate_limit


def propagate_step(
    model: Model, omega: Vec3, b: Vec3, h: PerWheel, m: Vec3, u: PerWheel
) -> tuple[Vec3, Vec3]:
    """Propagate (omega, b) over a step with m (A m2) and u (N m) held.

    Midpoint rule.
    """
    dt = model.step
    tau, w = body_momentum(model.axes, u), body_momentum(model.axes, h)
    slope = _slope(model, omega, b, m, tau, w)
    turn = cross(b, omega)
    middle = add(omega, scale(0.5 * dt, slope))
    b_middle = add(b, scale(0.5 * dt, turn))
    slope = _slope(model, middle, b_middle, m, tau, add(w, scale(0.5 * dt, tau)))
    return add(omega, scale(dt, slope)), add(b, scale(dt, cross(b_middle, middle)))


def _slope(model: Model, omega: Vec3, b: Vec3, m: Vec3, tau: Vec3, w: Vec3) -> Vec3:
    """Compute the angular acceleration (rad/s2, body)."""
    momentum = add(mat_vec(model.carrier, omega), w)
    torque = sub(sub(cross(m, b), tau), cross(omega, momentum))
    return mat_vec(model.inverse, torque)


def sought(
    model: Model,
    omega: Vec3,
    b: Vec3,
    h: PerWheel,
    before: Sequence,
    index: int,
    rounds: int,
    candidates: int,
    length: int,
    horizon: int,
) -> tuple[Sequence, float]:
    """Search the best sequence from here; return it and its cost (see `predict_cost`).

    index: number of the search, for the draws; candidates: sequences in each round;
    length (steps): of a segment; horizon (steps): of a simulation.
    """
    fastest = max(TURN / model.step, largest(omega))
    count = len(model.torque_limit)
    torques, segments, elapsed_steps = none(model)
    cost = predict_cost(model, omega, b, h, torques, 0, 0, length, horizon, inf, inf)
    if cost <= 0.0:
        return none(model), cost
    again = predict_cost(
        model,
        omega,
        b,
        h,
        before.torques,
        before.segments,
        before.elapsed_steps,
        length,
        horizon,
        cost,
        fastest,
    )
    if again < cost:
        cost, torques = again, before.torques
        segments, elapsed_steps = before.segments, before.elapsed_steps
    spread = 1.0
    for k in range(rounds):
        centre, used, centre_elapsed = torques, segments, elapsed_steps
        for i in range(candidates):
            number = (candidates * k + i) * (SEGMENTS * count)
            anew = k == 0 or used == 0
            about = none(model).torques if anew else centre
            trial = tuple(
                within(
                    about[j]
                    + spread
                    * _BEYOND
                    * model.torque_limit[j % count]
                    * (2.0 * uniform(_KEY, index, number + j) - 1.0),
                    model.torque_limit[j % count],
                )
                for j in range(SEGMENTS * count)
            )
            many = 1 + i % SEGMENTS if anew else used
            since = 0 if anew else centre_elapsed
            trial_cost = predict_cost(
                model, omega, b, h, trial, many, since, length, horizon, cost, fastest
            )
            if trial_cost < cost:
                cost, torques, segments, elapsed_steps = trial_cost, trial, many, since
        spread *= 0.5
    return Sequence(torques, segments, elapsed_steps), cost
