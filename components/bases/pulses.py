"""Provide the base of thrusters that fire pulses."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from math import inf

from ..contract.block import Output, Parameter, Table, Vec3
from ..contract.roles import Thrusters
from ..maths.moments import window
from ..maths.vector import ZERO, norm, scale

STANDARD_GRAVITY = 9.80665
BEGIN, CENTRED = range(2)
ENTRIES = 8
MOST_JETS = 16  # axes or nozzles

# Effect of a firing: torque (N m) and force (N) on the body, body, and its thrust (N),
# which takes propellant.
Jet = tuple[Vec3, Vec3, float]

# Begin and end (s), number of the axis or nozzle, and its effect.
Pulse = tuple[float, float, int, Jet]


class PulsedThrusters(Thrusters):
    """Thrusters that fire in pulses, with a schedule of firings.

    A block implements `commanded_on_times`: which torques fire for how long. They fire here.
    """

    least_pulse: float = Parameter(
        "s",
        "on-times are multiples of it, to the nearest",
        start=0.05,
        min=1e-6,
        usual=(1e-4, 10.0),
    )
    least_on_time: float = Parameter(
        "s",
        "shorter on-times are left out",
        min=0.0,
        usual=(0.0, 10.0),
    )
    carried: bool = Parameter(
        "1", "true: what pulses leave of a wanted on-time is added to the next one's"
    )
    placement: int = Parameter(
        "1",
        "where in the sample period pulses are",
        choices=("begin", "centred"),
        start="begin",
    )
    specific_impulse: float = Parameter(
        "s",
        "specific impulse",
        start=68.0,
        min=1.0,
        usual=(20.0, 1e4),
    )
    pulse_loss: float = Parameter(
        "s",
        "each pulse takes propellant for so much longer than it gives thrust",
        min=0.0,
        usual=(0.0, 1.0),
    )
    power: float = Parameter(
        "W",
        "electrical power of an axis, or of a nozzle, while it fires",
        min=0.0,
        usual=(0.0, 1e4),
    )
    schedule_start: Table = Parameter(
        "s", "scheduled firings: when each begins", shape=(ENTRIES,)
    )
    schedule_duration: Table = Parameter(
        "s",
        "scheduled firings: how long; 0: none",
        shape=(ENTRIES,),
        min=0.0,
        needs=("tau_mean_thruster_body", "tau_slope_thruster_body"),
    )
    schedule_tau_body: Table = Parameter(
        "N.m",
        "scheduled firings: torque of each on the body, body",
        shape=(ENTRIES, 3),
        usual=(-100.0, 100.0),
    )
    schedule_force_body: Table = Parameter(
        "N",
        "scheduled firings: force of each on the craft, body; propellant by its size",
        shape=(ENTRIES, 3),
        usual=(-1e4, 1e4),
    )
    schedule_on_time: float = Output(
        "s", "time of scheduled firings; no part of on_time"
    )
    schedule_propellant: float = Output(
        "kg",
        "propellant of scheduled firings whose force is given; no part of propellant",
    )

    electric_energy: float = Output("J", "power times on_time")
    net_impulse: float = Output(
        "N.s", "impulse of force on the craft, the sum of its size over steps"
    )

    _pulses: tuple[Pulse, ...]

    def start(self) -> None:
        """Set the state to its start values and read the schedule."""
        super().start()
        self._pulses = ()
        self._rests = (0.0,) * MOST_JETS
        self._schedule: tuple[Pulse, ...] = tuple(
            (
                self.schedule_start[i],
                self.schedule_start[i] + duration,
                i,
                self.scheduled_jet(i),
            )
            for i, duration in enumerate(self.schedule_duration)
            if duration > 0.0
        )
        self._on_time = self._propellant = self._net_impulse = 0.0
        self._schedule_on_time = self._schedule_propellant = 0.0
        self.tau_mean_thruster_body = self.tau_slope_thruster_body = ZERO
        self.force_mean_thruster_body = ZERO

    def output(self, t: float) -> None:
        """Set the counters of on-time and propellant."""
        self.on_time = self._on_time
        self.propellant = self._propellant
        self.electric_energy = self.power * self._on_time
        self.net_impulse = self._net_impulse
        self.schedule_on_time = self._schedule_on_time
        self.schedule_propellant = self._schedule_propellant

    def advance(self, t: float, dt: float) -> None:
        """Plan pulses at a sample and fire them and the schedule over the step."""
        if self.due(t):
            period = self.sample_time or dt
            wants = tuple(
                (on_time + self._rest(i, jet), jet)
                for i, (on_time, jet) in enumerate(self.commanded_on_times(period))
            )
            self._pulses = tuple(
                self._pulse(t, period, width, i, jet)
                for i, (on_time, jet) in enumerate(wants)
                if (width := self._width(on_time, period)) > 0.0
            )
            if self.carried:
                rests = [0.0] * MOST_JETS
                for i, (on_time, jet) in enumerate(wants):
                    rests[i] = (on_time - self._width(on_time, period)) * _way(jet)
                self._rests = tuple(rests)
        mean, slope, force = [0.0] * 3, [0.0] * 3, [0.0] * 3
        exhaust = STANDARD_GRAVITY * self.specific_impulse
        self.fire(mean, slope, force, t, dt)
        for begin, end, i, jet in self._schedule:
            seconds = _add(mean, slope, force, jet, begin, end, t, dt)
            self._schedule_on_time += seconds
            self._schedule_propellant += seconds * jet[2] / exhaust
            self.record_scheduled_firing(i, seconds)
        self.tau_mean_thruster_body = (mean[0], mean[1], mean[2])
        self.tau_slope_thruster_body = (slope[0], slope[1], slope[2])
        self.force_mean_thruster_body = (force[0], force[1], force[2])
        self._net_impulse += dt * norm(self.force_mean_thruster_body)

    def fire(
        self,
        mean: list[float],
        slope: list[float],
        force: list[float],
        t: float,
        dt: float,
    ) -> None:
        """Add the pulses over the step from t (s) and count them.

        They are added to the torque's mean and slope (N m) and the force's mean (N),
        body.
        """
        exhaust = STANDARD_GRAVITY * self.specific_impulse
        used = 0.0
        for begin, end, _, jet in self._pulses:
            flow = window(begin, end, t, dt)[0] * dt + self._loss(begin, t, dt)
            used += flow * jet[2] / exhaust
        remaining = self.propellant_limit() - self._propellant
        share = max(0.0, remaining) / used if used > remaining else 1.0
        for begin, end, i, (torque, push, thrust) in self._pulses:
            torque, push = scale(share, torque), scale(share, push)
            seconds = share * _add(
                mean, slope, force, (torque, push, thrust), begin, end, t, dt
            )
            self._on_time += seconds
            flow = seconds + share * self._loss(begin, t, dt)
            self._propellant += flow * thrust / exhaust
            self.record_firing(i, seconds)
        if share < 1.0:
            self._propellant = self.propellant_limit()

    def _loss(self, begin: float, t: float, dt: float) -> float:
        """Return the time (s) of flow without thrust of a pulse that begins in this step."""
        return self.pulse_loss if t <= begin < t + dt else 0.0

    def propellant_limit(self) -> float:
        """Return the propellant (kg) that all pulses may use: that of the tank."""
        return inf

    @abstractmethod
    def commanded_on_times(self, period: float) -> Iterable[tuple[float, Jet]]:
        """Return the commanded on-time (s) and the effect of each axis or nozzle.

        The command is that for this sample period (s).
        """

    def scheduled_jet(self, i: int) -> Jet:
        """Return the effect of the scheduled firing i."""
        x, y, z = self.schedule_tau_body[3 * i : 3 * i + 3]
        fx, fy, fz = self.schedule_force_body[3 * i : 3 * i + 3]
        return (x, y, z), (fx, fy, fz), norm((fx, fy, fz))

    def record_firing(self, i: int, seconds: float) -> None:
        """Record that the axis or nozzle i fired for some time (s) of this step."""

    def record_scheduled_firing(self, i: int, seconds: float) -> None:
        """Record that the scheduled firing i lasted some time (s) of this step."""

    def _rest(self, i: int, jet: Jet) -> float:
        """Return the remainder (s) of the last on-time of an axis or nozzle.

        It counts against a firing in the opposite direction of a pair. It is limited to
        the longest pulse that is left out.
        """
        most = max(self.least_pulse, self.least_on_time)
        return max(-most, min(self._rests[i] * _way(jet), most))

    def _width(self, on_time: float, period: float) -> float:
        """Round an on-time (s) to a pulse (s); 0 where it is left out."""
        count = int(on_time / self.least_pulse + 0.5)
        width = min(count * self.least_pulse, period)
        return 0.0 if width < self.least_on_time * (1.0 - 1e-12) else width

    def _pulse(self, t: float, period: float, width: float, i: int, jet: Jet) -> Pulse:
        """Place a pulse of this width (s) in the sample period from t (s)."""
        begin = t if self.placement == BEGIN else t + 0.5 * (period - width)
        return begin, begin + width, i, jet


def _way(jet: Jet) -> float:
    """Return -1 for the opposite direction of a pair, otherwise 1."""
    x, y, z = jet[0]
    return -1.0 if x + y + z < 0.0 else 1.0


def _add(
    mean: list[float],
    slope: list[float],
    force: list[float],
    jet: Jet,
    begin: float,
    end: float,
    t: float,
    dt: float,
) -> float:
    """Add a firing on [begin, end] to the torque's mean and slope and the force's mean.

    The means are those on [t, t + dt]. Returns the time on (s).
    """
    share, lead, seconds = window(begin, end, t, dt)
    if seconds > 0.0:
        for i, x in enumerate(jet[0]):
            mean[i] += x * share
            slope[i] += x * lead
            force[i] += jet[1][i] * share
    return seconds
