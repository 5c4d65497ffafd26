"""What a step costs as systems grow: magnetometers in a chain, native FMUs where they
are built.

Each point is the least of some rounds of processor time, with the compiled loop where
there is one.
"""

from __future__ import annotations

import resource
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from desat.engine.loop import run, stepping
from desat.engine.master import Master
from desat.engine.recording.recorder import Recorder
from desat.engine.recording.results import SERIES
from desat.figures.canvas import Figure
from desat.figures.style import COLOURS
from desat.files import library, paths
from desat.files.draft import Draft
from desat.runs.checks import check_draft
from desat.system.model import Component, Connection

PLOT = Path(__file__).with_name("scaling.svg")
ROUNDS = 5
STEPS = 20000
CHAIN = 32
"""Components, where their number is not what is varied."""


def _master(components: int, wired: int | None = None) -> Master:
    """A chain: the field that a magnetometer measures is the field of the next one, for
    so many of them (default: all)."""
    native = paths.fmus() / "native" / "magnetometer.fmu"
    file = native if native.exists() else paths.fmus() / "magnetometer.fmu"
    fmu = library.load(file)
    names = [f"m{i:04}" for i in range(components)]
    chain = {n: Component(n, file.name, fmu.interface, fmu=fmu) for n in names}
    wires = [
        Connection(a, f"b_body[{i}]", b, f"b_eci[{i}]")
        for a, b in list(pairwise(names))[:wired]
        for i in (1, 2, 3)
    ]
    draft = Draft(
        "benchmarks/scaling.py",
        "chain",
        components=chain,
        connections=wires,
        step=1.0,
        stop=1e7,
    )
    master = Master(*check_draft(draft).or_raise(), watched=lambda c, s: False)
    master.initialise()
    return master


def _seconds(master: Master, steps: int, stored_values: int | None = None) -> float:
    """Processor seconds of so many further steps; recorded in a file with the outputs
    of so many components."""
    with TemporaryDirectory() as folder:
        patterns = [f"m{i:04}.*" for i in range(stored_values or 0)]
        file = Path(folder) / SERIES
        recorder = None if stored_values is None else Recorder(file, master, patterns)
        stepper, until = stepping(master, recorder), master.k + steps
        began = time.process_time()
        if recorder is None:
            while master.k < until:
                stepper.some(until - master.k)
        else:
            run(master, stepper, until, recorder)
        seconds = time.process_time() - began
        if recorder is not None:
            recorder.finish(master).close()
    return seconds


def _varied(
    values: list[int], make: Callable[[int], Master], keep: bool = False
) -> list[Any]:
    """[value, us a step] for each value, which with `keep` is the number of components
    recorded."""
    rows = []
    for value in values:
        with make(value) as master:
            least = min(
                _seconds(master, STEPS, value if keep else None) for _ in range(ROUNDS)
            )
        rows.append([value, round(1e6 * least / STEPS, 3)])
    return rows


def _line(rows: list[Any]) -> dict[str, Any]:
    """The rows, and the straight line through them: cost of one more, and the largest
    distance from it as a share of the largest cost."""
    x, y = np.array(rows, dtype=float).T
    slope, start = np.polyfit(x, y, 1)
    return {
        "rows": rows,
        "of_one_more": round(float(slope), 8),
        "off_the_line": round(float(np.abs(y - start - slope * x).max() / y.max()), 3),
    }


def _steps(counts: list[int]) -> tuple[list[Any], dict[str, float]]:
    """[steps, seconds] of one system; and the memory (MiB) after the first and the last
    of them."""
    page = resource.getpagesize()
    rows, resident = [], []
    with _master(3) as master:
        for count in counts:
            rows.append([count, round(_seconds(master, count), 4)])
            held = int(Path("/proc/self/statm").read_text().split()[1])
            resident.append(round(held * page / 2**20, 2))
    return rows, {"mib_at_first": resident[0], "mib_at_the_end": resident[-1]}


def measure() -> dict[str, Any]:
    """All rows, and their plot beside this file."""
    counts, memory = _steps([10**4, 10**6, 2 * 10**6, 4 * 10**6, 10**7])
    found = {
        "steps": _line(counts),
        "components": _line(_varied([1, 8, 16, 32, 64, 128], lambda n: _master(n))),
        "connections": _line(
            [
                [3 * n, us]
                for n, us in _varied([0, 8, 16, 24, 31], lambda n: _master(CHAIN, n))
            ]
        ),
        "recorded": _line(
            [
                [3 * n, us]
                for n, us in _varied(
                    [0, 8, 16, 24, 31], lambda n: _master(CHAIN), keep=True
                )
            ]
        ),
    }
    _draw(found)
    return {**found, "memory": memory}


def _draw(found: dict[str, Any]) -> None:
    fig = Figure(9.0, 2.6)
    for i, name in enumerate(("steps", "components", "connections", "recorded")):
        remaining = 0.06 + 0.245 * i
        ax = fig.add(left=remaining, right=1.0 - remaining - 0.185, top=0.1, bottom=0.2)
        x, y = np.array(found[name]["rows"], dtype=float).T
        ax.plot(x / 1e6 if name == "steps" else x, y, COLOURS[i], marker=3.0)
        ax.size, ax.y.low = 75.0, 0.0
        ax.x.label = {"recorded": "recorded signals", "steps": "steps, millions"}.get(
            name, name
        )
        ax.y.label = "time [s]" if name == "steps" else "time of a step [µs]"
    PLOT.write_text(fig.svg(), encoding="utf-8")
