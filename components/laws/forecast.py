"""Forecast what changes the momentum of a craft over the intervals of a plan.

Two-body motion gives position and velocity ahead, a model the field, `Pointing` the
attitude, and `disturbance_learning` the torques. Each interval is integrated by Gauss'
formula with two points. The results are those that `predictive` plans with.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..contract.block import Mat33, Mat34, Table, Vec3, Vec4
from ..maths.attitude import product, rotate, rotate_back
from ..maths.vector import AXES, ZERO, add, cross, dot, mat_vec, norm, scale, sub
from ..physics.orbit import (
    Elements,
    elements_from_state,
    latitude_of,
    lvlh_attitude,
)
from ..physics.torques import gravity_gradient_eci
from . import disturbance_learning as learning
from . import predictive, slew
from .receding_horizon import coast

AT_1, AT_2 = 0.21132486540518713, 0.7886751345948129  # Gauss points
Field = Callable[[Vec3, Vec3, float], Vec3]  # B (T, eci) at r (m) with v (m/s), t (s)


class Craft(NamedTuple):
    """What a forecast assumes of the craft."""

    inertia: Mat33  # kg m2, body
    coil_axes: Mat34  # columns, body; zero where there is no coil
    dipoles: predictive.Vectors  # 1, body: of a unit of each command to the coils
    thrust: Vec3  # N m, torque that the thrusters give about each axis
    to_wheels: Table  # pseudo-inverse of the wheels' axes
    target: Vec3  # N m s, body: momentum that the wheels keep
    disturbances: Table  # x of `disturbance_learning`


class Pointing(NamedTuple):
    """Attitude at a time, and what it follows from there on."""

    t: float  # s
    q: Vec4  # body from eci
    from_lvlh: Vec4  # body from lvlh
    is_turning: bool  # whether it is fixed to lvlh, but for the slew; else to eci
    slew: slew.Slew


class Forecast(NamedTuple):
    """What happens in the intervals of a plan, in eci."""

    drift: predictive.Vectors  # N m s, change of X in each interval
    effect: predictive.Vectors  # N m s, change of X by a unit of each actuator
    wheel_axes: predictive.Vectors  # 1, at the end of each interval
    stiffness: float  # n^2 / b^2 (1/(T2 s2))


def lay_grid(
    reach: float, period: float, longest: float, is_growing: bool
) -> tuple[int, Table]:
    """Return the number of intervals of a plan, and their lengths (s).

    Parameters
    ----------
    reach : float
        Time over which the plan reaches (s).
    period : float
        Time from plan to plan, the length of the first interval (s).
    longest : float
        Limit of intervals that grow (s).
    is_growing : bool
        Whether each interval is twice as long as that before it; else all consist of
        whole periods, as few in each as the number of intervals allows.
    """
    dt = [0.0] * predictive.INTERVALS
    most = predictive.PATH_INTERVALS if is_growing else predictive.INTERVALS
    count, begin, size = 0, 0.0, period
    while count < most and begin < reach - 0.5 * period:
        dt[count] = size
        begin += size
        count += 1
        if is_growing:
            size = min(2.0 * size, longest)
        else:
            samples = int((reach - begin) / period + 0.5)
            slots = max(most - count, 1)
            size = period * float(max((samples + slots - 1) // slots, 1))
    return count, tuple(dt)


def predict(
    craft: Craft,
    pointing: Pointing,
    r: Vec3,
    v: Vec3,
    field: Field,
    offset: Vec3,
    count: int,
    dt: Table,
    actuators: int,
) -> Forecast:
    """Predict drift and effects of the actuators in each interval.

    Parameters
    ----------
    craft : Craft
        What is assumed of it.
    pointing : Pointing
        Its attitude from now on.
    r, v : Vec3
        Position (m) and velocity (m/s) now, eci.
    field : Field
        Model of the field.
    offset : Vec3
        Measured field minus that of the model (T, eci); it counts in the first interval.
    count : int
        Number of intervals.
    dt : Table
        Their lengths (s).
    actuators : int
        Actuators of an interval: COILS, with the wheels' axes, or ACTUATORS, without.
    """
    drift = [ZERO] * predictive.INTERVALS
    effect = [ZERO] * (predictive.ACTUATORS * predictive.INTERVALS)
    wheels = len(craft.to_wheels) // 3
    wheel_axes = [ZERO] * (wheels * predictive.PATH_INTERVALS)
    orbit = elements_from_state(r, v)
    before = _kept_momentum(craft, pointing, pointing.t, pointing.q, r, v)
    strength, rate_square_sum, begin = 0.0, 0.0, 0.0
    for k in range(count):
        step = dt[k]
        push = ZERO
        times = (begin + AT_1 * step, begin + AT_2 * step, begin + step)
        states = coast(r, v, times)
        for point in range(2):
            at = times[point]
            r_at, v_at = states[point]
            lvlh = lvlh_attitude(r_at, v_at)
            q = _attitude_ahead(pointing, at, lvlh)
            b = field(r_at, v_at, pointing.t + at)
            if k == 0:
                b = add(b, offset)
            torque = _torque(craft, orbit, q, lvlh, r_at, b)
            push = add(push, scale(0.5 * step, torque))
            vectors = _effects(craft, 0.5 * step, q, b)
            for j in range(actuators):
                i = actuators * k + j
                effect[i] = add(effect[i], vectors[j])
            squares = 0.25 * step * _field_across(craft.coil_axes, q, b)
            strength += squares
            rate_square_sum += (
                squares * (norm(cross(r_at, v_at)) / dot(r_at, r_at)) ** 2
            )
        begin += step
        r_at, v_at = states[2]
        q = _attitude_ahead(pointing, begin, lvlh_attitude(r_at, v_at))
        after = _kept_momentum(craft, pointing, pointing.t + begin, q, r_at, v_at)
        drift[k] = sub(push, sub(after, before))
        before = after
        for j in range(wheels if actuators == predictive.COILS else 0):
            w = craft.to_wheels
            axis = rotate_back(q, (w[3 * j], w[3 * j + 1], w[3 * j + 2]))
            wheel_axes[wheels * k + j] = axis
    return Forecast(
        tuple(drift),
        tuple(effect),
        tuple(wheel_axes),
        rate_square_sum * begin / max(strength * strength, 1e-60),
    )


def _field_across(axes: Mat34, q: Vec4, b: Vec3) -> float:
    """Sum |a_j x B|^2 (T2) of the coils in the field b (T, eci)."""
    total = 0.0
    for j in range(4):
        f = cross(rotate_back(q, (axes[j], axes[4 + j], axes[8 + j])), b)
        total += dot(f, f)
    return total


def _attitude_ahead(pointing: Pointing, ahead: float, lvlh: Vec4) -> Vec4:
    """Return the attitude (body from eci) after a time `ahead` (s).

    lvlh: orientation of lvlh from eci then.
    """
    resting = pointing.q
    if pointing.is_turning:
        resting = product(pointing.from_lvlh, lvlh)
    return slew.attitude_at(pointing.slew, resting, pointing.t, pointing.t + ahead)


def _effects(craft: Craft, weight: float, q: Vec4, b: Vec3) -> tuple[Vec3, ...]:
    """Return the effect of each actuator on X at a point of an interval (eci).

    Of a unit of each coil command over `weight` (s), in N m s / (A m2); then of half a
    second of each thruster axis (N m s).
    """
    return (
        *(scale(weight, cross(rotate_back(q, m), b)) for m in craft.dipoles),
        *(
            scale(0.5 * torque, rotate_back(q, axis))
            for torque, axis in zip(craft.thrust, AXES, strict=True)
        ),
    )


def _kept_momentum(
    craft: Craft, pointing: Pointing, t: float, q: Vec4, r: Vec3, v: Vec3
) -> Vec3:
    """Return the momentum (N m s, eci) that is not to be dumped at t (s).

    It is that of the body's rotation, and the target.
    """
    rate = ZERO
    if pointing.is_turning:
        rate = rotate(q, scale(1.0 / dot(r, r), cross(r, v)))
    rate = add(rate, slew.rate_at(pointing.slew, t))
    return rotate_back(q, add(mat_vec(craft.inertia, rate), craft.target))


def _torque(
    craft: Craft, orbit: Elements, q: Vec4, lvlh: Vec4, r: Vec3, b: Vec3
) -> Vec3:
    """Compute the known torque (N m, eci) on the craft at r (m).

    b (T, eci) is the field there.
    """
    x = craft.disturbances
    gravity = gravity_gradient_eci(r, q, craft.inertia)
    dipole_torque = cross(rotate_back(q, learning.vector(x, learning.DIPOLE)), b)
    c, s = latitude_of(orbit, r)
    constant = learning.vector(x, learning.ORBITAL)
    cosine = learning.vector(x, learning.WAVES)
    sine = learning.vector(x, learning.WAVES + 3)
    in_lvlh = add(add(constant, scale(c, cosine)), scale(s, sine))
    inertial = learning.vector(x, learning.INERTIAL)
    return add(
        add(scale(x[learning.GRAVITY], gravity), inertial),
        add(rotate_back(lvlh, in_lvlh), dipole_torque),
    )
