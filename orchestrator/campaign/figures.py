"""Figures of a campaign, as SVG text."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..study.drawing import COLOURS, LIMIT, axis_label, figure, legend, svg, time_axis

Array = NDArray[np.float64]
LEVELS = (5.0, 50.0, 95.0, 99.0)


def percentiles(
    title: str, unit: str, times: Array, curves: Array, worst: Sequence[tuple[int, Array]],
    limits: Sequence[tuple[str, float]] = (),
) -> str:  # fmt: skip
    """Percentile curves of envelopes (cases, parts) at times (parts,), their extremes, the worst
    cases by name, and limits by name."""
    fig, ax = figure(height=3.3)
    scale, time_unit = time_axis(times)
    x = times / scale
    known = np.isfinite(curves).any(axis=0)
    bands = np.full((len(LEVELS) + 2, len(times)), np.nan)
    bands[:, known] = np.nanpercentile(curves[:, known], (0.0, *LEVELS, 100.0), axis=0)
    low, p5, p50, p95, p99, high = bands
    ax.fill_between(x, low, high, color=COLOURS[0], alpha=0.12, linewidth=0, label="all cases")
    ax.fill_between(x, p5, p95, color=COLOURS[0], alpha=0.28, linewidth=0, label="5 to 95 %")
    ax.plot(x, p50, color=COLOURS[0], linewidth=1.5, label="median")
    ax.plot(x, p99, color=COLOURS[4], linewidth=1.0, label="99 %")
    for i, (case, line) in enumerate(worst):
        style = {
            "color": COLOURS[1 + 2 * (i % 2)],
            "linewidth": 0.8,
            "linestyle": ("-", "--", ":")[i % 3],
        }
        ax.plot(x, line, label=f"case {case}", **style)
    for i, (name, value) in enumerate(limits):
        dashes = ((0, (5, 2)), (0, (2, 2)), (0, (6, 2, 1, 2)))[i % 3]
        ax.axhline(value, color=LIMIT, linestyle=dashes, linewidth=1.2, label=name)
    ax.set_xlabel(f"time [{time_unit}]")
    ax.set_ylabel(axis_label(title, unit, 2.4))
    ax.set_ylim(bottom=0.0)
    legend(ax)
    return svg(fig)


def distribution(title: str, unit: str, values: Array, limits: Sequence[tuple[str, float]]) -> str:
    """Histogram and cumulative curve of a number, with the limits of requirements."""
    fig, ax = figure(height=2.7)
    bins = min(60, max(8, int(np.sqrt(len(values)))))
    ax.hist(values, bins=bins, color=COLOURS[0], alpha=0.55, label="cases")
    ax.locator_params(axis="x", nbins=7)  # those of large numbers would touch
    ax.set_xlabel(axis_label(title, unit, 6.0))
    ax.set_ylabel("cases")
    share = ax.twinx()
    ordered = np.sort(values)
    share.step(ordered, 100.0 * np.arange(1, len(ordered) + 1) / len(ordered), where="post",
               color=COLOURS[1], linewidth=1.2, label="at most this (right)")  # fmt: skip
    share.set_ylim(0.0, 100.0)
    share.set_ylabel("cumulative [%]")
    share.spines["top"].set_visible(False)
    for name, value in limits:
        ax.axvline(
            value, color=LIMIT, linestyle=(0, (5, 2)), linewidth=1.2, label=f"{name} {value:g}"
        )
    handles = [*ax.get_legend_handles_labels()[0], *share.get_legend_handles_labels()[0]]
    labels = [*ax.get_legend_handles_labels()[1], *share.get_legend_handles_labels()[1]]
    labels = [textwrap.fill(label, 14) for label in labels]
    ax.legend(handles, labels, fontsize=8, frameon=False, loc="center left",
              bbox_to_anchor=(1.13, 0.5), handlelength=1.6)  # fmt: skip
    return svg(fig)


def flat(values: Any) -> Array:
    """A column as an array of floats, nan where it has nothing."""
    return np.array([np.nan if v is None else float(v) for v in values], dtype=float)
