"""Targets of make that are killed at random moments, and started again: the same files?

`python -m benchmarks.targets [TARGET [KILLS [SEED]]]` (demo, 6, 1) makes a copy of what
git has of this checkout, with its packages but without what was built, and runs
`make TARGET` there in a process group that is killed (SIGKILL) so many times at random
moments; then it is left to end. All files below fmus/ and ssp/ are compared with those
that the target makes in one go. With `--keep` what came of it goes to seen.json.
"""

from __future__ import annotations

import hashlib
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from . import seen

ROOT = Path(__file__).resolve().parents[1]
LONGEST = {"fmus": 30.0, "ssp": 90.0, "demo": 120.0}
"""A target is killed within so many seconds of its start."""


def copied(folder: Path) -> dict[str, str]:
    """A copy of the checkout without what is built; the environment in which `desat` is
    it."""
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
    )
    for name in listed.stdout.decode().split("\0"):
        if (ROOT / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, folder / name)
    names = folder / ".venv/names/desat"
    names.mkdir(parents=True)
    for entry in (ROOT / ".venv").iterdir():
        if entry.name not in ("names", ".installed"):
            (folder / ".venv" / entry.name).symlink_to(entry)
    for entry in (
        *(folder / "orchestrator").iterdir(),
        folder / "components",
        folder / "fmus",
    ):
        (names / entry.name).symlink_to(entry)
    (folder / ".venv/.installed").touch()  # newer than pyproject.toml
    cache, temporary = folder / "cache", folder / "tmp"
    temporary.mkdir()
    return {
        **os.environ,
        "PYTHONPATH": str(names.parent),
        "DESAT_CACHE": str(cache),
        "TMPDIR": str(temporary),
    }


def hashes(root: Path) -> dict[str, str]:
    """The sha256 of what is below fmus/ and ssp/, by path."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for part in ("fmus", "ssp")
        for path in (root / part).rglob("*")
        if path.is_file() and "__pycache__" not in path.parts
    }


def make(
    target: str, folder: Path, environment: dict[str, str], until: float | None
) -> float:
    """Run a target, which is killed after so many seconds; how long it took, negative
    where it was killed. Raises CalledProcessError where it ends otherwise than well."""
    began = time.monotonic()
    with (folder / "log").open("w") as log:
        command = ["make", "-C", str(folder), target]
        process = subprocess.Popen(
            command, env=environment, stdout=log, stderr=log, start_new_session=True
        )
        try:
            process.wait(until)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            return began - time.monotonic()
    if process.returncode:
        print((folder / "log").read_text()[-2000:])
        raise subprocess.CalledProcessError(process.returncode, command)
    return time.monotonic() - began


def tried(target: str, kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """What is there when a target was killed so many times, and then ended."""
    chance, killed = random.Random(seed), list[float]()
    environment = copied(folder)
    inputs = hashes(folder)
    while len(killed) < kills:
        seconds = make(
            target, folder, environment, chance.uniform(1.0, LONGEST[target])
        )
        if seconds > 0.0:  # it was quicker
            break
        killed.append(round(-seconds, 1))
        print(
            f"killed after {killed[-1]} s; {len(hashes(folder)) - len(inputs)} files",
            flush=True,
        )
    make(target, folder, environment, None)
    broken = hashes(folder)
    for path in broken.keys() - inputs.keys():
        (folder / path).unlink()
    seconds = make(target, folder, environment, None)
    full = hashes(folder)
    names = sorted(broken.keys() | full.keys())
    return {
        "killed_after": killed,
        "files": len(full.keys() - inputs.keys()),
        "different": [
            n for n in names if ".part" not in n and broken.get(n) != full.get(n)
        ],
        "parts": [n for n in names if ".part" in n],
        "seconds": round(seconds, 1),
    }


def main() -> int:
    """One target; 1 where a file is another."""
    keep = seen.is_writing()
    target, kills, seed = (*sys.argv[1:], *("demo", "6", "1")[len(sys.argv) - 1 :])[:3]
    with tempfile.TemporaryDirectory() as folder:
        found = tried(target, int(kills), int(seed), Path(folder))
    for name, subject in found.items():
        print(f"{name}: {subject}")
    if keep:
        seen.keep("targets", target, found)
    return int(bool(found["different"]))


if __name__ == "__main__":
    sys.exit(main())
