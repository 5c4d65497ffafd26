"""Figures of a campaign, as SVG text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..figures.canvas import Axes, Figure
from ..figures.style import COLOURS, DASHED, DOTTED, LIMIT, WIDTH, axis_label, figure, time_axis

Array = NDArray[np.float64]
LEVELS = (5.0, 50.0, 95.0, 99.0)


def percentiles(
    title: str, unit: str, times: Array, curves: Array, worst: Sequence[tuple[int, Array]],
    limits: Sequence[tuple[str, float]] = (),
) -> str:  # fmt: skip
    """Percentile curves of envelopes (cases, parts) at times (parts,), their extremes, the worst
    cases by name, and limits by name."""
    fig, ax = figure(3.3)
    scale, time_unit = time_axis(times)
    x = times / scale
    known = np.isfinite(curves).any(axis=0)
    bands = np.full((len(LEVELS) + 2, len(times)), np.nan)
    bands[:, known] = np.nanpercentile(curves[:, known], (0.0, *LEVELS, 100.0), axis=0)
    low, p5, p50, p95, p99, high = bands
    ax.area(x, low, high, COLOURS[0], alpha=0.12, label="all cases")
    ax.area(x, p5, p95, COLOURS[0], alpha=0.28, label="5 to 95 %")
    ax.plot(x, p50, COLOURS[0], width=1.5, label="median")
    ax.plot(x, p99, COLOURS[4], label="99 %")
    for i, (case, line) in enumerate(worst):
        ax.plot(x, line, COLOURS[1 + 2 * (i % 2)], width=0.8, dash=((), DASHED, DOTTED)[i % 3],
                label=f"case {case}")  # fmt: skip
    for i, (name, value) in enumerate(limits):
        ax.level(value, LIMIT, width=1.2, dash=(DASHED, (2.0, 2.0), (6.0, 2.0, 1.0, 2.0))[i % 3],
                 label=name)  # fmt: skip
    ax.x.label, ax.y.label = f"time [{time_unit}]", axis_label(title, unit, 2.4)
    ax.y.low = 0.0
    return fig.svg()


def distribution(title: str, unit: str, values: Array, limits: Sequence[tuple[str, float]]) -> str:
    """Histogram and cumulative curve of a number, with the limits of requirements."""
    fig = Figure(WIDTH, 2.7)
    ax = fig.add(right=0.31)  # room for the other axis
    count, edges = np.histogram(values, min(60, max(8, int(np.sqrt(len(values))))))
    ax.bars(edges[:-1], edges[1:], count, COLOURS[0], alpha=0.55, label="cases")
    ax.x.label, ax.y.label = axis_label(title, unit, 6.0), "cases"
    ax.x.most, ax.y.low, ax.legend = 7, 0.0, 14
    ax.right = share = Axes(ax.left, ax.top, ax.width, ax.height)
    share.y.label, share.y.low, share.y.high = "cumulative [%]", 0.0, 100.0
    ordered = np.sort(values)
    share.plot(ordered, 100.0 * np.arange(1, len(ordered) + 1) / len(ordered), COLOURS[1],
               width=1.2, stepped=True, label="at most this (right)")  # fmt: skip
    for name, value in limits:
        ax.upright(value, LIMIT, width=1.2, dash=DASHED, label=f"{name} {value:g}")
    return fig.svg()


def flat(values: Any) -> Array:
    """A column as an array of floats, nan where it has nothing."""
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
