"""Co-simulation FMUs of FMI 1.0: values of each type, both loops, FMPy beside, what is
refused."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import fmpy
import numpy as np
import pytest

import desat
from desat.system.errors import DesatError
from tests.conftest import ROOT

VARIABLES = (
    ("k", 0, "Real", "internal", "parameter", "1"),
    ("u", 1, "Real", "input", "continuous", "0"),
    ("x", 2, "Real", "output", "continuous", ""),
    ("n", 0, "Integer", "input", "discrete", "0"),
    ("m", 1, "Integer", "output", "discrete", ""),
    ("b", 0, "Boolean", "input", "discrete", "false"),
    ("c", 1, "Boolean", "output", "discrete", ""),
)
DESCRIPTION = (
    '<?xml version="1.0" encoding="UTF-8"?>\n<fmiModelDescription fmiVersion="1.0" '
    'modelName="gain" modelIdentifier="gain1" guid="{1}" numberOfContinuousStates="0" '
    'numberOfEventIndicators="0"><ModelVariables>'
    + "".join(
        f'<ScalarVariable name="{name}" valueReference="{reference}" causality="{causality}" '
        f'variability="{variability}"><{kind}'
        + (f' start="{start}"' if start else "")
        + "/></ScalarVariable>"
        for name, reference, kind, causality, variability, start in VARIABLES
    )
    + "</ModelVariables><Implementation><CoSimulation_StandAlone><Capabilities "
    'canHandleVariableCommunicationStepSize="true"/></CoSimulation_StandAlone></Implementation>'
    "</fmiModelDescription>"
)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    shared_library = tmp_path_factory.mktemp("gain1") / "gain1.so"
    subprocess.run(
        [
            compiler,
            "-shared",
            "-fPIC",
            "-o",
            str(shared_library),
            str(ROOT / "tests" / "gain1.c"),
        ],
        check=True,
    )
    return shared_library


def fmu(path: Path, library: Path, description: str = DESCRIPTION) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", description)
        file.write(library, "binaries/linux64/gain1.so")
    return path


def scenario(folder: Path, values: str = "k = 3.0") -> Path:
    """a integrates what it is given, b what a has."""
    names = " ".join(
        f'xmlns:{p}="http://ssp-standard.org/SSP1/SystemStructure{n}"'
        for p, n in (
            ("ssd", "Description"),
            ("ssc", "Common"),
            ("ssv", "ParameterValues"),
        )
    )
    key, value = values.split(" = ")

    def part(name: str, parameters: str) -> str:
        rows = "".join(
            f'<ssd:Connector name="{n}" kind="{cause if cause != "internal" else "parameter"}">'
            f"<ssc:{kind}/></ssd:Connector>"
            for n, _, kind, cause, *_ in VARIABLES
        )
        return (
            f'<ssd:Component name="{name}" source="gain.fmu"><ssd:Connectors>{rows}'
            "</ssd:Connectors><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
            '<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>'
            + parameters
            + "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>"
            "</ssd:ParameterBindings></ssd:Component>"
        )

    def parameter(name: str, kind: str, value: str) -> str:
        return f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"/></ssv:Parameter>'

    wires = "".join(
        f'<ssd:Connection startElement="a" startConnector="{x}" endElement="b" endConnector="{y}"/>'
        for x, y in (("x", "u"), ("m", "n"), ("c", "b"))
    )
    first = (
        parameter(key, "Real", value)
        + parameter("u", "Real", "0.5")
        + parameter("n", "Integer", "41")
        + parameter("b", "Boolean", "false")
    )
    file = folder / "SystemStructure.ssd"
    file.write_text(
        f'<ssd:SystemStructureDescription version="1.0" name="x" {names}><ssd:System name="s">'
        f"<ssd:Elements>{part('a', first)}{part('b', parameter('k', 'Real', '2'))}</ssd:Elements>"
        f"<ssd:Connections>{wires}</ssd:Connections></ssd:System></ssd:SystemStructureDescription>"
    )
    return file


@pytest.mark.parametrize(
    ("loop", "isolate"),
    [
        ("compiled", "none"),
        ("python", "none"),
        ("compiled", "foreign"),
    ],
)
def test_values_of_every_type_are_handed_on(
    tmp_path: Path, library: Path, loop: str, isolate: str
) -> None:
    """x' = 3 * 0.5; through b: 43 = 41 + 1 + 1, and not not false."""
    fmu(tmp_path / "gain.fmu", library)
    options = {
        "stop": 2.0,
        "step": 0.25,
        "substeps": 1,
        "loop": loop,
        "isolate": isolate,
    }
    run = desat.run(str(scenario(tmp_path)), **options)
    assert run.manifest.status == "completed"
    # an output that may depend on inputs is that of a step, of which there are eight
    assert run.results.values("a.x").tolist() == [1.5 * 0.25 * i for i in range(1, 9)]
    assert run.results.values("b.m")[-1] == 43
    assert not run.results.values("b.c")[-1]


def test_the_series_are_those_of_fmpy(tmp_path: Path, library: Path) -> None:
    path = fmu(tmp_path / "gain.fmu", library)
    there = fmpy.simulate_fmu(
        str(path),
        validate=False,
        stop_time=2.0,
        output_interval=0.25,
        start_values={"k": 3.0, "u": 0.5, "n": 41},
        output=["x", "m", "c"],
    )
    run = desat.run(str(scenario(tmp_path)), stop=2.0, step=0.25, substeps=1)
    for name in ("x", "m", "c"):
        np.testing.assert_array_equal(run.results.values(f"a.{name}"), there[name][1:])


def test_what_the_fmu_says_is_told(tmp_path: Path, library: Path) -> None:
    fmu(tmp_path / "gain.fmu", library)
    with pytest.raises(
        DesatError, match=r"a: fmi1InitializeSlave returned error: k = -1: 0 or"
    ):
        desat.run(str(scenario(tmp_path, "k = -1")), stop=2.0, step=0.25, substeps=1)


@pytest.mark.parametrize(
    ("loop", "isolate"),
    [
        ("compiled", "none"),
        ("python", "none"),
        ("compiled", "foreign"),
    ],
)
@pytest.mark.parametrize(
    ("k", "expected_message", "status"),
    [
        (
            11,
            "a: reading its outputs returned warning, the first time at t = 0 s",
            "completed",
        ),
        (12, "a: fmi1TerminateSlave returned warning", "completed"),
        (13, "a: fmi1TerminateSlave returned error, after the run", "failed"),
    ],
)
def test_what_a_status_says_is_told_and_it_is_terminated(
    tmp_path: Path,
    library: Path,
    loop: str,
    isolate: str,
    k: int,
    expected_message: str,
    status: str,
) -> None:
    fmu(tmp_path / "gain.fmu", library)
    options = {
        "stop": 2.0,
        "step": 0.25,
        "substeps": 1,
        "loop": loop,
        "isolate": isolate,
    }
    run = desat.run(str(scenario(tmp_path, f"k = {k}")), **options)
    assert run.manifest.status == status
    lines = [*run.manifest.warnings, *run.manifest.message.splitlines()]
    assert [line for line in lines if line.startswith("a: ")] == [expected_message]
    assert len(run.results.times()) == 9


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "CoSimulation_StandAlone",
            "CoSimulation_Tool",
            "FMI 1.0 for a tool of its own alone",
        ),
        ("Implementation", "Implemented", "FMI 1.0 for model exchange alone"),
        ('name="x"', 'name="x" alias="negatedAlias"', "x is a negated alias"),
        (
            'modelIdentifier="gain1"',
            'modelIdentifier="../gain"',
            "modelIdentifier '../gain' is no C",
        ),
    ],
)
def test_what_cannot_be_is_refused_by_name(
    tmp_path: Path, library: Path, old: str, new: str, message: str
) -> None:
    fmu(tmp_path / "gain.fmu", library, DESCRIPTION.replace(old, new))
    with pytest.raises(DesatError, match=rf"a: gain\.fmu.*{message}"):
        desat.run(str(scenario(tmp_path)), stop=2.0, step=0.25, substeps=1)


def test_a_state_cannot_be_kept(tmp_path: Path, library: Path) -> None:
    fmu(tmp_path / "gain.fmu", library)
    with pytest.raises(
        DesatError, match=r"checkpoint: a: gain\.fmu cannot save its state"
    ):
        desat.run(
            str(scenario(tmp_path)), stop=2.0, step=0.25, substeps=1, checkpoint=1.0
        )
