"""Draw plots of scenarios: series of runs over time, with limit lines and modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..engine.recording.results import Results
from ..numbers import derived
from ..numbers.limits import limits_of
from ..numbers.numbers import sample_time_of, scale
from ..numbers.shapes import alternate, shape_of
from ..system.errors import DesatError, nearest
from ..system.expression import Table
from .canvas import INCH, Axes, Figure, Strip, Ticks
from .style import (
    BANDS,
    BINS,
    COLOURS,
    DASHED,
    DASHES,
    DOTTED,
    HEIGHT,
    LIMIT,
    PANELS,
    WIDTH,
    axis_label,
    between,
    figure,
    time_axis,
)

if TYPE_CHECKING:
    from ..language.scenario import Plot

Run = tuple[str, Results, Table]  # label, series, parameters as a manifest has them


class Line(NamedTuple):
    """Line of a plot: times (s) and values in the plot's unit."""

    name: str
    times: Any
    values: Any
    stepped: bool = False  # True: each value holds until the next
    rows: int = 0  # samples that it stands for, where they are more than its values; 0: its values


FAR = 10.0  # a limit beyond this factor of the drawn range is only named
_FIRST: dict[str, Any] = {"width": 1.4}
_OTHER: dict[str, Any] = {"width": 1.0, "dash": (4.0, 2.0), "alpha": 0.75}


def series_figure(
    plot: Plot, runs: Sequence[Run], bounds: Sequence[tuple[str, float]] = ()
) -> Figure | None:
    """Draw a scenario's `[plots.NAME]` over runs; None if nothing is recorded.

    `bounds` are what is required, names and values in the plot's unit: dashed lines.

    Of two runs the first is drawn in colours and the other dashed; of more, each run
    has a colour and a dash, and one line: the largest size of its elements.
    """
    _, results, parameters = runs[0]
    if (unit := unit_of(plot, results)) is None:
        return None
    lines_of_runs = [_drawn_lines(plot, r, p, unit) for _, r, p in runs]
    is_largest = len(runs) > 2 and any(len(lines) > 1 for lines in lines_of_runs)
    if is_largest:
        lines_of_runs = [_largest(lines) for lines in lines_of_runs]
    limits = limits_of(plot.limits, parameters, unit)
    # limits of a magnitude apply on the positive side only
    signed = any(
        np.nanmin(x.values, initial=0.0) < 0.0 for lines in lines_of_runs for x in lines
    )
    orbit = plot.orbit
    seconds, time_unit = (orbit, "orbits") if orbit else time_axis(results.times())
    fig, panels = _panels(plot, results)
    for ax, begin in panels:
        is_whole_run = begin is None
        lines = (
            lines_of_runs
            if begin is None
            else [[_since(x, begin) for x in run] for run in lines_of_runs]
        )
        _draw(
            ax,
            lines,
            [label for label, _, _ in runs] if is_whole_run else None,
            seconds,
            plot,
        )
        ax.y.log = plot.log and is_whole_run
        _draw_limits(ax, limits, signed, is_whole_run)
        further = [(name, value, False) for name, value in bounds]
        _draw_limits(ax, further, signed, is_whole_run, DASHED)
        title = plot.axis or f"{plot.title[:1].lower()}{plot.title[1:]}"
        quantity = f"largest {title}" if is_largest else plot.axis
        ax.y.label = axis_label(quantity or plot.title, unit, ax.height / INCH)
        timeline(ax, seconds, time_unit, results if is_whole_run else None)
        if begin is not None:
            ax.title = f"from {begin / seconds:g} {time_unit} on"
            ax.x.low, ax.x.high = begin / seconds, results.times()[-1] / seconds
    return fig


def _drawn_lines(
    plot: Plot, results: Results, parameters: Table, unit: str
) -> list[Line]:
    """Return the lines of a plot, an error from a held reference at its samples alone."""
    sample_time = sample_time_of(plot, parameters)
    signals = derived.compared_signals(plot, set(results.names()))
    if signals != tuple(plot.signals):  # the reference is known at every row
        sample_time = 0.0
    return lines_of(plot, results, unit, sample_time)


def _largest(lines: list[Line]) -> list[Line]:
    """Return one line with the largest size of these at each time."""
    if len(lines) < 2:
        return lines
    first = lines[0]
    alike = [x for x in lines if len(x.times) == len(first.times)]
    values = np.abs([x.values for x in alike]).max(axis=0)
    return [first._replace(name="", values=values)]


def of_name(name: str | None, plots: Mapping[str, Plot], runs: Sequence[Run]) -> Figure:
    """Draw a plot of a scenario by name, its first one (None), or a series over runs.

    Raises
    ------
    DesatError
        If there is none, or it is not recorded.
    """
    from ..language.scenario import Plot  # slow import

    names = runs[0][1].names()
    if name is None:
        name = next(iter(plots), names[0] if names else "")
    plot = plots.get(name) or (
        Plot(title=name, signals=(name,)) if name in names else None
    )
    if plot is None:
        raise DesatError(
            f"{name}: no plot and no series{nearest(name, [*plots, *names])}"
        )
    figure = series_figure(plot, runs)
    if figure is None:
        raise DesatError(
            f"{name}: what it shows is not recorded: {', '.join(plot.signals)}"
        )
    return figure


def unit_of(plot: Plot, results: Results) -> str | None:
    """Return the unit of a plot's axis, or None where its series are not recorded."""
    series_names = set(results.names())
    signals = [s for s in plot.signals if s in series_names]
    if not signals or (plot.derive and len(signals) < len(plot.signals)):
        return None
    quantity = derived.of_entry(plot)
    unit = quantity[0].unit if quantity else ""
    return plot.unit or unit or results.attribute(signals[0], "unit")


def _panels(
    plot: Plot, results: Results
) -> tuple[Figure, list[tuple[Axes, float | None]]]:
    """Build a figure with its axes: the whole run, and the time after `steady` (s).

    The second axes are left out where the plot has no `steady`, or the run ends before.
    """
    steady = plot.steady
    if steady is None or results.times()[-1] <= steady:
        fig = Figure(WIDTH, HEIGHT)
        return fig, [(fig.add(), None)]
    fig = Figure(WIDTH, PANELS)
    return fig, [
        (fig.add(top=0.04, bottom=0.60), None),
        (fig.add(top=0.54, bottom=0.10), steady),
    ]


def _since(line: Line, begin: float) -> Line:
    """Return the part of a line from a time (s) on."""
    is_shown = line.times >= begin
    return line._replace(times=line.times[is_shown], values=line.values[is_shown])


def _draw(
    ax: Axes,
    runs: list[list[Line]],
    labels: list[str] | None,
    seconds: float,
    plot: Plot,
) -> None:
    """Draw the lines of several runs, with their labels.

    A line is named in the first run. With two runs the first line of the second has the
    run's name, and a lone line always has. With more than two runs the first line of
    each has it. Without `labels` no line is named. An `envelope` fills the range of a
    line that is faster than the width of the plot can show.
    """
    for number, lines in enumerate(runs):
        look = _OTHER if number and len(runs) == 2 else _FIRST
        if len(runs) > 2:
            look = {"width": 1.2, "dash": DASHES[number % len(DASHES)]}
        for i, line in enumerate(lines):
            name = line.name if number == 0 else ""
            if labels and len(runs) > 2:
                name = labels[number] if i == 0 else ""
            elif labels and len(runs) > 1 and (len(lines) == 1 or (number and i == 0)):
                name = labels[number]
            name = name if labels else ""
            of_runs = (
                len(runs) > 2 or len(lines) == 1
            )  # else colours distinguish lines, and dashes runs
            colour = COLOURS[(number if of_runs else i) % len(COLOURS)]
            if len(runs) == 1:
                look = {**_FIRST, "dash": DASHES[i % len(DASHES)]}
            run = labels[number] if labels and len(runs) > 1 else ""
            owners = ", ".join(part for part in (line.name, run) if part)
            if plot.envelope and len(line.times) > BINS:
                x, low, high = between(line.times, line.values)
                ax.area(
                    x / seconds,
                    low,
                    high,
                    colour,
                    alpha=0.45,
                    label=name and f"{name}: least to most",
                    name=owners,
                    full_run=(line.times / seconds, line.values),
                    rows=line.rows,
                )
                continue
            ax.plot(
                line.times / seconds,
                line.values,
                colour,
                label=name,
                stepped=line.stepped,
                name=owners,
                rows=line.rows,
                **look,
            )


def _draw_limits(
    ax: Axes,
    limits: list[tuple[str, float, bool]],
    signed: bool,
    always: bool = True,
    dash: tuple[float, float] = DOTTED,
) -> None:
    """Draw limit lines and bands (name, value, filled).

    With `signed` they are on both sides of zero. Limits beyond the drawn range appear
    only with `always`. A limit beyond `FAR` times that range would flatten the lines,
    so only its name appears.
    """
    low, high = ax.y_range()
    bands = iter(BANDS * len(limits))
    for name, value, filled in limits:
        colour = next(bands) if filled else LIMIT
        if not always and value > max(-low, high):
            continue
        text = f"{'±' if signed else ''}{value:.4g}  {name}" if always else ""
        if filled:
            ax.band(-value if signed else 0.0, value, colour, alpha=0.16, label=text)
            continue
        if value > FAR * max(-low, high) > 0.0 and not ax.y.log:
            ax.plot(
                [np.nan],
                [np.nan],
                LIMIT,
                width=0.9,
                dash=dash,
                label=f"{text}: far beyond",
            )
            continue
        ax.level(value, LIMIT, width=0.9, dash=dash, label=text)
        if signed:
            ax.level(-value, LIMIT, width=0.9, dash=dash)


def keep_derived_lines(
    plots: Mapping[str, Plot], results: Results, parameters: Table
) -> None:
    """Compute what plots derive of all rows, before the file of a run is shortened.

    These are derived quantities and the strips of modes.
    """
    _strips_of(results)
    for plot in plots.values():
        if plot.derive and (unit := unit_of(plot, results)) is not None:
            _drawn_lines(plot, results, parameters, unit)


def lines_of(
    plot: Plot, results: Results, unit: str, sample_time: float = 0.0
) -> list[Line]:
    """Return the lines of a scenario's plot in a run, for recorded series only.

    A derived one has the rows at which a reference of `sample_time` s is new; 0: all.
    """
    series_names = set(results.names())
    if plot.derive:
        return (
            _derived_lines(plot, results, unit, sample_time)
            if series_names.issuperset(plot.signals)
            else []
        )
    signals = (s for s in plot.signals if s in series_names)
    return [line for signal in signals for line in _lines(plot, results, signal, unit)]


def _derived_lines(
    plot: Plot, results: Results, unit: str, sample_time: float
) -> list[Line]:
    """Return the lines that a plot derives from its signals."""
    entry = derived.of_entry(plot)
    assert entry is not None
    quantity, options = entry
    signals = derived.compared_signals(plot, set(results.names()))
    series = [results.series(s) for s in signals]
    times = results.times()[: min(map(len, series))]
    if sample_time > 0.0:
        sampled = derived.sample_rows(times, sample_time)
        times, series = times[sampled], [s.at(sampled) for s in series]

    def read(rows: slice) -> Any:
        """Compute rows of the quantity."""
        return quantity.rows(times[rows], [s[rows] for s in series], options)

    def shape() -> tuple[Any, Any, int]:
        """Compute the quantity as a plot shows it."""
        if not quantity.is_sum:
            return shape_of(times, read)
        all_rows = read(slice(None))
        return shape_of(times[: len(all_rows)], all_rows.__getitem__)

    key = repr(("line", plot.derive, signals, plot.sequence, sample_time))
    times, values, count = results.once(key, shape)
    values = values * scale(
        quantity.unit or results.attribute(plot.signals[0], "unit"), unit
    )
    # an empty name in the scenario leaves its element out; a quantity may have no names
    names = enumerate(plot.components or quantity.names)
    return [
        Line(n, times, values[:, i], rows=count)
        for i, n in names
        if n or not plot.components
    ]


def _lines(plot: Plot, results: Results, signal: str, unit: str) -> list[Line]:
    """Return the lines of a signal: one per element, or its size."""
    series, width = results.series(signal), np.ndim(results.values(signal, slice(0, 1)))

    def read(rows: slice) -> Any:
        """Read rows of the elements or of their size."""
        values = np.asarray(series[rows], float)
        return np.linalg.norm(values, axis=1) if plot.norm and width > 1 else values

    times, values, rows = shape_of(results.times(signal), read)
    stepped = results.attribute(signal, "class") == "interval" and rows == len(times)
    if (extremes := results.extremes(signal)) and not (plot.norm and width > 1):
        rows *= results.every
        times, values = alternate(times, *extremes)
        stepped = False
    values = values * scale(results.attribute(signal, "unit"), unit)
    prefix = "" if len(plot.signals) == 1 else signal.partition(".")[2]
    if width == 1 or plot.norm:
        return [Line(prefix, times, values[:, 0], stepped, rows)]
    # an element without a name, as of a missing wheel, is not shown
    names = plot.components or elements_of(signal, values.shape[1])
    return [
        Line(f"{prefix} {name}".strip(), times, values[:, i], stepped, rows)
        for i, name in enumerate(names)
        if name
    ]


def elements_of(signal: str, count: int) -> list[str]:
    """Return readable names of a signal's elements.

    These are axes for vectors, numbers with their kind for wheels, coils and nozzles,
    and numbers otherwise.
    """
    kind = signal.rpartition("_")[2]
    if kind in ("wheel", "coil", "nozzle"):
        return [f"{kind} {i + 1}" for i in range(count)]
    if kind in ("body", "eci", "lvlh") and count == len("xyz"):
        return list("xyz")
    return [str(i + 1) for i in range(count)]


# --- Time axis ------------------------------------------------------------------------
#
# Under it there are strips of coloured bands that show modes and phases. A strip stands
# for an Integer output whose values have names (`choices`).


# Colours of the values, by their number.
BAND_COLOURS = (
    "#d4d4d4",
    "#7fb8de",
    "#f2b84b",
    "#93c98a",
    "#e07a6e",
    "#b79ad6",
    "#6f6f6f",
    "#c9a27a",
)
# A span is at least as wide as one of this many columns, so that short ones are
# visible.
COLUMNS = 250


def timeline(
    ax: Axes, seconds: float, unit: str, results: Results | None = None
) -> None:
    """Label the time axis in a unit of `seconds` s, and add strips of the results.

    Each Integer output whose values have names, as a mode or phase, has a strip of
    coloured bands under the axis.
    """
    ax.x.label, ax.x.margin, ax.x.seconds = f"time [{unit}]", 0.01, seconds
    for strip in _strips_of(results) if results else ():
        spans = [(begin / seconds, end / seconds) for begin, end in strip.spans]
        ax.strips.append(replace(strip, spans=spans))


def _strips_of(results: Results) -> list[Strip]:
    """Return the strips of a run, which are found once."""
    return results.once("strips", lambda: list(_strips(results)))


def _strips(results: Results) -> Iterator[Strip]:
    """Yield the strips of a run, over times in s."""
    series_with_choices = [
        (s, choices) for s in results.names() if (choices := results.choices(s))
    ]
    for row, (signal, choices) in enumerate(series_with_choices):
        for value, spans in bands(results.times(), results.values(signal)):
            name = choices[value] if 0 <= value < len(choices) else str(value)
            label = f"{signal.partition('.')[2]}: {name.replace('_', ' ')}"
            yield Strip(row, spans, BAND_COLOURS[value % len(BAND_COLOURS)], label)


def bands(
    times: Any, values: Any, columns: int = COLUMNS
) -> list[tuple[int, list[tuple[float, float]]]]:
    """Return each value of an integer series with its spans (begin, end in s).

    Values that hold longest come first. `times` may have one more row: the end of the
    last value. A span is at least as wide as one of `columns` over the whole time, so
    that short ones are visible.
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
        rows_at_value = np.flatnonzero(values == value)
        breaks = np.flatnonzero(np.diff(rows_at_value) > 1)
        firsts, lasts = (
            rows_at_value[np.append(0, breaks + 1)],
            rows_at_value[np.append(breaks, len(rows_at_value) - 1)],
        )
        for first, last in zip(firsts, lasts, strict=True):
            begin, end = float(starts[first]), float(ends[last])
            end = max(end, min(begin + shortest, float(ends[-1])))
            if spans and begin - spans[-1][1] < shortest:
                begin = spans.pop()[0]  # a narrower gap would be invisible
            spans.append((begin, end))
        strips.append((int(value), spans))
    return strips


# --- Several runs together ------------------------------------------------------------


def scatter(*args: Any, **options: Any) -> str:
    """Draw `scattered` as SVG."""
    return scattered(*args, **options).svg()


def scattered(
    groups: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    xlabel: str,
    ylabel: str,
    *,
    diagonal: str = "",
    joined: bool = False,
    log: str = "",
    size: float = 5.0,
) -> Figure:
    """Draw groups of points of a size (pt): {label: (x, y)}.

    A group without a label is not in the legend. `diagonal` names the line y = x, empty
    for none. With `joined` a line connects the points. `log` names the logarithmic
    axes: "x", "y" or "xy". Infinite values, as a time not reached, have no point.
    """
    fig, ax = figure()
    ax.x.log, ax.y.log, ax.x.label, ax.y.label = "x" in log, "y" in log, xlabel, ylabel
    points_by_name = {
        label: tuple(
            np.where(np.isfinite(v), v, np.nan) for v in np.asarray(pair, float)
        )
        for label, pair in groups.items()
    }
    for i, (label, (x, y)) in enumerate(points_by_name.items()):
        ax.plot(
            x,
            y,
            COLOURS[i % len(COLOURS)],
            label=label,
            marker=size,
            width=float(joined),
        )
    if diagonal:
        top = max(float(np.nanmax(v)) for pair in points_by_name.values() for v in pair)
        ax.plot([0, top], [0, top], "#888888", width=0.9, dash=DOTTED, label=diagonal)
    ax.make_room()
    return fig


# Colours of the cells of a map, from the smallest value to the largest.
SHADES = ("#fdf3c0", "#f6d36b", "#7ecb8f", "#35a3a0", "#2a6fb0", "#33307e", "#1a1037")
NONE = "#c9c9c9"


def colour_cells(
    ax: Axes, levels: Any, names: Sequence[str], none: str, has_legend: bool = True
) -> None:
    """Colour the cells of a map by their levels (rows, columns), integers.

    Level i has the name `names[i]`; cells of the level after the last one are grey and
    have the name `none`.
    """
    last = max(1, len(names) - 1)
    shades = [SHADES[round(i * (len(SHADES) - 1) / last)] for i in range(len(names))]
    for i, colour in enumerate([*shades, NONE]):
        label = [*names, none][i] if has_legend else ""
        cells = np.argwhere(levels == i)
        if label and not len(cells):  # outside the axes, for the legend
            ax.area([-9.0, -8.0], -9.0, -8.0, colour, label=label)
        for row, column in cells:
            ax.area([column, column + 1.0], row, row + 1.0, colour, label=label)
            label = ""
    ax.x.low, ax.y.low = 0.0, 0.0
    ax.y.high, ax.x.high = map(float, levels.shape)
    ax.x.margin = ax.y.margin = 0.0


def cell_ticks(texts: Sequence[str]) -> Ticks:
    """Return ticks in the middle of cells."""
    return Ticks(tuple(i + 0.5 for i in range(len(texts))), tuple(texts))
