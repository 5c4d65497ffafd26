"""Compute the propellant of thrusters that remove the secular torque alone."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any, NamedTuple

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
    cost = thruster_cost(system, hardware, requirements)
    if cost is None:
        return None, None
    if size == 0.0:
        return 0.0, 0.0
    along, costs = costs_along(flight, torque, cost)
    full = np.abs(along @ hardware.spread().T).max(axis=1)
    at_begin = float(costs[full >= (1.0 - 1e-3) * full.max()].mean())
    return size * YEAR * at_begin, size * YEAR * float(costs.min())


def costs_along(
    flight: Flight, torque: Array, cost: ThrusterCost
) -> tuple[Array, Array]:
    """Compute the cost of 1 N m s along a torque at DUMP_ATTITUDES of a flight.

    Returns the direction of the torque (3,), eci, in body (rows, 3), and the propellant
    (kg) for each.
    """
    q = flight.q[:: max(1, len(flight.q) // DUMP_ATTITUDES)]
    along = rotate(q, np.broadcast_to(torque / np.linalg.norm(torque), (len(q), 3)))
    return along, np.array([cost.propellant(u) for u in along])


class DumpCost(NamedTuple):
    """What a dump takes."""

    impulse: float  # N s, of force
    net_impulse: float  # N s, that the craft as a whole is left with
    propellant: float  # kg
    duration: float  # s
    pulses: float  # of the nozzle, or axis, that fires most
    on_time: float  # s, of its pulses, the longest of all
    firing: float  # s, of all nozzles or axes together


@dataclass(frozen=True)
class ThrusterCost:
    """What thrusters take for an angular impulse (3,) N m s, body."""

    torques: Array  # (nozzles, 3) N m
    forces: Array  # (nozzles, 3) N
    thrust: Array  # (nozzles,) N
    is_paired: bool  # each torque both ways, about an axis of the body
    isp: float  # s
    # N m s of a sample, s that it lasts, s of the shortest pulse and of its flow
    # without thrust
    sample_impulse: float = inf
    sample_time: float = 0.0
    least_pulse: float = inf
    pulse_loss: float = 0.0

    def on_times(self, u: Array) -> Array:
        """Return the least on-times (nozzles,) s; inf where they cannot give it."""
        if self.is_paired:
            return np.abs(u) / self.torques.diagonal()
        x, y, z = u.tolist()
        torques = tuple(map(tuple, self.torques.tolist()))
        times = np.array(least_on_times(torques, (x, y, z), 1e9))
        is_given = np.linalg.norm(u - times @ self.torques) < 1e-3
        return times if is_given else np.full(len(times), inf)

    def impulse(self, u: Array) -> float:
        """Return the impulse of force (N s), inf where they cannot give it."""
        return float(self.on_times(u) @ self.thrust)

    def propellant(self, u: Array) -> float:
        """Return the propellant (kg), with what flows at the ends of pulses."""
        return self.of_dump(u).propellant

    def of_dump(self, u: Array) -> DumpCost:
        """Return all that a dump takes."""
        times = self.on_times(u)
        impulse = float(times @ self.thrust)
        if impulse == inf:
            return DumpCost(*[inf] * len(DumpCost._fields))
        samples = float(np.linalg.norm(u)) / self.sample_impulse
        pulses = np.minimum(samples, times / self.least_pulse)
        flow = impulse + self.pulse_loss * float(pulses @ self.thrust)
        return DumpCost(
            impulse,
            float(np.linalg.norm(times @ self.forces)),
            flow / (self.isp * GRAVITY),
            samples * self.sample_time,
            float(pulses.max()),
            float((times / np.maximum(pulses, 1.0)).max()),
            float(times.sum()),
        )


def thruster_cost(
    system: System, hardware: Hardware, requirements: SizingRequirements
) -> ThrusterCost | None:
    """Return what thrusters take; None where arm and nozzles, or I_sp, are unknown.

    With an arm that is required in place of the craft's, pulses lose nothing.
    """
    isp = requirements.specific_impulse or hardware.specific_impulse
    if isp is None:
        return None
    thrusters, manager = (
        values_of(system).get(x, {}) for x in ("thrusters", "manager")
    )
    losses: dict[str, float] = {}
    if "torque" in manager and "pulse_loss" in thrusters:
        losses = {
            "sample_impulse": manager["torque"] * manager["sample_time"],
            "sample_time": manager["sample_time"],
            "least_pulse": thrusters["least_pulse"],
            "pulse_loss": thrusters["pulse_loss"],
        }
    none = np.zeros((3, 3))
    if requirements.arm or (hardware.arm and "tau_level" not in thrusters):
        arm = requirements.arm or hardware.arm
        assert arm is not None
        return ThrusterCost(np.eye(3), none, np.full(3, 1.0 / arm), True, isp)
    if hardware.arm is not None:
        level = np.array(thrusters["tau_level"], float)
        pairs = np.diag(level)
        return ThrusterCost(pairs, none, level / hardware.arm, True, isp, **losses)
    if "position_nozzle" not in thrusters:
        return None
    thrust = np.array(thrusters["thrust"], float)
    forces = np.reshape(thrusters["direction_nozzle"], (-1, 3)) * thrust[:, None]
    torques = np.cross(np.reshape(thrusters["position_nozzle"], (-1, 3)), forces)
    partners = np.array(thrusters["partner_nozzle"], int) - 1
    firsts = np.flatnonzero((partners < 0) | (partners > np.arange(len(partners))))
    for table in (torques, forces, thrust):  # a couple counts as one nozzle
        couples = firsts[partners[firsts] >= 0]
        table[couples] += table[partners[couples]]
    return ThrusterCost(
        torques[firsts], forces[firsts], thrust[firsts], False, isp, **losses
    )
