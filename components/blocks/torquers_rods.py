from __future__ import annotations

from collections.abc import Iterator
from math import copysign, log

from ..contract.block import Parameter, Vec3, Vec4
from ..maths.moments import part
from ..physics.rod import DEMAGNETISED, Plays, dipole, over, warm
from ..physics.wheel_array import body_momentum
from .torquers import IDEAL, Torquers

CURRENT, VOLTAGE = range(2)
# A target so near the limit of the supply, relative to it, is only approached.
NEAR = 1e-9


class TorquersRods(Torquers):
    """Magnetic torquers with their core, winding and supply

    As `torquers`, but a coil's current i, expressed as the dipole x = area_turns i,
    follows its command u through a winding of `inductance` L and the resistance at its
    `temperature`,

        R = resistance (1 + temperature_coefficient (temperature - 293.15 K))

    from a bridge of +-supply_voltage V, which can hold at most X = area_turns V / R.
    With `regulation` of the `current` the full voltage is on the coil until the current
    is reached. With that of the `voltage`, the coil has the voltage that a coil of
    `resistance` would need, so that a warm one has less current:

        current:  x' = (+-X - x) R / L until x = u;     voltage:  x' = (u resistance / R - x) R / L

    Without a supply_voltage the current follows by `lag`, as in `torquers`.

    By hysteresis of the core, the fraction `remanence` of m_limit remains when the
    current has gone from m_limit to zero; the core begins demagnetised. With N = 8
    plays p_k of half widths r_k = (k - 1/2) m_limit / N, Rayleigh's law as N grows:

        m = (1 - 2 remanence) x + 4 remanence / N sum_k p_k
        p_k <- min(max(p_k, x - r_k), x + r_k)

    The remanent dipole acts like any other: at the end of the quiet time, where a
    magnetometer measures it, in m_body, and in a dead coil. The solution is exact over
    a step of any length. dipole_energy follows from m, electric_energy from i and R.

    Source: Rayleigh, Phil. Mag. 23 (1887) 225; Brokate & Sprekels, Hysteresis and Phase
    Transitions (1996), ch. 2, for the plays; copper's coefficient, 0.00393 1/K at 293
    K: IEC 60028.
    """

    remanence: float = Parameter(
        "1",
        "share of m_limit that is left when the current has gone from it to none; 0: no core",
        min=0.0,
        max=0.5,
        usual=(0.0, 0.1),
    )
    supply_voltage: float = Parameter(
        "V",
        "what the bridge can put on a coil; 0: any, and the current follows by lag",
        min=0.0,
        usual=(0.0, 200.0),
    )
    regulation: int = Parameter(
        "1",
        "what the bridge holds, with a supply_voltage",
        choices=("current", "voltage"),
        start="current",
    )
    inductance: float = Parameter(
        "H",
        "inductance of each coil, with a supply_voltage",
        min=0.0,
        usual=(0.0, 100.0),
    )
    temperature: float = Parameter(
        "K",
        "temperature of the windings",
        start=293.15,
        min=1.0,
        usual=(173.15, 423.15),
    )
    temperature_coefficient: float = Parameter(
        "1/K",
        "relative change of the resistance with temperature, at 293.15 K",
        start=0.00393,
        min=0.0,
        usual=(0.0, 0.01),
    )

    def start(self) -> None:
        """Check the circuit; compute resistance (Ohm), lag (s) and limit (A m2)."""
        super().start()
        if warm(1.0, self.temperature, self.temperature_coefficient) <= 0.0:
            self.fail(
                f"temperature = {self.temperature} K: with temperature_coefficient = "
                f"{self.temperature_coefficient} 1/K the resistance is not above 0"
            )
        if self.remanence > 0.0 and (self.drive == IDEAL or self.m_limit == 0.0):
            self.fail(
                f"remanence = {self.remanence} is a share of m_limit: it needs one above 0, "
                "and a drive that keeps it (limited, pulsed)"
            )
        self._ohm = warm(
            self.resistance, self.temperature, self.temperature_coefficient
        )
        self._most = 0.0  # A m2, limit by the supply; 0: none
        self._time_constant = self.lag
        if self.supply_voltage > 0.0:
            if self._ohm == 0.0:
                self.fail(
                    "resistance = 0 Ohm: with a supply_voltage the coils need one"
                )
            if self.lag > 0.0:
                self.fail(
                    f"lag = {self.lag} s beside a supply_voltage: the inductance says how "
                    "the current rises, give 0"
                )
            self._most = self.area_turns * self.supply_voltage / self._ohm
            self._time_constant = self.inductance / self._ohm
        elif self.inductance > 0.0:
            self.fail(
                f"inductance = {self.inductance} H needs a supply_voltage above 0"
            )
        self._share = self.resistance / self._ohm if self.regulation == VOLTAGE else 1.0
        self._plays: tuple[Plays, ...] = (DEMAGNETISED,) * 4
        self._dipoles: Vec4 = (0.0, 0.0, 0.0, 0.0)
        self._heat = 0.0

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        if 0.0 < self._most < self.m_limit:
            yield (
                f"supply_voltage = {self.supply_voltage:g} V holds {self._most:.3g} A m2 at "
                f"{self.temperature:g} K, less than m_limit = {self.m_limit:g} A m2"
            )
        yield from super().foresee(begin, end, wired_names)

    def output(self, t: float) -> None:
        super().output(t)
        a, b, c, d = self._m
        joule = self._ohm / (self.area_turns * self.area_turns)
        self.power = joule * (a * a + b * b + c * c + d * d)
        self.electric_energy = joule * self._heat
        self.m_coil = self._dipoles
        self.m_body = body_momentum(self.axes_coil, self._dipoles)

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            self._take(t)
        mean, slope, self._m = zip(
            *[self._rod(i, t, dt) for i in range(4)], strict=True
        )
        self.m_mean_body = body_momentum(self.axes_coil, mean)
        self.m_slope_body = body_momentum(self.axes_coil, slope)
        self._dipoles = (
            dipole(self._m[0], self._plays[0], self.remanence),
            dipole(self._m[1], self._plays[1], self.remanence),
            dipole(self._m[2], self._plays[2], self.remanence),
            dipole(self._m[3], self._plays[3], self.remanence),
        )

    def _rod(self, i: int, t: float, dt: float) -> Vec3:
        """Integrate coil i over a step: mean and slope of its dipole (A m2).

        The third result is the current at the end (A m2).
        """
        u, x, plays = self._command[i], self._m[i], self._plays[i]
        alive = self._alive(i, t, dt)
        on = min(max(self._begin - t, 0.0), alive)
        off = max(min(self._end[i] - t, alive), on)
        self._on_time += off - on if u != 0.0 else 0.0
        mean = slope = 0.0
        # off, on, off, and dead, when no current is driven
        for first, last, target, lag in (
            (0.0, on, 0.0, self._time_constant),
            (on, off, self._limit_current(u), self._time_constant),
            (off, alive, 0.0, self._time_constant),
            (alive, dt, 0.0, 0.0),
        ):
            there, towards = self._way(x, target, lag, first, last)
            for begin, end, aim, slow in (
                (first, there, towards, lag),
                (there, last, target, 0.0),
            ):
                if end > begin:
                    (share, lead, energy, heat, x), plays = over(
                        plays, x, aim, slow, end - begin, self.m_limit, self.remanence
                    )
                    share, lead = part(begin / dt, end / dt, share, lead)
                    mean, slope = mean + share, slope + lead
                    self._energy += 0.5 * energy * (end - begin)
                    self._heat += heat * (end - begin)
        a, b, c, d = self._plays
        self._plays = (
            plays if i == 0 else a,
            plays if i == 1 else b,
            plays if i == 2 else c,
            plays if i == 3 else d,
        )
        return mean, slope, x

    def _limit_current(self, command: float) -> float:
        """Limit a command (A m2) to the current (A m2) that the bridge reaches."""
        x = self._share * command
        return min(max(x, -self._most), self._most) if self._most > 0.0 else x

    def _way(
        self, x: float, target: float, lag: float, first: float, last: float
    ) -> tuple[float, float]:
        """Compute when (s) a current that leaves x (A m2) at `first` is at its target.

        The time is at most `last`. Also returns the value (A m2) that the current tends
        to until then.
        """
        if lag <= 0.0 or x == target:
            return first, target
        full = copysign(self._most, target - x)
        if self._most == 0.0 or self.regulation == VOLTAGE:
            return last, target
        if abs(full - target) <= NEAR * self._most:
            return last, full
        return min(first + lag * log((full - x) / (full - target)), last), full
