"""The Earth's own field: what environments and managers with a field model onboard share."""

from __future__ import annotations

from math import cos, sin

from ..contract.block import Block, BlockError, Parameter, Vec3
from ..maths.vector import scale
from ..physics import earth, geomagnetic
from ..physics.igrf14 import DEGREE
from ..physics.orbit import EARTH_RATE


class EarthField(Block):
    """Parameters and fields of a turning Earth: v_earth = R3(angle) v_eci, angle = angle_0 +
    `earth_rate` t. A block calls `start_field` before the fields."""

    epoch_j2000: float = Parameter(
        "s", "UTC of t = 0: seconds since 2000-01-01T12:00:00 UTC, leap seconds not counted; "
        "820497600 is 2026-01-01T00:00:00",
        start=820497600.0, min=-3.2e9, max=3.2e9,
    )  # fmt: skip
    dipole_earth: Vec3 = Parameter(
        "T.m3",
        "centred dipole, Earth-fixed: mu_0 / (4 pi) times the moment, which points south; from "
        "Gauss coefficients (g11, h11, g10) R^3. Start: IGRF-14 at 2025.0",
        start=scale(geomagnetic.REFERENCE_RADIUS**3, (-1410.3e-9, 4545.5e-9, -29350.0e-9)),
    )
    igrf_degree: int = Parameter(
        "1", "highest degree of igrf; 1: the tilted dipole of the epoch", start=DEGREE, min=1,
        max=DEGREE,
    )  # fmt: skip
    earth_rate: float = Parameter("rad/s", "rotation of the Earth", start=EARTH_RATE)
    earth_angle: int = Parameter(
        "1", "the Earth's angle at t = 0, from the epoch or as given", choices=("epoch", "given"),
        start="epoch",
    )  # fmt: skip
    earth_angle_start: float = Parameter(
        "rad", "if given: angle at t = 0 from the x axis of eci to the meridian of Greenwich"
    )

    def start_field(self, igrf: bool) -> None:
        """Take the Earth's angle at t = 0 and, for `igrf_eci`, the year; fails where IGRF-14 has no
        coefficients for it."""
        given = self.earth_angle
        self._angle = self.earth_angle_start if given else earth.earth_angle(self.epoch_j2000)
        self._year = 0.0
        if igrf:
            self._year = earth.decimal_year(self.epoch_j2000)
            try:
                geomagnetic.igrf(self._year, self.igrf_degree)
            except BlockError as error:
                self.fail(f"epoch_j2000 = {self.epoch_j2000:.10g} s: {error}")

    def field_eci(self, r_eci: Vec3, t: float, igrf: bool) -> Vec3:
        """B (T, eci) at r (m) and t (s): of IGRF with the coefficients of t = 0, or of the centred
        dipole."""
        x, y, z = r_eci
        angle = self._angle + self.earth_rate * t
        c, s = cos(angle), sin(angle)
        r_earth = (c * x + s * y, c * y - s * x, z)
        if igrf:
            bx, by, bz = geomagnetic.field(r_earth, geomagnetic.igrf(self._year, self.igrf_degree))
        else:
            bx, by, bz = geomagnetic.dipole(r_earth, self.dipole_earth)
        return (c * bx - s * by, s * bx + c * by, bz)
