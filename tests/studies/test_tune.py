"""`desat tune`: the best value over draws, judged by draws that it was not made with."""

from __future__ import annotations

import json
import math
import random

import pytest

from desat.begin import craft as new_craft
from desat.begin.facts import CraftFacts
from desat.campaign.draws import RunRow, draws
from desat.runs.prepare import read
from desat.runs.run import Options
from desat.studies import tune as study
from desat.system.errors import DesatError, Exit


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tune")
    new_craft.write(folder / "mine", CraftFacts(size="12U"), "desat new craft")
    return folder


@pytest.fixture
def model(home, monkeypatch):
    """Runs whose number is a function of gain and draw, `of(gain, error of the draw)`."""
    monkeypatch.chdir(home)
    requests: list[tuple[float, int]] = []

    def use(of, is_missed=lambda gain: False):
        def rows(tasks, jobs, title, progress, *baseline_rows, runner):
            results = []
            for _, options, _seed, draw in tasks:
                gain = options.values["manager.gain"]
                requests.append((gain, draw))
                value = of(gain, random.Random(draw).uniform(-1.0, 1.0))
                numbers = {
                    "final_momentum": value,
                    "pointing": 9.0 if is_missed(gain) else 0.1,
                    "largest_momentum": 10.0,
                    "coil_duty": 10.0,
                }
                results.append(
                    RunRow(
                        "completed",
                        0,
                        "",
                        numbers=numbers,
                        number=draw,
                        described={"final_momentum": {"unit": "mN.m.s"}},
                    )
                )
            return results

        monkeypatch.setattr(study, "rows_of", rows)
        return requests

    return use


def bowl(gain, error, best=4e-4):
    return 1.0 + math.log(gain / best) ** 2 + 0.01 * error


def test_the_least_of_a_bowl_is_found_and_confirmed(model):
    requests = model(bowl)
    tuning_value = study.tune(
        "mine", "manager.gain", "final_momentum", Options(), draws=5, unseen=12
    )
    assert tuning_value.best == pytest.approx(4e-4, rel=0.1)
    assert tuning_value.confirmed
    assert "better in 12" in tuning_value.answer
    tuning = {
        draw
        for gain, draw in requests
        if gain not in (tuning_value.own, tuning_value.best)
    }
    judging = {draw for _, draw in requests} - tuning
    assert (tuning, judging) == (set(range(5)), set(range(5, 17)))
    assert len({gain for gain, _ in requests}) <= study.LOOKED_AT + 1 + study.REFINED


def test_the_most_is_found(model):
    model(lambda gain, error: -bowl(gain, error))
    tuning = study.tune(
        "mine",
        "manager.gain",
        "final_momentum",
        Options(),
        most=True,
        draws=3,
        unseen=8,
    )
    assert tuning.best == pytest.approx(4e-4, rel=0.1)
    assert tuning.confirmed


def test_what_only_tuning_draws_like_is_not_confirmed(model):
    """Luck of the draws: the number hangs on the draw alone, but for the draws of the
    tuning."""
    errors = {random.Random(i).uniform(-1.0, 1.0) for i in range(4)}

    def lucky(gain, error):
        return (
            bowl(gain, 0.0)
            if error in errors
            else 1.0 + 1e-3 * error * math.sin(1e6 * gain)
        )

    model(lucky)
    tuning = study.tune(
        "mine", "manager.gain", "final_momentum", Options(), draws=4, unseen=16
    )
    assert tuning.best == pytest.approx(4e-4, rel=0.1)
    assert not tuning.confirmed
    assert tuning.answer.endswith("that is not confirmed.")


def test_a_requirement_is_not_given_up_for_a_number(model):
    model(bowl, is_missed=lambda gain: gain < 6e-4)
    tuning = study.tune(
        "mine", "manager.gain", "final_momentum", Options(), draws=3, unseen=8
    )
    assert 6e-4 <= tuning.best < tuning.own
    assert all(p.missed == 3 for p in tuning.points if p.value < 6e-4)


def test_what_the_craft_has_may_be_the_best(model):
    model(lambda gain, error: 1.0 + 1e-5 * math.log(gain))
    tuning = study.tune(
        "mine", "manager.gain", "final_momentum", Options(), draws=2, unseen=6
    )
    assert tuning.best == tuning.own
    assert not tuning.confirmed
    assert tuning.answer.endswith("is the best of its range already.")


def make_tuning(best=2.0, **message):
    """A result over four values, 2 the craft's own plus what was found."""
    unseen = {
        "interval_holds": True,
        "interval": (0.1, 0.4),
        "n": 8,
        "lower": 1,
        "higher": 7,
        "median_own": 2.0,
        "median_best": 1.0,
        "missed_own": 2,
        "missed_best": 2,
        **message,
    }
    points = tuple(study.Point(x, x, 0) for x in (1.0, 2.0, 3.0, 4.0))
    most = unseen.pop("most", False)
    return study.Tuned(
        "t",
        "c.p",
        "s",
        "n",
        "",
        most,
        5.0,
        best,
        (1.0, 4.0),
        8,
        points,
        study.Unseen(**unseen),
    )


def test_the_edge_of_the_range_is_its_first_or_last_value_alone(model):
    results = {x: make_tuning(x).answer for x in (1.0, 2.0, 3.0, 4.0)}
    assert [
        x for x, text in results.items() if ", at the edge of its range." in text
    ] == [
        1.0,
        4.0,
    ]
    ends = (
        1e-4,
        1e-3,
    )  # of a range that the craft's own value is not in: it is no end of it
    for best, range_ in ((1e-3, ends), (1e-4, (1e-4, 1e-2)), (1e-2, (1e-4, 1e-2))):
        model(lambda gain, error, best=best: bowl(gain, error, best))
        tuning = study.tune(
            "mine",
            "manager.gain",
            "final_momentum",
            Options(),
            draws=2,
            unseen=6,
            between=range_,
        )
        assert tuning.own == pytest.approx(1.10678e-3)
        assert tuning.best == best
        assert "at the edge of its range" in tuning.answer


def test_what_touches_none_is_not_confirmed():
    """An interval that ends at 0, or one more draw that misses a requirement."""
    assert make_tuning().confirmed
    assert not make_tuning(interval=(0.0, 0.4)).confirmed
    assert not make_tuning(missed_best=3).confirmed
    assert not make_tuning(best=5.0).confirmed
    assert not make_tuning(interval_holds=False).confirmed
    assert make_tuning(most=True, interval=(-0.4, -0.1)).confirmed
    assert not make_tuning(most=True, interval=(-0.4, 0.0)).confirmed
    assert "better in 7;" not in make_tuning().answer
    assert "better in 7" in make_tuning().answer
    assert "better in 1" in make_tuning(most=True).answer


@pytest.mark.parametrize(
    ("parameter", "number", "more", "line"),
    [
        (
            "manager.gian",
            "pointing",
            {},
            "manager.gian: no parameter; did you mean gain?",
        ),
        (
            "manger.gain",
            "pointing",
            {},
            "manger.gain: no component manger; did you mean manager?",
        ),
        ("controller.gain_matrix", "pointing", {}, "an array: exactly one numeric"),
        ("manager.law", "pointing", {}, "manager.law: it is no Real: normalised, ccpl"),
        (
            "environment.mean_anomaly",
            "pointing",
            {},
            "is sampled, and so cannot be tuned",
        ),
        (
            "manager.gain",
            "pionting",
            {},
            "--for pionting: mine has no such number; did you mean",
        ),
        ("manager.h_deadband", "pointing", {}, "a range is needed: --between LOW,HIGH"),
        (
            "manager.gain",
            "pointing",
            {"between": (2.0, 1.0)},
            "the first is to be below",
        ),
        (
            "manager.gain",
            "pointing",
            {"between": (-1.0, 1.0)},
            "-1 is outside [0.0, None]",
        ),
    ],
)
def test_wrong_wishes_are_refused_before_a_run(model, parameter, number, more, line):
    requests = model(bowl)
    with pytest.raises(DesatError) as refusal:
        study.tune("mine", parameter, number, Options(), **more)
    assert line in str(refusal.value)
    assert requests == []


@pytest.mark.study
def test_the_command_flies_and_says_both(desat, home):
    outcome = desat(
        "tune",
        "mine",
        "manager.gain",
        "--for",
        "coil_duty",
        "--stop",
        "60",
        "-n",
        "1",
        "--unseen",
        "6",
        "--jobs",
        "1",
        "--json",
        cwd=home,
    )
    answer = json.loads(outcome.stdout)
    assert outcome.returncode == (Exit.COMPLETED if answer["confirmed"] else Exit.UNMET)
    assert answer["best"] < answer["own"], "smaller gains work the coils less"
    assert answer["unseen"]["n"] == 6
    assert answer["unseen"]["lower"] == 0, "own less best is above zero"
    values = [p["value"] for p in answer["points"]]
    assert values == sorted(values)
    best_gain = [f"manager.gain={answer['best']!r}"]
    again = draws(str(home / "mine"), 1, 1, Options(stop=60.0, sets=best_gain), jobs=1)
    duty = again.rows[0].numbers["coil_duty"]
    (best,) = [p for p in answer["points"] if p["value"] == answer["best"]]
    assert best["median"] == duty


def test_a_gain_has_the_unit_of_the_law_that_flies(home):
    """Of ccpl it is 1/(T s), which is declared with the law."""
    for law, unit in (("normalised", "1/s"), ("ccpl", "1/(T.s)")):
        source = read(str(home / "mine"))
        options = Options(sets=[f"manager.law={law}"])
        assert study._parameter(source, options, "manager.gain")[2] == unit
