"""Independent masters on our packed files, unchanged, each in a process of its own."""

from __future__ import annotations

import importlib.util
import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import seen
from desat.export.packing import pack, pack_scenario
from desat.files.build import build
from desat.files.scenario import find, read_foreign
from desat.files.ssp import read
from desat.runs.checks import check_draft
from desat.runs.run import Options, execute
from tests import others
from tests.conftest import python, slow_after

STEPS = 60
SHORT = Options(algorithm="jacobi", stop=600.0)

LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
log_output_level(CosimLogLevel.ERROR)
path, wanted, steps = sys.argv[1], json.loads(sys.argv[2]), int(sys.argv[3])
execution = CosimExecution.from_ssp_file(path)
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
infos = {i.name.decode(): i for i in execution.slave_infos()}
rows = []
for _ in range(steps):
    assert execution.step()
    row = []
    for name, references in wanted:
        values = observer.last_real_values(infos[name].index, references)
        row += list(values)
    rows.append(row)
print("ROWS " + json.dumps(rows))
"""

ECOS = """
import ctypes, glob, json, os, sys, sysconfig
site = sysconfig.get_paths()["purelib"]
for pattern in ("../../libtbb.so.12", "*/libtbb.so.12"):
    for found in glob.glob(os.path.join(site, pattern)):
        ctypes.CDLL(found, mode=ctypes.RTLD_GLOBAL)
from ecospy import EcosSimulation
path, wanted = sys.argv[1], json.loads(sys.argv[2])
steps, step = int(sys.argv[3]), float(sys.argv[4])
rows = []
with EcosSimulation(ssp_path=path, step_size=step) as sim:
    sim.init(parameter_set="parameters")
    for _ in range(steps):
        sim.step(1)
        rows.append([sim.get_real(f"{c}::{v}") for c, v in wanted])
print("ROWS " + json.dumps(rows))
"""


def real_outputs(path):
    """Every Real output of every component: {component: {variable: reference}}."""
    system = read(path, Options())
    return {
        c.name: {
            s.name: s.reference for s in c.interface.of("output") if s.kind == "Real"
        }
        for c in system.components.values()
    }


def columns(run, outputs):
    series = []
    for component, variables in outputs.items():
        for element in variables:
            base, _, index = element.partition("[")
            values = run.results.values(f"{component}.{base}")
            series.append(values[:, int(index[:-1]) - 1] if index else values)
    return np.array(series).T[1:]


def rows_of(result):
    assert "ROWS " in result.stdout, result.stdout[-2000:] + result.stderr[-2000:]
    return np.array(json.loads(result.stdout.split("ROWS ")[1].splitlines()[0]))


# libcosim counts time in 2^-32 s, so that a step of 0.2 s, say, would not be the same
# there.
CASES = [
    "uosat12/table2-cccp-mec-3",
    "uosat12/table3-ocdc-ilqr-1",
    "uosat12/flight-ocdc-2",
    "gyrostat/full",
    "nadir_day/day-igrf",
    "uosat12/fig2-lqr-1",  # gain tables
    "uosat12/beyond-receding_horizon-ilqr-1",
    "integrated/mil-nadir",
    "space_telescope/mixed-me-nominal",
]


NATIVE = ["integrated/mil-nadir", "gyrostat/full"]
"""Those that are tried with native FMUs, too; the last one in Ecos as well."""
BOTH = [*((name, "python") for name in CASES), *((name, "native") for name in NATIVE)]


def write_package(name, kind, folder):
    if kind == "python":
        return pack_scenario(find(name))
    return pack_scenario(find(name), folder / "native.ssp", fmus=kind)


@pytest.mark.skipif(
    not importlib.util.find_spec("libcosimpy"), reason="libcosimpy not installable"
)
@pytest.mark.parametrize(("name", "kind"), slow_after(2, BOTH))
def test_libcosim_agrees(name, kind, tmp_path):
    path = write_package(name, kind, tmp_path)
    outputs = real_outputs(path)
    requests = [(c, list(v.values())) for c, v in outputs.items()]
    theirs = rows_of(python(LIBCOSIM, str(path), json.dumps(requests), str(STEPS)))
    mine = columns(execute(name, SHORT), outputs)[:STEPS]
    assert theirs.shape == mine.shape
    print("largest difference", np.abs(theirs - mine).max())
    assert np.abs(theirs - mine).max() <= 1e-12


@pytest.mark.skipif(
    not importlib.util.find_spec("ecospy"), reason="ecospy not installable"
)
@pytest.mark.parametrize(
    ("name", "kind", "reads_sets"),
    [
        *((name, "python", True) for name in CASES[1:4]),
        (NATIVE[-1], "native", True),
        (NATIVE[-1], "native", False),
        (CASES[1], "python", False),
    ],
)
def test_ecos_agrees(name, kind, reads_sets, tmp_path):
    """With the parameter set and without it: the FMUs start with its values."""
    path = write_package(name, kind, tmp_path)
    outputs = real_outputs(path)
    requests = [(c, v) for c, variables in outputs.items() for v in variables]
    run = execute(name, SHORT)
    step = str(run.manifest["step"])
    script = ECOS if reads_sets else ECOS.replace('parameter_set="parameters"', "")
    theirs = rows_of(python(script, str(path), json.dumps(requests), str(STEPS), step))
    mine = columns(run, outputs)[:STEPS]
    print("largest difference", np.abs(theirs - mine).max())
    assert np.abs(theirs - mine).max() <= 1e-12


FIRING = """
extends = "alsat1/firing-{law}"
[shared]
schedule_start = [{start}, 0, 0, 0, 0, 0, 0, 0]
schedule_duration = [12.25, 0, 0, 0, 0, 0, 0, 0]
"""


@pytest.mark.skipif(
    not importlib.util.find_spec("libcosimpy"), reason="libcosimpy not installable"
)
@pytest.mark.parametrize(("law", "start"), [("z-wheel", 20.5), ("ours", 20.0)])
def test_libcosim_agrees_through_a_firing_whose_edges_are_inside_steps(
    law, start, tmp_path
):
    """ours begins its firings at samples; another law's both edges are inside a step of
    1 s."""
    file = tmp_path / "firing.toml"
    file.write_text(FIRING.format(law=law, start=start), encoding="utf-8")
    path = pack_scenario(read_foreign(file), tmp_path / "firing.ssp")
    outputs = real_outputs(path)
    requests = [(c, list(v.values())) for c, v in outputs.items()]
    theirs = rows_of(python(LIBCOSIM, str(path), json.dumps(requests), str(STEPS)))
    run = execute(str(file), Options(algorithm="jacobi", stop=float(STEPS)))
    mine = columns(run, outputs)
    assert theirs.shape == mine.shape
    print("largest difference", np.abs(theirs - mine).max())
    assert np.abs(theirs - mine).max() <= 1e-12
    names = [f"{c}.{v}" for c, variables in outputs.items() for v in variables]
    torque = theirs[:, names.index("thrusters.tau_mean_thruster_body[2]")]
    assert len(set(torque[20:33])) == (
        3 if start % 1.0 else 2
    )  # within, and each edge's step
    assert torque.sum() == pytest.approx(
        1.5e-3 * 12.25, rel=1e-12
    )  # N m s, steps of 1 s


@pytest.mark.skipif(
    not importlib.util.find_spec("libcosimpy"), reason="libcosimpy not installable"
)
def test_libcosim_agrees_on_components_that_step_less_often(tmp_path):
    """The lcm rule: an output moves when its source and its target are both due."""
    draft = build(find("gyrostat/full"), Options())
    for name, step_ratio in {"controller": 2, "magnetometer": 3, "manager": 6}.items():
        component = replace(draft.components[name], step_ratio=step_ratio)
        component.parameters["sample_time"] = 0.0
        draft.components[name] = component
    system, _ = check_draft(draft).or_raise()
    path = tmp_path / "multirate.ssp"
    pack(system, path)
    assert read(path, Options()).components["manager"].step_ratio == 6
    outputs = real_outputs(path)
    requests = [(c, list(v.values())) for c, v in outputs.items()]
    theirs = rows_of(python(LIBCOSIM, str(path), json.dumps(requests), str(STEPS)))
    mine = columns(execute(str(path), SHORT), outputs)[:STEPS]
    assert np.abs(theirs - mine).max() <= 1e-12


@pytest.mark.parametrize("tool", ["libcosim", "Ecos"])
def test_where_an_fmu_fails_they_do_what_the_page_says(tool):
    """`python tests/others.py` tries all failures."""
    if not importlib.util.find_spec(others.PACKAGES[tool]):
        pytest.skip(f"{others.PACKAGES[tool]} not installable")
    stored_outcomes = seen.known()["others"][tool]
    outcomes = others.all_of(tool, ("SEGFAULT", "EXIT_0", "NOT_FINITE"))
    assert outcomes == {name: stored_outcomes[name] for name in outcomes}
