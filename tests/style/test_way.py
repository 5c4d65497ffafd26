"""The way of a target to its run, without the checks: no longer than it was.

A limit never rises.
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
    # target -> functions to the prepared run
    "uosat12/table3-ocdc-ilqr-1": 149,
    "nadir_day/day-dipole": 145,
    "space_telescope/ours-nominal": 170,
    SSP: 125,
}


def count_functions(target: str, folder: Path) -> int:
    """The functions on the way of a target, in a process of its own: what another one
    has read or imported is not counted."""
    empty = (
        folder / "tmp"
    )  # what others have left in the usual one is swept, which would count
    empty.mkdir(exist_ok=True)
    done = subprocess.run(
        [sys.executable, str(ROOT / "tests" / "way.py"), target, "spine"],
        text=True,
        capture_output=True,
        check=True,
        cwd=folder,
        env={**os.environ, "TMPDIR": str(empty)},
    )
    functions: int = json.loads(done.stdout)["functions"]
    return functions


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
    # what is made once for a user, the loop's library, is there
    count_functions(place, tmp_path)
    assert count_functions(place, tmp_path) <= LIMITS[target]
