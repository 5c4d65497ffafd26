"""How commands, runs and cases end, with what takes long replaced: exit codes and what
is said."""

from __future__ import annotations

import io
import json
import re
import signal
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.table import Table

from desat import cli
from desat.analyses.manifest import Manifest, Stopped
from desat.campaign import case as campaign_case
from desat.campaign import coordinator, plan, store
from desat.campaign import draws as study
from desat.campaign import sweep as sweep_study
from desat.cli import console as console_module
from desat.cli.commands import run as run_command
from desat.cli.console import plain_console
from desat.engine import checkpoint
from desat.engine.instances.base import EndedError
from desat.files.io import extract, is_full
from desat.fmus import native
from desat.numbers.text import Value
from desat.runs.run import Run
from desat.sizing import sizing
from desat.studies import compare, ranking
from desat.system.errors import DesatError, Exit, RunError, nearest, plain
from desat.system.options import Options
from tests.conftest import module_of
from tests.numbers.test_verdicts import FAILED, LATE_ONE, UNMET, WELL
from tests.papers.test_comparison import cell

tables = module_of("desat.papers.tables")
tables_command = module_of("desat.papers.commands.tables")
web_module = module_of("desat.web.module")


def test_what_each_exit_code_is():
    assert {e.name: (e.value, bool(e.meaning)) for e in Exit} == {
        name: (code, True)
        for name, code in (
            ("COMPLETED", 0),
            ("UNMET", 1),
            ("INPUT", 2),
            ("BUG", 3),
            ("COMPONENT", 4),
            ("TIMEOUT", 5),
            ("SPACE", 6),
            ("HUNG_UP", 129),
            ("INTERRUPTED", 130),
            ("TERMINATED", 143),
        )
    }
    assert (DesatError("x").code, RunError("x").code) == (Exit.INPUT, Exit.COMPONENT)


@pytest.mark.parametrize(
    ("name", "candidates", "hint"),
    [
        ("wheel", ["wheels", "body"], "; did you mean wheels?"),
        ("x", ["a", "b"], "; there is a, b"),
        ("x", [], ""),
        ("x", list("abcdefghijkl"), "; there is a, b, c, d, e, f, g, h, i, j, k, l"),
        (
            "x",
            list("abcdefghijklm"),
            "; there is a, b, c, d, e, f, g, h, i, j, k, l, …",
        ),
        ("wheel", ["wheels", *(str(k) for k in range(1999))], "; did you mean wheels?"),
        ("wheel", ["wheels", *(str(k) for k in range(2000))], ""),
        ("x" * 200, ["x" * 199], f"; did you mean {'x' * 199}?"),
        ("x" * 201, ["x" * 199], ""),
    ],
)
def test_the_nearest_name(name, candidates, hint):
    assert nearest(name, candidates) == hint


def test_names_in_brackets_are_no_markup_and_numbers_have_no_colour():
    file = io.StringIO()
    console = plain_console(file=file, force_terminal=True, width=80)
    table = Table("h[b]", box=None, header_style="")
    table.add_row("x[b] = 12")
    console.print("h[b] = 12")
    console.print(table)
    assert [line.strip() for line in file.getvalue().splitlines()] == [
        "h[b] = 12",
        "h[b]",
        "x[b] = 12",
    ]


def test_what_is_no_text_is_made_a_line():
    assert plain("a\tb\x1b[c]\u00e9") == "a b\ufffd[c]\u00e9"


def test_a_bug_of_ours_says_how_to_see_where(desat, monkeypatch):
    def fails(**_: object) -> None:
        raise ValueError("why")

    monkeypatch.setattr(cli, "get_command", lambda app: fails)
    monkeypatch.setattr(cli, "spare", lambda command: None)
    for with_traceback in (False, True):
        if with_traceback:
            monkeypatch.setenv("DESAT_TRACEBACK", "1")
        command = desat()
        assert command.returncode == Exit.BUG
        assert command.stderr.splitlines()[-1] == (
            "error: internal: ValueError: why (DESAT_TRACEBACK=1 shows where)"
        )
        assert ("Traceback" in command.stderr) == with_traceback


@pytest.mark.parametrize("number", [1, 15])
def test_a_signal_to_stop_is_its_exit_code(number):
    with pytest.raises(SystemExit) as exit_info:
        cli._terminate(number, None)
    assert exit_info.value.code == 128 + number


SWALLOWED = """
import os, signal, sys, time, weakref
from desat import cli

def repeat(*given, as_it_is=signal.setitimer):
    signal.setitimer = as_it_is
    if {twice}:
        raise KeyboardInterrupt
    as_it_is(*given)

signal.setitimer = repeat

def fails(**given):
    thing = set()
    ref = weakref.ref(thing, lambda _: os.kill(os.getpid(), {number}))
    del thing
    time.sleep(30.0)
    print("it went on")

cli.get_command = lambda app: fails
cli.spare = lambda command: None
sys.argv[1:] = []
cli.main()
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="needs POSIX")
@pytest.mark.parametrize("twice", [False, True])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_stop_that_python_swallows_comes_again(number, twice):
    """Inside a weakref callback, as each import has one, its exception is printed and
    ignored; a second one may come meanwhile."""
    script = SWALLOWED.format(number=int(number), twice=twice)
    command = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (command.returncode, command.stdout, command.stderr) == (
        128 + number,
        "",
        "",
    )


def test_a_full_disk_is_known_by_what_an_error_came_from():
    def chain_error(
        cause: BaseException | None, context: BaseException | None
    ) -> BaseException:
        error = RuntimeError("why")
        error.__cause__, error.__context__ = cause, context
        return error

    full, other = OSError(28, "full"), OSError(5, "read")
    assert is_full(full)
    for cause, context, is_disk_full in (
        (full, None, True),
        (None, full, True),
        (full, other, True),
        (other, full, False),
        (other, None, False),
        (None, chain_error(None, full), True),
    ):
        assert is_full(chain_error(cause, context)) == is_disk_full
    own_value = chain_error(None, None)
    own_value.__cause__ = own_value
    assert not is_full(own_value)


# --- input that is refused in one line ------------------------------------------------

CRAFT = ["new", "craft", "made", "--size", "3U", "--altitude", "400km"]
ELEMENTS = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)


def refused_line(command) -> str:
    """Return the one line of a command that refuses its input."""
    assert command.returncode == Exit.INPUT
    (line,) = command.stderr.splitlines()
    assert line.startswith("error: ")
    return line.removeprefix("error: ")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["new", "law", ""], "an argument: an empty text"),
        (["new", "law", "."], "NAME .: a file's name is needed, as my_law"),
        (["new", "law", "/"], "NAME /: a file's name is needed, as my_law"),
        (["new", "block", "magnetometer", ""], "an argument: an empty text"),
        (
            ["new", "block", "magnetometer", "."],
            "NAME .: a file's name is needed, as my_block",
        ),
        (["new", "craft", "", "--force"], "an argument: an empty text"),
        (["run", "nadir_day/day", "--out", ""], "--out: an empty text"),
        (["run", "nadir_day/day", "--out="], "--out: an empty text"),
        (["check", "nadir_day/day", "--trust", ""], "--trust: an empty text"),
        (
            ["run", "nadir_day/day", "--time-limit", "0"],
            "--time-limit 0: above 0 is needed",
        ),
        (
            ["sweep", "nadir_day/day", "a.b=1", "--time-limit", "-0.0"],
            "--time-limit -0.0: above 0",
        ),
        (
            ["tune", "nadir_day/day", "a.b", "--time-limit", "0s"],
            "--time-limit 0s: above 0",
        ),
        (
            [*CRAFT, "--rods", "rod 0.2Am2 60x8mm 1e-300mm 100mA"],
            "--rods 1e-300mm: 1e-06 to 100 m",
        ),
        (
            [*CRAFT, "--rods", "rod 0.2Am2 60x8mm 0.2mm 1e-300A"],
            "--rods 1e-300A: 1e-06 to 1000 A",
        ),
        (
            [*CRAFT, "--rods", "coil 300 80x80mm 1e-30mm 1A"],
            "--rods 1e-30mm: 1e-06 to 100 m",
        ),
        (
            [*CRAFT, "--rods", "coil 0.1 80x80mm 1mm 1A"],
            "--rods 0.1: turns 1 or more are needed",
        ),
    ],
)
def test_a_value_that_is_no_value_is_refused(desat, tmp_path, arguments, text):
    command = desat(*arguments, cwd=tmp_path)
    assert refused_line(command).startswith(text)
    assert list(tmp_path.iterdir()) == []


def craft_of(elements, file, desat):
    """What `desat new craft` says to elements written into a file."""
    file.write_text("\n".join(elements))
    folder = file.parent
    return desat("new", "craft", "made", "--force", "--tle", str(file), cwd=folder)


def test_elements_as_they_are_give_a_craft(desat, tmp_path):
    assert craft_of(ELEMENTS, tmp_path / "iss.tle", desat).returncode == 0


@pytest.mark.parametrize(
    ("number", "old", "new", "field"),
    [
        (1, "19343.69339541", "19343 69339541", "day of the epoch"),
        (1, "19343.69339541", "193436.9339541", "day of the epoch"),
        (1, "19343.69339541", "1 343.69339541", "year of the epoch"),
        (1, "38792-4", "3879x-4", "B*"),
        (2, "51.6439", "51 6439", "inclination"),
        (2, "0007417", "0.07417", "eccentricity"),
        (2, "15.50103472", "1550.103472", "mean motion"),
    ],
)
def test_an_element_that_lost_its_point_is_refused(
    desat, tmp_path, number, old, new, field
):
    lines = list(ELEMENTS)
    body = lines[number - 1].replace(old, new)[:68]
    digits = sum(int(c) if c.isdigit() else c == "-" for c in body)
    lines[number - 1] = f"{body}{digits % 10}"
    file = tmp_path / "iss.tle"
    command = craft_of(lines, file, desat)
    assert command.returncode == Exit.INPUT
    assert refused_line(command).startswith(
        f"--tle {file}: line {number}, {field} (columns "
    )


@pytest.mark.parametrize(
    ("offers", "text"),
    [
        (
            '(Law("own", {"gain": float("nan")}),)',
            "Law own: gains: gain is nan; a finite number",
        ),
        (
            '(Law("own", {"gain": [1.0, 2.0]}),)',
            "Law own: gains: gain is [1.0, 2.0]; a finite",
        ),
        (
            '(Law("own", {"gian": 0.003}),)',
            "Law own: gains: no parameter gian; did you mean gain?",
        ),
        ('(Law("own", units={"x": "1"}),)', "Law own: units: no parameter x"),
        (
            '(Law("own", {"gain": 1}, "rate"),)',
            "Law own: rate: 'rate' is none of its gains",
        ),
        ('(Law("own", None),)', "Law own: gains: a dict is needed"),
        ('Law("own")', "a tuple is needed"),
        ("3", "a tuple is needed"),
        ('(("own", {}),)', "('own', {}) is no law with a name"),
        ("(Law(3),)", "Law(name=3"),
    ],
)
def test_laws_of_another_form_are_refused_before_anything_flies(
    desat, tmp_path, monkeypatch, offers, text
):
    assert desat("new", "law", "own", cwd=tmp_path).returncode == 0
    file = tmp_path / "own.py"
    new_text, count = re.subn(
        r"offers = .*", lambda _: f"offers = {offers}", file.read_text()
    )
    assert count == 1
    file.write_text(new_text)
    monkeypatch.setattr(ranking, "_fly", lambda *_: pytest.fail("it flew"))
    command = desat(
        "compare", "nadir_day/day-dipole", "--law", str(file), "--blocks", cwd=tmp_path
    )
    assert refused_line(command).startswith(f"own.py: offers: {text}")


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--laws", "foo"], "foo: no law and no manager"),
        (["--laws", "all,foo"], "foo: no law and no manager"),
        (["--laws", "all", "--law", "no.py"], "--law no.py: No such file"),
        (["--laws", "all", "--law", "no.fmu"], "--law no.fmu: No such file"),
    ],
)
def test_names_of_laws_are_looked_at_before_anything_flies(
    desat, monkeypatch, arguments, text
):
    monkeypatch.setattr(ranking, "_fly", lambda *_: pytest.fail("it flew"))
    command = desat("compare", "nadir_day/day-dipole", "--blocks", *arguments)
    assert refused_line(command).startswith(text)


@pytest.mark.parametrize("number", [27, 28, 122])
def test_an_archive_without_room_is_not_called_unreadable(
    tmp_path, monkeypatch, number
):
    archive = tmp_path / "a.fmu"
    with zipfile.ZipFile(archive, "w") as new_archive:
        new_archive.writestr("modelDescription.xml", "<x/>")

    def fails(*_: object) -> None:
        raise OSError(number, "no room")

    monkeypatch.setattr(zipfile.ZipFile, "extract", fails)
    with pytest.raises(
        DesatError, match=r"a\.fmu: it cannot be extracted to .* \(no room\)"
    ) as full:
        extract(archive, tmp_path / "new")
    assert full.value.code == Exit.SPACE
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("message", "number"),
    [
        ("error: unable to open 'x.o': 'File too large'", 27),
        ("x.o: No space left on device", 28),
        ("File size limit exceeded signal terminated program as", 27),
        ("x.c:1: error: no", None),
    ],
)
@pytest.mark.parametrize(
    "compiler", [native._run_compiler, web_module._run], ids=["native", "web"]
)
def test_a_compiler_without_room_is_no_bug(tmp_path, compiler, message, number):
    command = [sys.executable, "-c", f"import sys; sys.exit({message!r})"]
    with pytest.raises(Exception) as error:  # noqa: PT011
        compiler(command, tmp_path)
    assert getattr(error.value, "errno", None) == number
    assert is_full(error.value) == (number is not None)


def test_an_error_that_comes_from_a_full_disk_ends_as_that(desat, monkeypatch):
    def fails(**_: object) -> None:
        try:
            raise OSError(28, "full")
        except OSError as error:
            raise DesatError("a.json: not written") from error

    monkeypatch.setattr(cli, "get_command", lambda app: fails)
    monkeypatch.setattr(cli, "spare", lambda command: None)
    assert desat().returncode == Exit.SPACE


# --- commands -------------------------------------------------------------------------

SWEPT = sweep_study.Sweep("a", {}, 0, None, {}, [], [])


@pytest.mark.parametrize("as_json", [True, False])
@pytest.mark.parametrize(
    ("arguments", "module", "name"),
    [
        (["sweep", "a", "b.k=0,1"], sweep_study, "sweep"),
        (["tables", "uosat12"], tables_command, "_draws_of"),
        (["size", "a"], sizing, "size"),
    ],
)
def test_progress_is_shown_to_people_alone(
    desat, monkeypatch, arguments, module, name, as_json
):
    inputs = []

    def size_nothing(*args: object, progress: object = None, **_: object):
        inputs.append(args[4] if name == "sweep" else progress)
        if name == "_draws_of":
            raise DesatError("enough")
        if name == "size":
            return SimpleNamespace(as_json=lambda: {"x": 1}, problems=[])
        return SWEPT

    monkeypatch.setattr(module, name, size_nothing)
    monkeypatch.setattr(
        "desat.cli.commands.size._print_sizing", lambda size_nothing: print("people")
    )
    monkeypatch.setattr(
        "desat.sizing.page.write_sizing", lambda size_nothing, page: page
    )
    command = desat(*arguments, *(["--json"] if as_json else []))
    assert inputs == ([None] if name == "size" else [not as_json])
    if name != "_draws_of":
        assert command.returncode == 0
        assert command.stdout.startswith("{") == as_json


@pytest.mark.parametrize(
    ("problems", "code"), [([], 0), (["a wheel [b] is full"], Exit.UNMET)]
)
def test_a_craft_that_cannot_hold_ends_with_1(desat, monkeypatch, problems, code):
    inputs = []

    def size(*args: object) -> SimpleNamespace:
        inputs.append(args)
        args[-1]("flying")
        return SimpleNamespace(as_json=lambda: {}, problems=problems)

    monkeypatch.setattr(sizing, "size", size)
    for flag, loop, duty in (
        ([], True, 0.5),
        (["--no-loop", "--duty", "20"], False, 0.2),
    ):
        command = desat("size", "a", "--json", *flag)
        assert command.returncode == code
        assert command.stderr.splitlines() == [
            f"it cannot hold: {line}" for line in problems
        ]
        wishes = inputs[-1][2]
        assert (wishes.duty, wishes.flown) == (duty, loop)
        assert not inputs[-1][1].blocks


@pytest.mark.parametrize(
    ("rows", "others", "code"),
    [
        ([WELL], [UNMET], 1),
        ([UNMET], [WELL], 1),
        ([WELL], [LATE_ONE], 5),
        ([FAILED], [WELL], 4),
        ([WELL], [WELL], 0),
    ],
)
def test_paired_draws_end_as_the_worst_of_both(desat, monkeypatch, rows, others, code):
    both = [
        study.Draws(name, 1, [replace(row, number=0) for row in x], {}, [f"w{name}"])
        for name, x in (("a", rows), ("b", others))
    ]
    monkeypatch.setattr(compare, "are_campaigns", lambda targets: False)
    monkeypatch.setattr(compare, "paired_draws", lambda *_, **__: ([], both))
    command = desat("compare", "a", "b", "-n", "1")
    assert command.returncode == code
    assert command.stderr.splitlines()[:2] == ["warning: a: wa", "warning: b: wb"]


@pytest.mark.parametrize(
    "origin", [None, {"file": "computed now", "seed": 3, "components_as": "z"}]
)
def test_tables_are_printed_as_they_are(desat, monkeypatch, tmp_path, origin):
    rows = [
        cell(1.5, values=1.6, definition="how [b] it is"),
        cell(3.0, values=1.5, unit="s"),
    ]
    messages = []
    monkeypatch.setattr(
        tables_command, "_draws_of", lambda *_, **__: ({"a": 1}, origin)
    )
    monkeypatch.setattr(tables, "rows", lambda *args: messages.append(args) or rows)
    monkeypatch.setattr(
        tables, "write_html", lambda *args: messages.append(args) or args[2]
    )
    command = desat(
        "tables", "uosat12", "--html", str(tmp_path / "a.html"), "--jobs", "3"
    )
    assert command.returncode == 0
    lines = [" ".join(line.split()) for line in command.stdout.splitlines()]
    heads = [
        "case paper ours difference band sample",
        "case paper ours difference band sample",
    ]
    assert [x for x in lines if x.startswith("case")] == heads
    assert "how [b] it is" in lines
    assert (
        "case  paper  ours        difference  band " in command.stdout
    )  # numbers to the right
    assert "\nname   1.50  3.00  +1.50 (+100.0 %)  1.00 " in command.stdout
    assert any("1.6" in x and "1.5" in x for x in lines)
    assert [x for x in lines if x.startswith("draws: ")] == (
        ["draws: computed just now with seed 3 by z"] if origin else []
    )
    assert lines[-1] == f"page: {tmp_path / 'a.html'}"
    assert messages[0][0] == messages[1][0] == "uosat12"
    assert (messages[0][2:], messages[1][4]) == ((3, {"a": 1}), origin)
    assert desat("tables", "uosat12").returncode == 0
    assert messages[-1][2] == Path("runs/tables-uosat12.html")
    as_json = desat("tables", "uosat12", "--json")
    assert json.loads(as_json.stdout)["rows"][0]["ours"] == 1.5


def test_verdicts_alone_are_coloured(desat, monkeypatch):
    file = io.StringIO()
    console = plain_console(
        file=file, force_terminal=True, color_system="standard", width=200
    )
    rows = [cell(1.5, values=1.6), cell(3.0, values=1.5)]
    monkeypatch.setattr(tables_command, "out", console)
    monkeypatch.setattr(console_module, "out", console)
    monkeypatch.setattr(tables_command, "_draws_of", lambda *_, **__: (None, None))
    monkeypatch.setattr(tables, "rows", lambda *_: rows)
    monkeypatch.setattr(tables, "write_html", lambda *args: args[2])
    assert desat("tables", "uosat12").returncode == 0
    coloured_words = re.findall("\x1b\\[3[12]m([^\x1b]*)", file.getvalue())
    assert [text.strip() for text in coloured_words] == ["within", "outside"]


@pytest.mark.parametrize("status", ["completed", "failed"])
def test_a_table_of_a_run_that_failed_ends_as_it(monkeypatch, status):
    options = Options(blocks=True)
    scenarios = [SimpleNamespace(name="a/b"), SimpleNamespace(name="a/c")]
    results = [
        study.RunRow("completed", 0, "", numbers={"x": 1.0}),
        study.RunRow(
            status, 0 if status == "completed" else 5, "h is nan", numbers={"x": 2.0}
        ),
    ]

    def rows(tasks: list[tuple[object, ...]], *values: object, progress: bool):
        assert [(task[0], task[1], task[3]) for task in tasks] == [
            ("a/b", options, None),
            ("a/c", options, None),
        ]
        assert (values, progress) == ((3, "runs"), False)
        return results

    monkeypatch.setattr(tables, "rows_of_runs", rows)
    if status == "completed":
        assert tables._single(scenarios, options, 3) == {
            "a/b": {"x": 1.0},
            "a/c": {"x": 2.0},
        }
    else:
        with pytest.raises(RunError, match=r"^a/c: failed: h is nan$") as error:
            tables._single(scenarios, options, 3)
        assert error.value.code == Exit.TIMEOUT


def test_a_check_as_json_has_the_order_or_none(desat, tmp_path):
    good = json.loads(desat("check", "gyrostat/light", "--blocks", "--json").stdout)
    assert "spacecraft" in good["order"]
    assert {c["timing"] for c in good["connections"]} >= {"at t_k"}
    assert good["problems"] == []
    bad = desat("check", "gyrostat/light", "--stop", "0.05", "--blocks", "--json")
    answer = json.loads(bad.stdout)
    assert (bad.returncode, answer["order"], answer["connections"]) == (
        Exit.UNMET,
        [],
        [],
    )
    assert answer["problems"]
    far = desat("check", "gyrostat/heavy-wheels", "--substeps", "1", "--blocks")
    assert "\nwarning: turn and nutation in a substep" in "\n" + far.stderr
    assert "\nnote: " in far.stderr


def make_run(code: int = 0, **more: object) -> Run:
    """A run that ended so."""
    status = "completed" if code < 2 else "failed"
    results = {
        "status": status,
        "message": "h[b] is nan",
        "steps_done": 3,
        "us_per_step": 0.5,
        "unmet": ["x[b] = 2"] * (code == 1),
        "exit": code if code > 1 else None,
    }
    run = Run(Manifest.from_json(results), SimpleNamespace(every=1))
    run.manifest = replace(run.manifest, **more)
    return run


@pytest.mark.parametrize("csv", [True, False])
@pytest.mark.parametrize(
    ("own_scenario", "baseline", "code"),
    [
        (0, None, 0),
        (1, None, 1),
        (4, None, 4),
        (5, None, 5),
        (0, 0, 0),
        (0, 1, 1),
        (1, 0, 1),
        (0, 4, 4),
        (1, 4, 1),
        (4, 0, 4),
    ],
)
def test_a_run_and_its_baseline_end_the_command(
    monkeypatch, tmp_path, own_scenario, baseline, code, csv
):
    """Checkpoints go where both have completed; a baseline follows a run that has."""
    steps: list[object] = []
    other = None if baseline is None else make_run(baseline)
    monkeypatch.setattr(
        run_command, "_run_baseline", lambda *_: steps.append("baseline") or other
    )
    monkeypatch.setattr(run_command, "_report", lambda *_: steps.append("report"))
    monkeypatch.setattr(run_command, "_csv", lambda *_: steps.append("csv"))
    monkeypatch.setattr(
        run_command, "_report_run", lambda *args: steps.append(args[-1])
    )
    monkeypatch.setattr(checkpoint, "remove", lambda folder: steps.append(folder.name))
    for has_baseline in (True, False):
        steps.clear()
        run, exit_code = make_run(own_scenario), 0
        try:
            run_command.conclude(
                run,
                None,
                tmp_path / "a",
                csv=csv,
                baseline=has_baseline,
                everything=False,
                as_json=csv,
            )
        except run_command.typer.Exit as exit_error:
            exit_code = exit_error.exit_code
        follows = has_baseline and own_scenario < 2
        assert exit_code == (
            code if follows or own_scenario > 1 or not baseline else own_scenario
        )
        theirs = baseline if follows and baseline is not None else 0
        removals = (
            ["a", run_command.BASELINE] if own_scenario < 2 and theirs < 2 else []
        )
        assert steps == ["baseline"] * follows + ["report"] + [
            "csv"
        ] * csv + removals + [csv]


def test_what_a_run_says_at_its_end(capsys, tmp_path):
    numbers = {"x": Value("Size of [b]", 2.0, "N.m.s"), "y": Value("Time", None, "s")}
    own_value = make_run(
        4,
        numbers=numbers,
        not_checked={"z": "no [b]"},
        unmet=["x[b] = 2: above"],
        stopped_when=Stopped("a.h[b] below 1", 12.5),
    )
    other = make_run(0, numbers={"x": Value("Size of [b]", 3.0, "N.m.s")})
    for baseline in (None, other):
        run_command._report_run(
            own_value, baseline, tmp_path, tmp_path / "[b].html", False, False
        )
        out, err = capsys.readouterr()
        lines = [" ".join(x.split()) for x in out.splitlines()]
        assert err.splitlines() == ["failed: h[b] is nan", "not met: x[b] = 2: above"]
        assert lines[0] == "ended at 12.5 s: a.h[b] below 1"
        table = ["Size of [b] 2 N m s", "Time not reached s", "z not checked no [b]"]
        if baseline:
            table = ["this run baseline", table[0].replace("2", "2 3"), *table[1:]]
        assert lines[1:-2] == table
        theirs = "         3" if baseline else ""  # numbers to the right
        assert f"\nSize of [b]            2{theirs}  N m s" in out
        assert lines[-2:] == [
            f"3 steps; series in {tmp_path / 'series.h5'}",
            f"report: {tmp_path / '[b].html'}",
        ]
    run_command._report_run(make_run(), None, tmp_path, None, False, False)
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("3 steps")
    for page in (None, tmp_path / "a.html"):
        run_command._report_run(own_value, None, tmp_path, page, False, True)
        answer = json.loads(capsys.readouterr().out)
        assert (answer["folder"], answer["report"]) == (
            str(tmp_path),
            page and str(page),
        )


@pytest.mark.parametrize("code", [0, 4])
def test_without_room_for_a_report_a_run_that_completed_ends_with_6(code):
    full = OSError(28, "No space left on device")
    if code:
        with run_command.skip_if_disk_full(make_run(code), Path("a"), "report"):
            raise full
    else:
        with (
            pytest.raises(RunError, match=r"^a: its report: ") as error,
            run_command.skip_if_disk_full(make_run(code), Path("a"), "report"),
        ):
            raise full
        assert error.value.code == Exit.SPACE
    with (
        pytest.raises(OSError, match="gone"),
        run_command.skip_if_disk_full(make_run(code), Path("a"), "x"),
    ):
        raise OSError(2, "gone")


@pytest.mark.parametrize(
    ("number", "text", "code", "message"),
    [
        (1, "", 0, []),
        (2, "", Exit.INPUT, ["error: c: case 2: there are 0 to 1"]),
        (0, "its craft", Exit.INPUT, None),
        (0, "", 1, ["not met: x[b] = 2"]),
        (0, "", 4, ["error: case 0: failed: h[b] is nan"]),
        (0, "", 5, ["error: case 0: failed: h[b] is nan"]),
    ],
)
@pytest.mark.parametrize("row", [None, SimpleNamespace()])
def test_a_case_made_again_ends_as_it_did(
    desat, monkeypatch, number, text, code, message, row
):
    comparisons: list[object] = []
    monkeypatch.setattr(plan, "read", lambda folder: SimpleNamespace(count=2))
    monkeypatch.setattr(plan, "changed", lambda plan: text)
    monkeypatch.setattr(plan, "anew", lambda plan: "begin anew")
    monkeypatch.setattr(plan, "same_versions", lambda *args: comparisons.append(args))
    monkeypatch.setattr(store, "versions_of", lambda folder, number: row)
    monkeypatch.setattr(campaign_case, "repeat", lambda *_: make_run(code))
    monkeypatch.setattr(coordinator, "kept_in", lambda folder, number: folder / "[b]")
    into = ["--out", "[o]"] if row else []
    command = desat("campaign", "case", "c", str(number), *into)
    assert command.returncode == code
    lines = ["error: c: case 0: its craft: the case would differ; begin anew"]
    assert command.stderr.splitlines() == (lines if message is None else message)
    result = code != Exit.INPUT
    place = "[o]" if row else "c/[b]"
    assert command.stdout.splitlines() == [f"{place}/report.html"] * result
    assert [args[2] for args in comparisons] == [False] * (result and row is not None)


# --- a run in a process of its own ----------------------------------------------------


def catch_error(function, *args: object) -> tuple[str, object] | object:
    try:
        return function(*args)
    except (
        KeyboardInterrupt,
        SystemExit,
        OSError,
        RuntimeError,
        DesatError,
        EndedError,
    ) as error:
        return type(error).__name__, getattr(error, "code", str(error))
