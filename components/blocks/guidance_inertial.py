from __future__ import annotations

from ..bases.pointing import PointingLaw
from ..contract.block import Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..maths.attitude import normalise
from ..maths.vector import ZERO


class GuidanceInertial(PointingLaw):
    """Inertial pointing

        q_ref_bi = q_target_bi,     omega_ref_body = 0

    Source: paper 004, sec. 3 (Figures 3-5).
    """

    q_target_bi: Vec4 = Parameter(
        "1", "wanted attitude: body from eci, scalar last; normalised", start=UPRIGHT
    )

    def start(self) -> None:
        super().start()
        if not any(self.q_target_bi):
            self.fail("q_target_bi is zero; it must be a quaternion")
        self._target = self.q_ref_bi = normalise(self.q_target_bi)
        self.start_reference()

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Return the target, and no rate (rad/s)."""
        return self._target, ZERO
