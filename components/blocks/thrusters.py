from __future__ import annotations

from ..block import Parameter, Vec3
from ..moments import pulse
from ..roles import Thrusters as Role
from ..vector import ZERO

STANDARD_GRAVITY = 9.80665


class Thrusters(Role):
    """Pulsed thruster pairs, one torque level per body axis

    At each sample the command of an axis becomes n pulses of `least_pulse`, n rounded to the
    nearest: `tau_level` with the command's sign from the sample on for n least_pulse, at most the
    whole `sample_time`. The edges may fall anywhere inside a step; impulse and first moment are
    exact (mean and slope).

        on_time += sum over the axes;  propellant += on-time tau_level / (arm g0 I_sp)

    Source: Chen & Steyn (paper 000), section VI: +-40 mN m, 50 ms. Arm and specific impulse
    (cold nitrogen) are not in the paper.
    """

    tau_level: Vec3 = Parameter("N.m", "torque of each axis while it fires", start=0.04, min=1e-9)
    least_pulse: float = Parameter("s", "length of one pulse", start=0.05, min=1e-6)
    arm: float = Parameter("m", "lever arm of the thrusters", start=0.4, min=1e-3)
    specific_impulse: float = Parameter("s", "specific impulse", start=68.0, min=1.0)

    def start(self) -> None:
        super().start()
        self._begin, self._width, self._sign = 0.0, ZERO, ZERO
        self._on_time = self._propellant = 0.0
        self.tau_mean_thruster_body = self.tau_slope_thruster_body = ZERO

    def output(self, t: float) -> None:
        self.on_time = self._on_time
        self.propellant = self._propellant

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            self._take(t, self.sample_time or dt)
        mean, slope = [0.0] * 3, [0.0] * 3
        for i, width in enumerate(self._width):
            begin = max(self._begin - t, 0.0)
            end = min(self._begin + width - t, dt)
            if width == 0.0 or end <= begin:
                continue
            share, lead = pulse(begin / dt, end / dt)
            torque = self._sign[i] * self.tau_level[i]
            mean[i], slope[i] = torque * share, torque * lead
            self._on_time += end - begin
            force = self.tau_level[i] / self.arm
            self._propellant += (end - begin) * force / (STANDARD_GRAVITY * self.specific_impulse)
        self.tau_mean_thruster_body = (mean[0], mean[1], mean[2])
        self.tau_slope_thruster_body = (slope[0], slope[1], slope[2])

    def _take(self, t: float, period: float) -> None:
        width, sign = [0.0] * 3, [0.0] * 3
        for i, wanted in enumerate(self.tau_cmd_thruster_body):
            count = int(abs(wanted) / self.tau_level[i] * period / self.least_pulse + 0.5)
            width[i] = min(count * self.least_pulse, period)
            sign[i] = 1.0 if wanted > 0.0 else -1.0
        self._begin = t
        self._width = (width[0], width[1], width[2])
        self._sign = (sign[0], sign[1], sign[2])
