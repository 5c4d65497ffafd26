"""The page that flies a loop (`desat export web`): in node against a run, its measures
against their Python, and in a browser against the line that it shows.

It is compiled by the package ziglang; node and a browser are taken where there are
such.
"""

from __future__ import annotations

import csv
import importlib.util
import json
import re
import shlex
import shutil
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from lxml import html
from typer.testing import CliRunner

from desat import cli
from desat.numbers.derived import QUANTITIES
from desat.numbers.measures import MEASURES
from desat.numbers.text import number, spell_unit
from desat.numbers.verdicts import describe_verdicts
from desat.report.table import SCALES, SI_UNITS
from desat.runs.prepare import prepare, read
from desat.runs.run import Options, Run, execute
from desat.studies import ranking
from desat.studies.ranking import options_of_laws
from desat.system.options import sets_of, with_assignment
from desat.system.parameters import parse_assignment
from desat.web import module, page
from desat.web.script import numpy_source, script
from desat.web.sliders import asked_of, usual, usual_of
from tests.conftest import slow_after, slow_value, wait_until

NODE = shutil.which("node")
needs_node = pytest.mark.skipif(NODE is None, reason="no node")
needs_zig = pytest.mark.skipif(
    not importlib.util.find_spec("ziglang"), reason="no ziglang"
)
STEPS = 200
SLIDERS = [
    "torquers.m_limit=0.05:0.8",
    "wheels.torque_limit=0.1 mN.m:3 mN.m",
    "spacecraft.residual_dipole_body=0:0.5",
    "wheels.h_start_wheel=0 mN.m.s:5 mN.m.s",
    "environment.inclination=0 deg:110 deg",
    "shared.inertia_wheel=1e-5:3e-5",
    "manager.gain=1e-4:4e-3",
    "wheels.speed_limit=1000 rpm:9000 rpm",
    "shared.epoch_j2000=8.5e8:8.6e8",
]
MOVED: dict[str, float] = {
    "torquers.m_limit": 0.12,
    "wheels.torque_limit": 0.7,
    "spacecraft.residual_dipole_body": 0.31,
    "wheels.h_start_wheel": 1.3,
    "environment.inclination": 97.4,
    "shared.inertia_wheel": 2.2e-5,
}


def node(code: str, values: Any) -> Any:
    """What a script prints as JSON; it finds what it is given as JSON in `input`. A
    number that is not finite is a text."""
    full = f"""const input = JSON.parse(require("fs").readFileSync(0));
{code}
console.log(JSON.stringify(told, (k, v) =>
  typeof v === "number" && !Number.isFinite(v) ? String(v) : v));"""
    assert NODE is not None
    process = subprocess.run(
        [NODE, "-e", full],
        input=json.dumps(values),
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr[-2000:]
    return json.loads(process.stdout)


# --- measures -------------------------------------------------------------------------


def rows(count: int = 500) -> dict[str, Any]:
    """Series that measures are tried with."""
    draw = np.random.default_rng(1)
    q = draw.normal(size=(count, 4))
    near = q / np.linalg.norm(q, axis=1, keepdims=True) + 0.01 * draw.normal(
        size=(count, 4)
    )
    times = np.arange(count) * 2.0
    return {
        "times": times,
        "v3": draw.normal(size=(count, 3)),
        "v4": 0.1 * draw.normal(size=(count, 4)).cumsum(axis=0),
        "rises": np.cumsum(draw.random(count) < 0.05)[:, None].astype(float),
        "decay": np.exp(-times / 200.0)[:, None] * np.ones((1, 3)),
        "scalar": np.exp(-times / 200.0)[:, None],
        "mode": (np.arange(count) // 100 % 3)[:, None].astype(float),
        "q": q / np.linalg.norm(q, axis=1, keepdims=True),
        "q_ref": near / np.linalg.norm(near, axis=1, keepdims=True),
    }


TRIED: dict[str, list[Any]] = {
    "last": ["rises"],
    "norm_last": ["v3"],
    "largest": ["v4"],
    "norm_largest": ["v3"],
    "rms": ["v4"],
    "growth_in": ["rises", 100.0],
    "steps_in": ["rises", 86400.0],
    "growth_between": ["scalar", "rises", 100.0],
    "growth_each": ["scalar", "rises"],
    "time_between": ["rises"],
    "share_along": ["v3", "decay"],
    "norm_mean": ["v3"],
    "norm_level_while": ["v3", "v4", 1.0, 95.0],
    "mean_size": ["v4"],
    "mean_size_last": ["v4"],
    "largest_mean": ["v4"],
    "load_until_below": ["v3", "decay", 0.3],
    "settled_within": ["decay", [0.5, 0.6, 0.7], 10.0, 20.0],
    "along": ["v4", [1.0, -1.0, 1.0, -1.0]],
    "above": ["v4", [1.0, -1.0, 1.0, -1.0], 0.01],
    "until_below": ["decay", 0.5, "norm_"],
    "first_reached": ["rises", 10, 1],
    "first_below": ["decay", 0.5],
    "until_above": ["rises", 5],
    "largest_while": ["v3", "mode", 1, 2],
    "drive_energy": ["v4", 3.0, 10.0],
    "time_of": ["mode", 2],
    "share_below": ["v4", 0.3],
    "sign_changes": ["v4"],
    "decay_rate": ["decay"],
    "mean_rate": ["rises"],
    "pointing_last": ["q", "q_ref"],
    "pointing_largest": ["q", "q_ref"],
    "pointing_rms": ["q", "q_ref"],
    "pointing_mean": ["q", "q_ref"],
    "pointing_until_below": ["q", "q_ref", 2.0],
    "pointing_level": ["q", "q_ref"],
    "pointing_relative": ["q", "q_ref", 60.0, None],
}
DERIVED: dict[str, list[Any]] = {
    "in_body": ["v4", [float(i) for i in range(12)]],
    "error_vector": ["q", "q_ref"],
    "pointing": ["q", "q_ref"],
    "nadir_body": ["q", "v3"],
    "angle_between": ["v3", "decay"],
    "momentum_budget": ["decay", "v3", "q", "v3"],
}


@pytest.mark.parametrize("count", [1, 2])
@pytest.mark.parametrize("name", TRIED)
def test_a_measure_of_few_rows_is_a_number_or_not_reached(name, count):
    """A run may end after its first step."""
    short_rows = {k: v[:count] for k, v in rows().items()}
    inputs = [
        ("norm" if a == "norm_" else short_rows.get(a, a)) if isinstance(a, str) else a
        for a in TRIED[name]
    ]
    assert isinstance(MEASURES[name](short_rows["times"], *inputs), float | int)


@needs_node
def test_measures_and_derived_quantities_are_those_of_their_python():
    """All measures, each on series of its kind; of derived quantities those that are
    translated."""
    assert TRIED.keys() == MEASURES.keys()
    functions = {**MEASURES, **{name: q.function for name, q in QUANTITIES.items()}}
    code, refusals = script(functions.values())
    assert QUANTITIES.keys() - DERIVED.keys() == refusals.keys()
    sample_rows = rows()
    all_inputs = {**TRIED, **DERIVED}
    args = {
        name: [
            ("norm" if a == "norm_" else sample_rows.get(a, a))
            if isinstance(a, str)
            else a
            for a in inputs
        ]
        for name, inputs in all_inputs.items()
    }
    answer = node(
        f"""{numpy_source()}{code}
const asked = (x) => x instanceof Array && x[0] instanceof Array
  ? $.array(x.map((r) => $.array(r))) : x;
const told = {{}};
for (const [name, args] of Object.entries(input.args)) {{
  const times = measures[name].order[0] === "times" ? [$.array(input.times)] : [];
  told[name] = Array.from($.asarray(measures[name](...times, ...args.map(asked))).data);
}}""",
        {
            "times": sample_rows["times"].tolist(),
            "args": {
                name: [a.tolist() if isinstance(a, np.ndarray) else a for a in of]
                for name, of in args.items()
            },
        },
    )
    for name, of in args.items():
        times = (
            [sample_rows["times"]]
            if name in MEASURES or name == "momentum_budget"
            else []
        )
        want = np.ravel(functions[name](*times, *of))
        script_values = np.array([float(x) for x in answer[name]])
        assert np.allclose(
            script_values, want, rtol=1e-12, atol=1e-12, equal_nan=True
        ), name


# --- the loop -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    folder = tmp_path_factory.mktemp("web") / "my12u"
    invocation = CliRunner().invoke(
        cli.app_for([]),
        [
            "new",
            "craft",
            str(folder),
            "--size",
            "12U",
            "--residual-dipole",
            "0.09",
            "--altitude",
            "400km",
            "--inclination",
            "51.6deg",
            "--rods",
            "0.2",
        ],
    )
    assert invocation.exit_code == 0, invocation.output
    return folder


OPTIONS = Options(stop=float(STEPS), substeps=2)


@pytest.fixture(scope="module")
def exported_page(craft):
    """The page of a craft with two laws, in which eight sliders move; 200 s."""
    laws = options_of_laws(str(craft), OPTIONS, ["predictive"])
    return page.export(str(craft), laws, SLIDERS, craft.parent / "page.html"), laws


def told_of(path: Path) -> tuple[dict[str, Any], str]:
    """What a page is told, and the code of its worker."""
    tree = html.fromstring(path.read_text())
    (worker,) = (e.text for e in tree.iter("script") if e.get("id") == "worker")
    return json.loads(tree.find(".//script[@id='told']").text), worker


FAILS = 1e9
"""A residual dipole (A m2) that begins to turn the craft faster than a step can be made
of."""


def fly(path: Path, law: int, slider_values: dict[str, float]) -> dict[str, Any]:
    """The series of a flight in node, its numbers, and what it said of two faults
    before: one at the start, one under way."""
    answer, worker = told_of(path)
    return node(
        """globalThis.postMessage = () => {};
const [told0, worker, law, moved, fails] = input;
(0, eval)(worker.replace('"use strict";', "") + ";globalThis.Flight = Flight;globalThis.$ = $;");
const flight = new Flight(told0, new WebAssembly.Module(Buffer.from(told0.wasm, "base64")));
const first = flight.begin(law, { ...moved, "wheels.speed_limit": -1 });
const begun = flight.begin(law, { ...moved, "spacecraft.residual_dipole_body": fails });
while (flight.some());
const way = [begun, flight.fault];
const said = flight.begin(law, moved);
while (flight.some());
const told = { first, way, ended: flight.ended, said, fault: flight.fault, table: flight.table,
  numbers: flight.numbers(), plots: flight.law.plots.map((p) => flight.plot(p)),
  fullest: flight.law.managed && flight.fullest(),
  series: Object.fromEntries(Object.keys(flight.law.series).map((name) =>
    [name, Array.from(flight.series(name).data)])) };""",
        [answer, worker, law, slider_values, FAILS],
    )


ROUNDED = 1e-15  # a number below this is of roundings alone
WITHIN = (1e-12, 1e-10)
"""Of the scale of each series, a law: musl's sines are not glibc's, and the predictive
law solves for its dipoles."""


def without_rounding(value: float | None) -> float | None:
    return 0.0 if value is not None and abs(value) < ROUNDED else value


def differing(
    page_texts: dict[str, tuple[str, str]], command_numbers: dict[str, Any]
) -> dict[str, tuple[str, str]]:
    """What a page shows where a command has another number, and that.

    A page shows a quantity in one unit, as a table of `desat run` does.
    """
    differences = {}
    for name, (text, page_unit) in page_texts.items():
        value, unit = (command_numbers[name][k] for k in ("value", "unit"))
        if value is not None and spell_unit(unit) != page_unit:
            units = {spell_unit(u): f for u, f in SCALES[SI_UNITS[unit]].items()}
            value *= units[spell_unit(unit)] / units[page_unit]
        if value is not None and 0.0 < abs(value) < ROUNDED:
            same = abs(float(text)) < ROUNDED
        else:
            same = text == number(value)
        if not same:
            differences[name] = text, number(value)
    return differences


def alike(page_flight: dict[str, Any], run: Run, within: float) -> list[str]:
    """The series of a flight that are not those of a run."""
    wrong = []
    for name, values in page_flight["series"].items():
        want = run.results.values(name).astype(float).ravel()
        page_values = np.array([float(x) for x in values])
        scale = max(float(np.abs(want).max()), 1e-300)
        if (
            len(page_values) != len(want)
            or float(np.abs(page_values - want).max()) > within * scale
        ):
            wrong.append(f"{name}: {np.abs(page_values - want).max() / scale:.1e}")
    return wrong


@needs_node
@needs_zig
@pytest.mark.parametrize("law", slow_after(1, [0, 1], "study"))
@pytest.mark.parametrize(
    "slider_values", [slow_value({}), MOVED], ids=["as it is", "moved"]
)
def test_a_flight_is_that_of_a_run_with_what_follows_from_sliders(
    exported_page, craft, law, slider_values
):
    """Also after two that failed: it flies on after the reset."""
    answer, laws = exported_page
    options = [*laws.values()][law]
    facts, _ = told_of(answer.path)
    sliders = {s["name"]: s for s in facts["laws"][law]["sliders"]}
    before = facts["laws"][law]["values"]
    inputs = dict(slider_values)
    sets = [text_of(sliders[name], value, before) for name, value in inputs.items()]
    run = execute(
        str(craft), Options(**{**vars(options), "sets": [*options.sets, *sets]}), None
    )
    assert run.ok
    page_flight = fly(answer.path, law, inputs)
    # of the wheels, or of the capacity that the law takes from it
    assert "_limit = " in page_flight["first"]
    way_begin, message = page_flight["way"]
    assert way_begin == ""
    assert "take a shorter step" in message
    assert page_flight["said"] == page_flight["fault"] == ""
    assert len(page_flight["series"]) > 8
    assert alike(page_flight, run, WITHIN[law]) == []
    for name, parameters in run.manifest.parameters.items():
        for key, parameter in parameters.items():
            if (value := page_flight["table"].get(f"{name}.{key}")) is not None:
                assert value == parameter.value, f"{name}.{key}"
    numbers = {n: run.manifest.numbers[n].value for n in page_flight["numbers"]}
    assert len(numbers) > 12
    assert {
        n: number(without_rounding(x)) for n, x in page_flight["numbers"].items()
    } == {n: number(without_rounding(x)) for n, x in numbers.items()}


@needs_node
@needs_zig
@pytest.mark.parametrize(
    ("start", "wheels"),
    slow_after(1, [(38.0, 6), (0.0, 4), (38.0, 4)], "study"),
    ids=["six wheels", "fills", "dumps"],
)
def test_a_craft_that_dumps_by_thrusters_has_the_standard_numbers_on_its_page(
    desat, tmp_path, start, wheels
):
    facts = GEO.replace("4 pyramid", f"{wheels} pyramid")
    desat("new", "craft", "c", *shlex.split(facts), check=True, cwd=tmp_path)
    target = str(tmp_path / "c")
    sets = [f"wheels.h_start_wheel={','.join([str(start)] * wheels)}"]
    options = Options(stop=3000.0, sets=sets)
    answer = page.export(target, {"threshold": options}, [], tmp_path / "page.html")
    run = execute(target, options, None)
    page_flight = fly(answer.path, 0, {})
    standard = {"sum_rms", "momentum_margin", "limit_time", "left_rms", "unmanaged_rms"}
    assert standard <= page_flight["numbers"].keys() & run.manifest.numbers.keys()
    assert "coil_duty" not in run.manifest.numbers
    assert {n: number(x) for n, x in page_flight["numbers"].items()} == {
        n: number(run.manifest.numbers[n].value) for n in page_flight["numbers"]
    }
    numbers = {n: x.value for n, x in run.manifest.numbers.items()}
    if not start:  # no dump: what is left is what there would be without
        assert numbers["left_rms"] == pytest.approx(numbers["unmanaged_rms"], rel=1e-6)
    else:
        assert numbers["left_rms"] < 0.8 * numbers["unmanaged_rms"]


LEVER = "spacecraft.offset_plates_body"


@needs_zig
@pytest.mark.parametrize(
    ("wheels", "stop", "moves"),
    slow_after(
        1,
        [
            (
                "4 pyramid 50Nms",
                12.0,
                {LEVER: 0.4, "wheels.h_start_wheel": 6.0, "manager.begin": 12.0},
            ),
            ("4 pyramid 50Nms", 60.0, {LEVER: 0.1, "manager.begin": 25.0}),
            ("4 pyramid 50Nms", 60.0, {"manager.begin": 18.0}),
            ("4 pyramid 50Nms", 60.0, {"manager.end": 12.0, "thrusters.thrust": 5.0}),
            ("6 pyramid 25Nms", 40.0, {"manager.begin": 9.0}),
        ],
        "study",
    ),
)
def test_the_model_of_a_page_says_at_once_what_the_loop_then_shows(
    desat, tmp_path, wheels, stop, moves
):
    """Dumps of other thresholds, arms and starts, from the flight before.

    Of another craft it is silent.
    """
    line = shlex.split(GEO.replace("4 pyramid 50Nms", wheels))
    desat("new", "craft", "c", *line, check=True, cwd=tmp_path)
    laws = {"threshold": Options(stop=stop * 86400.0)}
    answer = page.export(str(tmp_path / "c"), laws, [], tmp_path / "page.html")
    page_data, worker = told_of(answer.path)
    result = node(
        """globalThis.postMessage = () => {};
const [told0, worker, moved] = input;
(0, eval)(worker.replace('"use strict";', "") + ";Object.assign(globalThis, { Flight, modelled });");
const flight = new Flight(told0, new WebAssembly.Module(Buffer.from(told0.wasm, "base64")));
flight.begin(0, {});
while (flight.some());
const free = flight.free(), { law } = flight, began = performance.now();
const answer = modelled(told0, law, moved, free), seconds = (performance.now() - began) / 1e3;
const other = modelled(told0, law, moved, { ...free, table: { ...free.table, "spacecraft.inertia": 0 } });
flight.begin(0, moved);
while (flight.some());
const told = { seconds, other, times: answer.times, numbers: flight.numbers(),
  largest: [answer.line, flight.fullest().lines[0]].map((y) => y.reduce((a, b) => Math.max(a, b), 0)) };""",
        [page_data, worker, moves],
    )
    assert result["other"] is None
    assert result["seconds"] < 1.0
    times, numbers = result["times"], result["numbers"]
    assert len(times) == numbers["dumps"] > 1
    assert times[0] / 3600.0 == pytest.approx(numbers["first_dump"], rel=1e-3)
    between = (times[-1] - times[0]) / (len(times) - 1) / 3600.0
    # where a peak of the day passes the threshold by a hair, a dump comes half a day apart
    assert between == pytest.approx(numbers["between_dumps"], rel=0.01)
    assert result["largest"][0] == pytest.approx(result["largest"][1], rel=0.02)


# a condition that ends a flight, and the slider that then moves
CONDITIONS = {
    "below": ("detumbling", "", {"spacecraft.omega_start_body": 6.0}),
    "above": (
        "nominal",
        'signal = "wheels.h_wheel"\nabove = 0.0004\nheld = 20.0',
        {"spacecraft.residual_dipole_body": 0.3},
    ),
    "of a parameter": (
        "nominal",
        'signal = "torquers.m_body"\nabove = "0.05 * torquers.m_limit"\nheld = 9.0',
        {"torquers.m_limit": 0.1},
    ),
    "after a step": ("nominal", 'signal = "controller.tau_ctrl_body"\nabove = 0.0', {}),
    "reaches": ("nominal", 'signal = "manager.mode"\nreaches = 1\nheld = 30.0', {}),
    "never": ("nominal", 'signal = "wheels.h_wheel"\nabove = 0.5', {}),
}


@needs_node
@needs_zig
@pytest.mark.parametrize("kind", slow_after(1, CONDITIONS, "study"))
def test_a_flight_ends_where_the_run_ends(craft, tmp_path, kind):
    """By `stop_when`, as the scenario has it and with a slider moved."""
    name, condition, slider_values = CONDITIONS[kind]
    place = craft / f"ends-{kind.replace(' ', '-')}.toml"
    text = (craft / f"{name}.toml").read_text()
    if condition:
        text += f"\n[stop_when]\n{condition}\n"
    place.write_text(text)
    options = Options(stop=9000.0 if kind == "below" else 1500.0, substeps=1)
    answer = page.export(str(place), {"own": options}, [], tmp_path / "page.html")
    facts, _ = told_of(answer.path)
    law = facts["laws"][0]
    sliders = {s["name"]: s for s in law["sliders"]}
    for inputs in [{}, slider_values] if slider_values else [{}]:
        sets = [text_of(sliders[k], v, law["values"]) for k, v in inputs.items()]
        run = execute(str(place), Options(**{**vars(options), "sets": sets}), None)
        page_flight = fly(answer.path, 0, inputs)
        assert page_flight["fault"] == ""
        assert alike(page_flight, run, 1e-9) == []
        stop = run.manifest.stopped_when
        assert (page_flight["ended"] and page_flight["ended"]["time"]) == (
            stop and stop.time
        )
        assert (stop is None) == (kind == "never")


def test_a_craft_that_tumbles_has_sliders_of_its_start_and_of_its_brake(craft):
    system, _ = prepare(read(str(craft / "detumbling.toml")), Options()).or_raise()
    sliders = {s.name: s for s in usual(system)}
    names = ["spacecraft.omega_start_body", "torquers.m_limit", "magnetometer.noise"]
    assert [n for n in sliders if not n.startswith("environment")] == [
        *names,
        "manager.gain",
    ]
    assert sliders[names[0]].unit == "deg/s"
    assert sliders[names[0]].start == pytest.approx(5.0 * 3**0.5)


def text_of(slider: dict[str, Any], value: float, values: dict[str, Any]) -> str:
    """`NAME=VALUE` of a slider as the page is told of it."""
    fields = {k: v for k, v in slider.items() if k != "shown"}
    full = page.Slider(**fields)
    return full.value_text(value, values[next(t for t in full.targets if t in values)])


@pytest.mark.slow
@needs_zig
def test_the_same_page_comes_out_again_and_needs_no_server(exported_page, craft):
    answer, laws = exported_page
    text = answer.path.read_text()
    tree = html.fromstring(text)
    assert not tree.xpath("//*[@src] | //link | //img")
    assert not re.search(
        r"url\(|@import|fetch\(|https?://(?!github.com/leeoniya|www.w3.org/2000/svg)",
        text,
    )
    assert answer.digest in text
    again = page.export(str(craft), laws, SLIDERS, craft.parent / "again.html")
    assert again.path.read_text() == text
    for licence in (
        "uPlot",
        "musl",
        "wasi-libc",
        "compiler-rt",
        "Permission is hereby granted",
    ):
        assert licence in text


# --- what is refused ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--slider", "torquers.m_limt=0:1"],
            "has no parameter torquers.m_limt; did you mean torquers.m_limit",
        ),
        (["--slider", "torquers.m_limit"], "the form is NAME=FROM:TO"),
        (
            ["--slider", "torquers.m_limit=0.4:0.1"],
            "from a lower value to a higher one",
        ),
        (["--slider", "torquers.m_limit=-1:1"], "allowed is 0 to inf"),
        (
            ["--slider", "torquers.m_limit=0.1 kg:1"],
            "kg is no unit of torquers.m_limit, which is in A.m2",
        ),
        (
            ["--slider", "manager.m_limit=0.1:1"],
            "the scenario has it follow torquers.m_limit",
        ),
        (["--slider", "torquers.drive=0:1"], "a choice of "),
        (["--slider", "manager.sample_time=1:10"], "what the loop is written out with"),
        (
            [
                "--source",
                "environment=environment_tle",
                "--set",
                "environment.epoch_tle_j2000=852033600",
            ],
            "environment_tle is a block of Python without",
        ),
        (["--step", "10"], "sample_time"),
        (["--law", "b_dot"], "--law b dot: it brakes a tumbling craft"),
        (["--law", "magnetic"], "it needs tables made for one craft"),
        (["--law", "nonsense"], "nonsense: no law and no manager"),
        (["--stop", "900d"], "too many for a page's memory"),
    ],
)
@needs_zig
def test_what_no_page_can_have_is_refused(desat, craft, arguments, message, tmp_path):
    stop = [] if "--stop" in arguments else ["--stop", "200"]
    command = desat(
        "export",
        "web",
        str(craft),
        "--out",
        str(tmp_path / "x.html"),
        *stop,
        *arguments,
    )
    assert command.returncode == 2
    assert message in command.stderr, command.stderr
    assert not (tmp_path / "x.html").exists()


def test_without_ziglang_it_says_what_to_install(desat, craft, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "zig", _no_zig)
    with pytest.raises(page.DesatError, match="pip install 'desat\\[web\\]'"):
        page.export(str(craft), {"own": Options()}, (), tmp_path / "x.html")


def _no_zig() -> tuple[str, ...]:
    raise module.NoCompilerError("")


# --- in a browser ---------------------------------------------------------------------


@needs_zig
@pytest.mark.parametrize("width", [1400, 420])
def test_a_slider_moved_in_a_browser_gives_what_the_shown_line_prints(
    browser, exported_page, craft, desat, width, tmp_path
):
    """The numbers of the page are those of `desat run`; the address brings the page
    back."""
    tab = browser.new_page(viewport={"width": width, "height": 900})
    tab.set_default_timeout(20_000)
    errors: list[str] = []
    tab.on("pageerror", lambda error: errors.append(str(error)))

    def wait_for_flight() -> None:
        wait_until(
            tab,
            """document.getElementById("state").textContent.startsWith("flown")
            && !document.getElementById("numbers").classList.contains("pale")""",
        )

    tab.goto(exported_page[0].path.as_uri())
    wait_for_flight()
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    tab.locator("#compare").click()
    tab.select_option("#law", label="predictive")
    wait_for_flight()
    field = tab.locator("[id='value-torquers.m_limit']")
    field.fill("0.123")
    field.press("Enter")
    tab.locator("[id='value-wheels.h_start_wheel']").fill("1.7")
    tab.locator("[id='value-wheels.h_start_wheel']").press("Enter")
    wait_until(
        tab, "desat.shown.moved['wheels.h_start_wheel'] === 1.7 && desat.shown.numbers"
    )
    wait_for_flight()
    line = shlex.split(tab.locator("#command").inner_text())
    assert line[:2] == ["desat", "run"]
    command = desat(*line[1:], "--out", str(tmp_path / "run"), "--json")
    assert command.returncode in (0, 1), (
        command.stderr
    )  # 1: what is required is not met in 200 s
    command_numbers = json.loads(command.stdout)["numbers"]
    page_texts = shown_numbers(tab)
    assert len(page_texts) > 12
    assert differing(page_texts, command_numbers) == {}
    labels = tab.evaluate("desat.charts.map(u => [u.axes[0].label, u.axes[1].label])")
    assert all(x.startswith("time [") and y for x, y in labels)
    assert any(
        "kept" in s for s in tab.evaluate("desat.charts[0].series.map(s => s.label)")
    )
    address = tab.evaluate("location.href")
    assert "law=predictive" in address
    tab.goto("about:blank")
    tab.goto(address)
    wait_for_flight()
    assert shlex.split(tab.locator("#command").inner_text()) == line
    tab.goto(exported_page[0].path.as_uri() + "#wheels.speed_limit=-3")
    wait_until(tab, "document.getElementById('fault').textContent")
    assert "speed_limit = " in tab.locator("#fault").inner_text()
    tab.locator("#reset").click()
    wait_for_flight()
    assert tab.locator("#fault").inner_text() == ""
    assert errors == []
    tab.close()


# --- sliders of each law --------------------------------------------------------------


LAWS = ["ccpl", "predictive"]
GAIN = "manager.gain"


@pytest.fixture(scope="module")
def usual_page(craft):
    """The page of a craft with the sliders that are usual, one of whose values `--set`
    gave."""
    options = Options(stop=float(STEPS), substeps=2, sets=["torquers.m_limit=0.15"])
    laws = options_of_laws(str(craft), options, LAWS)
    return page.export(str(craft), laws, (), craft.parent / "usual.html")


@needs_zig
def test_each_law_has_its_own_sliders(usual_page):
    """Range, unit and start are those of the law; a law without a gain has no such
    slider."""
    facts, _ = told_of(usual_page.path)
    gains = {}
    for law in facts["laws"]:
        for slider in law["sliders"]:
            assert slider["low"] <= slider["start"] <= slider["high"], slider["name"]
            if slider["name"] == GAIN:
                gains[law["name"]] = slider
    assert list(gains) == ["cross product", "ccpl"]
    assert gains["ccpl"]["low"] > gains["cross product"]["high"]


@needs_zig
def test_a_range_that_was_asked_for_is_of_the_laws_whose_value_lies_in_it(craft):
    options = Options(stop=float(STEPS), substeps=2)
    laws = options_of_laws(str(craft), options, LAWS)
    requests = [f"{GAIN}=10:60", "torquers.m_limit=0.3:0.5"]
    exported_page = page.export(str(craft), laws, requests, craft.parent / "asked.html")
    facts, _ = told_of(exported_page.path)
    ranges = {
        (law["name"], s["name"]): (s["low"], s["high"])
        for law in facts["laws"]
        for s in law["sliders"]
    }
    assert ranges["ccpl", GAIN] == (10.0, 60.0)
    low, high = ranges["cross product", GAIN]
    assert low < 0.00113137 < high < 1.0
    assert all(
        ranges[x, "torquers.m_limit"] == (0.3, 0.5) for x in ("ccpl", "predictive")
    )
    assert [
        n.partition(":")[0] for n in exported_page.notes if n.startswith("slider")
    ] == [
        f"slider {GAIN}",
        "slider torquers.m_limit",
    ]


@needs_zig
def test_a_slider_is_checked_with_its_value_in_place_of_one_that_was_given(craft):
    """Also where a law's own rule gives it: `given twice` is said of neither."""
    options = Options(stop=float(STEPS), sets=[f"{GAIN}=0.002"])
    laws = options_of_laws(str(craft), options, ["ccpl"])
    with pytest.raises(page.DesatError, match="allowed is 0 to inf"):
        page.export(str(craft), laws, [f"{GAIN}=-1:0.01"], craft.parent / "x.html")
    exported_page = page.export(
        str(craft), laws, [f"{GAIN}=0.001:0.01"], craft.parent / "twice.html"
    )
    assert exported_page.sliders == (GAIN,)


GEO = (
    "--orbit geo --mass 2500kg --box 2.5,2.5,3 --wheels '4 pyramid 50Nms' --rods none "
    "--thrusters '4 10N' --dump 'thrusters 70:10' --panel '13m2 1.35m'"
)
THRUSTER_SLIDERS = [
    "manager.begin",
    "manager.end",
    "thrusters.tau_level",
    "thrusters.arm",
    "spacecraft.offset_plates_body",
    "wheels.h_start_wheel",
]


@pytest.mark.parametrize(
    ("inputs", "names"),
    [
        (GEO, THRUSTER_SLIDERS),
        (
            "--altitude 600km --inclination 97.8deg --mass 150kg --box 0.6,0.6,0.8 --rods none "
            "--wheels '3 axes 1Nms' --thrusters '4 1N' --dump 'thrusters 60:5'",
            THRUSTER_SLIDERS,
        ),
    ],
)
def test_sliders_of_a_craft_with_thrusters_are_those_of_its_dumps(
    desat, tmp_path, inputs, names
):
    """Thresholds, thrust, arm and start momentum; what holds the craft's own values."""
    desat("new", "craft", "c", *shlex.split(inputs), check=True, cwd=tmp_path)
    system, _ = prepare(read(str(tmp_path / "c")), Options(stop=100.0)).or_raise()
    sliders = {s.name: s for s in usual(system)}
    assert list(sliders) == names
    assert all(s.holds_start and s.low < s.high for s in sliders.values())
    begin, end = sliders["manager.begin"], sliders["manager.end"]
    wheels = system.components["wheels"].values
    capacity = wheels["inertia_wheel"][0] * wheels["speed_limit"]
    assert begin.high * begin.factor <= capacity
    assert end.start < begin.low
    assert end.high < begin.start


# the pulses of its law do not follow the thrusters, whose torques a test sets
OF_GEO = Options(stop=100.0, sets=["manager.pulse_body=1e-3,1e-3,1e-3"])


@pytest.fixture(scope="module")
def geo(tmp_path_factory):
    """A craft that dumps by thrusters alone."""
    folder = tmp_path_factory.mktemp("geo") / "c"
    line = ["new", "craft", str(folder), *shlex.split(GEO)]
    assert CliRunner().invoke(cli.app_for([]), line).exit_code == 0
    return folder


@pytest.mark.parametrize(
    ("target", "inputs", "display_value"),
    [
        ("thrusters.tau_level", "0.03,0.03,0.03", 30.0),
        ("thrusters.tau_level[2]", "0.03,0.02,0.01", 20.0),
        ("wheels.h_start_wheel", "2,2,2,2", 2.0),
        ("spacecraft.residual_dipole_body", "0,3,4", 5.0),
        ("spacecraft.omega_start_body", "1e-3,1e-3,1e-3", 0.099239),
    ],
)
def test_a_slider_shows_one_quantity_and_sets_what_is_typed(
    geo, target, inputs, display_value
):
    """An element, equal elements, or the size of a vector in space."""
    array = target.partition("[")[0]
    options = with_assignment(OF_GEO, f"{array}={inputs}")
    system, _ = prepare(read(str(geo)), options).or_raise()
    slider = usual_of(target, system) or asked_of(f"{target}=0:50", system)
    assert slider.start == pytest.approx(display_value, rel=1e-4)
    owner, _, name = array.partition(".")
    before = system.components[owner].values[name]
    for value in (display_value, 2.0 * display_value):
        text = slider.value_text(value, before)
        again, _ = prepare(read(str(geo)), with_assignment(options, text)).or_raise()
        factor = value / display_value
        elements = again.components[owner].values[name]
        if "[" in target:
            assert elements == pytest.approx([before[0], factor * before[1], before[2]])
        else:
            assert elements == pytest.approx([factor * x for x in before], rel=1e-4)


def test_torques_that_differ_about_the_axes_have_a_slider_each(geo):
    options = with_assignment(OF_GEO, "thrusters.tau_level=0.03,0.02,0.01")
    system, _ = prepare(read(str(geo)), options).or_raise()
    level_sliders = {s.name: s for s in usual(system) if "tau_level" in s.name}
    assert {n: s.start for n, s in level_sliders.items()} == {
        "thrusters.tau_level[1]": 30.0,
        "thrusters.tau_level[2]": 20.0,
        "thrusters.tau_level[3]": 10.0,
    }
    assert len({s.title for s in level_sliders.values()}) == 3


def test_a_craft_with_coils_and_thrusters_has_the_sliders_of_both():
    names = [
        s.name
        for s in usual(
            prepare(read("uosat12/table2-ocdc-ilqr-1"), Options()).or_raise()[0]
        )
    ]
    assert {"torquers.m_limit", "thrusters.tau_level", "thrusters.arm"} <= {*names}


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("export web {} --law foo", "foo: no law and no manager"),
        ("export web {} --law predictive --law magnetc", "did you mean magnetic?"),
        ("export web {} --law mine.py", "mine.py: No such file"),
        (
            "export web {} --law ccpl --slider torquers.m_limit",
            "the form is NAME=FROM:TO",
        ),
        (
            "export web {} --law ccpl --slider a.b=0:1 --slider a.b=0:2",
            "a.b: it is given twice",
        ),
        ("compare {} --laws ccpl,foo", "foo: no law and no manager"),
        ("compare {} --law mine.py", "mine.py: No such file"),
        ("compare {0} --law {0}/craft.toml", "craft.toml: a law of your own is a .py"),
    ],
)
@needs_zig
def test_names_are_looked_at_before_anything_flies(
    desat, craft, monkeypatch, line, message
):
    monkeypatch.setattr(ranking, "_fly", _no_flight)
    command = desat(*shlex.split(line.format(craft)))
    assert command.returncode == 2
    assert message in command.stderr, command.stderr
    assert len(command.stderr.splitlines()) == 1


def _no_flight(*_: Any) -> None:
    raise AssertionError("it flew")


def test_a_value_stands_once_on_a_command_line():
    """A law's own value is applied after the user's; lists and truths as `--set` reads
    them."""
    options = Options(
        sets=["a.x=1", "a.y=2"],
        values={"a.x": [1.5, np.float64(2.0)], "a.t": True, "a.z": "b.c * 2"},
    )
    assert sets_of(options) == ["a.y=2", "a.x=[1.5, 2.0]", "a.t=true", "a.z=b.c * 2"]
    for text in sets_of(options):
        assert parse_assignment(text)
    assert parse_assignment("a.x=[1.5, 2.0]")[2] == [1.5, 2.0]


@needs_node
@needs_zig
@pytest.mark.parametrize(
    "slider_values",
    [
        {"torquers.m_limit": 1e6},
        {"wheels.speed_limit": 90000.0},
        slow_value({"torquers.m_limit": 1e-7}, "study"),
    ],
)
def test_a_page_warns_of_unusual_values_as_a_run_does(
    desat, usual_page, craft, slider_values, tmp_path
):
    """Beyond the ends of its sliders too, where an address may bring it."""
    facts, worker = told_of(usual_page.path)
    page_warnings = node(
        """globalThis.postMessage = () => {};
const [told0, worker, moved] = input;
(0, eval)(worker.replace('"use strict";', "") + ";globalThis.Flight = Flight;");
const flight = new Flight(told0, new WebAssembly.Module(Buffer.from(told0.wasm, "base64")));
flight.begin(0, moved);
const told = flight.warnings;""",
        [facts, worker, slider_values],
    )
    sliders = {s["name"]: s for s in facts["laws"][0]["sliders"]}
    before = facts["laws"][0]["values"]
    sets = [f"--set={text_of(sliders[n], x, before)}" for n, x in slider_values.items()]
    command = desat(
        "run", str(craft), "--stop", "20", *sets, "--out", str(tmp_path / "run")
    )
    messages = [
        x.rpartition(": ")[0].rpartition(": ")[2] + ": " + x.rpartition(": ")[2]
        for x in command.stderr.splitlines()
        if ": usual is " in x
    ]
    assert messages
    assert {*messages} == {*page_warnings}


@pytest.fixture(scope="module")
def page_to_save(craft):
    """The page of a craft that flies 3000 s in steps of 1 s."""
    sliders = [
        "torquers.m_limit=0.05:0.8",
        "wheels.speed_limit=1000 rpm:9000 rpm",
        "wheels.h_start_wheel=0 mN.m.s:30 mN.m.s",
        "manager.gain=1e-9:4e-3",
        "spacecraft.residual_dipole_body=0:20",
    ]
    options = Options(stop=3000.0, substeps=1)
    return page.export(str(craft), {"own": options}, sliders, craft.parent / "s.html")


LINES = """globalThis.postMessage = () => {};
const [told0, worker, moved] = input;
(0, eval)(worker.replace('"use strict";', "") + ";globalThis.Flight = Flight;");
const flight = new Flight(told0, new WebAssembly.Module(Buffer.from(told0.wasm, "base64")));
flight.begin(0, moved);
while (flight.some());
const told = { before: flight.warnings, after: flight.remarks(), unmet: flight.unmet(),
  numbers: Object.keys(flight.numbers()) };"""


def lines_alike(
    path: Path, target: str, options: Options, slider_values: dict[str, float]
):
    """The lines of a run, after it was found that a flight of a page has the same."""
    facts, worker = told_of(path)
    page_lines = node(LINES, [facts, worker, slider_values])
    law = facts["laws"][0]
    sliders = {s["name"]: s for s in law["sliders"]}
    sets = [text_of(sliders[n], x, law["values"]) for n, x in slider_values.items()]
    options = Options(**{**vars(options), "sets": [*options.sets, *sets]})
    manifest = execute(target, options, None).manifest
    before = prepare(target, options).warnings
    if not slider_values:
        assert {*page_lines["before"]} == {*before}
    after = {x for x in manifest.warnings if "accuracy is shown up to" not in x}
    assert {*page_lines["after"]} == after - {*before}
    exact = [
        re.sub(r"[\d.]+e-1\d", "0", x) for x in page_lines["unmet"]
    ]  # of roundings
    assert {*exact} == {re.sub(r"[\d.]+e-1\d", "0", x) for x in manifest.unmet}
    balance = {"left_rms", "unmanaged_rms"}
    assert balance & {*page_lines["numbers"]} == balance & manifest.numbers.keys()
    return "\n".join(
        [*page_lines["before"], *page_lines["after"], *page_lines["unmet"]]
    )


@needs_node
@needs_zig
@pytest.mark.parametrize(
    ("slider_values", "text"),
    [
        ({}, ""),
        ({"wheels.h_start_wheel": 14.9}, "was at its speed limit for"),
        ({"spacecraft.residual_dipole_body": 5.0}, "the attitude was lost: "),
        slow_value(({"manager.gain": 1e-9}, "it does nothing"), "study"),
    ],
    ids=["as it is", "full wheels", "lost attitude", "no effect"],
)
def test_a_page_warns_after_a_flight_as_a_run_does(
    craft, page_to_save, slider_values, text
):
    options = Options(stop=3000.0, substeps=1)
    assert text in lines_alike(page_to_save.path, str(craft), options, slider_values)


@needs_node
@needs_zig
def test_a_page_says_what_a_star_tracker_at_the_earth_costs(tmp_path):
    target = "nadir_day/star-tracker-prompt"
    sets = ["star_tracker.boresight_body=0,0,1"]
    options = Options(stop=5000.0, substeps=1, sets=sets)
    sliders = ["torquers.m_limit=0.05:2"]
    answer = page.export(target, {"own": options}, sliders, tmp_path / "page.html")
    lines = lines_alike(answer.path, target, options, {})
    for text in ("it was never valid (lost_to = 2", "not checked: left_rms, unmanaged"):
        assert text in lines


# a craft, options of its run, and the line of its thrusters
FIRINGS = {
    "empty tank": (
        "--altitude 600km --size 12U --wheels '3 axes 10mNms' --rods none --secular 20uNm "
        "--thrusters '4 50mN' --dump 'thrusters 70:10' --propellant 0.0001kg",
        Options(stop=3000.0, substeps=1),
        "its tank of 0.0001 kg is empty from",
    ),
    "short pulses": (
        "--thrusters 10mN",
        Options(
            stop=6000.0,
            substeps=1,
            sources=["manager=manager_combined"],
            sets=[
                "manager.split=dct",
                "manager.g_rate=1e-5",
                "manager.sample_time=10",
                "wheels.h_start_wheel=0.005,0.005,0.005,0.005",
                "thrusters.carried=false",
            ],
        ),
        "N m s, never fired",
    ),
}


@needs_node
@needs_zig
@pytest.mark.parametrize("kind", slow_after(1, FIRINGS, "study"))
def test_a_page_warns_of_thrusters_as_a_run_does(tmp_path, kind):
    inputs, options, text = FIRINGS[kind]
    target = tmp_path / "c"
    line = ["new", "craft", str(target), *shlex.split(inputs)]
    assert CliRunner().invoke(cli.app_for([]), line).exit_code == 0
    sliders = ["spacecraft.residual_dipole_body=0:1"]
    answer = page.export(str(target), {"own": options}, sliders, tmp_path / "page.html")
    assert text in lines_alike(answer.path, str(target), options, {})


def shown_numbers(tab: Any) -> dict[str, tuple[str, str]]:
    """The numbers of a page by name, as texts with their units."""
    rows = tab.evaluate(
        """[...document.querySelectorAll("#numbers tr[data-number]")].map(
             r => [r.dataset.number, r.children[1].textContent, r.dataset.unit])"""
    )
    return {name: (text, unit) for name, text, unit in rows}


class Tab:
    """A page in a browser, and what it says."""

    def __init__(self, browser, path: Path, address: str = "") -> None:
        self.tab = browser.new_page(viewport={"width": 1400, "height": 900})
        self.errors: list[str] = []
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        self.tab.on("console", lambda message: self.errors.append(message.text))
        self.tab.goto(path.as_uri() + address)
        self.wait()

    def wait(self) -> None:
        """Wait until what is set has flown, or cannot."""
        time.sleep(0.2)  # more than the page waits after a move
        wait_until(
            self.tab, "document.documentElement.dataset.flown === String(desat.asked)"
        )

    def text(self, name: str) -> str:
        return str(self.tab.locator(f"[id='{name}']").inner_text())

    def value(self, slider: str) -> float:
        return float(self.tab.locator(f"[id='value-{slider}']").input_value())

    def type(self, slider: str, text: str) -> None:
        field = self.tab.locator(f"[id='value-{slider}']")
        field.fill(text)
        field.press("Enter")
        self.wait()

    def command(self) -> list[str]:
        return shlex.split(self.text("command"))

    def warnings(self) -> list[str]:
        return list(self.tab.locator("#warnings li").all_inner_texts())


@pytest.mark.slow
@needs_zig
@pytest.mark.parametrize("law", slow_after(1, ["cross product", *LAWS], "study"))
def test_an_arrow_on_a_slider_stays_in_the_range_of_the_law(
    browser, usual_page, desat, tmp_path, law
):
    """What the shown line prints is what stands there, whatever law was chosen and
    moved."""
    at = Tab(browser, usual_page.path)
    at.tab.select_option("#law", label=law)
    at.wait()
    facts, _ = told_of(usual_page.path)
    (of,) = (x for x in facts["laws"] if x["name"] == law)
    for slider in of["sliders"]:
        name = slider["name"]
        at.tab.locator(f"[id='range-{name}']").press(
            "ArrowLeft" if slider["start"] else "ArrowRight"
        )
        span = slider["high"] - slider["low"]
        assert slider["low"] <= at.value(name) <= slider["high"], name
        assert abs(at.value(name) - slider["start"]) < 0.03 * span, name
        assert at.value(name) != slider["start"], name
    at.wait()
    line = at.command()
    command = desat(*line[1:], "--out", str(tmp_path / "run"), "--json")
    assert command.returncode in (0, 1), command.stderr
    command_numbers = json.loads(command.stdout)["numbers"]
    page_texts = shown_numbers(at.tab)
    assert len(page_texts) > 12
    assert differing(page_texts, command_numbers) == {}
    at.tab.locator("#reset").click()
    at.wait()
    assert at.tab.evaluate(
        "document.getElementById('law').selectedOptions[0].textContent"
    ) == ("cross product")
    first = desat(*at.command()[1:], "--out", str(tmp_path / "first"))
    assert first.returncode in (0, 1), first.stderr
    assert [x for x in at.command() if "=" in x] == ["torquers.m_limit=0.15"]
    assert at.errors == []
    at.tab.close()


@needs_zig
def test_what_was_moved_under_a_law_comes_back_with_it(browser, usual_page):
    at = Tab(browser, usual_page.path)
    at.type(GAIN, "0.003")
    at.type("torquers.m_limit", "0.3")
    at.tab.select_option("#law", label="ccpl")
    at.wait()
    assert at.value(GAIN) > 1.0
    assert at.value("torquers.m_limit") == 0.3
    at.type(GAIN, "100")
    at.tab.select_option("#law", label="predictive")
    at.wait()
    assert not at.tab.locator(f"[id='range-{GAIN}']").count()
    at.tab.select_option("#law", label="cross product")
    at.wait()
    assert at.value(GAIN) == 0.003
    assert "ccpl" not in at.text("command")
    at.tab.close()


@needs_zig
@pytest.mark.parametrize(
    ("slider", "text"),
    [
        (GAIN, "5"),
        (GAIN, "-0.001"),
        ("torquers.m_limit", "abc"),
        ("wheels.speed_limit", "1e9"),
        ("environment.inclination", ""),
    ],
)
def test_a_value_outside_a_slider_is_refused_where_it_is_typed(
    browser, usual_page, slider, text
):
    """It says what was given and what is allowed; what flies stays as it was."""
    at = Tab(browser, usual_page.path)
    before, command = at.value(slider), at.text("command")
    at.type(slider, text)
    messages = [x for x in at.tab.locator(".refused").all_inner_texts() if x]
    assert len(messages) == 1
    assert messages[0].startswith(f"{slider} = ")
    assert f"it stays at {before:g}"[:16] in messages[0]
    assert " to " in messages[0]
    assert at.text("command") == command
    at.type(slider, str(before))
    assert not [x for x in at.tab.locator(".refused").all_inner_texts() if x]
    at.tab.close()


@needs_zig
@pytest.mark.parametrize(
    ("address", "message"),
    [
        (
            "#torquers.m_limit=1000000",
            ["torquers.m_limit = 1000000 A m2: outside 0.015 to 0.6 A m2", "usual is"],
        ),
        (
            "#law=nonsense",
            ["law=nonsense: no such law on this page; there is cross product, ccpl"],
        ),
        (
            "#law=predictive&manager.gain=3",
            ["manager.gain=3: no slider of this page under the law predictive"],
        ),
        ("?spacecraft.mass=7", ["spacecraft.mass=7: no slider of this page"]),
        ("#torquers.m_limit=abc", ["torquers.m_limit=abc: a number is needed"]),
        ("#law=ccpl&manager.gain=0.002", ["manager.gain = 0.002 1/s: outside "]),
    ],
)
def test_an_address_beyond_the_sliders_warns(browser, usual_page, address, message):
    """What it can fly it flies, and says that it lies outside; reset takes the words
    away."""
    at = Tab(browser, usual_page.path, address)
    page_warnings = "\n".join(at.warnings())
    for text in message:
        assert text in page_warnings
    if "outside" in message[0]:
        name, _, value = message[0].partition(":")[0].partition(" = ")
        assert at.value(name) == float(value.split()[0])
    at.tab.locator("#reset").click()
    at.wait()
    assert at.warnings() == []
    assert "#" not in at.tab.url
    assert "?" not in at.tab.url
    at.tab.close()


# --- what the page says and shows first -----------------------------------------------


@needs_zig
def test_a_page_answers_in_a_sentence_and_says_who_made_it(browser, craft, tmp_path):
    """Its description, date and author; sliders are named in words; what is missed is
    named."""
    answer = page.export(
        str(craft),
        {"own": Options(stop=3000.0, substeps=1)},
        ["wheels.h_start_wheel=0 mN.m.s:14 mN.m.s", "torquers.m_limit=0.05:0.8"],
        tmp_path / "page.html",
        author="A. <Engineer> & Co",
    )
    at = Tab(browser, answer.path)
    run = execute(str(craft), Options(stop=3000.0, substeps=1))
    verdict = describe_verdicts(run.manifest.verdicts, 0)
    margin = verdict.partition("margin of ")[2].partition(" %")[0]
    start, _, title = at.text("answer").partition(" %")
    assert float(start.removeprefix("Holds with a margin of ")) == pytest.approx(
        float(margin), rel=1e-2
    )
    assert title.startswith(f"{verdict.partition(' %')[2]}; without")
    body = at.tab.locator("body").inner_text()
    assert "made by A. <Engineer> & Co on 20" in body
    assert "18 kg, nadir pointing" in body
    for slider in at.tab.locator("#sliders input[type=range]").all():
        label = slider.get_attribute("aria-label")
        assert "." not in label
        assert "_" not in label
    at.type("wheels.h_start_wheel", "14")
    text = at.text("answer")
    assert text.startswith("Does not hold: a wheel is full after")
    assert "Largest wheel momentum" in text.partition("NOT MET: ")[2]
    assert any("was at its speed limit for" in line for line in at.warnings())
    at.tab.close()


def save_csv(tab: Any) -> list[list[str]]:
    """The rows of the file that the first CSV button saves."""
    with tab.expect_download() as download:
        tab.locator("figure .save").first.get_by_text("CSV", exact=True).click()
    return [*csv.reader(Path(download.value.path()).read_text().splitlines())]


@needs_zig
def test_csv_of_a_chart_has_all_samples_of_both_flights(browser, craft, page_to_save):
    """Of the flight that is shown and of the one that was kept, as runs have them."""
    at = Tab(browser, page_to_save.path)
    at.tab.locator("#compare").click()
    at.type("torquers.m_limit", "0.06")
    head, *rows = save_csv(at.tab)
    at.tab.close()
    for label, sets in [("", ["torquers.m_limit=0.06"]), (", kept 1", [])]:
        run = execute(str(craft), Options(stop=3000.0, substeps=1, sets=sets), None)
        fullest = 1e3 * np.abs(run["wheels.h_wheel"]).max(axis=1)
        column = head.index(f"with management{label} [mN m s]")
        csv_values = np.array([row[column] for row in rows], dtype=float)
        assert np.allclose(csv_values, fullest, rtol=1e-9, atol=0.0)


@needs_zig
def test_flights_are_kept_beside_one_another(browser, page_to_save):
    """Each has a column and lines of its own, until its button takes it away."""
    at = Tab(browser, page_to_save.path)
    for value in ("0.06", "0.1"):
        at.tab.locator("#compare").click()
        at.type("torquers.m_limit", value)
    entries = at.tab.locator("#kept li")
    assert entries.all_inner_texts() == [
        "× kept 1: as the scenario has it",
        "× kept 2: largest dipole of each coil 0.06 A m2",
    ]
    head = at.tab.locator("#numbers th").all_inner_texts()
    assert head[:3] == ["now", "kept 1", "kept 2"]
    entries.first.locator("button").click()
    assert entries.all_inner_texts() == [
        "× kept 1: largest dipole of each coil 0.06 A m2"
    ]
    labels = at.tab.evaluate("desat.charts[0].series.map(s => s.label)")
    assert [x for x in labels if "kept" in x] == [
        "with management, kept 1",
        "without management (estimated), kept 1",
    ]
    assert at.errors == []
    at.tab.close()


CSV_HEAD = "# telemetry\ntime [min],flight [N m s],error [deg],heat [K]\n"
CSV_ROWS = "0,0.001,1,300\n10,,2,300\n20,0.003,3,300\n"
# the same flight in other words
CSV_OTHERS = (
    '\ufeffTime [h];"flight [uN.m.s]"\n0;1000\n0.1;nan\n0.3333333333333333;3000\n',
    't [s]\t"flight [mN·m·s]"\n0\t1\n1200\t3',
)


@needs_zig
@pytest.mark.parametrize("content", [CSV_HEAD + CSV_ROWS, *CSV_OTHERS])
def test_a_csv_of_ones_own_lies_over_the_curves(
    browser, page_to_save, tmp_path, content
):
    """In the charts' units, at its own times; what fits none is said."""
    at = Tab(browser, page_to_save.path)
    file = tmp_path / "own.csv"
    file.write_text(content, encoding="utf-8")
    at.tab.set_input_files("#own", file)
    wait_until(at.tab, "document.querySelector('#kept li')")
    text = at.text("kept")
    assert 'flight in "Momentum of the fullest wheel' in text
    assert ("heat [K] in none, whose units are [mNms]" in text) == ("heat" in content)
    head, *rows = save_csv(at.tab)
    column = head.index("flight, own.csv [mN m s]")
    drawn_values = {float(row[0]): row[column] for row in rows if row[column]}
    assert {t: float(x) for t, x in drawn_values.items()} == {0.0: 1.0, 1200.0: 3.0}
    assert at.errors == []
    at.tab.close()


@needs_zig
@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "a line of names and lines of numbers are needed"),
        ("time [s];h\n0;1\n", "no chart has the unit of h; there is [mNms]"),
        ("t,h [Nms]\n0,1\n", 'the first column is "t"; it has to be time [s]'),
        ("time [y],h [Nms]\n0,1\n", 'the first column is "time [y]"'),
        (CSV_HEAD + "0,x,1,1\n", 'row 1, flight [N m s]: "x" is not a number'),
        (CSV_HEAD + "1,1,1,1\n1,1,1,1\n", 'row 2: time "1" does not come after'),
        (CSV_HEAD + "100,1,1,1\n", "no row lies within the flight"),
    ],
)
def test_a_csv_that_cannot_be_drawn_is_refused(
    browser, page_to_save, tmp_path, content, message
):
    at = Tab(browser, page_to_save.path)
    file = tmp_path / "own.csv"
    file.write_text(content)
    at.tab.set_input_files("#own", file)
    wait_until(at.tab, "document.getElementById('refused').textContent")
    assert at.text("refused").startswith("own.csv: ")
    assert message in at.text("refused")
    assert at.tab.locator("#kept li").count() == 0
    at.tab.close()


@needs_zig
def test_a_threshold_is_dragged_in_its_chart(browser, geo, tmp_path):
    """By pointer and by arrows; its slider follows, and the loop flies with it."""
    laws = {"threshold": Options(stop=10.0 * 86400.0)}
    answer = page.export(str(geo), laws, [], tmp_path / "page.html")
    at = Tab(browser, answer.path)
    limits = at.tab.evaluate("desat.shown.plots[0].limits")
    capacity, begin, end, most = limits
    assert (begin, end, most) == (35.0, 5.0, pytest.approx(0.8 * capacity))
    grips = at.tab.locator("figure").first.locator(".grip")
    assert grips.count() == 2  # the capacity has no slider there, nor its share
    box = grips.first.bounding_box()
    height = at.tab.evaluate(
        f"desat.charts[0].valToPos(20, 'y') - desat.charts[0].valToPos({begin}, 'y')"
    )
    x, y = box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]
    at.tab.mouse.move(x, y)
    at.tab.mouse.down()
    at.tab.mouse.move(x, y + 0.5 * height)
    at.tab.mouse.move(x, y + height)
    at.tab.mouse.up()
    at.wait()
    slider_values = at.tab.evaluate("desat.shown.moved")
    assert [*slider_values] == ["manager.begin"]
    assert slider_values["manager.begin"] == pytest.approx(20.0, abs=0.03 * capacity)
    assert at.value("manager.begin") == slider_values["manager.begin"]
    assert (
        at.tab.evaluate("desat.shown.plots[0].limits[1]")
        == slider_values["manager.begin"]
    )
    grips.nth(1).focus()
    at.tab.keyboard.press("ArrowUp")
    at.tab.keyboard.press("ArrowUp")
    at.wait()
    assert at.value("manager.end") > end
    assert at.tab.evaluate("document.activeElement.className") == "grip"
    assert at.errors == []
    at.tab.close()


@needs_zig
def test_csv_of_a_flight_that_is_gone_says_what_it_holds(browser, page_to_save):
    """One that cannot start has taken its place: what is drawn is saved, and said."""
    at = Tab(browser, page_to_save.path)
    at.tab.evaluate("location.hash = 'wheels.speed_limit=-1'")
    at.wait()
    assert at.text("fault")
    note, _, *rows = save_csv(at.tab)
    at.tab.close()
    assert note[0].startswith("# minima and maxima of 600 bins of 3001 samples")
    assert len(rows) == 1200


@needs_zig
def test_charts_of_a_page_are_saved_and_its_view_follows_the_pointer(
    browser, page_to_save, tmp_path
):
    at = Tab(browser, page_to_save.path)
    tab = at.tab
    assert tab.locator(".save").count() == tab.evaluate("desat.charts.length")
    bar = tab.locator("figure .save").first
    for kind in ("PNG", "SVG", "CSV"):
        with tab.expect_download() as download:
            bar.get_by_text(kind, exact=True).click()
        file = tmp_path / download.value.suggested_filename
        download.value.save_as(file)
        if kind == "PNG":
            assert file.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
        elif kind == "SVG":
            root = html.fromstring(file.read_bytes())
            assert "with management" in root.text_content()
        else:
            head, *lines = file.read_text().splitlines()
            assert head.startswith("time [s],with management [mN m s]")
            assert [float(x.partition(",")[0]) for x in lines] == [*range(3001)]
    box = tab.locator("figure .u-over").first.bounding_box()
    tab.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
    count = tab.evaluate("desat.scene.data.count")
    wait_until(tab, f"Math.abs(desat.scene.row - {count / 2}) < {0.03 * count}")
    tab.evaluate(
        "(() => { const s = document.querySelector('#scene input'); s.value = 100;"
        " s.dispatchEvent(new Event('input')); })()"
    )
    pointer_time = tab.evaluate(
        "desat.charts[0].posToVal(desat.charts[0].cursor.left, 'x')"
    )
    step = tab.evaluate("desat.scene.data.step")
    assert pointer_time == pytest.approx(100 * step, abs=3000.0 / 300)
    tab.close()
