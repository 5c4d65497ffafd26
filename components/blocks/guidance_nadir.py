from __future__ import annotations

from ..bases.pointing import PointingLaw
from ..contract.block import Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..maths.attitude import normalise, product, rotate
from ..maths.vector import cross, dot, norm, scale
from ..physics.orbit import lvlh_attitude


class GuidanceNadir(PointingLaw):
    """Nadir pointing

        q_ref_bi = q_bo (x) q_oi(r, v)
        omega_ref_body = C(q_bo) (0, -|r x v| / r^2, 0)

    at each sample, held in between. q_oi is the attitude of lvlh (z to nadir, y to
    minus orbit normal); its rate is exact on circular and elliptic Kepler orbits. A
    force across the orbit turns the plane and adds r f / |r x v| about z. This is
    neglected: for the Earth's J2 it is less than 2e-3 of the orbital rate. The sign of
    the quaternion is that of the previous sample.

    Source: paper 004, sec. 3; the rate from the conservation of angular momentum.
    """

    q_bo: Vec4 = Parameter(
        "1",
        "wanted attitude: body from lvlh, scalar last; normalised",
        start=UPRIGHT,
        needs=("r_eci", "v_eci"),
    )

    def start(self) -> None:
        super().start()
        if not any(self.q_bo):
            self.fail("q_bo is zero; it must be a quaternion")
        self._q_bo = normalise(self.q_bo)
        self._axis = rotate(self._q_bo, (0.0, -1.0, 0.0))
        self.start_reference()

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the wanted attitude and rate (rad/s) from position and velocity."""
        r, v = self.r_eci, self.v_eci
        return (
            product(self._q_bo, lvlh_attitude(r, v)),
            scale(norm(cross(r, v)) / dot(r, r), self._axis),
        )
