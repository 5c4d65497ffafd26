"""Files of other tools: what FMI and SSP allow is read, what they forbid and what is
harmless is a warning, and what would be lost is refused."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Iterable
from pathlib import Path

import pytest
from scipy.io import loadmat

import desat
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import ROOT
from tests.files.test_foreign_ssp import NAMESPACES, system, wire

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="typed" guid="{{g}}">
<CoSimulation modelIdentifier="typed" canHandleVariableCommunicationStepSize="true"/>
{types}<DefaultExperiment stopTime="2" stepSize="0.5"/>
<ModelVariables>{variables}</ModelVariables>
<ModelStructure><Outputs>{outputs}</Outputs>{unknowns}</ModelStructure>
</fmiModelDescription>"""


@pytest.fixture(scope="session")
def typed_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library of typed.c."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    library = tmp_path_factory.mktemp("typed") / "typed.so"
    source = ROOT / "tests" / "typed.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def variable(
    name: str, reference: int, kind: str = "Real", causality: str = "input", **more: str
) -> str:
    """A variable of FMI 2.0; `start`, `unit` and the like belong to its type."""
    of_type = {"start", "unit", "declaredType", "min", "max"}
    usual = {"input": {"start": "0"}, "parameter": {"start": "0"}}.get(causality, {})
    inner = usual | {k: v for k, v in more.items() if k in of_type}
    outer = {k: v for k, v in more.items() if k not in of_type}
    if causality == "parameter":
        outer = {"variability": "fixed"} | outer
    if kind != "Real" and causality in ("input", "output"):
        outer = {"variability": "discrete"} | outer
    attributes = "".join(f' {k}="{v}"' for k, v in outer.items())
    values = "".join(f' {k}="{v}"' for k, v in inner.items() if v != "-")
    return (
        f'<ScalarVariable name="{name}" valueReference="{reference}" '
        f'causality="{causality}"{attributes}><{kind}{values}/></ScalarVariable>\n'
    )


def fmu(
    path: Path,
    library: Path,
    variables: Iterable[str],
    types: str = "",
    unknowns: str = "",
    dependencies: str = ' dependencies=""',
) -> Path:
    """An FMU of typed.c with these variables."""
    rows = list(variables)
    outputs = "".join(
        f'<Unknown index="{i}"{dependencies}/>'
        for i, row in enumerate(rows, 1)
        if 'causality="output"' in row
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        text = DESCRIPTION.format(
            types=types, variables="".join(rows), outputs=outputs, unknowns=unknowns
        )
        archive.writestr("modelDescription.xml", text)
        archive.write(library, "binaries/linux64/typed.so")
    return path


def component(name: str, ends: str = "", bindings: str = "", fmu: str = "") -> str:
    """A component; ends are its listed connectors."""
    connectors = f"<ssd:Connectors>{ends}</ssd:Connectors>" if ends else ""
    source = fmu or f"{name}.fmu"
    return (
        f'<ssd:Component name="{name}" source="resources/{source}">{connectors}{bindings}'
        "</ssd:Component>"
    )


def connector(name: str, kind: str, type: str = "Real", inner: str = "") -> str:
    element = f"<ssc:{type}/>" if type else ""
    return (
        f'<ssd:Connector name="{name}" kind="{kind}">{element}{inner}</ssd:Connector>'
    )


def values(**inputs: str) -> str:
    """A parameter set: the value of each name, as `Real 3`."""
    rows = "".join(
        '<ssv:Parameter name="{}"><ssv:{} value="{}"/></ssv:Parameter>'.format(
            name, *text.split(" ", 1)
        )
        for name, text in inputs.items()
    )
    return (
        "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>"
        '<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>'
        f"{rows}</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues>"
        "</ssd:ParameterBinding></ssd:ParameterBindings>"
    )


def write(folder: Path, elements: str, wires: str = "", version: str = "1.0") -> Path:
    file = folder / "SystemStructure.ssd"
    file.write_text(
        f'<ssd:SystemStructureDescription version="{version}" name="x" {NAMESPACES}>\n'
        f"{system('s', elements, wires)}\n</ssd:SystemStructureDescription>",
        encoding="utf-8",
    )
    return file


def run(file: Path, **options: object) -> desat.Run:
    result = desat.run(str(file), stop=2.0, step=0.5, substeps=1, **options)
    assert result.manifest.status == "completed", result.manifest.message
    return result


def check_file(file: Path, **options: object):
    return prepare(str(file), Options(stop=2.0, step=0.5, **options))


# --- names ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    ["a[1].b", "y/z", "a[1].b[2].c", ".", "..", "100%", "y%2Fz", "der(y)", "'y z'"],
)
@pytest.mark.parametrize("in_folder", [True, False])
def test_a_series_has_the_name_of_its_variable(
    typed_library, tmp_path, name, in_folder
):
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("u", 1, start="10"), variable(name, 17, causality="output")],
    )
    file = write(tmp_path, component("a"))
    folder = {"folder": tmp_path / "out"} if in_folder else {}
    results = run(file, **folder).results
    assert results.names() == [f"a.{name}"]
    assert results.values(f"a.{name}").tolist() == [10.0] * 5


def test_names_that_matlab_does_not_allow_are_changed_and_told(typed_library, tmp_path):
    """Nothing is left out of the file."""
    from desat.export.series import export

    names = ["y/z", "y_z", "y%z", "1", "units", "long" * 20]
    rows = [variable(name, 17, causality="output") for name in names]
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("u", 1, start="10"), *rows],
    )
    file = write(tmp_path, component("interval", fmu="a.fmu"))
    run(file, folder=tmp_path / "out")
    (path,), note = export(tmp_path / "out", "mat")
    struct = loadmat(path, simplify_cells=True)["interval_2"]
    assert "interval.y/z is interval_2.y_z" in note
    fields = set(struct) - {"units", "names"}
    assert len(fields) == len(struct["names"]) == len(names)
    assert {f"interval.{name}" for name in names} == set(struct["names"].values())
    assert all(struct[field].tolist() == [10.0] * 5 for field in fields)


def test_elements_of_an_array_in_an_array_are_series(typed_library, tmp_path):
    outputs = [variable(f"a[1].b[{i}]", 16 + i, causality="output") for i in (1, 2)]
    others = [variable("a[1].c", 19, causality="output")]
    fmu(tmp_path / "resources/a.fmu", typed_library, [*outputs, *others])
    results = run(write(tmp_path, component("a"))).results
    assert results.names() == ["a.a[1].b", "a.a[1].c"]
    assert results.values("a.a[1].b")[-1].tolist() == [10.0, 20.0]
    assert results.values("a.a[1].c")[-1] == 30.0


# --- connectors -----------------------------------------------------------------------


def test_a_listed_connector_that_nobody_uses_is_a_warning(typed_library, tmp_path):
    """Such as a tool's own settings, and one of another type; all in one line."""
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("u", 0), variable("y", 16, causality="output")],
    )
    ends = (
        connector("fmi_rTol", "parameter")
        + connector("u", "input", "", '<ssc:Binary mime-type="application/x"/>')
        + connector("y", "output")
    )
    file = write(tmp_path, component("a", ends))
    case = check_file(file)
    assert case.problems == []
    [line] = [w for w in case.warnings if "fmi_rTol" in w]
    assert "a.fmi_rTol: the FMU has no such variable" in line
    assert line.endswith("u: listed as Binary, but it is Real; they are not used")
    run(file)
    for use in (values(fmi_rTol="Real 1e-3"), values(u="Real 1")):
        [line] = check_file(write(tmp_path, component("a", ends, use))).problems
        assert "SystemStructure.ssd:2: a." in line


def test_wired_connectors_that_do_not_fit_are_refused_in_one_line(
    typed_library, tmp_path
):
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("y", 16, causality="output")],
    )
    fmu(tmp_path / "resources/b.fmu", typed_library, [variable("u", 0)])
    ends = connector("u", "input", "Boolean") + connector("v", "input")
    file = write(
        tmp_path,
        component("a", connector("y", "output")) + component("b", ends),
        wire("a.y", "b.u") + wire("a.y", "b.v"),
    )
    lines = [p for p in check_file(file).problems if "listed" in p]
    assert len(lines) == 1
    assert "b.u: listed as Boolean, but it is Real; v: the FMU has no such" in lines[0]


# --- types ----------------------------------------------------------------------------

TYPES = (
    '<TypeDefinitions><SimpleType name="law"><Enumeration><Item name="off" value="0"/>'
    '<Item name="on" value="1"/></Enumeration></SimpleType></TypeDefinitions>'
)


@pytest.mark.parametrize("loop", ["compiled", "python"])
@pytest.mark.parametrize("listed_type", ["Integer", "Real"])
def test_an_integer_feeds_a_real_and_an_enumeration_an_integer(
    typed_library, tmp_path, loop, listed_type
):
    """Also where a connector says Real and the variable is an Integer; factor and
    offset are those of the connection."""
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [
            variable("i", 0, "Integer", start="0"),
            variable("law", 1, "Enumeration", declaredType="law", start="0"),
            variable("y", 16, "Integer", "output"),
            variable("z", 17, "Enumeration", "output", declaredType="law"),
            variable("x", 16, causality="output"),
        ],
        TYPES,
    )
    fmu(
        tmp_path / "resources/b.fmu",
        typed_library,
        [
            variable("u", 0),
            variable("v", 1),
            variable("n", 0, "Integer"),
            variable("x", 2),
            variable("copy_u", 16, causality="output"),
            variable("copy_v", 17, causality="output"),
            variable("copy_n", 16, "Integer", "output"),
            variable("copy_x", 18, causality="output"),
        ],
    )
    ends = connector("y", "output", listed_type)
    ends += "".join(connector(n, "output", "") for n in "zx")
    twice = '<ssc:LinearTransformation factor="2" offset="0.5"/>'
    wires = wire("a.y", "b.u") + wire("a.y", "b.v", twice) + wire("a.z", "b.n")
    file = write(
        tmp_path,
        component("a", ends, values(i="Integer 7", law="Enumeration on"))
        + component("b"),
        wires + wire("a.x", "b.x"),
    )
    results = run(file, loop=loop).results
    last = {n: results.values(f"b.{n}")[-1] for n in ("copy_u", "copy_v", "copy_n")}
    assert last == {"copy_u": 7.0, "copy_v": 14.5, "copy_n": 1}


@pytest.mark.parametrize(
    ("source", "target"),
    [
        ("Real", "Integer"),
        ("Real", "Boolean"),
        ("Boolean", "Integer"),
        ("String", "Real"),
        ("Real", "String"),
        ("Integer", "Boolean"),
    ],
)
def test_what_would_lose_something_is_refused_by_check(
    typed_library, tmp_path, source, target
):
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("y", 16, source, "output")],
    )
    more = {"start": "text"} if target == "String" else {}
    fmu(tmp_path / "resources/b.fmu", typed_library, [variable("u", 0, target, **more)])
    file = write(tmp_path, component("a") + component("b"), wire("a.y", "b.u"))
    [line] = check_file(file).problems
    assert line.endswith(f"a.y -> b.u: type {source} does not fit {target}")


def test_a_text_is_passed_on(typed_library, tmp_path):
    """From a to b, which counts its letters in a step, to c."""
    text = [
        variable("s", 0, "String", start="-"),
        variable("t", 16, "String", "output"),
    ]
    letters = variable("n", 15, "Integer", "output")
    for name in "abc":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, [*text, letters])
    file = write(
        tmp_path,
        component("a", "", values(s="String a text")) + component("b") + component("c"),
        wire("a.t", "b.s") + wire("b.t", "c.s"),
    )
    results = run(file).results
    assert results.names() == ["a.n", "b.n", "c.n"]
    assert [int(results.values(f"{n}.n")[-1]) for n in "abc"] == [6, 6, 6]
    again = run(file, isolate="none").results
    assert [int(again.values(f"{n}.n")[-1]) for n in "abc"] == [6, 6, 6]


# --- what may be set before initialisation --------------------------------------------


def test_outputs_and_locals_may_be_set_where_initial_says_so(typed_library, tmp_path):
    """By a parameter set and by --set; the FMU shows them at the start."""
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [
            variable("x", 1, causality="output", initial="approx", start="1"),
            variable("hidden", 2, causality="local", initial="exact", start="1"),
            variable("computed", 3, causality="local"),
            variable("fixed", 4, causality="local", variability="constant", start="3"),
            variable("text", 0, "String", "parameter", start="-"),
            variable("show", 18, causality="output"),
            variable("n", 15, "Integer", "output"),
        ],
    )
    binding = values(x="Real 4", hidden="Real 5", text="String seven 7")
    file = write(tmp_path, component("a", "", binding))
    results = run(file).results
    assert results.values("a.x")[0] == 4.0
    assert results.values("a.show")[0] == 5.0
    assert results.values("a.n")[-1] == len("seven 7")
    sets = {"a.x": 6.0, "a.hidden": 7.0, "a.text": "four"}
    results = run(file, sets=sets).results
    assert results.values("a.x")[0] == 6.0
    assert results.values("a.show")[0] == 7.0
    assert results.values("a.n")[-1] == 4
    for name in ("computed", "fixed"):
        with pytest.raises(
            DesatError, match=rf"a\.{name} is a local, whose start value"
        ):
            run(file, sets={f"a.{name}": 1.0})
    with pytest.raises(DesatError, match=r"a\.text = 3: a String is needed"):
        run(file, sets={"a.text": 3})


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *((x, x) for x in ("43", "043.50", "true", "1979-05-27", "1, two", "[1]")),
        ('"43"', "43"),
        ("k * 2", "k * 2"),
    ],
)
def test_a_text_is_set_as_it_is_typed(typed_library, tmp_path, value, text):
    rows = [variable("s", 0, "String", start="-")]
    rows += [variable("t[1]", 2, "String", start="-")]
    rows += [variable("t[2]", 3, "String", start="-")]
    rows += [variable("y", 16, causality="output")]
    fmu(tmp_path / "resources/a.fmu", typed_library, rows)
    file = write(tmp_path, component("a"))
    sets = [f"a.s={value}", "a.t=1,02"]
    parameters = check_file(file, sets=sets).or_raise()[0].components["a"].parameters
    assert parameters == {"s": text, "t[1]": "1", "t[2]": "02"}


# --- faults of a description ----------------------------------------------------------


@pytest.mark.parametrize(
    ("rows", "more", "message"),
    [
        (
            [variable("p", 0, causality="parameter", variability="continuous")],
            {},
            "p: causality parameter with variability continuous: fixed or tunable is "
            "allowed: taken for tunable",
        ),
        (
            [variable("p", 0, variability="fixed")],
            {},
            "causality input with variability fixed: discrete or continuous is allowed: "
            "taken for continuous",
        ),
        (
            [variable("p", 0)],
            {"dependencies": ' dependencies="1 99"'},
            "dependencies '99' is no variable; 1 to 2 are allowed: it is taken to depend "
            "on everything",
        ),
        (
            [variable("p", 0)],
            {"unknowns": '<InitialUnknowns><Unknown index="7"/></InitialUnknowns>'},
            "index '7' is no variable; 1 to 2 are allowed: it is left out",
        ),
        (
            [variable("p", 0).replace("<Real ", '<Real derivative="9" ')],
            {},
            "derivative '9' is no variable; 1 to 2 are allowed: it is left out",
        ),
        (
            [variable("p", 0).replace("<Real ", '<Real declaredType="Angle" ')],
            {},
            "p: declaredType Angle is not defined: it is left out",
        ),
    ],
)
def test_a_fault_that_other_tools_tolerate_is_a_warning(
    typed_library, tmp_path, rows, more, message
):
    """--strict refuses it."""
    outputs = [variable("y", 16, causality="output")]
    fmu(tmp_path / "resources/a.fmu", typed_library, [*rows, *outputs], **more)
    file = write(tmp_path, component("a", "", values(p="Real 3")))
    case = check_file(file)
    assert case.problems == []
    [line] = [w for w in case.warnings if "not as FMI wants it" in w]
    assert message in line
    assert run(file).results.values("a.y")[-1] == 3.0
    assert any(message in p for p in check_file(file, strict=True).problems)


# --- arrays in part -------------------------------------------------------------------


def test_an_array_of_a_foreign_fmu_may_be_given_in_part(typed_library, tmp_path):
    """Wired, in a parameter set, by --set: the rest keeps its start values."""
    rows = [variable(f"u[{i}]", i, start=f"{10 * i}") for i in (1, 2, 3)]
    rows += [variable(f"y[{i}]", 16 + i, causality="output") for i in (1, 2, 3)]
    for name in "ab":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, rows)
    wires = wire("a.y[1]", "b.u[2]")
    file = write(tmp_path, component("a") + component("b"), wires)
    [line] = [w for w in check_file(file).warnings if "in part" in w]
    assert "b.u is wired or given in part: u[1], u[3] of 3 keep the start" in line
    assert run(file).results.values("b.y")[-1].tolist() == [10.0, 10.0, 30.0]
    results = run(file, sets={"a.u[1]": 5.0, "b.u[3]": 7.0}).results
    assert results.values("b.y")[-1].tolist() == [10.0, 5.0, 7.0]
    binding = values(**{"u[2]": "Real 4"})
    file = write(tmp_path, component("a", "", binding))
    assert run(file).results.values("a.y")[-1].tolist() == [10.0, 4.0, 30.0]
    with pytest.raises(DesatError, match=r"no variable u\[4\]"):
        run(file, sets={"a.u[4]": 1.0})


# --- units ----------------------------------------------------------------------------


def test_units_of_one_name_and_two_definitions_are_a_warning(typed_library, tmp_path):
    units = (
        '<UnitDefinitions><Unit name="x"><BaseUnit m="1" factor="{}"/></Unit>'
        "</UnitDefinitions>"
    )
    outputs = [variable("y", 16, causality="output", unit="x")]
    rows = [variable("u", 0, unit="x", start="3"), *outputs]
    fmu(tmp_path / "resources/a.fmu", typed_library, rows, units.format(1))
    fmu(tmp_path / "resources/b.fmu", typed_library, rows, units.format(1000))
    inputs = values(u="Real 3").replace('value="3"', 'value="3" unit="x"')
    own_value = (
        '</ssv:Parameters><ssv:Units><ssc:Unit name="x"><ssc:BaseUnit m="1" '
        'factor="7"/></ssc:Unit></ssv:Units>'
    )
    elements = component("a", "", inputs.replace("</ssv:Parameters>", own_value))
    file = write(tmp_path, elements + component("b"), wire("a.y", "b.u"))
    assert run(file).results.values("b.y")[-1] == 3.0
    lines = [w for w in check_file(file).warnings if "is defined in two ways" in w]
    assert len(lines) == 2
    assert (
        "a.y -> b.u: u: the unit x is defined in two ways: the value is taken"
        in lines[1]
    )


# --- archives -------------------------------------------------------------------------


@pytest.mark.parametrize("form", ["./{}", "{}", ".\\{}"])
def test_archives_with_dots_and_backslashes_are_read(typed_library, tmp_path, form):
    def rewrite_name(name: str) -> str:
        return form.format(name.replace("/", "\\") if "\\" in form else name)

    rows = [variable("u", 1), variable("y", 17, causality="output")]
    plain = fmu(tmp_path / "resources/a.fmu", typed_library, rows)
    odd = tmp_path / "odd.fmu"
    with zipfile.ZipFile(plain) as old, zipfile.ZipFile(odd, "w") as new:
        new.writestr(zipfile.ZipInfo("./"), "")
        for entry in old.infolist():
            new.writestr(zipfile.ZipInfo(rewrite_name(entry.filename)), old.read(entry))
    file = write(tmp_path, component("a"))
    archive_file = tmp_path / "their.ssp"
    with zipfile.ZipFile(archive_file, "w") as archive:
        archive.writestr(zipfile.ZipInfo("./"), "")
        archive.writestr(zipfile.ZipInfo(rewrite_name("resources/")), "")
        archive.writestr(
            zipfile.ZipInfo(rewrite_name("resources/a.fmu")), odd.read_bytes()
        )
        archive.writestr(zipfile.ZipInfo(rewrite_name(file.name)), file.read_bytes())
    assert run(archive_file).results.values("a.y")[-1] == 10.0


@pytest.mark.parametrize("name", ["../x", "..\\x", "/x", "\\x", "C:\\x", "a/../../x"])
def test_what_leaves_the_folder_of_an_archive_is_refused(tmp_path, name):
    archive_file = tmp_path / "their.ssp"
    with zipfile.ZipFile(archive_file, "w") as archive:
        archive.writestr(zipfile.ZipInfo(name), "")
    with pytest.raises(DesatError) as caught:
        desat.run(str(archive_file))
    [line] = str(caught.value).splitlines()
    assert line.startswith("their.ssp: entry ")
    assert line.endswith(" would leave the folder")


# --- algebraic loops ------------------------------------------------------------------


def feedthrough(folder: Path, library: Path, name: str) -> None:
    """y = 2 u + 1, at once."""
    rows = [variable("u", 0), variable("y", 24, causality="output")]
    path = folder / f"resources/{name}.fmu"
    fmu(path, library, rows, dependencies=' dependencies="1"')


def test_a_genuine_loop_is_refused_with_the_options_that_help(typed_library, tmp_path):
    for name in "ab":
        feedthrough(tmp_path, typed_library, name)
    wires = wire("a.y", "b.u") + wire("b.y", "a.u")
    file = write(tmp_path, component("a") + component("b"), wires)
    [line] = check_file(file).problems
    for text in (
        "cycle over the step: a.y -> b.y -> a",
        "--output-class b.y=state",
        "--algorithm jacobi",
        "--solve-loops",
    ):
        assert text in line


@pytest.mark.parametrize("isolate", ["none", "foreign"])
@pytest.mark.parametrize("factor", [0.1, 0.75, -2.0])
def test_a_genuine_loop_is_solved(typed_library, tmp_path, factor, isolate):
    """a = 2 f b + 1, b = 2 a + 1; also where a fixed point iteration would diverge."""
    for name in "abc":
        feedthrough(tmp_path, typed_library, name)
    back = f'<ssc:LinearTransformation factor="{factor}"/>'
    wires = wire("a.y", "b.u") + wire("b.y", "a.u", back) + wire("b.y", "c.u")
    elements = component("a") + component("b") + component("c")
    file = write(tmp_path, elements, wires)
    a = (1.0 + 2.0 * factor) / (1.0 - 4.0 * factor)
    loop_run = run(file, solve_loops=True, isolate=isolate)
    values = {n: loop_run.results.values(f"{n}.y").tolist() for n in "abc"}
    assert values["a"] == pytest.approx([a] * 5, rel=1e-9)
    assert values["b"] == pytest.approx([2.0 * a + 1.0] * 5, rel=1e-9)
    assert values["c"] == pytest.approx([4.0 * a + 3.0] * 4, rel=1e-9)
    assert any("algebraic loop of a, b" in w for w in loop_run.manifest.warnings)


def test_a_genuine_loop_runs_with_jacobi(typed_library, tmp_path):
    """A step late from the solution on, which it keeps: it is a fixed point."""
    for name in "ab":
        feedthrough(tmp_path, typed_library, name)
    back = '<ssc:LinearTransformation factor="0.1"/>'
    wires = wire("a.y", "b.u") + wire("b.y", "a.u", back)
    file = write(tmp_path, component("a") + component("b"), wires)
    jacobi_run = run(file, algorithm="jacobi")
    assert jacobi_run.results.values("a.y")[-1] == pytest.approx(2.0, rel=1e-9)


def test_a_loop_without_a_solution_is_a_line(typed_library, tmp_path):
    for name in "ab":
        feedthrough(tmp_path, typed_library, name)
    back = '<ssc:LinearTransformation factor="0.25"/>'
    wires = wire("a.y", "b.u") + wire("b.y", "a.u", back)
    file = write(tmp_path, component("a") + component("b"), wires)
    with pytest.raises(DesatError, match=r"algebraic loop of .*: no solution after"):
        desat.run(str(file), stop=2.0, step=0.5, substeps=1, solve_loops=True)


def test_solving_where_there_is_no_loop_is_a_warning(typed_library, tmp_path):
    feedthrough(tmp_path, typed_library, "a")
    file = write(tmp_path, component("a"))
    assert (
        "--solve-loops: there is no algebraic loop"
        in check_file(file, solve_loops=True).warnings
    )


ALL, SILENT, NONE = ' dependencies="1"', "", ' dependencies=""'
"""Of an output's dependencies: its input, not said, no input."""
# a = 0.5 b + 1, b = 0.5 a + 2, by 2 u + 1 at both ends
TO_A = '<ssc:LinearTransformation factor="0.25"/>'
TO_B = '<ssc:LinearTransformation factor="0.25" offset="0.5"/>'


def ring(
    folder: Path,
    library: Path,
    lines_found: Iterable[str],
    outputs: Iterable[int] = (24, 24),
) -> Path:
    """a and b in a loop whose gain is 0.25; 24: y follows u at once, 12: in a step."""
    for name, dependencies, y in zip("ab", lines_found, outputs, strict=True):
        rows = [variable("u", 0), variable("y", y, causality="output")]
        fmu(folder / f"resources/{name}.fmu", library, rows, dependencies=dependencies)
    wires = wire("a.y", "b.u", TO_B) + wire("b.y", "a.u", TO_A)
    return write(folder, component("a") + component("b"), wires)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"solve_loops": True},
        {"algorithm": "jacobi"},
        {"output_classes": {"b.y": "state"}},
        {"output_classes": {"a.y": "state", "b.y": "state"}},
    ],
)
@pytest.mark.parametrize(
    "dependencies", [(SILENT, SILENT), (ALL, SILENT), (SILENT, ALL)]
)
def test_an_undeclared_loop_is_solved_at_the_start(
    typed_library, tmp_path, dependencies, options
):
    """It did not settle. Steps keep the solution, as it is a fixed point."""
    loop_run = run(ring(tmp_path, typed_library, dependencies), **options)
    for name, value in (("a", 8.0 / 3.0), ("b", 10.0 / 3.0)):
        samples = loop_run.results.values(f"{name}.y").tolist()
        assert samples == pytest.approx([value] * len(samples), rel=1e-9)
    text = "\n".join(loop_run.manifest.warnings)
    assert "there is no algebraic loop" not in text
    if options.get("solve_loops"):
        assert "algebraic loop of a, b" in text
        assert "declares no dependencies" not in text


def test_a_declared_loop_that_is_taken_late_is_solved_at_the_start(
    typed_library, tmp_path
):
    file = ring(tmp_path, typed_library, (ALL, ALL))
    loop_run = run(file, output_classes={"b.y": "state"})
    assert loop_run.results.values("a.y")[0] == pytest.approx(8.0 / 3.0, rel=1e-9)


def test_undeclared_loops_of_one_and_of_three_are_solved(typed_library, tmp_path):
    """y = 0.5 y + 1; and a, b, c, of which each takes a quarter of the one before."""
    rows = [variable("u", 0), variable("y", 24, causality="output")]
    for name in "abc":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, rows, dependencies="")
    alone = write(tmp_path, component("a"), wire("a.y", "a.u", TO_A))
    for options in ({}, {"solve_loops": True}):
        assert run(alone, **options).results.values("a.y")[-1] == pytest.approx(2.0)
    wires = (
        wire("a.y", "b.u", TO_A) + wire("b.y", "c.u", TO_A) + wire("c.y", "a.u", TO_A)
    )
    three = write(tmp_path, "".join(map(component, "abc")), wires)
    for options in ({}, {"solve_loops": True}):
        results = run(three, **options).results
        for name in "abc":
            assert results.values(f"{name}.y")[0] == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize("isolate", ["none", "foreign"])
@pytest.mark.parametrize(
    ("outputs", "output_names"), [((12, 12), "a.y, b.y"), ((24, 12), "b.y")]
)
def test_what_does_not_answer_between_steps_is_named(
    typed_library, tmp_path, isolate, outputs, output_names
):
    """Its loop was called solved: 2.66504 in place of 8/3."""
    file = ring(tmp_path, typed_library, (ALL, ALL), outputs)
    with pytest.raises(DesatError) as error:
        desat.run(
            str(file), stop=2.0, step=0.5, substeps=1, solve_loops=True, isolate=isolate
        ).or_raise("it")
    assert f"does not answer to them between two steps: {output_names}; " in str(
        error.value
    )
    assert f"--output-class {output_names[:3]}=state" in str(error.value)
    late = {f"{name}.y": "state" for name in "ab"}
    run(file, solve_loops=True, isolate=isolate, output_classes=late)


@pytest.mark.parametrize("dependencies", [SILENT, NONE])
def test_what_declares_nothing_may_be_a_state_and_is_told(
    typed_library, tmp_path, dependencies
):
    """It is named once; one that declares that it is a state is not."""
    loop_run = run(
        ring(tmp_path, typed_library, (dependencies, dependencies), (12, 12)),
        solve_loops=True,
    )
    text = "\n".join(loop_run.manifest.warnings)
    lines = [x for x in loop_run.manifest.warnings if "does not answer to u" in x]
    assert len(lines) == (2 if dependencies == SILENT else 0)
    assert ("there is no algebraic loop" in text) == (dependencies == NONE)


# --- words ----------------------------------------------------------------------------


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_one_text_is_one_line_with_its_count(typed_library, tmp_path, isolate):
    """That an FMU logs at each of four steps."""
    rows = [variable("loud", 14, "Boolean", "parameter", start="false")]
    rows += [variable("y", 16, causality="output")]
    fmu(tmp_path / "resources/a.fmu", typed_library, rows)
    file = write(tmp_path, component("a", "", values(loud="Boolean true")))
    log_run = run(file, isolate=isolate)
    assert [w for w in log_run.manifest.warnings if "again" in w] == [
        "a: not again (4 times)"
    ]


def test_a_fault_of_many_components_is_one_line(typed_library, tmp_path):
    rows = [variable("p", 0, variability="fixed")]
    rows += [variable("y", 16, causality="output")]
    fmu(tmp_path / "resources/a.fmu", typed_library, rows)
    elements = "".join(component(f"c{i}", fmu="a.fmu") for i in range(12))
    lines = [
        w for w in check_file(write(tmp_path, elements)).warnings if "FMI wants" in w
    ]
    assert len(lines) == 1
    assert lines[0].startswith("c0, c1 and 10 more: a.fmu: not as FMI wants it")


def test_a_step_that_is_given_is_not_missed(typed_library, tmp_path):
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("y", 16, causality="output")],
    )
    file = write(tmp_path, component("a"))
    default_warnings = prepare(str(file), Options()).warnings
    assert (
        sum("no step: 0.5 s" in w or "no stop time" in w for w in default_warnings) == 2
    )
    assert not [w for w in check_file(file).warnings if "no st" in w]
    half = prepare(str(file), Options(step=0.25)).warnings
    assert ["no step" in w for w in half if "no st" in w] == [False]


def test_a_fixed_step_that_does_not_fit_is_told(typed_library, tmp_path):
    path = fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("y", 16, causality="output")],
    )
    text = 'canHandleVariableCommunicationStepSize="true"'
    odd = tmp_path / "odd.fmu"
    with zipfile.ZipFile(path) as old, zipfile.ZipFile(odd, "w") as new:
        for entry in old.infolist():
            new.writestr(entry, old.read(entry).replace(text.encode(), b""))
    shutil.copy(odd, path)
    file = write(tmp_path, component("a"))
    fit = prepare(str(file), Options(stop=2.0, step=1.0)).warnings
    assert not any("fixed step" in w for w in fit)
    for step in (0.2, 0.75):
        step_warnings = prepare(str(file), Options(stop=3.0, step=step)).warnings
        assert any(
            f"has a fixed step of 0.5 s, which does not fit into its step of {step:g} s"
            in w
            for w in step_warnings
        )


def test_a_missing_fmu_is_not_answered_with_our_blocks(tmp_path):
    (tmp_path / "resources").mkdir()
    [line] = check_file(
        write(tmp_path, component("a", fmu="manager_b_dott.fmu"))
    ).problems
    assert line.endswith("a: FMU resources/manager_b_dott.fmu is missing")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "<ssd:Component ",
            '<ssd:Component type="application/x-ssp-package" ',
            "component a is of type application/x-ssp-package, no FMU",
        ),
        (
            "http://ssp-standard.org/SSP1/SystemStructureDescription",
            "http://www.pmsf.net/xsd/SystemStructureDescriptionDraft",
            "SystemStructureDescriptionDraft, that of a draft before SSP 1.0",
        ),
    ],
)
def test_what_is_no_fmu_or_a_draft_is_named(typed_library, tmp_path, old, new, message):
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("y", 16, causality="output")],
    )
    file = write(tmp_path, component("a"))
    file.write_text(file.read_text().replace(old, new))
    with pytest.raises(DesatError, match=message):
        check_file(file)


def test_a_library_that_cannot_be_loaded_is_found_by_check(typed_library, tmp_path):
    """Of another machine, no library, without a function, without a library that it
    needs; nothing of it is loaded."""
    rows = [variable("y", 16, causality="output")]
    data = typed_library.read_bytes()
    other = bytearray(data)
    other[18:20] = b"\xb7\x00"
    source = tmp_path / "needs.c"
    source.write_text("extern int gone(void); int fmi2DoStep(void) { return gone(); }")
    stub = tmp_path / "stub.c"
    stub.write_text("int gone(void) { return 0; }")
    missing_library, needs = tmp_path / "libgone.so", tmp_path / "needs.so"
    for result, *sources in ((missing_library, stub), (needs, source, missing_library)):
        subprocess.run(["gcc", "-shared", "-fPIC", "-o", result, *sources], check=True)
    missing_library.unlink()
    for content, message in (
        (bytes(other), "it is for AArch64, not x86_64"),
        (b"MZ and so on", "it is no library of Linux"),
        (data.replace(b"fmi2DoStep", b"fmi2NoStep"), "it does not export fmi2DoStep"),
        (needs.read_bytes(), "it does not export fmi2Instantiate"),
    ):
        library = tmp_path / "typed.so"
        library.write_bytes(content)
        fmu(tmp_path / "resources/a.fmu", library, rows)
        [line] = check_file(write(tmp_path, component("a"))).problems
        assert f"a.fmu: its library cannot be loaded: {message}" in line
    from desat.files import binary

    fault = binary.loading_fault(needs, ("fmi2DoStep",))
    assert fault.startswith("it needs ")
    assert fault.endswith("libgone.so, which is not here")
    assert binary.loading_fault(typed_library, ("fmi2DoStep",)) == ""


@pytest.mark.parametrize(
    ("name", "version", "here"),
    [
        ("libstdc++.so.6", "GLIBCXX_3.4.999", "GLIBCXX_3.4."),
        ("libc.so.6", "GLIBC_2.999", "GLIBC_2."),
        ("libgcc_s.so.1", "GCC_999.0.0", "GCC_"),
        ("libm.so.6", "OTHER_1", "none"),
    ],
)
def test_a_library_that_needs_a_newer_version_is_found_by_check(
    typed_library, tmp_path, desat, name, version, here
):
    """Of a file and of a system; what is here provides the version named last."""
    script, stub, user = (tmp_path / n for n in ("map", "stub.c", "user.c"))
    script.write_text(f"{version} {{ newer; }};")
    stub.write_text("int newer(void) { return 0; }")
    source = (ROOT / "tests" / "typed.c").read_text()
    user.write_text(
        source + "extern int newer(void); int call(void) { return newer(); }"
    )
    other, library = tmp_path / name, tmp_path / "new/typed.so"
    library.parent.mkdir()
    shared = ["gcc", "-shared", "-fPIC", "-nostdlib", "-o"]
    of_stub = [f"-Wl,--version-script={script}", f"-Wl,-soname,{name}"]
    subprocess.run([*shared, other, stub, *of_stub], check=True)
    subprocess.run([*shared, library, user, other], check=True)
    path = tmp_path / "resources/a.fmu"
    unknowns = '<InitialUnknowns><Unknown index="1"/></InitialUnknowns>'
    fmu(path, library, [variable("y", 16, causality="output")], unknowns=unknowns)
    message = (
        f"its library cannot be loaded: it needs {version} of {name}; here is {here}"
    )
    [line] = check_file(write(tmp_path, component("a"))).problems
    assert f"a: a.fmu: {message}" in line
    assert f"warning: a.fmu: {message}" in desat("check", str(path)).stderr
    from desat.files import binary

    main, helper = (
        library.with_name("main.so"),
        library.rename(tmp_path / "new/help.so"),
    )
    source = tmp_path / "main.c"
    source.write_text("extern int call(void); int run(void) { return call(); }")
    subprocess.run(
        [*shared, main, source, "-L", helper.parent, "-l:help.so"], check=True
    )
    fault = binary.loading_fault(main, ("run",))
    assert fault.startswith(f"help.so: it needs {version} of {name}; here is {here}")


# --- structural parameters ------------------------------------------------------------


SIZED = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="sized3" instantiationToken="t">
<CoSimulation modelIdentifier="sized3" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>
<UInt64 name="n" valueReference="1" causality="structuralParameter" start="3"/>
<Float64 name="u" valueReference="2" causality="input" start="1 2 3">
<Dimension valueReference="1"/></Float64>
<Float64 name="y" valueReference="3" causality="output"><Dimension valueReference="1"/>
</Float64></ModelVariables>
<ModelStructure><Output valueReference="3" dependencies="2"/></ModelStructure>
</fmiModelDescription>"""


@pytest.fixture(scope="session")
def sized_library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An FMU of sized3.c."""
    import re

    import fmpy

    folder = tmp_path_factory.mktemp("sized3")
    source = (ROOT / "tests" / "sized3.c").read_text()
    header = (Path(fmpy.__file__).parent / "c-code/fmi3FunctionTypes.h").read_text()
    others = {*re.findall(r"(fmi3\w+)TYPE", header)} - {
        *re.findall(r"\b(fmi3\w+)\(", source)
    }
    code, library = folder / "sized3.c", folder / "sized3.so"
    code.write_text(
        source + "".join(f"int {f}(void) {{ return 3; }}\n" for f in sorted(others))
    )
    command = ["gcc", "-shared", "-fPIC", "-w", "-o", library, code]
    subprocess.run(command, check=True)
    with zipfile.ZipFile(folder / "a.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", SIZED)
        archive.write(library, f"binaries/{fmpy.platform_tuple}/sized3.so")
    return folder / "a.fmu"


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_arrays_follow_from_a_structural_parameter(sized_library, tmp_path, isolate):
    """By a parameter set and by --set, in configuration mode; also larger than before."""
    (tmp_path / "resources").mkdir()
    shutil.copy(sized_library, tmp_path / "resources")
    file = write(tmp_path, component("a"))
    assert run(file, isolate=isolate).results.values("a.y")[-1].tolist() == [2, 4, 6]
    larger = {"a.n": 5, "a.u": [5.0, 4.0, 3.0, 2.0, 1.0]}
    results = run(file, sets=larger, isolate=isolate).results
    assert results.values("a.y")[-1].tolist() == [10, 8, 6, 4, 2]
    elements = {"a.u[2]": 4.0, "a.u[1]": 5.0, "a.n": 2}
    results = run(file, sets=elements, isolate=isolate).results
    assert results.values("a.y")[-1].tolist() == [10, 8]
    file = write(tmp_path, component("a", "", values(n="Integer 2")))
    assert run(file, isolate=isolate).results.values("a.y")[-1].tolist() == [2, 4]
    with pytest.raises(DesatError, match=r"no variable u\[3\]"):
        run(file, sets={"a.u[3]": 1.0})


# --- arrays of SSP 2.0 ----------------------------------------------------------------


def array(name: str, kind: str, size: str = "3") -> str:
    return connector(name, kind, "Float64", f'<ssc:Dimension size="{size}"/>')


def test_an_array_is_wired_by_one_connection(tmp_path):
    """Our magnetometer of FMI 3.0 feeds the B-dot manager."""
    from desat.files import paths

    (tmp_path / "resources").mkdir()
    for name in ("magnetometer", "manager_b_dot"):
        shutil.copy(paths.fmus() / f"fmi3/{name}.fmu", tmp_path / "resources")
    field = values(b_eci="Float64 1e-5 2e-5 -3e-5")
    elements = component("magnetometer", array("b_body", "output"), field)
    off = values(gain="Float64 0")
    elements += component("manager_b_dot", array("b_body", "input"), off)
    wires = wire("magnetometer.b_body", "manager_b_dot.b_body")
    file = write(tmp_path, elements, wires, version="2.0")
    results = run(file).results
    assert results.values("magnetometer.b_body")[-1] == pytest.approx(
        [1e-5, 2e-5, -3e-5], abs=1e-6
    )
    system_, _ = prepare(str(file), Options(stop=2.0, step=0.5)).or_raise()
    assert [c.input for c in system_.connections] == [f"b_body[{i}]" for i in (1, 2, 3)]


@pytest.mark.parametrize("target_name", [".", "SystemStructure.ssd"])
def test_a_system_of_somebody_is_packed_and_gives_the_same(
    typed_library, tmp_path, desat, target_name
):
    """A packed one is refused."""
    folder = tmp_path / "sys"
    rows = [variable("u", 1, start="3"), variable("y", 17, causality="output")]
    fmu(folder / "resources/a.fmu", typed_library, rows)
    file = write(folder, component("a", "", values(u="Real 4")))
    command = desat("pack", str((folder / target_name).resolve()), check=True)
    package = Path(command.stdout.split(": ")[1].strip())
    assert package.stem == (folder / target_name).resolve().stem
    assert run(package).results.values("a.y").tolist() == [4.0] * 5
    assert run(file).results.values("a.y").tolist() == [4.0] * 5
    again = desat("pack", str(package))
    assert again.returncode == 2
    assert f"{package}: it is packed already" in again.stderr


@pytest.mark.parametrize(
    ("size", "message"),
    [
        ("0", "a Dimension of size '0'; a number from 1 to"),
        ("-1", "a Dimension of size '-1'"),
        ("x", "a Dimension of size 'x'"),
        ("", "a Dimension of no size"),
        ("2", "a.y -> b.u: 3 does not fit 2"),
    ],
)
def test_a_wrong_dimension_is_a_line(typed_library, tmp_path, size, message):
    rows = [variable(f"u[{i}]", i) for i in (1, 2, 3)]
    rows += [variable(f"y[{i}]", 16 + i, causality="output") for i in (1, 2, 3)]
    for name in "ab":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, rows)
    elements = component("a", array("y", "output"))
    elements += component("b", array("u", "input", size))
    case = check_file(write(tmp_path, elements, wire("a.y", "b.u"), version="2.0"))
    assert any(message in line for line in case.problems)


def test_a_matrix_is_wired_by_one_connection(typed_library, tmp_path):
    names = ("[1,1]", "[1,2]", "[2,1]", "[2,2]")
    rows = [variable(f"u{n}", 1 + i) for i, n in enumerate(names)]
    rows += [variable(f"y{n}", 17 + i, causality="output") for i, n in enumerate(names)]
    for name in "ab":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, rows)
    two = '<ssc:Dimension size="2"/><ssc:Dimension size="2"/>'
    elements = component("a", connector("y", "output", "Float64", two))
    elements += component("b", connector("u", "input", "Float64", two))
    file = write(tmp_path, elements, wire("a.y", "b.u"), version="2.0")
    assert run(file).results.values("b.y")[-1].tolist() == [10.0, 20.0, 30.0, 0.0]


# --- roles ----------------------------------------------------------------------------


def test_check_says_which_roles_an_fmu_fits(typed_library, tmp_path, desat):
    """Ours fits its own; a stranger's what its variables' names, sizes, units say."""
    from desat.files import paths

    command = desat("check", str(paths.fmus() / "native/manager_b_dot.fmu"))
    assert "manager: fits; gives tau_cmd_wheel, m_cmd_body" in command.stdout
    dipole = [
        variable(f"m_cmd_body[{i}]", 16 + i, causality="output", unit="A.m2")
        for i in (1, 2, 3)
    ]
    field = [variable(f"b_body[{i}]", i, unit="T") for i in (1, 2, 3)]
    units = (
        '<UnitDefinitions><Unit name="A.m2"/><Unit name="T"/><Unit name="m"/>'
        "</UnitDefinitions>"
    )
    path = fmu(
        tmp_path / "a.fmu", typed_library, [*dipole, *field, variable("own", 5)], units
    )
    command = desat("check", str(path))
    [line] = [
        x for x in command.stdout.splitlines() if x.strip().startswith("manager:")
    ]
    assert "manager: fits in part; gives m_cmd_body; lacks tau_cmd_wheel" in line
    assert line.endswith("has inputs of its own own")
    wrong = [row.replace('unit="A.m2"', 'unit="m"') for row in dipole]
    command = desat("check", str(fmu(tmp_path / "b.fmu", typed_library, wrong, units)))
    assert "manager: does not fit" in command.stdout
    assert "m_cmd_body (unit m, A.m2 is needed)" in " ".join(command.stdout.split())
    [role] = json.loads(desat("check", str(path), "--json").stdout)["roles"]
    assert role["outputs"] == ["m_cmd_body"]


# --- bad input ------------------------------------------------------------------------


def test_a_set_that_names_another_component_is_refused(typed_library, tmp_path):
    for name in "ab":
        fmu(tmp_path / f"resources/{name}.fmu", typed_library, [variable("u", 0)])
    binding = values(**{"b.u": "Real 3"})
    file = write(tmp_path, component("a", "", binding) + component("b"))
    [line] = check_file(file).problems
    assert line.endswith("a.b.u: it names b, but the set is that of a")
    assert "SystemStructure.ssd:2: " in line


def test_public_reports_are_read_or_refused_in_a_line(typed_library, tmp_path):
    """FMPy 108 and 189, fmi-cross-check 74, OpenModelica 11265, OMSimulator 495, 1017,
    1094, 1222 and 1318, FMPy 107: rebuilt by the smallest file."""
    output = variable("y", 16, causality="output")
    table = variable("table.fileName", 0, "String", "parameter", start="NoName")
    read = {
        "calculatedParameter, constant": [
            variable("p", 3, causality="calculatedParameter", variability="constant")
        ],
        "parameter, constant": [
            variable("p", 0, causality="parameter", variability="constant")
        ],
        "slash, brackets and a blank": [
            variable("a/b(1)", 17, causality="output"),
            variable("m[1, 1]", 18, causality="output"),
            variable("m[1, 2]", 19, causality="output"),
        ],
        "previous": [variable("previous(Ts)", 1, causality="local")],
        "a table's file": [table],
    }
    for rows in read.values():
        fmu(tmp_path / "resources/a.fmu", typed_library, [*rows, output])
        assert run(write(tmp_path, component("a"))).results.values("a.y")[-1] == 0.0
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("speed", 0), variable("on", 17, "Boolean", "output")],
    )
    fmu(
        tmp_path / "resources/b.fmu",
        typed_library,
        [variable("on", 1, "Boolean", start="true"), output],
    )
    both = component("a") + component("b")
    file = write(tmp_path, both, wire("a.on", "b.on") + wire("b.y", "a.speed"))
    file.write_text(file.read_text().replace('name="s"', 'name="Root-System"'))
    assert prepare(str(file), Options()).or_raise()[0].step == 0.5
    assert run(file).manifest.status == "completed"
    empty = '<ssd:Connection startElement="y" startConnector="" endElement="b" '
    file = write(tmp_path, both, empty + 'endConnector="on"/>')
    assert check_file(file).problems[0].endswith("no component y; there is a, b")
    fmu(
        tmp_path / "resources/a.fmu",
        typed_library,
        [variable("n", 3, causality="none")],
    )
    [line] = check_file(write(tmp_path, component("a"))).problems
    assert "n: causality none: there are parameter" in line
