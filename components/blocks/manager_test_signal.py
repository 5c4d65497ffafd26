from __future__ import annotations

from math import pi, sin

from ..contract.block import TURN, Output, Parameter, PerWheel
from ..contract.roles import Manager
from ..maths.vector import ZERO


class ManagerTestSignal(Manager):
    """Open-loop wheel torques, for identification and for reference runs

        tau_cmd_wheel[i] = bias[i] + amplitude[i] sin(2 pi t_s / period[i] + phase[i])

    with t_s the time of the last sample; no dipole, no thrusters, no feedback.
    """

    no_law = "it turns the wheels by a given signal, without feedback"

    bias: PerWheel = Parameter("N.m", "constant part for each wheel")
    amplitude: PerWheel = Parameter("N.m", "amplitude for each wheel")
    period: PerWheel = Parameter("s", "period for each wheel", start=600.0, min=1e-3)
    phase: PerWheel = Parameter("rad", "phase for each wheel", usual=TURN)
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle",),
    )

    def start(self) -> None:
        super().start()
        self.tau_cmd_wheel = (0.0,) * len(self.h_wheel)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.mode = 0

    def compute(self, t: float, dt: float) -> None:
        """Command bias + amplitude sin(2 pi t / period + phase) of each wheel (N m)."""
        if self.due(t):
            t_sample = self._sample * self.sample_time if self.sample_time > 0.0 else t
            self.tau_cmd_wheel = tuple(
                b + a * sin(2.0 * pi * t_sample / p + q)
                for b, a, p, q in zip(
                    self.bias, self.amplitude, self.period, self.phase, strict=True
                )
            )
