from __future__ import annotations

from ..block import Parameter
from ..moments import pulse
from ..roles import Torquers as Role
from ..vector import ZERO, clip, dot


class Torquers(Role):
    """Three magnetic torquers along the body axes

    `drive` says how a command becomes a dipole:

    - `ideal`: as commanded, without limit (paper 000, Table 2);
    - `limited`: as commanded, within +-m_limit;
    - `pulsed`: +-m_limit for n pulses of `least_pulse` in each `sample_time`, n rounded to the
      nearest and at most `duty_max` of the period; the pulses begin `pulse_delay` after the sample,
      so that a magnetometer that samples with the same period sees no dipole (paper 000, Table 3).
    """

    drive: int = Parameter(
        "1", "how a command becomes a dipole", choices=("ideal", "limited", "pulsed"),
        start="limited",
    )  # fmt: skip
    m_limit: float = Parameter("A.m2", "largest dipole of each coil", start=40.0, min=0.0)
    least_pulse: float = Parameter("s", "length of one pulse", start=0.05, min=1e-6)
    duty_max: float = Parameter("1", "largest share of the period", start=0.9, min=0.0, max=1.0)
    pulse_delay: float = Parameter("s", "from the sample to the pulses", start=0.0, min=0.0)

    def start(self) -> None:
        super().start()
        self._command = ZERO
        self._begin, self._width = 0.0, ZERO  # of the pulses: time (s), lengths (s)
        self._on_time = self._energy = 0.0
        self.m_mean_body = self.m_slope_body = ZERO
        if self.drive == 2 and self.pulse_delay + self.duty_max * self.sample_time > (
            self.sample_time * (1.0 + 1e-12)
        ):
            self.fail("pulse_delay + duty_max * sample_time is longer than sample_time")

    def output(self, t: float) -> None:
        self.on_time = self._on_time
        self.dipole_energy = self._energy

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            self._take(t)
        if self.drive == 2:
            self._pulses(t, dt)
            return
        m = self._command
        self.m_mean_body, self.m_slope_body = m, ZERO
        self._energy += 0.5 * dot(m, m) * dt
        self._on_time += dt * sum(1 for x in m if x != 0.0)

    def _take(self, t: float) -> None:
        m = self.m_cmd_body
        self._command = m if self.drive == 0 else clip(m, self.m_limit)
        if self.drive == 2:
            self._begin = t + self.pulse_delay
            self._width = tuple(self._pulse_width(x) for x in m)  # type: ignore[assignment]

    def _pulse_width(self, m: float) -> float:
        most = int(self.duty_max * self.sample_time / self.least_pulse + 1e-9)
        wanted = int(abs(m) / self.m_limit * self.sample_time / self.least_pulse + 0.5)
        return min(wanted, most) * self.least_pulse

    def _pulses(self, t: float, dt: float) -> None:
        mean, slope = [0.0] * 3, [0.0] * 3
        for i, width in enumerate(self._width):
            begin = max(self._begin - t, 0.0)
            end = min(self._begin + width - t, dt)
            if width == 0.0 or end <= begin:
                continue
            m = self.m_limit if self._command[i] > 0.0 else -self.m_limit
            share, lead = pulse(begin / dt, end / dt)
            mean[i], slope[i] = m * share, m * lead
            self._on_time += end - begin
            self._energy += 0.5 * m * m * (end - begin)
        self.m_mean_body = (mean[0], mean[1], mean[2])
        self.m_slope_body = (slope[0], slope[1], slope[2])
