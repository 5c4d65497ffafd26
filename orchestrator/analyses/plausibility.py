"""Find figures of hardware and orbit that contradict each other or are implausible.

`desat new craft`, `check`, `run` and `size` all report them.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

import numpy as np
from numpy.typing import NDArray

from ..system.body import contradictions
from ..system.craft import WheelArray, craft_of
from ..system.model import Component, System
from ..system.wheels import smallest_capacity

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
# parameters of torques on an area, and the option that makes them act
ON_AREA = {
    "area_drag": "aerodynamics",
    "centre_drag_body": "aerodynamics",
    "area_radiation": "radiation",
    "centre_radiation_body": "radiation",
}
LARGEST_PULSE = 0.25  # share of a wheel's capacity, for the shortest pulse of thrusters


def warnings(system: System) -> Iterator[str]:
    """Yield a line for each implausible figure of a checked system."""
    yield from _body(system)
    wheels = craft_of(system).wheels
    if wheels is not None and "inertia_wheel" in wheels.component.values:
        yield from _dumps(system, wheels)
        yield from _momentum_target(system, wheels)
    yield from _coils(system)
    yield from _surfaces(system)
    yield from _thrusters(system)
    yield from _controller(system)
    if (table := craft_of(system).disturbance) is not None:
        yield from _short_rows(system, table)


def place_of(system: System, component: Component, name: str) -> str:
    """Return file and key of a parameter, for messages."""
    return component.origins.get(name, system.place)


def _body(system: System) -> Iterator[str]:
    """Check mass, sides, inertia and propellant against each other."""
    craft, thrusters = craft_of(system).spacecraft, craft_of(system).thrusters
    if system.body is None:
        return
    if craft is not None and "inertia" in craft.values:
        inertia = np.diag(np.reshape(craft.values["inertia"], (3, 3))).tolist()
        place = place_of(system, craft, "inertia")
        yield from (
            f"{place}: body: {line}" for line in contradictions(system.body, inertia)
        )
    tank = 0.0 if thrusters is None else thrusters.values.get("tank", 0.0)
    if thrusters is not None and tank > LARGEST_TANK * system.body.mass:
        yield (
            f"{place_of(system, thrusters, 'tank')}: {thrusters.name}.tank = {tank:g} kg in a craft "
            f"of {system.body.mass:g} kg"
        )


def _surfaces(system: System) -> Iterator[str]:
    """Find what an option gives of surfaces that the torques do not act on."""
    craft = craft_of(system).spacecraft
    if craft is None or "plates" not in craft.values:
        return
    modes = {option: craft.choice(option) for option in ("aerodynamics", "radiation")}
    of_plates = dict.fromkeys(("plates", "drive_plate", "offset_plates_body"), "plates")
    acting = set(modes.values())
    for name, mode in {**of_plates, **ON_AREA}.items():
        acts = mode in acting if mode == "plates" else modes[mode] == "area"
        place = craft.origins.get(name, "")
        if place.startswith("--") and not acts:
            yield (
                f"{place}: no torque acts on it: "
                f"{', '.join(f'{k} = {x}' for k, x in modes.items())}"
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
    place = place_of(system, manager, "begin")
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
    if manager.choice("by") == "coils" or not manager.values.get("feedforward", True):
        return
    wheel_torque = torque * float(
        np.linalg.norm(np.linalg.pinv(wheels.axes), axis=1).max()
    )
    if wheel_torque > limit * (1.0 + 1e-9):
        yield (
            f"{place_of(system, manager, 'torque')}: {manager.name}.torque = {torque:g} N m asks up "
            f"to {wheel_torque:.3g} N m of a wheel, which gives {limit:g} N m: the craft turns with "
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
    place = place_of(system, manager, "h_target_body")
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
            f"{place_of(system, coils, 'm_limit')}: {coils.name}.m_limit = "
            f"{coils.values['m_limit']:g} A m2: such a torquer has some {mass:.2g} kg, and the "
            f"craft {system.body.mass:.4g} kg"
        )
    if construction and power > LARGEST_COIL_POWER:
        yield (
            f"{place_of(system, coils, min(construction))}: {coils.name}: {power:.3g} W in each coil at "
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
    place = f"{place_of(system, thrusters, 'tau_level')}: {thrusters.name}.tau_level"
    pulse = float(levels.max()) * thrusters.values.get("least_pulse", 0.0)
    capacity = float(wheels.capacities.min())
    if pulse > LARGEST_PULSE * capacity:
        yield (
            f"{place} = {levels.max():.4g} N m: the shortest pulse gives {pulse:.3g} N m s, "
            f"and a wheel holds {capacity:.4g} N m s: thrusters this strong do not empty it"
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
            place = place_of(system, controller, gain)
            yield f"{place}: {controller.name}.{gain} = 0: {consequence}"
    is_set = "torque_limit" in controller.origins
    limit = wheels.component.values.get("torque_limit", inf) if wheels else inf
    if is_set and controller.values.get("torque_limit") == 0.0 and limit < inf:
        yield (
            f"{place_of(system, controller, 'torque_limit')}: {controller.name}.torque_limit = 0 "
            f"sets no limit; a wheel gives {limit:g} N m"
        )


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
        f"{place_of(system, table, 'torque')}: {table.name}.torque: a row of "
        f"{shortest:g} s is shorter than"
    )
    if shortest < step * (1.0 - 1e-9):
        yield f"{line} a step of {step:g} s, over which it acts by its mean"
    elif manager is not None:
        sample = manager.values.get("sample_time", 0.0)
        if shortest < sample * (1.0 - 1e-9):
            yield f"{line} a sample of {manager.name}, {sample:g} s: its law cannot follow it"
