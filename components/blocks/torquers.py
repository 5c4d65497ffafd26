from __future__ import annotations

from collections.abc import Iterator
from math import copysign, inf

from ..contract.block import Mat34, Output, Parameter, Vec3, Vec4
from ..contract.roles import Torquers as Role
from ..maths.moments import first_order, lag, part, window
from ..maths.vector import ZERO, add, norm, scale
from ..physics.wheel_array import body_momentum, pseudo_inverse, to_coils

IDEAL, LIMITED, PULSED = range(3)
NO_COIL = 0
OFF: Vec4 = (0.0, 0.0, 0.0, 0.0)


class Torquers(Role):
    """Magnetic torquers, up to four coils, driven linearly or by pulses

    At each sample the commanded dipole is allocated to the coils, u = A^+ m_cmd_body
    (least squares; A: `axes_coil`). `drive` selects how a coil follows its command u_i:

    - `ideal`: as commanded, without limit (paper 000, Table 2);
    - `limited`: as commanded, within +-m_limit, each coil on its own;
    - `pulsed`: +-m_limit for n pulses of `least_pulse` in each `sample_time`, n rounded to the
      nearest and at most `duty_max` of the period (paper 000, Table 3).

    All coils are off for `quiet_time` before each sample, so that a magnetometer that
    samples at the same times measures exp(-quiet_time / lag) of their dipole; pulses
    begin `pulse_delay` after the sample. A coil follows with the time constant `lag`,

        m_i' = (u_i - m_i) / lag,        m_body = A m,

    through edges that may fall anywhere inside a step. Mean, slope and energies over
    the step are exact:

        dipole_energy   = sum_i 1/2 int m_i^2 dt            (paper 000, eq. 32)
        electric_energy = sum_i int resistance (m_i / area_turns)^2 dt

    on_time counts commands, not the decay. m_body, m_coil and power are those at the
    end of the last step. From `failed_from` on the failed coil has `failed_share` of
    its dipole; with `failure_known` the allocation at the samples from then on uses the
    others only.

    Source: Chen & Steyn (paper 000), sections V and VI. Resistance and area-turns
    (defaults: 1.2 W at 40 A m2) are not in the paper.
    """

    drive: int = Parameter(
        "1",
        "how a command becomes a dipole",
        choices=("ideal", "limited", "pulsed"),
        start="limited",
    )
    axes_coil: Mat34 = Parameter(
        "1",
        "columns: the coils' axes, body; zero where there is no coil",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        usual=(-1.0, 1.0),
    )
    m_limit: float = Parameter(
        "A.m2", "largest dipole of each coil", start=40.0, min=0.0, usual=(1e-3, 5000.0)
    )
    lag: float = Parameter(
        "s",
        "time constant of a coil; 0: none",
        min=0.0,
        usual=(0.0, 10.0),
    )
    quiet_time: float = Parameter(
        "s",
        "before each sample all coils are off so long",
        min=0.0,
        usual=(0.0, 100.0),
    )
    least_pulse: float = Parameter(
        "s",
        "pulsed: length of one pulse",
        start=0.05,
        min=1e-6,
        usual=(1e-4, 10.0),
    )
    duty_max: float = Parameter(
        "1", "pulsed: largest share of the period", start=0.9, min=0.0, max=1.0
    )
    pulse_delay: float = Parameter(
        "s",
        "pulsed: from the sample to the pulses",
        min=0.0,
        usual=(0.0, 10.0),
    )
    resistance: float = Parameter(
        "Ohm",
        "resistance of each coil",
        start=30.0,
        min=0.0,
        usual=(1e-2, 1e4),
    )
    area_turns: float = Parameter(
        "m2",
        "dipole per ampere: area times turns, core included",
        start=200.0,
        min=1e-9,
        usual=(1e-3, 1e5),
    )
    failed_coil: int = Parameter(
        "1", "which coil fails", choices=("none", "1", "2", "3", "4"), start="none"
    )
    failed_from: float = Parameter("s", "when it fails", start=0.0)
    failed_share: float = Parameter(
        "1",
        "share of its dipole that a failed coil still gives: 0: dead, -1: turned",
        start=0.0,
        min=-1.0,
        max=1.0,
    )
    failure_known: bool = Parameter(
        "1", "true: the allocation then leaves the failed coil out"
    )
    m_coil: Vec4 = Output("A.m2", "dipole of each coil at this time")
    power: float = Output("W", "electric power of all coils at this time")

    def start(self) -> None:
        """Check axes and times; compute the allocations of all and of healthy coils."""
        super().start()
        self._check_axes()
        self._check_times()
        dead_coil = self.failed_coil - 1
        rest = tuple(
            0.0 if i % 4 == dead_coil else x for i, x in enumerate(self.axes_coil)
        )
        self._allocation = pseudo_inverse(self.axes_coil)
        self._allocation_of_rest = pseudo_inverse(rest)
        # _end: time (s) at which the command of each coil ends
        self._command = self._end = self._m = OFF
        self._command_body = ZERO
        self._begin = self._constant_until = 0.0
        self._coils_on = 0
        self._coil_failed = False  # as of the last sample
        self._on_time = self._energy = 0.0
        self.m_mean_body = self.m_slope_body = ZERO

    def _check_axes(self) -> None:
        """Refuse axes that are not unit vectors."""
        for i in range(4):
            x, y, z = axis = self.axes_coil[i::4]
            if axis != ZERO and abs(norm((x, y, z)) - 1.0) > 1e-6:
                self.fail(f"axes_coil: column {i + 1} = {axis} is not a unit vector")

    def _check_times(self) -> None:
        """Refuse times that do not fit into a sample period."""
        period = self.sample_time
        if self.drive == PULSED:
            if period == 0.0 or self.m_limit == 0.0:
                self.fail("pulsed drive needs a sample_time and an m_limit above 0")
            if self.quiet_time + self.pulse_delay + self.duty_max * period > period * (
                1.0 + 1e-12
            ):
                self.fail(
                    "quiet_time + pulse_delay + duty_max * sample_time = "
                    f"{self.quiet_time} + {self.pulse_delay} + {self.duty_max} * {period} s "
                    "exceeds sample_time"
                )
        elif self.quiet_time > 0.0 and self.quiet_time >= period:
            self.fail(
                f"quiet_time = {self.quiet_time} s must be shorter than sample_time"
            )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        if self.m_limit == 0.0 and self.drive != IDEAL and "m_cmd_body" in wired_names:
            self.fail(
                "m_limit = 0 A.m2: these rods make no dipole, whatever a manager commands; "
                "give them one, or fly without torquers"
            )
        yield from super().foresee(begin, end, wired_names)

    def output(self, t: float) -> None:
        a, b, c, d = self.m_coil = self._m
        self.m_body = body_momentum(self.axes_coil, self._m)
        joule = self.resistance / (self.area_turns * self.area_turns)
        self.power = joule * (a * a + b * b + c * c + d * d)
        self.on_time = self._on_time
        self.dipole_energy = self._energy
        self.electric_energy = 2.0 * joule * self._energy

    def advance(self, t: float, dt: float) -> None:
        """Take a due sample; set mean and slope of the dipole (A m2, body)."""
        if self.due(t):
            self._take(t)
        if self._begin <= t and t + dt <= self._constant_until:
            self._hold(dt)
            return
        over_step = (
            self._switched_without_lag if self.lag == 0.0 else self._switched_with_lag
        )
        mean, slope, self._m = zip(
            *[over_step(i, t, dt) for i in range(4)], strict=True
        )
        self.m_mean_body = body_momentum(self.axes_coil, mean)
        self.m_slope_body = body_momentum(self.axes_coil, slope)

    def _take(self, t: float) -> None:
        """Take a sample: command of each coil, and its beginning and end."""
        fails = self.failed_coil != NO_COIL
        has_failed = fails and t >= self.failed_from
        dipoles = self._allocate(has_failed)
        if has_failed and not self._coil_failed:
            self._m = self._without_failed(self._m)
        self._coil_failed = has_failed
        self._command = self._driven(dipoles)
        self._begin = t + (self.pulse_delay if self.drive == PULSED else 0.0)
        self._end = self._ends(dipoles)
        if fails and not has_failed:
            i = self.failed_coil - 1
            end = min(self._end[i], self.failed_from)
            self._end = _replace_element(self._end, i, end)
        self._command_body = body_momentum(self.axes_coil, self._command)
        self._coils_on = 4 - self._command.count(0.0)
        self._constant_until = min(self._end) if self.drive != PULSED else self._begin

    def _allocate(self, has_failed: bool) -> Vec4:
        """Allocate the commanded dipole to the coils (A m2)."""
        if has_failed and self.failure_known:
            return self._without_failed(
                to_coils(self._allocation_of_rest, self.m_cmd_body)
            )
        dipoles = to_coils(self._allocation, self.m_cmd_body)
        return self._without_failed(dipoles) if has_failed else dipoles

    def _driven(self, dipoles: Vec4) -> Vec4:
        """Compute the dipole of each coil while it is on (A m2)."""
        a, b, c, d = dipoles
        most = self.m_limit
        if self.drive == PULSED:
            return (
                copysign(most, a),
                copysign(most, b),
                copysign(most, c),
                copysign(most, d),
            )
        if self.drive == LIMITED:
            return (
                _within(a, most),
                _within(b, most),
                _within(c, most),
                _within(d, most),
            )
        return dipoles

    def _ends(self, dipoles: Vec4) -> Vec4:
        """Return the time (s) at which each coil is switched off.

        inf: not before the next sample.
        """
        if self.drive != PULSED:
            if self.quiet_time == 0.0:
                return (inf, inf, inf, inf)
            end = (self._sample + 1) * self.sample_time - self.quiet_time
            return (end, end, end, end)
        a, b, c, d = dipoles
        begin, width = self._begin, self._pulse_width
        return (begin + width(a), begin + width(b), begin + width(c), begin + width(d))

    def _without_failed(self, x: Vec4) -> Vec4:
        """Return x with the failed coil's element reduced to its share."""
        i = self.failed_coil - 1
        return _replace_element(x, i, 0.0 + self.failed_share * x[i])

    def _hold(self, dt: float) -> None:
        """Integrate the coils over a step of dt (s) with constant commands.

        It sets mean and slope of their dipole (A m2, body), the on-time (s) and
        `_energy`, half the integral of the squared dipoles (A2 m4 s).
        """
        a, b, c, d = self._command
        self._on_time += dt * self._coils_on
        if self.lag == 0.0:
            self._energy += 0.5 * (a * a + b * b + c * c + d * d) * dt
            self._m, self.m_mean_body, self.m_slope_body = (
                self._command,
                self._command_body,
                ZERO,
            )
            return
        # m = command + gap exp(-t / lag), all coils at once
        mean, slope, end = lag(dt / self.lag)
        mean_square = lag(2.0 * dt / self.lag)[0]
        p, q, r, s = self._m
        p, q, r, s = gap = p - a, q - b, r - c, s - d
        self._energy += (
            0.5
            * dt
            * (
                a * (a + 2.0 * mean * p)
                + b * (b + 2.0 * mean * q)
                + c * (c + 2.0 * mean * r)
                + d * (d + 2.0 * mean * s)
                + mean_square * (p * p + q * q + r * r + s * s)
            )
        )
        self._m = (a + end * p, b + end * q, c + end * r, d + end * s)
        gap_body = body_momentum(self.axes_coil, gap)
        self.m_mean_body = add(self._command_body, scale(mean, gap_body))
        self.m_slope_body = scale(slope, gap_body)

    def _pulse_width(self, m: float) -> float:
        """Compute the on-time (s) in a period for a dipole m (A m2)."""
        most_pulses = int(self.duty_max * self.sample_time / self.least_pulse + 1e-9)
        pulses = int(abs(m) / self.m_limit * self.sample_time / self.least_pulse + 0.5)
        return min(pulses, most_pulses) * self.least_pulse

    def _switched_without_lag(self, i: int, t: float, dt: float) -> Vec3:
        """Compute mean, slope and end value (A m2) of coil i over a step.

        There is no lag.
        """
        u = self._command[i]
        share, lead, seconds = window(self._begin, self._end[i], t, dt)
        if seconds == 0.0 or u == 0.0:
            return ZERO
        self._on_time += seconds
        self._energy += 0.5 * u * u * seconds
        # slightly before the step's end, as rounding may shift an edge that falls on it
        last = t + dt * (1.0 - 1e-6)
        return u * share, u * lead, u if self._begin < last < self._end[i] else 0.0

    def _switched_with_lag(self, i: int, t: float, dt: float) -> Vec3:
        """Compute mean, slope and end value (A m2) of coil i over a step.

        The coil is off, on, off, and dead after a failure.
        """
        u, m = self._command[i], self._m[i]
        alive = self._alive(i, t, dt)
        on = min(max(self._begin - t, 0.0), alive)
        off = max(min(self._end[i] - t, alive), on)
        self._on_time += off - on if u != 0.0 else 0.0
        mean = slope = 0.0
        for first, last, target in ((0.0, on, 0.0), (on, off, u), (off, alive, 0.0)):
            if last > first:
                x, lead, m, square = first_order(m, target, (last - first) / self.lag)
                x, lead = part(first / dt, last / dt, x, lead)
                mean, slope = mean + x, slope + lead
                self._energy += 0.5 * square * (last - first)
        return mean, slope, m if alive == dt else 0.0

    def _alive(self, i: int, t: float, dt: float) -> float:
        """Return for how long (s) of a step coil i follows its last command."""
        if i != self.failed_coil - 1 or self._coil_failed:
            return dt
        return min(max(self.failed_from - t, 0.0), dt)


def _within(x: float, limit: float) -> float:
    """Limit x to +-limit."""
    return min(max(x, -limit), limit)


def _replace_element(x: Vec4, i: int, value: float) -> Vec4:
    """Return x with element i replaced."""
    a, b, c, d = x
    return (
        value if i == 0 else a,
        value if i == 1 else b,
        value if i == 2 else c,
        value if i == 3 else d,
    )
