"""The axis of times of a plot, over strips of coloured bands: what modes and phases were meanwhile.

A strip stands for an Integer output whose values have names (`choices`).
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..engine.results import Results

COLOURS = ("#d4d4d4", "#7fb8de", "#f2b84b", "#93c98a", "#e07a6e", "#b79ad6", "#6f6f6f", "#c9a27a")
"""Of the values, by their number."""
HEIGHT = 0.13
"""Of a strip (in)."""
COLUMNS = 800
"""A span is drawn at least as long as one of so many columns, so that short ones are seen."""


def timeline(ax: Any, seconds: float, unit: str, results: Results | None = None) -> None:
    """Name the axis of times, in `unit` of so many seconds. Under it, a strip of coloured bands for
    each Integer of the results whose values have names: a mode, a phase."""
    ax.margins(x=0.01)
    named = [s for s in results.names() if results.choices(s)] if results else []
    if results is not None and named:
        height = HEIGHT * len(named)
        left, bottom, right, top = ax.get_position().extents
        bottom += height / ax.figure.get_figheight()
        ax.set_position((left, bottom, right - left, top - bottom))
        ax.tick_params(axis="x", pad=3.5 + 72.0 * height)  # points
        for row, name in enumerate(named):
            _strip(ax, row, name, results, seconds)
    ax.set_xlabel(f"time [{unit}]")


def _strip(ax: Any, row: int, signal: str, results: Results, seconds: float) -> None:
    """One strip, the `row`-th under the axis; the names of the values that occur go to the
    legend."""
    values, choices = results.values(signal), results.choices(signal)
    height = HEIGHT / (ax.get_position().height * ax.figure.get_figheight())
    place = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linewidth": 0}
    for value, spans in bands(results.times(), values):
        name = choices[value] if 0 <= value < len(choices) else str(value)
        ax.broken_barh(
            [(begin / seconds, (end - begin) / seconds) for begin, end in spans],
            (-height * (row + 1), 0.8 * height), color=COLOURS[value % len(COLOURS)],
            label=f"{signal.partition('.')[2]}: {name.replace('_', ' ')}", **place,
        )  # fmt: skip


def bands(
    times: Any, values: Any, columns: int = COLUMNS
) -> list[tuple[int, list[tuple[float, float]]]]:
    """(value, its spans from begin to end in s) of a series of integers, those that hold longest
    first. `times` may have one row more: the end of the last.

    A span is at least as long as a column, one of so many over all: what is shorter is seen.
    """
    if len(values) == 0:
        return []
    ends = np.append(times[1 : len(values)], times[-1])
    starts = times[: len(values)]
    shortest = (ends[-1] - starts[0]) / columns
    values_, counts = np.unique(values, return_counts=True)
    strips = []
    for value in values_[np.argsort(-counts, kind="stable")]:
        spans: list[tuple[float, float]] = []
        held = np.flatnonzero(values == value)
        breaks = np.flatnonzero(np.diff(held) > 1)
        firsts, lasts = held[np.append(0, breaks + 1)], held[np.append(breaks, len(held) - 1)]
        for first, last in zip(firsts, lasts, strict=True):
            begin, end = float(starts[first]), float(ends[last])
            end = max(end, min(begin + shortest, float(ends[-1])))
            if spans and begin - spans[-1][1] < shortest:
                begin = spans.pop()[0]  # no gap that nobody could see
            spans.append((begin, end))
        strips.append((int(value), spans))
    return strips
