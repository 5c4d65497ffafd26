"""What a measure is: a function that is known by its name, and the unit that it gives."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.units import Unit, times, unit_of

Array = NDArray[np.float64]
Measure = Callable[..., float]
MEASURES: dict[str, Measure] = {}
OWN_UNIT: dict[str, Callable[[Unit], Unit]] = {}
"""Measures that give another unit than that of their values: which, from the values' unit."""
LATE: set[str] = set()
"""Measures of a time at which a run reaches something. Where it does not they give nan, no number;
over several runs that is later than any time that one reached."""


def measure(function: Measure) -> Measure:
    """Make a function known by its name."""
    MEASURES[function.__name__] = function
    return function


def in_unit(
    unit: str | Callable[[Unit], Unit], late: bool = False
) -> Callable[[Measure], Measure]:  # fmt: skip
    """The same, of a function that gives a unit of its own, or one made from that of its values;
    `late`: it is one of LATE."""

    def known(function: Measure) -> Measure:
        if late:
            LATE.add(function.__name__)
        own = unit_of(unit) if isinstance(unit, str) else None
        OWN_UNIT[function.__name__] = (lambda _: own) if own is not None else unit  # type: ignore[assignment]
        return measure(function)

    return known


def per_second(unit: Unit) -> Unit:
    """The unit of a rate of change."""
    return times(unit, unit_of("s"), -1)


def settled(times: Array, good: NDArray[np.bool_]) -> float:
    """When it has become good to stay (s); nan where it does not."""
    bad = np.flatnonzero(~good)
    if not len(bad):
        return float(times[0])
    return float(times[bad[-1] + 1]) if good[-1] else float("nan")
