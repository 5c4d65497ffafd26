"""Compute the rotation of the Earth, the direction of the Sun and the Earth's shadow.

Times are epochs: seconds since 2000-01-01T12:00:00 UTC, leap seconds not counted, UT1 =
UTC. The frame of this module is `date`: the mean equator and equinox of date (what the
elements of SGP4 mean by TEME, to 20 arcsec), held fixed during a run. The Earth's angle
is therefore the sidereal time, and the Sun's direction is that of the almanac.
v_earth_fixed = R3(angle) v_date.
"""

from __future__ import annotations

from math import acos, asin, cos, floor, pi, radians, sin, sqrt, tau

from ..contract.block import Mat33, Vec3
from .orbit import EARTH_RADIUS

SUN_RADIUS = 6.957e8  # m, nominal, IAU 2015 resolution B3

ASTRONOMICAL_UNIT = 1.495978707e11  # m

OBLIQUITY = radians(23.439)  # rad, of the ecliptic at J2000; it falls by 4e-7 deg a day

ECLIPTIC_NORTH: Vec3 = (0.0, -sin(OBLIQUITY), cos(OBLIQUITY))  # unit vector, date

FLATTENING = 1.0 / 298.257223563  # of the WGS-84 ellipsoid

SUN_YEARS = (1950.0, 2050.0)  # years for which `sun` is good to 0.01 deg

_DAY = 86400.0


def earth_angle(epoch: float) -> float:
    """Compute the Greenwich mean sidereal time (rad, 0 to 2 pi) at an epoch (s).

    IAU 1982: Vallado, Fundamentals of Astrodynamics and Applications, 4th ed., eq.
    3-45.
    """
    c = epoch / (36525.0 * _DAY)
    seconds = 67310.54841 + (876600.0 * 3600.0 + 8640184.812866) * c
    seconds += (0.093104 - 6.2e-6 * c) * c * c
    return tau * (seconds % _DAY) / _DAY


def _days_before(year: int) -> int:
    """Count the days from 2000-01-01 to January 1st of a Gregorian year."""
    n = year - 1
    return 365 * n + n // 4 - n // 100 + n // 400 - 730119


def decimal_year(epoch: float) -> float:
    """Convert an epoch (s) to a decimal year, 2026.5 for the middle of 2026.

    The fraction is the elapsed part of the calendar year.
    """
    days = epoch / _DAY + 0.5
    year = 2000 + floor(days / 365.2425)
    if days < _days_before(year):
        year -= 1
    elif days >= _days_before(year + 1):
        year += 1
    first = _days_before(year)
    return year + (days - first) / (_days_before(year + 1) - first)


def precession(epoch: float) -> Mat33:
    """Compute P of v_date = P v_j2000 at an epoch (s).

    P leads from the mean equator and equinox of J2000 to those of the epoch. IAU 1976,
    the precession that goes with the sidereal time of 1982 (Lieske and others, Astron.
    Astrophys. 58 (1977) 1; Vallado, Fundamentals of Astrodynamics and Applications, 4th
    ed., eq. 3-88): P = R3(-z) R2(theta) R3(-zeta). That of 2006 differs by 0.3 arcsec a
    century.
    """
    c = epoch / (36525.0 * _DAY)
    zeta = radians((2306.2181 + (0.30188 + 0.017998 * c) * c) * c / 3600.0)
    theta = radians((2004.3109 - (0.42665 + 0.041833 * c) * c) * c / 3600.0)
    z = radians((2306.2181 + (1.09468 + 0.018203 * c) * c) * c / 3600.0)
    cx, sx, cy, sy, cz, sz = (
        cos(zeta),
        sin(zeta),
        cos(theta),
        sin(theta),
        cos(z),
        sin(z),
    )
    return (
        cz * cy * cx - sz * sx,
        -cz * cy * sx - sz * cx,
        -cz * sy,
        sz * cy * cx + cz * sx,
        -sz * cy * sx + cz * cx,
        -sz * sy,
        sy * cx,
        -sy * sx,
        cy,
    )


def sun(epoch: float) -> tuple[Vec3, float]:
    """Compute the direction (unit vector, date) and distance (m) of the Sun.

    Seen from the Earth at an epoch (s), by the low-precision formulae of the
    Astronomical Almanac (page C5): 0.01 deg from 1950 to 2050.
    """
    days = epoch / _DAY
    g = radians(357.528 + 0.9856003 * days)
    sin_g, cos_g = sin(g), cos(g)
    longitude = radians(280.460 + 0.9856474 * days + (1.915 + 0.040 * cos_g) * sin_g)
    obliquity = radians(23.439 - 4e-7 * days)
    distance = 1.00014 - 0.01671 * cos_g - 0.00014 * (2.0 * cos_g * cos_g - 1.0)
    s = sin(longitude)
    return (
        cos(longitude),
        cos(obliquity) * s,
        sin(obliquity) * s,
    ), distance * ASTRONOMICAL_UNIT


def raan_of_local_time(hours: float, epoch: float) -> float:
    """Compute the raan (rad, 0 to 2 pi) of a mean local solar time at an epoch (s).

    `hours` from 0 to 24 applies to the ascending node: 12 puts it under the mean Sun.
    """
    mean_sun = radians(280.460 + 0.9856474 * epoch / _DAY)
    return (mean_sun + (hours - 12.0) * tau / 24.0) % tau


def sunlight(
    r_date: Vec3, sun_date: Vec3, sun_distance: float, body_radius: float = EARTH_RADIUS
) -> float:
    """Compute the visible fraction of the Sun's disc at r (m): 0 in umbra.

    It is 1 outside of the penumbra. The body, by default the Earth, is a sphere. Two
    overlapping discs, Montenbruck & Gill, Satellite Orbits, section 3.4.2.
    """
    x, y, z = r_date
    sx, sy, sz = sun_date
    along = x * sx + y * sy + z * sz
    if along >= 0.0:  # on the day side
        return 1.0
    size2 = x * x + y * y + z * z
    # spacecraft to Sun: its distance, and the cosine of its angle from the Earth's
    # centre
    distance = sqrt(sun_distance * (sun_distance - 2.0 * along) + size2)
    radius = sqrt(size2)
    a = asin(SUN_RADIUS / distance)
    b = asin(min(body_radius / radius, 1.0))
    c = acos(max((size2 - sun_distance * along) / (distance * radius), -1.0))
    if c >= a + b:
        return 1.0
    if c <= b - a:
        return 0.0
    if c <= a - b:  # an annular eclipse, far out
        return 1.0 - (b / a) ** 2
    # distance from the Sun's centre to the chord of the two rims; rounding may put it
    # outside of +-a
    u = max(min((a * a + (c - b) * (c + b)) / (2.0 * c), a), -a)
    sector = b * b * acos(max(min((c - u) / b, 1.0), -1.0))
    hidden = a * a * acos(u / a) + sector - c * sqrt(a * a - u * u)
    return 1.0 - hidden / (pi * a * a)


def height(r_date: Vec3) -> float:
    """Compute the height (m) of r (m) above the WGS-84 ellipsoid, to 5 m up to 1000 km.

    It is measured along the radius, which deviates from the vertical by at most 0.2
    deg.
    """
    x, y, z = r_date
    size2 = x * x + y * y + z * z
    polar2 = (1.0 - FLATTENING) ** 2
    surface = EARTH_RADIUS / sqrt(1.0 + (1.0 / polar2 - 1.0) * z * z / size2)
    return sqrt(size2) - surface
