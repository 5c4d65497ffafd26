from __future__ import annotations

from ..bases.known_slew import Slew
from ..bases.pointing import PointingLaw
from ..contract.block import Vec3, Vec4
from ..laws.attitude_control import rest_to_rest
from ..maths.attitude import propagate
from ..maths.vector import scale


class GuidanceSlew(PointingLaw, Slew):
    """Tracked slew about the eigenaxis, rest to rest

        s = 10 u^3 - 15 u^4 + 6 u^5,        u = (t - t_begin) / (t_end - t_begin) in [0, 1]
        q_ref_bi = dq(a s) (x) q_begin,     omega_ref_body = a ds/dt

    at each sample, held in between. a is the shortest rotation vector from `q_begin_bi`
    to `q_end_bi`, or `slew_body` where that is not zero, dq(a) the rotation by |a|
    about a; a has the same components in every frame during the slew. Rate and
    acceleration are zero at both ends; the largest rate is 15/8 of the mean. Before
    `t_begin` and after `t_end` the reference is at rest.

    Source: paper 004, sec. 3 (Figures 6-8: a slew of 1.5 h), which does not give its
    profile; the quintic is ours.
    """

    def start(self) -> None:
        super().start()
        self.start_slew()
        self.q_ref_bi = self._q_begin
        self.start_reference()

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the wanted attitude and rate (rad/s) at t (s)."""
        duration = self.t_end - self.t_begin
        s, rate = rest_to_rest((t - self.t_begin) / duration)
        return (
            propagate(self._q_begin, self._rotation, s),
            scale(rate / duration, self._rotation),
        )
