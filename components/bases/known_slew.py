"""Provide a slew that is known before a run, to guidance and to managers."""

from __future__ import annotations

from ..contract.block import TURN, Block, Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..laws.attitude_control import eigenaxis
from ..maths.attitude import normalise
from ..maths.vector import ZERO, scale


class Slew(Block):
    """Parameters of a slew about one axis, from rest to rest.

    A block calls `start_slew` before it uses `_q_begin`, the attitude before the slew,
    and `_rotation`, the slew's rotation vector (rad, body).
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

    def start_slew(self) -> None:
        """Compute the slew's rotation.

        Refuses a slew that ends before it begins, and a quaternion of zero.
        """
        for name in ("q_begin_bi", "q_end_bi"):
            if not any(getattr(self, name)):
                self.fail(f"{name} is zero; it must be a quaternion")
        if self.t_end <= self.t_begin:
            self.fail(
                f"t_end = {self.t_end} s must be after t_begin = {self.t_begin} s"
            )
        self._q_begin = normalise(self.q_begin_bi)
        axis, angle = eigenaxis(self._q_begin, normalise(self.q_end_bi))
        self._rotation = (
            scale(angle, axis) if self.slew_body == ZERO else self.slew_body
        )


class KnownSlew(Slew):
    """A slew that a manager plans for if `manoeuvre` is true."""

    manoeuvre: bool = Parameter("1", "true: the slew is planned for")

    def start_known_slew(self) -> None:
        """Compute the slew's rotation, which is zero without a manoeuvre."""
        self._q_begin = UPRIGHT
        self._rotation = ZERO
        if self.manoeuvre:
            self.start_slew()
