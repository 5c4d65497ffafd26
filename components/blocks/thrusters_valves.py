from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..bases.pulses import MOST_JETS, STANDARD_GRAVITY, Jet
from ..contract.block import Output, Parameter
from ..maths.moments import first_order, part
from ..maths.noise import normal_pair, stream
from ..maths.vector import ZERO, scale, sub
from .thrusters_nozzles import ThrustersNozzles

CLOSED, OPEN = range(2)
NO_NOZZLE = 0
ROUNDING = 1e-12  # of a step: shorter times open or shut are rounding


class ThrustersValves(ThrustersNozzles):
    """Nozzles with valves and a tank: rise and decay, scatter, stuck valves, blow-down

    As `thrusters_nozzles`, but the share s_i of a nozzle's thrust follows its valve,

        s_i' = (c - s_i) / rise_time while it is open,    s_i' = -s_i / decay_time while it is shut

    through edges that may fall anywhere inside a step; mean and slope are exact. A
    decaying thrust extends into the next sample period. c = p (1 + impulse_scatter n),
    with n a standard normal number of each pulse (c is never below 0), and p the tank's
    pressure relative to that of the start. With a `tank` of propellant, filled to 1 /
    blowdown by gas that expands at constant temperature,

        p = 1 / (1 + (blowdown - 1) propellant / tank)

    at the beginning of the step, and 0 when the tank is empty; the step in which that
    happens has the thrust of the remaining propellant. `on_time` counts open valves,
    `propellant` the mass expelled: thrust / (g0 I_sp), and `pulse_loss` each pulse.

    The valve of `stuck_nozzle` is `stuck` closed or open from `stuck_from` on, whatever
    is commanded. With `failure_known` the on-times at the samples from then on use the
    other nozzles only and compensate the open one.

    Scheduled firings have neither edges nor scatter. Those that use nozzles are refused
    together with a stuck one, all of them together with a tank. The craft's inertia
    does not change.

    Source: ours; Boyle's law for the pressure.
    """

    rise_time: float = Parameter(
        "s",
        "time constant of the thrust as a valve opens",
        min=0.0,
        usual=(0.0, 1.0),
    )
    decay_time: float = Parameter(
        "s",
        "time constant of the thrust as a valve shuts",
        min=0.0,
        usual=(0.0, 1.0),
    )
    impulse_scatter: float = Parameter(
        "1",
        "standard deviation of a pulse's thrust, relative; each pulse anew",
        min=0.0,
        usual=(0.0, 0.3),
    )
    seed: int = Parameter(
        "1", "seed of the scatter; instance name and variable key it as well", start=1
    )
    stuck_nozzle: int = Parameter(
        "1",
        "whose valve is stuck",
        choices=("none", *(str(i + 1) for i in range(MOST_JETS))),
        start="none",
    )
    stuck: int = Parameter(
        "1", "how it is stuck", choices=("closed", "open"), start="closed"
    )
    stuck_from: float = Parameter("s", "when it is", start=0.0)
    failure_known: bool = Parameter("1", "true: the allocation then reckons with it")
    tank: float = Parameter(
        "kg",
        "propellant at the start; 0: without end",
        min=0.0,
        usual=(0.0, 1e4),
    )
    blowdown: float = Parameter(
        "1",
        "the tank's pressure at the start over that when it is empty; 1: regulated",
        start=1.0,
        min=1.0,
        usual=(1.0, 10.0),
    )
    propellant_left: float = Output(
        "kg", "propellant in the tank; 0 where it is without end"
    )

    def start(self) -> None:
        """Check stuck nozzle and tank; set the valves' levels to their start values."""
        super().start()
        i = self.stuck_nozzle - 1
        if i >= len(self._jets) or (i >= 0 and self._jets[i][1] == ZERO):
            self.fail(
                f"stuck_nozzle = {i + 1}: its thrust or direction is 0: no such nozzle"
            )
        if i >= 0 and any(x > 0.0 for x in self.schedule_nozzle):
            self.fail(
                f"stuck_nozzle = {i + 1}: not beside scheduled firings of schedule_nozzle"
            )
        if self.tank > 0.0 and any(x > 0.0 for x in self.schedule_duration):
            self.fail(f"tank = {self.tank} kg: not beside scheduled firings")
        if self.blowdown > 1.0 and self.tank == 0.0:
            self.fail(f"blowdown = {self.blowdown} needs a tank above 0 kg")
        self._knows_failure = False  # whether the stuck valve is known at this step
        self._key = stream(self.instance, "tau_mean_thruster_body", self.seed)
        self._levels: tuple[float, ...] = (0.0,) * len(self.thrust)  # s of each nozzle

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        if self.stuck_nozzle != NO_NOZZLE and self.stuck == OPEN and self.tank == 0.0:
            yield f"stuck_nozzle = {self.stuck_nozzle} stays open without end: there is no tank"
        yield from super().foresee(begin, end, wired_names)

    def output(self, t: float) -> None:
        super().output(t)
        self.propellant_left = max(self.tank - self._propellant, 0.0)

    def advance(self, t: float, dt: float) -> None:
        self._knows_failure = self.failure_known and t >= self.stuck_from
        super().advance(t, dt)

    def commanded_on_times(self, period: float) -> Iterable[tuple[float, Jet]]:
        impulse = scale(period, self.tau_cmd_thruster_body)
        torques, stuck = tuple(jet[0] for jet in self._jets), self.stuck_nozzle - 1
        if stuck >= 0 and self._knows_failure:
            if self.stuck == OPEN:
                impulse = sub(impulse, scale(period * self._pressure(), torques[stuck]))
            torques = tuple(ZERO if i == stuck else x for i, x in enumerate(torques))
        return zip(self.on_times(torques, impulse, period), self._jets, strict=True)

    def fire(
        self,
        mean: list[float],
        slope: list[float],
        force: list[float],
        t: float,
        dt: float,
    ) -> None:
        """Add the nozzles' thrust over the step from t (s), and take propellant (kg).

        It is added to the torque's mean and slope (N m) and the force's mean (N), body.
        """
        shares = [0.0] * (2 * len(self.thrust))  # mean and slope of each nozzle's share
        open_time, levels = [0.0] * len(self.thrust), list(self._levels)
        pressure, used = self._pressure(), 0.0
        for i in range(len(self.thrust)):
            _, push, thrust = self._jets[i]
            if push != ZERO:
                a, b, levels[i], open_time[i] = self._share(
                    i, levels[i], pressure, t, dt
                )
                shares[2 * i], shares[2 * i + 1] = a, b
                flow = dt * a
                for begin, _, nozzle, _ in self._pulses:
                    if nozzle == i and open_time[i] > 0.0:
                        flow += self._loss(begin, t, dt)
                used += flow * thrust / (STANDARD_GRAVITY * self.specific_impulse)
        remaining = self.tank - self._propellant
        share = remaining / used if self.tank > 0.0 and used > remaining else 1.0
        for i in range(len(self.thrust)):
            torque, push, _ = self._jets[i]
            if push != ZERO:
                a, b = share * shares[2 * i], share * shares[2 * i + 1]
                for axis in range(3):
                    mean[axis] += a * torque[axis]
                    slope[axis] += b * torque[axis]
                    force[axis] += a * push[axis]
                self._on_time += open_time[i]
                self.record_firing(i, open_time[i])
        self._levels = tuple(levels)
        self._propellant = self.tank if share < 1.0 else self._propellant + used

    def _pressure(self) -> float:
        """Return the tank's pressure relative to that of the start."""
        if self.tank == 0.0:
            return 1.0
        if self._propellant >= self.tank:
            return 0.0
        return 1.0 / (1.0 + (self.blowdown - 1.0) * self._propellant / self.tank)

    def _share(
        self, i: int, level: float, pressure: float, t: float, dt: float
    ) -> tuple[float, float, float, float]:
        """Integrate the share of nozzle i of its thrust over a step.

        Returns mean, slope and end of the share, and how long (s) its valve is open.
        """
        begin = end = t
        for first, last, nozzle, _ in self._pulses:
            if nozzle == i:
                begin, end = first, last
        always = dt
        if i == self.stuck_nozzle - 1:
            if self.stuck == OPEN:
                always = min(max(self.stuck_from - t, 0.0), dt)
            else:
                end = min(end, self.stuck_from)
        on = min(max(begin - t, 0.0), always)
        off = min(max(end - t, on), always)
        goal = pressure
        if self.impulse_scatter > 0.0 and off > on:
            goal *= max(1.0 + self.impulse_scatter * self._draw_pulse_error(i), 0.0)
        mean = slope = 0.0
        for first, last, target, lag in (
            (0.0, on, 0.0, self.decay_time),
            (on, off, goal, self.rise_time),
            (off, always, 0.0, self.decay_time),
            (always, dt, pressure, self.rise_time),
        ):
            if last - first > ROUNDING * dt:  # else a valve would shut between samples
                x, lead, after = target, 0.0, target
                if lag > 0.0:
                    x, lead, after, _ = first_order(level, target, (last - first) / lag)
                a, b = part(first / dt, last / dt, x, lead)
                mean, slope, level = mean + a, slope + b, after
        return mean, slope, level, off - on + dt - always

    def _draw_pulse_error(self, i: int) -> float:
        """Draw the normal number of the pulse of nozzle i at this sample."""
        return normal_pair(self._key, self._sample, 2 * i)[0]
