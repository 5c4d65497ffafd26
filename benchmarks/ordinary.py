"""An ordinary user without a home directory, in several locales, in folders with spaces
and umlauts: do commands end well, two runs at once in one folder, too?

`python -m benchmarks.ordinary [PLACE ...]` (all) makes them as uid 65534, who owns
nothing but the folder that he works in and a temporary one, and prints a line each; it
needs root and setpriv, to become another user, and says so where they are not. He may
read all, as Python may be in a folder of root's, and write nothing that is not his.
With `--keep` what came of it goes to seen.json.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from desat.engine.recording.results import Results

from . import seen

USER = 65534
BECOME = (
    "setpriv",
    f"--reuid={USER}",
    f"--regid={USER}",
    "--clear-groups",
    "--inh-caps=+dac_read_search",
    "--ambient-caps=+dac_read_search",
)
RUN = ("run", "nadir_day/day-dipole", "--stop", "20")
OTHERS = (
    ("list",),
    ("check", "nadir_day/day-dipole"),
    (
        "run",
        "nadir_day/day-dipole",
        "--stop",
        "20",
        "--checkpoint",
        "5",
        "--out",
        "c ö",
    ),
    ("campaign", "nadir_day/day-dipole", "-n", "2", "--stop", "20"),
)
PLACES: dict[str, tuple[dict[str, str], str]] = {
    "HOME unset, LC_ALL=C": ({"LC_ALL": "C"}, "Größe und Maß"),
    "HOME empty, LC_ALL=POSIX": (
        {"HOME": "", "LC_ALL": "POSIX", "PYTHONUTF8": "0"},
        "ö ü",
    ),
    "HOME not there, LC_ALL=C.UTF-8": (
        {"HOME": "/nowhere", "LC_ALL": "C.UTF-8"},
        "Größe und Maß",
    ),
    "HOME another's": ({"HOME": "/root"}, "a b c"),
}
"""Environments, and the folder in which he works."""


def started(
    folder: Path, environment: dict[str, str], *values: str
) -> subprocess.Popen[str]:
    """A command of his."""
    return subprocess.Popen(
        [*BECOME, sys.executable, "-m", "desat.cli", *values],
        cwd=folder,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        errors="replace",
        env={
            "PATH": os.environ["PATH"],
            "TMPDIR": str(folder.parent / "tmp ö"),
            **environment,
        },
    )


def ended(processes: list[subprocess.Popen[str]]) -> list[tuple[int, str]]:
    """Their codes, and what they said on standard error."""
    return [
        (p.returncode, message) for p in processes for _, message in (p.communicate(),)
    ]


def tried(environment: dict[str, str], name: str, root: Path) -> dict[str, Any]:
    """What came of all commands in one environment: how many, and what was not as it
    should be."""
    folder, wrong = root / name, []
    for new in (folder, root / "tmp ö"):
        new.mkdir()
        os.chown(new, USER, USER)
    both = ended([started(folder, environment, *RUN) for _ in range(2)])
    wrong += [
        f"two at once: {code} {message}" for code, message in both if code or message
    ]
    results = [Results.open(p.parent) for p in sorted(folder.glob("runs/*/series.h5"))]
    bits = {r.values("wheels.h_wheel").tobytes() for r in results}
    if (len(results), len(bits)) != (2, 1):
        wrong.append(
            f"two at once made {len(results)} runs, {len(bits)} of them different"
        )
    one = ended([started(folder, environment, *RUN, "--out", "one") for _ in range(2)])
    if (
        sorted(code for code, _ in one) != [0, 2]
        or not (folder / "one/report.html").exists()
    ):
        wrong.append(f"two at once into one folder: {one}")
    for inputs in OTHERS:
        ((code, message),) = ended([started(folder, environment, *inputs)])
        if code or [x for x in message.splitlines() if not x.startswith("note: ")]:
            wrong.append(f"{inputs[0]}: {code} {message}")
    remaining = [
        p.name for p in (root / "tmp ö").iterdir() if p.name != f"desat-cache-{USER}"
    ]
    wrong += [f"left in the temporary folder: {remaining}"] if remaining else []
    return {"commands": 4 + len(OTHERS), "wrong": wrong}


def main() -> int:
    """A line an environment; 1 where something was not as it should be."""
    keep, bad = seen.is_writing(), False
    arguments = sys.argv[1:] or PLACES
    if (
        not shutil.which("setpriv")
        or subprocess.run([*BECOME, "true"], check=False).returncode
    ):
        print("skipped: it needs root and setpriv, to become another user")
        return 0
    for name in arguments:
        environment, place = PLACES[name]
        with tempfile.TemporaryDirectory() as folder:
            os.chmod(folder, 0o755)
            found = tried(environment, place, Path(folder))
        print(f"{name}, in {place!r}: {found}", flush=True)
        bad = bad or bool(found["wrong"])
        if keep:
            seen.keep("ordinary", f"{name}, in `{place}`", found)
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
