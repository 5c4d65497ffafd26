"""CONTRIBUTING says which file a change touches: three changes, made in a copy of the
tree."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

TABLE = dict(
    re.findall(r"^\| ([^|]+?) \| `(\S+)`", (ROOT / "CONTRIBUTING.md").read_text(), re.M)
)
SCENARIO = """extends = "plant/light"
[numbers.first]
title = "Rate at the start"
signal = "spacecraft.omega_bi_body"
measure = "norm_first"
unit = "rad/s"
"""
MEASURE = '''

@measure
def norm_first(times: Array, values: Array) -> float:
    """The size of a vector at the start."""
    return float(np.linalg.norm(values[0]))
'''


@pytest.fixture
def tree(tmp_path) -> Path:
    """A copy of orchestrator/ under its import name, the other folders beside it as
    links."""
    shutil.copytree(ROOT / "orchestrator", tmp_path / "desat")
    for name in ("components", "fmus"):
        (tmp_path / "desat" / name).symlink_to(ROOT / name)
    for name in ("components", "fmus", "ssp", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    return tmp_path


def change_file(tree: Path, change: str, old: str, new: str) -> None:
    """Replace a text in the file that CONTRIBUTING names for a change."""
    file = tree / TABLE[change].replace("orchestrator/", "desat/")
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new, 1), encoding="utf-8")


def command(tree: Path, *arguments: str) -> None:
    subprocess.run(
        [sys.executable, "-m", "desat.cli", *arguments],
        cwd=tree / "here",
        check=True,
        capture_output=True,
        env={**os.environ, "PYTHONPATH": str(tree)},
    )


def test_every_file_of_the_table_is_there():
    assert TABLE
    assert [file for file in TABLE.values() if not (ROOT / file).is_file()] == []


def test_a_measure_a_field_of_the_manifest_and_a_colour_are_a_change_of_one_file_each(
    tree,
):
    measures = tree / TABLE["a new measure"].replace("orchestrator/", "desat/")
    measures.write_text(
        measures.read_text(encoding="utf-8") + MEASURE, encoding="utf-8"
    )
    message = "a field of the manifest"
    change_file(
        tree,
        message,
        '    platform: str = ""\n',
        '    planned: int = 0\n    platform: str = ""\n',
    )
    change_file(
        tree,
        message,
        "step=system.step,",
        "step=system.step, planned=system.steps + 1,",
    )
    change_file(tree, "a colour of plots", "#244c6e", "#123456")
    (tree / "here").mkdir()
    (tree / "here" / "mine.toml").write_text(SCENARIO)
    command(tree, "run", "mine.toml", "--stop", "5", "--blocks", "--out", "run")
    manifest = json.loads((tree / "here" / "run" / "manifest.json").read_text())
    steps = round((manifest["stop"] - manifest["start"]) / manifest["step"])
    assert manifest["planned"] == steps + 1
    assert manifest["numbers"]["first"]["value"] > 0.0
    report = (tree / "here" / "run" / "report.html").read_text()
    assert "#123456" in report
    assert "#244c6e" not in report
