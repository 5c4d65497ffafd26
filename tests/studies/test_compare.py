"""`desat compare`: runs side by side, draws and campaigns in pairs."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from desat import compare as compare_laws
from desat.analyses.motion import period_of
from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.campaign import pairs
from desat.campaign.draws import draws
from desat.campaign.pairs import differences, each_draw
from desat.campaign.sampling import draw_of
from desat.figures.plots import series_figure
from desat.figures.style import COLOURS
from desat.files import paths
from desat.numbers.text import Value
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import prepare, read
from desat.runs.run import execute
from desat.studies import compare
from desat.studies.criteria import half_full
from desat.system.errors import Exit
from desat.system.options import Options


@pytest.fixture(scope="module")
def craft(tmp_path_factory):
    """A craft's folder `mine`, with a scenario that has half of the gain, and the
    folder around."""
    home = tmp_path_factory.mktemp("compare")
    new_craft.write(
        home / "mine", CraftFacts(size="12U", residual_dipole="0.09"), "desat new craft"
    )
    (home / "mine" / "slow.toml").write_text(
        'extends = "nominal"\nparameters.manager.gain = 2e-4\nparameters.manager.null_gain = 0.0\n'
    )
    (home / "mine" / "tight.toml").write_text(
        'extends = "nominal"\nstop = 300.0\n'
        '[requirements.momentum]\nnumber = "largest_momentum"\nmax = 1e-3\n'
    )
    return home


def table(text, heading):
    (line,) = [x for x in text.splitlines() if x.startswith(heading)]
    return line.removeprefix(heading).split()


def test_runs_stand_side_by_side_with_their_differences(desat, craft):
    """A scenario that flies now, a run folder, and one more: one table, one page."""
    desat(
        "run", "mine/slow.toml", "--stop", "300", "--out", "slow", cwd=craft, check=True
    )
    outcome = desat(
        "compare",
        "mine",
        "slow",
        "mine/tight.toml",
        "--stop",
        "300",
        "--json",
        cwd=craft,
    )
    assert outcome.returncode == Exit.UNMET
    assert "mine/tight.toml: not met: momentum" in outcome.stderr
    answer = json.loads(outcome.stdout)
    assert answer["targets"] == ["mine", "slow", "mine/tight.toml"]
    entry = answer["numbers"]["final_momentum"]
    number_of_run = json.loads((craft / "slow" / "manifest.json").read_text())[
        "numbers"
    ]["final_momentum"]
    assert entry["values"]["slow"] == number_of_run["value"]
    assert entry["differences"] == {
        t: pytest.approx(entry["values"]["mine"] - entry["values"][t], rel=1e-12)
        for t in answer["targets"][1:]
    }
    page = (craft / answer["page"]).read_text()
    assert "Wheel momentum" in page
    assert page.count("<svg") == 6, "each plot of the first"
    assert all(colour in page for colour in COLOURS[:3]), "a colour a run"
    command = desat(
        "compare", "mine", "slow", "--stop", "300", "--html", "a.html", cwd=craft
    )
    assert command.returncode == 0
    cells = table(command.stdout, "Total wheel momentum at the end (body frame)")
    values = [
        entry["values"]["mine"],
        entry["values"]["slow"],
        entry["differences"]["slow"],
    ]
    assert [1e-3 * float(x) for x in cells[:3]] == pytest.approx(values, rel=1e-3)
    assert cells[3:] == ["uN", "m", "s"]
    assert (craft / "a.html").is_file()


def test_runs_of_other_length_are_warned_of(desat, craft):
    desat("run", "mine", "--stop", "120", "--out", "short", cwd=craft, check=True)
    outcome = desat("compare", "mine", "short", "--stop", "60", cwd=craft)
    assert "warning: mine ends at 60 s, short at 120 s" in outcome.stderr


@pytest.mark.study
def test_draws_are_compared_in_pairs(desat, craft):
    """The same as of the draws of both, flown one by one."""
    inputs = ["-n", "7", "--stop", "100", "--json", "--jobs", "1"]
    outcome = desat("compare", "mine", "mine/slow.toml", *inputs, cwd=craft, check=True)
    answer = json.loads(outcome.stdout)
    one, two = (
        draws(str(craft / x), 7, 1, Options(stop=100.0), jobs=1)
        for x in ("mine", "mine/slow.toml")
    )
    before = {n: x.to_json() for n, x in differences(one, two).items()}
    assert answer["pairs"] == 7
    assert answer["numbers"].keys() == before.keys()
    for name, entry in answer["numbers"].items():
        for key in (
            "median",
            "min",
            "max",
            "n",
            "lower",
            "higher",
            "equal",
            "not_reached",
        ):
            assert entry[key] == before[name][key]
    entry = answer["numbers"]["final_momentum"]
    each = each_draw(one.rows, two.rows, "final_momentum").values()
    assert entry["interval"] == [min(each), max(each)], "98 % with seven pairs"
    assert entry["share_lower"] == pytest.approx(100.0 * sum(x < 0.0 for x in each) / 7)


def test_campaigns_are_compared(desat, craft):
    for name, target in (("one", "mine"), ("two", "mine/slow.toml")):
        desat(
            "campaign",
            target,
            "-n",
            "3",
            "--stop",
            "60",
            "--out",
            name,
            "--jobs",
            "1",
            cwd=craft,
        )
    outcome = desat("compare", "one", "two", "--json", cwd=craft, check=True)
    assert json.loads(outcome.stdout)["pairs"] == 3
    for arguments, text in (
        (
            ["mine"],
            "one is a campaign, mine is none: campaigns compare with campaigns alone",
        ),
        (["two", "-n", "3"], "-n: campaigns are compared as they are"),
        (
            ["two", "--html", "a.html"],
            "--html: only comparisons of runs, without -n, have a page",
        ),
    ):
        refusal = desat("compare", "one", *arguments, cwd=craft)
        assert refusal.returncode == Exit.INPUT
        assert text in refusal.stderr


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["mine"], "mine: two or more are needed to compare"),
        (["mine", "mine/slow.toml", "mine"], "mine: it is there twice"),
        (["mine", "min"], "min"),
        (["mine", "mine/detumbling.toml", "--set", "manager.null_gain=1"], "null_gain"),
    ],
)
def test_what_cannot_be_compared(desat, craft, arguments, text):
    refusal = desat("compare", *arguments, "--stop", "60", cwd=craft)
    assert refusal.returncode == Exit.INPUT
    assert text in refusal.stderr
    assert "Traceback" not in refusal.stderr


def test_a_run_has_nothing_to_draw(desat, craft):
    desat("run", "mine", "--stop", "20", "--out", "drawn", cwd=craft, check=True)
    refusal = desat("compare", "mine", "drawn", "-n", "3", cwd=craft)
    assert refusal.returncode == Exit.INPUT
    assert "drawn: a run cannot be sampled" in refusal.stderr


def test_numbers_are_compared_in_the_unit_of_the_first_run():
    class Answer:
        def __init__(self, **numbers):
            self.manifest = type("M", (), {"numbers": numbers})

    rows = compare.rows_of(
        [
            Answer(
                a=Value("A", 1.0, "m"),
                b=Value("B", None, "s"),
                c=Value("C", 3.0, "1"),
                d=Value("D", 40.0, "%"),
                e=Value("E", 1.0, "s"),
                f=Value("F", 90.0, "deg"),
            ),
            Answer(
                a=Value("A", 2.0, "km"),
                b=Value("B", 2.0, "min"),
                c=Value("C", 3.0 + 1e-15, "1"),
                d=Value("D", 0.5, "1"),
                e=Value("E", 2.0, "N.m.s"),
                f=Value("F", math.pi / 4.0, "rad"),
            ),
        ]
    )
    assert list(rows) == ["a", "b", "c", "d", "d (1)", "e", "e (N.m.s)", "f"]
    assert rows["a"].row == ["A", 1.0, 2000.0, -1999.0, "m"]
    assert rows["b"].row == ["B", "not reached", 120.0, None, "s"]
    assert rows["c"].differences == (0.0,), "equal but for rounding"
    assert rows["d"].row == ["D", 40.0, None, None, "%"], "of what, is not known"
    assert rows["d (1)"].row == ["D", None, 0.5, None, "1"]
    assert rows["e (N.m.s)"].row == ["E", None, 2.0, None, "N.m.s"]
    assert rows["f"].row == ["F", 90.0, pytest.approx(45.0), pytest.approx(45.0), "deg"]


@pytest.mark.parametrize("scenario", ["detumbling", "rollout"])
def test_laws_that_hold_wheels_are_not_compared_with_one_that_brakes(
    desat, craft, scenario
):
    refusal = desat("compare", f"mine/{scenario}.toml", "--laws", "all", cwd=craft)
    assert refusal.returncode == Exit.INPUT
    assert "brakes a tumbling craft" in refusal.stderr
    both = desat("compare", "mine/detumbling.toml", "mine/rollout.toml", cwd=craft)
    detumbling_row = table(
        both.stdout, "Detumbled: every rate below 0.3 deg/s for 10 min"
    )
    b_dot, rollout, less, unit = detumbling_row
    assert float(less) == pytest.approx(float(b_dot) - float(rollout), rel=1e-3)
    assert unit == "min"


def test_no_differences_have_no_interval():
    assert pairs.confident([]).n == 0
    assert "interval" not in pairs.confident([]).to_json()


# --- law by law -----------------------------------------------------------------------

IDLE = '''
from __future__ import annotations

from desat.components.bases.dumping import TorquerDumping
from desat.components.contract.block import Vec3


class Nothing(TorquerDumping):
    """It commands nothing"""

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        return None
'''


@pytest.fixture
def laws(desat, craft, stored_values={}):  # noqa: B006 (once for all tests of the module)
    """`mine` flown law by law for ten minutes, with two laws of the user's own."""
    if stored_values:
        return stored_values["laws"]
    desat("new", "law", "my_law", cwd=craft, check=True)
    (craft / "idle.py").write_text(IDLE)
    fmu = str(paths.fmus() / "native" / "manager_closed_loop.fmu")
    mine = [x for file in ("my_law.py", "idle.py", fmu) for x in ("--law", file)]
    stored_values["laws"] = desat(
        "compare",
        "mine",
        "--laws",
        "ccpl,predictive,combined",
        *mine,
        "--stop",
        "600",
        "--by",
        "peak,duty,energy,pointing",
        "--json",
        cwd=craft,
        check=True,
    )
    return stored_values["laws"]


def test_a_craft_is_flown_with_each_law_that_fits(laws, craft):
    answer = json.loads(laws.stdout)
    by_name = {law["name"]: law for law in answer["laws"]}
    assert by_name.keys() == {
        "cross product",
        "ccpl",
        "predictive",
        "my law",
        "manager closed loop",
    }
    assert [law["values"]["peak"] for law in answer["laws"]] == sorted(
        law["values"]["peak"] for law in answer["laws"]
    )
    assert by_name["cross product"]["own"]
    assert by_name["my law"]["gains"]["gain"].startswith("craft.rate = ")
    own_value = by_name["cross product"]["values"]
    assert by_name["my law"]["values"]["peak"] == pytest.approx(
        own_value["peak"], rel=1e-6
    ), "the same law at the same rate"
    assert by_name["predictive"]["values"]["peak"] != own_value["peak"]
    reason = {r["name"]: r["why"] for r in answer["refused"]}
    assert reason["combined"].startswith("it needs thrusters")
    assert reason["idle"] == "it flew, and commanded neither dipole nor thrusters"
    page = (craft / answer["page"]).read_text()
    assert page.count("<svg") == 3 + 6, (
        "the first criterion over each other, and each plot"
    )
    assert "does not take" not in laws.stderr, "what the own manager had is no matter"
    assert answer["comparison"]["targets"][0] == "cross product"


def test_numbers_of_laws_are_those_of_their_runs(laws, craft, desat):
    """What `compare` says of a law is what `run` says with the manager and gains that
    it names."""
    answer = json.loads(laws.stdout)
    (ccpl,) = [law for law in answer["laws"] if law["name"] == "ccpl"]
    sets = [x for k, v in ccpl["set"].items() for x in ("--set", f"{k}={v}")]
    outcome = desat(
        "run", "mine", "--stop", "600", "--json", *sets, cwd=craft, check=True
    )
    numbers = json.loads(outcome.stdout)["numbers"]
    assert ccpl["values"]["duty"] == numbers["coil_duty"]["value"]
    assert ccpl["values"]["peak"] == pytest.approx(
        100.0 - numbers["momentum_margin"]["value"]
    )
    last = answer["comparison"]["numbers"]["final_momentum"]["values"]["ccpl"]
    assert last == numbers["final_momentum"]["value"]


def test_who_beats_whom():
    from desat.studies.criteria import beats

    assert beats((1.0, 2.0), (1.0, 3.0))
    assert not beats((1.0, 2.0), (1.0, 2.0))
    assert not beats((1.0, 4.0), (2.0, 3.0))
    unknown, never = math.nan, math.inf
    assert beats((1.0, unknown), (2.0, 1.0)), "what is not known does not count"
    assert not beats((1.0, unknown), (1.0, 3.0))
    assert beats((1.0, 5.0), (1.0, never)), "what is not reached is the worst"


def test_values_within_two_per_cent_are_as_good_as_each_other():
    from desat.studies.criteria import beats

    assert not beats((0.0202186, 1.0), (0.0202207, 1.0))
    assert beats((0.0202186, 0.9), (0.0202207, 1.0))
    assert beats((1.01, 0.9), (1.0, 1.0)), "1 % more does not save it"
    assert not beats((1.03, 0.9), (1.0, 1.0))


@pytest.fixture(scope="module")
def orbits(tmp_path_factory):
    """A 12U flown law by law for two orbits and a half."""
    folder = tmp_path_factory.mktemp("laws") / "u12"
    new_craft.write(folder, CraftFacts(size="12U", rods="0.2"), "desat new craft")
    return folder, compare_laws(
        str(folder), laws=["cross product", "predictive"], stop=14000.0
    )


@pytest.mark.slow
def test_the_time_to_empty_does_not_depend_on_the_other_laws(orbits):
    folder, ranking = orbits
    k = [c.name for c in ranking.by].index("emptying")
    times = {e.name: e.values[k] for e in ranking.ranked}
    alone = compare_laws(str(folder), laws=["ccpl"], by="emptying", stop=14000.0)
    (time,) = [e.values[0] for e in alone.ranked if e.law.is_own]
    assert time == pytest.approx(times["cross product"], rel=1e-12)
    assert "empty: every wheel below 10 % of its capacity" in ranking.notes


def test_a_ranking_is_measured_from_the_end_of_the_first_orbit(orbits):
    """The start is not among the numbers, and the run says from when they are."""
    _, ranking = orbits
    own_law = next(e for e in ranking.ranked if e.law.is_own)
    run = ranking.comparison.runs[0]
    h, times = run.results.values("wheels.h_wheel"), run.results.times()
    r, v = (run.results.values(f"environment.{x}_eci")[0] for x in "rv")
    first = period_of(r, v)
    assert ranking.notes[0] == (
        f"measured from the end of the first orbit on, t = {first:.0f} s"
    )
    wheels = run.manifest.values_of("wheels")
    capacity = wheels["inertia_wheel"][0] * wheels["speed_limit"]
    by_name = dict(zip((c.name for c in ranking.by), own_law.values, strict=True))
    late = np.abs(h[times >= first]).max() / capacity
    assert by_name["peak"] == pytest.approx(100.0 * late)
    spent = run.results.values("torquers.electric_energy")
    later = run.results.times("torquers.electric_energy") >= first
    assert by_name["energy"] == pytest.approx(spent[-1] - spent[later][0])


def test_half_full_wheels_are_emptied_in_a_flight_of_their_own(orbits):
    folder, ranking = orbits
    own_law = next(e for e in ranking.ranked if e.law.is_own)
    by_name = dict(zip((c.name for c in ranking.by), own_law.values, strict=True))
    (line,) = [x for x in ranking.notes if x.startswith("empty:")]
    level = float(line.split()[4])
    system, _ = prepare(str(folder), Options()).or_raise()
    start = half_full(system)
    run = execute(
        str(folder), Options(stop=14000.0, values={"wheels.h_start_wheel": start})
    )
    wheels = run.manifest.values_of("wheels")
    capacity = wheels["inertia_wheel"][0] * wheels["speed_limit"]
    fill = 100.0 * np.abs(run.results.values("wheels.h_wheel")).max(axis=1) / capacity
    assert fill[0] == pytest.approx(50.0)
    first = run.results.times()[fill <= level][0]
    assert by_name["emptying"] == pytest.approx(first / 60.0)


def test_where_all_laws_do_the_plainest_is_named(orbits):
    """`torquer` is found by the model or by flights, and its day is said."""
    _, ranking = orbits
    assert ranking.plainest.name == "cross product"
    assert "leave three quarters of the wheels free; the plainest is cross product" in (
        ranking.answer
    )
    k = [c.name for c in ranking.by].index("torquer")
    values = {e.name: e.values[k] for e in ranking.ranked}
    assert 0.0 < values["cross product"] < 0.2
    assert 0.3 < values["predictive"] / values["cross product"] < 1.1
    assert (
        "least torquer of predictive: by flights of that day, to 10 %" in ranking.notes
    )
    (line,) = [x for x in ranking.notes if x.startswith("the worst day is ")]
    assert line.endswith("the model of `desat size` has all laws but predictive")
    full = replace(ranking.ranked[0], values=(60.0, *ranking.ranked[0].values[1:]))
    assert replace(ranking, ranked=(full, *ranking.ranked[1:])).plainest is None


@pytest.mark.study
def test_laws_are_ranked_over_samples(orbits, desat):
    """Numbers of a sample are those of the run with its values."""
    folder, _ = orbits
    options = ("--laws", "ccpl", "--by", "peak,emptying", "--stop", "1500", "--json")
    command = desat(
        "compare",
        folder.name,
        "-n",
        "3",
        "--jobs",
        "1",
        *options,
        cwd=folder.parent,
        check=True,
    )
    answer = json.loads(command.stdout)
    assert (answer["samples"], answer["seed"]) == (3, 1)
    assert [law["failed"] for law in answer["laws"]] == [0, 0]
    source = read(str(folder))
    peaks = []
    for k in range(3):
        values = draw_of(draft_to_draw(source, False), 1, k)
        run = execute(str(folder), Options(stop=1500.0, values=values))
        peaks.append(100.0 - run.manifest.numbers["momentum_margin"].value)
    (first,) = [law for law in answer["laws"] if law["own"]]
    peak = first["criteria"]["peak"]
    assert peak["n"] == 3
    assert peak["median"] == pytest.approx(sorted(peaks)[1], rel=1e-6)


def test_a_law_of_ones_own_is_ranked_by_its_source(desat, craft):
    desat("new", "law", "theirs", cwd=craft, check=True)
    options = ("--laws", "ccpl", "--by", "peak", "--stop", "600", "--json")
    command = desat(
        "compare",
        "mine",
        "--source",
        "manager=theirs.py",
        *options,
        cwd=craft,
        check=True,
    )
    laws = {law["name"]: law["own"] for law in json.loads(command.stdout)["laws"]}
    assert laws == {"theirs": True, "ccpl": False}


@pytest.mark.parametrize(
    ("values", "line"),
    [
        (
            ["mine", "--laws", "predictve"],
            "predictve: no law and no manager; did you mean",
        ),
        (
            ["mine", "--laws", "all", "--by", "paek"],
            "--by paek: no paek; did you mean peak?",
        ),
        (["mine", "slow", "--laws", "all"], "mine slow: --laws flies one craft"),
        (["mine", "slow", "--by", "peak"], "--by: it ranks laws: --laws all"),
        (
            ["mine", "--laws", "ccpl", "--by", "firing", "--stop", "60"],
            "mine: --by firing: the firing time is not available for it",
        ),
        (["mine", "--law", "nowhere.py", "--stop", "60"], "nowhere.py: No such file"),
        (
            ["mine", "--laws", "all", "-n", "5", "--by", "torquer"],
            "--by torquer: the least torquer is found once for a craft",
        ),
        (
            ["mine", "--laws", "all", "-n", "5", "--html", "x.html"],
            "--html: only a ranking of one run each, without -n, has a page",
        ),
    ],
)
def test_wrong_choices_are_refused_in_a_line(desat, craft, values, line):
    outcome = desat("compare", *values, cwd=craft)
    assert outcome.returncode == Exit.INPUT
    assert line in outcome.stderr
    assert "Traceback" not in outcome.stderr


def test_two_runs_end_with_a_sentence_that_says_what_differs(desat, craft):
    """A parameter, a law, a step; equal runs; and nothing for three."""

    def sentence(*arguments):
        command = desat("compare", *arguments, "--stop", "600", "--json", cwd=craft)
        return json.loads(command.stdout)["difference"]

    text = sentence("mine", "mine/slow.toml")
    assert text.startswith("mine and mine-slow differ in manager.")
    assert "manager.gain (0.001107 and 2.000e-04 1/s)" in text
    assert "manager.null_gain (0.001107 and 0 1/s)" in text
    (craft / "mine" / "same.toml").write_text('extends = "nominal"\n')
    text = sentence("mine", "mine/same.toml")
    assert "are alike" in text
    assert text.endswith("no number of a requirement differs by 1 %.")
    assert sentence("mine", "mine/slow.toml", "mine/same.toml") == ""


def test_other_blocks_and_settings_are_among_what_differs(craft):
    target = str(craft / "mine" / "nominal.toml")
    run = compare.side_by_side([target, target], Options(stop=60.0)).runs[0]
    fmus = {
        **run.manifest.fmus,
        "manager": {"source": "resources/manager_b_dot.fmu", "sha256": ""},
        "extra": {"source": "gain.fmu", "sha256": ""},
    }
    other = replace(run.manifest, fmus=fmus, step=2.0, substeps=4)
    assert compare._causes(run.manifest, other) == [
        "step (1 s and 2 s)",
        "substeps (1 and 4)",
        "manager (manager_cross_product and manager_b_dot)",
        "extra (absent and gain)",
    ]


def test_more_than_two_runs_have_a_line_and_a_dash_each(craft):
    targets = [str(craft / "mine" / f"{n}.toml") for n in ("nominal", "slow", "worst")]
    comparison = compare.side_by_side(targets, Options(stop=60.0))
    plot = comparison.runs[0].manifest.content.plots["momentum"]
    runs = [
        (str(k), r.results, r.manifest.parameters)
        for k, r in enumerate(comparison.runs)
    ]
    (ax,) = series_figure(plot, runs).axes
    lines = [m for m in ax.marks if m.label in "012" and m.label]
    assert [m.label for m in lines] == ["0", "1", "2"]
    assert len({(m.colour, m.dash) for m in lines}) == 3
    assert len({m.dash for m in lines}) == 3
    assert ax.y.label.startswith("largest")
    h = comparison.runs[1].results.values("wheels.h_wheel")
    assert lines[1].y == pytest.approx(1e3 * np.abs(h).max(axis=1), rel=1e-12)
