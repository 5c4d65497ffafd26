"""The exchange between components, on the gyrostat: accuracy, order, momentum, and
checks that fail when something is wrong. The authorities are monolithic solutions that
are not ours."""

from __future__ import annotations

import json
import math
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from benchmarks.validation import convergence
from benchmarks.validation.reference import Gyrostat
from desat.export.packing import pack_scenario
from desat.files.scenario import find
from desat.files.ssp import read
from desat.numbers.derived import pointing
from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError
from tests.conftest import ROOT

AUTHORITIES = ROOT / "tests" / "authorities"
CASES = {
    "gyrostat/full": "gyrostat_full.csv",
    "gyrostat/free": "gyrostat_free.csv",
    "gyrostat/stress": "gyrostat_stress_free.csv",
}


def authority(name: str):
    """(q, omega, h) each second."""
    table = np.loadtxt(AUTHORITIES / CASES[name], delimiter=",", skiprows=1)
    return table[:, 1:5], table[:, 5:8], table[:, 8:11]


def errors(run, name: str, step: float) -> tuple[float, float]:
    """Largest attitude error (rad) and wheel momentum error (N m s) at the whole
    seconds."""
    every = round(1.0 / step)
    q, _, h = authority(name)
    attitude = np.radians(
        pointing(run.results.values("spacecraft.q_bi")[::every], q)
    ).max()
    momentum = np.abs(run.results.values("wheels.h_wheel")[::every, :3] - h).max()
    return attitude, momentum


def residual(run) -> float:
    return run.manifest["numbers"]["momentum_residual"]["value"]


def test_scenario_has_the_numbers_of_the_authority():
    values = json.loads((AUTHORITIES / "gyrostat.json").read_text())
    parameters = execute("gyrostat/full", Options(stop=1.0)).manifest["parameters"]

    def value(component, name):
        return parameters[component][name]["value"]

    assert value("spacecraft", "inertia") == [
        x for row in values["inertia_total_with_locked_wheels"] for x in row
    ]
    for name, key in (
        ("motor_lag", "motor_lag_s"),
        ("viscous", "viscous"),
        ("coulomb", "coulomb"),
        ("friction_speed", "omega_eps"),
    ):
        assert value("wheels", name) == values["wheels"][key]
    assert (
        value("wheels", "inertia_wheel")[:3] == [values["wheels"]["spin_inertia"]] * 3
    )
    assert value("wheels", "h_start_wheel")[:3] == values["start"]["h_wheel"]
    assert value("spacecraft", "omega_start_body") == values["start"]["omega_bi_body"]
    control = values["controller"]
    assert value("controller", "kp") == 2 * control["kp"]
    assert value("controller", "kd") == control["kd"]
    assert value("controller", "ki") == control["ki"]
    assert value("controller", "torque_limit") == control["torque_limit"]
    field = values["field"]
    tilt, phase, k = field["tilt_rad"], field["phase_rad"], field["dipole_T_m3"]
    axis = (
        math.sin(tilt) * math.cos(phase),
        math.sin(tilt) * math.sin(phase),
        -math.cos(tilt),
    )
    assert value("environment", "dipole_earth") == pytest.approx(
        [k * x for x in axis], rel=1e-15
    )
    assert value("environment", "semi_major_axis") == values["orbit"]["radius"]
    assert value("environment", "inclination") == math.radians(
        values["orbit"]["inclination_deg"]
    )
    assert value("environment", "mu") == values["orbit"]["mu"]
    stress = execute("gyrostat/stress", Options(stop=1.0)).manifest["parameters"]
    assert stress["wheels"]["motor_lag"]["value"] == values["stress"]["motor_lag_s"]
    assert (
        stress["spacecraft"]["omega_start_body"]["value"]
        == values["stress"]["omega_bi_body"]
    )


@pytest.mark.study
@pytest.mark.parametrize("name", CASES)
def test_reference_is_the_authority(name):
    system, _ = prepare(name, Options()).or_raise()
    trajectory = Gyrostat(system).ideal()
    q, omega, h = authority(name)
    assert np.radians(pointing(trajectory.q, q)).max() < 1e-12
    assert np.abs(trajectory.omega - omega).max() < 1e-12
    assert np.abs(trajectory.h[:, :3] - h).max() < 1e-11


def test_accuracy_at_one_second():
    run = execute("gyrostat/full", Options(step=1.0))
    attitude, momentum = errors(run, "gyrostat/full", 1.0)
    assert attitude < 2e-7
    assert momentum < 5e-7


def test_accuracy_under_stress():
    attitude, _ = errors(execute("gyrostat/stress", Options()), "gyrostat/stress", 1.0)
    assert attitude < 1e-5


@pytest.mark.parametrize("step", [1.0, 0.5, 0.25, 0.125])
@pytest.mark.parametrize("name", ["gyrostat/free", "gyrostat/stress"])
def test_momentum_is_conserved_at_every_step(name, step):
    run = execute(name, Options(step=step))
    assert residual(run) <= 1e-12
    # without external torque the impulse is exactly zero: the residual is the
    # momentum's drift
    assert not run.results.values("spacecraft.impulse_eci").any()


@pytest.fixture(scope="module")
def study():
    return convergence.study(
        "gyrostat/full", Options(stop=30.0), steps=(1.0, 0.5, 0.25)
    )


@pytest.mark.slow
def test_observed_order(study):
    assert study["order"] >= 2.5
    rows = [r for r in study["rows"] if r["algorithm"] == "gauss_seidel"]
    assert [r["step"] for r in rows] == [1.0, 0.5, 0.25]
    assert all(r["momentum_drift"] <= 1e-12 for r in rows)
    assert rows[0]["attitude_error"] < 2e-7


def test_jacobi_against_the_reference_with_the_same_delays(study):
    """The delays are all that separates jacobi from the truth: against the ideal
    reference it errs by 1e-2 rad, against the delayed one it converges as we do."""
    rows = [r for r in study["rows"] if r["algorithm"] == "jacobi"]
    assert all(r["attitude_error"] > 1e-2 for r in rows)
    assert all(r["momentum_drift"] > 1e-3 for r in rows)
    delay_errors = [r["attitude_error_same_delays"] for r in rows]
    assert delay_errors[0] < 2e-7
    assert convergence.order([r["step"] for r in rows[1:]], delay_errors[1:]) >= 2.5


def run_corrupted(tmp_path, signal: str, factor: float, name: str = "gyrostat/full"):
    """The packed scenario with one connected signal scaled on its way, run from the
    folder."""
    package = pack_scenario(find(name))
    with zipfile.ZipFile(package) as archive:
        archive.extractall(tmp_path)
    ssd = tmp_path / "SystemStructure.ssd"
    lines = []
    count = 0
    for line in ssd.read_text(encoding="utf-8").splitlines():
        if f'startConnector="{signal}[' in line and 'endElement="spacecraft"' in line:
            line = line.replace(
                "/>",
                f'><ssc:LinearTransformation factor="{factor!r}"/></ssd:Connection>',
            )
            count += 1
        lines.append(line)
    assert count == 4
    ssd.write_text("\n".join(lines), encoding="utf-8")
    draft = read(tmp_path, Options())
    assert not draft.problems
    assert {c.factor for c in draft.connections} == {1.0, factor}
    return execute(str(tmp_path), Options())


def test_a_corrupted_slope_is_caught_by_the_attitude(tmp_path):
    run = run_corrupted(tmp_path, "tau_slope_wheel", 0.9)
    attitude, _ = errors(run, "gyrostat/full", 1.0)
    assert attitude > 2e-7
    assert residual(run) <= 1e-12, "a wrong slope moves momentum in time, it loses none"


def test_a_corrupted_mean_is_caught_by_the_residual(tmp_path):
    run = run_corrupted(tmp_path, "tau_mean_wheel", 1.0 + 1e-9)
    assert residual(run) > 1e-12


def test_an_actuator_without_slopes_still_conserves(tmp_path):
    """Slopes start at 0, so a foreign actuator may omit them."""
    run = run_corrupted(tmp_path, "tau_slope_wheel", 0.0)
    assert residual(run) <= 1e-12
    assert errors(run, "gyrostat/full", 1.0)[0] > 2e-7


def test_the_reference_says_what_it_does_not_know():
    options = Options(sets=["magnetometer.noise=1e-7"])
    system, _ = prepare("gyrostat/full", options).or_raise()
    with pytest.raises(
        DesatError, match=r"needs magnetometer.noise = 0.0, it is 1e-07"
    ):
        Gyrostat(system)
    system, _ = prepare("uosat12/table3-ocdc-ilqr-1", Options()).or_raise()
    with pytest.raises(
        DesatError, match="needs environment = environment_kepler, there is env"
    ):
        Gyrostat(system)


@pytest.mark.slow
def test_command():
    def apart(*arguments: str) -> subprocess.CompletedProcess[str]:
        command = [
            sys.executable,
            "-m",
            "benchmarks.validation",
            "convergence",
            *arguments,
        ]
        return subprocess.run(
            command, capture_output=True, text=True, cwd=ROOT, check=False
        )

    result = apart("gyrostat/free", "--steps", "1,0.5", "--stop", "20")
    assert result.returncode == 0, result.stderr
    assert "observed order (gauss_seidel): " in result.stdout
    bad = apart("gyrostat/free", "--steps", "0.3")
    assert bad.returncode == 2
    assert "is not a multiple of" in bad.stderr
