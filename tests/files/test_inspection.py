"""`desat check FILE.fmu`: what the description of an FMU says, its binary not loaded."""

from __future__ import annotations

import json
import time
import zipfile
from pathlib import Path

import pytest

from desat.engine.instances import fmu as instances
from desat.files import paths
from tests.conftest import ROOT

DIST = ROOT / "fmus" / "dist"
NO_LIBRARY = b"not code: who loads it fails"
FMI1 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="1.0" modelName="one" modelIdentifier="one" guid="{1}"
 numberOfContinuousStates="0" numberOfEventIndicators="0">
<UnitDefinitions><BaseUnit unit="N.m"/></UnitDefinitions>
<ModelVariables>
<ScalarVariable name="u[1]" valueReference="0" causality="input">
<Real unit="N.m" start="0"/></ScalarVariable>
<ScalarVariable name="u[2]" valueReference="1" causality="input">
<Real unit="N.m" start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real unit="N.m"/></ScalarVariable>
<ScalarVariable name="gain" valueReference="3" variability="parameter">
<Real start="1"/></ScalarVariable>
</ModelVariables>
<Implementation><CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone></Implementation>
</fmiModelDescription>
"""
FMI2 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="2.0" modelName="two" guid="{2}">
<CoSimulation modelIdentifier="two"/>
<UnitDefinitions><Unit name="N.m"/></UnitDefinitions>
<ModelVariables>
<ScalarVariable name="u[1]" valueReference="0" causality="input" variability="continuous">
<Real unit="N.m" start="0"/></ScalarVariable>
<ScalarVariable name="u[2]" valueReference="1" causality="input" variability="continuous">
<Real unit="N.m" start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output" variability="continuous">
<Real unit="N.m"/></ScalarVariable>
<ScalarVariable name="gain" valueReference="3" causality="parameter" variability="fixed">
<Real start="1"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="3"/></Outputs>
<InitialUnknowns><Unknown index="3"/></InitialUnknowns></ModelStructure>
</fmiModelDescription>
"""
FMI3 = """<?xml version="1.0"?>
<fmiModelDescription fmiVersion="3.0" modelName="three" instantiationToken="{3}">
<CoSimulation modelIdentifier="three"/>
<UnitDefinitions><Unit name="N.m"/></UnitDefinitions>
<ModelVariables>
<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>
<Float64 name="u" valueReference="0" causality="input" variability="continuous" unit="N.m" start="0 0"><Dimension start="2"/></Float64>
<Float64 name="y" valueReference="2" causality="output" variability="continuous" unit="N.m"/>
<Float64 name="gain" valueReference="3" causality="parameter" variability="fixed" start="1"/>
</ModelVariables>
<ModelStructure><Output valueReference="2"/><InitialUnknown valueReference="2"/></ModelStructure>
</fmiModelDescription>
"""  # noqa: E501
LIBRARIES = {
    "1.0": "binaries/linux64/one.so",
    "2.0": "binaries/linux64/two.so",
    "3.0": "binaries/x86_64-linux/three.so",
}
DESCRIPTIONS = {"1.0": FMI1, "2.0": FMI2, "3.0": FMI3}


@pytest.fixture(autouse=True)
def _nothing_is_loaded(monkeypatch):
    """An FMU that is checked is never made an instance of."""

    def refuse(*_, **__):
        raise AssertionError("its binary was to be loaded")

    monkeypatch.setattr(instances.FmuInstance, "__init__", refuse)
    monkeypatch.setattr("ctypes.CDLL.__init__", refuse)


def write(path: Path, text: str, library: str) -> Path:
    with zipfile.ZipFile(path, "w") as file:
        file.writestr("modelDescription.xml", text)
        if library:
            file.writestr(library, NO_LIBRARY)
    return path


def of_version(folder: Path, version: str, old: str = "", new: str = "") -> Path:
    text = DESCRIPTIONS[version]
    assert old in text
    return write(folder / "it.fmu", text.replace(old, new, 1), LIBRARIES[version])


@pytest.mark.parametrize("version", DESCRIPTIONS)
def test_interface_platforms_and_hash_are_printed(desat, tmp_path, version):
    path = of_version(tmp_path, version)
    command = desat("check", str(path))
    assert command.returncode == 0, command.stderr
    assert command.stderr.count("warning: ") == 1
    assert "its library cannot be loaded: it is no library of Linux" in command.stderr
    assert f"FMI {version} for co-simulation" in command.stdout
    assert f"platforms: {LIBRARIES[version].split('/')[1]}\n" in command.stdout
    answer = json.loads(desat("check", str(path), "--json").stdout)
    assert answer["sha256"] in command.stdout
    assert answer["problems"] == []
    interface = {
        v["name"]: (v["causality"], v["shape"], v["unit"]) for v in answer["variables"]
    }
    interface.pop("time", None)
    assert interface == {
        "u": ("input", [2], "N.m"),
        "y": ("output", [], "N.m"),
        "gain": ("parameter", [], ""),
    }
    rows = [" ".join(line.split()) for line in command.stdout.splitlines()]
    assert any(row.startswith("u[2] ") and row.endswith(" N.m") for row in rows)


def test_an_extracted_one_and_one_of_ours(desat, tmp_path):
    path = DIST / "native" / "wheels.fmu"
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "wheels")
    one, other = (desat("check", str(p), "--json") for p in (path, tmp_path / "wheels"))
    assert one.returncode == other.returncode == 0
    first, second = json.loads(one.stdout), json.loads(other.stdout)
    assert first["ours"]
    assert first["variables"] == second["variables"]
    axes = next(v for v in first["variables"] if v["name"] == "axes_wheel")
    assert axes["shape"] == [3, 4]


@pytest.mark.parametrize(
    "name", ["wheels", "native/manager_predictive", "fmi3/thrusters"]
)
def test_ours_are_as_the_standard_wants_them(desat, name):
    path = paths.fmus() / f"{name}.fmu"
    if not path.exists():
        pytest.skip("it is not built here")
    command = desat("check", str(path))
    assert (command.returncode, command.stderr) == (0, "")


@pytest.mark.parametrize(
    ("version", "old", "new", "message"),
    [
        ("2.0", "<Real unit", '<Real bogus="1" unit', "bogus"),
        ("2.0", 'variability="fixed"', 'variability="continuous"', "gain"),
        ("2.0", 'variability="fixed"', 'variability="constant"', "gain"),
        ("2.0", 'index="3"', 'index="30"', "30"),
        ("2.0", 'index="3"', 'index="3" dependencies="77"', "77"),
        ("2.0", 'name="u[2]"', 'name="u[1]"', "u[1]"),
        ("2.0", 'unit="N.m" start', 'unit="oz.in" start', "oz.in"),
        ("2.0", ' guid="{2}"', "", "guid"),
        ("2.0", 'modelIdentifier="two"', 'modelIdentifier="other"', "no library other"),
        ("2.0", '<Outputs><Unknown index="3"/></Outputs>', "", "y"),
        (
            "2.0",
            "<Real unit",
            '<Real derivative="9" unit',
            "u[1]: derivative 9: allowed is 1 to 4",
        ),
        (
            "3.0",
            'Output valueReference="2"',
            'Output valueReference="2" dependencies="7"',
            " 7:",
        ),
        ("1.0", ' guid="{1}"', "", "guid"),
        ("1.0", 'causality="output"', 'causality="nonsense"', "nonsense"),
        ("1.0", 'valueReference="2"', "", "valueReference"),
        ("3.0", ' instantiationToken="{3}"', "", "instantiationToken"),
        ("3.0", 'Output valueReference="2"', 'Output valueReference="20"', "20"),
        ("3.0", 'variability="fixed"', 'variability="continuous"', "gain"),
        ("3.0", '<Float64 name="gain"', '<Float65 name="gain"', "Float65"),
    ],
)
def test_what_breaks_the_standard_is_a_problem(
    desat, tmp_path, version, old, new, message
):
    """Named by the file, and ended with 1; no word of a bug of ours."""
    path = of_version(tmp_path, version, old, new)
    command = desat("check", str(path))
    assert command.returncode == 1, command.stdout
    assert "Traceback" not in command.stderr
    assert "error: internal" not in command.stderr
    *lines, last = command.stderr.splitlines()
    assert last == f"1 problem(s) in {path}" or int(last.split()[0]) == len(lines)
    assert all(line.startswith("it.fmu: ") for line in lines)
    assert message in " ".join(lines)
    answer = json.loads(desat("check", str(path), "--json").stdout)
    assert answer["problems"]


def test_an_fmu_without_a_binary_and_sources_breaks_the_standard(desat, tmp_path):
    path = write(tmp_path / "it.fmu", FMI2, "")
    command = desat("check", str(path))
    assert command.returncode == 1
    assert "it.fmu: neither a library in binaries/ nor sources/" in command.stderr


@pytest.mark.parametrize(
    ("old", "new", "library", "message"),
    [
        ("CoSimulation", "ModelExchange", LIBRARIES["2.0"], "for model exchange alone"),
        ("", "", "binaries/win64/two.dll", "has no binary for linux64; there is win64"),
    ],
)
def test_what_would_not_run_here_is_a_warning(
    desat, tmp_path, old, new, library, message
):
    path = write(tmp_path / "it.fmu", FMI2.replace(old, new) if old else FMI2, library)
    command = desat("check", str(path))
    assert command.returncode == 0
    assert command.stderr.startswith("warning: it.fmu")
    assert message in command.stderr


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "No such file or directory"),
        (b"", "not a readable archive"),
        (b"PK\x03\x04 cut", "not a readable archive"),
        ({"readme.txt": "x"}, "modelDescription.xml: no such file"),
        ({"modelDescription.xml": "<fmiModel"}, "modelDescription.xml:1: "),
        ({"modelDescription.xml": "<!DOCTYPE x><fmiModelDescription/>"}, "DOCTYPE"),
        ({"modelDescription.xml": "<html/>"}, "the description of an FMU of FMI"),
        (
            {
                "modelDescription.xml": FMI2.replace(
                    'fmiVersion="2.0"', 'fmiVersion="9"'
                )
            },
            "FMI 9",
        ),
        ({"../modelDescription.xml": FMI2}, "would leave the folder"),
    ],
)
def test_what_is_no_fmu_is_a_line(desat, tmp_path, content, message):
    path = tmp_path / "it.fmu"
    if isinstance(content, bytes):
        path.write_bytes(content)
    elif content is not None:
        with zipfile.ZipFile(path, "w") as file:
            for name, text in content.items():
                file.writestr(name, text)
    command = desat("check", str(path))
    assert command.returncode == 2
    assert len(command.stderr.splitlines()) == 1
    assert "it.fmu" in command.stderr
    assert message in command.stderr


@pytest.mark.parametrize(
    "option", [["--set", "a.b=1"], ["--stop", "5"], ["--schedule"]]
)
def test_options_of_systems_are_refused(desat, tmp_path, option):
    command = desat("check", str(of_version(tmp_path, "2.0")), *option)
    assert command.returncode == 2
    assert (
        command.stderr == f"error: {option[0]}: it is of a system, and this is an FMU\n"
    )


def test_a_list_of_trusted_hashes_holds(desat, tmp_path):
    path = of_version(tmp_path, "2.0")
    answer = json.loads(desat("check", str(path), "--json").stdout)
    hashes = tmp_path / "trusted"
    hashes.write_text(f"{answer['sha256']}  it.fmu\n")
    assert desat("check", str(path), "--trust", str(hashes)).returncode == 0
    hashes.write_text("0" * 64)
    command = desat("check", str(path), "--trust", str(hashes))
    assert command.returncode == 1
    assert "it.fmu is not of the list of --trust" in command.stderr


# Names in the notation of FMI 2.0.4, section 2.2.9, {} a number.
LEGAL = (
    *("a.b{0}[{0}].c", "der(x{0})", "'q {0} $'.y", "m{0}[1,2,{0}]", "_p{0}"),
    *("der(a.b{0}[2].'w'.c,2)", "long.path.of.a.library{0}.port[3].v", "'a \" b{0}'"),
)
ILLEGAL = (
    *("a b", "der(x", "'q", "x[1", "x[a]", "1x", "a..b", "a.", "''", "der(x,)", "ä"),
    *("der(der(x))", "a[1][2]", "x[]", "x[1,]", "", "'a'b", "a-b", "der(x,2).y", "x²"),
)


def test_names_are_judged_as_fmpy_does():
    from types import SimpleNamespace

    from fmpy.validation import _validate_variable_names as judge
    from lxml import etree

    from desat.files.fmu import _name_faults

    names = [*(text.format(7) for text in LEGAL), *ILLEGAL]
    root = etree.Element("fmiModelDescription", variableNamingConvention="structured")
    variables = etree.SubElement(root, "ModelVariables")
    for name in names:
        etree.SubElement(variables, "ScalarVariable", name=name)
    fault_lines = list(_name_faults(root))
    rows = [SimpleNamespace(name=name, sourceline=1) for name in names]
    theirs = judge(
        SimpleNamespace(variableNamingConvention="structured", modelVariables=rows)
    )
    assert len(fault_lines) == len(theirs) == len(ILLEGAL)
    for name, line in zip(ILLEGAL, fault_lines, strict=True):
        assert line.startswith(f"{name!r} (line ")
    root.set("variableNamingConvention", "flat")
    variables[0].set("name", "a\tb")
    (line,) = _name_faults(root)
    assert line.startswith("'a\\tb' (line ")


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_two_thousand_variables_take_less_than_a_second(desat, tmp_path, version):
    """A general parser took 11 s for 1,909 names; a slow machine has twice as long."""
    text = DESCRIPTIONS[version].replace(
        "guid=", 'variableNamingConvention="structured" guid='
    )
    rows = "".join(
        f'<ScalarVariable name="{LEGAL[i % 7].format(i)}" valueReference="{10 + i}">'
        "<Real/></ScalarVariable>\n"
        for i in range(2000)
    )
    text = text.replace("</ModelVariables>", f"{rows}</ModelVariables>")
    path = write(tmp_path / "it.fmu", text, LIBRARIES[version])
    seconds = []
    for _ in range(3):  # the least is its own, the rest is the machine's
        start_time = time.process_time()
        command = desat("check", str(path))
        seconds.append(time.process_time() - start_time)
    assert min(seconds) < 2.0
    assert command.returncode == 0, command.stderr
    assert "der(x1)" in command.stdout
