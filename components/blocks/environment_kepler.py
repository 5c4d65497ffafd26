from __future__ import annotations

from ..bases.near_earth import NearEarth
from ..bases.orbit_start import MEAN, OrbitStart
from ..contract.block import Parameter, Vec3
from ..physics.orbit import (
    Drift,
    Elements,
    drifting_state,
    ellipse_state,
    j2_drift,
    mean_motion,
    perifocal_axes,
)

DEGREE = 4  # of the zonal harmonics in which osculating elements are averaged


class EnvironmentKepler(NearEarth, OrbitStart):
    """Kepler orbit with the Earth's field, Sun, eclipse and atmosphere

    With E - e sin E = M, M = `mean_anomaly` + n t and n = sqrt(mu / a^3)

        r = a (cos E - e) p + a sqrt(1 - e^2) sin E q

    in closed form; p points to the perigee, q 90 deg ahead.

    With `j2` the Earth is oblate: raan, argument of perigee and M of the mean elements
    drift at the secular rates of its oblateness (first order; Vallado, Fundamentals of
    Astrodynamics and Applications, section 9.6)

        raan' = -3/2 k n cos i,  arg' = 3/4 k n (5 cos^2 i - 1),
        M' = n + 3/4 k n sqrt(1 - e^2) (3 cos^2 i - 1),  k = J2 (R / (a (1 - e^2)))^2;

    the periodic part, some km, is neglected. Osculating elements, or position and
    velocity, are first averaged over a revolution integrated with J2 to J4. If they
    were used as mean ones, the position would be off by 50 to 100 km after a revolution
    in a low orbit. environment_propagated includes the periodic part. v is the time
    derivative of r in both cases.
    """

    j2: bool = Parameter("1", "true: secular drift of the mean elements by J2")

    def start(self) -> None:
        super().start()
        elements = self.start_elements(DEGREE if self.j2 else 1, MEAN)
        a, e, i, raan, perigee, _ = elements
        self._elements = tuple(elements)
        self._mean_motion = mean_motion(a, self.mu)
        self._to_perigee, self._ahead = perifocal_axes(i, raan, perigee)
        self._drift = tuple(j2_drift(a, e, i, self.mu))

    def size(self) -> tuple[float, float]:
        return self.start_size()

    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        if self.j2:
            return drifting_state(
                Elements(*self._elements), Drift(*self._drift), t, self.mu
            )
        a, e, _, _, _, anomaly = self._elements
        n = self._mean_motion
        return ellipse_state(a, e, anomaly + n * t, n, self._to_perigee, self._ahead)
