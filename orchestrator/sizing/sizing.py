"""Size wheels, rods and propellant of a craft from its momentum alone (`desat size`).

One run at the wanted attitude gives what no law changes (`analyses/flight.py`): the
field B(t), the attitude C(t), and the impulse J(t) of the disturbances. The following
use these alone:

- the secular torque and the cyclic momentum (`momentum.py`);
- the least rod of any law (`least_rod.py`);
- the curves of momentum and duty over rods, law by law (`model.py`, `rods.py`), and the
  rods that hold with the required margin and duty;
- the extremes of a year (`year.py`): torque, cyclic momentum and least rod at other
  dates.

The recommended rods hold on the worst of these days by the same model, and with them
the scenario `worst.toml` beside the craft's meets its requirements in the closed loop.
The closed loop flies beside the model at the sizes that count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..analyses import wheels
from ..analyses.flight import (
    Attitude,
    Flight,
    Hardware,
    attitude_of,
    fly_days,
    hardware_of,
    secular,
    wanted_attitude,
)
from ..files.scenario import Scenario
from ..language.content import content_of
from ..report.cases import craft_digest
from ..runs.prepare import prepare, read, resolved
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from . import intervals
from .attitude import find_least_attitude
from .changes import CASE_STEP, Change, describe_change, find_change
from .compatibility import terms_of
from .law import OTHERS_STEP, Law, UnsuitedError, hold_of, law_of
from .least_rod import compute_geometry, least_by_formula, least_by_programme, reach
from .model import fly, track_of
from .momentum import (
    compute_bias,
    compute_body_rate,
    compute_slew,
    compute_wheel_needs,
    cyclic_span,
    shares_of,
    smallest_wheel_capacity,
)
from .propellant import compute_propellant
from .requirements import SizingRequirements
from .result import (
    ASSUMED_CASES,
    ENDS,
    SCENARIO_DAY,
    WORST_DAY,
    Course,
    RodsByCondition,
    Sizing,
    find_margins,
    find_notes,
    find_problems,
)
from .rods import (
    Best,
    add_closed_loop,
    compute_curves,
    find_rod_for_worst,
    find_rod_for_year,
    fly_rods,
    manager_name,
    other_laws,
    round_up,
)
from .scenarios import (
    closed_loop_only,
    doubts,
    find_tip_off,
    find_worst_scenario,
    fly_and_settle,
)
from .year import WorstDay, YearDate, days_of_year, find_worst_day

Array = NDArray[Any]
SMALLEST_TORQUE = 1e-300  # N m per A m2: replaces 0 so that no division by zero occurs


def size(
    target: str,
    options: Options,
    requirements: SizingRequirements | None = None,
    progress: Callable[[str], None] = lambda text: None,
    tell: Callable[[str], None] = lambda text: None,
) -> Sizing:
    """Size wheels and rods of a craft for the attitude, orbit and law of a scenario.

    Parameters
    ----------
    target, options
        Scenario of the craft.
    requirements
        Requirements beside the scenario's.
    progress
        Called with a text for each stage of the work.
    tell
        Called with the rods by the model before the closed loop flies with them.

    Raises
    ------
    DesatError
        If the craft lacks data that this needs, or a run does not complete.
    """
    requirements = requirements or SizingRequirements()
    source = read(target)
    case = prepare(source, options)
    system, _ = case.or_raise()
    hardware = hardware_of(system)
    progress("the run at the wanted attitude")
    flight, substeps = fly_and_settle(case, system)
    notes = [*doubts(system), *closed_loop_only(system, options)]
    own_law = _own_law(system, notes)
    torque, cyclic = secular(flight)
    able = reach(flight, hardware)
    progress("the least rod, by a linear programme")
    formula, least = least_by_formula(able, torque), least_by_programme(able, torque)
    attitude = attitude_of(system, flight.q, flight.r, flight.v)
    year, hardest = _fly_year(system, hardware, attitude, requirements, progress, notes)
    laws = [own_law] if own_law is not None else []
    if requirements.laws or own_law is None:
        terms = terms_of(flight.period, flight.b, attitude.kind in ("inertial", "sun"))
        laws += other_laws(case, terms, notes)
    curve, best = compute_curves(
        flight, hardware, laws, least, requirements, progress, notes
    )
    law, day = (best[0].law, best[0].rod) if best else ("", None)
    model = next((x for x in laws if x.name == law), None)
    by_year = find_rod_for_year(day, hardest, model, hardware, requirements)
    progress("what is not known for sure")
    draws = intervals.draw(system, flight, hardware)
    uncertain = _uncertain_day(system, hardest, hardware)
    by_share = by_year
    if uncertain is not None and model is not None and by_year is not None:
        by_share = find_rod_for_year(
            by_year, uncertain, model, hardware, requirements, OTHERS_STEP
        )
    conditions = _find_conditions(
        best, by_year, laws, hardest, least, hardware, requirements
    )
    if by_share != by_year:
        title = f"{intervals.MOST_DRAWS}, that day"
        conditions.append(RodsByCondition(title, {law: by_share}))
    if law:
        needs = "no rods do" if by_share is None else f"{by_share:.3g} A m2"
        tell(
            f"{target} by the model: {least:.3g} A m2 is the least rod of any law; {law} needs "
            f"{needs} on the worst day; it has {hardware.m_limit:.4g} A m2"
        )
    recommended = by_share
    unmet: list[str] = []
    worst = find_worst_scenario(source) if requirements.flown else None
    if worst is not None:
        recommended, unmet = find_rod_for_worst(
            worst, options, hardware, recommended, model, progress
        )
        conditions.append(
            RodsByCondition(f"{worst.target}, closed loop", {law: recommended})
        )
    if requirements.flown and 0.0 < least < inf:
        curve = add_closed_loop(
            curve,
            recommended,
            source,
            replace(options, substeps=substeps),
            system,
            own_law,
            least,
            progress,
        )
    momentum_needed, time_without = compute_wheel_needs(
        flight, hardware, torque, cyclic, _bias(system)
    )
    geometry = compute_geometry(flight, hardware, able, torque, least)
    slew_momentum, slew_torque = compute_slew(hardware, requirements)
    shares, unexplained = shares_of(flight, torque)
    propellant, propellant_least = compute_propellant(
        system, flight, hardware, torque, requirements
    )
    rate, time_to_detumble = find_tip_off(source, options)
    rate = rate if requirements.tip_off is None else requirements.tip_off
    tip_off = float(np.linalg.eigvalsh(hardware.inertia)[-1]) * rate
    start = float(np.linalg.norm(flight.h_start))
    rod = hardware.m_limit
    sizing = Sizing(
        target=target,
        craft=craft_digest(system.parameters),
        orbits=round(flight.orbits_duration / flight.period),
        period=flight.period,
        attitude=attitude.kind,
        secular=tuple(torque.tolist()),
        per_orbit=float(np.linalg.norm(torque)) * flight.period,
        cyclic=cyclic_span(cyclic),
        sources=shares,
        unexplained=unexplained,
        year=year,
        wheel_needed=momentum_needed,
        slew_momentum=slew_momentum,
        slew_torque=slew_torque,
        wheel_capacity=smallest_wheel_capacity(hardware),
        wheel_torque=hardware.torque_limit,
        body_rate=compute_body_rate(hardware),
        least_attitude=find_least_attitude(system, attitude, flight, hardware),
        bias_needed=inf,
        wheel_allowed=_allowed(system, "largest_momentum", 1.0)
        * smallest_wheel_capacity(hardware),
        duty_allowed=_allowed(system, "coil_duty", requirements.duty),
        wheel_lost=_wheel_lost(flight, hardware, torque, cyclic, _bias(system)),
        time_without=time_without,
        least_formula=formula,
        least=least,
        rod=rod,
        best=best,
        conditions=tuple(conditions),
        law=law,
        recommended=recommended,
        recommended_year=by_year,
        recommended_share=by_share,
        recommended_day=day and round_up(day),
        worst_day="" if hardest is None else _describe_day(hardest, least),
        least_year=0.0 if hardest is None else max(least, hardest.least),
        worst_scenario="" if worst is None else worst.target,
        weakest=tuple(geometry.weakest.tolist()),
        weakness=geometry.weakness,
        blind=geometry.blind,
        tip_off_rate=rate,
        tip_off=tip_off,
        detumbling=_dump_time(tip_off, geometry.tumbling, rod),
        first_dump=_dump_time(tip_off, geometry.against, rod),
        detumbling_recommended=_dump_time_with(tip_off, geometry.tumbling, recommended),
        first_dump_recommended=_dump_time_with(tip_off, geometry.against, recommended),
        start_momentum=start,
        start_dump=_dump_time(start, geometry.against, rod),
        propellant=propellant,
        propellant_least=propellant_least,
        requirements=requirements,
        intervals=(),
        assumptions=(),
        curve=curve,
        margins=(),
        problems=(),
        change="",
        notes=(),
    )
    if draws is not None:
        sizing = replace(
            sizing,
            intervals=tuple(_intervals(sizing, draws, flight, model, hardware)),
            assumptions=draws.assumptions,
        )
    flights = _flights_of_cases(flight, hardest, uncertain, worst, options)
    courses = _fly_cases(flights, model, hardware)
    margins = find_margins(sizing, courses, time_to_detumble)
    of_day = courses.get(SCENARIO_DAY)
    swing = sizing.wheel_needed if of_day is None else of_day.wheel
    swing -= max(map(abs, hardware.bias), default=0.0)
    sizing = replace(
        sizing, margins=tuple(margins), bias_needed=compute_bias(hardware, swing)
    )
    axes, short = list(wheels.warnings(system)), find_problems(sizing)
    change = ""
    if (short or unmet) and not axes:
        cases = [f for case, f in flights.items() if _counts(case, bool(unmet))]
        change = _describe_change(sizing, cases, model, hardware)
        if "thrusters" in system.roles:
            change += " Its thrusters take what rods leave by --dump 'both 70:10'."
    return replace(
        sizing,
        problems=(*axes, *short, *unmet),
        change=change,
        notes=(*notes, *find_notes(sizing, attitude)),
    )


def _counts(case: str, unmet: bool) -> bool:
    """Return whether a craft has to hold in a case; those of worst.toml if unmet."""
    return not case.startswith(ASSUMED_CASES) or (unmet and case.startswith(ENDS))


def _describe_change(
    sizing: Sizing, flights: Sequence[Flight], law: Law | None, hardware: Hardware
) -> str:
    """Say what would do for a craft that does not hold; "" if nothing is known."""
    rods, capacity = sizing.recommended, sizing.wheel_capacity
    has_rods = sizing.rod > 0.0
    if rods is not None and has_rods and rods > sizing.rod:
        return describe_change(Change(rods / sizing.rod, 1.0), sizing.rod, capacity)
    if law is None or not has_rods or not 0.0 < capacity < inf:
        return ""
    limits = sizing.wheel_allowed, sizing.duty_allowed
    least_rod = max(sizing.least, sizing.least_year)
    least_wheel = sizing.wheel_needed + sizing.slew_momentum
    least = least_rod, least_wheel
    change = find_change(flights, law, hardware, limits, least)
    return "" if change is None else describe_change(change, sizing.rod, capacity)


def _own_law(system: System, notes: list[str]) -> Law | None:
    """Return the craft's own law; None, with a note, if the model does not have it."""
    try:
        return law_of(system.components["manager"])
    except UnsuitedError as error:
        notes.append(f"{manager_name(system)}: closed loop only; {error}")
        return None


def _fly_year(
    system: System,
    hardware: Hardware,
    attitude: Attitude,
    requirements: SizingRequirements,
    progress: Callable[[str], None],
    notes: list[str],
) -> tuple[tuple[YearDate, ...], WorstDay | None]:
    """Fly the days of a year and the worst one.

    None are returned if they are not required or not known.
    """
    if not requirements.year:
        return (), None
    progress("the days of a year")
    try:
        days = list(days_of_year(system, hardware, attitude))
        year = tuple(day for day, _ in days)
        return year, find_worst_day(system, hardware, attitude, days)
    except DesatError as error:
        notes.append(f"no other days of the year: {error}")
        return (), None


def _uncertain_day(
    system: System, hardest: WorstDay | None, hardware: Hardware
) -> WorstDay | None:
    """Return the worst day of the year with what is not known for sure.

    It is that of the draw whose rods suffice for `intervals.SHARE` of them; None where
    all is known, or no other day is.
    """
    draws = (
        None if hardest is None else intervals.draw(system, hardest.flight, hardware)
    )
    if hardest is None or draws is None:
        return None
    flight = draws.hardest(intervals.SHARE, hardest.flight)
    torque, _ = secular(flight)
    least = least_by_formula(reach(flight, hardware), torque)
    return replace(hardest, least=least, flight=flight)


def _intervals(
    sizing: Sizing,
    draws: intervals.CraftDraws,
    flight: Flight,
    law: Law | None,
    hardware: Hardware,
) -> Iterator[intervals.Interval]:
    """Yield the intervals of a sizing; under its law those of its own rods."""
    for title, unit, nominal, values in (
        (
            "Momentum a day",
            "N.m.s",
            float(np.linalg.norm(sizing.secular)) * 86400.0,
            draws.momentum_a_day,
        ),
        (
            "Fullest wheel without the secular part",
            "N.m.s",
            sizing.wheel_needed,
            draws.wheel,
        ),
        ("Smallest rod for any law", "A.m2", sizing.least_formula, draws.rod),
    ):
        yield intervals.interval(title, unit, nominal, values)
    if law is None or hardware.m_limit == 0.0:
        return
    hold = hold_of(law, flight, CASE_STEP)
    own_impulse = flight.disturbance[::hold]
    every = [own_impulse, *draws.impulses_at(flight.times[::hold])]
    track = track_of(flight, law, hardware, every, hold)
    course = fly([track], law, hardware, [hardware.m_limit])
    for title, unit, values in (
        (f"Fullest wheel under {law.name}", "N.m.s", course.wheel.ravel()),
        (f"Duty of its coils under {law.name}", "%", 100.0 * course.duty.ravel()),
    ):
        yield intervals.interval(title, unit, float(values[0]), values[1:])


def _find_conditions(
    best: Sequence[Best],
    by_year: float | None,
    laws: Sequence[Law],
    hardest: WorstDay | None,
    least: float,
    hardware: Hardware,
    requirements: SizingRequirements,
) -> list[RodsByCondition]:
    """Return the smallest rods on the scenario's day and on the worst of the year."""
    of_day = {b.law: b.rod and round_up(b.rod) for b in best}
    conditions = [RodsByCondition(SCENARIO_DAY, of_day)]
    if hardest is None or not best:
        return conditions
    models = {law.name: law for law in laws}
    of_year = {best[0].law: by_year}
    for b in best[1:]:
        of_year[b.law] = find_rod_for_year(
            b.rod, hardest, models[b.law], hardware, requirements, OTHERS_STEP
        )
    title = f"the worst day of the year ({_describe_day(hardest, least)})"
    return [*conditions, RodsByCondition(title, of_year)]


def _flights_of_cases(
    flight: Flight,
    hardest: WorstDay | None,
    uncertain: WorstDay | None,
    worst: Scenario | None,
    options: Options,
) -> dict[str, Flight]:
    """Return the flights of the cases in which a craft has to hold."""
    flights = {SCENARIO_DAY: flight}
    if hardest is not None:
        flights[WORST_DAY] = hardest.flight
    if uncertain is not None:
        title = f"{intervals.MOST_DRAWS}, {WORST_DAY}"
        flights[title] = uncertain.flight
    if worst is not None:
        system, _ = resolved(worst, options)
        ends = fly_days(system, wanted_attitude(system))
        flights[f"{ENDS}, {worst.file.name}"] = ends
    return flights


def _fly_cases(
    flights: Mapping[str, Flight], law: Law | None, hardware: Hardware
) -> dict[str, Course]:
    """Fly the model with the craft's own rods in each case.

    There are none where it has no rods, or there is no law.
    """
    cases: dict[str, Course] = {}
    if law is None or hardware.m_limit == 0.0:
        return cases
    for case, flight in flights.items():
        rods = np.array([hardware.m_limit])
        course = fly_rods(flight, law, hardware, rods, CASE_STEP)
        cases[case] = Course(float(course.wheel[0]), float(course.duty[0]))
    return cases


def _allowed(system: System, number: str, share: float) -> float:
    """Return the share (1) that a requirement on a number in % allows, or `share`."""
    limits = [
        x.max / 100.0
        for x in content_of(system.about).requirements.values()
        if x.number == number and x.max is not None
    ]
    return min(limits, default=share)


def _wheel_lost(
    flight: Flight, hardware: Hardware, torque: Array, cyclic: Array, bias: Array
) -> float:
    """Return what the fullest wheel needs (N m s) with the worst of them lost.

    It is inf where those that are left do not span space.
    """
    needs = []
    for k in np.flatnonzero(hardware.capacity > 0.0):
        works = np.ones(len(hardware.capacity))
        works[k] = 0.0
        axes, capacity = hardware.axes_wheel * works, hardware.capacity * works
        if np.linalg.matrix_rank(axes) < 3:
            return inf
        others = replace(hardware, axes_wheel=axes, capacity=capacity)
        needs.append(compute_wheel_needs(flight, others, torque, cyclic, bias)[0])
    return max(needs, default=0.0)


def _bias(system: System) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the momentum that the manager keeps in the wheels (3,) N m s, body."""
    values = system.components["manager"].values
    return np.array([values[f"h_target_body[{i}]"] for i in (1, 2, 3)], float)


def _dump_time(momentum: float, torque: float, rod: float) -> float:
    """Compute the time (s) in which rods (A m2) remove a momentum (N m s).

    `torque` is that of 1 A m2 (N m).
    """
    return momentum / (max(torque, SMALLEST_TORQUE) * max(rod, SMALLEST_TORQUE))


def _dump_time_with(momentum: float, torque: float, rod: float | None) -> float | None:
    """Compute the time as `_dump_time`, or return None without a rod."""
    return None if rod is None else _dump_time(momentum, torque, rod)


def _describe_day(hardest: WorstDay, least: float) -> str:
    """Describe the worst day: the scenario's own where that needs larger rods."""
    if least >= hardest.least:
        return "that of the scenario"
    activity = f", {hardest.activity} solar activity" if hardest.activity else ""
    return f"{hardest.day}{activity}"
