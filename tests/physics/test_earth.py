"""Earth and Sun: time, height, sunlight and eclipse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from desat.components.physics import earth, orbit
from tests.physics.environments import at, epoch, kepler


def test_sidereal_time():
    """Vallado, Fundamentals of Astrodynamics and Applications, example 3-5."""
    sidereal_angle = math.degrees(earth.earth_angle(epoch(1992, 8, 20, 12, 14)))
    # its Julian date is rounded to 4e-5 s
    assert sidereal_angle == pytest.approx(152.578787810, abs=2e-7)


def test_the_earth_turns_at_its_rate():
    start, day = epoch(2026, 1, 1), 86400.0
    excess_angle = (
        earth.earth_angle(start + day)
        - earth.earth_angle(start)
        - orbit.EARTH_RATE * day
    )
    assert math.remainder(excess_angle, math.tau) == pytest.approx(0, abs=1e-7)


@pytest.mark.parametrize("month", range(1, 13))
def test_the_sun_is_over_greenwich_at_noon(month):
    """Sidereal time and the Sun's direction are of one frame: only the equation of time
    is left."""
    noon = epoch(2026, month, 15, 12)
    (x, y, _), _ = earth.sun(noon)
    late = math.degrees(
        math.remainder(math.atan2(y, x) - earth.earth_angle(noon), math.tau)
    )
    # in minutes, the Sun behind the clock
    equation = (9.2, 14.1, 8.9, 0.1, -3.7, 0.5, 6.0, 4.5, -4.8, -14.2, -15.4, -4.9)
    assert 4 * late == pytest.approx(equation[month - 1], abs=0.4)


def test_decimal_year():
    assert earth.decimal_year(epoch(2026, 1, 1)) == 2026.0
    assert earth.decimal_year(epoch(2024, 7, 2)) == pytest.approx(2024.5, abs=1e-12)
    assert earth.decimal_year(epoch(1900, 1, 1)) == 1900.0


def test_height():
    a, f = 6378137.0, 1 / 298.257223563
    e2 = f * (2 - f)
    for h in (0.0, 300e3, 1000e3):
        for latitude in np.radians(range(-90, 91, 5)):
            n = a / math.sqrt(1 - e2 * math.sin(latitude) ** 2)
            r = (
                (n + h) * math.cos(latitude),
                0.0,
                (n * (1 - e2) + h) * math.sin(latitude),
            )
            assert earth.height(r) == pytest.approx(h, abs=5)


@pytest.mark.parametrize(
    (
        "date",
        "sun_longitude",
    ),  # equinoxes and solstices of 2024 and 2026, published to the minute
    [
        ((2024, 3, 20, 3, 6), 0),
        ((2024, 6, 20, 20, 51), 90),
        ((2024, 9, 22, 12, 44), 180),
        ((2024, 12, 21, 9, 20), 270),
        ((2026, 3, 20, 14, 46), 0),
        ((2026, 6, 21, 8, 25), 90),
        ((2026, 9, 23, 0, 5), 180),
        ((2026, 12, 21, 20, 50), 270),
    ],
)
def test_sun_at_equinox_and_solstice(date, sun_longitude):
    (x, y, z), distance = earth.sun(epoch(*date))
    assert x * x + y * y + z * z == pytest.approx(1, abs=1e-14)
    tilt = math.radians(23.4365)
    longitude = math.atan2(y * math.cos(tilt) + z * math.sin(tilt), x)
    assert math.remainder(
        math.degrees(longitude) - sun_longitude, 360
    ) == pytest.approx(0, abs=0.013)
    assert math.degrees(math.asin(z)) == pytest.approx(
        {0: 0, 90: 23.4365, 180: 0, 270: -23.4365}[sun_longitude], abs=0.006
    )
    assert 0.983 < distance / earth.ASTRONOMICAL_UNIT < 1.017


def test_distance_of_the_sun():
    """Perihelion on 2026-01-03, aphelion on 2026-07-06."""
    assert earth.sun(epoch(2026, 1, 3, 17))[1] == pytest.approx(1.470999e11, rel=1e-4)
    assert earth.sun(epoch(2026, 7, 6, 18))[1] == pytest.approx(1.520877e11, rel=1e-4)


X_AXIS, AU = (1.0, 0.0, 0.0), earth.ASTRONOMICAL_UNIT


def behind(along: float, aside: float) -> float:
    """Sunlight at a point `along` (m) behind the Earth and `aside` (m) from the axis."""
    return earth.sunlight(
        (-along, aside * math.cos(0.7), aside * math.sin(0.7)), X_AXIS, AU
    )


@pytest.mark.parametrize("along", [1e5, 3e6, 6.9e6, 4.2e7])
def test_eclipse_cones(along):
    """The cones touch the Sun's and the Earth's spheres: sin(half angle) = (R_s +- R_e)
    / D."""
    umbra = math.asin((earth.SUN_RADIUS - orbit.EARTH_RADIUS) / AU)
    penumbra = math.asin((earth.SUN_RADIUS + orbit.EARTH_RADIUS) / AU)
    substeps = orbit.EARTH_RADIUS / math.cos(umbra) - along * math.tan(umbra)
    outer = orbit.EARTH_RADIUS / math.cos(penumbra) + along * math.tan(penumbra)
    if along > orbit.EARTH_RADIUS:
        assert behind(along, 0.0) == 0.0
    assert behind(along, substeps - 1.0) == 0.0
    assert 0.0 < behind(along, substeps + 10.0) < 1e-2
    assert 1 - 1e-2 < behind(along, outer - 10.0) < 1.0
    assert behind(along, outer + 1.0) == 1.0
    # the middle of the penumbra: the rim of the large Earth is nearly straight
    assert behind(along, orbit.EARTH_RADIUS) == pytest.approx(0.5, abs=0.01)
    grid = [behind(along, x) for x in np.linspace(substeps, outer, 200)]
    assert grid == sorted(grid)


def test_eclipse_is_the_hidden_part_of_the_disc():
    """Rays to points of the Sun's disc, cut by the Earth's sphere."""
    rng = np.random.default_rng(5)
    for along, aside in (
        (3e6, 6.37e6),
        (2e7, 6.45e6),
        (3e8, 7.0e6),
        (3e8, 6.0e6),
        (2e9, 1e6),
    ):
        r = np.array([-along, aside, 0.0])
        to_sun = np.array([AU, 0, 0]) - r
        axis = to_sun / np.linalg.norm(to_sun)
        u = np.cross(axis, [0, 0, 1])
        u /= np.linalg.norm(u)
        w = np.cross(axis, u)
        radius = np.sqrt(rng.random(200_000)) * math.asin(
            earth.SUN_RADIUS / np.linalg.norm(to_sun)
        )
        phi = rng.random(200_000) * math.tau
        ray = (
            np.cos(radius)[:, None] * axis
            + (np.sin(radius) * np.cos(phi))[:, None] * u
            + (np.sin(radius) * np.sin(phi))[:, None] * w
        )
        is_lit = (
            np.linalg.norm(r - (ray @ r)[:, None] * ray, axis=1) > orbit.EARTH_RADIUS
        )
        assert earth.sunlight(tuple(r.tolist()), X_AXIS, AU) == pytest.approx(
            is_lit.mean(), abs=5e-3
        )


def test_sunlit_side():
    assert earth.sunlight((7e6, 0.0, 0.0), X_AXIS, AU) == 1.0
    assert earth.sunlight((0.0, 0.0, 6.5e6), X_AXIS, AU) == 1.0


def test_eclipse_of_an_orbit():
    """With the Sun in the plane the shadow takes asin(R / r) / pi of a circle."""
    block = kepler(
        inclination=math.radians(23.44), field="none", epoch_j2000=epoch(2026, 3, 20)
    )
    period = math.tau / orbit.mean_motion(block.semi_major_axis)
    dark = np.mean([at(block, t).sunlight < 0.5 for t in np.arange(0.0, period, 5.0)])
    assert dark == pytest.approx(
        math.asin(orbit.EARTH_RADIUS / 6928137) / math.pi, abs=0.003
    )
    assert math.dist(block.sun_eci, earth.sun(block.epoch_j2000)[0]) < 2e-3


@pytest.mark.parametrize(
    ("date", "flux"),
    # perihelion and aphelion of 2026 (0.983302, 1.016644 au), and one astronomical unit
    [((2026, 1, 3, 17), 1.03425), ((2026, 7, 6, 18), 0.96753), ((2026, 4, 4), 1.0)],
)
def test_sunlight_over_the_year(date, flux):
    """Outside of the shadow the inverse square of the distance: 6.7 % between January
    and July."""
    block = kepler(field="none", epoch_j2000=epoch(*date))
    lit = [at(block, t).sunlight for t in np.arange(0.0, 6000.0, 60.0).tolist()]
    assert max(lit) == pytest.approx(flux, rel=3e-4)
    distance = earth.sun(block.epoch_j2000 + 5.0)[1]
    assert at(block, 0.0).sunlight in (
        0.0,
        pytest.approx((AU / distance) ** 2, rel=1e-9),
    )
