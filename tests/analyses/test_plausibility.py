"""What a craft is made of is held against itself: mass and sides, wheels and orbit,
dumps, coils, sampled attitude control, and laws that do nothing."""

from __future__ import annotations

import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import desat as library
from desat.analyses import attitude_loop, plausibility
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.contract.block import BlockError
from desat.components.contract.roles import Thrusters, Torquers, Wheels
from desat.fmus.registry import block_class, names
from desat.runs.checking import check
from desat.runs.prepare import prepare
from desat.system.craft import craft_of
from desat.system.errors import DesatError
from desat.system.interface import role_classes
from desat.system.options import Options
from desat.system.sampled_loop import (
    AttitudeLoop,
    longest_sample,
    stability,
    worst_momentum,
)

GEO: dict[str, Any] = {
    "orbit": "geo",
    "rods": "none",
    "wheels": "4 pyramid 50Nms",
    "thrusters": "4 10N",
    "dump": "thrusters 70:10",
}
CUBE: dict[str, Any] = {
    "altitude": "600km",
    "inclination": "97.8deg",
    "mass": "50kg",
    "box": "0.5,0.5,0.5",
    "wheels": "4 pyramid 4Nms",
    "rods": "1",
}


def crafted(folder: Path, **facts: Any) -> str:
    """Write a craft; return its folder as a target."""
    write(folder / "mine", CraftFacts(**facts), "")
    return str(folder / "mine")


# --- mass and sides -----------------------------------------------------------


@pytest.mark.parametrize(
    ("facts", "mass", "side"),
    [
        ({"mass": "2500kg"}, 2500.0, 10.0 ** (1.0 / 3.0)),
        ({"mass": "50kg", "inertia": "2,2,2"}, 50.0, 0.2 ** (1.0 / 3.0)),
        # m s^2 / 6 = 2 kg m2 with m = 250 s^3
        ({"inertia": "2,2,2"}, 250.0 * 0.048**0.6, 0.048**0.2),
        ({"size": "3U"}, 4.5, None),
        ({"box": "1,1,2"}, 500.0, None),
    ],
)
def test_what_is_not_given_follows_from_what_is(tmp_path, facts, mass, side):
    system, _ = prepare(crafted(tmp_path, **facts), Options()).or_raise()
    assert system.body.mass == pytest.approx(mass, rel=1e-5)
    if side is not None:
        assert system.body.sides == pytest.approx((side, side, side), rel=1e-5)
        rows = np.reshape(system.components["spacecraft"].values["plates"], (-1, 9))
        assert rows[:6, 3] == pytest.approx(side**2, rel=1e-5), "six faces"
    assert list(plausibility.warnings(system)) == []


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"size": "3U", "mass": "1000kg"}, r"2\.94e\+05 kg/m3; crafts have 20 to 3000"),
        ({"box": "2,2,2", "mass": "10kg"}, r"1\.25 kg/m3; crafts have"),
        (
            {"mass": "50kg", "inertia": "0.01,0.01,0.01"},
            r"0\.00351 times that of a homogeneous",
        ),
        ({"size": "3U", "inertia": "5,5,5"}, r"times that of a homogeneous box"),
        (
            {
                "mass": "10kg",
                "thrusters": "4 1N",
                "dump": "thrusters 70:10",
                "propellant": "20kg",
            },
            r"--propellant 20kg: more than 90 % of 10 kg",
        ),
        ({"rods": "coil 1e-9Am2 80x80mm 0.2mm 100mA"}, r"one turn gives 0\.00064 A m2"),
        (
            {"rods": "rod 1e-300Am2 60x8mm 0.2mm 100mA"},
            r"one turn gives 0\.000162 A m2",
        ),
        ({"rods": "coil 300 80x80mm 0.2mm 100A"}, r"3\.18e\+03 A/mm2 in the wire"),
        ({"rods": "rod 0.2Am2 60x8mm 0.2mm 1uA"}, r"a tenth of the craft"),
        (
            {"orbit": "200x384400km"},
            r"an eccentricity of 0\.967; the environment has up to 0\.95",
        ),
        ({"altitude": "400"}, r"--altitude 400: a unit is needed, as 400km"),
        ({"mass": "16"}, r"--mass 16: a unit is needed, as 16kg"),
        (
            {"thrusters": "4 1", "dump": "thrusters 70:10"},
            r"--thrusters 1: a unit is needed",
        ),
        (
            {"dump": "coils 0.7:0.1"},
            r"thresholds are in % of a wheel's capacity: 'coils 70:10'",
        ),
        (
            {"size": "12U", "sample": "0.3s"},
            r"--sample 0\.3s: 10 s over a whole number",
        ),
        (
            {**CUBE, "sample": "1s"},
            r"--sample 1s: .*nutates.*these samples do not hold; 0\.2s",
        ),
    ],
)
def test_what_contradicts_itself_is_refused(tmp_path, facts, message):
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(**facts), "")
    assert not (tmp_path / "mine").exists()


@pytest.mark.parametrize(
    ("facts", "sets", "message"),
    [
        (
            GEO | {"mass": "2500kg"},
            ["manager.begin=60"],
            "a wheel holds 50 N m s: no dump begins",
        ),
        (
            GEO | {"mass": "2500kg"},
            ["manager.begin=0.3", "manager.end=0.1"],
            "is it meant as a share",
        ),
        (
            GEO | {"mass": "2500kg"},
            ["manager.torque=1"],
            "the craft turns with each dump",
        ),
        (
            GEO | {"mass": "2500kg", "propellant": "100kg"},
            ["thrusters.tank=2400"],
            "thrusters.tank = 2400 kg in a craft of 2500 kg",
        ),
        (CUBE, ["torquers.resistance=1e4"], "W in each coil at 1 A m2"),
        (
            CUBE,
            ["spacecraft.residual_dipole_body=300,0,0"],
            "in and out of the fullest within",
        ),
        (
            {"size": "12U", "pointing": "sun"},
            ["spacecraft.residual_dipole_body=30,0,0"],
            "in and out of the fullest within",
        ),
        ({"size": "12U", "secular": "1mNm"}, [], "in the fullest wheel in each orbit"),
    ],
)
def test_improbable_hardware_is_told_by_check(tmp_path, facts, sets, message):
    case = check(crafted(tmp_path, **facts), Options(sets=sets))
    assert message in "\n".join(case.warnings)
    assert message not in "\n".join(check(case.target, Options()).warnings) or not sets


def test_a_craft_file_whose_body_is_wrong_is_told(tmp_path, desat):
    target = Path(crafted(tmp_path, size="6U"))
    craft = target / "craft.toml"
    text = craft.read_text()
    craft.write_text(text.replace('mass = "9 kg"', 'mass = "900 kg"'))
    outcome = desat("check", str(target), check=True).stderr
    assert "kg/m3; crafts have 20 to 3000" in outcome.replace("\n", " ")
    for wrong, message in (
        ('mass = "9 km"', "km does not fit kg"),
        ("mass = true", "a number in kg is needed"),
        ('mess = "9 kg"', "unknown key; did you mean mass"),
    ):
        craft.write_text(text.replace('mass = "9 kg"', wrong))
        with pytest.raises(DesatError, match=message):
            prepare(str(target), Options()).or_raise()


def test_new_craft_prints_what_it_assumed(desat, tmp_path):
    outcome = desat(
        "new",
        "craft",
        str(tmp_path / "c"),
        "--mass",
        "30kg",
        "--rods",
        "0.2",
        "--json",
        check=True,
    )
    rows = {row["quantity"]: row for row in json.loads(outcome.stdout)["assumptions"]}
    assert rows["mass"] == {
        "quantity": "mass",
        "value": "30",
        "unit": "kg",
        "origin": "given",
    }
    assert rows["sides"]["origin"] == "class: a cube of 250 kg/m3"
    assert rows["rods, each axis"]["unit"] == "A m2"


# --- torques ------------------------------------------------------------------


def test_given_torques_add_up(tmp_path):
    (tmp_path / "tau.csv").write_text("t,x,y,z\n0,1e-6,0,0\n100,3e-6,0,0\n")
    both = crafted(
        tmp_path,
        secular="4uNm",
        torque=f"{tmp_path}/tau.csv eci",
        panel="2m2 0.5m",
        residual_dipole="0.1",
        size="12U",
    )
    system, _ = prepare(both, Options()).or_raise()
    craft = system.components["spacecraft"].values
    assert craft["tau_disturbance_body"] == [0.0, 4e-6, 0.0]
    assert system.components["disturbance"].values["torque"][:8] == [
        0,
        1e-6,
        0,
        0,
        100,
        3e-6,
        0,
        0,
    ]
    assert np.linalg.norm(craft["residual_dipole_body"]) == pytest.approx(0.1, rel=1e-5)
    areas = [x for x in craft["plates"][3::9] if x > 0.0]
    assert areas == [2.0], "its panel alone"
    assert system.components["spacecraft"].choice("aerodynamics") == "none", (
        "a class's default"
    )
    worse, _ = prepare(f"{both}/worst.toml", Options()).or_raise()
    assert worse.components["spacecraft"].values["tau_disturbance_body"][
        1
    ] == pytest.approx(5.2e-6)


# --- which wheels there are ---------------------------------------------------


@pytest.mark.parametrize(
    ("sets", "message"),
    [
        (["wheels.failed=5"], r"wheels\.failed = 5: not a choice"),
        (
            ["shared.inertia_wheel=1e-4,1e-4,1e-4,0"],
            r"column 4 = .*, but inertia_wheel\[4\] = 0",
        ),
        (["wheels.failed=12"], r"not a choice"),
    ],
)
def test_wheels_that_contradict_each_other_are_refused(tmp_path, sets, message):
    with pytest.raises(DesatError, match=message):
        prepare(crafted(tmp_path, size="12U"), Options(sets=sets)).or_raise()


def test_three_wheels_of_four_have_a_margin(tmp_path):
    target = crafted(tmp_path, size="12U", wheels="3 axes 30mNms")
    run = library.run(target, stop=60.0)
    assert 0.0 < run.manifest.numbers["momentum_margin"].value <= 100.0
    with pytest.raises(DesatError, match=r"there is no wheel 4"):
        prepare(target, Options(sets=["wheels.failed=4"])).or_raise()
    extra = prepare(target, Options(sets=["wheels.h_start_wheel=0,0,0,0.01"]))
    assert "h_start_wheel[4] = 0.01 N m s is left out" in "\n".join(extra.warnings)


# --- ranges of sensors and actuators --------------------------------------------

SENSORS = {role for role, block in role_classes().items() if block.is_sensor}
TIMES = {
    "sample_time",
    "fail_time",
    "delay",
    "failed_from",
    "stuck_from",
    "schedule_start",
    "schedule_duration",
    "speed_sample_time",
}
FREE = {
    "boresight_body",  # normalised
    "axes_wheel",
    "inertia_wheel",  # of the craft
    "h_start_wheel",  # within the wheel's capacity, which the block checks
}
"""Real parameters for which no range is meaningful by itself."""


def test_each_real_parameter_of_a_sensor_or_actuator_has_a_range():
    lacking = []
    for name in names():
        block = block_class(name)
        actuator = issubclass(block, (Wheels, Torquers, Thrusters))
        if block.role not in SENSORS and not actuator:
            continue
        lacking += [
            f"{name}.{v.name}"
            for v in block.variables
            if v.causality == "parameter"
            and v.type == "Real"
            and v.usual is None
            and (v.minimum is None or v.maximum is None)
            and v.name not in TIMES | FREE
        ]
    assert lacking == []


@pytest.mark.parametrize(
    "values",
    [
        "gyro.misalignment_body=1,1,1",
        "magnetometer.bias_body=1,0,0",
        "wheels.viscous=1",
        "magnetometer.response_error=5,0,0,0,5,0,0,0,5",
        "torquers.lag=1000",
        "tachometers.noise=50",
    ],
)
def test_a_parameter_beyond_its_model_is_told(tmp_path, values):
    case = prepare(crafted(tmp_path, size="12U"), Options(sets=[values]))
    messages = "\n".join(case.warnings + case.problems)
    assert f"{values.partition('=')[0]}" in messages
    assert "usual is" in messages


# --- sampled attitude control ---------------------------------------------------


def a_loop(sample: float, lag: float = 0.0) -> AttitudeLoop:
    """A loop of a body of 2 kg m2 with a bandwidth of 0.1 rad/s."""
    inertia = 2.0 * np.eye(3)
    return AttitudeLoop(
        inertia=inertia,
        gain_matrix=inertia,
        kp=0.02,
        kd=0.14,
        ki=0.0,
        actuated=np.eye(3),
        motor_lag=lag,
        gyroscopic=True,
        step=sample,
        gyro_sample=sample,
        attitude_sample=sample,
        controller_sample=sample,
        wheel_sample=sample,
    )


def test_a_loop_at_rest_has_the_damping_of_its_gains():
    found = stability(a_loop(0.01), np.zeros(3))
    assert found.damping == pytest.approx(0.7, abs=0.01)
    assert found.stable


def test_held_compensation_is_unstable_near_two_radians_of_nutation_in_a_sample():
    loop = a_loop(1.0)
    stable = [
        stability(loop, np.array([0.0, 2.0 * x, 0.0])).stable
        for x in (0.5, 1.0, 1.5, 2.2)
    ]
    assert loop.nutation(np.array([0.0, 2.0, 0.0])) == pytest.approx(1.0)
    assert stable == [True, True, True, False]
    axes = np.eye(3)
    assert longest_sample(loop, axes, np.array([0.0, 4.4, 0.0])) == 0.5


def test_the_worst_momentum_is_that_of_the_least_damping():
    """Of two wheels that nearly cancel with equal signs, opposite signs add up."""
    loop = a_loop(1.0)
    axes = np.array([[1.0, -0.8], [0.0, 0.6], [0.0, 0.0]])
    momentum, found = worst_momentum(loop, axes, np.array([1.0, 1.0]))
    assert momentum == pytest.approx([1.8, -0.6, 0.0])
    assert found == stability(loop, np.array([1.8, -0.6, 0.0]))
    assert found.damping < stability(loop, np.array([0.2, 0.6, 0.0])).damping


@pytest.mark.parametrize(("share", "is_stable"), [(0.95, True), (1.05, False)])
def test_a_controller_may_be_as_late_as_its_phase_margin(share, is_stable):
    """Of (2 zeta w s + w^2) / s^2, of gain 1 at the crossover."""
    w, zeta = 0.1, 0.7
    crossover = w * np.sqrt(2.0 * zeta**2 + np.sqrt(4.0 * zeta**4 + 1.0))
    longest = np.arctan(2.0 * zeta * crossover / w) / crossover
    loop = replace(a_loop(0.1), controller_delay=0.1 * round(10.0 * share * longest))
    assert stability(loop, np.zeros(3)).stable is is_stable


def test_the_loop_of_a_craft_has_the_delays_of_its_computers(tmp_path):
    values = {"controller.delay": 0.4, "manager.delay": 0.2}
    target = crafted(tmp_path, **CUBE)
    system, _ = prepare(target, Options(values=values)).or_raise()
    loop = attitude_loop.loop_of(system)
    assert (loop.controller_delay, loop.manager_delay) == (0.4, 0.2)


def test_wheels_of_a_craft_that_dumps_are_full_where_dumps_begin(tmp_path):
    """70 % of 50 N m s in each wheel, of some signs."""
    system, _ = prepare(crafted(tmp_path, **GEO, mass="2500kg"), Options()).or_raise()
    loop, body = attitude_loop.loop_of(system), craft_of(system).rigid_body
    *_, full = attitude_loop.conditions(system, loop, body)
    assert full.name == "with the wheels where dumps begin"
    sums = [body.wheels.axes @ (35.0 * np.array(x)) for x in product((1, -1), repeat=4)]
    distances = np.linalg.norm(np.array(sums) - full.momentum, axis=1)
    assert distances.min() < 1e-9


def test_a_loop_that_is_poorly_damped_is_told_with_its_damping(tmp_path):
    """G is the inertia: e is half the angle, so that zeta = kd / (2 sqrt(kp / 2))."""
    target = crafted(tmp_path, **CUBE)
    system, _ = prepare(target, Options()).or_raise()
    kp = system.components["controller"].values["kp"]
    for zeta, number in ((0.05, 1), (0.2, 0)):
        sets = {"controller.kd": 2.0 * zeta * np.sqrt(kp / 2.0), "controller.ki": 0.0}
        weak, _ = prepare(target, Options(values=sets)).or_raise()
        lines = [x for x in attitude_loop.warnings(weak) if "wheels at rest" in x]
        assert len(lines) == number
        for line in lines:
            damping = line.partition("has a damping of ")[2].partition(" ")[0]
            assert float(damping) == pytest.approx(zeta, abs=0.01)


@pytest.mark.study
@pytest.mark.parametrize("momentum", [1.0, 2.0])
def test_what_the_eigenvalues_say_flies(tmp_path, momentum):
    """A craft of the issue, sampled each second: at a quarter it points, at half it is
    lost."""
    target = crafted(tmp_path, **CUBE)
    folder = Path(target)
    for file in folder.glob("*.toml"):
        text = file.read_text().replace("step = 0.2", "step = 1.0")
        text = text.replace("substeps = 2", "substeps = 4")
        file.write_text(text.replace("sample_time = 0.2", "sample_time = 1.0"))
    sets = [f"wheels.h_start_wheel={momentum},{momentum},-{momentum},-{momentum}"]
    problems = prepare(target, Options(sets=sets)).problems
    if momentum == 2.0:
        assert (
            "attitude control is unstable with the wheels' momentum at the start"
            in problems[0]
        )
        assert problems[0].endswith("0.2 s would do")
        nominal = folder / "nominal.toml"
        reason = 'unstable = "to see it"\ntitle'
        nominal.write_text(nominal.read_text().replace("title", reason, 1))
    else:
        assert problems == []
    values = {"wheels.h_start_wheel": [momentum, momentum, -momentum, -momentum]}
    run = library.run(target, values, stop=3000.0)
    pointing = run.manifest.numbers["pointing"].value
    assert (pointing > 5.0) == (momentum == 2.0)


def test_a_new_craft_samples_as_its_full_wheels_need(tmp_path):
    system, _ = prepare(crafted(tmp_path, **CUBE), Options()).or_raise()
    assert system.step == 0.2
    assert list(attitude_loop.problems_when_full(system)) == []
    assert list(attitude_loop.warnings(system)) == []


def test_check_ends_with_1_where_full_wheels_are_unstable(tmp_path, desat):
    target = crafted(tmp_path, **CUBE)
    slow = [
        "--step",
        "1",
        "--set",
        "gyro.sample_time=1",
        "--set",
        "determination.sample_time=1",
        "--set",
        "controller.sample_time=1",
        "--set",
        "manager.wheel_sample_time=1",
        "--set",
        "tachometers.sample_time=1",
        "--set",
        "guidance.sample_time=1",
        "--set",
        "magnetometer.sample_time=1",
    ]
    outcome = desat("check", target, *slow)
    assert outcome.returncode == 1
    assert "is unstable with full wheels" in outcome.stderr.replace("\n", " ")


# --- laws that do nothing, or harm ------------------------------------------------


def test_a_law_that_does_nothing_is_not_met(tmp_path):
    target = crafted(tmp_path, size="12U", rods="0.2")
    still = library.run(target, {"manager.gain": 0.0}, stop=6000.0)
    assert any("it does nothing" in line for line in still.manifest.not_met)
    own_value = library.run(target, stop=6000.0)
    assert not any("it does nothing" in line for line in own_value.manifest.not_met)
    off = library.run(target, {"manager.enable": False}, stop=6000.0)
    assert not any("it does nothing" in line for line in off.manifest.not_met)


def test_b_dot_that_drives_a_rotation_is_told_and_not_met(tmp_path):
    target = crafted(tmp_path, size="12U", rods="0.2") + "/detumbling.toml"
    case = prepare(
        target, Options(sets=['spacecraft.omega_start_body=["180 deg/s",0,0]'])
    )
    assert "by 180 deg in a sample of 1 s: beyond 90 deg manager speeds" in "\n".join(
        case.warnings
    )
    slow = prepare(target, Options())
    assert not any("speeds the rotation up" in line for line in slow.warnings)
    run = library.run(
        target, {"spacecraft.omega_start_body": ["180 deg/s", 0, 0]}, stop=6000.0
    )
    assert any(
        "manager is to brake a rotation" in line for line in run.manifest.not_met
    )


@pytest.mark.parametrize("pointing", ["yaw", "inertial", "nadir"])
def test_a_bias_that_the_attitude_turns_is_refused(tmp_path, pointing):
    facts = {
        "size": "12U",
        "altitude": "600km",
        "inclination": "97deg",
        "rods": "0.3",
        "wheels": "4 pyramid 100mNms",
        "pointing": pointing,
    }
    target = crafted(tmp_path, **facts)
    case = prepare(target, Options(sets=["manager.h_target_body=0,0.02,0"]))
    message = "\n".join(case.problems)
    assert ("no law turns a bias with it" in message) == (pointing == "yaw")


@pytest.mark.parametrize("begin", [1000.0, 40000.0])
def test_a_bias_that_a_slew_turns_is_refused(tmp_path, begin):
    target = crafted(tmp_path, size="12U", rods="0.3", pointing="inertial")
    sets = [
        "manager.h_target_body=0,0.002,0",
        "guidance.q_end_bi=0.7071068,0,0,0.7071068",
        f"guidance.t_begin={begin}",
        f"guidance.t_end={begin + 600.0}",
    ]
    slewed = Options(sources=["guidance=guidance_slew"], sets=sets)
    assert "guidance_slew turns it by 90 deg" in "\n".join(
        prepare(target, slewed).problems
    )


def test_the_dumps_of_a_run_are_the_vector_sums_of_their_pulses(tmp_path):
    """Of a torque of 0.4, 1, 0.2 mN m the pulses turn as they go: their sizes add up to
    more."""
    (tmp_path / "t.csv").write_text("0,0.4e-3,1e-3,0.2e-3\n1e9,0.4e-3,1e-3,0.2e-3\n")
    facts = GEO | {
        "mass": "2500kg",
        "box": "2.5,2.5,3",
        "pointing": "inertial",
        "wheels": "3 axes 50Nms",
        "torque": f"{tmp_path}/t.csv eci",
    }
    target = crafted(tmp_path, **facts)
    run = library.run(target, stop=200000.0)
    h = run.results.values("wheels.h_wheel")
    sizes = np.linalg.norm(h[:, :3], axis=1)
    dumps = run.manifest.numbers["dumps"].value
    assert dumps >= 2
    taken = run.manifest.numbers["dump_momentum"].value
    assert taken == pytest.approx(
        sizes.max() - sizes[len(sizes) // 2 :].min(), rel=0.05
    )


# --- what a sizing knows ----------------------------------------------------------


def _fingerprint(system: Any) -> str:
    """Everything that the momentum model takes from a system, as text."""
    from desat.analyses.flight import (
        environment_block,
        flown_at,
        hardware_of,
        inputs_at,
        wanted_attitude,
    )
    from desat.sizing.dumps import LAW
    from desat.sizing.propellant import thruster_cost
    from desat.sizing.requirements import SizingRequirements

    times = system.start + np.array([0.0, 500.0, 9000.0, 40000.0])
    inputs = inputs_at(
        environment_block(system.components["environment"]), times.tolist()
    )
    flight = flown_at(system, wanted_attitude(system), inputs, times)
    manager = system.components["manager"]
    law = manager.values if manager.interface.model == LAW else {}
    tank = system.components["thrusters"].values["tank"]
    hardware = hardware_of(system)
    seen = (
        hardware,
        thruster_cost(system, hardware, SizingRequirements()),
        dict(law),
        tank,
        flight.q,
        flight.disturbance,
        flight.body,
    )
    with np.printoptions(precision=17, floatmode="unique"):
        return repr(seen)


def _changed(signals: Any, values: Any) -> list[Any]:
    """Other values than a parameter has."""
    results = []
    for s, x in zip(signals, values, strict=True):
        if s.kind == "Boolean":
            results.append(not x)
        elif s.choices:
            results.append(s.choices[(x + 1) % len(s.choices)])
        elif s.kind == "Integer":
            results.append(x + 1)
        else:
            results.append(1.05 * x if x else 0.01 * (s.maximum or 1.0))
    return results


INACTIVE = {
    "thrusters.power",  # of a dump's energy alone
    "environment.dipole_earth",
    "environment.earth_angle_start",  # of a dipole's field
    "environment.f107",
    "environment.ap",  # of an activity that is given
    "environment.density_base",
    "environment.altitude_base",
    "environment.scale_height",
    "environment.atmosphere_radius",  # of an exponential atmosphere
    "environment.orbit_frame",
    "environment.r_start",
    "environment.v_start",  # of a start by state
    "spacecraft.area_drag",
    "spacecraft.centre_drag_body",
    "spacecraft.area_radiation",
    "spacecraft.centre_radiation_body",  # of torques on an area
    "spacecraft.drive_plate",  # of what has no drive
}
"""Parameters that another choice of the craft makes active, in the closed loop, too."""


def _silent(target: str) -> set[str]:
    """Parameters whose change neither moves the momentum model nor is said or refused."""
    from desat.sizing.scenarios import closed_loop_only

    own_value, _ = prepare(target, Options()).or_raise()
    known, silent = _fingerprint(own_value), set()
    for component in own_value.components.values():
        for name in dict.fromkeys(s.array for s in component.interface.parameters):
            signals = component.interface.elements[name]
            values = _changed(signals, [component.values[s.name] for s in signals])
            inputs = values if len(signals) > 1 else values[0]
            options = Options(values={f"{component.name}.{name}": inputs})
            if list(closed_loop_only(own_value, options)):
                continue
            try:
                system, _ = prepare(target, options).or_raise()
                if _fingerprint(system) == known:
                    silent.add(f"{component.name}.{name}")
            except (DesatError, ValueError, RuntimeError):
                continue  # refused
    return silent


def test_size_uses_each_parameter_of_a_craft_or_says_that_it_does_not(tmp_path):
    geo = GEO | {"mass": "2500kg", "propellant": "15kg", "residual_dipole": "1"}
    low = geo | {
        "orbit": None,
        "altitude": "420km",
        "pointing": "inertial",
        "box": "1,1.5,2",
    }
    found = _silent(crafted(tmp_path / "geo", **geo)) & _silent(
        crafted(tmp_path / "low", **low)
    )
    assert not found - INACTIVE, " ".join(sorted(found - INACTIVE))


@pytest.mark.parametrize("size", [1e30, 1e39, 1e300])
@pytest.mark.parametrize(
    "name",
    [
        "wheels.h_start_wheel",
        "wheels.speed_limit",
        "shared.inertia",
        "spacecraft.omega_start_body",
        "spacecraft.residual_dipole_body",
        "torquers.m_limit",
        "environment.semi_major_axis",
        "controller.kp",
    ],
)
def test_a_value_beyond_all_quantities_is_a_problem_and_no_bug(name, size):
    """Eigenvalues of a matrix that is not finite, an arc cosine of 1e50, overflows were
    met."""
    count = {"wheels.h_start_wheel": 4, "shared.inertia": 9}.get(
        name, 3 * name.endswith("body")
    )
    values = {name: [size] * count or size}
    if name == "shared.inertia":
        values = {name: [size if i % 4 == 0 else 0.0 for i in range(9)]}
    for target in ("nadir_day/day-dipole", "gyrostat/saturating"):
        found = prepare(target, Options(values=values))
        if size > 1e40:
            assert any(
                "a magnitude of at most 1e+40 is needed" in line
                for line in found.problems
            )


@pytest.mark.parametrize(
    ("target", "wheels", "message"),
    [
        ("0,-0.2,0", "4 pyramid 15mNms", "0.0866 N m s of a wheel, which holds 0.015"),
        ("0,0,0.02", "3 axes 15mNms", "0.02 N m s of a wheel, which holds 0.015 N m s"),
        ("0,-0.002,0", "4 pyramid 15mNms", ""),
        ("0,0,0.02", "4 pyramid 15mNms", ""),
    ],
)
def test_a_target_that_wheels_do_not_hold_is_told(tmp_path, target, wheels, message):
    write(tmp_path / "c", CraftFacts(size="12U", wheels=wheels), "desat new craft")
    options = Options(sets=[f"manager.h_target_body={target}"])
    lines = "\n".join(prepare(str(tmp_path / "c"), options).warnings)
    assert (message in lines) if message else ("h_target_body" not in lines)


@pytest.mark.parametrize(
    ("rows", "line"),
    [
        (
            [[0.0, 4e-6, 0.0, 0.0], [0.4, 0.0, 0.0, 0.0], [7000.0, 0.0, 0.0, 0.0]],
            "a row of 0.4 s is shorter than a step of 1 s, over which it acts by its mean",
        ),
        (
            [[0.0, 4e-6, 0.0, 0.0], [4.0, 0.0, 0.0, 0.0], [7000.0, 0.0, 0.0, 0.0]],
            "a row of 4 s is shorter than a sample of manager, 10 s: its law cannot follow it",
        ),
        ([[0.0, 4e-6, 0.0, 0.0], [600.0, 0.0, 0.0, 0.0], [7e3, 0.0, 0.0, 0.0]], ""),
        ([[0.0, 4e-6, 0.0, 0.0]], ""),  # a constant torque
    ],
)
def test_a_pulse_of_torque_that_is_too_short_is_named(tmp_path, rows, line):
    crafted(tmp_path, size="12U")
    table = (
        '[components]\ndisturbance = "disturbance_table"\n'
        f"[parameters.disturbance]\ntorque = {rows}\nrepeated = {str(len(rows) > 1).lower()}\n"
        'between = "hold"\n'
    )
    file = next(tmp_path.rglob("craft.toml"))
    file.write_text(
        file.read_text().replace("[components]\n", table.partition("[parameters")[0], 1)
    )
    file.write_text(
        file.read_text() + "\n[parameters" + table.partition("[parameters")[2]
    )
    system, _ = prepare(str(file.parent), Options()).or_raise()
    found = [x for x in plausibility.warnings(system) if "a row of" in x]
    assert [x.rpartition(".torque: ")[2] for x in found] == [line] * bool(line)


# --- hardware against the craft -------------------------------------------------------

DUMPS: dict[str, Any] = {"rods": "none", "dump": "thrusters 70:10", "mass": "16kg"}


@pytest.mark.parametrize(
    ("facts", "sets", "key", "message"),
    [
        (
            {"size": "12U", "rods": "200"},
            [],
            "torquers.m_limit",
            "has some 4 kg, and the",
        ),
        (
            {"size": "3U", "rods": "40"},
            [],
            "torquers.m_limit",
            "such a torquer has some",
        ),
        (
            {**DUMPS, "wheels": "4 pyramid 30mNms", "thrusters": "4 20N"},
            [],
            "thrusters.tau_level",
            "do not empty it",
        ),
        (
            {**DUMPS, "thrusters": "4 0.1uN"},
            [],
            "thrusters.tau_level",
            "less than the disturbances leave",
        ),
        (
            {"size": "12U"},
            ["controller.kd=0"],
            "--set controller.kd=0",
            "no rate is damped",
        ),
        (
            {"size": "12U"},
            ["controller.torque_limit=0"],
            "torque_limit=0",
            "sets no limit",
        ),
        (
            {"size": "12U", "altitude": "900km", "wings": ["500m2 30m 0kg/m2"]},
            [],
            "spacecraft.plates",
            "mostly radiation",
        ),
        (
            {"size": "12U", "altitude": "150km"},
            [],
            "spacecraft.plates",
            "mostly drag",
        ),
        (
            {"size": "12U"},
            ["spacecraft.area_drag=3"],
            "--set spacecraft.area_drag",
            "no torque acts on it: aerodynamics = plates, radiation = plates",
        ),
        (
            {"size": "12U"},
            ["spacecraft.aerodynamics=area", "spacecraft.centre_radiation_body=1,0,0"],
            "--set spacecraft.centre_radiation_body",
            "no torque acts on it: aerodynamics = area, radiation = plates",
        ),
        (
            {"size": "12U", "secular": "80Nm"},
            [],
            "disturbance.torque",
            "mostly given torque",
        ),
        (
            {"size": "12U"},
            ["spacecraft.residual_dipole_body=50,0,0"],
            "--set spacecraft.residual_dipole_body",
            "mostly residual dipole",
        ),
    ],
)
def test_hardware_is_held_against_the_craft(tmp_path, facts, sets, key, message):
    write(tmp_path / "mine", CraftFacts(**facts), "")
    case = check(str(tmp_path / "mine"), Options(sets=sets))
    lines = [x for x in case.warnings if message in x]
    assert lines
    assert key in lines[0]


@pytest.mark.parametrize(
    ("rods", "message"),
    [
        (
            "rod 20Am2 60x8mm 0.2mm 100mA",
            r"20 A m2; a core of 60x8mm is saturated at 5",
        ),
        ("coil 300 800x800mm 0.2mm 100mA", r"0\.8 m do not fit a craft of 0\.366 m"),
        ("rod 800 400x8mm 0.2mm 100mA", r"0\.4 m do not fit a craft"),
    ],
)
def test_a_torquer_that_the_craft_cannot_have_is_refused(tmp_path, rods, message):
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(size="12U", rods=rods), "")


@pytest.mark.parametrize(
    ("days", "fails", "warns"),
    [
        (3.0, False, False),
        (10.0, False, True),
        (-10.0, False, True),
        (400.0, True, True),
    ],
)
def test_elements_are_valid_for_days(days, fails, warns):
    block = block_class("environment_tle")()
    block.epoch_j2000 = block.epoch_tle_j2000 + 86400.0 * days
    if fails:
        with pytest.raises(
            BlockError, match="400 days after the epoch of its elements"
        ):
            list(block.foresee(0.0, 3600.0, frozenset()))
        return
    lines = list(block.foresee(0.0, 3600.0, frozenset()))
    assert any("10 days" in x for x in lines) == warns
