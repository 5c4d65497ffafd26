"""Compute the propellant of thrusters that remove the secular torque alone."""

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
DUMP_ATTITUDES = 720  # attitudes at which the cost of a dump is evaluated


def compute_propellant(
    system: System,
    flight: Flight,
    hardware: Hardware,
    torque: Array,
    requirements: SizingRequirements,
) -> tuple[float | None, float | None]:
    """Compute the propellant (kg a year) of thrusters that remove the secular torque.

    The first value is for dumps that begin as the fullest wheel is fullest; the second
    for dumps that wait for the attitude at which they cost least. None where they are
    unknown.

    An impulse along the body direction u costs |u|_1 / (arm g0 I_sp) with pairs that
    give a torque about one axis each, and with nozzles the sum of their on-times
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
    """Compute the cost of 1 N m s along a torque at DUMP_ATTITUDES of a flight.

    Returns the direction of the torque (3,), eci, in body (rows, 3), and the propellant
    (kg) for each.
    """
    q = flight.q[:: max(1, len(flight.q) // DUMP_ATTITUDES)]
    along = rotate(q, np.broadcast_to(torque / np.linalg.norm(torque), (len(q), 3)))
    return along, np.array([cost(u) for u in along]) / (isp * GRAVITY)


def thruster_cost(
    system: System, hardware: Hardware, requirements: SizingRequirements
) -> Callable[[Array], float] | None:
    """Return the function for the impulse of force (N s) per angular impulse.

    Its argument is an angular impulse (3,) N m s, body. None where arm and nozzles are
    unknown.
    """
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
        """Return the impulse of force (N s) of nozzles for a momentum.

        It is inf where they cannot give it.
        """
        x, y, z = u.tolist()
        times = least_on_times(tuple(map(tuple, torques.tolist())), (x, y, z), 1e9)
        remaining = u - np.array(times) @ torques
        return (
            float(np.array(times) @ thrust) if np.linalg.norm(remaining) < 1e-3 else inf
        )

    return cost
