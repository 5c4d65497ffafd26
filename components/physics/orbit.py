"""Compute orbits: constants of the Earth, Kepler motion, the local orbital frame.

Frames: `eci`, where gravity and drift have z to the Earth's pole; `lvlh` (z to nadir, y
to minus orbit normal, x completes: along the velocity on a circular orbit).
"""

from __future__ import annotations

from math import acos, atan2, copysign, cos, pi, remainder, sin, sqrt, tau
from typing import NamedTuple

from ..contract.block import Mat33, Vec3, Vec4
from ..maths.attitude import from_matrix
from ..maths.vector import add, cross, dot, mat_vec, norm, scale, unit

MU = 3.986004418e14  # m3/s2, gravitational parameter of the Earth, WGS-84 / EGM

EARTH_RADIUS = 6378137.0  # m, equatorial, WGS-84

EARTH_RATE = 7.2921159e-5  # rad/s, rotation of the Earth

# Zonal harmonics of the Earth's gravity, EGM-96 (not normalised).
J2, J3, J4 = 1.08262668e-3, -2.53265649e-6, -1.61962159e-6

TROPICAL_YEAR = 365.24219 * 86400.0  # s, mean motion of the Sun through the equinoxes


class Elements(NamedTuple):
    """Kepler elements at t = 0: m, 1, and angles in rad relative to eci."""

    semi_major_axis: float
    eccentricity: float
    inclination: float
    raan: float
    argument_of_perigee: float
    mean_anomaly: float


class Drift(NamedTuple):
    """Rates of the angular elements in addition to Kepler's motion (rad/s)."""

    raan: float
    argument_of_perigee: float
    mean_anomaly: float


def mean_motion(semi_major_axis: float, mu: float = MU) -> float:
    """Compute the mean motion n = sqrt(mu / a^3) (rad/s); a in m, mu in m3/s2."""
    return sqrt(mu / semi_major_axis**3)


def orbit_plane(inclination: float, raan: float) -> tuple[Vec3, Vec3, Vec3]:
    """Compute the axes of the orbital plane, unit vectors in eci.

    They point to the ascending node, 90 deg ahead in the plane, and along the normal.
    Angles in rad.
    """
    ci, si, co, so = cos(inclination), sin(inclination), cos(raan), sin(raan)
    return (co, so, 0.0), (-ci * so, ci * co, si), (si * so, -si * co, ci)


def lvlh_attitude(r_eci: Vec3, v_eci: Vec3) -> Vec4:
    """Compute q_OI, the attitude of lvlh relative to eci.

    From position (m) and velocity (m/s).
    """
    z = scale(-1.0, unit(r_eci))
    y = scale(-1.0, unit(cross(r_eci, v_eci)))
    x = cross(y, z)
    return from_matrix((*x, *y, *z))


def perifocal_axes(
    inclination: float, raan: float, argument_of_perigee: float
) -> tuple[Vec3, Vec3]:
    """Compute unit vectors in eci to the perigee and 90 deg ahead in the plane.

    Angles in rad.
    """
    node, ahead, _ = orbit_plane(inclination, raan)
    c, s = cos(argument_of_perigee), sin(argument_of_perigee)
    return add(scale(c, node), scale(s, ahead)), add(scale(-s, node), scale(c, ahead))


def eccentric_anomaly(mean_anomaly: float, eccentricity: float) -> float:
    """Solve Kepler's equation E - e sin E = M for E (rad, -pi to pi).

    0 <= e < 1, to rounding. Newton's iteration. Above e = 0.8 it starts at pi, on the
    side where the equation is convex, so it converges from there for any M (Montenbruck
    & Gill, Satellite Orbits, section 2.2.4).
    """
    m, e = remainder(mean_anomaly, tau), eccentricity
    x = m + e * sin(m) if e < 0.8 else copysign(pi, m)
    while True:
        s = sin(x)
        step = (x - e * s - m) / (1.0 - e * cos(x))
        x -= step
        # the next step would be of the order of step^2, below rounding; nan ends here too
        if not abs(step) > 1e-9:
            return x


def mean_from_true_anomaly(true_anomaly: float, eccentricity: float) -> float:
    """Convert a true anomaly (rad) to the mean anomaly (rad, -pi to pi), 0 <= e < 1."""
    c, s = cos(true_anomaly), sin(true_anomaly)
    y, x = sqrt(1.0 - eccentricity * eccentricity) * s, eccentricity + c
    return atan2(y, x) - eccentricity * y / (1.0 + eccentricity * c)


def ellipse_of_altitudes(perigee: float, apogee: float) -> tuple[float, float]:
    """Compute semi-major axis (m) and eccentricity from perigee and apogee heights (m).

    Heights are above the equatorial radius.
    """
    low, high = EARTH_RADIUS + perigee, EARTH_RADIUS + apogee
    return 0.5 * (low + high), (high - low) / (high + low)


def ellipse_state(
    semi_major_axis: float,
    eccentricity: float,
    mean_anomaly: float,
    anomaly_rate: float,
    to_perigee: Vec3,
    ahead: Vec3,
) -> tuple[Vec3, Vec3]:
    """Compute position (m) and velocity (m/s) on an ellipse.

    a in m, M in rad and its rate in rad/s. The ellipse lies in the plane of the unit
    vectors `to_perigee` and `ahead`; the results are in their frame.
    """
    anomaly = eccentric_anomaly(mean_anomaly, eccentricity)
    c, s = cos(anomaly), sin(anomaly)
    minor = semi_major_axis * sqrt(1.0 - eccentricity * eccentricity)
    rate = anomaly_rate / (1.0 - eccentricity * c)
    x, y = semi_major_axis * (c - eccentricity), minor * s
    vx, vy = -semi_major_axis * s * rate, minor * c * rate
    px, py, pz = to_perigee
    qx, qy, qz = ahead
    return (
        (x * px + y * qx, x * py + y * qy, x * pz + y * qz),
        (vx * px + vy * qx, vx * py + vy * qy, vx * pz + vy * qz),
    )


def drifting_state(
    elements: Elements, drift: Drift, t: float, mu: float
) -> tuple[Vec3, Vec3]:
    """Compute r (m) and v (m/s) in eci on an ellipse whose angles drift.

    The time t (s) counts from the elements. v is the time derivative of r, including
    the rotation of the ellipse.
    """
    a, e, i, raan, perigee, anomaly = elements
    raan += drift.raan * t
    p, q = perifocal_axes(i, raan, perigee + drift.argument_of_perigee * t)
    rate = mean_motion(a, mu) + drift.mean_anomaly
    r, v = ellipse_state(a, e, anomaly + rate * t, rate, p, q)
    wx, wy, wz = scale(drift.argument_of_perigee, cross(p, q))
    return r, add(v, cross((wx, wy, wz + drift.raan), r))


def j2_drift(
    semi_major_axis: float, eccentricity: float, inclination: float, mu: float = MU
) -> Drift:
    """Compute the secular drift by the Earth's oblateness for mean elements.

    First order in J2: Vallado, Fundamentals of Astrodynamics and Applications, 4th ed.,
    section 9.6.
    """
    n = mean_motion(semi_major_axis, mu)
    one_minus_e2 = 1.0 - eccentricity * eccentricity
    c = cos(inclination)
    k = 0.75 * n * J2 * (EARTH_RADIUS / (semi_major_axis * one_minus_e2)) ** 2
    return Drift(
        raan=-2.0 * k * c,
        argument_of_perigee=k * (5.0 * c * c - 1.0),
        mean_anomaly=k * sqrt(one_minus_e2) * (3.0 * c * c - 1.0),
    )


def gravity(r: Vec3, degree: int, mu: float = MU) -> Vec3:
    """Compute the Earth's gravity (m/s2) at r (m, z to the pole).

    It has the zonal harmonics up to `degree`, from 1 (none) to 4: Vallado, Fundamentals
    of Astrodynamics and Applications, 4th ed., section 8.7.
    """
    x, y, z = r
    size2 = x * x + y * y + z * z
    size = sqrt(size2)
    # acceleration: mu over r cubed, times (-r + across (x, y, 0) + along (0, 0, 1))
    across = along = 0.0
    s = z / size
    s2 = s * s
    q = EARTH_RADIUS / size
    q2 = q * q
    if degree > 1:
        k = 1.5 * J2 * q2
        across += k * (5.0 * s2 - 1.0)
        along += k * (5.0 * s2 - 3.0) * z
    if degree > 2:
        k = 2.5 * J3 * q2 * q
        across += k * s * (7.0 * s2 - 3.0)
        along += k * (s2 * (7.0 * s2 - 6.0) + 0.6) * size
    if degree > 3:
        k = 1.875 * J4 * q2 * q2
        across += k * (1.0 + s2 * (21.0 * s2 - 14.0))
        along += k * (5.0 + s2 * (21.0 * s2 - 70.0 / 3.0)) * z
    g = mu / (size2 * size)
    inward = g * (across - 1.0)
    return (inward * x, inward * y, g * (along - z))


def sun_synchronous_inclination(
    semi_major_axis: float, eccentricity: float = 0.0
) -> float:
    """Compute the inclination (rad) of a Sun-synchronous orbit.

    J2 turns its node once in a tropical year.

    Raises
    ------
    ValueError
        If the orbit is too high (a > 12 352 km when circular).
    """
    k = -j2_drift(semi_major_axis, eccentricity, 0.0).raan
    cosine = -tau / TROPICAL_YEAR / k
    if cosine < -1.0:
        raise ValueError(
            f"no inclination makes a = {semi_major_axis:g} m, e = {eccentricity:g} "
            "Sun-synchronous: the orbit is too high"
        )
    return acos(cosine)


def elements_from_state(r_eci: Vec3, v_eci: Vec3, mu: float = MU) -> Elements:
    """Compute the elements of the ellipse through r (m) with v (m/s).

    raan is 0 on an equatorial orbit, the argument of perigee 0 on a circular one.

    Raises
    ------
    ValueError
        If the motion is not an ellipse.
    """
    radius = norm(r_eci)
    a = 1.0 / (2.0 / radius - dot(v_eci, v_eci) / mu)
    h = cross(r_eci, v_eci)
    if not (a > 0.0 and norm(h) > 0.0):
        raise ValueError("r and v are not those of an ellipse")
    tilt = sqrt(h[0] * h[0] + h[1] * h[1])
    inclination = atan2(tilt, h[2])
    raan = atan2(h[0], -h[1]) if tilt > 1e-12 * norm(h) else 0.0
    node, ahead, _ = orbit_plane(inclination, raan)

    e_sin, e_cos = dot(r_eci, v_eci) / sqrt(mu * a), 1.0 - radius / a
    e = sqrt(e_sin * e_sin + e_cos * e_cos)
    if e < 1e-14:
        return Elements(
            a, 0.0, inclination, raan, 0.0, atan2(dot(r_eci, ahead), dot(r_eci, node))
        )
    anomaly = atan2(e_sin, e_cos)
    true = atan2(sqrt(1.0 - e * e) * sin(anomaly), cos(anomaly) - e)
    perigee = remainder(atan2(dot(r_eci, ahead), dot(r_eci, node)) - true, tau)
    return Elements(a, e, inclination, raan, perigee, anomaly - e_sin)


def orbit_motion(r_eci: Vec3, v_eci: Vec3) -> tuple[float, float]:
    """Return rate (rad/s) and period (s) of the orbit through r (m) with v (m/s)."""
    n = mean_motion(elements_from_state(r_eci, v_eci).semi_major_axis)
    return n, 2.0 * pi / n


def latitude_of(orbit: Elements, r_eci: Vec3) -> tuple[float, float]:
    """Return cosine and sine of the argument of latitude of a point r (m) of an orbit."""
    node, ahead, _ = orbit_plane(orbit.inclination, orbit.raan)
    size = norm(r_eci)
    return dot(r_eci, node) / size, dot(r_eci, ahead) / size


def state_from_elements(elements: Elements, mu: float = MU) -> tuple[Vec3, Vec3]:
    """Compute r (m) and v (m/s) on the ellipse of the elements, at their time."""
    a, e, i, raan, perigee, anomaly = elements
    p, q = perifocal_axes(i, raan, perigee)
    return ellipse_state(a, e, anomaly, mean_motion(a, mu), p, q)


def rotate_elements(elements: Elements, c: Mat33) -> Elements:
    """Transform the elements of an ellipse to another frame, v_other = c v."""
    p, q = perifocal_axes(
        elements.inclination, elements.raan, elements.argument_of_perigee
    )
    p, q = mat_vec(c, p), mat_vec(c, q)
    nx, ny, nz = cross(p, q)
    tilt = sqrt(nx * nx + ny * ny)
    inclination = atan2(tilt, nz)
    raan = atan2(nx, -ny) if tilt > 1e-12 else 0.0
    node, ahead, _ = orbit_plane(inclination, raan)
    perigee = atan2(dot(p, ahead), dot(p, node))
    return Elements(
        elements.semi_major_axis,
        elements.eccentricity,
        inclination,
        raan,
        perigee,
        elements.mean_anomaly,
    )
