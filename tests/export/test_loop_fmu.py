"""The loop of a scenario as one FMU: every series bit by bit that of a run, in any
host."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.validation import validate_fmu

from desat.export.loop_fmu import LoopEnds, export
from desat.fmus import native
from desat.fmus.compiler import compiler
from desat.runs.prepare import prepare
from desat.runs.run import Options, Run, execute
from desat.system.errors import DesatError
from desat.system.interface import base_name
from tests.conftest import ROOT, python, slow_after

STEPS = 200
ONE_OF_EACH = [
    "alsat1/basin-inverted",
    "gyrostat/stress",
    "hausat2/along-field",
    "integrated/mil-nadir",
    "nadir_day/day-dipole",
    "plant/light",
    "space_telescope/closed-cp-nominal",
    "uosat12/table3-ocdc-ilqr-1",
]


class Loop:
    """An FMU of a loop through fmpy."""

    def __init__(
        self, path: Path, folder: Path, start: float = 0.0, **starts: float
    ) -> None:
        description = fmpy.read_model_description(path)
        self.variables = {v.name: v for v in description.modelVariables}
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=fmpy.extract(path, str(folder)),
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="loop",
        )
        self.step = float(description.defaultExperiment.stepSize)
        self.fmu.instantiate()
        self.set(starts)
        self.fmu.setupExperiment(startTime=start)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        self.t = start

    def set(self, values: dict[str, float]) -> None:
        for name, value in values.items():
            v = self.variables[name]
            getattr(self.fmu, f"set{v.type}")([v.valueReference], [value])

    def outputs(self) -> dict[str, float]:
        values: dict[str, float] = {}
        for kind in ("Real", "Integer", "Boolean"):
            of = [
                v
                for v in self.variables.values()
                if v.causality == "output" and v.type == kind
            ]
            raw_values = (
                getattr(self.fmu, f"get{kind}")([v.valueReference for v in of])
                if of
                else []
            )
            values |= {v.name: float(x) for v, x in zip(of, raw_values, strict=True)}
        return values

    def advance(self, steps: int = 1) -> dict[str, float]:
        self.fmu.doStep(self.t, steps * self.step)
        self.t += steps * self.step
        return self.outputs()

    def close(self) -> None:
        self.fmu.freeInstance()


def columns(run: Run) -> dict[str, tuple[np.ndarray, bool]]:
    """Every element of a run's series, and whether it is of the interval class."""
    elements = {}
    for name in run.results.names():
        values, is_interval = (
            run.results.values(name),
            run.results.attribute(name, "class") == "interval",
        )
        flat = values.reshape(len(values), -1)
        for i in range(flat.shape[1]):
            elements[name, i] = flat[:, i].astype(float), is_interval
    return elements


def differing(path: Path, run: Run, folder: Path, steps: int) -> tuple[int, list[str]]:
    """The number of series compared, and those that differ in a bit."""
    loop, series = Loop(path, folder), columns(run)
    rows = [loop.outputs()] + [loop.advance() for _ in range(steps)]
    loop.close()
    places: dict[str, int] = {}
    wrong, series_count = [], 0
    for element in rows[0]:
        name = base_name(element)
        if name == "fault":
            continue
        i = places[name] = places.get(name, -1) + 1
        want, is_interval = series[name, i]
        fmu_values = np.array([row[element] for row in rows])
        # after step k: states of t_k+1, interval values of [t_k, t_k+1)
        a, b = (
            (fmu_values[1:], want[:steps])
            if is_interval
            else (fmu_values, want[: steps + 1])
        )
        series_count += 1
        if a.tobytes() != b.tobytes():
            wrong.append(element)
    return series_count, wrong


def short(name: str, steps: int = STEPS, **options: Any) -> Options:
    """So many steps of a scenario, or all that it has."""
    system, _ = prepare(name, Options()).or_raise()
    return Options(
        stop=system.start + min(steps, system.steps) * system.step, **options
    )


@pytest.fixture(autouse=True)
def _quickly_compiled(monkeypatch):
    """The same bits in a third of the time."""
    monkeypatch.setattr(
        native, "FLAGS", tuple("-O1" if f == "-O3" else f for f in native.FLAGS)
    )


@pytest.mark.parametrize("name", slow_after(2, ONE_OF_EACH))
def test_every_series_is_that_of_a_run_bit_by_bit(name, tmp_path):
    options = short(name)
    path = export(name, options, LoopEnds(outputs=["*"]), tmp_path / "loop.fmu")
    run = execute(name, options, None)
    assert run.ok
    series_count, wrong = differing(
        path, run, tmp_path / "x", len(run.results.times()) - 1
    )
    assert series_count > 40
    assert wrong == []


@pytest.mark.slow
def test_it_is_as_large_as_its_page_says(monkeypatch, tmp_path):
    """Built as `desat export fmu` does, for this platform alone."""
    monkeypatch.undo()
    page = (ROOT / "docs" / "loop-fmu.md").read_text(encoding="utf-8")
    (message,) = re.findall(r"`nadir_day/day-dipole` has (\d+) kB", page)
    path = export("nadir_day/day-dipole", Options(), LoopEnds(), tmp_path / "loop.fmu")
    assert path.stat().st_size == pytest.approx(1e3 * float(message), rel=0.03)


NADIR = "integrated/mil-nadir"
"""With substeps, and computers slower than the rest."""


@pytest.fixture(scope="module")
def built_loop(tmp_path_factory):
    """The loop of NADIR as one FMU, the same without its manager, and the run."""
    folder = tmp_path_factory.mktemp("loops")
    options = short(NADIR, 120, substeps=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            native, "FLAGS", tuple("-O1" if f == "-O3" else f for f in native.FLAGS)
        )
        full = export(
            NADIR,
            options,
            LoopEnds(parameters=["manager.gain*", "shared.inertia"]),
            folder / "whole.fmu",
        )
        open_ = export(
            NADIR,
            options,
            LoopEnds(["wheels.*", "spacecraft.*"], without=["manager"]),
            folder / "open.fmu",
        )
    return full, open_, execute(NADIR, options, None), folder


@pytest.mark.slow
def test_its_outputs_are_those_that_the_scenario_plots_and_validators_find_nothing(
    built_loop,
):
    full, open_, run, folder = built_loop
    assert validate_fmu(str(full)) == []
    assert validate_fmu(str(open_)) == []
    series_count, wrong = differing(full, run, folder / "w", 120)
    assert series_count > 10
    assert wrong == []


def test_a_loop_without_its_manager_is_a_plant_for_anybodys(built_loop):
    _, path, run, folder = built_loop
    loop, series = Loop(path, folder / "o"), columns(run)
    inputs = [n for n, v in loop.variables.items() if v.causality == "input"]
    assert {base_name(n) for n in inputs} == {
        "manager.m_cmd_body",
        "manager.tau_cmd_wheel",
    }
    assert any(
        n.startswith("manager.b_body") and v.causality == "output"
        for n, v in loop.variables.items()
    )
    rows, index = (
        [loop.outputs()],
        {n: int(n.partition("[")[2][:-1]) - 1 for n in inputs},
    )
    for k in range(120):  # what our manager gave, given by hand
        loop.set({n: series[base_name(n), i][0][k] for n, i in index.items()})
        rows.append(loop.advance())
    for name in ("wheels.h_wheel", "spacecraft.q_bi"):
        for i in range(4):
            manager_values = np.array([row[f"{name}[{i + 1}]"] for row in rows])
            assert manager_values.tobytes() == series[name, i][0].tobytes()
    outputs = fmpy.read_model_description(path).outputs
    on = {o.variable.name: {d.name for d in o.dependencies} for o in outputs}
    assert on["spacecraft.q_bi[1]"] == set()
    assert on["wheels.tau_mean_wheel[1]"] == {n for n in inputs if "wheel" in n}
    assert on["manager.b_body[1]"] == set()
    loop.close()


def test_several_steps_at_once_states_and_parameters(built_loop):
    full, _, run, folder = built_loop
    one, many = Loop(full, folder / "a"), Loop(full, folder / "b")
    for _ in range(6):
        at_once = many.advance(5)
        for _ in range(5):
            singly = one.advance()
        assert at_once == singly
    state = many.fmu.getFMUstate()
    after = many.advance(7)
    data = many.fmu.serializeFMUstate(state)
    other = Loop(full, folder / "c")
    other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(data))
    other.t = one.t
    assert other.advance(7) == after
    with pytest.raises(Exception, match="DoStep"):
        one.fmu.doStep(one.t, 1.5 * one.step)
    options = short(NADIR, 120, substeps=3)
    options.sets = ["manager.gain=1e-4"]
    changed_columns = columns(execute(NADIR, options, None))
    loop = Loop(full, folder / "d", **{"manager.gain": 1e-4})
    loop_rows = [loop.outputs()] + [loop.advance() for _ in range(120)]
    want = changed_columns["wheels.h_wheel", 0][0]
    assert (
        np.array([row["wheels.h_wheel[1]"] for row in loop_rows]).tobytes()
        == want.tobytes()
    )
    assert want.tobytes() != columns(run)["wheels.h_wheel", 0][0].tobytes()
    for x in (one, many, other, loop):
        x.close()


def test_a_c_host_without_python_runs_it(built_loop, tmp_path):
    full, open_, _, _ = built_loop
    host, inputs = tmp_path / "host", []
    subprocess.run(
        [
            *compiler(),
            "-std=gnu11",
            "-w",
            str(ROOT / "tests" / "host.c"),
            "-ldl",
            "-o",
            str(host),
        ],
        check=True,
    )
    for path in (full, open_):
        folder = Path(fmpy.extract(path, str(tmp_path / path.stem)))
        (library,) = folder.rglob("*.so")
        inputs += [str(library), fmpy.read_model_description(path).guid]
    host_run = subprocess.run(
        ["/usr/bin/env", "-i", str(host), *inputs], capture_output=True, text=True
    )
    assert host_run.stdout == "2 FMUs\n", host_run.stdout


@pytest.mark.skipif(
    not importlib.util.find_spec("libcosimpy"), reason="libcosimpy not installable"
)
def test_libcosim_runs_it_to_the_same_bits(built_loop):
    full, _, run, _ = built_loop
    names = [f"wheels.h_wheel[{i}]" for i in (1, 2, 3, 4)]
    references = {
        v.name: v.valueReference
        for v in fmpy.read_model_description(full).modelVariables
    }
    script_run = python(LIBCOSIM, str(full), json.dumps([references[n] for n in names]))
    assert "ROWS " in script_run.stdout, script_run.stderr[-1000:]
    rows = np.array(json.loads(script_run.stdout.split("ROWS ")[1].splitlines()[0]))
    assert rows.tobytes() == run.results.values("wheels.h_wheel")[1:21].tobytes()


LIBCOSIM = """
import json, sys
from libcosimpy.CosimExecution import CosimExecution
from libcosimpy.CosimObserver import CosimObserver
from libcosimpy.CosimSlave import CosimLocalSlave
execution = CosimExecution.from_step_size(500_000_000)
slave = CosimLocalSlave(fmu_path=sys.argv[1], instance_name="loop")
index = execution.add_local_slave(slave)
observer = CosimObserver.create_last_value()
execution.add_observer(observer)
rows = []
for _ in range(20):
    assert execution.step()
    rows.append(list(observer.last_real_values(index, json.loads(sys.argv[2]))))
print("ROWS " + json.dumps(rows))
"""


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--without", "managr"],
            "--without managr: integrated/mil-nadir has no such component; "
            "did you mean manager",
        ),
        (
            ["--outputs", "wheels.h_weel"],
            "--outputs wheels.h_weel: integrated/mil-nadir has no "
            "output of this name; did you mean wheels.h_wheel",
        ),
        (
            ["--parameters", "shared.inertia_weel"],
            "no component shares it; did you mean shared.inertia_wheel",
        ),
        (
            ["--inputs", "manager.b_body"],
            "--inputs manager.b_body: something in the loop feeds it",
        ),
    ],
)
def test_names_that_are_not_of_the_loop_are_refused(
    desat, arguments, message, tmp_path
):
    command = desat(
        "export",
        "fmu",
        NADIR,
        "--substeps",
        "1",
        "--out",
        str(tmp_path / "x.fmu"),
        *arguments,
    )
    assert command.returncode == 2
    assert message in command.stderr


def test_a_block_that_has_no_c_is_named(desat, tmp_path):
    of_the_epoch = ("--set", "environment.epoch_tle_j2000=727444800")
    command = desat(
        "export",
        "fmu",
        NADIR,
        "--substeps",
        "1",
        "--source",
        "environment=environment_tle",
        *of_the_epoch,
        "--out",
        str(tmp_path / "x.fmu"),
    )
    assert command.returncode == 2
    message = "environment: environment_tle is a block of Python without a translation"
    assert message in command.stderr
    assert "`--without environment` leaves it out" in command.stderr


def test_each_output_says_of_which_time_it_is(desat, tmp_path):
    """A reference is of the step that has ended, an attitude of its end: who subtracts
    them takes them a step apart."""
    file = tmp_path / "day.fmu"
    desat(
        "export",
        "fmu",
        "nadir_day/day-dipole",
        "--out",
        str(file),
        "--outputs",
        "spacecraft.q_bi",
        "--outputs",
        "guidance.q_ref_bi",
        check=True,
    )
    descriptions = {
        v.name: v.description for v in fmpy.read_model_description(file).modelVariables
    }
    assert descriptions["spacecraft.q_bi[1]"].endswith("after a step: of its end")
    assert descriptions["guidance.q_ref_bi[1]"].endswith(
        "after a step: of the step that has just ended"
    )
    assert all(
        "after a step: " in text
        for name, text in descriptions.items()
        if name.startswith(("spacecraft.", "guidance."))
    )
    page = (ROOT / "docs/loop-fmu.md").read_text()
    assert page.index("attitudes that are one step apart") < page.index("| option |")


@pytest.mark.study
@pytest.mark.parametrize("third", [False, True])
def test_a_loop_of_reals_alone_has_no_other_output(tmp_path, third):
    """For hosts that know no other type; what is named and no Real is refused."""
    options = short("nadir_day/day-dipole", 60)
    ends = LoopEnds(["wheels.*"], reals=True)
    path = export("nadir_day/day-dipole", options, ends, tmp_path / "a.fmu", "", third)
    assert validate_fmu(str(path)) == []
    outputs = [
        v
        for v in fmpy.read_model_description(path).modelVariables
        if v.causality == "output"
    ]
    assert {v.type for v in outputs} == {"Float64" if third else "Real"}
    assert any(v.name.startswith("wheels.h_wheel") for v in outputs)
    for ends, message in (
        (
            LoopEnds(["wheels.failed_wheel"], reals=True),
            "wheels.failed_wheel is of type",
        ),
        (LoopEnds(without=["manager"], reals=True), "which --without makes an output"),
    ):
        with pytest.raises(DesatError, match=f"--reals: .*{message}"):
            export("nadir_day/day-dipole", options, ends, tmp_path / "b.fmu")
