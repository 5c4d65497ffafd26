"""Draw figures as SVG text: lines, areas and points on axes with ticks and a legend.

A figure is laid out here into shapes and texts, in tenths of a point from its upper
left corner. `svg` writes these, and `desat export` has matplotlib paint the same ones.
A report needs no plotting library, which takes half a second off every run.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from html import escape
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..system.errors import plain

Array = NDArray[np.float64]
Point = tuple[float, float]
Box = tuple[float, float, float, float]  # left, top, width, height

INCH = 720
# Free rims of all axes as shares of the figure's width and height, so that times align.
LEFT_MARGIN, RIGHT_MARGIN, TOP_MARGIN, BOTTOM_MARGIN = 0.115, 0.25, 0.08, 0.16
GRID, INK = "#dddddd", "#222222"
SMALL, USUAL = 80, 90  # Font sizes: SMALL of the legend, USUAL of all other text.
LETTER = 0.64  # mean width of a letter over its size
LEGEND = 21  # letters in a line of a legend
STRIP = 94  # height of a strip under an axis
LINE = 115  # distance between the lines of a legend
# Width of a column of a long line; of each column the first, smallest, largest and last
# point are drawn.
COLUMN = 5.0
# Limit for all longer lines of a figure together, so that a file stays below 60 kB.
COLUMNS = 2400

DOTS = 2500  # largest number of dots of one kind


class Shape(NamedTuple):
    """Painted path in tenths of a point, of several parts (n, 2) each.

    With `fill` it is closed.
    """

    parts: list[Array]
    colour: str
    width: float = 0.0
    dash: tuple[float, ...] = ()
    alpha: float = 1.0
    fill: str = ""
    within: Box | None = None  # box that it is clipped to


class Dots(NamedTuple):
    """Round points (n, 2) with a width (pt)."""

    at: Array
    colour: str
    width: float
    alpha: float = 1.0


class Words(NamedTuple):
    """Text at a point; with `turned` it runs from bottom to top."""

    at: Point
    text: str
    size: float = USUAL
    anchor: Literal["start", "middle", "end"] = "start"
    turned: bool = False


Drawn = Shape | Dots | Words


@dataclass
class Mark:
    """Line, area or points in data coordinates.

    A nan separates parts of it, an inf is the edge of the axes.
    """

    x: Array
    y: Array
    colour: str
    label: str = ""
    width: float = 1.0  # pt, of the line; 0: no line
    dash: tuple[float, ...] = ()  # pt, alternating lengths of dashes and gaps
    alpha: float = 1.0
    filled: bool = False
    marker: float = 0.0  # pt, width of a point
    hollow: bool = False
    stepped: bool = False  # whether each value of a line holds until the next
    # name of a line without a label, in figures where each line has a name
    name: str = ""
    # the line that lies within, for an area that encloses a fast line
    full_run: tuple[Array, Array] | None = None
    rows: int = 0  # samples that a line of fewer points stands for; 0: its points

    @property
    def count(self) -> int:
        """Count the points of its path."""
        return 2 * len(self.x) - 1 if self.stepped and len(self.x) else len(self.x)

    @property
    def path(self) -> tuple[Array, Array]:
        """Return x and y of all its points, corners of steps included."""
        if not self.stepped:
            return self.x, self.y
        return np.repeat(self.x, 2)[1:], np.repeat(self.y, 2)[:-1]


@dataclass
class Strip:
    """Coloured spans under the x axis."""

    row: int
    spans: list[tuple[float, float]]
    colour: str
    label: str


@dataclass
class Axis:
    """One of the two axes, with its label and its range where that is fixed."""

    label: str = ""
    low: float | None = None
    high: float | None = None
    log: bool = False
    margin: float = 0.05  # beyond what is drawn, as a share of it
    ticks: Ticks | None = None
    most: int | None = None  # largest number of ticks; None: as many as fit
    seconds: float = 0.0  # seconds in the unit of a time axis


@dataclass
class Axes:
    """Pair of axes in a figure, with its place and the marks on it."""

    left: float
    top: float
    width: float
    height: float
    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    size: float = USUAL  # font size
    legend: int = LEGEND  # letters in a line of the legend; 0: no legend
    marks: list[Mark] = field(default_factory=list)
    strips: list[Strip] = field(default_factory=list)
    # axes over these with the same x, whose y axis is at the right
    right: Axes | None = None

    def plot(self, x: Any, y: Any, colour: str, **look: Any) -> None:
        """Add a line, or points if `width` is 0 and `marker` is set."""
        self.marks.append(
            Mark(np.asarray(x, float), np.asarray(y, float), colour, **look)
        )

    def area(self, x: Any, low: Any, high: Any, colour: str, **look: Any) -> None:
        """Add the area between two lines of the same x."""
        x, low, high = (np.asarray(a, float) for a in np.broadcast_arrays(x, low, high))
        has_value = np.isfinite(low) | np.isinf(x)
        x, low, high = x[has_value], low[has_value], high[has_value]
        there_and_back = np.concatenate([x, x[::-1]]), np.concatenate([low, high[::-1]])
        self.marks.append(Mark(*there_and_back, colour, width=0.0, filled=True, **look))

    def bars(
        self, begin: Any, end: Any, heights: Any, colour: str, **look: Any
    ) -> None:
        """Add bars from zero, or from the edge of a logarithmic axis.

        A nan height leaves a bar out.
        """
        begin, end, heights = (np.asarray(a, float) for a in (begin, end, heights))
        foot = np.full_like(heights, -np.inf if self.y.log else 0.0)
        gap = np.full_like(heights, np.nan)
        x = np.column_stack([begin, begin, end, end, gap]).ravel()
        y = np.column_stack([foot, heights, heights, foot, gap]).ravel()
        self.marks.append(Mark(x, y, colour, width=0.0, filled=True, **look))

    def level(self, value: float, colour: str, **look: Any) -> None:
        """Add a horizontal line at a value of y."""
        self.plot([-math.inf, math.inf], [value, value], colour, **look)

    def upright(self, value: float, colour: str, **look: Any) -> None:
        """Add a vertical line at a value of x."""
        self.plot([value, value], [-math.inf, math.inf], colour, **look)

    def band(self, low: float, high: float, colour: str, **look: Any) -> None:
        """Add the area between two values of y."""
        self.area([-math.inf, math.inf], low, high, colour, **look)

    def y_range(self) -> Point:
        """Return the lowest and highest y of the axis, margins included."""
        return _range(self.y, [m.y for m in self.marks])

    def x_range(self) -> Point:
        """Return the lowest and highest x of the axis, margins included."""
        others = [self.right] if self.right else []
        spans = [np.ravel(s.spans) for s in self.strips]
        return _range(
            self.x, [*spans, *(m.x for a in (self, *others) for m in a.marks)]
        )

    def across(self, values: Any) -> Array:
        """Convert values of x to places in the figure.

        They are in tenths of a point from its left edge.
        """
        return _Scale(self.x, self.x_range(), self.left, self.width)(values)

    def make_room(self) -> None:
        """Move the left edge so far that labels and title of the y axis stand apart."""
        texts = self._of_y(self.y_range()).labels
        rows = len(self.y.label.split("\n")) if self.y.label else 0
        longest = max(map(len, texts), default=0)
        width_needed = 110 + LETTER * self.size * longest + 1.2 * self.size * rows
        if width_needed > self.left:
            self.width -= width_needed - self.left
            self.left = width_needed

    # --- layout -----------------------------------------------------------------------

    def shapes(self, column: float = COLUMN) -> Iterator[Drawn]:
        """Yield all shapes and texts of the axes.

        Lines of many points are thinned to columns of the width `column`.
        """
        others = [self.right] if self.right else []
        x = self.x_range()
        columns = _Columns(column)
        floor = self.height - STRIP * len({s.row for s in self.strips})
        box = (self.left, self.top, self.width, floor)
        yield from self._grid(x, box)
        for axes in (self, *others):
            scales = (
                _Scale(axes.x, x, box[0], box[2]),
                _Scale(axes.y, axes.y_range(), box[1] + box[3], -box[3]),
            )
            for mark in axes.marks:
                yield from _painted(mark, *scales, box, columns)
        for strip in self.strips:
            yield self._strip(strip, _Scale(self.x, x, box[0], box[2]), box)
        for axes in (self, *others):
            yield from axes._ordinate(box, right=axes is not self)
        yield from self._abscissa(x, box)
        if self.title:
            yield Words((self.left, self.top - 50), self.title, self.size)
        yield from self._legend(box)

    def _ticks(self, axis: Axis, ends: Point, labels: float) -> Ticks:
        """Return the ticks of an axis that has room for this many labels."""
        if axis.ticks is not None:
            return axis.ticks
        most = min(axis.most or 99, max(2, int(labels)))
        return (logarithmic if axis.log else linear)(*ends, most)

    def _of_x(self, x: Point) -> Ticks:
        """Return the ticks of the x axis."""
        return self._ticks(self.x, x, self.width / (4.6 * self.size))

    def _of_y(self, y: Point) -> Ticks:
        """Return the ticks of the y axis."""
        return self._ticks(self.y, y, min(9.0, self.height / (2.3 * self.size)))

    def _grid(self, x: Point, box: Box) -> Iterator[Shape]:
        """Draw the grid lines at the ticks."""
        x0, top, width, height = box
        y = self.y_range()
        across, up = (
            _Scale(self.x, x, x0, width),
            _Scale(self.y, y, top + height, -height),
        )
        lines = [np.array([[x0, v], [x0 + width, v]]) for v in up(self._of_y(y).values)]
        # no vertical lines between bars, which have their own ticks
        if self.x.ticks is None or self.x.log:
            lines += [
                np.array([[v, top], [v, top + height]])
                for v in across(self._of_x(x).values)
            ]
        yield Shape(lines, GRID, 0.6)

    def _ordinate(self, box: Box, right: bool) -> Iterator[Drawn]:
        """Draw the y axis with ticks, labels and title, at the left or the right."""
        x0, top, width, height = box
        ends = self.y_range()
        positions = self._of_y(ends)
        scale, side = _Scale(self.y, ends, top + height, -height), 1 if right else -1
        edge = x0 + width if right else x0
        lines = [np.array([[edge, top], [edge, top + height]])]
        longest = 0
        for value, text in zip(scale(positions.values), positions.labels, strict=True):
            lines.append(
                np.array([[edge, value], [edge + side * (35 if text else 20), value]])
            )
            yield Words(
                (edge + side * 60, value + 0.35 * self.size),
                text,
                self.size,
                "start" if right else "end",
            )
            longest = max(longest, len(text))
        yield Shape(lines, INK, 0.8)
        if positions.aside:
            yield Words(
                (edge, top - 35),
                positions.aside,
                self.size,
                "end" if right else "start",
            )
        rows = self.y.label.split("\n") if self.y.label else []
        at = edge + side * (60 + LETTER * self.size * longest + 50)
        for i, row in enumerate(rows):
            if right:
                place = at + self.size + i * 1.2 * self.size
            else:
                place = max(
                    at - (len(rows) - 1 - i) * 1.2 * self.size,
                    0.8 * self.size * (i + 1),
                )
            yield Words(
                (place, top + height / 2), row, self.size, "middle", turned=True
            )

    def _abscissa(self, x: Point, box: Box) -> Iterator[Drawn]:
        """Draw the x axis with ticks, labels and title."""
        x0, top, width, height = box
        floor, positions = self.top + self.height, self._of_x(x)
        lines = [np.array([[x0, top + height], [x0 + width, top + height]])]
        row = floor + 30 + self.size
        for value, text in zip(
            _Scale(self.x, x, x0, width)(positions.values),
            positions.labels,
            strict=True,
        ):
            end = top + height + (35 if text else 20)
            lines.append(np.array([[value, top + height], [value, end]]))
            yield Words((value, row), text, self.size, "middle")
        yield Shape(lines, INK, 0.8)
        label = f"{self.x.label} {positions.aside}".strip()
        for i, text in enumerate(label.split("\n")):
            at = (x0 + width / 2, row + (1.3 + 1.2 * i) * self.size)
            yield Words(at, text, self.size, "middle")

    def _strip(self, strip: Strip, scale: _Scale, box: tuple[float, ...]) -> Shape:
        """Draw the spans of a strip under the axes."""
        top = box[1] + box[3] + STRIP * (strip.row + 0.15)
        low, high = top, top + 0.8 * STRIP
        parts = []
        for begin, end in scale(np.array(strip.spans)):
            parts.append(
                np.array([[begin, low], [end, low], [end, high], [begin, high]])
            )
        return Shape(parts, "", fill=strip.colour)

    def _legend(self, box: Box) -> Iterator[Drawn]:
        """Draw the legend beside the axes; long labels are wrapped."""
        named: list[Mark | Strip] = []
        for axes in [self, *([self.right] if self.right else [])]:
            named += [m for m in axes.marks if m.label]
        named += [s for s in self.strips if s.label]
        if not named or not self.legend:
            return
        entries = [(m, textwrap.wrap(m.label, self.legend)) for m in named]
        size, pitch = float(SMALL), float(LINE)
        rows_in_all = sum(len(rows) for _, rows in entries)
        if rows_in_all * pitch > (
            height := self.height + 300
        ):  # a smaller font for a long legend
            size, pitch = size * height / (rows_in_all * pitch), height / rows_in_all
        x0 = box[0] + box[2] + (560 if self.right else 80)
        y = self.top + self.height / 2 - rows_in_all * pitch / 2 + 0.75 * pitch
        for mark, rows in entries:
            yield from _sample(mark, x0, y - 0.35 * size)
            for row in rows:
                yield Words((x0 + 190, y), row, size)
                y += pitch


@dataclass
class Figure:
    """Figure with a width and height (in)."""

    width: float
    height: float
    axes: list[Axes] = field(default_factory=list)

    def add(
        self,
        top: float = TOP_MARGIN,
        bottom: float = BOTTOM_MARGIN,
        left: float = LEFT_MARGIN,
        right: float = RIGHT_MARGIN,
    ) -> Axes:
        """Add axes with a free rim of these shares of the figure."""
        width, height = INCH * self.width, INCH * self.height
        axes = Axes(
            left * width,
            top * height,
            (1.0 - left - right) * width,
            (1.0 - top - bottom) * height,
        )
        self.axes.append(axes)
        return axes

    def shapes(self) -> Iterator[Drawn]:
        """Yield all shapes and texts, the lowest first."""
        all_axes = [*self.axes, *(a.right for a in self.axes if a.right)]
        width = max((a.width for a in self.axes), default=0.0)
        dense = sum(
            m.count > 2.0 * width / COLUMN for a in all_axes for m in a.marks if m.width
        )
        for axes in self.axes:
            yield from axes.shapes(max(COLUMN, width * dense / COLUMNS))

    def svg(self) -> str:
        """Return the figure as an <svg> element, the same for the same data."""
        width, height = round(INCH * self.width), round(INCH * self.height)
        parts = [
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
            'font-family="DejaVu Sans,Verdana,Helvetica,Arial,sans-serif" '
            f'fill="none" stroke-linejoin="round">'
            f'<rect width="{width}" height="{height}" fill="#fff"/>'
        ]
        parts += [_markup(shape) for shape in self.shapes()]
        return "\n".join([*filter(None, parts), "</svg>"])

    def _repr_svg_(self) -> str:
        return self.svg()


def in_notebook(figure: Figure | None) -> str:
    """Return a figure as a part of what a notebook shows; "" without one."""
    return f'<div style="max-width:48rem">{figure.svg()}</div>' if figure else ""


class _Scale:
    """Conversion from data coordinates to those of the figure; inf is the edge."""

    def __init__(self, axis: Axis, ends: Point, start: float, length: float) -> None:
        self._log, self._start, self._length = axis.log, start, length
        self._low, self._high = map(math.log10, ends) if axis.log else ends

    def has(self, values: Array) -> NDArray[np.bool_]:
        """Return which values have a place; on a logarithmic axis it is above zero."""
        has_place = ~np.isnan(values)
        return (
            has_place & ((values > 0.0) | np.isinf(values)) if self._log else has_place
        )

    def __call__(self, values: Any) -> Array:
        """Convert values of the axis to places on the canvas (pixels)."""
        values = np.asarray(values, float)
        if self._log:
            with np.errstate(divide="ignore", invalid="ignore"):
                edge = np.isinf(values)
                # a logarithmic axis has no place for values below or at zero
                values = np.where(
                    edge, values, np.log10(np.where(values > 0.0, values, np.nan))
                )
        share = (values - self._low) / (self._high - self._low)
        share = np.where(values == np.inf, 1.0, np.where(values == -np.inf, 0.0, share))
        # values far outside are clipped anyway
        place: Array = self._start + self._length * np.clip(share, -9.0, 10.0)
        return place


def _range(axis: Axis, values: Sequence[Array]) -> Point:
    """Return the lower and upper end of an axis that shows these values."""
    shown = [
        v[np.isfinite(v) & (v > 0.0)] if axis.log else v[np.isfinite(v)] for v in values
    ]
    shown = [v for v in shown if len(v)]
    low = min((float(v.min()) for v in shown), default=0.1 if axis.log else 0.0)
    high = max((float(v.max()) for v in shown), default=1.0)
    if axis.log:
        rim = axis.margin * math.log10(high / low) or 0.3
        low, high = low * 10.0**-rim, high * 10.0**rim
    else:
        # a constant: a margin of its own size
        rim = (
            axis.margin * (high - low)
            if high - low > 1e-12 * max(abs(low), abs(high))
            else (0.05 * max(abs(low), abs(high)) or 1.0)
        )
        low, high = low - rim, high + rim
    return (
        low if axis.low is None else axis.low,
        high if axis.high is None else axis.high,
    )


class _Columns:
    """Columns of a picture to which lines of many points are thinned.

    Most lines of axes have the same x; their columns are found once.
    """

    def __init__(self, width: float) -> None:
        self._width = width
        self._x: Array | None = None
        self._places: Array
        self._ends: tuple[Any, Any] | None

    def thinned(self, x: Array, y: Array, across: _Scale, up: _Scale) -> Array:
        """Return the points of a line, the first, lowest, highest and last of a column.

        They are rounded to tenths of a point, and repeated ones are dropped. Only they
        are scaled: scales are monotonic.
        """
        places, ends = self._found(x, across)
        if ends is None:
            points = np.round(np.column_stack([places, up(y)]))
        else:
            first, last = ends
            a, b = (up(f.reduceat(y, first)) for f in (np.minimum, np.maximum))
            heights = [up(y[first]), np.minimum(a, b), np.maximum(a, b), up(y[last])]
            sides = [places[first], places[first], places[last], places[last]]
            points = np.column_stack(
                [np.round(np.stack(v, axis=1)).ravel() for v in (sides, heights)]
            )
        moved = (np.diff(points, axis=0) != 0.0).any(axis=1)
        thinned: Array = points[np.append(True, moved)]
        return thinned

    def _found(self, x: Array, across: _Scale) -> tuple[Array, tuple[Any, Any] | None]:
        """Find the places of points, and the first and last one of each column.

        None instead of these where there are few points, or not in the order of x.
        """
        if self._x is None or not np.array_equal(self._x, x):
            places = np.round(across(x))
            first = np.flatnonzero(
                np.diff(np.floor(places / self._width), prepend=-np.inf)
            )
            last = np.append(first[1:], len(x)) - 1
            many = len(x) > 4 * len(first) and (np.diff(places) >= 0.0).all()
            self._x, self._places = x, places
            self._ends = (first, last) if many else None
        return self._places, self._ends


def _painted(
    mark: Mark, across: _Scale, up: _Scale, box: Box, columns: _Columns
) -> Iterator[Drawn]:
    """Convert a mark to shapes."""
    x, y = mark.path
    if mark.width and not mark.filled:
        parts = [
            columns.thinned(x[part], y[part], across, up)
            for part in _parts(across.has(x) & up.has(y))
        ]
        yield Shape(parts, mark.colour, mark.width, mark.dash, mark.alpha, within=box)
    if not (mark.filled or mark.marker):
        return
    points = np.column_stack([across(x), up(y)])
    is_finite = np.isfinite(points.sum(axis=1))
    if mark.filled:
        parts = [points[p] for p in _parts(is_finite) if p.stop - p.start > 2]
        yield Shape(parts, "", alpha=mark.alpha, fill=mark.colour, within=box)
    if mark.marker:
        yield from _dots(mark, points[is_finite])


def _dots(mark: Mark, points: Array) -> Iterator[Dots]:
    """Draw the points of a mark; if there are very many, on a grid."""
    grid, at = 1.0, np.unique(np.round(points), axis=0)
    while len(at) > DOTS:
        grid *= 1.5
        at = np.unique(np.round(points / grid), axis=0) * grid
    yield Dots(at, mark.colour, mark.marker, mark.alpha)
    if mark.hollow:
        yield Dots(at, "#ffffff", mark.marker - 1.4)


def _parts(known: NDArray[np.bool_]) -> list[slice]:
    """Return the contiguous parts of points that are known."""
    if known.all():
        return [slice(0, len(known))] if len(known) else []
    ends = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    return [slice(a, b) for a, b in ends.reshape(-1, 2).tolist()]


def _sample(mark: Mark | Strip, x0: float, y: float) -> Iterator[Drawn]:
    """Draw the sample of a mark before its label in a legend."""
    if isinstance(mark, Strip) or mark.filled:
        box = np.array(
            [[x0, y - 32], [x0 + 130, y - 32], [x0 + 130, y + 32], [x0, y + 32]]
        )
        alpha = 1.0 if isinstance(mark, Strip) else mark.alpha
        yield Shape([box], "", alpha=alpha, fill=mark.colour)
        return
    if mark.width:
        line = np.array([[x0, y], [x0 + 130, y]])
        yield Shape([line], mark.colour, mark.width, mark.dash, mark.alpha)
    if mark.marker:
        yield from _dots(
            replace(mark, marker=max(mark.marker, 3.0)), np.array([[x0 + 65, y]])
        )


# --- SVG ------------------------------------------------------------------------------


def _markup(shape: Drawn) -> str:
    """Convert a shape or text to SVG."""
    if isinstance(shape, Words):
        return _text(shape)
    return _path_of(shape) if isinstance(shape, Shape) else _dots_of(shape)


def _path_of(shape: Shape) -> str:
    """Convert a shape to SVG.

    It is clipped by an <svg> element of its own, because names of clip paths would
    apply to the whole page.
    """
    path = "".join(_path(p) + "z" * bool(shape.fill) for p in shape.parts)
    if not path:
        return ""
    look = f' fill="{shape.fill}"' if shape.fill else f' stroke="{shape.colour}"'
    if shape.width:
        look += f' stroke-width="{10.0 * shape.width:g}"'
    if shape.dash:
        look += f' stroke-dasharray="{" ".join(f"{10.0 * d:g}" for d in shape.dash)}"'
    if shape.alpha < 1.0:
        look += f' opacity="{shape.alpha:g}"'
    element = f'<path d="{path}"{look}/>'
    if shape.within is None:
        return element
    x0, top, width, height = (round(v) for v in shape.within)
    points = np.concatenate(shape.parts) - (x0, top)
    if (points >= -5.0).all() and (points <= (width + 5.0, height + 5.0)).all():
        return element  # nothing to clip
    return (
        f'<svg x="{x0}" y="{top}" width="{width}" height="{height}" '
        f'viewBox="{x0} {top} {width} {height}">{element}</svg>'
    )


def _dots_of(dots: Dots) -> str:
    """Convert dots to SVG, as lines of zero length with round ends."""
    if not len(dots.at):
        return ""
    moves = np.diff(
        np.rint(dots.at).astype(int), axis=0, prepend=np.zeros((1, 2), int)
    ).tolist()
    path = "".join(f"m{x}{'' if y < 0 else ' '}{y}h0" for x, y in moves)
    alpha = f' opacity="{dots.alpha:g}"' if dots.alpha < 1.0 else ""
    return (
        f'<path d="{path}" stroke="{dots.colour}" stroke-width="{10.0 * dots.width:g}" '
        f'stroke-linecap="round"{alpha}/>'
    )


def _path(points: Array) -> str:
    """Convert points to an SVG path in whole tenths of a point.

    Each point is relative to the one before.
    """
    pixels = np.rint(points).astype(int)
    (x, y), moves = pixels[0].tolist(), np.diff(pixels, axis=0).tolist()
    parts, letter = [f"M{x} {y}"], ""
    for dx, dy in moves:
        if dy == 0:
            command, text = "h", f"{dx}"
        elif dx == 0:
            command, text = "v", f"{dy}"
        else:
            command, text = "l", f"{dx}{'' if dy < 0 else ' '}{dy}"
        joint = command if command != letter else "" if text[0] == "-" else " "
        parts.append(joint + text)
        letter = command
    return "".join(parts)


def _text(words: Words) -> str:
    """Convert a text to SVG."""
    if not words.text:
        return ""
    x, y = (round(v) for v in words.at)
    place = (
        f'transform="translate({x} {y})rotate(-90)"'
        if words.turned
        else f'x="{x}" y="{y}"'
    )
    anchor = "" if words.anchor == "start" else f' text-anchor="{words.anchor}"'
    text = escape(plain(words.text), quote=False)
    return (
        f'<text {place} font-size="{words.size:.3g}"{anchor} fill="{INK}">{text}</text>'
    )


# --- Ticks and labels of an axis ------------------------------------------------------


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
# Sizes above and below which a power of ten is taken out of all labels of an axis.
_LARGE, _SMALL = 1e5, 1e-3
FEWEST_TICKS = 3
# Decades of a logarithmic axis up to which values between the powers have ticks.
_FEW = 3


class Ticks(NamedTuple):
    """Ticks of an axis: values, and a label each, empty for a short tick without one.

    The text `aside` stands for what is taken out of all labels, as ×10⁻⁶ or + 7000.
    """

    values: tuple[float, ...]
    labels: tuple[str, ...]
    aside: str = ""


def raised(number: int) -> str:
    """Return an integer as an exponent: -3 becomes ⁻³."""
    return str(number).translate(_RAISED)


def linear(low: float, high: float, most: int) -> Ticks:
    """Return at most `most` ticks from low to high, at a round distance.

    The distance is 1, 2, 2.5 or 5 times a power of ten. There are three to five where
    `most` would leave fewer than three.
    """
    step = nice((high - low) / max(most - 1, 1))
    values = _multiples(step, low, high)
    for part in (0.5, 0.4, 0.25, 0.2):
        closer = _multiples(nice(part * step), low, high)
        if len(values) < FEWEST_TICKS <= len(closer) <= max(most, FEWEST_TICKS + 2):
            step, values = nice(part * step), closer
    largest = max(abs(low), abs(high))
    aside, shift, power = "", 0.0, 0
    if step < 1e-4 * largest:  # all labels would have the same leading digits
        shift = math.floor(low / (1000.0 * step) + 1e-3) * 1000.0 * step
        aside = f"{'−' if shift < 0.0 else '+'} {abs(shift):.15g}"
        largest = high - shift
    if not _SMALL <= largest < _LARGE:
        power = math.floor(math.log10(largest))
        aside = f"×10{raised(power)} {aside}".strip()
    # decimals of the step; 2.5 has one more
    size = step / 10.0**power
    digits = next(
        (d for d in range(12) if abs(round(size, d) - size) < 1e-6 * size), 12
    )
    texts = [f"{(v - shift) / 10.0**power:.{digits}f}" for v in values]
    return Ticks(tuple(values), tuple(minus(t) for t in texts), aside)


def _multiples(step: float, low: float, high: float) -> list[float]:
    """Return the multiples of a step from low to high."""
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [k * step for k in range(first, last + 1)]


def nice(step: float) -> float:
    """Round a step up to 1, 2, 2.5 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(s * power for s in _STEPS if s * power >= step * (1.0 - 1e-9))


def logarithmic(low: float, high: float, most: int) -> Ticks:
    """Return ticks at powers of ten, with at most `most` labels.

    On an axis of few decades there are ticks between them, too.
    """
    first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
    every = -(-(last - first + 1) // max(most, 2))
    ticks: list[tuple[float, str]] = []
    inside = sum(low <= 10.0**k <= high for k in range(first, last + 1))
    for k in range(first, last + 1):
        ticks.append((10.0**k, f"10{raised(k)}" if k % every == 0 else ""))
        if last - first > _FEW:
            continue
        for digit in range(2, 10):
            has_label = inside < 2 and digit in (2, 5)
            ticks.append(
                (digit * 10.0**k, f"{digit}×10{raised(k)}" if has_label else "")
            )
    within = [(v, t) for v, t in ticks if low * (1 - 1e-9) <= v <= high * (1 + 1e-9)]
    return Ticks(tuple(v for v, _ in within), tuple(t for _, t in within))


def minus(text: str) -> str:
    """Return a number's text with a minus as wide as a plus, and none before a zero."""
    return text.replace("-", "−") if float(text) else text.lstrip("-")
