"""docs/your-craft.md: six crafts from the first command to the answer, by the
commands.

python -m benchmarks.your_craft
"""

from __future__ import annotations

import json
import os
import resource
import shlex
import subprocess
import sys
import tempfile
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from desat.analyses import management
from desat.figures.plots import series_figure
from desat.figures.style import on_dark
from desat.report.report import label_of
from desat.runs.run import load_run

DOCS = Path(__file__).parents[1] / "docs"
CRAFTS = {
    "my12u": (
        "A CubeSat of 12 units",
        "--altitude 400km --inclination 51.6deg --size 12U --wheels '4 pyramid 30mNms' --rods 0.2 "
        "--residual-dipole 0.05",
        [
            ["size", "my12u"],
            ["run", "my12u"],
            ["run", "my12u/worst.toml"],
            ["run", "my12u/detumbling.toml"],
            ["compare", "my12u", "--laws", "all"],
            ["tune", "my12u", "manager.gain", "--for", "sum_rms", "--stop", "12000"],
            ["campaign", "my12u", "-n", "200", "--stop", "6000"],
        ],
    ),
    "geo": (
        "A geostationary craft with thrusters",
        "--orbit geo --mass 2500kg --box 2.5,2.5,3 --wheels '4 pyramid 50Nms' --rods none "
        "--thrusters '4 10N' --dump 'thrusters 70:10' --panel '13m2 1.35m' --propellant 20kg",
        [
            ["size", "geo"],
            ["run", "geo"],
            ["run", "geo/worst.toml"],
            ["campaign", "geo", "-n", "200", "--stop", "1728000"],
        ],
    ),
    "sun6u": (
        "A CubeSat of 6 units that points to the Sun",
        "--sso 550km --ltan 10:30 --size 6U --pointing sun",
        [
            ["size", "sun6u"],
            ["run", "sun6u"],
            ["run", "sun6u/worst.toml"],
            ["run", "sun6u/detumbling.toml"],
            ["compare", "sun6u", "--laws", "all"],
        ],
    ),
    "geo8": (
        "A geostationary craft with eight nozzles",
        "--orbit geo --mass 2700kg --box 2.5,2.5,3 --wings '2 x 12m2 4m' --wheels '4 pyramid 20Nms' "
        "--rods none --thrusters '8 10N' --dump 'thrusters 70:10' --propellant 10kg",
        [
            ["size", "geo8"],
            ["size", "geo8", "--map", "--wheels", "10,20", "--thresholds", "50,70,90"],
            ["run", "geo8"],
        ],
    ),
    "l2": (
        "An observatory at L2",
        "--sun L2 --mass 1500kg --box 2,2,3 --wings '2 x 5m2 3m' --wheels '6 pyramid 12Nms' "
        "--thrusters '12 5N' --dump 'thrusters 70:10' --pointing 'sun 45deg'",
        [["size", "l2"], ["run", "l2"]],
    ),
    "lunar": (
        "An orbiter of the Moon",
        "--orbit 'moon 100km' --mass 600kg --box 1.2,1.2,1.8 --wings '2 x 3m2 2.2m' "
        "--thrusters '4 1N' --dump 'thrusters 70:10' --pointing 'nadir 5deg roll'",
        [["size", "lunar"], ["run", "lunar"], ["run", "lunar/worst.toml"]],
    ),
}
NUMBERS = (
    "pointing",
    "pointing_largest",
    "largest_momentum",
    "largest_speed",
    "final_momentum",
    "detumbled",
    "last_rate",
    "coil_duty",
    "first_dump",
    "between_dumps",
    "dump_momentum",
    "dumps_a_week",
    "propellant_a_year",
)
HEAD = """# Your craft

Six crafts of one's own, from the first command to the answer: every number is of the commands as
they stand here, run on {date} by `python -m benchmarks.your_craft` (desat {version}). What
`desat new craft` is not told is typical of its class and marked so in `craft.toml`; the folder is
yours to change.
"""


def ran(command: list[str], folder: Path) -> tuple[str, float]:
    """What a command prints, and its CPU seconds. Raises SystemExit where it cannot
    run."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "desat.cli", *command],
        cwd=folder,
        text=True,
        capture_output=True,
        check=False,
        env={**os.environ, "COLUMNS": "100"},
    )
    if done.returncode > 1:
        raise SystemExit(f"{shlex.join(command)}: {done.stderr[-2000:]}")
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return done.stdout, cpu


def answer_of(command: list[str], text: str, folder: Path) -> str:
    """What of a command's output answers."""
    if command[0] == "size" and "--map" not in command:
        first = text.partition("\n\n")[0]
        return first[first.find(f"\n{command[1]} ") + 1 :]
    if command[0] in ("compare", "tune", "size"):
        return "\n".join(
            x.rstrip() for x in text.splitlines() if not x.startswith("page: ")
        )
    if command[0] == "campaign":
        lines = [x for x in text.splitlines() if x and not x.startswith("runs/")]
        return "\n".join(lines)
    name = command[1].removesuffix(".toml").replace("/", "-")
    manifest = json.loads(
        (folder / "runs" / name / "manifest.json").read_text(encoding="utf-8")
    )
    rows: dict[str, Any] = manifest["numbers"]
    return "\n".join(
        f"{rows[n]['title']}: {rows[n]['value']:.4g} {rows[n]['unit']}"
        for n in NUMBERS
        if n in rows and rows[n]["value"] is not None
    )


def drawn(name: str, folder: Path, plot: str) -> str:
    """The SVG of a plot of a run."""
    run = load_run(folder / "runs" / name)
    one = label_of(run.manifest), run.results, run.manifest.parameters
    found = series_figure(run.manifest.content.plots[plot], [one])
    assert found is not None
    return found.svg()


def with_and_without(name: str, folder: Path) -> str:
    """The first plot of a run's report: its fullest wheel, managed and not, as SVG."""
    run = load_run(folder / "runs" / name)
    (_, first), *_ = management.figures(run.manifest, run.results)
    return first.svg()


def main() -> int:
    parts = [HEAD.format(date=datetime.now(UTC).date(), version=version("desat"))]
    for name, (title, options, commands) in CRAFTS.items():
        with tempfile.TemporaryDirectory() as text:
            folder = Path(text)
            first = ["new", "craft", name, *shlex.split(options)]
            every, full = [first, *commands], 0.0
            parts.append(f"## {title}\n\n{len(every)} lines are typed.\n")
            for command in every:
                out, cpu = ran(command, folder)
                full += cpu
                answer = (
                    out.splitlines()[0]
                    if command is first
                    else answer_of(command, out, folder)
                )
                line = (
                    f"new craft {name} {options}"
                    if command is first
                    else shlex.join(command)
                )
                parts.append(f"    desat {line}\n\n```text\n{answer}\n```\n")
                if command == ["run", "my12u"]:
                    picture = with_and_without(name, folder)
                    for variant, text in (
                        ("with-and-without.svg", picture),
                        ("with-and-without-dark.svg", on_dark(picture)),
                    ):
                        (DOCS / variant).write_text(text, encoding="utf-8")
                if command == ["run", name]:
                    for plot in (
                        "momentum",
                        "speed" if "--thrusters" in options else "dipole",
                    ):
                        file = DOCS / f"your-craft-{name}-{plot}.svg"
                        file.write_text(drawn(name, folder, plot), encoding="utf-8")
                        parts.append(f"![{plot} over the run]({file.name})\n")
            sheet = DOCS / "_static" / f"budget-{name}.html"
            ran(["budget", name, "--out", str(sheet)], folder)
            parts.append(
                f"All of it took {full:.0f} s of CPU. The sheet of `desat budget {name}`: "
                f"[{name}](_static/{sheet.name}).\n"
            )
    (DOCS / "your-craft.md").write_text("\n".join(parts), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
