"""Map dumps by thrusters over wheels, thresholds and rods (`desat size --map`).

No closed loop is flown: the model of `dumps.py` follows the dumps of the scenario's day
as if it lasted, with other wheels, other thresholds and, where rods work all the time,
other rods. Mass and inertia of other wheels are not counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from math import inf, nan
from typing import NamedTuple

from ..analyses.flight import Flight, Hardware, fly_days, hardware_of, wanted_attitude
from ..runs.prepare import prepare, read
from ..system.errors import DesatError
from ..system.options import Options
from ..system.typed import JsonObject
from . import quantities
from .dumps import cost_of_thrusters, rates_of
from .margins import finite
from .momentum import smallest_wheel_capacity
from .propellant import ThrusterCost
from .requirements import SizingRequirements
from .threshold import ThresholdLaw, threshold_law

# Default axes: wheels and rods by multiples of the craft's, thresholds in %, and years.
_WHEELS, _RODS = (0.5, 1.0, 2.0), (0.5, 1.0, 2.0)
_THRESHOLDS, _YEARS = (30.0, 50.0, 70.0, 90.0), (5.0, 10.0, 15.0)


@dataclass(frozen=True)
class DumpAxes:
    """Axes of a map of dumps; an empty one takes its default values."""

    wheels: tuple[float, ...] = ()  # N m s, capacity of each
    thresholds: tuple[float, ...] = ()  # % of it, at which dumps begin
    rods: tuple[float, ...] = ()  # A m2; of a craft whose rods work all the time
    years: tuple[float, ...] = ()  # that a tank lasts


class DumpCell(NamedTuple):
    """Dumps with other wheels, thresholds and rods: N m s, A m2, a week, kg a year."""

    wheel: float
    begin: float
    end: float
    rod: float
    a_week: float  # nan: no dump is possible between these thresholds
    a_year: float


@dataclass(frozen=True)
class DumpMap:
    """Dumps over wheels, thresholds and rods, and the tanks that they need."""

    target: str
    cells: tuple[DumpCell, ...]
    years: tuple[float, ...]
    tank: float  # kg; 0: unknown
    has_rods: bool  # that work all the time

    def as_json(self) -> JsonObject:
        """Return the data that `--json` prints; unknown numbers are null."""
        cells = [
            {k: finite(x) for k, x in cell._asdict().items()}
            | {"tanks": [finite(cell.a_year * years) for years in self.years]}
            for cell in self.cells
        ]
        return asdict(replace(self, cells=())) | {"cells": cells}


def map_of_dumps(
    target: str,
    options: Options,
    axes: DumpAxes,
    requirements: SizingRequirements,
    progress: Callable[[str], None] = lambda text: None,
) -> DumpMap:
    """Compute the map of a craft that dumps by thrusters between thresholds.

    Dumps end at the share of a wheel at which those of the craft end.

    Raises
    ------
    DesatError
        If the craft lacks what this needs, or has no rods that work all the time and
        some are asked for.
    """
    system, _ = prepare(read(target), options).or_raise()
    hardware, law = hardware_of(system), threshold_law(system)
    cost = cost_of_thrusters(target, system, hardware, requirements)
    capacity = smallest_wheel_capacity(hardware)
    if not 0.0 < capacity < inf:
        raise DesatError(f"{target}: its wheels have no capacity: a map needs one")
    if axes.rods and law.gain == 0.0:
        raise DesatError(
            f"{target}: --rods: no rods work between its dumps; manager.by = both has them"
        )
    rods = tuple(map(quantities.RODS, axes.rods))
    if not rods:
        rods = tuple(x * hardware.m_limit for x in _RODS if law.gain > 0.0) or (0.0,)
    axes = DumpAxes(
        tuple(map(quantities.WHEELS, axes.wheels or [x * capacity for x in _WHEELS])),
        tuple(map(quantities.THRESHOLDS, axes.thresholds or _THRESHOLDS)),
        rods,
        tuple(map(quantities.YEARS, axes.years or _YEARS)),
    )
    progress("the days of the scenario")
    flight = fly_days(system, wanted_attitude(system))
    progress(f"{len(axes.wheels) * len(axes.thresholds) * len(axes.rods)} dumpers")
    return DumpMap(
        target=target,
        cells=tuple(_cells(flight, hardware, law, cost, axes)),
        years=axes.years,
        tank=float(system.components["thrusters"].values.get("tank", 0.0)),
        has_rods=law.gain > 0.0,
    )


def _cells(
    flight: Flight,
    hardware: Hardware,
    law: ThresholdLaw,
    cost: ThrusterCost,
    axes: DumpAxes,
) -> Iterator[DumpCell]:
    """Yield the cells of a map, threshold by threshold."""
    end_share = law.end / smallest_wheel_capacity(hardware)
    for rod in axes.rods:
        craft = replace(hardware, m_limit=rod) if law.gain > 0.0 else hardware
        for wheel in axes.wheels:
            for percent in axes.thresholds:
                begin, end = percent / 100.0 * wheel, end_share * wheel
                cell = DumpCell(wheel, begin, end, rod, nan, nan)
                if begin - end > max(0.5 * law.pulse, 0.05 * end):
                    other = law.between(begin, end, wheel)
                    rates = rates_of(flight, craft, other, cost)
                    cell = cell._replace(a_week=rates.a_week, a_year=rates.a_year)
                yield cell
