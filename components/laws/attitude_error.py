"""Estimate a constant error of a known attitude from the measured field.

The true attitude is exp(-[theta]x) C with C the known attitude, theta (rad, body) the
constant error. The direction of the measured field then is

    b / |b| = exp(-[theta]x) m / |m| + e + noise

with m the model's field in the known attitude (body) and e (1, body) the constant error
of the model's direction. One measurement shows theta about the two axes across the
field; as the field turns, all three become observable. e looks like an attitude error as
long as the field has not turned. Therefore e is a considered state (Schmidt): it is
never corrected, and its prior deviation stays in the deviation of theta. The size of the
field has no effect.

A Kalman filter has the state x = (theta, e).
"""

from __future__ import annotations

from ..contract.block import Table, Vec3, Vec4
from ..maths import kalman
from ..maths.attitude import IDENTITY_Q, propagated, rotate
from ..maths.vector import dot, mat_vec, norm, scale, sub
from .predictive import inverse_of_lower, root

ANGLES = 3  # theta, with which x begins
STATES = 6
SPREAD_ANGLE = 0.1  # rad, prior standard deviation of theta about each axis
SIGNIFICANT = 3.0  # standard deviations from which an error counts


def first_covariance(field_spread: float) -> Table:
    """Build the initial covariance P, row-major.

    field_spread (1): standard deviation of e, the relative error of the model's field
    across it.
    """
    p = [0.0] * (STATES * STATES)
    for i in range(STATES):
        spread = SPREAD_ANGLE if i < ANGLES else field_spread
        p[STATES * i + i] = spread * spread
    return tuple(p)


def rotation(x: Table) -> Vec4:
    """Return the quaternion of the estimated error: true body from known body."""
    return propagated(IDENTITY_Q, (x[0], x[1], x[2]), 1.0)


def update(
    x: Table, p: Table, measured: Vec3, model: Vec3, noise: float
) -> tuple[Table, Table, float]:
    """Return (x, P) after a measurement, and how large its innovation is.

    The latter is the mean square of the innovation over its expected variance (1).

    Parameters
    ----------
    x, p : Table
        State, from zeros on, and covariance (row-major).
    measured, model : Vec3
        The measured field, and that of the model in the known attitude (T, body).
    noise : float
        Standard deviation of a measured component (T).
    """
    state, covariance = [0.0] * STATES, [0.0] * (STATES * STATES)
    for i in range(STATES):
        state[i] = x[i]
    for i in range(STATES * STATES):
        covariance[i] = p[i]
    size = max(norm(measured), 1e-12)
    expected = rotate(rotation(x), scale(1.0 / max(norm(model), 1e-12), model))
    direction = scale(1.0 / size, measured)
    found = sub(direction, expected)
    variance = (noise / size) * (noise / size)
    # [direction]x, the derivative by theta: taken at the measured direction, as an
    # expected one that moves with the estimate would seem to show the third axis
    ex, ey, ez = direction
    slopes = (0.0, -ez, ey, ez, 0.0, -ex, -ey, ex, 0.0)
    product = [0.0] * STATES
    squares = 0.0
    for row in range(3):
        innovation = found[row]
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
        kalman.correct_first(state, covariance, product, innovation, total, ANGLES)
    # two axes are across the field
    return tuple(state), tuple(covariance), 0.5 * squares


def is_significant(x: Table, p: Table) -> bool:
    """Return whether theta is beyond `SIGNIFICANT` standard deviations from zero."""
    theta = (x[0], x[1], x[2])
    covariance = (p[0], p[1], p[2], p[6], p[7], p[8], p[12], p[13], p[14])
    ratio = mat_vec(inverse_of_lower(root(covariance)), theta)
    return dot(ratio, ratio) > SIGNIFICANT * SIGNIFICANT
