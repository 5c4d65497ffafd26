"""Find the attitude near the wanted one at which disturbances leave least momentum."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.maths.attitude import product

from ..analyses.flight import Attitude, Flight, Hardware, flown_at
from ..numbers.derived import rotate
from ..system.model import System

Array = NDArray[Any]
ROWS = 360  # of a flight, at most or a few more
MOST = np.radians(20.0)  # rad, that the craft is turned by, about each axis
STEP = np.radians(2.0)  # rad, first step of the search
EVALUATIONS = 200
# Share of the momentum that a turn by MOST has to save: of turns that save alike, as
# about the nadir, the smallest counts.
LEAN = 0.05
WORTH = 0.1  # share of the momentum that another attitude saves at least
KINDS = ("nadir", "inertial")  # of attitudes that can be turned


@dataclass(frozen=True)
class LeastAttitude:
    """A turn of the craft, and what the fullest wheel comes to in a day with it."""

    turn: tuple[float, float, float]  # rad, rotation vector in body
    momentum: float  # N m s
    wanted_momentum: float  # N m s, the same at the wanted attitude

    @property
    def words(self) -> str:
        """Describe the turn."""
        angle = float(np.linalg.norm(self.turn))
        x, y, z = (round(a / angle, 2) + 0.0 for a in self.turn)
        return f"{np.degrees(angle):.3g} deg about ({x:.2f}, {y:.2f}, {z:.2f})"


def find_least_attitude(
    system: System, attitude: Attitude, flight: Flight, hardware: Hardware
) -> LeastAttitude | None:
    """Find the turn of at most MOST about each axis with the least momentum.

    It is that of the fullest wheel over the flight, which begins with wheels at rest.
    None where the attitude cannot be turned, or no turn saves WORTH of it.
    """
    from scipy.optimize import minimize

    inputs = dict(flight.inputs)
    inputs.pop("q_bi", None)
    names = {"r_eci", "v_eci", "b_eci", "sun_eci", "sunlight", "density"}
    if attitude.kind not in KINDS or not names <= inputs.keys():
        return None
    every = max(1, len(flight.source_times) // ROWS)
    times = flight.source_times[::every]
    inputs = {name: inputs[name][::every] for name in names}
    spread = hardware.spread().T

    def momentum(turn: Array) -> float:
        """Return the momentum (N m s) of the fullest wheel with a turn (3,) rad."""
        half = 0.5 * float(np.linalg.norm(turn))
        x, y, z = (0.5 * np.sinc(half / np.pi) * turn).tolist()
        other = attitude._replace(q=product((x, y, z, float(np.cos(half))), attitude.q))
        there = flown_at(system, other, inputs, times)
        inside = rotate(there.q, there.disturbance) - (there.body - there.body[0])
        return float(np.abs(inside @ spread).max())

    wanted_momentum = momentum(np.zeros(3))
    best = minimize(
        lambda turn: (
            momentum(turn) + LEAN * wanted_momentum * float(turn @ turn) / MOST**2
        ),
        np.zeros(3),
        method="Nelder-Mead",
        bounds=[(-MOST, MOST)] * 3,
        options={
            "initial_simplex": np.vstack([np.zeros(3), STEP * np.eye(3)]),
            "maxfev": EVALUATIONS,
            "xatol": 1e-4,
            "fatol": 1e-4 * max(wanted_momentum, 1e-12),
        },
    )
    least = momentum(best.x)
    if least > (1.0 - WORTH) * wanted_momentum:
        return None
    a, b, c = best.x.tolist()
    return LeastAttitude((a, b, c), least, wanted_momentum)
