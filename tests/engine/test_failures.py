"""What ends a run, or would: a row of docs/failures.md each. failing.c is the FMU that
fails."""

from __future__ import annotations

import ast
import contextlib
import errno
import json
import os
import platform
import re
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import psutil
import pytest

from benchmarks import seen, soak
from desat import cli
from desat.campaign.draws import draws
from desat.campaign.sweep import sweep
from desat.cli.console import plain_console
from desat.engine import child
from desat.engine.recording.recorder import Recorder
from desat.engine.recording.results import Results
from desat.engine.recording.row_buffer import Bank
from desat.engine.recording.series_file import Packing
from desat.export.packing import pack
from desat.files import io, library
from desat.fmus import native
from desat.report.report import write_report
from desat.runs import isolation, step_case, substep_choice
from desat.runs import run as case
from desat.runs.run import Options, load_run, prepare, simulate
from desat.system.errors import DesatError, Exit, RunError
from tests.conftest import ROOT, module_of, python

pages = module_of("benchmarks.pages.sources")
tables = module_of("desat.papers.tables")
SOURCE = ROOT / "tests" / "failing.c"
FAILURES = (
    re.search(r"enum \{(.*?)\}", SOURCE.read_text(), re.S)[1]
    .replace("\n", " ")
    .split(",")
)
FAILURES = [name.strip() for name in FAILURES]

DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="failing" guid="{{1}}">
<CoSimulation modelIdentifier="{identifier}"/>
<ModelVariables>
<ScalarVariable name="how" valueReference="0" causality="parameter" variability="fixed">
<Integer start="0"/></ScalarVariable>
<ScalarVariable name="y" valueReference="1" causality="output"><Real/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="2" dependencies=""/></Outputs></ModelStructure>
</fmiModelDescription>"""
SSD = """<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
 xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
 xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
 name="s" version="1.0"><ssd:System name="s"><ssd:Elements>
<ssd:Component name="{name}" type="application/x-fmu-sharedlibrary" source="{source}">
{inside}</ssd:Component></ssd:Elements></ssd:System>
<ssd:DefaultExperiment startTime="{start}" stopTime="{stop}"/></ssd:SystemStructureDescription>"""


def ssd(
    source: str = "resources/failing.fmu",
    name: str = "bad",
    inside: str = "",
    start: str = "0",
    stop: str = "10",
) -> str:
    return SSD.format(source=source, name=name, inside=inside, start=start, stop=stop)


def fmu(
    path: Path,
    binary: bytes,
    identifier: str = "failing",
    folder: str = "linux64",
    description: str = "",
) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(path, "w") as archive:
        text = description or DESCRIPTION.format(identifier=identifier)
        archive.writestr("modelDescription.xml", text)
        archive.writestr(f"binaries/{folder}/failing.so", binary)
    return path


def compile_failing(folder: Path, *flags: str) -> bytes:
    """The library of failing.c."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    library = folder / "failing.so"
    subprocess.run(
        [
            compiler,
            "-shared",
            "-fPIC",
            "-O1",
            "-w",
            *flags,
            "-o",
            library,
            SOURCE,
            "-lm",
        ],
        check=True,
    )
    return library.read_bytes()


@pytest.fixture(scope="session")
def binary(tmp_path_factory) -> bytes:
    return compile_failing(tmp_path_factory.mktemp("failing"))


@pytest.fixture
def system(tmp_path, binary) -> Path:
    """A folder with one component, `bad`, which fails as its parameter says."""
    fmu(tmp_path / "s" / "resources" / "failing.fmu", binary)
    (tmp_path / "s" / "SystemStructure.ssd").write_text(ssd())
    return tmp_path / "s"


def drawn_to_fail(folder: Path, binary: bytes, ways: list[str]) -> str:
    """A system in `folder` whose component `bad` is drawn to fail in one of these ways."""
    fmu(folder / "resources" / "failing.fmu", binary)
    (folder / "SystemStructure.ssd").write_text(ssd())
    about = {
        "name": "failing",
        "numbers": {"y": {"title": "y", "signal": "bad.y"}},
        "dispersions": {"bad.how": {"one_of": [FAILURES.index(w) for w in ways]}},
    }
    (folder / "extra" / "desat").mkdir(parents=True)
    (folder / "extra" / "desat" / "scenario.json").write_text(json.dumps(about))
    return str(folder)


def options(failure: str, **more: object) -> Options:
    """In the process that steps, which is watched, unless more is said."""
    more = {"supervised": True, "isolate": "none", **more}
    return Options(sets=[f"bad.how={FAILURES.index(failure)}"], step=1.0, **more)


def test_a_system_without_connections_can_be_packed(system, tmp_path):
    pack(prepare(str(system), options("NOTHING")).or_raise()[0], tmp_path / "p.ssp")
    system_packed, _ = prepare(str(tmp_path / "p.ssp"), Options()).or_raise()
    assert (list(system_packed.components), system_packed.connections) == (["bad"], ())


# --- a component that ends the process ------------------------------------------------

CALL = "bad: the step from t = 3 s ended the process: "
ALONE = CALL.replace("the process", "its process")


@pytest.mark.parametrize(
    ("failure", "text"),
    [
        ("SEGFAULT", CALL + "SIGSEGV"),
        ("ABORT", CALL + "SIGABRT"),
        ("KILL", CALL + "SIGKILL"),
        ("EXIT_0", CALL + "exit(0)"),
        ("EXIT_3", CALL + "exit(3)"),
        ("OVERFLOW", CALL + "SIGSEGV"),
    ],
)
def test_a_component_that_ends_the_process(system, tmp_path, failure, text):
    """4, and the rows up to the step before, none twice."""
    run = simulate(prepare(str(system), options(failure)), tmp_path / "out")
    assert run.code == Exit.COMPONENT
    assert run.manifest["message"].startswith(text)
    assert run.results.times().tolist() == [0.0, 1.0, 2.0]
    assert run.results.values("bad.y").tolist() == [0.0, 1.0, 2.0]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "manifest.json",
        "series.h5",
    }
    assert (
        json.loads((tmp_path / "out/manifest.json").read_text())["status"] == "failed"
    )


@pytest.mark.parametrize("failure", ["SEGFAULT", "EXIT_0"])
def test_a_crash_of_one_of_ours_ends_the_run(system, tmp_path, monkeypatch, failure):
    """Ours run together, and so not in processes of their own."""
    monkeypatch.setattr(library.FmuFile, "ours", True)
    run = simulate(
        prepare(str(system), options(failure, isolate="foreign")), tmp_path / "out"
    )
    assert run.code == Exit.COMPONENT
    assert run.manifest["message"].startswith(CALL)
    assert run.results.times().tolist() == [0.0, 1.0, 2.0]


@pytest.fixture(scope="session")
def ours(tmp_path_factory) -> Path:
    """A native FMU of ours that crashes in its fourth step of 1 s."""
    folder, sources = tmp_path_factory.mktemp("ours"), native.sources

    def crashing(name: str) -> tuple[dict[str, str], str]:
        files, guid = sources(name)
        begins = "static void desat_do_advance(void *self, double t, double dt)\n{"
        text = files[f"{name}.c"]
        assert begins in text
        crash = f"{begins}\n    if (t > 2.5) *(volatile int *)8 = 1;"
        return {**files, f"{name}.c": text.replace(begins, crash)}, guid

    native.compile_wrapper(folder)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(native, "sources", crashing)
        return native.build("controller_pd", folder / "dist", folder)


@pytest.mark.parametrize("substeps", [1, "auto"])
def test_a_crash_of_one_of_ours_is_named_also_in_a_flight_beforehand(
    ours, tmp_path, substeps
):
    """With `auto` it ended the command itself, without a word: flights were made in its
    process."""
    script = f"""
import sys
from desat import cli
from desat.files import library
library.FmuFile.ours = True
sys.argv = ["desat", "run", "nadir_day/day-dipole", "--source", "controller={ours}", "--stop", "10",
            "--substeps", "{substeps}", "--out", {str(tmp_path / "out")!r}]
sys.exit(cli._code())
"""
    script_run = python(script)
    crash = "controller: the step from t = 3 s ended the process: SIGSEGV"
    assert script_run.returncode == Exit.COMPONENT, script_run.stderr
    assert f"failed: {crash}; 3 rows are kept" in script_run.stderr
    assert (tmp_path / "out/report.html").exists()
    with load_run(tmp_path / "out").results as results:
        assert results.times().tolist() == [0.0, 1.0, 2.0]
    if substeps == "auto":
        answer = json.loads((tmp_path / "out/manifest.json").read_text())[
            "substep_choice"
        ]["why"]
        assert answer == f"a flight beforehand failed: {crash}"


@pytest.fixture
def hang_up_is_heard() -> Iterator[None]:
    """SIGHUP as a process has it by default: whoever runs the tests may have it
    ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hang_up_is_heard")
@pytest.mark.parametrize(
    ("number", "error_type"),
    [
        (signal.SIGINT, KeyboardInterrupt),
        (signal.SIGTERM, SystemExit),
        (signal.SIGHUP, SystemExit),
    ],
)
def test_a_signal_in_a_flight_beforehand_ends_it(monkeypatch, number, error_type):
    test = os.getpid()

    def flies(*_: object) -> None:
        assert os.getppid() == test
        time.sleep(0.5)  # until the parent hands it on
        os.kill(os.getppid(), number)
        time.sleep(30.0)

    monkeypatch.setattr(substep_choice._Flights, "choice", flies)
    with pytest.raises(error_type) as exit_info:
        simulate(
            prepare("nadir_day/day-dipole", Options(substeps="auto", supervised=True))
        )
    assert error_type is KeyboardInterrupt or exit_info.value.code == 128 + number


@pytest.mark.parametrize("loop", ["compiled", "python"])
def test_a_fork_among_others_changes_no_row(system, tmp_path, loop):
    """Both processes wrote rows into what they share, and the run ended as a bug of
    ours."""
    run = simulate(prepare(str(system), options("FORK", loop=loop)), tmp_path / "out")
    assert (run.ok, run.manifest["loop"]["name"]) == (True, loop)
    assert run.results.times().tolist() == [float(k) for k in range(11)]
    assert run.results.values("bad.y").tolist() == run.results.times().tolist()


@pytest.mark.parametrize("loop", ["compiled", "python"])
@pytest.mark.parametrize("failure", ["FORK", "FORK_BESIDE"])
def test_a_fork_does_not_come_back_to_whoever_runs_it(system, failure, loop):
    """In a step, in initialisation and when it is freed: a script that uses the library
    went on twice."""
    script = f"""
import desat
sets = {{"bad.how": {FAILURES.index(failure)}}}
run = desat.run({str(system)!r}, sets, isolate="none", step=1.0, loop={loop!r})
print("ended", run.manifest["status"], run.results.times()[-1])
"""
    assert python(script).stdout == "ended completed 10.0\n"


def test_the_command_reports_a_crash(apart, system, tmp_path):
    result = apart(
        "run",
        str(system),
        "--step",
        "1",
        "--set",
        f"bad.how={FAILURES.index('EXIT_0')}",
        "--out",
        str(tmp_path / "out"),
    )
    assert result.returncode == Exit.COMPONENT
    (line,) = [x for x in result.stderr.splitlines() if "exit(0)" in x]
    assert line == f"failed: {ALONE}exit(0)"
    assert (tmp_path / "out" / "report.html").exists()


def children() -> set[int]:
    """The processes that this one has started and not waited for."""
    return {process.pid for process in psutil.Process().children()}


@pytest.mark.parametrize("is_supervised", [True, False])
def test_an_isolated_component_ends_alone(system, tmp_path, is_supervised):
    """Of two components one ends its process: the run has its last row, the other is
    freed."""
    before = children()  # of other tests
    two = (system / "SystemStructure.ssd").read_text()
    one = two[two.index("<ssd:Component ") : two.index("</ssd:Elements>")]
    two = two.replace(one, one + one.replace('"bad"', '"good"'))
    (system / "SystemStructure.ssd").write_text(two)
    for failure, text, code, last in (
        ("SEGFAULT", f"{ALONE}SIGSEGV", Exit.COMPONENT, 3.0),
        ("ABORT", f"{ALONE}SIGABRT", Exit.COMPONENT, 3.0),
        ("KILL", f"{ALONE}SIGKILL", Exit.COMPONENT, 3.0),
        ("OVERFLOW", f"{ALONE}SIGSEGV", Exit.COMPONENT, 3.0),
        ("EXIT_0", f"{ALONE}exit(0)", Exit.COMPONENT, 3.0),
        ("EXIT_3", f"{ALONE}exit(3)", Exit.COMPONENT, 3.0),
        (
            "HANG",
            "bad: the step from t = 3 s did not return within 1.5 s",
            Exit.TIMEOUT,
            3.0,
        ),
        (
            "STEP_ERROR",
            "bad: the step from t = 3 s returned error",
            Exit.COMPONENT,
            3.0,
        ),
        ("FATAL", "bad: the step from t = 3 s returned fatal", Exit.COMPONENT, 3.0),
        ("DISCARD", "bad: the step from t = 3 s returned discard", Exit.COMPONENT, 3.0),
        ("NEGATIVE", "bad: the step from t = 3 s returned -1", Exit.COMPONENT, 3.0),
        ("FORK", "", Exit.COMPLETED, 10.0),
        ("LEAVE", f"{ALONE}SIGSEGV", Exit.COMPONENT, 3.0),
        ("NOT_FINITE", "bad.y = nan at t = 4 s", Exit.COMPONENT, 4.0),
        (
            "IN_FREE",
            "bad: freeing it ended its process: SIGSEGV, after the run",
            4,
            10.0,
        ),
        (
            "IN_START",
            "bad: entering initialisation ended its process: SIGSEGV",
            4,
            None,
        ),
        ("IN_EXIT", "bad: leaving initialisation ended its process: exit(0)", 4, None),
        ("ROUNDING", "", Exit.COMPLETED, 10.0),
    ):
        limit = 1.5 if failure == "HANG" else 60.0
        run_options = options(
            failure, call_limit=limit, isolate="foreign", supervised=is_supervised
        )
        if last is None:
            with pytest.raises(RunError) as error:
                simulate(prepare(str(system), run_options), tmp_path / failure)
            assert (str(error.value), error.value.code) == (text, code)
        else:
            run = simulate(prepare(str(system), run_options), tmp_path / failure)
            assert (run.manifest["message"], run.code) == (text, code)
            assert run.results.values("good.y").tolist() == run.results.times().tolist()
            assert run.results.times()[-1] == last
        assert children() <= before  # none is left, not even unwaited for
    (warning,) = [w for w in run.manifest["warnings"] if "rounding" in w]
    assert warning.startswith("bad: it changed the rounding mode of its process")


WROTE = "bad: at t = 3 s it wrote into a file that is not its own; it was ended"


@pytest.mark.parametrize(
    ("failure", "text"),
    [
        ("SCRIBBLE", WROTE),
        ("DOT", WROTE),
        ("KILL_GROUP", f"{ALONE}SIGKILL"),
        ("DAEMON", ""),
        ("STAY", ""),
    ],
)
def test_an_isolated_component_has_nothing_of_the_heads(
    system, apart, daemons, failure, text
):
    """What it finds open, its process group and what it leaves behind are its own: it
    wrote into the files of the run, killed `desat`, and its daemons held the caller's
    pipes."""
    command = apart(
        "run",
        str(system),
        "--step",
        "1",
        "--set",
        f"bad.how={FAILURES.index(failure)}",
        "--json",
        "--out",
        str(system / "out"),
    )
    assert command.returncode == (Exit.COMPONENT if text else Exit.COMPLETED), (
        command.stderr
    )
    answer = json.loads(command.stdout)
    assert answer["message"] == text
    with load_run(system / "out").results as results:
        assert results.times().tolist() == [float(k) for k in range(4 if text else 11)]
        assert results.values("bad.y").tolist() == results.times().tolist()
    assert daemons() == []


def test_daemons_that_left_their_group_stay_where_nobody_watches(system, daemons):
    """As the page says: of a run in the library that is not supervised."""
    script = f"""
import desat
desat.run({str(system)!r}, {{"bad.how": {FAILURES.index("DAEMON")}}}, step=1.0).or_raise("it")
"""
    subprocess.run(
        [sys.executable, "-c", script],
        check=True,
        timeout=60,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
    )
    deadline = time.monotonic() + 60.0
    while not (stays := daemons()) and time.monotonic() < deadline:
        time.sleep(0.05)  # it is forked before it takes its name
    (one,) = stays
    one.kill()


@pytest.mark.parametrize(
    ("failure", "message", "code"),
    [
        (
            "SCRIBBLE_EARLY",
            "wrote into a file that is not its own; it was ended",
            Exit.COMPONENT,
        ),
        (
            "SCRIBBLE_CODE",
            "wrote into a file that is not its own; it was ended",
            Exit.COMPONENT,
        ),
        ("SCRIBBLE_LONG", "did not return within 1 s", Exit.TIMEOUT),
    ],
)
def test_what_an_isolated_component_writes_is_no_answer(
    system, tmp_path, failure, message, code
):
    """In a call that is no step: it was a bug of ours. What reads as the beginning of a
    message is waited for."""
    limit = (
        1.0 if code == Exit.TIMEOUT else 60.0
    )  # nothing else is late on a busy machine
    run_options = options(failure, isolate="foreign", call_limit=limit)
    with pytest.raises(RunError) as error:
        simulate(prepare(str(system), run_options), tmp_path)
    assert (str(error.value), error.value.code) == (
        f"bad: entering initialisation {message}",
        code,
    )


def test_what_refuses_to_be_instantiated_is_heard(system, tmp_path):
    """Also where it has a process, of which nothing is left; and what cannot even be
    loaded, and what ends its process then."""
    before = children()
    refuses, dies = (
        compile_failing(tmp_path, "-DREFUSES"),
        compile_failing(tmp_path, "-DDIES"),
    )
    died = "bad: instantiating it ended {} process: SIGSEGV"
    for binary_file, isolate, text, code in (
        (refuses, "none", "bad: cannot be instantiated: no licence", 2),
        (refuses, "foreign", "bad: cannot be instantiated: no licence", 2),
        (b"no library", "none", "its library cannot be loaded: it is no library", 2),
        (dies, "none", died.format("the"), 4),
        (dies, "foreign", died.format("its"), 4),
    ):
        fmu(system / "resources/failing.fmu", binary_file)
        with pytest.raises(DesatError, match=re.escape(text)) as error:
            simulate(prepare(str(system), options("NOTHING", isolate=isolate)))
        assert error.value.code == code
        assert children() <= before


def test_where_no_process_can_be_had_it_is_said(system, monkeypatch):
    """Elsewhere than on POSIX."""
    monkeypatch.setattr(isolation, "CAN", False)
    case = prepare(str(system), Options(step=1.0))
    assert isolation.isolated_in(case.or_raise()[0], case.options) == frozenset()
    (line,) = [w for w in case.warnings if "POSIX" in w]
    assert line.startswith("bad: foreign FMUs run in the process of the run")
    run = simulate(prepare(str(system), options("NOTHING", isolate="foreign")))
    assert (run.code, run.manifest["loop"]["name"]) == (Exit.COMPLETED, "compiled")
    with pytest.raises(
        DesatError, match="--isolate all: it needs processes that can be forked"
    ):
        prepare(str(system), Options(step=1.0, isolate="all")).or_raise()
    assert prepare(str(system), Options(step=1.0, isolate="none")).warnings == []
    monkeypatch.undo()
    with pytest.raises(
        DesatError, match="--isolate all: it has no effect without an FMU"
    ):
        prepare("gyrostat/free", Options(blocks=True, isolate="all")).or_raise()


def test_isolated_runs_have_the_same_bits(tmp_path):
    """Also where they go on from a checkpoint."""
    series = []
    for isolate in ("none", "all"):
        options = Options(stop=20.0, isolate=isolate, supervised=True)
        results = simulate(
            prepare("gyrostat/free", options), tmp_path / isolate
        ).results
        series.append({n: results.values(n).tobytes() for n in results.names()})
    assert series[0] == series[1]
    assert len(series[0]) > 10


@pytest.mark.usefixtures("hang_up_is_heard")
@pytest.mark.parametrize(
    ("number", "error_type"),
    [
        (signal.SIGINT, KeyboardInterrupt),
        (signal.SIGTERM, SystemExit),
        (signal.SIGHUP, SystemExit),
    ],
)
def test_a_signal_before_the_first_step_is_no_bug_of_ours(
    monkeypatch, number, error_type
):
    def starts(*_: object) -> None:
        signal.signal(number, signal.default_int_handler)
        time.sleep(1.0)  # until the parent hands it on
        os.kill(os.getppid(), number)
        time.sleep(30.0)

    monkeypatch.setattr(case, "step", starts)
    with pytest.raises(error_type) as exit_info:
        simulate(prepare("plant/light", Options(supervised=True, blocks=True)))
    assert error_type is KeyboardInterrupt or exit_info.value.code == 128 + number


def test_many_rows_survive_a_crash(system, tmp_path, monkeypatch):
    """Those that were flushed, and those that were not, once each."""
    (system / "SystemStructure.ssd").write_text(ssd(start="-1097", stop="10"))
    run = simulate(prepare(str(system), options("SEGFAULT")), tmp_path / "out")
    assert run.results.times().tolist() == [float(t) for t in range(-1097, 3)]
    assert run.results.values("bad.y").tolist()[1:] == run.results.times().tolist()[1:]


@pytest.mark.parametrize(
    ("failure", "text", "code"),
    [
        (
            "IN_START",
            "bad: entering initialisation ended the process: SIGSEGV",
            Exit.COMPONENT,
        ),
        (
            "IN_EXIT",
            "bad: leaving initialisation ended the process: exit(0)",
            Exit.COMPONENT,
        ),
    ],
)
def test_a_component_that_ends_the_process_before_the_first_step(
    system, tmp_path, failure, text, code
):
    with pytest.raises(DesatError) as error:
        simulate(prepare(str(system), options(failure)), tmp_path / "out")
    assert str(error.value) == text
    assert error.value.code == code


def test_a_component_that_crashes_when_it_is_freed(system, tmp_path):
    run = simulate(prepare(str(system), options("IN_FREE")), tmp_path / "out")
    assert run.code == Exit.COMPONENT
    assert (
        run.manifest["message"]
        == "bad: freeing it ended the process: SIGSEGV, after the run"
    )
    assert run.results.times()[-1] == 10.0


def test_a_component_that_fails_politely(system, tmp_path):
    for failure, status, loop in (
        ("STEP_ERROR", "error", "compiled"),
        ("NEGATIVE", "-1", "compiled"),
        ("NEGATIVE", "-1", "python"),
        ("FATAL", "fatal", "compiled"),
        ("FATAL", "fatal", "python"),
        ("DISCARD", "discard", "compiled"),
    ):
        alone = options(failure, supervised=False, isolate="foreign")
        assert (
            f" returned {status}"
            in simulate(prepare(str(system), alone)).manifest["message"]
        )
        run = simulate(
            prepare(str(system), options(failure, loop=loop, supervised=False))
        )
        assert (run.code, run.manifest["loop"]["name"]) == (Exit.COMPONENT, loop)
        assert (
            run.manifest["message"] == f"bad: the step from t = 3 s returned {status}"
        )
        assert run.results.times()[-1] == 3.0
    for loop in ("compiled", "python"):
        run = simulate(prepare(str(system), options("NOT_FINITE", loop=loop)))
        assert (run.code, run.manifest["message"]) == (
            Exit.COMPONENT,
            "bad.y = nan at t = 4 s",
        )
        assert run.results.times()[-1] == 4.0


WAYS = [("compiled", "none"), ("python", "none"), ("compiled", "foreign")]
"""Both loops, and a process of its own."""


@pytest.mark.parametrize(("loop", "isolate"), WAYS)
def test_a_warning_by_status_is_told_once(system, loop, isolate):
    for failure, call in (
        ("READ_WARNS", "reading its outputs"),
        ("STEP_WARNS", "the step"),
    ):
        run = simulate(
            prepare(str(system), options(failure, loop=loop, isolate=isolate))
        )
        assert run.code == Exit.COMPLETED
        messages = [
            line for line in run.manifest["warnings"] if line.startswith("bad: ")
        ]
        assert messages == [f"bad: {call} returned warning, the first time at t = 3 s"]


@pytest.mark.parametrize(("loop", "isolate"), WAYS)
def test_one_that_asks_for_the_end_of_the_simulation_is_named(system, loop, isolate):
    run = simulate(
        prepare(str(system), options("ASKS_END", loop=loop, isolate=isolate))
    )
    assert run.code == Exit.COMPONENT
    assert run.manifest["message"] == (
        "bad: the step from t = 3 s returned discard: it asks for the end of the simulation at "
        "t = 3.5 s"
    )


@pytest.mark.parametrize(("loop", "isolate"), WAYS)
def test_one_that_does_not_terminate_is_named(system, loop, isolate):
    """Once all is recorded; after a failure it is not asked to, and of a run that was
    stopped it is a warning."""
    run = simulate(
        prepare(str(system), options("ENDS_BADLY", loop=loop, isolate=isolate))
    )
    assert run.code == Exit.COMPONENT
    message = "bad: fmi2Terminate returned error: not now"
    assert run.manifest["message"] == f"{message}, after the run"
    assert run.results.times()[-1] == 10.0
    late = options(
        "ENDS_BADLY", loop=loop, isolate=isolate, time_limit=0.0, supervised=False
    )
    run = simulate(prepare(str(system), late))
    assert run.code == Exit.TIMEOUT
    assert message in run.manifest["warnings"]
    step_error = options("STEP_ERROR", loop=loop, isolate=isolate)
    run = simulate(prepare(str(system), step_error))
    assert "fmi2Terminate" not in str(
        [run.manifest["message"], run.manifest["warnings"]]
    )


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_a_status_below_0_of_initialisation_is_refused(system, isolate):
    with pytest.raises(
        DesatError, match=r"^bad: fmi2EnterInitializationMode returned -1$"
    ):
        simulate(prepare(str(system), options("START_NEGATIVE", isolate=isolate)))


def test_a_discarded_step_is_made_in_parts(system, tmp_path, binary):
    """Where it is asked for, and the FMU can."""
    with pytest.raises(
        DesatError, match=r"--halve: bad: failing\.fmu cannot step anew"
    ):
        prepare(str(system), options("DISCARD", halvings=2)).or_raise()
    able = 'canGetAndSetFMUstate="true" canHandleVariableCommunicationStepSize="true"/>'
    text = DESCRIPTION.format(identifier="failing").replace("/>", f" {able}", 1)
    fmu(system / "resources/failing.fmu", binary, description=text)
    for halvings, last in ((0, 3.0), (1, 3.0), (2, 10.0)):
        run = simulate(
            prepare(str(system), options("DISCARD", halvings=halvings)),
            tmp_path / str(halvings),
        )
        assert run.results.times()[-1] == last
        assert run.manifest["status"] == ("completed" if halvings == 2 else "failed")
    assert run.results.values("bad.y").tolist() == run.results.times().tolist()
    assert (
        "bad: the step from t = 3 s was discarded, and made in 4 parts"
        in (run.manifest["warnings"])
    )
    assert run.manifest["loop"]["why"] == "the steps of bad may be halved"
    with pytest.raises(
        DesatError, match="--halve: it has no effect without a foreign FMU"
    ):
        prepare("nadir_day/day-dipole", Options(halvings=1)).or_raise()


def test_supervised_runs_have_the_same_bits(tmp_path):
    series = []
    for is_supervised in (False, True):
        case = prepare("gyrostat/free", Options(stop=20.0, supervised=is_supervised))
        results = simulate(case, tmp_path / str(is_supervised)).results
        series.append({n: results.values(n).tobytes() for n in results.names()})
    assert series[0] == series[1]
    assert len(series[0]) > 10


def test_a_crash_among_draws_leaves_the_other_rows(tmp_path, binary):
    target = drawn_to_fail(tmp_path / "s", binary, ["NOTHING", "SEGFAULT"])
    rows = draws(target, 8, 1, Options(step=1.0), jobs=2).rows
    crashes = [row.values["bad.how"] != FAILURES.index("NOTHING") for row in rows]
    assert [row.code for row in rows] == [int(Exit.COMPONENT) * e for e in crashes]
    assert {row.numbers["y"] for row in rows if row.completed} == {10.0}
    assert 0 < sum(crashes) < 8


def test_tables_name_the_scenario_and_component_that_crashed(system):
    scenario = SimpleNamespace(name=str(system))
    text = f"{system}: failed: {ALONE}SIGSEGV"
    with pytest.raises(RunError, match=re.escape(text)) as error:
        tables._single([scenario], options("SEGFAULT", isolate="foreign"), 1)
    assert error.value.code == Exit.COMPONENT


def test_a_crash_in_a_sweep_is_named(system):
    axes = {"bad.how": [FAILURES.index(failure) for failure in ("NOTHING", "SEGFAULT")]}
    well, badly = sweep(str(system), axes, Options(step=1.0), 1).to_json()["points"]
    assert well["status"] == "completed"
    assert badly["code"] == Exit.COMPONENT
    assert badly["message"] == f"{ALONE}SIGSEGV"
    with pytest.raises(RunError) as error:
        sweep(
            str(system), {"bad.how": [FAILURES.index("IN_START")]}, Options(step=1.0), 1
        )
    text = f"{system}: bad: entering initialisation ended its process: SIGSEGV"
    assert (str(error.value), error.value.code) == (text, Exit.COMPONENT)


def test_a_page_names_the_component_that_crashed(system, monkeypatch):
    """What pages are made of is watched, too."""
    sources = pages.Sources("uosat12", [], 1, None)
    monkeypatch.setattr(pages.Sources, "_needed", lambda self, name: ["bad.*"])
    change = {"bad.how": FAILURES.index("SEGFAULT")}
    with pytest.raises(
        RunError, match=r"failed: bad: the step from t = 3 s .*SIGSEGV"
    ) as error:
        sources.run(f"{system}/", change, step=1.0)
    assert error.value.code == Exit.COMPONENT


# --- one that never comes back; signals -----------------------------------------------


def test_a_call_that_does_not_return(system, tmp_path):
    run = simulate(
        prepare(str(system), options("HANG", call_limit=0.5)), tmp_path / "out"
    )
    assert run.code == Exit.TIMEOUT
    assert run.manifest["message"].startswith(
        "bad: the step from t = 3 s did not return within 0.5"
    )
    assert run.results.times().tolist() == [0.0, 1.0, 2.0]


def start_run(
    system: Path,
    tmp_path: Path,
    failure: str,
    *more: str,
    until: str = "out/manifest.json.part",
    hang_up: Any = signal.SIG_DFL,
):
    """The command, running."""
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "desat.cli",
            "run",
            str(system),
            "--step",
            "1",
            "--stop",
            "100000",
            "--set",
            f"bad.how={FAILURES.index(failure)}",
            "--out",
            str(tmp_path / "out"),
            *more,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        preexec_fn=lambda: signal.signal(signal.SIGHUP, hang_up),
    )
    deadline = time.monotonic() + 60
    while not (tmp_path / until).exists():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.05)
    time.sleep(0.2)
    return process


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, Exit.INTERRUPTED),
        (signal.SIGTERM, Exit.TERMINATED),
        (signal.SIGHUP, Exit.HUNG_UP),
    ],
)
def test_signals_end_alike(system, tmp_path, number, code):
    process = start_run(system, tmp_path, "SLOW")
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    assert "Traceback" not in out + err
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["status"] == "interrupted"
    with Results.open(tmp_path / "out") as results:
        times = results.times().tolist()
    assert times == [float(k) for k in range(manifest["steps_done"] + 1)]
    assert manifest["message"] == f"stopped by the user at t = {times[-1]:g} s"
    assert (tmp_path / "out/report.html").exists()
    assert not list(tmp_path.glob("desat-*"))


def test_nohup_is_heeded(system, tmp_path):
    """Whoever starts it may have it ignore SIGHUP; it ended all the same."""
    process = start_run(system, tmp_path, "SLOW", hang_up=signal.SIG_IGN)
    for one in (
        psutil.Process(process.pid),
        *psutil.Process(process.pid).children(recursive=True),
    ):
        one.send_signal(signal.SIGHUP)  # a terminal that closes tells all of them
    with pytest.raises(subprocess.TimeoutExpired):
        process.communicate(timeout=1.0)
    process.terminate()
    _, error = process.communicate(timeout=60)
    assert process.returncode == Exit.TERMINATED, error


def test_who_runs_the_tests_may_have_hang_up_ignored():
    """By nohup: those that send SIGHUP within their own process failed, or tried
    nothing."""
    test_ids = [
        f"{__file__}::{name}"
        for name in (
            "test_a_signal_in_a_flight_beforehand_ends_it[1-SystemExit]",
            "test_a_signal_before_the_first_step_is_no_bug_of_ours[1-SystemExit]",
        )
    ]
    pytest_run = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *test_ids],
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN),
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=200,
        check=False,
    )
    assert pytest_run.returncode == 0, pytest_run.stdout


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (signal.SIGINT, Exit.INTERRUPTED),
        (signal.SIGTERM, Exit.TERMINATED),
        (signal.SIGHUP, Exit.HUNG_UP),
    ],
)
def test_a_signal_while_it_is_prepared_leaves_nothing(tmp_path, number, code):
    """SIGHUP left temporary files and an empty folder of the run."""
    script = f"""
import os, signal, sys
from desat.cli import main
from desat.files import library
from desat.runs import run
def prepared(*_, **__): library.scratch("x"); os.kill(os.getpid(), {int(number)})
run.simulate = prepared
signal.signal(signal.SIGHUP, signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.argv = ["desat", "run", "nadir_day/day-dipole", "--out", {str(tmp_path / "out")!r}]
main()
"""
    script_run = python(script, env={**os.environ, "TMPDIR": str(tmp_path)})
    assert (script_run.returncode, script_run.stdout, script_run.stderr) == (
        code,
        "",
        "",
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.usefixtures("hang_up_is_heard")
@pytest.mark.parametrize(
    ("whom", "number", "status", "code"),
    [
        (os.getppid, signal.SIGTERM, "completed", 0),
        (os.getppid, signal.SIGINT, "completed", 0),
        (os.getppid, signal.SIGHUP, "completed", 0),
        (os.getpid, signal.SIGKILL, "failed", 4),
    ],
    ids=["SIGTERM", "SIGINT", "SIGHUP", "SIGKILL"],
)
def test_ended_when_all_is_recorded(
    system, tmp_path, monkeypatch, whom, number, status, code
):
    """While the last of its series are compressed."""
    finish, test = Packing.finish, os.getpid()

    def signal_and_pack(packing: Packing, *last: object) -> Path | None:
        if os.getpid() != test:  # the parent packs what it has saved
            os.kill(whom(), number)
            time.sleep(0.3)
        return finish(packing, *last)

    monkeypatch.setattr(Packing, "finish", signal_and_pack)
    run = simulate(
        prepare(str(system), options("NOTHING")), tmp_path / "out", partial=True
    )
    assert (run.manifest["status"], run.code) == (status, code)
    assert run.results.times().tolist() == [float(k) for k in range(11)]
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "manifest.json",
        "series.h5",
    }


def test_killed_before_its_first_row_it_has_none(desat, tmp_path, monkeypatch):
    """Where there are interval values, of which there is a row less in the end, it was
    a bug of ours (3), and neither manifest nor report was there."""
    monkeypatch.setattr(
        step_case, "begin_manifest", lambda *_: os.kill(os.getpid(), signal.SIGKILL)
    )
    command = desat(
        "run", "nadir_day/day-dipole", "--stop", "5", "--out", str(tmp_path / "out")
    )
    assert command.returncode == Exit.COMPONENT
    assert (
        "ended by SIGKILL, outside a call of a component; 0 rows are kept"
        in command.stderr
    )
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "manifest.json",
        "report.html",
        "series.h5",
    }
    with Results.open(tmp_path / "out") as results:
        assert {len(results.values(n)) for n in results.names()} == {0}


@pytest.mark.parametrize("is_packed", [True, False], ids=["packed", "no_room_to_pack"])
def test_killed_at_the_end_all_rows_are_saved(tmp_path, monkeypatch, is_packed):
    """The final row has states, and no interval values: also where the parent saves it."""
    whole_run = simulate(
        prepare("nadir_day/day-dipole", Options(stop=20.0)), tmp_path / "whole"
    )
    finish, write, test = Packing.finish, Recorder._write, os.getpid()

    def without(packing: Packing, *last: object) -> Path | None:
        if os.getpid() == test or is_packed:
            return finish(packing, *last)
        return packing.drop()

    def kill_after_write(recorder: Recorder, half: Bank, last: bool = False) -> None:
        write(recorder, half, last)
        os.kill(os.getpid(), signal.SIGKILL)

    def killed_packing(packing: Packing, *last: object) -> Path | None:
        if os.getpid() != test:
            os.kill(os.getpid(), signal.SIGKILL)
        return finish(packing, *last)

    monkeypatch.setattr(Packing, "finish", killed_packing if is_packed else without)
    monkeypatch.setattr(Recorder, "_write", write if is_packed else kill_after_write)
    options = Options(stop=20.0, supervised=True)
    run = simulate(prepare("nadir_day/day-dipole", options), tmp_path / "out")
    assert (run.manifest["status"], run.code) == ("failed", 4)
    lengths = set()
    for name in whole_run.results.names():
        full, recovered_values = (
            whole_run.results.values(name),
            run.results.values(name),
        )
        assert recovered_values.shape == full.shape, name
        assert recovered_values.tobytes() == full.tobytes(), name
        lengths.add(len(recovered_values))
    assert lengths == {20, 21}


@pytest.mark.parametrize(
    ("limit", "code"),
    [
        ("--call-limit", Exit.TERMINATED),
        ("--time-limit", Exit.TIMEOUT),
    ],
)
def test_stopped_and_continued(system, tmp_path, limit, code):
    """As Ctrl-Z does, for longer than a call, or the run, may take: the time of the
    call does not pass, that of the run does."""
    process = start_run(system, tmp_path, "SLOW", limit, "2")
    all_of_it = [
        psutil.Process(process.pid),
        *psutil.Process(process.pid).children(recursive=True),
    ]
    assert len(all_of_it) == 3
    for one in all_of_it:
        one.suspend()
    time.sleep(3.0)
    for one in all_of_it:
        one.resume()
        time.sleep(0.1)
    time.sleep(0.5)
    if code == Exit.TERMINATED:
        process.terminate()
    _, error = process.communicate(timeout=60)
    assert process.returncode == code, error


@pytest.mark.parametrize("limit", [0.0, 0.1, 0.5, 5.0])
@pytest.mark.parametrize("pause", [0.0, 1.5, 1e4])
def test_a_call_that_was_stopped_has_its_whole_limit(monkeypatch, limit, pause):
    """The parent looks at one call, is stopped while the call is in it, looks on: it
    kills it no sooner than its limit after that, and not much later."""
    clock, kill_times, stop = [100.0], [], [pause]

    class Pipe:
        def poll(self, seconds: float) -> bool:
            clock[0] += seconds + (stop.pop() if stop else 0.0)
            return False

    monkeypatch.setattr(child.time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(child.current_call, "now", lambda: (21, 9.0))
    monkeypatch.setattr(
        child.current_call, "status_of", lambda child: 9 if kill_times else None
    )
    monkeypatch.setattr(
        child.os, "kill", lambda child, number: kill_times.append(clock[0])
    )
    end = child.Ended()
    assert child._wait(1, Pipe(), end, limit) == 9
    assert end.hung == limit
    assert limit <= kill_times[0] - (100.0 + pause) <= limit + 1.5


def test_a_second_ctrl_c_always_ends(system, tmp_path):
    process = start_run(system, tmp_path, "HANG")
    process.send_signal(signal.SIGINT)
    time.sleep(0.6)
    assert process.poll() is None
    for _ in range(
        2
    ):  # on a busy machine the first may come late, and the second soon after it
        process.send_signal(signal.SIGINT)
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.communicate(timeout=20)
            break
    assert process.returncode == Exit.INTERRUPTED
    assert (
        json.loads((tmp_path / "out/manifest.json").read_text())["status"]
        == "interrupted"
    )
    assert (tmp_path / "out/report.html").exists()
    with Results.open(tmp_path / "out") as results:
        assert results.times().tolist() == [0.0, 1.0, 2.0]


def test_folders_of_dead_processes_are_swept(system, tmp_path):
    process = start_run(system, tmp_path, "SLOW")
    process.kill()
    process.communicate()
    (stale,) = tmp_path.glob("desat-*")
    code = "from desat.files import library; print(library._root())"
    for _ in range(100):  # its child ends by itself
        done_process = subprocess.run(
            [sys.executable, "-c", code],
            capture_output=True,
            text=True,
            env={**os.environ, "TMPDIR": str(tmp_path)},
            cwd=ROOT,
            check=True,
        )
        if not stale.exists():
            break
    assert not stale.exists()
    assert not Path(done_process.stdout.strip()).exists()


def test_what_is_left_of_a_removal_is_swept(tmp_path, monkeypatch):
    """A folder without its lock, once it is old; nobody else's; nor one where Python
    FMUs do not find themselves."""
    folders = {
        "desat-01234567": "0" * 20,
        "desat-76543210": "mine",
        "desat-89abcdef": "f" * 20,
    }
    for name, entry in folders.items():
        (tmp_path / name / entry).mkdir(parents=True)
        if name != "desat-89abcdef":
            os.utime(tmp_path / name, (0, 0))
    library._root.cache_clear()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    library._root()
    assert sorted(p.name for p in tmp_path.iterdir() if p != library._root()) == [
        "desat-76543210",
        "desat-89abcdef",
    ]
    library._root.cache_clear()
    (tmp_path / "ö").mkdir()
    with monkeypatch.context() as patch:
        patch.setattr(tempfile, "tempdir", str(tmp_path / "ö"))
        patch.setattr(library, "_ELSEWHERE", (str(tmp_path / "not there"),))
        with pytest.raises(
            DesatError, match="FMUs cannot be extracted to a path with"
        ) as error:
            library._root()
        assert error.value.code == Exit.INPUT
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "ö"))
    assert library._root().parent == Path("/tmp")
    library._root.cache_clear()


@pytest.mark.parametrize("late", [False, True])
def test_a_folder_that_another_process_sweeps_at_once_is_made_again(
    tmp_path, monkeypatch, late
):
    """Between making it and its lock: campaigns that began together failed with
    `.lock: No such file or directory`."""
    from filelock import FileLock

    swept = []

    class Disturbed(FileLock):
        def acquire(self, *args, **more):
            folder = Path(self.lock_file).parent
            first = not swept
            swept.append(folder)
            if first and not late:
                shutil.rmtree(folder)
                raise FileNotFoundError(self.lock_file)
            lock = super().acquire(*args, **more)
            if first:
                shutil.rmtree(folder)
            return lock

    monkeypatch.setattr(library, "FileLock", Disturbed)
    folder, lock = library._hold(tmp_path)
    assert len(swept) == 2
    assert swept[0] != swept[1] == folder
    assert lock.is_locked
    assert [p.name for p in folder.iterdir()] == [".lock"]
    lock.release()


def test_no_temporary_folder_at_all(desat, tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(
        tempfile, "_candidate_tempdir_list", lambda: [str(tmp_path / "none")]
    )
    monkeypatch.setattr(
        library, "_by_contents", {}
    )  # as no other test had extracted it
    monkeypatch.setattr(library, "_loaded", {})
    library._root.cache_clear()
    command = desat("run", "gyrostat/free", "--out", str(tmp_path / "out"))
    library._root.cache_clear()
    there = f"No usable temporary directory found in ['{tmp_path}/none']"
    assert (command.returncode, command.stdout, command.stderr) == (
        Exit.INPUT,
        "",
        f"error: {there}\n",
    )
    assert not (tmp_path / "out").exists()


@pytest.mark.study
@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_many_runs_in_one_process_leave_nothing():
    """`python -m benchmarks.soak native` makes a thousand."""
    samples = list(soak.runs(30))
    early, late = samples[2], samples[-1]
    assert late["handles"] == early["handles"]
    assert late["temporary"] == early["temporary"]
    assert late["memory_kB"] - early["memory_kB"] < 4000


@pytest.mark.study
@pytest.mark.parametrize(
    ("environment", "folder"),
    [
        ({"LC_ALL": "C", "PYTHONUTF8": "0"}, "Größe"),
        ({"LC_ALL": "C.UTF-8"}, "Größe und Maß"),
        ({"HOME": "/dev/null", "USER": None, "MPLBACKEND": "none such"}, "a b c"),
    ],
    ids=str,
)
def test_two_at_once_wherever_they_run(tmp_path, environment, folder):
    """Any locale, no home directory that can be written, paths with spaces and umlauts;
    a folder each; started by one that ignores SIGCHLD."""
    place, temporary = tmp_path / folder, tmp_path / "tmp"
    for new in (place, temporary):
        new.mkdir()
    inputs = {**os.environ, "TMPDIR": str(temporary), **environment}
    inputs = {k: v for k, v in inputs.items() if v is not None}
    command = [
        sys.executable,
        "-m",
        "desat.cli",
        "run",
        "nadir_day/day-dipole",
        "--stop",
        "20",
    ]
    both = [
        subprocess.Popen(
            command,
            cwd=place,
            env=inputs,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            preexec_fn=lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN),
        )
        for _ in range(2)
    ]
    for process in both:
        out, error = process.communicate(timeout=120)
        assert (process.returncode, error) == (0, "")
        folder_text = (
            "Gr" + 4 * r"\ufffd" + "e"
            if environment.get("PYTHONUTF8") == "0"
            else folder
        )
        assert f"{folder_text}/runs/nadir_day" in out.replace("\n", "")
    result = sorted(place.glob("runs/*/report.html"))
    assert [p.parent.name for p in result] == [
        "nadir_day-day-dipole",
        "nadir_day-day-dipole-2",
    ]
    loops = [
        json.loads((p.parent / "manifest.json").read_text())["loop"]["name"]
        for p in result
    ]
    assert loops == ["compiled", "compiled"]
    series = [Results.open(p.parent) for p in result]
    assert len({r.values("wheels.h_wheel").tobytes() for r in series}) == 1
    remaining = [p.name for p in temporary.iterdir()]
    assert remaining == (
        [f"desat-cache-{os.getuid()}"] if "HOME" in environment else []
    )


# --- no room --------------------------------------------------------------------------


def test_a_file_size_limit(system, tmp_path):
    """6, a line, and the series has the rows that were really written."""
    result = subprocess.run(
        [
            sys.executable,
            "-m",
            "desat.cli",
            "run",
            str(system),
            "--step",
            "1",
            "--stop",
            "200000",
            "--out",
            str(tmp_path / "out"),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
        preexec_fn=lambda: resource.setrlimit(
            resource.RLIMIT_FSIZE, (400_000, 400_000)
        ),
    )
    assert result.returncode == Exit.SPACE, result.stderr
    assert "Traceback" not in result.stderr
    (line,) = [x for x in result.stderr.splitlines() if x.startswith("no space:")]
    assert "series.h5: the file is larger than is allowed" in line
    with Results.open(tmp_path / "out") as results:
        times, y = results.times(), results.values("bad.y")
    assert len(times) > 1000
    assert times.tolist() == [float(k) for k in range(len(times))]
    assert y[1:].tolist() == times[1:].tolist()


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (errno.ENOSPC, "no space left on the disk"),
        (errno.EDQUOT, "the disk quota is used up"),
    ],
)
def test_no_room_for_rows(system, tmp_path, monkeypatch, number, text):
    """What the system says where a disk is full, or a quota used up."""
    write, count = Recorder._write, [0]

    def full(recorder: Recorder, half: Bank, last: bool = False) -> None:
        count[0] += 1
        if count[0] == 2:
            raise OSError(number, os.strerror(number))
        write(recorder, half, last)

    monkeypatch.setattr(Recorder, "_write", full)
    (system / "SystemStructure.ssd").write_text(ssd(stop="20000"))
    run = simulate(prepare(str(system), options("NOTHING")), tmp_path / "out")
    assert (run.code, run.manifest["status"]) == (Exit.SPACE, "no space")
    assert text in run.manifest["message"]
    rows = run.results.times()
    assert 0 < len(rows) < 20000
    assert rows.tolist() == [float(k) for k in range(len(rows))]


def test_a_folder_that_cannot_be_written_is_refused(
    system, tmp_path, monkeypatch, desat
):
    """As on a disk that is mounted to be read only."""
    make = Path.mkdir

    def only_read(path: Path, *arguments: object, **more: object) -> None:
        if path == tmp_path / "out":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        make(path, *arguments, **more)

    monkeypatch.setattr(Path, "mkdir", only_read)
    command = desat("run", str(system), "--step", "1", "--out", str(tmp_path / "out"))
    assert (command.returncode, command.stdout) == (Exit.INPUT, "")
    assert command.stderr == f"error: {tmp_path}/out: Read-only file system\n"


def test_a_full_disk(tmp_path, monkeypatch, capsys):
    """Full to the last byte: the manifest has its room, the report has none. Then one
    that can only be read."""
    place = tmp_path / "disk"
    place.mkdir()
    mount_command = ["mount", "-t", "tmpfs", "-o", "size=10m", "tmpfs", str(place)]
    if subprocess.run(mount_command, capture_output=True, check=False).returncode:
        pytest.skip("needs the right to mount a small disk")
    try:
        result = subprocess.run(
            [
                sys.executable,
                "-m",
                "desat.cli",
                "run",
                "gyrostat/free",
                "--step",
                "0.01",
                "--stop",
                "300",
                "--no-baseline",
                "--out",
                str(place / "out"),
            ],
            capture_output=True,
            text=True,
            cwd=ROOT,
            check=False,
        )
        assert result.returncode == Exit.SPACE, result.stderr
        lines = [x for x in result.stderr.splitlines() if "may take" not in x]
        assert (
            lines[0]
            == f"warning: {place}/out: it has no report: no space left on the disk"
        )
        assert re.fullmatch(
            rf"no space: {place}/out/series.h5: no space left on the disk; (\d+) rows are kept",
            lines[1],
        )
        assert len(lines) == 2
        assert {p.name for p in (place / "out").iterdir()} == {
            "manifest.json",
            "series.h5.part",
        }
        manifest = json.loads((place / "out/manifest.json").read_text())
        with Results.open(place / "out") as results:
            times = results.times()
        assert (manifest["status"], manifest["rows"]) == ("no space", len(times))
        assert len(times) > 500
        assert times[-1] == pytest.approx(0.01 * (len(times) - 1))
        subprocess.run(["mount", "-o", "remount,ro", str(place)], check=True)
        monkeypatch.setattr(
            sys, "argv", ["desat", "run", "plant/light", "--out", str(place / "b")]
        )
        assert cli._code() == Exit.INPUT
        assert capsys.readouterr().err == f"error: {place}/b: Read-only file system\n"
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_room_is_estimated(system, tmp_path, monkeypatch, desat):
    from desat.runs import validation

    usage = shutil.disk_usage(tmp_path)
    with monkeypatch.context() as patch:
        small = usage._replace(free=1000)
        patch.setattr(
            shutil,
            "disk_usage",
            lambda path: small if str(path).startswith(str(tmp_path)) else usage,
        )
        command = desat(
            "run", str(system), "--step", "0.001", "--out", str(tmp_path / "out")
        )
    assert command.returncode == 0
    assert re.search(
        r"^warning: .* may take .* are free", command.stderr.replace("\n", " ")
    )
    case = prepare(str(system), Options(step=2.0**-29, stop=999.0))
    assert validation.size(case.system, case.options) == 16 * (999 * 2**29 + 1)
    assert "GB are free" in validation.check_disk(
        case.system, case.options, system / "not there"
    )


@pytest.mark.study
def test_ten_thousand_outputs(tmp_path, binary):
    """They are recorded, all rows of them, also of a run that crashes, and reported."""
    numbers = range(1, 10_001)
    xml = DESCRIPTION.format(identifier="failing")
    variables = "".join(
        f'<ScalarVariable name="y{i}" valueReference="{i}" causality="output"><Real/>'
        "</ScalarVariable>"
        for i in numbers
    )
    outputs = "".join(f'<Unknown index="{i + 1}" dependencies=""/>' for i in numbers)
    xml = re.sub('<ScalarVariable name="y".*?</ScalarVariable>', variables, xml)
    xml = re.sub("<Outputs>.*</Outputs>", f"<Outputs>{outputs}</Outputs>", xml)
    result = fmu(tmp_path / "s/resources/failing.fmu", binary, description=xml)
    (result.parents[1] / "SystemStructure.ssd").write_text(ssd(start="-1097"))
    run = simulate(
        prepare(str(result.parents[1]), options("SEGFAULT")), tmp_path / "out"
    )
    assert len(run.results.names()) == len(numbers)
    assert run.results.times().tolist() == [float(t) for t in range(-1097, 3)]
    for name in ("bad.y1", "bad.y10000"):
        assert run.results.values(name).tolist()[1:] == run.results.times().tolist()[1:]
    assert write_report(tmp_path / "out", run).stat().st_size < 1_000_000


# --- what components do to the process ------------------------------------------------


@pytest.mark.parametrize(
    ("failure", "fault"),
    [
        ("CHDIR", "working directory"),
        ("ROUNDING", "rounding mode"),
        ("LOCALE", "locale"),
        ("HANDLER", "signal handlers"),
        ("TRAPS", "floating-point modes"),
        ("UMASK", "permissions"),
        ("FLUSHED", "floating-point modes"),
    ],
)
def test_what_a_component_changes_is_put_back_and_said(
    system, tmp_path, failure, fault
):
    if failure in ("TRAPS", "FLUSHED") and platform.machine() not in (
        "x86_64",
        "aarch64",
    ):
        pytest.skip("its modes are not known")
    run = simulate(prepare(str(system), options(failure)), tmp_path / "out")
    assert run.ok
    assert [w for w in run.manifest["warnings"] if fault in w]
    here = os.getcwd()
    simulate(prepare(str(system), Options(sets=options(failure).sets, step=1.0)))
    assert os.getcwd() == here
    assert 1.0 + 1e-17 == 1.0


def test_a_relative_out_where_a_component_goes_elsewhere(apart, system, tmp_path):
    apart(
        "run",
        str(system),
        "--step",
        "1",
        "--set",
        f"bad.how={FAILURES.index('CHDIR')}",
        "--out",
        "o",
        cwd=tmp_path,
        check=True,
    )
    assert (tmp_path / "o" / "report.html").exists()


def test_what_a_component_prints_is_no_json_and_what_it_logs_is_a_warning(
    apart, system, tmp_path
):
    for failure in ("PRINT", "LOG"):
        result = apart(
            "run",
            str(system),
            "--step",
            "1",
            "--set",
            f"bad.how={FAILURES.index(failure)}",
            "--json",
            "--out",
            str(tmp_path / failure),
            check=True,
        )
        manifest = json.loads(result.stdout)
        assert manifest["status"] == "completed"
        assert ("{not json}" in result.stderr) == (failure == "PRINT")
    assert "warning: bad: low \ufffd[31mpressure at 3\n" in result.stderr
    assert "\033" not in result.stderr
    assert "bad: low \ufffd[31mpressure at 3" in manifest["warnings"]


# --- archives -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "source",
    [
        "../failing.fmu",
        "/etc/passwd",
        "%2e%2e/failing.fmu",
        "a/../../x",
        "..\\x",
        "C:/x",
    ],
)
def test_a_source_outside_is_refused(system, tmp_path, source):
    shutil.copy(system / "resources/failing.fmu", tmp_path / "failing.fmu")
    (system / "SystemStructure.ssd").write_text(ssd(source))
    problems = prepare(str(system), Options(step=1.0)).problems
    assert any("is outside the folder of the system" in p for p in problems)


def test_a_parameter_file_outside_is_refused(system):
    binding = '<ssd:ParameterBindings><ssd:ParameterBinding source="{}"/></ssd:ParameterBindings>'
    for source in ("/etc/passwd", "../p.ssv"):
        (system / "SystemStructure.ssd").write_text(ssd(inside=binding.format(source)))
        (problem,) = prepare(str(system), Options(step=1.0)).problems
        assert f"{source!r} is outside the folder of the system" in problem


@pytest.mark.parametrize(
    "identifier", ["../../failing", "a/b", "", "a b", "é", "x" * 300]
)
def test_a_library_has_a_c_name(tmp_path, identifier):
    with pytest.raises(DesatError, match="is no C name"):
        _ = library.load(fmu(tmp_path / "x.fmu", b"", identifier)).interface


def test_devices_and_pipes_are_not_read(system, tmp_path):
    os.mkfifo(tmp_path / "pipe.fmu")
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "zero.ssd").symlink_to("/dev/zero")
    (tmp_path / "zero.ssp").symlink_to("/dev/zero")
    for name in ("zero.ssd", "zero.ssp", "pipe.toml"):
        with pytest.raises(DesatError, match="not a regular file"):
            prepare(str(tmp_path / name), Options())
    for name in ("manifest.json", "series.h5"):
        os.mkfifo(tmp_path / name)
        with pytest.raises(DesatError, match="not a regular file"):
            load_run(tmp_path)
        (tmp_path / "manifest.json").unlink(missing_ok=True)
        (tmp_path / "manifest.json").write_text('{"status": "completed", "about": {}}')
    (system / "resources/failing.fmu").unlink()
    (system / "resources/failing.fmu").symlink_to(tmp_path / "pipe.fmu")
    (problem,) = prepare(str(system), Options(step=1.0)).problems
    assert "not a regular file" in problem


def zip_file(path: Path, entries: dict[str, bytes]) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in entries.items():
            archive.writestr(name, data)
    return path


def test_budgets_of_archives(tmp_path, monkeypatch):
    bomb = zip_file(tmp_path / "bomb.ssp", {"a": bytes(40 << 20)})
    with pytest.raises(
        DesatError, match=r"39 KiB would become 40 MiB; 200 times its size"
    ):
        library.extract(bomb)
    many = zip_file(tmp_path / "many.ssp", {str(i): b"" for i in range(io.ENTRIES + 1)})
    with pytest.raises(DesatError, match="20001 entries; 20000 allowed"):
        library.extract(many)
    deep = zip_file(tmp_path / "deep.ssp", {"a/" * 40 + "b": b""})
    with pytest.raises(DesatError, match="41 folders; 32 allowed"):
        library.extract(deep)
    monkeypatch.setattr(io, "IN_ALL", io._extracted + 10)
    with pytest.raises(DesatError, match="with the archives before it more than"):
        library.extract(zip_file(tmp_path / "all.ssp", {"a": bytes(11)}))
    link = zipfile.ZipInfo("link")
    link.external_attr = (stat.S_IFLNK | 0o777) << 16
    with zipfile.ZipFile(tmp_path / "link.ssp", "w") as archive:
        archive.writestr(link, "/etc/passwd")
    with pytest.raises(DesatError, match="entry 'link' is no regular file"):
        library.extract(tmp_path / "link.ssp")


@pytest.mark.study
def test_check_is_linear(tmp_path):
    """Connectors, none of which there is: eight times as many take about eight times as
    long; where each looked at all others it would be 64 times."""
    fmu(tmp_path / "resources/failing.fmu", b"")
    seconds = []
    for count in (20000, 160000):
        connectors = "".join(
            f'<ssd:Connector name="x{i}" kind="output"><ssc:Real/></ssd:Connector>'
            for i in range(count)
        )
        inside = f"<ssd:Connectors>{connectors}</ssd:Connectors>"
        (tmp_path / "SystemStructure.ssd").write_text(ssd(inside=inside))
        began = time.process_time()
        warnings = prepare(str(tmp_path), Options(step=1.0)).warnings
        seconds.append(time.process_time() - began)
        [line] = [w for w in warnings if "no such variable" in w]
        assert line.endswith(f"and {count - 10} more; they are not used")
    assert seconds[1] < 24.0 * seconds[0]


OUTSIDE = '<ssd:ParameterBindings><ssd:ParameterBinding source="../p.ssv"/></ssd:ParameterBindings>'


@pytest.mark.parametrize(
    ("values", "check_code"),
    [
        ({"source": "../failing.fmu"}, 1),
        ({"inside": OUTSIDE}, 1),
        ({"name": "a.b"}, 1),
        ({"start": "1e17", "stop": "1.0000000000001e17"}, 1),
        ({"stop": "soon"}, 2),
        ({"identifier": "a/b"}, 1),
        ({"folder": "win64"}, 1),
    ],
    ids=str,
)
def test_a_file_that_is_refused_ends_run_and_check_alike(
    desat, system, binary, values, check_code
):
    """By the codes of the README, in lines, and without a folder of the run."""
    of_fmu = {k: values.pop(k) for k in ("identifier", "folder") if k in values}
    if of_fmu:
        fmu(system / "resources/failing.fmu", binary, **of_fmu)
    (system / "SystemStructure.ssd").write_text(ssd(**values))
    for command, code in (("run", Exit.INPUT), ("check", check_code)):
        more = ("--out", str(system / "out")) if command == "run" else ()
        result = desat(command, str(system), "--step", "1", *more)
        assert result.returncode == code, result.stderr
        lines = (result.stdout + result.stderr).splitlines()
        assert lines
        assert not any("internal" in x or "Traceback" in x for x in lines)
        assert not (system / "out").exists()


def test_a_name_that_is_a_formula_has_a_mark_in_a_csv_file(desat, system, tmp_path):
    (system / "SystemStructure.ssd").write_text(ssd(name="-a"))
    desat(
        "run",
        str(system),
        "--step",
        "1",
        "--csv",
        "--out",
        str(tmp_path / "out"),
        check=True,
    )
    head = (tmp_path / "out/series.csv").read_text().splitlines()[0]
    assert head == '"time [s]","\'-a.y"'


# --- whose code it is -----------------------------------------------------------------


def test_check_runs_no_foreign_code_unless_trusted(apart, system, tmp_path):
    cases = (
        "check",
        str(system),
        "--step",
        "1",
        "--set",
        f"bad.how={FAILURES.index('IN_START')}",
    )
    result = apart(*cases)
    assert result.returncode == 0, result.stderr
    digest = library.sha256(system / "resources/failing.fmu")
    assert (
        f"failing.fmu is foreign native code, for linux64; sha256 {digest}"
        in result.stderr
    )
    trust_file = tmp_path / "trusted"
    trust_file.write_text(f"# mine\n{digest}  failing.fmu\n")
    result = apart(*cases, "--trust", str(trust_file))
    assert result.returncode == Exit.UNMET
    assert ": bad: entering initialisation ended the process: SIGSEGV" in result.stderr
    trust_file.write_text("0" * 64)
    result = apart(
        "run", *cases[1:], "--trust", str(trust_file), "--out", str(tmp_path / "out")
    )
    assert result.returncode == Exit.INPUT
    assert "bad: failing.fmu is not of the list of --trust" in result.stderr
    trust_file.write_text("so what")
    with pytest.raises(
        DesatError, match="trusted:1: 'so what': a sha256 of 64 digits is needed"
    ):
        library.hashes(trust_file)


def test_a_binary_for_elsewhere_is_said(tmp_path):
    fmu(tmp_path / "resources/failing.fmu", b"", folder="win64")
    (tmp_path / "SystemStructure.ssd").write_text(ssd())
    (problem,) = prepare(str(tmp_path), Options(step=1.0)).problems
    assert problem == "bad: failing.fmu has no binary for linux64; there is win64"


# --- inputs ---------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["a.b", "a/b", "time", "a[1]", "", "a&#9;b", "=1"])
def test_names_that_no_series_can_have(system, name):
    (system / "SystemStructure.ssd").write_text(ssd(name=name))
    problems = prepare(str(system), Options(step=1.0)).problems
    assert any("a name is needed without" in p for p in problems)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"record": ("bad.z",)}, "--record bad.z: no output fits; did you mean bad.y?"),
        ({"every": 10**9}, "--every 1000000000: the run has 10 steps"),
        (
            {"sets": ["bad.how=1", "bad.how=2"]},
            "--set bad.how=2: bad.how is given twice",
        ),
    ],
)
def test_options_without_effect_are_refused(system, more, message):
    with pytest.raises(DesatError) as error:
        prepare(str(system), Options(step=1.0, **more)).or_raise()
    assert str(error.value) == message


def test_a_start_at_which_time_does_not_grow(system):
    (system / "SystemStructure.ssd").write_text(
        ssd(start="1e17", stop="1.0000000000001e17")
    )
    with pytest.raises(DesatError, match="time does not grow by a step of 1 s"):
        prepare(str(system), Options(step=1.0)).or_raise()


def test_a_parameter_given_twice(system):
    one = '<ssv:Parameter name="how"><ssv:Integer value="{}"/></ssv:Parameter>'
    (system / "SystemStructure.ssd").write_text(
        ssd(
            inside=(
                "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet "
                f'name="p" version="1.0"><ssv:Parameters>{one.format(1)}{one.format(2)}</ssv:Parameters>'
                "</ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>"
            )
        )
    )
    problems = prepare(str(system), Options(step=1.0)).problems
    assert any("how is given twice" in p for p in problems)


def test_a_closed_standard_output(system):
    line = f"exec {sys.executable} -m desat.cli list >&-"
    result = subprocess.run(
        ["sh", "-c", line], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert result.returncode == 0
    assert result.stderr == ""


def test_a_reader_that_goes_away(system, tmp_path):
    """The code is that of the run."""
    with subprocess.Popen(
        [
            sys.executable,
            "-m",
            "desat.cli",
            "run",
            str(system),
            "--step",
            "1",
            "--json",
            "--set",
            f"bad.how={FAILURES.index('SEGFAULT')}",
            "--out",
            str(tmp_path / "out"),
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    ) as process:
        process.stdout.close()
        error = process.stderr.read()
    assert process.returncode == Exit.COMPONENT, error


def test_control_characters_do_not_reach_the_terminal(desat, capsys, tmp_path):
    (tmp_path / "a.toml").write_text('extends = "b\\u001b[31mc"\ntitle = "T"\n')
    for target in ("a\033[31mb", str(tmp_path / "a.toml")):
        command = desat("run", target)
        assert command.returncode == Exit.INPUT
        assert "\ufffd[31m" in command.stderr
        assert "\033" not in command.stderr
    console = plain_console()
    console.print("a\033[31mb\x07", markup=False)
    assert capsys.readouterr().out == "a\ufffd[31mb\ufffd\n"


def test_a_report_that_fails_leaves_the_manifest(system, tmp_path, monkeypatch, capsys):
    from desat.report import report

    monkeypatch.setattr(report, "write_report", lambda *a: 1 / 0)
    monkeypatch.setattr(
        sys,
        "argv",
        ["desat", "run", str(system), "--step", "1", "--out", str(tmp_path / "out")],
    )
    assert cli._code() == Exit.BUG
    manifest = json.loads((tmp_path / "out/manifest.json").read_text())
    assert manifest["status"] == "completed"
    with Results.open(tmp_path / "out") as results:
        assert len(results.times()) == 11
    assert "internal: ZeroDivisionError" in capsys.readouterr().err


PROVOKED = {
    "the same up to 64, with an `accuracy` of": "FALLBACK",
    "no room to shorten": "leave_room",
    "segmentation fault": '"SEGFAULT"',
    "stack overflow": '"OVERFLOW"',
    "abort": '"ABORT"',
    "kill -9": r'"KILL"|SIGKILL|trials\(',
    "exit(0)": '"EXIT_0"',
    "exit(3)": '"EXIT_3"',
    "one of ours": "FmuFile",
    "in a flight": "_Flights|substep_choice",
    "instantiated": "REFUSES",
    "or in initialisation": '"IN_START"',
    "it is freed": '"IN_FREE"',
    "library to be loaded": "no library",
    "returns discard": '"DISCARD"',
    "error,": '"STEP_ERROR"',
    "fatal": '"FATAL"',
    "returns warning": '"READ_WARNS".*"STEP_WARNS"',
    "asks for the end": '"ASKS_END"',
    "does not terminate": '"ENDS_BADLY"',
    "below 0": '"START_NEGATIVE"',
    "ok for a step": "lastSuccessfulTime",
    "another version": "VERSION",
    "does not know": '"NEGATIVE"',
    "NaN": '"NOT_FINITE"',
    "--halve": "halvings",
    "it forks": '"FORK"',
    "any call": '"FORK_BESIDE"',
    "files that are open": '"SCRIBBLE"',
    "process group": '"KILL_GROUP"',
    "daemons": '"DAEMON"',
    "does not return": '"HANG"',
    "`draws`": r"\bdraws\(",
    "`sweep`": r"sweep\(",
    "`tables`": r"tables\.",
    "a page": "Sources",
    "logs": '"LOG"',
    "no POSIX": '"CAN"',
    "prints": '"PRINT"',
    "rounding mode": '"ROUNDING"',
    "traps": '"TRAPS"',
    "flushing": '"FLUSHED"',
    "locale,": '"LOCALE"',
    "umask": '"UMASK"',
    "working directory": '"CHDIR"',
    "signal handlers": '"HANDLER"',
    "Ctrl-C": "SIGINT",
    "SIGTERM": "SIGTERM",
    "SIGHUP": "SIGHUP",
    "are compressed": "Packing",
    "first step": "simulate",
    "first row": "begin_manifest",
    "`nohup`": "SIG_IGN",
    "Ctrl-Z": r"\.suspend\(",
    "second Ctrl-C": r"range\(2\)",
    "with `--checkpoint`": "checkpoint",
    "save its state": "cannot save",
    "an FMU, a file, a package or the machine": '"FMU", "file", "package", "machine"',
    "into one folder": "claimed",
    "temporary folders": "stale|desat-01",
    "no home": '"HOME"',
    "SIGCHLD": "SIGCHLD",
    "of a path": "LC_ALL",
    "(umlauts)": "ö",
    "no temporary": "_candidate_tempdir_list",
    "`make`": "desat.fmus.build",
    "disk full": "ENOSPC",
    "quota": "EDQUOT",
    "size limit": "RLIMIT_FSIZE",
    "report,": "report",
    "--csv": "--csv",
    "journal": "journal",
    "checkpoint is": "savez",
    "cannot be written": 'EROFS|"/dev/null"',
    "not fit": "disk_usage",
    'substeps = "auto"': r"substeps|own\(",
    "512": "512",
    "by which it chose": "choose_again|again",
    "given substeps": "substeps=1",
    "10,000": "10_001",
    "50,000": "50000",
    "is closed": ">&-",
    "(a pipe)": "stdout.close",
    "lost their end": "remaining",
    "report fails": "write_report",
    "`..`": r'"\.\./',
    "absolute": '"/etc',
    "%2e": "%2e",
    "a drive": "C:/",
    "parameter set": "ParameterBinding",
    "C name": '"a/b"',
    "a device": "/dev/zero",
    "a pipe,": "mkfifo",
    "run folder:": "load_run",
    "20,000": "ENTRIES",
    "1 GiB": "LARGEST",
    "8 GiB": "IN_ALL",
    "200 times": "200 times",
    "32 folders": "32 allowed",
    "links": "S_IFLNK",
    "outside, or twice": "leave the folder.*twice",
    "connectors": "20000",
    "no such file": "fuzz",
    "are none": "a number that is none",
    "UTF-8": "not UTF-8",
    "wrong types": "wrong type",
    "`--trust`": "--trust",
    "this platform": "win64",
    "`a.b`": r'"a\.b"',
    "`a/b`": '"a/b"',
    "`time`": '"time"',
    "given twice": "given twice",
    "`--record`": "record=|record",
    "`--every`": "every",
    "cannot grow": "1e17",
    "control characters": r"\\033",
    "a formula": "'-a",
}
"""What the first column says, and what stands in a test that provokes it."""
SUCCESS = r"|\.ok\b|check=True|completed|== 0|or_raise|== \[\]"


def lacking(row: str, sources: dict[str, str]) -> list[str]:
    """What a row of the page says that no test which it cites looks like: what goes
    wrong, and the exit codes."""
    cells = [x.strip() for x in row.strip("| ").split(" | ")]
    texts = "\n".join(sources.get(x, "") for x in re.findall(r"`(test_\w+)`", row))
    messages = [subject for subject in PROVOKED if subject in cells[0]]
    wrong = [
        subject for subject in messages if not re.search(PROVOKED[subject], texts, re.S)
    ]
    codes = (
        [int(x) for x in re.findall(r"\b\d+\b", cells[-2])] if len(cells) > 2 else []
    )
    for code in codes:
        message = rf"Exit\.{Exit(code).name}\b|\b{code}\b" + (
            SUCCESS if code == 0 else ""
        )
        if code == Exit.INPUT:
            message += "|raises\\(DesatError"
        wrong += [] if re.search(message, texts) else [f"code {code}"]
    return wrong if messages else ["anything: add it to PROVOKED"]


def test_every_failure_of_the_table_has_its_test():
    """Each row of the tables that say what is done, but for those of other tools. This
    reads the tests alone; that a row with the tests of another is found shows that it
    reads them well."""
    page = seen.PAGE.read_text(encoding="utf-8").split(seen.BEGIN)[0]
    rows = [
        x
        for x in page.splitlines()
        if x.startswith("| ") and not x.startswith("| failure |")
    ]
    sources: dict[str, str] = {}
    for file in (ROOT / "tests").rglob("test_*.py"):
        text = file.read_text(encoding="utf-8")
        lines = text.splitlines()
        constants: dict[str, str] = {}
        for node in ast.parse(text).body:
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
                constants[node.targets[0].id] = ast.unparse(node.value)
            if isinstance(node, ast.FunctionDef):
                first = min(
                    (d.lineno for d in node.decorator_list), default=node.lineno
                )
                own_value = "\n".join(lines[first - 1 : node.end_lineno])
                used = (
                    x
                    for name, x in constants.items()
                    if re.search(rf"\b{name}\b", own_value)
                )
                sources[node.name] = "\n".join([own_value, ast.unparse(node), *used])
    assert len(rows) > 40
    for row in rows:
        test_names = re.findall(r"`(test_\w+)`", row)
        assert test_names, row
        assert set(test_names) <= sources.keys(), row
    assert {row: wrong for row in rows if (wrong := lacking(row, sources))} == {}
    cited_sources = "".join(
        sources[x] for row in rows for x in re.findall(r"`(test_\w+)`", row)
    )
    assert [
        failure for failure in FAILURES[1:] if f'"{failure}"' not in cited_sources
    ] == []
    # each with the tests of all others in turn
    tests = ["`, `".join(re.findall(r"`(test_\w+)`", row)) for row in rows]
    clashes = [
        (row, other)
        for row, own_value in zip(rows, tests, strict=True)
        for other in tests
        if not set(own_value.split("`, `")) & set(other.split("`, `"))
        and not lacking(re.sub(r"`test_.*`", f"`{other}`", row), sources)
    ]
    assert len(clashes) < 0.01 * len(rows) ** 2, clashes
    known_codes = {str(int(code)) for code in Exit}
    table = page[page.index("## Components") : page.index("## Archives")]
    codes = {
        x
        for row in table.splitlines()
        if row.startswith("| ")
        for x in re.findall(r"\b\d+\b", row.split("|")[5])
    }
    assert codes <= known_codes, codes - known_codes


def test_the_page_has_what_was_seen():
    """`python -m benchmarks.seen` writes it, of what was kept."""
    page = seen.PAGE.read_text(encoding="utf-8")
    assert page.split(seen.BEGIN)[1].split(seen.END)[0] == seen.part()
    stored_results = seen.known()
    assert all(part["equal"] for part in stored_results["same bits"].values())
    assert all(
        part["equal"] == part["runs"] for part in stored_results["killed"].values()
    )
    assert not any(part["different"] for part in stored_results["targets"].values())
