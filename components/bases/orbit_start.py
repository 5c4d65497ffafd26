"""Provide the start of an orbit to environments that compute their own."""

from __future__ import annotations

from ..contract.block import TURN, Block, Parameter, Vec3
from ..maths.vector import mat_vec
from ..physics import averaging, earth
from ..physics.orbit import (
    EARTH_RADIUS,
    MU,
    Elements,
    elements_from_state,
    rotate_elements,
)

MEAN, OSCULATING, STATE = range(3)
_AS_ECI, _J2000 = 0, 2
_ECI_IS_J2000 = 1
_STEEPEST = 3.13


class OrbitStart(Block):
    """Parameters of an orbit at t = 0, as elements or as position and velocity."""

    orbit_start: int = Parameter(
        "1",
        "what gives the orbit at t = 0: the elements, as mean or as osculating ones, or "
        "r_start and v_start; alike where the Earth is taken as a sphere",
        choices=("mean", "osculating", "state"),
        start="mean",
    )
    orbit_frame: int = Parameter(
        "1",
        "what they are relative to: eci, or the mean equator and equinox of date or of J2000",
        choices=("eci", "date", "j2000"),
        start="eci",
    )
    semi_major_axis: float = Parameter(
        "m", "semi-major axis a", start=6928137.0, min=6.4e6
    )
    eccentricity: float = Parameter("1", "eccentricity e", start=0.0, min=0.0, max=0.95)
    inclination: float = Parameter(
        "rad", "inclination i", start=1.7033, min=0.0, max=3.1415926536
    )
    raan: float = Parameter(
        "rad", "right ascension of the ascending node at t = 0", usual=TURN
    )
    argument_of_perigee: float = Parameter(
        "rad", "argument of perigee at t = 0", usual=TURN
    )
    mean_anomaly: float = Parameter("rad", "mean anomaly at t = 0", usual=TURN)
    r_start: Vec3 = Parameter(
        "m", "state: position at t = 0", start=(6928137.0, 0.0, 0.0)
    )
    v_start: Vec3 = Parameter(
        "m/s", "state: velocity at t = 0", start=(0.0, 0.0, 7585.1)
    )
    mu: float = Parameter(
        "m3/s2", "gravitational parameter of the Earth", start=MU, min=1e14
    )

    epoch_j2000: float
    eci_frame: int

    def start_elements(self, degree: int, kind: int) -> Elements:
        """Compute the elements at t = 0, MEAN or OSCULATING as `kind`.

        They are in the mean equator and equinox of date; fails where they describe no
        orbit. `degree`: of the zonal harmonics; 1: a sphere.
        """
        elements = Elements(
            self.semi_major_axis,
            self.eccentricity,
            self.inclination,
            self.raan,
            self.argument_of_perigee,
            self.mean_anomaly,
        )
        name = f"semi_major_axis = {self.semi_major_axis:g} m with eccentricity = "
        name += f"{self.eccentricity:g}"
        if self.orbit_start == STATE:
            name = f"r_start = {self.r_start} m with v_start = {self.v_start} m/s"
            try:
                elements = elements_from_state(self.r_start, self.v_start, self.mu)
            except (ValueError, ZeroDivisionError):
                self.fail(f"{name}: not on an ellipse around the Earth")
        perigee = elements.semi_major_axis * (1.0 - elements.eccentricity)
        if perigee < EARTH_RADIUS:
            self.fail(
                f"{name}: the perigee at {perigee:g} m is inside the Earth, {EARTH_RADIUS:g} m"
            )
        if self._from_j2000():
            elements = rotate_elements(elements, earth.precession(self.epoch_j2000))
        start_kind = MEAN if self.orbit_start == MEAN else OSCULATING
        if degree == 1 or start_kind == kind:
            return elements
        if elements.inclination > _STEEPEST:
            self.fail(
                f"inclination = {elements.inclination:g} rad: between mean and osculating elements "
                f"it must be below {_STEEPEST:g} rad"
            )
        convert = (
            averaging.mean_elements if kind == MEAN else averaging.osculating_elements
        )
        return convert(elements, degree, self.mu)

    def start_size(self) -> tuple[float, float]:
        """Return semi-major axis (m) and eccentricity at t = 0, as configured."""
        elements = self.start_elements(1, OSCULATING)
        return elements.semi_major_axis, elements.eccentricity

    def start_state(self) -> tuple[Vec3, Vec3]:
        """Return r_start (m) and v_start (m/s), equator and equinox of date."""
        if not self._from_j2000():
            return self.r_start, self.v_start
        c = earth.precession(self.epoch_j2000)
        return mat_vec(c, self.r_start), mat_vec(c, self.v_start)

    def _from_j2000(self) -> bool:
        """Return whether the orbit is relative to the axes of J2000."""
        if self.orbit_frame == _AS_ECI:
            return self.eci_frame == _ECI_IS_J2000
        return self.orbit_frame == _J2000
