"""Wheels by number, nozzles by layout, attitudes and orbits of a new craft, flown."""

from __future__ import annotations

import re
import shlex
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from desat.begin import nozzles, wheel_layout
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.blocks.thrusters_nozzles import ThrustersNozzles
from desat.components.maths.allocation import least_on_times
from desat.files import own
from desat.fmus import registry
from desat.runs.prepare import prepare, read, resolved
from desat.runs.run import simulate
from desat.sizing.dumps import size as size_dumps
from desat.sizing.requirements import SizingRequirements
from desat.sizing.sizing import size
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import slow_after


class ThrustersNozzles12(ThrustersNozzles, nozzles=12):
    """Twelve nozzles"""


LOW = CraftFacts(size="12U", altitude="500km", inclination="51.6deg", rods="0.5")
FAR = CraftFacts(
    mass="600kg",
    box="1.2,1.2,1.8",
    wings=("2 x 3m2 2.2m",),
    wheels="4 pyramid 4Nms",
    rods="none",
    thrusters="4 1N",
    dump="thrusters 70:10",
)
AXES = "x,y,z\n1,0,0\n0,1,0\n0,0,2\n1,1,1\n-1,1,1\n"
LAYOUT = (
    "name,x [mm],y [mm],z [mm],u,v,w,thrust [N],isp\n"
    + "a,0,600,-900,0,0,1,1,220\nb,0,-600,-900,0,0,1,1,220\n"
    + "c,600,0,-900,0,0,1,1,220\nd,-600,0,-900,0,0,1,1,220\n"
    + "e,600,-600,0,0,1,0,1,220\nf,600,600,0,0,-1,0,1,220\n"
)


def fly(folder, facts, stop=6000.0, **values):
    write(folder, facts, "")
    options = Options(stop=stop, values=values)
    return simulate(prepare(read(str(folder)), options)).or_raise(str(folder))


@pytest.mark.parametrize(
    "wheels", ["3 pyramid 30mNms", "FILE 30mNms", "6 pyramid 30mNms", "8 axes 30mNms"]
)
def test_any_number_of_wheels_keeps_the_momentum_to_the_last_bits(tmp_path, wheels):
    (tmp_path / "wheels.csv").write_text(AXES)
    wheels = wheels.replace("FILE", str(tmp_path / "wheels.csv"))
    flight = fly(tmp_path / "mine", replace(LOW, wheels=wheels))
    largest = np.abs(flight.results.values("wheels.h_wheel")).max()
    assert flight.manifest.numbers["momentum_residual"].value < 1e-14 * largest
    assert flight.manifest.numbers["pointing"].value < 0.1
    count = wheel_layout.layout_of(wheels).count
    assert flight.results.values("wheels.h_wheel").shape[1] == max(count, 4)


def test_the_native_block_of_six_wheels_is_the_one_in_python(tmp_path):
    """Of the same craft as FMUs and as bare blocks, a wheel failing meanwhile."""
    write(tmp_path / "mine", replace(LOW, wheels="6 pyramid 30mNms"), "")
    values = {"wheels.failed": "2+5", "wheels.failed_from": 700.3}
    series = []
    for blocks in (False, True):
        options = Options(stop=1500.0, values=values, blocks=blocks)
        flight = simulate(prepare(read(str(tmp_path / "mine")), options)).or_raise(
            "mine"
        )
        series.append(flight.results.values("wheels.h_wheel"))
        dead = flight.results.values("wheels.failed_wheel")
        assert dead[-1].tolist() == [False, True, False, False, True, False]
    assert np.array_equal(*series)
    assert not np.array_equal(series[0][0], series[0][-1])


@pytest.mark.parametrize("wheels", ["4 pyramid 30mNms", "6 pyramid 30mNms"])
def test_a_wheel_that_is_known_to_have_failed_gets_no_command(tmp_path, wheels):
    errors = []
    for known in ("none", "1"):
        values = {
            "wheels.failed": "1",
            "wheels.failed_from": 3000.0,
            "manager.wheels_out": known,
            "manager.out_from": 3000.0,
        }
        folder = tmp_path / known
        flight = fly(folder, replace(LOW, wheels=wheels), stop=12000.0, **values)
        errors.append(flight.manifest.numbers["pointing"].value)
        commands = flight.results.values("manager.tau_cmd_wheel")
    assert errors[1] < 0.7 * errors[0]
    assert not commands[3002:, 0].any()
    assert commands[:2990, 0].any()


@pytest.mark.study
@pytest.mark.parametrize(
    "wheels",
    slow_after(1, ["6 pyramid 15mNms", "4 pyramid 15mNms", "5 axes 15mNms"], "study"),
)
def test_dumps_beside_a_bias_are_sized_as_they_fly(tmp_path, wheels):
    facts = replace(
        LOW,
        rods="none",
        thrusters="4 10mN",
        wheels=wheels,
        dump="thrusters 70:10",
        residual_dipole="0.1Am2",
        bias="2mNms",
    )
    write(tmp_path / "mine", facts, "")
    requirements = SizingRequirements(year=False)
    sizing = size_dumps(str(tmp_path / "mine"), Options(), requirements)
    sizes = sizing.within or sizing.steady
    assert sizes.a_week == pytest.approx(sizing.loop["dumps_a_week"], rel=0.05)
    assert sizes.momentum == pytest.approx(sizing.loop["dump_momentum"], rel=0.05)


def test_wheels_that_fail_and_those_left_out_count_together(tmp_path):
    write(tmp_path / "mine", LOW, "")
    failures = {
        "wheels.failed": "1",
        "manager.wheels_out": "2",
        "manager.out_from": 600.0,
    }
    for values, count in ((failures, 1), ({"wheels.failed": "1"}, 0)):
        options = Options(values=values)
        warnings = prepare(read(str(tmp_path / "mine")), options).warnings
        assert sum("no wheel gives torque about" in x for x in warnings) == count
    assert any(
        "wheels_out = 2: from 600 s on" in x
        for x in prepare(
            read(str(tmp_path / "mine")), Options(values=failures)
        ).warnings
    )


def test_another_number_of_wheels_is_built_once_and_is_ours(tmp_path):
    write(tmp_path / "mine", replace(LOW, wheels="5 pyramid 30mNms"), "")
    system, _ = resolved(str(tmp_path / "mine"), Options())
    wheels = system.components["wheels"]
    assert wheels.model == "wheels"
    assert wheels.interface.sizes == (("wheels", 5),)
    assert wheels.fmu.ours
    assert own.folder_of(wheels.fmu.path) is not None
    assert system.components["gyro"].interface.sizes == ()
    assert len(wheels.interface.signals["failed"].choices) == 2**5
    assert registry.block_class("wheels").variables[0].shape == ()


def test_a_bias_keeps_wheels_from_standstill_and_is_counted(tmp_path):
    changes, margins = [], []
    for bias in (None, "9mNms", "1500rpm"):
        folder = tmp_path / str(bias)
        facts = replace(LOW, wheels="6 pyramid 30mNms", bias=bias)
        flight = fly(folder, facts, stop=12000.0)
        speed = flight.results.values("wheels.speed_wheel")
        changes.append(int((np.diff(np.sign(speed), axis=0) != 0).sum()))
        margins.append(flight.manifest.numbers["largest_momentum"].value)
    assert changes[0] > 0
    assert changes[1] == changes[2] == 0
    assert margins[1] > margins[0] + 20.0


@pytest.mark.parametrize("count", [6, 8, 12])
def test_on_times_are_those_of_another_linear_programme(count):
    layout = nozzles.layout_of(count, 10.0, (0.6, 0.7, 0.9), 0.0)
    torques = np.array(layout.torques)
    random = np.random.default_rng(count)
    for _ in range(200):
        impulse = random.normal(size=3)
        ours = np.array(least_on_times(layout.torques, tuple(impulse), 10.0))
        assert ours @ torques == pytest.approx(impulse, abs=1e-9)
        other = linprog(
            np.ones(count), A_eq=torques.T, b_eq=impulse, bounds=(0.0, 10.0)
        )
        assert ours.sum() == pytest.approx(other.fun, rel=1e-9)


def test_couples_leave_no_force():
    layout = nozzles.layout_of(12, 10.0, (0.6, 0.7, 0.9), 0.0)
    block = ThrustersNozzles12()
    forces = layout.directions * layout.thrust[:, None]
    block.position_nozzle = tuple(layout.positions.ravel())
    block.direction_nozzle = tuple(layout.directions.ravel())
    block.thrust, block.partner_nozzle = tuple(layout.thrust), tuple(layout.partners)
    block.check()
    block.start()
    for impulse in np.random.default_rng(1).normal(size=(50, 3)):
        times = np.array(block.on_times(layout.torques, tuple(impulse), 10.0))
        assert times @ np.array(layout.torques) == pytest.approx(impulse, abs=1e-9)
        assert times @ forces == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    block.partner_nozzle = (2.0, 3.0, 2.0, *[0.0] * 9)
    with pytest.raises(ValueError, match="each is the partner of the other"):
        block.start()


@pytest.mark.study
@pytest.mark.parametrize(
    ("thrusters", "wheels"),
    [
        ("8 1N", "5 pyramid 12Nms"),
        ("12 1N", "4 pyramid 12Nms"),
        ("FILE", "6 axes 12Nms"),
    ],
)
def test_dumps_by_nozzles_are_sized_as_they_fly(tmp_path, thrusters, wheels):
    (tmp_path / "layout.csv").write_text(LAYOUT)
    thrusters = thrusters.replace("FILE", str(tmp_path / "layout.csv"))
    facts = replace(
        FAR,
        orbit="geo",
        thrusters=thrusters,
        wheels=wheels,
        secular="300uNm,450uNm,150uNm",
    )
    write(tmp_path / "mine", facts, "")
    sizing = size_dumps(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False)
    )
    steady, loop = sizing.steady, sizing.loop
    assert steady.a_week == pytest.approx(loop["dumps_a_week"], rel=0.05)
    assert steady.propellant == pytest.approx(loop["dump_propellant"], rel=0.05)
    if thrusters != "12 1N":
        net = pytest.approx(loop["dump_net_impulse"], rel=0.05)
        assert steady.net_impulse == net
        assert steady.net_impulse > 0.1 * steady.impulse
    else:
        assert steady.net_impulse < 1e-6 * steady.impulse


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAYOUT.replace("0,600,-900,0,0,1", "0,300,-900,0,0,-1"), "row 1 fires into"),
        (LAYOUT.replace("f,600,600,0,0,-1", "f,600,600,0,0,1"), "no torque about -z"),
        (LAYOUT.replace(",220\nb", ",230\nb"), "one specific impulse"),
        (LAYOUT.replace("0,0,1,1,220\nb", "0,0,0,1,220\nb"), "row 1 has no direction"),
        (LAYOUT.replace("u,v,w", "u,v,q"), "no such column"),
    ],
)
def test_a_layout_that_cannot_be_is_refused(tmp_path, text, message):
    (tmp_path / "layout.csv").write_text(text)
    with pytest.raises(DesatError, match=message):
        nozzles.read_layout(str(tmp_path / "layout.csv"), (1.2, 1.2, 1.8))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,0,0\n0,1,0\n1,1,0\n", "lie in a plane or on a line"),
        ("x,y,z\n1,0,0\n0,1,0\n0,0,0\n", "row 3 is no axis"),
        ("x,y,z\n1,0,0\n0,1,0\n", "2 wheels; 3 to 8 are taken"),
        ("x,y\n1,0\n", "no column z"),
    ],
)
def test_wheels_that_cannot_be_are_refused(tmp_path, text, message):
    (tmp_path / "w.csv").write_text(text)
    with pytest.raises(DesatError, match=message):
        wheel_layout.layout_of(f"{tmp_path / 'w.csv'} 30mNms")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,mode\n0,nadir\n0,sun\n", "is not after that of the row before"),
        ("t,mode\n5,nadir\n", "a row at 0 s, or before, is needed"),
        ("t,mode\n0,sideways\n", "a time, and a mode"),
        ("0,inertial\n", "inertial needs a quaternion"),
        ("0,0,0,1\n", "a time, and a mode"),
        ("t,mode\n" + "".join(f"{k},nadir\n" for k in range(40)), "32 are taken"),
    ],
)
def test_a_plan_that_is_none_is_refused(tmp_path, text, message):
    (tmp_path / "plan.csv").write_text(text)
    pointing = str(tmp_path / "plan.csv")
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", replace(LOW, pointing=pointing), "")


@pytest.mark.parametrize(
    "pointing",
    ["nadir 16deg", "sun 90deg", "spin 0.5rpm", "target 48.1N 11.6E", "plan.csv"],
)
def test_a_craft_follows_where_it_points(tmp_path, pointing):
    if pointing == "plan.csv":
        (tmp_path / "plan.csv").write_text("t [min],mode\n0,nadir\n40,sun\n80,nadir\n")
        pointing = str(tmp_path / "plan.csv")
    flight = fly(tmp_path / "mine", replace(LOW, pointing=pointing), stop=8000.0)
    assert flight.manifest.numbers["pointing"].value < 0.2
    q = flight.results.values("guidance.q_ref_bi")
    assert np.abs(np.linalg.norm(q, axis=1) - 1.0).max() < 1e-12


@pytest.mark.study
@pytest.mark.parametrize(
    "place",
    [{"orbit": "mars 250x400km", "pointing": "nadir 16deg"}, {"sun": "L2"}],
)
def test_elsewhere_is_sized_as_it_flies(tmp_path, place):
    write(tmp_path / "mine", replace(FAR, **place), "")
    sizing = size_dumps(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False)
    )
    within = sizing.within or sizing.steady
    assert within.a_week == pytest.approx(sizing.loop["dumps_a_week"], rel=0.05)
    assert within.propellant == pytest.approx(sizing.loop["dump_propellant"], rel=0.05)


def test_a_tilt_at_mars_has_the_gravity_torque_of_the_books(tmp_path):
    """3 n^2 (I_z - I_x) sin cos of the tilt, about y."""
    facts = replace(
        FAR, orbit="mars 400km", inertia="200,300,120", pointing="nadir 16deg"
    )
    write(tmp_path / "mine", facts, "")
    sizing = size_dumps(
        str(tmp_path / "mine"),
        Options(values={"spacecraft.radiation": "none", "environment.j2": False}),
        SizingRequirements(year=False, flown=False),
    )
    system, _ = resolved(str(tmp_path / "mine"), Options())
    mu = system.components["spacecraft"].values["mu"]
    rate2 = mu / system.components["environment"].values["semi_major_axis"] ** 3
    tilt = np.radians(16.0)
    torque = 3.0 * rate2 * (200.0 - 120.0) * np.sin(tilt) * np.cos(tilt)
    assert sizing.a_day / 86400.0 == pytest.approx(torque, rel=1e-4)
    least = sizing.least_attitude
    assert np.degrees(least.turn) == pytest.approx([0.0, -16.0, 0.0], abs=0.05)
    assert least.momentum < 1e-4 * least.wanted_momentum
    assert least.words == "16 deg about (0.00, -1.00, 0.00)"


@pytest.mark.study
def test_sunlight_at_l2_turns_as_the_books_say(tmp_path):
    """P / (1.01 AU)^2 on 5 m2 whose centre is 0.4 m off: for a day, sun pointing."""
    write(tmp_path / "mine", replace(FAR, sun="L2", secular=None), "")
    flat = {
        "spacecraft.radiation": "area",
        "spacecraft.area_radiation": 5.0,
        "spacecraft.centre_radiation_body": [0.4, 0.0, 0.0],
        "spacecraft.offset_plates_body": [0.0, 0.0, 0.0],
    }
    sizing = size_dumps(
        str(tmp_path / "mine"),
        Options(values=flat),
        SizingRequirements(year=False, flown=False),
    )
    distance = 1.01  # AU
    torque = 4.56e-6 / distance**2 * 5.0 * 0.4
    assert sizing.a_day == pytest.approx(86400.0 * torque, rel=1e-3)


@pytest.mark.study
def test_electric_thrusters_say_their_power(tmp_path):
    """A pair takes twice the power of one, at its share of the class's thrust."""
    facts = CraftFacts(
        altitude="600km",
        mass="160kg",
        wheels="4 pyramid 0.2Nms",
        rods="none",
        thrusters="4 2mN electric",
        dump="thrusters 70:10",
    )
    write(tmp_path / "mine", facts, "")
    system, _ = resolved(str(tmp_path / "mine"), Options())
    assert system.components["thrusters"].values["power"] == pytest.approx(300.0)
    assert system.components["thrusters"].values["specific_impulse"] == 2100.0
    sizing = size_dumps(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False)
    )
    energy = sizing.power * sizing.steady.firing
    assert energy == pytest.approx(75e3 * sizing.steady.impulse, rel=1e-4)
    assert sizing.loop["dump_energy"] == pytest.approx(energy, rel=0.05)
    assert sizing.loop["dump_time"] == pytest.approx(sizing.steady.duration, rel=0.15)


@pytest.mark.study
@pytest.mark.parametrize("wheels", ["4 pyramid 30mNms", "5 pyramid 30mNms"])
def test_the_bias_of_size_keeps_all_wheels_from_zero(tmp_path, wheels):
    facts = CraftFacts(
        size="12U", altitude="500km", inclination="51.6deg", wheels=wheels
    )
    write(tmp_path / "mine", facts, "")
    requirements = SizingRequirements(year=False, flown=False, laws=False)
    sizing = size(str(tmp_path / "mine"), Options(), requirements)
    crossings = []
    for bias in (None, f"{sizing.bias_needed}Nms"):
        flight = fly(tmp_path / f"with {bias}", replace(facts, bias=bias), 86400.0)
        crossings.append(flight.manifest.numbers["crossings"].value)
    assert crossings[0] > 50
    assert crossings[1] == 0
    values = resolved(str(tmp_path / "mine"), Options())[0].components
    axes = np.reshape(values["wheels"].values["axes_wheel"], (3, -1))
    inertia = np.reshape(values["spacecraft"].values["inertia"], (3, 3))
    a_rate = np.linalg.norm(np.linalg.pinv(axes) @ inertia, axis=1).max()
    assert sizing.body_rate == pytest.approx(0.03 / a_rate)


@pytest.mark.study
@pytest.mark.parametrize("spin", ["0.78rpm z", "0.95rpm x", "0.3rpm z"])
def test_a_spinning_craft_is_sized_as_it_flies(tmp_path, spin):
    facts = CraftFacts(
        size="12U",
        altitude="464km",
        inclination="52.4deg",
        rods="0.5",
        pointing=f"spin {spin}",
    )
    write(tmp_path / "mine", facts, "")
    sizing = size(
        str(tmp_path / "mine"), Options(), SizingRequirements(year=False, laws=False)
    )
    point = max((x for x in sizing.curve if x.loop_rms), key=lambda x: x.rod)
    assert point.rms == pytest.approx(point.loop_rms, rel=0.05)
    assert point.duty == pytest.approx(point.loop_duty, rel=0.02)


PAGE = Path(__file__).parents[2] / "docs" / "forms.md"
COMMANDS = [
    line.strip()
    for line in PAGE.read_text().splitlines()
    if line.startswith("    desat")
]
FORMS = sorted(
    {
        form
        for row in PAGE.read_text().splitlines()
        if row.startswith("| ")
        for form in re.findall(r"--[a-z]+ (?:'[^']+'|[^\s`,;|]+)", row)
    }
)


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_of_the_page_makes_a_craft(command, tmp_path, desat):
    arguments = shlex.split(command)[1:]
    arguments[2] = str(tmp_path / arguments[2])
    desat(*arguments, check=True)
    desat("check", arguments[2], check=True)


@pytest.mark.parametrize("form", FORMS)
def test_each_form_of_the_page_is_taken(form, tmp_path, desat):
    """With what it needs beside it: thrusters with dumps, a craft in deep space."""
    files = {
        "wheels.csv": AXES,
        "layout.csv": LAYOUT,
        "contacts.csv": "begin [h],end [h]\n2,3\n",
        "plan.csv": "t,mode\n0,nadir\n600,sun\n",
    }
    option, value = shlex.split(form)
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        value = value.replace(name, str(tmp_path / name))
    facts = {"--mass": "600kg", "--box": "1.2,1.2,1.8"}
    if option in ("--thrusters", "--dump", "--arm", "--orbit", "--sun", "--altitude"):
        facts |= {"--thrusters": "4 1N", "--dump": "thrusters 70:10", "--rods": "none"}
    if "both" in value:
        facts["--rods"] = "5"
    if value.endswith("mNms"):
        facts |= {"--mass": "20kg", "--box": "0.2,0.2,0.3"}
    facts[option] = value
    arguments = [x for pair in facts.items() for x in pair]
    desat("new", "craft", str(tmp_path / "mine"), *arguments, check=True)
