"""FMUs of FMI 3.0 of others in our master, by strange3.c; and ours, as if they were
others'."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import fmpy
import numpy as np
import pytest

import desat
from desat import prepare
from desat.engine.compiled import CODES, Program
from desat.engine.ending import NEVER
from desat.engine.instances.base import ComponentError
from desat.engine.loop import run, stepping
from desat.engine.master import Master
from desat.engine.recording.recorder import Recorder
from desat.files import library
from desat.files.draft import Assignment, Draft
from desat.files.fmu import of_fmu
from desat.fmus.build import DIST
from desat.runs.checks import check_draft
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from desat.system.model import Component, Connection
from tests.conftest import ROOT

BOTH = ("compiled", "python")
FULL_RANGE = {
    "Int8": 20,
    "Int16": 22,
    "Int32": 24,
    "Int64": 26,
    "UInt8": 28,
    "UInt16": 30,
    "UInt32": 32,
    "UInt64": 34,
}


def description(
    more: str = "", kind: str = "CoSimulation", version: str = "3.0"
) -> str:
    """The modelDescription.xml of strange3.c."""
    rows = [
        '<Float64 name="time" valueReference="0" causality="independent"/>',
        '<UInt64 name="n" valueReference="1" causality="structuralParameter" start="3"/>',
        '<Float64 name="u" valueReference="2" causality="input" start="0.5 1.5 2.5">'
        '<Dimension valueReference="1"/></Float64>',
        '<Float64 name="y" valueReference="3" causality="output"><Dimension valueReference="1"/>'
        "</Float64>",
        '<Float64 name="gain" valueReference="4" causality="parameter" start="2"/>',
        '<Float32 name="f_in" valueReference="5" causality="input" start="0"/>',
        '<Float32 name="f_out" valueReference="6" causality="output"/>',
        '<Float64 name="table" valueReference="7" causality="output"><Dimension start="2"/>'
        '<Dimension start="2"/></Float64>',
        '<Int32 name="trick" valueReference="8" causality="parameter" start="0"/>',
        '<Boolean name="b_in" valueReference="36" causality="input" start="false"/>',
        '<Boolean name="b_out" valueReference="37" causality="output"/>',
        '<Enumeration name="m_in" declaredType="M" valueReference="40" causality="input" '
        'start="1"/>',
        '<Enumeration name="m_out" declaredType="M" valueReference="41" causality="output"/>',
        '<String name="said" valueReference="50" causality="parameter"><Start value="x"/></String>',
        '<Binary name="blob" valueReference="51" causality="input"/>',
    ]
    for name, vr in FULL_RANGE.items():
        low = name.lower()
        rows.append(
            f'<{name} name="{low}_in" valueReference="{vr}" causality="input" start="1"/>'
        )
        rows.append(
            f'<{name} name="{low}_out" valueReference="{vr + 1}" causality="output"/>'
        )
    knowns = {"3": "2", "6": "5", "7": "", "37": "36", "41": "40"} | {
        str(vr + 1): str(vr) for vr in FULL_RANGE.values()
    }
    outputs = "".join(
        f'<Output valueReference="{r}" dependencies="{on}"/>'
        for r, on in knowns.items()
    )
    return (
        f'<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="{version}" '
        f'modelName="strange3" instantiationToken="{{three}}"><{kind} modelIdentifier="strange3" '
        'canGetAndSetFMUState="true" canSerializeFMUState="true" '
        'canHandleVariableCommunicationStepSize="true"/>'
        '<TypeDefinitions><EnumerationType name="M"><Item name="off" value="0"/><Item name="on" '
        'value="1"/><Item name="safe" value="3"/></EnumerationType></TypeDefinitions>'
        f"<ModelVariables>{''.join(rows)}{more}</ModelVariables><ModelStructure>{outputs}"
        "</ModelStructure></fmiModelDescription>"
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The stranger's folder."""
    return compiled_folder(tmp_path_factory.mktemp("strange3"))


def compiled_folder(place: Path, *flags: str) -> Path:
    """The folder `where` as the stranger's, compiled with these flags."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    library_ = place / "binaries" / fmpy.platform_tuple / "strange3.so"
    library_.parent.mkdir(parents=True)
    source = (ROOT / "tests" / "strange3.c").read_text()
    header = (Path(fmpy.__file__).parent / "c-code" / "fmi3FunctionTypes.h").read_text()
    others = set(re.findall(r"(fmi3\w+)TYPE", header)) - set(
        re.findall(r"\b(fmi3\w+)\(", source)
    )
    others -= {
        f"fmi3{way}{name}"
        for way in ("Get", "Set")
        for name in ("Float32", "Float64", "Boolean", *FULL_RANGE)
    }
    code = place / "strange3.c"
    code.write_text(
        source + "".join(f"int {f}(void) {{ return 3; }}\n" for f in sorted(others))
    )
    subprocess.run(
        [
            compiler,
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            *flags,
            "-o",
            str(library_),
            str(code),
            "-lm",
        ],
        check=True,
    )
    (place / "modelDescription.xml").write_text(description())
    return place


TYPED = ("f", "b", "m", *(n.lower() for n in FULL_RANGE))
WIRES = [
    Connection(
        "a", "y[1]", "b", "u[2]", factor=3.0, offset=-0.1
    ),  # the others stay as they start
    Connection("a", "y[1]", "b", "f_in"),
    *(Connection("a", f"{n}_out", "b", f"{n}_in") for n in TYPED if n != "f"),
]


def system(folder: Path, of: str = "b", **parameters: object):
    """Two in a row, one of them with these parameters."""
    fmu = library.load(folder)
    inputs: dict[str, dict[str, object]] = {
        "a": {"u[1]": 0.5, "u[2]": 1.5, "u[3]": 7.0},
        "b": {"u[1]": 0.5, "u[3]": 2.5},
    }
    inputs[of] |= parameters
    draft = Draft("here", "strange", connections=list(WIRES), step=0.5, stop=1e6)
    for n in "ab":
        draft.components[n] = Component(n, "strange3.fmu", fmu.interface, fmu=fmu)
        draft.assign(Assignment(n, name, x, "here") for name, x in inputs[n].items())
    return check_draft(draft).or_raise()


def rows(
    folder: Path,
    loop: str,
    steps: int = 20,
    isolated: tuple[str, ...] = (),
    **parameters: object,
) -> dict[str, np.ndarray]:
    with Master(*system(folder, **parameters), isolated=isolated) as m:
        m.initialise()
        recorder = Recorder(None, m)
        result = stepping(m, recorder, NEVER, loop)
        assert result.name == loop, result.reason
        run(m, result, steps, recorder)
        with recorder.finish(m) as results:
            return {n: results.values(n).copy() for n in results.names()}


def test_what_it_declares_is_read(folder):
    signals = of_fmu(folder).signals
    assert [n for n in signals if n.startswith("table")] == [
        "table[1,1]",
        "table[1,2]",
        "table[2,1]",
        "table[2,2]",
    ]
    assert [signals[f"u[{i}]"].start for i in (1, 2, 3)] == [0.5, 1.5, 2.5]
    assert {signals[f"{n.lower()}_in"].kind for n in FULL_RANGE} == {"Integer"}
    assert signals["f_in"].kind == "Real"
    assert signals["m_in"].choices == ("off", "on", "-", "safe")
    assert signals["y[2]"].output_class == "interval"
    assert signals["table[2,2]"].output_class == "state"


def test_every_type_comes_through_alike_in_both_loops(folder):
    results = [rows(folder, loop) for loop in BOTH]
    for name, values in results[0].items():
        assert values.tobytes() == results[1][name].tobytes(), name
    first_rows = results[0]
    t = 0.5 * np.arange(21)
    y = 2.0 * 0.5 + np.sin(t + 0.5)[:-1]  # over the step from t
    np.testing.assert_array_equal(
        first_rows["a/y"][:-1, 0] if "a/y" in first_rows else first_rows["a.y"][:20, 0],
        y,
    )
    b = first_rows["b.y"][:20]
    np.testing.assert_allclose(b[:, 1], 2.0 * (3.0 * y - 0.1), rtol=1e-15)
    assert (first_rows["a.y"][:20, 1:] == (3.0, 14.0)).all()
    assert (b[:, 2] == 5.0).all()
    np.testing.assert_array_equal(
        first_rows["b.f_out"][:20], np.float32(y) / np.float32(3)
    )
    np.testing.assert_array_equal(
        first_rows["b.table"].reshape(21, 4),
        10.0 * np.arange(4) + t[:, None],
        strict=True,
    )
    for n in FULL_RANGE:
        assert (first_rows[f"b.{n.lower()}_out"][:20] == 3).all(), n
    assert first_rows["b.b_out"][:20].all() == 0
    assert (first_rows["b.m_out"][:20] == 1).all()


@pytest.mark.parametrize("loop", BOTH)
@pytest.mark.parametrize(
    ("trick", "message"),
    [
        (
            1,
            "b: the step from t = 3 s returned error: it asks for the end of the simulation at t = 3.5 "
            "s",
        ),
        (
            2,
            "b: the step from t = 3 s returned error: it returned early, at t = 3.5 s, which desat "
            "does not offer (earlyReturnAllowed is false)",
        ),
        (3, "b: the step from t = 0 s returned discard: 100 % too long"),
        (
            4,
            "b: reading its outputs after t = 3 s returned error: int64_out = 1099511627779 is "
            "beyond -2147483648 to 2147483647",
        ),
        (
            5,
            "b: the step from t = 3 s returned error: it says ok, but came to t = 3.125 s "
            "(lastSuccessfulTime)",
        ),
        (
            6,
            "b: the step from t = 3 s returned error: it wants an event handled at t = 3.5 s, which "
            "desat does not offer (eventModeUsed is false)",
        ),
        (
            14,
            "b: the step from t = 3 s returned error: it says ok, but came to t = nan s "
            "(lastSuccessfulTime)",
        ),
    ],
)
def test_what_a_step_may_not_end_with_is_said(folder, loop, trick, message):
    with pytest.raises(ComponentError) as error:
        rows(folder, loop, trick=trick)
    assert str(error.value) == message


WAYS = [("compiled", ()), ("python", ()), ("python", ("a", "b"))]
"""Both loops, and a process each."""


@pytest.mark.parametrize(("loop", "isolated"), WAYS)
@pytest.mark.parametrize(
    ("trick", "message"),
    [
        (5, "it says ok, but came to t = 3.125 s"),
        (6, "it wants an event handled"),
        (14, "nan s"),
    ],
)
def test_a_step_that_is_none_is_refused_in_every_way(
    folder, loop, isolated, trick, message
):
    with pytest.raises(
        ComponentError, match=f"b: the step from t = 3 s returned error: .*{message}"
    ):
        rows(folder, loop, isolated=isolated, trick=trick)


@pytest.mark.parametrize(("loop", "isolated"), WAYS)
@pytest.mark.parametrize(
    ("trick", "call"),
    [
        (7, "reading its outputs returned warning, the first time at t = 3 s"),
        (8, "setting its inputs returned warning, the first time at t = 3.5 s"),
        (9, "the step returned warning, the first time at t = 3 s"),
        (10, "fmi3ExitInitializationMode returned warning"),
        (12, "fmi3Terminate returned warning"),
    ],
)
def test_a_status_of_warning_is_told_once(folder, loop, isolated, trick, call):
    with Master(*system(folder, trick=trick), isolated=isolated) as m:
        m.initialise()
        run(m, stepping(m, None, NEVER, loop), 20, Recorder(None, m))
        assert m.k == 20
        m.terminate()
        assert m.messages() == [f"b: {call}"]


@pytest.mark.parametrize("isolated", [(), ("a", "b")])
def test_a_status_below_0_is_none_of_fmi(folder, isolated):
    with (
        Master(*system(folder, trick=11), isolated=isolated) as m,
        pytest.raises(
            ComponentError, match=r"^b: fmi3EnterInitializationMode returned -1$"
        ),
    ):
        m.initialise()


@pytest.mark.parametrize("isolate", ["none", "foreign"])
@pytest.mark.parametrize(
    ("trick", "status", "expected_message"),
    [
        (12, "completed", "b: fmi3Terminate returned warning"),
        (13, "failed", "b: fmi3Terminate returned error: not now, after the run"),
        (
            6,
            "failed",
            "b: the step from t = 3 s returned error: it wants",
        ),  # and is not terminated
    ],
)
def test_a_run_that_has_not_failed_terminates_it(
    folder, tmp_path, isolate, trick, status, expected_message
):
    """All rows are there; at the end of one that has failed no more is said."""
    shutil.make_archive(str(tmp_path / "strange3"), "zip", folder)
    (tmp_path / "strange3.zip").rename(tmp_path / "strange3.fmu")
    (tmp_path / "SystemStructure.ssd").write_text(
        '<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/'
        'SystemStructureDescription" name="s" version="1.0"><ssd:System name="s"><ssd:Elements>'
        '<ssd:Component name="b" source="strange3.fmu"/></ssd:Elements></ssd:System>'
        "</ssd:SystemStructureDescription>"
    )
    options = {"step": 0.5, "stop": 5.0, "isolate": isolate}
    ran = desat.run(str(tmp_path), {"b.trick": trick}, **options)
    assert ran.manifest.status == status
    assert len(ran.results.times()) == (11 if trick > 10 else 7)
    messages = [ran.manifest.message, *ran.manifest.warnings]
    (own_value,) = (x for x in messages if x.startswith("b: ") and "returned" in x)
    assert own_value.startswith(expected_message)
    assert sum("Terminate" in line for line in messages) == (trick > 10)


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_a_library_of_another_version_is_refused(tmp_path, isolate):
    other = compiled_folder(tmp_path / "other", '-DVERSION="3.9"')
    isolated = ("a", "b") if isolate == "foreign" else ()
    with pytest.raises(DesatError) as error:
        Master(*system(other), isolated=isolated)
    assert str(error.value) == (
        "a: other: its library says that it is of FMI 3.9 (fmi3GetVersion), its "
        "modelDescription.xml of FMI 3.0: both must be the same"
    )


def test_in_a_process_of_its_own_it_does_the_same(folder):
    alone, inside = (rows(folder, "python", isolated=i) for i in (("a", "b"), ()))
    for name, values in inside.items():
        assert values.tobytes() == alone[name].tobytes(), name
    with pytest.raises(
        ComponentError, match="t = 3 s returned error: it asks for the end"
    ):
        rows(folder, "python", isolated=("a", "b"), trick=1)


def test_a_parameter_beyond_its_type_and_one_that_is_structural_are_refused(folder):
    with (
        Master(*system(folder, uint8_in=300)) as m,
        pytest.raises(ComponentError, match=r"b: .*uint8_in = 300 is beyond 0 to 255"),
    ):
        m.initialise()
    with pytest.raises(
        ComponentError, match="fmi3EnterConfigurationMode returned error"
    ):
        Master(*system(folder, n=5))


@pytest.mark.parametrize("loop", BOTH)
def test_the_last_value_of_a_type_is_one_of_it(folder, loop):
    """Set, handed on and read: b gives one more than a, which gives one more than it is
    given."""
    most = (1 << 31) - 1
    with Master(*system(folder, int8_in=-128, uint8_in=255, int32_in=most)) as m:
        m.initialise()
    last_rows = rows(
        folder, loop, 4, of="a", int64_in=most - 2, int8_in=-128, uint8_in=253
    )
    assert set(last_rows["b.int64_out"]) == {most}
    assert (last_rows["a.int8_out"][0], last_rows["b.uint8_out"][0]) == (-127, 255)
    with pytest.raises(
        ComponentError, match=rf"b: .*int64_out = {most + 1} is beyond -2147483648"
    ):
        rows(folder, loop, 4, of="a", int64_in=most - 1)
    for values in (
        {"int8_in": 127, "uint8_in": 300},
        {"int8_in": -128, "uint8_in": -1},
    ):
        with (
            Master(*system(folder, **values)) as m,
            pytest.raises(
                ComponentError, match=rf": uint8_in = {values['uint8_in']} is beyond"
            ),
        ):
            m.initialise()


@pytest.mark.parametrize(("loop", "isolated"), WAYS)
def test_what_is_logged_is_told_where_it_is_no_ok_and_twenty_times(
    folder, loop, isolated
):
    for trick, answer in (
        (15, []),
        (16, [f"b: now at {0.5 * k:g} s" for k in range(20)]),
    ):
        with Master(*system(folder, trick=trick), isolated=isolated) as m:
            m.initialise()
            run(m, stepping(m, None, NEVER, loop), 30, Recorder(None, m))
            assert m.messages() == answer


def test_a_step_that_is_discarded_is_halved(folder):
    with Master(*system(folder, trick=3), halvings=2) as m:
        m.initialise()
        for _ in range(4):
            m.advance()
        assert "made in 2 parts" in str(m.members["b"].instance.messages)


def test_a_state_goes_on_in_another_instance(folder):
    with Master(*system(folder)) as one, Master(*system(folder)) as other:
        one.initialise(), other.initialise()
        for _ in range(3):
            one.advance()
        for name, member in one.members.items():
            other.members[name].instance.restore(member.instance.save())
        other.k = one.k
        one.advance(), other.advance()
        assert one.live["Real"].tobytes() == other.live["Real"].tobytes()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            description(kind="ModelExchange"),
            "FMI 3.0 for model exchange alone: FMI 1.0, 2.0 or 3.0 for "
            "co-simulation is needed",
        ),
        (
            description(kind="ScheduledExecution"),
            "FMI 3.0 for scheduled execution alone",
        ),
        (
            description(version="3.1"),
            "FMI 3.1: FMI 1.0, 2.0 or 3.0 for co-simulation is needed",
        ),
        (
            description(version="3.9"),
            "FMI 3.9: FMI 1.0, 2.0 or 3.0 for co-simulation is needed",
        ),
        (
            description(version="3.0-beta.2"),
            "FMI 3.0-beta.2: FMI 1.0, 2.0 or 3.0 for co-sim",
        ),
        (
            description(
                '<Clock name="tick" valueReference="60" causality="input" intervalVariability='
                '"triggered"/>'
            ),
            "tick is a clock: there is no event mode here",
        ),
        (
            description(
                '<Float64 name="z" valueReference="61" causality="input" start="1 2"><Dimension '
                'start="3"/></Float64>'
            ),
            "z: 2 start values for 3 elements",
        ),
        (
            description(
                '<Float64 name="z" valueReference="61"><Dimension start="99999999"/></Float64>'
            ),
            "z: 99999999 elements, more than 1000000",
        ),
    ],
)
def test_what_is_not_supported_is_refused_by_name(tmp_path, text, message):
    (tmp_path / "modelDescription.xml").write_text(text)
    with pytest.raises(DesatError) as error:
        of_fmu(tmp_path, "theirs.fmu")
    assert str(error.value).startswith("theirs.fmu")
    assert message in str(error.value)


def test_what_is_not_handed_on_is_said(folder):
    assert list(library.unused_warnings(system(folder)[0])) == [
        "a: Binary variables are not passed to other components: blob",
        "b: Binary variables are not passed to other components: blob",
    ]


# --- ours, by their other face --------------------------------------------------------


def test_ours_declare_by_both_faces_the_same():
    fmus = sorted((DIST / "fmi3").glob("*.fmu"))
    assert len(fmus) > 30
    for path in fmus:
        two, three = of_fmu(DIST / "native" / path.name), of_fmu(path)
        signals = {n: replace(s, type="", element=0) for n, s in three.signals.items()}
        del signals["time"]
        assert list(signals.items()) == list(two.signals.items()), path.name
        assert (three.role, three.title, three.fmi) == (two.role, two.title, "3.0")


@pytest.mark.parametrize("way", ["compiled", "called", "python"])
def test_a_whole_scenario_of_fmi_3_has_the_bits_of_fmi_2(way, monkeypatch):
    """By the compiled loop, which finds values where they lie; by FMI's calls alone; in
    Python."""
    name = "integrated/mil-nadir"
    two = execute(name, Options(stop=60.0), None)
    system_, _ = prepare(name, Options(stop=60.0)).or_raise()
    sources = [
        f"{c.name}={DIST / 'fmi3' / Path(c.source).name}"
        for c in system_.components.values()
    ]
    if way == "called":
        monkeypatch.setattr(
            "desat.engine.instances.fmu.FmuInstance._places", lambda *_: None
        )
    options = Options(
        stop=60.0, sources=sources, loop="python" if way == "python" else "compiled"
    )
    three = execute(name, options, None)
    names = two.results.names()
    assert names == three.results.names()
    for n in names:
        assert two.results.values(n).tobytes() == three.results.values(n).tobytes(), n
    with Master(*prepare(name, options).or_raise()) as m:
        m.initialise()
        codes = {CODES[o.code] for o in Program(m.cycle).operations}
    assert "STEP_3" in codes
    assert "STEP" not in codes
    assert ("TRANSFER_3" in codes) == (way == "called")
