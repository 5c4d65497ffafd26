"""Hold the result of a sizing: numbers, margins, problems and the answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import Any

import numpy as np

from ..analyses.flight import Attitude
from ..numbers.text import format_duration, format_momenta
from ..system.typed import JsonObject
from .momentum import SourceShare
from .requirements import SizingRequirements
from .rods import LARGEST_MULTIPLE, Best, SizingPoint
from .year import YearDate


@dataclass(frozen=True)
class Margin:
    """A requirement beside the craft's value."""

    name: str
    needed: float
    has: float
    unit: str

    @property
    def ratio(self) -> float:
        """Return the craft's value over the required one."""
        return self.has / self.needed if self.needed > 0.0 else inf


@dataclass(frozen=True)
class RodsByCondition:
    """Smallest rods that hold under a condition, by law."""

    condition: str  # text for the user
    # law -> A m2; None: none up to LARGEST_MULTIPLE times the least
    rods: Mapping[str, float | None]


@dataclass(frozen=True, repr=False)
class Sizing:
    """Requirements of a craft beside its hardware.

    Momenta are in N m s, torques in N m, dipoles in A m2, times in s.
    """

    target: str
    orbits: int
    period: float
    attitude: str  # nadir, inertial or moving
    secular: tuple[float, ...]  # N m, eci
    per_orbit: float  # N m s, secular momentum of an orbit
    cyclic: float  # N m s, largest distance of the cyclic momentum from its middle
    sources: tuple[SourceShare, ...]
    # N m, secular torque of no source; None: the sources are unknown
    unexplained: float | None
    year: tuple[YearDate, ...]
    # N m s, of the fullest wheel for the cyclic and body momentum as the attitude
    # turns, and a bias
    wheel_needed: float
    slew_momentum: float  # N m s, of the fullest wheel, 2 I theta / T
    slew_torque: float  # N m, of that wheel, 4 I theta / T^2
    wheel_capacity: float  # N m s, of the smallest wheel; inf: no limit
    wheel_torque: float  # N m, limit of a wheel
    # s, until a wheel that starts at rest is full without dumping; inf: never
    time_without: float
    least_formula: float
    least: float  # A m2, by the linear programme
    rod: float  # A m2, of the craft
    best: tuple[Best, ...]  # by law, the craft's own first where the model has it
    # rods with the required margin and duty, easier conditions first
    conditions: tuple[RodsByCondition, ...]
    law: str  # law of the recommended rods, the first of `best`
    # A m2, smallest rod with the required margin and duty on the worst day of the year,
    # with which the wheels suffice and `worst.toml` meets its requirements; None: there
    # is none
    recommended: float | None
    # A m2, the same without `worst.toml`, by the model alone
    recommended_year: float | None
    recommended_day: float | None  # A m2, the same for the day of the scenario alone
    # date and solar activity, or that it is the scenario's own day; empty: no other day
    # was examined
    worst_day: str
    least_year: float  # A m2, least rod of any law on that day, by the linear programme
    # scenario that the recommended rods meet too; empty: there is none, or it did not
    # fly
    worst_scenario: str
    # unit vector, eci: the rods have least authority against a torque along it
    weakest: tuple[float, ...]
    weakness: float  # authority there over its mean over all directions
    # s, longest time in which rods of 1.3 times the least cannot cancel the secular
    # torque
    blind: float
    tip_off_rate: float  # rad/s, rate of the body after separation
    tip_off: float  # N m s, momentum of the body after separation
    # s, minimum time to remove that momentum from a tumbling craft with saturated rods
    detumbling: float
    # s, the same at the wanted attitude, from its wheels, in the worst direction
    first_dump: float
    # s, as `detumbling`, with the recommended rods
    detumbling_recommended: float | None
    # s, as `first_dump`, with the recommended rods
    first_dump_recommended: float | None
    start_momentum: float  # N m s, of the wheels at the start
    start_dump: float  # s, as `first_dump`, for `start_momentum`
    # kg a year, of thrusters alone in this layout, where dumps begin as a wheel is
    # full; None: unknown
    propellant: float | None
    # kg a year, the same where each dump waits for its cheapest attitude
    propellant_least: float | None
    requirements: SizingRequirements
    curve: tuple[SizingPoint, ...]
    margins: tuple[Margin, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def as_json(self) -> JsonObject:
        """Return the data that `--json` prints; infinite numbers are null."""
        data = {name: finite(value) for name, value in asdict(self).items()}
        for row, margin in zip(data["margins"], self.margins, strict=True):
            row["ratio"] = finite(margin.ratio)
        data["wishes"] = data.pop("requirements")
        return data | {"answer": self.answer}

    def __repr__(self) -> str:
        return f"<Sizing {self.answer}>"

    @property
    def duty(self) -> float:
        """Return the required duty of the coils (1)."""
        return self.requirements.duty

    @property
    def answer(self) -> str:
        """Return the sentence that answers the sizing."""
        if self.problems:
            rods = (
                ""
                if self.recommended is None or self.recommended <= self.rod
                else (f" Rods of {self.recommended:.3g} A m2 do.")
            )
            return f"{self.target} cannot hold: {self.problems[0]}.{rods}"
        required = (
            f" with a duty of {100.0 * self.duty:.3g} % and a margin of "
            f"{self.requirements.margin:g} under {self.law}"
        )
        if not self.best:
            rods = (
                f"the least rod of any law is {max(self.least, self.least_year):.3g} A m2 (the "
                "model has no law that fits)"
            )
            required = ""
        elif self.recommended is None:
            rods = (
                f"no rods of up to {LARGEST_MULTIPLE:g} times the least, "
                f"{max(self.least, self.least_year):.3g} A m2, do"
            )
        else:
            rods = f"rods of {self.recommended:.3g} A m2 are recommended: they hold {self._held()}"
        text = f"{self.target}: {rods}{required}; it has {self.rod:.4g} A m2. "
        if (
            self.detumbling_recommended is not None
            and self.first_dump_recommended is not None
        ):
            text += (
                f"With {self.recommended:.3g} A m2 detumbling takes at least "
                f"{format_duration(self.detumbling_recommended)}, the first dump "
                f"{format_duration(self.first_dump_recommended)}. "
            )
        needs, has = self.wheel_needed + self.slew_momentum, self.wheel_capacity
        if has == inf:
            return (
                text
                + f"Its wheels need {format_momenta(needs)} each and have no limit."
            )
        return text + f"Its wheels need {format_momenta(needs, has)} each."

    def _held(self) -> str:
        """Return the hardest condition under which the recommended rods hold."""
        rod, year = self.recommended, self.recommended_year
        if self.worst_scenario and rod is not None and (year is None or rod > year):
            return self.worst_scenario
        if self.worst_day:
            return f"the worst day of the year ({self.worst_day})"
        return "the day of the scenario"


def finite(value: Any) -> Any:
    """Convert a value for JSON: numbers that are not finite become null."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _cyclic_margins(sizing: Sizing) -> Iterator[Margin]:
    """Yield the cyclic momentum, alone and with a slew, beside the wheels' capacity."""
    if sizing.wheel_capacity == inf:
        return
    yield Margin(
        "wheels: cyclic momentum", sizing.wheel_needed, sizing.wheel_capacity, "N.m.s"
    )
    if sizing.slew_momentum > 0.0:
        both = sizing.wheel_needed + sizing.slew_momentum
        yield Margin(
            "wheels: cyclic momentum and slew", both, sizing.wheel_capacity, "N.m.s"
        )


def find_margins(sizing: Sizing, filled: float | None) -> Iterator[Margin]:
    """Yield each requirement beside the craft's value.

    `filled` is the momentum (N m s) of the fullest wheel on the worst day with the
    craft's rods; None if it is unknown.
    """
    if sizing.least < inf:
        yield Margin("rods: any law, this day", sizing.least, sizing.rod, "A.m2")
    if sizing.least_year > 0.0:
        yield Margin(
            "rods: any law, worst day of the year",
            sizing.least_year,
            sizing.rod,
            "A.m2",
        )
    if sizing.recommended is not None:
        yield Margin(
            f"rods: {sizing.law}, duty and margin",
            sizing.recommended,
            sizing.rod,
            "A.m2",
        )
    if filled is not None and 0.0 < sizing.wheel_capacity < inf:
        yield Margin(
            f"wheels: {sizing.law} with its rods, worst day",
            filled,
            sizing.wheel_capacity,
            "N.m.s",
        )
    yield from _cyclic_margins(sizing)
    for row in (r for r in sizing.curve if r.law == sizing.law and r.rod == sizing.rod):
        if row.filled is not None:
            yield Margin(
                f"wheels: {row.law} with its rods",
                row.filled * sizing.wheel_capacity,
                sizing.wheel_capacity,
                "N.m.s",
            )
        if row.duty is not None:
            yield Margin(
                f"coils: duty by {row.law} with its rods", row.duty, sizing.duty, "1"
            )
    if sizing.slew_torque > 0.0 and sizing.wheel_torque < inf:
        yield Margin(
            "wheels: torque of the slew", sizing.slew_torque, sizing.wheel_torque, "N.m"
        )


def find_problems(sizing: Sizing) -> list[str]:
    """Return why the craft cannot hold its momentum, one reason a line."""
    lines = []
    if sizing.least == inf:
        lines.append(
            "no rod takes the secular torque out: the field is along it all the time"
        )
    elif sizing.rod < sizing.least:
        lines.append(
            f"rods of {sizing.rod:.4g} A m2: the secular torque needs at least "
            f"{sizing.least:.4g} A m2 with any law"
        )
    else:
        lines += [
            f"rods of {m.has:.4g} A m2: the worst day of the year needs at least {m.needed:.4g} "
            "A m2 with any law"
            for m in sizing.margins
            if "worst day" in m.name and m.ratio < 1.0
        ]
    lines += [
        f"wheels of {format_momenta(m.has)}: {sizing.law} with its rods of {sizing.rod:.4g} A m2 "
        f"lets the fullest one come to {format_momenta(m.needed)}"
        f"{' on the worst day' * m.name.endswith('day')}"
        for m in sizing.margins
        if m.name.startswith(f"wheels: {sizing.law} with its rods") and m.ratio < 1.0
    ]
    if sizing.wheel_needed > sizing.wheel_capacity:
        lines.append(
            f"wheels of {format_momenta(sizing.wheel_capacity)}: the cyclic momentum alone needs "
            f"{format_momenta(sizing.wheel_needed)} of the fullest one"
        )
    elif sizing.wheel_needed + sizing.slew_momentum > sizing.wheel_capacity:
        lines.append(
            f"wheels of {format_momenta(sizing.wheel_capacity)}: cyclic momentum and slew need "
            f"{format_momenta(sizing.wheel_needed + sizing.slew_momentum)} of the fullest one"
        )
    if sizing.slew_torque > sizing.wheel_torque:
        lines.append(
            f"wheels of {sizing.wheel_torque:.4g} N m: the slew needs "
            f"{sizing.slew_torque:.4g} N m of the fullest one"
        )
    return lines


def find_notes(sizing: Sizing, attitude: Attitude) -> list[str]:
    """Return the limits of the numbers, a line each."""
    lines = []
    if sizing.orbits < 14:
        lines.append(
            f"{sizing.orbits} whole orbits: a day (--stop 86400) sees the field turn once"
        )
    if (
        sizing.least < inf
        and abs(sizing.least - sizing.least_formula) > 0.01 * sizing.least_formula
    ):
        lines.append(
            "formula and linear programme differ by more than 1 %: the latter counts"
        )
    if attitude.kind == "moving":
        lines.append(
            "the attitude moves: rods and wheels are those of the run as it was flown"
        )
    return lines
