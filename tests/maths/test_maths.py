"""Vectors, attitudes, moments, noise, units: invariants and analytic cases."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from desat.components.contract.units import (
    PREFIXES,
    SI,
    Unit,
    conversion,
    times,
    unit_of,
)
from desat.components.maths import attitude, moments, noise, vector
from desat.components.physics import orbit, wheel_array

number = st.floats(-10, 10, allow_nan=False)
vec3 = st.tuples(number, number, number)
quaternion = (
    st.tuples(number, number, number, number)
    .filter(lambda q: sum(x * x for x in q) > 1e-3)
    .map(attitude.normalised)
)


@given(vec3, vec3)
def test_cross_is_numpys(a, b):
    assert vector.cross(a, b) == pytest.approx(tuple(np.cross(a, b)), abs=1e-12)


@given(
    st.tuples(*[number] * 9).filter(
        lambda m: abs(np.linalg.det(np.reshape(m, (3, 3)))) > 0.1
    )
)
def test_inverse(m):
    expected = np.linalg.inv(np.reshape(m, (3, 3))).ravel()
    assert np.allclose(vector.inverse(m), expected, rtol=1e-9, atol=1e-9)


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
    expected = Rotation.from_quat(q).inv().apply(v)
    assert np.allclose(attitude.rotate(q, v), expected, atol=1e-12)
    assert np.allclose(vector.mat_vec(attitude.matrix(q), v), expected, atol=1e-12)
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
    found = attitude.from_matrix(attitude.matrix(q))
    assert abs(sum(x * y for x, y in zip(found, q, strict=True))) == pytest.approx(
        1, abs=1e-12
    )
    assert found[3] >= 0


@given(quaternion, vec3, st.floats(0, 3))
def test_propagated_solves_the_kinematics(q, omega, t):
    x, y, z = omega
    w = np.array(
        [[0, z, -y, x], [-z, 0, x, y], [y, -x, 0, z], [-x, -y, -z, 0]]
    )  # paper 004, eq. 6
    assert np.allclose(
        attitude.propagated(q, omega, t), expm(0.5 * w * t) @ q, atol=1e-10
    )


@given(quaternion, st.floats(1e-6, math.pi - 1e-6))
def test_error_angle(q, angle):
    turned = attitude.product((math.sin(angle / 2), 0, 0, math.cos(angle / 2)), q)
    assert attitude.error_angle(turned, q) == pytest.approx(angle, abs=1e-9)


def test_lvlh_axes():
    q = attitude.inverse(orbit.lvlh_attitude((7e6, 0, 0), (0, 7.5e3, 0)))
    assert attitude.rotate(q, (0, 0, 1)) == pytest.approx(
        (-1, 0, 0), abs=1e-15
    )  # nadir
    assert attitude.rotate(q, (0, 1, 0)) == pytest.approx(
        (0, 0, -1), abs=1e-15
    )  # -normal
    assert attitude.rotate(q, (1, 0, 0)) == pytest.approx((0, 1, 0), abs=1e-15)  # along


@given(st.floats(0, 1), st.floats(0, 1))
def test_moments_of_a_pulse(a, b):
    begin, end = min(a, b), max(a, b)
    mean, slope = moments.pulse(begin, end)
    assert mean == pytest.approx(end - begin, abs=1e-15)
    first = (end**2 - begin**2) / 2 - mean / 2
    assert slope == pytest.approx(12 * first, abs=1e-12)


@given(st.floats(1e-9, 30))
def test_moments_of_a_lag(ratio):
    mean, slope, end = moments.lag(ratio)
    assert mean == pytest.approx(
        quad(lambda s: math.exp(-ratio * s), 0, 1, epsabs=1e-14)[0], 1e-11
    )
    first = quad(lambda s: (s - 0.5) * math.exp(-ratio * s), 0, 1, epsabs=1e-14)[0]
    assert slope == pytest.approx(12 * first, rel=1e-9, abs=1e-12)
    assert end == pytest.approx(math.exp(-ratio), rel=1e-14)


def test_noise_is_normal_and_seeded():
    draws = np.array([noise.normal3(7, i) for i in range(20000)])
    assert np.abs(draws.mean(axis=0)).max() < 0.03
    assert np.abs(draws.std(axis=0) - 1).max() < 0.03
    assert np.abs(np.corrcoef(draws.T) - np.eye(3)).max() < 0.03
    assert abs(np.corrcoef(draws[1:, 0], draws[:-1, 0])[0, 1]) < 0.03
    assert noise.normal3(7, 5) == noise.normal3(7, 5)
    assert noise.normal3(7, 5) != noise.normal3(8, 5)
    assert 0 < min(noise.uniform(1, i) for i in range(20000)) < 1e-3


@given(st.lists(number, min_size=12, max_size=12).map(tuple), vec3)
def test_wheel_allocation_is_the_pseudo_inverse(axes, v):
    matrix = np.reshape(axes, (3, 4))
    if np.linalg.cond(matrix) > 1e3:
        return
    found = wheel_array.to_wheels(wheel_array.pseudo_inverse(axes), v)
    assert np.allclose(found, np.linalg.pinv(matrix) @ v, rtol=1e-6, atol=1e-7)
    assert np.allclose(wheel_array.body_momentum(axes, found), v, rtol=1e-7, atol=1e-7)


def test_units_convert_by_dimension():
    assert conversion(unit_of("deg/s"), unit_of("rad/s")) == (math.pi / 180, 0)
    assert conversion(unit_of("rpm"), unit_of("rad/s")) == (math.pi / 30, 0)
    assert conversion(unit_of("uT"), unit_of("nT")) == (pytest.approx(1000), 0)
    assert conversion(unit_of("N.m"), unit_of("J")) == (
        1,
        0,
    )  # one dimension, two names
    assert conversion(unit_of("N.m"), unit_of("N.m.s")) is None
    assert conversion(unit_of("rad/s"), unit_of("1/s")) == (1, 0)


names = st.sampled_from(
    [*SI, *(p + n for n in SI for p in PREFIXES if p + n not in ("min", "kg"))]
)
factors = st.lists(
    st.tuples(names, st.integers(-4, 4).filter(bool)), min_size=1, max_size=4
)


@given(factors, factors)
def test_any_product_is_a_unit(above, below):
    def text(parts):
        return ".".join(f"{n}{p}" if p != 1 else n for n, p in parts)

    def product(parts):
        unit = Unit()
        for name, power in parts:
            unit = times(unit, unit_of(name), power)
        return unit

    result, expected = unit_of(f"{text(above)}/({text(below)})"), product(above)
    expected = times(expected, product(below), -1)
    assert result[:6] == expected[:6]
    assert result.factor == pytest.approx(expected.factor, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "like", "factor"),
    [
        ("rad/s2", "1/s2", 1),
        ("kg.m2/s", "N.m.s", 1),
        ("N.m.s/rad", "J.s", 1),
        ("mT", "T", 1e-3),
        ("1/(T2.s2)", "T-2.s-2", 1),
        ("mA.m2", "A.m2", 1e-3),
        ("Hz", "1/s", 1),
        ("V.s", "Wb", 1),
        ("W.h", "J", 3600),
        ("km2", "m2", 1e6),
        ("min", "s", 60),
        ("mm", "m", 1e-3),
        ("%", "1", 0.01),
        ("(N.m)/(rad/s)", "N.m.s", 1),
    ],
)
def test_units_by_name(text, like, factor):
    assert conversion(unit_of(text), unit_of(like)) == (pytest.approx(factor), 0)


@pytest.mark.parametrize(
    "text",
    [
        "sek",
        "m/",
        "/s",
        "m//s",
        "N/m.s",
        "m/s/s",
        "(m",
        "m)",
        "m^2",
        "12",
        "m.1/0",
        "mmin",
        "Gm9.Gm9.Gm9.Gm9",
        "1/(nm9.nm9.nm9.nm9)",
        "1/(1/(Gm9.Gm9.Gm9.Gm9))",
        "(" * 2000,
        "kkg",
        "m s",
        "m12",
    ],
)
def test_what_is_no_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"\w"):
        unit_of(text)
