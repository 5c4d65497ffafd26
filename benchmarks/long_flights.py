"""What a flight of a craft that dumps takes as it becomes longer: memory, CPU and disk.

    python -m benchmarks.long_flights [--other DESAT] [--days 1,3,7,14,28,100]

Peak memory and CPU are the kernel's counts of the command. `--other` is the command
`desat` of another installation, flown in turn with ours, up to `OTHER_DAYS`. The answer
goes into docs/results.md and docs/long-flights.svg.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import tempfile
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

from desat.figures.canvas import Figure
from desat.figures.style import COLOURS

HOME = Path(__file__).parents[1]
PAGE, PLOT = HOME / "docs" / "results.md", HOME / "docs" / "long-flights.svg"
BEGIN, END = "<!-- long flights -->", "<!-- end of long flights -->"
OTHER_DAYS = 28  # days beyond which the other's memory is not asked for
CRAFT = ["--altitude", "520km", "--inclination", "97.5deg", "--mass", "400kg"]
CRAFT += ["--box", "1,1,2.5", "--wheels", "4 pyramid 8Nms", "--rods", "none"]
CRAFT += ["--thrusters", "4 0.5N", "--isp", "65s", "--dump", "thrusters 70:10"]


class Cost(NamedTuple):
    """Cost of a flight: peak memory and disk in bytes, CPU in seconds."""

    memory: float
    cpu: float
    disk: float


def cost_of(command: list[str], folder: Path) -> Cost:
    """Run a command and return its cost, with the bytes that it leaves in a folder."""
    with tempfile.TemporaryFile() as log:
        process = subprocess.Popen(command, stdout=log, stderr=log, cwd=folder.parent)
        _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise SystemExit(f"{' '.join(command)}: exit code {process.returncode}")
    disk = sum(f.stat().st_size for f in folder.rglob("*") if f.is_file())
    return Cost(1e3 * usage.ru_maxrss, usage.ru_utime + usage.ru_stime, disk)


def fly(
    days: list[float], commands: dict[str, list[str]]
) -> dict[str, dict[float, Cost]]:
    """Fly the craft for each of the days with each command; return costs by both."""
    costs: dict[str, dict[float, Cost]] = {name: {} for name in commands}
    with tempfile.TemporaryDirectory() as place:
        for name, command in commands.items():
            (home := Path(place, name)).mkdir()
            subprocess.run(
                [*command, "new", "craft", "sar", *CRAFT],
                cwd=home,
                check=True,
                capture_output=True,
            )
        for day in days:
            for name, command in commands.items():
                if name != "ours" and day > OTHER_DAYS:
                    continue
                folder = Path(place, name, f"run-{day:g}")
                flight = [*command, "run", "sar", "--stop", f"{86400 * day:.0f}"]
                cost = cost_of([*flight, "--out", str(folder)], folder)
                costs[name][day] = cost
                print(name, day, cost, file=sys.stderr)
                subprocess.run(["rm", "-r", str(folder)], check=True)
    return costs


def draw(costs: dict[str, dict[float, Cost]]) -> None:
    """Draw peak memory and CPU over the length of the flight, logarithmic."""
    figure = Figure(7.2, 5.0)
    quantities = ("peak memory [MB]", 1e-6, 0), ("CPU of the command [s]", 1.0, 1)
    for k, (label, factor, field) in enumerate(quantities):
        ax = figure.add(top=0.04 + 0.5 * k, bottom=0.58 - 0.48 * k)
        for i, (name, of) in enumerate(costs.items()):
            ax.plot(
                list(of),
                [factor * c[field] for c in of.values()],
                COLOURS[i],
                label=name,
                marker=5.0,
                dash=(4.0, 2.0) if i else (),
            )
        ax.x.log = ax.y.log = True
        ax.x.label, ax.y.label = "length of the flight [d]", label
    PLOT.write_text(figure.svg(), encoding="utf-8")


def table(costs: dict[str, dict[float, Cost]]) -> str:
    """Return the table of the page."""
    heads = [f"{n}: {q}" for n in costs for q in ("memory, MB", "CPU, s", "disk, MB")]
    lines = [f"| days at 1 s | {' | '.join(heads)} |", "|---" * (len(heads) + 1) + "|"]
    for day in next(iter(costs.values())):
        cells = []
        for of in costs.values():
            if (c := of.get(day)) is None:
                cells += ["", "", ""]
            else:
                cells += [
                    f"{1e-6 * c.memory:.0f}",
                    f"{c.cpu:.1f}",
                    f"{1e-6 * c.disk:.0f}",
                ]
        lines.append(f"| {day:g} | {' | '.join(cells)} |")
    about = (
        f"Measured {date.today()}, desat {version('desat')}, Python "
        f"{platform.python_version()}, {os.cpu_count()} cores of {platform.machine()}: a craft "
        "of 400 kg that dumps by thrusters, all outputs, report included."
    )
    return "\n".join([*lines, "", about])


def main() -> None:
    """Fly, draw, and write the table into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--other", help="command `desat` of another installation")
    parser.add_argument("--name", default="before", help="its name in the table")
    parser.add_argument("--days", default="1,3,7,14,28,100")
    words = parser.parse_args()
    commands = {"ours": [sys.executable, "-m", "desat.cli"]}
    if words.other:
        commands[words.name] = [words.other]
    costs = fly([float(x) for x in words.days.split(",")], commands)
    draw(costs)
    text = PAGE.read_text(encoding="utf-8")
    block = f"{BEGIN}\n{table(costs)}\n{END}"
    pattern = f"{re.escape(BEGIN)}.*{re.escape(END)}"
    PAGE.write_text(
        re.sub(pattern, lambda _: block, text, flags=re.S), encoding="utf-8"
    )


if __name__ == "__main__":
    main()
