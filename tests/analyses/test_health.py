"""What a run says of itself whatever its scenario requires: management that is worse
than none, an attitude that was lost, sensors that never measured, thrusters that never
fire, accounts of one figure that differ. Each was green before."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from desat.analyses import management
from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.fmus.registry import block_class, names
from desat.numbers.measures import MEASURES
from desat.numbers.verdicts import describe_verdicts
from desat.runs.prepare import prepare
from desat.runs.run import execute
from desat.system.errors import DesatError, Exit
from desat.system.options import Options
from desat.system.sensors import noise_of

DAY = "nadir_day/day-dipole"
WORSE = '''"""A law with the sign of its cross product the wrong way round."""

from __future__ import annotations

from desat.components.bases.dumping import TorquerDumping
from desat.components.contract.block import Parameter, Vec3
from desat.components.laws import cross_product


class WorseLaw(TorquerDumping):
    """M = -gain (h x B) / |B|^2"""

    gain: float = Parameter("1/s", "gain", start=1e-3)

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        return cross_product.normalised(h, self.b_body, -self.gain)
'''


@pytest.fixture(scope="module")
def craft(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("crafts") / "my12u"
    facts = CraftFacts(
        size="12U",
        altitude="400km",
        inclination="51.6deg",
        rods="0.2",
        residual_dipole="0.09",
    )
    new_craft.write(folder, facts, "desat new craft")
    return folder


# --- what management takes out --------------------------------------------------------


def test_a_law_that_is_worse_than_none_is_not_met(craft, tmp_path):
    file = tmp_path / "worse_law.py"
    file.write_text(WORSE)
    options = Options(
        sources=[f"manager={file}"], stop=9000.0, sets=["manager.gain=1e-4"]
    )
    run = execute(str(craft), options)
    (line,) = run.manifest.unmet
    assert "in the second half of the run, without management it would be" in line
    assert run.code == Exit.UNMET
    assert all(v.met for v in run.manifest.verdicts.values()), (
        "its requirements do not see it"
    )
    answer = describe_verdicts(run.manifest.verdicts, len(run.manifest.unmet))
    assert answer == "Does not hold: 1 check of the run not met"


def test_what_there_would_be_without_management_is_what_flies_without(craft):
    """The estimate of a managed run beside the run whose manager is off."""
    managed_run = execute(str(craft), Options(stop=43200.0))
    off = execute(str(craft), Options(stop=43200.0, sets=["manager.enable=false"]))
    estimate = managed_run.manifest.numbers["unmanaged_rms"].value
    assert estimate == pytest.approx(off.manifest.numbers["left_rms"].value, rel=0.01)
    assert managed_run.manifest.numbers["left_rms"].value < 0.5 * estimate
    assert managed_run.code == Exit.COMPLETED
    assert off.manifest.unmet == [], "a manager that is off is not to hold anything"


def test_thrusters_that_empty_the_wheels_are_management():
    """Their impulse is taken off what comes in, as the coils' is."""
    name = "uosat12/table3-ocdc-ilqr-1"
    run = execute(name, Options())
    off = execute(name, Options(sets=["manager.enable=false"]))
    estimate = run.manifest.numbers["unmanaged_rms"].value
    assert run.results.values("thrusters.on_time")[-1] > 1.0
    assert estimate == pytest.approx(off.manifest.numbers["left_rms"].value, rel=0.01)


def test_which_laws_hold():
    """Laws that brake, start up or empty until an end are not held to it."""

    def holds(target, **values):
        system, _ = prepare(target, Options(blocks=True, values=values)).or_raise()
        return management.applies(system).holds

    assert holds(DAY)
    assert holds("space_telescope/open-me-nominal")
    assert not holds("hausat2/start-up-ours")
    assert not holds("uosat12/table3-ocdc-ilqr-1", **{"manager.law": "lqr"})


@pytest.mark.parametrize("target", ["3e-3,0,0", "0,3e-3,1e-3", "0,0,-1e-3"])
def test_a_bias_that_would_have_to_turn_with_the_craft_is_refused(craft, target):
    case = prepare(str(craft), Options(sets=[f"manager.h_target_body={target}"]))
    with pytest.raises(
        DesatError, match="no law turns a bias with it; only one along the orbit's"
    ):
        case.or_raise()


def test_a_bias_along_the_orbits_normal_is_kept(craft):
    options = Options(sets=["manager.h_target_body=0,-3e-3,0"], stop=43200.0)
    run = execute(str(craft), options)
    h = run.results.values("wheels.h_wheel")
    axes = np.reshape(run.manifest.parameters["wheels"]["axes_wheel"].value, (3, 4))
    late = (h @ axes.T)[len(h) // 2 :].mean(axis=0)
    assert late == pytest.approx([0.0, -3e-3, 0.0], abs=7e-4)
    assert run.code == Exit.COMPLETED


def test_a_bias_of_a_craft_that_stays_in_eci_is_not_refused():
    options = Options(blocks=True, sets=["manager.h_target_body=3,0,0"])
    prepare("space_telescope/ours-nominal", replace(options)).or_raise()


# --- sensors, attitude, wheels --------------------------------------------------------


def test_a_star_tracker_that_looks_at_the_earth(desat, tmp_path):
    """It never measures, and the attitude that it was to keep is lost: 1, and both are
    said."""
    command = desat(
        "run",
        "nadir_day/star-tracker-prompt",
        "--stop",
        "5000",
        "--json",
        "--set",
        "star_tracker.boresight_body=0,0,1",
        "--out",
        str(tmp_path / "run"),
    )
    assert command.returncode == Exit.UNMET, command.stderr
    unmet = json.loads(command.stdout)["unmet"]
    assert any(
        "star_tracker: it was never valid (lost_to = 2" in line for line in unmet
    )
    assert any("the attitude was lost" in line for line in unmet)


def test_a_star_tracker_that_sees_is_not_warned_of():
    run = execute("nadir_day/star-tracker-prompt", Options(stop=600.0))
    assert run.manifest.unmet == []
    assert not any("Sun" in w for w in run.manifest.warnings)


@pytest.mark.parametrize(
    "name", ["magnetometer", "gyro", "determination", "tachometers"]
)
def test_a_sensor_that_a_scenario_has_fail_is_not_told_of(craft, name):
    def lines(values):
        run = execute(str(craft), Options(stop=100.0, values=values))
        return [x for x in run.manifest.unmet if "never valid" in x]

    assert lines({f"{name}.fail_time": 0.0}) == []
    assert lines({}) == []


@pytest.mark.study
def test_more_dipole_than_wheels_hold(tmp_path, desat):
    """7 A m2 typed into a craft: `check` and `run` say what `new craft` refuses."""
    desat("new", "craft", str(tmp_path / "six"), "--size", "6U", check=True)
    file = tmp_path / "six" / "craft.toml"
    line = next(
        x for x in file.read_text().splitlines() if x.startswith("residual_dipole_body")
    )
    file.write_text(
        file.read_text().replace(line, "residual_dipole_body = [7.0, 0.0, 0.0]")
    )
    command = desat("check", str(tmp_path / "six"))
    text = " ".join(command.stderr.split())
    assert (
        "mN m s in and out of the fullest within each orbit, which no rods prevent"
        in text
    )
    run = execute(str(tmp_path / "six"), Options(stop=14400.0))
    assert run.code == Exit.UNMET
    assert any("the attitude was lost" in line for line in run.manifest.unmet)
    assert any("at its speed limit" in w for w in run.manifest.warnings)


def test_every_quaternion_is_of_size_one_from_the_start():
    for name in names():
        block = block_class(name)()
        outputs = [
            v.name
            for v in block.variables
            if v.causality == "output" and v.name[:2] == "q_" and v.size == 4
        ]
        if not outputs:
            continue
        block.start()
        block.output(0.0)
        for output in outputs:
            assert np.linalg.norm(getattr(block, output)) == pytest.approx(1.0), (
                name,
                output,
            )


@pytest.mark.parametrize("delay", [0.0, 2.0])
def test_a_star_tracker_that_was_never_valid_says_no_quaternion_of_zeros(delay):
    block = block_class("star_tracker")()
    block.boresight_body, block.earth_exclusion = (-1.0, 0.0, 0.0), 0.5  # r is along x
    block.sample_time, block.delay = 1.0, delay
    block.start()
    for k in range(5):
        assert not block.valid
        assert block.q_meas_bi == (0.0, 0.0, 0.0, 1.0)
        block.advance(float(k), 1.0)


# --- wheels that are left, thrusters, accounts ----------------------------------------


def test_two_wheels_that_are_left_are_told_of(craft):
    own_value = prepare(str(craft), Options()).or_raise()[0].components["wheels"].values
    remaining = [1.0, 0.0, 1.0, 0.0]
    inertia = [
        x * k for x, k in zip(own_value["inertia_wheel"], remaining, strict=True)
    ]
    axes = [x * remaining[i % 4] for i, x in enumerate(own_value["axes_wheel"])]
    spin = f"shared.inertia_wheel={inertia}"
    with pytest.raises(DesatError, match=r"column 2 = .*, but inertia_wheel\[2\] = 0"):
        prepare(str(craft), Options(sets=[spin])).or_raise()
    two = Options(sets=[spin, f"shared.axes_wheel={axes}"])
    (line,) = [w for w in prepare(str(craft), two).warnings if "2 wheels" in w]
    assert "none of them gives torque about (" in line


def test_the_third_wheel_of_three_that_fails_is_told_of(tmp_path, desat):
    desat(
        "new", "craft", str(tmp_path / "three"), "--wheels", "3 axes 30mNms", check=True
    )
    for sets in (
        ["wheels.failed=2", "wheels.failed_from=100"],
        ["manager.wheels_out=2", "manager.out_from=100"],
    ):
        lines = prepare(str(tmp_path / "three"), Options(sets=sets)).warnings
        assert any(
            "from 100 s on no wheel gives torque about (0, 1, 0)" in x for x in lines
        )
    assert not any(
        "no wheel turns" in x
        for x in prepare(str(tmp_path / "three"), Options()).warnings
    )


def test_thrusters_whose_pulses_are_all_too_short(tmp_path, desat):
    """What is commanded and never fires is told of: 1."""
    desat("new", "craft", str(tmp_path / "jets"), "--thrusters", "10mN", check=True)
    sets = [
        "manager.split=dct",
        "manager.g_rate=1e-5",
        "manager.sample_time=10",
        "wheels.h_start_wheel=0.005,0.005,0.005,0.005",
        "thrusters.carried=false",
    ]
    options = Options(sources=["manager=manager_combined"], sets=sets, stop=6000.0)
    run = execute(str(tmp_path / "jets"), options)
    assert run.results.values("thrusters.on_time")[-1] == 0.0
    assert any("N m s, never fired" in line for line in run.manifest.unmet)
    assert run.code == Exit.UNMET
    faster = replace(options, sets=[sets[0], "manager.g_rate=1e-3", *sets[2:]])
    assert not any(
        "never fired" in x
        for x in execute(str(tmp_path / "jets"), faster).manifest.unmet
    )


def test_two_accounts_of_propellant_are_refused(tmp_path, desat):
    """The mass that an orbit loses is by the specific impulse of what fires."""
    desat("new", "craft", str(tmp_path / "burns"), "--thrusters", "50mN", check=True)
    file = tmp_path / "burns" / "craft.toml"
    text = file.read_text().replace("environment_kepler", "environment_propagated")
    text = "\n".join(x for x in text.splitlines() if not x.startswith("j2 = "))
    file.write_text(
        text.replace(
            "[shared]",
            """[wiring]
"environment.force_mean_thruster_body" = "thrusters.force_mean_thruster_body"
"environment.q_bi" = "spacecraft.q_bi"
"environment.omega_bi_body" = "spacecraft.omega_bi_body"

[shared]""",
        )
    )
    sets = ["environment.firings=true", "environment.specific_impulse=220"]
    with pytest.raises(
        DesatError, match=r"specific_impulse = 220 s, but thrusters\.specific_"
    ):
        prepare(str(file.parent), Options(sets=sets)).or_raise()
    same = [*sets, "thrusters.specific_impulse=220"]
    prepare(str(file.parent), Options(sets=same)).or_raise()
    drag = [*same, "environment.area_drag=1", "environment.mass=20"]
    lines = prepare(str(file.parent), Options(sets=drag)).warnings
    assert any("area_drag = 1 m2, but a side = 0.02263 to 0.14205" in x for x in lines)


# --- laws that can do nothing, and laws that are told ---------------------------------


@pytest.mark.parametrize(
    ("target", "manager", "text"),
    [
        (
            "hausat2/start-up-ours",
            "manager_predictive",
            "needs wheels about three axes",
        ),
        (
            "alsat1/ours-one-wheel",
            "manager_predictive",
            "needs wheels about three axes",
        ),
        ("alsat1/firing-ours", "manager_predictive", "tau_ctrl_body is unconnected"),
        ("alsat1/firing-ours", "manager_cross_product", "tau_ctrl_body is unconnected"),
        (
            DAY,
            "manager_magnetic",
            r"needs tables made for one craft.*gain_table, offset_table are 0",
        ),
        (DAY, "manager_preview", "its tables are missing"),
    ],
)
def test_a_law_that_can_do_nothing_is_refused(target, manager, text):
    case = prepare(target, Options(sources=[f"manager={manager}"]))
    with pytest.raises(DesatError, match=text):
        case.or_raise()


@pytest.mark.slow
def test_the_predictive_law_is_told_what_the_sensors_have(tmp_path, desat):
    """It was flown with another craft's noise, which put it seventh of eight."""
    facts = CraftFacts(
        sso="600km", mass="150kg", box="0.8,0.8,1.2", wheels="4 pyramid 4Nms", rods="30"
    )
    new_craft.write(tmp_path / "agile", facts, "desat new craft")
    target = str(tmp_path / "agile")
    command = desat(
        "compare",
        target,
        "--laws",
        "cross product,predictive",
        "--json",
        "--stop",
        "17400",
        cwd=tmp_path,
    )
    assert command.returncode == 0, command.stderr
    untold = prepare(target, Options(sources=["manager=manager_predictive"]))
    assert any(
        "manager.h_noise = 0.0001 N.m.s, but the craft's sensors have 0.004" in line
        for line in untold.warnings
    )
    rows = {row["name"]: row for row in json.loads(command.stdout)["laws"]}
    assert "craft.h_noise = 0.004" in json.dumps(rows["predictive"])
    results = {f"manager.{n}": x for n, x in noise_of(untold.or_raise()[0]).items()}
    both = [
        execute(target, replace(untold.options, stop=17400.0, values=v))
        for v in ({}, results)
    ]
    fill = [run.manifest.numbers["largest_momentum"].value for run in both]
    assert fill[1] < 0.8 * fill[0]


# --- detumbling -----------------------------------------------------------------------


@pytest.mark.study
@pytest.mark.parametrize(
    "inputs",
    [
        {"size": "3U", "altitude": "721.863km", "inclination": "90deg", "rods": "0.2"},
        {
            "size": "1U",
            "altitude": "500km",
            "inclination": "72.58deg",
            "rods": "0.0915",
        },
        {"size": "6U", "sso": "800km"},
    ],
    ids=lambda g: g["size"],
)
def test_detumbling_is_within_a_third_of_the_quickest_gain(tmp_path, inputs):
    """It was seven to ten times as slow for the first of these."""
    new_craft.write(tmp_path / "c", CraftFacts(**inputs), "desat new craft")
    target = str(tmp_path / "c" / "detumbling.toml")
    own_value = execute(target, Options()).manifest.numbers
    system, _ = prepare(target, Options()).or_raise()
    gain = system.components["manager"].values["gain"]
    others = [
        execute(target, Options(values={"manager.gain": k * gain}, stop=20000.0))
        for k in (0.4, 0.7, 1.5, 2.5)
    ]
    times = [run.manifest.numbers["detumbled"].value for run in others]
    assert own_value["detumbled"].value <= 1.3 * min(x for x in times if x is not None)
    assert (
        0.0 < own_value["least_braking"].value / 3600.0 < own_value["detumbled"].value
    )


# --- numbers are of all rows ----------------------------------------------------------

ROWS = (
    "uosat12/table3-ocdc-ilqr-1",
    "integrated/mil-nadir",
    "hausat2/detumbling-ours",
    "alsat1/momentum-solar",
    "space_telescope/closed-me-nominal",
    "gyrostat/light",
    "plant/light",
    DAY,
)


@pytest.mark.parametrize("target", [*ROWS, "craft"])
def test_what_is_kept_of_the_rows_changes_no_number(craft, tmp_path, desat, target):
    """All numbers, verdicts and exit codes of a run whose every tenth row is kept."""
    target = str(craft) if target == "craft" else target
    stop = {DAY: 12000.0, str(craft): 12000.0}.get(target, 3000.0)
    runs = [execute(target, Options(stop=stop, every=n)) for n in (1, 10)]
    full, thin = (run.manifest for run in runs)
    assert full.numbers == thin.numbers
    assert full.verdicts == thin.verdicts
    assert full.unmet == thin.unmet
    assert runs[0].code == runs[1].code
    saved_times = runs[1].results.times()
    assert saved_times.tolist() == runs[0].results.times()[::10].tolist()


def test_a_requirement_is_judged_by_all_rows(craft, tmp_path, desat):
    """The largest momentum was that of the rows that were kept."""
    full = (
        execute(str(craft), Options(stop=6000.0))
        .manifest.numbers["largest_momentum"]
        .value
    )
    file = craft / "tight.toml"
    file.write_text(
        f'extends = "nominal"\n[requirements.momentum]\nnumber = "largest_momentum"\n'
        f"max = {0.9999 * full}\n"
    )
    for every in ("1", "10"):
        command = desat(
            "run",
            str(file),
            "--stop",
            "6000",
            "--every",
            every,
            "--out",
            str(tmp_path / every),
        )
        assert command.returncode == Exit.UNMET, command.stderr


def test_what_is_not_recorded_is_not_checked(craft):
    run = execute(str(craft), Options(stop=3000.0, record=("manager.*",)))
    answer = run.manifest.not_checked
    assert answer["largest_momentum"] == "not recorded: wheels.h_wheel"
    assert answer["sum_rms"].startswith("not recorded: ")
    assert not {"largest_momentum", "sum_rms", "pointing"} & run.manifest.numbers.keys()
    assert run.manifest.verdicts == {}


def test_rms_is_over_time():
    """Of the square between rows that are not evenly apart as well; a mean over rows is
    not."""
    times = np.array([0.0, 1.0, 2.0, 10.0])
    assert management._rms(np.array([2.0, 2.0, 2.0, 2.0]), times) == 2.0
    assert management._rms(np.array([0.0, 0.0, 0.0, 3.0]), times) == pytest.approx(
        np.sqrt(0.5 * 9.0 * 8.0 / 10.0)
    )


def test_dumps_are_counted_between_the_first_and_the_last():
    """Neither the filling before the first counts nor what comes after the last."""
    week = 7 * 86400.0
    times = np.arange(0.0, 60.0 * 86400.0, 3600.0)
    dumps = np.zeros(len(times))
    for day in (11.0, 18.62, 26.24, 33.86, 41.48, 49.1):
        dumps[times >= day * 86400.0] += 0.5
        dumps[times >= day * 86400.0 + 3600.0] += 0.5  # over two rows
    step_count = MEASURES["steps_in"](times, dumps[:, None], week)
    assert step_count == pytest.approx(7.0 / 7.62, rel=2e-3)
    assert MEASURES["growth_in"](times, dumps[:, None], week) < 0.8
    assert np.isnan(MEASURES["steps_in"](times, 0.0 * dumps[:, None], week))


def test_a_law_that_is_worse_than_none_comes_last(craft, tmp_path, desat):
    """`compare` ranks it behind all that leave less, whatever it is ranked by."""
    file = tmp_path / "worse_law.py"
    file.write_text(WORSE)
    command = desat(
        "compare",
        str(craft),
        "--laws",
        "cross product",
        "--law",
        str(file),
        "--json",
        "--by",
        "energy",
        "--stop",
        "9000",
        "--set",
        "manager.gain=1e-4",
        cwd=tmp_path,
    )
    rows = json.loads(command.stdout)["laws"]
    assert [row["name"] for row in rows] == ["cross product", "worse law"]
    assert not rows[0]["not_met"]
    assert any("without management it would be" in line for line in rows[1]["not_met"])
