"""Run one case of a campaign: a function of plan and number alone, wherever it runs."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..figures.plots import lines_of, unit_of
from ..language.content import content_of
from ..language.scenario import Plot
from ..report.report import write_report
from ..runs.prepare import prepare
from ..runs.run import Run, simulate
from ..runs.substep_choice import choose_for_cases
from ..system.errors import DesatError, Exit
from .draws import STOPPED, ran
from .plan import CampaignPlan, cases_of, system
from .sampling import Drawn
from .store import Batch, CaseRow

POINTS = 200  # parts of a run for which an envelope has a value


def batch(
    plan: CampaignPlan, numbers: Sequence[int], attempt: int, versions: str
) -> Batch:
    """Run cases of one block, each for the `attempt`th time, with these versions."""
    return Batch.of(row(plan, number, attempt, versions) for number in numbers)


def row(
    plan: CampaignPlan, number: int, attempt: int = 1, versions: str = ""
) -> CaseRow:
    """Run a case and return its row: inputs, numbers, and how it ended.

    A case that cannot begin has a row that says so. From the second attempt on it runs
    in a process of its own, which can report what ended it.
    """
    clock, values = time.perf_counter(), {}
    try:
        values = plan.values(number)
        outcome = _ran(plan, values, attempt > 1)
    except DesatError as error:
        if error.code > STOPPED:  # this process has to end, so its call is lost
            raise SystemExit(int(error.code)) from error
        outcome = CaseRow("failed", int(error.code), str(error), values=values)
    return replace(
        outcome,
        number=number,
        seconds=round(time.perf_counter() - clock, 6),
        worker=f"{platform.node()}:{os.getpid()}",
        attempts=attempt,
        versions=versions,
    )


def _ran(plan: CampaignPlan, values: Mapping[str, Drawn], supervised: bool) -> CaseRow:
    """Run a case with drawn values, and return its row with envelopes."""
    options = plan.options
    if supervised:
        options = replace(options, supervised=True, call_limit=plan.limit)
    curves: dict[str, list[float]] = {}
    numbers: dict[str, dict[str, str]] = {}

    def look(run: Run) -> None:
        """Collect the envelopes, titles and units of the run."""
        curves.update(_curves(chosen, run))
        numbers.update(_described(chosen, values, run))

    plots = content_of(system(plan).about).plots
    chosen = {name: plots[name] for name in plan.curves}
    signals = [signal for plot in chosen.values() for signal in plot.signals]
    row = ran(cases_of(plan), options, values, signals, look, plan.sample_values)
    return CaseRow(
        **{**vars(row), "described": {**row.described, **numbers}}, curves=curves
    )


def _described(
    plots: Mapping[str, Plot], values: Mapping[str, Drawn], run: Run
) -> dict[str, dict[str, str]]:
    """Return title and unit of drawn values and of envelopes.

    The names are `in.component.variable` and `curve.PLOT`.
    """
    descriptions = {}
    for name in values:
        owner, _, variable = name.partition(".")
        parameter = run.manifest.parameters[owner][variable]
        descriptions[f"in.{name}"] = {"title": parameter.text, "unit": parameter.unit}
    for name, unit in _units(plots, run).items():
        descriptions[f"curve.{name}"] = {"title": plots[name].title, "unit": unit}
    return descriptions


def _units(plots: Mapping[str, Plot], run: Run) -> dict[str, str]:
    """Return the unit of each plot's axis, for plots whose series are recorded."""
    units = {name: unit_of(plot, run.results) for name, plot in plots.items()}
    return {name: unit for name, unit in units.items() if unit is not None}


def _curves(plots: Mapping[str, Plot], run: Run) -> dict[str, list[float]]:
    """Compute the envelope of each plot.

    It is the largest size of any of its lines in each part of the run, and nan where
    the run was over.
    """
    start, stop = run.manifest.start, run.manifest.stop
    envelopes = {}
    for name, unit in _units(plots, run).items():
        lines = lines_of(plots[name], run.results, unit)
        envelopes[name] = _envelope([(x.times, x.values) for x in lines], start, stop)
    return envelopes


def _envelope(
    lines: Sequence[tuple[NDArray[Any], NDArray[Any]]], start: float, stop: float
) -> list[float]:
    """Compute the largest size of any line in each part of the run.

    Parts without a sample are interpolated linearly between their neighbours.
    """
    top = np.full(POINTS, np.nan)
    for times, values in lines:
        part = (
            ((times - start) / (stop - start) * POINTS).astype(int).clip(0, POINTS - 1)
        )
        np.fmax.at(top, part, np.abs(values))
    parts = np.arange(POINTS)
    if (has_value := np.isfinite(top)).any():
        top = np.interp(parts, parts[has_value], top[has_value], right=np.nan)
    return [float(x) for x in top]


def repeat(plan: CampaignPlan, number: int, into: Path) -> Run:
    """Run a case again and keep its series and report in a folder."""
    options = replace(plan.options, supervised=True, call_limit=plan.limit)
    values = {**options.values, **plan.values(number)}
    cases = cases_of(plan)
    case = prepare(cases.scenario, replace(options, values=values))
    choice = choose_for_cases(case, cases, options, plan.sample_values)
    run = simulate(case, into, choice=choice)
    if run.code == Exit.SPACE or run.code > STOPPED:
        run.or_raise(plan.target)
    write_report(into, run)
    return run
