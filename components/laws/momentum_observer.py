"""Observe the momentum of a craft from sample to sample, and learn what changes it.

`disturbance_learning` has the filter of disturbance torques and of what coils and
thrusters give, `thrust_limit` that of the largest torque of thrusters. Here is what they
are fed with: the effects of all torques over an interval between two samples, the noise
of the measured momentum, and the errors of firings that no other parameter may explain.
"""

from __future__ import annotations

from math import copysign, sqrt
from typing import NamedTuple

from ..contract.block import Mat33, Mat34, Table, Vec3, Vec4
from ..maths import kalman
from ..maths.attitude import IDENTITY_Q, product, rotate, rotate_back
from ..maths.vector import AXES, ZERO, add, cross, dot, norm, scale, sub
from ..physics.orbit import (
    elements_from_state,
    latitude_of,
    lvlh_attitude,
    orbit_motion,
)
from . import disturbance_learning as learning
from . import thrust_limit

# Error of the thrusters' directions (rad), by attitude and mounting.
MISALIGNMENT = 0.1
TORQUE_SPREAD = 0.5  # prior deviation of constant torques, relative to n^2 J
DIPOLE_SPREAD = 0.1  # prior deviation of the craft's own dipole, relative to m_limit
# Least torque that is not modelled, relative to n^2 J and to the torques that are known,
# for a sixth of an orbit at a time.
UNMODELLED_TORQUE = 0.01
VARIES = 0.1
DRIFT = 0.1  # change of a parameter in an orbit, relative to its prior deviation
LONGEST_INTERVAL = 10.0  # in samples; after a longer one the momentum begins anew


class Craft(NamedTuple):
    """What is known of the craft and its sensors."""

    inertia: Mat33  # kg m2, body
    coil_axes: Mat34  # columns, body; zero where there is no coil
    dipole: float  # A m2, limit of each coil
    thrust: Vec3  # N m, torque of the thrusters about each axis; 0: none
    pulse: float  # s, shortest on-time of the thrusters
    sample_time: float  # s
    h_noise: float  # N m s, standard deviation of a measured wheel momentum
    rate_noise: float  # rad/s, the same of a rate
    attitude_noise: float  # rad, the same of an attitude
    doubt: learning.Doubt  # of the coils


class Sample(NamedTuple):
    """Where the craft is at a sample."""

    t: float  # s; negative: the sample is not known
    q: Vec4  # attitude, body from eci
    r: Vec3  # m, eci
    v: Vec3  # m/s, eci
    field: Vec3  # T, eci
    gravity: Vec3  # N m, eci: gravity gradient


class Interval(NamedTuple):
    """Two samples, and the commands from the first one to the second one."""

    begin: Sample
    end: Sample
    coils: Vec4  # A m2
    thrust: Vec3  # N m, body


class Filter(NamedTuple):
    """What is learnt of disturbances, coils and thrusters."""

    x: Table  # state of `disturbance_learning`
    p: Table  # covariance (row-major)
    deviations: Table  # prior standard deviations; zero before the first sample
    evidence: learning.Evidence
    coil_suspicions: Vec4  # 1 for each coil that is suspected
    surprises: int  # number of surprising samples in a row
    restarts: int  # how often the filter was lost and began anew


class ThrustLimits(NamedTuple):
    """Largest torques of the thrusters about each axis, as shares of their level."""

    share: Table
    deviation: Table  # its standard deviation
    bound: Table  # of `thrust_limit.raise_bound`


class Measurement(NamedTuple):
    """A momentum measured at the end of an interval."""

    h: Vec3  # N m s, eci
    noise: float  # N m s, standard deviation
    elapsed_time: float  # s, length of the interval
    effects: Table  # of `disturbance_learning.causes`
    innovation: Vec3  # N m s, eci


def _begin(h: Vec3, deviations: Table, coil_suspicions: Vec4, restarts: int) -> Filter:
    """Return a filter with all of its doubts, at the momentum h (N m s, eci)."""
    return Filter(
        learning.first_state(h),
        learning.first_covariance(deviations),
        deviations,
        learning.NO_EVIDENCE,
        coil_suspicions,
        0,
        restarts,
    )


NO_SAMPLE = Sample(-1.0, IDENTITY_Q, ZERO, ZERO, ZERO, ZERO)
NO_FILTER = _begin(ZERO, (0.0,) * learning.STATES, (0.0, 0.0, 0.0, 0.0), 0)
NO_FIRINGS = ThrustLimits(
    (1.0, 1.0, 1.0), (learning.SPREAD_ACTUATOR,) * 3, (0.0, 0.0, 0.0)
)


def turn_back(last: Sample, estimate: Filter, turn: Vec4) -> tuple[Sample, Filter]:
    """Return sample and filter with vectors (eci) for an attitude that was wrong.

    turn: quaternion from the attitude that was used to the right one.
    """
    q = product(turn, last.q)
    h = rotate_back(q, rotate(last.q, learning.vector(estimate.x, 0)))
    field = rotate_back(q, rotate(last.q, last.field))
    gravity = rotate_back(q, rotate(last.q, last.gravity))
    return (
        Sample(last.t, q, last.r, last.v, field, gravity),
        Filter((*h, *estimate.x[3:]), *estimate[1:]),
    )


def reach(thrust: Vec3, share: Table, level: Vec3) -> Table:
    """Return a commanded thrust within a share of the thrusters' level (N m, body)."""
    torque = [0.0] * 3
    for j in range(3):
        most = share[j] * level[j]
        torque[j] = min(max(thrust[j], -most), most)
    return tuple(torque)


def observe(
    estimate: Filter,
    limits: ThrustLimits,
    interval: Interval,
    craft: Craft,
    total: Vec3,
    is_measured: bool,
) -> tuple[Filter, ThrustLimits]:
    """Return filter and limits after the change of momentum over an interval.

    Parameters
    ----------
    estimate : Filter
        At its begin, `NO_FILTER` at first.
    limits : ThrustLimits
        At its begin, `NO_FIRINGS` at first.
    interval : Interval
        Samples and commands.
    craft : Craft
        What is known of it.
    total : Vec3
        Momentum of the craft at the end (N m s, body).
    is_measured : bool
        Whether the field at the end is valid; else only the momentum begins anew.
    """
    begin, end = interval.begin, interval.end
    h = rotate_back(end.q, total)
    n, _ = orbit_motion(end.r, end.v)
    largest = max(map(abs, craft.inertia[::4]))
    gravity_torque = n * n * largest
    noise = max(
        _momentum_noise(craft, largest, norm(total)),
        1e-3 * gravity_torque * craft.sample_time,
    )
    if estimate.deviations[learning.GRAVITY] == 0.0:
        deviations = learning.spreads(
            TORQUE_SPREAD * gravity_torque,
            learning.air_torque(largest, end.r, end.v),
            DIPOLE_SPREAD * craft.dipole,
            noise,
        )
        return _begin(
            h, deviations, estimate.coil_suspicions, estimate.restarts
        ), limits
    elapsed_time = end.t - begin.t
    is_long = elapsed_time > LONGEST_INTERVAL * craft.sample_time
    if begin.t < 0.0 or is_long or not is_measured:
        p = learning.forgotten(estimate.p, noise)
        return Filter((*h, *estimate.x[3:]), p, *estimate[2:]), limits
    effects = _causes(
        interval,
        craft,
        reach(interval.thrust, limits.share, craft.thrust),
        elapsed_time,
    )
    innovation = learning.innovation(estimate.x, h, effects)
    measurement = Measurement(h, noise, elapsed_time, effects, innovation)
    new_limits, missing = _limit_thrust(estimate, limits, interval, craft, measurement)
    return (
        _learn(estimate, interval, craft, measurement, gravity_torque, missing),
        new_limits,
    )


def _learn(
    estimate: Filter,
    interval: Interval,
    craft: Craft,
    measurement: Measurement,
    gravity_torque: float,
    missing: Table,
) -> Filter:
    """Return the filter after a measurement.

    gravity_torque: n^2 J (N m); missing: of `_limit_thrust`.
    """
    h, noise, elapsed_time, effects, innovation = measurement
    _, orbit = orbit_motion(interval.end.r, interval.end.v)
    axes = tuple(rotate_back(interval.begin.q, axis) for axis in AXES)
    # thrusters round on-times to whole pulses, as the law does; where they are weaker than
    # known, their on-times are longer and the roundings differ
    rounding = tuple(
        0.5 * craft.pulse * level if torque != 0.0 else 0.0
        for torque, level in zip(interval.thrust, craft.thrust, strict=True)
    )
    # a coil is not lost where the thrusters' rounding explains the innovation
    unexplained_momentum = innovation
    for j in range(3):
        most = rounding[j] + missing[j]
        along = min(max(dot(innovation, axes[j]), -most), most)
        unexplained_momentum = sub(unexplained_momentum, scale(along, axes[j]))
    evidence = learning.gather(
        learning.Evidence(*estimate.evidence),
        estimate.p,
        unexplained_momentum,
        effects,
        elapsed_time,
        orbit,
        craft.doubt,
    )
    failed_actuator = learning.find_failure(
        evidence, estimate.x, estimate.deviations[learning.DIPOLE]
    )
    coil_suspicions = estimate.coil_suspicions
    if failed_actuator >= 0:
        evidence = learning.explain(evidence, failed_actuator)
        coil_suspicions = learning.suspect(coil_suspicions, failed_actuator)
    unmodelled_torque = max(
        UNMODELLED_TORQUE * gravity_torque,
        VARIES * learning.known_torque(estimate.x),
        learning.unmodelled_torque(evidence),
    )
    # commands, and so their roundings, last as long as innovations are averaged
    lasting = sqrt(2.0 / 3.0 * learning.SMOOTHED * orbit / elapsed_time)
    x, p, surprise = learning.update(
        estimate.x,
        estimate.p,
        h,
        effects,
        noise,
        unmodelled_torque * sqrt(orbit * elapsed_time / 3.0),
        tuple(scale(lasting * rounding[j] + missing[j], axes[j]) for j in range(3)),
        estimate.deviations,
        DRIFT * sqrt(elapsed_time / orbit),
        failed_actuator,
    )
    surprises = kalman.count_surprises(estimate.surprises, surprise)
    if surprises >= kalman.SURPRISES:
        return _begin(h, estimate.deviations, coil_suspicions, estimate.restarts + 1)
    return Filter(
        x,
        p,
        estimate.deviations,
        evidence,
        coil_suspicions,
        surprises,
        estimate.restarts,
    )


def _limit_thrust(
    estimate: Filter,
    limits: ThrustLimits,
    interval: Interval,
    craft: Craft,
    measurement: Measurement,
) -> tuple[ThrustLimits, Table]:
    """Learn the largest torque about each axis from the firings of an interval.

    Returns also the impulses (N m s, body) that may be missing where a firing tested
    it, so that the interval teaches nothing else about this axis.
    """
    q, elapsed_time, thrust = interval.end.q, measurement.elapsed_time, interval.thrust
    innovation = rotate(q, measurement.innovation)
    expected_thrust = reach(thrust, limits.share, craft.thrust)
    shares, deviations = list(limits.share), list(limits.deviation)
    bounds, missing = list(limits.bound), [0.0] * 3
    for j in range(3):
        if thrust[j] == 0.0:
            continue
        i, level = learning.THRUSTERS + j, craft.thrust[j]
        spread = learning.deviation_along(
            estimate.p,
            measurement.effects,
            rotate_back(q, AXES[j]),
            i,
            measurement.noise,
        )
        spread /= elapsed_time
        across = MISALIGNMENT * (norm(thrust) - abs(thrust[j]))
        error = sqrt(spread * spread + across * across) / level
        command = abs(thrust[j]) / level
        torque = estimate.x[i] * expected_thrust[j] + innovation[j] / elapsed_time
        share = copysign(1.0, thrust[j]) * torque / level
        is_tested = thrust_limit.is_tested(
            shares[j], deviations[j], bounds[j], command, error
        )
        if is_tested:
            missing[j] = elapsed_time * abs(thrust[j])
            if thrust_limit.is_cut(command, share, error):
                shares[j], deviations[j] = thrust_limit.correct(
                    shares[j], deviations[j], share, error
                )
        bounds[j] = thrust_limit.raise_bound(bounds[j], command, share, error)
    return ThrustLimits(tuple(shares), tuple(deviations), tuple(bounds)), tuple(missing)


def _momentum_noise(craft: Craft, inertia: float, total: float) -> float:
    """Return the standard deviation of the measured momentum H (N m s).

    inertia: the largest (kg m2); total: |H| (N m s).
    """
    from_rate = inertia * craft.rate_noise
    from_attitude = total * craft.attitude_noise
    return sqrt(
        craft.h_noise * craft.h_noise
        + from_rate * from_rate
        + from_attitude * from_attitude
    )


def _causes(
    interval: Interval, craft: Craft, thrust: Table, elapsed_time: float
) -> Table:
    """Return the effect of a unit of each learnt parameter on H, `learning.causes`.

    By the mean of begin and end. thrust: of `reach`; elapsed_time (s): length of the interval.
    """
    begin, end = interval.begin, interval.end
    half = 0.5 * elapsed_time
    orbit = elements_from_state(end.r, end.v)
    then, now = lvlh_attitude(begin.r, begin.v), lvlh_attitude(end.r, end.v)
    (c0, s0), (c1, s1) = latitude_of(orbit, begin.r), latitude_of(orbit, end.r)
    g = craft.coil_axes
    coil_axes = tuple((g[i], g[4 + i], g[8 + i]) for i in range(4))
    return learning.causes(
        (
            scale(half, add(begin.gravity, end.gravity)),
            *(scale(elapsed_time, axis) for axis in AXES),
            *(scale(half, _combine_axes(1.0, then, 1.0, now, axis)) for axis in AXES),
            *(scale(half, _sum_across_field(axis, begin, end)) for axis in AXES),
            *(
                scale(half * coil, _sum_across_field(axis, begin, end))
                for axis, coil in zip(coil_axes, interval.coils, strict=True)
            ),
            *(
                scale(half * torque, _combine_axes(1.0, begin.q, 1.0, end.q, axis))
                for axis, torque in zip(AXES, thrust, strict=True)
            ),
            *(scale(half, _combine_axes(c0, then, c1, now, axis)) for axis in AXES),
            *(scale(half, _combine_axes(s0, then, s1, now, axis)) for axis in AXES),
        )
    )


def _sum_across_field(axis: Vec3, begin: Sample, end: Sample) -> Vec3:
    """Sum axis x B (T, eci) of two samples; axis: body."""
    then = cross(rotate_back(begin.q, axis), begin.field)
    return add(then, cross(rotate_back(end.q, axis), end.field))


def _combine_axes(p: float, first: Vec4, r: float, second: Vec4, axis: Vec3) -> Vec3:
    """Return p and r times an axis of two frames (eci), added."""
    return add(scale(p, rotate_back(first, axis)), scale(r, rotate_back(second, axis)))
