"""Provide the base of orbits around the Earth: field, Sun, shadow and atmosphere."""

from __future__ import annotations

import inspect
from abc import abstractmethod
from collections.abc import Iterator
from math import degrees, floor, sin, sqrt
from typing import Annotated, ClassVar

from ..contract.block import Parameter, Vec3
from ..contract.roles import Environment
from ..maths.vector import ZERO, norm
from ..physics import atmosphere, earth
from ..physics.orbit import EARTH_RADIUS, mean_motion
from .earth_field import EarthField

_PAGE = """
**Field.** `none`; `dipole`, centred, B = (3 (m.u) u - m) / r^3 with u = r / |r| and m =
`dipole_earth` in Earth-fixed axes; or `igrf`, the spherical harmonics of IGRF-14 up to
`igrf_degree` with the coefficients of t. The Earth turns: v_earth = R3(angle) v_date, angle =
angle_0 + `earth_rate` t, where angle_0 is the sidereal time of the epoch (IAU 1982), or
`earth_angle_start`.

The field is computed at the multiples of 10 s; in between it is the polynomial of fifth degree
through the six values around, which is the field to 1e-16 T (dipole) or 2e-14 T (igrf). So b_eci
and its two derivatives along the orbit belong together.

**Sun.** Low-precision formulae of the Astronomical Almanac, 0.01 deg, taken at the middle of each
10 s. `sunlight` is the visible share of its disc behind a spherical Earth (Montenbruck & Gill,
Satellite Orbits, section 3.4.2), times (1 astronomical unit / its distance)^2.

**Frames.** Orbit, Earth and Sun are computed in the mean equator and equinox of date, those of
t = 0. `eci` is that frame, or with `eci_frame` = `j2000` that of J2000, from where
v_date = P v_j2000 with the precession of IAU 1976.

**Atmosphere.** `none`; `table`: layers with exponential density over the height above the
ellipsoid (Vallado, Fundamentals of Astrodynamics and Applications, table 8-4), static, of moderate
activity; `exponential`: rho = `density_base` exp(-(|r| - `atmosphere_radius` - `altitude_base`) /
`scale_height`); or `activity`: by F10.7 and Ap, day and night, latitude and season: exospheric
temperature and variations of Jacchia (1971), gases in diffusive equilibrium above 120 km (Jacchia
1965, Walker 1965). Against NRLMSISE-00 over latitudes, local times and seasons at 200 to 800 km
the factor of error is 1.24 at low, 1.17 at moderate and 1.26 at high activity (root mean square),
0.42 and 2.6 at the worst; with `table` 7.2, 1.45 and 5.1, at the worst 0.03 and 46.
"""

NODE_TIME = 10.0  # s, between the points at which the field is computed

NODES = 6  # points that a polynomial goes through

# 1/s2: sum of the squared mean motions of the Sun and the Moon, that of the Moon times
# its share of the mass of Earth and Moon.
THIRD_BODIES = 1.991e-7**2 + 0.0123 * 2.6617e-6**2
MUCH_PLANE, MUCH_PERIGEE = 0.01, 2e4  # thresholds of a warning (rad, m)

_NO_FIELD, _IGRF = 0, 2
NO_AIR, _AIR_TABLE, _AIR_EXPONENTIAL = 0, 1, 2

_Vec6 = tuple[float, float, float, float, float, float]
# Data of one interval between nodes: its number, B (eci) at the nodes around it, the
# polynomial of each component, the Sun's unit vector in date and in eci, its distance.
_Piece = tuple[int, tuple[Vec3, ...], tuple[_Vec6, ...], Vec3, Vec3, float]


class NearEarth(Environment, EarthField):
    """Base of the environments of an Earth orbit; a block adds `motion` and `size`.

    The page of the block is extended by what all of them compute.

    `advance` prepares the polynomials of the interval between nodes that its step ends
    in, and `output` uses them. For another time, `output` computes them itself and does
    not store them. They depend on parameters and time only, so the outputs do not
    depend on earlier calls.
    """

    third_bodies: ClassVar[bool] = False  # whether Sun and Moon move the orbit

    field: int = Parameter(
        "1", "geomagnetic field", choices=("none", "dipole", "igrf"), start="igrf"
    )
    atmosphere: int = Parameter(
        "1",
        "model of the atmosphere",
        choices=("none", "table", "exponential", "activity"),
        start="table",
    )
    solar_activity: int = Parameter(
        "1",
        "activity: F10.7 and Ap of ECSS-E-ST-10-04C: 65, 0; 140, 15; 250, 45; or as given",
        choices=("low", "moderate", "high", "given"),
        start="moderate",
    )
    f107: float = Parameter(
        "1",
        "given: solar flux at 10.7 cm, of the day and in the mean, 1e-22 W/(m2 Hz)",
        start=140.0,
        min=0.0,
        max=500.0,
        usual=(60.0, 400.0),
    )
    ap: float = Parameter(
        "1", "given: geomagnetic index Ap", start=15.0, min=0.0, max=400.0
    )
    density_base: float = Parameter(
        "kg/m3", "exponential: density at altitude_base", start=6.967e-13, min=0.0
    )
    altitude_base: float = Parameter("m", "exponential: base altitude", start=500e3)
    scale_height: float = Parameter(
        "m", "exponential: scale height", start=63822.0, min=1.0
    )
    atmosphere_radius: float = Parameter(
        "m", "exponential: radius of altitude 0", start=EARTH_RADIUS, min=0.0
    )

    def __init_subclass__(cls) -> None:
        """Append the common page to the docstring of the block."""
        super().__init_subclass__()
        cls.__doc__ = f"{inspect.cleandoc(cls.__doc__ or '')}\n{_PAGE}"

    @abstractmethod
    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        """Compute position (m) and velocity (m/s) at t (s).

        The frame is the mean equator and equinox of date.
        """

    @abstractmethod
    def size(self) -> tuple[float, float]:
        """Return semi-major axis (m) and eccentricity at the start, as configured."""

    def start(self) -> None:
        """Set the Earth's field, the solar activity and the state to start values."""
        self.start_field(igrf=self.field == _IGRF)
        has_own_activity = self.solar_activity == len(atmosphere.ACTIVITY)
        f107, ap = (
            (self.f107, self.ap)
            if has_own_activity
            else atmosphere.ACTIVITY[self.solar_activity]
        )
        self._coldest, self._kp = (
            atmosphere.coldest_temperature(f107),
            atmosphere.kp_of_ap(ap),
        )
        self._piece: _Piece | None = None

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: epoch, height, third bodies."""
        # the polynomials of the last step extend beyond it
        self.check_igrf_years(
            begin, end + NODE_TIME * (NODES // 2), self.field == _IGRF
        )
        years = tuple(earth.decimal_year(self.epoch_j2000 + t) for t in (begin, end))
        first, last = earth.SUN_YEARS
        if (
            wired_names & {"sun_eci", "sunlight"}
            and not first <= min(years) <= max(years) <= last
        ):
            yield (
                f"epoch_j2000 = {self.epoch_j2000:.10g} s: the year {max(years):.2f} is outside "
                f"[{first:.0f}, {last:.0f}], in which the Sun's direction is good to 0.01 deg"
            )
        if (
            self.atmosphere not in (NO_AIR, _AIR_EXPONENTIAL)
            and "density" in wired_names
        ):
            a, e = self.size()
            low, high = a * (1.0 - e) - EARTH_RADIUS, a * (1.0 + e) - EARTH_RADIUS
            least, most = atmosphere.HEIGHTS
            # above `most` the density is negligible
            if low < least:
                name = ("none", "table", "exponential", "activity")[self.atmosphere]
                yield (
                    f"atmosphere = {name}: its density is good from {1e-3 * least:.0f} to "
                    f"{1e-3 * most:.0f} km, the orbit is {1e-3 * low:.0f} to {1e-3 * high:.0f} "
                    "km high: it is extrapolated"
                )
        if not self.third_bodies and "r_eci" in wired_names:
            yield from self._left_out(end - begin)

    def _left_out(self, span: float) -> Iterator[str]:
        """Yield a warning where Sun and Moon would change the orbit much.

        `span` in s. Their mean field is averaged over the orbit and over their own.
        With w = (n_sun^2 + 0.0123 n_moon^2) / n the plane turns by at most 3/8 w (1 + 4
        e^2) / sqrt(1 - e^2) sin 2 epsilon and the eccentricity changes by at most 15/8
        w e sqrt(1 - e^2) (Cook, Geophys. J. 6 (1962) 271).
        """
        a, e = self.size()
        w = THIRD_BODIES / mean_motion(a)
        round_ = sqrt(1.0 - e * e)
        plane = (
            0.375 * w * (1.0 + 4.0 * e * e) / round_ * sin(2.0 * earth.OBLIQUITY) * span
        )
        perigee = 1.875 * w * e * round_ * a * span
        if plane > MUCH_PLANE or perigee > MUCH_PERIGEE:
            yield (
                f"the Sun and the Moon, which it leaves out, turn the orbit's plane by up to "
                f"{degrees(plane):.2g} deg and move its perigee by up to "
                f"{1e-3 * perigee:.2g} km in {span / 86400.0:.0f} days"
            )

    def output(self, t: float) -> None:
        """Set orbit, field, Sun and density at t (s)."""
        interval = floor(t / NODE_TIME)
        piece = self._piece
        if piece is None or piece[0] != interval:
            piece = self._piece_of(interval)
        _, _, polynomials, sun, self.sun_eci, sun_distance = piece

        r, v = self.motion(t)
        self.r_eci, self.v_eci = self.to_eci(r), self.to_eci(v)
        if polynomials:
            s = t - NODE_TIME * interval
            values = [derivatives(c, s) for c in polynomials]
            self.b_eci, self.b_rate_eci, self.b_accel_eci = zip(*values, strict=True)
        else:
            self.b_eci = self.b_rate_eci = self.b_accel_eci = ZERO
        nearer = earth.ASTRONOMICAL_UNIT / sun_distance
        self.sunlight = nearer * nearer * earth.sunlight(r, sun, sun_distance)
        self.density = self.density_at(r, t, sun)

    def advance(self, t: float, dt: float) -> None:
        """Prepare the polynomials of the interval in which the step ends."""
        interval = floor((t + dt) / NODE_TIME)
        if self._piece is None or self._piece[0] != interval:
            self._piece = self._piece_of(interval)

    def _piece_of(self, interval: int) -> _Piece:
        """Compute the data of an interval; nodes of the stored one are reused."""
        nodes: Annotated[tuple[Vec3, ...], NODES] = ()
        polynomials: tuple[_Vec6, ...] = ()
        if self.field != _NO_FIELD:
            if self._piece is not None and 0 < interval - self._piece[0] < NODES:
                nodes = self._piece[1][interval - self._piece[0] :]
            first = interval - NODES // 2 + 1
            missing = range(first + len(nodes), first + NODES)
            nodes += tuple(
                self.to_eci(
                    self.field_date(self.motion(t)[0], t, igrf=self.field == _IGRF)
                )
                for t in (NODE_TIME * k for k in missing)
            )
            polynomials = tuple(quintic(f) for f in zip(*nodes, strict=True))
        sun, distance = earth.sun(self.epoch_j2000 + NODE_TIME * (interval + 0.5))
        return interval, nodes, polynomials, sun, self.to_eci(sun), distance

    def density_at(self, r_date: Vec3, t: float, sun_date: Vec3) -> float:
        """Compute the density (kg/m3) at r (m) and t (s).

        `sun_date` is the unit vector to the Sun.
        """
        if self.atmosphere == NO_AIR:
            return 0.0
        if self.atmosphere == _AIR_TABLE:
            return atmosphere.table(earth.height(r_date))
        if self.atmosphere == _AIR_EXPONENTIAL:
            return atmosphere.exponential(
                norm(r_date) - self.atmosphere_radius,
                self.altitude_base,
                self.density_base,
                self.scale_height,
            )
        return atmosphere.by_activity(
            earth.height(r_date),
            r_date,
            sun_date,
            self.epoch_j2000 + t,
            self._coldest,
            self._kp,
        )


def quintic(f: tuple[float, ...]) -> _Vec6:
    """Compute the coefficients c0 to c5 of a polynomial in s (s): the sum of c_n s^n.

    It has the values f at s = -2, -1, 0, 1, 2, 3 times NODE_TIME.
    """
    a, b, c, d, e, g = f
    h = 1.0 / NODE_TIME
    return (
        c,
        (6.0 * a - 60.0 * b - 40.0 * c + 120.0 * d - 30.0 * e + 4.0 * g) / 120.0 * h,
        (-5.0 * a + 80.0 * b - 150.0 * c + 80.0 * d - 5.0 * e) / 120.0 * h**2,
        (-5.0 * a - 5.0 * b + 50.0 * c - 70.0 * d + 35.0 * e - 5.0 * g) / 120.0 * h**3,
        (5.0 * a - 20.0 * b + 30.0 * c - 20.0 * d + 5.0 * e) / 120.0 * h**4,
        (-a + 5.0 * b - 10.0 * c + 10.0 * d - 5.0 * e + g) / 120.0 * h**5,
    )


def derivatives(c: _Vec6, s: float) -> Vec3:
    """Evaluate the polynomial with coefficients c at s, and two derivatives."""
    c0, c1, c2, c3, c4, c5 = c
    return (
        c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5)))),
        c1 + s * (2.0 * c2 + s * (3.0 * c3 + s * (4.0 * c4 + s * (5.0 * c5)))),
        2.0 * c2 + s * (6.0 * c3 + s * (12.0 * c4 + s * (20.0 * c5))),
    )
