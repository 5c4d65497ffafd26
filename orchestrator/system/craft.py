"""Find the parts of a spacecraft in its system, once."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .model import Component, Connection, System, Values
from .wheels import axes_of, capacities, existing

Array = NDArray[np.float64]

_RIGID = {
    "inertia",
    "axes_wheel",
    "inertia_wheel",
    "q_bi",
    "omega_bi_body",
    "impulse_eci",
}


def carrier(inertia: Array, axes: Array, spin: Array) -> Array:
    """Compute the inertia (3, 3), body, without the axial part of the rotors.

    `axes` (3, n) are the rotor axes, `spin` (n,) their axial inertia.
    """
    return inertia - (axes * spin) @ axes.T


def carrier_inertia(values: Values) -> Array:
    """Compute the body inertia (3, 3), kg m2, without the rotors' axial part."""
    inertia = np.reshape(np.array(values["inertia"], float), (3, 3))
    return carrier(inertia, axes_of(values), np.array(values["inertia_wheel"]))


class WheelArray:
    """Reaction wheels of a spacecraft, from the parameters of their component."""

    def __init__(self, component: Component) -> None:
        values = component.values
        self.component = component
        self.exist = existing(values)  # (n,)
        # (3, m), body, of the wheels that exist
        self.axes = axes_of(values)[:, self.exist]
        zeros = np.zeros(len(self.exist))
        self.h_start: Array = np.array(
            values.get("h_start_wheel", zeros), float
        )  # (n,) N m s

    @cached_property
    def capacities(self) -> Array:
        """Return the largest momentum of each wheel that exists (m,), N m s."""
        return capacities(self.component.values)[self.exist]


class RigidBody:
    """Component with the parameters of a rigid body with wheels, ours or not."""

    def __init__(
        self, component: Component, wire: Connection, wheels: Component
    ) -> None:
        self.component = component
        self.wheels = WheelArray(wheels)
        self.wheel_series = wire.series  # series of the wheel momentum that it receives
        self.axes = axes_of(component.values)  # (3, n), body, of all wheels
        self.carrier = carrier_inertia(component.values)  # (3, 3), kg m2
        # whether its inertia is physically possible
        self.is_possible = bool(np.linalg.eigvalsh(self.carrier).min() > 0.0)


class Craft:
    """Parts of a spacecraft by their role; None where there is none.

    Parameters
    ----------
    system
        The system in which it flies. Of several components of a role the last counts.
    """

    def __init__(self, system: System) -> None:
        """Find the component of each role in a system."""
        roles = system.roles
        self.spacecraft = roles.get("spacecraft")
        self.environment = roles.get("environment")
        self.controller = roles.get("controller")
        self.manager = roles.get("manager")
        self.coils = roles.get("torquers")
        self.thrusters = roles.get("thrusters")
        self.magnetometer = roles.get("magnetometer")
        self.gyro = roles.get("gyro")
        self.tachometers = roles.get("tachometers")
        self.determination = roles.get("determination")
        self.star_tracker = roles.get("star_tracker")
        self.disturbance = roles.get("disturbance")
        wheels = roles.get("wheels")
        self.wheels = None if wheels is None else WheelArray(wheels)
        self.rigid_body: RigidBody | None = None
        for name, wire in system.by_input["h_wheel"].items():
            component = system.components[name]
            if component.interface.arrays.keys() >= _RIGID:
                self.rigid_body = RigidBody(
                    component, wire, system.components[wire.source]
                )
                break


def craft_of(system: System) -> Craft:
    """Return the parts of the spacecraft of a system, found once for each system."""
    craft: Craft | None = vars(system).get("craft")
    if craft is None:
        craft = vars(system)["craft"] = Craft(system)
    return craft
