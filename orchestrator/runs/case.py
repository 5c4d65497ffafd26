"""Represent a scenario with options, as it is checked before it runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from ..analyses.manifest import Manifest
from ..engine.trial_initialisation import refusals
from ..files.completion import complete
from ..files.draft import Draft
from ..files.scenario import Scenario
from ..files.ssp import ABOUT
from ..language.content import NOTHING, content_of
from ..system.check import Unwired, foresee, unwired
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from ..system.refusal import explain
from ..system.schedule import Schedule

if TYPE_CHECKING:
    from ..engine.master import MasterPool


def described_by(draft: Draft, scenario: Scenario) -> Scenario | None:
    """Return the scenario whose content describes a system; None without one.

    It is packed in a system file with a scenario.
    """
    if not scenario.is_system_file:
        return scenario
    content = content_of(draft.about)
    if content is NOTHING:
        return None
    file = Path(draft.place).parent / ABOUT
    return Scenario(content, file, file.parent, is_system_file=True)


@dataclass
class Case:
    """Scenario with options: the system for a run, or the problems with it.

    `system` is set if it could be built, `schedule` if nothing prevents running it.
    """

    scenario: Scenario
    options: Options
    draft: Draft
    system: System | None
    schedule: Schedule | None
    problems: list[str]
    warnings: list[str]
    notes: list[str] = field(default_factory=list)
    # manifest before the run, where it is known from another case (`runs/cases.py`)
    manifest: Manifest | None = None
    # pool with a master to run with, for cases that differ in values alone
    spare: MasterPool | None = None

    @property
    def target(self) -> str:
        """Return the target as it was named."""
        return self.scenario.target

    @property
    def place(self) -> str:
        """Return the file that the system was read from, for messages."""
        return self.draft.place

    @property
    def described(self) -> Scenario | None:
        """Return the scenario whose content describes the system; None without one."""
        return described_by(self.draft, self.scenario)

    @classmethod
    def of_draft(cls, scenario: Scenario, options: Options, draft: Draft) -> Case:
        """Complete a draft; problems and warnings are those of the draft so far."""
        system = complete(draft)
        return cls(
            scenario, options, draft, system, None, draft.problems, draft.warnings
        )

    def or_raise(self) -> tuple[System, Schedule]:
        """Return the system and its schedule.

        Raises
        ------
        DesatError
            If there are problems; it names each on a line.
        """
        if self.problems or self.system is None or self.schedule is None:
            raise DesatError("\n".join(self.problems))
        return self.system, self.schedule

    @cached_property
    def unwired(self) -> Mapping[str, Unwired]:
        """Return inputs at their default and unused outputs, by component."""
        return {} if self.system is None else unwired(self.system)

    @cached_property
    def foreseen(self) -> tuple[list[str], list[str]]:
        """Return the problems and warnings that blocks foresee from their values."""
        return ([], []) if self.system is None else foresee(self.system, self.unwired)

    @cached_property
    def trial(self) -> tuple[list[str], list[str]]:
        """Return what components refuse when they are initialised: problems, warnings."""
        system, schedule = self.system, self.schedule
        assert system is not None
        assert schedule is not None
        refused = refusals(system, schedule, self.options.trusted)
        problems, warnings = (explain(system, "\n".join(lines)) for lines in refused)
        return list(problems), list(warnings)
