"""Figures of pages, as SVG text: several runs on one pair of axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .drawing import COLOURS, LIMIT, figure, legend, svg, time_axis
from .series import Series
from .strips import timeline


def curves(
    data: Sequence[tuple[str, Series]], ylabel: str, *, limits: Sequence[tuple[str, float]] = (),
    steps: bool = False, log: bool = False, height: float = 2.9, dashed: Sequence[str] = (),
) -> str:  # fmt: skip
    """Labelled lines over time; `limits` are labelled horizontal lines, drawn at + and - where
    something is below zero; `dashed` names lines."""
    fig, ax = figure(height=height)
    seconds, unit = time_axis(data[0][1].times)
    for i, (label, line) in enumerate(data):
        ax.plot(
            line.times / seconds, line.values, color=COLOURS[i % len(COLOURS)], linewidth=1.3,
            label=label, drawstyle="steps-post" if steps else "default",
            linestyle=(0, (4, 2)) if label in dashed else "-",
        )  # fmt: skip
    signs = (1, -1) if any((line.values < 0.0).any() for _, line in data) else (1,)
    for name, value in limits:
        for sign in signs:
            ax.axhline(sign * value, color=LIMIT, linewidth=0.9, linestyle=":",
                       label=f"{name} {value:g}" if sign > 0 else None)  # fmt: skip
    if log:
        ax.set_yscale("log")
    timeline(ax, seconds, unit)
    ax.set_ylabel(ylabel, fontsize=9)
    legend(ax)
    return svg(fig)


def bars(
    groups: dict[str, dict[str, float]], ylabel: str, *, log: bool = False,
    printed: dict[str, dict[str, float]] | None = None,
) -> str:  # fmt: skip
    """Bars: {group: {label: value}}, one colour a label; `printed`: the paper's values of some, as
    marks on theirs."""
    fig, ax = figure()
    labels = list(dict.fromkeys(label for values in groups.values() for label in values))
    width = 0.8 / len(labels)
    for i, label in enumerate(labels):
        x = np.arange(len(groups)) + (i - (len(labels) - 1) / 2) * width
        ax.bar(x, [v.get(label, np.nan) for v in groups.values()], width * 0.92,
               color=COLOURS[i % len(COLOURS)], label=label)  # fmt: skip
        marks = [(printed or {}).get(group, {}).get(label, np.nan) for group in groups]
        first = "paper" if printed and i == 0 else None
        ax.plot(x, marks, "D", color="black", markersize=4, markerfacecolor="white", label=first)
    ax.set_xticks(range(len(groups)), list(groups))
    ax.grid(False, axis="x")
    if log:
        ax.set_yscale("log")
    ax.set_ylabel(ylabel, fontsize=9)
    legend(ax)
    return svg(fig)


def scatter(
    groups: Mapping[str, tuple[Sequence[float], Sequence[float]]], xlabel: str, ylabel: str, *,
    diagonal: str = "", joined: bool = False, log: str = "", size: float = 5.0,
) -> str:  # fmt: skip
    """Points of a size (pt): {label: (x, y)}, one without a label in no legend; `diagonal` names
    the line y = x, empty for none; `joined`: a line from each to the next; `log`: the axes that are
    logarithmic, of "x", "y", "xy"."""
    fig, ax = figure()
    for i, (label, (x, y)) in enumerate(groups.items()):
        ax.plot(x, y, "o-" if joined else "o", color=COLOURS[i % len(COLOURS)], label=label,
                markersize=size, linewidth=1.0, rasterized=len(x) > 2000)  # fmt: skip
    if "x" in log:
        ax.set_xscale("log")
    if "y" in log:
        ax.set_yscale("log")
    if diagonal:
        top = max(max(*x, *y) for x, y in groups.values())
        ax.plot([0, top], [0, top], color="#888888", linewidth=0.9, linestyle=":", label=diagonal)
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel, fontsize=9)
    legend(ax)
    return svg(fig)
