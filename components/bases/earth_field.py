"""Provide the Earth's field to environments and to managers with a field model."""

from __future__ import annotations

from math import cos, sin

from ..contract.block import TURN, Block, BlockError, Parameter, Vec3
from ..maths.vector import IDENTITY, mat_t_vec, mat_vec, scale
from ..physics import earth, geomagnetic, igrf14
from ..physics.igrf14 import DEGREE
from ..physics.orbit import EARTH_RATE

EQUATOR_OF_DATE = 0


class EarthField(Block):
    """Parameters and fields of a rotating Earth.

    v_earth = R3(angle) v_date, angle = angle_0 + `earth_rate` t, where `date` is the
    mean equator and equinox of t = 0. `eci` is that frame, unless `eci_frame` is j2000.
    A block calls `start_field` before the fields.
    """

    epoch_j2000: float = Parameter(
        "s",
        "UTC of t = 0: seconds since 2000-01-01T12:00:00 UTC, leap seconds not counted; "
        "820497600 is 2026-01-01T00:00:00",
        start=820497600.0,
        min=-3.2e9,
        max=3.2e9,
    )
    eci_frame: int = Parameter(
        "1",
        "what eci is: the mean equator and equinox of date (of t = 0), or of J2000; 0.36 deg "
        "apart in 2026",
        choices=("date", "j2000"),
        start="date",
        shared=True,
    )
    dipole_earth: Vec3 = Parameter(
        "T.m3",
        "centred dipole, Earth-fixed: mu_0 / (4 pi) times the moment, which points south; from "
        "Gauss coefficients (g11, h11, g10) R^3. Start: IGRF-14 at 2025.0",
        start=scale(
            geomagnetic.REFERENCE_RADIUS**3, (-1410.3e-9, 4545.5e-9, -29350.0e-9)
        ),
    )
    igrf_degree: int = Parameter(
        "1",
        "highest degree of igrf; 1: the tilted dipole",
        start=DEGREE,
        min=1,
        max=DEGREE,
    )
    earth_rate: float = Parameter("rad/s", "rotation of the Earth", start=EARTH_RATE)
    earth_angle: int = Parameter(
        "1",
        "the Earth's angle at t = 0, from the epoch or as given",
        choices=("epoch", "given"),
        start="epoch",
    )
    earth_angle_start: float = Parameter(
        "rad",
        "if given: angle at t = 0 from the equinox of date to the meridian of Greenwich",
        usual=TURN,
    )

    def start_field(self, igrf: bool) -> None:
        """Set the Earth's angle at t = 0 and the frame `eci`.

        Fails where `igrf` is true and IGRF-14 does not cover the epoch.
        """
        has_start_angle = self.earth_angle
        self._angle = (
            self.earth_angle_start
            if has_start_angle
            else earth.earth_angle(self.epoch_j2000)
        )
        of_date = self.eci_frame == EQUATOR_OF_DATE
        self._precession = IDENTITY if of_date else earth.precession(self.epoch_j2000)
        self.check_igrf_years(0.0, 0.0, igrf)

    def check_igrf_years(self, begin: float, end: float, igrf: bool) -> None:
        """Check that IGRF-14 covers begin to end (s), if `igrf` is true.

        Raises
        ------
        BlockError
            If it does not.
        """
        for name, t in (("", begin), (f", at t = {end:.10g} s", end)):
            try:
                if igrf:
                    igrf14.model_of(earth.decimal_year(self.epoch_j2000 + t))
            except BlockError as error:
                self.fail(f"epoch_j2000 = {self.epoch_j2000:.10g} s{name}: {error}")

    def to_eci(self, v_date: Vec3) -> Vec3:
        """Transform a vector from the mean equator and equinox of date to eci."""
        if self.eci_frame == EQUATOR_OF_DATE:
            return v_date
        return mat_t_vec(self._precession, v_date)

    def to_date(self, v_eci: Vec3) -> Vec3:
        """Transform a vector from eci to the mean equator and equinox of date."""
        return (
            v_eci
            if self.eci_frame == EQUATOR_OF_DATE
            else mat_vec(self._precession, v_eci)
        )

    def field_eci(self, r_eci: Vec3, t: float, igrf: bool) -> Vec3:
        """Compute the field B (T, eci) at r (m) and t (s), as `field_date`."""
        return self.to_eci(self.field_date(self.to_date(r_eci), t, igrf))

    def field_date(self, r_date: Vec3, t: float, igrf: bool) -> Vec3:
        """Compute the field B (T, date) at r (m) and t (s).

        It is that of IGRF with the coefficients of t, or of the centred dipole.

        Raises
        ------
        BlockError
            If t is outside the years that IGRF-14 covers.
        """
        x, y, z = r_date
        angle = self._angle + self.earth_rate * t
        c, s = cos(angle), sin(angle)
        r_earth = (c * x + s * y, c * y - s * x, z)
        if igrf:
            year = earth.decimal_year(self.epoch_j2000 + t)
            bx, by, bz = geomagnetic.igrf(r_earth, year, self.igrf_degree)
        else:
            bx, by, bz = geomagnetic.dipole(r_earth, self.dipole_earth)
        return (c * bx - s * by, s * bx + c * by, bz)
