"""The report of a run: what comes first, the data of its figures, the page in a
browser.

A browser is taken where there is one: the package playwright, and Chromium by its name
or by the variable DESAT_CHROMIUM (CONTRIBUTING.md).
"""

from __future__ import annotations

import base64
import json
import re
import webbrowser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import html
from typer.testing import CliRunner

from desat import cli
from desat.campaign import report as campaign_report
from desat.campaign import store
from desat.figures import interactive
from desat.figures.canvas import Figure, Ticks
from desat.figures.plots import timeline
from desat.numbers.text import short_title
from desat.report import report
from desat.runs.run import Options, execute, load_run


def figure(lines, rows=100, *, name="a", step=1.0):
    plot_figure = Figure(7.2, 2.9)
    ax = plot_figure.add()
    times = np.arange(rows) * step
    for i in range(lines):
        ax.plot(times / 60.0, np.sin(times / 50.0 + i), "#0b62a4", name=f"{name} {i}")
    timeline(ax, 60.0, "min")
    return plot_figure


def numbers(series):
    raw = np.frombuffer(base64.b64decode(series["data"]), "<f4").astype(float)
    return raw + series["offset"]


# --- data of the figures --------------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(
    st.integers(1, 900),
    st.integers(10, 60),
    st.integers(0, 3),
    st.integers(0, 2**32 - 1),
)
def test_thinning_keeps_least_and_most_of_each_part(rows, parts, less, seed):
    draw = np.random.default_rng(seed)
    x, y = np.cumsum(draw.uniform(0.1, 3.0, rows)), draw.normal(size=rows)
    row_count = max(1, rows - less)
    times, (first, second) = interactive.thinned(
        [(x, y), (x[:row_count], y[:row_count])], 2 * parts
    )
    assert len(times) == len(first) == len(second) <= max(2 * parts, 0)
    assert (np.diff(times) > 0.0).all()
    assert times[0] == x[0]
    assert times[-1] == x[-1]
    if rows <= 2 * parts:
        assert np.array_equal(first, y)
        assert np.array_equal(second[:row_count], y[:row_count])
        return
    edges = np.linspace(x[0], x[-1], parts + 1)
    part = np.clip(np.searchsorted(edges, x, "right") - 1, 0, parts - 1)
    for k in range(parts):
        own_value, pair = y[part == k], first[2 * k : 2 * k + 2]
        # a sample on an edge may be counted to either side
        if len(own_value) and not np.isin(x[part == k], edges).any():
            assert sorted(pair) == [own_value.min(), own_value.max()]


def test_lines_of_other_times_stand_at_their_own():
    fast, slow = np.arange(0.0, 10.0), np.arange(0.5, 10.0, 2.0)
    times, (a, b) = interactive.thinned([(fast, fast), (slow, -slow)], 100)
    assert sorted({*fast, *slow}) == list(times)
    assert np.array_equal(a[np.isfinite(a)], fast)
    assert np.array_equal(b[np.isfinite(b)], -slow)
    assert np.array_equal(times[np.isfinite(b)], slow)


def test_gaps_stay_gaps():
    x, y = np.arange(1000.0), np.ones(1000)
    y[200:400], y[5] = np.nan, np.nan
    _, (thin,) = interactive.thinned([(x, y)], 100)
    assert np.isnan(thin[22:38]).all()
    assert np.isfinite(thin[:20]).all()  # one value of several that lacks is no gap


def test_values_that_hardly_differ_keep_their_digits():
    plot_figure, x = Figure(7.2, 2.9), np.arange(50.0)
    ax = plot_figure.add()
    ax.plot(x, 7.0e6 + 1e-3 * x, "#0b62a4")
    timeline(ax, 1.0, "s")
    (plot,) = interactive.data_of([plot_figure])["plots"]
    assert np.abs(numbers(plot["series"][0]) - (7.0e6 + 1e-3 * x)).max() < 1e-8


def test_a_day_of_thirty_series_is_below_6_megabytes():
    """With the SVG of its figures, the script and all samples."""
    figures = [figure(3, 86_400) for _ in range(10)]
    answer = interactive.data_of(figures)
    size = len(json.dumps(answer)) + sum(len(f.svg()) for f in figures)
    script = sum(
        p.stat().st_size
        for p in Path(report.__file__).parents[1].rglob("templates/**/*")
    )
    assert 500_000 < size + script < 6_000_000
    assert len(answer["grids"]) == 1  # of all plots
    assert {len(numbers(s)) for p in answer["plots"] for s in p["series"]} == {
        answer["most"]
    }


@pytest.mark.parametrize("of", ["bars", "names below", "turns back", "two ordinates"])
def test_what_the_script_cannot_draw_stays_svg(of):
    odd_figure = figure(1)
    (ax,) = odd_figure.axes
    if of == "bars":
        ax.bars([1.0, 2.0], [2.0, 3.0], [1.0, 2.0], "#000000")
    elif of == "names below":
        ax.x.ticks = Ticks((1.0,), ("one",))
    elif of == "turns back":
        ax.plot([1.0, 2.0, 1.5], [2.0, 3.0, 1.0], "#000000")
    else:
        ax.right = Figure(1.0, 1.0).add()
    answer = interactive.data_of([odd_figure, figure(1)])
    assert [bool(p) for p in answer["plots"]] == [False, True]


def test_points_areas_and_upright_lines_are_drawn_over_any_x():
    plot_figure, x = Figure(7.2, 2.9), np.array([0.1, 0.2, 0.4])
    ax = plot_figure.add()
    ax.x.log, ax.x.label, ax.y.label = True, "coil [A m²]", "duty [%]"
    ax.plot(x, 1.0 / x, "#112233", label="model")
    ax.plot(
        x[1:],
        1.1 / x[1:],
        "#112233",
        width=0.0,
        marker=6.0,
        hollow=True,
        label="closed loop",
    )
    ax.area(x, 0.0, x, "#445566", alpha=0.3, label="all")
    ax.upright(0.15, "#000000", label="least")
    (plot,) = interactive.data_of([plot_figure])["plots"]
    assert (plot["axis"], plot["unit"], plot["xlog"], plot["seconds"]) == (
        "coil",
        "A m²",
        True,
        0,
    )
    assert [s["label"] for s in plot["series"]] == [
        "model",
        "closed loop",
        "all: least",
        "all: most",
    ]
    assert [s["points"] for s in plot["series"]] == [0.0, 6.0, 0.0, 0.0]
    assert [s["area"] for s in plot["series"]] == [0.0, 0.0, 0.3, 0.3]
    assert np.allclose(numbers(plot["series"][3]), x)
    assert plot["upright"] == [{"label": "least", "colour": "#000000", "at": 0.15}]


def test_limits_go_across_and_fast_lines_are_whole():
    plot_figure = figure(0)
    (ax,) = plot_figure.axes
    x = np.arange(5000.0)
    ax.area(
        x[:5],
        0.0,
        1.0,
        "#112233",
        label="w: least to most",
        name="w",
        full_run=(x, np.cos(x)),
    )
    ax.level(2.0, "#000000", label="limit")
    ax.band(-1.0, 1.0, "#000000", alpha=0.2, label="band")
    (plot,) = interactive.data_of([plot_figure])["plots"]
    ((series,), level, band) = plot["series"], *plot["across"]
    assert series["label"] == "w"
    assert len(numbers(series)) == 5000
    assert (level["low"], level["high"], level["filled"]) == (2.0, 2.0, False)
    assert (band["low"], band["high"], band["filled"], band["alpha"]) == (
        -1.0,
        1.0,
        True,
        0.2,
    )


# --- the page -------------------------------------------------------------------------

MINE = """extends = "integrated/mil-nadir"
title = "Mine"
stop = 1200.0
[requirements.pointing]
max = 179.0
[requirements.wheels]
number = "largest"
max = 1.0
[numbers.largest]
title = "Largest </script><b>wheel"
signal = "wheels.h_wheel"
measure = "largest"
unit = "N.m.s"
[plots.dipole]
title = "Dipole </script><img>"
components = ["</script><b>x", "y", "z"]
"""


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    folder = tmp_path_factory.mktemp("report")
    (folder / "mine.toml").write_text(MINE)
    run = execute(str(folder / "mine.toml"), Options(), folder / "run")
    report.write_report(folder / "run", run)
    return folder / "run" / report.REPORT


def test_verdicts_and_the_plot_that_matters_come_first(page):
    """`wheels` has 98 % left and `pointing` hardly less than all of 179 deg: which is
    nearer?"""
    run, answer = load_run(page.parent), html.fromstring(page.read_text())
    nearest = min(run.manifest.verdicts.items(), key=lambda e: e[1].margin)
    texts = [e.text_content() for e in answer.iter("p", "table", "figcaption", "h2")]
    assert (
        f"Holds with a margin of {100 * nearest[1].margin:.3g} % ({nearest[1].title})"
        in texts[1]
    )
    title = {"wheels": "Wheel momentum", "pointing": "Pointing error"}[nearest[0]]
    captions = [f.findtext("figcaption").strip() for f in answer.iter("figure")]
    assert captions[:2] == [
        "Momentum of the fullest wheel, with management and without",
        title,
    ]
    assert texts.index(title + " all of it") < texts.index("Numbers")
    assert captions.count(title) == 1


@pytest.mark.parametrize(
    ("wheels", "pointing", "first"),
    [
        (0.5, 0.99, "Wheel momentum"),
        (2.0, 0.99, "Pointing error"),
        (0.999, 2.0, "Wheel momentum"),
    ],
)
def test_what_gives_first_stands_first(page, tmp_path, wheels, pointing, first):
    """Where requirements are not met: the plot that was the first to lose one. Limits
    are shares of what the run has; an rms is lost once the sum is too much for all."""
    numbers = load_run(page.parent).numbers["value"]
    requirements = (
        f"max = {pointing * numbers['pointing']}\n[requirements.wheels]\n"
        f'number = "largest"\nmax = {wheels * numbers["largest"]}\n'
    )
    before, _, after = MINE.partition("max = 179.0\n")
    after = after.partition("max = 1.0\n")[2]
    (tmp_path / "mine.toml").write_text(before + requirements + after)
    flight = execute(str(tmp_path / "mine.toml"), Options())
    text = flight.write_report(tmp_path / "page").read_text()
    captions = [
        f.findtext("figcaption").strip() for f in html.fromstring(text).iter("figure")
    ]
    assert captions[0] == first


def test_the_page_stands_alone_and_nobodys_names_end_its_script(page):
    text = page.read_text()
    answer = html.fromstring(text)
    assert answer.findall(".//img") == []
    assert not answer.xpath("//*[@src] | //link | //b[starts-with(., 'x')]")
    assert not re.search(r"url\(|@import", text)
    data = json.loads(answer.find(".//script[@id='drawn']").text)
    figures = answer.findall(".//figure")
    assert (
        len(data["plots"])
        == len(figures)
        == len(answer.xpath("//div[@class='still']/svg"))
    )
    assert all(data["plots"])
    dipole = next(
        p
        for f, p in zip(figures, data["plots"], strict=True)
        if f.findtext("figcaption").startswith("Dipole </script><img>")
    )
    assert dipole["series"][0]["label"] == "</script><b>x"
    assert "Permission is hereby granted" in text  # uPlot's licence


def test_its_data_are_those_of_the_run(page):
    run = load_run(page.parent)
    data = json.loads(
        html.fromstring(page.read_text()).find(".//script[@id='drawn']").text
    )
    plot = next(
        p for p in data["plots"] if p["label"].startswith("momentum of each wheel")
    )
    times = np.frombuffer(base64.b64decode(data["grids"][plot["grid"]]), "<f8")
    assert np.allclose(times, run.results.times("wheels.h_wheel"), rtol=0.0, atol=1e-9)
    values = np.column_stack([numbers(s) for s in plot["series"]])
    assert np.allclose(
        values, 1e3 * run.results.values("wheels.h_wheel"), rtol=1e-6, atol=1e-9
    )


def test_report_open(page, monkeypatch):
    uris = []
    monkeypatch.setattr(
        webbrowser, "open", lambda uri: uris.append(uri) or len(uris) == 1
    )
    for message in ("", "no browser was found"):
        invocation = CliRunner().invoke(
            cli.app_for([]), ["report", str(page.parent), "--open"]
        )
        assert invocation.exit_code == 0
        assert message in invocation.output
    assert uris == 2 * [page.resolve().as_uri()]


# --- a campaign's ---------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign") / "a b"
    invocation = CliRunner().invoke(
        cli.app_for([]),
        [
            "campaign",
            "integrated/mil-nadir",
            "-n",
            "12",
            "--stop",
            "20",
            "--jobs",
            "1",
            "--out",
            str(folder),
        ],
    )
    assert invocation.exit_code == 1, invocation.output  # nothing is dumped in 20 s
    return folder


def test_a_limit_far_from_a_distribution_is_named_and_not_drawn():
    """Drawn it would squeeze the bars to a line."""
    edges = np.array([1.0, 2.0, 3.0])
    near = {x: campaign_report._is_near(x, edges) for x in (-4.0, -2.0, 2.5, 6.0, 80.0)}
    assert near == {-4.0: False, -2.0: True, 2.5: True, 6.0: True, 80.0: False}
    assert short_title("Coil duty: mean dipole of the coils (%)") == "Coil duty"
    assert short_title("Largest wheel momentum (share)") == ("Largest wheel momentum")


def test_histograms_name_the_cases_of_each_bar(campaign):
    answer = html.fromstring((campaign / "report.html").read_text())
    data = json.loads(answer.find(".//script[@id='told']").text)
    assert data["command"] == f"desat campaign case '{campaign}'"
    figures = answer.xpath("//figure[@data-histogram]")
    assert len(figures) == len(data["histograms"]) > 5
    for bars in data["histograms"]:
        assert sorted(c for cases in bars["cases"] for c in cases) == list(range(12))
        assert list(map(len, bars["cases"])) == bars["counts"]
        assert 0.0 < bars["edges"][0] < bars["edges"][-1] < 1.0
        assert (np.diff(bars["edges"]) > 0.0).all()
    title = "Largest wheel momentum (share of capacity)"
    (k,) = (
        i for i, f in enumerate(figures) if f.findtext("figcaption").strip() == title
    )
    (name,) = (n for n, of in store.described(campaign).items() if of["title"] == title)
    table, bars = store.read(campaign), data["histograms"][k]
    assert table["case"].to_pylist() == list(range(12))
    values = np.array(table[f"out.{name}"].to_pylist())
    order = [
        c for cases in bars["cases"] for c in sorted(cases, key=lambda c: values[c])
    ]
    assert (np.diff(values[order]) >= 0.0).all()


# --- in a browser ---------------------------------------------------------------------

RANGES = "desat.shown.map(u => [u.scales.x.min, u.scales.x.max])"


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1400, 420])
def test_zoom_and_values_in_a_browser(browser, page, width, scheme):
    """All plots are drawn, nothing is wider than the window, times are linked, values
    are said."""
    tab = browser.new_page(
        viewport={"width": width, "height": 900}, color_scheme=scheme
    )
    tab.set_default_timeout(10_000)
    errors = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(page.as_uri())
    plots = "//figure[starts-with(@id, 'plot-')]"
    count = len(html.fromstring(page.read_text()).xpath(plots))
    assert tab.evaluate("desat.shown.length") == count
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert tab.evaluate("document.querySelectorAll('.still').length") == count
    assert not tab.locator(".still").first.is_visible()
    labels = tab.evaluate("desat.shown.map(u => [u.axes[0].label, u.axes[1].label])")
    assert all(x.startswith("time [") and y for x, y in labels)
    assert set(map(tuple, tab.evaluate(RANGES))) == {(0, 1200)}
    over = tab.locator(".u-over").first
    box = over.bounding_box()
    at = box["x"] + 0.25 * box["width"], box["y"] + 0.5 * box["height"]
    tab.mouse.move(*at)
    message = (
        tab.locator(".u-legend").nth(1).inner_text()
    )  # of another plot than that under it
    assert re.search(r"time:?\s*(29|30)\d\.\d s", message.replace("\n", " "))
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.5 * box["width"], at[1], steps=3)
    tab.mouse.up()
    ranges = tab.evaluate(RANGES)
    assert ranges[0] == pytest.approx([300.0, 600.0], abs=8.0)
    assert all(r == ranges[0] for r in ranges)
    tab.locator(".whole").first.click()
    assert set(map(tuple, tab.evaluate(RANGES))) == {(0, 1200)}
    tab.locator(".live").first.focus()
    for key, span in [
        ("+", (300, 900)),
        ("ArrowRight", (450, 1050)),
        ("-", (0, 1200)),
        ("+", (300, 900)),
        ("0", (0, 1200)),
    ]:
        tab.keyboard.press(key)
        assert {tuple(map(round, x)) for x in tab.evaluate(RANGES)} == {span}
    tab.locator(".u-legend .u-series th").nth(1).click()
    assert tab.evaluate("desat.shown[0].series[1].show") is False
    tab.emulate_media(media="print")
    assert tab.locator(".still").first.is_visible()
    assert not tab.locator(".live").first.is_visible()
    assert errors == []
    tab.close()


def test_a_click_on_a_bar_names_its_cases_and_on_one_its_command(browser, campaign):
    tab = browser.new_page(viewport={"width": 420, "height": 900})
    tab.set_default_timeout(10_000)
    tab.goto((campaign / "report.html").as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= 420
    data = json.loads(tab.evaluate("document.getElementById('told').textContent"))
    bars = data["histograms"][0]
    k = int(np.argmax(bars["counts"]))
    histogram = tab.locator(".many svg").first
    histogram.scroll_into_view_if_needed()
    box = histogram.bounding_box()
    share = 0.5 * (bars["edges"][k] + bars["edges"][k + 1])
    histogram.click(position={"x": share * box["width"], "y": 0.4 * box["height"]})
    case_list = tab.locator("#named")
    assert case_list.inner_text().endswith(": " + ", ".join(map(str, bars["cases"][k])))
    case_list.locator(".case").last.click()
    assert f"{data['command']} {bars['cases'][k][-1]}" in case_list.inner_text()
    tab.close()


def save_csv(browser, file, title):
    """Save the data of a figure by its button; return the lines of the file."""
    tab = browser.new_page()
    tab.goto(file.as_uri())
    button = tab.get_by_label(f"save {title} as CSV", exact=True)
    with tab.expect_download() as download:
        button.click()
    text = Path(download.value.path()).read_text()
    tab.close()
    return text.splitlines()


@pytest.mark.parametrize(
    ("title", "series", "factor"),
    [
        ("Wheel momentum", "wheels.h_wheel", 1e3),
        ("Dipole </script><img>", "torquers.m_mean_body", 1.0),
    ],
)
def test_csv_of_a_figure_has_all_samples_to_six_digits(
    browser, page, monkeypatch, tmp_path, title, series, factor
):
    monkeypatch.setattr(interactive, "FEWEST", 20)
    monkeypatch.setattr(interactive, "VALUES", 20)
    run = load_run(page.parent)
    lines = save_csv(browser, report.write_report(tmp_path, run), title)
    assert lines[0].startswith("time [s],")
    rows = [[float(x) for x in line.split(",")] for line in lines[1:]]
    assert [row[0] for row in rows] == run.results.times(series).tolist()
    values = factor * run.results.values(series)
    csv_values = np.array([row[1:] for row in rows])
    sixth_digit = 10.0 ** (np.floor(np.log10(np.abs(values))) - 5.0)
    assert (np.abs(csv_values - values) < sixth_digit).all()


def test_csv_of_a_page_without_all_samples_says_so_in_its_first_line(
    browser, page, monkeypatch, tmp_path
):
    for limit in ("FEWEST", "VALUES", "SAMPLES"):
        monkeypatch.setattr(interactive, limit, 20)
    run = load_run(page.parent)
    lines = save_csv(browser, report.write_report(tmp_path, run), "Wheel momentum")
    count = len(run.results.times())
    assert lines[0].startswith(f"# minima and maxima of 10 bins of {count} samples")
    assert len(lines) == 2 + 20
    assert max(len(x) for x in lines[2].split(",")) < 14


def test_without_javascript_the_svg_is_shown(browser, page):
    context = browser.new_context(java_script_enabled=False)
    tab = context.new_page()
    tab.goto(page.as_uri())
    assert tab.locator(".still svg").first.is_visible()
    assert not tab.locator(".live").first.is_visible()
    context.close()


def test_a_limit_that_is_far_beyond_is_named_and_no_line():
    """It has no place on the axes, and none among the times that lines share."""
    figure = Figure(6.0, 3.0)
    ax = figure.add()
    ax.x.seconds = 60.0
    ax.plot([0.0, 1.0], [0.0, 2.0], "#000000", label="x")
    ax.plot([np.nan], [np.nan], "#ff0000", label="±400 capacity: far beyond")
    (plot,) = interactive.data_of([figure])["plots"]
    assert [line["label"] for line in plot["series"]] == ["x"]
    assert plot["across"][0]["label"] == "±400 capacity: far beyond"
    assert plot["across"][0]["low"] is None


def test_a_run_without_rows_has_no_plot_of_the_browser_s():
    figure = Figure(6.0, 3.0)
    ax = figure.add()
    ax.x.seconds = 60.0
    ax.plot([], [], "#000000", label="x")
    assert interactive.data_of([figure])["plots"] == [None]
