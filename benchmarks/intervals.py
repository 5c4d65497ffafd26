"""The table of docs/assumed.md: intervals of `desat size` beside closed loops.

Each loop has the values of a sample of what is not known for sure, the same that the
model has; places in the orbit and start momenta are those of the craft.

python -m benchmarks.intervals [--loops N]
"""

from __future__ import annotations

import argparse
import math
import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import numpy as np

from desat.campaign.draws import series_of_numbers
from desat.campaign.sampling import draw_of
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import prepare, read, resolved
from desat.runs.run import simulate
from desat.sizing import dumps, intervals, sizing
from desat.sizing.requirements import SizingRequirements
from desat.system.options import Options

PAGE = Path(__file__).parents[1] / "docs" / "assumed.md"
BEGIN, END = "<!-- intervals -->", "<!-- end -->"
DAY = 86400.0
# kind, options of `desat new craft`, length of a flight (s)
CRAFTS = {
    "LEO, rods": ("--size 12U --sso 550km", DAY),
    "Sun, rods": (
        "--size 6U --sso 550km --pointing sun --wings '2 x 0.06m2 0.25m'",
        DAY,
    ),
    "LEO, thrusters": (
        "--mass 400kg --box 1,1,2.5 --altitude 520km --inclination 97.5deg --rods none "
        "--wheels '4 pyramid 0.3Nms' --thrusters '4 0.5N' --dump 'thrusters 70:10'",
        4.0 * DAY,
    ),
    "GEO": (
        "--orbit geo --mass 2500kg --box 2,2,3 --rods none --wheels '4 pyramid 20Nms' "
        "--wing '13m2 1.35m' --thrusters '4 10N' --dump 'thrusters 70:10'",
        40.0 * DAY,
    ),
    "deep space": (
        "--sun 1AU --mass 600kg --box 1.5,1.5,2 --rods none --wheels '4 pyramid 1Nms' "
        "--wings '2 x 4m2 2.5m' --thrusters '4 1N' --dump 'thrusters 70:10'",
        40.0 * DAY,
    ),
    "yaw steering": (
        "--altitude 1400km --inclination 52deg --pointing yaw --mass 450kg --rods none "
        "--wing '5m2 2.2m' --wheels '4 pyramid 4Nms' --thrusters '4 0.5N' "
        "--dump 'thrusters 70:10'",
        12.0 * DAY,
    ),
}


def make(line: str, folder: Path) -> None:
    """Write the craft of a line's options."""
    command = [sys.executable, "-m", "desat.cli", "new", "craft", str(folder)]
    subprocess.run([*command, *shlex.split(line)], check=True, capture_output=True)


def fly(target: str, stop: float, draw: int) -> tuple[float, float]:
    """Fly a sample: fullest wheel late (N m s) and duty (%), or s between dumps and 0."""
    source = read(target)
    system, _ = resolved(source, Options())
    values = draw_of(draft_to_draw(source, False), intervals.SEED, draw)
    values = {k: v for k, v in values.items() if k.startswith("spacecraft.")}
    case = prepare(source, Options(values=values, stop=stop, every=1))
    series = [*series_of_numbers(case.or_raise()[0]), "wheels.h_wheel"]
    series += ["manager.dumps"] if dumps.applies(system) else []
    options = replace(case.options, record=tuple(dict.fromkeys(series)))
    run = simulate(replace(case, options=options)).or_raise(target)
    with run.results as results:
        if dumps.applies(system):
            count = results.values("manager.dumps").ravel()
            times = results.times()[1 - len(count) :]
            starts = times[np.diff(count) > 0.0]
            if len(starts) < 2:
                return math.inf, 0.0
            return float(starts[-1] - starts[0]) / (len(starts) - 1), 0.0
        h = np.abs(results.values("wheels.h_wheel"))
        duty = run.manifest.numbers["coil_duty"].value
        assert duty is not None
        return float(h[len(h) // 2 :].max()), duty


def compare(
    kind: str, folder: Path, pool: ProcessPoolExecutor, loops: int
) -> Iterator[str]:
    """Yield a row for each quantity of a craft."""
    line, stop = CRAFTS[kind]
    target = str(folder / kind.replace(", ", "-").replace(" ", "-"))
    make(line, Path(target))
    requirements = SizingRequirements(flown=False, year=False, laws=False)
    options = Options(stop=stop)
    intervals.DRAWS = intervals.FOLLOWED = loops  # the same samples
    each = np.array(list(pool.map(partial(fly, target, stop), range(loops))))
    if dumps.is_of(target, Options()):
        by_model = dumps.size(target, options, requirements).intervals[1:2]
        columns = [("time between dumps, d", 1.0 / DAY)]
    else:
        by_model = sizing.size(target, Options(), requirements).intervals[3:]
        columns = [("fullest wheel, mN m s", 1e3), ("duty of the coils, %", 1.0)]
    for (title, factor), row, values in zip(columns, by_model, each.T, strict=False):
        ends = np.percentile(values, (intervals.LOW, intervals.HIGH), method="nearest")
        pairs = [(x, y) for x, y in zip(row[3:], ends, strict=True) if math.isfinite(y)]
        share = max(abs(x - y) for x, y in pairs) / (row.high - row.low)
        high = (
            "more than were flown" if math.isinf(ends[1]) else f"{factor * ends[1]:.3g}"
        )
        yield (
            f"| {kind} | {title} | {factor * row.low:.3g} to {factor * row.high:.3g} | "
            f"{factor * ends[0]:.3g} to {high} | {100.0 * share:.0f} |"
        )


def main() -> None:
    """Compare all crafts and write their table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--loops", type=int, default=200)
    loops = parser.parse_args().loops
    with (
        tempfile.TemporaryDirectory() as folder,
        ProcessPoolExecutor(os.cpu_count()) as pool,
    ):
        rows = [r for kind in CRAFTS for r in compare(kind, Path(folder), pool, loops)]
    today = datetime.now(UTC).date().isoformat()
    table = [
        BEGIN,
        f"{loops} loops of each craft (`python -m benchmarks.intervals`, {today}, "
        f"desat {version('desat')}, numpy {np.__version__}):",
        "",
        "| craft | | model, 5 to 95 % | closed loops | ends differ, % of the width |",
        "|---|---|---|---|---|",
        *rows,
        END,
    ]
    text = PAGE.read_text(encoding="utf-8")
    before, _, rest = text.partition(BEGIN)
    after = rest.partition(END)[2]
    PAGE.write_text(before + "\n".join(table) + after, encoding="utf-8")
    print("\n".join(rows))


if __name__ == "__main__":
    main()
