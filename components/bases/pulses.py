"""Thrusters that fire pulses: what the blocks of the role share."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable

from ..contract.block import Output, Parameter, Table, Vec3
from ..contract.roles import Thrusters
from ..maths.moments import window
from ..maths.vector import ZERO

STANDARD_GRAVITY = 9.80665
BEGIN, CENTRED = range(2)
ENTRIES = 8

# a torque (N m) from begin to end (s), and the force that it takes (N)
Pulse = tuple[float, float, Vec3, float]


class PulsedThrusters(Thrusters):
    """Thrusters that fire in pulses, and a schedule of firings.

    A block says in `wanted` which torques are to fire for how long; they fire here.
    """

    least_pulse: float = Parameter(
        "s", "on-times are multiples of it, to the nearest", start=0.05, min=1e-6
    )
    least_on_time: float = Parameter("s", "shorter on-times are left out", min=0.0)
    placement: int = Parameter(
        "1", "where in the sample period pulses are", choices=("begin", "centred"), start="begin"
    )
    specific_impulse: float = Parameter("s", "specific impulse", start=68.0, min=1.0)
    schedule_start: Table = Parameter("s", "scheduled firings: when each begins", shape=(ENTRIES,))
    schedule_duration: Table = Parameter(
        "s", "scheduled firings: how long; 0: none", shape=(ENTRIES,), min=0.0,
        needs=("tau_mean_thruster_body", "tau_slope_thruster_body"),
    )  # fmt: skip
    schedule_tau_body: Table = Parameter(
        "N.m", "scheduled firings: torque of each on the body, body", shape=(ENTRIES, 3)
    )
    schedule_on_time: float = Output("s", "time of scheduled firings; no part of on_time")

    _pulses: tuple[Pulse, ...]

    def start(self) -> None:
        super().start()
        self._pulses = ()
        x, y, z = (self.schedule_tau_body[i::3] for i in range(3))
        self._schedule = tuple(
            (self.schedule_start[i], self.schedule_start[i] + duration, (x[i], y[i], z[i]))
            for i, duration in enumerate(self.schedule_duration)
            if duration > 0.0
        )
        self._on_time = self._propellant = self._schedule_on_time = 0.0
        self.tau_mean_thruster_body = self.tau_slope_thruster_body = ZERO

    def output(self, t: float) -> None:
        self.on_time = self._on_time
        self.propellant = self._propellant
        self.schedule_on_time = self._schedule_on_time

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            period = self.sample_time or dt
            self._pulses = tuple(
                self._pulse(t, period, width, torque, force)
                for on_time, torque, force in self.wanted(period)
                if (width := self._width(on_time, period)) > 0.0
            )
        mean, slope = [0.0] * 3, [0.0] * 3
        for begin, end, torque, force in self._pulses:
            seconds = _add(mean, slope, torque, begin, end, t, dt)
            self._on_time += seconds
            self._propellant += seconds * force / (STANDARD_GRAVITY * self.specific_impulse)
        for begin, end, torque in self._schedule:
            self._schedule_on_time += _add(mean, slope, torque, begin, end, t, dt)
        self.tau_mean_thruster_body = (mean[0], mean[1], mean[2])
        self.tau_slope_thruster_body = (slope[0], slope[1], slope[2])

    @abstractmethod
    def wanted(self, period: float) -> Iterable[tuple[float, Vec3, float]]:
        """What the command wants in this sample period: on-time (s), torque (N m), force (N)."""

    def _width(self, on_time: float, period: float) -> float:
        """The pulse (s) that a wanted on-time (s) becomes; 0 where it is left out."""
        count = int(on_time / self.least_pulse + 0.5)
        width = min(count * self.least_pulse, period)
        return 0.0 if width < self.least_on_time * (1.0 - 1e-12) else width

    def _pulse(self, t: float, period: float, width: float, torque: Vec3, force: float) -> Pulse:
        begin = t if self.placement == BEGIN else t + 0.5 * (period - width)
        return begin, begin + width, torque, force


def _add(mean: list[float], slope: list[float], torque: Vec3, begin: float, end: float,
         t: float, dt: float) -> float:  # fmt: skip
    """Add to mean and slope on [t, t + dt] a torque on [begin, end]; return the time on (s)."""
    share, lead, seconds = window(begin, end, t, dt)
    if seconds > 0.0:
        for i, x in enumerate(torque):
            mean[i] += x * share
            slope[i] += x * lead
    return seconds
