from __future__ import annotations

from collections.abc import Iterable

from ..bases.pulses import PulsedThrusters
from ..contract.block import Parameter, Table, Vec3
from ..maths.allocation import least_on_times
from ..maths.vector import ZERO, cross, norm, scale

NOZZLES = 8


class ThrustersNozzles(PulsedThrusters):
    """Pulsed thrusters: up to eight nozzles anywhere on the body

    Nozzle i at r_i with the force F_i = thrust_i direction_i on the body has the torque r_i x F_i.
    At each sample the on-times x_i follow from the linear programme

        minimise sum x_i,   sum x_i (r_i x F_i) = sample_time tau_cmd,   0 <= x_i <= sample_time

    and where the nozzles cannot give that impulse, the error's 1-norm is minimised first. Each
    on-time is rounded to the nearest multiple of `least_pulse` and left out where shorter than
    `least_on_time`. Pulses begin at the sample or are centred in the period (`placement`). Their
    edges may fall anywhere inside a step; impulse and first moment are exact (mean and slope).

        on_time += sum over the nozzles;  propellant += on-time thrust / (g0 I_sp)

    Up to eight scheduled firings (`schedule_...`: an orbit manoeuvre's disturbance, say) add their
    torques, and count in `schedule_on_time` only. The force on the orbit is not modelled.

    The default is six nozzles of 0.1 N at 0.4 m: 40 mN m about each axis, one nozzle each way.

    Source: Crawford, AIAA 69-845 (1969), for the programme.
    """

    position_nozzle: Table = Parameter(
        "m", "position of each nozzle from the centre of mass, body", shape=(NOZZLES, 3),
        start=(
            (0.0, 0.4, 0.0), (0.0, -0.4, 0.0), (-0.4, 0.0, 0.0), (0.4, 0.0, 0.0),
            (0.4, 0.0, 0.0), (0.4, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
        ),
    )  # fmt: skip
    direction_nozzle: Table = Parameter(
        "1", "direction of each nozzle's force on the body, unit vector; zero: no nozzle",
        shape=(NOZZLES, 3),
        start=(
            (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0),
            (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0),
        ),
    )  # fmt: skip
    thrust: Table = Parameter("N", "thrust of each nozzle", shape=(NOZZLES,), start=0.1, min=0.0)

    def start(self) -> None:
        super().start()
        self._torques = tuple(self._torque(i) for i in range(NOZZLES))

    def _torque(self, i: int) -> Vec3:
        x, y, z = self.direction_nozzle[3 * i : 3 * i + 3]
        if (x, y, z) != ZERO and abs(norm((x, y, z)) - 1.0) > 1e-6:
            self.fail(f"direction_nozzle: row {i + 1} = {(x, y, z)} is not a unit vector")
        px, py, pz = self.position_nozzle[3 * i : 3 * i + 3]
        return cross((px, py, pz), scale(self.thrust[i], (x, y, z)))

    def wanted(self, period: float) -> Iterable[tuple[float, Vec3, float]]:
        impulse = scale(period, self.tau_cmd_thruster_body)
        on_times = least_on_times(self._torques, impulse, period)
        return zip(on_times, self._torques, self.thrust, strict=True)
