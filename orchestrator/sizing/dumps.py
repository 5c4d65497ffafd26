"""Size dumps by thrusters between thresholds (`manager_threshold`) for `desat size`.

The results are how often the craft dumps, the propellant of a dump and of a year, and
how long the tank lasts.

The momentum H (N m s, eci) grows by the impulse of the disturbances at the wanted
attitude C(t), which the environment's own block gives. With h_b the momentum of the
body and A^+ the least-squares allocation to the wheels,

    h(t) = A^+ (C(t) H(t) - h_b(t)),   a dump begins where the fill of h reaches `begin`

and the law's own block continues it to its `end`. A dump takes the impulse of force
that the thrusters need for its momentum u in the attitude where it begins: |u|_1 / arm
for pairs about the axes, the least on-times for nozzles (`least_on_times`).

One degree of the orbit, or a threshold that differs by APART, decides in which quarter
of the orbit the next dump begins. WAYS such courses show how far the rates differ.
Rates are taken between the first and the last dump of the course that the craft flies
itself. Those of a year are the mean over the days of a year, each as if it lasted, and
over the courses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from itertools import pairwise
from math import ceil, floor, hypot, inf, nan, pi, sqrt
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.bases.dumping import DUMPING

from ..analyses import attitude_loop, unmanaged_orbit, wheels
from ..analyses.flight import (
    TURN_ROWS,
    Attitude,
    Flight,
    Hardware,
    environment_block,
    flown_at,
    fly_days,
    hardware_of,
    inputs_at,
    needless,
    secular,
    turn_of,
    values_of,
    wanted_attitude,
)
from ..analyses.motion import BEYOND, mu_of
from ..campaign.draws import series_of_numbers
from ..campaign.sampling import draw_one
from ..figures.canvas import Figure
from ..language.content import content_of, dispersions_of
from ..numbers.derived import rotate, rotate_back
from ..numbers.text import format_duration, format_momenta
from ..report.cases import Margin, craft_digest, tabulate_margins
from ..runs.case import Case
from ..runs.prepare import prepare, read, resolved
from ..runs.run import Run, simulate
from ..system.errors import DesatError
from ..system.expression import factor
from ..system.model import System
from ..system.options import Options
from ..system.parameters import unit_of
from ..system.typed import JsonObject
from .attitude import LeastAttitude, find_least_attitude
from .changes import would_do
from .compatibility import terms_of
from .intervals import (
    MOST_DRAWS,
    SEED,
    AssumptionShare,
    CraftDraws,
    Interval,
    describe_interval,
    describe_width,
    draw,
    draw_followed,
    follow,
    fullest_wheel,
    gravity_leads,
    interval,
)
from .law import UnsuitedError
from .margins import (
    as_html,
    describe_margins,
    finite,
    first_figure,
    margins_as_json,
    quantities_of,
    tabulate_spread,
)
from .momentum import (
    SourceShare,
    compute_body_rate,
    compute_slew,
    shares_of,
    smallest_wheel_capacity,
)
from .propellant import YEAR, DumpCost, ThrusterCost, thruster_cost
from .requirements import SizingRequirements
from .rods import find_rods_of_laws, other_laws, round_up
from .scenarios import closed_loop_only, doubts, find_worst_scenario
from .threshold import COILS, ThresholdLaw, threshold_law
from .year import YearDate, days_of_year

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]

Array = NDArray[Any]
LAW = "manager_threshold"
# Dumps of a course, courses that rates are the mean of, and largest relative change of
# their thresholds in either direction.
TRIED, WAYS, APART = 10, 8, 0.01
# Maximum number of dumps that are followed after the first, and of steps to follow
# them.
MANY, MOST_STEPS = 25, 1_500_000
NOTHING = DumpCost(*[0.0] * len(DumpCost._fields))
# Numbers of the closed loop that are shown beside the sizes, and their units here.
LOOP = {
    "dumps_a_week": "1",
    "propellant_a_year": "kg",
    "first_dump": "s",
    "dumps": "1",
    "dump_momentum": "N.m.s",
    "dump_propellant": "kg",
    "dump_net_impulse": "N.s",
    "dump_energy": "J",
    "dump_time": "s",
    "pointing_largest": "deg",
}
# Cases: those that are no problem of the model.
SLEW_CASE, LOOP_CASE = "slew at that time", "closed loop"
LONGEST = 20.0 * YEAR  # s: maximum time to the first dumps
PARTS = 5  # days of a scenario that are examined
# Spacing of rows in deep space (s), and maximum number of rows of a flight through all
# dumps.
COARSE, MOST_ROWS = 1200.0, 100_000
FEW = 4  # dumps of a draw of what is not known for sure, at least
MOST_SAMPLES = 10_000  # samples of a dump
LAST_SAMPLES = 8  # samples of a dump that are computed one by one
BETWEEN = 200  # minimum number of rows between two dumps
WEEK = 7.0 * 86400.0
# Thresholds, as shares of a wheel's capacity, for which dumps are sized beside the
# craft's own.
SHARES = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
CHEAPEST_OF, CHEAPEST_AT = (
    10,
    180,
)  # dumps, and attitudes at which their cost is evaluated
DUMPS_FLOWN, STEPS_FLOWN = 3, 800_000  # of the closed loop, at least
# Intervals between dumps after the first that the model follows, until there are two.
ROUNDS = (3, 6, 12)
SLOW_ORBIT = (
    4.0 * 3600.0
)  # s: a faster orbit gets rows of 2 min, which keep the field to 1e-5
COARSE_TURN = 0.1  # deg: a pulse that turns the craft further is coarse


@dataclass(frozen=True)
class DumpRates:
    """Mean rates of dumps: times s, momenta N m s, propellant kg."""

    first: float  # s, from wheels at rest to the first dump; inf: never
    interval: float
    momentum: float  # N m s, of a dump
    # of a dump, as of DumpCost
    impulse: float  # N s
    net_impulse: float  # N s
    propellant: float  # kg
    duration: float  # s
    pulses: float
    on_time: float  # s
    firing: float
    fullest: float = 0.0  # N m s, largest fill at which a dump begins
    # kg, of a dump that waits for the attitude at which its momentum costs least
    least_propellant: float = 0.0
    # dumps a week: range over courses that begin at other times with slightly other
    # thresholds
    least_a_week: float = 0.0
    most_a_week: float = 0.0

    def as_json(self) -> JsonObject:
        """Return the data for programs; infinite ones are null."""
        rates = {"a_week": self.a_week, "a_year": self.a_year}
        return {k: finite(x) for k, x in (asdict(self) | rates).items()}

    @property
    def takes(self) -> DumpCost:
        """Return what a dump takes."""
        return DumpCost(
            self.impulse,
            self.net_impulse,
            self.propellant,
            self.duration,
            self.pulses,
            self.on_time,
            self.firing,
        )

    @property
    def a_week(self) -> float:
        """Return the number of dumps a week."""
        return WEEK / self.interval if self.interval < inf else 0.0

    @property
    def a_year(self) -> float:
        """Return the propellant of a year (kg)."""
        return self.propellant * YEAR / self.interval if self.interval < inf else 0.0

    @property
    def least_a_year(self) -> float:
        """Return the propellant (kg) of a year of dumps at their cheapest attitude."""
        return (
            self.least_propellant * YEAR / self.interval if self.interval < inf else 0.0
        )


class Threshold(NamedTuple):
    """Dumps that begin at another fill than the craft's: N m s, dumps a week, kg a year."""

    begin: float
    a_week: float
    a_year: float


class RodsAlone(NamedTuple):
    """Rods (A m2) of a craft that dumps by thrusters, and what they would have to be."""

    has: float
    # smallest of all laws without the thrusters on the worst day; None: none holds
    needed: float | None
    law: str  # the law of `needed`

    @property
    def suffice(self) -> bool:
        """Return whether the rods would hold the craft without its thrusters."""
        return self.needed is not None and self.has >= self.needed


class DumpCourse(NamedTuple):
    """Fill (n,) N m s of the wheels over times (n,) s, and the times (s) of its dumps."""

    times: Array
    fill: Array
    dumps: Array


@dataclass(frozen=True, repr=False)
class DumpSizing:
    """Requirements of a craft that dumps by thrusters, beside its hardware."""

    target: str
    craft: str  # digest of its parameters
    period: float
    attitude: str
    secular: tuple[float, ...]  # N m, eci
    a_day: float  # N m s
    sources: tuple[SourceShare, ...]
    year: tuple[YearDate, ...]
    begin: float  # N m s
    end: float
    capacity: float  # N m s, of the smallest wheel
    steady: DumpRates  # in the time of the scenario
    # kg of propellant, mean over the days of a year with the scenario's solar activity
    a_year: float
    range_a_year: tuple[float, float]  # kg, least and most of these days
    # kg, the same with low and high solar activity, where air matters
    by_activity: Mapping[str, float]
    each_year: tuple[float, ...]  # kg, the same as if each day of `year` lasted
    # kg, as `a_year` where each dump waits for the attitude at which it costs least
    least_a_year: float
    weekly: float  # N m s, capacity of wheels that would dump once a week
    tank: float  # kg; 0: unknown
    pulse: float  # N m s, shortest pulse of the thrusters; 0: no lower limit
    slew_momentum: float  # N m s, of the fullest wheel in the required slew
    slew_torque: float  # N m, of that wheel
    wheel_torque: float  # N m, limit of a wheel
    # the numbers LOOP of the closed loop; empty: not flown
    loop: Mapping[str, float | None]
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    thresholds: tuple[Threshold, ...] = ()
    rods: RodsAlone | None = None  # None: it has none
    # through the dumps of the scenario's time; None: they are too many, or too late
    course: DumpCourse | None = None
    margins: tuple[Margin, ...] = ()  # worst first
    # in the time that the closed loop flies, in which the torque may be another
    within: DumpRates | None = None
    change: str = ""  # the smallest one with which it would hold, as a sentence
    mass: float = 0.0  # kg; 0: unknown
    body_rate: float = inf  # rad/s, that wheels at rest take over; inf: no limit
    power: float = 0.0  # W, electrical, of a nozzle or axis; 0: it takes none
    # the attitude with least momentum; None: the wanted one, or it cannot be turned
    least_attitude: LeastAttitude | None = None
    end_speed: float | None = None  # rad/s, of the fullest wheel; None: unknown
    # share (1) of the disturbances' momentum that coils take; None: they do not work
    coil_share: float | None = None
    intervals: tuple[Interval, ...] = ()  # over what is not known for sure
    assumptions: tuple[
        AssumptionShare, ...
    ] = ()  # by the share in the width of the momentum a day

    def __repr__(self) -> str:
        return f"<DumpSizing {self.answer}>"

    def _repr_html_(self) -> str:
        tables = tabulate_spread(self.intervals, self.assumptions)
        margins = tabulate_margins(self.margins)
        return as_html(self.answer, (margins, *tables), self.plot())

    def plot(self) -> Figure | None:
        """Draw the first figure of its page; None where it has none."""
        return first_figure(self)

    @property
    def years(self) -> float:
        """Return how long the tank lasts (years); nan if its content is unknown."""
        if self.tank == 0.0:
            return nan
        return self.tank / self.a_year if self.a_year > 0.0 else inf

    def as_json(self) -> JsonObject:
        """Return the data that `--json` prints; infinite or unknown values are null."""
        bare = replace(self, course=None)
        document = {k: finite(x) for k, x in asdict(bare).items() if k != "course"}
        document["margins"] = margins_as_json(self.margins)
        document["thresholds"] = [finite(x._asdict()) for x in self.thresholds]
        if self.rods is not None:
            document["rods"] = self.rods._asdict() | {"suffice": self.rods.suffice}
        return document | {
            "steady": self.steady.as_json(),
            "within": None if self.within is None else self.within.as_json(),
            "years": finite(self.years),
            "answer": self.answer,
        }

    @property
    def numbers(self) -> DataFrame:
        """Return the quantities as a table: value and closed loop, and unit, by title."""
        return quantities_of(self, "tabulate_dumps")

    @property
    def answer(self) -> str:
        """Return the sentence that answers the sizing."""
        if self.problems:
            gravity = gravity_leads(self.sources, self.assumptions)
            return (
                f"{self.target} cannot hold: {self.problems[0]}.{self.change}{gravity}"
            )
        if self.steady.interval == inf:
            return (
                f"{self.target}: its wheels never come to {self.begin:.4g} N m s: no dump."
                f"{self._about_rods()}"
            )
        each = f"{1e3 * self.steady.propellant:.3g} g each"
        text = f"{describe_margins(self.target, self.margins)}. It {self._gains()}"
        text += (
            f"dumps {self.steady.a_week:.3g} times a week, {each}, "
            f"{self.steady.a_year:.3g} kg a year"
        )
        if self.year:
            least, most = self.range_a_year
            text += (
                f" at this rate; over the dates of a year {self.a_year:.3g} kg "
                f"({least:.3g} to {most:.3g} by date)"
            )
        if self.by_activity:
            levels = [f"{x:.3g} at {name}" for name, x in self.by_activity.items()]
            text += f", {', '.join(levels)} solar activity"
        text += f", at least {self.least_a_year:.3g} kg where dumps wait for the cheapest attitude"
        if self.tank > 0.0:
            text += f"; its {self.tank:g} kg last {self.years:.3g} years"
        return f"{text}.{self._about_rods()}"

    def _gains(self) -> str:
        """Return what the craft gains a day and how often it dumps, with intervals."""
        if not self.intervals:
            return ""
        text = f"gains {describe_interval(self.intervals[0])}: a dump each "
        a_day, between = self.intervals[:2]
        text += format_duration(between.nominal)
        width = describe_width(a_day, self.assumptions)
        ends = " to ".join(
            format_duration(x) if x < inf else "never" for x in between[3:]
        )
        return f"{text}{width and f' ({ends}{width})'}. It "

    def _about_rods(self) -> str:
        """Say whether the craft's rods would hold it without propellant, if it has some."""
        if self.rods is None:
            return ""
        rods = f" Its rods of {self.rods.has:.4g} A m2"
        if self.coil_share is not None:
            rods += f" take {100.0 * self.coil_share:.3g} % of the momentum; they"
        if self.rods.needed is None:
            return f"{rods} do not suffice alone: none would."
        needs = f"{self.rods.law} needs {self.rods.needed:.3g} A m2"
        if self.rods.suffice:
            return f"{rods} suffice alone ({needs}; a craft without --dump): no propellant."
        return f"{rods} do not suffice alone: {needs}."


def applies(system: System) -> bool:
    """Return whether a system dumps by thrusters between thresholds."""
    manager = system.components.get("manager")
    return (
        manager is not None
        and manager.model == LAW
        and (manager.choice("by") != "coils")
    )


def is_of(target: str, options: Options) -> bool:
    """Return whether a target dumps by thrusters between thresholds.

    False also where the target cannot be resolved; sizing it reports the error.
    """
    try:
        return applies(resolved(target, options)[0])
    except DesatError:
        return False


def size(
    target: str,
    options: Options,
    requirements: SizingRequirements | None = None,
    progress: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> DumpSizing:
    """Size dumps by thrusters.

    Parameters
    ----------
    target, options
        Scenario of the craft.
    requirements
        Requirements beside the scenario's.
    progress
        Called with a text for each stage of the work.
    tell
        Called with the answer of the sizes before the closed loop flies.

    Raises
    ------
    DesatError
        If the craft does not dump by thrusters between thresholds, or lacks data that
        this needs.
    """
    requirements = requirements or SizingRequirements()
    case = prepare(read(target), options)
    system, _ = case.or_raise()
    if not applies(system):
        raise DesatError(
            f"{target}: its manager does not dump by thrusters between thresholds"
        )
    if lines := list(unmanaged_orbit.dump_problems(system)):
        raise DesatError("\n".join(lines))
    hardware, values = hardware_of(system), values_of(system)
    law = threshold_law(system)
    cost = cost_of_thrusters(target, system, hardware, requirements)
    attitude = wanted_attitude(system)
    progress("the days of the scenario")
    flight = fly_days(system, attitude)
    torque, _ = secular(flight)
    rates_in = partial(rates_of, hardware=hardware, law=law, cost=cost)
    steady = _mean_rates(system, options, attitude, flight, rates_in)
    window = _window(system, options, steady)
    progress("its dumps, one after the other")
    steady, whole_run = _follow_dumps(
        system, options, attitude, flight, steady, window, rates_in
    )
    course = None if whole_run is None else _course_of_fill(whole_run, hardware, law)
    progress("other thresholds")
    thresholds = tuple(_rates_by_threshold(flight, hardware, law, cost))
    is_wanted = requirements.year and float(np.linalg.norm(flight.r[0])) < BEYOND
    year, each = (
        _days_of(system, hardware, attitude, law, rates_in, progress)
        if is_wanted
        else ([], [])
    )
    rods = _rods_alone(case, flight, requirements, progress)
    slew_momentum, slew_torque = compute_slew(hardware, requirements)
    sizing = DumpSizing(
        target=target,
        craft=craft_digest(system.parameters),
        period=flight.period,
        attitude=attitude.kind,
        secular=tuple(torque.tolist()),
        a_day=float(np.linalg.norm(torque)) * 86400.0,
        sources=shares_of(flight, torque)[0],
        year=tuple(year),
        begin=law.begin,
        end=law.end,
        capacity=smallest_wheel_capacity(hardware),
        steady=steady,
        rods=rods,
        weekly=smallest_wheel_capacity(hardware) * WEEK / steady.interval
        if steady.interval > 0.0
        else inf,
        tank=float(values["thrusters"].get("tank", 0.0)),
        pulse=law.pulse,
        slew_momentum=slew_momentum,
        slew_torque=slew_torque,
        wheel_torque=hardware.torque_limit,
        loop={},
        problems=(),
        notes=(),
        **_over_year(year, each, steady),
        thresholds=thresholds,
        course=course,
        body_rate=compute_body_rate(hardware),
        power=float(values["thrusters"].get("power", 0.0)),
        least_attitude=find_least_attitude(system, attitude, flight, hardware),
        end_speed=_end_speed(system, hardware, law),
        coil_share=_coil_share(flight, whole_run, hardware, law),
        mass=0.0 if system.body is None else system.body.mass,
    )
    notes = [*doubts(system), *closed_loop_only(system, options)]
    progress("what is not known for sure")
    rows, shares = _intervals(
        system, sizing, (flight, whole_run or flight), hardware, law, cost
    )
    sizing = replace(
        sizing,
        intervals=rows,
        assumptions=shares,
        notes=(*notes, *_notes(sizing, requirements)),
    )
    sizing = _judge(system, sizing, (), requirements)
    if not (requirements.flown and (steady.first < window or options.stop is not None)):
        return sizing
    tell(sizing.answer)
    flights = _lengths_of_flights(system, options, window, steady, whole_run)
    causes = list(_causes(system, law, hardware))
    loop, unmet = _fly_loops(target, options, flights, causes, progress)
    within = _rates_within(whole_run, flights[0], hardware, law, cost)
    sizing = _judge(
        system, replace(sizing, loop=loop, within=within or steady), unmet, requirements
    )
    return replace(sizing, notes=(*notes, *_notes(sizing, requirements)))


def _end_speed(system: System, hardware: Hardware, law: ThresholdLaw) -> float | None:
    """Return the speed (rad/s) of the fullest wheel after a dump.

    What it keeps against the others is in it. None where a wheel has no largest speed.
    """
    capacity = smallest_wheel_capacity(hardware)
    limit = system.components["wheels"].values.get("speed_limit", inf)
    if not (0.0 < capacity < inf and law.of_wheels):
        return None
    return float((law.end + _bias_of(system)) / capacity * limit)


def _coil_share(
    flight: Flight, whole_run: Flight | None, hardware: Hardware, law: ThresholdLaw
) -> float | None:
    """Return the share (1) of the disturbances' momentum that coils take.

    It is along that momentum, over the flight through the dumps or, without one, over
    days that repeat. None where no coils work.
    """
    of = flight if whole_run is None else whole_run
    (along,) = law.with_coils([of], hardware, whole_run is None)
    if COILS not in along.sources:
        return None
    impulse = of.disturbance[-1] - of.disturbance[0]
    return float(-along.sources[COILS][-1] @ impulse / max(impulse @ impulse, 1e-300))


def _rates_within(
    flight: Flight | None,
    span: float,
    hardware: Hardware,
    law: ThresholdLaw,
    cost: ThrusterCost,
) -> DumpRates | None:
    """Compute the rates of the dumps of a flight in its first `span` (s).

    None where there are fewer than two.
    """
    if flight is None:
        return None
    (flight,) = law.with_coils([flight], hardware, False)
    dumps = [
        x
        for x in _course(flight, hardware, law, 1.0, 0, False, 10 * MANY)
        if x.time <= span
    ]
    if len(dumps) < 2:
        return None
    between = (dumps[-1].time - dumps[0].time) / (len(dumps) - 1)
    momentum = float(np.mean([np.linalg.norm(x.body) for x in dumps]))
    each = _mean_cost(cost, [x.body for x in dumps])
    return DumpRates(
        dumps[0].time, between, momentum, *each, law.fullest([x.fill for x in dumps])
    )


def _judge(
    system: System,
    sizing: DumpSizing,
    unmet: Sequence[str],
    requirements: SizingRequirements,
) -> DumpSizing:
    """Return a sizing with margins, problems, and what would do if it has some.

    `unmet` are the requirements that the closed loop misses.
    """
    margins = _margins(system, sizing)
    problems = (*wheels.warnings(system), *_problems(sizing, margins), *unmet)
    change = ""
    if problems:
        change = _describe_change(sizing, margins, requirements)
    return replace(sizing, margins=tuple(margins), problems=problems, change=change)


def _describe_change(
    sizing: DumpSizing, margins: Sequence[Margin], requirements: SizingRequirements
) -> str:
    """Say what would do for a craft that dumps by thrusters; "" where nothing would."""
    changes = list(_changes_of_dumps(sizing, margins, requirements))
    return would_do("; ".join(changes))


def _changes_of_dumps(
    sizing: DumpSizing, margins: Sequence[Margin], requirements: SizingRequirements
) -> Iterator[str]:
    """Yield the smallest change for each thing that there is too little of."""
    short = [m for m in margins if m.margin < 0.0]
    capacity = sizing.capacity
    wheels = [capacity * m.used / m.limit for m in short if m.of == "wheels"]
    larger = f"wheels of {format_momenta(round_up(max(wheels, default=0.0)))} each"
    has_torque = sizing.slew_torque <= sizing.wheel_torque
    free = capacity - sizing.begin
    if sizing.slew_momentum > 0.0 and free > 0.0 and (wheels or not has_torque):
        longer = max(
            sqrt(sizing.slew_torque / sizing.wheel_torque), sizing.slew_momentum / free
        )
        slew = f"a slew of {format_duration(longer * requirements.slew_time)}"
        yield f"{slew}, or {larger}" if has_torque else slew
    elif wheels:
        limit = min(m.limit for m in short if m.of == "wheels")
        if limit > sizing.end + 0.5 * sizing.pulse:
            share = floor(100.0 * limit / capacity)
            yield f"dumps that begin at {share} % of a wheel, or {larger}"
        else:
            yield larger
    if 0.5 * sizing.pulse >= sizing.begin - sizing.end:
        end = sizing.begin - 0.55 * sizing.pulse
        if end > 0.0:
            yield f"dumps that end at {format_momenta(end)}"
    for propellant in (m for m in short[::-1] if m.of == "propellant"):
        most = sizing.steady.a_year * propellant.limit / propellant.used
        enough = [t for t in sizing.thresholds if t.a_year <= most]
        if enough:
            t = min(enough, key=lambda t: abs(t.begin - sizing.begin))
            share = round(100.0 * t.begin / capacity)
            yield f"dumps that begin at {share} % of a wheel ({t.a_year:.3g} kg a year)"
        else:
            yield f"{propellant.used:.3g} kg of propellant a year"
        break


def _margins(system: System, sizing: DumpSizing) -> list[Margin]:
    """Return what the craft uses in each case beside its limits, worst first."""
    limits = {
        x.number: x.max
        for x in content_of(system.about).requirements.values()
        if x.max is not None
    }
    rows = []
    if 0.0 < sizing.capacity < inf:
        limit = limits.get("largest_momentum", 100.0) / 100.0 * sizing.capacity
        # a dump that waits begins later; one by the calendar may begin before
        begin = max(sizing.begin, sizing.steady.fullest) + _bias_of(system)
        rows.append(Margin("where a dump begins", "wheels", begin, limit, "N.m.s"))
        if sizing.slew_momentum > 0.0:
            both = begin + sizing.slew_momentum
            rows.append(Margin(SLEW_CASE, "wheels", both, sizing.capacity, "N.m.s"))
    if (a_year := limits.get("propellant_a_year")) is not None:
        cases = {"the dates of a year, mean": sizing.a_year}
        if sizing.intervals:
            cases[MOST_DRAWS] = sizing.intervals[2].high
        for case, used in cases.items():
            rows.append(Margin(case, "propellant", used, a_year, "kg"))
    pointing = sizing.loop.get("pointing_largest")
    if pointing is not None and "pointing_largest" in limits:
        limit = limits["pointing_largest"]
        rows.append(Margin(LOOP_CASE, "pointing", pointing, limit, "deg"))
    return sorted(rows, key=lambda m: m.margin)


def _bias_of(system: System) -> float:
    """Return what a wheel keeps against the others (N m s), beyond which dumps count."""
    return abs(float(system.components["manager"].values["h_null"]))


def _over_year(
    year: Sequence[YearDate], each: Sequence[DumpRates], steady: DumpRates
) -> dict[str, Any]:
    """Return what a year of dumps takes, by the names of DumpSizing.

    It is that of the scenario's time where no other dates are known.
    """
    activity = year[0].activity if year else ""
    by_activity = {
        name: float(np.mean(_a_year_of(name, year, each)))
        for name in dict.fromkeys(d.activity for d in year)
        if name != activity
    }
    rates = [r for d, r in zip(year, each, strict=True) if d.activity == activity]
    rates = rates or [steady]
    return {
        "a_year": float(np.mean([r.a_year for r in rates])),
        "range_a_year": (min(r.a_year for r in rates), max(r.a_year for r in rates)),
        "by_activity": by_activity,
        "each_year": tuple(r.a_year for r in each) or (steady.a_year,),
        "least_a_year": float(np.mean([r.least_a_year for r in rates])),
    }


def _intervals(
    system: System,
    sizing: DumpSizing,
    flights: tuple[Flight, Flight],
    hardware: Hardware,
    law: ThresholdLaw,
    cost: ThrusterCost,
) -> tuple[tuple[Interval, ...], tuple[AssumptionShare, ...]]:
    """Return the intervals of a sizing over what is not known for sure.

    `flights` are the scenario's days, and that through its dumps, which is
    repeated where it has few;
    dumps are in units of what that gives for the craft as it is described.
    """
    draws = draw(system, flights[0], hardware)
    along = draw_followed(system, flights[1], hardware)
    if draws is None or along is None:
        return (), ()

    def rates(of: Flight, fill: float = 1.0) -> tuple[float, float]:
        """Return the time between dumps (s) and the propellant of a year (kg).

        `fill` scales all thresholds.
        """
        at_fill = law.at_fill(fill)
        course = list(_course(of, hardware, at_fill, 1.0, 0, False, 10 * MANY))
        if len(course) < FEW:
            course = list(_course(of, hardware, at_fill, 1.0, 0, True, FEW))
        if len(course) < 2:
            return inf, 0.0
        between = (course[-1].time - course[0].time) / (len(course) - 1)
        each = _mean_cost(cost, [x.body for x in course])
        return between, each.propellant * YEAR / between

    fills = _fills(system, len(along.impulses))
    along = _with_coils(along, flights, hardware, law, fills)
    between, propellant = follow(along, rates, fills)
    for name in ("arm", "specific_impulse"):
        propellant = propellant / _shares(system, f"thrusters.{name}", len(fills))
    times, mass = rates(along.flight)
    steady = sizing.steady
    if times < inf and steady.interval < inf:
        between = between * (steady.interval / times)
        propellant = propellant * (steady.a_year / mass)
    with np.errstate(invalid="ignore"):  # without dumps it takes none
        each_dump = np.nan_to_num(propellant * between / YEAR)
    rows = (
        interval("Momentum a day", "N.m.s", sizing.a_day, draws.momentum_a_day),
        interval("Time between dumps", "s", steady.interval, between),
        interval("Propellant a year", "kg", steady.a_year, propellant),
        interval("Propellant of a dump", "kg", steady.propellant, each_dump),
        interval(
            "Fullest wheel without the secular part",
            "N.m.s",
            float(fullest_wheel(draws.flight, hardware)),
            draws.wheel,
        ),
    )
    return rows, draws.assumptions


def _with_coils(
    along: CraftDraws,
    flights: tuple[Flight, Flight],
    hardware: Hardware,
    law: ThresholdLaw,
    fills: Array,
) -> CraftDraws:
    """Return draws along a flight with what the coils take in each of them.

    It is integrated at all rows of the flight, which has more than the draws.
    """
    if law.gain == 0.0:
        return along
    base, times = flights[1], along.flight.times
    every = [base.disturbance, *along.impulses_at(base.times)]
    each = [replace(base, disturbance=x) for x in every]
    is_repeated = base is flights[0]
    with_theirs = law.with_coils(each, hardware, is_repeated, [1.0, *fills.tolist()])
    nominal, *impulses = (
        np.stack([np.interp(times, x.times, y) for y in x.disturbance.T], axis=1)
        for x in with_theirs
    )
    flight = replace(along.flight, disturbance=nominal)
    return replace(along, impulses=np.stack(impulses), flight=flight)


def _fills(system: System, count: int) -> Array:
    """Return the thresholds in each draw (count,) over those of the craft."""
    fills = _shares(system, "manager.begin", count)
    capacity = "wheels.speed_limit"  # which a threshold may be in proportion to
    if capacity in system.components["manager"].references.get("begin", ""):
        fills = fills * _shares(system, capacity, count)
    return fills


def _shares(system: System, key: str, count: int) -> Array:
    """Return a sampled number in each draw (count,) over that of the craft."""
    specs = dispersions_of(system)
    component, _, name = key.partition(".")
    value = float(system.components[component].values.get(name, 0.0))
    if key not in specs or value <= 0.0:
        return np.ones(count)
    each = [draw_one(system, key, specs[key], SEED, k) for k in range(count)]
    return np.ravel(each) / value


def _lengths_of_flights(
    system: System,
    options: Options,
    window: float,
    steady: DumpRates,
    whole_run: Flight | None,
) -> tuple[float, float]:
    """Return how long the closed loop and the worst scenario fly (s), `window` at most.

    Unless the user sets a stop time, the first has at least `DUMPS_FLOWN` dumps, and as
    many more as `STEPS_FLOWN` steps have; the second has one.
    """
    if options.stop is not None:
        return window, window
    if whole_run is None:  # beyond the scenario's stop the environment may end
        window = min(window, system.stop - system.start)
    three = steady.first + (DUMPS_FLOWN - 0.5) * steady.interval
    some, few = (
        system.step * ceil(max(86400.0, x) / system.step)
        for x in (max(three, STEPS_FLOWN * system.step), 1.2 * steady.first)
    )
    return min(window, some), min(window, few)


def _mean_cost(cost: ThrusterCost, every: list[Array]) -> DumpCost:
    """Return what dumps of momenta (3,) N m s, body, take in the mean."""
    return DumpCost(*np.mean([cost.of_dump(u) for u in every], axis=0).tolist())


def cost_of_thrusters(
    target: str, system: System, hardware: Hardware, requirements: SizingRequirements
) -> ThrusterCost:
    """Return what thrusters take.

    Raises DesatError where the craft does not say what that follows from.
    """
    cost = thruster_cost(system, hardware, requirements)
    if cost is None:
        raise DesatError(
            f"{target}: its thrusters have neither arm nor nozzles, or no specific "
            "impulse: give them with --arm and --isp"
        )
    return cost


def _mean_rates(
    system: System,
    options: Options,
    attitude: Attitude,
    flight: Flight,
    rates_in: Callable[[Flight], DumpRates],
) -> DumpRates:
    """Compute the mean of the rates over the days of a scenario, as if each lasted.

    Between dumps that are far apart node and Sun move: unless the user sets a stop time,
    the days are spread until the second dump.
    """
    span = system.stop - system.start
    rates = mean_of(_rates_over(system, attitude, flight, span, rates_in))
    later = rates.first + rates.interval
    if options.stop is not None or not span < later < LONGEST:
        return rates
    return mean_of(_rates_over(system, attitude, flight, later, rates_in))


def _follow_dumps(
    system: System,
    options: Options,
    attitude: Attitude,
    flight: Flight,
    steady: DumpRates,
    window: float,
    rates_in: Callable[..., DumpRates],
) -> tuple[DumpRates, Flight | None]:
    """Follow the dumps one after the other, until there are two.

    Returns their rates and the flight through them; `steady` and None where that takes
    too many rows, or there is no dump.
    """
    for count in ROUNDS if options.stop is None else (0,):
        span = max(window, steady.first + count * steady.interval)
        if not span < LONGEST:
            break
        whole_run = _through(system, attitude, flight, span, steady.interval)
        if whole_run is None:
            break
        along = rates_in(whole_run, interval=steady.interval)
        if along.interval < inf or options.stop is not None:
            return _steady_along(along, steady), whole_run
    return steady, None


def _rates_over(
    system: System,
    attitude: Attitude,
    flight: Flight,
    span: float,
    rates_in: Callable[[Flight], DumpRates],
) -> list[DumpRates]:
    """Compute the rates at dates spread over a span (s), as if each of them lasted.

    `flight` is that of the first date.
    """
    rest = max(0.0, span - (flight.times[-1] - flight.times[0]))
    dates = [float(t) for t in np.linspace(0.0, rest, PARTS)[1:] if t > 0.0]
    later = [fly_days(system, attitude, t) for t in dates]
    return [rates_in(f) for f in (flight, *later)]


def _rods_alone(
    case: Case,
    flight: Flight,
    requirements: SizingRequirements,
    progress: Callable[[str], None],
) -> RodsAlone | None:
    """Size the rods of a craft that dumps by thrusters, as if they were its only ones.

    None for a craft without rods.
    """
    system, _ = case.or_raise()
    hardware = hardware_of(system)
    if hardware.m_limit == 0.0 or not flight.b.any():
        return None
    progress("its rods alone")
    skipped = list[str]()
    terms = terms_of(flight.period, flight.b, wanted_attitude(system).kind != "nadir")
    try:
        laws = list(other_laws(case, terms, skipped))
        _, rods = find_rods_of_laws(system, flight, laws, requirements)
    except (DesatError, UnsuitedError):
        laws, rods = [], []
    needs = [
        (rod, law.name) for law, rod in zip(laws, rods, strict=True) if rod is not None
    ]
    rod_needed, name = min(needs, default=(None, ""))
    return RodsAlone(hardware.m_limit, rod_needed, name)


def _a_year_of(
    activity: str, year: Sequence[YearDate], rates: Sequence[DumpRates]
) -> list[float]:
    """Return the propellant (kg a year) of the days of one solar activity."""
    return [
        r.a_year for d, r in zip(year, rates, strict=True) if d.activity == activity
    ]


def _fly_loops(
    target: str,
    options: Options,
    flights: tuple[float, float],
    causes: Sequence[str],
    progress: Callable[[str], None],
) -> tuple[dict[str, float | None], list[str]]:
    """Fly the closed loop, and the worst scenario beside the craft, for these times (s).

    Returns the numbers of the first, and a line for each requirement that is not met.
    """
    progress("the closed loop")
    run = _fly_closed_loop(target, options, flights[0])
    unmet = [f"in the closed loop: {line}" for line in run.manifest.not_met]
    worst_scenario = find_worst_scenario(read(target))
    if worst_scenario is not None:
        progress(f"{worst_scenario.target}: what is usually worse")
        worst = _fly_closed_loop(worst_scenario.target, options, flights[1])
        unmet += [
            f"in {worst_scenario.target}: {line}" for line in worst.manifest.not_met
        ]
    likely = f" (likely by {'; '.join(causes)})" if causes else ""
    return dict(_numbers_of(run)), [f"{line}{likely}" for line in unmet]


def _causes(system: System, law: ThresholdLaw, hardware: Hardware) -> Iterator[str]:
    """Yield likely causes of requirements that the closed loop misses, as text."""
    kick = law.pulse * law.sample_time
    turn = np.degrees(kick / float(np.linalg.eigvalsh(hardware.inertia)[0]) / 8.0)
    if turn > COARSE_TURN:
        yield f"coarse pulses: the shortest turns the craft by {turn:.2g} deg before wheels take it"
    for find in (attitude_loop.problems_when_full, attitude_loop.warnings):
        for line in find(system):
            yield line.partition("controller: ")[2] or line
            return


def _numbers_of(run: Run) -> Iterator[tuple[str, float | None]]:
    """Yield the numbers LOOP of a run, each in its unit there."""
    for name, unit in LOOP.items():
        if (number := run.manifest.numbers.get(name)) is None:
            continue
        to = factor(unit_of(number.unit), unit, f"of {name}")
        yield name, None if number.value is None else number.value * to


def _window(system: System, options: Options, steady: DumpRates) -> float:
    """Return the time (s) over which dumps are followed and flown.

    It has MANY dumps or MOST_STEPS steps, unless the user sets a stop time.
    """
    if options.stop is not None:
        return system.stop - system.start
    duration = min(MOST_STEPS * system.step, steady.first + MANY * steady.interval)
    return system.step * ceil(duration / system.step)


def _fly_closed_loop(target: str, options: Options, window: float) -> Run:
    """Fly the closed loop for `window` (s) and return the run.

    Raises DesatError where it cannot run or does not complete.
    """
    source = read(target)
    start = resolved(source, options)[0].start
    case = prepare(source, replace(options, stop=start + window))
    # all series of a year would not fit into memory
    record = series_of_numbers(case.or_raise()[0])
    run = simulate(
        replace(case, options=replace(case.options, record=record))
    ).or_raise(target)
    run.results.close()
    return run


def _through(
    system: System, attitude: Attitude, flight: Flight, span: float, interval: float
) -> Flight | None:
    """Fly the orbit and the Sun through all dumps, many rows between two of them.

    None where that takes too many rows, or the environment ends before `span` (s).
    """
    block = environment_block(system.components["environment"], needless(system))
    longest = min(interval / BETWEEN, turn_of(system) / TURN_ROWS)
    mu = mu_of(system)
    times = system.start + _nodes(block, system.start, flight, span, longest, mu)
    if len(times) > MOST_ROWS:
        return None
    try:
        return flown_at(system, attitude, inputs_at(block, times.tolist()), times)
    except DesatError:  # the environment ends before
        return None


def _nodes(
    block: Any, start: float, flight: Flight, span: float, longest: float, mu: float
) -> Array:
    """Return times (s) since the start through a span, at most `longest` apart.

    On an ellipse they are spaced by the eccentric anomaly, so that perigee and apogee
    have equally many.
    """
    r, v = flight.r[0], flight.v[0]
    size = float(np.linalg.norm(r))
    if size > BEYOND:
        step = min(COARSE, longest)
        return np.arange(0.0, span + step, step)
    fine = ceil(flight.period / longest)
    axis = 1.0 / (2.0 / size - float(v @ v) / mu)
    eccentricity = hypot(float(r @ v) / sqrt(mu * axis), 1.0 - size / axis)
    if eccentricity < 0.1:
        each = max(45 if flight.period < SLOW_ORBIT else 90, fine)
        count = ceil(span / flight.period * each) + 1
        return np.linspace(0.0, count * flight.period / each, count + 1)
    each = max(80, fine)
    anomaly = 2.0 * pi / each * np.arange(each)
    share = (anomaly - eccentricity * np.sin(anomaly)) / (2.0 * pi)
    perigees = _perigees(block, start, flight.period, span)
    rounds = [a + (b - a) * share for a, b in pairwise(perigees)]
    times = np.concatenate([*rounds, [perigees[-1]]])
    return np.append(0.0, times[times > 0.0])


def _perigees(block: Any, start: float, period: float, span: float) -> list[float]:
    """Find the times of the perigees (s since the start).

    They go from the one before the start to the one after `span`.
    """
    from scipy.optimize import brentq

    def outward(t: float) -> float:
        """Return r . v (m2/s), positive after a perigee.

        `t` is in s since the start.
        """
        r, v = block.motion(start + t)
        return float(np.dot(r, v))

    times: list[float] = []
    t, step = -1.1 * period, period / 16.0
    while not times or times[-1] < span:
        if outward(t) < 0.0 <= outward(t + step):
            times.append(float(brentq(outward, t, t + step)))
        t += step
    return [x for k, x in enumerate(times) if k + 1 == len(times) or times[k + 1] > 0.0]


def rates_of(
    flight: Flight,
    hardware: Hardware,
    law: ThresholdLaw,
    cost: ThrusterCost,
    interval: float = 0.0,
) -> DumpRates:
    """Compute the mean rates of dumps over WAYS courses of a flight.

    A flight without `interval` is repeated as it is. One with an `interval` (s) goes
    through all dumps, which are its own; the courses begin within the first interval.
    """
    (flight,) = law.with_coils([flight], hardware, interval == 0.0)
    parts = np.linspace(-APART, APART, WAYS)
    last = len(flight.q) - 1
    if interval > 0.0:
        last = int(np.searchsorted(flight.times - flight.times[0], interval))
    goes_on, most = interval == 0.0, TRIED if interval == 0.0 else 10 * MANY
    each = [
        list(
            _course(flight, hardware, law, 1.0 + part, i * last // WAYS, goes_on, most)
        )
        for i, part in enumerate(parts)
    ]
    each = [course for course in each if course]
    if not each:
        return DumpRates(inf, inf, 0.0, *NOTHING)
    rates = list(_course(flight, hardware, law, 1.0, 0, goes_on, most))
    weekly = [
        WEEK * (len(c) - 1) / (c[-1].time - c[0].time)
        for c in [*each, rates]
        if len(c) > 1
    ]
    counted = each if goes_on or len(rates) < 2 else [rates]
    seconds = sum(course[-1].time - course[0].time for course in counted)
    count = sum(len(course) - 1 for course in counted)
    every = [x.body for course in counted for x in course]
    inertial = [x.inertial for x in (rates or each[0])[:CHEAPEST_OF]]
    least = float(np.mean([_cheapest(flight, u, cost) for u in inertial]))
    momentum = float(np.mean([np.linalg.norm(u) for u in every]))
    each_takes = _mean_cost(cost, every)
    first = (rates or each[0])[0].time
    return DumpRates(
        first,
        seconds / count if count else inf,
        momentum,
        *each_takes,
        law.fullest([x.fill for x in rates or each[0]]),
        min(least, each_takes.propellant),
        min(weekly, default=0.0),
        max(weekly, default=0.0),
    )


def _steady_along(along: DumpRates, steady: DumpRates) -> DumpRates:
    """Return the rates of dumps along a flight through them all.

    `steady` are those of days that repeat; fewer than two dumps give no other rate.
    """
    return along if along.interval < inf else replace(steady, first=along.first)


def _days_of(
    system: System,
    hardware: Hardware,
    attitude: Attitude,
    law: ThresholdLaw,
    rates_in: Callable[[Flight], DumpRates],
    progress: Callable[[str], None],
) -> tuple[list[YearDate], list[DumpRates]]:
    """Return the days of a year, and the rates of dumps if each of them lasted."""
    progress("the days of a year")
    dates, flights = [], []
    for date, there in days_of_year(system, hardware, attitude, own_day=True):
        flights.append(flown_at(system, attitude, *there))
        dates.append(date)
    flights = law.with_coils(flights, hardware, True)
    return dates, [rates_in(x) for x in flights]


def _rates_by_threshold(
    flight: Flight,
    hardware: Hardware,
    law: ThresholdLaw,
    cost: ThrusterCost,
) -> Iterator[Threshold]:
    """Yield the rates of dumps that begin at other shares of a wheel's capacity."""
    capacity = smallest_wheel_capacity(hardware)
    if not 0.0 < capacity < inf:
        return
    of_craft = law.begin / capacity
    shares = {*SHARES, round(of_craft, 6)} if of_craft < 1.0 else SHARES
    for share in sorted(shares):
        begin = share * capacity
        if begin <= 1.05 * law.end:
            continue
        other = law.between(begin, law.end, capacity)
        rates = rates_of(flight, hardware, other, cost)
        yield Threshold(begin, rates.a_week, rates.a_year)


def _course_of_fill(
    flight: Flight, hardware: Hardware, law: ThresholdLaw
) -> DumpCourse:
    """Compute the fill of the wheels along a flight through all its dumps."""
    (flight,) = law.with_coils([flight], hardware, False)
    dumps = list(_course(flight, hardware, law, 1.0, 0, False, 10 * MANY))
    times = flight.times - flight.times[0]
    begun = np.array([x.time for x in dumps])
    total = rotate_back(flight.q[:1], flight.body[:1])[0]
    removed = np.zeros((len(dumps) + 1, 3))
    if dumps:
        removed[1:] = np.cumsum([x.inertial for x in dumps], axis=0)
    count = np.searchsorted(begun, times, side="left")
    gained = flight.disturbance - flight.disturbance[0]
    momentum_body = rotate(flight.q, total + gained - removed[count])
    momentum_body = momentum_body - flight.body - law.target
    fill = (
        np.abs(momentum_body @ hardware.spread().T).max(axis=1)
        if law.of_wheels
        else np.linalg.norm(momentum_body, axis=1)
    )
    return DumpCourse(times, fill, begun)


def _cheapest(flight: Flight, momentum: Array, cost: ThrusterCost) -> float:
    """Return the least propellant (kg) for a momentum (3,) N m s, eci.

    The minimum is over the attitudes of the flight.
    """
    q = flight.q[:: max(1, len(flight.q) // CHEAPEST_AT)]
    each = rotate(q, np.broadcast_to(momentum, (len(q), 3)))
    return min(cost.propellant(u) for u in each)


def mean_of(each: Sequence[DumpRates]) -> DumpRates:
    """Return the mean of rates that follow each other for equal times."""
    some = [r for r in each if r.interval < inf]
    if not some:
        return each[0]
    a_second = float(
        np.mean([1.0 / r.interval if r.interval < inf else 0.0 for r in each])
    )
    shares = np.array([1.0 / r.interval for r in some])
    momentum, least, *takes = (
        float(shares @ np.array(x) / shares.sum())
        for x in zip(
            *((r.momentum, r.least_propellant, *r.takes) for r in some), strict=True
        )
    )
    return DumpRates(
        each[0].first,
        1.0 / a_second,
        momentum,
        *DumpCost(*takes),
        max(r.fullest for r in some),
        least,
        min(r.least_a_week for r in some),
        max(r.most_a_week for r in some),
    )


class Dump(NamedTuple):
    """A dump of the model."""

    time: float  # s since the course began
    body: Array  # (3,) N m s that it removes
    inertial: Array  # the same in eci
    fill: float  # N m s, where it begins


class _WheelCourse:
    """Wheels along a flight, at rest at a row of it, and when a dump is due."""

    def __init__(
        self,
        flight: Flight,
        hardware: Hardware,
        law: ThresholdLaw,
        begin: float,
        row: int,
    ) -> None:
        """Begin at a row; `begin` (N m s) is the law's, or near it."""
        self._flight, self._law, self._begin, self.row = flight, law, begin, row
        self._spread = hardware.spread()
        self._gained = flight.disturbance - flight.disturbance[0]
        # The body's own momentum turns with it: with wheels at rest it is the whole
        first = slice(row, row + 1)
        self._total = rotate_back(flight.q[first], flight.body[first])[0]
        self._times = flight.times - flight.times[0]
        self._span = float(self._times[-1])
        #: s, of the flight's first row since the course began
        self.begun = -float(self._times[row])
        self._calendar = law.period
        self._opens = -inf  # window of a dump that is due; -inf: none is

    def next_dump(self, goes_on: bool, dumps: int) -> Dump | None:
        """Follow the wheels to their next dump; None where there is none.

        With `goes_on` the flight is repeated. There have been `dumps` so far.
        """
        law = self._law
        while self.begun < LONGEST:
            momentum, in_body, fill = self._momenta()
            due = self._rows_due(fill)
            if not due.any():
                if not goes_on or not self._repeat(momentum[-1], fill, dumps):
                    return None
                continue
            times = self._times[self.row :]
            k = _begins(law, in_body, fill, times, int(np.argmax(due)))
            self._total, self.row = momentum[k], self.row + k
            time = self.begun + float(times[k])
            if self._opens == -inf:
                self._opens = law.next_open(time)
                if self._opens == inf:
                    return None
                if self._opens > time:
                    continue
            return self._dump(time, in_body[k], float(fill[k]))
        return None

    def _momenta(self) -> tuple[Array, Array, Array]:
        """Return the momentum (rows, 3) N m s, eci and body, and the fill (rows,)."""
        flight, law, rows = self._flight, self._law, slice(self.row, None)
        momentum = self._total + self._gained[rows] - self._gained[self.row]
        in_body = rotate(flight.q[rows], momentum) - flight.body[rows] - law.target
        if law.of_wheels:
            return momentum, in_body, np.abs(in_body @ self._spread.T).max(axis=1)
        return momentum, in_body, np.linalg.norm(in_body, axis=1)

    def _rows_due(self, fill: Array) -> Array:
        """Return at which rows a dump is due, by threshold, calendar or window."""
        law, times = self._law, self.begun + self._times[self.row :]
        if self._opens > -inf:
            return np.asarray(times >= self._opens)
        due = fill >= self._begin
        if law.period < inf:
            due |= law.is_calendar(times) & (times >= self._calendar) & (fill > law.end)
        return np.asarray(due)

    def _repeat(self, momentum: Array, fill: Array, dumps: int) -> bool:
        """Begin the flight anew; False where no dump would come.

        Repetitions that cannot yet bring the fill to its threshold are skipped.
        `momentum` (3,) N m s, eci, is that at the end of the flight.
        """
        law = self._law
        most = np.linalg.norm(self._spread, axis=1).max() if law.of_wheels else 1.0
        growth = float(np.linalg.norm(self._gained[-1]) * most)
        free = 1.0
        if growth > 0.0 and self.row == 0:
            free = (self._begin - float(fill.max())) / growth
        until = min(LONGEST, self._calendar)
        if self._opens > -inf:
            free, until = inf, min(LONGEST, self._opens)
        times_on = max(1, int(min(free, (until - self.begun) / self._span)))
        self._total = momentum + (times_on - 1) * self._gained[-1]
        self.begun, self.row = self.begun + times_on * self._span, 0
        is_long = not dumps and self.begun >= 3.0 * self._span
        return not (is_long and law.period == inf and _stays(self._flight, law, fill))

    def _dump(self, time: float, in_body: Array, fill: float) -> Dump | None:
        """Dump the momentum (3,) N m s, body, at a time (s); None: less than a pulse."""
        law, here = self._law, slice(self.row, self.row + 1)
        out = _taken(law, in_body, fill, self._spread, law.target)
        if not out.any():
            return None
        inertial = rotate_back(self._flight.q[here], out[None])[0]
        self._total, self._opens = self._total - inertial, -inf
        if law.period < inf:
            self._calendar = law.period * (1 + time // law.period)
        return Dump(time, out, inertial, fill)


def _course(
    flight: Flight,
    hardware: Hardware,
    law: ThresholdLaw,
    part: float,
    row: int,
    goes_on: bool,
    most: int,
) -> Iterator[Dump]:
    """Yield the first `most` dumps of wheels that are at rest at a row.

    `part` scales the threshold at which dumps begin. If `goes_on`, the flight is
    repeated until there are as many; otherwise it ends.
    """
    course = _WheelCourse(flight, hardware, law, part * law.begin, row)
    for count in range(most):
        dump = course.next_dump(goes_on, count)
        if dump is None:
            return
        yield dump


def _taken(
    law: ThresholdLaw, momentum_body: Array, fill: float, spread: Array, target: Array
) -> Array:
    """Return the momentum (3,) N m s, body, that a dump by the law's block removes.

    `momentum_body` is the momentum beyond the target; the craft does not turn
    meanwhile. Until `LAST_SAMPLES` are left the block takes its torque along the
    momentum, to within the pulse that the next samples make up for.
    """
    block = law.block
    block.end = law.end
    share = 1.0
    if not target.any():
        size = float(np.linalg.norm(momentum_body))
        step = block.torque * block.sample_time / size
        share -= step * max(0, int((1.0 - block.end / fill) / step) - LAST_SAMPLES)
    block.begin = max(0.999 * share * fill, 1.001 * block.end)
    block.start()
    remaining, t = share * momentum_body, 0.0
    for _ in range(MOST_SAMPLES):
        block.h_wheel = tuple((spread @ (remaining + target)).tolist())
        x, y, z = remaining.tolist()
        torque, _ = block.dump(t, t, (x, y, z))
        if block.mode != DUMPING:
            break
        remaining = remaining + block.sample_time * np.array(torque)
        t += block.sample_time
    return momentum_body - remaining


def _begins(
    law: ThresholdLaw, momentum_body: Array, fill: Array, times: Array, due: int
) -> int:
    """Return the row at which a dump begins that is due at row `due`.

    It begins at once, or where its momentum (rows, 3) lies near an axis, but at most
    `longest_wait` later, and where the fill (rows,) is at `latest`.
    """
    if law.aligned == 0.0:
        return due
    last = int(np.searchsorted(times, times[due] + law.longest_wait, side="right"))
    waiting = momentum_body[due : max(last, due + 1)]
    lies = np.abs(waiting).sum(axis=1) <= law.aligned * np.linalg.norm(waiting, axis=1)
    lies |= fill[due : due + len(waiting)] >= law.latest
    return due + (int(np.argmax(lies)) if lies.any() else len(waiting) - 1)


def _stays(flight: Flight, law: ThresholdLaw, sizes: Array) -> bool:
    """Return whether wheels below their threshold stay below it for LONGEST."""
    torque, _ = secular(flight)
    return bool(
        float(sizes.max()) + float(np.linalg.norm(torque)) * LONGEST < law.begin
    )


def _problems(sizing: DumpSizing, margins: Sequence[Margin]) -> Iterator[str]:
    """Yield a line for each reason why dumps cannot work."""
    for m in margins:
        if m.margin >= 0.0 or m.case.startswith(MOST_DRAWS) or m.case == LOOP_CASE:
            continue
        if m.of == "propellant":
            yield f"a year takes {m.used:.4g} kg of {m.limit:.4g} kg allowed: {m.case}"
        elif m.case == SLEW_CASE:
            yield (
                f"a slew needs {sizing.slew_momentum:.4g} N m s of the fullest wheel, "
                f"which may hold {sizing.begin:.4g} already, of {m.limit:.4g} N m s"
            )
        else:
            yield (
                f"dumps begin at {m.used:.4g} N m s, and a wheel may hold "
                f"{m.limit:.4g} N m s"
            )
    if sizing.slew_torque > sizing.wheel_torque:
        yield (
            f"a slew needs {sizing.slew_torque:.4g} N m of the fullest wheel, which gives "
            f"{sizing.wheel_torque:.4g} N m"
        )
    if 0.5 * sizing.pulse >= sizing.begin - sizing.end:
        yield (
            f"the thrusters' shortest pulse gives {sizing.pulse:.4g} N m s, and a dump goes from "
            f"{sizing.begin:.4g} to {sizing.end:.4g} N m s"
        )
    if sizing.steady.impulse == inf:
        yield "its thrusters give no torque about some axis, so no dump can end"


def _notes(sizing: DumpSizing, requirements: SizingRequirements) -> Iterator[str]:
    """Yield a line for each limit of the results."""
    if requirements.flown and not sizing.loop:
        first = sizing.steady.first
        cause = (
            f"the first dump comes after {format_duration(first)} (--stop flies it)"
            if first < inf
            else "there is no dump"
        )
        yield f"the closed loop was not flown: {cause}; every number is the model's"
    dumps = sizing.loop.get("dumps")
    if sizing.loop and (dumps is None or dumps < DUMPS_FLOWN):
        yield (
            f"the closed loop has {dumps or 0:g} dumps: too few for reliable rates; use a longer --stop"
        )
