"""Stability margins of the quaternion PID on a rigid body (paper 004, eqs. 10 to 12).

About one axis, with the gains times the inertia (eq. 11) and e half the angle, the open
loop is

    L(s) = (kd s + kp / 2 + ki / (2 s)) / s^2  exp(-delay s)

kp in 1/s2, kd in 1/s, ki in 1/s3; frequencies in rad/s. Analysis only, no block uses
it.
"""

from __future__ import annotations

from cmath import exp, phase
from collections.abc import Callable
from math import degrees, inf, log10, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq


class Margins(NamedTuple):
    """Of an open loop: the paper asks for 45 deg and 6 dB."""

    phase: float
    """Phase margin (deg); negative: unstable."""
    crossover: float
    """Frequency at which |L| = 1 (rad/s)."""
    gain_up: float
    """What the gain may grow by (dB); infinite without a delay."""
    gain_down: float
    """What it may fall by (dB); infinite without an integral."""
    delay: float
    """Further delay that it bears (s)."""


def pid_margins(kp: float, kd: float, ki: float, delay: float = 0.0) -> Margins:
    """The margins of positive gains kp and kd, of ki >= 0 and a delay (s) in the loop."""

    def loop(w: float) -> complex:
        s = 1j * w
        return (kd * s + kp / 2.0 + ki / (2.0 * s)) / (s * s) * exp(-delay * s)

    def lead(w: float) -> float:
        """Phase above -180 deg (rad); L s^2 has a positive real part."""
        return phase(kp / 2.0 + 1j * (kd * w - ki / (2.0 * w))) - delay * w

    crossover = _root(lambda w: 1.0 - abs(loop(w)), 1e-9, 1e6)
    margin = lead(crossover)
    up = down = inf
    if ki > 0.0:
        turn = sqrt(ki / (2.0 * kd))
        low = _root(lead, 0.5 * turn, max(2.0 * turn, crossover)) if delay else turn
        down = 20.0 * log10(abs(loop(low)))
    if delay > 0.0 and margin > 0.0:
        high = _root(lambda w: -lead(w), crossover, pi / delay)
        up = -20.0 * log10(abs(loop(high)))
    return Margins(degrees(margin), crossover, up, down, margin / crossover)


def _root(f: Callable[[float], float], low: float, high: float) -> float:
    """Where f changes its sign between two positive bounds."""
    return float(
        np.exp(brentq(lambda x: f(np.exp(x)), np.log(low), np.log(high), xtol=1e-14))
    )
