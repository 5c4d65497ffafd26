"""How commands, runs and cases end, with what takes long replaced: exit codes and what
is said."""

from __future__ import annotations

import io
import json
import math
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
from rich.table import Table

from desat import cli
from desat.analyses import coverage, energy, fixed, residual
from desat.analyses.manifest import Manifest, Stopped, SubstepChoice
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.campaign import case as campaign_case
from desat.campaign import coordinator, plan, store
from desat.campaign import draws as study
from desat.cli import console as console_module
from desat.cli.commands import run as run_command
from desat.cli.console import plain_console
from desat.engine import checkpoint, child
from desat.engine.child import Ended
from desat.engine.instances.base import EndedError
from desat.engine.master import Master
from desat.files.io import extract, is_full
from desat.fmus import native
from desat.numbers.text import Value
from desat.runs import run as runs
from desat.runs import step_case, stopping
from desat.runs.run import Run
from desat.runs.step_case import Outcome
from desat.runs.stopping import LATE, Condition
from desat.sizing import sizing
from desat.studies import compare, ranking
from desat.system.errors import DesatError, Exit, RunError, nearest, plain
from desat.system.options import Options
from tests.conftest import module_of
from tests.fuzz import commands
from tests.numbers.test_verdicts import FAILED, LATE_ONE, UNMET, WELL, cell

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
    ("name", "known", "hint"),
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
def test_the_nearest_name(name, known, hint):
    assert nearest(name, known) == hint


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
    for traced in (False, True):
        if traced:
            monkeypatch.setenv("DESAT_TRACEBACK", "1")
        done = desat()
        assert done.returncode == Exit.BUG
        assert done.stderr.splitlines()[-1] == (
            "error: internal: ValueError: why (DESAT_TRACEBACK=1 shows where)"
        )
        assert ("Traceback" in done.stderr) == traced


@pytest.mark.parametrize("number", [1, 15])
def test_a_signal_to_stop_is_its_exit_code(number):
    with pytest.raises(SystemExit) as raised:
        cli._terminate(number, None)
    assert raised.value.code == 128 + number


SWALLOWED = """
import os, sys, time, weakref
from desat import cli

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
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_stop_that_python_swallows_comes_again(number):
    """Inside a weakref callback, as each import has one, its exception is printed and
    ignored."""
    script = SWALLOWED.format(number=int(number))
    done = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "")


def test_a_full_disk_is_known_by_what_an_error_came_from():
    def chained(
        cause: BaseException | None, context: BaseException | None
    ) -> BaseException:
        error = RuntimeError("why")
        error.__cause__, error.__context__ = cause, context
        return error

    full, other = OSError(28, "full"), OSError(5, "read")
    assert is_full(full)
    for cause, context, known in (
        (full, None, True),
        (None, full, True),
        (full, other, True),
        (other, full, False),
        (other, None, False),
        (None, chained(None, full), True),
    ):
        assert is_full(chained(cause, context)) == known
    own_value = chained(None, None)
    own_value.__cause__ = own_value
    assert not is_full(own_value)


# --- input that is refused in one line ------------------------------------------------

CRAFT = ["new", "craft", "made", "--size", "3U", "--altitude", "400km"]
ELEMENTS = (
    "1 25544U 98067A   19343.69339541  .00001764  00000-0  38792-4 0  9991",
    "2 25544  51.6439 211.2001 0007417  17.6667  85.6398 15.50103472202482",
)


def refused_line(done) -> str:
    """Return the one line of a command that refuses its input."""
    assert done.returncode == Exit.INPUT
    (line,) = done.stderr.splitlines()
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
    done = desat(*arguments, cwd=tmp_path)
    assert refused_line(done).startswith(text)
    assert list(tmp_path.iterdir()) == []


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
    for written, code in ((ELEMENTS, 0), (lines, Exit.INPUT)):
        file.write_text("\n".join(written))
        done = desat(
            "new", "craft", "made", "--force", "--tle", str(file), cwd=tmp_path
        )
        assert done.returncode == code
    assert refused_line(done).startswith(
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
    changed, count = re.subn(
        r"offers = .*", lambda _: f"offers = {offers}", file.read_text()
    )
    assert count == 1
    file.write_text(changed)
    monkeypatch.setattr(ranking, "_fly", lambda *_: pytest.fail("it flew"))
    done = desat(
        "compare", "nadir_day/day-dipole", "--law", str(file), "--blocks", cwd=tmp_path
    )
    assert refused_line(done).startswith(f"own.py: offers: {text}")


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
    done = desat("compare", "nadir_day/day-dipole", "--blocks", *arguments)
    assert refused_line(done).startswith(text)


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
@pytest.mark.parametrize("module", [native, web_module])
def test_a_compiler_without_room_is_no_bug(tmp_path, module, message, number):
    command = [sys.executable, "-c", f"import sys; sys.exit({message!r})"]
    with pytest.raises(Exception) as ended:  # noqa: PT011
        module._run(command, tmp_path)
    assert getattr(ended.value, "errno", None) == number
    assert is_full(ended.value) == (number is not None)


def test_an_error_that_comes_from_a_full_disk_ends_as_that(desat, monkeypatch):
    def fails(**_: object) -> None:
        try:
            raise OSError(28, "full")
        except OSError as error:
            raise DesatError("a.json: not written") from error

    monkeypatch.setattr(cli, "get_command", lambda app: fails)
    monkeypatch.setattr(cli, "spare", lambda command: None)
    assert desat().returncode == Exit.SPACE


# --- run folders that somebody has altered --------------------------------------------

READERS = (
    "export run bad --format csv --out made",
    "export run bad --format parquet --out made",
    "export run bad --format mat --out made",
    "export run bad --format png --out made",
    "report bad",
    "compare bad good --html made.html",
    "compare good bad --html made.html",
    "bound bad",
)


@pytest.fixture(scope="module")
def good_run(tmp_path_factory):
    """The folder in which a run lies."""
    folder = tmp_path_factory.mktemp("ends")
    line = "run nadir_day/day-dipole --stop 40 --blocks --substeps 1 --out good"
    assert commands.ended(line.split(), folder)[0] in (0, 1)
    return folder


@pytest.fixture
def bad_run(good_run):
    """The folder of a copy of it, to be damaged."""
    bad = good_run / "bad"
    shutil.rmtree(bad, ignore_errors=True)
    shutil.rmtree(good_run / "made", ignore_errors=True)
    (good_run / "made.html").unlink(missing_ok=True)
    shutil.copytree(good_run / "good", bad)
    return bad


def assert_refused(bad, text):
    """All commands that read a run folder refuse one in a line, and leave nothing
    behind."""
    before = sorted(p.name for p in bad.iterdir())
    for line in READERS:
        code, message = commands.ended(line.split(), bad.parent)
        assert code == Exit.INPUT, (line, message)
        assert text in message, line
        assert "internal" not in message
        assert len(message.splitlines()) == 1
    output = bad.parent / "made"
    assert not output.exists() or not list(output.iterdir())
    assert not (bad.parent / "made.html").exists()
    assert sorted(p.name for p in bad.iterdir()) == before


@pytest.mark.parametrize(
    ("path", "value", "text"),
    [
        (["numbers"], [], "numbers has not the form that it needs"),
        (["numbers", "*", "value"], "x", "value is 'x'; a number or null is needed"),
        (["numbers", "*", "title"], None, "title is None; a text is needed"),
        (["numbers", "*", "unit"], 3, "unit is 3; a text is needed"),
        (["numbers", "*"], {"x": 1}, "numbers has not the form that it needs"),
        (["parameters", "spacecraft"], 3, "parameters has not the form that it needs"),
        (
            ["parameters", "spacecraft", "inertia"],
            {},
            "parameters has not the form that it needs",
        ),
        (["choices"], {"a.b": 3}, "choices.a.b is 3; a list is needed"),
        (["stop"], "soon", "stop is 'soon'; a number is needed"),
        (["stop"], 10**310, "stop is 1000"),
        (["warnings"], [3], "warnings[1] is 3; a text is needed"),
        (["momentum_balance"], 3, "no manifest of a run: "),
        (
            ["substep_choice"],
            {},
            "substep_choice has not the form that it needs ('reached')",
        ),
        (["status"], None, "no manifest of a run (it has no status)"),
    ],
)
def test_an_altered_manifest_is_refused_with_its_key(bad_run, path, value, text):
    file = bad_run / "manifest.json"
    answer = table = json.loads(file.read_text())
    if path == ["momentum_balance"]:
        path = [residual.KEY]
    for key in path[:-1]:
        table = table[next(iter(table)) if key == "*" else key]
    table[next(iter(table)) if path[-1] == "*" else path[-1]] = value
    file.write_text(json.dumps(answer))
    assert_refused(bad_run, text)


def _cut(file):
    file.write_bytes(file.read_bytes()[:3000])


def _without_time(file):
    with h5py.File(file, "r+") as opened:
        del opened["time"]


def _time_stands_still(file):
    with h5py.File(file, "r+") as opened:
        opened["time"][3] = opened["time"][2]


def _replace_series(value):
    def change(file):
        with h5py.File(file, "r+") as opened:
            del opened["spacecraft/q_bi"]
            opened["spacecraft/q_bi"] = value

    return change


def _group_is_a_series(file):
    with h5py.File(file, "r+") as opened:
        del opened["spacecraft"]
        opened["spacecraft"] = np.zeros(3)


@pytest.mark.parametrize(
    "change",
    [
        _cut,
        _without_time,
        _time_stands_still,
        _replace_series(np.zeros((4, 4))),
        _replace_series(3.0),
        _replace_series(b"text"),
        _replace_series(np.zeros((41, 2, 2))),
        _group_is_a_series,
    ],
)
def test_damaged_series_are_refused_with_their_file(bad_run, change):
    change(bad_run / "series.h5")
    assert_refused(bad_run, "bad: no readable series (")


def test_a_series_without_its_unit_is_refused_with_its_name(bad_run):
    with h5py.File(bad_run / "series.h5", "r+") as opened:
        del opened["spacecraft/q_bi"].attrs["unit"]
    line = "export run bad --format csv --out made"
    code, message = commands.ended(line.split(), bad_run.parent)
    assert code == Exit.INPUT
    assert "series.h5: spacecraft.q_bi, attribute unit, cannot be read" in message
    assert list((bad_run.parent / "made").iterdir()) == []


@pytest.mark.parametrize("name", ["ger\u00e4t", "ger\udce4t", "ger\udcc3\udca4t"])
def test_a_folder_of_any_name_is_written(tmp_path, good_run, name):
    """Of UTF-8, of another encoding, and as Python has it where the locale is not
    UTF-8."""
    lines = (
        f"campaign nadir_day/day-dipole -n 1 --stop 20 --jobs 1 --blocks --substeps 1 --out {name}",
        f"campaign report {name}",
        f"run nadir_day/day-dipole --stop 20 --blocks --substeps 1 --csv --out run-{name}",
        f"export run run-{name} --format parquet --out made-{name}",
        f"report run-{name}",
        f"compare run-{name} {good_run / 'good'} --html made-{name}.html",
    )
    for line in lines:
        code, message = commands.ended(line.split(), tmp_path)
        assert code in (0, 1), (line, message)
    page = (tmp_path / f"made-{name}.html").read_bytes().decode()
    assert ("ger\ufffdt" if name == "ger\udce4t" else "ger\u00e4t") in page


# --- commands -------------------------------------------------------------------------

SWEPT = study.Sweep("a", {}, 0, None, {}, [], [])


@pytest.mark.parametrize("as_json", [True, False])
@pytest.mark.parametrize(
    ("arguments", "module", "name"),
    [
        (["sweep", "a", "b.k=0,1"], study, "sweep"),
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
    done = desat(*arguments, *(["--json"] if as_json else []))
    assert inputs == ([None] if name == "size" else [not as_json])
    if name != "_draws_of":
        assert done.returncode == 0
        assert done.stdout.startswith("{") == as_json


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
        done = desat("size", "a", "--json", *flag)
        assert done.returncode == code
        assert done.stderr.splitlines() == [
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
    done = desat("compare", "a", "b", "-n", "1")
    assert done.returncode == code
    assert done.stderr.splitlines()[:2] == ["warning: a: wa", "warning: b: wb"]


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
    done = desat("tables", "uosat12", "--html", str(tmp_path / "a.html"), "--jobs", "3")
    assert done.returncode == 0
    lines = [" ".join(line.split()) for line in done.stdout.splitlines()]
    heads = [
        "case paper ours difference band sample",
        "case paper ours difference band sample",
    ]
    assert [x for x in lines if x.startswith("case")] == heads
    assert "how [b] it is" in lines
    assert (
        "case  paper  ours        difference  band " in done.stdout
    )  # numbers to the right
    assert "\nname   1.50  3.00  +1.50 (+100.0 %)  1.00 " in done.stdout
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
    coloured = re.findall("\x1b\\[3[12]m([^\x1b]*)", file.getvalue())
    assert [text.strip() for text in coloured] == ["within", "outside"]


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
        with pytest.raises(RunError, match=r"^a/c: failed: h is nan$") as raised:
            tables._single(scenarios, options, 3)
        assert raised.value.code == Exit.TIMEOUT


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


def finished(code: int = 0, **more: object) -> Run:
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
    run = Run(Manifest.from_json(results), SimpleNamespace())
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
    done: list[object] = []
    other = None if baseline is None else finished(baseline)
    monkeypatch.setattr(
        run_command, "_run_baseline", lambda *_: done.append("baseline") or other
    )
    monkeypatch.setattr(run_command, "_report", lambda *_: done.append("report"))
    monkeypatch.setattr(run_command, "_csv", lambda *_: done.append("csv"))
    monkeypatch.setattr(run_command, "_report_run", lambda *args: done.append(args[-1]))
    monkeypatch.setattr(checkpoint, "remove", lambda folder: done.append(folder.name))
    for expected in (True, False):
        done.clear()
        run, ended = finished(own_scenario), 0
        try:
            run_command.conclude(
                run,
                None,
                tmp_path / "a",
                csv=csv,
                baseline=expected,
                everything=False,
                as_json=csv,
            )
        except run_command.typer.Exit as exit_error:
            ended = exit_error.exit_code
        follows = expected and own_scenario < 2
        assert ended == (
            code if follows or own_scenario > 1 or not baseline else own_scenario
        )
        theirs = baseline if follows and baseline is not None else 0
        removed = ["a", run_command.BASELINE] if own_scenario < 2 and theirs < 2 else []
        assert done == ["baseline"] * follows + ["report"] + ["csv"] * csv + removed + [
            csv
        ]


def test_what_a_run_says_at_its_end(capsys, tmp_path):
    numbers = {"x": Value("Size of [b]", 2.0, "N.m.s"), "y": Value("Time", None, "s")}
    own_value = finished(
        4,
        numbers=numbers,
        not_checked={"z": "no [b]"},
        unmet=["x[b] = 2: above"],
        stopped_when=Stopped("a.h[b] below 1", 12.5),
    )
    other = finished(0, numbers={"x": Value("Size of [b]", 3.0, "N.m.s")})
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
            f"3 steps, 0.5 us a step; series in {tmp_path / 'series.h5'}",
            f"report: {tmp_path / '[b].html'}",
        ]
    run_command._report_run(finished(), None, tmp_path, None, False, False)
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
        with run_command.skip_if_disk_full(finished(code), Path("a"), "report"):
            raise full
    else:
        with (
            pytest.raises(RunError, match=r"^a: its report: ") as raised,
            run_command.skip_if_disk_full(finished(code), Path("a"), "report"),
        ):
            raise full
        assert raised.value.code == Exit.SPACE
    with (
        pytest.raises(OSError, match="gone"),
        run_command.skip_if_disk_full(finished(code), Path("a"), "x"),
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
    compared: list[object] = []
    monkeypatch.setattr(plan, "read", lambda folder: SimpleNamespace(count=2))
    monkeypatch.setattr(plan, "changed", lambda plan: text)
    monkeypatch.setattr(plan, "anew", lambda plan: "begin anew")
    monkeypatch.setattr(plan, "same_versions", lambda *args: compared.append(args))
    monkeypatch.setattr(store, "versions_of", lambda folder, number: row)
    monkeypatch.setattr(campaign_case, "repeat", lambda *_: finished(code))
    monkeypatch.setattr(coordinator, "kept_in", lambda folder, number: folder / "[b]")
    into = ["--out", "[o]"] if row else []
    done = desat("campaign", "case", "c", str(number), *into)
    assert done.returncode == code
    lines = ["error: c: case 0: its craft: the case would differ; begin anew"]
    assert done.stderr.splitlines() == (lines if message is None else message)
    result = code != Exit.INPUT
    place = "[o]" if row else "c/[b]"
    assert done.stdout.splitlines() == [f"{place}/report.html"] * result
    assert [args[2] for args in compared] == [False] * (result and row is not None)


# --- a run in a process of its own ----------------------------------------------------

FULL = "errno = 28, "
DIED = {"component": "a", "call": "stepping", "exit_text": "SIGSEGV"}
HUNG = {**DIED, "hung": 2.0}


def raised(function, *args: object) -> tuple[str, object] | object:
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


@pytest.mark.parametrize(
    ("ended", "result"),
    [
        (Ended({"made": 7}), 7),
        (Ended({}, signal=signal.SIGINT), ("KeyboardInterrupt", "")),
        (Ended({"made": 7}, signal=signal.SIGTERM), ("SystemExit", 143)),
        (Ended({"error": (DesatError, ("no",))}), ("DesatError", Exit.INPUT)),
        (Ended({"error": (RunError, ("no", Exit.SPACE))}), ("RunError", Exit.SPACE)),
        (Ended({"system": (2, "gone")}), ("FileNotFoundError", "[Errno 2] gone")),
        (Ended({"bug": "why"}), ("RuntimeError", "why")),
        (Ended({}, **DIED), ("EndedError", Exit.COMPONENT)),
        (Ended({}, **HUNG), ("EndedError", Exit.TIMEOUT)),
    ],
)
def test_what_is_done_apart_ends_as_its_process(monkeypatch, ended, result):
    monkeypatch.setattr(child, "watch", lambda *_: ended)
    assert raised(child.apart, lambda: 7, [], 1.0) == result


DONE = ("completed", "", 0)
ROWS = SimpleNamespace()


@pytest.mark.parametrize(
    ("ended", "result"),
    [
        (Ended({"layout": ROWS, "outcome": DONE}), DONE),
        (
            Ended({"layout": ROWS, "outcome": DONE}, **DIED),
            ("failed", "a: stepping ended the process: SIGSEGV, after the run", 0),
        ),
        (Ended({"error": (DesatError, ("no",))}), ("DesatError", Exit.INPUT)),
        (Ended({"layout": ROWS, "error": (DesatError, ("no",))}), "cut short"),
        (
            Ended({"layout": ROWS, "outcome": DONE, "error": (DesatError, ("no",))}),
            ("DesatError", Exit.INPUT),
        ),
        (Ended({"system": (2, "gone")}), ("FileNotFoundError", "[Errno 2] gone")),
        (Ended({"layout": ROWS, "system": (2, "gone"), "outcome": DONE}), DONE),
        (Ended({"layout": ROWS, "system": (2, "gone"), "bug": FULL}), "cut short"),
        (Ended({"bug": "why"}), ("RuntimeError", "why")),
        (Ended({"layout": ROWS, "bug": "why", "outcome": DONE}), DONE),
        (Ended({"layout": ROWS, "bug": "why"}, signal=2), "cut short"),
        (Ended({"bug": FULL}), ("RunError", Exit.SPACE)),
        (Ended({"layout": ROWS, "bug": FULL}), "cut short"),
        (Ended({}, **DIED), ("RunError", Exit.COMPONENT)),
        (Ended({}, **HUNG), ("RunError", Exit.TIMEOUT)),
        (Ended({}, signal=2), ("KeyboardInterrupt", "")),
        (Ended({"layout": ROWS}, signal=2), "cut short"),
        (Ended({"layout": ROWS}, **DIED), "cut short"),
    ],
)
@pytest.mark.parametrize("stored_values", [True, False])
def test_a_supervised_run_ends_as_its_process(
    monkeypatch, tmp_path, ended, result, stored_values
):
    """Its folder is removed where nobody has asked for one, whatever comes; the shorter
    of both limits holds for a call."""
    if isinstance(ended.reports.get("outcome"), tuple):
        ended = replace(ended, reports={**ended.reports, "outcome": Outcome(*DONE)})
    limits, scratch = [], tmp_path / "scratch"
    monkeypatch.setattr(child, "watch", lambda *args: limits.append(args[-1]) or ended)
    monkeypatch.setattr(runs.Results, "open", lambda place: place)
    monkeypatch.setattr(runs, "_cut_short", lambda *args: ("cut short", args[2]))
    if not ended.exit_text:  # else it is gone already
        scratch.mkdir()
    monkeypatch.setattr(runs.library, "scratch", lambda name: scratch)
    options = SimpleNamespace(call_limit=3.0, time_limit=2.0 if stored_values else None)
    system, schedule = SimpleNamespace(components={}), SimpleNamespace(order=[])
    case = SimpleNamespace(or_raise=lambda: (system, schedule), options=options)
    inputs = raised(
        runs._simulate_apart, case, tmp_path if stored_values else None, None, False
    )
    assert limits == [2.0 if stored_values else 3.0]
    if inputs[1] == (tmp_path if stored_values else scratch):
        outcome = inputs[0]
        inputs = (
            outcome
            if isinstance(outcome, str)
            else (outcome.status, outcome.message, outcome.code)
        )
    assert inputs == result
    assert scratch.exists() == (stored_values and not ended.exit_text)


@pytest.mark.parametrize(
    ("ended", "full", "status", "code", "message"),
    [
        (
            Ended({}, **DIED),
            "",
            "failed",
            Exit.COMPONENT,
            "a: stepping ended the process: SIGSEGV",
        ),
        (
            Ended({}, **HUNG),
            "",
            LATE,
            Exit.TIMEOUT,
            "a: stepping did not return within 2 s",
        ),
        (Ended({"error": (RunError, ("no", 4))}), "", "failed", Exit.COMPONENT, "no"),
        (Ended({}, signal=2), "", "interrupted", 130, "stopped by the user"),
        (Ended({}, signal=15, **HUNG), "", "interrupted", 143, "stopped by the user"),
        (Ended({}, signal=15), "disk full", "no space", Exit.SPACE, "{}: disk full"),
    ],
)
@pytest.mark.parametrize("files", ["series.h5", "series.h5.part", "both"])
@pytest.mark.parametrize("times", [[], [5.0], [5.0, 7.0, 9.0]])
def test_a_run_cut_short_says_how_far_it_came(
    monkeypatch, tmp_path, ended, full, status, code, message, files, times
):
    for name in ("series.h5", "series.h5.part") if files == "both" else (files,):
        (tmp_path / name).touch()
    opened, results = [], SimpleNamespace(times=lambda: np.array(times))
    monkeypatch.setattr(
        runs.Results, "open", lambda *args: opened.append(args) or results
    )
    monkeypatch.setattr(
        runs, "recover", lambda part, path, *_: opened.append((part, "recovered"))
    )
    unwritten = SimpleNamespace(lay_out=lambda layout: None, written=2)
    system = SimpleNamespace(start=5.0, step=2.0)
    outcome, _ = runs._cut_short(system, None, tmp_path, ended, ROWS, unwritten, full)
    path, part = tmp_path / "series.h5", tmp_path / "series.h5.part"
    expected_message = f"{message.format(path)}; {len(times)} rows are kept"
    assert (outcome.status, outcome.code, outcome.message) == (
        status,
        code,
        expected_message,
    )
    assert outcome.steps == max(0, len(times) - 1)
    if full:
        assert (opened, outcome.rows) == ([(part, 2)], 2)
    else:
        full_run = files == "series.h5"
        assert opened == ([] if full_run else [(part, "recovered")]) + [(path,)]
        assert outcome.rows is None


@pytest.mark.parametrize(
    ("seconds", "every"), [(1.0, 1), (0.1, 1), (2.6, 3), (10.0, 10)]
)
def test_a_checkpoint_is_saved_every_so_many_steps(
    monkeypatch, tmp_path, seconds, every
):
    def checkpoints(folder: Path, every: int, *_: object) -> None:
        raise AskedError(every)

    monkeypatch.setattr(step_case, "Checkpoints", checkpoints)
    options = Options(blocks=True, stop=20.0, substeps=1, checkpoint=seconds)
    with pytest.raises(AskedError) as requests:
        runs.simulate(runs.prepare("gyrostat/light", options), tmp_path)
    assert requests.value.args == (every,)


def test_the_time_of_a_run_is_that_of_its_steps(monkeypatch):
    results, stepping = [], step_case.stepping
    monkeypatch.setattr(
        step_case, "stepping", lambda *x: results.append(stepping(*x)) or results[0]
    )
    options = Options(blocks=True, stop=20.0, substeps=1)
    run = runs.simulate(runs.prepare("gyrostat/light", options))
    assert run.manifest.us_per_step == pytest.approx(
        1e6 * results[0].seconds / 20, abs=1.0
    )


@pytest.mark.parametrize("number", [1, 2, 15])
def test_a_run_that_a_signal_stops_says_which(monkeypatch, number):
    monkeypatch.setattr(step_case, "interruptible", lambda: nullcontext(lambda: number))
    options = Options(blocks=True, stop=20.0, substeps=1)
    case = runs.prepare("gyrostat/light", options)
    run = runs.simulate(case, partial=True)
    assert (run.manifest.status, run.code) == ("interrupted", 128 + number)
    assert run.manifest.message.startswith("stopped by the user at t = ")
    # a run of a study takes the study with it
    expected = KeyboardInterrupt if number == signal.SIGINT else SystemExit
    with pytest.raises(expected):
        runs.simulate(case)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "line",
    [
        "faults c -n 2 --stop 2orbits --jobs 1",
        "compare c --laws all --stop 6orbits",
        "size c",
        "sweep c manager.gain=1e-4,1e-3,2e-3,4e-3 --stop 6orbits --jobs 1",
        "bound c",
    ],
)
def test_a_signal_at_any_moment_ends_a_study(tmp_path, line, number):
    """Sent to the whole group of processes, as a terminal does, and to the first alone."""
    write(tmp_path / "c", CraftFacts(size="12U", rods="0.2"), "")
    draw = random.Random(f"{line} {number}")
    for stop in (os.kill, os.killpg):
        process = subprocess.Popen(
            [sys.executable, "-m", "desat.cli", *line.split()],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            cwd=tmp_path,
        )
        time.sleep(draw.uniform(0.7, 1.6))
        if process.poll() is None:
            stop(process.pid, number)
        began = time.monotonic()
        _, errors = process.communicate(timeout=60)
        assert process.returncode in (128 + number, -number), errors
        assert time.monotonic() - began < 5.0
        assert b"Traceback" not in errors


def test_a_run_whose_components_cannot_be_freed_ends_as_the_first(monkeypatch):
    ended, leave = (
        [EndedError("a hangs", Exit.TIMEOUT), EndedError("b died")],
        Master.__exit__,
    )

    def fail_to_free(self: Master, *values: object) -> None:
        leave(self, *values)
        self.unfreed = ended

    monkeypatch.setattr(Master, "__exit__", fail_to_free)
    run = runs.simulate(
        runs.prepare("gyrostat/light", Options(blocks=True, stop=20.0, substeps=1))
    )
    assert (run.manifest.status, run.code) == ("failed", Exit.TIMEOUT)
    assert run.manifest.message == "a hangs, after the run"


# --- a run's condition, a case's row, what draws record -------------------------------


@pytest.mark.parametrize(
    ("kind", "value", "result"),
    [
        ("Boolean", True, 1),
        ("Boolean", False, 0),
        ("Boolean", 1, "Boolean: true or false"),
        ("Integer", 3, 3),
        ("Integer", "b", 1),
        ("Integer", True, "is an Integer"),
        ("Integer", "bb", "no value bb; did you mean b?"),
        ("Real", 1, "a Real, which has below"),
    ],
)
def test_what_a_condition_may_reach(kind, value, result):
    signal = SimpleNamespace(kind=kind, array="mode", choices=["a", "b"])
    if isinstance(result, int):
        assert stopping._reaches(signal, value) == result
    else:
        with pytest.raises(DesatError, match=result):
            stopping._reaches(signal, value)


@pytest.mark.parametrize("seconds", [None, 5.0])
def test_the_time_is_over_after_it_and_not_at_it(monkeypatch, seconds):
    now = 10.0
    monkeypatch.setattr(stopping.time, "monotonic", lambda: now)
    ending = stopping.watch(SimpleNamespace(slots=[]), None, seconds)
    assert ending.kind == "never"
    for now, late in (14.9, False), (15.0, False), (math.nextafter(15.0, 16.0), True):  # noqa: B007
        assert ending.reason() == (LATE if late and seconds else "")


@pytest.mark.parametrize("interval", [True, False])
@pytest.mark.parametrize("algorithm", ["gauss_seidel", "jacobi"])
def test_a_condition_is_to_hold_for_its_time(interval, algorithm):
    """From the row that it holds at, which of an interval output began a step ago; anew
    where it was broken."""
    live = {"Real": np.array([0.0, 1.0])}
    x, y = (SimpleNamespace(name=name, series=name) for name in "xy")
    slot = SimpleNamespace(
        component="a", signal=x, kind="Real", index=1, interval=interval
    )
    others = [
        SimpleNamespace(component="b", signal=x),
        SimpleNamespace(component="a", signal=y),
    ]
    master = SimpleNamespace(
        slots=[*others, slot],
        live=live,
        start=3.0,
        step_size=0.1,
        k=0,
        algorithm=algorithm,
    )
    at_start = not (interval and algorithm == "gauss_seidel")
    ending = stopping.watch(
        master, Condition("a", "x", "below", 2.0, 0.3, "it is low"), None
    )
    assert (ending.watched, ending.limit, ending.kind) == ([slot], 2.0, "below")
    assert ending.memory == ({"since": 3.0} if at_start else {})
    met = []
    for k, value in enumerate((1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0), start=1):
        master.k, live["Real"][1] = k, value
        met.append(ending.reason())
    assert met == ["", "", "it is low" if at_start else "", "", "", "", "", "it is low"]
    live["Real"][1] = 9.0
    ending.reason()
    assert ending.memory == {}


def test_a_condition_that_has_just_held_long_enough_is_met():
    x = SimpleNamespace(name="x", series="x")
    slot = SimpleNamespace(
        component="a", signal=x, kind="Real", index=0, interval=False
    )
    master = SimpleNamespace(
        slots=[slot],
        live={"Real": np.array([1.0])},
        start=0.0,
        k=2,
        step_size=0.5,
        algorithm="gauss_seidel",
    )
    held = 1.0 + 1e-9
    assert held - 1e-9 == 1.0
    ending = stopping.watch(
        master, Condition("a", "x", "below", 2.0, held, "low"), None
    )
    assert ending.reason() == "low"
    master.step_size = math.nextafter(0.5, 0.0)
    assert ending.reason() == ""


class AskedError(Exception):
    """What a run was to record."""


@pytest.mark.parametrize(
    ("substeps", "record", "looks"),
    [
        ("auto", ("*",), True),
        (1, ("*",), False),
        (1, ("wheels.h_wheel",), None),
        ("auto", ("wheels.h_wheel",), None),
    ],
)
def test_draws_record_what_their_numbers_need(monkeypatch, substeps, record, looks):
    """And, where the run chooses its substeps, what that is looked at again with."""

    def simulate(case: object, choice: None) -> None:
        raise AskedError(case.options.record)

    monkeypatch.setattr(study, "simulate", simulate)
    options = Options(blocks=True, stop=20.0, substeps=substeps, record=record)
    with pytest.raises(AskedError) as requests:
        study.ran(study.read("gyrostat/light"), options, {})
    (found,) = requests.value.args
    if looks is None:
        assert found == record
    else:
        looked_at = {"spacecraft.omega_bi_body", "spacecraft.impulse_eci"}
        assert looked_at & set(found) == (looked_at if looks else set())
        assert {"spacecraft.q_bi", "wheels.h_wheel", "torquers.m_mean_body"} < set(
            found
        )


@pytest.mark.parametrize(
    ("error", "code"),
    [(DesatError("no"), 2), (RunError("no"), 4), (RunError("no", 128), 128), (None, 0)],
)
def test_a_case_that_cannot_begin_is_a_row(monkeypatch, error, code):
    def values(number: int) -> dict[str, float]:
        return {"a.k": 1.0}

    def ran(plan: object, values: object, supervised: bool) -> store.CaseRow:
        assert supervised is False
        if error:
            raise error
        return store.CaseRow("completed", 0, "", values=values)

    monkeypatch.setattr(campaign_case, "_ran", ran)
    result = campaign_case.row(SimpleNamespace(values=values), 7)
    assert (result.code, result.number, result.values) == (code, 7, {"a.k": 1.0})
    assert result.message == ("no" if error else "")
    assert result.status == ("failed" if error else "completed")
    assert 0.0 <= result.seconds < 1.0
    error = RunError("told to end", Exit.INTERRUPTED)
    with pytest.raises(SystemExit) as raised:
        campaign_case.row(SimpleNamespace(values=values), 7)
    assert raised.value.code == 130


@pytest.mark.parametrize(
    ("code", "raises"),
    [(0, False), (1, False), (4, False), (5, False), (6, True), (130, True)],
)
def test_a_case_that_is_kept_needs_room_and_no_signal(
    monkeypatch, tmp_path, code, raises
):
    written = []
    monkeypatch.setattr(campaign_case, "source", lambda plan: "a")
    monkeypatch.setattr(campaign_case, "prepare", lambda target, options: options)
    monkeypatch.setattr(campaign_case, "choose_for_cases", lambda *_: "once for all")

    def simulate(options: Options, into: Path, choice: str) -> Run:
        assert choice == "once for all"
        assert (options.supervised, options.call_limit) == (True, 9.0)
        assert options.values == {"a.k": 1.0}
        return finished(code)

    monkeypatch.setattr(campaign_case, "simulate", simulate)
    monkeypatch.setattr(
        campaign_case, "write_report", lambda *args: written.append(args[0])
    )
    of = plan.CampaignPlan("a", "", 3, limit=9.0)
    monkeypatch.setattr(plan.CampaignPlan, "values", lambda self, number: {"a.k": 1.0})
    if raises:
        with pytest.raises(RunError):
            campaign_case.repeat(of, 1, tmp_path)
    else:
        assert campaign_case.repeat(of, 1, tmp_path).code == code
    assert written == [tmp_path] * (not raises)


@pytest.mark.parametrize(
    ("values", "status"),
    [({}, "completed"), ({"timeout": True}, "timed out")],
)
def test_what_never_came_back_is_a_failed_row(values, status):
    result = study.lost_row(study.NoResult("why", **values))
    assert (result.status, result.message) == ("failed", "why")
    assert result.code == (Exit.TIMEOUT if values else Exit.COMPONENT)


# --- the range of the exchange --------------------------------------------------------


def test_a_number_at_the_limit_of_the_range_is_no_warning():
    limits = coverage.LIMITS
    assert (limits.turn, limits.kick, coverage.TOGETHER, coverage.JITTER) == (
        0.46,
        0.0076,
        0.0103,
        1e-6,
    )
    for scale in (1.0, 1.0 + 1e-9):
        assert (
            list(
                coverage._beyond(
                    coverage.StepCriteria(limits.turn * scale, limits.kick)
                )
            )
            == []
        )
    above = coverage.StepCriteria(limits.turn * (1.0 + 2e-9), limits.kick)
    assert list(coverage._beyond(above)) == [("turn", above.turn)]
    assert coverage._of_jitter(1e-6, "now") == []
    assert len(coverage._of_jitter(math.nextafter(1e-6, 1.0), "now")) == 1


PARTS = coverage.StepParts(
    ["a.q", "a.w", "w.h", "a.i"],
    np.eye(3, 4).tolist(),
    np.eye(3).tolist(),
    [0.01] * 4,
    0.0,
)


def remarked(
    turning=0.0, pushed=0.0, h=0.0, last=0.0, unbalance=0.0, lacking=(), **message
):
    """Remarks about rows of a body that reached so much, of wheels with momenta h to
    `last`."""
    found = coverage.Reached(
        np.array([0.0, 1.0, 2.0]),
        np.array([0.0, turning, 0.0]),
        np.array([0.0, pushed]),
        np.zeros(1),
    )
    results = SimpleNamespace(
        names=lambda: [x for x in PARTS.series if x not in lacking],
        values=lambda name: np.array([[h] * 4, [last] * 4]),
    )
    manifest = SimpleNamespace(
        substep_choice=None,
        parts={coverage.KEY: replace(PARTS, unbalance=unbalance)},
        algorithm="gauss_seidel",
        step=2.0,
        substeps=4,
    )
    vars(manifest).update(message)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            coverage, "of_run", lambda parts, results: None if lacking else found
        )
        return coverage.remarks(manifest, results)


def test_a_run_says_where_it_left_the_range():
    turn, kick = 0.46 / 0.5, 0.0103 / 0.25
    assert remarked(turn, kick) == []
    assert remarked(0.46 * (1.0 + 1e-9) / 0.5, 0.0103 * (1.0 + 1e-9) / 0.25) == []
    assert remarked(2.0 * turn, 2.0 * kick, lacking=["a.q"]) == []
    assert remarked(2.0 * turn, 2.0 * kick, algorithm="jacobi") == []
    line, other = remarked(turn * (1.0 + 3e-9), kick * (1.0 + 3e-9))
    assert line.startswith(
        "at t = 1 s, turn and nutation in a substep: 0.46 rad, accuracy"
    )
    assert other.startswith(
        "at t = 1 s, turn by the largest torque of all actuators in a substep"
    )


def test_a_run_says_how_much_the_jitter_of_faster_wheels_leaves():
    """8 unbalance Omega H / J of four wheels, where they turn once within a step and
    more."""
    assert remarked(h=1.0, last=1.9, unbalance=1e-9) == []
    assert remarked(h=1.0, last=2.0, unbalance=1e-9) == []
    (line,) = remarked(h=1.0, last=2.1, unbalance=1e-9)
    assert "attitude error of about 3.4e-06 rad, at their largest speeds" in line
    assert remarked(h=0.0, last=2.1, unbalance=1e-10) == []


def test_a_run_that_chose_says_what_it_could_not_look_at():
    flight = SubstepChoice(4, 1e-7, 5e-8, steps=30, reached=(1.0, 1.0, 1.0))
    assert remarked(substep_choice=flight) == []
    (line,) = remarked(substep_choice=flight, lacking=["a.w", "a.i"])
    assert line == (
        "its substeps are chosen by its first 30 steps, and not looked at again: "
        "not recorded: a.i, a.w"
    )
    assert remarked(substep_choice=replace(flight, reached=None), lacking=["a.w"]) == []
    assert remarked(substep_choice=flight, parts={coverage.KEY: None}) == []
    far = {"turning": 9.0, "pushed": 9.0}
    assert len(remarked(substep_choice=replace(flight, estimate=None), **far)) == 2
    assert remarked(substep_choice=flight, **far) == []


# --- the balances ---------------------------------------------------------------------


def manifest_with(**more: object) -> SimpleNamespace:
    """A manifest's part that balances look at."""
    usual = {
        "algorithm": "gauss_seidel",
        "step": 2.0,
        "substeps": 1,
        "about": {},
        "numbers": {},
        "parts": {},
        "balance": None,
    }
    return SimpleNamespace(**{**usual, **more})


def test_the_largest_residual_is_that_of_a_row(monkeypatch):
    off = np.array([[3.0, 0.0, 4.0], [0.0, -4.9, 0.0], [3.0, 0.0, 0.0]])
    series = residual.Momentum(np.arange(3.0), off, 7.0)
    monkeypatch.setattr(residual, "momentum", lambda *_: series)
    number = residual.numbers(None, None)["momentum_residual"]
    assert (number.value, number.unit) == (5.0, "N.m.s")
    assert residual.unchecked(None, None) == {}
    for algorithm, bound, lines in (
        ("gauss_seidel", None, 1),
        ("jacobi", None, 0),
        ("gauss_seidel", 5.0 / 7.0, 0),
        ("gauss_seidel", 0.7, 1),
    ):
        about = {} if bound is None else {"residual_bound": bound}
        manifest = manifest_with(
            numbers={"momentum_residual": number}, algorithm=algorithm, about=about
        )
        assert len(residual.unmet(manifest, None)) == lines
    at_bound = {"momentum_residual": Value("x", 7e-9, "N.m.s")}
    assert residual.unmet(manifest_with(numbers=at_bound), None) == []
    at_bound = {"momentum_residual": Value("x", 7.1e-9, "N.m.s")}
    assert len(residual.unmet(manifest_with(numbers=at_bound), None)) == 1
    monkeypatch.setattr(residual, "momentum", lambda *_: None)
    assert residual.unmet(manifest_with(), None) == []
    assert residual.numbers(None, None) == {}


def test_why_there_is_no_residual():
    parts = residual.MomentumParts("a", "w.h")
    series = [*(f"a.{n}" for n in ("q_bi", "omega_bi_body", "impulse_eci")), "w.h"]
    for names, reason in (
        (series, "there are no rows"),
        (series[1:], "not recorded: a.q_bi"),
        (series[2:], "not recorded: a.q_bi, a.omega_bi_body"),
    ):
        results = SimpleNamespace(
            names=lambda names=names: names, once=lambda key, make: None
        )
        manifest = manifest_with(parts={residual.KEY: parts})
        assert residual.unchecked(manifest, results) == {"momentum_residual": reason}


def test_totals_go_on_from_block_to_block(monkeypatch):
    blocks = [
        energy.Block(
            np.array([1.0, 4.0, 2.0]),
            np.array([2.5, -1.5]),
            np.array([[1.0, 0.0, 0.0], [0.0, 2.0, 0.0]]),
            np.array([0.1, 0.3]),
        ),
        energy.Block(
            np.array([2.0, 1.0]),
            np.array([-3.0]),
            np.array([[1.0, 0.0, 0.0]]),
            np.array([0.2]),
        ),
    ]
    impulses = [
        [[5.0, 0.0, 0.0], [6.0, 0.0, 3.0], [6.0, 2.0, 0.0]],
        [[6.0, 2.0, 0.0], [7.0, 2.0, -4.0]],
    ]
    monkeypatch.setattr(energy, "sums", lambda steps: blocks[steps.number])
    for outer in (None, object()):
        totals, found = energy.Totals(), []
        for k, impulse in enumerate(impulses):
            steps = SimpleNamespace(number=k, impulse=np.array(impulse), outer=outer)
            found.append(totals.add(steps))
            assert totals.start == 1.0
            assert totals.energy == 4.0
        assert [list(mismatch) for mismatch, _ in found] == [[0.5, 0.0], [2.0]]
        assert (totals.work, totals.worked, totals.mismatch) == (-2.0, 2.5, 2.0)
        assert (totals.hidden, totals.began) == (0.3, (5.0, 0.0, 0.0))
        assert totals.given == (2.0, 2.0, 0.0)
        assert totals.impulse == (4.0 if outer else None)
    blocks[0] = blocks[0]._replace(energy=np.array([5.0, 1.0, 1.0]))
    totals = energy.Totals()
    totals.add(SimpleNamespace(number=0, impulse=np.array(impulses[0]), outer=None))
    assert (totals.energy, totals.start, totals.mismatch) == (5.0, 5.0, 6.5)


@pytest.mark.parametrize(
    ("values", "share", "impulse"),
    [
        ({"energy": 2.0, "worked": 4.0}, 0.25, None),
        ({"energy": 8.0, "worked": 4.0}, 0.125, 0.5),
        ({}, None, 0.5),
        (None, None, None),
    ],
)
def test_the_numbers_of_a_balance(monkeypatch, values, share, impulse):
    result = (
        None
        if values is None
        else energy.Totals(mismatch=1.0, hidden=3.0, impulse=impulse, **values)
    )
    monkeypatch.setattr(energy, "totals_of", lambda *_: result)
    monkeypatch.setattr(energy, "_not_of_rows", lambda *_: "why")
    found = {name: n.value for name, n in energy.numbers(manifest_with(), None).items()}
    expected = {
        "energy_mismatch": share,
        "hidden_work": values is not None and 3.0,
        "impulse_mismatch": impulse,
    }
    assert found == {k: v for k, v in expected.items() if v}
    parts = energy.EnergyParts("a", "w.h")
    lacking = energy.unchecked(manifest_with(parts={energy.KEY: parts}), None)
    if values is None:
        assert lacking == dict.fromkeys(energy.NUMBERS, "why")
    else:
        assert list(lacking) == ["impulse_mismatch"] * (impulse is None)


def series_of(names: list[str], times: list[float], lacking: str = "", **counts: int):
    """Results with such series."""
    return SimpleNamespace(
        names=lambda: [n for n in names if n != lacking],
        once=lambda key, make: make(),
        times=lambda name: np.array(times if name == "a.q_bi" else [0.0, 99.0]),
        count=lambda name: counts.get(name.replace(".", "_"), len(times)),
    )


@pytest.mark.parametrize(
    ("more", "times", "lacking", "counts", "reason"),
    [
        ({}, [0.0, 2.0, 4.0], "", {}, ""),
        (
            {"algorithm": "jacobi"},
            [0.0, 2.0],
            "",
            {},
            "under jacobi torques act a step late",
        ),
        ({"why": "so"}, [0.0, 2.0], "", {}, "so"),
        ({}, [0.0, 2.0], "w.mean", {}, "not recorded: w.mean"),
        ({}, [0.0], "", {}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"w_mean": 0}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"a_q_bi": 1}, "there is no whole step"),
        ({}, [0.0, 2.0], "", {"w_mean": 1}, ""),
        ({}, [0.0, 4.0], "", {}, "its rows"),
        ({}, [0.0, 1.0], "", {}, "its rows"),
        ({}, [5.0, 7.0], "", {}, ""),
        ({"rows": False}, [0.0, 2.0], "", {}, "its rows"),
        ({"rows": None}, [0.0, 2.0], "", {}, ""),
        ({"rows": None, "substeps": 2}, [0.0, 2.0], "", {}, "its rows"),
    ],
)
def test_why_rows_have_no_balance(more, times, lacking, counts, reason):
    of = {k: more.pop(k) for k in ("why", "rows") if k in more}
    parts = energy.EnergyParts(
        "a", "w.h", "w.mean", "w.slope", None, **{"rows": True, **of}
    )
    results = series_of(energy.of_work(parts), times, lacking, **counts)
    found = energy._not_of_rows(
        manifest_with(parts={energy.KEY: parts}, **more), results
    )
    assert found.startswith(reason)
    assert bool(found) == bool(reason)


@pytest.mark.parametrize(
    ("hidden", "impulse", "about", "lines"),
    [
        (2e-8, 7e-6, {}, []),
        (2.1e-8, None, {}, ["hidden_work"]),
        (None, 7.1e-6, {}, ["impulse"]),
        (2.1e-8, 7.1e-6, {}, ["hidden_work", "impulse"]),
        (None, None, {}, []),
        (0.5, 3.5, {"energy_bound": 0.5, "impulse_bound": 0.5}, []),
        (
            0.6,
            3.6,
            {"energy_bound": 0.5, "impulse_bound": 0.5},
            ["hidden_work", "impulse"],
        ),
    ],
)
def test_a_balance_at_its_bound_is_met(monkeypatch, hidden, impulse, about, lines):
    series = residual.Momentum(np.zeros(1), np.zeros((1, 3)), 7.0)
    numbers = {"hidden_work": hidden, "impulse_mismatch": impulse}
    manifest = manifest_with(
        about=about,
        numbers={k: Value(k, v, "1") for k, v in numbers.items() if v is not None},
    )
    monkeypatch.setattr(residual, "momentum", lambda *_: series)
    assert [
        x[: len(y)] for x, y in zip(energy.unmet(manifest, None), lines, strict=True)
    ] == lines
    monkeypatch.setattr(residual, "momentum", lambda *_: None)
    assert len(energy.unmet(manifest, None)) == ("hidden_work" in lines)
    of_fixed = "impulse" in lines
    monkeypatch.setattr(
        fixed, "mismatch", lambda *_: None if impulse is None else (impulse, 7.0)
    )
    assert len(fixed.unmet(manifest, None)) == of_fixed
    found = fixed.numbers(manifest, None)
    assert {k: v.value for k, v in found.items()} == (
        {} if impulse is None else {"impulse_mismatch": impulse}
    )


@pytest.mark.parametrize(
    ("more", "times", "lacking", "reason"),
    [
        ({}, [0.0, 2.0], "", ""),
        (
            {"algorithm": "jacobi"},
            [0.0, 2.0],
            "",
            "under jacobi torques act a step late",
        ),
        ({"why": "so"}, [0.0, 2.0], "", "so"),
        ({}, [0.0, 2.0], "a.h_copy_wheel", "not recorded: a.h_copy_wheel"),
        ({}, [0.0], "", "there is no whole step"),
        ({}, [0.0, 4.0], "", "rows are left out"),
        ({}, [3.0, 5.0, 9.0], "", ""),
    ],
)
def test_why_a_fixed_attitude_has_no_balance(more, times, lacking, reason):
    parts = fixed.FixedAttitudeParts("a", {"x": "b.c"}, more.pop("why", ""))
    results = series_of(fixed.balanced(parts), times, lacking)
    manifest = manifest_with(parts={fixed.KEY: parts}, **more)
    assert fixed._reason_against(manifest, results) == reason
    assert fixed.unchecked(manifest, results) == (
        {"impulse_mismatch": reason} if reason else {}
    )
