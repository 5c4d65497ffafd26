"""Paired differences over the same draws, and sweeps over parameters."""

from __future__ import annotations

import itertools
import json
import re
from dataclasses import replace

import pytest
from lxml import html

from desat.campaign import sweep_page
from desat.campaign.draws import Draws, RunRow, draws, one
from desat.campaign.pairs import common, differences, each_draw
from desat.campaign.spread import Spread
from desat.campaign.sweep import Sweep, SweepPoint, axes_of, sweep
from desat.language.scenario import Requirement
from desat.numbers.text import number
from desat.runs.cases import Cases
from desat.runs.prepare import read
from desat.runs.run import Options, execute
from desat.system.errors import DesatError
from tests.conftest import module_of

NAME = "integrated/mil-nadir"
SHORT = Options(blocks=True, stop=100.0)


@pytest.fixture
def other(tmp_path):
    """A scenario of one's own that differs from NAME in what is given here."""

    def write(text: str) -> str:
        (tmp_path / "other.toml").write_text(f'extends = "{NAME}"\n{text}')
        return str(tmp_path / "other.toml")

    return write


def test_paired_differences_are_those_of_the_draws(other):
    target = other("parameters.manager.gain = 1e-3")
    both = [draws(n, 3, 4, SHORT, 1) for n in (NAME, target)]
    result, (ours, theirs) = differences(*both), (x.rows for x in both)
    for name, spread in result.items():
        entry = spread.to_json()
        each = [a.numbers[name] for a in ours], [b.numbers[name] for b in theirs]
        if None in (*each[0], *each[1]):
            assert entry["n"] == 0
            assert entry["median"] is None
            continue
        expected = [a - b for a, b in zip(*each, strict=True)]
        found = each_draw(ours, theirs, name)
        assert list(found.values()) == pytest.approx(expected, abs=1e-9)
        assert entry["lower"] + entry["higher"] + entry["equal"] == 3
        assert entry["min"] <= entry["median"] <= entry["max"]
    assert result["coil_load"].equal < 3
    assert [r.values for r in ours] == [r.values for r in theirs]
    found = common(Cases(read(NAME)), Cases(read(target)), 4, SHORT, SHORT)
    assert found["drawn_only_in_it"] == found["drawn_only_in_the_other"] == []


def test_a_scenario_against_itself_is_equal_in_all():
    result = differences(*(draws(NAME, 2, 1, SHORT, 1) for _ in range(2)))
    assert all(e.equal == e.n for e in result.values())
    assert any(e.n == 2 for e in result.values())


def test_what_is_drawn_otherwise_is_refused_and_what_one_draws_is_said(other):
    text = """without = ['dispersions.{}']\ndispersions."{}" = {}"""
    h, seed = "wheels.h_start_wheel", "*.seed"
    target = other(text.format(seed, "magnetometer.seed", "{ seed = true }"))
    found = common(Cases(read(NAME)), Cases(read(target)), 1, SHORT, SHORT)
    assert found["drawn_only_in_the_other"] == []
    assert "tachometers.seed" in found["drawn_only_in_it"]
    assert "magnetometer.seed" in found["drawn_in_both"]
    target = other(text.format(h, h, "{ normal = [0.0, 5e-3] }"))
    with pytest.raises(
        DesatError, match=r"h_start_wheel is drawn as .*0\.006.* and as .*0\.005"
    ):
        common(Cases(read(NAME)), Cases(read(target)), 1, SHORT, SHORT)
    target = other('without = ["dispersions"]')
    with pytest.raises(DesatError, match="the two sample nothing in common"):
        common(Cases(read(NAME)), Cases(read(target)), 1, SHORT, SHORT)


def test_a_drawn_value_that_is_refused_is_named(other):
    """Draw, file, dispersion, value and what is allowed; also of a dispersion of
    nothing, and where a block refuses it."""
    key, of = (
        '"wheels.speed_limit"',
        "dispersions.wheels.h_start_wheel: wheels: h_start_wheel",
    )
    target = other(f"dispersions.{key} = {{ uniform = [-0.2, 0.8] }}")
    place = f"{target}: dispersions.wheels.speed_limit"
    for draw, text in (
        (6, f"{target}: draw 6: {place}: wheels.speed_limit = -0.032233 rad/s"),
        (0, f"speed_limit from {place}"),
    ):
        with pytest.raises(DesatError, match=re.escape(text)) as error:
            one(Cases(read(target)), SHORT, 1, draw)
        assert ("allowed is 0.001 to inf" if draw else of) in str(error.value)
    target = other('dispersions."wheel.speed_limit" = { uniform = [1.0, 2.0] }')
    with pytest.raises(
        DesatError, match=r"toml:2: dispersions\.wheel\.speed_limit: no component"
    ):
        draws(target, 2, 1, SHORT, 1)


def test_numbers_of_another_unit_are_not_compared():
    def result(unit, *values):
        rows = [
            RunRow("completed", 0, "", numbers={"x": v}, number=i)
            for i, v in enumerate(values)
        ]
        return Draws("s", 1, rows, {"x": Spread(unit=unit)}, [])

    assert differences(result("s", 1.0), result("min", 1.0)) == {}
    found = differences(
        result("s", 1.0, 2.0, None, 3.0), result("s", 2.0, 2.0, 1.0, 1.0)
    )["x"]
    assert [found.n, found.lower, found.equal, found.higher] == [3, 1, 1, 1]
    rows = (result("s", 1.0, 2.0, None, 3.0).rows, result("s", 2.0, 2.0, 1.0, 1.0).rows)
    assert each_draw(*rows, "x") == {0: -1.0, 1: 0.0, 3: 2.0}


def test_a_sweep_is_its_runs():
    axes = axes_of(["manager.gain=1e-3,5e-3", "manager.velocity_dumping=true,false"])
    result = sweep(NAME, axes, SHORT, jobs=1).to_json()
    assert [p["values"] for p in result["points"]] == [
        {"manager.gain": g, "manager.velocity_dumping": v}
        for g in (1e-3, 5e-3)
        for v in (True, False)
    ]
    for point in result["points"][1:3]:
        sets = [f"{n}={str(v).lower()}" for n, v in point["values"].items()]
        run = execute(NAME, Options(blocks=True, stop=100.0, sets=sets))
        expected = {n: run.manifest["numbers"][n]["value"] for n in point["numbers"]}
        assert point["numbers"] == expected
    assert result["units"]["coil_load"]


@pytest.mark.parametrize(
    ("texts", "limit", "answer"),
    [
        (["manager.gain=1e-3,5e-3"], 1e6, "Holds at all 2 combinations; best at "),
        (["manager.gain=1e-3,5e-3"], 1e-6, "Holds at none of 2 combinations; nearest"),
        (["manager.velocity_dumping=true,false"], 1e6, "velocity_dumping = true"),
    ],
)
def test_a_sweep_says_where_its_requirements_hold(
    other, tmp_path, texts, limit, answer
):
    """Curves, and values that are words: each has the limit."""
    target = other(f'[requirements.load]\nnumber = "coil_load"\nmax = {limit}\n')
    result = sweep(target, axes_of(texts), replace(SHORT, stop=10.0), jobs=1)
    assert answer in result.answer
    assert result.answer.endswith("; not decided: pointing, dumped")
    assert all(p["holds"] == (limit > 1.0) for p in result.to_json()["points"])
    page = sweep_page.write(result, tmp_path / "page.html").read_text("utf-8")
    assert page.count("<figure") == 3  # the two of NAME are drawn, too
    assert f"at most {number(limit)}" in page


@pytest.mark.parametrize(
    ("counts", "maps", "about"),
    [
        ((2, 3, 2), 0, "12 combinations."),
        ((2, 4, 4), 2, "32 combinations."),
        ((3, 4, 3, 3), 6, "3 of 9 maps are left to the tables"),
    ],
)
def test_a_sweep_over_many_parameters_is_lines_or_maps(tmp_path, counts, maps, about):
    """Up to six lines a plot; else maps over the two longest axes, one a combination
    of the others, in colours of all."""
    names = [f"c.{k}" for k in "uvwx"[: len(counts)]]
    axes = {
        name: [True, False] if n == 2 else [*map(float, range(n))]
        for name, n in zip(names, counts, strict=True)
    }
    result = sweep_of(axes, lambda values: float(sum(values)))
    page = sweep_page.write(result, tmp_path / "page.html").read_text("utf-8")
    assert page.count("<figure") == max(1, maps)
    assert about in page
    beyond = "not at most 4" if maps else "at most 4"
    assert page.count(f">{beyond}<") == max(1, maps)
    assert page.count("Load, c.u = true") == (maps == 2)
    if maps:
        assert len({*re.findall("[0-9.]+ to [0-9.]+ N m", page)}) == sweep_page.LEVELS


def test_values_that_read_alike_are_two_points(tmp_path):
    near = [1.0000001, 1.0000002]
    axes = {"c.u": near, "c.v": [*map(float, range(7))]}
    result = sweep_of(axes, lambda values: 1e7 * (values[0] - 1.0) + values[1])
    page = sweep_page.write(result, tmp_path / "page.html").read_text("utf-8")
    assert {*re.findall(r"c\.u = ([0-9.]+)", page)} == {*map(str, near)}
    (plot,) = result_plots(page)
    assert [line["label"] for line in plot["series"]] == [f"c.u = {x}" for x in near]


def result_plots(page):
    """What the plots of a page draw."""
    tree = html.fromstring(page)
    return json.loads(tree.find(".//script[@id='drawn']").text)["plots"]


def sweep_of(axes, compute):
    """A sweep whose one number is a function of the values."""
    points = [
        SweepPoint(
            dict(zip(axes, values, strict=True)),
            [RunRow("completed", 0, "")],
            {"load": Spread(levels={"median": compute(values)})},
        )
        for values in itertools.product(*axes.values())
    ]
    return Sweep(
        "a",
        axes,
        0,
        None,
        {"load": "N.m"},
        points,
        [],
        requirements={"light": Requirement(number="load", max=4.0)},
        titles={"load": "Load"},
        axis_titles={name: (name, "") for name in axes},
    )


def test_a_sweep_with_draws_has_their_medians():
    result = sweep(NAME, {"manager.gain": [5e-3]}, SHORT, 1, draws=2, seed=3)
    options = Options(blocks=True, stop=100.0, values={"manager.gain": 5e-3})
    assert result.points[0].summary == draws(NAME, 2, 3, options, 1).summary


def test_axes():
    assert axes_of(["a.b=1,2.5,x"]) == {"a.b": [1, 2.5, "x"]}
    assert axes_of(["a.b=1,0,0;0,1,0"]) == {"a.b": [[1, 0, 0], [0, 1, 0]]}
    for text in ("a.b", "a.b=", "ab=1", "a.b=1,,2"):
        with pytest.raises(DesatError, match=r"the form is component\.parameter=a,b,c"):
            axes_of([text])


@pytest.mark.parametrize(
    ("axis", "message"),
    [
        ({"manger.gain": [1.0]}, "no component manger; did you mean manager?"),
        ({"manager.gan": [1.0]}, "manager has no variable gan; did you mean gain?"),
        ({"manager.gain": [1.0, -1.0]}, r"gain = -1.* allowed is"),
        ({"manager.gain": ["x"]}, "x"),
    ],
)
def test_what_a_sweep_refuses(axis, message):
    with pytest.raises(DesatError, match=message) as error:
        sweep(NAME, axis, SHORT, 1)
    assert len(str(error.value).splitlines()) == 1


def test_a_drawn_parameter_is_no_axis_of_draws():
    (name,) = common(Cases(read(NAME)), Cases(read(NAME)), 1, SHORT, SHORT)[
        "drawn_in_both"
    ][:1]
    with pytest.raises(DesatError, match=f"{name} is sampled"):
        sweep(NAME, {name: [1.0]}, SHORT, 1, draws=2)
    options = draws(NAME, 1, 1, Options(blocks=True, stop=10.0, sets=[f"{name}=1"]), 1)
    assert (
        f"--set {name}: it is sampled, and so never has this value" in options.warnings
    )


def test_commands(desat):
    short = ("--blocks", "--stop", "20", "--jobs", "1")
    other = "integrated/mil-cross-product"
    done = desat("compare", NAME, other, "-n", "1", *short, "--json", check=True)
    assert json.loads(done.stdout)["numbers"]["coil_load"]["n"] == 1
    gone = desat("draws", NAME, "-n", "3")
    assert "desat campaign NAME -n COUNT makes them, the same of a seed" in gone.stderr
    shown = desat("sweep", NAME, "manager.gain=1e-3,2e-3", *short, check=True).stdout
    assert "0.002" in shown
    assert "coil_load" in shown
    wrong = desat("sweep", NAME, "manager.gan=1", *short)
    assert wrong.returncode == 2
    assert len(wrong.stderr.splitlines()) == 1


def test_definitions_that_differ_in_their_baseline_are_one():
    definitions = module_of("desat.papers.tables").definitions

    texts = [*(f"Saved (ratio of t to that of a-{i})" for i in (1, 2)), "Time (last)"]
    assert definitions(texts) == [
        "Saved (ratio of t to that of a-1, a-2, row by row)",
        texts[2],
    ]
    assert definitions(texts[1:]) == texts[1:]
