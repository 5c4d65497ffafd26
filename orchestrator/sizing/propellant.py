"""The propellant of thrusters that take out the secular torque alone."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.maths.allocation import least_on_times

from ..analyses.flight import Flight, Hardware, values_of
from ..numbers.derived import rotate
from ..system.model import System
from .requirements import SizingRequirements

Array = NDArray[Any]
YEAR = 365.25 * 86400.0  # s
GRAVITY = 9.80665  # m/s2
DUMP_ATTITUDES = 720  # at which the cost of a dump by thrusters is looked at


def compute_propellant(
    system: System,
    flight: Flight,
    hardware: Hardware,
    torque: Array,
    requirements: SizingRequirements,
) -> tuple[float | None, float | None]:
    """Return the kg a year that thrusters alone take for the secular torque: where
    dumps begin as the fullest wheel is fullest, and where each waits for the attitude
    at which it costs least. None where they are not known.

    An impulse along the body direction u costs |u|_1 / (arm g0 I_sp) of pairs that give
    a torque about one axis each, and of nozzles what their own on-times come to
    (`least_on_times`).
    """
    size = float(np.linalg.norm(torque))
    isp = requirements.specific_impulse or hardware.specific_impulse
    cost = thruster_cost(system, hardware, requirements)
    if cost is None or isp is None:
        return None, None
    if size == 0.0:
        return 0.0, 0.0
    along, costs = costs_along(flight, torque, cost, isp)
    full = np.abs(along @ hardware.spread().T).max(axis=1)
    at_begin = float(costs[full >= (1.0 - 1e-3) * full.max()].mean())
    return size * YEAR * at_begin, size * YEAR * float(costs.min())


def costs_along(
    flight: Flight, torque: Array, cost: Callable[[Array], float], isp: float
) -> tuple[Array, Array]:
    """Return the direction of a torque (3,), eci, in body at DUMP_ATTITUDES of a flight
    (rows, 3), and the propellant (kg) that 1 N m s along it takes in each."""
    q = flight.q[:: max(1, len(flight.q) // DUMP_ATTITUDES)]
    along = rotate(q, np.broadcast_to(torque / np.linalg.norm(torque), (len(q), 3)))
    return along, np.array([cost(u) for u in along]) / (isp * GRAVITY)


def thruster_cost(
    system: System, hardware: Hardware, requirements: SizingRequirements
) -> Callable[[Array], float] | None:
    """Return the impulse of force (N s) that an angular impulse of 1 N m s along a body
    direction takes; None where it is not known."""
    arm = requirements.arm or hardware.arm
    if arm is not None:
        return lambda u: float(np.abs(u).sum()) / arm
    thrusters = values_of(system).get("thrusters", {})
    if "position_nozzle" not in thrusters:
        return None
    thrust = np.array(thrusters["thrust"], float)
    forces = np.reshape(thrusters["direction_nozzle"], (-1, 3)) * thrust[:, None]
    torques = np.cross(np.reshape(thrusters["position_nozzle"], (-1, 3)), forces)

    def cost(u: Array) -> float:
        x, y, z = u.tolist()
        times = least_on_times(tuple(map(tuple, torques.tolist())), (x, y, z), 1e9)
        remaining = u - np.array(times) @ torques
        return (
            float(np.array(times) @ thrust) if np.linalg.norm(remaining) < 1e-3 else inf
        )

    return cost
