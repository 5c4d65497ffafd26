"""A rigid body between the rows of a run: attitude, momentum and rate inside every step.

From the rows: attitude, rate and external impulse at both ends, the wheels' momentum at the start
and their torque as mean and slope. The attitude is the polynomial of degree 5 through values, first
and second derivatives at both ends; it errs by (nutation step)^6 / 46,080. The momentum goes by the
impulse, and by the torque at both ends where that is known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import cross, rotate_back

Array = NDArray[np.float64]

Torque = Callable[[float, Array], Array]
"""f(e, q): N m, body (steps, 3), at the share e of every step, where the attitudes are q."""

NODES = (0.0, 0.5 - 0.5 * sqrt(3.0 / 7.0), 0.5, 0.5 + 0.5 * sqrt(3.0 / 7.0), 1.0)
WEIGHTS = (1.0 / 20.0, 49.0 / 180.0, 16.0 / 45.0, 49.0 / 180.0, 1.0 / 20.0)
"""Of Lobatto's quadrature of order 8 over a step, as shares of it: at both ends all is known."""


def rotate(q: Array, v: Array) -> Array:
    """C(q) v, row by row: from eci to body."""
    return rotate_back(q * np.array([-1.0, -1.0, -1.0, 1.0]), v)


def _turned(q: Array, omega: Array) -> Array:
    """1/2 Omega(omega) q, row by row."""
    vector, scalar = q[:, :3], q[:, 3:]
    return 0.5 * np.hstack(
        [scalar * omega - cross(omega, vector), -(omega * vector).sum(axis=1, keepdims=True)]
    )


@dataclass
class Steps:
    """All steps of a run at once; arrays have a row a step, or one more where they say so."""

    dt: float | Array
    """s; of each step its own as (steps, 1)"""
    carrier: Array
    """J_r (3, 3), kg m2"""
    axes: Array
    """(3, wheels)"""
    q: Array
    """(steps + 1, 4)"""
    omega: Array
    """(steps + 1, 3), rad/s, body"""
    impulse: Array
    """(steps + 1, 3), N m s, eci: of the external torque since the start"""
    h: Array
    """(steps + 1, wheels), N m s"""
    mean: Array
    """(steps, wheels), N m: of the torque on each rotor"""
    slope: Array
    """(steps, wheels), N m"""
    outer: Torque | None = None
    """External torque; None: its mean by the impulse."""

    def __post_init__(self) -> None:
        self.inverse = np.linalg.inv(self.carrier)
        self.gained = np.diff(self.impulse, axis=0)
        spin = self.omega @ self.carrier.T + self.h @ self.axes.T
        self.momentum = rotate_back(self.q, spin)
        self.ends = self.torque(0.0, self.q[:-1]), self.torque(1.0, self.q[1:])
        """The external torque (N m, body) at the start and at the end of every step."""
        self._start = self._edge(0, self.q[:-1], self.omega[:-1], spin[:-1])
        self._end = self._edge(1, self.q[1:], self.omega[1:], spin[1:])
        self.turned = (rotate_back(self.q[:-1], self.ends[0]),
                       rotate_back(self.q[1:], self.ends[1]))  # fmt: skip
        """The same in eci."""
        self._bend = self.dt * (self.turned[1] - self.turned[0])

    def torque(self, e: float, q: Array) -> Array:
        """The external torque (N m, body) at the share e of every step."""
        return self.outer(e, q) if self.outer else rotate(q, self.gained / self.dt)

    def motors(self, e: float) -> Array:
        """What the wheels' rotors take from the body (N m, body)."""
        return np.asarray((self.mean + (e - 0.5) * self.slope) @ self.axes.T)

    def _edge(self, e: int, q: Array, omega: Array, spin: Array) -> tuple[Array, Array, Array]:
        """q and its first and second derivative by the share of the step."""
        torque = self.ends[e] - self.motors(e) - cross(omega, spin)
        first = _turned(q, omega)
        second = _turned(q, torque @ self.inverse.T) + _turned(first, omega)
        return q, self.dt * first, self.dt**2 * second

    def attitude(self, e: float) -> Array:
        """q (steps, 4) at the share e of every step."""
        z = 1.0 - e

        def basis(s: float) -> tuple[float, float, float]:
            """At s for the value, first and second derivative at 0; 0 with all three at 1."""
            c = (1.0 - s) ** 3
            return c * (1.0 + s * (3.0 + 6.0 * s)), c * s * (1.0 + 3.0 * s), 0.5 * c * s * s

        a, b, c = basis(e)
        f, g, h = basis(z)
        (q0, d0, s0), (q1, d1, s1) = self._start, self._end
        q = a * q0 + b * d0 + c * s0 + f * q1 - g * d1 + h * s1
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))

    def rate(self, e: float, q: Array) -> Array:
        """The body's rate (rad/s, body) where its attitude is q."""
        h = self.h[:-1] + self.dt * (e * self.mean + 0.5 * (e * e - e) * self.slope)
        total = rotate(q, self.momentum[:-1] + e * self.gained + 0.5 * (e * e - e) * self._bend)
        return np.asarray((total - h @ self.axes.T) @ self.inverse.T)
