"""Plots for people, as SVG text: units, legends, limit lines."""

from __future__ import annotations

import io
import re
import textwrap
from itertools import pairwise
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from ..engine.results import Results
from ..system.expression import factor, product
from . import derived
from .numbers import scale

COLOURS = ("#0b62a4", "#d1495b", "#2e8b57", "#8a5fbf", "#e08e0b", "#444444")
POINTS = 3000
"""More points than a plot is wide are thinned, keeping each bin's least and largest."""
LEGEND_WIDTH = 24
"""Characters that there is room for beside the axes."""

_FIRST: dict[str, Any] = {"linestyle": "-", "linewidth": 1.4}
_OTHER: dict[str, Any] = {"linestyle": (0, (4, 2)), "linewidth": 1.0, "alpha": 0.75}
_PRETTY = {"A.m2": "A m²", "N.m": "N m", "N.m.s": "N m s", "uN.m": "µN m", "mN.m": "mN m",
           "mN.m.s": "mN m s", "uT": "µT", "A2.m4.s": "A² m⁴ s", "1": ""}  # fmt: skip


def pretty_unit(unit: str) -> str:
    """A unit's name as people write it: `N.m.s` -> `N m s`."""
    return _PRETTY.get(unit, unit)


def time_axis(times: np.ndarray[Any, Any]) -> tuple[float, str]:
    """(seconds in the unit, unit) that suit a time span."""
    span = float(times[-1] - times[0]) if len(times) else 0.0
    if span > 3 * 3600:
        return 3600.0, "h"
    return (60.0, "min") if span > 1200 else (1.0, "s")


def figure(width: float = 7.2, height: float = 2.9) -> tuple[Figure, Any]:
    """A figure in our style, and its axes."""
    fig = Figure(figsize=(width, height))
    ax = fig.add_axes((0.095, 0.16, 0.655, 0.76))  # the same for all, so that times align
    ax.grid(True, color="#dddddd", linewidth=0.6)
    ax.set_axisbelow(True)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    return fig, ax


def legend(ax: Any) -> None:
    """The legend beside the axes, where there is something to name; long labels are wrapped."""
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        ax.legend(
            handles, [textwrap.fill(label, LEGEND_WIDTH) for label in labels], fontsize=8,
            frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5),
        )  # fmt: skip


def svg(fig: Figure) -> str:
    """The figure as an <svg> element, the same for the same data."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "desat", "svg.fonttype": "path"}):
        fig.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', "", text[text.index("<svg") :], count=1)


def series_plot(
    plot: dict[str, Any], runs: list[tuple[str, Results, dict[str, Any]]]
) -> str | None:
    """The SVG of a scenario's `[[plots]]` entry over runs (label, results, parameters).

    The first run is drawn in colours, the others dashed. None where a series is not recorded.
    """
    known = set(runs[0][1].names())
    signals = [s for s in plot["signals"] if s in known]
    if not signals or ("derive" in plot and len(signals) < len(plot["signals"])):
        return None
    fig, ax = figure()
    seconds, time_unit = time_axis(runs[0][1].times())
    found = derived.of_entry(plot)
    own = found[0].unit if found else ""
    unit = plot.get("unit") or own or runs[0][1].attribute(signals[0], "unit")
    least = 0.0
    for number, (label, results, _) in enumerate(runs):
        if "derive" in plot:
            lines = _derived(plot, results, unit)
        else:
            lines = [line for s in signals for line in _lines(plot, results, s, unit)]
        for i, (name, times, values, stepped) in enumerate(lines):
            named = name if number == 0 else None
            if len(runs) > 1 and (len(lines) == 1 or (number and i == 0)):
                named = label
            x, y = _thinned(times, values, plot.get("points", POINTS))
            least = min(least, float(np.nanmin(y, initial=0.0)))
            ax.plot(
                x / seconds,
                y,
                color=COLOURS[i % len(COLOURS)],
                label=named,
                drawstyle="steps-post" if stepped else "default",
                **(_FIRST if number == 0 else _OTHER),
            )
    for name, value, filled in _limits(plot, runs[0][2], unit):
        both = least < 0.0  # a size has no limit below zero
        text = f"{'±' if both else ''}{value:.4g}  {name}"
        if filled:
            ax.axhspan(-value if both else 0.0, value, color="#b22222", alpha=0.08, label=text)
            continue
        for sign in (1.0, -1.0) if both else (1.0,):
            ax.axhline(
                sign * value,
                color="#b22222",
                linewidth=0.9,
                linestyle=":",
                label=text if sign > 0 else None,
            )
    if plot.get("log"):
        ax.set_yscale("log")
    ax.set_xlabel(f"time [{time_unit}]")
    ax.set_ylabel(f"[{pretty_unit(unit)}]" if pretty_unit(unit) else "")
    ax.margins(x=0.01)
    legend(ax)
    return svg(fig)


def _derived(plot: dict[str, Any], results: Results, unit: str) -> list[tuple[str, Any, Any, bool]]:
    """The lines that a plot derives from its signals."""
    found = derived.of_entry(plot)
    assert found is not None
    quantity, options = found
    series = [results.values(s) for s in plot["signals"]]
    values = quantity.rows(results.times(), series, options)
    values = values * scale(quantity.unit or results.attribute(plot["signals"][0], "unit"), unit)
    times = results.times()[: len(values)]
    names = plot.get("components", quantity.names)
    return [(n, times, values[:, i], False) for i, n in enumerate(names)]


def _lines(
    plot: dict[str, Any], results: Results, signal: str, unit: str
) -> list[tuple[str, Any, Any, bool]]:
    """(name, times, values, stepped) of each line of a signal, in the plot's unit."""
    if signal not in results.names():
        return []
    values = results.values(signal).astype(float) * scale(results.attribute(signal, "unit"), unit)
    times = results.times(signal)
    stepped = results.attribute(signal, "class") == "interval"
    prefix = "" if len(plot["signals"]) == 1 else signal.partition(".")[2]
    if values.ndim == 1:
        return [(prefix, times, values, stepped)]
    if plot.get("norm"):
        return [(prefix, times, np.linalg.norm(values, axis=1), stepped)]
    # fewer names than elements: the rest is not shown (a wheel that is not there)
    names = plot.get("components") or [str(i + 1) for i in range(values.shape[1])]
    return [
        (f"{prefix} {name}".strip(), times, values[:, i], stepped) for i, name in enumerate(names)
    ]


def _limits(
    plot: dict[str, Any], parameters: dict[str, Any], unit: str
) -> list[tuple[str, float, bool]]:
    """(name, value, filled) of the limit lines, or bands about zero: parameters, or numbers, that
    hold in this run."""
    found = []
    for limit in plot.get("limits", []):
        spec = {"value": limit} if not isinstance(limit, dict) else limit
        if any(_parameter(parameters, k)[0] == v for k, v in spec.get("unless", {}).items()):
            continue
        filled = bool(spec.get("fill"))
        if isinstance(spec["value"], str):
            value, own = product(spec["value"], parameters)
            name = spec["value"].partition("[")[0]
            scaled = value * factor(own, unit, f'of "{spec["value"]}"')
            found.append((spec.get("name", name), scaled, filled))
        else:
            found.append((spec.get("name", "limit"), float(spec["value"]), filled))
    return found


def _parameter(parameters: dict[str, Any], name: str) -> tuple[Any, str]:
    """(value, unit) of `component.parameter` or `component.parameter[i]`; (None, "") if unknown."""
    component, _, rest = name.partition(".")
    variable, _, index = rest.partition("[")
    entry = parameters.get(component, {}).get(variable)
    if entry is None:
        return None, ""
    value = entry["value"]
    if index:
        value = value[int(index.rstrip("]")) - 1]
    return value, entry["unit"]


def _thinned(x: Any, y: Any, points: int = POINTS) -> tuple[Any, Any]:
    if len(x) <= points:
        return x, y
    edges = np.linspace(0, len(x), points // 2 + 1).astype(int)
    keep: set[int] = set()
    for a, b in pairwise(edges):
        keep.update((a + int(np.argmin(y[a:b])), a + int(np.argmax(y[a:b]))))
    index = np.array(sorted(keep | {0, len(x) - 1}))
    return x[index], y[index]
