"""Orbits: Kepler's equation, elements, the drift by J2."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.contract.block import BlockError
from desat.components.maths import attitude
from desat.components.maths.vector import cross, dot, norm
from desat.components.physics import earth, orbit
from tests.physics.environments import at, epoch, kepler

angle = st.floats(-math.pi, math.pi)

elements = st.builds(
    lambda perigee, e, i, raan, argument, anomaly: orbit.Elements(
        perigee / (1 - e), e, i, raan, argument, anomaly
    ),
    st.floats(6.5e6, 4e7),
    st.floats(0, 0.9),
    st.floats(0, math.pi),
    angle,
    angle,
    angle,
)


def of_elements(e: orbit.Elements, **parameters: object) -> EnvironmentKepler:
    return kepler(field="none", **e._asdict(), **parameters)


@given(st.floats(-20, 20), st.floats(0, 0.95))
def test_eccentric_anomaly_solves_keplers_equation(m, e):
    anomaly = orbit.eccentric_anomaly(m, e)
    assert math.remainder(
        anomaly - e * math.sin(anomaly) - m, math.tau
    ) == pytest.approx(0, abs=5e-15)


@given(angle, st.floats(0, 0.95))
def test_true_anomaly(true, e):
    anomaly = orbit.eccentric_anomaly(orbit.mean_from_true_anomaly(true, e), e)
    x, y = math.cos(anomaly) - e, math.sqrt(1 - e * e) * math.sin(anomaly)
    assert math.remainder(math.atan2(y, x) - true, math.tau) == pytest.approx(
        0, abs=1e-12
    )


@given(elements, st.floats(0, 1e5))
def test_energy_and_angular_momentum_are_those_of_the_elements(e, t):
    block = at(of_elements(e), t)
    energy = dot(block.v_eci, block.v_eci) / 2 - orbit.MU / norm(block.r_eci)
    assert energy == pytest.approx(-orbit.MU / (2 * e.semi_major_axis), rel=1e-12)
    h = math.sqrt(orbit.MU * e.semi_major_axis * (1 - e.eccentricity**2))
    _, _, normal = orbit.orbit_plane(e.inclination, e.raan)
    assert cross(block.r_eci, block.v_eci) == pytest.approx(
        tuple(h * x for x in normal), abs=1e-13 * h / (1 - e.eccentricity)
    )


@given(elements, st.floats(0, 1e5), st.booleans())
def test_velocity_is_the_derivative_of_position(e, t, j2):
    block = of_elements(e, j2=j2)
    r = {k: at(block, t + 0.5 * k).r_eci for k in (-2, -1, 1, 2)}
    velocity = [
        (8 * (b - a) - (d - c)) / 6
        for a, b, c, d in zip(r[-1], r[1], r[-2], r[2], strict=True)
    ]
    assert velocity == pytest.approx(at(block, t).v_eci, abs=2e-6)


@given(elements)
def test_an_orbit_closes(e):
    period = math.tau / orbit.mean_motion(e.semi_major_axis)
    block = of_elements(e)
    once = at(block, 0.0).r_eci
    # the rounding of the time and of the angle, times the speed at the perigee
    assert (
        math.dist(at(block, period).r_eci, once)
        < 1e-5 + 3e-12 * period * norm(block.v_eci) / 1e3
    )


@given(elements, st.floats(0, 1e5))
def test_elements_from_state(e, t):
    block = at(of_elements(e), t)
    elements = orbit.elements_from_state(block.r_eci, block.v_eci)
    again = at(of_elements(elements), 0.0)
    scale = norm(block.r_eci)
    assert again.r_eci == pytest.approx(block.r_eci, abs=1e-9 * scale)
    assert again.v_eci == pytest.approx(block.v_eci, abs=1e-9 * norm(block.v_eci))
    assert elements.semi_major_axis == pytest.approx(e.semi_major_axis, rel=1e-11)
    assert elements.eccentricity == pytest.approx(e.eccentricity, abs=1e-11)
    assert elements.inclination == pytest.approx(e.inclination, abs=1e-7)


@pytest.mark.parametrize("inclination", [0.0, 1.0, math.pi])
def test_elements_of_a_circle(inclination):
    block = at(
        kepler(inclination=inclination, raan=0.3, mean_anomaly=0.4, field="none"), 50.0
    )
    elements = orbit.elements_from_state(block.r_eci, block.v_eci)
    again = at(of_elements(elements), 0.0)
    assert again.r_eci == pytest.approx(block.r_eci, abs=1e-7)
    with pytest.raises(ValueError, match="not those of an ellipse"):
        orbit.elements_from_state(block.r_eci, tuple(2 * x for x in block.v_eci))


def test_altitudes():
    assert orbit.ellipse_of_altitudes(500e3, 500e3) == (6878137.0, 0.0)
    a, e = orbit.ellipse_of_altitudes(300e3, 900e3)
    assert a * (1 - e) == pytest.approx(orbit.EARTH_RADIUS + 300e3)
    assert a * (1 + e) == pytest.approx(orbit.EARTH_RADIUS + 900e3)


def test_j2_drift_is_that_of_the_integrated_motion():
    """The mean drift of the osculating elements under the acceleration of J2."""

    def rhs(t, x):
        r, size = x[:3], np.linalg.norm(x[:3])
        z2 = 5 * (r[2] / size) ** 2
        k = 1.5 * orbit.J2 * (orbit.EARTH_RADIUS / size) ** 2
        bent = k * np.array([z2 - 1, z2 - 1, z2 - 3])
        return np.concatenate([x[3:], orbit.MU / size**3 * r * (bent - 1)])

    start = orbit.Elements(7.5e6, 0.08, 0.9, 0.5, 1.0, 0.2)
    period = math.tau / orbit.mean_motion(start.semi_major_axis)
    state = at(of_elements(start), 0.0)
    t = np.linspace(0, 40 * period, 4001)
    solution = solve_ivp(
        rhs,
        (0, t[-1]),
        [*state.r_eci, *state.v_eci],
        "DOP853",
        t,
        rtol=1e-11,
        atol=1e-6,
    )
    osculating = np.array(
        [orbit.elements_from_state(x[:3], x[3:]) for x in solution.y.T.tolist()]
    )
    a, e, i = osculating[:, :3].mean(axis=0)
    drift = orbit.j2_drift(a, e, i)
    for column, rate in ((3, drift.raan), (4, drift.argument_of_perigee)):
        slope = np.polyfit(t, np.unwrap(osculating[:, column]), 1)[0]
        assert slope == pytest.approx(rate, rel=0.005)
    latitude_argument = np.unwrap(osculating[:, 5] + osculating[:, 4])
    argument_rate = (
        orbit.mean_motion(a) + drift.mean_anomaly + drift.argument_of_perigee
    )
    # a mean over time differs from the mean element by some 1e-4
    assert np.polyfit(t, latitude_argument, 1)[0] == pytest.approx(
        argument_rate, rel=3e-4
    )


def test_j2_drift_of_the_block():
    a, e, i = 7.2e6, 0.02, 1.1
    block = kepler(
        semi_major_axis=a, eccentricity=e, inclination=i, j2=True, field="none"
    )
    # Wertz & Larson, Space Mission Analysis and Design: km and deg per day
    per_day = math.radians(-2.06474e14 * 7200**-3.5 * math.cos(i) / (1 - e * e) ** 2)
    for day in (1, 10):
        state = at(block, 86400.0 * day)
        elements = orbit.elements_from_state(state.r_eci, state.v_eci)
        # the drift itself is in v: it tilts r x v by up to 5e-4 rad
        assert elements.raan == pytest.approx(per_day * day, abs=6e-4)
        assert elements.inclination == pytest.approx(i, abs=6e-4)


def test_sun_synchronous():
    i = orbit.sun_synchronous_inclination(orbit.EARTH_RADIUS + 550e3)
    assert math.degrees(i) == pytest.approx(97.59, abs=0.01)
    year = orbit.j2_drift(orbit.EARTH_RADIUS + 550e3, 0.0, i).raan * 365.24219 * 86400
    assert year == pytest.approx(math.tau, rel=1e-12)
    with pytest.raises(ValueError, match="too high"):
        orbit.sun_synchronous_inclination(1.3e7)


def test_a_sun_synchronous_orbit_keeps_its_local_time():
    start = epoch(2026, 1, 1)
    a = orbit.EARTH_RADIUS + 550e3
    i = orbit.sun_synchronous_inclination(a)
    node = earth.raan_of_local_time(10.5, start)
    for day in range(0, 366, 30):
        node_then = node + orbit.j2_drift(a, 0.0, i).raan * day * 86400
        (x, y, _), _ = earth.sun(start + day * 86400)
        hours = 12 + 12 / math.pi * math.remainder(
            node_then - math.atan2(y, x), math.tau
        )
        assert hours == pytest.approx(10.5, abs=17 / 60)  # the equation of time


def test_a_perigee_inside_the_earth_is_refused():
    with pytest.raises(
        BlockError, match=r"semi_major_axis = 7e\+06 m with eccentricity = 0.1"
    ):
        kepler(semi_major_axis=7e6, eccentricity=0.1)


def test_lvlh_axes():
    q = attitude.inverse(orbit.lvlh_attitude((7e6, 0, 0), (0, 7.5e3, 0)))
    assert attitude.rotate(q, (0, 0, 1)) == pytest.approx(
        (-1, 0, 0), abs=1e-15
    )  # nadir
    assert attitude.rotate(q, (0, 1, 0)) == pytest.approx(
        (0, 0, -1), abs=1e-15
    )  # -normal
    assert attitude.rotate(q, (1, 0, 0)) == pytest.approx((0, 1, 0), abs=1e-15)  # along
