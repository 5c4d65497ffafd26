"""Attitudes by a plan: slews within limits, and a target on the ground."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from desat.components.maths.attitude import error_angle, inverse, product, rotate
from desat.components.physics.orbit import EARTH_RADIUS, MU, ellipse_state
from tests.conftest import started

AXIS = EARTH_RADIUS + 5e5
RATE = (MU / AXIS**3) ** 0.5
NADIR, TARGET = (0.0, 1.0, 0, 0, 0, 1.0), (0.0, 3.0, 0, 0, 0, 1.0)


def fly(rows, seconds, step=1.0, **values):
    """Return times, attitudes and rates (rad/s) of a block along a circular orbit."""
    flat = [x for row in rows for x in row]
    plan = tuple(flat + [0.0] * (192 - len(flat)))
    block = started("guidance_plan", sun_eci=(0.0, 1.0, 0.0), plan=plan, **values)
    times, attitudes, rates = [], [], []
    for k in range(int(seconds / step)):
        t = step * k
        to, ahead = (1.0, 0.0, 0.0), (0.0, 0.6, 0.8)
        block.r_eci, block.v_eci = ellipse_state(AXIS, 0.0, RATE * t, RATE, to, ahead)
        if k == 0:
            block.start()
        block.advance(t, step)
        times.append(t)
        attitudes.append(block.q_ref_bi)
        rates.append(block.omega_ref_body)
    return np.array(times), attitudes, np.array(rates)


def differences(attitudes, step):
    """Return the rate (rad/s, body) of the attitudes from row to row."""
    out = []
    for a, b in itertools.pairwise(attitudes):
        x, y, z, w = product(b, inverse(a))
        size = np.linalg.norm((x, y, z))
        angle = 2.0 * np.arctan2(size, abs(w)) * np.sign(w)
        out.append(np.array((x, y, z)) / max(size, 1e-300) * angle / step)
    return np.array(out)


@pytest.mark.parametrize("step", [1.0, 5.0])
def test_the_rate_is_that_of_the_differenced_attitude(step):
    rows = [NADIR, (600.0, 0.0, 0, 0, 0.7071, 0.7071), (1800.0, 2.0, 0, 0, 0, 0)]
    _, attitudes, rates = fly(rows, 4000.0, step)
    assert np.abs(differences(attitudes, step) - rates[:-1]).max() < 1e-8


def test_slews_stay_within_their_limits_and_arrive():
    rows = [(0.0, 0.0, 0, 0, 0, 1.0), (100.0, 0.0, 0, 0.7071, 0, 0.7071)]
    limits = {"rate_limit": 5e-3, "acceleration_limit": 5e-5}
    times, attitudes, rates = fly(rows, 1200.0, **limits)
    size = np.linalg.norm(rates, axis=1)
    assert size.max() <= 5e-3 * (1.0 + 1e-9)
    assert size.max() > 4.9e-3
    change = np.linalg.norm(np.diff(rates, axis=0), axis=1)
    assert change.max() <= 5e-5 * (1.0 + 1e-9)
    assert error_angle(attitudes[99], (0.0, 0.0, 0.0, 1.0)) < 1e-12
    assert (
        error_angle(attitudes[-1], (0.0, 0.7071067811865476, 0.0, 0.7071067811865476))
        < 1e-4
    )
    # from rest to rest: at least 2 sqrt(angle / acceleration), or angle / rate + ramps
    still = times[(size > 1e-6) & (times > 99.0)]
    assert 400.0 < still[-1] - 100.0 < 700.0


def test_a_target_lies_along_z_while_it_is_above_its_elevation():
    _, attitudes, _ = fly(
        [TARGET],
        1400.0,
        target_latitude=0.24,
        target_longitude=0.19,
        elevation_limit=0.0873,
        acceleration_limit=1e-2,
        rate_limit=0.1,
    )
    e2 = 1.0 / 298.257223563 * (2.0 - 1.0 / 298.257223563)
    n = EARTH_RADIUS / np.sqrt(1.0 - e2 * np.sin(0.24) ** 2)
    flat = np.array((1.0, 1.0, 1.0 - e2))
    site0 = (
        n
        * flat
        * (
            np.cos(0.24) * np.cos(0.19),
            np.cos(0.24) * np.sin(0.19),
            np.sin(0.24),
        )
    )
    count = 0
    for k in range(0, 1400):
        angle = 7.292115e-5 * k
        c, s = np.cos(angle), np.sin(angle)
        site = np.array(((c, -s, 0), (s, c, 0), (0, 0, 1))) @ site0
        r, _ = ellipse_state(AXIS, 0.0, RATE * k, RATE, (1, 0, 0), (0, 0.6, 0.8))
        line = site - np.array(r)
        up = site / np.linalg.norm(site)
        elevation = np.arcsin(-line @ up / np.linalg.norm(line))
        z = np.array(rotate(attitudes[k], tuple(line / np.linalg.norm(line))))
        if elevation > 0.3:
            count += 1
            assert z[2] > np.cos(2e-3)
        elif elevation < -0.2 and k > 10:
            down = rotate(attitudes[k], tuple(-np.array(r) / np.linalg.norm(r)))
            assert down[2] > np.cos(0.2)
    assert count > 100


@pytest.mark.parametrize(
    ("row", "text"),
    [
        ((0.0, 5.0, 0, 0, 0, 1.0), "mode = 5 is none"),
        ((0.0, 0.0, 0, 0, 0, 0.0), "a quaternion is needed"),
    ],
)
def test_a_row_that_means_nothing_is_refused(row, text):
    with pytest.raises(ValueError, match=text):
        fly([row], 2.0)
