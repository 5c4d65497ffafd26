"""How our figures look: colours, axes, units, legends; a figure as SVG text."""

from __future__ import annotations

import io
import os
import re
import textwrap
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from ..files import places

if TYPE_CHECKING:  # half a second, which only what draws needs
    from matplotlib.figure import Figure

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
    fig = blank(width, height)
    return fig, axes(fig, BOTTOM, TOP)


def blank(width: float, height: float) -> Figure:
    """A figure without axes."""
    if places.no_home():  # it would say where it keeps what it finds of fonts
        os.environ.setdefault("MPLCONFIGDIR", str(places.cache() / "matplotlib"))
    backend = os.environ.pop("MPLBACKEND", None)  # we need none, and one that is unknown is refused
    try:
        from matplotlib.figure import Figure
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    return Figure(figsize=(width, height))


def axes(fig: Figure, bottom: float, top: float) -> Any:
    """Axes in our style from bottom to top of a figure, as shares of it."""
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
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "desat", "svg.fonttype": "path"}):
        fig.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return re.sub(r'width="[\d.]+pt" height="[\d.]+pt"', "", text[text.index("<svg") :], count=1)


def between(x: Any, y: Any) -> tuple[Any, Any, Any]:
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
