"""Hold the result of a sizing: numbers, margins, problems and the answer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from math import inf
from typing import TYPE_CHECKING, NamedTuple

from ..analyses.flight import Attitude
from ..figures.canvas import Figure
from ..numbers.text import format_duration, format_momenta
from ..report.cases import Margin, tabulate_margins
from ..system.typed import JsonObject
from .attitude import LeastAttitude
from .intervals import (
    MOST_DRAWS,
    AssumptionShare,
    Interval,
    describe_interval,
    describe_width,
    gravity_leads,
)
from .margins import (
    as_html,
    describe_margins,
    finite,
    first_figure,
    margins_as_json,
    quantities_of,
    tabulate_spread,
)
from .momentum import SourceShare
from .requirements import SizingRequirements
from .rods import LARGEST_MULTIPLE, Best, SizingPoint
from .year import YearDate

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]


class Course(NamedTuple):
    """Fullest wheel (N m s) and duty (1) of a craft with its own rods."""

    wheel: float
    duty: float


# Cases, and beginnings of those in which what is assumed is at its end.
SCENARIO_DAY = "the day of the scenario"
WORST_DAY = "the worst day of the year"
ENDS = "what is assumed at its ends"
WHEEL_LOSS = "a wheel lost"
SEPARATION = "after separation"
ASSUMED_CASES = (MOST_DRAWS, ENDS, WHEEL_LOSS)


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
    craft: str  # digest of its parameters
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
    body_rate: float  # rad/s, that wheels at rest take over; inf: no limit
    # the attitude with least momentum; None: the wanted one, or it cannot be turned
    least_attitude: LeastAttitude | None
    # N m s, of the null space, with which no wheel passes zero; inf: none does
    bias_needed: float
    # N m s, that a scenario's requirement allows of the smallest wheel; inf: no limit
    wheel_allowed: float
    duty_allowed: float  # 1, the same of the coils
    # N m s, as `wheel_needed` where the wheel is lost that is missed most; 0: no other
    # wheels can do its work, inf: none can
    wheel_lost: float
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
    # A m2, the same for a share of the draws of what is not known for sure
    recommended_share: float | None
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
    intervals: tuple[Interval, ...]  # over what is not known for sure; empty: all is
    assumptions: tuple[
        AssumptionShare, ...
    ]  # by the share in the width of the momentum a day
    curve: tuple[SizingPoint, ...]
    margins: tuple[Margin, ...]  # worst first
    problems: tuple[str, ...]
    change: str  # the smallest one with which it would hold, as a sentence
    notes: tuple[str, ...]

    def as_json(self) -> JsonObject:
        """Return the data that `--json` prints; infinite numbers are null."""
        data = {name: finite(value) for name, value in asdict(self).items()}
        data["margins"] = margins_as_json(self.margins)
        data["wishes"] = data.pop("requirements")
        return data | {"answer": self.answer}

    def __repr__(self) -> str:
        return f"<Sizing {self.answer}>"

    def _repr_html_(self) -> str:
        tables = tabulate_spread(self.intervals, self.assumptions)
        margins = tabulate_margins(self.margins)
        return as_html(self.answer, (margins, *tables), self.plot())

    def plot(self) -> Figure | None:
        """Draw the first figure of its page; None where it has none."""
        return first_figure(self)

    @property
    def duty(self) -> float:
        """Return the required duty of the coils (1)."""
        return self.requirements.duty

    @property
    def answer(self) -> str:
        """Return the sentence that answers the sizing."""
        if self.problems:
            gravity = gravity_leads(self.sources, self.assumptions)
            return (
                f"{self.target} cannot hold: {self.problems[0]}.{self.change}{gravity}"
            )
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
        margins = [m for m in self.margins if m.of not in ("rods", "time")]
        holds = describe_margins(self.target, margins)
        text = f"{holds}{self._leading()}. {rods[0].upper()}{rods[1:]}{required}; "
        text += f"it has {self.rod:.4g} A m2. "
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
            text += f"Its wheels need {format_momenta(needs)} each and have no limit."
        else:
            text += f"Its wheels need {format_momenta(needs, has)} each."
        return text + self._width()

    @property
    def numbers(self) -> DataFrame:
        """Return the quantities as a table: value, and unit, by title."""
        return quantities_of(self, "tabulate_quantities")

    def _leading(self) -> str:
        """Say which source has most of the secular momentum."""
        first = max(self.sources, key=lambda x: x.along, default=None)
        if first is None or first.along <= 0.0:
            return ""
        return f"; {100.0 * first.along:.0f} % of the momentum is by {first.name}"

    def _width(self) -> str:
        """Return how far the momentum a day spreads, and why; "" where all is known."""
        if not self.intervals:
            return ""
        a_day = self.intervals[0]
        width = describe_width(a_day, self.assumptions)
        return f" It gains {describe_interval(a_day)}{width}."

    def _held(self) -> str:
        """Return the hardest condition under which the recommended rods hold."""
        rod, year = self.recommended, self.recommended_year
        share = self.recommended_share
        if self.worst_scenario and rod is not None and (share is None or rod > share):
            return self.worst_scenario
        if share is not None and year is not None and share > year:
            return f"for {MOST_DRAWS}, on {WORST_DAY}"
        if self.worst_day:
            return f"the worst day of the year ({self.worst_day})"
        return SCENARIO_DAY


def find_margins(
    sizing: Sizing, courses: Mapping[str, Course], time_to_detumble: float = inf
) -> list[Margin]:
    """Return what the craft uses in each case beside what it is allowed, worst first.

    `courses` are the cases that the model flew with the craft's own rods, the time (s)
    is that within which it has to be detumbled.
    """
    capacity = sizing.wheel_allowed
    has_wheels = 0.0 < capacity < inf
    day = SCENARIO_DAY
    rows = []
    if sizing.least < inf:
        rows.append(Margin(f"{day}, any law", "rods", sizing.least, sizing.rod, "A.m2"))
    if 0.0 < sizing.least_year < inf:
        rows.append(
            Margin(
                f"{WORST_DAY}, any law", "rods", sizing.least_year, sizing.rod, "A.m2"
            )
        )
    if has_wheels:
        for case, needed in (
            (f"{day}, cyclic part", sizing.wheel_needed),
            (f"{WHEEL_LOSS}, cyclic part", sizing.wheel_lost),
        ):
            if 0.0 < needed < inf:
                rows.append(Margin(case, "wheels", needed, capacity, "N.m.s"))
    for case, course in courses.items():
        if has_wheels:
            rows.append(Margin(case, "wheels", course.wheel, capacity, "N.m.s"))
        duty, limit = 100.0 * course.duty, 100.0 * sizing.duty_allowed
        rows.append(Margin(case, "coils", duty, limit, "%"))
    if time_to_detumble < inf:
        hours = sizing.detumbling / 3600.0, time_to_detumble / 3600.0
        rows.append(Margin(f"{SEPARATION}, at least", "time", *hours, "h"))
    rows += _margins_of_slew(sizing)
    return sorted(rows, key=lambda m: m.margin)


def _margins_of_slew(sizing: Sizing) -> Iterator[Margin]:
    """Yield what a slew takes of the fullest wheel, if there is one."""
    if 0.0 < sizing.wheel_capacity < inf and sizing.slew_momentum > 0.0:
        both = sizing.wheel_needed + sizing.slew_momentum
        yield Margin("slew", "wheels", both, sizing.wheel_capacity, "N.m.s")
    if sizing.slew_torque > 0.0 and sizing.wheel_torque < inf:
        torque = sizing.slew_torque, sizing.wheel_torque
        yield Margin("slew", "wheel torque", *torque, "N.m")


def find_problems(sizing: Sizing) -> list[str]:
    """Return why the craft cannot hold its momentum, one reason a line.

    Cases in which what is assumed is at its end are not among them, as they are a
    matter of `worst.toml`, nor is a wheel that is lost.
    """
    lines = []
    if sizing.least == inf:
        lines.append(
            "no rod takes the secular torque out: the field is along it all the time"
        )
    return lines + [
        f"{_needs(m, sizing)}: {m.case}"
        for m in sizing.margins
        if m.margin < 0.0 and not m.case.startswith(ASSUMED_CASES)
    ]


def _needs(margin: Margin, sizing: Sizing) -> str:
    """Say what a case takes beside what there is."""
    if margin.of == "rods":
        return (
            f"rods of {margin.limit:.4g} A m2: the secular torque needs at least "
            f"{margin.used:.4g} A m2"
        )
    if margin.of == "coils":
        return (
            f"rods of {sizing.rod:.4g} A m2: their duty comes to "
            f"{margin.used:.3g} % of {margin.limit:.3g} % allowed"
        )
    if margin.of == "time":
        return (
            f"rods of {sizing.rod:.4g} A m2: detumbling takes {margin.used:.3g} h or "
            f"more, of {margin.limit:.3g} h allowed"
        )
    if margin.unit == "N.m":
        return (
            f"wheels of {margin.limit:.4g} N m: the slew needs {margin.used:.4g} N m of "
            "the fullest one"
        )
    return (
        f"wheels, {format_momenta(margin.limit)} of them allowed: the fullest one "
        f"comes to {format_momenta(margin.used)}"
    )


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
    if sizing.wheel_lost == inf:
        lines.append(f"{WHEEL_LOSS}: those that are left give no torque about an axis")
    if attitude.kind == "moving":
        lines.append(
            "the attitude moves: rods and wheels are those of the run as it was flown"
        )
    return lines
