"""Define the look of our figures: colours, sizes and units."""

from __future__ import annotations

import re
import textwrap
from itertools import pairwise
from typing import Any

import numpy as np

from ..numbers.text import spell_unit
from . import canvas
from .canvas import BOTTOM_MARGIN, Axes, Figure

# Colours of series on a light page, each with its own on a dark one. Any two differ by
# 15 (CIEDE2000) or more for normal, deuteranopic and protanopic eyes, by 12 for
# tritanopic ones, and by a contrast of 3 from the page (tests/figures/test_palette.py).
PALETTE = {
    "#244c6e": "#12a7ff",  # blue
    "#d0759c": "#c59ea6",  # rose
    "#318b61": "#109070",  # green
    "#574fdf": "#96769d",  # violet
    "#8f5c01": "#ffa106",  # ochre
    "#292c30": "#edfff8",  # ink
    "#3298e9": "#37e2fe",  # sky
    "#573a1f": "#a6632f",  # brown
    "#96981c": "#f7ffa1",  # lime
}
COLOURS = tuple(PALETTE)
INK = "#292c30"  # of the palette; drawings whose lines are not series leave it out
LIMIT = "#b22222"
DARK = {**PALETTE, LIMIT: "#ff7b72"}  # each colour that has its own on a dark page
# colours of filled limits, in order
BANDS = ("#b22222", "#e0a100", "#5b7f95")
BINS = 240  # parts of a line whose minimum and maximum are drawn as an area
# in: width and height of a figure with one pair of axes, and height of one with two
WIDTH, HEIGHT, PANELS = 7.2, 2.9, 4.9
LOW = 2.4  # in, below which the rim under the axes is not made smaller
SMALL_HEIGHT = 1.9  # in, of a figure that shows what is all but zero
DOTTED, DASHED = (1.0, 1.6), (5.0, 2.5)
# Dashes of series in turn, so that they can be told apart without colours.
DASHES: tuple[tuple[float, ...], ...] = (
    (),
    (6.0, 2.0),
    (2.0, 2.0),
    (7.0, 2.0, 1.5, 2.0),
    (1.0, 1.6),
)


def time_axis(times: np.ndarray[Any, Any]) -> tuple[float, str]:
    """Choose the unit of a time span; return its seconds and its name."""
    span = float(times[-1] - times[0]) if len(times) else 0.0
    if span > 5 * 86400:
        return 86400.0, "d"
    if span > 3 * 3600:
        return 3600.0, "h"
    return (60.0, "min") if span > 1200 else (1.0, "s")


def figure(height: float = HEIGHT) -> tuple[Figure, Axes]:
    """Build a figure in our style with a height (in), and its axes."""
    fig = Figure(WIDTH, height)
    # labels keep their room in a low figure
    return fig, fig.add(bottom=BOTTOM_MARGIN * max(1.0, LOW / height))


def axis_label(quantity: str, unit: str, height: float) -> str:
    """Return `quantity [unit]`, wrapped to fit an axis of a height (in)."""
    bracket = f"[{spell_unit(unit)}]".replace(" ", "\u00a0") if spell_unit(unit) else ""
    return textwrap.fill(f"{quantity} {bracket}".strip(), max(14, int(height * 14)))


def on_dark(svg: str) -> str:
    """Return a figure as it is on a dark page."""
    others = {"#fff": "#0d1117", canvas.INK: "#dddddd", canvas.GRID: "#3a3d3f"}
    hues = {**DARK, **others}
    return re.sub(
        r'"(#[0-9a-f]{3,6})"', lambda hue: f'"{hues.get(hue[1], hue[1])}"', svg
    )


def between(x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Compute times, minimum and maximum of each of `BINS` parts of a line."""
    edges = np.linspace(0, len(x), BINS + 1).astype(int)
    parts = [(x[a], y[a:b].min(), y[a:b].max()) for a, b in pairwise(edges)]
    times, low, high = np.array(parts).T
    return times, low, high
