"""Determine which wheels a craft has: those with an axis and a spin inertia, if known.

A block of wheels refuses values that contradict each other
(`components/blocks/wheels.py`).
"""

from __future__ import annotations

from math import inf

import numpy as np
from numpy.typing import NDArray

from .model import Values

Array = NDArray[np.float64]

# Axes lie in a plane if their smallest singular value, against the largest, is below
# this.
FLAT = 1e-3


def axes_of(values: Values) -> Array:
    """Return the wheel axes (3, n), body; zero where there is no wheel.

    A craft without wheels of its own has ideal ones inside, one along each body axis.
    """
    return np.reshape(np.array(values.get("axes_wheel", np.eye(3, 4)), float), (3, -1))


def existing(values: Values) -> NDArray[np.bool_]:
    """Return which wheels exist (n,).

    The parameters may be those of a spacecraft or of its wheels.
    """
    there: NDArray[np.bool_] = np.linalg.norm(axes_of(values), axis=0) > 0.0
    if "inertia_wheel" not in values:
        return there
    return np.asarray(
        there & (np.broadcast_to(values["inertia_wheel"], there.shape) > 0.0)
    )


def capacities(values: Values) -> Array:
    """Return the largest momentum of each wheel (n,), N m s.

    It is 0 where there is no wheel, and infinite if a wheel has no speed limit or its
    spin inertia is unknown.
    """
    there = existing(values)
    spin = np.broadcast_to(
        np.array(values.get("inertia_wheel", inf), float), there.shape
    )
    return np.where(there, np.where(there, spin, 1.0) * largest_speed(values), 0.0)


def largest_speed(values: Values) -> float:
    """Return the speed (rad/s) that wheels reach.

    It is their limit, or that of their supply if it is lower.
    """
    voltage = float(values.get("supply_voltage", 0.0))
    no_load = voltage / float(values["torque_constant"]) if voltage > 0.0 else inf
    return float(min(values.get("speed_limit", inf), no_load))


def smallest_capacity(values: Values) -> float:
    """Return the capacity of the smallest wheel (N m s); 0 without wheels."""
    capacities_present = capacities(values)[existing(values)]
    return float(capacities_present.min()) if len(capacities_present) else 0.0
