"""Split the momentum of a craft into secular and cyclic parts, by source and wheel.

The secular torque is s = (J(T) - J(0)) / T over whole orbits, where J(t) is the impulse
of the disturbances. The wheels have to hold the cyclic remainder J - s t whatever the
coils do.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.laws.integrated import null_vector

from ..analyses.flight import Flight, Hardware, secular
from ..numbers.derived import rotate
from .model import in_body_of
from .requirements import SizingRequirements

Array = NDArray[Any]
BEYOND_ZERO = 1.2  # a bias over the swing of the fullest wheel


@dataclass(frozen=True)
class SourceShare:
    """Share of a source of disturbance in the momentum."""

    name: str
    secular: float  # N m, magnitude
    # component along the secular torque over that torque; the sum is 1 where all
    # sources are known
    along: float
    per_orbit: float  # N m s
    cyclic: float  # N m s, as `Sizing.cyclic`


def cyclic_span(cyclic: Array) -> float:
    """Return the largest distance (N m s) of the cyclic momentum from its middle.

    The middle is that of the box that encloses it.
    """
    return float(np.linalg.norm(cyclic - box_middle(cyclic), axis=1).max())


def box_middle(cyclic: Array) -> Array:
    """Return the middle (3,) N m s of the box that encloses the cyclic momentum."""
    return np.asarray((cyclic.max(axis=0) + cyclic.min(axis=0)) / 2.0)


def shares_of(
    flight: Flight, torque: Array
) -> tuple[tuple[SourceShare, ...], float | None]:
    """Compute the shares of the sources, and the secular torque (N m) of none of them.

    Without known sources there are no shares and the torque is None.
    """
    if not flight.sources:
        return (), None
    square = float(torque @ torque)
    rows, explained_torque = [], np.zeros(3)
    for name, impulse in flight.sources.items():
        mean, cyclic = secular(flight, flight.source_times, impulse)
        explained_torque += mean
        size = float(np.linalg.norm(mean))
        along = float(mean @ torque) / square if square > 0.0 else 0.0
        rows.append(
            SourceShare(name, size, along, size * flight.period, cyclic_span(cyclic))
        )
    return tuple(rows), float(np.linalg.norm(torque - explained_torque))


def smallest_wheel_capacity(hardware: Hardware) -> float:
    """Return the capacity of the smallest wheel (N m s)."""
    there = hardware.capacity[hardware.capacity > 0.0]
    return float(there.min()) if len(there) else 0.0


def compute_wheel_needs(
    flight: Flight, hardware: Hardware, torque: Array, cyclic: Array, bias: Array
) -> tuple[float, float]:
    """Compute the momentum of the fullest wheel, and the time without dumping.

    The momentum (N m s) is the part of the cyclic momentum and of a bias (3,) N m s,
    body, that this wheel holds by least squares. The time (s) is until a wheel that
    starts at rest is full; inf: never.
    """
    spread = hardware.spread()
    n = len(cyclic)
    inside = in_body_of(flight, cyclic - box_middle(cyclic))
    bent = flight.body[:n] - flight.body[:n].mean(axis=0)
    momentum_needed = float(np.abs(hardware.of_wheels(inside - bent + bias)).max())
    exists = hardware.capacity > 0.0
    capacity = hardware.capacity[exists]
    gained = flight.disturbance - flight.disturbance[0]
    wheel_momentum = np.abs(hardware.of_wheels(in_body_of(flight, gained)))[:, exists]
    full = (wheel_momentum >= capacity).any(axis=1)
    since = flight.times - flight.times[0]
    if full.any():
        return momentum_needed, float(since[np.argmax(full)])
    # Beyond the flight the momentum grows along the torque, in the attitudes
    # that the flight has shown.
    along = rotate(flight.q[:n], np.broadcast_to(torque, (n, 3)))
    rate = float(np.abs(along @ spread.T)[:, exists].max())
    remaining = float((capacity - wheel_momentum.max(axis=0)).min())
    return momentum_needed, inf if rate == 0.0 else float(since[-1]) + remaining / rate


def compute_body_rate(hardware: Hardware) -> float:
    """Compute the largest rate of the body (rad/s) that wheels at rest take over.

    It is about the worst axis; inf: they have no limit.
    """
    each = np.linalg.norm(hardware.spread() @ hardware.inertia, axis=1)
    works = hardware.capacity > 0.0
    return float((hardware.capacity[works] / each[works]).min(initial=inf))


def compute_bias(hardware: Hardware, swing: float) -> float:
    """Compute the bias (N m s) with which no wheel passes zero; inf: none does.

    `swing` (N m s) is what the fullest wheel comes to without it. The bias is that of
    the wheel whose share is 1 (`manager.h_null`).
    """
    shares = np.abs(null_vector(tuple(np.ravel(hardware.axes_wheel).tolist())))
    shares = shares[hardware.capacity > 0.0]
    return BEYOND_ZERO * swing / float(shares.min()) if shares.all() else inf


def compute_slew(
    hardware: Hardware, requirements: SizingRequirements
) -> tuple[float, float]:
    """Compute momentum (N m s) and torque (N m) of the fullest wheel in a slew.

    The slew is about the worst axis, with a triangular rate profile.
    """
    if requirements.slew_time == 0.0:
        return 0.0, 0.0
    worst = float(np.linalg.norm(hardware.spread() @ hardware.inertia, axis=1).max())
    rate = 2.0 * requirements.slew_angle / requirements.slew_time
    return worst * rate, worst * 2.0 * rate / requirements.slew_time
