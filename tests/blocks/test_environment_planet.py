"""Orbits about the Moon and Mars against two bodies, formulae and geometry."""

from __future__ import annotations

import numpy as np
import pytest

from desat.components.blocks.environment_planet import BODIES
from tests.conftest import started

MOON, MARS = BODIES


def course(times, **values):
    block = started("environment_planet", **values)
    rows = []
    for t in times:
        block.output(float(t))
        rows.append((*block.r_eci, *block.v_eci, *block.sun_eci, block.sunlight))
    return np.array(rows)


@pytest.mark.parametrize(("body", "figures"), [(0, MOON), (1, MARS)])
def test_the_orbit_is_keplers_and_its_node_drifts_by_j2(body, figures):
    mu, radius, j2, *_ = figures
    a, e, i = radius + 6e5, 0.05, 1.2
    n = np.sqrt(mu / a**3)
    values = {"body": body, "semi_major_axis": a, "eccentricity": e, "inclination": i}
    times = np.linspace(0.0, 2.0 * np.pi / n, 50)
    rows = course(times, j2=False, **values)
    r, v = rows[:, :3], rows[:, 3:6]
    energy = 0.5 * (v * v).sum(axis=1) - mu / np.linalg.norm(r, axis=1)
    assert energy == pytest.approx(-0.5 * mu / a, rel=1e-12)
    h = np.cross(r, v)
    assert h == pytest.approx(np.tile(h[0], (50, 1)), rel=1e-12, abs=1e-3)
    pole = np.radians(figures[3:])
    z = np.array(
        (
            np.cos(pole[1]) * np.cos(pole[0]),
            np.cos(pole[1]) * np.sin(pole[0]),
            np.sin(pole[1]),
        )
    )
    assert h[0] @ z / np.linalg.norm(h[0]) == pytest.approx(np.cos(i), rel=1e-12)
    day = 86400.0
    later = course([0.0, day], **values)
    first, last = (np.cross(x[:3], x[3:6]) for x in later)
    first, last = (x - (x @ z) * z for x in (first, last))
    turn = np.arccos(first @ last / np.linalg.norm(first) / np.linalg.norm(last))
    drift = 1.5 * n * j2 * (radius / a / (1 - e * e)) ** 2 * np.cos(i) * day
    assert turn == pytest.approx(drift, rel=2e-3)


def test_the_share_of_eclipse_is_that_of_a_cylinder():
    """100 km over the Moon; the penumbra moves it by less than 1 %."""
    mu, radius = MOON[:2]
    a = radius + 1e5
    period = 2.0 * np.pi * np.sqrt(a**3 / mu)
    times = np.linspace(0.0, period, 4000, endpoint=False)
    rows = course(times, body=0, semi_major_axis=a, inclination=1.5708, j2=False)
    light = rows[:, 9]
    normal = np.cross(rows[0, :3], rows[0, 3:6])
    beta = np.arcsin(abs(normal @ rows[0, 6:9]) / np.linalg.norm(normal))
    inside = np.sqrt(1.0 - (radius / a) ** 2) / np.cos(beta)
    share = np.arccos(inside) / np.pi if inside < 1.0 else 0.0
    assert (light < 0.5 * light.max()).mean() == pytest.approx(share, abs=0.005)


def test_the_sun_of_mars_is_at_its_distance_and_of_the_moon_at_the_earths():
    """Perihelion of Mars on 2022-06-21: 1.3815 AU; aphelion 2023-05-30: 1.6659 AU."""
    for epoch, distance in ((709041600.0, 1.3815), (738720000.0, 1.6659)):
        rows = course([0.0], body=1, semi_major_axis=8e6, epoch_j2000=epoch)
        light = max(rows[0, 9], 1e-9)
        if light > 1e-6:
            assert light**-0.5 == pytest.approx(distance, rel=1e-3)
    rows = course(np.arange(0.0, 7200.0, 100.0), body=0, semi_major_axis=1e7)
    assert rows[:, 9].max() == pytest.approx(1.0, abs=0.04)


def test_an_orbit_inside_is_refused():
    with pytest.raises(ValueError, match="inside the body"):
        started("environment_planet", semi_major_axis=1.8e6, eccentricity=0.2)
