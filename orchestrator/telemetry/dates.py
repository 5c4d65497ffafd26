"""Fit the centre of pressure of a craft to the dates of its dumps alone.

Sunlight and air act in proportion to the offset of the centre of pressure, so that dumps
come the quicker the larger it is. The dates say one number: the size of the offset with
which `desat size` has dumps as often as they were. Its direction stays.
"""

from __future__ import annotations

from math import hypot, inf, log

import numpy as np

from ..campaign.sampling import NINETY
from ..language.content import dispersions_of
from ..sizing.dumps import size
from ..sizing.requirements import SizingRequirements
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from .fit import OFFSET, UNITS, Fit, ParameterFit
from .log import Log

MODEL_ERROR = 0.05  # of the time between dumps, by docs/sizing-thrusters.md
LARGEST_FACTOR = 50.0  # on the offset, either way
TRIES, CLOSE = 12, 1e-3
FEWEST = 3  # dates


def fit_dates(system: System, target: str, dates: Log, options: Options) -> Fit:
    """Fit the size of the offset of the centre of pressure to dates of dumps.

    Parameters
    ----------
    system, target, options
        The craft, which dumps by thrusters, and how it is read.
    dates
        A row for each dump.

    Raises
    ------
    DesatError
        If there are too few dates, or no offset has dumps as often.
    """
    gaps = np.diff(dates.times)
    if len(dates.times) < FEWEST:
        raise DesatError(
            f"{dates.place}: {len(dates.times)} dates of dumps; at least {FEWEST} are needed"
        )
    mean_gap = float(gaps.mean())
    before = np.array(system.components["spacecraft"].values[OFFSET], float)
    requirements = SizingRequirements(flown=False, year=False, laws=False)

    def interval(factor: float) -> float:
        """Return the time between dumps (s) with the offset times a factor."""
        values = {**options.values, f"spacecraft.{OFFSET}": (factor * before).tolist()}
        other = Options(sets=options.sets, values=values)
        return size(target, other, requirements).steady.interval

    factor = 1.0
    for _ in range(TRIES):
        there = interval(factor)
        if abs(there / mean_gap - 1.0) < CLOSE:
            break
        factor *= there / mean_gap if there < inf else 2.0
        if not 1.0 / LARGEST_FACTOR < factor < LARGEST_FACTOR or not before.any():
            break
    if abs(there / mean_gap - 1.0) > MODEL_ERROR:
        raise DesatError(
            f"{dates.place}: a dump each {mean_gap / 86400.0:.4g} d: no offset of the centre of "
            f"pressure explains it; as it is described a dump comes each "
            f"{interval(1.0) / 86400.0:.4g} d"
        )
    scatter = float(gaps.std(ddof=1)) / mean_gap / np.sqrt(len(gaps))
    wheels = dispersions_of(system).get("wheels.speed_limit")
    capacity = log(wheels.factor) / NINETY if wheels and wheels.factor else 0.0
    value = factor * before
    parameter = ParameterFit(
        OFFSET,
        UNITS[OFFSET],
        before,
        np.abs(before),
        value,
        hypot(scatter, MODEL_ERROR, capacity) * np.abs(value),
        value != 0.0,
    )
    return Fit(
        {OFFSET: parameter},
        ["direction of the offset: not observable"],
        0.0,
        0.0,
        float(len(gaps)),
        [
            f"{len(gaps)} intervals between dumps, {mean_gap / 86400.0:.4g} d in the mean",
            "areas and reflection are in it, and the wheels' capacity: their lines in "
            "[dispersions] may go",
        ],
    )
