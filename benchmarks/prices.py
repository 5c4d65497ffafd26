"""What safety costs: `python -m benchmarks.prices [STEPS]` (2000).

The nadir day, all ways in turns, the least of each kept: processes of their own for its
FMUs (both in the Python loop), the process that watches a run, and checkpoints (both in
the compiled loop, ten times the steps). Wall time, and CPU time of all processes. With
`--keep` it goes to seen.json, too.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from pathlib import Path

from desat.runs.run import Options, execute

from . import seen

TARGET = "nadir_day/day-dipole"
TURNS, CHECKPOINTS = 5, 20


def _cpu() -> float:
    return sum(os.times()[:4])


def _cost(options: Options) -> tuple[float, float, float, int]:
    """Of a run, in s: wall time of stepping, wall and CPU time of all; and its FMUs."""
    with tempfile.TemporaryDirectory() as folder:
        cpu, wall = _cpu(), time.perf_counter()
        run = execute(TARGET, options, Path(folder) / "run")
        run.results.close()
        found = run.manifest
        return (
            1e-6 * found["us_per_step"] * found["steps_done"],
            time.perf_counter() - wall,
            _cpu() - cpu,
            len(found["fmus"]),
        )


def measured(steps: int) -> dict[str, float]:
    """The prices, each with its unit."""
    many = 10 * steps
    ways = {
        "together": Options(stop=steps, loop="python", isolate="none"),
        "apart": Options(stop=steps, loop="python", isolate="all"),
        "together, started": Options(stop=2, loop="python", isolate="none"),
        "apart, started": Options(stop=2, loop="python", isolate="all"),
        "alone": Options(stop=many),
        "watched": Options(stop=many, supervised=True),
        "saved": Options(stop=many, checkpoint=many / CHECKPOINTS),
    }
    turns = [
        {name: _cost(options) for name, options in ways.items()} for _ in range(TURNS)
    ]

    def least(name: str, kind: int) -> float:
        return min(turn[name][kind] for turn in turns)

    fmus = turns[0]["apart"][3]
    each = 1e6 / steps / fmus
    started = {
        i: least("apart, started", i) - least("together, started", i) for i in (1, 2)
    }
    return {
        "isolation: wall, us a step and component": each
        * (least("apart", 0) - least("together", 0)),
        "isolation: CPU, us a step and component": each
        * (least("apart", 2) - least("together", 2) - started[2]),
        "without: wall, us a step and component": each * least("together", 0),
        "isolation: wall, ms to start each": 1e3 * started[1] / fmus,
        "isolation: CPU, ms to start each": 1e3 * started[2] / fmus,
        "watching: wall, us a step": 1e6
        / many
        * (least("watched", 0) - least("alone", 0)),
        "without: compiled loop, us a step": 1e6 / many * least("alone", 0),
        "watching: CPU, ms a run": 1e3 * (least("watched", 2) - least("alone", 2)),
        "a checkpoint: wall, ms": 1e3
        * (least("saved", 0) - least("alone", 0))
        / CHECKPOINTS,
        "a checkpoint: CPU, ms": 1e3
        * (least("saved", 2) - least("alone", 2))
        / CHECKPOINTS,
    }


def main() -> None:
    """A line a figure."""
    keep = seen.is_writing()
    steps = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    found = {name: round(value, 3) for name, value in measured(steps).items()}
    for name, value in found.items():
        print(f"{name}: {value}")
    if keep:
        seen.keep("prices", f"{steps} steps", found)


if __name__ == "__main__":
    main()
