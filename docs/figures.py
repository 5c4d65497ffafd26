"""Figures of the generated pages: several runs on one pair of axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from desat.study.plots import COLOURS, figure, legend, svg, time_axis

Curve = tuple[str, Any, Any]
"""label, times (s), values"""


def curves(
    data: Sequence[Curve], ylabel: str, *, limits: Sequence[tuple[str, float]] = (),
    steps: bool = False, log: bool = False, height: float = 2.9, dashed: Sequence[str] = (),
) -> str:  # fmt: skip
    """Lines over time as SVG; `limits` are labelled horizontal lines, drawn at + and -."""
    fig, ax = figure(height=height)
    seconds, unit = time_axis(np.asarray(data[0][1]))
    for i, (label, times, values) in enumerate(data):
        ax.plot(
            np.asarray(times) / seconds, values, color=COLOURS[i % len(COLOURS)], linewidth=1.3,
            label=label, drawstyle="steps-post" if steps else "default",
            linestyle=(0, (4, 2)) if label in dashed else "-",
        )  # fmt: skip
    for name, value in limits:
        for sign in (1, -1) if ax.get_ylim()[0] < 0 else (1,):
            ax.axhline(sign * value, color="#b22222", linewidth=0.9, linestyle=":",
                       label=f"{name} {value:g}" if sign > 0 else None)  # fmt: skip
    if log:
        ax.set_yscale("log")
    ax.set_xlabel(f"time [{unit}]")
    ax.set_ylabel(ylabel)
    ax.margins(x=0.01)
    legend(ax)
    return svg(fig)


def bars(groups: dict[str, dict[str, float]], ylabel: str, *, log: bool = False) -> str:
    """Bars as SVG: {group: {label: value}}, one colour a label."""
    fig, ax = figure()
    labels = list(dict.fromkeys(label for values in groups.values() for label in values))
    width = 0.8 / len(labels)
    for i, label in enumerate(labels):
        x = np.arange(len(groups)) + (i - (len(labels) - 1) / 2) * width
        ax.bar(x, [v.get(label, np.nan) for v in groups.values()], width * 0.92,
               color=COLOURS[i % len(COLOURS)], label=label)  # fmt: skip
    ax.set_xticks(range(len(groups)), list(groups))
    ax.grid(False, axis="x")
    if log:
        ax.set_yscale("log")
    ax.set_ylabel(ylabel)
    legend(ax)
    return svg(fig)
