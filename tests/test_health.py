"""What a run says of itself whatever its scenario requires: management that is worse than none,
an attitude that was lost, sensors that never measured, thrusters that never fire, accounts of one
figure that differ. Each was green before."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from desat.analyses import management
from desat.files import new_craft
from desat.files.new_craft import Wanted
from desat.fmus.registry import block_class, names
from desat.runs.prepare import prepare
from desat.runs.run import execute
from desat.system.errors import DesatError, Exit
from desat.system.options import Options

DAY = "nadir_day/day-dipole"
WORSE = '''"""A law with the sign of its cross product the wrong way round."""

from __future__ import annotations

from desat.components.bases.dumping import TorquerDumping
from desat.components.contract.block import Parameter, Vec3
from desat.components.laws import cross_product


class WorseLaw(TorquerDumping):
    """M = -gain (h x B) / |B|^2"""

    gain: float = Parameter("1/s", "gain", start=1e-3)

    def dipole(self, elapsed: float, h: Vec3) -> Vec3 | None:
        return cross_product.normalised(h, self.b_body, -self.gain)
'''


@pytest.fixture(scope="module")
def craft(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("crafts") / "my12u"
    wanted = Wanted(size="12U", altitude="400km", inclination="51.6deg", rods="0.2")
    new_craft.write(folder, wanted, "desat new craft")
    return folder


# --- what management takes out ------------------------------------------------------------------


def test_a_law_that_is_worse_than_none_is_not_met(craft, tmp_path):
    file = tmp_path / "worse_law.py"
    file.write_text(WORSE)
    given = Options(sources=[f"manager={file}"], stop=9000.0, sets=["manager.gain=1e-4"])
    run = execute(str(craft), given)
    (line,) = run.manifest.unmet
    assert "in the second half of the run, without management it would be" in line
    assert run.code == Exit.UNMET
    assert all(v.met for v in run.manifest.verdicts.values()), "its requirements do not see it"


def test_what_there_would_be_without_management_is_what_flies_without(craft):
    """The estimate of a managed run beside the run whose manager is off."""
    managed = execute(str(craft), Options(stop=43200.0))
    off = execute(str(craft), Options(stop=43200.0, sets=["manager.enable=false"]))
    said = managed.manifest.numbers["unmanaged_rms"].value
    assert said == pytest.approx(off.manifest.numbers["left_rms"].value, rel=0.01)
    assert managed.manifest.numbers["left_rms"].value < 0.5 * said
    assert managed.code == Exit.COMPLETED
    assert off.manifest.unmet == [], "a manager that is off is not to hold anything"


def test_thrusters_that_empty_the_wheels_are_management():
    """Their impulse is taken off what comes in, as the coils' is."""
    name = "uosat12/table3-ocdc-ilqr-1"
    run = execute(name, Options())
    off = execute(name, Options(sets=["manager.enable=false"]))
    said = run.manifest.numbers["unmanaged_rms"].value
    assert run.results.values("thrusters.on_time")[-1] > 1.0
    assert said == pytest.approx(off.manifest.numbers["left_rms"].value, rel=0.01)


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
    with pytest.raises(DesatError, match="no law turns a bias with it; only one along the orbit's"):
        case.or_raise()


def test_a_bias_along_the_orbits_normal_is_kept(craft):
    given = Options(sets=["manager.h_target_body=0,-3e-3,0"], stop=43200.0)
    run = execute(str(craft), given)
    h = run.results.values("wheels.h_wheel")
    axes = np.reshape(run.manifest.parameters["wheels"]["axes_wheel"].value, (3, 4))
    late = (h @ axes.T)[len(h) // 2 :].mean(axis=0)
    assert late == pytest.approx([0.0, -3e-3, 0.0], abs=6e-4)
    assert run.code == Exit.COMPLETED


def test_a_bias_of_a_craft_that_stays_in_eci_is_not_refused():
    given = Options(blocks=True, sets=["manager.h_target_body=3,0,0"])
    prepare("space_telescope/ours-nominal", replace(given)).or_raise()


# --- sensors, attitude, wheels ------------------------------------------------------------------


def test_a_star_tracker_that_looks_at_the_earth(desat, tmp_path):
    """It never measures, and the attitude that it was to keep is lost: 1, and both are said."""
    done = desat("run", "nadir_day/star-tracker-prompt", "--stop", "5000", "--json",
                 "--set", "star_tracker.boresight_body=0,0,1",
                 "--out", str(tmp_path / "run"))  # fmt: skip
    assert done.returncode == Exit.UNMET, done.stderr
    unmet = json.loads(done.stdout)["unmet"]
    assert any("star_tracker: it was never valid (lost_to = 2" in line for line in unmet)
    assert any("the attitude was lost" in line for line in unmet)


def test_a_star_tracker_that_sees_is_not_warned_of():
    run = execute("nadir_day/star-tracker-prompt", Options(stop=600.0))
    assert run.manifest.unmet == []
    assert not any("Sun" in w for w in run.manifest.warnings)


@pytest.mark.parametrize("name", ["magnetometer", "gyro", "determination", "tachometers"])
def test_a_sensor_that_a_scenario_has_fail_is_not_told_of(craft, name):
    def lines(values):
        run = execute(str(craft), Options(stop=100.0, values=values))
        return [x for x in run.manifest.unmet if "never valid" in x]

    assert lines({f"{name}.fail_time": 0.0}) == []
    assert lines({}) == []


def test_more_dipole_than_wheels_hold(tmp_path, desat):
    """7 A m2 typed into a craft: `check` and `run` say what `new craft` refuses."""
    desat("new", "craft", str(tmp_path / "six"), "--size", "6U", check=True)
    file = tmp_path / "six" / "craft.toml"
    line = next(x for x in file.read_text().splitlines() if x.startswith("residual_dipole_body"))
    file.write_text(file.read_text().replace(line, "residual_dipole_body = [7.0, 0.0, 0.0]"))
    checked = desat("check", str(tmp_path / "six"))
    text = " ".join(checked.stderr.split())
    assert "mN m s in and out of the fullest within each orbit, which no rods prevent" in text
    run = execute(str(tmp_path / "six"), Options(stop=43200.0))
    assert run.code == Exit.UNMET
    assert any("the attitude was lost" in line for line in run.manifest.unmet)
    assert any("at its speed limit" in w for w in run.manifest.warnings)


def test_every_quaternion_is_of_size_one_from_the_start():
    for name in names():
        block = block_class(name)()
        outputs = [v.name for v in block.variables
                   if v.causality == "output" and v.name[:2] == "q_" and v.size == 4]  # fmt: skip
        if not outputs:
            continue
        block.start()
        block.output(0.0)
        for output in outputs:
            assert np.linalg.norm(getattr(block, output)) == pytest.approx(1.0), (name, output)


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


# --- wheels that are left, thrusters, accounts --------------------------------------------------


def test_two_wheels_that_are_left_are_told_of(craft):
    left = {"spacecraft": 0, "wheels": 0}
    spin = prepare(str(craft), Options()).or_raise()[0].components["wheels"].parameters
    inertia = [spin["inertia_wheel[1]"], 0.0, spin["inertia_wheel[3]"], 0.0]
    two = Options(values={f"{owner}.inertia_wheel": inertia for owner in left})
    (line,) = [w for w in prepare(str(craft), two).checked.warnings if "2 wheels" in w]
    assert "none turns the craft about (" in line


def test_the_third_wheel_of_three_that_fails_is_told_of(tmp_path, desat):
    desat("new", "craft", str(tmp_path / "three"), "--wheels", "3 axes 30mNms", check=True)
    given = Options(sets=["wheels.failed=2", "wheels.failed_from=100"])
    lines = prepare(str(tmp_path / "three"), given).checked.warnings
    assert any("from 100 s on no wheel turns the craft about (0, 1, 0)" in x for x in lines)
    assert not any("no wheel turns" in x for x in
                   prepare(str(tmp_path / "three"), Options()).checked.warnings)  # fmt: skip


def test_thrusters_whose_pulses_are_all_too_short(tmp_path, desat):
    """What is commanded and never fires is told of: 1."""
    desat("new", "craft", str(tmp_path / "jets"), "--thrusters", "10mN", check=True)
    sets = ["manager.split=dct", "manager.g_rate=1e-5", "manager.sample_time=10",
            "wheels.h_start_wheel=0.005,0.005,0.005,0.005"]  # fmt: skip
    given = Options(sources=["manager=manager_combined"], sets=sets, stop=20000.0)
    run = execute(str(tmp_path / "jets"), given)
    assert run.results.values("thrusters.on_time")[-1] == 0.0
    assert any("N m s, never fired" in line for line in run.manifest.unmet)
    assert run.code == Exit.UNMET
    faster = replace(given, sets=[sets[0], "manager.g_rate=1e-3", *sets[2:]])
    assert not any("never fired" in x for x in
                   execute(str(tmp_path / "jets"), faster).manifest.unmet)  # fmt: skip


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
    with pytest.raises(DesatError, match=r"specific_impulse = 220 s, but thrusters\.specific_"):
        prepare(str(file.parent), Options(sets=sets)).or_raise()
    same = [*sets, "thrusters.specific_impulse=220"]
    prepare(str(file.parent), Options(sets=same)).or_raise()
    drag = [*same, "environment.area_drag=1", "environment.mass=20"]
    lines = prepare(str(file.parent), Options(sets=drag)).checked.warnings
    assert any("area_drag = 1 m2, but spacecraft.area_drag" in x for x in lines)
