"""Tabulate a sweep, and write its page: curves or maps with the requirements."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..figures.canvas import Axes, Figure
from ..figures.plots import cell_ticks, colour_cells
from ..figures.style import COLOURS, DASHED, DASHES, LIMIT, axis_label, figure
from ..numbers.text import number as shown
from ..numbers.text import short_title, spell_unit
from ..report.report import figures_of, render, versions, write_page
from ..report.table import ROW_UNIT, Cell, Column, Row, Table, or_not_reached
from .sweep import Sweep, SweepPoint, text_of

LINES = 6  # most lines of a plot; more are maps
MAPS = 6  # most maps of a number
DRAWN = 6  # numbers that a page draws where there is no requirement
LEVELS = 7  # colours of a map


def tabulate(sweep: Sweep, names: Sequence[str] = ()) -> Table:
    """Tabulate numbers by value, with `names` by their titles; without, all by name.

    The longer side goes down the page.
    """
    points = sweep.points
    units = {name: sweep.units[name] for name in names or sweep.units}
    titles = {n: short_title(sweep.titles[n]) if names else n for n in units}
    is_judged = bool(sweep.answer)
    if len(units) <= len(points):
        columns = [
            *(Column(name) for name in sweep.axes),
            *(Column(titles[name], unit) for name, unit in units.items()),
            *([Column("holds", kind="text")] if is_judged else []),
        ]
        rows: list[Row] = [
            [
                *map(text_of, point.values.values()),
                *(_cell(point, name) for name in units),
                *([_holds(point)] if is_judged else []),
            ]
            for point in points
        ]
        return Table("", columns, rows)
    columns = [
        Column("", kind="text"),
        *(Column("", ROW_UNIT) for _ in points),
        Column("", kind="unit"),
    ]
    rows = [
        [axis, *(text_of(point.values[axis]) for point in points), ""]
        for axis in sweep.axes
    ]
    if is_judged:
        rows.append(["holds", *map(_holds, points), ""])
    rows += [
        [titles[name], *(_cell(point, name) for point in points), unit]
        for name, unit in units.items()
    ]
    return Table("", columns, rows, has_header=False)


def _holds(point: SweepPoint) -> Cell:
    """Return whether a combination holds."""
    return Cell("yes", mark="ok") if point.holds else Cell("no", mark="bad")


def _cell(point: SweepPoint, name: str) -> Cell:
    """Return a number at a point, and in how many samples it is not reached."""
    spread = point.summary.get(name)
    value = or_not_reached(spread.levels["median"] if spread else None)
    missing = spread.not_reached_text if spread and point.has_draws else ""
    verdicts = [v for row in point.rows for v in row.verdicts.values()]
    is_bad = any(v.number == name and not v.met for v in verdicts)
    return Cell(
        value,
        note=f"not reached: {missing}" if missing else "",
        mark="bad" if is_bad else "",
    )


def write(sweep: Sweep, path: Path) -> Path:
    """Write the page of a sweep and return its path.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    names = list(dict.fromkeys(r.number for r in sweep.requirements.values()))
    numbers = [name for name in names if name in sweep.units] or [*sweep.units][:DRAWN]
    path.parent.mkdir(parents=True, exist_ok=True)
    about = f"{len(sweep.points)} combinations"
    if sweep.draws:
        about += f", each with the same {sweep.draws} samples; numbers are medians"
    figures = [figure for n in numbers for figure in _draw(sweep, n)]
    maps_left = _maps(sweep) - MAPS
    if maps_left > 0:
        about += f"; {maps_left} of {_maps(sweep)} maps are left to the tables"
    page = render(
        "study.html",
        title=f"{sweep.scenario} over {' and '.join(sweep.axes)}",
        answer=sweep.answer,
        holds=sweep.holds,
        about=f"{about}.",
        first=[tabulate(sweep, numbers)],
        heading="All numbers",
        tables=[tabulate(sweep)],
        notes=sweep.warnings,
        versions=versions(),
        **figures_of(figures),
    )
    return write_page(path, page)


def _by_values(sweep: Sweep) -> list[str]:
    """Return the axes, the one with most values first."""
    return sorted(sweep.axes, key=lambda axis: -len(sweep.axes[axis]))


def _maps(sweep: Sweep) -> int:
    """Return the number of maps of a number, 0 where it is drawn as lines."""
    counts = [len(sweep.axes[axis]) for axis in _by_values(sweep)[1:]]
    return math.prod(counts[1:]) if math.prod(counts) > LINES else 0


def _draw(sweep: Sweep, name: str) -> Iterator[tuple[str, Figure]]:
    """Draw a number over the axis with most values, with captions.

    A line stands for each combination of the others. More than `LINES` are maps over
    the two axes with most values, one for each combination of the rest.
    """
    over, *others = _by_values(sweep)
    title = sweep.titles[name]
    if not _maps(sweep):
        yield title, _lines(sweep, name, over)
        return
    rest = others[1:]
    for values in [*itertools.product(*(sweep.axes[axis] for axis in rest))][:MAPS]:
        rest_values = dict(zip(rest, values, strict=True))
        points = [p for p in sweep.points if p.values.items() >= rest_values.items()]
        text = _text_of_values(rest_values)
        caption = f"{title}, {text}" if text else title
        yield caption, _map(sweep, name, points, (over, others[0]))


def _text_of_values(values: Mapping[str, Any]) -> str:
    """Return values of parameters as a readable text."""
    return ", ".join(f"{x} = {text_of(value)}" for x, value in values.items())


def _lines(sweep: Sweep, name: str, over: str) -> Figure:
    """Draw a number over an axis as lines, with its limits."""
    fig, ax = figure()
    _draw_lines(ax, sweep, name, over)
    for place, limit in _limits(sweep, name):
        ax.level(limit, LIMIT, width=1.2, dash=DASHED, label=f"{place} {shown(limit)}")
    ax.y.label = axis_label(short_title(sweep.titles[name]), sweep.units[name], 2.6)
    ax.x.label = axis_label(*sweep.axis_titles[over], 6.0)
    return fig


def _draw_lines(ax: Axes, sweep: Sweep, name: str, over: str) -> None:
    """Draw a number over an axis, a line for each combination of the others."""
    values = sweep.axes[over]
    is_numeric = all(
        isinstance(x, (int, float)) and not isinstance(x, bool) for x in values
    )
    at = np.array(values if is_numeric else range(len(values)), dtype=float)
    order = np.argsort(at, kind="stable")
    others = [axis for axis in sweep.axes if axis != over]
    lines: dict[tuple[int, ...], list[SweepPoint]] = {}
    for point in sweep.points:
        key = tuple(_place(sweep, point, axis) for axis in others)
        lines.setdefault(key, []).append(point)
    for k, line in enumerate(lines.values()):
        label = _text_of_values({x: line[0].values[x] for x in others})
        ax.plot(
            at[order],
            np.array([_value(point, name) for point in line])[order],
            COLOURS[k % len(COLOURS)],
            width=1.5,
            marker=5.0,
            dash=DASHES[k % len(DASHES)],
            label=label,
        )
    ax.x.log = is_numeric and bool(at.min() > 0.0 and at.max() >= 10.0 * at.min())
    if not is_numeric:
        ax.x.ticks = cell_ticks([text_of(x) for x in values])


def _place(sweep: Sweep, point: SweepPoint, axis: str) -> int:
    """Return the place of a point's value among those of an axis."""
    return list(sweep.axes[axis]).index(point.values[axis])


def _value(point: SweepPoint, name: str) -> float:
    """Return the median of a number at a point, nan where there is none."""
    spread = point.summary.get(name)
    value = spread.levels["median"] if spread else None
    return math.nan if value is None else value


def _limits(sweep: Sweep, name: str) -> Iterator[tuple[str, float]]:
    """Yield `at most` and `at least` with the limits of a number."""
    for entry in sweep.requirements.values():
        if entry.number == name:
            extremes = (("at most", entry.max), ("at least", entry.min))
            yield from ((word, x) for word, x in extremes if x is not None)


def _map(
    sweep: Sweep, name: str, points: Sequence[SweepPoint], axes: tuple[str, str]
) -> Figure:
    """Draw a number at points over two axes, with dots where it is beyond a limit.

    The colours are those of the number at all points of the sweep.
    """
    over, up = axes
    values = np.full((len(sweep.axes[up]), len(sweep.axes[over])), np.nan)
    beyond = np.zeros(values.shape, bool)
    limits = [r for r in sweep.requirements.values() if r.number == name]
    for point in points:
        cell = tuple(_place(sweep, point, axis) for axis in (up, over))
        values[cell] = _value(point, name)
        beyond[cell] = not all(r.holds(values[cell]) for r in limits)
    fig, ax = figure(3.4)
    everywhere = np.array([_value(point, name) for point in sweep.points])
    _colour(ax, values, everywhere, spell_unit(sweep.units[name]))
    row, column = np.nonzero(beyond)
    if len(row):
        ax.plot(
            column + 0.5,
            row + 0.5,
            LIMIT,
            width=0.0,
            marker=6.0,
            label=" or ".join(f"not {w} {shown(x)}" for w, x in _limits(sweep, name)),
        )
    ax.x.label = axis_label(*sweep.axis_titles[over], 6.0)
    ax.y.label = axis_label(*sweep.axis_titles[up], 2.6)
    ax.x.ticks = cell_ticks([text_of(x) for x in sweep.axes[over]])
    ax.y.ticks = cell_ticks([text_of(x) for x in sweep.axes[up]])
    return fig


def _colour(ax: Axes, values: Any, everywhere: Any, unit: str) -> None:
    """Colour cells by equal parts of the range of all values."""
    there = np.isfinite(values)
    is_finite = np.isfinite(everywhere)
    finite = everywhere[is_finite] if is_finite.any() else np.zeros(1)
    edges = np.linspace(finite.min(), finite.max(), LEVELS + 1)
    levels = np.clip(np.searchsorted(edges, values, "right") - 1, 0, LEVELS - 1)
    levels[~there] = LEVELS
    texts = [f"{shown(a)} to {shown(b)} {unit}" for a, b in itertools.pairwise(edges)]
    colour_cells(ax, levels, texts, "not reached")
