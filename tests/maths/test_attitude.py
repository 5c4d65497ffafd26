"""Attitudes: a quaternion and its matrix."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from desat.components.maths import attitude, vector


@pytest.mark.parametrize("seed", range(8))
def test_a_quaternion_comes_back_from_its_matrix(seed):
    """Each of Shepperd's four choices; the matrix as scipy has it, which turns the
    other way."""
    from scipy.spatial.transform import Rotation

    q = np.random.default_rng(seed).normal(size=4)
    q[seed % 4] += math.copysign(4.0, q[seed % 4])  # which of the four is the largest
    q *= math.copysign(1.0, q[3]) / np.linalg.norm(q)
    c = attitude.matrix(tuple(q.tolist()))
    assert np.reshape(c, (3, 3)) == pytest.approx(
        Rotation.from_quat(q).as_matrix().T, abs=1e-14
    )
    assert attitude.from_matrix(c) == pytest.approx(q, abs=1e-14)


number = st.floats(-10, 10, allow_nan=False)

vec3 = st.tuples(number, number, number)

quaternion = (
    st.tuples(number, number, number, number)
    .filter(lambda q: sum(x * x for x in q) > 1e-3)
    .map(attitude.normalise)
)


@given(vec3, st.floats(0, 5))
def test_rotation_about_is_the_exponential(rate, t):
    x, y, z = rate
    skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert np.allclose(
        np.reshape(vector.rotation_about(rate, t), (3, 3)), expm(skew * t), atol=1e-11
    )


@given(quaternion, vec3)
def test_attitude_matrix_rotates_as_scipy_backwards(q, v):
    # scipy's rotation turns vectors; ours turns frames, so it is the inverse
    scipy_vector = Rotation.from_quat(q).inv().apply(v)
    assert np.allclose(attitude.rotate(q, v), scipy_vector, atol=1e-12)
    assert np.allclose(vector.mat_vec(attitude.matrix(q), v), scipy_vector, atol=1e-12)
    assert np.allclose(attitude.rotate_back(q, attitude.rotate(q, v)), v, atol=1e-12)


@given(quaternion, quaternion)
def test_product_composes(a, b):
    remaining = np.reshape(attitude.matrix(attitude.product(a, b)), (3, 3))
    right = np.reshape(attitude.matrix(a), (3, 3)) @ np.reshape(
        attitude.matrix(b), (3, 3)
    )
    assert np.allclose(remaining, right, atol=1e-12)


@given(quaternion)
def test_from_matrix_inverts_matrix(q):
    quaternion = attitude.from_matrix(attitude.matrix(q))
    assert abs(sum(x * y for x, y in zip(quaternion, q, strict=True))) == pytest.approx(
        1, abs=1e-12
    )
    assert quaternion[3] >= 0


@given(quaternion, vec3, st.floats(0, 3))
def test_propagated_solves_the_kinematics(q, omega, t):
    x, y, z = omega
    w = np.array(
        [[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]]
    )  # paper 004, eq. 6
    assert np.allclose(
        attitude.propagate(q, omega, t), expm(0.5 * w * t) @ q, atol=1e-10
    )


@given(quaternion, st.floats(1e-6, math.pi - 1e-6))
def test_error_angle(q, angle):
    rotated_attitude = attitude.product(
        (math.sin(angle / 2), 0, 0, math.cos(angle / 2)), q
    )
    assert attitude.error_angle(rotated_attitude, q) == pytest.approx(angle, abs=1e-9)
