"""FMI 3.0: our native FMUs, which have its face beside that of FMI 2.0, in other
people's hands."""

from __future__ import annotations

import ctypes
import json
import math
import random
import subprocess
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from fmpy.validation import validate_fmu
from lxml import etree

from desat.components.contract.block import Block, Output, Parameter
from desat.fmus import fmi3, native
from desat.fmus.build import DIST
from desat.fmus.registry import block_class, names
from desat.runs.run import Options, execute

NATIVE = [n for n in names() if n not in native.PINNED]
SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3"
SOME = ("manager_cross_product", "magnetometer", "wheels", "thrusters_nozzles")


def path(name: str, kind: str = "fmi3") -> Path:
    return DIST / kind / f"{name}.fmu"


@pytest.mark.parametrize("name", NATIVE[::6])
def test_it_validates(name):
    assert validate_fmu(str(path(name))) == []


def test_each_native_block_has_one_whose_files_are_as_the_schemas_want():
    kinds = {
        "modelDescription.xml": "fmi3ModelDescription",
        "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons",
        "sources/buildDescription.xml": "fmi3BuildDescription",
    }
    schemas = {
        n: etree.XMLSchema(file=str(SCHEMA / f"{x}.xsd")) for n, x in kinds.items()
    }
    assert {p.stem for p in (DIST / "fmi3").glob("*.fmu")} == {*NATIVE}
    for name in NATIVE:
        with (
            zipfile.ZipFile(path(name)) as archive,
            zipfile.ZipFile(path(name, "native")) as two,
        ):
            for file, schema in schemas.items():
                assert schema.validate(etree.fromstring(archive.read(file))), (
                    name,
                    file,
                )
            files = set(archive.namelist())
            assert {"terminalsAndIcons/icon.png"} <= files
            (library,) = (n for n in two.namelist() if n.startswith("binaries/"))
            here = fmi3.PLATFORMS[native.platform()][0]
            assert archive.read(f"binaries/{here}/{Path(library).name}") == two.read(
                library
            )
            build_description = etree.fromstring(
                archive.read("sources/buildDescription.xml")
            )
        assert {
            f"sources/{f.get('name')}" for f in build_description.iter("SourceFile")
        } == {f for f in files if f.endswith(".c")}


def test_arrays_modes_and_terminals_are_such():
    fmu_variables = {
        v.name: v for v in fmpy.read_model_description(path("wheels")).modelVariables
    }
    block_variables = {v.name: v for v in block_class("wheels").variables}
    assert {n for n in fmu_variables if n != "time"} == set(block_variables)
    for name, v in block_variables.items():
        assert tuple(fmu_variables[name].shape or ()) == v.shape
    manager = fmpy.read_model_description(path("manager_magnetic"))
    mode = next(v for v in manager.modelVariables if v.name == "mode")
    assert mode.type == "Enumeration"
    choices = next(
        v for v in block_class("manager_magnetic").variables if v.name == "mode"
    ).choices
    assert [(i.name, int(i.value)) for i in mode.declaredType.items] == [
        (name, i) for i, name in enumerate(choices) if name != "-"
    ]
    with zipfile.ZipFile(path("wheels")) as archive:
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
    members = {
        t.get("name"): {m.get("memberName"): m.get("variableName") for m in t}
        for t in root.iter("Terminal")
    }
    assert members["wheels"]["h_wheel"] == "h_wheel"
    assert members["manager"]["tau_cmd_wheel"] == "tau_cmd_wheel"
    assert set(members) == {"wheels"} | {
        v.source[0].partition(".")[0] for v in block_variables.values() if v.source
    }


def test_a_mode_that_a_block_never_has_is_no_item_and_a_loop_has_no_terminals():
    class Odd(Block):
        """Odd."""

        mode: int = Output("1", "mode", choices=("off", "-", "on"))
        way: int = Parameter("1", "how", choices=("a", "b"))

    root = etree.fromstring(fmi3.model_description(Odd, "odd", "{x}", None, {}))
    items = [
        (i.get("name"), i.get("value"))
        for i in root.iterfind(".//EnumerationType/Item")
    ]
    assert items == [("off", "0"), ("on", "2"), ("a", "0"), ("b", "1")]
    assert b"Terminal " not in fmi3.terminals(Odd)
    assert b"<Icon " in fmi3.terminals(Odd)


class Both:
    """A block's native FMU through fmpy by either face, driven alike; values by scalar
    name."""

    def __init__(self, name: str, folder: Path) -> None:
        block = block_class(name)
        self.heard: list[bytes] = []
        results = []
        for kind, of in (("native", FMU2Slave), ("fmi3", FMU3Slave)):
            description = fmpy.read_model_description(path(name, kind))
            fmu = of(
                guid=description.guid or description.instantiationToken,
                instanceName=block.role,
                unzipDirectory=fmpy.extract(str(path(name, kind)), str(folder / kind)),
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
            results.append((fmu, {v.name: v for v in description.modelVariables}))
        (self.two, self.of_two), (self.three, self.of_three) = results
        self.two.instantiate()
        self.three.instantiate(
            logMessage=lambda e, status, kind, text: self.heard.append(text)
        )
        self.variables, self.t = block.variables, 0.0

    def initialise(self) -> None:
        self.two.setupExperiment(startTime=0.0)
        self.two.enterInitializationMode()
        self.two.exitInitializationMode()
        self.three.enterInitializationMode(startTime=0.0)
        self.three.exitInitializationMode()

    def set(self, v, values: list[float]) -> None:
        kind = {"Real": "Float64", "Integer": "Int64", "Boolean": "Boolean"}[v.type]
        references = [self.of_two[n].valueReference for n in v.elements()]
        getattr(self.two, f"set{v.type}")(references, values)
        getattr(self.three, f"set{kind}")(
            [self.of_three[v.name].valueReference], values
        )

    def get(self, v) -> tuple[list[float], list[float]]:
        kind = {"Real": "Float64", "Integer": "Int64", "Boolean": "Boolean"}[v.type]
        references = [self.of_two[n].valueReference for n in v.elements()]
        return (
            [float(x) for x in getattr(self.two, f"get{v.type}")(references)],
            [
                float(x)
                for x in getattr(self.three, f"get{kind}")(
                    [self.of_three[v.name].valueReference], nValues=v.size
                )
            ],
        )

    def step(self, dt: float) -> None:
        self.two.doStep(self.t, dt)
        self.three.doStep(self.t, dt)
        self.t += dt

    def assert_equal(self) -> None:
        for v in self.variables:
            two, three = self.get(v)
            assert list(map(float.hex, two)) == list(map(float.hex, three)), v.name

    def close(self) -> None:
        self.two.fmi2FreeInstance(self.two.component)
        self.three.fmi3FreeInstance(self.three.component)


@pytest.mark.parametrize("name", SOME)
def test_both_faces_give_the_same_bits(name, tmp_path):
    both, random_ = Both(name, tmp_path), random.Random(1)
    inputs = [v for v in both.variables if v.causality == "input"]
    both.initialise()
    both.assert_equal()
    has_moved = False
    for _ in range(20):
        for v in inputs:
            if v.type == "Real":
                both.set(v, [random_.gauss(0.0, 1e-3) for _ in range(v.size)])
            elif v.type == "Boolean":
                both.set(v, [True] * v.size)
        both.step(1.0)
        both.assert_equal()
        has_moved |= any(
            any(both.get(v)[1]) for v in both.variables if v.causality == "output"
        )
    assert has_moved
    time = both.of_three["time"].valueReference
    assert both.three.getFloat64([time]) == [20.0]
    state = both.three.getFMUState()
    before = [both.get(v)[1] for v in both.variables]
    data = both.three.serializeFMUState(state)
    both.three.doStep(20.0, 1.0)
    both.three.setFMUState(both.three.deserializeFMUState(data))
    assert [both.get(v)[1] for v in both.variables] == before
    both.step(1.0)
    both.assert_equal()
    both.close()


def test_what_it_refuses_it_says(tmp_path):
    both = Both("wheels", tmp_path)
    three, of = both.three, both.of_three
    both.initialise()
    tau, axes = of["tau_cmd_wheel"].valueReference, of["axes_wheel"].valueReference
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getFloat64([tau], nValues=3)
    assert (
        both.heard[-1]
        == b"wheels: get Float64 tau_cmd_wheel[1]: there are too few values"
    )
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getFloat64([tau], nValues=5)
    assert both.heard[-1] == b"wheels: get Float64: there are too many values"
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getFloat64([tau + 1], nValues=1)
    assert b"an array is read and set as a whole" in both.heard[-1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getInt64([tau], nValues=4)
    assert b"it is of another type" in both.heard[-1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getFloat64([9999])
    assert b"value reference 9999: there is no such variable" in both.heard[-1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.getFloat32([tau], nValues=4)
    assert b"there is none" in both.heard[-1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.fmi3EnterEventMode(three.component)
    assert both.heard[-1] == b"wheels: EnterEventMode: there is no such mode"
    one = (ctypes.c_double * 1)(1.0)
    references = (ctypes.c_uint * 1)(tau)
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.fmi3GetDirectionalDerivative(
            three.component, references, 1, references, 1, one, 1, one, 1
        )
    assert b"derivatives are not provided" in both.heard[-1]
    with pytest.raises(fmpy.fmi1.FMICallException):
        three.setFloat64([axes], [1.0] * 12)
    assert b"a parameter is fixed once the simulation runs" in both.heard[-1]
    three.fmi3FreeInstance(three.component)
    with pytest.raises(Exception, match="Failed to instantiate"):
        three.instantiate(
            eventModeUsed=True, logMessage=lambda e, s, k, t: both.heard.append(t)
        )
    assert both.heard[-1] == b"there is no event mode"
    three.guid = "{other}"
    with pytest.raises(Exception, match="Failed to instantiate"):
        three.instantiate(logMessage=lambda e, s, k, t: both.heard.append(t))
    assert both.heard[-1] == b"the guid is that of another FMU"
    both.two.fmi2FreeInstance(both.two.component)


def test_a_step_that_fails_is_discarded_and_logged_once(tmp_path):
    both = Both("wheels", tmp_path)
    both.initialise()
    with pytest.raises(fmpy.fmi1.FMICallException, match="discard"):
        both.three.doStep(0.0, math.nan)
    assert both.heard == [b"wheels: step from t = 0.0 s: RuntimeError: a step of nan s"]
    both.close()


@pytest.mark.slow
def test_the_loop_as_an_fmu_of_fmi_3_gives_the_bits_of_a_run(desat, tmp_path):
    file = tmp_path / "loop.fmu"
    command = desat(
        "export",
        "fmu",
        "integrated/mil-nadir",
        "--fmi",
        "3",
        "--out",
        str(file),
        "--outputs",
        "wheels.h_wheel",
        "--outputs",
        "manager.mode",
    )
    assert command.returncode == 0, command.stderr
    assert validate_fmu(str(file)) == []
    ran = execute("integrated/mil-nadir", Options(stop=30.0), None)
    series = fmpy.simulate_fmu(str(file), stop_time=30.0, output_interval=0.5)[
        "wheels.h_wheel"
    ]
    assert series.any()
    np.testing.assert_array_equal(
        np.array(series), ran.results.values("wheels.h_wheel"), strict=True
    )


def test_a_block_file_of_ones_own_becomes_one(desat, tmp_path, quick_builds):
    file = tmp_path / "doubled.py"
    file.write_text(
        '''"""A block."""

from __future__ import annotations

from desat.components.contract.block import Block, Input, Output, Vec3


class Doubled(Block):
    """Doubles."""

    given: Vec3 = Input("1", "given")
    made: Vec3 = Output("1", "twice what is given", interval=True)

    def start(self) -> None:
        self.made = (0.0, 0.0, 0.0)

    def output(self, t: float) -> None:
        pass

    def advance(self, t: float, dt: float) -> None:
        x, y, z = self.given
        self.made = (2.0 * x, 2.0 * y, 2.0 * z)
'''
    )
    command = desat(
        "build", str(file), "--fmi", "3", "--out", str(tmp_path / "out"), "--json"
    )
    assert command.returncode == 0, command.stderr
    assert json.loads(command.stdout) == {
        "fmi3": str(tmp_path / "out" / "fmi3" / "doubled.fmu")
    }
    result = fmpy.simulate_fmu(
        str(tmp_path / "out" / "fmi3" / "doubled.fmu"),
        stop_time=1.0,
        output_interval=1.0,
        start_values={"given": "1 2 3"},
    )
    assert result["made"][-1].tolist() == [2.0, 4.0, 6.0]
    file.write_text(
        file.read_text().replace("x, y, z = self.given", "x, y, z = {1: self.given}[1]")
    )
    command = desat("build", str(file), "--fmi", "3", "--out", str(tmp_path / "out"))
    assert command.returncode == 2
    assert (
        "doubled.py: FMI 3.0 is for native FMUs, and there is none of it: doubled.py:"
        in (command.stderr)
    )


def test_all_functions_of_the_standard_are_there(tmp_path):
    """The functions that the standard lists are all there."""
    library = next(
        n
        for n in zipfile.ZipFile(path("wheels")).namelist()
        if n.startswith("binaries/")
    )
    with zipfile.ZipFile(path("wheels")) as archive:
        archive.extract(library, tmp_path)
    symbol_table = subprocess.run(
        ["nm", "-D", "--defined-only", str(tmp_path / library)],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    header = Path(fmpy.__file__).parent / "c-code" / "fmi3FunctionTypes.h"
    function_names = {
        w.removesuffix("TYPE")
        for w in header.read_text().replace("(", " ").split()
        if w.startswith("fmi3") and w.endswith("TYPE")
    }
    assert len(function_names) > 60
    assert {w for w in function_names if f" {w}\n" not in symbol_table} == set()
