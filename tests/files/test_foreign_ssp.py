"""SSPs as other tools write them: what they nest, map, leave out and forget to declare."""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

import desat
from desat.runs.prepare import prepare
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import ROOT
from tests.engine.test_failures import FAILURES, compile_failing, fmu

NAMESPACES = " ".join(
    f'xmlns:{prefix}="http://ssp-standard.org/SSP1/SystemStructure{name}"'
    for prefix, name in (
        ("ssd", "Description"),
        ("ssc", "Common"),
        ("ssv", "ParameterValues"),
        ("ssm", "ParameterMapping"),
        ("ssb", "SignalDictionary"),
    )
)
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="gain" guid="{g}">
<CoSimulation modelIdentifier="gain" canHandleVariableCommunicationStepSize="true"/>
<UnitDefinitions><Unit name="bar"/></UnitDefinitions>
<DefaultExperiment stopTime="2" stepSize="0.5"/>
<ModelVariables>
<ScalarVariable name="k" valueReference="0" causality="parameter" variability="tunable">
<Real start="1"/></ScalarVariable>
<ScalarVariable name="u" valueReference="1" causality="input">
<Real start="0" unit="bar"/></ScalarVariable>
<ScalarVariable name="y" valueReference="2" causality="output"><Real/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="3"/></Outputs></ModelStructure>
</fmiModelDescription>"""


@pytest.fixture(scope="module")
def gain(tmp_path_factory: pytest.TempPathFactory) -> Path:
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    folder = tmp_path_factory.mktemp("gain")
    source, library = ROOT / "tests" / "gain.c", folder / "gain.so"
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-o", str(library), str(source)], check=True
    )
    with zipfile.ZipFile(folder / "gain.fmu", "w") as file:
        file.writestr("modelDescription.xml", DESCRIPTION)
        file.write(library, "binaries/linux64/gain.so")
    return folder / "gain.fmu"


def component(name: str, bindings: str = "", source: str = "resources/gain.fmu") -> str:
    ends = (("k", "parameter"), ("u", "input"), ("y", "output"))
    connectors = "".join(
        f'<ssd:Connector name="{c}" kind="{kind}"><ssc:Real/></ssd:Connector>'
        for c, kind in ends
    )
    return (
        f'<ssd:Component name="{name}" source="{source}"><ssd:Connectors>{connectors}'
        f"</ssd:Connectors>{bindings}</ssd:Component>"
    )


def wire(start: str, end: str, extra: str = "") -> str:
    """`a.y`, or `y` of the system itself."""
    text = ""
    for kind, name in (("start", start), ("end", end)):
        element, dot, connector = name.rpartition(".")
        text += f' {kind}Element="{element}"' if dot else ""
        text += f' {kind}Connector="{connector}"'
    return f"<ssd:Connection{text}>{extra}</ssd:Connection>"


def inline(
    values: dict[str, float], mapping: str = "", unit: str = "", prefix: str = ""
) -> str:
    rows = "".join(
        f'<ssv:Parameter name="{name}"><ssv:Real value="{value}"{unit}/></ssv:Parameter>'
        for name, value in values.items()
    )
    return (
        f"<ssd:ParameterBindings><ssd:ParameterBinding{prefix}><ssd:ParameterValues>"
        f'<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>{rows}</ssv:Parameters>'
        f"</ssv:ParameterSet></ssd:ParameterValues>{mapping}</ssd:ParameterBinding>"
        "</ssd:ParameterBindings>"
    )


def connectors(*names: str) -> str:
    rows = "".join(
        f'<ssd:Connector name="{n}" kind="{"output" if n[0] == "y" else "input"}"><ssc:Real/>'
        "</ssd:Connector>"
        for n in names
    )
    return f"<ssd:Connectors>{rows}</ssd:Connectors>"


def system(name: str, elements: str, wires: str = "", before: str = "") -> str:
    wires = f"<ssd:Connections>{wires}</ssd:Connections>" if wires else ""
    return (
        f'<ssd:System name="{name}">{before}<ssd:Elements>{elements}</ssd:Elements>{wires}'
        "</ssd:System>"
    )


def ssp(folder: Path, gain: Path, system: str, after: str = "", **options: str) -> Path:
    (folder / "resources").mkdir(exist_ok=True)
    shutil.copy(gain, folder / "resources")
    version, names = options.get("version", "1.0"), options.get("names", NAMESPACES)
    file = folder / "SystemStructure.ssd"
    file.write_text(
        f'<ssd:SystemStructureDescription version="{version}" name="x" {names}>\n'
        f"{system}{after}\n</ssd:SystemStructureDescription>"
    )
    return file


def last(file: Path, name: str) -> float:
    run = desat.run(str(file), stop=2.0, step=0.5, substeps=1)
    assert run.manifest.status == "completed"
    return float(run.results.values(name)[-1])


LINEAR = '<ssc:LinearTransformation factor="2" offset="1"/>'
INNER = system(
    "inner",
    component("b"),
    wire("u", "b.u", LINEAR) + wire("b.y", "y"),
    connectors("u", "y"),
)


def test_nested_systems_become_one_flat_one(tmp_path: Path, gain: Path) -> None:
    """a -> 3 * -> inner.u -> 2 * + 1 -> b -> inner.y -> c: 7 * 3 = 21, 43, 43 * 10."""
    elements = component("a", inline({"u": 1.0, "k": 7.0})) + INNER + component("c")
    three = '<ssc:LinearTransformation factor="3" offset="0"/>'
    wires = wire("a.y", "inner.u", three) + wire("inner.y", "c.u") + wire("c.y", "y")
    file = ssp(
        tmp_path,
        gain,
        system(
            "s",
            elements,
            wires,
            connectors("y") + inline({"c.k": 10.0, "inner.b.k": 1.0}),
        ),
    )
    assert last(file, "inner_b.y") == 43.0
    assert last(file, "c.y") == 430.0


def test_a_value_of_a_system_reaches_what_its_connector_feeds(
    tmp_path: Path, gain: Path
) -> None:
    """Through two systems, and before the value that the component's own set has."""
    inner = INNER.replace(component("b"), component("b", inline({"u": 99.0})))
    file = ssp(
        tmp_path,
        gain,
        system(
            "s",
            inner,
            wire("u0", "inner.u"),
            connectors("u0") + inline({"u0": 5.0, "inner.b.k": 2.0, "nobody": 1.0}),
        ),
    )
    assert last(file, "inner_b.y") == 22.0
    case = prepare(str(file), Options(stop=2.0, step=0.5))
    assert any("nobody reaches no component" in w for w in case.warnings)


def test_a_mapping_renames_and_transforms_and_leaves_the_rest(
    tmp_path: Path, gain: Path
) -> None:
    (tmp_path / "resources").mkdir()
    (tmp_path / "resources" / "m.ssm").write_text(
        f'<ssm:ParameterMapping version="1.0" {NAMESPACES}>'
        '<ssm:MappingEntry source="big" target="a.k"/>'
        f'<ssm:MappingEntry source="big" target="b.k">{LINEAR}</ssm:MappingEntry>'
        "</ssm:ParameterMapping>"
    )
    mapping = '<ssd:ParameterMapping source="resources\\m.ssm"/>'
    values = inline({"big": 4.0, "a.u": 1.0, "b.u": 1.0}, mapping)
    file = ssp(tmp_path, gain, system("s", component("a") + component("b"), "", values))
    assert (last(file, "a.y"), last(file, "b.y")) == (4.0, 9.0)


def test_a_signal_dictionary_hands_on(tmp_path: Path, gain: Path) -> None:
    reference = (
        '<ssd:SignalDictionaryReference name="{}" dictionary="bus"><ssd:Connectors>'
        '<ssd:Connector name="x" kind="inout"><ssc:Real/></ssd:Connector>'
        "</ssd:Connectors></ssd:SignalDictionaryReference>"
    )
    inner = system(
        "inner", component("b") + reference.format("there"), wire("there.x", "b.u")
    )
    elements = component("a", inline({"u": 6.0})) + reference.format("here") + inner
    file = ssp(tmp_path, gain, system("s", elements, wire("a.y", "here.x")))
    assert last(file, "inner_b.y") == 6.0


def test_a_dictionary_is_that_of_the_system_around(tmp_path: Path, gain: Path) -> None:
    """Two systems have each a dictionary `bus` of their own, and one within them finds
    it there."""
    reference = (
        '<ssd:SignalDictionaryReference name="{}" dictionary="bus"><ssd:Connectors>'
        '<ssd:Connector name="x" kind="inout"><ssc:Real/></ssd:Connector>'
        "</ssd:Connectors></ssd:SignalDictionaryReference>"
    )
    dictionaries = (
        '<ssd:SignalDictionaries><ssd:SignalDictionary name="bus" source="d.ssb"/>'
        "</ssd:SignalDictionaries></ssd:System>"
    )
    (tmp_path / "d.ssb").write_text(
        f'<ssb:SignalDictionary {NAMESPACES} version="1.0"><ssb:DictionaryEntry name="x">'
        "<ssc:Real/></ssb:DictionaryEntry></ssb:SignalDictionary>"
    )
    within = system(
        "deep", component("b") + reference.format("there"), wire("there.x", "b.u")
    )

    def one(name: str, value: float) -> str:
        parts = component("a", inline({"u": value})) + reference.format("here") + within
        result = system(name, parts, wire("a.y", "here.x"))
        return result[: -len("</ssd:System>")] + dictionaries

    file = ssp(tmp_path, gain, system("s", one("p", 6.0) + one("q", 7.0)))
    assert last(file, "p_deep_b.y") == 6.0
    assert last(file, "q_deep_b.y") == 7.0
    assert not any(
        "has a dictionary" in w for w in prepare(str(file), Options()).warnings
    )
    (tmp_path / "d.ssb").unlink()
    with pytest.raises(
        DesatError, match=r"SystemStructure\.ssd:\d+: d\.ssb is missing"
    ):
        prepare(str(file), Options()).or_raise()
    alone = ssp(
        tmp_path,
        gain,
        system(
            "s",
            component("b", inline({"u": 1.0})) + reference.format("r"),
            wire("r.x", "b.u"),
        ),
    )
    messages = prepare(str(alone), Options(stop=2.0, step=0.5)).warnings
    assert any(
        "r: no system that it is in has a dictionary bus: taken" in w for w in messages
    )


def test_start_and_end_say_not_what_gives(tmp_path: Path, gain: Path) -> None:
    """The kinds of the connectors do (SSP 1.0), of systems, too: all wires the other
    way round."""
    inner = system(
        "inner",
        component("b"),
        wire("b.u", "u", LINEAR) + wire("y", "b.y"),
        connectors("u", "y"),
    )
    elements = component("a", inline({"u": 1.0, "k": 7.0})) + inner + component("c")
    wires = wire("inner.u", "a.y") + wire("c.u", "inner.y") + wire("y", "c.y")
    file = ssp(tmp_path, gain, system("s", elements, wires, connectors("y")))
    assert last(file, "c.y") == 15.0


def test_of_two_sets_the_later_stands_but_one_may_not_waver(
    tmp_path: Path, gain: Path
) -> None:
    two = (inline({"k": 2.0, "u": 1.0}) + inline({"k": 5.0})).replace(
        "</ssd:ParameterBindings><ssd:ParameterBindings>", ""
    )
    file = ssp(tmp_path, gain, system("s", component("a", two)))
    assert last(file, "a.y") == 5.0
    assert not any("twice" in w for w in prepare(str(file), Options()).warnings)
    rows = '<ssv:Parameter name="{}"><ssv:Real value="{}"/></ssv:Parameter>'
    for name, is_refused in (("k", True), ("lost", False)):
        both = rows.format(name, 3) + rows.format(name, 4)
        twice = inline({"u": 1.0}).replace(
            "<ssv:Parameters>", f"<ssv:Parameters>{both}"
        )
        file = ssp(tmp_path, gain, system("s", component("a", twice)))
        answer = [p for p in prepare(str(file), Options()).problems if "twice" in p]
        assert bool(answer) == is_refused
        assert not is_refused or answer[0].endswith("k is given twice")


def test_units_that_nobody_explains(tmp_path: Path, gain: Path) -> None:
    """Equal names are the same unit, and what reaches nothing may be in any."""
    values = inline({"u": 2.0}, unit=' unit="furlong"')
    file = ssp(tmp_path, gain, system("s", component("a", values)))
    with pytest.raises(
        DesatError,
        match=r"a\.u: unit furlong is not known: it cannot be converted to bar",
    ):
        prepare(str(file), Options()).or_raise()
    file = ssp(
        tmp_path, gain, system("s", component("a", values.replace('"u"', '"lost"')))
    )
    prepare(str(file), Options()).or_raise()
    same = tmp_path / "furlong.fmu"
    with zipfile.ZipFile(gain) as old, zipfile.ZipFile(same, "w") as new:
        for entry in old.infolist():
            new.writestr(entry, old.read(entry).replace(b'"bar"', b'"furlong"'))
    shutil.copy(same, tmp_path / "resources")
    file = ssp(
        tmp_path, gain, system("s", component("a", values, "resources/furlong.fmu"))
    )
    assert last(file, "a.y") == 2.0


def test_enumerations_are_integers_with_names(tmp_path: Path, gain: Path) -> None:
    """By SSP a value is an item's name, and an integer may feed one; of proxyfmu the
    file runs."""
    there = tmp_path / "named.fmu"
    text = (
        DESCRIPTION.replace(
            "<ModelVariables>",
            '<TypeDefinitions><SimpleType name="law">'
            '<Enumeration><Item name="off" value="0"/><Item name="on" value="1"/></Enumeration>'
            "</SimpleType></TypeDefinitions><ModelVariables>",
        )
        .replace('<Real start="1"/>', '<Enumeration declaredType="law" start="1"/>')
        .replace('"tunable"', '"fixed"')
    )
    with zipfile.ZipFile(there, "w") as file, zipfile.ZipFile(gain) as old:
        file.writestr("modelDescription.xml", text)
        file.writestr("binaries/linux64/gain.so", old.read("binaries/linux64/gain.so"))
    (tmp_path / "resources").mkdir()
    shutil.copy(there, tmp_path / "resources")
    values = inline({"k": 0.0}).replace(
        '<ssv:Real value="0.0"/>', '<ssv:Enumeration value="{}"/>'
    )
    one = component("a", "{}", "proxyfmu://localhost?file=resources/named.fmu").replace(
        "<ssc:Real/>", '<ssc:Enumeration name="law"/>', 1
    )
    case = prepare(
        str(ssp(tmp_path, gain, system("s", one.format(values.format("off"))))),
        Options(),
    )
    case.or_raise()
    assert case.system is not None
    assert case.system.components["a"].parameters["k"] == 0
    assert any("proxyfmu its file alone is used" in w for w in case.warnings)
    wrong = ssp(tmp_path, gain, system("s", one.format(values.format("of"))))
    with pytest.raises(DesatError, match=r"a\.k = of: not a choice; did you mean off"):
        prepare(str(wrong), Options()).or_raise()


def test_times_of_the_fmus_where_the_file_has_none(tmp_path: Path, gain: Path) -> None:
    file = ssp(tmp_path, gain, system("s", component("a", inline({"u": 1.0}))))
    case = prepare(str(file), Options())
    case.or_raise()
    assert case.system is not None
    assert (case.system.step, case.system.stop) == (0.5, 2.0)
    assert any("no step: 0.5 s of gain.fmu" in w for w in case.warnings)


def test_what_is_forgotten_is_a_warning(tmp_path: Path, gain: Path) -> None:
    """A prefix, a value, a variable, a unit in brackets; version 2.0; backslashes."""
    one = component("a", inline({"k": 3.0, "lost": 1.0}), "resources\\gain.fmu")
    two = component("b", inline({"u": 2e5}, unit=' unit="[Pa]"'))
    hint = (
        '<ssd:DefaultExperiment stopTime="2"><ssd:Annotations><ssc:Annotation type="osp">'
        '<osp:Algorithm><osp:FixedStepAlgorithm baseStepSize="0.5"/></osp:Algorithm>'
        "</ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment>"
    )
    file = ssp(tmp_path, gain, system("s", one + two), hint, version="2.0")
    case = prepare(str(file), Options())
    case.or_raise()
    text = "\n".join(case.warnings)
    for message in (
        "prefix osp is not declared",
        "version 2.0: read as 1.0",
        "a: u is listed",
        "gain.fmu has no variable lost",
    ):
        assert message in text
    assert last(file, "b.y") == 2.0  # bar


@pytest.mark.parametrize(
    ("elements", "wires", "message"),
    [
        ("", "", "holds no component"),
        (component("a") + component("a"), "", "component a twice"),
        (
            system("t", component("a"), wire("u", "a.u"), connectors("u")),
            wire("t.u", "t.u"),
            "t.u is its own source",
        ),
        (
            component("a") + INNER,
            wire("a.y", "inner.u") * 2,
            "inner.u has two sources, also line",
        ),
        (component("a") + INNER, wire("a.y", "iner.u"), "no component iner"),
        (
            component("a") + component("b"),
            wire(
                "a.y",
                "b.u",
                "<ssc:BooleanMappingTransformation>"
                '<ssc:MapEntry source="true" target="false"/></ssc:BooleanMappingTransformation>',
            ),
            "BooleanMappingTransformation of",
        ),
    ],
)
def test_what_is_wrong_is_refused_by_line(
    tmp_path: Path, gain: Path, elements: str, wires: str, message: str
) -> None:
    file = ssp(tmp_path, gain, system("s", elements, wires))
    with pytest.raises(DesatError, match=r"SystemStructure\.ssd:\d+: .*") as caught:
        prepare(str(file), Options(stop=2.0, step=0.5)).or_raise()
    assert message in str(caught.value)


def test_files_outside_only_when_allowed(tmp_path: Path, gain: Path) -> None:
    folder = tmp_path / "inside"
    folder.mkdir()
    shutil.copy(gain, tmp_path)
    one = component("a", inline({"u": 3.0}), "../gain.fmu")
    file = ssp(folder, gain, system("s", one))
    with pytest.raises(
        DesatError, match=r"ssd:2: source '../gain.fmu' is outside.*--allow-outs"
    ):
        prepare(str(file), Options()).or_raise()
    prepare(str(file), Options(outside=True)).or_raise()


@pytest.mark.parametrize("form", ["file://{}", "file:{}", "FILE://localhost{}"])
def test_files_may_be_named_by_uri(tmp_path: Path, gain: Path, form: str) -> None:
    """FMU and parameter file: within the folder, and outside where that is allowed."""
    folder = tmp_path / "of it, 50%"
    (folder / "resources").mkdir(parents=True)
    values = inline({"u": 3.0}).partition("<ssd:ParameterValues>")[2]
    values = values.partition("</ssd:ParameterValues>")[0]
    for place in (tmp_path, folder / "resources"):
        shutil.copy(gain, place)
        names = f'<ssv:ParameterSet {NAMESPACES} version="1.0"'
        text = values.replace('<ssv:ParameterSet version="1.0"', names)
        (place / "p.ssv").write_text(text)
    binding = '<ssd:ParameterBindings><ssd:ParameterBinding source="{}"/></ssd:ParameterBindings>'
    for place, options in ((folder / "resources", {}), (tmp_path, {"outside": True})):
        uris = [
            form.format(
                (place / name).as_posix().replace("%", "%25").replace(" ", "%20")
            )
            for name in ("gain.fmu", "p.ssv")
        ]
        one = component("a", binding.format(uris[1]), uris[0])
        file = ssp(folder, gain, system("s", one))
        run = desat.run(str(file), stop=2.0, step=0.5, substeps=1, **options)
        assert run.results.values("a.y")[-1] == 3.0
    problems = prepare(str(file), Options(stop=2.0, step=0.5)).problems
    assert len(problems) == 2, "the FMU and the parameter file"
    assert all("is outside the folder of the system" in p for p in problems)


@pytest.mark.parametrize(
    "source", ["../gain.fmu", "/etc/passwd", "file:///etc/passwd", "..\\x", "file:../x"]
)
def test_a_file_outside_is_one_problem(tmp_path: Path, gain: Path, source: str) -> None:
    """Also where its connectors are wired and not listed."""
    bare = f'<ssd:Component name="a" source="{source}"/>'
    elements = system("s", bare + component("b"), wire("a.y", "b.u"))
    file = ssp(tmp_path, gain, elements)
    (line,) = prepare(str(file), Options(stop=2.0, step=0.5)).problems
    assert "is outside the folder of the system" in line


# --- stand-ins for the public ones: what makes each of their outcomes; their ways to write -----

OMS_NAMES = (
    "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd"
)
OMS = (
    '<ssd:Annotations><ssc:Annotation type="org.openmodelica"><oms:Annotations><oms:'
    'SimulationMetaData><oms:FixedStepMaster description="oms-ma" stepSize="0.25"/>'
    "</oms:SimulationMetaData></oms:Annotations></ssc:Annotation>"
    "</ssd:Annotations>"
)
EXPERIMENT = '<ssd:DefaultExperiment startTime="{}" stopTime="{}"/>'
PSI = (
    '<ssv:Units><ssc:Unit name="psi"><ssc:BaseUnit kg="1" m="-2"/></ssc:Unit></ssv:Units>'
    "</ssv:ParameterSet>"
)


def parameters(name: str, file: str) -> str:
    """A binding of a file of parameters, mapped by m.ssm."""
    return (
        f'<ssd:ParameterBindings><ssd:ParameterBinding source="{file}">'
        f'<ssd:ParameterMapping source="{name}"/></ssd:ParameterBinding>'
        "</ssd:ParameterBindings>"
    )


def other(gain: Path, folder: Path, name: str, **changes: tuple[str, str]) -> None:
    """A copy of gain.fmu whose entries, or the description's text, are changed: old,
    new."""
    entries, texts = changes.get("entry", ("", "")), changes.get("text", ("", ""))
    (folder / "resources").mkdir(exist_ok=True)
    with (
        zipfile.ZipFile(gain) as old,
        zipfile.ZipFile(folder / "resources" / name, "w") as new,
    ):
        for entry in old.infolist():
            data = old.read(entry).replace(texts[0].encode(), texts[1].encode())
            new.writestr(
                entry.filename.replace(*entries), data if texts[0] else old.read(entry)
            )


def made_elsewhere(folder: Path, gain: Path) -> str:
    other(gain, folder, "their.fmu", entry=("linux64", "win64"))
    return system("s", component("a", source="resources/their.fmu"))


def model_exchange(folder: Path, gain: Path) -> str:
    other(gain, folder, "their.fmu", text=("CoSimulation", "ModelExchange"))
    return system("s", component("a", source="resources/their.fmu"))


def leaving(folder: Path, gain: Path) -> str:
    other(gain, folder, "their.fmu", entry=("binaries/linux64", "../binaries/linux64"))
    return system("s", component("a", source="resources/their.fmu"))


def not_finite(folder: Path, gain: Path) -> str:
    """In the first step, which begins at 5 s."""
    fmu(folder / "resources/failing.fmu", compile_failing(folder))
    way = inline({"how": FAILURES.index("NOT_FINITE")}).replace("Real", "Integer")
    return system(
        "s",
        f'<ssd:Component name="a" source="resources/failing.fmu">{way}</ssd:Component>',
    ) + EXPERIMENT.format(5, 6)


def of_a_step_beyond_the_end(folder: Path, gain: Path) -> str:
    other(gain, folder, "their.fmu", text=('stepSize="0.5"', 'stepSize="3"'))
    one = component("a", source="resources/their.fmu")
    return system("s", one) + EXPERIMENT.format(0, 1)


def in_another_unit(folder: Path, gain: Path) -> str:
    values = inline({"u": 1.0}, unit=' unit="psi"').replace("</ssv:ParameterSet>", PSI)
    return system("s", component("a", values))


def by_bad_values(folder: Path, gain: Path) -> str:
    (folder / "p.ssv").write_text(
        f'<ssv:ParameterSet version="1.0" name="p" {NAMESPACES}>'
        '<ssv:Parameters to="b"/></ssv:ParameterSet>'
    )
    (folder / "m.ssm").write_text(f'<ssm:ParameterMapping version="1.0" {NAMESPACES}/>')
    return system("s", component("a"), "", parameters("m.ssm", "p.ssv"))


def by_a_bad_mapping(folder: Path, gain: Path) -> str:
    (folder / "p.ssv").write_text(
        f'<ssv:ParameterSet version="1.0" name="p" {NAMESPACES}>'
        "<ssv:Parameters/></ssv:ParameterSet>"
    )
    (folder / "m.ssm").write_text(
        f'<ssm:ParameterMapping version="1.0" {NAMESPACES}><ssm:MappingEntry from="x"/>'
        "</ssm:ParameterMapping>"
    )
    return system("s", component("a"), "", parameters("m.ssm", "p.ssv"))


STAND_INS = {
    "no step of": of_a_step_beyond_the_end,
    "no binary for linux64": made_elsewhere,
    "is missing": lambda *_: system("s", component("a", source="resources/lost.fmu")),
    "does not fit bar": in_another_unit,
    "holds no component": lambda *_: (
        f'<ssd:System name="s">{inline({"u": 1.0})}</ssd:System>'
    ),
    "not expected": lambda *_: system("s", component("a"), before="<ssd:Parameters/>"),
    "not allowed": lambda *_: system(
        "s", component("a").replace(' name="a"', ' name="a" to="b"')
    ),
    "not allowed, of an .ssv": by_bad_values,
    "not allowed, of an .ssm": by_a_bad_mapping,
    "model exchange": model_exchange,
    "would leave the folder": leaving,
    "fails": not_finite,
}
"""What is said, or becomes of it, and what lets it: a function of the folder and
gain.fmu."""


@pytest.mark.parametrize("expected_message", STAND_INS)
def test_what_becomes_of_public_ones_becomes_of_their_kind(
    tmp_path: Path, gain: Path, expected_message: str
) -> None:
    file = ssp(tmp_path, gain, STAND_INS[expected_message](tmp_path, gain))
    if expected_message == "fails":
        run = desat.run(str(file), step=0.5, substeps=1)
        assert run.manifest.status == "failed"
        assert run.manifest.message == "a.y = nan at t = 5.5 s"
        return
    with pytest.raises(DesatError) as caught:
        desat.run(str(file), substeps=1)
    subject, _, kind = expected_message.partition(", of an ")
    lines = [line for line in str(caught.value).splitlines() if subject in line]
    assert lines
    assert not kind or re.match(rf"\w+\{kind}:\d+: ", lines[0])


def of_their_annotation(folder: Path, gain: Path) -> Path:
    """The step is OMSimulator's, in an annotation of the system."""
    one = system("s", component("a", inline({"k": 2.0, "u": 3.0})))
    one = one.replace("</ssd:System>", f"{OMS}</ssd:System>")
    names = NAMESPACES + f' xmlns:oms="{OMS_NAMES}"'
    return ssp(folder, gain, one, EXPERIMENT.format(0, 1), names=names)


def of_files_in_files(folder: Path, gain: Path) -> Path:
    """An archive whose systems and component have a file of parameters each, one with a
    mapping."""
    for name, rows in (
        ("top", {"inner.a.k": 2.0}),
        ("inner", {"wide": 4.0}),
        ("a", {"u": 9.0}),
    ):
        text = re.sub(
            r".*(<ssv:ParameterSet)(.*</ssv:ParameterSet>).*",
            r"\1 NAMES\2",
            inline(rows),
        )
        (folder / f"{name}.ssv").write_text(text.replace("NAMES", NAMESPACES))
    (folder / "m.ssm").write_text(
        f'<ssm:ParameterMapping version="1.0" {NAMESPACES}><ssm:MappingEntry source="wide" '
        'target="a.u"><ssc:LinearTransformation factor="0.5" offset="1"/></ssm:MappingEntry>'
        "</ssm:ParameterMapping>"
    )
    binding = '<ssd:ParameterBindings><ssd:ParameterBinding source="{}.ssv"/></ssd:ParameterBindings>'
    inner = system(
        "inner",
        component("a", binding.format("a")),
        "",
        parameters("m.ssm", "inner.ssv"),
    )
    file = ssp(
        folder,
        gain,
        system("s", inner, "", binding.format("top")),
        EXPERIMENT.format(0, 1),
    )
    archive_file = folder / "their.ssp"
    with zipfile.ZipFile(archive_file, "w") as archive:
        for path in (file, *folder.glob("*.ss[vm]"), folder / "resources/gain.fmu"):
            archive.write(path, path.relative_to(folder))
    file.unlink()
    return archive_file


def of_no_times(folder: Path, gain: Path) -> Path:
    """Neither the file nor its FMU, which lies outside, has a step."""
    (folder / "in").mkdir()
    text = ('<DefaultExperiment stopTime="2" stepSize="0.5"/>', "")
    other(gain, folder, "their.fmu", text=text)
    one = component("a", inline({"k": 2.0, "u": 3.0}), "../resources/their.fmu")
    return ssp(folder / "in", gain, system("s", one), EXPERIMENT.format(0, 1))


@pytest.mark.parametrize(
    ("result", "options", "name"),
    [
        (of_their_annotation, {}, "a.y"),
        (of_files_in_files, {"step": 0.25}, "inner_a.y"),
        (of_no_times, {"step": 0.25, "outside": True}, "a.y"),
    ],
)
def test_their_ways_to_write_run_to_the_end(
    tmp_path: Path, gain: Path, result, options: dict[str, object], name: str
) -> None:
    file = result(tmp_path, gain)
    run = desat.run(str(file), substeps=1, **options)
    assert run.manifest.status == "completed"
    assert (run.manifest.steps_done, run.results.values(name)[-1]) == (4, 6.0)
    if "outside" in options:
        with pytest.raises(DesatError, match=r"no step is given; use step"):
            desat.run(str(file), substeps=1, outside=True)
        with pytest.raises(DesatError, match=r"is outside the folder"):
            desat.run(str(file), substeps=1, step=0.25)


def test_each_outcome_of_public_ones_has_a_stand_in() -> None:
    outcomes = {message.partition(",")[0] for message in STAND_INS}
    assert {answer["outcome"] for answer in PUBLIC} - {"runs"} == outcomes - {
        "does not fit bar"
    }


PUBLIC = tomllib.loads((ROOT / "tests" / "foreign.toml").read_text())["ssp"]


@pytest.mark.parametrize(
    "message", PUBLIC, ids=lambda message: f"{message['repository']}/{message['file']}"
)
def test_public_ones_become_what_is_told_of_them(message: dict[str, str]) -> None:
    """Of those that lie in the folder DESAT_FOREIGN; none of them is committed."""
    file = (
        Path(os.environ.get("DESAT_FOREIGN", "-"))
        / message["repository"]
        / message["file"]
    )
    if not file.is_file():
        pytest.skip("not there")
    assert hashlib.sha256(file.read_bytes()).hexdigest() == message["sha256"]
    late = "no_algorithm" in message["file"]  # starts at 5 s
    options = {"inner": 1, "stop": 6.0 if late else 1.0, "outside": True}
    without = {
        "dcmotor": 0.001,
        "no_algorithm": 0.001,
        "1.0/dp_ship": 0.02,
        "linear_": 0.1,
    }
    if steps := [x for name, x in without.items() if name in message["file"]]:
        options["step"] = steps[0]
    if message["outcome"] in (statuses := {"runs": "completed", "fails": "failed"}):
        assert (
            desat.run(str(file), **options).manifest.status
            == statuses[message["outcome"]]
        )
    else:
        with pytest.raises(DesatError) as caught:
            desat.run(str(file), **options)
        assert message["outcome"] in str(caught.value)
