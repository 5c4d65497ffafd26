"""What the pages of a family are made of: runs, draws, and the cells of the paper's
tables."""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from functools import cached_property
from typing import Any

from desat.analyses import analyses
from desat.campaign.draws import needed_signals
from desat.files.scenario import find
from desat.language.content import content_of
from desat.papers import stored, tables
from desat.papers.comparison import PaperCell
from desat.runs.run import Options, Run, execute, prepare
from desat.system.errors import DesatError, nearest

Change = dict[str, Any]
"""`component.parameter` -> another value."""


class Sources:
    """Of a family whose scenarios are named without it; everything is made once, when
    it is asked for.

    Runs are made by FMUs and kept in memory: of each what its numbers and plots are
    made of, and every series that a template names as "component.output".
    """

    def __init__(
        self, family: str, templates: Sequence[str], jobs: int, draft: float | None
    ) -> None:
        self.family, self.jobs, self.draft = family, jobs, draft
        self._named = sorted(
            {n for t in templates for n in re.findall(r'"(\w+\.\w+)"', t)}
        )
        self._runs: dict[str, Run] = {}

    def name_of(self, scenario: str) -> str:
        """The full name of a scenario."""
        return scenario if "/" in scenario else f"{self.family}/{scenario}"

    def end_of(self, scenario: str, stop: float | None) -> float | None:
        """The stop time of a run; None: that of the scenario."""
        if self.draft is None:
            return stop
        own_value = stop or find(self.name_of(scenario)).content.stop
        return self.draft if own_value is None else min(own_value, self.draft)

    def run(
        self,
        scenario: str,
        change: Change | None = None,
        step: float | None = None,
        stop: float | None = None,
    ) -> Run:
        """A run, made once."""
        key = repr((scenario, change, step, stop))
        if key not in self._runs:
            name = self.name_of(scenario)
            options = Options(
                values=change or {},
                step=step,
                stop=self.end_of(scenario, stop),
                record=tuple(self._needed(name)),
                supervised=True,
            )
            self._runs[key] = execute(name, options).or_raise(name)
        return self._runs[key]

    def _needed(self, name: str) -> list[str]:
        """What must be recorded of a scenario."""
        system, _ = prepare(name, Options()).or_raise()
        outputs = {
            f"{c.name}.{s.series}"
            for c in system.components.values()
            for s in c.interface.outputs
        }
        content = content_of(system.about)
        needed = [n for n in self._named if n in outputs] + needed_signals(content)
        needed += [signal for plot in content.plots.values() for signal in plot.signals]
        for analysis in analyses():
            if parts := analysis.applies(system):
                needed += analysis.signals(parts)
        return sorted(set(needed))

    @cached_property
    def draws(self) -> stored.StoredDraws:
        """The family's draws: those that are outdated are made now, but not for a
        draft."""
        return stored.read(self.family) if self.draft is not None else self._renewed({})

    def _renewed(self, also: dict[str, set[str]]) -> stored.StoredDraws:
        result = stored.renew(self.family, self.jobs, sys.stderr.isatty(), also)
        stored.write(result)
        return result

    def draws_of(self, scenario: str, number: str = "") -> stored.StoredScenario:
        """The draws of a scenario, and of these a number that has not been stored yet,
        for which they are made anew. Raises DesatError where it has none, and in a
        draft for such a number.
        """
        name, saved = self.name_of(scenario), self.draws["scenarios"]
        if name not in saved:
            raise DesatError(f"{scenario} has no draws{nearest(name, saved)}")
        if number and number not in saved[name]["units"]:
            known = {n for a in analyses() for n in a.NUMBERS}
            known |= find(name).content.numbers.keys()
            if number not in known:
                hint = nearest(number, known)
                raise DesatError(f"{scenario}: draws have no number {number}{hint}")
            if self.draft is not None:
                raise DesatError(
                    f"{scenario}: {number} of its draws is not stored; without "
                    "--draft they are made anew"
                )
            self.draws = self._renewed({name: {number}})
        draws = self.draws["scenarios"][name]
        if number and number not in draws["units"]:
            raise DesatError(f"{scenario}: no draw has a number {number}")
        return draws

    @cached_property
    def _table(self) -> list[PaperCell]:
        drawn = self.draws if stored.with_draws(self.family) else None
        return tables.rows(self.family, Options(), self.jobs, drawn)

    def cells(self, draws: bool) -> list[PaperCell]:
        """The cells of the paper's tables; `draws` False leaves out the medians of
        samples."""
        return [row for row in self._table if draws or row.draws is None]
