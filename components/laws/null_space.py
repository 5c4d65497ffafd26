"""Hold the momentum in the null space of the wheels relative to that of the last orbit.

Momentum in the null space is no momentum of the craft, so that no coil can remove it,
and wheels that are driven against each other change it without a torque on the body. It
keeps wheels away from zero speed. Without a weight it decays to `NULL_MOMENTUM` times
the peak, the largest momentum that a wheel had otherwise in the last orbit; with one it
is held at this many times what keeps all wheels from standstill.
"""

from __future__ import annotations

from math import copysign, inf
from typing import NamedTuple

from ..contract.block import PerWheel, Table
from ..maths.vector import inner
from .integrated import null_torque

BINS = 8  # parts of an orbit whose largest wheel momenta are stored
# Limit of the momentum in the null space, relative to the peak.
NULL_MOMENTUM = 2.0
# Share of its capacity (1) below which a wheel counts as near standstill.
STANDSTILL = 0.02
# Share of its capacity (1) to which momentum in the null space may fill a wheel.
MOST_FILL = 0.9


class Peaks(NamedTuple):
    """Largest wheel momenta of the last orbit, without those in the null space."""

    bins: Table  # N m s, BINS parts of an orbit, the newest first
    newest: int  # number of the newest part since t = 0; -1: none
    first: int  # number of the first part; -1: none


NO_PEAKS = Peaks((0.0,) * BINS, -1, -1)


def store_peak(peaks: Peaks, t: float, orbit: float, largest: float) -> Peaks:
    """Return the peaks with the `largest` wheel momentum (N m s) at t (s).

    orbit (s): its period.
    """
    bins, newest, first = peaks
    now = int(t * float(BINS) / orbit)
    if first < 0:
        first = now
    while newest < now:
        newest = now if newest < now - BINS else newest + 1
        bins = (0.0, *bins[:-1])
    return Peaks((max(bins[0], largest), *bins[1:]), newest, first)


def drive_to_level(
    h: PerWheel,
    null: PerWheel,
    rate: float,
    peak: float,
    capacity: float,
    weight: float,
) -> PerWheel:
    """Compute wheel torques (N m) by which null-space momentum decays to its level.

    Parameters
    ----------
    h : PerWheel
        Momentum of the wheels (N m s).
    null : PerWheel
        Of `integrated.null_direction`.
    rate : float
        Rate of the decay (1/s).
    peak : float
        Largest of the last orbit (N m s), of `Peaks`.
    capacity : float
        Of a wheel (N m s); 0: not known.
    weight : float
        Of time near standstill against momentum in the null space (1); 0: none.
    """
    along = inner(null, h) / max(inner(null, null), 1.0)
    level = min(max(along, -NULL_MOMENTUM * peak), NULL_MOMENTUM * peak)
    if weight > 0.0:
        size = weight * (peak + STANDSTILL * capacity)
        if capacity > 0.0:
            size = min(size, max(MOST_FILL * capacity - peak, 0.0))
        level = copysign(size, along)
    excess = tuple(x - level * y for x, y in zip(h, null, strict=True))
    return null_torque(excess, null, rate, inf)
