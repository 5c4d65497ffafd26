"""What decides a verdict, an exit code or a time: a test for each mutation that
survived."""

from __future__ import annotations

import errno
import math
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from desat import cli
from desat.analyses import residual
from desat.analyses.manifest import Manifest
from desat.campaign import draws as study
from desat.campaign import report
from desat.campaign import sweep as sweep_study
from desat.campaign.judged import CaseVerdict, requirement
from desat.campaign.store import CaseRow
from desat.language.content import Content
from desat.language.scenario import Requirement
from desat.numbers import verdicts
from desat.numbers.text import Value
from desat.runs.cases import Cases
from desat.runs.run import Run, load_run, prepare, simulate
from desat.runs.stopping import LATE, StopCondition
from desat.system.errors import Exit, RunError
from desat.system.options import Options
from tests.engine.test_failures import binary, options, ssd, system

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
def test_a_sweep_ends_as_the_worst_of_its_points(
    desat, monkeypatch, tmp_path, rows, code, lines
):
    points = [
        sweep_study.SweepPoint({"a.k": k}, [row], {}) for k, row in enumerate(rows)
    ]
    swept = sweep_study.Sweep("NAME", {"a.k": [0, 1]}, 0, None, {}, points, [])
    monkeypatch.setattr(sweep_study, "sweep", lambda *_, **__: swept)
    done = desat("sweep", "NAME", "a.k=0,1", "--json", cwd=tmp_path)
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
    condition = StopCondition("a", "x", way, 2.0, 0.0, "")
    assert condition.met(np.array(values)) is met


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
    row = study.one(Cases(study.read(str(file))), Options(), 0, None)
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
