"""Orbits: constants of the Earth, Kepler motion, the local orbital frame.

Frames: `eci`; `lvlh` (z to nadir, y to minus orbit normal, x completes: along the velocity on a
circular orbit).
"""

from __future__ import annotations

from math import cos, sin, sqrt

from .attitude import from_matrix
from .block import Vec3, Vec4
from .vector import cross, scale, unit

MU = 3.986004418e14
"""Gravitational parameter of the Earth (m3/s2), WGS-84 / EGM."""

EARTH_RADIUS = 6378137.0
"""Equatorial radius (m), WGS-84."""

EARTH_RATE = 7.2921159e-5
"""Rotation of the Earth (rad/s)."""


def mean_motion(semi_major_axis: float) -> float:
    """n = sqrt(mu / a^3) (rad/s) for a semi-major axis in m."""
    return sqrt(MU / semi_major_axis**3)


def orbit_plane(inclination: float, raan: float) -> tuple[Vec3, Vec3, Vec3]:
    """Unit vectors in eci: to the ascending node, 90 deg ahead in the plane, and the normal.

    Angles in rad.
    """
    ci, si, co, so = cos(inclination), sin(inclination), cos(raan), sin(raan)
    return (co, so, 0.0), (-ci * so, ci * co, si), (si * so, -si * co, ci)


def lvlh_attitude(r_eci: Vec3, v_eci: Vec3) -> Vec4:
    """q_OI: the attitude of lvlh relative to eci, from position (m) and velocity (m/s)."""
    z = scale(-1.0, unit(r_eci))
    y = scale(-1.0, unit(cross(r_eci, v_eci)))
    x = cross(y, z)
    return from_matrix((*x, *y, *z))
