from __future__ import annotations

from ..bases.pulses import ENTRIES, Jet
from ..contract.block import TURN, Parameter, Table, Vec3
from ..laws.firing import overlap
from ..maths.vector import mat_vec, rotation_about, scale
from .thrusters import Thrusters


class ThrustersMisaligned(Thrusters):
    """Thrusters whose scheduled firings are not quite what is known of them

    As `thrusters`, but the torque of the scheduled firing i is

        tau_i = (1 + scale_error) (1 + schedule_scale_error_i)
                R(schedule_turn_i) R(turn_body) schedule_tau_body_i

    where R(a) turns by |a| about a. There is a common error of all firings, and an
    additional one of each. `schedule_start`, `_duration` and `_tau_body` are the
    nominal values, the same in all components that know them (`shared`). Two
    simultaneous scheduled firings are refused.

    Source: ours; paper 000, section VI, for the pulses.
    """

    schedule_start: Table = Parameter(
        "s", "scheduled firings: when each begins", shape=(ENTRIES,), shared=True
    )
    schedule_duration: Table = Parameter(
        "s",
        "scheduled firings: how long; 0: none",
        shape=(ENTRIES,),
        min=0.0,
        shared=True,
        needs=("tau_mean_thruster_body", "tau_slope_thruster_body"),
    )
    schedule_tau_body: Table = Parameter(
        "N.m",
        "scheduled firings: torque of each on the body as it is known, body",
        shape=(ENTRIES, 3),
        shared=True,
        usual=(-100.0, 100.0),
    )
    scale_error: float = Parameter(
        "1",
        "of all scheduled firings: true over known torque, less 1",
        min=-1.0,
        usual=(-0.5, 0.5),
    )
    turn_body: Vec3 = Parameter(
        "rad",
        "of all scheduled firings: rotation from the known to the true torque, body",
        usual=TURN,
    )
    schedule_scale_error: Table = Parameter(
        "1",
        "of each beyond that: true over known torque, less 1",
        shape=(ENTRIES,),
        min=-1.0,
        usual=(-0.5, 0.5),
    )
    schedule_turn_body: Table = Parameter(
        "rad",
        "of each beyond that: rotation, body",
        shape=(ENTRIES, 3),
        usual=TURN,
    )

    def start(self) -> None:
        super().start()
        for i in range(ENTRIES):
            for j in range(i):
                start, other = self.schedule_start[i], self.schedule_start[j]
                lasts, long = self.schedule_duration[i], self.schedule_duration[j]
                if overlap(start, lasts, other, long) > 0.0:
                    self.fail(
                        f"schedule_start[{i + 1}] = {start:g} s for {lasts:g} s overlaps firing "
                        f"{j + 1}, {other:g} s to {other + long:g} s; one at a time"
                    )

    def scheduled_jet(self, i: int) -> Jet:
        torque, force, thrust = super().scheduled_jet(i)
        x, y, z = self.schedule_turn_body[3 * i : 3 * i + 3]
        share = (1.0 + self.scale_error) * (1.0 + self.schedule_scale_error[i])
        torque = _rotate(torque, self.turn_body)
        return scale(share, _rotate(torque, (x, y, z))), force, thrust


def _rotate(v: Vec3, a: Vec3) -> Vec3:
    """Rotate v by |a| (rad) about a."""
    return mat_vec(rotation_about(a, 1.0), v)
