"""Tabulate a sizing for terminal and page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf, isnan

import numpy as np

from ..numbers.text import format_duration
from ..report.table import ROW_UNIT, Cell, Column, Row, Table, share
from .attitude import LeastAttitude
from .dumps import DumpSizing
from .map import SizingMap
from .momentum import BEYOND_ZERO, SourceShare
from .propellant import YEAR
from .result import Sizing
from .rods import SizingPoint
from .trade import DumpMap
from .year import YearDate

QUANTITIES = (
    Column("", kind="text"),
    Column("", ROW_UNIT, ".4g"),
    Column("", kind="unit"),
)  #: Columns of a table of quantities: name, value, unit.
UNEXPLAINED = "of no source"

# Relative change of the time between dumps from which on the flown time has rows.
DRIFT = 0.02


def tabulate_quantities(sizing: Sizing) -> Table:
    """Tabulate the quantities that drive a sizing and those that follow from them."""
    secular = float(np.linalg.norm(sizing.secular))
    weakest = ", ".join(f"{x:.2f}" for x in sizing.weakest)
    rows: list[Row] = [
        ("Secular torque", secular, "N.m"),
        ("Secular momentum per orbit", sizing.per_orbit, "N.m.s"),
        ("Cyclic momentum, amplitude", sizing.cyclic, "N.m.s"),
        (
            "Momentum of the fullest wheel without the secular part",
            sizing.wheel_needed,
            "N.m.s",
        ),
        _capitalise(_body_rate(sizing.body_rate)),
        *map(_capitalise, _least_attitude(sizing.least_attitude)),
        *_bias(sizing),
        _duration("Time without dumping until a wheel is full", sizing.time_without),
        (
            "Smallest rod for any law (mean over the orbits)",
            sizing.least_formula,
            "A.m2",
        ),
        ("Smallest rod for any law (linear programme)", sizing.least, "A.m2"),
    ]
    if sizing.least_year > 0.0:
        title = f"The same on the worst day of the year ({sizing.worst_day})"
        rows.append((title, sizing.least_year, "A.m2"))
    rows += [
        _duration(
            "Longest time during which 1.3 times this dipole cannot cancel the secular torque",
            sizing.blind,
        ),
        (
            "Control authority in the weakest direction, relative to the mean",
            f"{sizing.weakness:.3f}",
            "",
        ),
        ("Weakest direction (eci)", weakest, ""),
        ("Rate after separation", float(np.degrees(sizing.tip_off_rate)), "deg/s"),
        ("Momentum after separation", sizing.tip_off, "N.m.s"),
        _duration("Detumbling, minimum time with saturated rods", sizing.detumbling),
        _duration("First dump of that momentum, minimum time", sizing.first_dump),
    ]
    detumbling, first_dump = (
        sizing.detumbling_recommended,
        sizing.first_dump_recommended,
    )
    if detumbling is not None and first_dump is not None:
        rows.append(
            _duration(f"Detumbling with {sizing.recommended:.3g} A m2", detumbling)
        )
        rows.append(_duration("First dump with these rods", first_dump))
    if sizing.start_momentum > 0.0:
        rows.append(("Wheels at the start", sizing.start_momentum, "N.m.s"))
        rows.append(
            _duration("Dump of the start momentum, minimum time", sizing.start_dump)
        )
    if sizing.slew_momentum > 0.0:
        title = "Slew: momentum of the fullest wheel, 2 I θ / T"
        rows.append((title, sizing.slew_momentum, "N.m.s"))
        rows.append(
            ("Slew: torque of that wheel, 4 I θ / T²", sizing.slew_torque, "N.m")
        )
    if sizing.propellant is not None and sizing.propellant_least is not None:
        title = "Propellant a year with thrusters alone, dumping when a wheel is full"
        rows.append(_propellant(title, sizing.propellant))
        title = "The same, each dump at its cheapest attitude"
        rows.append(_propellant(title, sizing.propellant_least))
    return Table("Numbers", QUANTITIES, rows, has_header=False, is_scaled=True)


def _body_rate(rate: float) -> tuple[str, float | str, str]:
    """Return the row of the rate (rad/s) that wheels at rest take over."""
    title = "largest body rate that wheels at rest take over, about any axis"
    return (
        (title, float(np.degrees(rate)), "deg/s") if rate < inf else (title, "any", "")
    )


def _capitalise(row: tuple[str, float | str, str]) -> Row:
    """Return a row whose title begins with a capital letter."""
    title, value, unit = row
    return title[0].upper() + title[1:], value, unit


def _least_attitude(least: LeastAttitude | None) -> Iterator[tuple[str, float, str]]:
    """Yield what the fullest wheel comes to in a day as wanted, and at the least."""
    if least is not None:
        yield "fullest wheel in a day, from rest", least.wanted_momentum, "N.m.s"
        yield f"the same, turned by {least.words}, body", least.momentum, "N.m.s"


def _bias(sizing: Sizing) -> Iterator[Row]:
    """Yield the bias with which no wheel passes zero, where there is one."""
    if sizing.bias_needed == inf:
        return
    over = sizing.bias_needed + sizing.bias_needed / BEYOND_ZERO > sizing.wheel_allowed
    reason = "; more than they are allowed" if over else ""
    title = f"Bias that is {BEYOND_ZERO:g} times the fullest wheel's swing: none passes zero{reason}"
    yield title, sizing.bias_needed, "N.m.s"


def _duration(title: str, seconds: float) -> Row:
    """Return a row with a duration (s)."""
    return title, format_duration(seconds), ""


def _propellant(title: str, mass: float) -> Row:
    """Return a row with a mass (kg), or its reason where no layout gives it."""
    if mass == inf:
        return title, "no layout gives it", ""
    return title, mass, "kg"


def tabulate_sources(
    sources: Sequence[SourceShare], unexplained: float | None = None
) -> Table:
    """Tabulate the momentum of each disturbance, and the torque of no source."""
    columns = [
        Column("source", kind="text"),
        Column("secular", "N.m", ".4g"),
        Column("along the total", "%", ".1f"),
        Column("an orbit", "N.m.s", ".4g"),
        Column("cyclic", "N.m.s", ".4g"),
    ]
    rows: list[Row] = [
        (s.name, s.secular, 100.0 * s.along, s.per_orbit, s.cyclic) for s in sources
    ]
    if unexplained is not None:
        rows.append((UNEXPLAINED, unexplained, None, None, None))
    return Table("What drives it", columns, rows, is_scaled=True)


def tabulate_days(days: Sequence[YearDate]) -> Table:
    """Tabulate the days of a year."""
    columns = [
        Column("day", kind="text"),
        Column("solar activity", kind="text"),
        Column("secular", "N.m", ".4g"),
        Column("an orbit", "N.m.s", ".4g", is_detail=True),
        Column("cyclic", "N.m.s", ".4g", is_detail=True),
        Column("least rod", "A.m2", ".4g"),
    ]
    rows = [
        (d.day, d.activity, d.secular, d.per_orbit, d.cyclic, d.least) for d in days
    ]
    return Table("A year", columns, rows, is_scaled=True)


def tabulate_extremes(days: Sequence[YearDate]) -> Table:
    """Tabulate the days of a year that need the smallest and the largest rods."""
    columns = [
        Column("of a year", kind="text"),
        Column("day", kind="text"),
        Column("solar activity", kind="text"),
        Column("secular", "N.m", ".4g"),
        Column("least rod", "A.m2", ".4g"),
    ]
    extremes = {
        "least": min(days, key=lambda d: d.least),
        "most": max(days, key=lambda d: d.least),
    }
    rows = [
        (name, d.day, d.activity, d.secular, d.least) for name, d in extremes.items()
    ]
    return Table("A year", columns, rows, is_scaled=True)


def tabulate_points(points: Sequence[SizingPoint]) -> Table:
    """Tabulate sizes of rods by law: the model, and the closed loop where it flew."""
    columns = [
        Column("law", kind="text"),
        Column("rod", "A.m2", ".4g"),
        Column("times the smallest", form=".3g", is_detail=True),
        Column("rms", "N.m.s", ".4g"),
        Column("largest", "N.m.s", ".4g", is_detail=True),
        Column("wheel", "%", ".4g"),
        Column("duty", "%", ".4g"),
        Column("closed loop: rms", "N.m.s", ".4g", is_detail=True),
        Column("largest", "N.m.s", ".4g", is_detail=True),
        Column("duty", "%", ".4g", is_detail=True),
    ]
    rows = [
        (
            point.law,
            point.rod,
            point.multiple,
            point.rms,
            point.largest,
            _percent(point.filled),
            _percent(point.duty),
            Cell(point.loop_rms, note=_difference(point.rms, point.loop_rms)),
            Cell(
                point.loop_largest, note=_difference(point.largest, point.loop_largest)
            ),
            _percent(point.loop_duty),
        )
        for point in points
    ]
    return Table("Rods", columns, rows, is_scaled=True)


def _percent(share: float | None) -> float | None:
    """Return a share in percent."""
    return None if share is None else 100.0 * share


def _difference(model: float | None, loop: float | None) -> str:
    """Format by how many percent the model is above the closed loop."""
    if model is None or loop is None:
        return ""
    return f"{100.0 * (model / loop - 1.0):+.1f} %"


def tabulate_conditions(sizing: Sizing) -> Table:
    """Tabulate the smallest rods that hold under each condition, by law."""
    laws = [best.law for best in sizing.best]
    margin = sizing.requirements.margin
    title = f"smallest rods (A m2), duty {100.0 * sizing.duty:g} %, margin {margin:g}"
    columns = [Column(title, kind="text"), *(Column(law, form=".3g") for law in laws)]
    rows = [
        (condition.condition, *(_smallest_rod(condition.rods, law) for law in laws))
        for condition in sizing.conditions
    ]
    return Table("Smallest rods", columns, rows)


def _smallest_rod(rods: Mapping[str, float | None], law: str) -> str | float:
    """Return a law's rod (A m2), "none", or "" where the law was not examined."""
    rod = rods.get(law)
    if rod is None:
        return "none" if law in rods else ""
    return rod


def tabulate_dumps(sizing: DumpSizing) -> Table:
    """Tabulate the rates of dumps, as sized and in the closed loop."""
    columns = [
        Column("dumps by thrusters", kind="text"),
        Column("sized", ROW_UNIT, ".4g"),
        Column("closed loop", ROW_UNIT, ".4g"),
        Column("", kind="unit"),
    ]
    loop, steady = sizing.loop, sizing.steady
    first = loop.get("first_dump")
    loop_first = "" if first is None else format_duration(first)
    apart = f"{steady.least_a_week:.4g} to {steady.most_a_week:.4g}"
    rows: list[Row] = [
        (
            "first dump, from wheels at rest",
            format_duration(steady.first),
            loop_first,
            "",
        ),
        ("dumps a week", steady.a_week, loop.get("dumps_a_week"), ""),
        ("the same, thresholds 1 % apart", apart, "", ""),
        ("momentum of a dump", steady.momentum, loop.get("dump_momentum"), "N.m.s"),
        ("impulse of force of a dump", steady.impulse, None, "N.s"),
        *_net_force(sizing),
        ("propellant of a dump", steady.propellant, loop.get("dump_propellant"), "kg"),
        ("time of a dump", steady.duration, loop.get("dump_time"), "s"),
        *_energy(sizing),
        ("longest pulse", steady.on_time, None, "s"),
        (
            "pulses a year of the valve that opens most",
            f"{steady.pulses * YEAR / steady.interval:,.0f}",
            "",
            "",
        ),
        (
            "propellant a year, from the simulated time",
            steady.a_year,
            loop.get("propellant_a_year"),
            "kg",
        ),
        (
            "propellant a year, mean over the days of the year",
            sizing.a_year,
            None,
            "kg",
        ),
    ]
    within = sizing.within
    if within is not None and abs(within.interval / steady.interval - 1.0) > DRIFT:
        weekly, yearly = loop.get("dumps_a_week"), loop.get("propellant_a_year")
        rows += [
            ("dumps a week in the time that is flown", within.a_week, weekly, ""),
            ("propellant a year by that time", within.a_year, yearly, "kg"),
        ]
    for name, mass in sizing.by_activity.items():
        rows.append((f"the same with {name} solar activity", mass, None, "kg"))
    rows += [
        (
            "the same, each dump at its cheapest attitude",
            sizing.least_a_year,
            None,
            "kg",
        ),
        ("momentum of a day", sizing.a_day, None, "N.m.s"),
        *_share_of_coils(sizing),
        *_wheels_of_dumps(sizing),
        ("largest pointing error", None, loop.get("pointing_largest"), "deg"),
        (
            "capacity for one dump a week",
            share(sizing.weekly, sizing.capacity),
            None,
            "N.m.s",
        ),
    ]
    if sizing.rods is not None:
        rod_needed = sizing.rods.needed
        text = "none do" if rod_needed is None else share(rod_needed, sizing.rods.has)
        rows.append(("rods needed without thrusters", text, None, "A.m2"))
    if sizing.slew_momentum > 0.0:
        momentum = share(sizing.slew_momentum, sizing.capacity)
        torque = share(sizing.slew_torque, sizing.wheel_torque)
        rows.append(("slew: momentum of the fullest wheel", momentum, None, "N.m.s"))
        rows.append(("slew: torque of that wheel", torque, None, "N.m"))
    return Table("Dumps", columns, rows, is_scaled=True)


def _energy(sizing: DumpSizing) -> Iterator[Row]:
    """Yield the electric energy of a dump, where the thrusters take some."""
    if sizing.power > 0.0:
        energy, in_loop = (
            None if x is None else x / 3600.0
            for x in (
                sizing.steady.firing * sizing.power,
                sizing.loop.get("dump_energy"),
            )
        )
        yield "electric energy of a dump", energy, in_loop, "W.h"


def _wheels_of_dumps(sizing: DumpSizing) -> Iterator[Row]:
    """Yield what the wheels turn at after a dump, and the rate that they take over."""
    title, rate, unit = _body_rate(sizing.body_rate)
    yield title, rate, None, unit
    for text, momentum, unit in _least_attitude(sizing.least_attitude):
        yield text, momentum, None, unit
    if sizing.end_speed is not None:
        speed = sizing.end_speed * 30.0 / np.pi
        yield "speed of the fullest wheel after a dump", speed, None, "rpm"


def _share_of_coils(sizing: DumpSizing) -> Iterator[Row]:
    """Yield what the coils take of a day's momentum, where they work between dumps."""
    if sizing.coil_share is not None:
        yield "share of it that the rods take", 100.0 * sizing.coil_share, None, "%"


def _net_force(sizing: DumpSizing) -> Iterator[Row]:
    """Yield what a dump leaves the craft as a whole, if its thrusters are no couples."""
    net = sizing.steady.net_impulse
    if net <= 0.0:
        return
    in_loop = sizing.loop.get("dump_net_impulse")
    yield "net impulse of a dump", net, in_loop, "N.s"
    if sizing.mass > 0.0:
        velocity = None if in_loop is None else in_loop / sizing.mass
        yield "net velocity of a dump", net / sizing.mass, velocity, "m/s"


def tabulate_dump_sources(sources: Sequence[SourceShare]) -> Table:
    """Tabulate the secular torque of each source of disturbance."""
    columns = [
        Column("source", kind="text"),
        Column("secular", "N.m", ".4g"),
        Column("along the total", "%", ".1f"),
    ]
    rows = [(s.name, s.secular, 100.0 * s.along) for s in sources]
    return Table("What drives it", columns, rows, is_scaled=True)


def tabulate_dump_days(sizing: DumpSizing) -> Table:
    """Tabulate the days of a year with the propellant of a year of such days."""
    columns = [
        Column("day", kind="text"),
        Column("solar activity", kind="text"),
        Column("secular", "N.m", ".4g"),
        Column("propellant a year", "kg", ".4g"),
    ]
    rows = [
        (d.day, d.activity, d.secular, mass)
        for d, mass in zip(sizing.year, sizing.each_year, strict=True)
    ]
    return Table("A year", columns, rows, is_scaled=True)


def tabulate_dump_extremes(days: Sequence[YearDate]) -> Table:
    """Tabulate the days of a year with the least and the largest torque."""
    columns = [
        Column("of a year", kind="text"),
        Column("day", kind="text"),
        Column("secular", "N.m", ".4g"),
    ]
    extremes = {
        "least": min(days, key=lambda d: d.secular),
        "most": max(days, key=lambda d: d.secular),
    }
    rows = [(name, d.day, d.secular) for name, d in extremes.items()]
    return Table("A year", columns, rows, is_scaled=True)


def describe_map(sizing: SizingMap, law: str) -> str:
    """Return the caption of a map for a law."""
    return (
        f"{law}: the smallest rod (A m2) that holds with a duty of "
        f"{100.0 * sizing.requirements.duty:g} % and a margin of {sizing.requirements.margin:g}"
    )


def tabulate_map(sizing: SizingMap, law: int) -> Table:
    """Tabulate the smallest rods that hold under a law, by orbit and dipole.

    The dipole is the residual dipole of the craft.
    """
    axes = sizing.axes
    order = np.argsort(axes.rods, kind="stable")
    columns = [
        Column("residual dipole", "A.m2", ".3g", kind="text"),
        Column("altitude", "km", "g"),
        *(Column(f"{i:g} deg", form=".3g") for i in axes.inclinations),
    ]
    rows: list[Row] = []
    for d, dipole in enumerate(axes.dipoles):
        for a, altitude in enumerate(axes.altitudes):
            cells: list[float | str] = []
            for i in range(len(axes.inclinations)):
                holding = [axes.rods[j] for j in order if sizing.holds[law, i, a, d, j]]
                cells.append(holding[0] if holding else "-")
            rows.append((dipole, altitude / 1e3, *cells))
    return Table(describe_map(sizing, sizing.laws[law]), columns, rows)


def tabulate_dump_map(dump_map: DumpMap) -> Table:
    """Tabulate the dumps of a map over wheels, thresholds and rods."""
    columns = [
        Column("wheels", "N.m.s", ".4g"),
        Column("dumps begin at", "N.m.s", ".4g"),
        Column("of a wheel", "%", ".3g"),
        *([Column("rods", "A.m2", ".3g")] if dump_map.has_rods else []),
        Column("dumps a week", "1", ".3g"),
        Column("propellant a year", "kg", ".3g"),
        *(Column(f"tank for {x:g} years", "kg", ".3g") for x in dump_map.years),
        *([Column("its tank lasts", "years", ".3g")] if dump_map.tank else []),
    ]
    rows: list[Row] = []
    for cell in dump_map.cells:
        share, rods = 100.0 * cell.begin / cell.wheel, [cell.rod] * dump_map.has_rods
        tanks = [x * cell.a_year for x in dump_map.years]
        if dump_map.tank:
            tanks.append(dump_map.tank / cell.a_year if cell.a_year > 0.0 else inf)
        numbers = [cell.a_week, cell.a_year, *tanks]
        refusal = ["too near where dumps end"] + [""] * (len(numbers) - 1)
        cells = refusal if isnan(cell.a_week) else numbers
        rows.append((cell.wheel, cell.begin, share, *rods, *cells))
    return Table("Dumps by wheels and thresholds", columns, rows)


def tabulate_least_rods(sizing: SizingMap, dipole: int) -> Table:
    """Tabulate the least rods of any law over the orbits of a map.

    `dipole` is the index of the residual dipole.
    """
    axes = sizing.axes
    columns = [
        Column("altitude", "km", "g", kind="text"),
        *(Column(f"{i:g} deg", form=".3g") for i in axes.inclinations),
    ]
    rows = [
        (altitude / 1e3, *sizing.least[:, a, dipole].tolist())
        for a, altitude in enumerate(axes.altitudes)
    ]
    return Table(f"Residual dipole {axes.dipoles[dipole]:.3g} A m2", columns, rows)
