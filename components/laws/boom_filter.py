"""Estimate attitude, rate, gyro bias and unknown torques by one extended Kalman filter.

The state x (15) is the attitude error theta (rad), the rate omega (rad/s), the gyro's
bias b (rad/s), a constant torque d (N m) and the craft's residual dipole m_r (A m2), all
body. Between samples, with h (N m s) the wheels' momentum, m (A m2) the coils' dipole, B
(T) the field, u the direction of nadir and n (rad/s) the orbit's rate,

    theta' = delta omega - omega x theta,
    J omega' + h' = (m + m_r) x B + 3 n^2 u x J u + d + firing - omega x (J omega + h).

The attitude q has the mean of theta in it: after each correction theta is moved into q
and begins anew at zero. Linear about the estimate, with [a] the matrix of a x,

    J delta omega' = ([J omega + h] - [omega] J) delta omega
                     + 3 n^2 ([u] J - [J u]) [u] theta + delta d - [B] delta m_r.

The attitude measures theta and the gyro omega + b, six numbers one after the other. b, d
and m_r are random walks. A constant attitude error acts on gravity's torque like a
constant d, so the two cannot be told apart here; `attitude_error` finds it, and `turn`
takes what it finds.

Source: ours; the attitude error as in Lefferts, Markley & Shuster, Kalman filtering for
spacecraft attitude estimation, J. Guidance, Control, and Dynamics 5 (1982) 417.
"""

from __future__ import annotations

from typing import NamedTuple

from ..contract.block import Mat33, Table, Vec3, Vec4
from ..maths import kalman, matrix
from ..maths.attitude import inverse, product, propagate
from ..maths.vector import IDENTITY, ZERO, add, cross, mat_vec, scale, sub
from . import firing
from .gravity_gradient import gravity_vector_torque, rotation_vector

# where each part of the state begins
RATE = 3
BIAS = 6
TORQUE = 9
DIPOLE = 12
STATES = 15
MOVING = BIAS  # attitude error and rate; the others are constant between samples


class Deviations(NamedTuple):
    """Standard deviations of each axis: at the start, or of a walk in a root second."""

    bias: float  # rad/s
    torque: float  # N m
    dipole: float  # A m2


class Setting(NamedTuple):
    """Constants of the filter."""

    attitude_noise: float  # rad, of the measured attitude, each axis
    gyro_noise: float  # rad/s, of the measured rate, each axis
    spread: Deviations  # at the start
    walk: Deviations  # over a root second
    inertia: Mat33  # kg m2, wheels locked
    inverse: Mat33  # 1/(kg m2)


class Interval(NamedTuple):
    """Conditions from the last sample to this one."""

    elapsed_time: float  # s
    dipole: Vec3  # A m2, mean of the coils, body
    field: Vec3  # T, mean, body
    nadir: Vec3  # 1, direction of nadir at the last sample, body
    orbit_rate: float  # rad/s
    h_before: Vec3  # N m s, the wheels' momentum at the last sample, body
    h: Vec3  # N m s, that at this sample, body
    firing: Vec3  # N m s, expected impulse of a firing, body
    uncertainty: Vec3  # N m s, standard deviation of the unknown impulse, body


def begin(omega: Vec3, setting: Setting) -> tuple[Table, Table]:
    """Return the first state (15) and covariance (15 x 15, row-major).

    The attitude estimate begins with the measured one, and omega (rad/s, body) is the
    measured rate.
    """
    x = [0.0] * STATES
    p = [0.0] * (STATES * STATES)
    spread = setting.spread
    for i in range(3):
        p[(STATES + 1) * (BIAS + i)] = spread.bias * spread.bias
        p[(STATES + 1) * (TORQUE + i)] = spread.torque * spread.torque
        p[(STATES + 1) * (DIPOLE + i)] = spread.dipole * spread.dipole
    return resume(tuple(x), tuple(p), omega, setting)


def resume(x: Table, p: Table, omega: Vec3, setting: Setting) -> tuple[Table, Table]:
    """Begin attitude and rate anew by a measurement, with the constants as they are.

    Parameters
    ----------
    x, p : Table
        State (15) and covariance (15 x 15, row-major) before a gap in the measurements.
    omega : Vec3
        Measured rate (rad/s, body), which has the gyro's bias in it.
    setting : Setting
        Of the filter.

    Returns
    -------
    tuple
        State and covariance at this sample.
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    for i in range(BIAS, STATES):
        state[i] = x[i]
        for j in range(BIAS, STATES):
            covariance[STATES * i + j] = p[STATES * i + j]
    attitude, gyro = setting.attitude_noise, setting.gyro_noise
    for i in range(3):
        state[RATE + i] = omega[i] - x[BIAS + i]
        covariance[(STATES + 1) * i] = attitude * attitude
        # the error of omega is the gyro's noise less the error of the bias
        for j in range(BIAS, STATES):
            of_bias = -p[STATES * (BIAS + i) + j]
            covariance[STATES * (RATE + i) + j] = of_bias
            covariance[STATES * j + RATE + i] = of_bias
        for j in range(3):
            covariance[STATES * (RATE + i) + RATE + j] = p[
                STATES * (BIAS + i) + BIAS + j
            ]
        covariance[(STATES + 1) * (RATE + i)] += gyro * gyro
    return tuple(state), tuple(covariance)


def rate_of(x: Table) -> Vec3:
    """Return omega (rad/s, body)."""
    return (x[3], x[4], x[5])


def bias_of(x: Table) -> Vec3:
    """Return the gyro's bias b (rad/s, body)."""
    return (x[6], x[7], x[8])


def torque_of(x: Table) -> Vec3:
    """Return the constant torque d (N m, body)."""
    return (x[9], x[10], x[11])


def dipole_of(x: Table) -> Vec3:
    """Return the residual dipole m_r (A m2, body)."""
    return (x[12], x[13], x[14])


def turn(
    q: Vec4, x: Table, change: Vec3, nadir: Vec3, orbit_rate: float, inertia: Mat33
) -> tuple[Vec4, Table]:
    """Return attitude and state where the measured attitude's known error changes.

    The rate turns with the attitude, the bias is what it leaves of the gyro's rate, and
    the torque is what gravity and the turning craft leave of the total. Momentum of wheels
    is not counted, as its mean is small.

    Parameters
    ----------
    q : Vec4
        Attitude estimate, inertial to body.
    x : Table
        State (15).
    change : Vec3
        Change of the known error (rad, body), by which attitudes turn back.
    nadir : Vec3
        Direction of nadir (1, body) of this attitude, before.
    orbit_rate : float
        Rate of the orbit (rad/s).
    inertia : Mat33
        Of the craft (kg m2).
    """
    omega = rate_of(x)
    omega_after = add(omega, cross(change, omega))
    before = sub(
        gravity_vector_torque(nadir, inertia, orbit_rate),
        cross(omega, mat_vec(inertia, omega)),
    )
    after = sub(
        gravity_vector_torque(add(nadir, cross(change, nadir)), inertia, orbit_rate),
        cross(omega_after, mat_vec(inertia, omega_after)),
    )
    state = [0.0] * STATES
    for i in range(STATES):
        state[i] = x[i]
    for i in range(3):
        state[RATE + i] = omega_after[i]
        state[BIAS + i] += omega[i] - omega_after[i]
        state[TORQUE + i] += before[i] - after[i]
    return propagate(q, scale(-1.0, change), 1.0), tuple(state)


def update(
    q: Vec4,
    x: Table,
    p: Table,
    interval: Interval,
    q_measured: Vec4,
    gyro: Vec3,
    setting: Setting,
) -> tuple[Vec4, Table, Table, Vec3, float]:
    """Propagate to this sample and correct by its attitude and rate.

    Parameters
    ----------
    q : Vec4
        Attitude estimate at the last sample, inertial to body, scalar last.
    x, p : Table
        State (15) and covariance (15 x 15, row-major) at the last sample.
    interval : Interval
        Conditions since then.
    q_measured : Vec4
        Measured attitude, as q.
    gyro : Vec3
        Measured rate (rad/s, body).
    setting : Setting
        Of the filter.

    Returns
    -------
    tuple
        Attitude, state, covariance; the correction of omega (rad/s, body); and the
        largest square of an innovation over its variance (1), `kalman.UNSOUND` where the
        covariance cannot be that of anything.
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    omega = _predict(state, covariance, x, interval, setting)
    mean = scale(0.5, add(rate_of(x), omega))
    q_predicted = propagate(q, mean, interval.elapsed_time)
    error = rotation_vector(product(q_measured, inverse(q_predicted)))
    worst = _correct(state, covariance, error, gyro, setting)
    attitude = propagate(q_predicted, (state[0], state[1], state[2]), 1.0)
    correction = ZERO
    if kalman.is_sound(state, covariance):
        correction = (
            state[RATE] - omega[0],
            state[RATE + 1] - omega[1],
            state[RATE + 2] - omega[2],
        )
    else:
        worst = kalman.UNSOUND
    for i in range(3):
        state[i] = 0.0
    return attitude, tuple(state), tuple(covariance), correction, worst


def _predict(
    state: list[float],
    covariance: list[float],
    x: Table,
    interval: Interval,
    setting: Setting,
) -> Vec3:
    """Propagate the state, whose copy x is, and its covariance in place.

    Returns the rate (rad/s, body) at this sample.
    """
    elapsed_time, b = interval.elapsed_time, interval.field
    magnetic = cross(add(interval.dipole, dipole_of(x)), b)
    gravity = gravity_vector_torque(
        interval.nadir, setting.inertia, interval.orbit_rate
    )
    steady = add(add(magnetic, gravity), torque_of(x))
    omega = firing.predicted_rate(
        rate_of(x),
        interval.h_before,
        interval.h,
        add(scale(elapsed_time, steady), interval.firing),
        setting.inertia,
        setting.inverse,
        elapsed_time,
    )
    effects = [0.0] * (MOVING * STATES)
    _fill_effects(effects, rate_of(x), interval, setting)
    kalman.predict(state, covariance, effects)
    for i in range(3):
        state[RATE + i] = omega[i]
    _add_noise(covariance, interval, setting)
    return omega


def _add_noise(covariance: list[float], interval: Interval, setting: Setting) -> None:
    """Add the unknown impulse and the walks of the constants to the covariance."""
    walk, unknown = setting.walk, interval.uncertainty
    for i in range(3):
        rate = unknown[i] * setting.inverse[4 * i]
        covariance[(STATES + 1) * (RATE + i)] += rate * rate
        elapsed_time = interval.elapsed_time
        covariance[(STATES + 1) * (BIAS + i)] += walk.bias * walk.bias * elapsed_time
        covariance[(STATES + 1) * (TORQUE + i)] += (
            walk.torque * walk.torque * elapsed_time
        )
        covariance[(STATES + 1) * (DIPOLE + i)] += (
            walk.dipole * walk.dipole * elapsed_time
        )


def _fill_effects(
    effects: list[float], omega: Vec3, interval: Interval, setting: Setting
) -> None:
    """Set the first six rows of the transition matrix."""
    elapsed_time, inertia_inverse = interval.elapsed_time, setting.inverse
    inertia, u = setting.inertia, interval.nadir
    momentum = add(mat_vec(inertia, omega), interval.h_before)
    turning = matrix.crossing(omega)
    slope = matrix.subtract(
        matrix.crossing(momentum), matrix.multiply(turning, inertia)
    )
    a = matrix.scale(elapsed_time, matrix.multiply(inertia_inverse, slope))
    half = matrix.scale(0.5, matrix.multiply(a, a))
    of_rate = matrix.add(matrix.add(IDENTITY, a), half)
    tilt = matrix.subtract(
        matrix.multiply(matrix.crossing(u), inertia),
        matrix.crossing(mat_vec(inertia, u)),
    )
    n = interval.orbit_rate
    # a torque that lasts turns with the rate that it gives, on the average half as far
    impulse = matrix.scale(
        elapsed_time,
        matrix.multiply(matrix.add(IDENTITY, matrix.scale(0.5, a)), inertia_inverse),
    )
    gravity = matrix.scale(3.0 * n * n, matrix.multiply(tilt, matrix.crossing(u)))
    of_attitude = matrix.multiply(impulse, gravity)
    of_dipole = matrix.multiply(impulse, matrix.crossing(scale(-1.0, interval.field)))
    _fill_rows(effects, 0, of_attitude, elapsed_time)
    _fill_rows(effects, RATE, of_rate, elapsed_time)
    _fill_rows(effects, TORQUE, impulse, elapsed_time)
    _fill_rows(effects, DIPOLE, of_dipole, elapsed_time)
    across = matrix.subtract(IDENTITY, matrix.scale(elapsed_time, turning))
    for i in range(3):
        effects[(STATES + 1) * i + RATE] += 0.5 * elapsed_time
        for j in range(3):
            effects[STATES * i + j] += across[3 * i + j]


def _fill_rows(
    effects: list[float], state: int, of_rate: Mat33, elapsed_time: float
) -> None:
    """Set the columns of three states, from what they do to the rate.

    The attitude follows the mean of the rate before and after.
    """
    for i in range(3):
        for j in range(3):
            effects[STATES * (RATE + i) + state + j] = of_rate[3 * i + j]
            effects[STATES * i + state + j] = 0.5 * elapsed_time * of_rate[3 * i + j]


def _correct(
    state: list[float],
    covariance: list[float],
    error: Vec3,
    gyro: Vec3,
    setting: Setting,
) -> float:
    """Correct in place by the measured attitude error (rad) and rate (rad/s), body.

    The result is the largest square of an innovation over its variance (1).
    """
    of_attitude = setting.attitude_noise * setting.attitude_noise
    of_gyro = setting.gyro_noise * setting.gyro_noise
    column = [0.0] * STATES
    worst = 0.0
    for axis in range(6):
        for i in range(STATES):
            column[i] = covariance[STATES * i + axis]
        if axis < RATE:
            innovation = error[axis] - state[axis]
            variance = column[axis] + of_attitude
        else:
            bias = axis - RATE + BIAS
            for i in range(STATES):
                column[i] += covariance[STATES * i + bias]
            innovation = gyro[axis - RATE] - state[axis] - state[bias]
            variance = column[axis] + column[bias] + of_gyro
        worst = max(worst, kalman.surprise(innovation, variance))
        kalman.correct(state, covariance, column, innovation, variance, STATES)
    return worst
