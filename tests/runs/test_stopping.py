"""What ends a run before its stop time: conditions, and the limit of wall time."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from desat.campaign.draws import draws
from desat.runs import stopping
from desat.runs.run import execute, prepare
from desat.runs.stopping import LATE, Condition
from desat.system.errors import DesatError, Exit, MisfitError
from desat.system.options import Options
from tests.conftest import but

NAME = "integrated/mil-nadir"
RATE = "spacecraft.omega_bi_body"


@pytest.fixture
def scenario(tmp_path):
    """A scenario of one's own that ends on a condition, by blocks."""

    def write(condition: str, more: str = "") -> str:
        file = tmp_path / "mine.toml"
        text = f'extends = "{NAME}"\nstop = 300.0\ntitle = "T"\n{more}\n[stop_when]\n{condition}\n'
        file.write_text(text)
        return str(file)

    return write


def run(target: str, **options):
    return execute(target, Options(blocks=True, **options))


def test_it_ends_where_the_measure_says(scenario):
    """At the row where all elements have been below for so long, as `first_below` has
    it."""
    full = run(NAME, stop=300.0)
    sizes = np.abs(full.results.values(RATE))
    limit = float(np.sort(sizes.max(axis=1))[len(sizes) // 2])
    number = (
        f"[numbers.first]\nsignal = '{RATE}'\nmeasure = 'first_below'\nunit = 's'\n"
    )
    options = f"options = {{ limit = {limit!r}, held = 5.0 }}\n"
    stopped_run = run(
        scenario(f"signal = '{RATE}'\nbelow = {limit!r}\nheld = 5.0", number + options)
    )
    good, step = (sizes < limit).all(axis=1), full.manifest["step"]
    rows = round(5.0 / step)
    first = next(i for i in range(len(good)) if good[i : i + rows + 1].all())
    assert stopped_run.manifest["status"] == "completed"
    assert stopped_run.manifest["stopped_when"]["time"] == pytest.approx(
        (first + rows) * step
    )
    assert (
        stopped_run.manifest["steps_done"] == first + rows < full.manifest["steps_done"]
    )
    assert stopped_run.manifest["numbers"]["first"]["value"] == pytest.approx(
        first * step
    )
    assert np.array_equal(
        stopped_run.results.values(RATE), full.results.values(RATE)[: first + rows + 1]
    )


@pytest.mark.parametrize("algorithm", ["gauss_seidel", "jacobi"])
def test_above_is_met_by_any_element_and_need_not_be_recorded(scenario, algorithm):
    name = "wheels.h_wheel"
    full = run(NAME, stop=300.0, algorithm=algorithm)
    sizes = np.abs(full.results.values(name)).max(axis=1)
    limit = float(sizes[len(sizes) // 3 :].max()) * 0.999
    k = max(1, int(np.flatnonzero(sizes > limit)[0]))
    target = scenario(f"signal = '{name}'\nabove = {1e3 * limit!r}\nunit = 'mN.m.s'")
    stopped_run = run(target, algorithm=algorithm, record=("spacecraft.q_bi",))
    assert stopped_run.manifest["steps_done"] == k
    assert stopped_run.results.names() == ["spacecraft.q_bi"]
    assert "mN.m.s" in stopped_run.manifest["stopped_when"]["condition"]


def test_an_output_that_reaches_nobody_need_not_be_recorded(scenario):
    target = scenario("signal = 'wheels.speed_wheel'\nabove = 1e-9")
    assert run(target, record=("spacecraft.q_bi",)).manifest["steps_done"] == 1


def test_a_product_of_parameters_and_a_mode(scenario):
    text = "signal = 'wheels.h_wheel'\nabove = '1e-9 * wheels.inertia_wheel * wheels.speed_limit'"
    assert run(scenario(text)).manifest["steps_done"] == 1
    assert (
        run(scenario("signal = 'manager.mode'\nreaches = 99")).manifest["stopped_when"]
        is None
    )
    mode = run(NAME, stop=60.0).results
    name, value = mode.choices("manager.mode"), int(mode.values("manager.mode")[-1])
    stopped_run = run(
        scenario(f"signal = 'manager.mode'\nreaches = '{name[value]}'\nheld = 20.0")
    )
    assert stopped_run.manifest["stopped_when"]["condition"].endswith(
        f"reaches {name[value]} for 20 s"
    )


def test_what_is_not_reached_stays_not_reached(scenario):
    window = "[numbers.late]\nsignal = 'thrusters.on_time'\nwindow = [200.0, 300.0]\n"
    window = window.replace("thrusters.on_time", RATE).replace(
        "\nwindow", "\nmeasure = 'largest'\nwindow"
    )
    stopped_run = run(scenario(f"signal = '{RATE}'\nabove = 0.0\nheld = 50.0", window))
    assert stopped_run.manifest["end_time"] == 50.0
    assert stopped_run.manifest["numbers"]["late"]["value"] is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "signal = 'manger.mode'\nreaches = 1",
            "stop_when.signal: no component manger; did you",
        ),
        (
            "signal = 'manager.mod'\nreaches = 1",
            "stop_when.signal: manager has no output mod;",
        ),
        (
            "signal = 'manager.mode'\nreaches = 'nomnal'",
            "stop_when.reaches: no value nomnal",
        ),
        (
            "signal = 'manager.mode'\nbelow = 1.0",
            "stop_when.below: manager.mode is of type Integer",
        ),
        (
            f"signal = '{RATE}'\nreaches = 1",
            "stop_when.reaches: got 1; omega_bi_body is a Real",
        ),
        (
            f"signal = '{RATE}'\nbelow = 1.0\nunit = 'T'",
            "stop_when.below: unit T of the limit does",
        ),
        (
            f"signal = '{RATE}'\nbelow = 'wheels.inertia_wheel'",
            "stop_when.below: unit of",
        ),
        (
            f"signal = '{RATE}'",
            "stop_when: exactly one of below, above, reaches is needed",
        ),
        (f"signal = '{RATE}'\nbelow = 1.0\nabove = 2.0", "stop_when: exactly one of"),
        (
            f"signal = '{RATE}'\nbelo = 1.0",
            "stop_when.belo: unknown key; did you mean below?",
        ),
        (f"signal = '{RATE}'\nbelow = 1.0\nheld = -1.0", "stop_when.held: got -1.0"),
        (
            "signal = 'manager.mode'\nreaches = 1.5",
            "stop_when.reaches: got 1.5: a whole number",
        ),
    ],
)
def test_what_is_wrong_is_one_line(scenario, text, message):
    target = scenario(text)
    with pytest.raises(DesatError) as error:
        prepare(target, Options(blocks=True)).or_raise()
    (line,) = str(error.value).splitlines()
    assert re.search(r"mine\.toml:\d+: stop_when", line)
    assert message in line


def test_a_replaced_component_without_the_signal_is_refused(scenario):
    target = scenario("signal = 'manager.mode'\nreaches = 1")
    system, _ = prepare(target, Options(blocks=True)).or_raise()
    about = but(system.about, stop_when={"signal": "manager.nothing", "reaches": 1})
    system = replace(system, about=about)
    with pytest.raises(MisfitError) as refusal:
        stopping.condition(system)
    key, text = refusal.value.keys, str(refusal.value)
    assert key == ("stop_when", "signal")
    assert "manager has no output nothing" in text


def test_the_time_limit(tmp_path):
    late = execute(NAME, Options(blocks=True, time_limit=0.0), tmp_path / "run")
    assert late.manifest["status"] == "timed out"
    assert late.code == Exit.TIMEOUT == 5
    assert late.manifest["steps_done"] == len(late.results.times()) - 1 == 1
    result = draws(
        "uosat12/flight-ocdc-1", 1, 1, Options(blocks=True, time_limit=0.0), jobs=1
    )
    assert result.rows[0].code == 5


def test_the_command_ends_with_5_and_keeps_the_run(desat, tmp_path):
    command = desat(
        "run", NAME, "--blocks", "--time-limit", "1e-9", "--out", str(tmp_path / "a")
    )
    assert command.returncode == 5
    assert (
        "\ntimed out: 1e-09 s of wall time over at t = " in command.stderr
    )  # after warnings
    assert (
        json.loads((tmp_path / "a/manifest.json").read_text())["status"] == "timed out"
    )
    assert (tmp_path / "a/report.html").exists()


@pytest.mark.parametrize(
    ("kind", "value", "result"),
    [
        ("Boolean", True, 1),
        ("Boolean", False, 0),
        ("Boolean", 1, "Boolean: true or false"),
        ("Integer", 3, 3),
        ("Integer", "b", 1),
        ("Integer", True, "is an Integer"),
        ("Integer", "bb", "no value bb; did you mean b?"),
        ("Real", 1, "a Real, which has below"),
    ],
)
def test_what_a_condition_may_reach(kind, value, result):
    signal = SimpleNamespace(kind=kind, array="mode", choices=["a", "b"])
    if isinstance(result, int):
        assert stopping._reaches(signal, value) == result
    else:
        with pytest.raises(DesatError, match=result):
            stopping._reaches(signal, value)


@pytest.mark.parametrize("seconds", [None, 5.0])
def test_the_time_is_over_after_it_and_not_at_it(monkeypatch, seconds):
    now = 10.0
    monkeypatch.setattr(stopping.time, "monotonic", lambda: now)
    ending = stopping.watch(SimpleNamespace(slots=[]), None, seconds)
    assert ending.kind == "never"
    for now, late in (14.9, False), (15.0, False), (math.nextafter(15.0, 16.0), True):  # noqa: B007
        assert ending.reason() == (LATE if late and seconds else "")


@pytest.mark.parametrize("interval", [True, False])
@pytest.mark.parametrize("algorithm", ["gauss_seidel", "jacobi"])
def test_a_condition_is_to_hold_for_its_time(interval, algorithm):
    """From the row that it holds at, which of an interval output began a step ago; anew
    where it was broken."""
    live = {"Real": np.array([0.0, 1.0])}
    x, y = (SimpleNamespace(name=name, series=name) for name in "xy")
    slot = SimpleNamespace(
        component="a", signal=x, kind="Real", index=1, interval=interval
    )
    others = [
        SimpleNamespace(component="b", signal=x),
        SimpleNamespace(component="a", signal=y),
    ]
    master = SimpleNamespace(
        slots=[*others, slot],
        live=live,
        start=3.0,
        step_size=0.1,
        k=0,
        algorithm=algorithm,
    )
    at_start = not (interval and algorithm == "gauss_seidel")
    ending = stopping.watch(
        master, Condition("a", "x", "below", 2.0, 0.3, "it is low"), None
    )
    assert (ending.watched, ending.limit, ending.kind) == ([slot], 2.0, "below")
    assert ending.memory == ({"since": 3.0} if at_start else {})
    reasons = []
    for k, value in enumerate((1.0, 1.0, 1.0, 9.0, 1.0, 1.0, 1.0, 1.0), start=1):
        master.k, live["Real"][1] = k, value
        reasons.append(ending.reason())
    assert reasons == [
        "",
        "",
        "it is low" if at_start else "",
        "",
        "",
        "",
        "",
        "it is low",
    ]
    live["Real"][1] = 9.0
    ending.reason()
    assert ending.memory == {}


def test_a_condition_that_has_just_held_long_enough_is_met():
    x = SimpleNamespace(name="x", series="x")
    slot = SimpleNamespace(
        component="a", signal=x, kind="Real", index=0, interval=False
    )
    master = SimpleNamespace(
        slots=[slot],
        live={"Real": np.array([1.0])},
        start=0.0,
        k=2,
        step_size=0.5,
        algorithm="gauss_seidel",
    )
    hold_time = 1.0 + 1e-9
    assert hold_time - 1e-9 == 1.0
    ending = stopping.watch(
        master, Condition("a", "x", "below", 2.0, hold_time, "low"), None
    )
    assert ending.reason() == "low"
    master.step_size = math.nextafter(0.5, 0.0)
    assert ending.reason() == ""
