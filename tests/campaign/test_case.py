"""Cases and draws: what their rows record, and how they end."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from desat.analyses.manifest import Manifest
from desat.campaign import case as campaign_case
from desat.campaign import draws as study
from desat.campaign import plan, store
from desat.engine.instances.base import EndedError
from desat.runs.run import Run
from desat.system.errors import DesatError, Exit, RunError
from desat.system.options import Options


def make_run(code: int = 0, **more: object) -> Run:
    """A run that ended so."""
    status = "completed" if code < 2 else "failed"
    results = {
        "status": status,
        "message": "h[b] is nan",
        "steps_done": 3,
        "us_per_step": 0.5,
        "unmet": ["x[b] = 2"] * (code == 1),
        "exit": code if code > 1 else None,
    }
    run = Run(Manifest.from_json(results), SimpleNamespace())
    run.manifest = replace(run.manifest, **more)
    return run


def catch_error(function, *args: object) -> tuple[str, object] | object:
    try:
        return function(*args)
    except (
        KeyboardInterrupt,
        SystemExit,
        OSError,
        RuntimeError,
        DesatError,
        EndedError,
    ) as error:
        return type(error).__name__, getattr(error, "code", str(error))


class AskedError(Exception):
    """What a run was to record."""


@pytest.mark.parametrize(
    ("substeps", "record", "looks"),
    [
        ("auto", ("*",), True),
        (1, ("*",), False),
        (1, ("wheels.h_wheel",), None),
        ("auto", ("wheels.h_wheel",), None),
    ],
)
def test_draws_record_what_their_numbers_need(monkeypatch, substeps, record, looks):
    """And, where the run chooses its substeps, what that is looked at again with."""

    def simulate(case: object, choice: None) -> None:
        raise AskedError(case.options.record)

    monkeypatch.setattr(study, "simulate", simulate)
    options = Options(blocks=True, stop=20.0, substeps=substeps, record=record)
    with pytest.raises(AskedError) as requests:
        study.ran(study.read("gyrostat/light"), options, {})
    (record_names,) = requests.value.args
    if looks is None:
        assert record_names == record
    else:
        looked_at = {"spacecraft.omega_bi_body", "spacecraft.impulse_eci"}
        assert looked_at & set(record_names) == (looked_at if looks else set())
        assert {"spacecraft.q_bi", "wheels.h_wheel", "torquers.m_mean_body"} < set(
            record_names
        )


@pytest.mark.parametrize(
    ("error", "code"),
    [(DesatError("no"), 2), (RunError("no"), 4), (RunError("no", 128), 128), (None, 0)],
)
def test_a_case_that_cannot_begin_is_a_row(monkeypatch, error, code):
    def values(number: int) -> dict[str, float]:
        return {"a.k": 1.0}

    def ran(plan: object, values: object, is_supervised: bool) -> store.CaseRow:
        assert is_supervised is False
        if error:
            raise error
        return store.CaseRow("completed", 0, "", values=values)

    monkeypatch.setattr(campaign_case, "_ran", ran)
    result = campaign_case.row(SimpleNamespace(values=values), 7)
    assert (result.code, result.number, result.values) == (code, 7, {"a.k": 1.0})
    assert result.message == ("no" if error else "")
    assert result.status == ("failed" if error else "completed")
    assert 0.0 <= result.seconds < 1.0
    error = RunError("told to end", Exit.INTERRUPTED)
    with pytest.raises(SystemExit) as exit_info:
        campaign_case.row(SimpleNamespace(values=values), 7)
    assert exit_info.value.code == 130


@pytest.mark.parametrize(
    ("code", "raises"),
    [(0, False), (1, False), (4, False), (5, False), (6, True), (130, True)],
)
def test_a_case_that_is_kept_needs_room_and_no_signal(
    monkeypatch, tmp_path, code, raises
):
    report_folders = []
    monkeypatch.setattr(campaign_case, "source", lambda plan: "a")
    monkeypatch.setattr(campaign_case, "prepare", lambda target, options: options)
    monkeypatch.setattr(campaign_case, "choose_for_cases", lambda *_: "once for all")

    def simulate(options: Options, into: Path, choice: str) -> Run:
        assert choice == "once for all"
        assert (options.supervised, options.call_limit) == (True, 9.0)
        assert options.values == {"a.k": 1.0}
        return make_run(code)

    monkeypatch.setattr(campaign_case, "simulate", simulate)
    monkeypatch.setattr(
        campaign_case, "write_report", lambda *args: report_folders.append(args[0])
    )
    of = plan.CampaignPlan("a", "", 3, limit=9.0)
    monkeypatch.setattr(plan.CampaignPlan, "values", lambda self, number: {"a.k": 1.0})
    if raises:
        with pytest.raises(RunError):
            campaign_case.repeat(of, 1, tmp_path)
    else:
        assert campaign_case.repeat(of, 1, tmp_path).code == code
    assert report_folders == [tmp_path] * (not raises)


@pytest.mark.parametrize(
    ("values", "status"),
    [({}, "completed"), ({"timeout": True}, "timed out")],
)
def test_what_never_came_back_is_a_failed_row(values, status):
    result = study.lost_row(study.NoResult("why", **values))
    assert (result.status, result.message) == ("failed", "why")
    assert result.code == (Exit.TIMEOUT if values else Exit.COMPONENT)
