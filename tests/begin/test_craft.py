"""`desat new craft`: a folder that stands alone and runs at once; what is not given is
marked; each wish that cannot be is refused with a line, and nothing is written."""

from __future__ import annotations

import json
import math
import re
import tomllib
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import desat as library
from desat.analyses.flight import (
    environment_block,
    flown_at,
    inputs_at,
    wanted_attitude,
)
from desat.analyses.motion import period_of
from desat.begin.body import CUBESATS
from desat.begin.craft import SCENARIOS, write
from desat.begin.facts import CraftFacts
from desat.begin.torques import given_torque
from desat.components.physics.earth import ASTRONOMICAL_UNIT
from desat.components.physics.orbit import EARTH_RADIUS
from desat.files.hardware import classes, quantity
from desat.fmus import registry
from desat.runs.new_craft import write_craft
from desat.runs.prepare import prepare
from desat.runs.run import execute
from desat.sizing.map import MapAxes, map_of
from desat.sizing.requirements import SizingRequirements
from desat.sizing.sizing import size
from desat.system.errors import DesatError
from desat.system.options import Options

TWELVE = CraftFacts(
    altitude="400km",
    inclination="51.6deg",
    size="12U",
    wheels="4 pyramid 30mNms",
    rods="0.2",
    residual_dipole="0.05",
)
AGILE = CraftFacts(
    sso="600km",
    ltan="10:30",
    mass="150kg",
    box="0.8,0.8,1.2",
    wheels="4 pyramid 4Nms",
    rods="30",
    thrusters="4 1N",
)
LARGE = CraftFacts(
    mass="2500kg",
    box="2.5,2.5,3",
    rods="none",
    wheels="4 pyramid 50Nms",
    thrusters="4 10N",
    dump="thrusters 70:10",
)
DEEP_SPACE = {"thrusters": "4 10mN", "dump": "thrusters 70:10"}
ISS = """1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991
2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482
"""


@pytest.fixture(scope="module")
def twelve(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("crafts") / "my12u"
    write(folder, TWELVE, "desat new craft my12u")
    return folder


def test_the_command_writes_what_runs_from_its_folder(desat, tmp_path: Path) -> None:
    result = desat(
        "new",
        "craft",
        "mine",
        "--size",
        "3U",
        "--sso",
        "550km",
        cwd=tmp_path,
        check=True,
    )
    assert (
        result.stdout.splitlines()[0]
        == "mine: craft.toml, nominal.toml, worst.toml, detumbling.toml, rollout.toml"
    )
    # of the first minute alone the start is too much: its requirement would not be met
    run = desat("run", "mine", "--stop", "600", cwd=tmp_path, check=True)
    assert "Pointing error, rms" in run.stdout
    again = desat("new", "craft", "mine", cwd=tmp_path)
    assert again.returncode == 2
    assert again.stderr == "error: mine: it exists; --force writes the craft into it\n"
    assert desat("new", "craft", "mine", "--force", cwd=tmp_path).returncode == 0


@pytest.mark.parametrize("scenario", SCENARIOS)
@pytest.mark.parametrize(
    "facts", [TWELVE, AGILE, CraftFacts()], ids=["12u", "agile", "class"]
)
def test_each_scenario_is_sound(
    tmp_path: Path, facts: CraftFacts, scenario: str
) -> None:
    folder = tmp_path / "mine"
    write(folder, facts, "desat new craft mine")
    case = prepare(str(folder / f"{scenario}.toml"), Options())
    system, _ = case.or_raise()
    text = "\n".join(case.warnings)
    assert "usual is" not in text
    assert "another craft" not in text
    assert system.name == ("mine" if scenario == "nominal" else f"mine-{scenario}")


GTO = CraftFacts(
    orbit="300x35786km",
    mass="838kg",
    box="1.16,1.54,1.21",
    rods="none",
    wheels="4 pyramid 4Nms",
    thrusters="4 1N",
    dump="thrusters 60:10",
)


@pytest.mark.parametrize(
    "facts",
    [
        GTO,
        replace(GTO, mass="300kg", dump="thrusters 80:20"),
        replace(GTO, sample="2s"),
        replace(LARGE, orbit="geo", sample="2.5s"),
        replace(AGILE, dump="thrusters 70:10", rods="none", sample="0.4s"),
    ],
    ids=["2 s", "lighter", "given 2 s", "given 2.5 s", "given 0.4 s"],
)
def test_thrusters_sample_at_whole_steps(tmp_path: Path, facts: CraftFacts) -> None:
    folder = tmp_path / "mine"
    write(folder, facts, "desat new craft mine")
    for scenario in ("nominal", "worst"):
        system, _ = prepare(str(folder / f"{scenario}.toml"), Options()).or_raise()
        sample = system.components["thrusters"].values["sample_time"]
        assert sample >= system.step
        assert sample / system.step == pytest.approx(
            round(sample / system.step), abs=1e-9
        )


HIGH = ("low", "moderate", "high").index("high")
WORSE = {
    "12u": (replace(TWELVE, residual_dipole=None), ("dipole", "air")),
    "given": (
        replace(
            TWELVE,
            secular="1uNm",
            torque="torque.csv",
            residual_dipole="0.05 +-50%",
        ),
        ("dipole", "constant", "rows"),
    ),
    "deep space": (
        CraftFacts(
            sun="1.52AU",
            mass="500kg",
            box="1,1,1.5",
            rods="none",
            wheels="4 pyramid 12Nms",
            thrusters="4 1N",
            dump="thrusters 70:10",
        ),
        ("light",),
    ),
}


@pytest.mark.parametrize("case", WORSE)
def test_the_worst_scenario_is_worse_in_all_that_it_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, case: str
) -> None:
    """What is assumed is at its end, given torques grow, and the start is 10 deg off."""
    monkeypatch.chdir(tmp_path)
    Path("torque.csv").write_text("0,1e-6,0,0\n60,0,2e-6,0\n", encoding="utf-8")
    facts, sources = WORSE[case]
    write(Path("mine"), facts, "")
    usual, worst = (
        {name: part.values for name, part in system.components.items()}
        for system, _ in (
            prepare(f"mine/{name}.toml", Options()).or_raise()
            for name in ("nominal", "worst")
        )
    )

    def ratio(component: str, parameter: str) -> float:
        return float(
            np.linalg.norm(worst[component][parameter])
            / np.linalg.norm(usual[component][parameter])
        )

    if "dipole" in sources:
        end = 5.0 if case == "12u" else 1.5
        assert ratio("spacecraft", "residual_dipole_body") == pytest.approx(
            end, rel=1e-5
        )
    if "air" in sources:
        assert usual["environment"]["solar_activity"] < HIGH
        assert worst["environment"]["solar_activity"] == HIGH
    if "light" in sources:
        assert ratio("spacecraft", "offset_plates_body") == pytest.approx(2.1, rel=1e-5)
    if "constant" in sources:
        assert ratio("spacecraft", "tau_disturbance_body") == pytest.approx(1.3)
    if "rows" in sources:
        assert ratio("disturbance", "factor") == pytest.approx(1.3)
    q, usual_attitude = (
        np.array(x["spacecraft"]["q_start_bi"]) for x in (worst, usual)
    )
    assert math.degrees(2.0 * math.acos(abs(q @ usual_attitude))) == pytest.approx(
        10.0, abs=0.01
    )
    assert not np.any(worst["wheels"]["h_start_wheel"])


@pytest.mark.parametrize(
    ("orbit", "air"),
    [
        ("gto", True),
        ("molniya", True),
        ("geo", False),
        ("999x20000km", True),
        ("1000x20000km", False),
    ],
)
def test_there_is_air_where_the_perigee_is_low(
    tmp_path: Path, orbit: str, air: bool
) -> None:
    """As its environment has it at perigee, where it starts."""
    write(tmp_path / "mine", replace(LARGE, orbit=orbit), "")
    run = library.run(str(tmp_path / "mine"), stop=20.0)
    assert (run.results.values("environment.density")[0] > 0.0) == air
    assert ("drag" in run.manifest.content.description) == air


def test_molniyas_perigee_is_the_farthest_south(tmp_path: Path) -> None:
    """Its apogee stands over the north for most of its day: the craft starts at
    perigee, 504 km above the equator's radius, at a latitude of -63.4349 deg."""
    write(tmp_path / "mine", replace(LARGE, orbit="molniya"), "")
    run = library.run(str(tmp_path / "mine"), stop=60.0)
    r = run.results.values("environment.r_eci")
    height = np.linalg.norm(r, axis=1)
    assert height[0] == pytest.approx(EARTH_RADIUS + 504e3, abs=1.0)
    assert (np.diff(height) > 0.0).all()
    assert math.degrees(math.asin(r[0, 2] / height[0])) == pytest.approx(
        -63.4349, abs=1e-3
    )


def test_the_torque_of_a_table_is_its_mean_over_time(tmp_path: Path) -> None:
    """Linear between rows that are not evenly apart: what goes to and fro leaves
    nothing."""
    row = {
        "rise": ("0,0,0,0\n10,2e-6,0,0\n40,2e-6,0,0\n", 70.0 / 40.0 * 1e-6),
        "turns": (
            "0,3e-6,0,4e-6\n30,3e-6,0,4e-6\n50,-3e-6,0,-4e-6\n70,3e-6,0,4e-6\n",
            5e-6 * 30.0 / 70.0,
        ),
        "back": ("5,0,1e-6,0\n15,0,-1e-6,0\n", 0.0),
        "single": ("0,3e-6,0,4e-6\n", 5e-6),
    }
    for name, (text, mean) in row.items():
        file = tmp_path / f"{name}.csv"
        file.write_text(text, encoding="utf-8")
        for steady, neighbour in ((None, 0.0), ("2uNm", 2e-6)):
            inputs = given_torque(CraftFacts(torque=f"{file} eci", secular=steady))
            assert inputs is not None
            # in eci and in body: the directions turn against each other
            assert inputs.size == pytest.approx(
                np.hypot(mean, neighbour), rel=1e-12, abs=1e-18
            ), name


def test_it_is_the_craft_that_was_asked_for(twelve: Path) -> None:
    run = library.run(str(twelve), stop=10.0)
    of = run.manifest.values_of
    assert of("environment")["semi_major_axis"] == pytest.approx(6778137.0)
    assert of("environment")["inclination"] == pytest.approx(math.radians(51.6))
    assert np.array(of("wheels")["inertia_wheel"]) * of("wheels")[
        "speed_limit"
    ] == pytest.approx([0.03] * 4)
    assert np.linalg.norm(of("spacecraft")["residual_dipole_body"]) == pytest.approx(
        0.05, rel=1e-5
    )
    assert of("torquers")["m_limit"] == 0.2
    assert of("manager")["m_limit"] == 0.2, "the manager's follows from the torquers'"
    assert of("controller")["gain_matrix"] == of("spacecraft")["inertia"]
    a, b, c = CUBESATS[12]
    assert of("spacecraft")["inertia"][0] == pytest.approx(
        18.0 / 12.0 * (b * b + c * c), rel=1e-5
    )
    assert of("spacecraft")["inertia"][8] == pytest.approx(
        18.0 / 12.0 * (a * a + b * b), rel=1e-5
    )


def test_a_night_and_a_day_hold(twelve: Path) -> None:
    """Two hours, past what starts it."""
    run = library.run(str(twelve), stop=7200.0)
    numbers = run.manifest.numbers
    assert run.manifest.unmet == []
    assert numbers["pointing"].value < 0.1
    assert numbers["largest_momentum"].value < 10.0


def test_it_is_detumbled(twelve: Path) -> None:
    run = library.run(str(twelve / "detumbling.toml"))
    assert run.manifest.stopped_when is not None
    assert 12.0 < run.manifest.numbers["detumbled"].value < 240.0
    assert np.abs(run.results.values("wheels.h_wheel")[-1]).max() < 1e-4


def test_every_number_says_where_it_is_from(twelve: Path) -> None:
    for line in (twelve / "craft.toml").read_text().splitlines():
        if re.match(r'\w+ = (".*\d|\[*[-\d]|\d)', line) and not line.startswith(
            ("title", "stop", "sample_time", "inertia", "axes_wheel")
        ):
            assert "#" in line or "inertia_wheel" in line, line


def test_numbers_have_units_and_are_converted(twelve: Path, tmp_path: Path) -> None:
    text = (twelve / "craft.toml").read_text()
    assert tomllib.loads(text)["parameters"]["wheels"]["speed_limit"] == "6500 rpm"
    run = library.run(str(twelve), {"environment.inclination": "97 deg"}, stop=5.0)
    assert run.manifest.values_of("environment")["inclination"] == pytest.approx(
        math.radians(97.0)
    )
    folder = tmp_path / "wrong"
    write(folder, TWELVE, "desat new craft wrong")
    (folder / "craft.toml").write_text(text.replace("6500 rpm", "6500 rmp"))
    with pytest.raises(
        DesatError,
        match=r"wrong/craft\.toml:\d+: parameters\.wheels\.speed_limit: "
        r"wheels\.speed_limit = '6500 rmp': unit rmp is not known; did you mean "
        r"rpm\?",
    ):
        prepare(str(folder), Options()).or_raise()
    (folder / "craft.toml").write_text(text.replace("6500 rpm", "6500 km"))
    with pytest.raises(
        DesatError,
        match=r"wheels\.speed_limit = '6500 km': km is no unit of wheels\.speed_limit, which is in rad/s",
    ):
        prepare(str(folder), Options()).or_raise()


def test_an_orbit_may_be_a_two_line_element_set(tmp_path: Path) -> None:
    (tmp_path / "iss.tle").write_text("ISS\n" + ISS)
    write(
        tmp_path / "mine",
        CraftFacts(tle=tmp_path / "iss.tle", epoch="2019-12-10T00:00:00Z"),
        "",
    )
    run = library.run(str(tmp_path / "mine"), stop=20.0)
    r = np.linalg.norm(run.results.values("environment.r_eci"), axis=1)
    assert ((r > 6.78e6) & (r < 6.81e6)).all()


def test_a_sun_synchronous_orbit_keeps_its_local_time(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(sso="500km", ltan="10:30", epoch="2027-03-21T00:00:00Z"),
        "",
    )
    rows = tomllib.loads((tmp_path / "mine" / "craft.toml").read_text())["parameters"][
        "environment"
    ]
    assert quantity("", rows["inclination"], "deg") == pytest.approx(97.4, abs=0.1)
    # the mean Sun is near the equinox then: 10:30 is 22.5 deg before it
    assert quantity("", rows["raan"], "deg") == pytest.approx(360.0 - 22.5, abs=2.5)


@pytest.mark.parametrize("pointing", ["nadir", "inertial"])
def test_what_wheels_must_hold_of_an_orbit_is_near_what_size_finds(
    tmp_path: Path, pointing: str
) -> None:
    """A craft that its dipole and gravity alone turn, in an untilted field."""
    wish = {
        "altitude": "500km",
        "inclination": "70deg",
        "inertia": "0.9,1.2,0.7",
        "pointing": pointing,
        "residual_dipole": "0.6",
    }
    write(tmp_path / "mine", CraftFacts(**wish, wheels="3 axes 1Nms"), "")  # type: ignore[arg-type]
    sets = [
        "environment.field=dipole",
        "environment.dipole_earth=[0,0,-7.75e15]",
        "spacecraft.aerodynamics=none",
        "spacecraft.radiation=none",
    ]
    sizing = size(
        str(tmp_path / "mine"),
        Options(stop=20000.0, sets=sets),
        SizingRequirements(year=False, laws=False, flown=False),
    )
    with pytest.raises(DesatError, match="in and out of the fullest") as refusal:
        write(tmp_path / "less", CraftFacts(**wish, wheels="3 axes 1mNms"), "")  # type: ignore[arg-type]
    answer = float(re.findall(r"turn ([\d.]+) mN m s", str(refusal.value))[0]) * 1e-3
    assert answer == pytest.approx(sizing.wheel_needed, rel=0.1)


def test_classes_grow_with_their_size() -> None:
    for kind, unit in (("wheels", "N.m.s"), ("rods", "A.m2"), ("thrusters", "N")):
        measure = {"wheels": "capacity", "rods": "dipole", "thrusters": "force"}[kind]
        sizes = [quantity("", x[measure], unit) for x in classes()[kind].values()]
        assert sizes == sorted(sizes)
        assert len(sizes) >= (3 if kind == "thrusters" else 6)


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        (
            {"altitude": "400 km", "sso": "500km"},
            r"--altitude, --sso: only one of them may define the orbit",
        ),
        ({"altitude": "90km"}, r"--altitude 90km: 150 to 300000 km are covered"),
        ({"altitude": "400 kg"}, r"--altitude 400 kg: kg does not fit km"),
        ({"altitude": "400kmm"}, r"--altitude 400kmm: unit kmm is not known"),
        ({"altitude": "high"}, r"--altitude high: a number is needed"),
        (
            {"inclination": "51deg"},
            r"--inclination 51deg: --altitude is needed with it",
        ),
        (
            {"altitude": "400km", "ltan": "10:30"},
            r"--ltan 10:30: only with a Sun-synchronous orbit",
        ),
        ({"sso": "500km", "ltan": "25:00"}, r"--ltan 25:00: a time of day is needed"),
        ({"size": "5U"}, r"--size 5U: there is 1U, 2U, .*; --box has any other"),
        (
            {"size": "6U", "box": "1,1,1"},
            r"--box 1,1,1: --size 6U gives the sides as well: use one of them",
        ),
        ({"box": "1,1"}, r"--box 1,1: three sides are needed"),
        ({"box": "1,1,-1"}, r"--box 1,1,-1: sides above 0 are needed"),
        ({"mass": "0kg"}, r"--mass 0kg: above 0 is needed"),
        ({"inertia": "1,1,3"}, r"--inertia 1,1,3: no body has these moments"),
        ({"wheels": "4 piramid 1Nms"}, r"no layout piramid; did you mean pyramid\?"),
        ({"wheels": "9 pyramid 1Nms"}, r"3 to 8 wheels are taken"),
        ({"wheels": "2 axes 1Nms"}, r"3 to 8 wheels are taken"),
        (
            {"bias": "29mNms", "wheels": "4 pyramid 30mNms"},
            r"at most 0.027 N m s are taken",
        ),
        (
            {"bias": "1mNms", "wheels": "3 axes 30mNms"},
            r"keep nothing against each other",
        ),
        ({"arm": "1m"}, r"--arm 1m: --thrusters says which"),
        ({"thrusters": "7 1N"}, r"layouts of 6, 8 and 12 nozzles are known"),
        ({"pointing": "nadir 10deg nose"}, r"roll, pitch or yaw is needed"),
        ({"pointing": "spin 1rpm w"}, r"x, y or z is needed"),
        (
            {"pointing": "spin 1rpm x", "inertia": "2,1,2.5", "mass": "20kg"},
            r"between 1 and 2.5: a spin about the intermediate axis is unstable",
        ),
        ({"pointing": "target 95N 11E"}, r"0 to 90 deg are covered"),
        ({"pointing": "target Munich"}, r"latitude and longitude are needed"),
        ({"orbit": "moon 1km"}, r"10 to 100000 km are covered"),
        ({"orbit": "moon 100km", "rods": "1"}, r"there is no field to speak of there"),
        ({"sun": "L3"}, r"or L1, L2"),
        ({"wheels": "big"}, r"--wheels big: the form is COUNT LAYOUT SIZE"),
        ({"wheels": "3 axes huge"}, r"--wheels huge: no class.*; there is 2mNms"),
        ({"rods": "-1"}, r"--rods -1: above 0 is needed"),
        (
            {"wheels": "3 axes 2mNms", "residual_dipole": "1"},
            r"--wheels: 2 mN m s a wheel; .*turn "
            r"\d+\.?\d* mN m s in and out of the fullest within each orbit.*: take at least",
        ),
        (
            {"pointing": "nadri"},
            r"--pointing nadri: no such pointing; did you mean nadir.; there is nadir, ",
        ),
        ({"epoch": "tomorrow"}, r"--epoch tomorrow: a time is needed"),
        ({"tle": Path("/nowhere.tle")}, r"--tle /nowhere\.tle: "),
    ],
)
def test_what_cannot_be_is_refused(
    tmp_path: Path, facts: dict[str, object], message: str
) -> None:
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(**facts), "")  # type: ignore[arg-type]
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    ("target", "more", "code", "message"),
    [
        ("mine", (), 0, ""),
        ("alone", ("--stop", "3"), 0, ""),
        ("min", (), 2, "no scenario min; did you mean mine?"),
        (
            "integrated",
            (),
            2,
            "scenarios (desat list integrated); one of them is needed",
        ),
        (
            "mine",
            ("--source", "manager=manager_cros"),
            2,
            "did you mean manager_cross_product?",
        ),
        (
            "mine",
            ("--set", "torquers.m_limit=0"),
            2,
            "m_limit = 0 A.m2: these rods make no dipole",
        ),
        ("mine", ("--set", "wheels.torque_limit=2"), 0, "usual is 1e-06 to 1 N.m"),
        ("mine", ("--set", "wheels.speed_limit=6000"), 0, "usual is 1 to 1100 rad/s"),
    ],
)
def test_what_is_mistyped_is_answered_with_what_was_meant(
    desat, tmp_path: Path, target: str, more: tuple[str, ...], code: int, message: str
) -> None:
    write(tmp_path / "mine", TWELVE, "")
    (tmp_path / "alone.toml").write_text('extends = "nadir_day/day-dipole"\n')
    arguments = more if "--stop" in more else ("--stop", "3", *more)
    result = desat("run", target, *arguments, cwd=tmp_path)
    assert result.returncode == code, result.stderr
    assert message in result.stderr


def test_blocks_are_told(desat) -> None:
    every = json.loads(desat("help", "blocks", "--json", check=True).stdout)["rows"]
    assert {r["block"] for r in every} == set(registry.names())
    manager = json.loads(
        desat("help", "blocks", "manager", "--json", check=True).stdout
    )
    assert "manager_b_dot: B-dot detumbling" in manager["text"]
    variables = {r["name"]: r for r in manager["rows"]}
    assert variables["b_body [3]"]["unit"] == "T"
    assert variables["b_body [3]"]["frame"] == "body"
    assert variables["b_body [3]"]["usually from"] == "magnetometer.b_body"
    one = json.loads(desat("help", "blocks", "wheels", "--json", check=True).stdout)
    rows = {r["name"]: r for r in one["rows"]}
    assert rows["torque_limit"]["unit"] == "N.m"
    assert rows["speed_limit"]["allowed"] == ">= 0.001"
    assert rows["command_mode"]["allowed"] == "torque, speed"
    assert "Reaction wheels" in one["text"]
    outcome = desat("help", "blocks", "manager_combined", check=True).stdout
    assert "thrusters that take its command" in outcome
    assert (
        "Law: ocdc (law = ilqr, split = ocdc, g_rate = craft.rate, weight_ratio = 1 /"
        in outcome
    )
    outcome = desat("help", "blocks", "manager_b_dot", check=True).stdout
    assert (
        "No law that holds the wheels' momentum: it brakes a tumbling craft" in outcome
    )
    wrong = desat("help", "blocks", "wheel")
    assert wrong.returncode == 2
    assert wrong.stderr == "error: wheel: no block and no role; did you mean wheels?\n"


def test_standard_numbers_and_plots_come_from_the_roles(desat, tmp_path):
    """Not from the craft's files, nor from another craft; what a file gives besides is
    merged."""
    desat("new", "craft", "mine", "--thrusters", "4 1N", cwd=tmp_path, check=True)
    own_value = (tmp_path / "mine" / "nominal.toml").read_text()
    assert "[numbers" not in own_value
    assert "[plots" not in own_value
    outcome = desat(
        "show",
        str(tmp_path / "mine" / "worst.toml"),
        "--json",
        cwd=tmp_path,
        check=True,
    )
    by_key = {row["key"]: row for row in json.loads(outcome.stdout)}
    assert by_key["numbers.pointing.measure"]["from"].endswith("roles/manager.toml")
    assert by_key["numbers.propellant.unit"]["from"].endswith("roles/thrusters.toml")
    result = desat(
        "run",
        "mine",
        "--stop",
        "20",
        "--json",
        "--no-baseline",
        cwd=tmp_path,
        check=True,
    )
    numbers = json.loads(result.stdout)["numbers"]
    assert {
        "pointing",
        "largest_momentum",
        "final_momentum",
        "firing",
        "propellant",
    } <= (numbers.keys())
    file = tmp_path / "mine" / "nominal.toml"
    file.write_text(own_value.replace('"roles/manager", ', '"roles/manger", '))
    wrong = desat("check", "mine", cwd=tmp_path)
    assert (
        "extends: no roles/manger; did you mean manager?" in wrong.stdout + wrong.stderr
    )


def test_what_is_made_of_a_crafts_scenario_has_its_name(desat, tmp_path):
    """Two crafts' bad days wrote runs/worst and runs/worst-2."""
    desat("new", "craft", "mine", cwd=tmp_path, check=True)
    result = desat("run", "mine/worst.toml", "--stop", "20", cwd=tmp_path)
    assert "runs/mine-worst/report.html" in result.stdout
    result = desat("run", "mine", "--stop", "20", cwd=tmp_path)
    assert "runs/mine/report.html" in result.stdout
    command = desat("show", "mine", cwd=tmp_path, check=True)
    assert "parameters.manager.gain" in command.stdout


def test_wheels_and_coils_detumble_sooner_than_coils_alone(tmp_path: Path) -> None:
    """And the law doubts what a craft of its class is not known to."""
    folder = tmp_path / "mine"
    write(folder, TWELVE, "desat new craft mine")
    runs = {
        name: execute(str(folder / f"{name}.toml"), Options(), tmp_path / name)
        for name in ("detumbling", "rollout")
    }
    alone = runs["detumbling"].manifest.numbers["detumbled"].value * 60.0
    together = runs["rollout"].manifest.numbers["detumbled"].value
    assert together < 0.5 * alone
    values = runs["rollout"].manifest.values_of("manager")
    spreads = classes()["spreads"]["nano"]
    for name in ("inertia", "coil", "coupling"):
        assert values[f"{name}_spread"] == float(spreads[name])
    wheels = runs["rollout"].manifest.values_of("wheels")
    capacity = wheels["inertia_wheel"][0] * wheels["speed_limit"]
    assert values["h_limit"] == pytest.approx(0.8 * capacity)
    momenta = runs["rollout"].results.values("wheels.h_wheel")
    assert np.abs(momenta).max() < 0.95 * capacity


def test_a_craft_without_rods_has_no_detumbling(tmp_path: Path) -> None:
    files = write(tmp_path / "mine", GTO, "desat new craft mine").files
    assert {x.name for x in files} == {"craft.toml", "nominal.toml", "worst.toml"}


@pytest.mark.parametrize(
    ("numbers", "texts"),
    [
        ({"size": "12U", "rods": 0.2}, {"size": "12U", "rods": "0.2"}),
        (
            {"altitude": 450e3, "inclination": np.float64(0.9)},
            {"altitude": "450km", "inclination": "0.9rad"},
        ),
        (
            {"mass": 20, "box": [0.3, 0.3, 0.4], "sample": 0.2},
            {"mass": "20kg", "box": "0.3,0.3,0.4", "sample": "0.2s"},
        ),
        (
            {"inertia": np.array([0.2, 0.2, 0.1]), "residual_dipole": 0.05},
            {"inertia": "0.2,0.2,0.1", "residual_dipole": "0.05"},
        ),
        ({"secular": 8e-5}, {"secular": "8e-5Nm"}),
        ({"epoch": datetime(2027, 3, 1)}, {"epoch": "2027-03-01T00:00:00"}),
        (
            {"sun": 1.5 * ASTRONOMICAL_UNIT, "rods": None, **DEEP_SPACE},
            {"sun": "1.5AU", **DEEP_SPACE},
        ),
    ],
)
def test_a_program_gives_numbers_in_si(tmp_path, numbers, texts):
    files = []
    for folder, facts in (("a", numbers), ("b", texts)):
        text = (
            library.new(tmp_path / folder / "c", **facts) / "craft.toml"
        ).read_text()
        files.append(re.sub("made by .*", "", text))
    assert files[0] == files[1]


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"rods": True}, "rods=True: a number in A.m2, or a text as of"),
        ({"size": 12}, "size=12: a text as of `desat new craft --size` is needed"),
        ({"mass": [1.0, 2.0]}, "mass=[1.0, 2.0]: a number in kg, or a text"),
        ({"box": ["a", 1, 2]}, "box=['a', 1, 2]: numbers in m, or a text"),
        ({"mass": math.nan}, "mass nan kg: a number is needed"),
        ({"altitude": 450}, "altitude 450.0 m: 150 to 300000 km are covered"),
        ({"rod": 0.2}, "rod: no fact of a craft; did you mean rods?"),
    ],
)
def test_a_value_without_a_meaning_is_refused_in_a_line(tmp_path, facts, message):
    with pytest.raises(DesatError) as refusal:
        library.new(tmp_path / "c", **facts)
    assert message in str(refusal.value)
    assert "\n" not in str(refusal.value)
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    "facts",
    [
        {"size": "12U", "altitude": "400km", "inclination": "51.6deg", "rods": "0.2"},
        {"size": "6U", "sso": "520km", "rods": "0.1"},
        {"mass": "50kg", "altitude": "600km", "inclination": "30deg", "rods": "5"},
        {"size": "12U", "altitude": "450km", "pointing": "inertial", "rods": "0.3"},
    ],
)
def test_an_assumed_dipole_has_the_worse_sign(tmp_path, facts):
    """Its secular torque adds to that of the others: against its sign there is less."""
    write_craft(tmp_path / "c", CraftFacts(**facts), "")
    system, _ = prepare(str(tmp_path / "c"), Options()).or_raise()
    dipole = system.components["spacecraft"].values["residual_dipole_body"]
    sizes = {}
    for sign in (1.0, -1.0, 0.0):
        values = {"spacecraft.residual_dipole_body": [sign * x for x in dipole]}
        craft_system, _ = prepare(
            str(tmp_path / "c"), Options(values=values)
        ).or_raise()
        block = environment_block(craft_system.components["environment"])
        first = inputs_at(block, [0.0])
        period = period_of(first["r_eci"][0], first["v_eci"][0])
        times = np.linspace(0.0, round(86400.0 / period) * period, 1441)
        block = environment_block(craft_system.components["environment"])
        inputs = inputs_at(block, times.tolist())
        flight = flown_at(craft_system, wanted_attitude(craft_system), inputs, times)
        sizes[sign] = np.linalg.norm(flight.disturbance[-1] - flight.disturbance[0])
    assert sizes[1.0] >= 0.98 * max(sizes.values())


def test_the_least_rod_of_a_map_grows_with_the_dipole(tmp_path):
    facts = CraftFacts(size="12U", altitude="400km", inclination="51.6deg", rods="0.2")
    write(tmp_path / "c", facts, "")
    for sign in (1.0, -1.0):
        text = (tmp_path / "c" / "craft.toml").read_text()
        axes = MapAxes(
            rods=(0.1,),
            inclinations=(20.0, 51.6),
            altitudes=(350e3,),
            dipoles=(0.0, 0.045, 0.09, 0.18),
        )
        size_map = map_of(
            str(tmp_path / "c"), Options(), axes, SizingRequirements(), jobs=1
        )
        assert (np.diff(size_map.least[:, 0], axis=1) >= 0.0).all(), sign
        assert (np.diff(size_map.rms[0, :, 0, :, 0], axis=1) >= 0.0).all(), sign
        opposite_text = re.sub(
            r"(residual_dipole_body = )\[(.*?)\]",
            lambda m: f"{m[1]}[{', '.join(str(-float(x)) for x in m[2].split(','))}]",
            text,
        )
        (tmp_path / "c" / "craft.toml").write_text(opposite_text)


def test_a_quaternion_of_any_length_is_a_direction(tmp_path):
    write(tmp_path / "c", CraftFacts(size="12U", altitude="400km", rods="0.2"), "")
    plain, twice = (
        prepare(str(tmp_path / "c"), Options(sets=[f"guidance.q_bo=0,0,0,{w}"]))
        for w in (1, 2)
    )
    assert twice.warnings == plain.warnings
