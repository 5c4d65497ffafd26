"""Provide the base of guidance blocks: a law, and the reference held between its samples."""

from __future__ import annotations

from abc import abstractmethod

from ..contract.block import Output, Vec3, Vec4
from ..contract.roles import UPRIGHT, Guidance
from ..maths.attitude import nearest
from ..maths.vector import ZERO


class PointingLaw(Guidance):
    """Base of guidance blocks; a block adds the law, `point`.

    The wanted attitude is the law's at every step. Reference attitude and rate are the
    law's at the samples, held in between, with the sign of the previous sample.
    """

    q_wanted_bi: Vec4 = Output(
        "1",
        "attitude that the law wants at this step, whose samples the reference holds",
        interval=True,
        starts_from=("r_eci", "v_eci", "sun_eci"),
    )

    def start(self) -> None:
        """Set the reference to its start value."""
        super().start()
        self.q_ref_bi, self.omega_ref_body = UPRIGHT, ZERO

    def start_reference(self) -> None:
        """Evaluate the law at the start, once the block has set what it needs."""
        q, rate = self.point(0.0)
        self.q_ref_bi = self.q_wanted_bi = nearest(q, self.q_ref_bi)
        self.omega_ref_body = rate

    def advance(self, t: float, dt: float) -> None:
        """Evaluate the law, and take a sample of it where one is due."""
        q, rate = self.point(t)
        self.q_wanted_bi = nearest(q, self.q_wanted_bi)
        if self.due(t):
            self.q_ref_bi = nearest(q, self.q_ref_bi)
            self.omega_ref_body = rate

    @abstractmethod
    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute attitude (body from eci) and rate (rad/s, its frame) wanted at t (s)."""
