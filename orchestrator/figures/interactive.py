"""Convert figures to JSON for a page's script (`figures.js`, which draws with uPlot).

They show what the SVG of `canvas` shows, with more points. The series of a figure share
their times. Longer series are drawn thinned to minimum and maximum in parts of equal
length, so that what is drawn on a page stays below 1.3 MB; all their samples, which a
reader saves, are packed beside it.
"""

from __future__ import annotations

import base64
import math
import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numbers.shapes import extremes, split
from ..system.typed import JsonObject
from .canvas import Axes, Figure, Mark
from .style import HEIGHT

Array = NDArray[np.float64]
VALUES = 200_000  # limit for all figures of a page, with 5.4 bytes per value
FEWEST, MOST = 400, 20_000  # Limits of the values of a line.
# limit of the samples of a page, with 1 to 3 bytes each: a day of 45 lines at 1 Hz
SAMPLES = 4_000_000
UNUSED_BITS = 3  # of a float's mantissa; the others are of six significant digits
LEVEL = 4  # of zlib: 2 % larger than the usual one, in half the time
GRID_DIGITS = 12  # significant digits of the largest x of all samples


def data_of(figures: Sequence[Figure]) -> JsonObject:
    """Convert figures to the data of a page.

    `grids` are values of x (s for times) as base64 of little-endian doubles. `plots`
    has an entry per figure; it is None for one that the script cannot draw, whose SVG
    stays. `most` is the limit of the values of a line. `samples` of a thinned plot are
    all its rows, without their values where the page would have more than `SAMPLES`;
    `sample_grids` are the x of them.
    """
    lines = [_lines(f.axes[0]) if _drawable(f) else [] for f in figures]
    points = min(MOST, max(FEWEST, VALUES // max(sum(map(len, lines)), 1)))
    grids: dict[bytes, int] = {}
    sample_grids: dict[str, int] = {}
    plots = [
        _plot(figure.axes[0], lines_of_figure, points, grids)
        if lines_of_figure
        else None
        for figure, lines_of_figure in zip(figures, lines, strict=True)
    ]
    is_whole = sum(max(len(x.x), x.mark.rows) for of in lines for x in of) <= SAMPLES
    for plot, lines_of_figure, figure in zip(plots, lines, figures, strict=True):
        if plot is not None:
            plot["small"] = figure.height < HEIGHT - 0.5
            plot["samples"] = _samples(
                lines_of_figure, plot["seconds"] or 1.0, points, is_whole, sample_grids
            )
    return {
        "grids": [base64.b64encode(g).decode() for g in grids],
        "sample_grids": [*sample_grids],
        "plots": plots,
        "most": points,
    }


def _samples(
    lines: Sequence[_DrawnLine],
    unit: float,
    points: int,
    is_whole: bool,
    grids: dict[str, int],
) -> JsonObject | None:
    """Pack all samples of lines over x in `unit`; None if they are drawn as they are."""
    x, columns = _shared([(line.x, line.y) for line in lines])
    rows = max(len(x), *(line.mark.rows for line in lines))
    if rows <= points:
        return None
    if not is_whole or rows > len(x):
        return {"rows": rows}
    grid = _pack_grid(unit * x)
    return {
        "rows": len(x),
        "grid": grids.setdefault(grid, len(grids)),
        "columns": [_pack(values) for values in columns],
    }


def _pack_grid(x: Array) -> str:
    """Pack values of x as base64 of deflated differences (doubles), the first from 0."""
    decimals = GRID_DIGITS - math.ceil(math.log10(np.abs(x).max() or 1.0))
    steps = np.diff(np.round(x, decimals), prepend=0.0).round(decimals)
    return base64.b64encode(
        zlib.compress(steps.astype("<f8").tobytes(), LEVEL)
    ).decode()


def _pack(values: Array) -> JsonObject:
    """Pack values as base64 of deflated floats, to six significant digits.

    The bits of each float are replaced by their difference from the ones before, with
    the sign in the lowest bit; all lowest bytes come first.
    """
    data, offset = _floats(values)
    bits = data.view("<i4") + (1 << (UNUSED_BITS - 1)) & -1 << UNUSED_BITS
    steps = np.diff(bits, prepend=np.int32(0))
    signed_last = (steps << 1 ^ steps >> 31).astype("<i4")
    by_byte = signed_last.view(np.uint8).reshape(-1, 4).T.tobytes()
    return {
        "data": base64.b64encode(zlib.compress(by_byte, LEVEL)).decode(),
        "offset": offset,
    }


class _DrawnLine(NamedTuple):
    """Line, or one of the two edges of an area."""

    mark: Mark
    x: Array
    y: Array
    label: str
    edge: bool = False


def _lines(ax: Axes) -> list[_DrawnLine]:
    """Collect the lines of axes; an area gives two, the lower edge first."""
    bare = _bare(ax)
    lines = []
    for m in ax.marks:
        if _is_area(m):
            half, label = len(m.x) // 2, m.name or m.label or bare
            lines += [
                _DrawnLine(m, m.x[:half], m.y[:half], f"{label}: least", True),
                _DrawnLine(m, m.x[:half], m.y[half:][::-1], f"{label}: most", True),
            ]
        elif _is_line(m):
            x, y = m.full_run or (m.x, m.y)
            lines.append(_DrawnLine(m, x, y, m.name or m.label or bare))
    return lines


def _bare(ax: Axes) -> str:
    """Return the label of the y axis without its unit."""
    return " ".join(ax.y.label.split("\n")).partition("[")[0].strip() or "value"


def _is_across(mark: Mark) -> bool:
    """Return whether a mark is a level or band from edge to edge.

    A limit that is so far away that only its name is shown (nan) is one, too.
    """
    return 0 < len(mark.x) <= 4 and not np.isfinite(mark.x).any()


def _is_upright(mark: Mark) -> bool:
    """Return whether a mark is a vertical line."""
    return len(mark.y) == 2 and bool(np.isinf(mark.y).all())


def _is_area(mark: Mark) -> bool:
    """Return whether a mark is an area between two lines of the same x."""
    half = len(mark.x) // 2
    return (
        mark.filled
        and mark.full_run is None
        and half > 2
        and bool(np.array_equal(mark.x[:half], mark.x[half:][::-1]))
    )


def _is_line(mark: Mark) -> bool:
    """Return whether a mark is a line or points."""
    return mark.full_run is not None or not (
        mark.filled or not len(mark.x) or _is_upright(mark) or _is_across(mark)
    )


def _drawable(figure: Figure) -> bool:
    """Return whether the script can draw a figure.

    It can draw lines of growing x, areas, and levels and lines across the axes.
    """
    ax = figure.axes[0]
    known = all(
        _is_line(m) or _is_area(m) or _is_across(m) or _is_upright(m) for m in ax.marks
    )
    if (
        not known
        or ax.right is not None
        or ax.x.ticks is not None
        or ax.y.ticks is not None
    ):
        return False
    return all(
        len(line.x) and bool((np.diff(line.x) > 0.0).all()) for line in _lines(ax)
    )


def _plot(
    ax: Axes, lines: Sequence[_DrawnLine], points: int, grids: dict[bytes, int]
) -> JsonObject:
    """Convert a pair of axes to JSON, with its lines thinned to `points` values."""
    seconds = ax.x.seconds
    x, columns = thinned([(line.x, line.y) for line in lines], points)
    label = " ".join(ax.y.label.split("\n"))
    low, high = ax.y_range()
    return {
        "grid": grids.setdefault(
            ((seconds or 1.0) * x).astype("<f8").tobytes(), len(grids)
        ),
        "axis": ax.x.label.partition("[")[0].strip(),
        "unit": ax.x.label.partition("[")[2].rstrip("]"),
        "seconds": seconds,
        "xlog": ax.x.log,
        "ends": list(ax.x_range()),
        "label": label,
        "log": ax.y.log,
        "range": [low, high],
        "series": [
            {
                "label": line.label,
                "colour": m.colour,
                "width": m.width,
                "dash": list(m.dash),
                "points": m.marker,
                "hollow": m.hollow,
                "area": m.alpha if line.edge else 0.0,
                "stepped": m.stepped and len(x) == len(line.x),
                "gaps": bool(np.isnan(line.y.min(initial=0.0))),
                **_encode(values),
            }
            for line, values in zip(lines, columns, strict=True)
            for m in (line.mark,)
        ],
        "across": [
            {
                "label": m.label,
                "colour": m.colour,
                "low": _finite(m.y.min()),
                "high": _finite(m.y.max()),
                "filled": m.filled,
                "alpha": m.alpha,
                "dash": m.dash,
            }
            for m in ax.marks
            if _is_across(m)
        ],
        "upright": [
            {"label": m.label, "colour": m.colour, "at": float(m.x[0])}
            for m in ax.marks
            if _is_upright(m)
        ],
        "strips": [
            {
                "row": s.row,
                "label": s.label,
                "colour": s.colour,
                "spans": [round(seconds * t, 6) for span in s.spans for t in span],
            }
            for s in ax.strips
        ],
    }


def _finite(value: float) -> float | None:
    """Return a value as float, or None if it is not finite."""
    return float(value) if np.isfinite(value) else None


def thinned(
    lines: Sequence[tuple[Array, Array]], most: int
) -> tuple[Array, list[Array]]:
    """Thin lines (times, values) to shared times, at most `most` (even) of them.

    Lines that are short enough stay as they are, with nan where one has no value.
    Otherwise each has the minimum and maximum of each of `most` / 2 parts, in about the
    order in which they occur.
    """
    shared, is_alike = _shared_grid(lines)
    if len(shared) <= most:
        return _shared(lines)
    times, starts = split(shared, most // 2)
    firsts = shared[starts]
    return times, [
        extremes(y, starts if is_alike else np.searchsorted(x, firsts))
        for x, y in lines
    ]


def _shared_grid(lines: Sequence[tuple[Array, Array]]) -> tuple[Array, bool]:
    """Return all x of lines, and whether each line has the first of them."""
    longest = max((x for x, _ in lines), key=len)
    is_alike = all(np.array_equal(x, longest[: len(x)]) for x, _ in lines)
    if is_alike:
        return longest, True
    return np.unique(np.concatenate([x for x, _ in lines])), False


def _shared(lines: Sequence[tuple[Array, Array]]) -> tuple[Array, list[Array]]:
    """Return all x of lines, and the values of each, nan where it has none."""
    shared, _ = _shared_grid(lines)
    columns = [np.full(len(shared), np.nan) for _ in lines]
    for column, (x, y) in zip(columns, lines, strict=True):
        column[np.searchsorted(shared, x)] = y
    return shared, columns


def _floats(values: Array) -> tuple[NDArray[np.float32], float]:
    """Return values as little-endian floats, and an offset that is subtracted.

    It is not 0 where the values hardly differ.
    """
    finite_values = values[np.isfinite(values)]
    low, high = (
        (float(finite_values.min()), float(finite_values.max()))
        if len(finite_values)
        else (0.0, 0.0)
    )
    offset = 0.5 * (low + high) if high - low < 1e-3 * max(abs(low), abs(high)) else 0.0
    with np.errstate(over="ignore"):  # values beyond a float are not drawn
        return (values - offset).astype("<f4"), offset


def _encode(values: Array) -> JsonObject:
    """Encode values as base64 of little-endian floats with an offset."""
    data, offset = _floats(values)
    return {"data": base64.b64encode(data.tobytes()).decode(), "offset": offset}
