"""What a process of its own costs an FMU, per step: `python -m benchmarks.isolation [STEPS]`.

The nadir day with all its FMUs in one process and with each in its own, both in the Python loop,
in turns; the least wall time and the least CPU time (of all processes) of the turns, over the
steps and over the components. With `--keep` the lines go to seen.json, too.
"""

from __future__ import annotations

import os
import sys

from desat.study.case import Options, execute

TARGET = "nadir_day/day-dipole"
TURNS = 5


def _cpu() -> float:
    return sum(os.times()[:4])


def measured(steps: int) -> dict[str, float]:
    """us per step and component: wall and CPU time that isolation adds, and what is without it."""
    ways = {"together": Options(stop=steps, loop="python", isolate="none"),
            "apart": Options(stop=steps, loop="python", isolate="all")}  # fmt: skip
    wall: dict[str, list[float]] = {name: [] for name in ways}
    cpu: dict[str, list[float]] = {name: [] for name in ways}
    components = 1
    for _ in range(TURNS):
        for name, options in ways.items():
            began = _cpu()
            run = execute(TARGET, options)
            components = len(run.manifest["fmus"])
            wall[name].append(run.manifest["us_per_step"])
            cpu[name].append(1e6 * (_cpu() - began) / steps)
            run.results.close()
    least = {f"{kind} {name}": min(of[name]) / components
             for kind, of in (("wall", wall), ("cpu", cpu)) for name in ways}  # fmt: skip
    return {**least, "added wall": least["wall apart"] - least["wall together"],
            "added cpu": least["cpu apart"] - least["cpu together"]}  # fmt: skip


def main() -> None:
    """A line a figure."""
    for name, value in measured(int(sys.argv[1]) if len(sys.argv) > 1 else 3000).items():
        print(f"{name}: {value:.1f} us per step and component")


if __name__ == "__main__":
    main()
