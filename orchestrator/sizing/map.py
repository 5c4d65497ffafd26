"""Map rods by inclination, altitude, residual dipole and law (`desat size --map`).

No closed loop is flown. The environment's own block flies each orbit for a day at the
attitude that one run has shown (`flight.py`), and the momentum-only model flies all
dipoles and rods on it side by side. Each dipole stands for those of up to its size,
along the craft's own direction or against it, whichever is worst, because its sign is an
assumption. Compared with a closed loop this leaves out pointing errors, the drift of a
settling craft, and noise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.bases.orbit_start import MEAN
from desat.components.physics.orbit import EARTH_RADIUS

from ..analyses.flight import (
    Attitude,
    Flight,
    attitude_of,
    between,
    environment_block,
    flown_at,
    hardware_of,
    inputs_at,
    integral,
    secular,
    values_of,
)
from ..runs.prepare import prepare, read
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from ..system.typed import JsonObject
from . import quantities
from .compatibility import terms_of
from .law import Law, UnsuitedError, hold_of, law_of
from .least_rod import least_by_formula, reach
from .model import fly, track_of
from .momentum import smallest_wheel_capacity
from .requirements import SizingRequirements
from .rods import other_laws
from .scenarios import fly_case

Array = NDArray[Any]
STEP = 10.0  # s, between the rows of an orbit
SAMPLE = 30.0  # s: samples of a slow law that are closer are combined
NODES = 120.0  # s, between the times at which the environment is evaluated
DAY = 86400.0
SIGNS = (1.0, -1.0)  # of a residual dipole
_RODS = (0.5, 1.0, 1.5, 2.0, 4.0, 8.0)
_INCLINATIONS = (10.0, 28.5, 51.6, 75.0, 97.5)
_ALTITUDES = (350e3, 450e3, 550e3, 700e3, 900e3)
# The default map is given by multiples of the craft's least rod, deg, m, and multiples
# of its residual dipole.
_DIPOLES = (0.0, 0.5, 1.0, 2.0)


@dataclass(frozen=True)
class MapAxes:
    """Axes of a map; an empty one takes its default values."""

    rods: tuple[float, ...] = ()  # A m2
    inclinations: tuple[float, ...] = ()  # deg
    # m, of a circular orbit above the equatorial radius
    altitudes: tuple[float, ...] = ()
    # A m2, size of the residual dipole, along the craft's own or against it
    dipoles: tuple[float, ...] = ()
    laws: bool = False  # other laws than the craft's own fly too


@dataclass(frozen=True)
class SizingMap:
    """Smallest rods over orbits, residual dipoles and laws.

    Its tables have the shape (laws, inclinations, altitudes, dipoles, rods), `least`
    that of (inclinations, altitudes, dipoles).
    """

    target: str
    axes: MapAxes
    laws: tuple[str, ...]
    requirements: SizingRequirements
    least: Array  # A m2, least rod by the formula
    rms: Array  # N m s
    largest: Array  # N m s
    # share of the wheels' capacity in the second half of the day; 0: no limit
    filled: Array
    duty: Array  # 1
    notes: tuple[str, ...] = ()

    @property
    def holds(self) -> Array:
        """Return where margin and duty are as required.

        The shape is (laws, inclinations, altitudes, dipoles, rods).
        """
        enough = (
            np.asarray(self.axes.rods)
            >= self.requirements.margin * self.least[..., None]
        )
        return np.asarray(
            enough[None] & (self.duty <= self.requirements.duty) & (self.filled <= 1.0)
        )

    def as_json(self) -> JsonObject:
        """Return the data that `--json` prints; an infinite least rod is null."""
        tables = {
            n: getattr(self, n).tolist() for n in ("rms", "largest", "filled", "duty")
        }
        least = np.where(np.isfinite(self.least), self.least, np.nan).tolist()
        return {
            "target": self.target,
            "axes": asdict(self.axes),
            "laws": list(self.laws),
            "wishes": asdict(self.requirements),
            "least": _null(least),
            **tables,
            "holds": self.holds.tolist(),
            "notes": list(self.notes),
        }


def _null(value: Any) -> Any:
    """Replace nan in nested lists by None."""
    if isinstance(value, list):
        return [_null(v) for v in value]
    return None if value != value else value


@dataclass(frozen=True)
class _Task:
    """Orbits that one process flies."""

    system: System
    attitude: Attitude
    laws: tuple[Law, ...]
    orbits: tuple[tuple[float, float], ...]  # inclination (deg) and altitude (m)
    dipoles: tuple[float, ...]
    rods: tuple[float, ...]


def map_of(
    target: str,
    options: Options,
    axes: MapAxes,
    requirements: SizingRequirements,
    jobs: int = 2,
    progress: Callable[[str], None] = lambda text: None,
) -> SizingMap:
    """Compute the map of a scenario's craft.

    Raises
    ------
    DesatError
        If the law, the attitude or the environment of the craft has no model.
    """
    source = read(target)
    case = prepare(source, options)
    system, _ = case.or_raise()
    progress("the run at the wanted attitude")
    flight = fly_case(case, system)
    attitude = attitude_of(system, flight.q, flight.r, flight.v)
    if attitude.kind == "moving":
        raise DesatError(
            f"{target}: the attitude moves: a map needs one that stays in lvlh or eci"
        )
    hardware, notes = hardware_of(system), []
    try:
        laws = [law_of(system.components["manager"])]
    except UnsuitedError as error:
        laws = []
        notes.append(
            f"{system.components['manager'].source}: closed loop only; {error}"
        )
    if axes.laws or not laws:
        terms = terms_of(flight.period, flight.b, attitude.kind in ("inertial", "sun"))
        laws += other_laws(case, terms, notes)
    torque, _ = secular(flight)
    least = least_by_formula(reach(flight, hardware), torque)
    dipole = float(np.linalg.norm(_residual(system))) or 0.05 * hardware.m_limit
    axes = replace(
        axes,
        rods=axes.rods or tuple(k * least for k in _RODS),
        inclinations=axes.inclinations or _INCLINATIONS,
        altitudes=axes.altitudes or _ALTITUDES,
        dipoles=axes.dipoles or tuple(k * dipole for k in _DIPOLES),
    )
    for quantity, values in (
        (quantities.RODS, axes.rods),
        (quantities.INCLINATIONS, axes.inclinations),
        (quantities.ALTITUDES, tuple(x / 1e3 for x in axes.altitudes)),
        (quantities.DIPOLES, axes.dipoles),
    ):
        for x in values:
            quantity(x)
    orbits = [(i, a) for i in axes.inclinations for a in axes.altitudes]
    tasks = [
        _Task(
            system,
            attitude,
            tuple(laws),
            tuple(orbits[k::jobs]),
            axes.dipoles,
            axes.rods,
        )
        for k in range(min(jobs, len(orbits)))
    ]
    progress(f"{len(orbits)} orbits of a day")
    parts = _side_by_side(tasks)
    shape = (len(axes.inclinations), len(axes.altitudes), len(axes.dipoles))
    leasts = np.empty((len(orbits), len(axes.dipoles)))
    tables = np.empty((4, len(laws), len(orbits), len(axes.dipoles), len(axes.rods)))
    for k, (some, results) in enumerate(parts):
        leasts[k::jobs], tables[:, :, k::jobs] = some, results
    capacity = smallest_wheel_capacity(hardware)
    rms, largest, wheel, duty = tables.reshape(4, len(laws), *shape, len(axes.rods))
    return SizingMap(
        target=target,
        axes=axes,
        laws=tuple(law.name for law in laws),
        requirements=requirements,
        least=leasts.reshape(shape),
        rms=rms,
        largest=largest,
        filled=wheel / capacity if 0.0 < capacity < inf else np.zeros_like(wheel),
        duty=duty,
        notes=tuple(notes),
    )


def _residual(system: System) -> Array:
    """Return the residual dipole (3,) A m2, body."""
    craft = values_of(system)["spacecraft"]
    return np.asarray(craft.get("residual_dipole_body", [0.0, 0.0, 0.0]), float)


def _side_by_side(tasks: Sequence[_Task]) -> list[tuple[Array, Array]]:
    """Fly tasks in parallel processes."""
    if len(tasks) == 1:
        return [_fly(tasks[0])]
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    with ProcessPoolExecutor(len(tasks), mp_context=get_context("spawn")) as pool:
        return list(pool.map(_fly, tasks))


def _fly(task: _Task) -> tuple[Array, Array]:
    """Fly the orbits of a task.

    Returns the least rods (orbits, dipoles) in A m2, and rms, largest, wheel and duty
    (4, laws, orbits, dipoles, rods).
    """
    system, hardware = task.system, hardware_of(task.system)
    component = system.components["environment"]
    residual = _residual(system)
    size = float(np.linalg.norm(residual))
    times = np.arange(0.0, DAY + STEP / 2.0, STEP)
    nodes = np.arange(0.0, DAY + NODES / 2.0, NODES)
    leasts, tracks = [], [[] for _ in task.laws]  # type: ignore[var-annotated]
    holds: list[int] = []
    for inclination, altitude in task.orbits:
        block = environment_block(component, _orbit(inclination, altitude))
        inputs = between(inputs_at(block, nodes.tolist()), nodes, times)
        flight = flown_at(system, task.attitude, inputs, times)
        own_part = flight.sources["residual dipole"]
        if size == 0.0:  # the craft has none: the diagonal gives the direction
            residual, size = np.full(3, 3.0**-0.5), 1.0
            own_part = integral(_of_dipole(flight, residual), times)
            rest = flight.disturbance
        else:
            rest = flight.disturbance - own_part
        signed = [sign * d for d in task.dipoles for sign in SIGNS]
        each = [rest + d / size * own_part for d in signed]
        able = reach(flight, hardware)
        leasts.append(
            [
                least_by_formula(able, secular(replace(flight, disturbance=d))[0])
                for d in each
            ]
        )
        holds = holds or [hold_of(law, flight, SAMPLE) for law in task.laws]
        for law, track, hold in zip(task.laws, tracks, holds, strict=True):
            rows = [d[::hold] for d in each]
            track.append(track_of(flight, law, hardware, rows, hold))
    results = [
        fly(track, law, hardware, task.rods)
        for law, track in zip(task.laws, tracks, strict=True)
    ]
    tables = np.array([np.stack(c[:4]) for c in results]).transpose(1, 0, 2, 3, 4)
    order = np.argsort(task.dipoles, kind="stable")
    return (
        _largest_up_to(np.array(leasts), 1, order),
        _largest_up_to(tables, 3, order),
    )


def _largest_up_to(values: Array, axis: int, order: Array) -> Array:
    """Return the largest of the values of dipoles up to each size, of both signs.

    Along an axis are the dipoles, each with SIGNS; `order` sorts their sizes.
    """
    shape = values.shape
    pairs = (*shape[:axis], shape[axis] // len(SIGNS), len(SIGNS), *shape[axis + 1 :])
    worse = values.reshape(pairs).max(axis=axis + 1)
    grown = np.maximum.accumulate(np.take(worse, order, axis=axis), axis=axis)
    return np.asarray(np.take(grown, np.argsort(order), axis=axis))


def _of_dipole(flight: Flight, dipole: Array) -> Array:
    """Compute the torque (rows, 3) N m, eci, of a dipole (A m2, body) in flight."""
    from ..numbers.derived import cross, rotate_back

    return cross(
        rotate_back(flight.q, np.broadcast_to(dipole, (len(flight.q), 3))), flight.b
    )


def _orbit(inclination: float, altitude: float) -> dict[str, float]:
    """Return a circular orbit as changes of an environment that takes elements.

    `inclination` is in deg, `altitude` in m.
    """
    return {
        "orbit_start": MEAN,
        "semi_major_axis": EARTH_RADIUS + altitude,
        "eccentricity": 0.0,
        "inclination": float(np.radians(inclination)),
    }
