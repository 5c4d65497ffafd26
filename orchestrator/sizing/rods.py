"""Size rods: momentum and duty of laws over rod sizes, and the smallest rods."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil, floor, inf, log10, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analyses.flight import (
    Flight,
    Hardware,
    attitude_of,
    flight_of,
    fly_days,
    hardware_of,
    secular,
    series_for,
    wanted_attitude,
)
from ..analyses.manifest import Manifest
from ..campaign.draws import series_of_numbers
from ..files.scenario import Scenario
from ..runs.case import Case
from ..runs.prepare import prepare, resolved
from ..runs.run import Run, simulate
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from .compatibility import Terms, fitting
from .law import OTHERS_STEP, STEP, Law, UnsuitedError, hold_of, law_of
from .least_rod import least_by_programme, reach
from .model import MomentumCourse, fly, track_of, useful
from .momentum import smallest_wheel_capacity
from .requirements import SizingRequirements
from .scenarios import WORST
from .year import WorstDay, days_of_year, find_worst_day

Array = NDArray[Any]
CURVE_MULTIPLES = (0.8, 1.0, 1.15, 1.3, 1.6, 2.0, 3.0, 5.0, 8.0)
# rods of a curve, in units of the least; from 1.15 on model and closed loop agree to 5 %
LARGEST_MULTIPLE = 30.0  # largest rod considered, or the craft's own if larger
LOOP_MULTIPLES = (1.3,)  # rods of the closed loop besides the recommended one
LOOP_TRIES = 6  # flights of the worst scenario, with growing rods
SATURATED = 0.9  # duty (1) of coils with which no loop holds
LOOP_STEP = 1.5  # growth factor where the model gives none
GRID_SIZES = 60  # rods of a search by the model
# Flights of a search by bisection, and factor between rods that suffice and do not, at
# which it ends.
TRIES, CLOSE = 8, 1.1


def other_laws(case: Case, terms: Terms, notes: list[str]) -> Iterator[Law]:
    """Yield the laws that fit the craft besides its own (`compatibility.py`).

    Laws that the model lacks are added to the notes instead.
    """
    without = []
    for each in fitting(case, terms)[0][1:]:
        system, _ = each.case.or_raise()
        try:
            yield law_of(system.components["manager"])
        except UnsuitedError:
            without.append(each.name)
    if without:
        notes.append(
            f"closed loop only, by `desat compare {case.target} --laws all`: {', '.join(without)}"
        )


@dataclass(frozen=True)
class SizingPoint:
    """A size of rods (A m2) under a law, by the model and in the closed loop."""

    law: str
    rod: float
    multiple: float  # rod over the least rod
    rms: float | None  # N m s; None: closed loop only
    largest: float | None
    # fullest wheel in the second half, share of its capacity; None: no limit
    filled: float | None
    duty: float | None  # 1
    loop_rms: float | None = None
    loop_largest: float | None = None
    loop_duty: float | None = None


def round_up(rod: float) -> float:
    """Return a rod (A m2) rounded up to three digits.

    So it can be typed again as it is printed.
    """
    if not 0.0 < rod < inf:
        return rod
    digit = 10.0 ** (floor(log10(rod)) - 2)
    return float(f"{ceil(rod / digit * (1.0 - 1e-12)) * digit:.3g}")


def rod_grid(
    least: float, requirements: SizingRequirements, hardware: Hardware
) -> Array:
    """Return rods (A m2) from the margin over the least one to the largest allowed."""
    largest = max(LARGEST_MULTIPLE, hardware.m_limit / least)
    return np.geomspace(requirements.margin, largest, GRID_SIZES) * least


def fly_rods(
    flight: Flight,
    law: Law,
    hardware: Hardware,
    rods: Array,
    longest: float | None = None,
) -> MomentumCourse:
    """Fly the model with rods of several sizes.

    Parameters
    ----------
    flight, law, hardware
        Flight, law and craft of the model.
    rods
        (n,) A m2.
    longest
        Time (s) up to which samples of the law are combined; None: the default of
        `hold_of`.

    Returns
    -------
    Course
        (n,) each.

    Raises
    ------
    UnsuitedError
        If the model does not have the law.
    """
    if longest is None:
        track = track_of(flight, law, hardware)
    else:
        track = track_of(flight, law, hardware, hold=hold_of(law, flight, longest))
    course = fly([track], law, hardware, rods.tolist())
    return MomentumCourse(*(table[0, 0] for table in course))


def find_smallest(rods: Array, is_enough: Array) -> float | None:
    """Return the first rod (A m2) that is enough, or None if there is none."""
    return float(rods[np.argmax(is_enough)]) if is_enough.any() else None


def meets(
    course: MomentumCourse, hardware: Hardware, requirements: SizingRequirements
) -> Array:
    """Return for each rod whether the duty is met and wheels hold with the margin."""
    capacity = smallest_wheel_capacity(hardware)
    holds = course.wheel * requirements.margin <= capacity
    return np.asarray((course.duty <= requirements.duty) & holds)


def curve_of(
    flight: Flight,
    law: Law,
    hardware: Hardware,
    least: float,
    requirements: SizingRequirements,
    longest: float,
) -> tuple[tuple[SizingPoint, ...], float | None]:
    """Compute the momentum and duty of a law over sizes of rods.

    Samples of the law are combined up to `longest` (s).

    Returns
    -------
    points
        At the sizes of CURVE_MULTIPLES, at the craft's own size and at the smallest
        that meets the requirements.
    smallest
        That rod (A m2); None if there is none.

    Raises
    ------
    UnsuitedError
        If the model does not have the law.
    """
    grid = rod_grid(least, requirements, hardware)
    sizes = [hardware.m_limit] if hardware.m_limit else []
    rods = np.array([*grid, *(k * least for k in CURVE_MULTIPLES), *sizes])
    course = fly_rods(flight, law, hardware, rods, longest)
    is_enough = meets(course, hardware, requirements)[: len(grid)]
    smallest = find_smallest(grid, is_enough)
    rows = [*range(len(grid), len(rods))]
    if smallest is not None:
        rows.append(int(np.argmax(is_enough)))
    capacity = smallest_wheel_capacity(hardware)
    points = tuple(
        SizingPoint(
            law=law.name,
            rod=float(rods[i]),
            multiple=float(rods[i]) / least,
            rms=float(course.rms[i]),
            largest=float(course.largest[i]),
            filled=float(course.wheel[i]) / capacity if capacity < inf else None,
            duty=float(course.duty[i]),
        )
        for i in sorted(rows, key=lambda i: rods[i])
    )
    return points, smallest


@dataclass(frozen=True)
class Best:
    """Smallest rods of the model with the required duty and margin, under a law."""

    law: str
    # A m2; None: none up to LARGEST_MULTIPLE times the least and the craft's own
    rod: float | None


def compute_curves(
    flight: Flight,
    hardware: Hardware,
    laws: Sequence[Law],
    least: float,
    requirements: SizingRequirements,
    progress: Callable[[str], None],
    notes: list[str],
) -> tuple[tuple[SizingPoint, ...], tuple[Best, ...]]:
    """Compute the curves of laws and the rods to recommend under each.

    The craft's own law comes first.
    """
    if not 0.0 < least < inf:
        return (), ()
    rows: tuple[SizingPoint, ...] = ()
    best: tuple[Best, ...] = ()
    for law in laws:
        progress(f"the model of {law.name}")
        longest = STEP if law is laws[0] else OTHERS_STEP
        try:
            more, recommended = curve_of(
                flight, law, hardware, least, requirements, longest
            )
        except UnsuitedError as error:
            notes.append(f"{law.name}: closed loop only; {error}")
            continue
        rows, best = rows + more, (*best, Best(law.name, recommended))
    return rows, best


def find_rod_for_year(
    day: float | None,
    hardest: WorstDay | None,
    law: Law | None,
    hardware: Hardware,
    requirements: SizingRequirements,
    longest: float = STEP,
) -> float | None:
    """Return the smallest rod (A m2) that holds on the scenario's and on the worst day.

    Parameters
    ----------
    day
        Rod (A m2) that the scenario's day needs; None: none holds.
    hardest
        The worst day; None: there is no other.
    law, hardware, requirements
        Law and craft of the model, and the conditions that the rod has to meet.
    longest
        Time (s) up to which samples of the law are combined.
    """
    if day is None or law is None:
        return None
    if hardest is None or hardest.least == 0.0:
        return round_up(day)
    if hardest.least == inf:
        return None
    grid = [round_up(x) for x in rod_grid(hardest.least, requirements, hardware)]
    rods = np.maximum(grid, round_up(day))
    course = fly_rods(hardest.flight, law, hardware, rods, longest)
    return find_smallest(rods, meets(course, hardware, requirements))


def find_rods_of_laws(
    system: System,
    flight: Flight,
    laws: Sequence[Law],
    requirements: SizingRequirements,
) -> tuple[WorstDay, list[float | None]]:
    """Return the smallest rods (A m2) of laws, on a flight and on the year's worst day.

    Parameters
    ----------
    system, flight
        The craft, and its flight at the wanted attitude.
    laws
        Laws of the model.
    requirements
        Conditions that the rods have to meet.

    Returns
    -------
    hardest
        The worst day.
    rods
        Those of each law; None: none holds.

    Raises
    ------
    DesatError
        If the attitude moves, or the environment has no other days.
    """
    hardware = hardware_of(system)
    attitude = attitude_of(system, flight.q, flight.r, flight.v)
    torque, _ = secular(flight)
    least = least_by_programme(reach(flight, hardware), torque)
    hardest = find_worst_day(
        system, hardware, attitude, list(days_of_year(system, hardware, attitude))
    )
    rods: list[float | None] = []
    for law in laws:
        grid = rod_grid(least, requirements, hardware)
        course = fly_rods(flight, law, hardware, grid, OTHERS_STEP)
        day = find_smallest(grid, meets(course, hardware, requirements))
        rods.append(
            find_rod_for_year(day, hardest, law, hardware, requirements, OTHERS_STEP)
        )
    return hardest, rods


def find_rod_by_flights(
    source: Scenario,
    options: Options,
    hardest: WorstDay,
    requirements: SizingRequirements,
) -> float | None:
    """Return the smallest rod (A m2) with which the closed loop holds the worst day.

    Duty and wheels have to be as the requirements say. The rod is found by bisection, to
    a factor of `CLOSE`; None: none of TRIES flights holds.
    """
    system, _ = prepare(source, options).or_raise()
    hardware = hardware_of(system)
    rod = floor_rod = requirements.margin * hardest.least
    too_small, enough = 0.0, inf
    for _ in range(TRIES):
        begin = float(hardest.flight.times[0])
        run = _with_rods(source, options, system, rod, begin=begin)
        if run.ok and _is_enough(run, hardware, rod, requirements):
            enough = rod
        else:
            too_small = rod
        if enough <= floor_rod or enough <= CLOSE * too_small:
            break
        rod = LOOP_STEP * rod if enough == inf else sqrt(too_small * enough)
    return None if enough == inf else round_up(enough)


def _is_enough(
    run: Run, hardware: Hardware, rod: float, requirements: SizingRequirements
) -> bool:
    """Return whether a run with a rod (A m2) keeps duty and wheels within requirements."""
    with run.results as results:
        wheels = results.values("wheels.h_wheel")
        m = results.values("torquers.m_mean_body")
        counts = useful(results.values("environment.b_eci")[: len(m)])
    coils = m @ np.linalg.pinv(hardware.axes_coil).T
    duty = float(np.abs(coils[: len(counts)][counts]).mean()) / rod
    fullest = float(np.abs(wheels[len(wheels) // 2 :]).max())
    holds = fullest * requirements.margin <= smallest_wheel_capacity(hardware)
    return holds and duty <= requirements.duty


def find_rod_for_worst(
    source: Scenario,
    options: Options,
    hardware: Hardware,
    rod: float | None,
    law: Law | None,
    progress: Callable[[str], None],
) -> tuple[float | None, list[str]]:
    """Return the smallest tried rod (A m2) that meets a scenario's requirements.

    The closed loop flies with rods from `rod` on; None if none meets them. The second
    value has a line for each requirement that the craft's own rods miss.
    """
    system, _ = resolved(source, options)

    def fly_with(size: float) -> tuple[Manifest, Flight | None]:
        """Fly the scenario with rods of a size (A m2)."""
        progress(f"{WORST} with rods of {size:.4g} A m2")
        settled = options
        if flights:  # the substeps of the first flight
            first, _ = next(iter(flights.values()))
            settled = replace(options, substeps=first.substeps)
        run = _with_rods(source, settled, system, size, more=series_of_numbers)
        with run.results as results:
            try:
                flight = flight_of(system, results)
            except DesatError:  # the run is shorter than an orbit
                flight = None
        return run.manifest, flight

    flights: dict[float, tuple[Manifest, Flight | None]] = {}
    craft_rod, largest = (
        hardware.m_limit,
        max(LARGEST_MULTIPLE * (rod or 0.0), hardware.m_limit),
    )
    if rod is not None and law is not None:
        rod = _first_to_try(system, law, hardware, rod, largest)
    while rod is not None:
        if rod not in flights:
            flights[rod] = fly_with(rod)
        manifest, flight_flown = flights[rod]
        if not manifest.not_met:
            break
        if len(flights) == LOOP_TRIES:
            rod = None
        else:
            rod = _find_larger(manifest, flight_flown, hardware, rod, law, largest)
    missed: list[str] = []
    if craft_rod > 0.0 and (rod is None or craft_rod < rod):
        missed = (flights.get(craft_rod) or fly_with(craft_rod))[0].not_met
    return rod, [
        f"{WORST} with its rods of {craft_rod:.4g} A m2: {line}" for line in missed
    ]


def _first_to_try(
    system: System, law: Law, hardware: Hardware, rod: float, largest: float
) -> float:
    """Return the first rod (A m2), from `rod` on, with which a loop may hold.

    With a smaller one the model fills a wheel or saturates the coils. It is `rod` where
    the environment cannot be flown by itself.
    """
    rods = np.array([round_up(x) for x in np.geomspace(rod, max(largest, rod), 20)])
    try:
        flight = fly_days(system, wanted_attitude(system))
        course = fly_rods(flight, law, hardware, rods, OTHERS_STEP)
    except (DesatError, UnsuitedError):
        return rod
    holds = course.peak <= smallest_wheel_capacity(hardware)
    return find_smallest(rods, holds & (course.duty < SATURATED)) or rod


def _find_larger(
    manifest: Manifest,
    flight: Flight | None,
    hardware: Hardware,
    rod: float,
    law: Law | None,
    largest: float,
) -> float | None:
    """Return the next rod (A m2) to try after a run that misses a requirement.

    Where the only requirement missed is the wheels' largest momentum and the craft
    keeps its attitude, the model gives it. None if it is larger than all that are
    considered.
    """
    over = [
        v.value / v.max
        for v in manifest.verdicts.values()
        if not v.met and v.max and v.value and v.number == "largest_momentum"
    ]
    step = round_up(LOOP_STEP * rod)
    if over and flight is not None and law is not None and not manifest.unmet:
        rods = np.array(
            [round_up(x) for x in np.geomspace(rod, max(largest, 1.01 * rod), 40)]
        )
        peak = fly_rods(flight, law, hardware, rods).peak
        smallest = find_smallest(rods, peak <= 0.99 * peak[0] / max(over))
        step = inf if smallest is None else max(step, smallest)
    return step if step <= largest else None


def add_closed_loop(
    curve: tuple[SizingPoint, ...],
    recommended: float | None,
    source: Scenario,
    options: Options,
    system: System,
    own_law: Law | None,
    least: float,
    progress: Callable[[str], None],
) -> tuple[SizingPoint, ...]:
    """Add the closed loop to the rows of the craft's own law, at some sizes.

    Where the model lacks that law, rows of the closed loop alone are added.
    """
    name = (
        own_law.name
        if own_law is not None and curve and curve[0].law == own_law.name
        else ""
    )
    closed = [
        *(k * least for k in LOOP_MULTIPLES),
        *([recommended] if recommended else []),
    ]
    if name:
        return tuple(
            in_the_loop(row, source, options, system, progress)
            if row.law == name and any(abs(row.rod - m) < 1e-9 * m for m in closed)
            else row
            for row in curve
        )
    alone = [
        SizingPoint(manager_name(system), m, m / least, None, None, None, None)
        for m in sorted(closed)
    ]
    return (
        *(in_the_loop(row, source, options, system, progress) for row in alone),
        *curve,
    )


def in_the_loop(
    row: SizingPoint,
    source: Scenario,
    options: Options,
    system: System,
    progress: Callable[[str], None] = lambda text: None,
) -> SizingPoint:
    """Fly the closed loop with a size of rods and add its results to the row."""
    progress(f"the closed loop with rods of {row.rod:.4g} A m2")
    run = _with_rods(source, options, system, row.rod).or_raise(source.target)
    with run.results as results:
        wheels = "wheels.h_wheel" in results.names()
        h = results.values("wheels.h_wheel" if wheels else "spacecraft.h_copy_wheel")
        m = results.values("torquers.m_mean_body")
        counts = useful(results.values("environment.b_eci")[: len(m)])
    hardware = hardware_of(system)
    sizes = np.linalg.norm(h @ hardware.axes_wheel.T, axis=1)
    coils = m @ np.linalg.pinv(hardware.axes_coil).T
    return replace(
        row,
        loop_rms=float(np.sqrt((sizes**2).mean())),
        loop_largest=float(sizes.max()),
        loop_duty=float(np.abs(coils[: len(counts)][counts]).mean()) / row.rod,
    )


def _with_rods(
    source: Scenario,
    options: Options,
    plain: System,
    rod: float,
    more: Callable[[System], Iterable[str]] = lambda system: (),
    begin: float | None = None,
) -> Run:
    """Run with rods of a size (A m2), recording the series of a flight and `more`.

    `plain` is the system with the rods of the craft. The run is as long as the
    scenario, from `begin` (s) on; None: from its start.
    """
    values = {**options.values, "torquers.m_limit": rod}
    if "m_limit" in plain.components["manager"].interface.signals:
        values["manager.m_limit"] = rod
    case = prepare(source, replace(options, values=values))
    system, _ = case.or_raise()
    if begin is not None:
        later = replace(system, start=begin, stop=begin + system.steps * system.step)
        case = replace(case, system=later)
    record = tuple(sorted({*series_for(system), *more(system)}))
    return simulate(
        replace(case, options=replace(case.options, record=record, every=1))
    )


def manager_name(system: System) -> str:
    """Return the file name of a craft's manager without its suffix."""
    return system.components["manager"].source.rpartition("/")[2].removesuffix(".fmu")
