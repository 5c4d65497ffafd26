"""A disk without room, in the process itself (full.c): what is said, and what is left of files."""

from __future__ import annotations

import errno
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import Command

from desat.campaign import store
from desat.engine.recording.results import Results
from desat.system.errors import Exit

MEANT = {errno.ENOSPC: "no space left on the disk", errno.EDQUOT: "the disk quota is used up"}


@pytest.fixture(scope="module")
def shim(tmp_path_factory) -> Path:
    """The library of full.c."""
    compiler = shutil.which("gcc") or shutil.which("cc")
    if compiler is None or sys.platform != "linux":
        pytest.skip("needs Linux and a C compiler")
    made = tmp_path_factory.mktemp("full") / "full.so"
    source = Path(__file__).with_name("full.c")
    subprocess.run([compiler, "-shared", "-fPIC", "-O1", "-o", made, source, "-ldl"], check=True)
    return made


@pytest.fixture
def limited(shim, apart, tmp_path) -> Command:
    """`desat` where the folder `out` takes so many new bytes (`most`)."""

    def run(*arguments: str, most: int, number: int = errno.ENOSPC):
        full = {"LD_PRELOAD": str(shim), "FULL_BELOW": str(tmp_path / "out"),
                "FULL_AFTER": str(most), "FULL_ERRNO": str(number),
                "FULL_USED": str(tmp_path / "used")}  # fmt: skip
        (tmp_path / "used").unlink(missing_ok=True)
        return apart(*arguments, "--out", str(tmp_path / "out"), env={**os.environ, **full})

    return run


RUN = ("run", "gyrostat/free", "--step", "0.01", "--stop", "100", "--no-twin")


def named(text: str) -> list[str]:
    """Lines but for the warning that the series may not fit."""
    return [line for line in text.splitlines() if "may take" not in line]


@pytest.mark.parametrize("number", MEANT)
def test_a_disk_that_fills_while_rows_are_written(limited, tmp_path, number):
    """As `test_a_full_disk`, where nobody may mount one: rows until then, manifest, no report, and
    no part of a CSV file, which it once was that the command spoke of, in place of the run."""
    done = limited(*RUN, "--csv", most=3_000_000, number=number)
    assert done.returncode == Exit.SPACE, done.stderr
    out, full = tmp_path / "out", MEANT[number]
    *warnings, last = named(done.stderr)
    assert warnings == [f"warning: {out}: it has no {what}: {full}"
                        for what in ("report", "series.csv")]  # fmt: skip
    assert {p.name for p in out.iterdir()} == {"manifest.json", "series.h5.part"}
    manifest = json.loads((out / "manifest.json").read_text())
    with Results.open(out) as results:
        times = results.times()
    assert 0 < len(times) < 10_000
    assert (manifest["status"], manifest["rows"]) == ("no space", len(times))
    assert last == f"no space: {out}/series.h5: {full}; {len(times)} rows are kept"
    assert times[-1] == pytest.approx(0.01 * (len(times) - 1))


def test_no_room_for_what_follows_a_run(limited, tmp_path):
    """It is named, and nothing is left of it."""
    given, out = (*RUN[:3], "0.05", *RUN[4:], "--csv"), tmp_path / "out"
    whole = limited(*given, most=1 << 40)
    assert whole.returncode == Exit.COMPLETED, whole.stderr
    sizes = {p.name: p.stat().st_size for p in out.iterdir()}
    used = int.from_bytes((tmp_path / "used").read_bytes(), "little")
    shutil.rmtree(out)
    done = limited(*given, most=used - sizes["series.csv"] // 2)
    assert (done.returncode, named(done.stderr)) == (
        Exit.SPACE, [f"error: {out}: its series.csv: no space left on the disk"])  # fmt: skip
    assert {p.name for p in out.iterdir()} == sizes.keys() - {"series.csv"}
    assert json.loads((out / "manifest.json").read_text())["status"] == "completed"
    shutil.rmtree(out)
    done = limited(*given, most=used - sizes["series.csv"] - sizes["report.html"] // 2)
    assert (done.returncode, named(done.stderr)) == (
        Exit.SPACE, [f"error: {out}: its report: no space left on the disk"])  # fmt: skip
    assert {p.name for p in out.iterdir()} == {"manifest.json", "series.h5"}


def test_a_campaign_names_the_file_and_goes_on(limited, tmp_path):
    given, out = ("campaign", "nadir_day/day-dipole", "-n", "3", "--stop", "5", "--jobs", "1"), []
    for most in (13_000, 1 << 40):
        done = limited(*given, most=most)
        out.append((done.returncode, done.stderr))
    full = f"error: {tmp_path}/out/journal.jsonl: No space left on device\n"
    assert out == [(Exit.SPACE, full), (Exit.COMPLETED, "")]
    rows = store.read(tmp_path / "out").to_pylist()
    assert [(r["case"], r["status"]) for r in rows] == [(k, "completed") for k in range(3)]
