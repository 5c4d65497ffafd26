"""Lay a log over a run: what both have, in one plot, and how far they are apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.recording.results import Results
from ..figures.canvas import INCH, Figure
from ..figures.plots import elements_of, timeline
from ..figures.style import COLOURS, axis_label, figure, time_axis
from ..numbers.derived import pointing
from ..numbers.numbers import scale
from ..report.report import figures_of, render, write_page
from ..report.table import ROW_UNIT, Column, Row, Table
from ..system.errors import DesatError
from ..system.typed import JsonObject
from .log import CHANNELS, Log, align_signs

Array = NDArray[np.float64]
PAUSE = 600.0  # s: thrusters that were off for longer begin a new dump
REFERENCES = ("guidance.q_wanted_bi", "guidance.q_ref_bi")


class ShownQuantity(NamedTuple):
    """Quantity that a log and a run have."""

    title: str
    unit: str  # in which it is shown
    names: tuple[str, ...]  # of the run's series, the first that is recorded


SHOWN = {
    "speed": ShownQuantity("Wheel speed", "rpm", ("wheels.speed_wheel",)),
    "momentum": ShownQuantity(
        "Wheel momentum", "mN.m.s", ("wheels.h_wheel", "spacecraft.h_copy_wheel")
    ),
    "rate": ShownQuantity("Body rate", "deg/s", ("spacecraft.omega_bi_body",)),
}


@dataclass(frozen=True)
class OverlaidLine:
    """Element of a quantity, as measured and as simulated, at the times of the log."""

    title: str
    unit: str
    times: Array  # (n,) s
    log: Array  # (n,)
    simulation: Array  # (n,)

    @property
    def rms(self) -> float:
        """Return the root mean square of the difference."""
        return float(np.sqrt(np.mean((self.log - self.simulation) ** 2)))

    @property
    def largest(self) -> float:
        """Return the largest difference."""
        return float(np.abs(self.log - self.simulation).max())


@dataclass(frozen=True)
class Overlay:
    """Log over a run."""

    target: str
    place: str  # of the log
    lines: dict[str, list[OverlaidLine]]  # by title of the plot
    dumps: tuple[list[float], list[float]]  # s: begins in the log and in the run

    @property
    def table(self) -> Table:
        """Tabulate the differences."""
        columns = [
            Column(f"{self.place} less {self.target}", kind="text"),
            Column("rms", ROW_UNIT),
            Column("largest", ROW_UNIT),
            Column("unit", kind="unit"),
            Column("rows", form="d"),
        ]
        rows: list[Row] = [
            (x.title, x.rms, x.largest, x.unit, len(x.times))
            for lines in self.lines.values()
            for x in lines
        ]
        return Table("", columns, rows)

    @property
    def dump_table(self) -> Table:
        """Tabulate when dumps begin (h); empty where thrusters are not in both."""
        columns = [Column("dump", form="d"), *(Column(x, "h") for x in ("log", "run"))]
        columns_of_times = [[x / 3600.0 for x in begins] for begins in self.dumps]
        rows: list[Row] = [
            (k + 1, *(x[k] if k < len(x) else None for x in columns_of_times))
            for k in range(max(map(len, columns_of_times)))
        ]
        return Table("", columns, rows)

    def as_json(self) -> JsonObject:
        """Return the differences for programs."""
        return {
            "log": self.place,
            "run": self.target,
            "differences": {
                x.title: {"unit": x.unit, "rms": x.rms, "largest": x.largest}
                for lines in self.lines.values()
                for x in lines
            },
            "dumps": {"log": self.dumps[0], "run": self.dumps[1]},
        }

    def figures(self) -> list[tuple[str, Figure]]:
        """Draw what was measured as lines, and what was simulated dashed over it."""
        return [(title, _draw(title, x)) for title, x in self.lines.items()]

    def write(self, path: Path) -> Path:
        """Write the page: plots and table; return its path."""
        path.parent.mkdir(parents=True, exist_ok=True)
        page = figures_of(self.figures())
        return write_page(path, render("overlay.html", overlay=self, **page))


def lay_over(target: str, results: Results, log: Log) -> Overlay:
    """Lay a log over a run.

    Raises
    ------
    DesatError
        If they have no time or no quantity in common, or other wheels.
    """
    end = results.times()
    inside = (log.times >= end[0]) & (log.times <= end[-1])
    if not inside.any():
        raise DesatError(
            f"{log.place}: from {log.times[0]:.6g} to {log.times[-1]:.6g} s; {target} is from "
            f"{end[0]:.6g} to {end[-1]:.6g} s"
        )
    lines = {}
    for quantity, channel in SHOWN.items():
        if quantity in log.values and (name := _find_series(channel.names, results)):
            values = log.values[quantity][inside]
            found_lines = list(
                _lines_of(channel, quantity, name, results, log, values, inside)
            )
            lines[channel.title] = found_lines
    if error := _attitude_error(results, log, inside):
        lines[error.title] = [error]
    lines = {title: x for title, x in lines.items() if x}
    if not lines:
        raise DesatError(f"{log.place}: no column of what {target} has recorded")
    return Overlay(target, log.place, lines, _dumps(results, log, inside))


def _find_series(names: Sequence[str], results: Results) -> str:
    """Return the first of these series that a run has; "" if it has none."""
    return next((n for n in names if n in results.names()), "")


def _series_at(results: Results, name: str, times: Array) -> Array:
    """Interpolate a series of a run (n, elements) at times (n,) s."""
    values = np.asarray(results.values(name), float)
    at = results.times(name)[: len(values)]
    return np.stack([np.interp(times, at, x) for x in values.T], axis=1)


def _lines_of(
    channel: ShownQuantity,
    quantity: str,
    name: str,
    results: Results,
    log: Log,
    values: Array,
    inside: NDArray[np.bool_],
) -> Iterator[OverlaidLine]:
    """Yield the lines of a quantity, an element each, in the unit that is shown."""
    times = log.times[inside]
    simulated_values = _series_at(results, name, times)
    exist = simulated_values.any(axis=0) | (np.arange(len(simulated_values[0])) < 3)
    if values.shape[1] != len(exist):
        simulated_values = simulated_values[:, exist]
    if values.shape[1] != simulated_values.shape[1]:
        raise DesatError(
            f"{log.place}: columns of {quantity}: {values.shape[1]} elements; the run has "
            f"{simulated_values.shape[1]}"
        )
    factor = scale(CHANNELS[quantity].unit, channel.unit)
    for k, element in enumerate(elements_of(name, values.shape[1])):
        rows = np.isfinite(values[:, k])
        if rows.any() and (values[rows, k].any() or simulated_values[:, k].any()):
            yield OverlaidLine(
                f"{channel.title}, {element}",
                channel.unit,
                times[rows],
                factor * values[rows, k],
                factor * simulated_values[rows, k],
            )


def _attitude_error(
    results: Results, log: Log, inside: NDArray[np.bool_]
) -> OverlaidLine | None:
    """Return the angle to the attitude that the guidance wants; None where unknown."""
    name = _find_series(REFERENCES, results)
    q = log.values.get("attitude")
    if not name or q is None or "spacecraft.q_bi" not in results.names():
        return None
    rows = inside & np.isfinite(q).all(axis=1)
    if not rows.any():
        return None
    errors: list[Any] = [
        pointing(q[rows], _attitude_at(results, name, log.times[rows]))
    ]
    own_q = _attitude_at(results, "spacecraft.q_bi", log.times[rows])
    errors.append(pointing(own_q, _attitude_at(results, name, log.times[rows])))
    return OverlaidLine("Attitude error", "deg", log.times[rows], *errors)


def _attitude_at(results: Results, name: str, times: Array) -> Array:
    """Interpolate an attitude of a run to unit quaternions (n, 4) at times (n,) s."""
    values = align_signs(np.asarray(results.values(name), float))
    at = results.times(name)[: len(values)]
    q = np.stack([np.interp(times, at, x) for x in values.T], axis=1)
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def _dumps(
    results: Results, log: Log, inside: NDArray[np.bool_]
) -> tuple[list[float], list[float]]:
    """Return when dumps by thrusters begin (s), in the log and in the run."""
    name = "thrusters.tau_mean_thruster_body"
    if "thrust" not in log.values or name not in results.names():
        return [], []
    values = np.asarray(results.values(name), float)
    at = results.times(name)[: len(values)]
    thrust = np.nan_to_num(log.values["thrust"][inside])
    return _begins(log.times[inside], thrust), _begins(at, values)


def _begins(times: Array, torque: Array) -> list[float]:
    """Return the times (s) at which a torque (n, 3) begins after a pause."""
    firing_times = times[torque.any(axis=1)]
    is_first = np.diff(firing_times, prepend=-np.inf) > PAUSE
    return [float(t) for t in firing_times[is_first]]


def _draw(title: str, lines: Sequence[OverlaidLine]) -> Figure:
    """Draw lines, each as measured and, dashed, as simulated."""
    fig, ax = figure()
    seconds, unit = time_axis(lines[0].times)
    for k, line in enumerate(lines):
        colour = COLOURS[k % len(COLOURS)]
        name = line.title.partition(", ")[2]
        x = line.times / seconds
        ax.plot(x, line.log, colour, label=f"{name} measured".strip(), width=1.4)
        label = f"{name} simulated".strip()
        ax.plot(
            x,
            line.simulation,
            colour,
            label=label,
            width=1.0,
            dash=(4.0, 2.0),
            alpha=0.75,
        )
    ax.y.label = axis_label(title, lines[0].unit, ax.height / INCH)
    timeline(ax, seconds, unit)
    return fig
