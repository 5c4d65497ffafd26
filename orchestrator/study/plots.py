"""Plots for people, as SVG text: units, legends, limit lines."""

from __future__ import annotations

import io
import re
import textwrap
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ..engine.results import Results
from ..system.errors import DesatError
from ..system.expression import entry as value_of
from ..system.expression import factor, product
from . import derived
from .numbers import scale
from .strips import timeline

COLOURS = ("#0b62a4", "#d1495b", "#2e8b57", "#8a5fbf", "#e08e0b", "#444444", "#1aa6b7", "#8b5a2b",
           "#a3b72c")  # fmt: skip
LIMIT = "#b22222"
BANDS = ("#b22222", "#e0a100", "#5b7f95")
"""Of filled limits, in their order."""
POINTS = 3000
"""Of a line: more than a plot is wide are thinned to its envelope."""
BINS = 240
"""Parts of a line whose least and most are drawn as an area."""
LEGEND_WIDTH = 21
"""Characters that there is room for beside the axes."""
LEFT, WIDTH, BOTTOM, TOP = 0.115, 0.635, 0.16, 0.92
"""Of all axes in their figures, so that times align."""
HEIGHT, PANELS = 2.9, 4.9
"""in, of a figure with one pair of axes and with two."""

Run = tuple[str, Results, dict[str, Any]]
"""label, series, parameters as a manifest has them"""


class Line(NamedTuple):
    """A line of a plot: times (s) and values in the plot's unit."""

    name: str
    times: Any
    values: Any
    stepped: bool = False
    """True: each value holds until the next."""


_FIRST: dict[str, Any] = {"linestyle": "-", "linewidth": 1.4}
_OTHER: dict[str, Any] = {"linestyle": (0, (4, 2)), "linewidth": 1.0, "alpha": 0.75}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def pretty_unit(unit: str) -> str:
    """A unit's name as people write it: `uN.m.s2` -> `µN m s²`; nothing for `1`."""
    if unit == "1":
        return ""
    micro = re.sub(r"\bu(?=[A-Z])", "µ", unit)
    return re.sub(r"(?<=[A-Za-z])-?\d+", lambda m: m[0].translate(_RAISED), micro).replace(".", " ")


def time_axis(times: np.ndarray[Any, Any]) -> tuple[float, str]:
    """(seconds in the unit, unit) that suit a time span."""
    span = float(times[-1] - times[0]) if len(times) else 0.0
    if span > 3 * 3600:
        return 3600.0, "h"
    return (60.0, "min") if span > 1200 else (1.0, "s")


def figure(width: float = 7.2, height: float = HEIGHT) -> tuple[Figure, Any]:
    """A figure in our style, and its axes."""
    fig = Figure(figsize=(width, height))
    return fig, _axes(fig, BOTTOM, TOP)


def _axes(fig: Figure, bottom: float, top: float) -> Any:
    ax = fig.add_axes((LEFT, bottom, WIDTH, top - bottom))
    ax.grid(True, color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return ax


def axis_label(what: str, unit: str, height: float) -> str:
    """`quantity [unit]` for an axis so many inches high, in lines that fit it."""
    bracket = f"[{pretty_unit(unit)}]".replace(" ", "\u00a0") if pretty_unit(unit) else ""
    return textwrap.fill(f"{what} {bracket}".strip(), max(14, int(height * 14)))


def legend(ax: Any) -> None:
    """The legend beside the axes, where there is something to name; long labels are wrapped."""
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        ax.legend(
            handles, [textwrap.fill(label, LEGEND_WIDTH) for label in labels], fontsize=8,
            frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5), handlelength=1.6,
        )  # fmt: skip


def svg(fig: Figure) -> str:
    """The figure as an <svg> element, the same for the same data."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "desat", "svg.fonttype": "path"}):
        fig.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', "", text[text.index("<svg") :], count=1)


def series_plot(plot: dict[str, Any], runs: Sequence[Run]) -> str | None:
    """The SVG of a scenario's `[plots.NAME]` over runs. The first is drawn in colours, the others
    dashed. None where a series is not recorded."""
    _, results, parameters = runs[0]
    known = set(results.names())
    signals = [s for s in plot["signals"] if s in known]
    if not signals or ("derive" in plot and len(signals) < len(plot["signals"])):
        return None
    quantity = derived.of_entry(plot)
    own = quantity[0].unit if quantity else ""
    unit = plot.get("unit") or own or results.attribute(signals[0], "unit")
    drawn = [lines_of(plot, r, unit) for _, r, _ in runs]
    what, steady = plot.get("axis", plot["title"]), plot.get("steady")
    orbit = plot.get("orbit")
    seconds, time_unit = (orbit, "orbits") if orbit else time_axis(results.times())
    if steady is None or results.times()[-1] <= steady:
        fig, ax = figure()
        panels = [(ax, drawn)]
    else:
        fig = Figure(figsize=(7.2, PANELS))
        later = [[_since(line, steady) for line in lines] for lines in drawn]
        panels = [(_axes(fig, 0.60, 0.96), drawn), (_axes(fig, 0.10, 0.46), later)]
        panels[1][0].set_title(f"from {steady / seconds:g} {time_unit} on", fontsize=9, loc="left")
    # the limits of a size have no other side
    signed = any(np.nanmin(x.values, initial=0.0) < 0.0 for lines in drawn for x in lines)
    for ax, lines in panels:
        whole = ax is panels[0][0]
        names = [label for label, _, _ in runs] if whole else None
        _draw(ax, lines, names, seconds, plot)
        _draw_limits(ax, _limits(plot, parameters, unit), signed, whole)
        if plot.get("log") and whole:
            ax.set_yscale("log")
        height = ax.get_position().height * fig.get_figheight()
        ax.set_ylabel(axis_label(what, unit, height), fontsize=9)
        timeline(ax, seconds, time_unit, results if whole else None)
        if steady is not None and not whole:
            ax.set_xlim(steady / seconds, results.times()[-1] / seconds)
        legend(ax)
    return svg(fig)


def _since(line: Line, begin: float) -> Line:
    kept = line.times >= begin
    return line._replace(times=line.times[kept], values=line.values[kept])


def _draw(
    ax: Any, runs: list[list[Line]], labels: list[str] | None, seconds: float,
    plot: dict[str, Any],
) -> None:  # fmt: skip
    """The lines of several runs. A line is named in the first run; where there are several runs,
    the first line of each other one has the run's name, and a lone line always has; without
    `labels` none has. An `envelope` fills what a line that is faster than the plot is wide lies
    between."""
    points = plot.get("points", POINTS)
    for number, lines in enumerate(runs):
        for i, line in enumerate(lines):
            name = line.name if number == 0 else None
            if labels and len(runs) > 1 and (len(lines) == 1 or (number and i == 0)):
                name = labels[number]
            name = name if labels else None
            colour = COLOURS[i % len(COLOURS)]
            if plot.get("envelope") and len(line.times) > BINS:
                x, low, high = _between(line.times, line.values)
                ax.fill_between(x / seconds, low, high, color=colour, alpha=0.45, linewidth=0.3,
                                label=name and f"{name}: least to most")  # fmt: skip
                continue
            x, y = envelope(line.times, line.values, points)
            ax.plot(
                x / seconds, y, color=colour, label=name,
                drawstyle="steps-post" if line.stepped else "default",
                **(_FIRST if number == 0 else _OTHER),
            )  # fmt: skip


def _draw_limits(
    ax: Any, limits: list[tuple[str, float, bool]], signed: bool, always: bool = True
) -> None:
    """Limit lines and bands (name, value, filled), on both sides of zero where `signed`; those that
    are beyond what is drawn only where `always`."""
    low, high = ax.get_ylim()
    bands = iter(BANDS * len(limits))
    for name, value, filled in limits:
        colour = next(bands) if filled else LIMIT
        if not always and value > max(-low, high):
            continue
        text = f"{'±' if signed else ''}{value:.4g}  {name}" if always else None
        if filled:
            ax.axhspan(-value if signed else 0.0, value, color=colour, alpha=0.16, label=text,
                       linewidth=0)  # fmt: skip
            continue
        for sign, label in ((1.0, text), (-1.0, None)) if signed else ((1.0, text),):
            ax.axhline(sign * value, color=LIMIT, linewidth=0.9, linestyle=":", label=label)


def lines_of(plot: dict[str, Any], results: Results, unit: str) -> list[Line]:
    """The lines of a scenario's plot in a run; none for a series that is not recorded."""
    known = set(results.names())
    if "derive" in plot:
        return _derived(plot, results, unit) if known.issuperset(plot["signals"]) else []
    shown = (s for s in plot["signals"] if s in known)
    return [line for signal in shown for line in _lines(plot, results, signal, unit)]


def _derived(plot: dict[str, Any], results: Results, unit: str) -> list[Line]:
    """The lines that a plot derives from its signals."""
    found = derived.of_entry(plot)
    assert found is not None
    quantity, options = found
    series = [results.values(s) for s in plot["signals"]]
    values = quantity.rows(results.times(), series, options)
    values = values * scale(quantity.unit or results.attribute(plot["signals"][0], "unit"), unit)
    times = results.times()[: len(values)]
    names = plot.get("components", quantity.names)
    return [Line(n, times, values[:, i]) for i, n in enumerate(names) if n]


def _lines(plot: dict[str, Any], results: Results, signal: str, unit: str) -> list[Line]:
    """The lines of a signal: one an element, or its size."""
    values = results.values(signal).astype(float) * scale(results.attribute(signal, "unit"), unit)
    times = results.times(signal)
    stepped = results.attribute(signal, "class") == "interval"
    prefix = "" if len(plot["signals"]) == 1 else signal.partition(".")[2]
    if values.ndim == 1:
        return [Line(prefix, times, values, stepped)]
    if plot.get("norm"):
        return [Line(prefix, times, np.linalg.norm(values, axis=1), stepped)]
    # an element without a name is not shown (a wheel that is not there)
    names = plot.get("components") or [str(i + 1) for i in range(values.shape[1])]
    return [
        Line(f"{prefix} {name}".strip(), times, values[:, i], stepped)
        for i, name in enumerate(names)
        if name
    ]


def _limits(
    plot: dict[str, Any], parameters: dict[str, Any], unit: str
) -> list[tuple[str, float, bool]]:
    """(name, value, filled) of the limit lines, or bands about zero: products of parameters, or
    numbers, that hold in this run."""
    limits = []
    for entry in plot.get("limits", []):
        spec = entry if isinstance(entry, dict) else {"value": entry}
        if any(_parameter(parameters, k) == v for k, v in spec.get("unless", {}).items()):
            continue
        value, name = spec["value"], "limit"
        if isinstance(value, str):
            name = value.partition("[")[0]
            value, own = product(value, parameters)
            value *= factor(own, unit, f'of "{spec["value"]}"')
        limits.append((spec.get("name", name), float(value), bool(spec.get("fill"))))
    return limits


def _parameter(parameters: dict[str, Any], name: str) -> Any:
    """The value of `component.parameter` or `component.parameter[i]`; None if unknown."""
    try:
        return value_of(name, parameters)[0]
    except DesatError:
        return None


def _between(x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Times, least and most of each of BINS parts of a line."""
    edges = np.linspace(0, len(x), BINS + 1).astype(int)
    parts = [(x[a], y[a:b].min(), y[a:b].max()) for a, b in pairwise(edges)]
    times, low, high = np.array(parts).T
    return times, low, high


def envelope(x: Any, y: Any, points: int = POINTS) -> tuple[Any, Any]:
    """What a line of many points looks like: of each bin its least and its largest point, and the
    ends, some `points` in all."""
    if len(x) <= points:
        return x, y
    size = -(-2 * len(x) // points)  # rows of a bin
    bins = len(x) // size
    whole, first = np.asarray(y[: bins * size]).reshape(bins, size), np.arange(bins) * size
    index = [first + whole.argmin(axis=1), first + whole.argmax(axis=1), [0, len(x) - 1]]
    if len(rest := y[bins * size :]):
        index.append([bins * size + rest.argmin(), bins * size + rest.argmax()])
    kept = np.unique(np.concatenate(index))
    return x[kept], y[kept]
