from __future__ import annotations

from ..bases.near_earth import NearEarth
from ..contract.block import Parameter, Vec3
from ..physics.orbit import (
    EARTH_RADIUS,
    MU,
    Drift,
    Elements,
    drifting_state,
    ellipse_state,
    j2_drift,
    mean_motion,
    perifocal_axes,
)


class EnvironmentKepler(NearEarth):
    """Kepler orbit with the Earth's field, Sun, eclipse and atmosphere

    With E - e sin E = M, M = `mean_anomaly` + n t and n = sqrt(mu / a^3)

        r = a (cos E - e) p + a sqrt(1 - e^2) sin E q

    in closed form; p points to the perigee, q 90 deg ahead. `eci` is the frame of the equator and
    the equinox of the epoch.

    With `j2` the elements are mean elements, and raan, argument of perigee and M drift at the
    secular rates of the Earth's oblateness (first order; Vallado, Fundamentals of Astrodynamics and
    Applications, section 9.6)

        raan' = -3/2 k n cos i,  arg' = 3/4 k n (5 cos^2 i - 1),
        M' = n + 3/4 k n sqrt(1 - e^2) (3 cos^2 i - 1),  k = J2 (R / (a (1 - e^2)))^2;

    the periodic part, some km, is left out. v is the time derivative of r either way.
    """

    semi_major_axis: float = Parameter("m", "semi-major axis a", start=6928137.0, min=6.4e6)
    eccentricity: float = Parameter("1", "eccentricity e", start=0.0, min=0.0, max=0.95)
    inclination: float = Parameter("rad", "inclination i", start=1.7033, min=0.0, max=3.1415926536)
    raan: float = Parameter("rad", "right ascension of the ascending node at t = 0")
    argument_of_perigee: float = Parameter("rad", "argument of perigee at t = 0")
    mean_anomaly: float = Parameter("rad", "mean anomaly at t = 0")
    j2: bool = Parameter("1", "true: mean elements with the secular drift of J2")
    mu: float = Parameter("m3/s2", "gravitational parameter of the Earth", start=MU, min=1e14)

    def start(self) -> None:
        super().start()
        a, e, i = self.semi_major_axis, self.eccentricity, self.inclination
        if a * (1.0 - e) < EARTH_RADIUS:
            self.fail(
                f"semi_major_axis = {a:g} m with eccentricity = {e:g}: the perigee at "
                f"{a * (1.0 - e):g} m is inside the Earth, {EARTH_RADIUS:g} m"
            )
        self._mean_motion = mean_motion(a, self.mu)
        self._to_perigee, self._ahead = perifocal_axes(i, self.raan, self.argument_of_perigee)
        self._drift = tuple(j2_drift(a, e, i, self.mu))

    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        a, e = self.semi_major_axis, self.eccentricity
        if self.j2:
            elements = Elements(
                a, e, self.inclination, self.raan, self.argument_of_perigee, self.mean_anomaly
            )
            return drifting_state(elements, Drift(*self._drift), t, self.mu)
        n = self._mean_motion
        return ellipse_state(a, e, self.mean_anomaly + n * t, n, self._to_perigee, self._ahead)
