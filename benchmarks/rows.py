"""The first 20 cases of a scenario of every family: are a campaign's rows the same bits
as those of another checkout's code?

    python -m benchmarks.rows OTHER/.venv/bin/python [--keep]    # `--keep`: into seen.json
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pyarrow as pa

from desat.campaign import store

from . import seen

NAMES = (
    "alsat1/basin-y-wheel",
    "hausat2/start-up-ours",
    "integrated/mil-nadir",
    "nadir_day/day-dipole",
    "nadir_day/day-igrf",
    "space_telescope/ours-nominal",
    "uosat12/robust-ocdc-nominal",
)
CASES = 20


def rows(python: str, name: str, folder: Path) -> pa.Table:
    """The rows of a campaign of that code, but for what is of the machine and the
    versions."""
    command = [
        python,
        "-m",
        "desat.cli",
        "campaign",
        name,
        "-n",
        str(CASES),
        "--jobs",
        "2",
        "--out",
        str(folder),
    ]
    subprocess.run(
        command, check=False, capture_output=True, cwd=Path(python).parents[2]
    )
    table = store.read(folder)
    return table.select([n for n in table.column_names if n not in store.BOOKKEEPING])


def differences(ours: pa.Table, theirs: pa.Table) -> list[str]:
    """The columns that one lacks, or that differ."""
    names = sorted(set(ours.column_names) | set(theirs.column_names))
    both = set(ours.column_names) & set(theirs.column_names)
    return [
        n
        for n in names
        if n not in both or repr(ours[n].to_pylist()) != repr(theirs[n].to_pylist())
    ]


def largest(ours: pa.Table, theirs: pa.Table) -> float:
    """The largest difference of a number that both have, relative to the larger of the
    two."""
    worst = 0.0
    for name in set(ours.column_names) & set(theirs.column_names):
        for x, y in zip(ours[name].to_pylist(), theirs[name].to_pylist(), strict=True):
            if isinstance(x, float) and isinstance(y, float) and x != y:
                worst = max(worst, abs(x - y) / max(abs(x), abs(y)))
    return worst


def _revision(python: str) -> str:
    command = ["git", "rev-parse", "--short", "HEAD"]
    done = subprocess.run(
        command, cwd=Path(python).parents[2], check=True, capture_output=True, text=True
    )
    return done.stdout.strip()


def main() -> int:
    """Compare each; 1 where something differs."""
    keep, other = seen.is_writing(), sys.argv[1]
    revisions = [_revision(python) for python in (sys.executable, other)]
    found: dict[str, Any] = {}
    for name in NAMES:
        with TemporaryDirectory() as folder:
            ours, theirs = (
                rows(python, name, Path(folder) / str(i))
                for i, python in enumerate((sys.executable, other))
            )
        found[name] = {
            "cases": len(ours),
            "columns": len(ours.column_names),
            "differing": differences(ours, theirs),
            "largest": largest(ours, theirs),
            "of": revisions[0],
            "other": revisions[1],
        }
        print(name, found[name], flush=True)
        if keep:
            seen.keep("rows", name, found[name])
    return int(any(x["differing"] for x in found.values()))


if __name__ == "__main__":
    sys.exit(main())
