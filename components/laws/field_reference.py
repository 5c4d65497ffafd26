"""Estimate a constant attitude error from the measured field and a model of it.

The measured attitude is turned by a (rad, body) against the true one. With B the field of
the model, rotated by an attitude from which the estimate of a has been taken away, and z
the measured field,

    z - B = (a - a_est) x B + c + v,

with c (T, body) the magnetometer's bias. The field turns in the body over an orbit, so all
components of a and c are found. a is a random walk. The filter is linear with 6 states
(a, c).

v is noise and the error of the model, which lasts for many samples. Its variance is taken
as noise^2 + k s (1 + s / noise^2), with s the mean square of z - B less what is estimated
and k the samples in CORRELATION_TIME, so that a model that does not fit teaches next to
nothing.

Source: ours.
"""

from __future__ import annotations

from math import exp
from typing import NamedTuple

from ..contract.block import Table, Vec3
from ..maths import kalman
from ..maths.vector import dot, sub
from .rate_filter import crossing

BIAS = 3  # where the magnetometer's bias begins
SQUARE = 6  # where s is (T2), the mean square of what remains
WEIGHT = 7  # and its weight, in samples
STATES = 6
CORRELATION_TIME = 600.0  # s: as long the model's error is the same, 36 deg of an orbit


class Setting(NamedTuple):
    """Constants of the filter."""

    offset_spread: float  # rad, deviation of a at the start, each axis
    offset_walk: float  # rad, of its change in 1 s, each axis
    bias_spread: float  # T, deviation of c, each axis
    noise: float  # T, deviation of a measured field from a model that fits, each axis
    memory: float  # s, time constant of the mean square of what remains


def begin(setting: Setting) -> tuple[Table, Table]:
    """Return the first numbers (8) and covariance (6 x 6, row-major)."""
    p = [0.0] * (STATES * STATES)
    for i in range(BIAS):
        p[(STATES + 1) * i] = setting.offset_spread * setting.offset_spread
        p[(STATES + 1) * (BIAS + i)] = setting.bias_spread * setting.bias_spread
    return (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), tuple(p)


def update(
    x: Table, p: Table, measured: Vec3, model: Vec3, elapsed: float, setting: Setting
) -> tuple[Table, Table]:
    """Correct by one measured field.

    Parameters
    ----------
    x, p : Table
        Numbers (8: a in rad, c in T, s in T2, its weight) and covariance of the first six
        (6 x 6, row-major).
    measured : Vec3
        Measured field (T, body).
    model : Vec3
        Field of the model (T, body), by the attitude less the estimated error.
    elapsed : float
        Time since the last measurement (s), above 0.
    setting : Setting
        Of the filter.
    """
    state = [0.0] * STATES
    covariance = [0.0] * (STATES * STATES)
    column = [0.0] * STATES
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    for i in range(BIAS):
        covariance[(STATES + 1) * i] += (
            setting.offset_walk * setting.offset_walk * elapsed
        )
    turning = crossing(model)  # a x B = -B x a
    difference = sub(measured, model)
    remaining = sub(difference, bias_of(x))
    weight = x[WEIGHT] * exp(-elapsed / setting.memory) + 1.0
    square = x[SQUARE] + (dot(remaining, remaining) / 3.0 - x[SQUARE]) / weight
    least2 = setting.noise * setting.noise
    correlated = max(CORRELATION_TIME / elapsed, 1.0)
    noise2 = least2 + correlated * square * (1.0 + square / least2)
    for axis in range(3):
        for i in range(STATES):
            column[i] = covariance[STATES * i + BIAS + axis]
            for j in range(3):
                column[i] -= turning[3 * axis + j] * covariance[STATES * i + j]
        variance = column[BIAS + axis] + noise2
        innovation = difference[axis] - state[BIAS + axis]
        for j in range(3):
            variance -= turning[3 * axis + j] * column[j]
            # the model's field has x in it already; what this sample adds has not
            innovation += turning[3 * axis + j] * (state[j] - x[j])
        kalman.correct_first(state, covariance, column, innovation, variance, STATES)
    a, b = (state[0], state[1], state[2]), (state[3], state[4], state[5])
    return (*a, *b, square, weight), tuple(covariance)


def offset_of(x: Table) -> Vec3:
    """Return the attitude error a (rad, body)."""
    return (x[0], x[1], x[2])


def bias_of(x: Table) -> Vec3:
    """Return the magnetometer's bias c (T, body)."""
    return (x[3], x[4], x[5])
