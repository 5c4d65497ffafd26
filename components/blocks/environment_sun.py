from __future__ import annotations

from math import cos, sin

from ..contract.block import TURN, Parameter, Vec3
from ..contract.roles import Environment
from ..maths.vector import ZERO, dot, norm, scale
from ..physics.earth import ASTRONOMICAL_UNIT, OBLIQUITY
from ..physics.orbit import ellipse_state, mean_motion, perifocal_axes

SUN_MU = 1.32712440018e20  # m3/s2, gravitational parameter of the Sun


class EnvironmentSun(Environment):
    """Deep space: a Kepler orbit about the Sun

    With E - e sin E = M, M = `mean_anomaly` + n t and n = sqrt(mu_sun / a^3)

        r = a (cos E - e) p + a sqrt(1 - e^2) sin E q

    from the Sun, in the axes of eci; the elements are relative to the ecliptic, which
    is inclined to the equator of eci by 23.439 deg. sun_eci = -r / |r|, sunlight = (1
    astronomical unit / |r|)^2. No field, no air, no shadow. r_eci is the position from
    the Sun: the gravity gradient of the Earth must be off in the spacecraft, and that
    of the Sun, 1e-13 N m for 1 kg m2, is not modelled.

    Source: two bodies.
    """

    semi_major_axis: float = Parameter(
        "m", "semi-major axis a", start=ASTRONOMICAL_UNIT, min=1e10, usual=(3e10, 5e12)
    )
    eccentricity: float = Parameter("1", "eccentricity e", min=0.0, max=0.95)
    inclination: float = Parameter(
        "rad", "inclination to the ecliptic", min=0.0, max=3.1415926536
    )
    raan: float = Parameter("rad", "longitude of the ascending node", usual=TURN)
    argument_of_perihelion: float = Parameter(
        "rad", "argument of the perihelion", usual=TURN
    )
    mean_anomaly: float = Parameter("rad", "mean anomaly at t = 0", usual=TURN)

    def start(self) -> None:
        to, ahead = perifocal_axes(
            self.inclination, self.raan, self.argument_of_perihelion
        )
        self._to, self._ahead = _from_ecliptic(to), _from_ecliptic(ahead)
        self._rate = mean_motion(self.semi_major_axis, SUN_MU)
        self.b_eci = self.b_rate_eci = self.b_accel_eci = ZERO
        self.density = 0.0

    def output(self, t: float) -> None:
        self.r_eci, self.v_eci = ellipse_state(
            self.semi_major_axis,
            self.eccentricity,
            self.mean_anomaly + self._rate * t,
            self._rate,
            self._to,
            self._ahead,
        )
        distance = norm(self.r_eci)
        self.sun_eci = scale(-1.0 / distance, self.r_eci)
        self.sunlight = (
            ASTRONOMICAL_UNIT * ASTRONOMICAL_UNIT / dot(self.r_eci, self.r_eci)
        )


def _from_ecliptic(v: Vec3) -> Vec3:
    """Rotate a vector from ecliptic axes to eci."""
    c, s = cos(OBLIQUITY), sin(OBLIQUITY)
    return (v[0], c * v[1] - s * v[2], s * v[1] + c * v[2])
