from __future__ import annotations

from math import cos, radians, sin, sqrt

from ..contract.block import TURN, Parameter, Vec3
from ..contract.roles import Environment
from ..maths.vector import ZERO, add, cross, mat_t_vec, norm, scale, unit
from ..physics import earth
from ..physics.orbit import (
    Drift,
    Elements,
    drifting_state,
    ellipse_state,
    mean_motion,
    perifocal_axes,
)

MOON, MARS = range(2)
# Of each body: gravitational parameter (m3/s2), radius (m), J2, and right ascension and
# declination (deg) of its pole: IAU WGCCRE 2015, GRAIL (GL0660B) and MRO (MRO110C).
BODIES = (
    (4.902800066e12, 1.7380e6, 2.0330e-4, 269.9949, 66.5392),
    (4.282837362e13, 3.39619e6, 1.95661e-3, 317.681, 52.886),
)
# Mars about the Sun, J2000 ecliptic: elements at J2000 and their change in a century
# (Standish, Keplerian elements for approximate positions, 1800 to 2050): axis (AU), e,
# inclination, mean longitude, longitude of perihelion and of the node (deg).
MARS_ORBIT = (
    (1.52371034, 1.847e-5),
    (0.0933941, 7.882e-5),
    (1.84969142, -8.13131e-3),
    (-4.55343205, 19140.30268499),
    (-23.94362959, 0.44441088),
    (49.55953891, -0.29257343),
)
CENTURY = 36525.0 * 86400.0  # s


class EnvironmentPlanet(Environment):
    """An orbit about the Moon or Mars, with the Sun and the body's shadow

    With E - e sin E = M, M = `mean_anomaly` + n t and n = sqrt(mu / a^3)

        r = a (cos E - e) p + a sqrt(1 - e^2) sin E q

    from the body's centre. The elements are relative to the body's equator, whose node
    on the equator of J2000 begins `raan`; r is in the axes of J2000. With `j2` raan,
    argument and M drift at the secular rates of the body's oblateness, as in
    environment_kepler with its J2 and radius; C22 of the Moon has no secular effect of
    first order, and its periodic one is left out.

    The Sun is seen from the Earth for the Moon, which is off by 0.15 deg at most, and
    from Mars by that planet's mean elements, some 0.02 deg. `sunlight` is the visible
    share of its disc behind the sphere of the body, times (1 astronomical unit /
    distance)^2. There is no field and no air: the Moon has neither, and Mars's crustal
    fields and upper atmosphere are not modelled.

    Source: two bodies; Vallado, Fundamentals of Astrodynamics and Applications, section
    9.6; Montenbruck & Gill, Satellite Orbits, section 3.4.2.
    """

    body: int = Parameter(
        "1", "about what the craft orbits", choices=("moon", "mars"), start="moon"
    )
    epoch_j2000: float = Parameter(
        "s",
        "UTC of t = 0: seconds since 2000-01-01T12:00:00 UTC, leap seconds not counted",
        start=820497600.0,
        min=-3.2e9,
        max=3.2e9,
    )
    semi_major_axis: float = Parameter(
        "m", "semi-major axis a", start=1.838e6, min=1.7e6, usual=(1.7e6, 1e9)
    )
    eccentricity: float = Parameter("1", "eccentricity e", min=0.0, max=0.95)
    inclination: float = Parameter(
        "rad", "inclination to the body's equator", min=0.0, max=3.1415926536
    )
    raan: float = Parameter(
        "rad", "ascending node, from the node of the body's equator", usual=TURN
    )
    argument_of_periapsis: float = Parameter(
        "rad", "argument of the periapsis", usual=TURN
    )
    mean_anomaly: float = Parameter("rad", "mean anomaly at t = 0", usual=TURN)
    j2: bool = Parameter("1", "true: secular drift of the elements by J2", start=True)

    def start(self) -> None:
        """Set the body, its axes and the drift of the orbit."""
        mu, radius, j2, ascension, declination = BODIES[self.body]
        self._mu, self._radius = mu, radius
        pole_at, pole_up = radians(ascension), radians(declination)
        pole: Vec3 = (
            cos(pole_up) * cos(pole_at),
            cos(pole_up) * sin(pole_at),
            sin(pole_up),
        )
        node = unit(cross((0.0, 0.0, 1.0), pole))
        self._axes: tuple[Vec3, Vec3, Vec3] = (node, cross(pole, node), pole)
        a, e = self.semi_major_axis, self.eccentricity
        if a * (1.0 - e) < radius:
            self.fail(
                f"semi_major_axis = {a:g} m with eccentricity = {e:g}: the periapsis at "
                f"{a * (1.0 - e):g} m is inside the body, {radius:g} m"
            )
        c, shape = cos(self.inclination), 1.0 - e * e
        k = 0.75 * mean_motion(a, mu) * j2 * (radius / (a * shape)) ** 2
        self._drift: tuple[float, float, float] = (
            -2.0 * k * c,
            k * (5.0 * c * c - 1.0),
            k * sqrt(shape) * (3.0 * c * c - 1.0),
        )
        self.b_eci = self.b_rate_eci = self.b_accel_eci = ZERO
        self.density = 0.0

    def output(self, t: float) -> None:
        """Set position (m), velocity (m/s) and the Sun at t (s)."""
        self.r_eci, self.v_eci = self.motion(t)
        to_sun = self._sun(self.epoch_j2000 + t)
        distance = norm(to_sun)
        self.sun_eci = scale(1.0 / distance, to_sun)
        visible = earth.sunlight(self.r_eci, self.sun_eci, distance, self._radius)
        self.sunlight = visible * (earth.ASTRONOMICAL_UNIT / distance) ** 2

    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        """Compute position (m) and velocity (m/s), eci, at t (s)."""
        a, e, i = self.semi_major_axis, self.eccentricity, self.inclination
        if self.j2:
            elements = Elements(
                a, e, i, self.raan, self.argument_of_periapsis, self.mean_anomaly
            )
            raan, argument, anomaly = self._drift
            drift = Drift(raan, argument, anomaly)
            r, v = drifting_state(elements, drift, t, self._mu)
        else:
            n = mean_motion(a, self._mu)
            to, ahead = perifocal_axes(i, self.raan, self.argument_of_periapsis)
            r, v = ellipse_state(a, e, self.mean_anomaly + n * t, n, to, ahead)
        return self._to_eci(r), self._to_eci(v)

    def _to_eci(self, x: Vec3) -> Vec3:
        """Rotate a vector from the body's equator to eci."""
        node, along, pole = self._axes
        return add(add(scale(x[0], node), scale(x[1], along)), scale(x[2], pole))

    def _sun(self, epoch: float) -> Vec3:
        """Compute the vector (m) from the body to the Sun, eci."""
        if self.body == MOON:
            of_date, distance = earth.sun(epoch)
            return scale(distance, mat_t_vec(earth.precession(epoch), of_date))
        t = epoch / CENTURY
        axis, e, i, longitude, perihelion, node = (x + y * t for x, y in MARS_ORBIT)
        argument = radians(perihelion - node)
        to, ahead = perifocal_axes(radians(i), radians(node), argument)
        place, _ = ellipse_state(
            axis * earth.ASTRONOMICAL_UNIT,
            e,
            radians(longitude - perihelion),
            1.0,
            to,
            ahead,
        )
        c, s = cos(earth.OBLIQUITY), sin(earth.OBLIQUITY)
        x, y, z = place
        return (-x, -(c * y - s * z), -(s * y + c * z))
