"""The FMUs: quality, robustness, and bitwise equality with the bare blocks."""

from __future__ import annotations

import ctypes
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import fmpy
import numpy as np
import pytest
from fmpy import validation
from fmpy.fmi2 import FMU2Slave

from desat.files import library, paths
from desat.files.fmu import of_fmu
from desat.fmus import build, interfaces, registry
from desat.fmus.description import ICON, LICENCE
from desat.system import interface
from desat.system.interface import KINDS
from tests.conftest import ROOT, description_of, python
from tests.contract.test_block import begin, fresh, randomise_inputs
from tests.fmus.test_native import OUT_OF_ORDER

NAMES = registry.names()


def path(name: str) -> Path:
    return paths.fmus() / f"{name}.fmu"


SHAPES: set[str] = set()
"""Of names that fmpy's grammar takes: with 1 for every number. It needs 0.1 s for a
name, and a table has hundreds that differ in numbers alone."""


def _names_once(description):
    """What fmpy has against the names of a description, those of a known shape left
    out."""
    new = {re.sub(r"\d+", "1", v.name): v for v in description.modelVariables}
    new = {shape: v for shape, v in new.items() if shape not in SHAPES}
    wrong = NAMES_BY_FMPY(
        SimpleNamespace(
            variableNamingConvention="structured", modelVariables=list(new.values())
        )
    )
    SHAPES.update(() if wrong else new)
    return wrong


NAMES_BY_FMPY = validation._validate_variable_names


@pytest.mark.parametrize("name", NAMES)
def test_validates(name, monkeypatch):
    monkeypatch.setattr(validation, "_validate_variable_names", _names_once)
    assert validation.validate_fmu(str(path(name))) == []


def test_a_wrong_name_is_seen(monkeypatch):
    """Also the second time, and beside one of a known shape."""
    assert (
        fmpy.read_model_description(path("torquers")).variableNamingConvention
        == "structured"
    )
    for name in ("2a", "a[]", "a[x]"):
        variables = [SimpleNamespace(name=n, sourceline=1) for n in ("a[7]", name)]
        for _ in range(2):
            (line,) = _names_once(SimpleNamespace(modelVariables=variables))
            assert f'"{name}"' in line


@pytest.mark.parametrize("name", NAMES)
def test_interface_is_the_blocks(name):
    """Units, bounds, start values, choices, classes, references: all arrive in the FMU."""
    from_block = interface.of_block(name, registry.block_class(name))
    from_fmu = of_fmu(path(name))
    assert from_fmu.role == from_block.role
    assert list(from_fmu.signals) == list(from_block.signals)
    for a, b in zip(
        from_fmu.signals.values(), from_block.signals.values(), strict=True
    ):
        assert a == b


@pytest.mark.parametrize("name", NAMES)
def test_model_description(name):
    md = description_of(path(name))
    cs = md.coSimulation
    assert cs.canGetAndSetFMUstate
    assert cs.canSerializeFMUstate
    assert not cs.providesDirectionalDerivative
    inputs = {v.name for v in md.modelVariables if v.causality == "input"}
    for unknown in md.outputs:
        names = {v.name for v in unknown.dependencies}
        assert names in (set(), inputs), (
            "state outputs depend on nothing, interval ones on inputs"
        )
    outputs = {v.name for v in md.modelVariables if v.causality == "output"}
    assert {u.variable.name for u in md.initialUnknowns} == outputs
    for v in md.modelVariables:
        assert v.description
        assert v.type != "Real" or v.unit
    with zipfile.ZipFile(path(name)) as archive:
        page = archive.read("documentation/index.html").decode()
        assert all(v.name.partition("[")[0] in page for v in md.modelVariables)
        assert not any("__pycache__" in n for n in archive.namelist())
        assert archive.read("model.png") == ICON.read_bytes()


def test_a_block_that_cannot_be_one_is_named_and_the_others_are_built(tmp_path):
    """Without that import its annotations are no text, and no FMU was built at all."""
    package = tmp_path / "desat"
    shutil.copytree(ROOT / "components", package / "components")
    for path in [*(ROOT / "orchestrator").iterdir(), ROOT / "fmus"]:
        (package / path.name).symlink_to(path)
    text = (ROOT / "components/blocks/tachometers.py").read_text(encoding="utf-8")
    mine = text.replace("from __future__ import annotations\n", "")
    (package / "components/blocks/tachometers_mine.py").write_text(
        mine, encoding="utf-8"
    )
    build_run = subprocess.run(
        [
            sys.executable,
            "-m",
            "desat.fmus.build",
            "tachometers",
            "tachometers_mine",
            "--into",
            str(tmp_path / "out"),
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        timeout=300,
        check=False,
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
    )
    assert build_run.returncode == 1
    (line,) = build_run.stderr.splitlines()
    assert line.startswith(
        "error: components/blocks/tachometers_mine.py: TypeError: Tachometers."
    )
    assert "its file needs the line `from __future__ import annotations`" in line
    assert [p.name for p in (tmp_path / "out").glob("*.fmu")] == ["tachometers.fmu"]


@pytest.mark.slow
def test_a_build_that_is_killed_and_started_again_gives_the_same_bytes(tmp_path):
    """`python -m benchmarks.targets` kills targets of make."""
    names = ("manager_combined", "environment_orbit_dipole")
    command = [
        sys.executable,
        "-m",
        "desat.fmus.build",
        *names,
        "--into",
        str(tmp_path),
    ]
    process = subprocess.Popen(
        command,
        start_new_session=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while process.poll() is None and not list(tmp_path.glob("*.fmu*")):
        time.sleep(0.005)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert not (tmp_path / "native").exists()
    subprocess.run(command, check=True, capture_output=True)
    for file in [f"{folder}{name}.fmu" for folder in ("", "native/") for name in names]:
        assert (tmp_path / file).read_bytes() == (paths.fmus() / file).read_bytes()


def test_package_name_follows_the_contents(tmp_path, monkeypatch):
    """Different code gives a different package, so two versions can live in one
    process."""
    files = build.contents("tachometers")
    new_contents = {
        **files,
        "blocks/tachometers.py": files["blocks/tachometers.py"] + b"# changed\n",
    }
    monkeypatch.setattr(build, "contents", lambda name: new_contents)
    new_fmu = build.build("tachometers", tmp_path)
    old, new = (
        {n.split("/")[1] for n in zipfile.ZipFile(p).namelist() if "/desat_" in n}
        for p in (path("tachometers"), new_fmu)
    )
    assert len(old) == len(new) == 1
    assert old != new


def test_they_are_as_large_as_the_page_of_hosts_says():
    """Built for one platform; in kB, to a fiftieth."""
    page = (ROOT / "docs" / "hosts.md").read_text(encoding="utf-8")
    row = re.search(r"\| size \| (\d+) to (\d+) kB \| (\d+) to (\d+) kB \|", page)
    assert row is not None
    for folder, message in (("native", row.groups()[:2]), (".", row.groups()[2:])):
        files = list((paths.fmus() / folder).glob("*.fmu"))
        with zipfile.ZipFile(files[0]) as archive:
            platforms = {
                n.split("/")[1] for n in archive.namelist() if n.startswith("binaries/")
            }
        if len(platforms) > 2:
            pytest.skip("built for all platforms")
        sizes = [f.stat().st_size / 1e3 for f in files]
        assert [min(sizes), max(sizes)] == pytest.approx(
            [float(x) for x in message], rel=0.02
        )


def test_interfaces_page_is_current():
    assert interfaces.PATH.read_text(encoding="utf-8") == interfaces.text(), (
        "run `make fmus`"
    )


class Instance:
    """An FMU through fmpy, for tests."""

    def __init__(self, name: str) -> None:
        self.md = description_of(path(name))
        self.fmu = FMU2Slave(
            guid=self.md.guid,
            unzipDirectory=str(library.extract(path(name))),
            modelIdentifier=self.md.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()
        self.variables = {v.name: v for v in self.md.modelVariables}

    def start(self):
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        return self

    def set(self, name: str, *values) -> None:
        refs = [
            v.valueReference
            for n, v in self.variables.items()
            if n.partition("[")[0] == name
        ]
        getattr(self.fmu, f"set{self._kind(name)}")(refs, list(values))

    def get(self, name: str) -> list:
        refs = [
            v.valueReference
            for n, v in self.variables.items()
            if n.partition("[")[0] == name
        ]
        return getattr(self.fmu, f"get{self._kind(name)}")(refs)

    def _kind(self, name: str) -> str:
        return next(
            v.type for n, v in self.variables.items() if n.partition("[")[0] == name
        )

    def outputs(self) -> dict:
        names = {
            n.partition("[")[0]
            for n, v in self.variables.items()
            if v.causality == "output"
        }
        return {n: self.get(n) for n in sorted(names)}

    def free(self) -> None:
        self.fmu.fmi2FreeInstance(self.fmu.component)


@pytest.fixture
def instance():
    results = []

    def make(name: str) -> Instance:
        results.append(Instance(name))
        return results[-1]

    yield make
    for i in results:
        i.free()


@pytest.mark.parametrize("name", NAMES)
def test_equals_the_bare_block_bitwise(name, instance):
    rng = random.Random(21)
    block = fresh(name)
    randomise_inputs(block, rng)
    i = instance(name)

    def feed() -> None:
        for v in block.variables:
            if v.causality == "input":
                value = getattr(block, v.name)
                i.set(v.name, *(value if v.shape else (value,)))

    i.fmu.setupExperiment(startTime=0.0)
    i.fmu.enterInitializationMode()
    feed()
    i.fmu.exitInitializationMode()
    begin(block)
    for k in range(50):
        assert i.outputs() == _outputs(block)
        randomise_inputs(block, rng)
        feed()
        i.fmu.doStep(float(k), 1.0)
        block.advance(float(k), 1.0)
        block.output(k + 1.0)


def _outputs(block) -> dict:
    return {
        v.name: list(getattr(block, v.name)) if v.shape else [getattr(block, v.name)]
        for v in sorted(block.variables, key=lambda v: v.name)
        if v.causality == "output"
    }


@pytest.mark.parametrize("name", NAMES)
def test_state_is_saved_and_serialised(name, instance):
    a, b = instance(name).start(), instance(name)
    for k in range(5):
        a.fmu.doStep(float(k), 1.0)
    state = a.fmu.getFMUstate()
    serial = a.fmu.serializeFMUstate(state)

    def run(i: Instance) -> list:
        rows = []
        for k in range(5, 15):
            i.fmu.doStep(float(k), 1.0)
            rows.append(i.outputs())
        return rows

    first = run(a)
    a.fmu.setFMUstate(state)
    assert run(a) == first
    b.fmu.setFMUstate(b.fmu.deSerializeFMUstate(serial))
    assert run(b) == first
    a.fmu.freeFMUstate(state)


def test_an_error_in_a_block_is_a_message_not_a_crash(instance):
    i = instance("torquers")
    i.set("m_limit", -1.0)
    i.start()
    assert i.get("fault") == [True]
    with pytest.raises(fmpy.fmi1.FMICallException, match="discard"):
        i.fmu.doStep(0.0, 1.0)
    assert i.get("m_mean_body") == [0, 0, 0]


def test_start_may_fail_until_the_inputs_have_settled(instance):
    i = instance("torquers")
    i.fmu.setupExperiment(startTime=0.0)
    i.fmu.enterInitializationMode()
    i.set("m_limit", -1.0)
    assert i.get("fault") == [True]
    i.set("m_limit", 5.0)
    assert i.get("fault") == [False]
    i.fmu.exitInitializationMode()
    i.fmu.doStep(0.0, 1.0)


def test_late_parameters_are_refused(instance):
    i = instance("torquers").start()
    i.fmu.doStep(0.0, 1.0)
    i.set("m_limit", 5.0)
    assert i.get("fault") == [True]
    with pytest.raises(fmpy.fmi1.FMICallException):
        i.fmu.doStep(1.0, 1.0)


@pytest.mark.parametrize(
    ("t", "dt"), [(0.0, -1.0), (0.0, 0.0), (0.0, float("nan")), (5.0, 1.0)]
)
def test_bad_steps_are_refused(t, dt, instance):
    i = instance("torquers").start()
    with pytest.raises(fmpy.fmi1.FMICallException):
        i.fmu.doStep(t, dt)


def test_unknown_and_wrong_references(instance):
    i = instance("torquers").start()
    wrong = i.variables["fault"].valueReference
    assert np.isnan(i.fmu.getReal([wrong])).all()
    assert i.get("fault") == [True]
    j = instance("torquers").start()
    assert np.isnan(j.fmu.getReal([9999])).all()
    j.fmu.setReal([9999], [1.0])
    assert j.get("fault") == [True]


@pytest.mark.parametrize("fault", OUT_OF_ORDER)
def test_what_fmi_forbids_is_a_fault(fault, instance):
    """pythonfmu has no status for most of it."""
    i = instance("torquers").start()
    i.fmu.doStep(0.0, 1.0)
    assert i.get("fault") == [False]
    references = {
        n.partition("[")[0]: v.valueReference for n, v in reversed(i.variables.items())
    }
    OUT_OF_ORDER[fault][0](i.fmu, references)
    assert i.get("fault") == [True]


def test_angles_are_shown_in_degrees_and_authors_are_named():
    for name in ("rate_gyro", "wheels"):
        for kind in ("", "native", "fmi3"):
            description = fmpy.read_model_description(
                paths.fmus() / kind / f"{name}.fmu"
            )
            assert (description.author, description.license) == (
                "the desat authors",
                "MIT",
            )
            display_units = {
                v.unit: v.displayUnit
                for v in description.modelVariables
                if v.type in ("Real", "Float64") and v.unit
            }
            assert display_units["rad/s"] == "deg/s"
            assert display_units["s"] is None
            (unit,) = (u for u in description.unitDefinitions if u.name == "rad/s")
            assert unit.displayUnits[0].factor * np.radians(1.0) == pytest.approx(1.0)


def test_a_broken_state_is_refused(instance):
    i = instance("torquers").start()
    state = i.fmu.deSerializeFMUstate(b"not a state")
    i.fmu.setFMUstate(state)
    assert i.get("fault") == [True]


def test_reset_starts_anew(instance):
    i = instance("torquers").start()
    i.set("m_cmd_body", 1.0, 2.0, 3.0)
    i.fmu.doStep(0.0, 1.0)
    i.fmu.reset()
    i.start()
    i.fmu.doStep(0.0, 1.0)
    assert i.get("m_mean_body") == [0, 0, 0]


def test_partial_arrays_can_be_set(instance):
    i = instance("torquers")
    refs = [i.variables[f"m_cmd_body[{k}]"].valueReference for k in (1, 3)]
    i.start()
    i.fmu.setReal(refs, [1.0, 3.0])
    i.fmu.doStep(0.0, 1.0)
    assert i.get("m_mean_body") == [1.0, 0.0, 3.0]


MANY = """
import gc, sys, fmpy
from fmpy import validation
from fmpy.fmi2 import FMU2Slave
path = sys.argv[1]
md, folder = fmpy.read_model_description(path), fmpy.extract(path)
fmu = FMU2Slave(guid=md.guid, unzipDirectory=str(folder),
                modelIdentifier=md.coSimulation.modelIdentifier, instanceName="x")
for n in range(1000):
    fmu.instantiate()
    fmu.setupExperiment()
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.doStep(0.0, 1.0)
    fmu.fmi2FreeInstance(fmu.component)
classes = [x for x in gc.get_objects() if isinstance(x, type) and x.__name__.endswith("Fmu")]
assert len(classes) == 1, classes
assert len(set(sys.path)) == len(sys.path), sys.path
fmu.dll.finalizePythonInterpreter()
print("done", n)
"""


def test_a_thousand_instances_in_a_row():
    """They have one class, and one place where modules are looked for."""
    result = python(MANY, str(path("manager_combined")))
    assert (result.returncode, result.stdout.strip()) == (0, "done 999"), result.stderr


TOGETHER = """
import sys
from pathlib import Path
from desat.files import library
from desat.files import paths as places
from desat.engine.instances.fmu import FmuInstance
from desat.system.model import Component
from desat.system.interface import KINDS
from desat.engine.instances.base import Clock
clock = Clock(0.0, 1.0)
units = []
for round in range(2):
    for path in sorted(places.fmus().glob("*.fmu")):
        fmu = library.load(path)
        units.append(FmuInstance(Component(path.stem + str(round), path.name, fmu.interface), fmu))
for unit in units:
    outputs = {k: [s for s in unit._interface.outputs if s.kind == k] for k in KINDS}
    import numpy as np
    from desat.engine.instances.base import DTYPE
    into = {k: np.zeros(len(outputs[k]), DTYPE[k]) for k in KINDS}
    unit.wire({k: [] for k in KINDS}, outputs, into, clock)
    unit.enter(0.0, {})
    unit.exit()
for k in range(3):
    clock.t.value = float(k)
    for unit in units:
        assert unit.step() == 0, unit.failed("step", 2)
        assert unit.pull() == 0
print("done", len(units))
"""


@pytest.mark.slow
def test_all_fmus_live_in_one_process():
    result = python(TOGETHER)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == f"done {2 * len(NAMES)}"


def test_needs_no_numpy():
    """A block of plain floats runs in a host without numpy."""
    for name in NAMES:
        for source, data in build.contents(name).items():
            if source != "slave.py" and b"import numpy" in data:
                assert "numpy" in (registry.block_class(name).__doc__ or ""), name


def test_pointers_hold():
    """fmi2GetReal through bare addresses, as the master calls it, reads what fmpy
    reads."""
    i = Instance("environment_orbit_dipole").start()
    refs = [v.valueReference for v in i.md.modelVariables if v.name.startswith("b_eci")]
    array = np.zeros(3)
    raw = (ctypes.c_uint * 3)(*refs)
    i.fmu.dll["fmi2GetReal"](
        ctypes.c_void_p(i.fmu.component),
        raw,
        ctypes.c_size_t(3),
        ctypes.c_void_p(array.ctypes.data),
    )
    assert array.tolist() == i.get("b_eci")
    assert KINDS[0] == "Real"
    i.free()


def test_an_fmu_has_the_license_of_the_project():
    """In the copy that a wheel has; a block of a user's own has none of ours."""
    licence = (ROOT / "LICENSE").read_bytes()
    assert LICENCE.read_bytes() == licence
    for kind in ("", "native/", "fmi3/"):
        with zipfile.ZipFile(paths.fmus() / f"{kind}torquers.fmu") as archive:
            assert archive.read("documentation/licenses/license.txt") == licence
