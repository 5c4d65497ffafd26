"""Provide a slew that is known before a run to the managers that plan for it."""

from __future__ import annotations

from ..contract.block import TURN, Block, Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..laws.attitude_control import eigenaxis
from ..maths.attitude import normalised
from ..maths.vector import ZERO, scale


class KnownSlew(Block):
    """Parameters of a slew, which are those of `guidance_slew`.

    A block calls `start_slew` before it uses `_rotation`, the slew's rotation vector
    (rad, body); without a manoeuvre there is none, and it is zero.
    """

    manoeuvre: bool = Parameter("1", "true: the slew below is planned for")
    q_begin_bi: Vec4 = Parameter("1", "attitude before the slew", start=UPRIGHT)
    q_end_bi: Vec4 = Parameter("1", "attitude after the slew", start=UPRIGHT)
    slew_body: Vec3 = Parameter(
        "rad", "the slew as a rotation vector, body; 0: q_end_bi counts", usual=TURN
    )
    t_begin: float = Parameter("s", "when the slew begins")
    t_end: float = Parameter("s", "when it ends", start=5400.0)

    def start_slew(self) -> None:
        """Compute the slew's rotation; refuse a slew that ends before it begins."""
        self._rotation = ZERO
        if not self.manoeuvre:
            return
        if self.t_end <= self.t_begin:
            self.fail(
                f"t_end = {self.t_end} s must be after t_begin = {self.t_begin} s"
            )
        axis, angle = eigenaxis(normalised(self.q_begin_bi), normalised(self.q_end_bi))
        self._rotation = (
            scale(angle, axis) if self.slew_body == ZERO else self.slew_body
        )
