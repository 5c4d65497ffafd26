"""How the package stands: the way of a target to its run, its size, its names, its commands' cost.

    make house

Ways are counted by tests/way.py, a process each, after one that makes what is made once for a user.
CPU is the least of five (`commands.py`), in seconds and over importing numpy, h5py, lxml, typer and
rich (B).
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

from . import commands

HOME = Path(__file__).parents[1]
PACKAGE = HOME / "orchestrator"
TARGETS = ("uosat12/table3-ocdc-ilqr-1", "nadir_day/day-dipole", "space_telescope/ours-nominal")
AIMS = {"functions": (185, 190, 215, 185), "calls": (115, 115, 145, 110),
        "total": (15_000, 15_000, 60_000, 15_000)}  # fmt: skip
COMMANDS = {
    "run_day": (4.5, "B"), "run_60_steps": (2.6, "B"), "check": (1.7, "B"),
    commands.FIRST: (0.8, "s"), "help": (0.13, "s"), "tables": (5.0, "s of wall"),
}  # fmt: skip
"""Command of `commands.py` -> aim."""


def ways(folder: Path) -> list[dict[str, int]]:
    """The counts of the three targets and of the .ssp of the second."""
    (folder / "day.toml").write_text('extends = "nadir_day/day-dipole"\n')
    subprocess.run([*desat(), "pack", "day.toml"], check=True, cwd=folder, capture_output=True)
    found = []
    for target in (*TARGETS, str(folder / "day.ssp")):
        command = [sys.executable, str(HOME / "tests" / "way.py"), target]
        for _ in range(2):
            done = subprocess.run(command, check=True, cwd=folder, capture_output=True, text=True)
        found.append(json.loads(done.stdout))
    return found


def desat() -> list[str]:
    """The command."""
    return [str(Path(sys.executable).with_name("desat"))]


def sizes() -> dict[str, int]:
    """Lines that are not blank, public class names that stand twice, and `dict[str, Any]`."""
    texts = [p.read_text(encoding="utf-8") for p in PACKAGE.rglob("*.py")]
    names = Counter(
        node.name for text in texts for node in ast.parse(text).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )  # fmt: skip
    return {
        "files": len(texts),
        "lines": sum(bool(line.strip()) for text in texts for line in text.splitlines()),
        "class names twice": sum(n > 1 for n in names.values()),
        "dict[str, Any]": sum(text.count("dict[str, Any]") for text in texts),
    }


def main() -> int:
    """Print all of it."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        counts = ways(folder)
        for what, aims in AIMS.items():
            now = ", ".join(f"{c[what]:,}" for c in counts)
            print(f"{what}: {now} (aims {', '.join(f'{a:,}' for a in aims)})")
        for name, number in sizes().items():
            print(f"{name}: {number:,}")
    lines = {n: c for n, c in commands.commands().items() if n in ("base", *COMMANDS)}
    costs = commands.measure(lines)
    print(f"B: {costs['base']['cpu']:.3f} s")
    for name, (aim, unit) in COMMANDS.items():
        of = costs[name]
        found = {"B": of["over_base"], "s": of["cpu"], "s of wall": of["wall"]}[unit]
        print(f"{' '.join(lines[name][3:])}: {found:.2f} {unit}, {of['cpu']:.2f} s "
              f"(aim {aim:g} {unit})")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
