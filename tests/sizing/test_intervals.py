"""Intervals of a sizing over what is not known for sure of a craft."""

from __future__ import annotations

import numpy as np
import pytest

from desat.analyses.flight import fly_days, hardware_of, secular, wanted_attitude
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.begin.spread import combine_factors
from desat.campaign.sampling import change_value, draw_of
from desat.language.content import dispersions_of
from desat.language.scenario import Dispersion
from desat.runs.prepare import prepare, read, resolved
from desat.sizing import intervals
from desat.sizing.dumps import size
from desat.sizing.requirements import SizingRequirements
from desat.system.errors import DesatError
from desat.system.options import Options

LOW = CraftFacts(altitude="450km", size="6U", wings=("2 x 0.1m2 0.4m x",))
FAR = CraftFacts(
    sun="1AU",
    mass="600kg",
    wheels="4 pyramid 15Nms",
    thrusters="4 1N",
    dump="thrusters 70:10",
    cp="5cm,2cm,0cm +-2cm",
)


@pytest.mark.parametrize("facts", [LOW, FAR])
def test_a_draw_is_the_craft_with_its_values(tmp_path, facts):
    """The sum of bases is the flight of the craft whose parameters are those values."""
    write(tmp_path / "mine", facts, "")
    system, _ = resolved(str(tmp_path / "mine"), Options())
    attitude = wanted_attitude(system)
    draws = intervals.draw(system, fly_days(system, attitude), hardware_of(system))
    for k in (0, 7, 499):
        values = {
            name: draw
            for name, draw in draw_of(system, intervals.SEED, k).items()
            if name.startswith("spacecraft.")
        }
        other, _ = resolved(str(tmp_path / "mine"), Options(values=values))
        flight = intervals._thin(fly_days(other, attitude), intervals.ROWS)
        rows = draws.impulses[k]
        # bases are integrated over fewer rows
        assert np.abs(rows - flight.disturbance).max() <= 1e-3 * np.abs(rows).max()
        torque, _ = secular(flight)
        assert draws.momentum_a_day[k] == pytest.approx(
            86400.0 * float(np.linalg.norm(torque)), rel=1e-3
        )
        assert draws.wheel[k] == pytest.approx(
            intervals.fullest_wheel(flight, hardware_of(other)), rel=2e-3
        )


def test_what_is_known_has_no_width(tmp_path):
    write(tmp_path / "mine", FAR, "")
    file = tmp_path / "mine/craft.toml"
    text = file.read_text().partition("[dispersions]")[0]
    file.write_text(text)
    sizing = size(
        str(tmp_path / "mine"), Options(), SizingRequirements(flown=False, year=False)
    )
    assert sizing.intervals == () == sizing.assumptions
    assert "90 %" not in sizing.answer
    file.write_text(
        f'{text}[dispersions]\n"spacecraft.nonsense" = {{ factor = 2.0 }}\n'
    )
    with pytest.raises(DesatError, match="nonsense"):
        prepare(read(str(tmp_path / "mine")), Options()).or_raise()


@pytest.mark.study
def test_light_is_in_proportion_to_the_offset(tmp_path):
    """An offset times or divided by 2.1, and plates by 1.3, give dumps as much rarer."""
    facts = CraftFacts(
        sun="1AU",
        mass="600kg",
        wheels="4 pyramid 1Nms",
        thrusters="4 1N",
        dump="thrusters 70:10",
    )
    write(tmp_path / "mine", facts, "")
    sizing = size(
        str(tmp_path / "mine"), Options(), SizingRequirements(flown=False, year=False)
    )
    a_day, between, a_year = sizing.intervals[:3]
    factor = combine_factors(2.1, 1.3)
    assert a_day.high / a_day.nominal == pytest.approx(factor, rel=0.1)
    assert a_day.nominal / a_day.low == pytest.approx(factor, rel=0.1)
    assert between.nominal / between.low == pytest.approx(factor, rel=0.25)
    assert between.high / between.nominal == pytest.approx(factor, rel=0.25)
    assert a_year.high / a_year.nominal == pytest.approx(
        combine_factors(factor, 1.7, 1.2), rel=0.25
    )
    assert sizing.assumptions[0].share == pytest.approx(0.9, abs=0.05)
    assert "--cp narrows it" in sizing.answer


def test_inertia_that_is_drawn_can_exist():
    """Second moments with a factor each keep no moment above the sum of the others."""
    spec = Dispersion(factor=1.5)
    rng = np.random.default_rng(4)
    for _ in range(300):
        a, b, c = rng.uniform(0.1, 1.0, 3)
        inertia = np.diag([b + c, a + c, a + b])
        values = change_value(spec, inertia.ravel(), 3.0 * rng.normal(size=3))
        moments = np.linalg.eigvalsh(np.reshape(values, (3, 3)))
        assert 0.0 < moments[2] <= moments[0] + moments[1]
    same = change_value(spec, inertia.ravel(), np.zeros(3))
    assert np.allclose(same, inertia.ravel(), rtol=1e-15)


def test_ninety_percent_are_within():
    rng = np.random.default_rng(5)
    sizes = np.array(
        [
            np.linalg.norm(
                change_value(Dispersion(direction=2.0, factor=3.0), np.zeros(3), x)
            )
            for x in rng.normal(size=(4000, 4))
        ]
    )
    share = np.mean((sizes > 2.0 / 3.0) & (sizes < 6.0))
    assert share == pytest.approx(0.9, abs=0.015)
    shifts = np.array(
        [
            change_value(Dispersion(plus_minus=0.1), np.array([1.0]), x)[0]
            for x in rng.normal(size=(4000, 1))
        ]
    )
    assert np.mean(np.abs(shifts - 1.0) < 0.1) == pytest.approx(0.9, abs=0.015)


@pytest.mark.parametrize("sampling", ["random", "latin-hypercube", "sobol"])
def test_samplings_draw_around_the_scenario(tmp_path, sampling):
    write(tmp_path / "mine", LOW, "")
    system, _ = resolved(str(tmp_path / "mine"), Options())
    nominal = system.components["spacecraft"].values["offset_plates_body"]
    ratios = []
    for k in range(64):
        values = draw_of(system, 1, k, sampling, 64)["spacecraft.offset_plates_body"]
        share = np.array(values) / nominal
        assert np.ptp(share) < 1e-12  # one factor for all elements
        ratios.append(share[0])
    assert np.median(ratios) == pytest.approx(1.0, rel=0.2)
    assert max(ratios) > 1.5 > 1 / 1.5 > min(ratios)


def test_worst_scenario_draws_nothing_that_is_at_its_end(tmp_path):
    write(tmp_path / "mine", LOW, "")
    nominal, _ = resolved(str(tmp_path / "mine"), Options())
    worst, _ = resolved(str(tmp_path / "mine/worst.toml"), Options())
    assert "spacecraft.residual_dipole_body" in dispersions_of(nominal)
    assert not [x for x in dispersions_of(worst) if x.startswith("spacecraft.")]
    of = [
        np.linalg.norm(s.components["spacecraft"].values["residual_dipole_body"])
        for s in (worst, nominal)
    ]
    assert of[0] == pytest.approx(5.0 * of[1], rel=1e-5)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("dispersions = 3", r"craft.toml:1: dispersions = 3: a table \[dispersions\]"),
        (
            '[dispersions]\n"spacecraft.offset_plates_body" = { factor = 0.5 }',
            r"craft.toml.*offset_plates_body.*greater than 1",
        ),
        (
            '[dispersions]\n"spacecraft.offset_plates_body" = { factor = 2.0, signs = [1] }',
            "exactly one of",
        ),
        (
            '[dispersions]\n"wheels.torque_limit" = { plus_minus = -1.0 }',
            "greater than 0",
        ),
    ],
)
def test_a_wrong_spread_of_a_craft_is_told_with_its_place(tmp_path, line, text):
    write(tmp_path / "mine", LOW, "")
    file = tmp_path / "mine/craft.toml"
    rest = file.read_text().partition("\n# What is not known for sure")[0]
    text_file = f"{line}\n{rest}\n" if line.startswith("disp") else f"{rest}\n{line}\n"
    file.write_text(text_file)
    (tmp_path / "mine/worst.toml").unlink()
    with pytest.raises(DesatError, match=text):
        prepare(read(str(tmp_path / "mine")), Options()).or_raise()


def test_a_scenario_has_its_own_spread_in_place_of_the_crafts(tmp_path):
    write(tmp_path / "mine", LOW, "")
    (tmp_path / "mine/known.toml").write_text(
        'extends = "nominal"\nwithout = ["dispersions.spacecraft.inertia"]\n'
        '[dispersions]\n"spacecraft.offset_plates_body" = { plus_minus = 0.001 }\n'
    )
    (tmp_path / "mine/alone.toml").write_text(
        'title = "alone"\nstop = 100.0\nstep = 1.0\n'
        '[dispersions]\n"spacecraft.offset_plates_body" = { plus_minus = 0.002 }\n'
    )
    for name, width, has_inertia in (("known", 0.001, False), ("alone", 0.002, True)):
        system, _ = resolved(str(tmp_path / f"mine/{name}.toml"), Options())
        spreads = dispersions_of(system)
        assert spreads["spacecraft.offset_plates_body"].plus_minus == width
        assert ("spacecraft.inertia" in spreads) == has_inertia
