"""The atmosphere's density."""

from __future__ import annotations

import math
from datetime import datetime

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.components.physics import atmosphere, earth, orbit
from tests.physics.environments import at, epoch, kepler


def still(**parameters: object) -> EnvironmentKepler:
    """An environment whose Earth does not turn: only the coefficients move."""
    return kepler(earth_rate=0.0, earth_angle="given", **parameters)


def test_atmosphere_table():
    assert atmosphere.table(500e3) == 6.967e-13
    assert atmosphere.table(550e3) == pytest.approx(
        6.967e-13 * math.exp(-50 / 63.822), rel=1e-12
    )
    assert atmosphere.table(1200e3) == pytest.approx(
        3.019e-15 * math.exp(-200 / 268), rel=1e-12
    )
    for h in (
        100,
        110,
        120,
        130,
        140,
        150,
        180,
        200,
        250,
        300,
        350,
        400,
        450,
        500,
        600,
        700,
        800,
    ):
        below, above = atmosphere.table(1e3 * h - 1e-3), atmosphere.table(1e3 * h)
        assert below == pytest.approx(above, rel=2e-4), (
            "a mistyped row would make a step"
        )


def test_atmosphere_of_the_block_is_over_the_ellipsoid():
    a = 6378137.0 + 500e3
    block = kepler(
        semi_major_axis=a, inclination=math.pi / 2, field="none", atmosphere="table"
    )
    assert at(block, 0.0).density == pytest.approx(6.967e-13, rel=1e-9)
    quarter = math.pi / 2 / orbit.mean_motion(a)
    density = 6.967e-13 * math.exp(-21.384685 / 63.822)
    assert at(block, quarter).density == pytest.approx(density, rel=1e-5)


def test_kp_of_ap():
    assert [
        atmosphere.kp_of_ap(ap) for ap in (0, 4, 15, 48, 400, 500)
    ] == pytest.approx([0, 1, 3, 5, 9, 9])
    assert atmosphere.kp_of_ap(45.0) == pytest.approx((14 + 6 / 9) / 3)


@pytest.mark.parametrize("temperature", [650.0, 900.0, 1200.0, 1800.0])
def test_separated_gases_are_in_diffusive_equilibrium(temperature):
    """dn/n = -(m g / k T) dz - (1 + alpha) dT/T of each gas, integrated in Jacchia's
    temperature T = T_inf - (T_inf - 355) exp(-s z); Walker's closed form moves T by a
    few K."""
    x = (temperature - 800) / (750 + 1.722e-4 * (temperature - 800) ** 2)
    s = 0.0291 * math.exp(-x * x / 2)
    gases = (
        (4.0e17, 28.0134, 0),
        (7.5e16, 31.9988, 0),
        (7.6e16, 15.9994, 0),
        (3.4e13, 4.0026, -0.38),
    )

    def slopes(z, y):
        t = temperature - (temperature - 355) * math.exp(-s * (z - 120))
        dt = s * (temperature - t)
        g = 9.80665 * (6356.766 / (6356.766 + z)) ** 2
        return [
            -m * g * 1e3 / (8314.46 * t) - (1 + alpha) * dt / t for _, m, alpha in gases
        ]

    heights = [200.0, 300.0, 500.0, 800.0]
    logs = solve_ivp(slopes, (120, 800), [0.0] * 4, "DOP853", heights, rtol=1e-9).y
    for z, column in zip(heights, logs.T, strict=True):
        rho = sum(
            n * m * 1.66054e-27 * math.exp(y)
            for (n, m, _), y in zip(gases, column, strict=True)
        )
        assert atmosphere.diffusive_density(1e3 * z, temperature, 1.0) == pytest.approx(
            rho, rel=0.06
        )
    assert atmosphere.diffusive_density(120e3, temperature, 1.0) == pytest.approx(
        2.46e-8, rel=5e-3
    )


def test_exosphere():
    """The bulge: 1.3 times the coldest, two hours after noon under the Sun; the night's
    side by 1; above it the storm of Kp."""
    equator = [
        atmosphere.exosphere(0.0, math.radians(15 * h), 0.0, 800.0, 0.0)
        for h in np.arange(-12, 12, 0.1)
    ]
    quiet = 0.03  # K: the exponential at Kp = 0
    assert max(equator) - quiet == pytest.approx(1040.0, rel=1e-3)
    assert np.arange(-12, 12, 0.1)[np.argmax(equator)] == pytest.approx(2.1, abs=0.3)
    assert min(equator) - quiet == pytest.approx(800.0, abs=0.1)
    storm = atmosphere.exosphere(0.2, 0.3, 0.1, 800.0, 5.0)
    still = atmosphere.exosphere(0.2, 0.3, 0.1, 800.0, 0.0)
    assert storm - still == pytest.approx(28 * 5 + 0.03 * (math.exp(5) - 1))


def test_activity_day_and_night_of_the_block():
    """At 500 km: day over night 2 to 6, moderate over low activity 13, high over
    moderate 4."""
    inputs = {"semi_major_axis": 6378137.0 + 500e3, "inclination": 0.3, "field": "none"}
    densities = {}
    for activity in ("low", "moderate", "high"):
        block = kepler(atmosphere="activity", solar_activity=activity, **inputs)
        densities[activity] = [
            at(block, t).density for t in np.arange(0.0, 5700.0, 30.0).tolist()
        ]
        assert 2 < max(densities[activity]) / min(densities[activity]) < 6
    low, moderate, high = (np.mean(x) for x in densities.values())
    assert moderate / low == pytest.approx(13, rel=0.2)
    assert high / moderate == pytest.approx(4, rel=0.2)
    requests = kepler(
        atmosphere="activity", solar_activity="given", f107=250.0, ap=45.0, **inputs
    )
    assert at(requests, 0.0).density == densities["high"][0]


def test_atmosphere_by_activity_goes_on_below_120_km():
    def density(h: float) -> float:
        return atmosphere.by_activity(
            h, (6.5e6, 1e6, 2e6), (0.6, 0.7, 0.39), 8e8, 900.0, 3.0
        )

    assert density(120e3 - 1e-3) == pytest.approx(density(120e3), rel=2e-4)
    ratio = density(120e3) / atmosphere.table(120e3)
    assert 0.7 < ratio < 1.4
    assert density(50e3) == pytest.approx(ratio * atmosphere.table(50e3), rel=1e-12)


@pytest.mark.parametrize(
    ("activity", "mean", "worst"),  # factors of error, at 200 to 800 km
    [("low", 1.25, 2.5), ("moderate", 1.18, 2.1), ("high", 1.27, 2.7)],
)
def test_atmosphere_against_nrlmsise(activity, mean, worst):
    """Day and night, summer and winter, equator and poles; the static table for
    comparison."""
    pymsis = pytest.importorskip(
        "pymsis", reason="the oracle of the atmosphere is pymsis"
    )
    f107, ap = atmosphere.ACTIVITY[("low", "moderate", "high").index(activity)]
    coldest, kp = atmosphere.coldest_temperature(f107), atmosphere.kp_of_ap(ap)
    points = [
        (datetime(2026, month, 15, 12), latitude, hour, height)
        for month in (1, 3, 6, 9, 11)
        for latitude in (-75, -45, 0, 45, 75)
        for hour in (2, 6, 10, 14, 18, 22)
        for height in (200, 300, 400, 500, 600, 700, 800)
    ]
    dates, latitudes, hours, heights = zip(*points, strict=True)
    n = len(points)
    reference_density = pymsis.calculate(
        np.array(dates, dtype="datetime64[s]"),
        15.0 * (np.array(hours) - 12.0),
        np.array(latitudes, float),
        np.array(heights, float),
        f107s=[f107] * n,
        f107as=[f107] * n,
        aps=[[ap] * 7] * n,
        version=0,
    )[:, 0]
    densities = []
    for date, latitude, hour, height in points:
        time = epoch(*date.timetuple()[:6])
        direction, _ = earth.sun(time)
        ascension = math.atan2(direction[1], direction[0]) + math.radians(
            15 * (hour - 12)
        )
        c, s = math.cos(math.radians(latitude)), math.sin(math.radians(latitude))
        r = (c * math.cos(ascension), c * math.sin(ascension), s)
        densities.append(
            atmosphere.by_activity(1e3 * height, r, direction, time, coldest, kp)
        )
    ratio = np.log(densities) - np.log(reference_density)
    assert math.exp(np.sqrt(np.mean(ratio**2))) < mean
    assert math.exp(np.abs(ratio).max()) < worst
    static = np.log([atmosphere.table(1e3 * h) for h in heights]) - np.log(
        reference_density
    )
    assert np.mean(static**2) > np.mean(ratio**2)
