"""Check a system as `desat check` does, before it runs."""

from __future__ import annotations

from ..analyses import attitude_loop, sampling
from ..engine.trial_initialisation import refusals
from ..files.library import notes
from ..system.check import Checked
from ..system.options import Options
from ..system.refusal import explain
from .prepare import prepare


def check(target: str, options: Options) -> Checked:
    """Return what is wrong with a system, also what its components refuse at the start.

    Raises
    ------
    DesatError
        If the target cannot be read.
    """
    checked = prepare(target, options).checked
    system, schedule = checked.system, checked.schedule
    if system is not None and schedule is not None:
        full = list(attitude_loop.problems_when_full(system))
        checked.problems += full
        checked.warnings = [line for line in checked.warnings if line not in full]
        problems, warnings = refusals(system, schedule, options.trusted)
        checked.problems += explain(system, "\n".join(problems))
        checked.warnings += explain(system, "\n".join(warnings))
        checked.notes += [*notes(system.components.values()), *sampling.notes(system)]
    return checked
