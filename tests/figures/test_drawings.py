"""Drawings of loop and craft, and the view of orbit and attitude."""

from __future__ import annotations

import base64
import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from lxml import etree

from desat.figures.craft import pieces, sketch
from desat.figures.diagram import DiagramPart, Wire, diagram
from desat.numbers.derived import rotate_back
from desat.report import report
from desat.report.scene import ROWS, view, view_of_run
from desat.runs import drawings
from desat.runs.prepare import prepare
from desat.runs.run import Options, execute, load_run
from desat.system.wheels import existing
from tests.conftest import ROOT, one_of_each_craft, wait_until

SVG = "{http://www.w3.org/2000/svg}"
COILS = "integrated/mil-nadir"


def numbers(encoding, columns):
    """Decode a packed series."""
    raw = np.frombuffer(base64.b64decode(encoding["data"]), "<i2").astype(float)
    return encoding["scale"] * raw.reshape((-1, columns))


def boxes(text):
    """Return the rectangles of components in a diagram: left, top, right, bottom."""
    rectangles = etree.fromstring(text.encode()).findall(f"{SVG}rect[@class='box']")
    sides = [
        [float(b.get(k)) for k in ("x", "y", "width", "height")] for b in rectangles
    ]
    return [(x, y, x + w, y + h) for x, y, w, h in sides]


# --- the loop -------------------------------------------------------------------------


@pytest.mark.parametrize("name", one_of_each_craft())
def test_a_diagram_has_each_component_and_each_wired_output(name):
    """No box covers another, and nothing lies outside the picture."""
    system, _ = prepare(name, Options()).or_raise()
    text = drawings.loop_of_system(system)
    root = etree.fromstring(text.encode())
    words = [t.text for t in root.iter(f"{SVG}text")]
    titles = [
        t.findtext(f"{SVG}title") for t in root.findall(f"{SVG}path[@class='wire']")
    ]
    assert {f"{c.source}.{c.output_array}" for c in system.connections} == set(titles)
    assert len(titles) == len(set(titles))
    assert set(system.components) <= set(words)
    rectangles = boxes(text)
    assert len(rectangles) == len(system.components)
    for k, a in enumerate(rectangles):
        for b in rectangles[k + 1 :]:
            assert a[2] <= b[0] or b[2] <= a[0] or a[3] <= b[1] or b[3] <= a[1]
    *_, wide, high = map(float, root.get("viewBox").split())
    places = re.findall(r"[MHV](-?[\d.]+)", text)
    assert all(-1.0 <= float(p) <= max(wide, high) for p in places)
    assert all(b[0] >= 0.0 and b[2] <= wide and b[3] <= high for b in rectangles)


def test_a_run_has_the_diagram_of_its_system(tmp_path):
    run = execute(COILS, Options(stop=20.0), tmp_path)
    system, _ = prepare(COILS, Options(stop=20.0)).or_raise()
    ends = r"<title>(\w+\.\w+)</title>"
    ours = drawings.loop_of_system(system)
    run_diagram = drawings.loop_of_run(run.manifest, run.results)
    assert re.findall(ends, run_diagram) == re.findall(ends, ours)
    assert boxes(run_diagram) == boxes(ours)


def test_outputs_have_their_units_and_marks():
    system, _ = prepare(COILS, Options()).or_raise()
    text = drawings.loop_of_system(system)
    assert "m_cmd_body [A m2]" in text
    assert "q_bi</text>" in text  # without a unit: no brackets
    bar = re.findall(r'<rect x="[-\d.]+" y="[-\d.]+" width="9"', text)
    assert len(bar) >= 2  # a mean over the step, and that of the legend
    assert text.count('class="open"') >= 2


def test_components_without_a_role_stand_right_of_what_feeds_them():
    """In a chain of four, and in a ring of three."""
    parts = {name: DiagramPart("", "") for name in "abcd"}
    chain = [Wire(a, "y", b, "u", "1", "state") for a, b in ("dc", "cb", "ba")]
    edges = [b[0] for b in boxes(diagram(parts, chain, "chain"))]  # a, b, c, d
    assert edges == sorted(edges, reverse=True)
    assert len(set(edges)) == 4
    ring = [Wire(a, "y", b, "u", "1", "state") for a, b in ("ab", "bc", "ca")]
    assert len(boxes(diagram({n: parts[n] for n in "abc"}, ring, "ring"))) == 3


def test_a_name_does_not_end_the_picture():
    text = diagram({"a": DiagramPart("", "<b>&")}, [], "x</title><script>")
    assert (
        etree.fromstring(text.encode()).findtext(f"{SVG}title") == "x</title><script>"
    )


# --- the craft ------------------------------------------------------------------------


@given(st.tuples(*[st.floats(0.2, 1.0)] * 3))
def test_a_craft_without_plates_is_the_box_of_its_moments(sides):
    a, b, c = sides
    moments = np.diag([b * b + c * c, a * a + c * c, a * a + b * b]) * 7.0 / 12.0
    (body,) = [p for p in pieces({"inertia": moments.ravel()}) if p.kind == "body"]
    extent = np.ptp(np.concatenate(body.faces), axis=0)
    assert extent == pytest.approx(np.array(sides) / max(sides), rel=1e-9)


@given(st.floats(0.01, 20.0), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_a_plate_has_its_area_and_lies_across_its_normal(area, normal):
    n = np.array(normal)
    n[2] += 2.0
    n /= np.linalg.norm(n)
    rows = np.zeros((2, 9))
    rows[0, :7] = *n, area, 0.3, -0.2, 0.1
    rows[1, :7] = 1.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0  # 2 m a side
    (plates,) = [p for p in pieces({"plates": rows.ravel()}) if p.kind == "plate"]
    face, other = plates.faces
    scale = 2.0 / np.linalg.norm(other[1] - other[0])
    sides = scale * (face[1] - face[0]), scale * (face[2] - face[1])
    assert np.linalg.norm(np.cross(*sides)) == pytest.approx(area, rel=1e-9)
    assert [float(s @ n) for s in sides] == pytest.approx([0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("name", one_of_each_craft())
def test_a_sketch_has_each_wheel_and_each_coil(name):
    system, _ = prepare(name, Options()).or_raise()
    parts = drawings.craft_of_system(system)
    if "spacecraft" not in system.roles:
        assert not parts
        return
    kinds = [p.kind for p in parts]
    wheels = system.roles.get("wheels")
    count = 0 if wheels is None else int(existing(wheels.values).sum())
    assert kinds.count("wheel") == count
    assert kinds.count("axis") == 3
    assert ("coil" in kinds) == (
        "axes_coil" in getattr(system.roles.get("torquers"), "values", {})
    )
    root = etree.fromstring(sketch(parts, name).encode())
    labels = {p.label for p in parts if p.label}
    assert labels <= {t.text for t in root.iter(f"{SVG}text")}


def test_show_draws(desat, tmp_path):
    for option, kind in (("--diagram", "loop"), ("--sketch", "craft")):
        command = desat("show", COILS, option, cwd=tmp_path, check=True)
        assert command.stdout.strip() == f"runs/{kind}-integrated-mil-nadir.svg"
        etree.parse(tmp_path / command.stdout.strip())
    command = desat(
        "show", COILS, "--diagram", "--out", "a/b.svg", "--json", cwd=tmp_path
    )
    assert json.loads(command.stdout) == {"drawing": "a/b.svg"}
    assert (tmp_path / "a" / "b.svg").exists()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["--out", "x.svg"], "--out x.svg: it goes with --diagram or --sketch"),
        (["--diagram", "--sketch"], "--diagram and --sketch: one at a time"),
        (["--sketch", "--out", "x.png"], "--out x.png: a drawing is an .svg file"),
    ],
)
def test_what_show_does_not_draw(desat, tmp_path, arguments, line):
    command = desat("show", COILS, *arguments, cwd=tmp_path)
    assert command.returncode == 2
    assert line in command.stderr
    assert not [*tmp_path.iterdir()]


def test_a_craft_that_is_not_ours_has_no_sketch(desat, tmp_path, monkeypatch):
    monkeypatch.setattr(drawings, "craft_of_system", lambda system: [])
    command = desat("show", COILS, "--sketch", cwd=tmp_path)
    assert command.returncode == 2
    assert "no spacecraft of ours" in command.stderr
    assert not [*tmp_path.iterdir()]


# --- orbit and attitude ---------------------------------------------------------------


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    place = tmp_path_factory.mktemp("seen")
    execute(COILS, Options(stop=3000.0), place)
    return load_run(place)


@pytest.fixture(scope="module")
def page(flight, tmp_path_factory):
    return report.write_report(tmp_path_factory.mktemp("page"), flight)


def test_the_view_has_what_was_flown(flight):
    flight_view = view_of_run(flight.manifest, flight.results)
    stride = round(flight_view["step"] / flight.manifest.step)
    for name, source, columns, factor in (
        ("r", "environment.r_eci", 3, 1e-3),
        ("q", "spacecraft.q_bi", 4, 1.0),
        ("b", "environment.b_eci", 3, 1.0),
    ):
        encoding = flight_view["series"][name]
        exact = factor * flight.results.values(source)[::stride][: flight_view["count"]]
        assert (
            np.abs(numbers(encoding, columns) - exact).max() <= 0.51 * encoding["scale"]
        )
    assert flight_view["count"] <= ROWS
    assert len(json.dumps(flight_view)) < 100_000


@pytest.mark.parametrize(
    ("r", "centre"),
    [
        (np.outer(np.linspace(0, 1, 50), [1e5, 0, 0]) + np.array([7e6, 0, 0]), "Earth"),
        (
            np.outer(np.linspace(0, 1, 50), [1e9, 0, 0]) + np.array([1.5e11, 0, 0]),
            "Sun",
        ),
        (np.tile([7e6, 0.0, 0.0], (50, 1)), ""),  # a test bench
        (None, ""),
    ],
)
def test_what_a_craft_orbits(browser, page, r, centre):
    series = {"q": np.tile([0.0, 0.0, 0.0, 1.0], (50, 1))}
    if r is not None:
        series |= {"r": r, "v": np.tile([0.0, 7e3, 0.0], (50, 1))}
    tab = browser.new_page()
    tab.goto(page.as_uri())
    orbit_view = view(np.arange(50.0), series, {})
    drawn_centre = tab.evaluate(
        "(seen) => { desatScene.show(seen); return desatScene.data.centre; }",
        orbit_view,
    )
    assert drawn_centre == centre
    assert tab.locator("#scene canvas").first.is_visible() == bool(centre)
    tab.close()


def test_without_a_sun_nothing_is_said_of_light(browser, page):
    """An environment that has none gives no light at all, which is no shadow."""
    tab = browser.new_page()
    tab.goto(page.as_uri())
    series = {
        "q": np.tile([0.0, 0.0, 0.0, 1.0], (50, 1)),
        "light": np.zeros(50),
        "sun": np.zeros((50, 3)),
    }
    for sun, text in ((0.0, ""), (1.0, "in shadow")):
        series["sun"][:, 0] = sun
        dark_view = view(np.arange(50.0), series, {})
        tab.evaluate("(seen) => desatScene.show(seen)", dark_view)
        line = tab.locator("#scene output").inner_text()
        assert (text in line) if text else ("in " not in line)
    tab.close()


def test_the_view_shows_how_full_wheels_are_and_which_nozzles_fire(browser, page):
    """A nozzle fires where it was open since the row before; unknown capacity: no bars."""
    rows = np.arange(50.0)
    open_time = np.zeros((50, 8))
    open_time[20:, 2] = 1e-2
    series = {
        "q": np.tile([0.0, 0.0, 0.0, 1.0], (50, 1)),
        "h": np.outer(rows, [1.0, -0.5, 0.0]) / 49.0,
        "fired": open_time,
    }
    wheels = {"axes_wheel": np.eye(3), "inertia_wheel": 0.01, "speed_limit": 200.0}
    nozzles = {
        "position_nozzle": np.ones((8, 3)),
        "direction_nozzle": np.tile([0.0, 0.0, 1.0], (8, 1)),
    }
    craft = {"spacecraft": {}, "wheels": wheels, "thrusters": nozzles}
    tab = browser.new_page()
    tab.goto(page.as_uri())
    show = "([seen, t]) => { desatScene.show(seen); desatScene.at(t); return desatScene.data.wheels; }"
    craft_view = view(rows, series, craft)
    lines = []
    for t in (19.0, 20.0, 21.0):
        assert tab.evaluate(show, [craft_view, t]) == 3
        lines.append(tab.locator("#scene output").inner_text())
    assert ["firing: n3" in line for line in lines] == [False, True, False]
    fill = tab.evaluate("() => desatScene.data.series.fill.scale * 32767")
    assert fill == pytest.approx(0.5)
    del wheels["speed_limit"]
    assert tab.evaluate(show, [view(rows, series, craft), 20.0]) == 0
    tab.close()


def test_without_an_attitude_there_is_no_view():
    assert view(np.arange(5.0), {"r": np.ones((5, 3))}, {}) is None
    assert view(np.arange(1.0), {"q": np.ones((1, 4))}, {}) is None


def test_the_view_moves_with_plots_and_slider(browser, flight, page):
    """The pointer over a plot sets its time, the slider that of the plots; it turns as
    the rest of us do."""
    tab = browser.new_page(viewport={"width": 1400, "height": 900})
    errors = []
    tab.on("pageerror", lambda error: errors.append(str(error)))
    tab.goto(page.as_uri())
    tab.evaluate("document.getElementById('scene').scrollIntoView()")
    tab.evaluate(
        "(() => { const s = document.querySelector('#scene input'); s.value = 700;"
        " s.dispatchEvent(new Event('input')); })()"
    )
    flight_view = view_of_run(flight.manifest, flight.results)
    t = 700 * flight_view["step"]
    wait_until(tab, "desat.shown.some(u => u.isTime && u.cursor.left > 0)")
    at = tab.evaluate(
        "desat.shown.filter(u => u.isTime)[0].posToVal("
        "desat.shown.filter(u => u.isTime)[0].cursor.left, 'x')"
    )
    assert at == pytest.approx(t, rel=0.01)
    over = tab.locator("figure.drawn .u-over").first
    over.scroll_into_view_if_needed()
    box = over.bounding_box()
    tab.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + 30)
    wait_until(tab, f"Math.abs(desatScene.row - {flight_view['count'] / 4}) < 15")
    q, v = np.array([0.1, -0.5, 0.3, 0.8]), np.array([1.0, -2.0, 0.5])
    q /= np.linalg.norm(q)
    scene_vector = tab.evaluate(
        "([q, v]) => desatScene.turned(q, v)", [q.tolist(), v.tolist()]
    )
    assert scene_vector == pytest.approx(rotate_back(q[None], v[None])[0], abs=1e-12)
    assert not errors
    tab.close()


@pytest.mark.parametrize("width", [1400, 420])
def test_figures_are_saved(browser, page, tmp_path, width):
    tab = browser.new_page(viewport={"width": width, "height": 900})
    tab.goto(page.as_uri())
    bar = tab.locator("figure.drawn .save").first
    downloads = {}
    for kind in ("PNG", "SVG", "CSV"):
        with tab.expect_download() as download:
            bar.get_by_text(kind, exact=True).click()
        download.value.save_as(tmp_path / download.value.suggested_filename)
        downloads[kind] = tmp_path / download.value.suggested_filename
    assert downloads["PNG"].read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    assert etree.parse(downloads["SVG"]).getroot().tag == f"{SVG}svg"
    head, *rows = downloads["CSV"].read_text().splitlines()
    assert head.startswith("time [s],")
    assert all(len(row.split(",")) == len(head.split(",")) for row in rows)
    assert float(rows[-1].split(",")[0]) == pytest.approx(3000.0, abs=2.0)
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tab.close()


def test_the_picture_of_the_readme_is_readable():
    """Six boxes, and no text below 12 px where it is 720 px wide."""
    picture = (ROOT / "docs" / "loop.svg").read_text()
    root = etree.fromstring(picture)
    assert len(root.findall(f".//{SVG}g[@class='boxes']/{SVG}rect")) == 6
    sizes = [float(x) for x in re.findall(r"font(?:-size)?: (?:\d+ )?(\d+)px", picture)]
    assert len(sizes) == 3
    assert 720.0 / float(root.get("width")) * min(sizes) >= 12.0
