"""Beyond nadir, circular, low: the blocks of it against analytic cases, and the crafts
of one line that take them; what cannot be is refused by name."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.begin.torques import given_torque
from desat.begin.torques import read as read_torques
from desat.components.contract.block import BlockError
from desat.components.maths.attitude import normalised, rotate
from desat.components.physics import coil, torques
from desat.runs.prepare import prepare
from desat.sizing import dumps
from desat.sizing.requirements import SizingRequirements
from desat.sizing.sizing import size as size_of
from desat.system.errors import DesatError
from desat.system.options import Options
from desat.system.parameters import expand
from tests.conftest import started


def table(*rows: tuple[float, ...]) -> tuple[float, ...]:
    flat = [x for row in rows for x in row]
    return tuple(flat + [0.0] * (1024 - len(flat)))


# --- torques by a table ---------------------------------------------------------------


@pytest.mark.parametrize("between", [0, 1])
def test_a_tables_impulse_is_exact_whatever_the_steps(between: int) -> None:
    rows = [(0.0, 0.0, 1.0, 0.0), (10.0, 1.0, 1.0, 0.0), (25.0, -1.0, 0.0, 0.0)]
    source = started(
        "disturbance_table", torque=table(*rows), between=between, repeated=True
    )
    # hold: 10 s of (0, 1, 0), 15 s of (1, 1, 0); linear: means of both ends
    full = np.array([15.0, 25.0, 0.0] if between == 0 else [5.0, 17.5, 0.0])
    for dt in (0.7, 1.0, 5.0, 12.5):
        total, steps = np.zeros(3), 0
        while (steps + 1) * dt <= 75.0 + 1e-9:
            source.advance(steps * dt, dt)
            total += dt * np.array(source.tau_ext_body)
            steps += 1
        rest = 75.0 - steps * dt
        if rest > 1e-9:
            source.advance(steps * dt, rest)
            total += rest * np.array(source.tau_ext_body)
        assert total == pytest.approx(3.0 * full, rel=1e-12, abs=1e-12)


def test_a_tables_frames_and_what_it_is_added_to() -> None:
    q = normalised((0.1, 0.2, 0.3, 0.9))
    rows = table((0.0, 0.1, 0.2, 0.3))
    source = started("disturbance_table", torque=rows, frame=2, factor=2.0)
    source.q_bi, source.tau_other_body = q, (0.0, 0.0, 1.0)
    source.advance(0.0, 10.0)
    x, y, z = rotate(q, (0.2, 0.4, 0.6))
    assert source.tau_ext_body == pytest.approx((x, y, z + 1.0))


def test_a_table_that_ends_before_the_run_is_refused() -> None:
    source = started("disturbance_table", torque=table((0.0, 1, 0, 0), (10.0, 1, 0, 0)))
    with pytest.raises(
        BlockError, match="the table is from 0 to 10 s, the run from 0 to 20 s"
    ):
        list(source.foresee(0.0, 20.0, frozenset()))
    assert not list(source.foresee(0.0, 10.0, frozenset()))


def test_the_first_rows_of_a_table_may_stand_alone_but_not_those_of_a_matrix() -> None:
    from desat.system.interface import interface_of_block

    interface = interface_of_block("disturbance_table")
    found = expand(
        interface, "torque", [[0.0, 1.0, 2.0, 3.0], [5.0, 0.0, 0.0, 0.0]], "x"
    )
    assert [found[f"torque[1,{k}]"] for k in (1, 2, 3, 4)] == [0.0, 1.0, 2.0, 3.0]
    assert found["torque[256,4]"] == 0.0
    with pytest.raises(DesatError, match="has rows of 4 values, got rows of 3"):
        expand(interface, "torque", [[0.0, 1.0, 2.0]], "x")
    wheels = interface_of_block("wheels")
    with pytest.raises(DesatError, match="axes_wheel needs 12 values, got 4"):
        expand(wheels, "axes_wheel", [[1.0, 0.0, 0.0, 0.0]], "x")


# --- magnets, rods, panels ------------------------------------------------------------


def test_a_saturating_cycle_loses_four_times_coercive_field_and_saturation() -> None:
    """The area between the branches, each the other moved by 2 H_c: 4 H_c B_s."""
    rods = started(
        "torquers_passive",
        rod_volume=(1e-6, 0.0, 0.0),
        coercive_field=12.0,
        remanence=0.004,
        saturation=0.025,
    )
    mu_0 = 4e-7 * math.pi
    h = 40_000.0 * np.sin(np.linspace(0.0, 4.0 * math.pi, 400_001))
    flux = []
    for k, x in enumerate(h[::50]):
        rods.b_eci = (mu_0 * x, 0.0, 0.0)
        rods.advance(float(k), 1.0)
        rods.output(float(k))
        flux.append(rods.flux_body[0])
    second = slice(len(flux) // 2, None)
    area = abs(np.trapezoid(np.array(flux)[second], h[::50][second]))
    assert area == pytest.approx(4.0 * 12.0 * 0.025, rel=0.02)
    assert max(flux) < 0.025
    assert rods.m_body[0] == pytest.approx(flux[-1] * 1e-6 / mu_0)


def test_rods_brake_a_tumble_and_a_magnet_alone_does_not(tmp_path: Path) -> None:
    craft = """
title = "passive"
[components]
environment = "environment_kepler"
spacecraft = "spacecraft_rigid"
torquers = "torquers_passive"
[wiring]
"spacecraft.sun_eci" = false
"spacecraft.sunlight" = false
"spacecraft.density" = false
[parameters.environment]
semi_major_axis = "6978.137 km"
inclination = "55 deg"
[parameters.spacecraft]
inertia = [0.0222, 0, 0, 0, 0.0218, 0, 0, 0, 0.005]
inertia_wheel = [0, 0, 0, 0]
omega_start_body = ["10 deg/s", "5 deg/s", "5 deg/s"]
[parameters.torquers]
magnet_body = [0, 0, 0.55]
rod_volume = [2.24e-7, 2.24e-7, 0]
"""
    (tmp_path / "craft.toml").write_text(craft)
    (tmp_path / "nominal.toml").write_text(
        'craft = "craft.toml"\ntitle = "passive"\nstep = 1.0\nstop = 40000.0\n'
        "epoch = 2010-06-01T00:00:00Z\n"
    )
    energy = {}
    for volume in (2.24e-7, 0.0):
        run = library.run(str(tmp_path), {"torquers.rod_volume": [volume, volume, 0.0]})
        omega = run.results.values("spacecraft.omega_bi_body")
        each = 0.5 * (omega**2 @ [0.0222, 0.0218, 0.005])
        energy[volume] = each[-4000:].mean() / each[:4000].mean()
    assert energy[2.24e-7] < 0.95
    assert energy[0.0] == pytest.approx(1.0, abs=0.02)


def test_a_benchs_field_turns_at_its_rate() -> None:
    bench = started(
        "environment_bench", field=(3e-5, 0.0, 1e-5), field_rate=(0.0, 0.0, 0.1)
    )
    bench.output(math.pi / 0.2)
    assert bench.b_eci == pytest.approx((0.0, 3e-5, 1e-5), abs=1e-18)
    assert bench.b_rate_eci == pytest.approx((-3e-6, 0.0, 0.0), abs=1e-18)
    assert bench.b_accel_eci == pytest.approx((0.0, -3e-7, 0.0), abs=1e-18)


def test_a_run_says_that_its_tank_is_empty(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(
            altitude="600km",
            size="12U",
            wheels="3 axes 10mNms",
            rods="none",
            thrusters="4 50mN",
            dump="thrusters 70:10",
            secular="20uNm",
            propellant="0.0001kg",
        ),
        "",
    )
    run = library.run(str(tmp_path / "mine"), stop=3000.0)
    assert [
        w for w in run.manifest.warnings if "its tank of 0.0001 kg is empty from" in w
    ]


def test_a_driven_panel_faces_the_sun_as_a_flat_area_does() -> None:
    sun = normalised((0.3, 0.5, -0.8, 0.0))[:3]
    rows = (1.0, 0.0, 0.0, 2.0, 0.0, -1.5, 0.0, 0.0, 0.0) + (0.0,) * 9 * 15
    drives = (0.0, 3.0, 0.0) + (0.0,) * 45
    plates = torques.plates_of(rows)
    turned = torques.facing(plates, torques.drives_of(rows, drives), sun)
    across = math.sqrt(sun[0] ** 2 + sun[2] ** 2)
    # a black plate whose normal is as near to the Sun as its drive lets it: cos is |s
    # across|
    expected = torques.radiation(sun, 1.0, 2.0 * across, (0.0, -1.5, 0.0))
    assert torques.radiation_on_plates(sun, 1.0, turned) == pytest.approx(expected)
    fixed = torques.facing(plates, torques.drives_of(rows, (0.0,) * 48), sun)
    assert fixed == plates


def test_driven_panels_balance_in_a_run(tmp_path: Path) -> None:
    """The torque that is computed outside the body, from its parameters, is its own."""
    write(
        tmp_path / "mine",
        CraftFacts(
            orbit="geo",
            size="12U",
            rods="none",
            thrusters="4 50mN",
            dump="thrusters 70:10",
            pointing="yaw",
        ),
        "",
    )
    rows = [[1, 0, 0, 0.5, 0, -0.4, 0, 0.1, 0.1], [1, 0, 0, 0.3, 0, 0.4, 0, 0.0, 0.2]]
    run = library.run(
        str(tmp_path / "mine"),
        {
            "spacecraft.radiation": "plates",
            "spacecraft.plates": rows,
            "spacecraft.drive_plate": [[0, 1, 0], [0, 1, 0]],
        },
        stop=20000.0,
    )
    residual = run.manifest.numbers["impulse_mismatch"].value
    largest = np.abs(run.results.values("spacecraft.impulse_eci")).max()
    assert residual < 1e-6 * largest


def test_a_coil_by_its_making() -> None:
    """300 turns of 80 x 80 mm at 100 mA: 0.192 A m2; a core of infinite permeability
    multiplies by 1 + 1 / N_d."""
    result = coil.air(300, 0.08, 0.08, 0.2e-3, 0.1)
    assert result.dipole == pytest.approx(0.192)
    length = 300 * 4 * 0.08
    section = math.pi * 1e-4**2
    assert result.resistance == pytest.approx(1.72e-8 * length / section)
    assert result.power == pytest.approx(0.01 * result.resistance)
    assert result.mass == pytest.approx(8960.0 * length * section)
    slender = 20.0
    demagnetising = 4 * (math.log(slender) - 1) / (slender**2 - 4 * math.log(slender))
    assert coil.core_factor(0.1, 0.005, 1e12) == pytest.approx(
        1.0 + 1.0 / demagnetising, rel=1e-6
    )


def test_rods_by_their_dipole_have_the_turns_that_it_takes(tmp_path: Path) -> None:
    write(
        tmp_path / "mine",
        CraftFacts(size="3U", rods="rod 0.2Am2 60x8mm 0.2mm 100mA"),
        "",
    )
    rows = tomllib.loads((tmp_path / "mine" / "craft.toml").read_text())["parameters"][
        "torquers"
    ]
    assert float(rows["m_limit"].split()[0]) == pytest.approx(0.2, rel=0.01)
    assert rows["area_turns"] == pytest.approx(2.0, rel=0.01)


def test_a_rod_is_as_thick_as_it_says(tmp_path: Path) -> None:
    """60x8mm is a length of 60 mm and a diameter of 8 mm: dipole, power and mass by
    hand."""
    length, radius, wire = 0.06, 0.004, 0.2e-3
    write(
        tmp_path / "mine", CraftFacts(size="3U", rods="rod 800 60x8mm 0.2mm 100mA"), ""
    )
    text = (tmp_path / "mine" / "craft.toml").read_text()
    rows = tomllib.loads(text)["parameters"]["torquers"]
    slender = length / radius
    demagnetising = 4 * (math.log(slender) - 1) / (slender**2 - 4 * math.log(slender))
    core = 1 + 19_999 / (1 + 19_999 * demagnetising)
    area = 800 * math.pi * radius**2 * core
    assert rows["area_turns"] == pytest.approx(area, rel=1e-3)
    assert float(rows["m_limit"].split()[0]) == pytest.approx(0.1 * area, rel=1e-3)
    section, wound = math.pi * wire**2 / 4, 800 * 2 * math.pi * radius
    resistance = 1.72e-8 * wound / section
    mass = 8960 * wound * section + 8200 * math.pi * radius**2 * length
    assert rows["resistance"] == pytest.approx(resistance, rel=1e-3)
    assert f"{0.01 * resistance:.3g} W, {1e3 * mass:.3g} g each" in text


# --- thrusters ------------------------------------------------------------------------


def test_an_empty_tank_fires_nothing() -> None:
    jets = started(
        "thrusters",
        sample_time=1.0,
        tau_level=(1.0, 1.0, 1.0),
        arm=1.0,
        least_pulse=0.01,
        specific_impulse=100.0,
        tank=3e-3,
    )
    jets.tau_cmd_thruster_body = (1.0, 0.0, 0.0)
    for k in range(20):
        jets.advance(float(k), 1.0)
    jets.output(20.0)
    # 1 N takes 1 / (100 s g0) = 1.0197 g a second: 2.94 s, and nothing after
    assert jets.propellant == 3e-3
    assert jets.propellant_left == 0.0
    assert jets.on_time == pytest.approx(3e-3 * 100.0 * 9.80665, rel=1e-12)


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
        assert "usual is" not in "\n".join(case.checked.warnings)
    run = library.run(str(tmp_path / "mine"), stop=4000.0)
    assert run.ok
    assert run.manifest.numbers["pointing"].value < 0.2


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


def test_a_csv_of_torques_flies(tmp_path: Path) -> None:
    (tmp_path / "tau.csv").write_text(
        "t,x,y,z\n0,1e-6,0,0\n3000,-1e-6,0,2e-7\n6000,1e-6,0,0\n"
    )
    facts = CraftFacts(
        altitude="600km", size="12U", torque=f"{tmp_path / 'tau.csv'} lvlh"
    )
    write(tmp_path / "mine", facts, "")
    rows = tomllib.loads((tmp_path / "mine" / "craft.toml").read_text())["parameters"]
    assert rows["disturbance"]["frame"] == "lvlh"
    assert rows["disturbance"]["torque"][1] == [3000.0, -1e-6, 0.0, 2e-7]
    run = library.run(str(tmp_path / "mine"), stop=6000.0)
    impulse = run.results.values("disturbance.tau_ext_body")
    assert np.linalg.norm(impulse[0]) == pytest.approx(1e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("expected", "message"),
    [
        (
            {"sun": "1AU", "rods": "0.2"},
            r"--rods 0.2: there is no field in deep space; thrusters",
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
    tmp_path: Path, expected: dict[str, Any], message: str
) -> None:
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(**expected), "")
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,y,z\n", "there is no row of 4 numbers"),
        ("0,1,2\n0,1,2,3\n1,2,3\n", r":1: 4 numbers are needed, t in s"),
        ("t,x,y,z\n0,1,2,3\n1,2,3\n", r":3: 4 numbers are needed, t in s"),
        ("inf,x,y,z\n0,1,2,3\n", r":1: 4 numbers are needed.*got inf,x,y,z"),
        ("0,1,2,3\n0,1,2,3\n", r": its time 0 s is not after that of the row before"),
        ("0,1,2,nan\n1,1,1,1\n2,x,1,1\n", r":1: 4 numbers are needed"),
        ("t,x,y\n0,1,2\n", r":1: no column z; the columns are t \[s\], x \[N\.m\], y"),
        ("t,x,y,y\n0,1,2,3\n", r":1: column y: twice; the columns are"),
        ("t,x,y,z,w\n0,1,2,3,4\n", r":1: column w: no such column; the columns are"),
        ("t [m],x,y,z\n0,1,2,3\n", r":1: t \[m\]: unit m does not fit s"),
        (
            "t,x [furlong],y,z\n0,1,2,3\n",
            r":1: x \[furlong\]: unit furlong is not known",
        ),
        (
            "\n".join(f"{k},0,0,0" for k in range(300)),
            "300 rows; 256 are taken at most",
        ),
    ],
)
def test_a_csv_that_is_wrong_is_refused_by_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "tau.csv").write_text(text)
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(torque=str(tmp_path / "tau.csv")), "")


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("t,z,y,x", "10,3,2,1"),
        ("x,y,z,t", "1,2,3,10"),
        ("t [ms],x [N m],y [N m],z [N m]", "10000,1,2,3"),
        ("time (s);x [mN m];y [mN.m];z [uNm]", "10;1000;2000;3000000"),
        ('"t [min]","tau_z [N m]","tau_x [N m]","tau_y [N m]"', f"{1 / 6!r},3,1,2"),
    ],
)
def test_a_heading_names_columns_and_units(
    tmp_path: Path, heading: str, row: str
) -> None:
    file = tmp_path / "tau.csv"
    file.write_text(f"# a comment\n{heading}\n{row}\n")
    (found,) = read_torques(file)
    assert found == pytest.approx((10.0, 1.0, 2.0, 3.0), rel=1e-12)


def test_torques_of_several_files_add_up(tmp_path: Path) -> None:
    for name, text in {
        "a": "0,1e-6,0,0\n100,3e-6,0,0\n",
        "b": "0,0,1e-6,0\n50,0,2e-6,0\n100,0,1e-6,0\n",
        "c": "0,0,0,4e-6\n",
        "d": "0,1,0,0\n70,1,0,0\n",
    }.items():
        (tmp_path / f"{name}.csv").write_text(text)
    a, b, c, d = (f"{tmp_path / name}.csv lvlh" for name in "abcd")
    total = given_torque(CraftFacts(torque=(a, b, c)))
    assert total is not None
    assert np.array(total.rows) == pytest.approx(
        np.array(
            [[0, 1e-6, 1e-6, 4e-6], [50, 2e-6, 2e-6, 4e-6], [100, 3e-6, 1e-6, 4e-6]]
        )
    )
    with pytest.raises(DesatError, match=r"from 0 to 70 s, and --torque .*to 100 s"):
        given_torque(CraftFacts(torque=(a, d)))
    with pytest.raises(DesatError, match=r"it is in body, and --torque .* in lvlh"):
        given_torque(CraftFacts(torque=(a, f"{tmp_path / 'b'}.csv")))


def test_the_mean_torque_is_that_of_the_sum(tmp_path: Path) -> None:
    file = tmp_path / "tau.csv"
    file.write_text("0,9e-5,0,0\n")
    found = given_torque(CraftFacts(torque=str(file), secular="0uNm,90uNm,0uNm"))
    assert found is not None
    assert found.size == pytest.approx(9e-5 * 2.0**0.5)


def test_a_gain_that_takes_out_more_than_there_is_is_told(tmp_path: Path) -> None:
    write(tmp_path / "mine", CraftFacts(size="12U"), "")
    fast = prepare(str(tmp_path / "mine"), Options(sets=["manager.gain=10"]))
    assert "takes 100 times the momentum out within a sample of 10 s" in "\n".join(
        fast.checked.warnings
    )
    usual = prepare(str(tmp_path / "mine"), Options())
    assert "takes" not in "\n".join(usual.checked.warnings)
