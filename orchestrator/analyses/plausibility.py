"""Find figures of hardware and orbit that contradict each other or are implausible.

`desat new craft`, `check`, `run` and `size` all report them.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi, sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import BlockError
from desat.components.physics import atmosphere
from desat.components.physics.orbit import EARTH_RADIUS, MU
from desat.components.physics.torques import SOLAR_PRESSURE

from ..begin import cyclic
from ..numbers.derived import rotate
from ..system.body import contradictions
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
from .sampling import orbit_period

Array = NDArray[np.float64]

ROWS = 37  # samples of an orbit
LARGEST_FIELD = 6e-5  # T, at the ground near a pole
# share of a wheel up to which an upper estimate of an orbit's momentum is enough
HARMLESS = 0.5
LARGEST_COIL_POWER = 200.0  # W, each; the largest rods take some tens
# share of a wheel's capacity below which a threshold is likely a wrong unit
SMALLEST_THRESHOLD = 0.01
LARGEST_TANK = 0.9  # share of the mass
# kg for 1 A m2; grows with the power 0.75 of the dipole: 30 g for 0.2 A m2, 0.5 kg for 15,
# 40 kg for 4,000 (makers' data)
ROD_MASS = 0.075
LARGEST_ROD = 0.1  # share of the mass, each
LARGEST_PULSE = 0.25  # share of a wheel's capacity, for the shortest pulse of thrusters
# parameter of the spacecraft that a source of torque follows from
CAUSES = {
    "gravity gradient": "inertia",
    "drag": "area_drag",
    "radiation": "area_radiation",
    "residual dipole": "residual_dipole_body",
    "constant": "tau_disturbance_body",
}
NO_TORQUE = 1e-15  # N m: below it a disturbance is rounding alone


def problems(system: System) -> Iterator[str]:
    """Yield a line if a dump may wait until the wheels are full."""
    wheels, manager = craft_of(system).wheels, craft_of(system).manager
    if wheels is None or manager is None or not len(wheels.capacities):
        return
    values, capacity = manager.values, float(wheels.capacities.min())
    if not values.get("aligned") or not 0.0 < capacity < inf:
        return
    if manager.choice("by") != "thrusters" or manager.choice("fill") != "wheels":
        return
    place = _place_of(system, manager, "longest_wait")
    latest = values["latest"]
    if latest > capacity:
        yield (
            f"{_place_of(system, manager, 'latest')}: {manager.name}.latest = {latest:g} N m s, "
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
    """Yield a line for each implausible figure of a checked system."""
    yield from _body(system)
    wheels = craft_of(system).wheels
    if wheels is not None and "inertia_wheel" in wheels.component.values:
        yield from _dumps(system, wheels)
        yield from _momentum_target(system, wheels)
        yield from _orbit_momentum(system, wheels)
    yield from _coils(system)
    yield from _thrusters(system)
    yield from _controller(system)
    if (table := craft_of(system).disturbance) is not None:
        yield from _short_rows(system, table)


def _place_of(system: System, component: Component, name: str) -> str:
    """Return file and key of a parameter, for messages."""
    return component.origins.get(name, system.place)


def _body(system: System) -> Iterator[str]:
    """Check mass, sides, inertia and propellant against each other."""
    craft, thrusters = craft_of(system).spacecraft, craft_of(system).thrusters
    if system.body is None:
        return
    if craft is not None and "inertia" in craft.values:
        inertia = np.diag(np.reshape(craft.values["inertia"], (3, 3))).tolist()
        place = _place_of(system, craft, "inertia")
        yield from (
            f"{place}: body: {line}" for line in contradictions(system.body, inertia)
        )
    tank = 0.0 if thrusters is None else thrusters.values.get("tank", 0.0)
    if thrusters is not None and tank > LARGEST_TANK * system.body.mass:
        yield (
            f"{_place_of(system, thrusters, 'tank')}: {thrusters.name}.tank = {tank:g} kg in a craft "
            f"of {system.body.mass:g} kg"
        )


def _dumps(system: System, wheels: WheelArray) -> Iterator[str]:
    """Check thresholds and torque of dumps against the wheels."""
    manager = craft_of(system).manager
    if manager is None or manager.model != "manager_threshold":
        return
    begin, capacity = (
        manager.values["begin"],
        smallest_capacity(wheels.component.values),
    )
    if not 0.0 < capacity < inf:
        return
    most, owner = capacity, "a wheel holds"
    if manager.choice("fill") == "sum":
        most = float(np.linalg.norm(np.abs(wheels.axes) @ wheels.capacities))
        owner = "the wheels hold no more than"
    place = _place_of(system, manager, "begin")
    if begin > most:
        yield (
            f"{place}: {manager.name}.begin = {begin:g} N m s, and {owner} {most:.4g} N m s: no "
            "dump begins"
        )
    elif begin < SMALLEST_THRESHOLD * capacity:
        yield (
            f"{place}: {manager.name}.begin = {begin:g} N m s is {100.0 * begin / capacity:.2g} % "
            f"of a wheel's {capacity:.4g} N m s: is it meant as a share?"
        )
    torque, limit = (
        manager.values["torque"],
        wheels.component.values.get("torque_limit", inf),
    )
    if manager.choice("by") != "thrusters" or not manager.values.get(
        "feedforward", True
    ):
        return
    needed = torque * float(np.linalg.norm(np.linalg.pinv(wheels.axes), axis=1).max())
    if needed > limit * (1.0 + 1e-9):
        yield (
            f"{_place_of(system, manager, 'torque')}: {manager.name}.torque = {torque:g} N m asks up "
            f"to {needed:.3g} N m of a wheel, which gives {limit:g} N m: the craft turns with "
            "each dump"
        )


def _momentum_target(system: System, wheels: WheelArray) -> Iterator[str]:
    """Check the target of the wheels' momentum against what the wheels hold.

    The share of each wheel is the least-squares one, as the laws share momentum.
    """
    manager = craft_of(system).manager
    if manager is None or (manager.name, "h_target_body") in system.fed:
        return
    target = np.array(manager.values.get("h_target_body", (0.0, 0.0, 0.0)), float)
    if not target.any() or not len(wheels.capacities):
        return
    shares = np.abs(np.linalg.pinv(wheels.axes) @ target)
    most = float((shares / wheels.capacities).max())
    place = _place_of(system, manager, "h_target_body")
    if most > 1.0:
        wheel = int((shares / wheels.capacities).argmax())
        yield (
            f"{place}: {manager.name}.h_target_body of {np.linalg.norm(target):.4g} N m s asks "
            f"{shares[wheel]:.4g} N m s of a wheel, which holds {wheels.capacities[wheel]:.4g} N m s"
        )


def _coils(system: System) -> Iterator[str]:
    """Check the power of coils at their largest dipole."""
    coils = craft_of(system).coils
    if (
        coils is None
        or not {"resistance", "area_turns", "m_limit"} <= coils.values.keys()
    ):
        return
    construction = {"resistance", "area_turns"} & coils.origins.keys()
    current = coils.values["m_limit"] / coils.values["area_turns"]
    power = current**2 * coils.values["resistance"]
    mass = ROD_MASS * coils.values["m_limit"] ** 0.75
    if system.body is not None and mass > LARGEST_ROD * system.body.mass:
        yield (
            f"{_place_of(system, coils, 'm_limit')}: {coils.name}.m_limit = "
            f"{coils.values['m_limit']:g} A m2: such a torquer has some {mass:.2g} kg, and the "
            f"craft {system.body.mass:.4g} kg"
        )
    if construction and power > LARGEST_COIL_POWER:
        yield (
            f"{_place_of(system, coils, min(construction))}: {coils.name}: {power:.3g} W in each coil at "
            f"{coils.values['m_limit']:g} A m2: coils of spacecraft take {LARGEST_COIL_POWER:g} W "
            "at most"
        )


def _thrusters(system: System) -> Iterator[str]:
    """Check the torque of thrusters that a manager commands against wheels and torques."""
    craft = craft_of(system)
    thrusters, wheels, body = craft.thrusters, craft.wheels, craft.spacecraft
    if thrusters is None or (thrusters.name, "tau_cmd_thruster_body") not in system.fed:
        return
    levels = np.abs(np.array(thrusters.values.get("tau_level", ()), float))
    if not levels.any() or wheels is None or body is None or not len(wheels.capacities):
        return
    place = f"{_place_of(system, thrusters, 'tau_level')}: {thrusters.name}.tau_level"
    pulse = float(levels.max()) * thrusters.values.get("least_pulse", 0.0)
    capacity = float(wheels.capacities.min())
    if pulse > LARGEST_PULSE * capacity:
        yield (
            f"{place} = {levels.max():.4g} N m: the shortest pulse gives {pulse:.3g} N m s, "
            f"and a wheel holds {capacity:.4g} N m s: thrusters this strong do not empty it"
        )
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
        yield (
            f"{place} = {weakest:.3g} N m: less than the disturbances leave, "
            f"{torque:.3g} N m: no dump ends"
        )


def _controller(system: System) -> Iterator[str]:
    """Check whether a controller that is enabled gives any torque, and up to a limit."""
    controller, wheels = craft_of(system).controller, craft_of(system).wheels
    if controller is None or not controller.values.get("enable", True):
        return
    if not {"kp", "kd"} <= controller.values.keys():
        return
    for gain, consequence in (
        ("kp", "no attitude is held"),
        ("kd", "no rate is damped"),
    ):
        if controller.values[gain] == 0.0:
            place = _place_of(system, controller, gain)
            yield f"{place}: {controller.name}.{gain} = 0: {consequence}"
    is_set = "torque_limit" in controller.origins
    limit = wheels.component.values.get("torque_limit", inf) if wheels else inf
    if is_set and controller.values.get("torque_limit") == 0.0 and limit < inf:
        yield (
            f"{_place_of(system, controller, 'torque_limit')}: {controller.name}.torque_limit = 0 "
            f"sets no limit; a wheel gives {limit:g} N m"
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
        return _place_of(system, table, "torque"), name
    return _place_of(system, craft, CAUSES.get(name, "inertia")), name


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
    if radius < motion.BEYOND:
        period = motion.period_of(r, v)
        axis = (MU * (period / (2.0 * pi)) ** 2) ** (1.0 / 3.0)
        eccentric = (r @ v) ** 2 / (MU * axis) + (1.0 - radius / axis) ** 2
        near = axis * (1.0 - sqrt(min(eccentric, 0.99)))
        inertia = np.linalg.eigvalsh(
            np.reshape(values.get("inertia", np.zeros(9)), (3, 3))
        )
        torque += 1.5 * MU / near**3 * float(inertia[-1] - inertia[0])
        field = LARGEST_FIELD * (EARTH_RADIUS / near) ** 3
        torque += field * float(np.linalg.norm(values.get("residual_dipole_body", 0.0)))
        density = 10.0 * atmosphere.table(near - EARTH_RADIUS)  # high solar activity
        torque += (
            density * MU / near * 2.2 * _lever(values, "aerodynamics", "area_drag")
        )
        return float(period * (torque + _largest_table_torque(system)))
    return float(motion.period_of(r, v) * (torque + _largest_table_torque(system)))


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


def _short_rows(system: System, table: Component) -> Iterator[str]:
    """Check the rows of a table of torques against the step and the manager's sample."""
    if "torque" not in table.values:
        return
    manager = craft_of(system).manager
    lengths = np.diff(np.reshape(table.values["torque"], (-1, 4))[:, 0])
    used = np.logical_and.accumulate(lengths > 0.0)  # the time grows up to the last row
    shortest = float(lengths[used].min(initial=inf))
    step = system.step * table.step_ratio
    line = (
        f"{_place_of(system, table, 'torque')}: {table.name}.torque: a row of "
        f"{shortest:g} s is shorter than"
    )
    if shortest < step * (1.0 - 1e-9):
        yield f"{line} a step of {step:g} s, over which it acts by its mean"
    elif manager is not None:
        sample = manager.values.get("sample_time", 0.0)
        if shortest < sample * (1.0 - 1e-9):
            yield f"{line} a sample of {manager.name}, {sample:g} s: its law cannot follow it"


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
