"""A time that a run does not reach is "not reached" everywhere, with its share."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

from benchmarks.pages.sources import Sources
from benchmarks.pages.verbs import Verbs
from desat.campaign import report
from desat.campaign.draws import draws
from desat.campaign.spread import spreads
from desat.files.scenario import find
from desat.numbers import measures
from desat.numbers.numbers import late
from desat.papers import comparison, stored
from desat.runs.run import Options, execute

COMMON = """
extends = "hausat2/detumbling-b-dot"
stop = 1200.0
samples = 4
"""
NEVER = f"{COMMON}parameters.manager.rate_limit = 1e-9\n"
# two of the four draws of seed 1 are below this within 5 min
SOME = COMMON.replace("1200", "300") + "parameters.manager.rate_limit = 0.075\n"


@pytest.fixture
def own_scenario(tmp_path):
    """Write a scenario of one's own; its path."""

    def write(text: str) -> str:
        path = tmp_path / "own.toml"
        path.write_text(text)
        return str(path)

    return write


def test_a_run_that_never_slows_says_so(desat, own_scenario, tmp_path):
    run = execute(own_scenario(NEVER), Options(blocks=True))
    assert run.manifest["numbers"]["detumbled"]["value"] is None
    outcome = desat(
        "run",
        own_scenario(NEVER),
        "--blocks",
        "--out",
        str(tmp_path / "run"),
        check=True,
    ).stdout
    assert re.search(r"below 0.003 rad/s at once .*not reached", outcome), outcome


def test_cases_that_never_slow_say_so_with_their_share(desat, own_scenario, tmp_path):
    outcome = desat(
        "campaign",
        own_scenario(NEVER),
        "-n",
        "4",
        "--blocks",
        "--jobs",
        "1",
        "--all",
        cwd=tmp_path,
        check=True,
    ).stdout
    line = next(x for x in outcome.splitlines() if "4 of 4 (100 %)" in x)
    assert line.count("not reached") == 5, "median, shares, and the ends"
    assert "20.00" not in line


def test_some_that_are_not_reached_are_later_than_all_others(own_scenario):
    answer = draws(own_scenario(SOME), 4, 1, Options(blocks=True), jobs=1).to_json()
    each = [row["numbers"]["detumbled"] for row in answer["draws"]]
    there = sorted(x for x in each if x is not None)
    assert 0 < len(there) < 4
    entry = answer["summary"]["detumbled"]
    assert (entry["n"], entry["not_reached"]) == (len(there), 4 - len(there))
    assert entry["min"] == there[0]
    assert entry["max"] is None, "the slowest of all is not there"
    ranks = [*there, *[math.inf] * (4 - len(there))]
    middle = (ranks[1] + ranks[2]) / 2.0
    assert entry["median"] == (None if math.isinf(middle) else middle)


def test_a_sweep_has_the_share(desat, own_scenario):
    outcome = desat(
        "sweep",
        own_scenario(COMMON),
        "manager.rate_limit=1e-9,0.14",
        "--samples",
        "4",
        "--blocks",
        "--jobs",
        "1",
        check=True,
    ).stdout
    row = next(
        x for x in outcome.splitlines() if x.startswith("detumbled") or "detumbled" in x
    )
    assert "not reached (not reached: 4 of 4 (100 %))" in outcome, outcome
    assert row.count("4 of 4") <= 1


def test_every_measure_of_a_time_is_late():
    """By its sentence: a measure that says when something is has no number where it
    never is."""
    moment = {
        n
        for n, m in measures.MEASURES.items()
        if re.match(r"(When|After how)", m.__doc__)
    }
    assert moment == measures.LATE


def test_medians_rank_what_is_not_reached():
    rows = [{"t": x, "y": x} for x in (3.0, None, 1.0, None, 2.0)]
    results = {
        n: x.to_json() for n, x in spreads(rows, {"t": "s", "y": "s"}, {"t"}).items()
    }
    assert results["t"] == {
        "unit": "s",
        "median": 3.0,
        "low": 1.0,
        "high": None,
        "min": 1.0,
        "max": None,
        "n": 3,
        "not_reached": 2,
    }
    assert (results["y"]["median"], results["y"]["max"]) == (2.0, 3.0), (
        "no time: of those that have it"
    )
    divergent_rows = [{"y": math.inf}] * 3
    assert spreads(divergent_rows, {"y": "s"}, set())["y"].levels["max"] == math.inf


def test_percentiles_of_a_campaign_rank_it_too():
    values, cases = np.array([4.0, np.nan, 2.0, 3.0, np.nan, 1.0]), np.arange(10, 16)
    answer = report._number("t", {}, values, cases, True).to_json()
    assert (answer["min"], answer["min_case"], answer["n"], answer["not_reached"]) == (
        1.0,
        15,
        4,
        2,
    )
    assert answer["median"] == 3.5
    assert (answer["p95"], answer["p99"], answer["max"], answer["max_case"]) == (
        None,
        None,
        None,
        11,
    )
    answer = report._number("y", {}, values, cases, False).to_json()
    assert (answer["median"], answer["max"], answer["max_case"]) == (2.5, 4.0, 10)


def test_a_row_of_a_table_is_not_within_where_a_draw_never_gets_there():
    scenario = find("integrated/mil-fast")
    entry_of_draws = stored.read("integrated")["scenarios"][scenario.name]
    values = {
        name: entry.levels["median"]
        for name, entry in entry_of_draws["summary"].items()
    }
    rows = {
        r.quantity: r for r in comparison.rows_of(scenario, values, {}, entry_of_draws)
    }
    row = rows["time_to_dump_build_up"]
    never = sum(d.numbers["dumped"] is None for d in entry_of_draws["draws"])
    assert never == 88
    assert row.draws.max is None
    assert row.within is False
    assert rows["samples_never_dumped"].ours == pytest.approx(100.0 * never / 200)


def test_stored_draws_have_no_end_of_a_run_for_a_time():
    for family in ("alsat1", "hausat2", "integrated", "space_telescope"):
        for name, entry_of_draws in stored.read(family)["scenarios"].items():
            scenario = find(name)
            for number in late(scenario.content):
                entry = scenario.content.numbers[number]
                if (
                    entry.unit not in ("s", "min")
                    or number not in entry_of_draws["units"]
                ):
                    continue
                scale = 60.0 if entry.unit == "min" else 1.0
                values = [d.numbers[number] for d in entry_of_draws["draws"]]
                end = scenario.content.stop / scale
                assert all(x is None or x < end for x in values), f"{name}: {number}"


def test_pages_say_not_reached():
    of = Verbs(Sources("hausat2", [], 1, draft=60.0))
    assert of.spread("gain-k-1e5", "detumbled") == "270.3 [128.0, 299.7], 225 of 400"
    assert of.spread("sample-time-10-wheel", "detumbled") == "none of 200"
    assert of.share("gain-k-1e5", "detumbled", least=200.0).startswith("206 of 400")
