"""Compute stability margins of the quaternion PID on a rigid body.

Source: paper 004, eqs. 10 to 12. About one axis, with the gains times the inertia (eq.
11) and e half the angle, the open loop is

    L(s) = (kd s + kp / 2 + ki / (2 s)) / s^2  exp(-delay s)

kp in 1/s2, kd in 1/s, ki in 1/s3; frequencies in rad/s. It serves analysis only; no
block uses it.
"""

from __future__ import annotations

from cmath import exp, phase
from collections.abc import Callable
from math import degrees, inf, log10, pi, sqrt
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq


class Margins(NamedTuple):
    """Margins of an open loop; the paper requires 45 deg and 6 dB."""

    phase: float  # deg, phase margin; negative: unstable
    crossover: float  # rad/s, frequency at which |L| = 1
    gain_up: float  # dB by which the gain may rise; infinite without a delay
    gain_down: float  # dB by which it may fall; infinite without an integral
    delay: float  # s, further delay that keeps it stable


def pid_margins(kp: float, kd: float, ki: float, delay: float = 0.0) -> Margins:
    """Compute the margins of gains kp, kd > 0 and ki >= 0 with a delay (s)."""

    def loop(w: float) -> complex:
        """Evaluate the open loop L at a frequency (rad/s)."""
        s = 1j * w
        return (kd * s + kp / 2.0 + ki / (2.0 * s)) / (s * s) * exp(-delay * s)

    def lead(w: float) -> float:
        """Compute the phase above -180 deg (rad) at a frequency (rad/s).

        L s^2 has a positive real part.
        """
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
    """Find where f changes its sign between two positive bounds."""
    return float(
        np.exp(brentq(lambda x: f(np.exp(x)), np.log(low), np.log(high), xtol=1e-14))
    )
