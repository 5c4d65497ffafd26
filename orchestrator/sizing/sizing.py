"""`desat size`: which wheels, rods and propellant a craft needs, from its momentum alone.

One run at the wanted attitude gives what no law changes (`flight.py`): the field B(t), the attitude
C(t), and the impulse J(t) of the disturbances. On these alone stand

- the secular torque s = (J(T) - J(0)) / T over whole orbits, and the cyclic rest J - s t, which the
  wheels have to hold whatever the coils do;
- the least rod. Rods of 1 A m2 at their limit work against s with kappa, the mean over time of
  sum_i |(a_i x B) . n|, n = s / |s|; so no law does with less than |s| / kappa. That the rest must
  come to nothing, too, makes it the larger  max over y of (y . s) / mean sum_i |(a_i x B) . y|,  a
  linear programme (its dual) whose answer any law can have that knows the whole time before;
- the curves of momentum and duty over rods, law by law (`model.py`), and the rods that
  hold with the margin and the duty asked for;
- a year's extremes: the same s, cyclic part and least rod at other dates, flown by the
  environment's own block at the attitude that the run has shown.

What is recommended holds on the worst of these days, by the same model, and with it the scenario
`worst.toml` beside the craft's meets its requirements in the closed loop. The closed loop flies
beside the model at the sizes that count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from math import ceil, floor, inf, log10, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.laws.least_firing import programme
from desat.components.maths.allocation import least_on_times

from ..analyses import attitude_loop, plausibility
from ..analyses.flight import (
    Attitude,
    Flight,
    Hardware,
    attitude_of,
    between,
    environment_block,
    flight_of,
    flown_at,
    hardware_of,
    inputs_at,
    needless,
    series_for,
    values_of,
)
from ..analyses.manifest import Manifest
from ..analyses.motion import period_of
from ..campaign.draws import series_of_numbers
from ..files.paths import NOMINAL
from ..numbers.derived import cross, rotate, rotate_back
from ..numbers.text import format_duration, format_momenta
from ..runs.prepare import Case, Target, prepare, read
from ..runs.run import Run, simulate
from ..system import quantities
from ..system.errors import DesatError
from ..system.model import Component, System
from ..system.options import Options
from .compatibility import Terms, fitting, prepare_with, terms_of
from .law import STEP, Law, UnsuitedError, hold_of, law_of
from .model import fly, in_body_of, track_of, useful

Array = NDArray[Any]
WHOLE = 1.15
"""From this multiple of the least rod on the model is within 5 % of the closed loop."""
SIZES = (0.8, 1.0, WHOLE, 1.3, 1.6, 2.0, 3.0, 5.0, 8.0)
"""Rods of the curve, as multiples of the least."""
LARGEST = 30.0
"""The largest rod that is looked at, as a multiple of the least, or the craft's own if larger."""
FLOWN = (1.3,)
"""Rods that fly in the closed loop beside the recommended one, as multiples of the least."""
WORST = "worst.toml"
"""The scenario beside a craft's own that what is recommended has to meet, too."""
DETUMBLING = "detumbling.toml"
OTHERS_STEP = 40.0  # s, samples of other laws than the craft's on the worst day
TIP_OFF = 5.0 * pi / 180.0  # rad/s, where no scenario says it
TRIES, STEP_UP = 6, 1.5
"""So often rods are made larger for it, each time by this where the model does not say by how
much."""
SAMPLE = 10.0
"""Time between the rows of the worst day (s)."""
PROGRAMME = 1440
"""Times that the linear programme has at most: as many minutes as a day has."""
DATES, DAYS, YEAR_STEP = 13, 28, 120.0
"""Days of a year that are looked at, how far apart, and the time between their rows (s)."""
YEAR = 365.25 * 86400.0
GRAVITY = 9.80665
ATTITUDES = 720
"""At which the cost of a dump by thrusters is looked at."""
DIRECTIONS = 400
"""In which the reach of the rods is looked at."""


@dataclass(frozen=True)
class Wishes:
    """What is asked of a sizing beside the craft."""

    duty: float = 0.5
    """of the coils"""
    margin: float = 1.3
    """of rods over the least rod, and of wheels over what they hold"""
    slew_angle: float = 0.0
    """rad"""
    slew_time: float = 0.0
    """s"""
    tip_off: float | None = None
    """rad/s; None: that of the craft's own scenario `detumbling`, else TIP_OFF"""
    arm: float | None = None
    """m, of thrusters; None: the craft's"""
    specific_impulse: float | None = None
    """s"""
    laws: bool = True
    """whether other laws than the craft's own have curves"""
    year: bool = True
    flown: bool = True
    """whether the closed loop flies with the rods that count"""

    def __post_init__(self) -> None:
        """Raises DesatError for a wish that makes no sense."""
        if not 0.0 < self.duty < 1.0:
            raise DesatError(f"--duty {100.0 * self.duty:g}: a share between 0 and 100 % is needed")
        quantities.MARGIN(self.margin)
        if (self.slew_angle > 0.0) != (self.slew_time > 0.0):
            raise DesatError("--slew: an angle and a time above 0 are needed, as 60/300")
        if self.slew_angle > pi * (1.0 + 1e-9):
            raise DesatError(f"--slew: {np.degrees(self.slew_angle):.4g} deg: a turn to any "
                             "attitude is of 180 deg at most; the angle is in deg")  # fmt: skip
        for quantity, value in ((quantities.ARM, self.arm),
                                (quantities.ISP, self.specific_impulse),
                                (quantities.TIP_OFF, None if self.tip_off is None
                                 else float(np.degrees(self.tip_off)))):  # fmt: skip
            if value is not None:
                quantity(value)
        if self.slew_time > 0.0:
            quantities.SLEW_TIME(self.slew_time)


# --- momentum -----------------------------------------------------------------------------------


def secular(flight: Flight) -> tuple[Array, Array]:
    """The secular torque (3,) N m, eci, over as many whole orbits as there are, and the cyclic
    impulse (rows, 3) N m s of these."""
    return _secular(flight.times, flight.disturbance, flight.whole)


def _secular(times: Array, impulse: Array, whole: float) -> tuple[Array, Array]:
    since = times - times[0]
    rows = since <= whole * (1.0 + 1e-12)
    end = np.array([np.interp(whole, since, x) for x in impulse.T])
    torque = (end - impulse[0]) / whole
    return torque, impulse[rows] - impulse[0] - np.outer(since[rows], torque)


def _span(cyclic: Array) -> float:
    """The largest distance from the middle of the box that holds the cyclic momentum."""
    return float(np.linalg.norm(cyclic - _middle(cyclic), axis=1).max())


def _middle(cyclic: Array) -> Array:
    return np.asarray((cyclic.max(axis=0) + cyclic.min(axis=0)) / 2.0)


# --- rods ---------------------------------------------------------------------------------------


def reach(flight: Flight, hardware: Hardware) -> Array:
    """What each rod of 1 A m2 can do over the whole orbits, as torque in eci: (rows, c, 3) N m."""
    rows = flight.times - flight.times[0] <= flight.whole * (1.0 + 1e-12)
    q, b = flight.q[rows], flight.b[rows]
    each = [rotate_back(q, np.broadcast_to(a, (len(q), 3))) for a in hardware.axes_coil.T]
    return np.stack([cross(axis, b) for axis in each], axis=1) if each else np.zeros((len(q), 0, 3))


def least_by_formula(able: Array, torque: Array) -> float:
    """|s| / mean sum_i |(a_i x B) . n| (A m2); inf where no rod does anything against s."""
    size = float(np.linalg.norm(torque))
    if size == 0.0:
        return 0.0
    work = float(np.abs(able @ (torque / size)).sum(axis=1).mean())
    return size / work if work > 0.0 else inf


def least_by_programme(able: Array, torque: Array) -> float:
    """The least dipole (A m2) of equal rods, any law: `_programme` over at most PROGRAMME rows."""
    if not np.any(torque):
        return 0.0
    some = able[:: -(-len(able) // PROGRAMME)]
    return _programme(some.reshape(-1, 3) / len(some), torque)


def _programme(able: Array, torque: Array) -> float:
    """min m,  sum u_i able_i = torque,  |u_i| <= m: (rods, 3) N m to A m2. As max x with
    sum u_i able_i = x torque and |u_i| <= 1, m = 1 / x, it has but three rows."""
    scale = float(np.abs(able).sum(axis=0).max())
    if scale == 0.0:
        return inf
    size = float(np.linalg.norm(torque))
    columns = np.column_stack([able.T / scale, -torque / size])
    cost = np.append(np.zeros(len(able)), -1.0)
    least, most = np.append(np.full(len(able), -1.0), 0.0), np.append(np.ones(len(able)), inf)
    x, _ = programme(cost, columns, np.zeros(3), least, most)
    if x is None or x[-1] <= 1e-12:
        return inf
    return size / (float(x[-1]) * scale)


class Geometry(NamedTuple):
    """Where the field forbids."""

    weakest: Array
    """(3,) unit vector, eci: against a torque along it the rods do least"""
    weakness: float
    """what they do there over what they do on the average of all directions"""
    blind: float
    """s: the longest time in which rods of 1.3 times the least cannot undo the secular torque"""
    against: float
    """mean sum_i |(a_i x B) . n| along the weakest (T)"""
    tumbling: float
    """the same of a craft that tumbles: half of |B x n| a rod, the mean over all attitudes"""


def geometry(flight: Flight, hardware: Hardware, able: Array, torque: Array,
             least: float) -> Geometry:  # fmt: skip
    """What the rods can do in which direction, and when not."""
    k = np.arange(DIRECTIONS) + 0.5
    z, turn = 1.0 - k / DIRECTIONS, pi * (1.0 + 5.0**0.5) * k  # half a sphere: n and -n are one
    n = np.stack([np.cos(turn) * np.sqrt(1.0 - z * z), np.sin(turn) * np.sqrt(1.0 - z * z), z])
    some = able[:: -(-len(able) // PROGRAMME)]
    work = np.abs(some @ n).sum(axis=1).mean(axis=0)
    b = flight.b[:: -(-len(flight.b) // PROGRAMME)]
    across = np.sqrt(np.maximum((b * b).sum(axis=1)[:, None] - (b @ n) ** 2, 0.0)).mean(axis=0)
    weakest = int(np.argmin(work))
    size = float(np.linalg.norm(torque))
    blind = 0.0
    if size > 0.0 and least < inf:
        can = 1.3 * least * np.abs(able @ (torque / size)).sum(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], can < size, [0]])))
        step = float(flight.times[1] - flight.times[0])
        blind = float((edges[1::2] - edges[::2]).max(initial=0)) * step
    return Geometry(n[:, weakest], float(work[weakest] / work.mean()), blind,
                    float(work[weakest]), 0.5 * able.shape[1] * float(across.min()))  # fmt: skip


# --- laws ---------------------------------------------------------------------------------------


def other_laws(
    source: Target, options: Options, terms: Terms, notes: list[str]
) -> Iterator[Law]:  # fmt: skip
    """The laws that fit the craft besides its own (`compatibility.py`), as the model has them; what
    it has not is added to the notes."""
    without = []
    for each in fitting(source, options, terms)[0][1:]:
        system, _ = prepare_with(source, each).or_raise()
        try:
            yield law_of(system.components["manager"])
        except UnsuitedError:
            without.append(each.name)
    if without:
        notes.append(f"closed loop only, by `desat compare {source.text} --laws all`: "
                     f"{', '.join(without)}")  # fmt: skip


@dataclass(frozen=True)
class Flown:
    """A size of rods (A m2) under a law: the model, and the closed loop where it flew."""

    law: str
    rod: float
    multiple: float
    """of the least rod"""
    rms: float | None
    """N m s; None: closed loop only"""
    largest: float | None
    filled: float | None
    """the fullest wheel in the second half, share of its capacity; None: without a limit"""
    duty: float | None
    """1"""
    loop_rms: float | None = None
    loop_largest: float | None = None
    loop_duty: float | None = None


def curve_of(
    flight: Flight, law: Law, hardware: Hardware, least: float, wishes: Wishes
) -> tuple[tuple[Flown, ...], float | None]:  # fmt: skip
    """The model over the sizes of SIZES, the craft's own and the recommended ones, and the smallest
    with the margin and the duty asked for. Raises UnsuitedError for a law that it does not have."""
    largest_rod = max(LARGEST, hardware.m_limit / least)
    fine = np.geomspace(wishes.margin, largest_rod, 60) * least
    given = [*(k * least for k in SIZES), *([hardware.m_limit] if hardware.m_limit else [])]
    rods = np.array([*fine, *given])
    made = fly([track_of(flight, law, hardware)], law, hardware, rods.tolist())
    rms, largest, wheel, duty, _ = (x[0, 0] for x in made)
    room = room_of(hardware)
    best = _smallest(duty[: len(fine)], wheel[: len(fine)], room, wishes)
    kept = sorted([*range(len(fine), len(rods)), *([] if best is None else [best])],
                  key=lambda i: rods[i])  # fmt: skip
    rows = tuple(
        Flown(law.name, float(rods[i]), float(rods[i]) / least, float(rms[i]), float(largest[i]),
              float(wheel[i]) / room if room < inf else None, float(duty[i]))
        for i in kept
    )  # fmt: skip
    return rows, None if best is None else float(rods[best])


def _smallest(duty: Array, wheel: Array, room: float, wishes: Wishes) -> int | None:
    """The first rod whose duty is as asked for and whose wheels hold with the margin; None: none.
    `wheel` (N m s) is what the fullest wheel comes to, `room` what one holds."""
    enough = (duty <= wishes.duty) & (wheel * wishes.margin <= room)
    return int(np.argmax(enough)) if enough.any() else None


@dataclass(frozen=True)
class WorstDay:
    """The day of the year that asks most of rods."""

    day: str
    activity: str
    """of the Sun; empty: as the scenario has it"""
    least: float
    """rod for any law, by the linear programme, A m2"""
    flight: Flight


def on_worst_day(
    worst: WorstDay, law: Law, hardware: Hardware, rods: Array, longest: float = STEP
) -> tuple[Array, Array]:  # fmt: skip
    """Duty (1) and what the fullest wheel comes to (N m s) with each of these rods (A m2) under a
    law, whose samples are taken together up to `longest` (s). Raises UnsuitedError for a law that
    the model does not have."""
    hold = hold_of(law, worst.flight, longest)
    made = fly([track_of(worst.flight, law, hardware, hold=hold)], law, hardware, rods.tolist())
    return made.duty[0, 0], made.wheel[0, 0]


def _up(rod: float) -> float:
    """A rod (A m2) rounded up to three digits: as it is printed, and typed again."""
    if not 0.0 < rod < inf:
        return rod
    digit = 10.0 ** (floor(log10(rod)) - 2)
    return float(f"{ceil(rod / digit * (1.0 - 1e-12)) * digit:.3g}")


def room_of(hardware: Hardware) -> float:
    """The capacity of the smallest wheel (N m s)."""
    there = hardware.capacity[hardware.capacity > 0.0]
    return float(there.min()) if len(there) else 0.0


# --- what a sizing says -------------------------------------------------------------------------


@dataclass(frozen=True)
class SourceShare:
    """What a source of disturbance has in the momentum."""

    name: str
    secular: float
    """N m, its size"""
    along: float
    """its share of the secular torque, along that; the shares make 1 where all sources are known"""
    per_orbit: float
    """N m s"""
    cyclic: float
    """N m s, as `Sizing.cyclic`"""


@dataclass(frozen=True)
class Date:
    """A day of the year."""

    day: str
    activity: str
    """of the Sun; empty: as the scenario has it"""
    secular: float
    """N m"""
    per_orbit: float
    """N m s"""
    cyclic: float
    """N m s"""
    least: float
    """rod, by the formula, A m2"""


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
class Best:
    """The rods of the model for the duty and the margin asked for, under a law."""

    law: str
    rod: float | None
    """A m2; None: there is none up to LARGEST times the least and the craft's own"""


@dataclass(frozen=True)
class RodsByCondition:
    """The smallest rods that hold under a condition, law by law."""

    condition: str
    """for people"""
    rods: Mapping[str, float | None]
    """law -> A m2; None: none up to LARGEST times the least"""


@dataclass(frozen=True, repr=False)
class Sizing:
    """What a craft needs, beside what it has. Momenta N m s, torques N m, dipoles A m2, times s."""

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
    year: tuple[Date, ...]
    wheel_needed: float
    """of the fullest wheel, to hold cyclic and body momentum as the attitude turns, and a bias"""
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
    """the rods with the margin and the duty asked for, under conditions that are easier first"""
    law: str
    """of the recommended rods, the first of these"""
    recommended: float | None
    """the smallest with the margin and the duty asked for on the worst day of the year, with which
    the wheels suffice and `worst.toml` meets its requirements; None: there is none"""
    recommended_year: float | None
    """the same without `worst.toml`, by the model alone"""
    recommended_day: float | None
    """the same for the day of the scenario alone"""
    worst_day: str
    """and the activity of the Sun on it, or that it is the scenario's own; empty: no other day was
    looked at"""
    least_year: float
    """least rod for any law on that day, by the linear programme"""
    worst_scenario: str
    """the scenario that the recommended rods meet, too; empty: there is none, or it did not fly"""
    weakest: tuple[float, ...]
    """eci: against a torque along it the rods do least"""
    weakness: float
    """what they do there over what they do on the average of all directions"""
    blind: float
    """the longest time in which rods of 1.3 times the least cannot undo the secular torque"""
    tip_off_rate: float
    """rate of the body after separation, rad/s"""
    tip_off: float
    """momentum of the body after separation"""
    detumbling: float
    """least time in which its rods, at their limits, take that out of a craft that tumbles"""
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
    """kg a year, of thrusters alone in this layout, where dumps begin as a wheel is full; None:
    they are not known"""
    propellant_least: float | None
    """the same where each dump waits for the attitude at which it costs least"""
    wishes: Wishes
    curve: tuple[Flown, ...]
    margins: tuple[Margin, ...]
    problems: tuple[str, ...]
    notes: tuple[str, ...]

    def as_json(self) -> dict[str, Any]:
        """What `--json` prints; what is without end is null."""
        told = {name: finite(value) for name, value in asdict(self).items()}
        for row, margin in zip(told["margins"], self.margins, strict=True):
            row["ratio"] = finite(margin.ratio)
        return told | {"answer": self.answer}

    def __repr__(self) -> str:
        return f"<Sizing {self.answer}>"

    @property
    def duty(self) -> float:
        """Asked for (1)."""
        return self.wishes.duty

    @property
    def answer(self) -> str:
        """The sentence that answers."""
        if self.problems:
            rods = "" if self.recommended is None or self.recommended <= self.rod else (
                f" Rods of {self.recommended:.3g} A m2 do.")  # fmt: skip
            return f"{self.target} cannot hold: {self.problems[0]}.{rods}"
        wished = (f" with a duty of {100.0 * self.duty:.3g} % and a margin of "
                  f"{self.wishes.margin:g} under {self.law}")  # fmt: skip
        if not self.best:
            rods = (f"the least rod of any law is {max(self.least, self.least_year):.3g} A m2 (the "
                    "model has no law that fits)")  # fmt: skip
            wished = ""
        elif self.recommended is None:
            rods = (f"no rods of up to {LARGEST:g} times the least, "
                    f"{max(self.least, self.least_year):.3g} A m2, do")  # fmt: skip
        else:
            rods = f"rods of {self.recommended:.3g} A m2 are recommended: they hold {self._held()}"
        text = f"{self.target}: {rods}{wished}; it has {self.rod:.4g} A m2. "
        if self.detumbling_recommended is not None and self.first_dump_recommended is not None:
            text += (f"With {self.recommended:.3g} A m2 detumbling takes at least "
                     f"{format_duration(self.detumbling_recommended)}, the first dump "
                     f"{format_duration(self.first_dump_recommended)}. ")  # fmt: skip
        needs, has = self.wheel_needed + self.slew_momentum, self.wheel_capacity
        if has == inf:
            return text + f"Its wheels need {format_momenta(needs)} each and have no limit."
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
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(v) for v in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def size(
    target: str, options: Options, wishes: Wishes | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Sizing:  # fmt: skip
    """Size the wheels and rods of a craft for the attitude, orbit and law of a scenario. Raises
    DesatError for a craft without what it takes, or a run that does not complete."""
    wishes = wishes or Wishes()
    source = read(target)
    case = prepare(source, options)
    system, _ = case.or_raise()
    hardware = hardware_of(system)
    progress("the run at the wanted attitude")
    flight = fly_case(case, system)
    notes = [*doubts(system), *closed_loop_only(system, options)]
    try:
        own = law_of(system.components["manager"])
    except UnsuitedError as why:
        own = None
        notes.append(f"{_manager(system)}: closed loop only; {why}")
    torque, cyclic = secular(flight)
    able = reach(flight, hardware)
    progress("the least rod, by a linear programme")
    formula, least = least_by_formula(able, torque), least_by_programme(able, torque)
    attitude = attitude_of(system, flight.q, flight.r, flight.v)
    year: tuple[Date, ...] = ()
    hardest: WorstDay | None = None
    if wishes.year:
        progress("the days of a year")
        try:
            days = list(days_of_year(system, hardware, attitude))
            year = tuple(day for day, _ in days)
            hardest = _worst_day(system, hardware, attitude, days)
        except DesatError as why:
            notes.append(f"no other days of the year: {why}")
    laws = [own] if own is not None else []
    if wishes.laws or own is None:
        terms = terms_of(flight.period, flight.b, attitude.kind in ("inertial", "sun"))
        laws += other_laws(source, options, terms, notes)
    curve, best = _curves(flight, hardware, laws, least, wishes, progress, notes)
    law, day = (best[0].law, best[0].rod) if best else ("", None)
    model = next((x for x in laws if x.name == law), None)
    recommended = by_year = _for_the_year(day, hardest, model, hardware, least, wishes)
    conditions = [RodsByCondition("the day of the scenario", {b.law: b.rod and _up(b.rod)
                                                              for b in best})]  # fmt: skip
    if hardest is not None and best:
        others = {
            b.law: _for_the_year(b.rod, hardest, x, hardware, least, wishes, OTHERS_STEP)
            for b in best[1:] for x in laws if x.name == b.law
        }  # fmt: skip
        day_of_year = f"the worst day of the year ({_named(hardest, least)})"
        conditions.append(RodsByCondition(day_of_year, {law: by_year, **others}))
    told: list[str] = []
    beside = beside_craft(source) if wishes.flown else None
    if beside is not None:
        recommended, unmet = _for_worst(beside, options, hardware, recommended, model, progress)
        told += unmet
        conditions.append(RodsByCondition(f"{beside.text}, closed loop", {law: recommended}))
    filled = None
    if model is not None and hardest is not None and hardware.m_limit > 0.0:
        _, wheel = on_worst_day(hardest, model, hardware, np.array([hardware.m_limit]))
        filled = float(wheel[0])
    if wishes.flown and 0.0 < least < inf:
        curve = _beside(curve, recommended, source, options, system, own, least, progress)
    component = system.components["manager"]
    bias = [component.values[f"h_target_body[{i}]"] for i in (1, 2, 3)]
    needed, lasts = _wheels(flight, hardware, torque, cyclic, np.array(bias, float))
    where = geometry(flight, hardware, able, torque, least)
    slew = slew_of(hardware, wishes)
    rate = _tip_off(source, options) if wishes.tip_off is None else wishes.tip_off
    tip_off = float(np.linalg.eigvalsh(hardware.inertia)[-1]) * rate
    start = float(np.linalg.norm(flight.h_start))
    tumbling, against = (max(x, 1e-300) for x in (where.tumbling, where.against))

    def takes(momentum: float, torque: float, rod: float | None) -> float | None:
        """How long (s) rods (A m2) of a torque for each A m2 take for a momentum."""
        return None if rod is None else momentum / (torque * max(rod, 1e-300))

    rod = hardware.m_limit
    spent, spent_least = _propellant(system, flight, hardware, torque, wishes)
    made = Sizing(
        target, round(flight.whole / flight.period), flight.period, attitude.kind,
        tuple(torque.tolist()), float(np.linalg.norm(torque)) * flight.period, _span(cyclic),
        *shares_of(flight, torque), year, needed, *slew, room_of(hardware), hardware.torque_limit,
        lasts, formula, least, rod, best, tuple(conditions), law, recommended, by_year,
        day and _up(day), "" if hardest is None else _named(hardest, least),
        0.0 if hardest is None else max(least, hardest.least),
        "" if beside is None else beside.text,
        tuple(where.weakest.tolist()), where.weakness, where.blind, rate, tip_off,
        takes(tip_off, tumbling, rod) or 0.0, takes(tip_off, against, rod) or 0.0,
        takes(tip_off, tumbling, recommended), takes(tip_off, against, recommended),
        start, takes(start, against, rod) or 0.0,
        spent, spent_least, wishes, curve, (), (), (),
    )  # fmt: skip
    made = replace(made, margins=tuple(_margins(made, filled)))
    problems = (*_problems(made), *told)
    return replace(made, problems=problems, notes=(*notes, *_notes(made, attitude)))


LOOP_ROLES = (
    "magnetometer",
    "gyro",
    "determination",
    "star_tracker",
    "sun_sensor",
    "controller",
)  #: Roles whose parameters act in the closed loop alone.
LOOP_PARAMETERS = {
    "wheels": {
        "motor_lag", "viscous", "coulomb", "friction_speed", "compensation", "stiction",
        "unbalance", "seed", "idle_power", "motor_constant", "h_start_wheel", "speed_gain",
        "speed_sample_time", "command_mode", "failed_from",
    },
    "spacecraft": {"q_start_bi", "omega_start_body", "start_frame", "angle_limit"},
    "tachometers": {"sample_time", "bias_wheel", "resolution", "full_scale", "fail_time", "seed"},
    "thrusters": {
        "sample_time", "placement", "carried", "least_on_time", "least_pulse", "schedule_start",
        "schedule_duration", "schedule_tau_body", "schedule_force_body",
    },
    "torquers": {"lag", "resistance", "area_turns", "failed_coil", "failed_from", "failed_share",
                 "failure_known", "pulse_delay", "least_pulse"},
    "manager": {"delay", "wheel_sample_time", "null_gain", "gyroscopic", "feedforward"},
}  # fmt: skip
"""Parameters of other roles that do so."""


def doubts(system: System) -> list[str]:
    """Say what is improbable in a craft, as `check` and `run` do."""
    return [*plausibility.warnings(system), *attitude_loop.warnings(system)]


def closed_loop_only(system: System, options: Options) -> Iterator[str]:
    """Name the parameters that options set and the momentum model does not have, in a line."""
    given = [x.partition("=")[0].strip() for x in options.sets] + [*options.values]
    names = []
    for name in dict.fromkeys(given):
        owner, _, parameter = name.partition(".")
        component = system.components.get(owner)
        role = owner if component is None else component.interface.role
        parameter = parameter.partition("[")[0]
        if role in LOOP_ROLES or parameter in LOOP_PARAMETERS.get(role, ()):
            names.append(name)
    if names:
        yield f"{', '.join(names)}: in the closed loop only, the sizes do not know it"


def _named(hardest: WorstDay, least: float) -> str:
    """The worst day for people: the scenario's own where that asks for more."""
    if least >= hardest.least:
        return "that of the scenario"
    activity = f", {hardest.activity} solar activity" if hardest.activity else ""
    return f"{hardest.day}{activity}"


def _for_the_year(
    day: float | None, hardest: WorstDay | None, law: Law | None, hardware: Hardware, least: float,
    wishes: Wishes, longest: float = STEP,
) -> float | None:  # fmt: skip
    """The rods (A m2) that hold on the scenario's day, which takes `day`, and on the worst one;
    None: there are none."""
    if day is None or law is None:
        return None
    if hardest is None or hardest.least == 0.0:
        return _up(day)
    if hardest.least == inf:
        return None
    most = max(LARGEST, hardware.m_limit / hardest.least)
    rods = np.array([_up(x) for x in np.geomspace(wishes.margin, most, 60) * hardest.least])
    rods = np.maximum(rods, _up(day))
    found = _smallest(
        *on_worst_day(hardest, law, hardware, rods, longest), room_of(hardware), wishes
    )
    return None if found is None else float(rods[found])


def _tip_off(source: Target, options: Options) -> float:
    """Return the rate after separation (rad/s): of the scenario `detumbling` beside a craft of
    one's own, or TIP_OFF."""
    file = source.scenario.file if source.scenario is not None else None
    if file is None or not (there := file.parent / DETUMBLING).is_file():
        return TIP_OFF
    try:
        system, _ = prepare(read(str(there)), replace(options, stop=None)).or_raise()
    except DesatError:
        return TIP_OFF
    return float(np.linalg.norm(system.components["spacecraft"].values["omega_start_body"]))


def beside_craft(source: Target) -> Target | None:
    """The worst scenario of a craft of one's own, where the source is its nominal one."""
    file = source.scenario.file if source.scenario is not None else None
    if file is None or file.name != NOMINAL or not (there := file.parent / WORST).is_file():
        return None
    return read(str(there))


def _for_worst(
    source: Target, options: Options, hardware: Hardware, rod: float | None, law: Law | None,
    progress: Callable[[str], None],
) -> tuple[float | None, list[str]]:  # fmt: skip
    """Rods (A m2), from `rod` on, with which a scenario meets its requirements in the closed loop;
    None: there are none. And a line for each requirement that it misses with the craft's own."""

    def flown_with(size: float) -> tuple[Manifest, Flight | None]:
        progress(f"{WORST} with rods of {size:.4g} A m2")
        run = _with_rods(source, options, size, more=series_of_numbers)
        with run.results as results:
            try:
                found = flight_of(prepare(source, options).or_raise()[0], results)
            except DesatError:  # it is shorter than an orbit
                found = None
        return run.manifest, found

    known: dict[float, tuple[Manifest, Flight | None]] = {}
    own, largest = hardware.m_limit, max(LARGEST * (rod or 0.0), hardware.m_limit)
    while rod is not None:
        manifest, found = known[rod] = known.get(rod) or flown_with(rod)
        if not manifest.not_met:
            break
        rod = _larger(manifest, found, hardware, rod, law, largest) if len(known) < TRIES else None
    missed: list[str] = []
    if own > 0.0 and (rod is None or own < rod):
        missed = (known.get(own) or flown_with(own))[0].not_met
    return rod, [f"{WORST} with its rods of {own:.4g} A m2: {line}" for line in missed]


def _larger(
    manifest: Manifest, flight: Flight | None, hardware: Hardware, rod: float, law: Law | None,
    largest: float,
) -> float | None:  # fmt: skip
    """The next rod to try where a run with `rod` misses a requirement: by the model where that is
    one on the wheels' largest momentum, in a craft that keeps its attitude. None: it is larger than
    all that are looked at."""
    over = [v.value / v.max for v in manifest.verdicts.values()
            if not v.met and v.max and v.value and v.number == "largest_momentum"]  # fmt: skip
    step = _up(STEP_UP * rod)
    if over and flight is not None and law is not None and not manifest.unmet:
        rods = np.array([_up(x) for x in np.geomspace(rod, max(largest, 1.01 * rod), 40)])
        peak = fly([track_of(flight, law, hardware)], law, hardware, rods.tolist()).peak[0, 0]
        enough = peak <= 0.99 * peak[0] / max(over)
        step = max(step, float(rods[int(np.argmax(enough))]) if enough.any() else inf)
    return step if step <= largest else None


def _worst_day(
    system: System, hardware: Hardware, attitude: Attitude, days: Sequence[tuple[Date, Any]]
) -> WorstDay:  # fmt: skip
    """The day of the largest least rod, flown at rows that the model can take."""
    date, (inputs, nodes) = max(days, key=lambda d: d[0].least)
    times = np.linspace(nodes[0], nodes[-1], round((nodes[-1] - nodes[0]) / SAMPLE) + 1)
    flight = flown_at(system, attitude, between(inputs, nodes, times), times)
    torque, _ = secular(flight)
    return WorstDay(date.day, date.activity, least_by_programme(reach(flight, hardware), torque),
                    flight)  # fmt: skip


def _manager(system: System) -> str:
    return system.components["manager"].source.rpartition("/")[2].removesuffix(".fmu")


def fly_case(case: Case, system: System) -> Flight:
    """The flight of a prepared case, flown now. Raises DesatError where it does not complete."""
    recording = replace(case.options, record=series_for(system), every=1)
    run = simulate(replace(case, options=recording)).or_raise(case.target)
    with run.results as results:
        return flight_of(system, results)


def shares_of(flight: Flight, torque: Array) -> tuple[tuple[SourceShare, ...], float | None]:
    """The shares of the sources, and the secular torque that is of none of them."""
    if not flight.sources:
        return (), None
    square = float(torque @ torque)
    rows, known = [], np.zeros(3)
    for name, impulse in flight.sources.items():
        mean, cyclic = _secular(flight.source_times, impulse, flight.whole)
        known += mean
        size = float(np.linalg.norm(mean))
        along = float(mean @ torque) / square if square > 0.0 else 0.0
        rows.append(SourceShare(name, size, along, size * flight.period, _span(cyclic)))
    return tuple(rows), float(np.linalg.norm(torque - known))


def days_of_year(
    system: System, hardware: Hardware, attitude: Attitude, own: bool = False
) -> Iterator[tuple[Date, tuple[dict[str, Array], Array]]]:  # fmt: skip
    """The days of a year, one after the other, each with what the environment gives and the times
    (s); `own`: with the scenario's own solar activity first, then with low and high. Raises
    DesatError where they cannot be asked for."""
    if attitude.kind == "moving":
        raise DesatError(f"the attitude stays neither in eci nor in lvlh ("
                         f"{np.degrees(attitude.wanders):.3g} deg from its mean)")  # fmt: skip
    component = system.components["environment"]
    block = environment_block(component, needless(system))
    first = inputs_at(block, [0.0])
    period = period_of(first["r_eci"][0], first["v_eci"][0])
    span = period * max(1, int(86400.0 / period))
    since = np.linspace(0.0, span, round(span / YEAR_STEP) + 1)
    levels = _activities(component, values_of(system)["spacecraft"], own)
    epoch = float(getattr(block, "epoch_j2000", 0.0))
    begin = datetime(2000, 1, 1, 12, tzinfo=UTC) + timedelta(seconds=epoch)
    for k in range(DATES):
        times = since + 86400.0 * DAYS * k
        inputs = inputs_at(block, times.tolist())
        for name, changes in levels:
            if changes:
                air = environment_block(component, changes)
                inputs = inputs | {"density": inputs_at(air, times.tolist())["density"]}
            flight = flown_at(system, attitude, inputs, times)
            torque, cyclic = secular(flight)
            size = float(np.linalg.norm(torque))
            date = Date((begin + timedelta(days=DAYS * k)).date().isoformat(), name, size,
                        size * flight.period, _span(cyclic),
                        least_by_formula(reach(flight, hardware), torque))  # fmt: skip
            yield date, (inputs, times)


def _activities(
    component: Component, craft: Mapping[str, Any], own: bool
) -> list[tuple[str, dict[str, int]]]:
    """Low and high activity of the Sun, as changes of an environment that makes no field, where the
    air matters and it knows them; else as it is. `own`: the scenario's before them."""
    signals = component.interface.signals
    thin = craft.get("aerodynamics", "none") == "none"
    if thin or "solar_activity" not in signals or "density" not in component.interface.signals:
        return [("", {})]

    def number(name: str, choice: str) -> int:
        return signals[name].choices.index(choice)

    still = {"field": number("field", "none"), "atmosphere": number("atmosphere", "activity")}
    levels = [(x, still | {"solar_activity": number("solar_activity", x)}) for x in ("low", "high")]
    if not own or component.choice("atmosphere") != "activity":
        return levels if not own else [("", {})]
    mine = component.choice("solar_activity")
    return [(mine, {}), *((name, changes) for name, changes in levels if name != mine)]


def _curves(
    flight: Flight, hardware: Hardware, laws: Sequence[Law], least: float, wishes: Wishes,
    progress: Callable[[str], None], notes: list[str],
) -> tuple[tuple[Flown, ...], tuple[Best, ...]]:  # fmt: skip
    """The curves of the laws, the craft's own first, and the rods to recommend under each."""
    if not 0.0 < least < inf:
        return (), ()
    rows: tuple[Flown, ...] = ()
    best: tuple[Best, ...] = ()
    for law in laws:
        progress(f"the model of {law.name}")
        try:
            more, recommended = curve_of(flight, law, hardware, least, wishes)
        except UnsuitedError as why:
            notes.append(f"{law.name}: closed loop only; {why}")
            continue
        rows, best = rows + more, (*best, Best(law.name, recommended))
    return rows, best


def _beside(
    curve: tuple[Flown, ...], recommended: float | None, source: Target, options: Options,
    system: System, own: Law | None, least: float, progress: Callable[[str], None],
) -> tuple[Flown, ...]:  # fmt: skip
    """The rows of the craft's own manager with the closed loop at the sizes that count; rows of the
    closed loop alone where the model does not have its law."""
    name = own.name if own is not None and curve and curve[0].law == own.name else ""
    closed = [*(k * least for k in FLOWN), *([recommended] if recommended else [])]
    if name:
        return tuple(
            in_the_loop(row, source, options, progress)
            if row.law == name and any(abs(row.rod - m) < 1e-9 * m for m in closed) else row
            for row in curve
        )  # fmt: skip
    alone = [Flown(_manager(system), m, m / least, None, None, None, None) for m in sorted(closed)]
    return (*(in_the_loop(row, source, options, progress) for row in alone), *curve)


def in_the_loop(
    row: Flown, source: Target, options: Options,
    progress: Callable[[str], None] = lambda text: None,
) -> Flown:  # fmt: skip
    """A size of rods with what the closed loop makes of it."""
    progress(f"the closed loop with rods of {row.rod:.4g} A m2")
    run = _with_rods(source, options, row.rod).or_raise(source.text)
    system, _ = prepare(source, options).or_raise()
    with run.results as results:
        wheels = "wheels.h_wheel" in results.names()
        h = results.values("wheels.h_wheel" if wheels else "spacecraft.h_copy_wheel")
        m = results.values("torquers.m_mean_body")
        counts = useful(results.values("environment.b_eci")[: len(m)])
    hardware = hardware_of(system)
    sizes = np.linalg.norm(h @ hardware.axes_wheel.T, axis=1)
    coils = m @ np.linalg.pinv(hardware.axes_coil).T
    return replace(
        row, loop_rms=float(np.sqrt((sizes**2).mean())), loop_largest=float(sizes.max()),
        loop_duty=float(np.abs(coils[: len(counts)][counts]).mean()) / row.rod,
    )  # fmt: skip


def _with_rods(
    source: Target, options: Options, rod: float,
    more: Callable[[System], Iterable[str]] = lambda system: (),
) -> Run:  # fmt: skip
    """A run with rods of this size (A m2), which has recorded what a flight takes, and more."""
    plain, _ = prepare(source, options).or_raise()
    values = {**options.values, "torquers.m_limit": rod}
    if "m_limit" in plain.components["manager"].interface.signals:
        values["manager.m_limit"] = rod
    case = prepare(source, replace(options, values=values))
    system, _ = case.or_raise()
    record = tuple(sorted({*series_for(system), *more(system)}))
    return simulate(replace(case, options=replace(case.options, record=record, every=1)))


def _wheels(
    flight: Flight, hardware: Hardware, torque: Array, cyclic: Array, bias: Array
) -> tuple[float, float]:  # fmt: skip
    """What the fullest wheel has to hold of the cyclic momentum and of a bias (3,) N m s, body,
    shared with the least squares, and how long wheels that begin at rest last without dumping
    (s)."""
    spread = hardware.spread()
    n = len(cyclic)
    inside = in_body_of(flight, cyclic - _middle(cyclic))
    bent = flight.body[:n] - flight.body[:n].mean(axis=0)
    needed = float(np.abs((inside - bent + bias) @ spread.T).max())
    room = hardware.capacity > 0.0
    capacity = hardware.capacity[room]
    gained = flight.disturbance - flight.disturbance[0]
    stored = np.abs(in_body_of(flight, gained) @ spread.T)[:, room]
    full = (stored >= capacity).any(axis=1)
    since = flight.times - flight.times[0]
    if full.any():
        return needed, float(since[np.argmax(full)])
    # of what goes on beyond the flight: along the torque in the attitudes that it has shown
    along = rotate(flight.q[:n], np.broadcast_to(torque, (n, 3)))
    rate = float(np.abs(along @ spread.T)[:, room].max())
    left = float((capacity - stored.max(axis=0)).min())
    return needed, inf if rate == 0.0 else float(since[-1]) + left / rate


def slew_of(hardware: Hardware, wishes: Wishes) -> tuple[float, float]:
    """Momentum (N m s) and torque (N m) of the fullest wheel in a slew about the worst axis, with
    the rate of a triangle."""
    if wishes.slew_time == 0.0:
        return 0.0, 0.0
    worst = float(np.linalg.norm(hardware.spread() @ hardware.inertia, axis=1).max())
    rate = 2.0 * wishes.slew_angle / wishes.slew_time
    return worst * rate, worst * 2.0 * rate / wishes.slew_time


def _propellant(
    system: System, flight: Flight, hardware: Hardware, torque: Array, wishes: Wishes
) -> tuple[float | None, float | None]:
    """kg a year that thrusters alone take for the secular torque: where dumps begin as the fullest
    wheel is fullest, and where each waits for the attitude at which it costs least. None where
    they are not known.

    An impulse along the body direction u costs |u|_1 / (arm g0 I_sp) of pairs that give a torque
    about one axis each, and of nozzles what their own on-times come to (`least_on_times`).
    """
    size = float(np.linalg.norm(torque))
    isp = wishes.specific_impulse or hardware.specific_impulse
    cost = cost_of(system, hardware, wishes)
    if cost is None or isp is None:
        return None, None
    if size == 0.0:
        return 0.0, 0.0
    along, costs = costs_along(flight, torque, cost, isp)
    full = np.abs(along @ hardware.spread().T).max(axis=1)
    at_begin = float(costs[full >= (1.0 - 1e-3) * full.max()].mean())
    return size * YEAR * at_begin, size * YEAR * float(costs.min())


def costs_along(
    flight: Flight, torque: Array, cost: Callable[[Array], float], isp: float
) -> tuple[Array, Array]:  # fmt: skip
    """The direction of a torque (3,), eci, in body at ATTITUDES of a flight (rows, 3), and the
    propellant (kg) that 1 N m s along it takes in each."""
    q = flight.q[:: max(1, len(flight.q) // ATTITUDES)]
    along = rotate(q, np.broadcast_to(torque / np.linalg.norm(torque), (len(q), 3)))
    return along, np.array([cost(u) for u in along]) / (isp * GRAVITY)


def cost_of(
    system: System, hardware: Hardware, wishes: Wishes
) -> Callable[[Array], float] | None:  # fmt: skip
    """The impulse of force (N s) that an angular impulse of 1 N m s along a body direction takes;
    None where it is not known."""
    arm = wishes.arm or hardware.arm
    if arm is not None:
        return lambda u: float(np.abs(u).sum()) / arm
    thrusters = values_of(system).get("thrusters", {})
    if "position_nozzle" not in thrusters:
        return None
    thrust = np.array(thrusters["thrust"], float)
    forces = np.reshape(thrusters["direction_nozzle"], (-1, 3)) * thrust[:, None]
    torques = np.cross(np.reshape(thrusters["position_nozzle"], (-1, 3)), forces)

    def cost(u: Array) -> float:
        x, y, z = u.tolist()
        times = least_on_times(tuple(map(tuple, torques.tolist())), (x, y, z), 1e9)
        left = u - np.array(times) @ torques
        return float(np.array(times) @ thrust) if np.linalg.norm(left) < 1e-3 else inf

    return cost


def _margins(made: Sizing, filled: float | None) -> Iterator[Margin]:
    """What is needed beside what there is, a row each. `filled`: what the fullest wheel comes to
    on the worst day with the craft's rods (N m s); None: it is not known."""
    if made.least < inf:
        yield Margin("rods: any law, this day", made.least, made.rod, "A.m2")
    if made.least_year > 0.0:
        yield Margin("rods: any law, worst day of the year", made.least_year, made.rod, "A.m2")
    if made.recommended is not None:
        yield Margin(f"rods: {made.law}, duty and margin", made.recommended, made.rod, "A.m2")
    if filled is not None and 0.0 < made.wheel_capacity < inf:
        yield Margin(f"wheels: {made.law} with its rods, worst day", filled, made.wheel_capacity,
                     "N.m.s")  # fmt: skip
    if made.wheel_capacity < inf:
        yield Margin("wheels: cyclic momentum", made.wheel_needed, made.wheel_capacity, "N.m.s")
        if made.slew_momentum > 0.0:
            both = made.wheel_needed + made.slew_momentum
            yield Margin("wheels: cyclic momentum and slew", both, made.wheel_capacity, "N.m.s")
    for row in (r for r in made.curve if r.law == made.law and r.rod == made.rod):
        if row.filled is not None:
            yield Margin(f"wheels: {row.law} with its rods", row.filled * made.wheel_capacity,
                         made.wheel_capacity, "N.m.s")  # fmt: skip
        if row.duty is not None:
            yield Margin(f"coils: duty by {row.law} with its rods", row.duty, made.duty, "1")
    if made.slew_torque > 0.0 and made.wheel_torque < inf:
        yield Margin("wheels: torque of the slew", made.slew_torque, made.wheel_torque, "N.m")


def _problems(made: Sizing) -> list[str]:
    """Why the craft cannot hold its momentum, a line each."""
    lines = []
    if made.least == inf:
        lines.append("no rod takes the secular torque out: the field is along it all the time")
    elif made.rod < made.least:
        lines.append(f"rods of {made.rod:.4g} A m2: the secular torque needs at least "
                     f"{made.least:.4g} A m2 with any law")  # fmt: skip
    else:
        lines += [
            f"rods of {m.has:.4g} A m2: the worst day of the year needs at least {m.needed:.4g} "
            "A m2 with any law" for m in made.margins if "worst day" in m.name and m.ratio < 1.0
        ]  # fmt: skip
    lines += [
        f"wheels of {format_momenta(m.has)}: {made.law} with its rods of {made.rod:.4g} A m2 lets "
        f"the fullest one come to {format_momenta(m.needed)}"
        f"{' on the worst day' * m.name.endswith('day')}"
        for m in made.margins
        if m.name.startswith(f"wheels: {made.law} with its rods") and m.ratio < 1.0
    ]
    if made.wheel_needed > made.wheel_capacity:
        lines.append(
            f"wheels of {format_momenta(made.wheel_capacity)}: the cyclic momentum alone needs "
            f"{format_momenta(made.wheel_needed)} of the fullest one"
        )
    elif made.wheel_needed + made.slew_momentum > made.wheel_capacity:
        lines.append(
            f"wheels of {format_momenta(made.wheel_capacity)}: cyclic momentum and slew need "
            f"{format_momenta(made.wheel_needed + made.slew_momentum)} of the fullest one"
        )
    if made.slew_torque > made.wheel_torque:
        lines.append(f"wheels of {made.wheel_torque:.4g} N m: the slew needs "
                     f"{made.slew_torque:.4g} N m of the fullest one")  # fmt: skip
    return lines


def _notes(made: Sizing, attitude: Attitude) -> list[str]:
    """What the numbers do not say, a line each."""
    lines = []
    if made.orbits < 14:
        lines.append(f"{made.orbits} whole orbits: a day (--stop 86400) sees the field turn once")
    if made.least < inf and abs(made.least - made.least_formula) > 0.01 * made.least_formula:
        lines.append("formula and linear programme differ by more than 1 %: the latter counts")
    if attitude.kind == "moving":
        lines.append("the attitude moves: rods and wheels are those of the run as it was flown")
    return lines
