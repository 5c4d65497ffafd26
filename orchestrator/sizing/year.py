"""Fly the days of a year with the environment's block, at the attitude of a run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analyses.flight import (
    TURN_ROWS,
    Attitude,
    Flight,
    Hardware,
    between,
    environment_block,
    flown_at,
    inputs_at,
    needless,
    secular,
    turn_of,
    values_of,
)
from ..analyses.motion import mu_of, period_of
from ..system.errors import DesatError
from ..system.model import Component, System, Values
from .least_rod import least_by_formula, least_by_programme, reach
from .momentum import cyclic_span

Array = NDArray[Any]
YEAR_DATES = 13  # days of a year that are examined
YEAR_DATE_SPACING = 28  # d
YEAR_ROW_SPACING = 120.0  # s
WORST_DAY_ROW_SPACING = 10.0  # s


@dataclass(frozen=True)
class YearDate:
    """A day of the year."""

    day: str
    activity: str  # solar activity; empty: that of the scenario
    secular: float  # N m
    per_orbit: float  # N m s
    cyclic: float  # N m s
    least: float  # A m2, least rod by the formula


@dataclass(frozen=True)
class WorstDay:
    """The day of the year that needs the largest rods."""

    day: str
    activity: str  # solar activity; empty: that of the scenario
    least: float  # A m2, least rod of any law, by the linear programme
    flight: Flight


def days_of_year(
    system: System, hardware: Hardware, attitude: Attitude, own_day: bool = False
) -> Iterator[tuple[YearDate, tuple[dict[str, Array], Array]]]:
    """Yield the days of a year, each with the environment's outputs and times (s).

    Each day has low and high solar activity where air matters; with `own_day` that of the
    scenario comes first.

    Raises
    ------
    DesatError
        If the attitude moves, or the environment has no outputs at these times.
    """
    if attitude.kind == "moving":
        raise DesatError(
            f"the attitude stays neither in eci nor in lvlh ("
            f"{np.degrees(attitude.wanders):.3g} deg from its mean)"
        )
    component = system.components["environment"]
    block = environment_block(component, needless(system))
    first = inputs_at(block, [0.0])
    period = period_of(first["r_eci"][0], first["v_eci"][0], mu_of(system))
    span = period * max(1, int(86400.0 / period))
    spacing = min(YEAR_ROW_SPACING, turn_of(system) / TURN_ROWS)
    since = np.linspace(0.0, span, round(span / spacing) + 1)
    levels = _activities(component, values_of(system)["spacecraft"], own_day)
    epoch = float(getattr(block, "epoch_j2000", 0.0))
    begin = datetime(2000, 1, 1, 12, tzinfo=UTC) + timedelta(seconds=epoch)
    for k in range(YEAR_DATES):
        times = since + 86400.0 * YEAR_DATE_SPACING * k
        inputs = inputs_at(block, times.tolist())
        for name, changes in levels:
            if changes:
                air = environment_block(component, changes)
                inputs = inputs | {"density": inputs_at(air, times.tolist())["density"]}
            flight = flown_at(system, attitude, inputs, times)
            torque, cyclic = secular(flight)
            size = float(np.linalg.norm(torque))
            date = YearDate(
                day=(begin + timedelta(days=YEAR_DATE_SPACING * k)).date().isoformat(),
                activity=name,
                secular=size,
                per_orbit=size * flight.period,
                cyclic=cyclic_span(cyclic),
                least=least_by_formula(reach(flight, hardware), torque),
            )
            yield date, (inputs, times)


def _activities(
    component: Component, craft: Values, own_activity: bool
) -> list[tuple[str, dict[str, int]]]:
    """Return levels of solar activity, as changes of an environment without a field.

    They are low and high where air matters and the environment has them; otherwise one
    level without changes. With `own_activity` the scenario's comes first, or is the only one
    where its atmosphere does not follow the activity.
    """
    signals = component.interface.signals
    thin = craft.get("aerodynamics", "none") == "none"
    if (
        thin
        or "solar_activity" not in signals
        or "density" not in component.interface.signals
    ):
        return [("", {})]

    def number(name: str, choice: str) -> int:
        """Return the number of a choice."""
        return signals[name].choices.index(choice)

    still = {
        "field": number("field", "none"),
        "atmosphere": number("atmosphere", "activity"),
    }
    levels = [
        (x, still | {"solar_activity": number("solar_activity", x)})
        for x in ("low", "high")
    ]
    if not own_activity or component.choice("atmosphere") != "activity":
        return levels if not own_activity else [("", {})]
    mine = component.choice("solar_activity")
    return [(mine, {}), *((name, changes) for name, changes in levels if name != mine)]


def find_worst_day(
    system: System,
    hardware: Hardware,
    attitude: Attitude,
    days: Sequence[tuple[YearDate, Any]],
) -> WorstDay:
    """Fly the day with the largest least rod, at rows close enough for the model."""
    date, (inputs, nodes) = max(days, key=lambda d: d[0].least)
    times = np.linspace(
        nodes[0], nodes[-1], round((nodes[-1] - nodes[0]) / WORST_DAY_ROW_SPACING) + 1
    )
    flight = flown_at(system, attitude, between(inputs, nodes, times), times)
    torque, _ = secular(flight)
    least = least_by_programme(reach(flight, hardware), torque)
    return WorstDay(day=date.day, activity=date.activity, least=least, flight=flight)
