"""Find the smallest change with which a craft that cannot hold its momentum would."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..analyses.flight import Flight, Hardware
from ..numbers.text import format_momenta
from .law import Law
from .rods import fly_rods, round_up

CASE_STEP = 60.0  # s: samples of the law that are closer are combined in a case
# Rods that are tried, in units of the craft's own.
MULTIPLES = np.geomspace(1.0, 30.0, 35)


class Change(NamedTuple):
    """Rods (A m2) and wheels (N m s each) that would do, in units of what there is."""

    rods: float
    wheels: float

    @property
    def size(self) -> float:
        """Return how large the change is: the product of both factors."""
        return self.rods * self.wheels


def find_change(
    flights: Sequence[Flight],
    law: Law,
    hardware: Hardware,
    limits: tuple[float, float],
    least: tuple[float, float],
) -> Change | None:
    """Find the smallest change of rods and wheels with which all flights hold.

    Parameters
    ----------
    flights, law, hardware
        Those of the model.
    limits
        Momentum (N m s) of the fullest wheel, and duty (1) of the coils.
    least
        Rods (A m2) of any law, and momentum (N m s) that a wheel has to hold whatever
        the rods.

    Returns
    -------
    Change
        None: no rods of MULTIPLES keep the duty.
    """
    rods = hardware.m_limit * MULTIPLES
    courses = [fly_rods(flight, law, hardware, rods, CASE_STEP) for flight in flights]
    wheel = np.max([c.wheel for c in courses], axis=0)
    duty = np.max([c.duty for c in courses], axis=0)
    holds = (duty <= limits[1]) & (rods >= least[0]) & np.isfinite(wheel)
    changes = [
        Change(float(multiple), max(1.0, float(x) / limits[0], least[1] / limits[0]))
        for multiple, x in zip(MULTIPLES[holds], wheel[holds], strict=True)
    ]
    return min(changes, key=lambda c: c.size, default=None)


def describe_change(change: Change, rod: float, capacity: float) -> str:
    """Say what would do in place of rods (A m2) and wheels (N m s each)."""
    parts = []
    if change.rods > 1.0:
        parts.append(f"rods of {round_up(change.rods * rod):.3g} A m2")
    if change.wheels > 1.0:
        wheels = format_momenta(round_up(change.wheels * capacity))
        parts.append(f"wheels of {wheels} each")
    return would_do(" with ".join(parts))


def would_do(text: str) -> str:
    """Return a sentence that says that this would do; "" without any."""
    return f" {text[0].upper()}{text[1:]} would do." if text else ""
