from __future__ import annotations

from ..contract.block import TURN, Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT, Guidance
from ..laws.attitude_control import eigenaxis, rest_to_rest
from ..maths.attitude import normalised, propagated
from ..maths.vector import ZERO, scale


class GuidanceSlew(Guidance):
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

    q_begin_bi: Vec4 = Parameter(
        "1", "attitude before: body from eci, scalar last; normalised", start=UPRIGHT
    )
    q_end_bi: Vec4 = Parameter(
        "1", "attitude after: body from eci, scalar last; normalised", start=UPRIGHT
    )
    slew_body: Vec3 = Parameter(
        "rad",
        "the slew as a rotation vector, body, in place of q_end_bi; 0: q_end_bi counts",
        usual=TURN,
    )
    t_begin: float = Parameter("s", "time at which the slew begins")
    t_end: float = Parameter("s", "time at which it ends, after t_begin", start=5400.0)

    def start(self) -> None:
        super().start()
        for name in ("q_begin_bi", "q_end_bi"):
            if not any(getattr(self, name)):
                self.fail(f"{name} is zero; it must be a quaternion")
        if self.t_end <= self.t_begin:
            self.fail(
                f"t_end = {self.t_end} s must be after t_begin = {self.t_begin} s"
            )
        self._q_begin = normalised(self.q_begin_bi)
        axis, angle = eigenaxis(self._q_begin, normalised(self.q_end_bi))
        self._rotation = (
            scale(angle, axis) if self.slew_body == ZERO else self.slew_body
        )
        self._point(0.0)

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            self._point(t)

    def _point(self, t: float) -> None:
        """Set the reference attitude and rate at t (s)."""
        duration = self.t_end - self.t_begin
        s, rate = rest_to_rest((t - self.t_begin) / duration)
        self.q_ref_bi = propagated(self._q_begin, self._rotation, s)
        self.omega_ref_body = scale(rate / duration, self._rotation)
