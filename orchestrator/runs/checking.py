"""Check a system as `desat check` does, before it runs."""

from __future__ import annotations

from ..system.options import Options
from .case import Case
from .checks import run_checks
from .prepare import prepare


def check(target: str, options: Options) -> Case:
    """Return what is wrong with a system, also what its components refuse at the start.

    Raises
    ------
    DesatError
        If the target cannot be read.
    """
    case = prepare(target, options)
    run_checks(case, "study")
    case.warnings = [line for line in case.warnings if line not in case.problems]
    return case
