"""Check wheels, dumps and thrusters against an orbit that is flown before the run.

The craft flies an orbit, or a day in deep space, at its reference attitude without a
manager: a study of `desat check` and `desat new craft`.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi, sqrt
from typing import Any

import numpy as np

from desat.components.contract.block import BlockError
from desat.components.physics import atmosphere
from desat.components.physics.orbit import EARTH_RADIUS, MU
from desat.components.physics.torques import SOLAR_PRESSURE

from ..numbers.derived import rotate
from ..system import cyclic
from ..system.craft import WheelArray, craft_of
from ..system.errors import DesatError
from ..system.model import Component, System, Values
from ..system.wheels import smallest_capacity
from . import motion
from .flight import (
    TABLE_TORQUE,
    Flight,
    environment_block,
    flown_at,
    inputs_at,
    needless,
    secular,
    wanted_attitude,
)
from .plausibility import place_of
from .sampling import orbit_period

ROWS = 37  # samples of an orbit
LARGEST_FIELD = 6e-5  # T, at the ground near a pole
# share of a wheel up to which an upper estimate of an orbit's momentum is enough
HARMLESS = 0.5
# parameter of the spacecraft that a source of torque follows from, drag and light on
# an area
CAUSES = {
    "gravity gradient": "inertia",
    "drag": "area_drag",
    "radiation": "area_radiation",
    "residual dipole": "residual_dipole_body",
    "constant": "tau_disturbance_body",
}
NO_TORQUE = 1e-15  # N m: below it a disturbance is rounding alone


def dump_problems(system: System) -> Iterator[str]:
    """Yield a line if a dump may wait until the wheels are full."""
    wheels, manager = craft_of(system).wheels, craft_of(system).manager
    if wheels is None or manager is None or not len(wheels.capacities):
        return
    values, capacity = manager.values, float(wheels.capacities.min())
    if not values.get("aligned") or not 0.0 < capacity < inf:
        return
    if manager.choice("by") == "coils" or manager.choice("fill") != "wheels":
        return
    place = place_of(system, manager, "longest_wait")
    latest = values["latest"]
    if latest > capacity:
        yield (
            f"{place_of(system, manager, 'latest')}: {manager.name}.latest = {latest:g} N m s, "
            f"and a wheel holds {capacity:.4g} N m s: a dump may wait until it is full"
        )
    reserve = capacity - values["begin"]
    if latest > 0.0 or reserve <= 0.0:
        return
    try:
        rate = _growth(orbit_flight(system), wheels)
    except (DesatError, BlockError):
        return  # attitude or environment are not known without a run
    wait, affordable = values["longest_wait"], reserve / max(rate, 1e-300)
    if wait > affordable:
        yield (
            f"{place}: {manager.name}.longest_wait = {wait:g} s: meanwhile disturbances bring up "
            f"to {wait * rate:.3g} N m s into a wheel, which holds {reserve:.3g} N m s above "
            f"begin: at most {affordable:.3g} s, or a {manager.name}.latest below "
            f"{capacity:.4g} N m s, from which on no dump waits"
        )


def warnings(system: System) -> Iterator[str]:
    """Yield a line if wheels or thrusters are too weak for an orbit's disturbances."""
    wheels = craft_of(system).wheels
    if wheels is not None and "inertia_wheel" in wheels.component.values:
        yield from _orbit_momentum(system, wheels)
    yield from _weak_thrusters(system)


def _weak_thrusters(system: System) -> Iterator[str]:
    """Check the smallest torque of thrusters that dump against the disturbances."""
    craft = craft_of(system)
    thrusters, wheels, body = craft.thrusters, craft.wheels, craft.spacecraft
    if thrusters is None or (thrusters.name, "tau_cmd_thruster_body") not in system.fed:
        return
    levels = np.abs(np.array(thrusters.values.get("tau_level", ()), float))
    if not levels.any() or wheels is None or body is None or not len(wheels.capacities):
        return
    weakest = float(levels[levels > 0.0].min())
    period = orbit_period(system)
    if period is None or weakest * period > _most_in_an_orbit(system, body):
        return
    try:
        flight = orbit_flight(system)
    except (DesatError, BlockError):
        return
    torque = float(np.linalg.norm(secular(flight)[0]))
    if weakest < torque:
        place = place_of(system, thrusters, "tau_level")
        yield (
            f"{place}: {thrusters.name}.tau_level = {weakest:.3g} N m: less than the "
            f"disturbances leave, {torque:.3g} N m: no dump ends"
        )


# --- Momentum of an orbit's disturbances ----------------------------------------------


def _orbit_momentum(system: System, wheels: WheelArray) -> Iterator[str]:
    """Check the momentum of an orbit's disturbances against the wheels' capacity."""
    craft, capacity = (
        craft_of(system).spacecraft,
        smallest_capacity(wheels.component.values),
    )
    axes, name = wheels.axes, wheels.component.name
    spans = axes.any() and np.linalg.matrix_rank(axes, tol=1e-3) == 3
    if craft is None or not spans or not 0.0 < capacity < inf:
        return
    if _most_in_an_orbit(system, craft) < HARMLESS * capacity:
        return
    try:
        flight = orbit_flight(system)
    except (DesatError, BlockError):
        return  # attitude or environment are not known without a run
    inverse = np.linalg.pinv(axes)
    _, rest = secular(flight)
    rest = rest - (rest.max(axis=0) + rest.min(axis=0)) / 2.0
    inside = rotate(flight.q, rest) - (flight.body - flight.body.mean(axis=0))
    needs = float(np.abs(inside @ inverse.T).max())
    place, cause = _largest_source(system, craft, flight)
    if needs > capacity:
        text = cyclic.shortfall(needs, capacity, f"disturbances, mostly {cause},")
        yield f"{place}: {name}: {text}"
    brings = flight.orbits_duration * _growth(flight, wheels)
    if brings > capacity:
        is_far = float(np.linalg.norm(flight.r[0])) > motion.BEYOND
        yield (
            f"{place}: {name}: disturbances, mostly {cause}, leave {brings:.3g} N m s in "
            f"the fullest wheel {'each day' if is_far else 'in each orbit'}, and it holds "
            f"{capacity:.3g} N m s"
        )


def _largest_source(
    system: System, craft: Component, flight: Flight
) -> tuple[str, str]:
    """Return file and key of what the largest disturbance follows from, and its name."""
    sizes = {
        name: float(np.linalg.norm(x - x[0], axis=1).max())
        for name, x in flight.sources.items()
    }
    name = max(sizes, key=sizes.__getitem__)
    if name == TABLE_TORQUE and (table := craft_of(system).disturbance) is not None:
        return place_of(system, table, "torque"), name
    cause = CAUSES.get(name, "inertia")
    options = {"drag": "aerodynamics", "radiation": "radiation"}
    if name in options and craft.choice(options[name]) == "plates":
        cause = "plates"
    return place_of(system, craft, cause), name


def _growth(flight: Flight, wheels: WheelArray) -> float:
    """Compute how fast the secular torque of a flight fills a wheel (N m), at most."""
    torque, _ = secular(flight)
    along = rotate(flight.q, np.broadcast_to(torque, (len(flight.q), 3)))
    return float(np.abs(along @ np.linalg.pinv(wheels.axes).T).max())


def mean_torque(system: System) -> float | None:
    """Compute the mean size of the disturbance torque over an orbit (N m).

    The craft is at its reference attitude; None where that or the environment is not
    known without a run, or there is no torque.
    """
    try:
        flight = orbit_flight(system)
    except (DesatError, BlockError, KeyError):
        return None
    torque = np.diff(flight.disturbance, axis=0) / np.diff(flight.times)[:, None]
    mean = float(np.linalg.norm(torque, axis=1).mean())
    return mean if mean > NO_TORQUE else None


def _most_in_an_orbit(system: System, craft: Component) -> float:
    """Estimate an upper bound of the disturbances' impulse in an orbit (N m s).

    It is inf where it is not known, and 0 where nothing is known of the environment.
    """
    environment = craft_of(system).environment
    if environment is None or environment.block is None:
        return 0.0  # the environment is not known
    try:
        block = environment_block(environment)
        block.output(system.start)
    except (DesatError, BlockError):
        return 0.0
    r, v = (np.array(getattr(block, name)) for name in ("r_eci", "v_eci"))
    radius, values = float(np.linalg.norm(r)), craft.values
    light = float(getattr(block, "sunlight", 1.0)) or 1.0
    torque = float(np.linalg.norm(values.get("tau_disturbance_body", 0.0)))
    torque += (
        SOLAR_PRESSURE * light * 2.0 * _lever(values, "radiation", "area_radiation")
    )
    mu = float(values.get("mu", MU))
    if radius < motion.BEYOND:
        period = motion.period_of(r, v, mu)
        axis = (mu * (period / (2.0 * pi)) ** 2) ** (1.0 / 3.0)
        eccentric = (r @ v) ** 2 / (mu * axis) + (1.0 - radius / axis) ** 2
        near = axis * (1.0 - sqrt(min(eccentric, 0.99)))
        inertia = np.linalg.eigvalsh(
            np.reshape(values.get("inertia", np.zeros(9)), (3, 3))
        )
        torque += 1.5 * mu / near**3 * float(inertia[-1] - inertia[0])
        field = LARGEST_FIELD * (EARTH_RADIUS / near) ** 3
        torque += field * float(np.linalg.norm(values.get("residual_dipole_body", 0.0)))
        density = 10.0 * atmosphere.table(near - EARTH_RADIUS)  # high solar activity
        torque += (
            density * mu / near * 2.2 * _lever(values, "aerodynamics", "area_drag")
        )
        return float(period * (torque + _largest_table_torque(system)))
    return float(motion.period_of(r, v, mu) * (torque + _largest_table_torque(system)))


def _lever(values: Values, option: str, area: str) -> float:
    """Return area times lever (m3) of drag or light: 0 if off, inf for plates."""
    if not values.get(option, 0):
        return 0.0
    if values[option] != 1:
        return inf
    centre = area.replace("area", "centre") + "_body"
    return float(values.get(area, 0.0) * np.linalg.norm(values.get(centre, 0.0)))


def _largest_table_torque(system: System) -> float:
    """Return the largest torque (N m) of a table of torques."""
    table = craft_of(system).disturbance
    if table is None or "torque" not in table.values:
        return 0.0
    rows = np.reshape(table.values["torque"], (-1, 4))[:, 1:]
    factor = abs(float(table.values.get("factor", 1.0)))
    return float(np.linalg.norm(rows, axis=1).max()) * factor


#: Flights of `orbit_flight` by what they depend on: one command checks a craft many times.
_orbits: dict[Any, Flight] = {}
_ORBITS_KEPT = 8


def orbit_flight(system: System) -> Flight:
    """Fly an orbit, or a day in deep space, at the reference attitude, unmanaged."""
    roles = ("environment", "spacecraft", "guidance", "disturbance")
    components = [system.roles[role] for role in roles if role in system.roles]
    key = (
        system.start,
        tuple(
            (c.name, c.model, tuple(sorted(c.parameters.items()))) for c in components
        ),
        tuple(map(str, system.connections)),
        "torquers" in system.roles,
    )
    if key not in _orbits:
        if len(_orbits) >= _ORBITS_KEPT:
            _orbits.clear()
        block = environment_block(system.roles["environment"], needless(system))
        period = orbit_period(system)
        if period is None:
            raise DesatError(f"{system.place}: its orbit is not known before a run")
        times = system.start + np.linspace(0.0, period, ROWS)
        inputs = inputs_at(block, times.tolist())
        _orbits[key] = flown_at(system, wanted_attitude(system), inputs, times)
    return _orbits[key]
