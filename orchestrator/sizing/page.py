"""Write the pages of a sizing and of its map, with their figures."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..figures.canvas import Figure, Ticks
from ..figures.plots import cell_ticks, colour_cells
from ..figures.style import (
    COLOURS,
    DASHED,
    DASHES,
    DOTTED,
    LIMIT,
    axis_label,
    figure,
    time_axis,
)
from ..numbers.text import format_momenta
from ..report.cases import tabulate_margins
from ..report.report import figures_of, render, versions, write_page
from ..report.table import Table
from . import tables
from .dumps import DumpSizing
from .map import SizingMap
from .margins import tabulate_spread
from .result import Sizing
from .trade import DumpMap


def write_sizing(sizing: Sizing, path: Path) -> Path:
    """Write the page of a sizing and return its path.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    sources = tables.tabulate_sources(sizing.sources, sizing.unexplained)
    tables_shown = [
        sources,
        tables.tabulate_quantities(sizing),
        *([tables.tabulate_conditions(sizing)] if sizing.best else []),
        tables.tabulate_points(sizing.curve),
        tables.tabulate_days(sizing.year),
    ]
    about = (
        f"{sizing.orbits} orbits of {sizing.period:.0f} s, attitude: {sizing.attitude}."
    )
    first = [
        tabulate_margins(sizing.margins),
        *tabulate_spread(sizing.intervals, sizing.assumptions),
    ]
    return _write(
        path,
        f"Size of {sizing.target}",
        sizing,
        first,
        tables_shown,
        about,
        drawn_of(sizing),
    )


def write_dumps(sizing: DumpSizing, path: Path) -> Path:
    """Write the page of a sizing of dumps and return its path.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    tables_shown = [tables.tabulate_dump_sources(sizing.sources)]
    if sizing.year:
        tables_shown.append(tables.tabulate_dump_days(sizing))
    first = [
        tabulate_margins(sizing.margins),
        *tabulate_spread(sizing.intervals, sizing.assumptions),
        tables.tabulate_dumps(sizing),
    ]
    about = f"Attitude: {sizing.attitude}."
    return _write(
        path,
        f"Dumps of {sizing.target}",
        sizing,
        first,
        tables_shown,
        about,
        drawn_of(sizing),
    )


def _write(
    path: Path,
    title: str,
    sizing: Sizing | DumpSizing,
    first: Sequence[Table],
    tables_shown: Sequence[Table],
    about: str,
    figures: Sequence[tuple[str, Figure]],
) -> Path:
    """Write a page with the `first` tables above the figures."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = render(
        "sizing.html",
        title=title,
        answer=sizing.answer,
        problems=sizing.problems,
        notes=sizing.notes,
        heading="",
        first=first,
        tables=tables_shown,
        about=about,
        versions=versions(),
        **figures_of(figures),
    )
    return write_page(path, text)


def write_map(sizing_map: SizingMap, path: Path) -> Path:
    """Write the page of a map and return its path.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    figures = [
        (tables.describe_map(sizing_map, law), heat_map(sizing_map, k))
        for k, law in enumerate(sizing_map.laws)
    ]
    tables_shown = [
        tables.tabulate_least_rods(sizing_map, d)
        for d in range(len(sizing_map.axes.dipoles))
    ]
    needs = sizing_map.requirements
    return _write_map(
        path,
        f"Rods by orbit and residual dipole: {sizing_map.target}",
        "A day at each orbit, by the model of the momentum alone; a cell is the smallest rod of "
        f"the map that holds with a duty of {100.0 * needs.duty:g} %, {needs.margin:g} times the "
        "least rod and no wheel full.",
        figures,
        tables_shown,
        heading="The least rod, any law, A m2",
        notes=sizing_map.notes,
    )


def write_dump_map(dump_map: DumpMap, path: Path) -> Path:
    """Write the page of a map of dumps and return its path.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    figures = [
        (
            "Dumps a week over the share of a wheel at which they begin",
            _dump_lines(dump_map, "a_week", "dumps a week"),
        ),
        (
            "Propellant a year",
            _dump_lines(dump_map, "a_year", "propellant\n[kg a year]"),
        ),
    ]
    return _write_map(
        path,
        f"Dumps by wheels and thresholds: {dump_map.target}",
        "The scenario's day as if it lasted, by the model of the momentum alone; mass and "
        "inertia of other wheels are not counted.",
        figures,
        [tables.tabulate_dump_map(dump_map)],
    )


def _write_map(
    path: Path,
    title: str,
    about: str,
    figures: Sequence[tuple[str, Figure]],
    tables_shown: Sequence[Table],
    heading: str = "",
    notes: Sequence[str] = (),
) -> Path:
    """Write the page of a map and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    text = render(
        "study.html",
        title=title,
        answer="",
        about=about,
        first=(),
        heading=heading,
        tables=tables_shown,
        notes=notes,
        versions=versions(),
        **figures_of(figures),
    )
    return write_page(path, text)


# --- figures --------------------------------------------------------------------------


def drawn_of(sizing: Sizing | DumpSizing) -> list[tuple[str, Figure]]:
    """Draw the figures of a sizing, each with its caption."""
    return _dumps_of(sizing) if isinstance(sizing, DumpSizing) else _rods_of(sizing)


def _dumps_of(sizing: DumpSizing) -> list[tuple[str, Figure]]:
    """Draw the figures of a sizing of dumps."""
    figures = []
    if sizing.course is not None and len(sizing.course.dumps):
        caption = "Momentum of the wheels, dump after dump: the sized course"
        figures.append((caption, _dump_course(sizing)))
    if len(sizing.thresholds) > 1:
        caption = "Propellant a year over the momentum at which dumps begin"
        figures.append(
            (caption, _thresholds(sizing, "a_year", "propellant\n[kg a year]"))
        )
        caption = "Dumps a week over the momentum at which they begin"
        figures.append((caption, _thresholds(sizing, "a_week", "dumps a week")))
    if sizing.year:
        caption = "A year: propellant, as if each day lasted"
        figures.append((caption, _dump_year(sizing)))
    return figures


def _rods_of(sizing: Sizing) -> list[tuple[str, Figure]]:
    """Draw the figures of a sizing of rods."""
    figures = []
    if any(r.duty is not None for r in sizing.curve):
        figures.append(
            (
                "Duty of the coils over their size: lines the model, circles the closed loop",
                _curve(sizing, "duty", "loop_duty", 100.0, "duty [%]"),
            )
        )
        figures.append(
            (
                "Momentum of the wheels, rms, over the size of the coils",
                _curve(sizing, "rms", "loop_rms", 1e3, "momentum, rms [mN m s]"),
            )
        )
        if any(r.filled is not None for r in sizing.curve):
            figures.append(
                (
                    "The fullest wheel in the second half of the run, share of its capacity",
                    _curve(sizing, "filled", "", 100.0, "of capacity [%]"),
                )
            )
    if sizing.sources:
        figures.append(
            (
                "What drives it: momentum of an orbit and cyclic momentum by source",
                _sources(sizing),
            )
        )
    if sizing.year:
        figures.append(("The least rod over a year", _year(sizing)))
    return figures


def _curve(sizing: Sizing, key: str, loop: str, factor: float, label: str) -> Figure:
    """Draw a quantity of the curves over the size of the rods.

    `factor` converts it to the unit of the axis.
    """
    fig, ax = figure()
    laws = list(dict.fromkeys(r.law for r in sizing.curve))
    shape = [r.rod for r in sizing.curve if r.rod != sizing.rod]
    low, high = min(shape), max(shape)
    for i, law in enumerate(laws):
        rows = sorted(
            (r for r in sizing.curve if r.law == law and r.rod <= 3.0 * high),
            key=lambda r: r.rod,
        )
        colour = COLOURS[i % len(COLOURS)]
        rows_with_value = [r for r in rows if getattr(r, key) is not None]
        if rows_with_value:
            ax.plot(
                [r.rod for r in rows_with_value],
                [factor * getattr(r, key) for r in rows_with_value],
                colour,
                width=1.5,
                dash=DASHES[i % len(DASHES)],
                label=law,
            )
        closed = [r for r in rows if loop and getattr(r, loop) is not None]
        if closed:
            ax.plot(
                [r.rod for r in closed],
                [factor * getattr(r, loop) for r in closed],
                colour,
                width=0.0,
                marker=6.0,
                hollow=True,
                label=f"{law}, closed loop",
            )
    ax.upright(sizing.least, LIMIT, width=1.2, dash=DASHED, label="least rod, any law")
    if sizing.recommended is not None:
        ax.upright(
            sizing.recommended, COLOURS[2], width=1.2, dash=DOTTED, label="recommended"
        )
        high = max(high, sizing.recommended)
    if low <= sizing.rod <= 3.0 * high:
        ax.upright(sizing.rod, "#444444", width=1.2, dash=DOTTED, label="what it has")
    ax.x.log, ax.x.label, ax.y.label = True, "coil [A m2]", label
    ax.y.log = key == "rms"
    if key != "rms":
        ax.y.low = 0.0
    return fig


def _sources(sizing: Sizing) -> Figure:
    """Draw the momentum of each source of disturbance (mN m s)."""
    fig, ax = figure(2.4)
    names = [s.name for s in sizing.sources]
    at = np.arange(len(names), dtype=float)
    for k, (label, key) in enumerate(
        (("secular, an orbit", "per_orbit"), ("cyclic", "cyclic"))
    ):
        heights = [1e3 * getattr(s, key) for s in sizing.sources]
        ax.bars(at - 0.38 + 0.38 * k, at + 0.38 * k, heights, COLOURS[k], label=label)
    ax.x.ticks = Ticks(tuple(at.tolist()), tuple(names))
    ax.y.low, ax.y.label = 0.0, "momentum\n[mN m s]"
    return fig


def _year(sizing: Sizing) -> Figure:
    """Draw the least rod (A m2) over the days of a year."""
    fig, ax = figure(2.4)
    for i, activity in enumerate(dict.fromkeys(d.activity for d in sizing.year)):
        rows = [d for d in sizing.year if d.activity == activity]
        label = f"{activity} solar activity" if activity else "least rod"
        ax.plot(
            [28.0 * k for k in range(len(rows))],
            [d.least for d in rows],
            COLOURS[i],
            width=1.5,
            marker=4.0,
            label=label,
        )
    if sizing.rod <= 3.0 * max(d.least for d in sizing.year):
        ax.level(sizing.rod, "#444444", width=1.2, dash=DOTTED, label="what it has")
    ax.x.label, ax.y.label, ax.y.low = (
        f"days since {sizing.year[0].day}",
        "least rod\n[A m2]",
        0.0,
    )
    return fig


def _dump_year(sizing: DumpSizing) -> Figure:
    """Draw the propellant (kg a year) over the days of a year."""
    fig, ax = figure(2.4)
    for i, activity in enumerate(dict.fromkeys(d.activity for d in sizing.year)):
        rows = [
            x
            for d, x in zip(sizing.year, sizing.each_year, strict=True)
            if d.activity == activity
        ]
        label = f"{activity} solar activity" if activity else "propellant a year"
        ax.plot(
            [28.0 * k for k in range(len(rows))],
            rows,
            COLOURS[i],
            width=1.5,
            marker=4.0,
            label=label,
        )
    ax.level(sizing.a_year, "#444444", width=1.2, dash=DOTTED, label="mean")
    ax.x.label, ax.y.label, ax.y.low = (
        f"days since {sizing.year[0].day}",
        "propellant\n[kg a year]",
        0.0,
    )
    return fig


def _dump_course(sizing: DumpSizing) -> Figure:
    """Draw the fill of the wheels (N m s) with its thresholds and the capacity."""
    assert sizing.course is not None
    times, fill, dumps = sizing.course
    fig, ax = figure()
    span, unit = (86400.0, "d") if times[-1] > 2.0 * 86400.0 else time_axis(times)
    factor, of = (1e3, "mN.m.s") if sizing.capacity < 1.0 else (1.0, "N.m.s")
    ax.plot(times / span, factor * fill, COLOURS[0], width=1.2, label="momentum")
    begun = fill[np.searchsorted(times, dumps).clip(max=len(times) - 1)]
    ax.plot(
        dumps / span,
        factor * begun,
        COLOURS[1],
        width=0.0,
        marker=4.0,
        label=f"{len(dumps)} dumps begin",
    )
    for value, name in ((sizing.begin, "dumps begin"), (sizing.end, "dumps end")):
        ax.level(factor * value, "#444444", width=1.0, dash=DOTTED, label=name)
    if sizing.capacity < 10.0 * sizing.begin:
        ax.level(
            factor * sizing.capacity,
            LIMIT,
            width=1.2,
            dash=DASHED,
            label="capacity of a wheel",
        )
    ax.x.label, ax.x.seconds, ax.x.margin = f"time [{unit}]", span, 0.01
    ax.y.label, ax.y.low = axis_label("momentum", of, 2.0), 0.0
    return fig


def _thresholds(sizing: DumpSizing, key: str, label: str) -> Figure:
    """Draw a rate of dumps over the momentum (N m s) at which they begin."""
    fig, ax = figure(2.4)
    factor, unit = (1e3, "mN.m.s") if sizing.capacity < 1.0 else (1.0, "N.m.s")
    begin = [factor * t.begin for t in sizing.thresholds]
    values = [getattr(t, key) for t in sizing.thresholds]
    ax.plot(begin, values, COLOURS[0], width=1.5, marker=4.0, label="a day that lasts")
    ax.upright(
        factor * sizing.begin, "#444444", width=1.2, dash=DOTTED, label="what it has"
    )
    ax.upright(
        factor * sizing.capacity,
        LIMIT,
        width=1.2,
        dash=DASHED,
        label="capacity of a wheel",
    )
    ax.x.label = axis_label("momentum at which dumps begin", unit, 9.0)
    ax.y.label, ax.y.low = label, 0.0
    return fig


def _dump_lines(dump_map: DumpMap, key: str, label: str) -> Figure:
    """Draw a rate of dumps over the threshold (%), a line for each wheel and rod."""
    fig, ax = figure(2.4)
    kinds = dict.fromkeys((x.wheel, x.rod) for x in dump_map.cells)
    for k, (wheel, rod) in enumerate(kinds):
        cells = [
            x
            for x in dump_map.cells
            if (x.wheel, x.rod) == (wheel, rod) and x.a_week == x.a_week
        ]
        rods = f", rods of {rod:.3g} A m2" if dump_map.has_rods else ""
        ax.plot(
            [100.0 * x.begin / x.wheel for x in cells],
            [getattr(x, key) for x in cells],
            COLOURS[k % len(COLOURS)],
            width=1.5,
            marker=4.0,
            label=f"wheels of {format_momenta(wheel)}{rods}",
        )
    ax.x.label, ax.y.label, ax.y.low = "a dump begins at [% of a wheel]", label, 0.0
    return fig


def heat_map(sizing_map: SizingMap, law: int) -> Figure:
    """Draw the smallest rod of the map that holds in each orbit.

    Each residual dipole has a panel of altitude over inclination.
    """
    axes = sizing_map.axes
    order = np.argsort(axes.rods)
    holds = sizing_map.holds[law][..., order]
    rods = [axes.rods[i] for i in order]
    count = len(axes.dipoles)
    rows = -(-count // 2)
    fig = Figure(7.2, 0.15 + 2.2 * rows)
    for k, dipole in enumerate(axes.dipoles):
        row, column = divmod(k, 2)
        tall = 2.2 / fig.height
        ax = fig.add(
            0.3 / fig.height + row * tall,
            1.0 - (row + 1) * tall + 0.25 / fig.height,
            0.095 + 0.37 * column,
            1.0 - (0.365 + 0.37 * column),
        )
        ax.title, ax.size = f"residual dipole {dipole:.3g} A m2", 80
        ax.x.label, ax.y.label = (
            "inclination [deg]",
            "altitude [km]" if column == 0 else "",
        )
        smallest = np.where(
            holds[:, :, k].any(axis=2), holds[:, :, k].argmax(axis=2), len(rods)
        )
        colour_cells(
            ax,
            smallest.T,
            [f"{rod:.3g} A m2" for rod in rods],
            "none of them",
            has_legend=k == min(1, count - 1),
        )
        ax.x.ticks = cell_ticks([f"{v:g}" for v in axes.inclinations])
        ax.y.ticks = cell_ticks([f"{a / 1e3:g}" for a in axes.altitudes])
    return fig
