from __future__ import annotations

from math import cos, sin

from ..contract.block import TURN, Parameter
from ..contract.roles import Environment
from ..maths.vector import ZERO, add, scale
from ..physics.orbit import EARTH_RADIUS, mean_motion, orbit_plane


class EnvironmentOrbitDipole(Environment):
    """Circular orbit with the dipole field of paper 000, given in the orbital frame

    With u = phase + n t the argument of latitude and lvlh = (x along the velocity, y
    minus orbit normal, z to nadir):

        B_lvlh = (b_x cos u, b_y, b_z sin u)            (eq. 30, which prints mT for microtesla)

    turned to eci, with its first and second time derivative. No Sun, no atmosphere.

    Source: Chen & Steyn, "Optimal Combined Reaction-Wheel Momentum Management for LEO
    Earth-Pointing Satellites", eq. 30.
    """

    altitude: float = Parameter(
        "m",
        "height of the orbit above 6378137 m",
        start=650e3,
        min=100e3,
        usual=(200e3, 2000e3),
    )
    inclination: float = Parameter(
        "rad", "inclination", start=1.7104, min=0.0, max=3.1415926536
    )
    raan: float = Parameter(
        "rad", "right ascension of the ascending node", start=0.0, usual=TURN
    )
    phase: float = Parameter(
        "rad", "argument of latitude at t = 0", start=0.0, usual=TURN
    )
    b_x: float = Parameter("T", "eq. 30, amplitude along the velocity", start=23e-6)
    b_z: float = Parameter("T", "eq. 30, amplitude to nadir", start=46e-6)
    paper_b_y: float = Parameter(
        "T",
        "eq. 30, constant part along minus orbit normal; as printed and physical +2.4e-6, but only "
        "-2.4e-6 reproduces the paper's tables",
        start=2.4e-6,
    )

    def start(self) -> None:
        radius = EARTH_RADIUS + self.altitude
        self._radius, self._rate = radius, mean_motion(radius)
        self._node, self._ahead, self._normal = orbit_plane(self.inclination, self.raan)
        # the paper has neither Sun nor atmosphere
        self.sun_eci, self.sunlight, self.density = (ZERO, 0.0, 0.0)

    def output(self, t: float) -> None:
        """Set orbit (m, m/s) and field (T) with two derivatives, eci, at t (s)."""
        n = self._rate
        u = self.phase + n * t
        c, s = cos(u), sin(u)
        up = add(scale(c, self._node), scale(s, self._ahead))
        along = add(scale(-s, self._node), scale(c, self._ahead))
        self.r_eci = scale(self._radius, up)
        self.v_eci = scale(self._radius * n, along)
        in_plane = add(scale(self.b_x * c, along), scale(-self.b_z * s, up))
        self.b_eci = add(in_plane, scale(-self.paper_b_y, self._normal))
        both = self.b_x + self.b_z
        self.b_rate_eci = add(scale(-n * both * s, along), scale(-n * both * c, up))
        self.b_accel_eci = add(
            scale(-2.0 * n * n * both * c, along), scale(2.0 * n * n * both * s, up)
        )
