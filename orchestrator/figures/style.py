"""Define the look of our figures: colours, sizes and units."""

from __future__ import annotations

import textwrap
from itertools import pairwise
from typing import Any

import numpy as np

from ..numbers.text import spell_unit
from .canvas import Axes, Figure

COLOURS = (
    "#0b62a4",
    "#d1495b",
    "#2e8b57",
    "#8a5fbf",
    "#e08e0b",
    "#444444",
    "#1aa6b7",
    "#8b5a2b",
    "#a3b72c",
)
LIMIT = "#b22222"
# colours of filled limits, in order
BANDS = ("#b22222", "#e0a100", "#5b7f95")
BINS = 240  # parts of a line whose minimum and maximum are drawn as an area
# in: width and height of a figure with one pair of axes, and height of one with two
WIDTH, HEIGHT, PANELS = 7.2, 2.9, 4.9
DOTTED, DASHED = (1.0, 1.6), (5.0, 2.5)


def time_axis(times: np.ndarray[Any, Any]) -> tuple[float, str]:
    """Choose the unit of a time span; return its seconds and its name."""
    span = float(times[-1] - times[0]) if len(times) else 0.0
    if span > 3 * 3600:
        return 3600.0, "h"
    return (60.0, "min") if span > 1200 else (1.0, "s")


def figure(height: float = HEIGHT) -> tuple[Figure, Axes]:
    """Build a figure in our style with a height (in), and its axes."""
    fig = Figure(WIDTH, height)
    return fig, fig.add()


def axis_label(quantity: str, unit: str, height: float) -> str:
    """Return `quantity [unit]`, wrapped to fit an axis of a height (in)."""
    bracket = f"[{spell_unit(unit)}]".replace(" ", "\u00a0") if spell_unit(unit) else ""
    return textwrap.fill(f"{quantity} {bracket}".strip(), max(14, int(height * 14)))


def between(x: Any, y: Any) -> tuple[Any, Any, Any]:
    """Compute times, minimum and maximum of each of `BINS` parts of a line."""
    edges = np.linspace(0, len(x), BINS + 1).astype(int)
    parts = [(x[a], y[a:b].min(), y[a:b].max()) for a, b in pairwise(edges)]
    times, low, high = np.array(parts).T
    return times, low, high
