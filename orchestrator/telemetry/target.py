"""Fit a target to the telemetry of a file, whichever it is."""

from __future__ import annotations

from pathlib import Path

from ..runs.prepare import prepare
from ..sizing.dumps import applies
from ..system.options import Options
from .dates import fit_dates
from .fit import ATTITUDE_ERROR, FIELD_ERROR, Fit, fit
from .log import origin_of, read_log


def fit_target(
    target: str,
    options: Options,
    log: Path,
    scalar_first: bool = False,
    errors: tuple[float, float] = (FIELD_ERROR, ATTITUDE_ERROR),
) -> Fit:
    """Fit a target to the telemetry of a csv: to dates of dumps where it has no more.

    Arguments as of `fit.fit` and `log.read_log`.

    Raises
    ------
    DesatError
        As by these, or if the target cannot be resolved.
    """
    system, _ = prepare(target, options).or_raise()
    rows = read_log(log, origin_of(system.parameters), scalar_first)
    if rows.is_of_dates and applies(system):
        return fit_dates(system, target, rows, options)
    return fit(system, rows, errors)
