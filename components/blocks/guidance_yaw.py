from __future__ import annotations

from math import atan2, cos, remainder, sin, sqrt, tau

from ..bases.pointing import PointingLaw
from ..contract.block import Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..maths.attitude import normalise, product, rotate
from ..maths.vector import cross, dot, norm
from ..physics.orbit import lvlh_attitude


class GuidanceYaw(PointingLaw):
    """Yaw steering: nadir pointing with a panel's axis kept perpendicular to the Sun

    With s = (s_x, s_y, s_z) the unit vector to the Sun in lvlh (z to nadir, y to minus
    orbit normal) and n = |r x v| / r^2, the craft is turned from lvlh by

        psi = atan2(s_y, s_x),     psi' = -n s_y s_z / (s_x^2 + s_y^2)

    about z, at each sample, held in between: the Sun lies in the plane of x and z, on the side of
    +x, and a panel that turns about y faces it. `q_bf` turns the body from that frame.

    Where the Sun is near the orbital plane, psi changes by up to half a turn at noon
    and midnight. The reference follows with rates up to `rate_limit` and accelerations
    up to `acceleration_limit`. While it lags psi by b, its rate is psi' +
    sqrt(acceleration_limit |b|) towards psi, or psi' + b / (10 steps) where that is
    less.

    Source: geometry; the convention is that of GPS block II (Bar-Sever, J. Geodesy 70
    (1996) 714).
    """

    q_bf: Vec4 = Parameter(
        "1",
        "attitude of the body from the steered frame, scalar last; normalised",
        start=UPRIGHT,
        needs=("r_eci", "v_eci", "sun_eci"),
    )
    rate_limit: float = Parameter(
        "rad/s", "largest rate about nadir", start=5e-3, min=1e-6, usual=(1e-5, 0.05)
    )
    acceleration_limit: float = Parameter(
        "rad/s2",
        "largest acceleration about nadir",
        start=1e-5,
        min=1e-10,
        usual=(1e-9, 1e-3),
    )

    def start(self) -> None:
        super().start()
        if not any(self.q_bf):
            self.fail("q_bf is zero; it must be a quaternion")
        self._q_bf = normalise(self.q_bf)
        self._last = 0.0
        self._yaw = self._rate = 0.0
        self._has_begun = False
        self.start_reference()

    def point(self, t: float) -> tuple[Vec4, Vec3]:
        """Compute the wanted attitude and rate (rad/s) at t (s).

        The yaw follows within its limits of rate and acceleration.
        """
        if norm(self.sun_eci) == 0.0:
            self.fail("sun_eci is zero: no Sun is modelled")
        r, v = self.r_eci, self.v_eci
        lvlh = lvlh_attitude(r, v)
        rate = norm(cross(r, v)) / dot(r, r)
        x, y, z = rotate(lvlh, self.sun_eci)
        across = sqrt(x * x + y * y)
        yaw = atan2(y, x) if across > 0.0 else self._yaw
        turning = -rate * y * z / (across * across) if across > 1e-9 else 0.0
        turning = self._within(turning, self.rate_limit)
        if self._has_begun and t > self._last:
            since = t - self._last
            self._yaw += since * self._rate
            behind = remainder(yaw - self._yaw, tau)
            after = sqrt(self.acceleration_limit * abs(behind))
            turning = self._within(
                turning + self._within(behind / (10.0 * since), after), self.rate_limit
            )
            most = since * self.acceleration_limit
            self._rate += self._within(turning - self._rate, most)
        elif not self._has_begun:
            self._has_begun, self._yaw, self._rate = True, yaw, turning
        self._last = t
        half = 0.5 * self._yaw
        q_yaw = product((0.0, 0.0, sin(half), cos(half)), lvlh)
        # the orbital rate points along minus y of lvlh
        c, s = cos(self._yaw), sin(self._yaw)
        return (
            product(self._q_bf, q_yaw),
            rotate(self._q_bf, (-rate * s, -rate * c, self._rate)),
        )

    def _within(self, x: float, most: float) -> float:
        """Limit x to +-most."""
        return min(max(x, -most), most)
