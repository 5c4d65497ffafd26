"""The axis of times of a plot, over strips of coloured bands: what modes and phases were meanwhile.

A strip stands for an Integer output whose values have names (`choices`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..engine.recording.results import Results
from .canvas import Axes, Strip

COLOURS = ("#d4d4d4", "#7fb8de", "#f2b84b", "#93c98a", "#e07a6e", "#b79ad6", "#6f6f6f", "#c9a27a")
"""Of the values, by their number."""
COLUMNS = 800
"""A span is drawn at least as long as one of so many columns, so that short ones are seen."""


def timeline(ax: Axes, seconds: float, unit: str, results: Results | None = None) -> None:
    """Name the axis of times, in `unit` of so many seconds. Under it, a strip of coloured bands for
    each Integer of the results whose values have names: a mode, a phase."""
    ax.x.label, ax.x.margin = f"time [{unit}]", 0.01
    strips = results.once("strips", lambda: list(_strips(results))) if results else []
    for strip in strips:
        spans = [(begin / seconds, end / seconds) for begin, end in strip.spans]
        ax.strips.append(replace(strip, spans=spans))


def _strips(results: Results) -> Iterator[Strip]:
    """The strips of a run, over times in s."""
    named = [(s, choices) for s in results.names() if (choices := results.choices(s))]
    for row, (signal, choices) in enumerate(named):
        for value, spans in bands(results.times(), results.values(signal)):
            name = choices[value] if 0 <= value < len(choices) else str(value)
            label = f"{signal.partition('.')[2]}: {name.replace('_', ' ')}"
            yield Strip(row, spans, COLOURS[value % len(COLOURS)], label)


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
