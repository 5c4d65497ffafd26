"""Estimate a constant error of a known attitude from the measured field and a model.

The true attitude is exp(-[theta]x) C with C the known attitude, theta (rad, body) the
constant error. With B the model's field in the attitude that is known with the estimate
of theta, the measured field is

    z = B + [z]x (theta - theta_est) + c + v

with c (body) a constant error of the field in the body: a magnetometer's bias, or an
error of the model's direction. z, B and c are in T, or 1 where z and B are directions; the
size of the field then has no effect. One measurement shows theta about the two axes across
the field. As the field turns, all three become observable, and theta is told from c. Where
the field hardly turns, c looks like theta: c is then only considered (Schmidt), and its
deviation stays in that of theta.

A Kalman filter has the state x = (theta, c). v is noise and the error of the model, which
lasts for many samples (`variance_of`).

Source: ours.
"""

from __future__ import annotations

from math import exp

from ..contract.block import Table, Vec3, Vec4
from ..maths import kalman
from ..maths.attitude import IDENTITY_Q, propagate
from ..maths.matrix import crossing
from ..maths.vector import dot, mat_vec, sub
from .predictive import inverse_of_lower, root

ANGLES = 3  # theta, with which x begins
STATES = 6
SIGNIFICANT = 3.0  # standard deviations from which an error counts
# s: as long the model's error is the same, 36 deg of an orbit
CORRELATION_TIME = 600.0


def first_covariance(angle: float, field: float) -> Table:
    """Build the initial covariance P (6 x 6, row-major).

    angle (rad), field (T, or 1): standard deviations of theta and c, each axis.
    """
    p = [0.0] * (STATES * STATES)
    for i in range(STATES):
        spread = angle if i < ANGLES else field
        p[STATES * i + i] = spread * spread
    return tuple(p)


def add_walk(p: Table, walk: float, elapsed_time: float) -> Table:
    """Return P after the elapsed time (s), in which theta walks (rad in a root second)."""
    covariance = [0.0] * (STATES * STATES)
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    for i in range(ANGLES):
        covariance[(STATES + 1) * i] += walk * walk * elapsed_time
    return tuple(covariance)


def update(
    x: Table,
    p: Table,
    measured_field: Vec3,
    model_field: Vec3,
    variance: float,
    estimated_states: int,
) -> tuple[Table, Table, float]:
    """Return (x, P) after a measurement, and how large its innovation is.

    The latter is the mean square of the innovation over its expected variance (1).

    Parameters
    ----------
    x, p : Table
        State, from zeros on, and covariance (row-major).
    measured_field, model_field : Vec3
        The measured field z, and that of the model, B (T, or directions; body).
    variance : float
        Of a measured component (the square of their unit).
    estimated_states : int
        STATES; or ANGLES, with c only considered.
    """
    state, covariance = [0.0] * STATES, [0.0] * (STATES * STATES)
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    field_difference = sub(measured_field, model_field)
    # the derivative by theta, taken at the measured field, as an expected one that moves
    # with the estimate would seem to show the third axis
    slopes = crossing(measured_field)
    product = [0.0] * STATES
    squares = 0.0
    for row in range(3):
        innovation = field_difference[row] - state[ANGLES + row]
        for j in range(ANGLES):
            # by as much as the components before this one have corrected it
            innovation -= slopes[3 * row + j] * (state[j] - x[j])
        for i in range(STATES):
            product[i] = covariance[STATES * i + ANGLES + row]
            for j in range(ANGLES):
                product[i] += covariance[STATES * i + j] * slopes[3 * row + j]
        total = variance + product[ANGLES + row]
        for j in range(ANGLES):
            total += slopes[3 * row + j] * product[j]
        squares += innovation * innovation / total
        kalman.correct(state, covariance, product, innovation, total, estimated_states)
    # two axes are across the field
    return tuple(state), tuple(covariance), 0.5 * squares


def variance_of(
    x: Table,
    remainder: Table,
    measured_field: Vec3,
    model_field: Vec3,
    noise: float,
    elapsed_time: float,
    memory: float,
) -> tuple[float, Table]:
    """Return the variance (T2) of v, and the mean square of what x does not explain.

    With s the mean square and k the samples in `CORRELATION_TIME`, the variance is
    noise^2 + k s (1 + s / noise^2), so that a model that does not fit teaches next to
    nothing.

    Parameters
    ----------
    x : Table
        State.
    remainder : Table
        Mean square (T2) of z - B - c, and its weight in samples, from zeros on.
    measured_field, model_field : Vec3
        Of `update`, in T.
    noise : float
        Standard deviation of a measured field from a model that fits (T, each axis).
    elapsed_time : float
        Time since the last measurement (s), above 0.
    memory : float
        Time constant of the mean square (s).
    """
    remaining = sub(sub(measured_field, model_field), field_error_of(x))
    weight = remainder[1] * exp(-elapsed_time / memory) + 1.0
    square = remainder[0] + (dot(remaining, remaining) / 3.0 - remainder[0]) / weight
    least = noise * noise
    correlated_samples = max(CORRELATION_TIME / elapsed_time, 1.0)
    return least + correlated_samples * square * (1.0 + square / least), (
        square,
        weight,
    )


def angles_of(x: Table) -> Vec3:
    """Return theta (rad, body)."""
    return (x[0], x[1], x[2])


def field_error_of(x: Table) -> Vec3:
    """Return c (T, or 1; body)."""
    return (x[3], x[4], x[5])


def rotation(x: Table) -> Vec4:
    """Return the quaternion of the estimated error: true body from known body."""
    return propagate(IDENTITY_Q, angles_of(x), 1.0)


def is_significant(x: Table, p: Table) -> bool:
    """Return whether theta is beyond `SIGNIFICANT` standard deviations from zero."""
    covariance = (p[0], p[1], p[2], p[6], p[7], p[8], p[12], p[13], p[14])
    ratio = mat_vec(inverse_of_lower(root(covariance)), angles_of(x))
    return dot(ratio, ratio) > SIGNIFICANT * SIGNIFICANT
