"""Compute the gain tables and costates that `magnetic.py` needs, offline.

It needs numpy and scipy. Model, units and signs as in `magnetic.py`. `field(t)` is B
(T, body) at t (s) after the start, `omega` (rad/s) the constant rate of the attitude;
weights are the diagonals of F (1/(T2 s2)) and R.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

Array = NDArray[np.floating[Any]]
Triple = Sequence[float] | Array
Field = Callable[[float], Triple]

_UPPER = np.triu_indices(3)
_FULL = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])

# Points of a Gauss-Legendre rule, exact for polynomials of degree 47, in each interval
# of QUADRATURE.
POINTS = 24
QUADRATURE = 300.0  # s, interval of the quadrature: a twentieth of a low orbit


def cross_matrix(v: Triple) -> Array:
    """Return the skew matrix [v x]."""
    x, y, z = v
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def reach(b: Triple, dipole_weight: Triple) -> Array:
    """Compute S = Q R^-1 Q' with Q = -[B x] (T2)."""
    q = cross_matrix(b)
    return np.asarray((q / np.asarray(dipole_weight)) @ q.T)


def gains(
    field: Field,
    omega: Triple,
    momentum_weight: Triple,
    dipole_weight: Triple,
    n_con: Triple,
    times: Array,
) -> tuple[Array, Array]:
    """Integrate gain K (nodes, 6; 1/(T2 s)) and offset g (nodes, 3; A m2/T) of eq. 11.

    `times` (s) rise to t_f. K' = -K W - W'K + K S K - F and g' = -(W - S K)' g + K
    N_con, backwards from K(t_f) = 0 and g(t_f) = 0 (notes, item 5), to 1e-10 of their
    size.
    """
    w, f, n = -cross_matrix(omega), np.diag(momentum_weight), np.asarray(n_con)
    largest = float(np.max(momentum_weight))
    if largest == 0.0:
        return np.zeros((len(times), 6)), np.zeros((len(times), 3))
    unit = sqrt(largest / np.linalg.norm(reach(field(times[-1]), dipole_weight), 2))

    def slope(t: float, y: Array) -> Array:
        """Return K' (upper triangle) and g' of the Riccati equation, over `unit`."""
        k, g = unit * y[:6][_FULL], unit * y[6:]
        s = reach(field(t), dipole_weight)
        rotation_term = k @ w
        dk = -rotation_term - rotation_term.T + k @ s @ k - f
        dg = -(w - s @ k).T @ g + k @ n
        return np.concatenate((dk[_UPPER], dg)) / unit

    solution = solve_ivp(
        slope,
        (times[-1], times[0]),
        np.zeros(9),
        t_eval=times[::-1],
        method="DOP853",
        rtol=1e-10,
        atol=1e-12,
    )
    table = unit * solution.y.T[::-1]
    return table[:, :6], table[:, 6:]


def costate(
    field: Field,
    omega: Triple,
    dipole_weight: Triple,
    n_con: Triple,
    start: Triple,
    end: Triple,
    horizon: float,
) -> Array:
    """Compute p(t_0) (A m2/T) of eq. 13 that leads from `start` to `end`.

    h(t_0) = start and h(t_0 + horizon) = end (N m s), horizon in s. In z = exp(-W t) h,
    eq. 14 is z' = -exp(-W t) S exp(W t) p(t_0) + exp(-W t) N_con; its integral is
    linear in p(t_0).
    """
    gramian, drift = np.zeros((3, 3)), np.zeros(3)
    for t, weight in zip(*_quadrature(horizon), strict=True):
        back = turned_back(omega, t)
        gramian += weight * back @ reach(field(t), dipole_weight) @ back.T
        drift += weight * back @ n_con
    momentum = np.asarray(start) + drift - turned_back(omega, horizon) @ end
    return np.linalg.solve(gramian, momentum)


def turned_back(omega: Triple, t: float) -> Array:
    """Return exp(-W t), the rotation by omega t."""
    return np.asarray(Rotation.from_rotvec(t * np.asarray(omega)).as_matrix())


def _quadrature(horizon: float) -> tuple[Array, Array]:
    """Return points (s) and weights of the integral from 0 to the horizon."""
    x, weights = np.polynomial.legendre.leggauss(POINTS)
    edges = np.linspace(0.0, horizon, max(1, round(horizon / QUADRATURE)) + 1)
    half = 0.5 * (edges[1] - edges[0])
    points = (edges[:-1, None] + half * (1.0 + x)).ravel()
    return points, np.tile(half * weights, len(edges) - 1)


def cheapest_end(free: Array, effect: Array, cost: Array, size: float) -> Array:
    """Find the end h = free + effect p (N m s) of length `size` of least cost.

    The cost is 1/2 p'cost p. With a multiplier m, (cost + m effect'effect) p = -m
    effect'free; as m rises, |h| falls from |free| to 0. free (3,), effect (3, 3), cost
    (3, 3), 0 < size < |free|.
    """
    rate = np.linalg.norm(cost, 2) / np.linalg.norm(effect, 2) ** 2

    def end(log: float) -> Array:
        """Return the end h (N m s) for a multiplier of rate 10^log."""
        m = rate * 10.0**log
        p = np.linalg.solve(cost + m * effect.T @ effect, -m * effect.T @ free)
        return np.asarray(free + effect @ p)

    log = brentq(
        lambda x: np.linalg.norm(end(x)) - size, -12.0, 12.0, xtol=1e-14, rtol=1e-14
    )
    return end(float(log))
