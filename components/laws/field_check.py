"""Check a measured field against a model of the Earth's, and learn how the two differ.

A field whose size differs much from a model that is as strong as the Earth's field can
be there is not the Earth's. Otherwise the field of the last orbit gives the scale of
the model's, and its direction a constant error of the attitude (`attitude_error`).
"""

from __future__ import annotations

from typing import NamedTuple

from ..contract.block import Table, Vec3, Vec4
from ..maths.attitude import IDENTITY_Q, rotate
from ..maths.vector import dot, norm, scale, sub
from ..physics import geomagnetic
from . import attitude_error

# Difference of measured and model field beyond which the field is strange: relative, and
# in addition in standard deviations of a measured component. Far from the Earth the
# field is as small as its noise.
FIELD_MISMATCH = 0.3
FIELD_DEVIATIONS = 5.0
# Relative error of the measured field's size beyond which it is not the Earth's, as where
# a strong coil is near the magnetometer.
WRONG_SIZE = 0.5
# Weight of the noise that is known in measurements against the noise that is seen, and
# least number of measurements from which an error of the attitude is corrected.
NOISE_WEIGHT = 0.3
FEWEST_MEASUREMENTS = 2.0
SPREAD_ANGLE = 0.1  # rad, prior deviation of the attitude's error about each axis
LEAST_FIELD_NOISE = 1e-10  # T, with which an attitude error is learnt


class AttitudeCheck(NamedTuple):
    """What measured fields say of a constant error of the attitude."""

    error: Table  # state of `attitude_error`
    covariance: Table  # of the error, row-major
    variance: float  # T2, of a component of the measured field
    measurements: float  # their number
    is_misaligned: bool  # whether the error has been significant once


def begin(spread: float, noise: float) -> AttitudeCheck:
    """Return the check of an attitude that counts as right.

    spread (1): relative error of the model's field across it; noise (T): standard
    deviation of a component of a measured field.
    """
    least = max(noise, LEAST_FIELD_NOISE)
    return AttitudeCheck(
        (0.0,) * attitude_error.STATES,
        attitude_error.first_covariance(SPREAD_ANGLE, spread),
        least * least,
        0.0,
        False,
    )


def learn_error(
    check: AttitudeCheck, measured_field: Vec3, model: Vec3, q: Vec4
) -> AttitudeCheck:
    """Return the check after a field was measured.

    measured_field (T): in body; model (T): the field expected, in eci; q: attitude without a
    correction.
    """
    size = max(norm(measured_field), 1e-12)
    # directions, so that a model whose field is too large has no effect
    error, covariance, ratio = attitude_error.update(
        check.error,
        check.covariance,
        scale(1.0 / size, measured_field),
        rotate(
            attitude_error.rotation(check.error),
            scale(1.0 / max(norm(model), 1e-12), rotate(q, model)),
        ),
        check.variance / (size * size),
        attitude_error.ANGLES,
    )
    variance, measurements = check.variance, check.measurements
    # the first measurement shows the error, the next ones the noise
    if measurements >= 1.0:
        share = 1.0 / (measurements + NOISE_WEIGHT)
        variance *= 1.0 + share * (ratio - 1.0)
    measurements += 1.0
    is_misaligned = check.is_misaligned or (
        measurements >= FEWEST_MEASUREMENTS
        and attitude_error.is_significant(error, covariance)
    )
    return AttitudeCheck(error, covariance, variance, measurements, is_misaligned)


def correction_of(check: AttitudeCheck) -> Vec4:
    """Return the quaternion that corrects an attitude, where its error is significant."""
    return attitude_error.rotation(check.error) if check.is_misaligned else IDENTITY_Q


def is_rejected(
    measured_field: Vec3, expected_size: float, noise: float, dipole: Vec3, r: Vec3
) -> bool:
    """Return whether a measured field has a size that is not the Earth's.

    Parameters
    ----------
    measured_field : Vec3
        Field (T).
    expected_size : float
        Size of the model's field (T).
    noise : float
        Standard deviation of a component of a measured field (T).
    dipole : Vec3
        Of the Earth (T m3).
    r : Vec3
        Position (m).
    """
    most = WRONG_SIZE * expected_size + FIELD_DEVIATIONS * noise
    return abs(
        norm(measured_field) - expected_size
    ) > most and geomagnetic.is_plausible(expected_size, norm(dipole), norm(r))


def is_strange(measured_field: Vec3, model: Vec3, noise: float) -> bool:
    """Return whether a measured field differs much from the model's (T, same frame)."""
    mismatch = FIELD_MISMATCH * norm(model) + FIELD_DEVIATIONS * noise
    return norm(sub(measured_field, model)) > mismatch


def compare(
    products: float, squares: float, measured_field: Vec3, model: Vec3, memory: float
) -> tuple[float, float]:
    """Return sums whose ratio is the scale of the model's field over an orbit.

    The scale has a prior of 1 that counts as one measurement.

    Parameters
    ----------
    products, squares : float
        Sums before (T2); zero at first.
    measured_field, model : Vec3
        Fields (T, same frame).
    memory : float
        Share of the sums that is kept (1).
    """
    square = dot(model, model)
    prior = square if squares == 0.0 else 0.0
    return (
        memory * products + prior + dot(measured_field, model),
        memory * squares + prior + square,
    )
