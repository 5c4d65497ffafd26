"""FMUs of others in our places: manager.c has the names of the role, and nothing else
of ours."""

from __future__ import annotations

import io
import json
import re
import shutil
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

import desat
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import ROOT

SOURCE = ROOT / "tests" / "manager.c"
INPUTS = {"b_body": (3, "T"), "h_wheel": (4, "N.m.s"), "tau_ctrl_body": (3, "N.m")}
OUTPUTS = {"tau_cmd_wheel": (4, "N.m"), "m_cmd_body": (3, "A.m2")}
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
STILL = ("hausat2", "plant", "uosat12")
"""Where its wheels have nothing to do: at rest, or not wired."""


def description(dependencies: str = "", **other_names: str) -> str:
    """Its modelDescription.xml; `renamed`: variables that are called otherwise."""
    rows: list[str] = []

    def variable(
        name: str, causality: str, unit: str, start: float | None = None
    ) -> None:
        kind = "fixed" if causality == "parameter" else "continuous"
        first = "" if start is None else f' start="{start}"'
        rows.append(
            f'<ScalarVariable name="{name}" valueReference="{len(rows)}" causality="{causality}" '
            f'variability="{kind}"><Real unit="{unit}"{first}/></ScalarVariable>'
        )

    variable("gain", "parameter", "1/s", 1e-3)
    variable("m_limit", "parameter", "A.m2", 5.0)
    for i in range(12):
        variable(
            f"axes_wheel[{i // 4 + 1},{i % 4 + 1}]", "parameter", "1", float(i % 5 == 0)
        )
    for name, (count, unit) in INPUTS.items():
        for i in range(count):
            variable(f"{other_names.get(name, name)}[{i + 1}]", "input", unit, 0.0)
    first = len(rows) + 1
    for name, (count, unit) in OUTPUTS.items():
        for i in range(count):
            variable(f"{other_names.get(name, name)}[{i + 1}]", "output", unit)
    outputs = "".join(
        f'<Unknown index="{i}"{dependencies}/>' for i in range(first, len(rows) + 1)
    )
    units = "".join(
        f'<Unit name="{u}"/>' for u in ("1", "1/s", "A.m2", "T", "N.m.s", "N.m")
    )
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<fmiModelDescription fmiVersion="2.0" modelName="stranger" guid="{s}">'
        '<CoSimulation modelIdentifier="manager" canHandleVariableCommunicationStepSize="true"/>'
        f"<UnitDefinitions>{units}</UnitDefinitions><ModelVariables>{''.join(rows)}"
        f"</ModelVariables><ModelStructure><Outputs>{outputs}</Outputs></ModelStructure>"
        "</fmiModelDescription>"
    )


@pytest.fixture(scope="session")
def library(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    shared_library = tmp_path_factory.mktemp("manager") / "manager.so"
    command = [
        compiler,
        "-shared",
        "-fPIC",
        "-O1",
        "-o",
        str(shared_library),
        str(SOURCE),
        "-lm",
    ]
    subprocess.run(command, check=True)
    return shared_library.read_bytes()


def fmu(path: Path, library: bytes, text: str) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", text)
        file.writestr("binaries/linux64/manager.so", library)
    return path


@pytest.fixture
def stranger(tmp_path: Path, library: bytes) -> Path:
    return fmu(tmp_path / "stranger.fmu", library, description())


@pytest.mark.parametrize("name", ONE_OF_EACH)
def test_it_runs_in_a_scenario_of_every_family(name: str, stranger: Path) -> None:
    run = desat.run(name, stop=60.0, sources=[f"manager={stranger}"], substeps=1)
    assert run.manifest.status == "completed"
    assert "stranger.fmu" in str(run.manifest.warnings)
    wheels = run.results.values("manager.tau_cmd_wheel")
    assert np.isfinite(wheels).all()
    assert np.abs(wheels).max() > 0.0 or name.startswith(STILL)


def test_what_it_lacks_is_left_out_with_a_line_each(stranger: Path) -> None:
    """The line of the README ended with 2, as a plot names a parameter of our manager."""
    case = prepare(
        "integrated/mil-nadir", Options(sources=[f"manager={stranger}"], stop=60.0)
    )
    case.or_raise()
    text = "\n".join(case.warnings)
    assert re.search(
        r"common\.toml:\d+: plots\.wanted_torque\.signals: manager has no output "
        r"tau_des_body; .*: left out",
        text,
    )
    assert re.search(
        r'plots\.momentum\.limits: ".*manager\.h_limit": manager has no parameter '
        r"threshold_off; there is .*: left out",
        text,
    )
    assert case.system is not None
    plots = case.system.about.plots
    assert "wanted_torque" not in plots
    assert plots["momentum"].signals
    assert not any("manager" in str(x.value) for x in plots["momentum"].limits)


def test_an_output_of_the_role_that_it_lacks_stays_at_its_start(stranger: Path) -> None:
    run = desat.run("uosat12/table3-ocdc-ilqr-1", sources=[f"manager={stranger}"])
    text = "\n".join(run.manifest.warnings)
    assert (
        "manager: stranger.fmu has no output tau_cmd_thruster_body; there is m_cmd_body, "
        "tau_cmd_wheel: thrusters.tau_cmd_thruster_body keeps the start value"
    ) in text
    assert (run.results.values("thrusters.on_time") == 0.0).all()


def test_one_that_has_no_output_that_is_read_is_refused(
    tmp_path: Path, library: bytes
) -> None:
    other = {"tau_cmd_wheel": "torque", "m_cmd_body": "m_cmd_bodi"}
    path = fmu(tmp_path / "other.fmu", library, description(**other))
    with pytest.raises(DesatError, match=r"lacks what is wired: .*m_cmd_body"):
        prepare("nadir_day/day-dipole", Options(sources=[f"manager={path}"])).or_raise()


def test_without_dependencies_it_depends_on_all_that_it_is_given(
    tmp_path: Path, library: bytes, stranger: Path
) -> None:
    """As if it declared that; it was taken a step late."""
    every = " ".join(str(i) for i in range(15, 25))
    explicit_fmu = fmu(
        tmp_path / "declared.fmu", library, description(f' dependencies="{every}"')
    )
    a, b = (
        desat.run(
            "nadir_day/day-dipole", stop=200.0, sources=[f"manager={x}"], substeps=1
        )
        for x in (stranger, explicit_fmu)
    )
    assert (
        a.results.values("wheels.h_wheel") == b.results.values("wheels.h_wheel")
    ).all()
    assert any(
        "m_cmd_body, tau_cmd_wheel may depend on every input and are taken over the step"
        in x
        for x in a.manifest.warnings
    )
    assert not any("declares no dependencies" in x for x in b.manifest.warnings)
    late = desat.run(
        "nadir_day/day-dipole",
        stop=200.0,
        sources=[f"manager={stranger}"],
        substeps=1,
        output_classes={
            "manager.m_cmd_body": "state",
            "manager.tau_cmd_wheel": "state",
        },
    )
    assert (
        a.results.values("wheels.h_wheel") != late.results.values("wheels.h_wheel")
    ).any()


def test_where_that_closes_a_circle_it_is_taken_a_step_late(
    tmp_path: Path, library: bytes
) -> None:
    folder = tmp_path / "ring"
    (folder / "resources").mkdir(parents=True)
    # what two managers dump is what the other one measures, so that each waits for the
    # other
    fmu(
        folder / "resources" / "m.fmu", library, description(b_body="x", m_cmd_body="y")
    )
    parts = "".join(
        f'<ssd:Component name="{name}" source="resources/m.fmu"><ssd:Connectors>'
        + "".join(
            f'<ssd:Connector name="{kind}[{i}]" kind="{end}"/>'
            for kind, end in (("x", "input"), ("y", "output"))
            for i in (1, 2, 3)
        )
        + "</ssd:Connectors></ssd:Component>"
        for name in ("a", "b")
    )
    ways = "".join(
        f'<ssd:Connection startElement="{a}" startConnector="y[{i}]" endElement="{b}" '
        f'endConnector="x[{i}]" suppressUnitConversion="true"/>'
        for a, b in (("a", "b"), ("b", "a"))
        for i in (1, 2, 3)
    )
    (folder / "SystemStructure.ssd").write_text(
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructure'
        'Description" name="ring" version="1.0"><ssd:System name="ring"><ssd:Elements>'
        f"{parts}</ssd:Elements><ssd:Connections>{ways}</ssd:Connections></ssd:System>"
        '<ssd:DefaultExperiment startTime="0" stopTime="3"/></ssd:SystemStructureDescription>'
    )
    case = prepare(str(folder), Options(step=1.0))
    _, schedule = case.or_raise()
    assert {moment for _, moment in schedule.timing} == {"one step late"}
    assert "are taken one step late, as they close a circle" in "\n".join(case.warnings)


def test_faults_against_the_standard_are_warnings(
    tmp_path: Path, library: bytes
) -> None:
    """Named by the file; `--strict` refuses."""
    text = description().replace("<Real unit", '<Real bogus="1" unit', 1)
    path = fmu(tmp_path / "faulty.fmu", library, text)
    case = prepare(
        "nadir_day/day-dipole", Options(sources=[f"manager={path}"], stop=60.0)
    )
    case.or_raise()
    (line,) = (x for x in case.warnings if "not as FMI wants it" in x)
    assert line.startswith("manager: faulty.fmu: not as FMI wants it: ")
    assert "bogus" in line
    with pytest.raises(DesatError, match=r"faulty\.fmu: not as FMI wants it"):
        prepare(case.target, replace(case.options, strict=True)).or_raise()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'fmiVersion="2.0"',
            'fmiVersion="1.0"',
            "FMI 1.0 for model exchange alone: FMI 1.0, 2.0 or 3.0 for co-simulation",
        ),
        (
            "CoSimulation",
            "ModelExchange",
            "FMI 2.0 for model exchange alone: FMI 1.0, 2.0",
        ),
    ],
)
def test_what_cannot_run_is_refused_by_name(
    tmp_path: Path, library: bytes, old: str, new: str, message: str
) -> None:
    path = fmu(tmp_path / "old.fmu", library, description().replace(old, new))
    with pytest.raises(DesatError, match=rf"old\.fmu: {message}"):
        prepare("nadir_day/day-dipole", Options(sources=[f"manager={path}"])).or_raise()


def test_a_unit_that_nobody_knows_is_no_number(tmp_path: Path, library: bytes) -> None:
    """A connection between N.m.s and `oz.in` was taken one to one, without a word."""
    text = description().replace('unit="N.m.s"', 'unit="oz.in"')
    path = fmu(tmp_path / "odd.fmu", library, text)
    with pytest.raises(
        DesatError, match=r"unit oz\.in is not known: nothing says how N\.m\.s "
    ):
        prepare("nadir_day/day-dipole", Options(sources=[f"manager={path}"])).or_raise()


# --- FMUs of each role that say nothing of units, classes and dependencies ------------

DAY, TABLE = "nadir_day/day-dipole", "uosat12/table3-ocdc-ilqr-1"
BARE = [
    *((DAY, c) for c in ("controller", "determination", "environment", "guidance")),
    *((DAY, c) for c in ("gyro", "magnetometer", "manager", "spacecraft")),
    *((DAY, c) for c in ("tachometers", "torquers", "wheels")),
    *((TABLE, c) for c in ("environment", "spacecraft", "thrusters", "torquers")),
]
OF_MEANING = ("unit", "displayUnit", "declaredType", "quantity", "min", "max")


def strip(data: bytes) -> bytes:
    """Remove units, types, dependencies and our annotations from an FMU of ours."""
    bare_fmu = io.BytesIO()
    with (
        zipfile.ZipFile(io.BytesIO(data)) as old,
        zipfile.ZipFile(bare_fmu, "w") as new,
    ):
        for name in old.namelist():
            content = old.read(name)
            if name == "modelDescription.xml":
                root = etree.fromstring(content)
                for tag in ("UnitDefinitions", "TypeDefinitions", "VendorAnnotations"):
                    for element in root.findall(tag):
                        root.remove(element)
                for element in list(root.iter("Annotations")):
                    element.getparent().remove(element)
                for element in root.iter():
                    for key in (*OF_MEANING, "dependencies", "dependenciesKind"):
                        element.attrib.pop(key, None)
                content = etree.tostring(root)
            new.writestr(name, content)
    return bare_fmu.getvalue()


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The .ssp of each scenario."""
    packages = {}
    for name in (DAY, TABLE):
        file = tmp_path_factory.mktemp("packed") / "it.toml"
        file.write_text(f'extends = "{name}"\n')
        command = [sys.executable, "-m", "desat.cli", "pack", str(file)]
        subprocess.run(command, check=True, capture_output=True)
        packages[name] = file.with_suffix(".ssp").read_bytes()
    return packages


@pytest.mark.parametrize(("name", "component"), BARE)
def test_what_a_bare_fmu_cannot_have_is_left_out_in_a_package_and_by_source(
    packages: dict[str, bytes], tmp_path: Path, name: str, component: str
) -> None:
    """Of numbers, plots, limits and analyses, with a line each; both ways alike."""
    member = f"resources/{component}.fmu"
    other, bare = tmp_path / "other.ssp", tmp_path / f"{component}.fmu"
    with (
        zipfile.ZipFile(io.BytesIO(packages[name])) as old,
        zipfile.ZipFile(other, "w") as new,
    ):
        bare.write_bytes(strip(old.read(member)))
        for entry in old.namelist():
            data = bare.read_bytes() if entry == member else old.read(entry)
            new.writestr(entry, data)
    sources = [f"{component}={bare}"]
    lines = []
    for case in (
        prepare(str(other), Options(stop=20.0)),
        prepare(name, Options(stop=20.0, sources=sources)),
    ):
        case.or_raise()
        texts = [x for x in case.warnings if "left out" in x]
        assert len(set(texts)) == len(texts)
        # rows of a paper do not travel in a package
        lines.append({x.split(": ", 1)[1] for x in texts if ": paper." not in x})
    assert lines[0] == lines[1]
    run = desat.run(str(other), stop=20.0)
    assert run.manifest.status == "completed", run.manifest.message


def test_a_limit_that_does_not_fit_is_left_out_alone(
    packages: dict[str, bytes], tmp_path: Path
) -> None:
    """Its plot and the plot's other limits stay."""
    other = tmp_path / "other.ssp"
    with (
        zipfile.ZipFile(io.BytesIO(packages[DAY])) as old,
        zipfile.ZipFile(other, "w") as new,
    ):
        for entry in old.namelist():
            data = old.read(entry)
            if entry.endswith("scenario.json"):
                about = json.loads(data)
                (plot,) = (p for p in about["plots"] if p["name"] == "dipole")
                plot["limits"] = [1.0, "wheels.speed_limit", "torquers.m_limit"]
                data = json.dumps(about).encode()
            new.writestr(entry, data)
    case = prepare(str(other), Options(stop=20.0))
    system, _ = case.or_raise()
    (line,) = (x for x in case.warnings if "left out" in x)
    assert "plots.dipole.limits: unit of" in line
    limits = system.about.plots["dipole"].limits
    assert [x.value for x in limits] == [1.0, "torquers.m_limit"]
