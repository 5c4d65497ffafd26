"""Our own figures: ticks, thinning, SVG that is well-formed, small and the same for the
same data; the shapes that matplotlib paints for an export."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from lxml import etree

from benchmarks.pages import figures
from benchmarks.pages.series import Series
from desat.figures import canvas, plots
from desat.figures.canvas import INCH, Dots, Figure, Shape, Words
from desat.figures.painting import paint
from desat.figures.plots import series_figure
from desat.language.scenario import Plot

SVG = "{http://www.w3.org/2000/svg}"


def axes(**options):
    figure = Figure(7.2, 2.9)
    return figure, figure.add(**options)


def lines(figure):
    """The lines that are drawn on axes, as points of the page."""
    return [s for s in figure.shapes() if isinstance(s, Shape) and s.within]


def texts(figure):
    return [s.text for s in figure.shapes() if isinstance(s, Words)]


# --- ticks ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("low", "high", "most", "labels", "aside"),
    [
        (0.0, 24.2, 6, ["0", "5", "10", "15", "20"], ""),
        (-0.31, 0.3, 5, ["−0.2", "0.0", "0.2"], ""),
        (0.0, 9.6, 5, ["0.0", "2.5", "5.0", "7.5"], ""),
        (-4.1e-5, 4.4e-5, 5, ["−2.5", "0.0", "2.5"], "×10⁻⁵"),
        (0.0, 2.1e7, 4, ["0", "1", "2"], "×10⁷"),
        (0.0, 85.0, 4, ["0", "25", "50", "75"], ""),  # steps of 50 would be two
        # all would begin with 6871
        (6871000.0, 6871002.1, 4, ["0", "1", "2"], "+ 6871000"),
        (3.0, 3.0 + 4.1e-9, 4, ["0", "2", "4"], "×10⁻⁹ + 3"),
    ],
)
def test_ticks_are_round_and_few(low, high, most, labels, aside):
    ticks = canvas.linear(low, high, most)
    assert (list(ticks.labels), ticks.aside) == (labels, aside)
    assert all(low - 1e-9 * abs(low) <= v <= high * (1 + 1e-9) for v in ticks.values)


@pytest.mark.parametrize("seed", range(40))
def test_labels_say_where_ticks_are(seed):
    """A label, with what is taken out of all, is the value of its tick, to the step."""
    draw = np.random.default_rng(seed)
    low = draw.normal() * 10.0 ** draw.integers(-9, 9)
    high = low + abs(draw.normal()) * 10.0 ** draw.integers(-6, 9)
    ticks = canvas.linear(low, high, 7)
    assert 1 <= len(ticks.values) <= 7
    power, shift = re.fullmatch(
        r"(?:×10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))? ?([+−] .*)?", ticks.aside
    ).groups()
    normal = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-")
    factor = 10.0 ** int((power or "⁰").translate(normal))
    offset = float((shift or "0").translate(normal).replace(" ", ""))
    messages = [float(t.translate(normal)) * factor + offset for t in ticks.labels]
    assert messages == pytest.approx(
        ticks.values, abs=1e-6 * (high - low) + 1e-12 * abs(low)
    )


def test_ticks_of_a_logarithmic_axis():
    ticks = canvas.logarithmic(0.5e-3, 2.0, 9)
    label_texts = [t for t in ticks.labels if t]
    assert label_texts == ["10⁻³", "10⁻²", "10⁻¹", "10⁰"]
    narrow = canvas.logarithmic(1.5, 8.0, 9)
    assert dict(zip(narrow.labels, narrow.values, strict=True))["2×10⁰"] == 2.0
    wide = canvas.logarithmic(1e-15, 1.0, 6)
    assert sum(map(bool, wide.labels)) <= 6


# --- lines ----------------------------------------------------------------------------


def test_a_line_keeps_its_extremes_when_thinned():
    x = np.arange(100_000.0)
    y = np.sin(x)
    y[54321], y[70000] = 50.0, -60.0
    figure, ax = axes()
    ax.plot(x, y, "#000000")
    ((part,),) = [s.parts for s in lines(figure)]
    assert len(part) < 3000
    height, (low, high) = ax.height, ax.y_range()
    line_values = high - (part[:, 1] - ax.top) / height * (high - low)
    assert (line_values.max(), line_values.min()) == pytest.approx(
        (50.0, -60.0), abs=0.05
    )
    assert (np.diff(part[:, 0]) >= 0.0).all()


def test_what_is_missing_parts_a_line():
    figure, ax = axes()
    ax.plot([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 1.0, np.nan, 1.0, 0.0], "#000000")
    assert [len(p) for p in lines(figure)[0].parts] == [2, 2]


def test_a_stepped_line_holds_each_value():
    figure, ax = axes()
    ax.plot([0.0, 1.0, 2.0], [0.0, 1.0, 0.0], "#000000", stepped=True)
    (part,) = lines(figure)[0].parts
    # along, up, along, down
    assert [bool(d[0]) for d in np.diff(part, axis=0)] == [True, False, True, False]


def test_a_limit_crosses_the_axes_and_counts_for_their_range():
    figure, ax = axes()
    ax.plot([0.0, 1.0], [0.0, 1.0], "#000000")
    ax.level(9.0, "#ff0000", label="9 limit")
    _, limit = lines(figure)
    assert limit.parts[0][:, 0].tolist() == [round(ax.left), round(ax.left + ax.width)]
    assert "8" in texts(figure)
    assert "9 limit" in texts(figure)


@pytest.mark.parametrize(
    "values", [[], [3.0] * 4, [0.0] * 4, [np.nan] * 4, [1e300, -1e300, 0, 0]]
)
def test_what_has_no_range_is_drawn_nevertheless(values):
    figure, ax = axes()
    ax.plot(np.arange(float(len(values))), values, "#000000", label="line")
    assert "nan" not in figure.svg()
    assert "line" in texts(figure)


def test_a_logarithmic_axis_leaves_out_what_is_not_above_zero():
    figure, ax = axes()
    ax.y.log = True
    ax.plot([0.0, 1.0, 2.0, 3.0], [1.0, 0.1, 0.0, 0.01], "#000000")
    assert [len(p) for p in lines(figure)[0].parts] == [2, 1]
    assert {"10⁻²", "10⁻¹", "10⁰"} <= set(texts(figure))


# --- SVG ------------------------------------------------------------------------------


def test_a_figure_of_many_long_lines_stays_small_and_the_same():
    draw = np.random.default_rng(1)
    times = np.arange(86401.0)
    data = [
        (f"line {i}", Series(times, draw.normal(size=len(times)))) for i in range(9)
    ]
    svg = figures.curves(data, "noise [1]")
    assert len(svg) < 60_000
    assert svg == figures.curves(data, "noise [1]")


def test_a_figure_of_very_many_points_stays_small():
    draw = np.random.default_rng(1)
    points = {
        "cases": (draw.normal(size=20_000).tolist(), draw.normal(size=20_000).tolist())
    }
    assert len(plots.scatter(points, "x", "y", size=2.0)) < 60_000


def test_names_of_others_cannot_break_out():
    figure, ax = axes()
    ax.plot([0.0, 1.0], [0.0, 1.0], "#000000", label="</svg><script>\x00\x1b")
    ax.y.label = "a & b < c"
    svg = figure.svg()
    assert "<script" not in svg
    root = etree.fromstring(svg)
    assert "a & b < c" in [e.text for e in root.iter(f"{SVG}text")]


def test_everything_lies_within_the_picture_and_nothing_on_a_label():
    """Of long labels too: ticks, names of axes and the legend have their own places."""
    figure, ax = axes()
    for i in range(14):
        ax.plot(
            [0.0, 86400.0],
            [-1e4 * i, 2e4],
            "#000000",
            label=f"a line with a long name {i}",
        )
    ax.x.label, ax.y.label = "time [s]", "momentum of each\nwheel [mN m s]"
    text_boxes = []
    for words in (s for s in figure.shapes() if isinstance(s, Words)):
        width, height = 0.58 * words.size * len(words.text), words.size
        x, y = words.at
        if words.turned:
            box = (x - height, y - width / 2, x, y + width / 2)
        else:
            remaining = (
                x - width * {"start": 0.0, "middle": 0.5, "end": 1.0}[words.anchor]
            )
            box = (remaining, y - 0.8 * height, remaining + width, y)
        assert box[0] >= -5, words
        assert box[1] >= -5, words
        assert box[2] <= INCH * 7.2 + 5, words
        assert box[3] <= INCH * 2.9 + 5, words
        for other, text in text_boxes:
            apart = (
                box[0] >= other[2]
                or box[2] <= other[0]
                or box[1] >= other[3]
                or box[3] <= other[1]
            )
            assert apart, (words.text, text)
        text_boxes.append((box, words.text))


def test_bars_and_marks_of_a_paper():
    svg = figures.bars(
        {"a": {"ours": 2.0}, "b": {"ours": 1.0}},
        "time [s]",
        printed={"a": {"ours": 1.9}},
    )
    words = [e.text for e in etree.fromstring(svg).iter(f"{SVG}text")]
    assert {"a", "b", "ours", "paper", "time [s]"} <= set(words)


# --- painted --------------------------------------------------------------------------


def test_matplotlib_paints_the_same_shapes(tmp_path):
    """A line, a filled band, points and texts are where SVG has them."""
    from matplotlib.image import imread

    figure, ax = axes()
    ax.band(-0.5, 0.5, "#00ff00")
    ax.plot([0.0, 1.0], [1.0, 1.0], "#ff0000", width=4.0)
    ax.plot([0.5], [-1.0], "#0000ff", width=0.0, marker=12.0)
    paint(figure, tmp_path / "a.png", "png")
    pixels = imread(tmp_path / "a.png")[..., :3]
    scale = 150.0 / INCH

    def at(x, y):
        return (pixels[round(y * scale), round(x * scale)] * 255).round().tolist()

    shapes = list(figure.shapes())
    line = next(s for s in shapes if isinstance(s, Shape) and s.colour == "#ff0000")
    dot = next(s for s in shapes if isinstance(s, Dots))
    middle = ax.left + ax.width / 2
    assert at(middle + 300, line.parts[0][0, 1]) == [255, 0, 0]
    assert at(*dot.at[0]) == [0, 0, 255]
    assert at(middle + 300, ax.top + ax.height / 2) == [0, 255, 0]
    assert at(10, 10) == [255, 255, 255]


def test_a_plot_without_its_series_is_none():
    class Nothing:
        def names(self):
            return []

    assert (
        series_figure(Plot(title="x", signals=["a.b"]), [("", Nothing(), {})]) is None
    )


def test_a_time_that_is_not_reached_has_no_point():
    """It stood at the upper edge, as if that were it."""
    scatter_plot = plots.scatter(
        {"law": ([1.0, 2.0], [10.0, 20.0])}, "x", "y", diagonal="equal"
    )
    neighbour = plots.scatter(
        {"law": ([1.0, 2.0, 5.0], [10.0, 20.0, math.inf])}, "x", "y", diagonal="equal"
    )
    assert neighbour == scatter_plot
