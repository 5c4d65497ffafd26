"""Compute the least rod with which any law can remove the secular torque.

Saturated rods of 1 A m2 work against the secular torque s with kappa, the mean over
time of sum_i |(a_i x B) . n|, n = s / |s|; so no law needs less than |s| / kappa. The
other components must vanish, too, which makes the least rod the larger

    max over y of (y . s) / mean sum_i |(a_i x B) . y|

This is the dual of a linear programme, whose solution is open to any law that knows the
whole time in advance.
"""

from __future__ import annotations

from math import inf, pi
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.laws.least_firing import programme

from ..analyses.flight import Flight, Hardware
from ..numbers.derived import cross, rotate_back

Array = NDArray[Any]
PROGRAMME_TIMES = 1440  # maximum rows of the linear programme: the minutes of a day
FIELD_DIRECTIONS = 400  # directions in which the rods' authority is evaluated


def reach(flight: Flight, hardware: Hardware) -> Array:
    """Compute the torque of each rod of 1 A m2 over the whole orbits.

    The result is (rows, c, 3) N m, eci.
    """
    rows = flight.times - flight.times[0] <= flight.orbits_duration * (1.0 + 1e-12)
    q, b = flight.q[rows], flight.b[rows]
    each = [
        rotate_back(q, np.broadcast_to(a, (len(q), 3))) for a in hardware.axes_coil.T
    ]
    return (
        np.stack([cross(axis, b) for axis in each], axis=1)
        if each
        else np.zeros((len(q), 0, 3))
    )


def least_by_formula(able: Array, torque: Array) -> float:
    """Return the rod |s| / mean sum_i |(a_i x B) . n| (A m2).

    It is inf where no rod acts against s.
    """
    size = float(np.linalg.norm(torque))
    if size == 0.0:
        return 0.0
    work = float(np.abs(able @ (torque / size)).sum(axis=1).mean())
    return size / work if work > 0.0 else inf


def least_by_programme(able: Array, torque: Array) -> float:
    """Return the least dipole (A m2) of equal rods under any law.

    `solve_programme` is solved over at most PROGRAMME_TIMES rows.
    """
    if not np.any(torque):
        return 0.0
    some = able[:: -(-len(able) // PROGRAMME_TIMES)]
    return solve_programme(some.reshape(-1, 3) / len(some), torque)


def solve_programme(able: Array, torque: Array) -> float:
    """Return the minimum m (A m2) with sum u_i able_i = torque, |u_i| <= m.

    `able` is (rods, 3) N m. As max x with sum u_i able_i = x torque and |u_i| <= 1, m =
    1 / x, the programme has only three rows.
    """
    scale = float(np.abs(able).sum(axis=0).max())
    if scale == 0.0:
        return inf
    size = float(np.linalg.norm(torque))
    columns = np.column_stack([able.T / scale, -torque / size])
    cost = np.append(np.zeros(len(able)), -1.0)
    least, most = (
        np.append(np.full(len(able), -1.0), 0.0),
        np.append(np.ones(len(able)), inf),
    )
    x, _ = programme(cost, columns, np.zeros(3), least, most)
    if x is None or x[-1] <= 1e-12:
        return inf
    return size / (float(x[-1]) * scale)


class Geometry(NamedTuple):
    """Directions and times in which the field limits the rods."""

    # (3,) unit vector, eci: the rods have least authority against a torque along it
    weakest: Array
    weakness: float  # authority there over its mean over all directions
    # s: longest time in which rods of 1.3 times the least cannot cancel the secular
    # torque
    blind: float
    against: float  # T, mean sum_i |(a_i x B) . n| along the weakest
    # T, the same of a tumbling craft: half of |B x n| a rod, mean over all attitudes
    tumbling: float


def compute_geometry(
    flight: Flight, hardware: Hardware, able: Array, torque: Array, least: float
) -> Geometry:
    """Compute the authority of the rods by direction, and when it is too small."""
    k = np.arange(FIELD_DIRECTIONS) + 0.5
    z, turn = (
        1.0 - k / FIELD_DIRECTIONS,
        pi * (1.0 + 5.0**0.5) * k,
    )  # half a sphere: n and -n are equivalent
    n = np.stack(
        [np.cos(turn) * np.sqrt(1.0 - z * z), np.sin(turn) * np.sqrt(1.0 - z * z), z]
    )
    some = able[:: -(-len(able) // PROGRAMME_TIMES)]
    work = np.abs(some @ n).sum(axis=1).mean(axis=0)
    b = flight.b[:: -(-len(flight.b) // PROGRAMME_TIMES)]
    across = np.sqrt(np.maximum((b * b).sum(axis=1)[:, None] - (b @ n) ** 2, 0.0)).mean(
        axis=0
    )
    weakest = int(np.argmin(work))
    size = float(np.linalg.norm(torque))
    blind = 0.0
    if size > 0.0 and least < inf:
        can = 1.3 * least * np.abs(able @ (torque / size)).sum(axis=1)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], can < size, [0]])))
        step = float(flight.times[1] - flight.times[0])
        blind = float((edges[1::2] - edges[::2]).max(initial=0)) * step
    return Geometry(
        weakest=n[:, weakest],
        weakness=float(work[weakest] / work.mean()),
        blind=blind,
        against=float(work[weakest]),
        tumbling=0.5 * able.shape[1] * float(across.min()),
    )
