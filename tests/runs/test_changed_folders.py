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

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.runs.run import Options, execute, load_run
from desat.system.errors import DesatError, Exit

VALUES = (None, 0, "x", [], {})
TRIED = 25  # changes of each file


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
    found = [path] if path else []
    if isinstance(document, dict):
        for key, value in document.items():
            found += places(value, (*path, key))
    elif isinstance(document, list):
        for key, value in enumerate(document[:2]):
            found += places(value, (*path, key))
    return found


def changed(document: Any, path: tuple[Any, ...], value: Any) -> str:
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
        (copy / file).write_text(changed(document, path, value))
        done = desat(*command, str(copy))
        assert done.returncode != Exit.BUG, (path, value, done.stderr)


@pytest.mark.parametrize("unit", [0, None, []])
def test_a_unit_that_is_no_text_is_named(folders, tmp_path, desat, unit):
    copy = tmp_path / "campaign"
    shutil.copytree(folders / "campaign", copy)
    document = json.loads((copy / "numbers.json").read_text())
    name = next(iter(document))
    document[name]["unit"] = unit
    (copy / "numbers.json").write_text(json.dumps(document))
    done = desat("campaign", "report", str(copy))
    assert done.returncode == Exit.INPUT
    assert f"numbers.json: damaged ({name}.unit: " in done.stderr


def test_a_manifest_without_connections_is_named(folders, tmp_path, desat):
    copy = tmp_path / "run"
    shutil.copytree(folders / "run", copy)
    document = json.loads((copy / "manifest.json").read_text())
    for value in (None, {"a.b": None}):
        (copy / "manifest.json").write_text(changed(document, ("connections",), value))
        done = desat("report", str(copy))
        assert done.returncode == Exit.INPUT
        assert "manifest.json" in done.stderr


@pytest.mark.parametrize("command", ["report", "export run", "compare", "bound"])
def test_series_of_another_run_are_refused(folders, tmp_path, desat, command):
    copy = tmp_path / "run"
    shutil.copytree(folders / "run", copy)
    shutil.copy(folders / "other" / "series.h5", copy / "series.h5")
    more = [str(folders / "other")] if command == "compare" else []
    done = desat(*command.split(), str(copy), *more)
    assert done.returncode == Exit.INPUT
    assert "its series are of another run" in done.stderr
    with pytest.raises(DesatError, match="its series are of another run"):
        load_run(copy)
