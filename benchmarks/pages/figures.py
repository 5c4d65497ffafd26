"""Figures of pages, as SVG text: several runs on one pair of axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from desat.figures.canvas import Ticks
from desat.figures.plots import timeline
from desat.figures.style import COLOURS, DOTTED, HEIGHT, LIMIT, figure, time_axis

from .series import Series


def curves(
    data: Sequence[tuple[str, Series]],
    ylabel: str,
    *,
    limits: Sequence[tuple[str, float]] = (),
    steps: bool = False,
    log: bool = False,
    height: float = HEIGHT,
    dashed: Sequence[str] = (),
) -> str:
    """Labelled lines over time; `limits` are labelled horizontal lines, drawn at + and
    - where something is below zero; `dashed` names lines."""
    fig, ax = figure(height)
    seconds, unit = time_axis(data[0][1].times)
    ax.y.log, ax.y.label = log, ylabel
    for i, (label, line) in enumerate(data):
        ax.plot(
            line.times / seconds,
            line.values,
            COLOURS[i % len(COLOURS)],
            width=1.3,
            label=label,
            stepped=steps,
            dash=(4.0, 2.0) if label in dashed else (),
        )
    signs = (1, -1) if any((line.values < 0.0).any() for _, line in data) else (1,)
    for name, value in limits:
        for sign in signs:
            ax.level(
                sign * value,
                LIMIT,
                width=0.9,
                dash=DOTTED,
                label=f"{name} {value:g}" if sign > 0 else "",
            )
    timeline(ax, seconds, unit)
    return fig.svg()


def bars(
    groups: dict[str, dict[str, float]],
    ylabel: str,
    *,
    log: bool = False,
    printed: dict[str, dict[str, float]] | None = None,
) -> str:
    """Bars: {group: {label: value}}, one colour a label; `printed`: the paper's values
    of some, as marks on theirs."""
    fig, ax = figure()
    ax.y.log, ax.y.label = log, ylabel
    ax.x.ticks = Ticks(tuple(map(float, range(len(groups)))), tuple(groups))
    labels = list(
        dict.fromkeys(label for values in groups.values() for label in values)
    )
    width = 0.8 / len(labels)
    for i, label in enumerate(labels):
        x = np.arange(len(groups)) + (i - (len(labels) - 1) / 2) * width
        heights = [v.get(label, np.nan) for v in groups.values()]
        half = 0.46 * width
        ax.bars(x - half, x + half, heights, COLOURS[i % len(COLOURS)], label=label)
        if not log and np.nanmin(heights, initial=0.0) == 0.0:
            ax.y.low = 0.0
        marks = [(printed or {}).get(group, {}).get(label, np.nan) for group in groups]
        ax.plot(
            x,
            marks,
            "#000000",
            width=0.0,
            marker=4.5,
            hollow=True,
            label="paper" if printed and i == 0 else "",
        )
    return fig.svg()
