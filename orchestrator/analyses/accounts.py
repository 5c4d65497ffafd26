"""Check figures of a craft that two of its components hold and that must agree.

Each component computes with its own figure, so that different figures contradict each
other.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product

from desat.components.contract.roles import Manager
from desat.components.physics.torques import PLATE_COLUMNS

from ..system.model import Component, System
from ..system.sensors import KNOWN, noise_of

FORCE = "force_mean_thruster_body"
IMPULSE = "specific_impulse"
DRAG = ("area_drag", "drag_coefficient")
BY_AREA = "area"
ABOUT = 3.0  # factor within which a filter's noise agrees with that of the sensors


def problems(system: System) -> Iterator[str]:
    """Yield a line for an orbit that loses another mass to a force than is spent.

    The thrusters that give the force spend the propellant.
    """
    for target, wire in system.by_input[FORCE].items():
        source = wire.source
        thrusters, orbit = system.components[source], system.components[target]
        if (
            IMPULSE not in thrusters.interface.signals
            or IMPULSE not in orbit.interface.signals
        ):
            continue
        theirs, its = thrusters.values[IMPULSE], orbit.values[IMPULSE]
        if its > 0.0 and abs(its - theirs) > 1e-9 * theirs:
            place = orbit.origins.get(IMPULSE, f"{system.place}: default")
            yield (
                f"{place}: {target}.{IMPULSE} = {its:g} s, but {source}.{IMPULSE} = "
                f"{theirs:g} s: the mass that leaves the craft is not the propellant that is "
                f'spent; given as "{source}.{IMPULSE}" it follows'
            )


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each figure that differs between two components.

    These are figures of the drag in orbit and attitude, and the noise in a manager's
    filter and in the sensors.
    """
    yield from _drag(system)
    noise = noise_of(system)
    for c in system.components.values():
        for name, of in _told_noise(c).items():
            stated, is_so, unit = c.values[name], noise[of], KNOWN[of]
            if is_so == 0.0:
                continue
            if not is_so / ABOUT <= stated <= is_so * ABOUT:
                yield (
                    f"{c.origins.get(name, f'{system.place}: default')}: {c.name}.{name} = "
                    f"{stated:.3g} {unit}, but the craft's sensors have {is_so:.3g}: "
                    "the filter of the law assumes a wrong value; --set "
                    f"{c.name}.{name}={is_so:.3g} corrects it"
                )


def _told_noise(c: Component) -> dict[str, str]:
    """Find the parameters of a manager that are a sensor's noise, by its laws' rules.

    A parameter of such a name may be another quantity, as a random walk.
    """
    block = c.block
    laws = block.offers if block is not None and issubclass(block, Manager) else ()
    return {
        key: str(rule).removeprefix("craft.")
        for law in laws
        for key, rule in law.gains.items()
        if str(rule).removeprefix("craft.") in KNOWN and key in c.interface.signals
    }


def _drag(system: System) -> Iterator[str]:
    """Yield a line for each figure of drag that differs between orbit and attitude."""
    bodies, orbits = (
        [
            c
            for c in system.components.values()
            if c.interface.signals.keys() >= {*DRAG, option}
        ]
        for option in ("aerodynamics", "zonals")
    )
    for body, orbit in product(bodies, orbits):
        by, area = body.choice("aerodynamics"), DRAG[0]
        if by == "none" or orbit.values[area] <= 0.0:
            continue
        for name in DRAG:
            its, other = orbit.values[name], body.values[name]
            of, low = f"{body.name}.{name}", other
            if name == area and by != BY_AREA:
                sides = [x for x in body.values["plates"][3::PLATE_COLUMNS] if x > 0.0]
                of, low, other = "a side", min(sides), 0.5 * sum(sides)
            if not low * (1.0 - 1e-9) <= its <= other * (1.0 + 1e-9):
                place = orbit.origins.get(name, f"{system.place}: default")
                unit = " m2" if name == area else ""
                range_ = f"{low:g} to " if low < other else ""
                yield (
                    f"{place}: {orbit.name}.{name} = {its:g}{unit}, but {of} "
                    f"= {range_}{other:g}{unit}: the same drag has two different values"
                )
