"""The way of a target to its run: no longer than it was.

A limit rises only for a check that is new.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import ROOT

SSP = "the .ssp of nadir_day/day-dipole"
LIMITS = {
    # target -> functions, all calls
    "uosat12/table3-ocdc-ilqr-1": (292, 13_550),
    "nadir_day/day-dipole": (319, 10_250),
    "space_telescope/ours-nominal": (435, 58_200),
    SSP: (323, 12_400),
}


def count_calls(target: str, folder: Path) -> dict[str, int]:
    """The counts of a target, in a process of its own: what another one has read or
    imported is not counted."""
    empty = (
        folder / "tmp"
    )  # what others have left in the usual one is swept, which would count
    empty.mkdir(exist_ok=True)
    process = subprocess.run(
        [sys.executable, str(ROOT / "tests" / "way.py"), target],
        text=True,
        capture_output=True,
        check=True,
        cwd=folder,
        env={**os.environ, "TMPDIR": str(empty)},
    )
    counts: dict[str, int] = json.loads(process.stdout)
    return counts


@pytest.mark.parametrize("target", LIMITS)
def test_the_way_of_a_target_does_not_grow(target, tmp_path, desat):
    place = target
    if target == SSP:
        file = (
            tmp_path / "day.toml"
        )  # what is packed of a file of one's own lies beside it
        file.write_text('extends = "nadir_day/day-dipole"\n')
        desat("pack", str(file), check=True)
        place = str(file.with_suffix(".ssp"))
    count_calls(
        place, tmp_path
    )  # what is made once for a user, the loop's library, is there
    counts = count_calls(place, tmp_path)
    functions, total = LIMITS[target]
    assert counts["functions"] <= functions, counts
    assert counts["total"] <= total, counts
