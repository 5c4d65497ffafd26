from __future__ import annotations

from collections.abc import Iterable
from math import copysign, inf

from ..bases.pulses import Jet, PulsedThrusters
from ..contract.block import Output, Parameter, Vec3
from ..maths.vector import ZERO


class Thrusters(PulsedThrusters):
    """Pulsed thruster pairs, one torque level per body axis

    At each sample the command of an axis becomes a pulse of `tau_level` with the
    command's sign and its impulse over the `sample_time`: n times `least_pulse` long, n
    rounded to the nearest, at most the whole period, and left out where shorter than
    `least_on_time`. Pulses begin at the sample or are centred in the period
    (`placement`). Their edges may fall anywhere inside a step; impulse and first moment
    are exact (mean and slope).

        on_time += sum over the axes
        propellant += (on-time + pulse_loss each pulse) tau_level / (arm g0 I_sp)

    With a `tank` no command is fired once `propellant` has reached it. The step in
    which that happens has the torque of the remaining propellant, as a mean over its
    pulses.

    A pair gives no force. Up to eight scheduled firings (`schedule_...`: for instance
    an orbit manoeuvre) add their torque and force, and count in `schedule_on_time` and
    `schedule_propellant` only:

        schedule_propellant += time |force| / (g0 I_sp)

    Source: Chen & Steyn (paper 000), section VI: +-40 mN m, 50 ms. Arm and specific
    impulse (cold nitrogen) are not in the paper.
    """

    tau_level: Vec3 = Parameter(
        "N.m",
        "torque of each axis while it fires",
        start=0.04,
        min=1e-9,
        usual=(1e-6, 1e3),
    )
    arm: float = Parameter(
        "m",
        "lever arm of the thrusters",
        start=0.4,
        min=1e-3,
        usual=(0.01, 20.0),
    )
    tank: float = Parameter(
        "kg",
        "propellant at the start; 0: without end",
        min=0.0,
        usual=(0.0, 1e4),
    )
    propellant_left: float = Output(
        "kg", "propellant in the tank; 0 where it is without end"
    )

    def output(self, t: float) -> None:
        super().output(t)
        self.propellant_left = max(0.0, self.tank - self._propellant)

    def commanded_on_times(self, period: float) -> Iterable[tuple[float, Jet]]:
        if 0.0 < self.tank <= self._propellant:
            return ()
        return tuple(self._axis(i, period) for i in range(3))

    def propellant_limit(self) -> float:
        return self.tank if self.tank > 0.0 else inf

    def _axis(self, i: int, period: float) -> tuple[float, Jet]:
        """Return the on-time (s) and the effect of axis i for a period (s)."""
        command, level = self.tau_cmd_thruster_body[i], self.tau_level[i]
        torque = copysign(level, command)
        x, y, z = (torque if axis == i else 0.0 for axis in range(3))
        return abs(command) / level * period, ((x, y, z), ZERO, level / self.arm)
