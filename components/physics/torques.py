"""External torques on a rigid body, in the body frame.

Each takes body-frame vectors and gives a torque in N m.
"""

from __future__ import annotations

from math import sqrt

from ..contract.block import Mat33, Table, Vec3
from ..maths.vector import cross, dot, mat_vec, scale
from .orbit import MU

SOLAR_PRESSURE = 4.56e-6
"""Radiation pressure at 1 astronomical unit (N/m2), 1367 W/m2 over the speed of light."""

PLATE_COLUMNS = 9
"""Of a plate table: outward normal (3), area (m2), centre (3, m), specular and diffuse share."""


def gravity_gradient(r: Vec3, inertia: Mat33) -> Vec3:
    """3 mu / r^5 r x J r, with r (m) the position from the Earth's centre in body."""
    x, y, z = r
    jx, jy, jz = mat_vec(inertia, r)
    size2 = x * x + y * y + z * z
    g = 3.0 * MU / (size2 * size2 * sqrt(size2))
    return (g * (y * jz - z * jy), g * (z * jx - x * jz), g * (x * jy - y * jx))


def drag(v: Vec3, density: float, area_cd: float, centre: Vec3) -> Vec3:
    """c x F with F = -1/2 rho C_d A |v| v on a projected area (C_d A in m2).

    v (m/s) is the velocity relative to the atmosphere, c (m) the centre of pressure.
    """
    speed = sqrt(dot(v, v))
    return cross(centre, scale(-0.5 * density * area_cd * speed, v))


def drag_on_plates(v: Vec3, density: float, drag_coefficient: float, plates: Table) -> Vec3:
    """Sum over the plates that face the flow: F = -1/2 rho C_d A (n.v) v."""
    tx = ty = tz = 0.0
    for nx, ny, nz, area, cx, cy, cz, _, _ in _rows(plates):
        facing = nx * v[0] + ny * v[1] + nz * v[2]
        if area > 0.0 and facing > 0.0:
            size = -0.5 * density * drag_coefficient * area * facing
            x, y, z = cross((cx, cy, cz), (size * v[0], size * v[1], size * v[2]))
            tx, ty, tz = tx + x, ty + y, tz + z
    return (tx, ty, tz)


def radiation(sun: Vec3, pressure: float, area_cr: float, centre: Vec3) -> Vec3:
    """c x F with F = -P C_r A s on a projected area; s is the unit vector to the Sun."""
    return cross(centre, scale(-pressure * area_cr, sun))


def radiation_on_plates(sun: Vec3, pressure: float, plates: Table) -> Vec3:
    """Sum over the lit plates: F = -P A cos [(1 - rs) s + 2 (rs cos + rd / 3) n].

    rs and rd are the specular and the diffuse share of the reflected light (Wertz, Spacecraft
    Attitude Determination and Control, eq. 17-34).
    """
    tx = ty = tz = 0.0
    for nx, ny, nz, area, cx, cy, cz, specular, diffuse in _rows(plates):
        cosine = nx * sun[0] + ny * sun[1] + nz * sun[2]
        if area > 0.0 and cosine > 0.0:
            size = -pressure * area * cosine
            a, b = size * (1.0 - specular), 2.0 * size * (specular * cosine + diffuse / 3.0)
            force = (a * sun[0] + b * nx, a * sun[1] + b * ny, a * sun[2] + b * nz)
            x, y, z = cross((cx, cy, cz), force)
            tx, ty, tz = tx + x, ty + y, tz + z
    return (tx, ty, tz)


def present(plates: Table) -> Table:
    """The rows of a plate table that have an area."""
    return tuple(x for row in _rows(plates) if row[3] > 0.0 for x in row)


def lever(plates: Table) -> float:
    """The sum of area times distance from the centre (m3): no pressure makes more torque."""
    total = 0.0
    for _, _, _, area, cx, cy, cz, _, _ in _rows(plates):
        total += area * sqrt(cx * cx + cy * cy + cz * cz)
    return total


def _rows(plates: Table) -> list[Table]:
    return [plates[i : i + PLATE_COLUMNS] for i in range(0, len(plates), PLATE_COLUMNS)]
