"""Runs with checkpoints that are killed at random moments, and go on: the bits of a run
without a break?

`python -m benchmarks.killed [COUNT [SEED]]` (100, 1) makes so many of them and prints a
line each. With `--keep` what came of it goes to seen.json.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py

from desat.engine import checkpoint

from . import seen

TARGET, STOP, EVERY = "nadir_day/day-igrf", 2000, 40
OF_WALL_TIME = {"started", "wall_seconds", "us_per_step", "seal"}


def series(folder: Path) -> dict[str, tuple[Any, ...]]:
    """All that the series of a run folder hold."""
    found = {}

    def add(name: str, of: h5py.Dataset | h5py.Group) -> None:
        if isinstance(of, h5py.Dataset):
            value = of[()]
            data = value if isinstance(value, bytes) else value.tobytes()
            own_value = {
                k: v for k, v in of.attrs.items() if isinstance(v, str | bytes)
            }
            found[name] = (of.dtype.str, of.shape, data, own_value)

    with h5py.File(folder / "series.h5") as file:
        file.visititems(add)
    return found


def differences(one: Path, other: Path) -> list[str]:
    """What differs between two run folders, but for wall times."""
    ours, theirs = series(one), series(other)
    assert len(ours) > 5
    manifests = [json.loads((x / "manifest.json").read_text()) for x in (one, other)]
    lines = [
        f"series {n}"
        for n in ours.keys() | theirs.keys()
        if ours.get(n) != theirs.get(n)
    ]
    for key in set().union(*manifests) - OF_WALL_TIME:
        if manifests[0].get(key) != manifests[1].get(key):
            lines.append(f"manifest {key}")
    return lines


def command(*values: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "desat.cli", *values],
        text=True,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def children(process: int) -> list[int]:
    text = Path(f"/proc/{process}/task/{process}/children").read_text()
    return [int(x) for x in text.split()]


def kill(process: subprocess.Popen[str], whom: str) -> None:
    """Both processes of a run, the one that waits, or the one that steps."""
    with suppress(ProcessLookupError, FileNotFoundError):
        if whom == "both":
            os.killpg(process.pid, signal.SIGKILL)
        for number in [process.pid] if whom == "parent" else children(process.pid):
            os.kill(number, signal.SIGKILL)


def trials(
    count: int, values: tuple[str, ...], folder: Path, seed: int
) -> Iterator[str]:
    """Runs that are killed at random moments, and again while they go on, until one is
    left to complete. Of each how it went; it begins with `equal` where nothing
    differs."""
    chance = random.Random(seed)
    began = time.monotonic()
    error = command("run", *values, "--out", str(folder / "whole")).communicate()[1]
    assert (folder / "whole/report.html").exists(), error
    seconds = time.monotonic() - began
    i = remaining = count
    while remaining:
        i += 1
        place, kills, started = folder / str(i), [], False
        for attempt in range(4):
            whom = chance.choice(("both", "parent", "child"))
            verb = (
                ("resume", str(place))
                if started
                else ("run", *values, "--out", str(place))
            )
            process = command(*verb)
            moment = chance.uniform(0.3, 0.9) * seconds if attempt < 3 else 600.0
            with suppress(subprocess.TimeoutExpired):
                process.wait(moment)
            if process.poll() is None:
                kill(process, whom)
                kills.append(f"{whom} at {moment:.2f} s")
            error = process.communicate()[1]
            if process.returncode == 0 or error.strip().endswith("it has completed"):
                break
            assert "Traceback" not in error, error
            assert "internal" not in error, error
            started = started or checkpoint.newest(place) is not None
            if not started:  # killed before there was anything: it begins anew
                place = folder / f"{i}-{attempt + 1}"
        done = (place / "report.html").exists()
        found = differences(folder / "whole", place) if done else [error]
        if kills:  # else it was too quick, and is no trial
            remaining -= 1
            yield f"{'; '.join(found) or 'equal'}: killed {', '.join(kills)}"


def main() -> int:
    """So many trials, by the seed that is given next; 1 where one differs."""
    keep = seen.is_writing()
    count, seed = (*map(int, sys.argv[1:]), *(100, 1)[len(sys.argv) - 1 :])[:2]
    cases = (TARGET, "--stop", str(STOP), "--checkpoint", str(EVERY), "--no-baseline")
    result = equal = kills = 0
    with tempfile.TemporaryDirectory() as folder:
        for line in trials(count, cases, Path(folder), seed):
            result += 1
            equal += line.startswith("equal")
            kills += line.count(" at ")
            print(line, flush=True)
            if keep:
                seen.keep(
                    "killed",
                    f"seed {seed}",
                    {"runs": result, "equal": equal, "kills": kills},
                )
    print(f"{equal} of {count} equal to the run without a break, killed {kills} times")
    return int(equal < count)


if __name__ == "__main__":
    sys.exit(main())
