"""The page that flies a loop (`desat export web`): in node against a run, its measures against
their Python, and in a browser against the line that it shows.

It is compiled by the package ziglang; node and a browser are taken where there are such.
"""

from __future__ import annotations

import importlib.util
import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import wait_until
from lxml import html
from typer.testing import CliRunner

from desat import cli
from desat.export.web import module, page
from desat.export.web.script import numpy_source, script
from desat.numbers.derived import QUANTITIES
from desat.numbers.measures import MEASURES
from desat.numbers.text import number
from desat.runs.run import Options, Run, execute
from desat.studies.ranking import options_of_laws

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no node")
needs_zig = pytest.mark.skipif(not importlib.util.find_spec("ziglang"), reason="no ziglang")
STEPS = 200
SLIDERS = ["torquers.m_limit=0.05:0.8", "wheels.torque_limit=0.1 mN.m:3 mN.m",
           "spacecraft.residual_dipole_body=0:0.5", "wheels.h_start_wheel=0 mN.m.s:5 mN.m.s",
           "environment.inclination=0 deg:110 deg", "shared.inertia_wheel=1e-5:3e-5",
           "manager.gain=1e-4:4e-3", "wheels.speed_limit=1000 rpm:9000 rpm",
           "shared.epoch_j2000=8.5e8:8.6e8"]  # fmt: skip
MOVED: dict[str, float] = {
    "torquers.m_limit": 0.12, "wheels.torque_limit": 0.7, "spacecraft.residual_dipole_body": 0.31,
    "wheels.h_start_wheel": 1.3, "environment.inclination": 97.4, "shared.inertia_wheel": 2.2e-5,
}  # fmt: skip


def node(code: str, given: Any) -> Any:
    """What a script prints as JSON; it finds what it is given as JSON in `input`. A number that is
    not finite is a text."""
    whole = f"""const input = JSON.parse(require("fs").readFileSync(0));
{code}
console.log(JSON.stringify(told, (k, v) =>
  typeof v === "number" && !Number.isFinite(v) ? String(v) : v));"""
    assert NODE is not None
    done = subprocess.run([NODE, "-e", whole], input=json.dumps(given), capture_output=True,
                          text=True, check=False)  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads(done.stdout)


# --- measures -----------------------------------------------------------------------------------


def rows(count: int = 500) -> dict[str, Any]:
    """Series that measures are tried with."""
    draw = np.random.default_rng(1)
    q = draw.normal(size=(count, 4))
    near = q / np.linalg.norm(q, axis=1, keepdims=True) + 0.01 * draw.normal(size=(count, 4))
    times = np.arange(count) * 2.0
    return {
        "times": times, "v3": draw.normal(size=(count, 3)),
        "v4": 0.1 * draw.normal(size=(count, 4)).cumsum(axis=0),
        "rises": np.cumsum(draw.random(count) < 0.05)[:, None].astype(float),
        "decay": np.exp(-times / 200.0)[:, None] * np.ones((1, 3)),
        "scalar": np.exp(-times / 200.0)[:, None],
        "mode": (np.arange(count) // 100 % 3)[:, None].astype(float),
        "q": q / np.linalg.norm(q, axis=1, keepdims=True),
        "q_ref": near / np.linalg.norm(near, axis=1, keepdims=True),
    }  # fmt: skip


TRIED: dict[str, list[Any]] = {
    "last": ["rises"], "norm_last": ["v3"], "largest": ["v4"], "norm_largest": ["v3"],
    "rms": ["v4"], "growth_in": ["rises", 100.0], "steps_in": ["rises", 86400.0],
    "growth_between": ["scalar", "rises", 100.0], "growth_each": ["scalar", "rises"],
    "time_between": ["rises"], "share_along": ["v3", "decay"], "norm_mean": ["v3"],
    "norm_level_while": ["v3", "v4", 1.0, 95.0], "mean_size": ["v4"], "mean_size_last": ["v4"],
    "largest_mean": ["v4"], "load_until_below": ["v3", "decay", 0.3],
    "settled_within": ["decay", [0.5, 0.6, 0.7], 10.0, 20.0],
    "along": ["v4", [1.0, -1.0, 1.0, -1.0]], "above": ["v4", [1.0, -1.0, 1.0, -1.0], 0.01],
    "until_below": ["decay", 0.5, "norm_"], "first_reached": ["rises", 10, 1],
    "first_below": ["decay", 0.5], "until_above": ["rises", 5],
    "largest_while": ["v3", "mode", 1, 2],
    "drive_energy": ["v4", 3.0, 10.0], "time_of": ["mode", 2], "share_below": ["v4", 0.3],
    "sign_changes": ["v4"], "decay_rate": ["decay"], "mean_rate": ["rises"],
    "pointing_last": ["q", "q_ref"], "pointing_largest": ["q", "q_ref"],
    "pointing_rms": ["q", "q_ref"], "pointing_mean": ["q", "q_ref"],
    "pointing_until_below": ["q", "q_ref", 2.0], "pointing_level": ["q", "q_ref"],
    "pointing_relative": ["q", "q_ref", 60.0, None],
}  # fmt: skip
DERIVED: dict[str, list[Any]] = {
    "in_body": ["v4", [float(i) for i in range(12)]], "error_vector": ["q", "q_ref"],
    "pointing": ["q", "q_ref"], "nadir_body": ["q", "v3"], "angle_between": ["v3", "decay"],
    "momentum_budget": ["decay", "v3", "q", "v3"],
}  # fmt: skip


@needs_node
def test_measures_and_derived_quantities_are_those_of_their_python():
    """All measures, each on series of its kind; of derived quantities those that are translated."""
    assert TRIED.keys() == MEASURES.keys()
    functions = {**MEASURES, **{name: q.function for name, q in QUANTITIES.items()}}
    code, refused = script(functions.values())
    assert QUANTITIES.keys() - DERIVED.keys() == refused.keys()
    known = rows()
    tried = {**TRIED, **DERIVED}
    args = {name: [("norm" if a == "norm_" else known.get(a, a)) if isinstance(a, str) else a
                   for a in given] for name, given in tried.items()}  # fmt: skip
    told = node(f"""{numpy_source()}{code}
const asked = (x) => x instanceof Array && x[0] instanceof Array
  ? $.array(x.map((r) => $.array(r))) : x;
const told = {{}};
for (const [name, args] of Object.entries(input.args)) {{
  const times = measures[name].order[0] === "times" ? [$.array(input.times)] : [];
  told[name] = Array.from($.asarray(measures[name](...times, ...args.map(asked))).data);
}}""", {"times": known["times"].tolist(), "args": {
        name: [a.tolist() if isinstance(a, np.ndarray) else a for a in of]
        for name, of in args.items()}})  # fmt: skip
    for name, of in args.items():
        times = [known["times"]] if name in MEASURES or name == "momentum_budget" else []
        want = np.ravel(functions[name](*times, *of))
        got = np.array([float(x) for x in told[name]])
        assert np.allclose(got, want, rtol=1e-12, atol=1e-12, equal_nan=True), name


# --- the loop -----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    folder = tmp_path_factory.mktemp("web") / "my12u"
    done = CliRunner().invoke(cli.app_for([]), [
        "new", "craft", str(folder), "--size", "12U", "--altitude", "400km", "--inclination",
        "51.6deg", "--rods", "0.2",
    ])  # fmt: skip
    assert done.exit_code == 0, done.output
    return folder


OPTIONS = Options(stop=float(STEPS), substeps=2)


@pytest.fixture(scope="module")
def made(craft):
    """The page of a craft with two laws, in which eight sliders move; 200 s."""
    laws = options_of_laws(str(craft), OPTIONS, ["predictive"])
    return page.export(str(craft), laws, SLIDERS, craft.parent / "page.html"), laws


def told_of(path: Path) -> tuple[dict[str, Any], str]:
    """What a page is told, and the code of its worker."""
    tree = html.fromstring(path.read_text())
    (worker,) = (e.text for e in tree.iter("script") if e.get("id") == "worker")
    return json.loads(tree.find(".//script[@id='told']").text), worker


FAILS = 1e9
"""A residual dipole (A m2) that begins to turn the craft faster than a step can be made of."""


def flown(path: Path, law: int, moved: dict[str, float]) -> dict[str, Any]:
    """The series of a flight in node, its numbers, and what it said of two faults before: one at
    the start, one under way."""
    told, worker = told_of(path)
    return node("""globalThis.postMessage = () => {};
const [told0, worker, law, moved, fails] = input;
(0, eval)(worker.replace('"use strict";', "") + ";globalThis.Flight = Flight;globalThis.$ = $;");
const flight = new Flight(told0, new WebAssembly.Module(Buffer.from(told0.wasm, "base64")));
const first = flight.begin(law, { ...moved, "wheels.speed_limit": -1 });
const begun = flight.begin(law, { ...moved, "spacecraft.residual_dipole_body": fails });
while (flight.some());
const way = [begun, flight.fault];
const said = flight.begin(law, moved);
while (flight.some());
const told = { first, way, said, fault: flight.fault, table: flight.table,
  numbers: flight.numbers(), plots: flight.law.plots.map((p) => flight.plot(p)),
  fullest: flight.law.managed && flight.fullest(),
  series: Object.fromEntries(Object.keys(flight.law.series).map((name) =>
    [name, Array.from(flight.series(name).data)])) };""",
        [told, worker, law, moved, FAILS])  # fmt: skip


WITHIN = (1e-12, 1e-10)
"""Of the scale of each series, a law: musl's sines are not glibc's, and the predictive law solves
for its dipoles."""


def alike(found: dict[str, Any], run: Run, within: float) -> list[str]:
    """The series of a flight that are not those of a run."""
    wrong = []
    for name, values in found["series"].items():
        want = run.results.values(name).astype(float).ravel()
        got = np.array([float(x) for x in values])
        scale = max(float(np.abs(want).max()), 1e-300)
        if len(got) != len(want) or float(np.abs(got - want).max()) > within * scale:
            wrong.append(f"{name}: {np.abs(got - want).max() / scale:.1e}")
    return wrong


@needs_node
@needs_zig
@pytest.mark.parametrize("law", [0, 1])
@pytest.mark.parametrize("moved", [{}, MOVED], ids=["as it is", "moved"])
def test_a_flight_is_that_of_a_run_with_what_follows_from_sliders(made, craft, law, moved):
    """Also after two that failed: it flies on after the reset."""
    told, laws = made
    options = [*laws.values()][law]
    facts, _ = told_of(told.path)
    sliders = {s["name"]: s for s in facts["sliders"]}
    before = facts["laws"][law]["values"]
    given = dict(moved)
    sets = [text_of(sliders[name], value, before) for name, value in given.items()]
    run = execute(str(craft), Options(**{**vars(options), "sets": [*options.sets, *sets]}), None)
    assert run.ok
    found = flown(told.path, law, given)
    assert "speed_limit = " in found["first"]
    begun, said = found["way"]
    assert begun == ""
    assert "take a shorter step" in said
    assert found["said"] == found["fault"] == ""
    assert len(found["series"]) > 8
    assert alike(found, run, WITHIN[law]) == []
    for name, parameters in run.manifest.parameters.items():
        for key, parameter in parameters.items():
            if (value := found["table"].get(f"{name}.{key}")) is not None:
                assert value == parameter.value, f"{name}.{key}"
    numbers = {n: run.manifest.numbers[n].value for n in found["numbers"]}
    assert len(numbers) > 12
    assert {n: number(x) for n, x in found["numbers"].items()} == {
        n: number(x) for n, x in numbers.items()}  # fmt: skip


def text_of(slider: dict[str, Any], value: float, values: dict[str, Any]) -> str:
    """`NAME=VALUE` of a slider as the page is told of it."""
    fields = {k: v for k, v in slider.items() if k != "shown"}
    whole = page.Slider(**fields, start=0.0)
    return whole.value_text(value, values[next(t for t in whole.targets if t in values)])


@needs_zig
def test_the_same_page_comes_out_again_and_needs_no_server(made, craft):
    told, laws = made
    text = told.path.read_text()
    tree = html.fromstring(text)
    assert not tree.xpath("//*[@src] | //link | //img")
    assert not re.search(r"url\(|@import|fetch\(|https?://(?!github.com/leeoniya)", text)
    assert told.digest in text
    again = page.export(str(craft), laws, SLIDERS, craft.parent / "again.html")
    assert again.path.read_text() == text
    for licence in ("uPlot", "musl", "wasi-libc", "compiler-rt", "Permission is hereby granted"):
        assert licence in text


# --- what is refused ----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--slider", "torquers.m_limt=0:1"], "has no parameter torquers.m_limt; did you mean "
         "torquers.m_limit"),
        (["--slider", "torquers.m_limit"], "the form is NAME=FROM:TO"),
        (["--slider", "torquers.m_limit=0.4:0.1"], "from a lower value to a higher one"),
        (["--slider", "torquers.m_limit=-1:1"], "allowed is 0 to inf"),
        (["--slider", "torquers.m_limit=0.1 kg:1"], "it has A.m2"),
        (["--slider", "manager.m_limit=0.1:1"], "the scenario has it follow torquers.m_limit"),
        (["--slider", "torquers.drive=0:1"], "a choice of "),
        (["--slider", "manager.sample_time=1:10"], "what the loop is written out with"),
        (["--source", "environment=environment_tle"], "environment_tle has no C, it runs as"),
        (["--step", "10"], "sample_time"),
        (["--law", "b_dot"], "--law b dot: it brakes a tumbling craft"),
        (["--law", "magnetic"], "it needs tables made for one craft"),
        (["--law", "nonsense"], "nonsense: no law and no manager"),
        (["--stop", "900d"], "too many for a page's memory"),
    ],
)  # fmt: skip
@needs_zig
def test_what_no_page_can_have_is_refused(desat, craft, arguments, said, tmp_path):
    stop = [] if "--stop" in arguments else ["--stop", "200"]
    done = desat("export", "web", str(craft), "--out", str(tmp_path / "x.html"), *stop, *arguments)
    assert done.returncode == 2
    assert said in done.stderr, done.stderr
    assert not (tmp_path / "x.html").exists()


def test_without_ziglang_it_says_what_to_install(desat, craft, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "zig", _no_zig)
    with pytest.raises(page.DesatError, match="pip install ziglang"):
        page.export(str(craft), {"own": Options()}, (), tmp_path / "x.html")


def _no_zig() -> tuple[str, ...]:
    raise module.NoCompilerError("")


# --- in a browser -------------------------------------------------------------------------------


@needs_zig
@pytest.mark.parametrize("width", [1400, 420])
def test_a_slider_moved_in_a_browser_gives_what_the_shown_line_prints(
    browser, made, craft, desat, width, tmp_path
):
    """The numbers of the page are those of `desat run`; the address brings the page back."""
    tab = browser.new_page(viewport={"width": width, "height": 900})
    tab.set_default_timeout(20_000)
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))

    def waited() -> None:
        wait_until(
            tab,
            """document.getElementById("state").textContent.startsWith("flown")
            && !document.getElementById("numbers").classList.contains("pale")""",
        )

    tab.goto(made[0].path.as_uri())
    waited()
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tab.locator("#compare").click()
    tab.select_option("#law", label="predictive")
    waited()
    field = tab.locator("[id='value-torquers.m_limit']")
    field.fill("0.123")
    field.press("Enter")
    tab.locator("[id='value-wheels.h_start_wheel']").fill("1.7")
    tab.locator("[id='value-wheels.h_start_wheel']").press("Enter")
    wait_until(tab, "desat.shown.moved['wheels.h_start_wheel'] === 1.7 && desat.shown.numbers")
    waited()
    line = shlex.split(tab.locator("#command").inner_text())
    assert line[:2] == ["desat", "run"]
    done = desat(*line[1:], "--out", str(tmp_path / "run"), "--json")
    assert done.returncode in (0, 1), done.stderr  # 1: what is required is not met in 200 s
    printed = json.loads(done.stdout)["numbers"]
    shown = {row["name"]: row["value"] for row in tab.evaluate(
        """[...document.querySelectorAll("#numbers tr[data-number]")].map(r =>
           ({name: r.dataset.number, value: r.children[1].textContent}))""")}  # fmt: skip
    assert len(shown) > 12
    assert shown == {name: number(printed[name]["value"]) for name in shown}
    labels = tab.evaluate("desat.charts.map(u => [u.axes[0].label, u.axes[1].label])")
    assert all(x.startswith("time [") and y for x, y in labels)
    assert any("kept" in s for s in tab.evaluate("desat.charts[0].series.map(s => s.label)"))
    address = tab.evaluate("location.href")
    assert "law=predictive" in address
    tab.goto("about:blank")
    tab.goto(address)
    waited()
    assert shlex.split(tab.locator("#command").inner_text()) == line
    tab.goto(made[0].path.as_uri() + "#wheels.speed_limit=-3")
    wait_until(tab, "document.getElementById('fault').textContent")
    assert "speed_limit = " in tab.locator("#fault").inner_text()
    tab.locator("#reset").click()
    waited()
    assert tab.locator("#fault").inner_text() == ""
    assert errors == []
    tab.close()
