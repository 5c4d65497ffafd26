"""Crafts beyond nadir, circular and low: flown as they are wanted, sized to their loop; what
cannot be is refused by name.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.runs.prepare import prepare
from desat.sizing import dumps
from desat.sizing.requirements import SizingRequirements
from desat.sizing.sizing import size as size_of
from desat.system.errors import DesatError
from desat.system.options import Options

# --- crafts of one line ---------------------------------------------------------------

CRAFTS = {
    "sun": CraftFacts(sso="550km", size="6U", pointing="sun"),
    "yaw": CraftFacts(
        orbit="geo",
        mass="2500kg",
        box="2,2,3",
        wheels="4 pyramid 50Nms",
        rods="none",
        thrusters="4 10N",
        dump="thrusters 70:10",
        pointing="yaw",
    ),
    "deep": CraftFacts(
        sun="1.52AU",
        size="12U",
        pointing="sun",
        wheels="3 axes 15mNms",
        thrusters="4 10mN",
        dump="thrusters 70:25",
        propellant="0.5kg",
        isp="60s",
    ),
    "gto": CraftFacts(
        orbit="gto",
        mass="600kg",
        box="1.2,1.2,1.6",
        wheels="4 pyramid 15Nms",
        rods="none",
        thrusters="4 1N",
        dump="thrusters 70:10",
    ),
    "molniya": CraftFacts(orbit="molniya", size="12U"),
    "secular": CraftFacts(altitude="600km", size="12U", secular="0.5uNm"),
}


@pytest.mark.parametrize("name", CRAFTS)
def test_a_craft_of_one_line_flies_as_it_is_wanted(tmp_path: Path, name: str) -> None:
    write(tmp_path / "mine", CRAFTS[name], "")
    for scenario in ("nominal", "worst"):
        case = prepare(str(tmp_path / "mine" / f"{scenario}.toml"), Options())
        case.or_raise()
        assert "usual is" not in "\n".join(case.warnings)
    run = library.run(str(tmp_path / "mine"), stop=4000.0)
    assert run.ok
    assert run.manifest.numbers["pointing"].value < 0.2


@pytest.mark.study
def test_a_sun_pointing_craft_is_sized_to_a_percent_of_its_loop(tmp_path: Path) -> None:
    write(tmp_path / "mine", CRAFTS["sun"], "")
    sizing = size_of(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False, laws=False)
    )
    assert sizing.attitude == "sun"
    flight = [r for r in sizing.curve if r.loop_rms is not None]
    assert flight
    for row in flight:
        assert row.rms == pytest.approx(row.loop_rms, rel=0.01)
        assert row.duty == pytest.approx(row.loop_duty, rel=0.01)


@pytest.mark.slow
def test_deep_space_is_sized_to_some_percent_of_its_loop(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(
            sun="0.9AU",
            size="12U",
            pointing="sun",
            wheels="3 axes 10mNms",
            thrusters="4 10mN",
            dump="thrusters 70:25",
            panel="0.6m2 0.2m",
        ),
        "",
    )
    sizing = dumps.size(str(tmp_path / "mine"), Options(), SizingRequirements())
    assert not sizing.problems
    assert sizing.loop["dumps"] >= 7
    assert sizing.steady.a_week == pytest.approx(sizing.loop["dumps_a_week"], rel=0.05)
    assert sizing.steady.a_year == pytest.approx(
        sizing.loop["propellant_a_year"], rel=0.05
    )


@pytest.mark.slow
def test_a_secular_torque_is_what_size_finds(tmp_path: Path) -> None:
    write(tmp_path / "mine", CRAFTS["secular"], "")
    sizing = size_of(
        str(tmp_path / "mine"),
        Options(),
        SizingRequirements(year=False, laws=False, flown=False),
    )
    inputs = next(s for s in sizing.sources if s.name == "given torque")
    # about the orbit's normal, which J2 turns by 7 deg a day
    assert inputs.secular == pytest.approx(0.5e-6, rel=0.01)
    assert inputs.along == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        (
            {"sun": "1AU", "rods": "0.2"},
            r"--rods 0.2: there is no field to speak of there; thrusters",
        ),
        (
            {"sun": "1AU", "pointing": "yaw"},
            r"--pointing yaw: there is no Earth about the Sun",
        ),
        (
            {"sun": "1AU", "pointing": "sun"},
            r"no rods: --dump says what takes momentum out",
        ),
        ({"sun": "far"}, r"--sun far: a distance in astronomical units is needed"),
        (
            {"sun": "1AU", "orbit": "geo"},
            r"--orbit, --sun: only one of them may define the orbit",
        ),
        (
            {"sun": "1AU", "inclination": "5deg"},
            r"--inclination 5deg: --sun 1AU says the orbit",
        ),
        ({"orbit": "50x2000km"}, r"--orbit 50 km: 150 to 400000 km are covered"),
        (
            {"orbit": "gro"},
            r"--orbit gro: no such orbit; did you mean ge?t?o.; there is geo, gto",
        ),
        ({"secular": "1uNm", "torque": "x.csv"}, r"--torque x\.csv: no such file"),
        ({"secular": "80"}, r"--secular 80: a unit is needed, as 80Nm"),
        ({"secular": "1uNm,2uNm"}, r"one torque, about y, or three are needed"),
        ({"secular": "0uNm"}, r"a torque other than 0 is needed"),
        ({"torque": "/nowhere.csv"}, r"--torque /nowhere\.csv: "),
        ({"propellant": "1kg"}, r"--propellant 1kg: --thrusters says which"),
        (
            {"rods": "coil 300 80mm 0.2mm 100mA"},
            r"the form is 'coil TURNS 80x80mm WIRE CURRENT'",
        ),
        (
            {"rods": "rod 300 10x8mm 0.2mm 100mA"},
            r"at least four times as long as it is thick",
        ),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, facts: dict[str, Any], message: str
) -> None:
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(**facts), "")
    assert not (tmp_path / "mine").exists()


def test_a_gain_that_takes_out_more_than_there_is_is_told(tmp_path: Path) -> None:
    write(tmp_path / "mine", CraftFacts(size="12U"), "")
    fast = prepare(str(tmp_path / "mine"), Options(sets=["manager.gain=10"]))
    assert "takes 100 times the momentum out within a sample of 10 s" in "\n".join(
        fast.warnings
    )
    usual = prepare(str(tmp_path / "mine"), Options())
    assert "takes" not in "\n".join(usual.warnings)
