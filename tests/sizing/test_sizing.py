"""`desat size`: secular torque by source, least rods, laws, the momentum-only model,
map, page."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from math import inf, pi, radians

import numpy as np
import pytest
from scipy.optimize import minimize

from benchmarks import sizing as bench
from desat.analyses import flight as flights
from desat.analyses.flight import Flight, Hardware, secular
from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.components.laws import cross_product
from desat.fmus.registry import block_class
from desat.numbers.derived import cross
from desat.numbers.text import format_momenta
from desat.runs.prepare import prepare
from desat.runs.run import Options, execute
from desat.sizing import law as law_module
from desat.sizing import map as sizing_map
from desat.sizing import page as sizing_page
from desat.sizing import sizing
from desat.sizing.law import UnsuitedError, ask, law_by, law_of
from desat.sizing.least_rod import (
    compute_geometry,
    least_by_formula,
    least_by_programme,
    reach,
    solve_programme,
)
from desat.sizing.model import fly, track_of
from desat.sizing.momentum import smallest_wheel_capacity
from desat.sizing.propellant import GRAVITY, YEAR, compute_propellant
from desat.sizing.requirements import SizingRequirements
from desat.sizing.result import Course, find_margins, find_problems
from desat.sizing.rods import CURVE_MULTIPLES, round_up
from desat.sizing.scenarios import fly_case
from desat.sizing.sizing import size
from desat.sizing.year import YEAR_DATES
from desat.system.errors import DesatError, Exit

NAME = "nadir_day/day-dipole"
FIELD, TORQUE, PERIOD = 3e-5, 2e-6, 5400.0
PYRAMID = np.array(
    [[0.5, -0.5, -0.5, 0.5], [0.5, 0.5, -0.5, -0.5], [0.7, 0.7, 0.7, 0.7]]
)


def craft(**changes) -> Hardware:
    values = {
        "axes_wheel": PYRAMID,
        "capacity": np.full(4, 0.05),
        "torque_limit": 1e-3,
        "axes_coil": np.eye(3),
        "m_limit": 1.0,
        "longest": 1.0,
        "open": 1.0,
        "inertia": np.eye(3),
        "carrier": np.eye(3),
        "arm": None,
        "specific_impulse": None,
    }
    return Hardware(**{**values, **changes})


def still(
    b=(FIELD, 0.0, 0.0), torque=(0.0, 0.0, TORQUE), cyclic=0.0, h=(0.0, 0.0, 0.0)
) -> Flight:
    """Two and a half orbits of a craft that does not turn, in a field that does not
    change."""
    times = np.arange(0.0, 2.5 * PERIOD + 1.0, 10.0)
    turn = np.sin(2.0 * pi * times / PERIOD)[:, None] * np.array([0.0, cyclic, 0.0])
    rows = np.ones((len(times), 1))
    return Flight(
        times,
        PERIOD,
        times[:, None] * np.array(torque) + turn,
        rows * [0.0, 0.0, 0.0, 1.0],
        rows * np.array(b),
        0.0 * rows * np.ones(3),
        np.array(h),
        {},
        times,
        rows * [7e6, 0.0, 0.0],
        rows * [0.0, 7.5e3, 0.0],
        0.0 * rows * np.ones(3),
    )


def turning(seed=1) -> Flight:
    """The same where field and disturbance turn, each at its own rate."""
    rng = np.random.default_rng(seed)
    base = still()
    t = base.times[:, None]
    b = FIELD * np.cos(
        2.0 * pi * t / PERIOD * np.array([1.0, 2.0, 1.0]) + rng.uniform(0, 6, 3)
    )
    inputs = 1e-6 * t + 1e-3 * np.sin(2.0 * pi * t / PERIOD + rng.uniform(0.0, 6.0, 3))
    return replace(base, b=b, disturbance=inputs - inputs[0])


# --- momentum and the least rod -------------------------------------------------------


def test_secular_and_cyclic_are_told_apart_over_whole_orbits():
    torque, rest = secular(still(cyclic=0.01))
    assert torque == pytest.approx([0.0, 0.0, TORQUE], abs=1e-18)
    assert len(rest) == 2 * PERIOD / 10.0 + 1
    assert np.abs(rest).max(axis=0) == pytest.approx([0.0, 0.01, 0.0], abs=1e-12)


@pytest.mark.parametrize(
    ("torque", "least"),
    [
        ((0.0, 0.0, TORQUE), TORQUE / FIELD),
        ((0.0, TORQUE, TORQUE), TORQUE / FIELD),
        ((TORQUE, 0.0, 0.0), np.inf),
    ],
)
def test_the_least_rod_in_a_field_that_stays(torque, least):
    """Across the field the rod that works against it, each axis its own; along it none
    does."""
    able = reach(still(torque=torque), craft())
    programme = least_by_programme(able, np.array(torque))
    assert programme == pytest.approx(least, rel=1e-9)
    assert least_by_formula(able, np.array(torque)) <= programme * (1.0 + 1e-9)


def test_without_a_secular_torque_no_rod_is_needed():
    able = reach(still(), craft())
    assert (
        least_by_formula(able, np.zeros(3))
        == least_by_programme(able, np.zeros(3))
        == 0.0
    )


@pytest.mark.parametrize("seed", range(2))
def test_the_programme_is_its_dual_by_another_solver(seed):
    """The most of (y . s) / sum |able . y| over y, which is convex in two unknowns."""
    rng = np.random.default_rng(seed)
    able, torque = (
        rng.normal(size=(300, 3)) * [1e-5, 3e-5, 2e-5],
        rng.normal(size=3) * 1e-6,
    )
    n = torque / np.linalg.norm(torque)
    across = np.linalg.svd(n[None])[2][1:]

    def cost(u):
        return np.abs(able @ (n + u @ across)).sum() * 1e3

    fine = {"xatol": 1e-12, "fatol": 1e-15, "maxiter": 10000}
    starts = rng.normal(size=(2, 2))
    best = min(
        minimize(cost, x, method="Nelder-Mead", options=fine).fun for x in starts
    )
    dual_value = np.linalg.norm(torque) / (best / 1e3)
    assert solve_programme(able, torque) == pytest.approx(dual_value, rel=1e-7)


def test_where_the_field_stays_rods_do_nothing_along_it():
    flight, hardware = still(), craft()
    able = reach(flight, hardware)
    geometry = compute_geometry(
        flight, hardware, able, np.array([0.0, 0.0, TORQUE]), TORQUE / FIELD
    )
    assert abs(geometry.weakest[0]) > 0.99
    assert geometry.weakness < 0.15
    assert geometry.blind == 0.0
    blind = compute_geometry(
        flight, hardware, able, np.array([TORQUE, 0.0, 0.0]), 1.0
    ).blind
    assert blind == pytest.approx(2.0 * PERIOD, abs=20.0)


# --- laws -----------------------------------------------------------------------------


def cross_block(**values):
    block = block_class("manager_cross_product")()
    for name, value in {"gain": 2e-3, "sample_time": 10.0, **values}.items():
        setattr(block, name, value)
    return block


def test_a_law_is_what_its_block_says():
    """K h of the model is the dipole of the law's own function."""
    flight, rows = turning(), np.arange(0, 1000, 100)
    target = np.array([1e-3, 0.0, 0.0])
    requests = ask(law_by(cross_block(), "x", target), flight, rows)
    h = np.array([3e-3, -1e-3, 2e-3])
    for k, row in enumerate(rows):
        law_dipole = cross_product.normalised(tuple(h), tuple(flight.b[row]), 2e-3)
        assert requests.gain[k] @ h + requests.offset[k] == pytest.approx(
            law_dipole, rel=1e-12
        )


@pytest.mark.parametrize("saturation", [True, False])
def test_the_model_steps_as_written_out(saturation):
    """Its three lines for one rod, one after the other."""
    flight, hardware, m, target = turning(), craft(), 0.05, np.array([1e-3, 0.0, -2e-3])
    flight = replace(flight, h_start=np.array([0.01, -0.02, 0.005]))
    law = law_by(cross_block(h_deadband=4e-3, saturation=saturation), "x", target)
    flight_numbers = fly([track_of(flight, law, hardware)], law, hardware, [0.2 * m, m])
    h, sizes, duty = flight.h_start.copy(), [np.linalg.norm(flight.h_start)], []
    for k in range(len(flight.times) - 1):
        away = h - target
        law_dipole = np.zeros(3)
        if np.linalg.norm(away) > 4e-3:
            law_dipole = np.array(
                cross_product.normalised(tuple(away), tuple(flight.b[k]), 2e-3)
            )
        coils = np.clip(law_dipole, -m, m)
        duty.append(np.abs(coils).mean() / m)
        middle = (flight.b[k] + flight.b[k + 1]) / 2.0
        h = (
            h
            + flight.disturbance[k + 1]
            - flight.disturbance[k]
            + np.cross(coils, middle) * 10.0
        )
        sizes.append(np.linalg.norm(h))
    assert flight_numbers.rms[0, 0, 1] == pytest.approx(
        np.sqrt(np.mean(np.square(sizes))), rel=1e-10
    )
    assert flight_numbers.largest[0, 0, 1] == pytest.approx(max(sizes), rel=1e-10)
    assert flight_numbers.duty[0, 0, 1] == pytest.approx(np.mean(duty), rel=1e-10)


@pytest.mark.parametrize(
    ("model", "values", "text"),
    [
        ("manager_closed_loop", {"centre_gain": 0.5}, "with memory"),
        ("manager_integrated", {}, "no law of the momentum alone"),
        ("manager_combined", {}, "no law of the momentum alone"),
    ],
)
def test_what_is_no_law_of_the_momentum_alone_is_refused(model, values, text):
    block = block_class(model)()
    for name, value in values.items():
        setattr(block, name, value)
    with pytest.raises(UnsuitedError, match=text):
        ask(
            law_by(block, model, np.zeros(3)), day_of(NAME)[1], np.arange(0, 20000, 500)
        )


@pytest.mark.parametrize(
    "model",
    ["manager_cross_product", "manager_closed_loop", "manager_magnetic_ilqr"],
)
def test_a_native_fmu_gives_a_law_as_its_block_does(model, monkeypatch):
    """The momenta of the wheels of a pyramid are units to the last bit but one."""
    flight, rows = turning(), np.arange(0, 1350, 10)

    def answer():
        block = block_class(model)()
        answers = ask(law_by(block, model, np.zeros(3)), flight, rows)
        return answers, block

    native, block = answer()
    assert (
        law_module._ask_native(
            law_by(block, model, np.zeros(3)), law_module._samples(None, flight, rows)
        )
        is not None
    )
    monkeypatch.setattr(law_module, "native_of", lambda block: None)
    block_answers, _ = answer()
    largest = np.abs(block_answers.gain).max()
    assert native.gain == pytest.approx(
        block_answers.gain, rel=1e-12, abs=1e-14 * largest
    )
    assert native.offset == pytest.approx(block_answers.offset, rel=1e-12)


def test_a_law_that_comes_to_remember_is_refused(monkeypatch):
    """By one flight that takes the momenta in turn: the first rows show nothing."""
    real = law_module.rows_of
    calls = []

    def remembers(component, times, outputs, inputs, values):
        rows = real(component, times, outputs, inputs, values)
        calls.append(1)
        if len(calls) == len(law_module.MOMENTA) + 1:
            rows[100:] *= 1.0 + 1e-15
        return rows

    monkeypatch.setattr(law_module, "rows_of", remembers)
    block = block_class("manager_closed_loop")()
    with pytest.raises(UnsuitedError, match="with memory"):
        ask(law_by(block, "x", np.zeros(3)), turning(), np.arange(0, 1350, 10))


def test_a_law_that_plans_by_the_momentum_is_refused():
    system, run = day_of("space_telescope/open-me-nominal")
    with pytest.raises(UnsuitedError, match="with memory"):
        ask(law_of(system.components["manager"]), run, np.arange(0, 4000, 10))


def test_a_law_that_is_not_affine_is_refused():
    class Strange(block_class("manager_cross_product")):
        def dipole(self, elapsed_time, h):
            m = super().dipole(elapsed_time, h)
            return m and tuple(x * abs(x) for x in m)

    with pytest.raises(UnsuitedError, match="not affine"):
        ask(
            law_by(Strange(), "strange", np.zeros(3)), turning(), np.arange(0, 1350, 50)
        )


def test_a_law_of_ones_own_is_one_of_the_model():
    class Mine(block_class("manager_cross_product")):
        def dipole(self, elapsed_time, h):
            return tuple(
                0.5 * x for x in cross(np.array([self.b_body]), np.array([h]))[0]
            )

    flight = turning()
    requests = ask(law_by(Mine(), "mine", np.zeros(3)), flight, np.arange(3))
    assert requests.gain[1] @ np.array([1.0, 2.0, 3.0]) == pytest.approx(
        0.5 * np.cross(flight.b[1], [1.0, 2.0, 3.0])
    )


# --- a craft --------------------------------------------------------------------------


@pytest.fixture(scope="module")
def reference_sizing():
    return size(
        NAME,
        Options(stop=20000.0),
        SizingRequirements(
            slew_angle=radians(60.0), slew_time=300.0, arm=0.3, specific_impulse=60.0
        ),
    )


@pytest.mark.slow
def test_the_model_follows_the_closed_loop(reference_sizing):
    flight = [row for row in reference_sizing.curve if row.loop_rms is not None]
    assert [round(row.multiple, 6) for row in flight][:1] == [1.3]
    assert len(flight) == 1, (
        "what is recommended holds on another day, beyond this day's curve"
    )
    assert {row.law for row in flight} == {"cross product"} == {reference_sizing.law}
    for row in flight:
        assert row.rms == pytest.approx(row.loop_rms, rel=0.02)
        assert row.largest == pytest.approx(row.loop_largest, rel=0.02)
        assert row.duty == pytest.approx(row.loop_duty, abs=0.01)
    assert reference_sizing.problems == ()


def test_a_slew_is_of_half_a_turn_at_most():
    SizingRequirements(slew_angle=pi, slew_time=60.0)
    with pytest.raises(
        DesatError, match=r"5157 deg: a turn to any attitude is of 180 deg at most"
    ):
        SizingRequirements(slew_angle=90.0, slew_time=60.0)


def test_the_model_follows_a_loop_whose_tachometers_are_noisy(monkeypatch):
    """Without their noise it says 17 % less; the bar is 5 %."""
    options = Options(stop=14000.0, sets=["tachometers.noise=0.02"])
    wishes = SizingRequirements(laws=False, year=False)

    def errors():
        rows = [r for r in size(NAME, options, wishes).curve if r.loop_rms is not None]
        assert rows
        return [abs(r.rms / r.loop_rms - 1.0) for r in rows if r.multiple > 1.15]

    assert max(errors()) < 0.05
    hardware_of = sizing.hardware_of
    monkeypatch.setattr(
        sizing, "hardware_of", lambda s: replace(hardware_of(s), noise=0.0)
    )
    assert max(errors()) > 0.05


def test_larger_rods_hold_less_and_work_less(reference_sizing):
    for law in {row.law for row in reference_sizing.curve}:
        rows = [row for row in reference_sizing.curve if row.law == law]
        assert [r.rms for r in rows] == sorted((r.rms for r in rows), reverse=True)
        assert len(rows) >= len(CURVE_MULTIPLES)
    assert (
        reference_sizing.recommended
        >= reference_sizing.recommended_day
        >= 1.3 * reference_sizing.least
    )
    assert reference_sizing.recommended >= 1.3 * reference_sizing.least_year
    assert [b.law for b in reference_sizing.best] == [
        "cross product",
        "ccpl",
        "CP with gravity",
        "quasi-static LQR",
    ]


def test_the_sources_make_the_whole(reference_sizing):
    assert sum(s.along for s in reference_sizing.sources) == pytest.approx(
        1.0, abs=1e-4
    )
    assert reference_sizing.unexplained < 1e-4 * np.linalg.norm(
        reference_sizing.secular
    )
    assert {s.name for s in reference_sizing.sources} == set(flights.SOURCES)


def test_its_own_rods_are_in_the_curve_and_judged(reference_sizing):
    (row,) = [
        r
        for r in reference_sizing.curve
        if r.rod == reference_sizing.rod and r.law == reference_sizing.law
    ]
    assert row.duty < 0.1
    (duty,) = [
        m
        for m in reference_sizing.margins
        if (m.case, m.of) == ("the day of the scenario", "coils")
    ]
    assert duty.used == pytest.approx(100.0 * row.duty, rel=0.02)
    capacity = reference_sizing.wheel_allowed
    over = {"the day of the scenario": Course(1.2 * capacity, 0.1)}
    full = replace(
        reference_sizing, margins=tuple(find_margins(reference_sizing, over))
    )
    (line,) = find_problems(full)
    assert "the fullest one comes to" in line
    assert full.margins[0].margin == pytest.approx(-0.2)
    assert list(full.margins) == sorted(full.margins, key=lambda m: m.margin)


def test_slew_propellant_and_what_follows_by_hand(reference_sizing):
    system, _ = prepare(NAME, Options()).or_raise()
    hardware = flights.hardware_of(system)
    rate = 2.0 * radians(60.0) / 300.0
    worst = max(
        np.linalg.norm(row)
        for row in np.linalg.pinv(hardware.axes_wheel) @ hardware.inertia
    )
    assert reference_sizing.slew_momentum == pytest.approx(worst * rate)
    assert reference_sizing.slew_torque == pytest.approx(
        2.0 * reference_sizing.slew_momentum / 300.0
    )
    size_ = float(np.linalg.norm(reference_sizing.secular))
    straight = size_ * 365.25 * 86400.0 / (0.3 * 60.0 * 9.80665)
    assert (
        straight
        <= reference_sizing.propellant_least
        <= reference_sizing.propellant
        <= 3.0**0.5 * straight
    )
    assert reference_sizing.tip_off == pytest.approx(
        np.linalg.eigvalsh(hardware.inertia)[-1] * radians(5.0)
    )
    assert 0.0 < reference_sizing.detumbling < 1e5
    of_slew = [m.of for m in reference_sizing.margins if m.case == "slew"]
    assert sorted(of_slew) == ["wheel torque", "wheels"]


def test_a_years_days_are_what_the_scenario_says_of_that_day(reference_sizing):
    """A run begun at another date has the torque that the year says of it: within 1 %."""
    assert len({d.day for d in reference_sizing.year}) == YEAR_DATES
    assert {d.activity for d in reference_sizing.year} == {"low", "high"}
    system, _ = prepare(NAME, Options()).or_raise()
    days = 28 * 4
    component = system.components["environment"]
    block = flights.environment_block(component)
    sets = {
        "environment.epoch_j2000": block.epoch_j2000 + 86400.0 * days,
        "environment.atmosphere": "activity",
        "environment.solar_activity": "high",
        "environment.raan": block.raan + block._drift[0] * 86400.0 * days,
    }
    orbits = int(86400.0 / reference_sizing.period) * reference_sizing.period
    then = size(
        NAME,
        Options(
            stop=float(round(orbits)) + 10.0, sets=[f"{k}={v}" for k, v in sets.items()]
        ),
        SizingRequirements(flown=False, year=False, laws=False),
    )
    (day,) = [d for d in reference_sizing.year if d.activity == "high"][4:5]
    assert day.secular == pytest.approx(np.linalg.norm(then.secular), rel=0.01)
    assert day.least == pytest.approx(then.least_formula, rel=0.01)


@cache
def day_of(name, stop=20000.0):
    case = prepare(name, Options(stop=stop))
    system, _ = case.or_raise()
    return system, fly_case(case, system)


def test_a_flight_without_a_run_is_that_of_a_run():
    """Attitude, field and disturbances by the environment's block, against those
    recorded."""
    system, run = day_of(NAME)
    attitude = flights.attitude_of(system, run.q, run.r, run.v)
    assert attitude.kind == "nadir"
    nodes, times = np.arange(0.0, 20041.0, 120.0), np.arange(0.0, 20001.0, 10.0)
    block = flights.environment_block(system.components["environment"])
    inputs = flights.between(flights.inputs_at(block, nodes.tolist()), nodes, times)
    reference_sizing = flights.flown_at(system, attitude, inputs, times)
    off = np.abs(reference_sizing.b - run.b[::10]).max(axis=1) / np.abs(run.b).max()
    assert off.max() < 2e-4
    assert off[24:-24].max() < 3e-5
    run_torque, _ = secular(run)
    sizing_torque, _ = secular(reference_sizing)
    assert sizing_torque == pytest.approx(
        run_torque, abs=0.01 * np.linalg.norm(run_torque)
    )
    assert reference_sizing.body[1000:].mean(axis=0) == pytest.approx(
        run.body[10000:].mean(axis=0), abs=2e-5
    )


def test_the_torque_of_an_independent_estimate():
    """The secular torque of a textbook: gravity gradient 3 n^2 u x J u of a craft that
    points to nadir, turned to eci with it, has no secular part but along what the
    orbit's axis keeps."""
    system, run = day_of(NAME)
    j = flights.hardware_of(system).inertia
    n = 2.0 * pi / run.period
    normal = np.cross(run.r[0], run.v[0]) / np.linalg.norm(np.cross(run.r[0], run.v[0]))
    # u = z of lvlh; only its part about y, minus the orbit's normal, stays where it is
    # in eci
    gravity_torque = (
        3.0 * n**2 * np.cross([0.0, 0.0, 1.0], j @ [0.0, 0.0, 1.0])[1] * -normal
    )
    since = run.source_times - run.source_times[0]
    impulse = run.sources["gravity gradient"]
    mean_torque = (
        np.array([np.interp(run.orbits_duration, since, x) for x in impulse.T])
        / run.orbits_duration
    )
    assert mean_torque == pytest.approx(
        gravity_torque, abs=0.02 * np.linalg.norm(gravity_torque)
    )


# --- crafts that nobody chose; all ten and a day each: `make sizing`, docs/sizing.md --


@pytest.mark.slow
@pytest.mark.parametrize("kind", [1, 6])
def test_unseen_crafts_are_within_5_percent_of_the_closed_loop(kind):
    craft = bench.drawn(10)[kind]
    least, rows = bench.compare_model_with_loop(craft, (1.2, 2.5), 20000.0)
    assert least > 0.0
    assert bench.held(rows)
    assert [r.multiple for r in rows] == [1.2, 2.5]
    assert rows[0].loop_duty > rows[1].loop_duty > 0.0
    for row in rows:
        assert row.duty == pytest.approx(row.loop_duty, abs=0.02)
    wrong = [replace(r, rms=0.06) for r in rows]
    assert not bench.held(wrong)


def test_an_estimate_that_uses_nothing_of_ours_has_the_same_secular_torque():
    torque, _ = bench.secular_of(bench.TWELVE)
    assert bench.estimated(bench.TWELVE) == pytest.approx(
        torque, abs=0.01 * np.linalg.norm(torque)
    )


# --- the map --------------------------------------------------------------------------


def test_a_map_says_of_its_orbit_what_the_model_says_of_a_run(tmp_path):
    system, run = day_of(NAME, None)
    block = flights.environment_block(system.components["environment"])
    altitude = block.semi_major_axis - 6378137.0
    residual = float(np.linalg.norm([0.1, -0.05, 0.08]))
    axes = sizing_map.MapAxes(
        (0.05, 0.02),
        (np.degrees(block.inclination), 40.0),
        (altitude,),
        (residual, 0.0),
    )
    reference_sizing = sizing_map.map_of(
        NAME, Options(stop=20000.0), axes, SizingRequirements(), jobs=1
    )
    assert reference_sizing.rms.shape == (1, 2, 1, 2, 2)
    hardware = flights.hardware_of(system)
    torque, _ = secular(run)
    least = least_by_formula(reach(run, hardware), torque)
    assert reference_sizing.least[0, 0, 0] == pytest.approx(least, rel=0.01)
    assert reference_sizing.least[0, 0, 1] < reference_sizing.least[0, 0, 0]
    assert reference_sizing.laws == ("cross product",)
    # the run begins with filled wheels and turns a little, the map with empty ones at
    # rest
    law = law_of(system.components["manager"])
    empty = replace(run, h_start=run.body[5000:].mean(axis=0) - run.body[0])
    ours = fly([track_of(empty, law, hardware)], law, hardware, axes.rods)
    share = ours.wheel[0, 0] / smallest_wheel_capacity(hardware)
    for name, model_value in (
        ("rms", ours.rms[0, 0]),
        ("duty", ours.duty[0, 0]),
        ("filled", share),
    ):
        assert getattr(reference_sizing, name)[0, 0, 0, 0] == pytest.approx(
            model_value, rel=0.03
        ), name
    assert reference_sizing.as_json()["holds"] == reference_sizing.holds.tolist()
    page = sizing_page.write_map(reference_sizing, tmp_path / "map.html").read_text()
    assert page.count("<figcaption>") == 1
    assert "residual dipole" in page


def test_an_orbit_of_the_map_is_one_whatever_gives_the_scenarios():
    """Of an orbit given by position and velocity, too."""
    sets = ["environment.orbit_start=state"]
    system, _ = prepare(NAME, Options(sets=sets)).or_raise()
    component = system.components["environment"]
    block = flights.environment_block(component, sizing_map._orbit(30.0, 700e3))
    inputs = flights.inputs_at(block, [0.0, 60.0])
    assert np.linalg.norm(inputs["r_eci"], axis=1) == pytest.approx(6378137.0 + 700e3)
    normal = np.cross(inputs["r_eci"][0], inputs["v_eci"][0])
    assert normal[2] / np.linalg.norm(normal) == pytest.approx(
        np.cos(np.radians(30.0)), abs=1e-3
    )


def test_a_map_of_a_craft_that_moves_is_refused():
    with pytest.raises(DesatError, match="attitude moves"):
        sizing_map.map_of(
            "alsat1/slew-0.42",
            Options(stop=7000.0),
            sizing_map.MapAxes(),
            SizingRequirements(),
            jobs=1,
        )


# --- the command ----------------------------------------------------------------------


def test_the_page_says_it_all(reference_sizing, tmp_path):
    page = sizing_page.write_sizing(
        reference_sizing, tmp_path / "size.html"
    ).read_text()
    assert reference_sizing.answer in page
    assert page.count("<figcaption>") == 5
    for text in (
        "Cases",
        "gravity gradient",
        "wheel torque",
        "quasi-static LQR",
        "least rod, any law",
        "cross product, closed",
        reference_sizing.year[0].day,
    ):
        assert text in page
    assert "nan" not in page
    json.dumps(reference_sizing.as_json(), allow_nan=False)


def test_what_cannot_hold_ends_with_1(desat):
    outcome = desat(
        "size",
        NAME,
        "--stop",
        "12000",
        "--no-loop",
        "--no-year",
        "--own-law",
        "--set",
        "torquers.m_limit=0.01",
        "--json",
    )
    assert outcome.returncode == Exit.UNMET
    reference_sizing = json.loads(outcome.stdout)
    assert reference_sizing["rod"] == 0.01 < reference_sizing["least"]
    assert "cannot hold" in reference_sizing["answer"]
    assert (
        "it cannot hold: rods of 0.01 A m2: the secular torque"
        in outcome.stderr.replace("\n", " ")
    )


def test_wheels_below_the_cyclic_momentum_and_no_rod_at_all_are_said(reference_sizing):
    def problems(sizing):
        return find_problems(
            replace(sizing, margins=tuple(find_margins(sizing, {})), wheel_lost=0.0)
        )

    needed = reference_sizing.wheel_needed
    full = replace(
        reference_sizing,
        wheel_capacity=2.0 * (needed + reference_sizing.slew_momentum),
        wheel_allowed=0.9 * needed,
        least=np.inf,
        least_year=0.0,
    )
    rods, wheels = problems(full)
    assert rods.startswith("no rod takes the secular torque out")
    assert wheels.startswith(f"wheels, {format_momenta(full.wheel_allowed)} of them")
    enough = replace(
        reference_sizing,
        rod=reference_sizing.least_year,
        wheel_torque=inf,
        wheel_capacity=needed + reference_sizing.slew_momentum,
        wheel_allowed=needed,
    )
    assert problems(enough) == []
    assert problems(replace(enough, wheel_capacity=needed))[0].endswith(": slew")
    assert "the slew needs" in problems(replace(enough, wheel_torque=1e-9))[0]
    worst = problems(replace(enough, rod=reference_sizing.least))
    assert "worst day of the year" in worst[0]


def test_a_law_that_the_model_has_not_is_said():
    reference_sizing = size(
        "integrated/mil-nadir",
        Options(stop=12000.0),
        SizingRequirements(flown=False, year=False),
    )
    assert reference_sizing.law == "cross product"
    assert any(
        "manager_integrated: closed loop only" in line
        for line in reference_sizing.notes
    )
    assert reference_sizing.least > 0.0


@pytest.mark.parametrize(
    ("target", "options", "values", "text"),
    [
        (NAME, Options(stop=600.0), {}, "an orbit 5717 s: at least one is needed"),
        (
            NAME,
            Options(stop=12000.0),
            {"duty": 1.0},
            "--duty 100: a share between 0 and 100 %",
        ),
        (
            NAME,
            Options(stop=12000.0),
            {"margin": 0.9},
            "--margin 0.9: a factor of 1 or more",
        ),
        (NAME, Options(stop=12000.0), {"arm": -1.0}, "--arm -1: a number above 0"),
        ("plant/light", Options(), {}, "no torquers: a craft with environment,"),
    ],
)
def test_what_cannot_be_sized_is_refused(target, options, values, text):
    with pytest.raises(DesatError, match=text):
        size(target, options, SizingRequirements(**values, flown=False, year=False))


def test_a_bias_fills_the_wheels(reference_sizing):
    options = Options(stop=20000.0, sets=["manager.h_target_body=0,0.1,0"])
    with_bias = size(
        NAME, options, SizingRequirements(flown=False, year=False, laws=False)
    )
    spread = np.abs(
        np.linalg.pinv(
            flights.hardware_of(prepare(NAME, options).or_raise()[0]).axes_wheel
        )
        @ [0.0, 0.1, 0.0]
    ).max()
    assert with_bias.wheel_needed == pytest.approx(
        reference_sizing.wheel_needed + spread, rel=0.05
    )


def test_a_map_by_the_command(desat):
    outcome = desat(
        "size",
        NAME,
        "--map",
        "--rods",
        "0.05,0.2",
        "--inclinations",
        "52",
        "--altitudes",
        "500",
        "--dipoles",
        "0.1",
        "--stop",
        "12000",
        "--jobs",
        "1",
        "--json",
        check=True,
    )
    reference_sizing = json.loads(outcome.stdout)
    assert reference_sizing["axes"]["altitudes"] == [500e3]
    assert reference_sizing["laws"] == ["cross product"]
    assert np.shape(reference_sizing["rms"]) == (1, 1, 1, 1, 2)
    assert (
        reference_sizing["rms"][0][0][0][0][1] < reference_sizing["rms"][0][0][0][0][0]
    )


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--slew", "60"], "--slew 60: an angle in deg and a time in s"),
        (["--rods", "1,2"], "--rods: it belongs to --map"),
        (["--map", "--rods", "1,b"], "--rods 1,b: numbers are needed"),
    ],
)
def test_options_that_make_no_sense_are_refused(desat, arguments, text):
    outcome = desat("size", NAME, *arguments)
    assert outcome.returncode == Exit.INPUT
    assert text in outcome.stderr.replace("\n", " ")


def test_where_no_law_fits_the_least_rod_is_the_answer():
    """One wheel and a boom: a cross product that takes wheels about three axes was said
    to do."""
    reference_sizing = size(
        "alsat1/ours-case-a",
        Options(stop=7000.0),
        SizingRequirements(flown=False, year=False),
    )
    assert reference_sizing.best == ()
    assert (
        f"The least rod of any law is {reference_sizing.least:.3g} A m2 (the model has no law"
        in reference_sizing.answer
    )


# --- the worst day, the worst scenario, propellant by the layout ----------------------


@pytest.mark.slow
def test_a_craft_whose_rods_do_not_hold_on_the_worst_day(tmp_path):
    """It began, green, with the day of the scenario; what is recommended then meets
    that day. `make sizing` tries thirty crafts so."""
    facts = CraftFacts(
        size="12U",
        altitude="400km",
        inclination="51.6deg",
        rods="0.2",
        residual_dipole="0.09",
    )
    new_craft.write(tmp_path / "my12u", facts, "desat new craft")
    options = Options(values={"torquers.m_limit": 0.025})
    reference_sizing = size(
        str(tmp_path / "my12u"), options, SizingRequirements(laws=False)
    )
    assert (
        reference_sizing.least
        < 0.025
        < reference_sizing.least_year
        < reference_sizing.recommended
    )
    assert any(
        line.endswith("the worst day of the year, any law")
        for line in reference_sizing.problems
    )
    assert any(
        line.startswith("worst.toml with its rods of 0.025 A m2: momentum: ")
        for line in reference_sizing.problems
    )
    assert (
        f"Rods of {reference_sizing.recommended:.3g} A m2 would do."
        in reference_sizing.answer
    )
    text = reference_sizing.as_json()
    assert text["recommended"] == reference_sizing.recommended > text["recommended_day"]
    with_rods = Options(values={"torquers.m_limit": reference_sizing.recommended})
    assert (
        execute(str(tmp_path / "my12u" / "worst.toml"), with_rods).manifest.not_met
        == []
    )
    assert text["detumbling_recommended"] == pytest.approx(
        reference_sizing.detumbling * 0.025 / reference_sizing.recommended
    )


@pytest.mark.parametrize(
    ("required_momentum", "has", "text"),
    [
        (0.0909, 12.0, "0.0909 of 12 N m s"),
        (0.00389, 0.015, "3.89 of 15 mN m s"),
        (0.633, 4.0, "0.633 of 4 N m s"),
        (2.0, None, "2 N m s"),
        (0.9, 1234.0, "0.9 of 1234 N m s"),
    ],
)
def test_needed_and_had_are_in_one_unit(required_momentum, has, text):
    assert format_momenta(required_momentum, has) == text


def test_a_rod_is_rounded_up_to_what_is_typed():
    for rod in (0.038312, 0.0384, 1.0, 123.4, 9.991):
        assert rod <= round_up(rod) < 1.01 * rod
        assert float(f"{round_up(rod):.3g}") == round_up(rod)


def geo(**sets):
    """The GEO of public notes, by hand: 2,500 kg, 13 m2 at 1.35 m, four wheels of 50 N
    m s along (+-1, +-1, 1), pairs of 10 N at 1.5 m, 220 s; nadir."""
    times = np.arange(0.0, 86165.0, 60.0)
    turn = 2.0 * pi * times / 86164.0
    rows = np.ones((len(times), 1))
    # a craft that turns about its y axis, which is along -z of eci, once a day; s is
    # along x of eci
    q = np.stack([0 * turn, 0 * turn, 0 * turn, 0 * turn], axis=1)
    q[:, 2], q[:, 3] = np.sin(turn / 2.0), np.cos(turn / 2.0)
    reference_sizing = Flight(
        times,
        86164.0,
        times[:, None] * np.array([76.9e-6, 0.0, 0.0]),
        q,
        1e-7 * rows * [0, 0, 1],
        0.0 * rows * np.ones(3),
        np.zeros(3),
        {},
        times,
        rows * [4.2e7, 0.0, 0.0],
        rows * [0.0, 3e3, 0.0],
        0.0 * rows * np.ones(3),
    )
    return reference_sizing, craft(
        arm=1.5, specific_impulse=220.0, axes_wheel=GEO_WHEELS, **sets
    )


GEO_WHEELS = np.array([[1, -1, -1, 1], [1, 1, -1, -1], [1, 1, 1, 1]]) / 3.0**0.5


def test_propellant_of_pairs_is_what_each_axis_takes():
    """Where wheels are fullest, between two axes, both pairs fire: 1.41 of the least."""
    flight, hardware = geo()
    rotated_axes = np.roll(
        np.eye(3), 1, axis=0
    )  # the turning axis is the wheels' second
    hardware = replace(hardware, axes_wheel=rotated_axes @ GEO_WHEELS)
    system, _ = prepare(NAME, Options()).or_raise()
    spent, least = compute_propellant(
        system, flight, hardware, np.array([76.9e-6, 0, 0]), SizingRequirements()
    )
    straight = 76.9e-6 * YEAR / (1.5 * 220.0 * GRAVITY)
    assert straight == pytest.approx(0.749, abs=2e-3)
    assert least == pytest.approx(straight, rel=1e-3)
    assert spent == pytest.approx(2.0**0.5 * straight, rel=1e-2)
    assert spent == pytest.approx(1.038, rel=0.05), "flown, seven dumps"


def test_propellant_of_nozzles_is_by_their_own_on_times(tmp_path):
    new_craft.write(tmp_path / "jets", CraftFacts(thrusters="50mN"), "desat new craft")
    pairs = size(
        str(tmp_path / "jets"),
        Options(stop=12000.0),
        SizingRequirements(year=False, flown=False, laws=False),
    )
    file = tmp_path / "jets" / "craft.toml"
    text = file.read_text()
    begin, end = text.index("[parameters.thrusters]"), len(text)
    file.write_text(
        text[:begin].replace('"thrusters"', '"thrusters_nozzles"')
        + """
[parameters.thrusters]
sample_time = 10.0
thrust = [0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0]
specific_impulse = "70 s"
"""
    )
    assert end > begin
    reference_sizing = size(
        str(tmp_path / "jets"),
        Options(stop=12000.0),
        SizingRequirements(year=False, flown=False, laws=False),
    )
    assert reference_sizing.propellant is not None
    # one nozzle at 0.4 m each way; the pair has the arm of half its middle side
    assert reference_sizing.propellant == pytest.approx(
        pairs.propellant * 0.113 / 0.4, rel=0.02
    )
