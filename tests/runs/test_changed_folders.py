"""Run and campaign folders whose files were changed: values of other types, and series
of another run."""

from __future__ import annotations

import json
import random
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from desat.analyses import residual
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.runs.run import execute, load_run
from desat.system.errors import DesatError, Exit
from desat.system.options import Options
from tests.fuzz import commands

VALUES = (None, 0, "x", [], {})
TRIED = 6  # changes of each file


@pytest.fixture(scope="module")
def folders(tmp_path_factory) -> Path:
    """Two runs and a campaign of a 12U."""
    folder = tmp_path_factory.mktemp("changed")
    write(folder / "c", CraftFacts(size="12U", rods="0.2"), "")
    for name, stop in (("run", 100.0), ("other", 110.0)):
        execute(str(folder / "c"), Options(stop=stop), folder / name)
    options = ["-n", "2", "--stop", "100", "--out", "campaign", "--jobs", "1"]
    command = [sys.executable, "-m", "desat.cli", "campaign", "c", *options]
    subprocess.run(command, cwd=folder, capture_output=True, check=False)
    assert (folder / "campaign" / "numbers.json").exists()
    return folder


def places(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The places of all values below the top of a document."""
    all_places = [path] if path else []
    if isinstance(document, dict):
        for key, value in document.items():
            all_places += places(value, (*path, key))
    elif isinstance(document, list):
        for key, value in enumerate(document[:2]):
            all_places += places(value, (*path, key))
    return all_places


def change_value(document: Any, path: tuple[Any, ...], value: Any) -> str:
    """The text of a document with another value at a place."""
    document_copy = json.loads(json.dumps(document))
    owner = document_copy
    for key in path[:-1]:
        owner = owner[key]
    owner[path[-1]] = value
    return json.dumps(document_copy)


@pytest.mark.parametrize(
    ("folder", "file", "command"),
    [
        ("run", "manifest.json", ("report",)),
        ("run", "manifest.json", ("bound",)),
        ("campaign", "campaign.json", ("campaign", "report")),
        ("campaign", "numbers.json", ("campaign", "report")),
        ("campaign", "status.json", ("campaign", "report")),
    ],
)
def test_a_value_of_another_type_is_told(
    folders, tmp_path, desat, folder, file, command
):
    copy = tmp_path / folder
    shutil.copytree(folders / folder, copy)
    document = json.loads((copy / file).read_text())
    draw = random.Random(f"{folder} {file} {command}")
    for path in draw.sample(
        all_places := places(document), min(TRIED, len(all_places))
    ):
        value = draw.choice(VALUES)
        (copy / file).write_text(change_value(document, path, value))
        result = desat(*command, str(copy))
        assert result.returncode != Exit.BUG, (path, value, result.stderr)


@pytest.mark.parametrize("unit", [0, None, []])
def test_a_unit_that_is_no_text_is_named(folders, tmp_path, desat, unit):
    copy = tmp_path / "campaign"
    shutil.copytree(folders / "campaign", copy)
    document = json.loads((copy / "numbers.json").read_text())
    name = next(iter(document))
    document[name]["unit"] = unit
    (copy / "numbers.json").write_text(json.dumps(document))
    command = desat("campaign", "report", str(copy))
    assert command.returncode == Exit.INPUT
    assert f"numbers.json: damaged ({name}.unit: " in command.stderr


def test_a_manifest_without_connections_is_named(folders, tmp_path, desat):
    copy = tmp_path / "run"
    shutil.copytree(folders / "run", copy)
    document = json.loads((copy / "manifest.json").read_text())
    for value in (None, {"a.b": None}):
        (copy / "manifest.json").write_text(
            change_value(document, ("connections",), value)
        )
        command = desat("report", str(copy))
        assert command.returncode == Exit.INPUT
        assert "manifest.json" in command.stderr


@pytest.mark.parametrize("command", ["report", "export run", "compare", "bound"])
def test_series_of_another_run_are_refused(folders, tmp_path, desat, command):
    copy = tmp_path / "run"
    shutil.copytree(folders / "run", copy)
    shutil.copy(folders / "other" / "series.h5", copy / "series.h5")
    more = [str(folders / "other")] if command == "compare" else []
    result = desat(*command.split(), str(copy), *more)
    assert result.returncode == Exit.INPUT
    assert "its series are of another run" in result.stderr
    with pytest.raises(DesatError, match="its series are of another run"):
        load_run(copy)


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
    assert commands.run_line(line.split(), folder)[0] in (0, 1)
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
        code, message = commands.run_line(line.split(), bad.parent)
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


def _truncate(file):
    file.write_bytes(file.read_bytes()[:3000])


def _without_time(file):
    with h5py.File(file, "r+") as series:
        del series["time"]


def _time_stands_still(file):
    with h5py.File(file, "r+") as series:
        series["time"][3] = series["time"][2]


def _replace_series(value):
    def change(file):
        with h5py.File(file, "r+") as series:
            del series["spacecraft/q_bi"]
            series["spacecraft/q_bi"] = value

    return change


def _group_is_a_series(file):
    with h5py.File(file, "r+") as series:
        del series["spacecraft"]
        series["spacecraft"] = np.zeros(3)


@pytest.mark.parametrize(
    "change",
    [
        _truncate,
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
    with h5py.File(bad_run / "series.h5", "r+") as series:
        del series["spacecraft/q_bi"].attrs["unit"]
    line = "export run bad --format csv --out made"
    code, message = commands.run_line(line.split(), bad_run.parent)
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
        code, message = commands.run_line(line.split(), tmp_path)
        assert code in (0, 1), (line, message)
    page = (tmp_path / f"made-{name}.html").read_bytes().decode()
    assert ("ger\ufffdt" if name == "ger\udce4t" else "ger\u00e4t") in page
