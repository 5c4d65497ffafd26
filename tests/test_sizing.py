"""`desat size`: secular torque, least rods, and the momentum-only model against the closed loop."""

from __future__ import annotations

import json
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from scipy.optimize import minimize

from desat.runs.run import Options
from desat.studies import sizing
from desat.studies.sizing import Flight, least_rod, secular, size
from desat.system.errors import DesatError, Exit

NAME = "nadir_day/day-dipole"
FIELD, TORQUE, PERIOD = 3e-5, 2e-6, 5400.0
PYRAMID = [[0.5, -0.5, -0.5, 0.5], [0.5, 0.5, -0.5, -0.5], [0.7, 0.7, 0.7, 0.7]]


def still(b=(FIELD, 0.0, 0.0), torque=(0.0, 0.0, TORQUE), cyclic=0.0) -> Flight:
    """Two and a half orbits of a craft that does not turn, in a field that does not change."""
    times = np.arange(0.0, 2.5 * PERIOD + 1.0, 10.0)
    turn = np.sin(2.0 * pi * times / PERIOD)[:, None] * np.array([0.0, cyclic, 0.0])
    rows = np.ones((len(times), 1))
    return Flight(
        times, PERIOD, times[:, None] * np.array(torque) + turn, rows * [0.0, 0.0, 0.0, 1.0],
        rows * np.array(b), 0.0 * rows * np.ones(3), np.zeros(4), np.array(PYRAMID),
        np.full(4, 0.05), np.eye(3), 1.0,
    )  # fmt: skip


def test_secular_and_cyclic_are_told_apart_over_whole_orbits():
    torque, rest = secular(still(cyclic=0.01))
    assert torque == pytest.approx([0.0, 0.0, TORQUE], abs=1e-18)
    assert len(rest) == 2 * PERIOD / 10.0 + 1
    assert np.abs(rest).max(axis=0) == pytest.approx([0.0, 0.01, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("torque", "least"),
    [((0.0, 0.0, TORQUE), TORQUE / FIELD), ((0.0, TORQUE, TORQUE), TORQUE / FIELD),
     ((TORQUE, 0.0, 0.0), np.inf)],
)  # fmt: skip
def test_the_least_rod_in_a_field_that_stays(torque, least):
    """Across the field the rod that works against it, each axis its own; along it none does."""
    formula, programme = least_rod(still(torque=torque), np.array(torque))
    assert programme == pytest.approx(least, rel=1e-9)
    assert formula <= programme * (1.0 + 1e-9)


def test_without_a_secular_torque_no_rod_is_needed():
    assert least_rod(still(torque=(0.0, 0.0, 0.0)), np.zeros(3)) == (0.0, 0.0)


@pytest.mark.parametrize("seed", range(2))
def test_the_programme_is_its_dual_by_another_solver(seed):
    """The most of (y . s) / sum |able . y| over y, which is convex in two unknowns."""
    rng = np.random.default_rng(seed)
    able, torque = rng.normal(size=(300, 3)) * [1e-5, 3e-5, 2e-5], rng.normal(size=3) * 1e-6
    n = torque / np.linalg.norm(torque)
    across = np.linalg.svd(n[None])[2][1:]

    def cost(u):
        return np.abs(able @ (n + u @ across)).sum() * 1e3

    fine = {"xatol": 1e-12, "fatol": 1e-15, "maxiter": 10000}
    starts = rng.normal(size=(2, 2))
    best = min(minimize(cost, x, method="Nelder-Mead", options=fine).fun for x in starts)
    expected = np.linalg.norm(torque) / (best / 1e3)
    assert sizing._programme(able, torque) == pytest.approx(expected, rel=1e-7)


@pytest.fixture(scope="module")
def made():
    return size(NAME, Options(stop=20000.0))


def test_the_model_follows_the_closed_loop(made):
    flown = [row for row in made.curve if row.loop_rms is not None]
    assert [round(row.multiple, 6) for row in flown][:2] == [1.0, 1.3]
    assert made.recommended in [row.rod for row in flown]
    for row in flown:
        assert row.rms == pytest.approx(row.loop_rms, rel=0.02)
        assert row.largest == pytest.approx(row.loop_largest, rel=0.02)
        assert row.duty == pytest.approx(row.loop_duty, abs=0.01)
    assert made.problems == ()


def test_larger_rods_hold_less_and_work_less(made):
    rms, duty = ([getattr(row, key) for row in made.curve] for key in ("rms", "duty"))
    assert rms == sorted(rms, reverse=True)
    assert duty == sorted(duty, reverse=True)
    (row,) = [row for row in made.curve if row.rod == made.recommended]
    assert row.duty <= made.duty
    assert row.multiple >= 1.3


def test_what_cannot_hold_ends_with_1(desat):
    told = desat("size", NAME, "--stop", "12000", "--no-loop", "--set", "torquers.m_limit=0.01",
                 "--json")  # fmt: skip
    assert told.returncode == Exit.UNMET
    made = json.loads(told.stdout)
    assert made["rod"] == 0.01 < made["least"]
    assert "it cannot hold: rods of 0.01 A m2: the secular torque" in told.stderr.replace("\n", " ")


def test_wheels_below_the_cyclic_momentum_and_no_rod_at_all_are_said(made):
    full = replace(made, wheel_capacity=0.9 * made.wheel_needed, least=np.inf)
    rods, wheels = sizing._problems(full)
    assert rods.startswith("no rod takes the secular torque out")
    assert wheels.startswith(f"wheels of {full.wheel_capacity:.4g} N m s: the cyclic momentum")
    assert sizing._problems(replace(made, rod=made.least, wheel_capacity=made.wheel_needed)) == []


def test_a_law_that_the_model_has_not_is_said():
    made = size("integrated/mil-nadir", Options(stop=12000.0), flown=False)
    assert (made.curve, made.recommended) == ((), None)
    assert any("closed loop only" in line for line in made.notes)
    assert made.least > 0.0


@pytest.mark.parametrize(
    ("target", "options", "duty", "text"),
    [
        (NAME, Options(stop=600.0), 0.5, "an orbit 5717 s: at least one is needed"),
        (NAME, Options(stop=12000.0), 1.0, "--duty 100: a share between 0 and 100 %"),
        (
            "plant/light",
            Options(),
            0.5,
            "no torquers: a craft with environment,",
        ),
    ],
)
def test_what_cannot_be_sized_is_refused(target, options, duty, text):
    with pytest.raises(DesatError, match=text):
        size(target, options, duty, flown=False)
