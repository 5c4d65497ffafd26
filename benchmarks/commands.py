"""What commands cost: CPU (user and system) and wall seconds, the least of five, in
turn, over those of importing what all of them need.

Each is run in an empty folder, once before it counts, so that bytecode and the lists of
scenarios are kept as after a first use; of `list_first` the lists are not. Commands of
a user's own craft take a 12U of `desat new craft` for CRAFT.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rich.progress import track

HERE = Path(__file__).parent
BASILISK = HERE.parent / ".venv-basilisk" / "bin" / "python"
ROUNDS = 5
BASE = "import numpy, h5py, lxml.etree, typer, rich"
FIRST = "list_first"
CRAFT = "CRAFT"  # of a command line: the folder of a craft
NEW_CRAFT = [
    "--size",
    "12U",
    "--altitude",
    "400km",
    "--inclination",
    "51.6deg",
    "--rods",
    "0.2",
]


def commands() -> dict[str, list[str]]:
    """The command lines by name; `base` is what the others are compared with."""
    desat = [sys.executable, "-m", "desat.cli"]
    results = {
        "base": [sys.executable, "-c", BASE],
        "help": [*desat, "--help"],
        "list": [*desat, "list"],
        FIRST: [*desat, "list"],
        "check": [*desat, "check", "uosat12/table3-ocdc-ilqr-1"],
        "run_60_steps": [*desat, "run", "uosat12/table3-ocdc-ilqr-1"],
        "run_day": [*desat, "run", "nadir_day/day-dipole"],
        "tables": [*desat, "tables", "uosat12"],
        "own_run": [*desat, "run", CRAFT],
        "own_compare": [*desat, "compare", CRAFT, "--laws", "all", "--stop", "6orbits"],
        "own_campaign": [*desat, "campaign", CRAFT, "-n", "20"],
        "own_size": [*desat, "size", CRAFT],
        "make_ssp": ["make", "-C", str(HERE.parent), "ssp"],
    }
    if BASILISK.exists():
        results["basilisk_day"] = [
            str(BASILISK),
            str(HERE / "basilisk_day.py"),
            "dipole",
            "86400",
            "series.npz",
        ]
    return results


def cost(command: list[str], cache: Path) -> tuple[float, float]:
    """CPU and wall seconds of a command and its processes. Raises CalledProcessError
    where it fails."""
    environment = {
        k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"
    }
    environment |= {
        "DESAT_CACHE": str(cache / "desat"),
        "PYTHONPYCACHEPREFIX": str(cache / "pyc"),
    }
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        _, status, used = os.wait4(process.pid, 0)
        wall = time.perf_counter() - began
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):  # 1: a requirement is not met, or not shown
        raise subprocess.CalledProcessError(process.returncode, command)
    return used.ru_utime + used.ru_stime, wall


def measure(lines: dict[str, list[str]], rounds: int = ROUNDS) -> dict[str, Any]:
    """Of each command its least CPU and wall seconds, the largest CPU seconds, and the
    least over the least of `base`."""
    load = os.getloadavg()[0]
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in lines}
    with tempfile.TemporaryDirectory() as folder:
        cache, craft = Path(folder), str(Path(folder) / "craft")
        if any(CRAFT in command for command in lines.values()):
            new = [sys.executable, "-m", "desat.cli", "new", "craft", craft]
            subprocess.run([*new, *NEW_CRAFT], check=True, capture_output=True)
        for number in track(
            range(rounds + 1), "commands", disable=not sys.stderr.isatty()
        ):
            for name, command in lines.items():
                if name == FIRST:
                    shutil.rmtree(cache / "desat" / "lists", ignore_errors=True)
                took = cost([craft if x == CRAFT else x for x in command], cache)
                if number:
                    found[name].append(took)
    base = min(cpu for cpu, _ in found["base"])
    rows = {
        name: {
            "cpu": round(min(cpu for cpu, _ in took), 3),
            "cpu_most": round(max(cpu for cpu, _ in took), 3),
            "wall": round(min(wall for _, wall in took), 3),
            "over_base": round(min(cpu for cpu, _ in took) / base, 2),
        }
        for name, took in found.items()
    }
    return {"load_before": round(load, 1), **rows}
