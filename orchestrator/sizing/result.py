"""What a sizing says: its numbers, margins, problems, and the sentence that answers."""

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
    """What is needed beside what there is."""

    name: str
    needed: float
    has: float
    unit: str

    @property
    def ratio(self) -> float:
        """What it has over what it needs."""
        return self.has / self.needed if self.needed > 0.0 else inf


@dataclass(frozen=True)
class RodsByCondition:
    """The smallest rods that hold under a condition, law by law."""

    condition: str
    """for people"""
    rods: Mapping[str, float | None]
    """law -> A m2; None: none up to LARGEST_MULTIPLE times the least"""


@dataclass(frozen=True, repr=False)
class Sizing:
    """What a craft needs, beside what it has. Momenta N m s, torques N m, dipoles A m2,
    times s."""

    target: str
    orbits: int
    period: float
    attitude: str
    """nadir, inertial or moving"""
    secular: tuple[float, ...]
    """eci"""
    per_orbit: float
    """secular momentum of an orbit"""
    cyclic: float
    """largest size of the cyclic momentum about its middle"""
    sources: tuple[SourceShare, ...]
    unexplained: float | None
    """secular torque that is of no source, N m; None: the sources are not known"""
    year: tuple[YearDate, ...]
    wheel_needed: float
    """of the fullest wheel, to hold cyclic and body momentum as the attitude turns, and
    a bias"""
    slew_momentum: float
    """of the fullest wheel, 2 I theta / T"""
    slew_torque: float
    """of it, 4 I theta / T^2"""
    wheel_capacity: float
    """of the smallest wheel; inf where it has no limit"""
    wheel_torque: float
    """of a wheel at most"""
    time_without: float
    """until a wheel that starts at rest is full without dumping; inf: never"""
    least_formula: float
    least: float
    """by the linear programme"""
    rod: float
    """that the craft has"""
    best: tuple[Best, ...]
    """law by law, the craft's own first where the model has it"""
    conditions: tuple[RodsByCondition, ...]
    """the rods with the margin and the duty asked for, under conditions that are easier
    first"""
    law: str
    """of the recommended rods, the first of these"""
    recommended: float | None
    """the smallest with the margin and the duty asked for on the worst day of the year,
    with which the wheels suffice and `worst.toml` meets its requirements; None: there
    is none"""
    recommended_year: float | None
    """the same without `worst.toml`, by the model alone"""
    recommended_day: float | None
    """the same for the day of the scenario alone"""
    worst_day: str
    """and the activity of the Sun on it, or that it is the scenario's own; empty: no
    other day was looked at"""
    least_year: float
    """least rod for any law on that day, by the linear programme"""
    worst_scenario: str
    """the scenario that the recommended rods meet, too; empty: there is none, or it did
    not fly"""
    weakest: tuple[float, ...]
    """eci: against a torque along it the rods do least"""
    weakness: float
    """what they do there over what they do on the average of all directions"""
    blind: float
    """the longest time in which rods of 1.3 times the least cannot undo the secular
    torque"""
    tip_off_rate: float
    """rate of the body after separation, rad/s"""
    tip_off: float
    """momentum of the body after separation"""
    detumbling: float
    """least time in which its rods, at their limits, take that out of a craft that
    tumbles"""
    first_dump: float
    """the same at the wanted attitude, from its wheels, in the worst direction"""
    detumbling_recommended: float | None
    """as `detumbling`, with the recommended rods"""
    first_dump_recommended: float | None
    """as `first_dump`, with these"""
    start_momentum: float
    """of the wheels at the start"""
    start_dump: float
    """the same for that"""
    propellant: float | None
    """kg a year, of thrusters alone in this layout, where dumps begin as a wheel is
    full; None: they are not known"""
    propellant_least: float | None
    """the same where each dump waits for the attitude at which it costs least"""
    requirements: SizingRequirements
    curve: tuple[SizingPoint, ...]
    margins: tuple[Margin, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def as_json(self) -> JsonObject:
        """Return what `--json` prints; what is without end is null."""
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
        """Return the sentence that answers."""
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
        """Return the hardest condition that the recommended rods hold, for people."""
        rod, year = self.recommended, self.recommended_year
        if self.worst_scenario and rod is not None and (year is None or rod > year):
            return self.worst_scenario
        if self.worst_day:
            return f"the worst day of the year ({self.worst_day})"
        return "the day of the scenario"


def finite(value: Any) -> Any:
    """Return a value for JSON: null where a number is not finite."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def find_margins(sizing: Sizing, filled: float | None) -> Iterator[Margin]:
    """Yield what is needed beside what there is, a row each. `filled`: what the fullest
    wheel comes to on the worst day with the craft's rods (N m s); None: it is not
    known."""
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
    if sizing.wheel_capacity < inf:
        yield Margin(
            "wheels: cyclic momentum",
            sizing.wheel_needed,
            sizing.wheel_capacity,
            "N.m.s",
        )
        if sizing.slew_momentum > 0.0:
            both = sizing.wheel_needed + sizing.slew_momentum
            yield Margin(
                "wheels: cyclic momentum and slew", both, sizing.wheel_capacity, "N.m.s"
            )
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
    """Return why the craft cannot hold its momentum, a line each."""
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
    """Return what the numbers do not say, a line each."""
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
