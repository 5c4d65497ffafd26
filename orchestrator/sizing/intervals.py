"""Compute how far sizes spread over what is not known for sure of a craft.

The dispersions of the spacecraft ([dispersions] of its craft file) are drawn DRAWS
times. The torque of each source is affine in the parameters that are drawn, so the
impulse of a draw is a sum of impulses that are computed once:

    J(t) = sum_k c_k(draw) J_k(t)

The secular torque, what it asks of rods, and the cyclic momentum in the fullest wheel
follow for all draws at once; dumps are followed for FOLLOWED of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.physics.torques import PLATE_COLUMNS

from ..analyses.flight import (
    TABLE_TORQUE,
    TURN_ROWS,
    Flight,
    Hardware,
    integral,
    secular,
    torques,
    turn_of,
)
from ..campaign.sampling import AREA, PLATES, draw_one
from ..language.content import dispersions_of
from ..numbers.derived import from_body
from ..numbers.text import format_momenta
from ..system.model import System
from .least_rod import reach
from .momentum import SourceShare

Array = NDArray[Any]
DRAWS, FOLLOWED = 500, 100
ROWS_FOLLOWED = 3000  # as ROWS, of draws whose dumps are followed
SEED = 1  # of the draws
ROWS = 720  # most rows of the impulses
LOW, HIGH = 5.0, 95.0  # %, ends of an interval
WIDTH = 1.01  # ends of an interval over each other, from which on it has a width
SHARE = 0.95  # of the draws for which recommended rods hold
MOST_DRAWS = f"{100.0 * SHARE:g} % of what is assumed"  # as cases name that share
# Of each source the parameter that it is affine in, and those that it is in proportion to.
AFFINE = {
    "gravity gradient": "inertia",
    "drag": "offset_plates_body",
    "radiation": "offset_plates_body",
    "residual dipole": "residual_dipole_body",
    "constant": "tau_disturbance_body",
}
PROPORTIONAL = {"drag": ("drag_coefficient", "plates"), "radiation": ("plates",)}
# Of each source the choice that says whether it acts on plates.
BY_PLATES = {"drag": "aerodynamics", "radiation": "radiation"}
# What is not known for sure, in words, and the option of `desat new craft` that says it.
ASSUMED = {
    "inertia": ("the moments of inertia", "--inertia"),
    "offset_plates_body": ("the offset of the centre of pressure", "--cp"),
    "residual_dipole_body": ("the residual dipole", "--residual-dipole"),
    "drag_coefficient": ("density and drag coefficient", ""),
    "plates": ("areas and reflection", ""),
    "tau_disturbance_body": ("the constant torque", "--secular"),
}


class Interval(NamedTuple):
    """Interval of a quantity: its ends, which 5 % and 95 % of the draws are below."""

    title: str
    unit: str
    nominal: float  # as the craft is described
    low: float
    high: float


class AssumptionShare(NamedTuple):
    """A parameter that is not known for sure."""

    title: str
    option: str  # that says it; "": none
    share: float  # of the width of the momentum a day, by variance of its logarithm


@dataclass(frozen=True)
class CraftDraws:
    """Draws of a craft: what they come to, an element each."""

    momentum_a_day: Array  # N m s
    wheel: Array  # N m s, of the fullest wheel without the secular part
    rod: Array  # A m2, smallest one for any law by the formula
    impulses: Array  # (draws, rows, 3) N m s, eci
    flight: Flight  # at the rows of the impulses
    assumptions: tuple[AssumptionShare, ...]

    def hardest(self, share: float, flight: Flight) -> Flight:
        """Return the flight of the draw whose smallest rod suffices for a share of them.

        `flight` has the rows that it gets.
        """
        order = np.argsort(self.rod, kind="stable")
        (impulse,) = self.impulses_at(
            flight.times, order[[int(share * (len(order) - 1))]]
        )
        return replace(flight, disturbance=impulse)

    def impulses_at(self, times: Array, draws: Any = slice(None)) -> list[Array]:
        """Return the impulses (rows, 3) N m s, eci, of some draws at other times (s)."""
        at = self.flight.times
        return [
            np.stack([np.interp(times, at, x) for x in impulse.T], axis=1)
            for impulse in self.impulses[draws]
        ]


def interval(title: str, unit: str, nominal: float, values: Array) -> Interval:
    """Return the interval of a quantity over draws; those without it are infinite."""
    # a rank, not a mean of two: they may be infinite
    low, high = np.percentile(values, (LOW, HIGH), method="nearest")
    return Interval(title, unit, nominal, float(low), float(high))


def draw(
    system: System,
    flight: Flight,
    hardware: Hardware,
    rows: int = ROWS,
    count: int | None = None,
) -> CraftDraws | None:
    """Draw what is not known for sure of a craft that flies as in a flight.

    There are `count` draws (default: DRAWS), their impulses at `rows` rows or a few
    more. None where nothing of it is drawn that the torques follow from, or the
    spacecraft is not ours.
    """
    component = system.components["spacecraft"]
    names = [
        name
        for name in ASSUMED
        if f"spacecraft.{name}" in dispersions_of(system) and name in component.values
    ]
    if not names or not flight.inputs:
        return None
    turns = float(flight.times[-1] - flight.times[0]) / turn_of(system)
    flight = _thin(flight, max(rows, ceil(TURN_ROWS * turns)))
    count = count or DRAWS
    bases = ImpulseBases(system, flight, names)
    specs = dispersions_of(system)
    values = {}
    for name in names:
        key = f"spacecraft.{name}"
        every = [draw_one(system, key, specs[key], SEED, k) for k in range(count)]
        values[name] = np.array([_row_of(name, x) for x in every])
    spread = {name: float(_log_variance(bases, {name: values[name]})) for name in names}
    total = sum(spread.values())
    assumptions = [
        AssumptionShare(*ASSUMED[name], x / total if total > 0.0 else 0.0)
        for name, x in spread.items()
    ]
    impulses = bases.impulses(values)
    torque = bases.secular(values)
    return CraftDraws(
        np.linalg.norm(torque, axis=1) * 86400.0,
        fullest_wheels(flight, hardware, impulses, torque),
        _least_rods(flight, hardware, torque),
        impulses,
        flight,
        tuple(sorted(assumptions, key=lambda x: -x.share)),
    )


def draw_followed(
    system: System, flight: Flight, hardware: Hardware
) -> CraftDraws | None:
    """Draw as `draw` for dumps that are followed."""
    return draw(system, flight, hardware, ROWS_FOLLOWED, FOLLOWED)


class ImpulseBases:
    """Impulses whose sums are those of all draws."""

    def __init__(self, system: System, flight: Flight, names: Sequence[str]) -> None:
        """Compute the impulses of a flight for the parameters `names`."""
        component = system.components["spacecraft"]
        self._nominal = {name: _row_of(name, component.values[name]) for name in names}
        self._flight = flight
        # the parameter and its element of each basis ("" and -1: what no parameter
        # changes), and those in proportion
        self.terms: list[tuple[str, int, tuple[str, ...]]] = []
        rows: list[Array] = []

        def add(parameter: str, element: int, torque: Array) -> None:
            """Add a basis."""
            self.terms.append((parameter, element, factors))
            rows.append(integral(torque, flight.times))

        for source, impulse in flight.sources.items():
            parameter = AFFINE.get(source, "")
            factors = tuple(x for x in PROPORTIONAL.get(source, ()) if x in names)
            if PLATES in factors and component.choice(BY_PLATES[source]) != PLATES:
                factors = tuple(x for x in factors if x != PLATES)
            if source == TABLE_TORQUE or parameter not in names:
                self.terms.append(("", -1, factors))
                rows.append(impulse)
                continue

            def at(value: Array, source: str = source, of: str = parameter) -> Array:
                """Return the torque of the source at another value of its parameter."""
                inputs = dict(flight.inputs)
                q = inputs.pop("q_bi")
                every = torques(system, inputs, q, {of: value.tolist()}, only=source)
                return every.get(source, np.zeros((len(q), 3)))

            size = len(self._nominal[parameter])
            rest = at(np.zeros(size))
            add("", -1, rest)
            for k in range(size):
                add(parameter, k, at(np.eye(size)[k]) - rest)
        self.rows = np.array(rows)  # (bases, rows, 3)

    def coefficients(self, values: Mapping[str, Array]) -> Array:
        """Return the factors (draws, bases) of the bases; what is not given is nominal."""
        count = len(next(iter(values.values())))
        columns = []
        for parameter, element, factors in self.terms:
            column = np.ones(count)
            if parameter:
                nominal = np.tile(self._nominal[parameter], (count, 1))
                column = values.get(parameter, nominal)[:, element].copy()
            for name in factors:
                if name in values:
                    column *= values[name][:, 0] / self._nominal[name][0]
            columns.append(column)
        return np.stack(columns, axis=1)

    def secular(self, values: Mapping[str, Array]) -> Array:
        """Return the secular torque (draws, 3) N m, eci, over whole orbits."""
        since, end = self._flight.times - self._flight.times[0], self._flight
        duration = end.orbits_duration
        flat = self.rows.transpose(0, 2, 1).reshape(-1, len(since))
        last = np.array([np.interp(duration, since, x) for x in flat]).reshape(-1, 3)
        return self.coefficients(values) @ (last / duration)

    def impulses(self, values: Mapping[str, Array]) -> Array:
        """Return the impulses (draws, rows, 3) N m s, eci."""
        return np.tensordot(self.coefficients(values), self.rows, axes=1)


def _row_of(name: str, value: Any) -> Array:
    """Return what is drawn of a parameter as a row; of plates the sum of their areas."""
    row = np.ravel(value).astype(float)
    if name == PLATES:
        row = np.array([row[AREA::PLATE_COLUMNS].sum()])
    return row


def _log_variance(bases: ImpulseBases, values: Mapping[str, Array]) -> float:
    """Return the variance of the logarithm of the momentum a day."""
    size = np.linalg.norm(bases.secular(values), axis=1)
    return float(np.log(np.maximum(size, 1e-300)).var())


def _thin(flight: Flight, most: int) -> Flight:
    """Return a flight at every so many rows of its sources, `most` or a few more."""
    every = max(1, len(flight.source_times) // most)
    times = flight.source_times[::every]
    rows = np.searchsorted(flight.times, times)
    names = ("disturbance", "q", "b", "body", "r", "v", "omega")
    of_rows: dict[str, Any] = {name: getattr(flight, name)[rows] for name in names}
    return replace(
        flight,
        times=times,
        source_times=times,
        sources={name: x[::every] for name, x in flight.sources.items()},
        inputs={name: x[::every] for name, x in flight.inputs.items()},
        **of_rows,
    )


def fullest_wheel(flight: Flight, hardware: Hardware) -> float:
    """Return the cyclic momentum of the fullest wheel (N m s) in a flight."""
    torque, _ = secular(flight)
    each = fullest_wheels(flight, hardware, flight.disturbance[None], torque[None])
    return float(each[0])


def fullest_wheels(
    flight: Flight, hardware: Hardware, impulses: Array, torque: Array
) -> Array:
    """Return the cyclic momentum of the fullest wheel (draws,) N m s (`momentum.py`).

    The impulses are (draws, rows, 3) N m s, the secular torque (draws, 3) N m; both eci.
    """
    since = flight.times - flight.times[0]
    rows = since <= flight.orbits_duration * (1.0 + 1e-12)
    cyclic = impulses[:, rows] - since[rows][:, None] * torque[:, None]
    cyclic -= 0.5 * (cyclic.max(axis=1) + cyclic.min(axis=1))[:, None]
    body = flight.body[rows]
    to_body = from_body(flight.q[rows])
    inside = np.einsum("nri,rij->nrj", cyclic, to_body) - (body - body.mean(axis=0))
    return np.asarray(np.abs(hardware.of_wheels(inside)).max(axis=(1, 2)))


def _least_rods(flight: Flight, hardware: Hardware, torque: Array) -> Array:
    """Return the smallest rods (draws,) A m2 of any law, by the formula."""
    size = np.linalg.norm(torque, axis=1)
    along = torque / np.maximum(size, 1e-300)[:, None]
    able = reach(flight, hardware)
    work = np.abs(able @ along.T).sum(axis=1).mean(axis=0)
    return np.asarray(size / np.maximum(work, 1e-300))


def describe_interval(row: Interval) -> str:
    """Return the momentum of a day with its interval, where that has a width."""
    if row.high <= WIDTH * row.low:
        return f"{format_momenta(row.nominal)} a day"
    return (
        f"{format_momenta(row.nominal)} a day "
        f"({format_momenta(row.low, row.high, ' to ')} in 90 % of what is assumed)"
    )


def gravity_leads(
    sources: Sequence[SourceShare], assumptions: Sequence[AssumptionShare]
) -> str:
    """Say so where gravity gradient decides and the inertia is assumed; else ""."""
    title, option = ASSUMED["inertia"]
    largest = max(sources, key=lambda x: x.cyclic + x.per_orbit, default=None)
    if (
        largest is None
        or largest.name != "gravity gradient"
        or title not in {x.title for x in assumptions}
    ):
        return ""
    return (
        f" Gravity gradient decides, by the difference of {title}, which are assumptions: "
        f"{option} says them."
    )


def describe_width(row: Interval, assumptions: Sequence[AssumptionShare]) -> str:
    """Say which assumption carries most of the width, if any, and what narrows it."""
    if row.high <= WIDTH * row.low:
        return ""
    first = assumptions[0]
    narrows = f": {first.option} narrows it" if first.option else ""
    return f"; {100.0 * first.share:.0f} % of the width is {first.title}{narrows}"


def follow(
    draws: CraftDraws,
    rates: Callable[[Flight, float], tuple[float, float]],
    fills: Array,
) -> tuple[Array, Array]:
    """Return what `rates` says of each draw: times between dumps (s) and propellant.

    `fills` (draws,) are its thresholds over those of the craft. Without two dumps times
    are infinite, and propellant is 0.
    """
    flights = (replace(draws.flight, disturbance=x) for x in draws.impulses)
    each = np.array([rates(*pair) for pair in zip(flights, fills, strict=True)])
    return each[:, 0], each[:, 1]
