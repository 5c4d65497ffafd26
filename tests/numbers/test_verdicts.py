"""What decides a verdict, an exit code or a time: a test for each mutation that
survived."""

from __future__ import annotations

import errno
import inspect
import math
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import beta

from desat import cli
from desat.analyses import residual
from desat.analyses.manifest import Manifest
from desat.campaign import draws as study
from desat.campaign import report
from desat.campaign.judged import CaseVerdict, for_half_the_width, more, requirement
from desat.campaign.spread import Spread
from desat.campaign.store import CaseRow
from desat.engine.checkpoint import newest
from desat.language.content import Content, Entry
from desat.language.scenario import Requirement
from desat.numbers import verdicts
from desat.numbers.statistics import clopper_pearson
from desat.numbers.text import Value
from desat.runs.run import Run, load_run, prepare, simulate
from desat.runs.stopping import LATE, Condition
from desat.system.errors import Exit, RunError, nearest
from desat.system.options import Options
from tests.conftest import module_of
from tests.engine.test_failures import binary, options, ssd, system

comparison = module_of("desat.papers.comparison")

__all__ = ["binary", "system"]  # fixtures


def judged(
    values: list[float], completed: list[bool], **bounds: float
) -> dict[str, object]:
    cases = np.arange(len(values))
    entry = Requirement(number="x", **bounds)
    return requirement(
        entry, {"x": np.array(values)}, np.array(completed), cases, Path("c")
    ).to_json()


def test_a_case_that_failed_is_outside_whatever_its_numbers():
    """A failed row does carry finite numbers: those until it failed."""
    judgement = judged([1.0, 1.0, 1.0], [True, False, True], max=2.0)
    assert (judgement["within"], judgement["outside"], judgement["cases_outside"]) == (
        2,
        1,
        [1],
    )


@pytest.mark.parametrize(
    "bounds", [{"max": 2.0}, {"min": 2.0}, {"min": 2.0, "max": 2.0}]
)
def test_a_number_at_its_limit_is_within(bounds):
    judgement = judged([2.0], [True], **bounds)
    assert (judgement["within"], judgement["outside"]) == (1, 0)


def test_a_bound_that_is_unmet_ends_a_run_with_1(desat, tmp_path):
    for bound, code in ((1e-30, Exit.UNMET), (1.0, Exit.COMPLETED)):
        file = tmp_path / "mine.toml"
        file.write_text(f'extends = "gyrostat/light"\nresidual_bound = {bound}\n')
        out = tmp_path / str(int(code))
        done = desat(
            "run", str(file), "--stop", "20", "--no-baseline", "--out", str(out)
        )
        assert done.returncode == code
        assert ("momentum_residual" in done.stdout + done.stderr) >= (
            code == Exit.UNMET
        )


def test_rows_begin_at_the_start_time(system):
    (system / "SystemStructure.ssd").write_text(ssd(start="5", stop="15"))
    run = simulate(prepare(str(system), options("NOTHING")))
    assert run.results.times().tolist() == [5.0 + k for k in range(11)]


# --- requirements of a campaign -------------------------------------------------------


def test_what_just_shows_a_requirement_shows_it():
    """One case of one, inside: any share within is less than 50 % with 50 % of
    confidence."""
    even = {"max": 2.0, "confidence": 0.5}
    assert judged([1.0], [True], probability=0.5, **even)["met"]
    assert judged([1.0], [True], probability=0.5, **even)["more_cases"] == 0
    above = math.nextafter(0.5, 1.0)
    assert not judged([1.0], [True], probability=above, **even)["met"]
    assert judged([1.0], [True], probability=above, **even)["more_cases"] == 1


@pytest.mark.parametrize(
    ("n", "outside"), [(58, 0), (59, 0), (92, 1), (93, 1), (200, 12)]
)
def test_a_requirement_is_judged_as_it_says(n, outside):
    """With 95 % and 95 % where nothing else is asked; the beta distribution as scipy
    has it."""
    values = np.where(np.arange(n) < outside, 3.0, 1.0)
    judgement = judged(list(values), [True] * n, max=2.0)
    shown = beta.ppf(0.05, n - outside, outside + 1)
    assert (judgement["probability"], judgement["confidence"], judgement["n"]) == (
        0.95,
        0.95,
        n,
    )
    assert judgement["met"] == (shown >= 0.95) == (n in (59, 93))
    assert judgement["shown_within"] == pytest.approx(100 * shown, rel=1e-12)
    assert judgement["outside"] == outside
    assert judgement["share_outside"] == pytest.approx(100 * outside / n, rel=1e-12)
    assert judgement["interval_outside"] == clopper_pearson(outside, n, 0.95)
    assert judgement["cases_outside"] == list(range(min(outside, 10)))
    assert judgement["commands"] == [
        f"desat campaign case c {k}" for k in range(min(outside, 3))
    ]
    assert judgement["for_half_the_width"] == for_half_the_width(n, outside, 0.95)


@pytest.mark.parametrize(
    ("count", "n"), [(0, 7), (1, 7), (3, 7), (6, 7), (7, 7), (1, 1)]
)
@pytest.mark.parametrize("level", [0.9, 0.95])
def test_the_interval_of_a_share(count, n, level):
    tail = (1.0 - level) / 2.0
    low = 100.0 * beta.ppf(tail, count, n - count + 1) if count else 0.0
    high = 100.0 * beta.ppf(1.0 - tail, count + 1, n - count) if count < n else 100.0
    assert clopper_pearson(count, n, level) == pytest.approx([low, high], rel=1e-12)
    assert clopper_pearson(count, n) == clopper_pearson(count, n, 0.95)


@pytest.mark.parametrize(
    ("n", "inside", "probability", "confidence"),
    [
        (10, 10, 0.9, 0.9),
        (10, 9, 0.8, 0.8),
        (7, 6, 0.7, 0.9),
        (30, 28, 0.85, 0.95),
        (9, 8, 0.8, 0.5),
        (3, 2, 0.5, 0.6),
        (40, 39, 0.9, 0.7),
        (2, 2, 0.99, 0.95),
    ],
)
def test_so_many_more_cases_show_it_and_one_less_does_not(
    n, inside, probability, confidence
):
    """Against every total one by one, the share outside rounded to whole cases."""

    def shown(total: int) -> bool:
        outside = math.floor((n - inside) * total / n + 0.5)
        return bool(
            beta.ppf(1.0 - confidence, total - outside, outside + 1) >= probability
        )

    last = max(k for k in range(n - 1, n + 3000) if k < n or not shown(k))
    assert more(n, inside, probability, confidence) == last + 1 - n


def test_more_than_ten_million_cases_are_not_told_of():
    assert more(10_000, 9_501, 0.95, 0.95) is None
    assert more(10, 10, 0.9999999, 0.95) is None  # it takes 29,957,321
    assert more(1, 1, 0.05 ** (1.0 / 9_999_998.5), 0.95) == 9_999_998
    assert more(1, 1, 0.05 ** (1.0 / 9_999_999.5), 0.95) is None
    assert for_half_the_width(3_000_000, 1_500_000, 0.95) is None
    assert for_half_the_width(2_000, 1_000, 0.95) == pytest.approx(6_000, rel=0.02)


def test_a_time_that_is_not_reached_counts_in_the_share():
    assert Spread(n=3, not_reached=1).not_reached_text == "1 of 4 (25 %)"
    assert Spread(n=5, not_reached=2).not_reached_text == "2 of 7 (28.6 %)"
    assert Spread(n=4, not_reached=0).not_reached_text == ""


# --- exit codes, bounds and conditions at their limits --------------------------------


@pytest.mark.parametrize(
    ("manifest", "code"),
    [
        ({"status": "completed"}, Exit.COMPLETED),
        ({"status": "completed", "unmet": []}, Exit.COMPLETED),
        ({"status": "completed", "unmet": ["a line"]}, Exit.UNMET),
        ({"status": "failed"}, Exit.COMPONENT),
        ({"status": "failed", "unmet": ["a line"]}, Exit.COMPONENT),
        ({"status": "no space", "exit": 6}, Exit.SPACE),
        ({"status": LATE}, Exit.TIMEOUT),
        ({"status": "interrupted", "exit": 130}, Exit.INTERRUPTED),
    ],
)
def test_how_a_run_ended_is_its_exit_code(manifest, code):
    run = Run(Manifest.from_json({"message": "why", **manifest}), SimpleNamespace())
    assert run.code == code
    assert run.ok == (manifest["status"] == "completed")
    if run.ok:
        assert run.or_raise("a") is run
    else:
        with pytest.raises(RunError, match=r"^a: .*: why$") as raised:
            run.or_raise("a")
        assert raised.value.code == code


@pytest.mark.parametrize(
    ("number", "code"),
    [
        (errno.ENOENT, Exit.INPUT),
        (errno.EACCES, Exit.INPUT),
        (errno.ENOSPC, Exit.SPACE),
    ],
)
def test_a_full_disk_has_an_exit_code_of_its_own(desat, monkeypatch, number, code):
    def fails(**_: object) -> None:
        raise OSError(number, os.strerror(number), "a/file")

    monkeypatch.setattr(cli, "get_command", lambda app: fails)
    monkeypatch.setattr(cli, "spare", lambda command: None)
    monkeypatch.setattr(cli, "_drop_output", lambda: None)
    done = desat()
    assert done.returncode == code
    assert f"a/file: {os.strerror(number)}" in done.stderr


@pytest.mark.parametrize("way", ["SEGFAULT", "EXIT_0"])
def test_a_run_that_a_component_ended_says_how_far_it_came(system, way):
    run = simulate(prepare(str(system), options(way)))
    times = run.results.times()
    assert run.code == Exit.COMPONENT
    assert len(times) > 1
    assert run.manifest["steps_done"] == len(times) - 1
    assert run.manifest["end_time"] == times[-1]


def test_a_run_within_its_range_has_no_remark():
    """Nothing is said of a range that it does not leave."""
    run = simulate(
        prepare("gyrostat/light", Options(stop=20.0, substeps=1, blocks=True))
    )
    assert run.manifest["warnings"] == []
    assert run.code == Exit.COMPLETED


WELL = study.RunRow("completed", 0, "")
UNMET = study.RunRow("completed", 1, "", unmet=["x = 2: above [b]"])
FAILED = study.RunRow("failed", 4, "h_wheel[b] is nan")
LATE_ONE = study.RunRow(LATE, 5, "after 1 s")


@pytest.mark.parametrize(
    ("rows", "code", "lines"),
    [
        ([WELL, WELL], Exit.COMPLETED, []),
        ([WELL, FAILED], Exit.COMPONENT, ["a.k = 1: failed: h_wheel[b] is nan"]),
        (
            [LATE_ONE, FAILED],
            Exit.TIMEOUT,
            [f"a.k = 0: {LATE}: after 1 s", "a.k = 1: failed: h_wheel[b] is nan"],
        ),
    ],
)
def test_a_sweep_ends_as_the_worst_of_its_points(desat, monkeypatch, rows, code, lines):
    points = [study.SweepPoint({"a.k": k}, [row], {}) for k, row in enumerate(rows)]
    swept = study.Sweep("NAME", {"a.k": [0, 1]}, 0, None, {}, points, [])
    monkeypatch.setattr(study, "sweep", lambda *_, **__: swept)
    done = desat("sweep", "NAME", "a.k=0,1", "--json")
    assert done.returncode == code
    assert done.stderr.splitlines() == lines


def case_verdict(met: bool, lacking: int = 0) -> CaseVerdict:
    entry, cases = Requirement(number="x", max=1.0), np.arange(20)
    verdict = requirement(
        entry, {"x": cases - 17.5}, np.ones(20, bool), cases, Path("c")
    )
    return replace(
        verdict, met=met, interval_outside=[0.0, 5.0], lacking=lacking, more_cases=None
    )


@pytest.mark.parametrize(
    ("requirements", "unmet", "failed", "code"),
    [
        ([True, True], [], [], Exit.COMPLETED),
        ([True, False], [], [], Exit.UNMET),
        ([], ["case 3: y: above [b]", "case 4: z"], [], Exit.UNMET),
        ([True], [], [4, 5], Exit.COMPONENT),
        ([False], [], [5, 5], Exit.TIMEOUT),
        ([False], ["case 3: y: above [b]"], [4], Exit.COMPONENT),
    ],
)
def test_a_campaign_ends_as_what_it_shows(
    desat, monkeypatch, requirements, unmet, failed, code
):
    answer = SimpleNamespace(
        changed="",
        versions=[],
        completed=20,
        count=20 + len(failed),
        unmet=unmet,
        numbers={},
        requirements={
            f"r{k}": case_verdict(met, k) for k, met in enumerate(requirements)
        },
        failed=[
            CaseRow("failed", c, "h[b] is nan", number=k) for k, c in enumerate(failed)
        ],
    )
    monkeypatch.setattr(report, "write", lambda folder: (folder / "[b].html", answer))
    done = desat("campaign", "report", "c")
    assert done.returncode == code
    shown = done.stdout.splitlines()
    assert shown[0] == f"20 of {20 + len(failed)} completed, {len(failed)} failed"
    for k, met in enumerate(requirements):
        lacking = f", {k} without x" if k else ""
        level = "that 95 % are within, with a confidence of 95 %"
        verdict = "met" if met else f"NOT SHOWN {level}"
        assert shown[1 + k] == f"r{k}: 1 of 20 outside{lacking} (0 to 5 %): {verdict}"
    assert shown[-1].endswith("[b].html")
    lines = [f"case {k}: h[b] is nan" for k in range(len(failed))]
    first = [
        f"{len(unmet)} not met of what each run is held against, first: {unmet[0]}"
        for _ in unmet[:1]
    ]
    assert done.stderr.splitlines() == lines + first


def test_a_number_at_its_bound_is_met():
    assert residual.beyond("x", Value("x", 2.0, "N.m.s"), "b", 0.5, 4.0) == []
    (line,) = residual.beyond(
        "x", Value("x", math.nextafter(2.0, 3.0), "N.m.s"), "b", 0.5, 4.0
    )
    assert line == "x = 2 N m s: above b = 0.5 of the largest momentum, 4 N m s"


@pytest.mark.parametrize(
    ("way", "values", "met"),
    [
        ("below", [1.0, -1.0], True),
        ("below", [1.0, -2.0], False),
        ("below", [0.0, 3.0], False),
        ("above", [1.0, -3.0], True),
        ("above", [1.0, -2.0], False),
        ("above", [0.0, 1.0], False),
        ("reaches", [2.0, 2.0], True),
        ("reaches", [2.0, 1.0], False),
    ],
)
def test_a_condition_at_its_limit_is_not_met_yet(way, values, met):
    condition = Condition("a", "x", way, 2.0, 0.0, "")
    assert condition.met(np.array(values)) is met


# --- verdicts of a paper's tables -----------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "band"),
    [
        ({"tolerance": [1, 2]}, (1.0, 2.0)),
        ({"tolerance": {"of": "x", "from": 0.5, "to": 2.0}}, (2.0, 8.0)),
        ({"tolerance": "12 %", "values": -50.0}, (-56.0, -44.0)),
        ({"tolerance": "12%", "values": -50.0}, (-56.0, -44.0)),
        ({"tolerance": "0.5", "values": 3.0}, (2.5, 3.5)),
        ({"tolerance": "0.5"}, None),
        ({"values": 3.0}, None),
    ],
)
def test_what_counts_as_within_a_row(entry, band):
    row = {"table": "1", "quantity": "a_number", "unit": "1", **entry}
    assert comparison.band_of(Entry.model_validate(row), {"x": 4.0}) == band


def test_of_draws_the_limits_count_and_what_is_lacking_does_not():
    values = [1.0, 2.0, 3.0, None]
    answer = comparison.share_of(values, least=2.0, most=3.0)
    assert (answer.n, answer.count) == (4, 2)
    assert comparison.share_of(values, most=2.0).count == 2
    assert comparison.share_of(values, least=-math.inf).count == 3
    assert answer.interval == clopper_pearson(2, 4)


def cell(ours: float | None, draws: object | None = None, **more: object):
    """A row of a table; its band is 1 to 2."""
    content = SimpleNamespace(labels={}, numbers={})
    scenario = SimpleNamespace(content=content, cell={}, name="family/name")
    entry = {
        "table": "1",
        "quantity": "a_number",
        "unit": "1",
        "tolerance": [1.0, 2.0],
        **more,
    }
    inputs = Entry.model_validate({k: v for k, v in entry.items() if v is not None})
    return comparison._row(scenario, inputs, ours, {}, draws)


@pytest.mark.parametrize(
    ("ours", "within"),
    [(0.9, False), (1.0, True), (1.5, True), (2.0, True), (2.1, False), (None, None)],
)
def test_a_cell_at_the_edge_of_its_band_is_within(ours, within):
    assert cell(ours).within is within
    assert cell(1.5, values=ours).paper_within is within
    assert cell(ours, tolerance=None).within is None


@pytest.mark.parametrize(
    ("least", "most", "ours", "within"),
    [
        (3.0, 4.0, 1.5, True),
        (3.0, 3.0, 1.5, True),
        (2.9, 4.0, 1.5, False),
        (3.0, 4.1, 1.5, False),
        (None, 4.0, 1.5, False),
        (3.0, None, 1.5, False),
        (3.0, 4.0, 2.5, False),
    ],
)
def test_each_draw_of_a_cell_is_to_be_in_its_band(least, most, ours, within):
    draws = comparison.Spread(2, least, most, (3.0, 4.0))
    assert cell(ours, draws).within is within
    assert cell(1.5, replace(draws, band=None)).within is True


def test_cells_are_counted_by_what_they_show():
    rows = [
        cell(1.5, values=1.6),
        cell(1.5, values=3.0),
        cell(3.0, values=1.5),
        cell(1.5, values=1.5, tuned="a gain"),
        cell(1.5, tuned="a gain"),
        cell(1.5, values=1.5, in_sample="a choice"),
        cell(1.5),
        cell(3.0),
        cell(None, not_judged="why", tolerance=None),
        cell(1.5, tolerance=None),
    ]
    assert comparison.count(rows) == {
        "rows": 10,
        "not_judged": 1,
        "banded": 8,
        "within": 6,
        "tuned": 2,
        "without_paper": 2,
        "in_sample": 1,
        "out_of_sample": 3,
        "out_of_sample_within": 2,
        "paper_outside": 1,
    }
    assert (cell(1.5).case, cell(1.5, case="1").case) == ("name", "1")
    assert (cell(1.5).heading, cell(1.5, heading="how long").heading) == (
        "a number",
        "how long",
    )
    assert (cell(1.5).method, cell(1.5, label="ours").method) == ("", "ours")
    assert cell(1.5, definition="as it says").definition == "as it says"


# --- what the last run of mutations left ----------------------------------------------


@pytest.mark.parametrize(
    ("name", "known", "message"),
    [
        (
            "abcx",
            ["abcxyz", "abcxaa"],
            "; did you mean abcxaa?",
        ),  # the first that it begins
        ("abc", ["abcdefghijkl"], "; did you mean abcdefghijkl?"),
        (
            "ab",
            ["abcdefghijkl"],
            "; there is abcdefghijkl",
        ),  # two letters begin too much
        (
            "yaw_rate",
            ["yaw_ratio", "yaw_rates_of_all"],
            "; did you mean yaw_rates_of_all?",
        ),
        ("x" * 200, ["y"], "; there is y"),
        ("x" * 201, ["y"], ""),
    ],
)
def test_the_nearest_name(name, known, message):
    assert nearest(name, known) == message


@pytest.mark.parametrize(
    ("count", "message"), [(2000, "; did you mean n7?"), (2001, "")]
)
def test_no_nearest_of_very_many_names(count, message):
    assert nearest("n7 ", (f"n{i}" for i in range(count))) == message


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sweep", "plant/spin", "spacecraft.x=1", "--samples", "-1"), "--samples"),
        (("campaign", "case", "nowhere", "--", "-1"), "'number'"),
    ],
)
def test_numbers_below_the_least_are_refused(arguments, message, desat):
    outcome = desat(*arguments)
    assert outcome.returncode == Exit.INPUT
    assert message in outcome.stderr
    assert "greater than or equal to 0" in outcome.stderr


def test_what_size_recommends_by_default():
    """As its page says: a duty of 50 %, a margin of 1.3, its own tip-off, other laws, a
    year's extremes and closed loops."""
    from desat.cli.commands.size import size

    usual = {name: p.default for name, p in inspect.signature(size).parameters.items()}
    assert (usual["duty"], usual["margin"], usual["tip_off"]) == (50.0, 1.3, None)
    assert (usual["laws"], usual["year"], usual["loop"], usual["as_map"]) == (
        None,
        True,
        True,
        False,
    )


@pytest.mark.parametrize(
    ("values", "wish", "page"),
    [
        ((), True, "size-nadir_day-day-dipole.html"),
        (("--laws",), True, "size-nadir_day-day-dipole.html"),
        (("--own-law",), False, "size-nadir_day-day-dipole.html"),
        (("--map",), False, "size-map-nadir_day-day-dipole.html"),
        (("--map", "--laws"), True, "size-map-nadir_day-day-dipole.html"),
        (("--map", "--own-law"), False, "size-map-nadir_day-day-dipole.html"),
    ],
)
def test_other_laws_than_the_crafts_by_default_but_of_maps(
    values, wish, page, monkeypatch, tmp_path, desat
):
    from desat.sizing import map as sizing_map
    from desat.sizing import page as sizing_page
    from desat.sizing import sizing

    requests: dict[str, object] = {}
    result = SimpleNamespace(problems=[], as_json=dict)
    monkeypatch.setattr(
        sizing,
        "size",
        lambda target, options, wishes, progress: (
            requests.update(laws=wishes.laws) or result
        ),
    )
    monkeypatch.setattr(
        sizing_map,
        "map_of",
        lambda target, options, axes, *rest: requests.update(laws=axes.laws) or result,
    )
    monkeypatch.setattr("desat.cli.commands.size._print_sizing", lambda result: None)
    monkeypatch.setattr("desat.cli.commands.size._print_map", lambda result: None)
    for name in ("write_sizing", "write_map"):
        monkeypatch.setattr(
            sizing_page, name, lambda result, page: requests.update(page=page) or page
        )
    monkeypatch.chdir(tmp_path)
    assert desat("size", "nadir_day/day-dipole", *values).returncode == 0
    assert requests["laws"] is wish
    assert requests["page"] == Path("runs") / page


def test_jacobi_records_its_first_row_whatever_is_left_out():
    """Row 0 is of the start; each second row beside it."""
    options = Options(algorithm="jacobi", every=2, stop=6.0, blocks=True)
    run = simulate(prepare("nadir_day/day-dipole", options))
    assert run.results.times()[:3].tolist() == [0.0, 2.0, 4.0]


def test_checkpoints_are_so_many_seconds_of_the_run_apart(tmp_path, monkeypatch):
    """Not so many steps: a step of half a second has twice as many between two."""
    apart: list[int] = []
    monkeypatch.setattr(
        "desat.runs.step_case.Checkpoints",
        lambda folder, every, *rest: (
            apart.append(every) or (_ for _ in ()).throw(RunError("seen"))
        ),
    )
    case = prepare(
        "nadir_day/day-dipole", Options(step=0.5, stop=60.0, checkpoint=10.0)
    )
    with pytest.raises(RunError, match="seen"):
        simulate(case, tmp_path / "run")
    assert apart == [20]


# --- requirements of a single run -----------------------------------------------------

REQUIRED = """extends = "integrated/mil-nadir"
stop = 960.0
without = ["requirements"]
[requirements.calm]
number = "pointing_95"
max = {calm}
[requirements.dumped]
number = "dumped"
max = {dumped}
"""


@pytest.mark.parametrize(
    ("calm", "dumped", "code"),
    [(179.0, 7200.0, 0), (0.01, 7200.0, 1), (179.0, 60.0, 1)],
)
def test_a_requirement_that_is_not_met_ends_a_run_with_1(
    desat, tmp_path, calm, dumped, code
):
    """A time that is not reached is not met once the run is over it, and before that
    unknown."""
    file, out = tmp_path / "mine.toml", tmp_path / "out"
    file.write_text(REQUIRED.format(calm=calm, dumped=dumped))
    done = desat("run", str(file), "--no-baseline", "--out", str(out))
    message = done.stdout + done.stderr
    assert done.returncode == code
    assert ("not met: calm: APE" in message) == ("NOT MET" in message) == (
        calm == 0.01
    ) or dumped < 100
    assert ("not met: dumped: " in message) == (dumped == 60.0)
    assert ("not checked: dumped: not reached at 960 s" in message) == (
        dumped == 7200.0
    )
    manifest = load_run(out).manifest
    verdict = manifest.verdicts["calm"]
    assert verdict.met == (calm == 179.0) == (verdict.margin > 0.0)
    assert verdict.value == manifest.numbers["pointing_95"].value
    page = (out / "report.html").read_text()
    assert ("NOT MET" in page) == bool(code)


def test_requirements_of_draws_are_of_all_together(tmp_path):
    """One case outside does not end a campaign with 1: its share does."""
    file = tmp_path / "mine.toml"
    file.write_text(REQUIRED.format(calm=0.01, dumped=60.0))
    row = study.one(study.read(str(file)), Options(), 0, None)
    assert (row.code, row.unmet) == (0, [])


def verdict(
    value: float | None, number: str = "late", until: float = 100.0, **limits: float
):
    content = Content.model_validate(
        {
            "numbers": {
                "late": {"signal": "a.b", "measure": "first_below", "unit": "s"},
                "then": {"signal": "a.b", "measure": "largest", "window": [50.0, 60.0]},
            },
            "requirements": {"r": {"number": number, **limits}},
        }
    )
    numbers = {number: Value("T", value, "s")}
    return verdicts.judge(content, numbers, 0.0, until)


@pytest.mark.parametrize(
    ("value", "limits", "met", "margin"),
    [
        (50.0, {"max": 100.0}, True, 0.5),
        (100.0, {"max": 100.0}, True, 0.0),
        (150.0, {"max": 100.0}, False, -0.5),
        (50.0, {"min": 100.0}, False, -0.5),
        (-50.0, {"max": -100.0}, False, -0.5),
        (50.0, {"min": 40.0, "max": 100.0}, True, 0.25),
        (math.inf, {"min": 1.0}, False, None),
        (None, {"max": 100.0}, False, None),
        (None, {"min": 100.0}, False, None),
        (1.0, {"min": 0.0}, True, None),
    ],
)
def test_a_margin_is_a_share_of_the_nearer_limit(value, limits, met, margin):
    found, unjudged = verdict(value, **limits)
    assert (found["r"].met, found["r"].margin, unjudged) == (met, margin, {})
    assert len(list(verdicts.lines(found))) == (not met)


@pytest.mark.parametrize(
    ("number", "until", "reason"),
    [
        ("late", 99.0, "not reached at 99 s, where the run ends; it has until 100 s"),
        ("late", 100.0, ""),
        ("then", 60.0, ""),
        ("then", 49.0, "the run ends at 49 s, before 50 s, where its window begins"),
    ],
)
def test_a_run_that_is_too_short_does_not_judge(number, until, reason):
    found, unjudged = verdict(None, number, until, max=100.0)
    assert unjudged == ({number: reason} if reason else {})
    assert bool(found) == (not reason)


def test_a_number_that_is_not_recorded_is_not_judged():
    content = Content.model_validate(
        {"requirements": {"r": {"number": "x", "max": 1.0}}}
    )
    assert verdicts.judge(content, {}, 0.0, 1.0) == ({}, {"x": "not recorded"})


def test_a_checkpoint_says_how_long_the_run_took_until_then(tmp_path):
    options = Options(stop=60.0, checkpoint=10.0, blocks=True)
    run = simulate(prepare("nadir_day/day-dipole", options), tmp_path / "run")
    answer = newest(tmp_path / "run").about["seconds"]
    assert 0.0 < answer <= run.manifest.wall_seconds


def test_the_first_option_that_belongs_to_a_map_is_named(desat):
    outcome = desat("size", "nadir_day/day-dipole", "--dipoles", "0.1", "--rods", "1,2")
    assert outcome.returncode == Exit.INPUT
    assert "--rods: it belongs to --map" in outcome.stderr


def test_check_is_as_run_by_default():
    """It takes an FMU's faults as warnings, and nothing from outside a system's folder."""
    from desat.cli.commands.check import check

    usual = inspect.signature(check).parameters
    assert (usual["strict"].default, usual["outside"].default) == (False, False)
