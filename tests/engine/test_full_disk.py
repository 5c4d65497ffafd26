"""A disk without room, in the process itself (full.c): what is said, and what is left
of files."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from desat.engine.recording.results import Results
from desat.system.errors import Exit
from tests.conftest import ROOT, Command, python

MEANT = {
    errno.ENOSPC: "no space left on the disk",
    errno.EDQUOT: "the disk quota is used up",
}


@pytest.fixture(scope="module")
def shim(tmp_path_factory) -> Path:
    """The library of full.c."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    library = tmp_path_factory.mktemp("full") / "full.so"
    source = ROOT / "tests" / "full.c"
    subprocess.run(
        [compiler, "-shared", "-fPIC", "-O1", "-o", library, source, "-ldl"], check=True
    )
    return library


def full(
    shim: Path, folder: Path, below: str, most: int, number: int = errno.ENOSPC
) -> dict[str, str]:
    """The environment in which what is `below` a folder takes so many new bytes."""
    (folder / "used").unlink(missing_ok=True)
    return {
        "LD_PRELOAD": str(shim),
        "FULL_BELOW": str(folder / below),
        "FULL_AFTER": str(most),
        "FULL_ERRNO": str(number),
        "FULL_USED": str(folder / "used"),
    }


@pytest.fixture
def limited_command(shim, apart, tmp_path) -> Command:
    """`desat` where the folder `out` takes so many new bytes (`most`)."""

    def run(*arguments: str, most: int, number: int = errno.ENOSPC):
        values = {**os.environ, **full(shim, tmp_path, "out", most, number)}
        return apart(*arguments, "--out", str(tmp_path / "out"), env=values)

    return run


RUN = ("run", "gyrostat/free", "--step", "0.01", "--stop", "300", "--no-baseline")


def shorten_lines(text: str) -> list[str]:
    """Lines but for the warning that the series may not fit."""
    return [line for line in text.splitlines() if "may take" not in line]


@pytest.mark.parametrize("number", MEANT)
def test_a_disk_that_fills_while_rows_are_written(limited_command, tmp_path, number):
    """As `test_a_full_disk`, where nobody may mount one: rows until then, manifest, no
    report, and no part of a CSV file, which it once was that the command spoke of, in
    place of the run."""
    command = limited_command(*RUN, "--csv", most=12_000_000, number=number)
    assert command.returncode == Exit.SPACE, command.stderr
    out, text = tmp_path / "out", MEANT[number]
    *warnings, last = shorten_lines(command.stderr)
    assert warnings == [
        f"warning: {out}: it has no {subject}: {text}"
        for subject in ("report", "series.csv")
    ]
    assert {p.name for p in out.iterdir()} == {"manifest.json", "series.h5.part"}
    manifest = json.loads((out / "manifest.json").read_text())
    with Results.open(out) as results:
        times = results.times()
    assert 0 < len(times) < 30_000
    assert (manifest["status"], manifest["rows"]) == ("no space", len(times))
    assert last == f"no space: {out}/series.h5: {text}; {len(times)} rows are kept"
    assert times[-1] == pytest.approx(0.01 * (len(times) - 1))


def test_no_room_for_what_follows_a_run(limited_command, tmp_path):
    """It is named, and nothing is left of it."""
    cases, out = (*RUN[:3], "1", *RUN[4:], "--csv"), tmp_path / "out"
    full = limited_command(*cases, most=1 << 40)
    assert full.returncode == Exit.COMPLETED, full.stderr
    sizes = {p.name: p.stat().st_size for p in out.iterdir()}
    used = int.from_bytes((tmp_path / "used").read_bytes(), "little")
    shutil.rmtree(out)
    command = limited_command(*cases, most=used - sizes["series.csv"] // 2)
    assert (command.returncode, shorten_lines(command.stderr)) == (
        Exit.SPACE,
        [f"error: {out}: its series.csv: no space left on the disk"],
    )
    assert {p.name for p in out.iterdir()} == sizes.keys() - {"series.csv"}
    assert json.loads((out / "manifest.json").read_text())["status"] == "completed"


def test_a_campaign_names_its_journal(shim, tmp_path):
    script = f"""
from pathlib import Path
from desat.campaign.store import Batch, CaseRow, Store
store = Store(Path({str(tmp_path / "out")!r}), 3)
row = CaseRow("completed", 0, 3000 * "1", number=0)
try:
    store.add(Batch.of([row]))
except OSError as error:
    print(error.errno, error.filename)
"""
    script_run = python(
        script,
        env={**os.environ, **full(shim, tmp_path, "out/cases/part-00000.jsonl", 100)},
    )
    assert (
        script_run.stdout == f"{errno.ENOSPC} {tmp_path}/out/cases/part-00000.jsonl\n"
    )
