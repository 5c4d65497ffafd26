"""Compute external torques on a rigid body, in the body frame.

Each function takes body-frame vectors and returns a torque in N m.
"""

from __future__ import annotations

from math import sqrt

from ..contract.block import BlockError, Mat33, Table, Vec3, Vec4
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import ZERO, add, cross, dot, mat_vec, norm, scale, sub, unit
from .orbit import MU

# N/m2, radiation pressure at 1 astronomical unit: 1367 W/m2, the only solar constant here,
# over the speed of light (Montenbruck & Gill, Satellite Orbits, sec. 3.4).
SOLAR_PRESSURE = 4.56e-6

# Columns of a plate table: outward normal (3), area (m2), centre (3, m), specular and
# diffuse fraction.
PLATE_COLUMNS = 9

# Normal n (3), area (m2), centre c (3, m), c x n (3, m), specular and diffuse fraction.
Plate = tuple[
    float, float, float, float, float, float, float, float, float, float, float, float
]

Plates = tuple[Plate, ...]


def gravity_gradient(r: Vec3, inertia: Mat33, mu: float = MU) -> Vec3:
    """Compute the gravity-gradient torque 3 mu / r^5 r x J r (N m).

    r (m) is the position from the centre, body; mu (m3/s2) by default the Earth's.
    """
    x, y, z = r
    jx, jy, jz = mat_vec(inertia, r)
    size2 = x * x + y * y + z * z
    g = 3.0 * mu / (size2 * size2 * sqrt(size2))
    return (g * (y * jz - z * jy), g * (z * jx - x * jz), g * (x * jy - y * jx))


def gravity_gradient_eci(r_eci: Vec3, q_bi: Vec4, inertia: Mat33) -> Vec3:
    """Compute the gravity-gradient torque (N m, eci) at r (m) and an attitude.

    inertia (kg m2): in the body frame.
    """
    return rotate_back(q_bi, gravity_gradient(rotate(q_bi, r_eci), inertia))


def drag(v: Vec3, density: float, area_cd: float, centre: Vec3) -> Vec3:
    """Compute the aerodynamic torque (N m) on a projected area (C_d A in m2).

    c x F with F = -1/2 rho C_d A |v| v; v (m/s) is the velocity relative to the
    atmosphere, c (m) the centre of pressure.
    """
    speed = sqrt(dot(v, v))
    return cross(centre, scale(-0.5 * density * area_cd * speed, v))


def drag_on_plates(
    v: Vec3,
    density: float,
    drag_coefficient: float,
    plates: Plates,
    drives: tuple[Vec3, ...],
) -> Vec3:
    """Compute the aerodynamic torque (N m) on the plates that face the flow.

    Sum of c x F with F = -1/2 rho C_d A |n.v| v. A plate with a drive is a wing, which
    the flow meets from both sides.
    """
    vx, vy, vz = v
    x = y = z = 0.0  # the sum of A |n.v| c
    for (nx, ny, nz, area, cx, cy, cz, _, _, _, _, _), drive in zip(
        plates, drives, strict=True
    ):
        facing = nx * vx + ny * vy + nz * vz
        if facing < 0.0 and drive != ZERO:
            facing = -facing
        if facing > 0.0:
            size = area * facing
            x, y, z = x + size * cx, y + size * cy, z + size * cz
    return scale(
        -0.5 * density * drag_coefficient,
        (y * vz - z * vy, z * vx - x * vz, x * vy - y * vx),
    )


def radiation(sun: Vec3, pressure: float, area_cr: float, centre: Vec3) -> Vec3:
    """Compute the torque of solar radiation (N m) on a projected area.

    c x F with F = -P C_r A s; s is the unit vector to the Sun.
    """
    return cross(centre, scale(-pressure * area_cr, sun))


def radiation_on_plates(sun: Vec3, pressure: float, plates: Plates) -> Vec3:
    """Compute the torque of solar radiation (N m) on the lit plates.

    Sum of c x F with F = -P A cos [(1 - rs) s + 2 (rs cos + rd / 3) n]; rs and rd are
    the specular and the diffuse fraction of the reflected light (Wertz, Spacecraft
    Attitude Determination and Control, eq. 17-34).
    """
    sx, sy, sz = sun
    x = y = z = 0.0  # the sum of A cos (1 - rs) c
    tx = ty = tz = 0.0  # the sum of 2 A cos (rs cos + rd / 3) c x n
    for nx, ny, nz, area, cx, cy, cz, mx, my, mz, specular, diffuse in plates:
        cosine = nx * sx + ny * sy + nz * sz
        if cosine > 0.0:
            a = area * cosine
            b = 2.0 * a * (specular * cosine + diffuse / 3.0)
            a = a * (1.0 - specular)
            x, y, z = x + a * cx, y + a * cy, z + a * cz
            tx, ty, tz = tx + b * mx, ty + b * my, tz + b * mz
    return scale(
        -pressure, (tx + y * sz - z * sy, ty + z * sx - x * sz, tz + x * sy - y * sx)
    )


def facing(plates: Plates, drives: tuple[Vec3, ...], sun: Vec3) -> Plates:
    """Turn the plates about their drive axes towards the Sun.

    The normal of each comes as near to the Sun's direction as it can. The axes are unit
    vectors; zero: fixed.
    """
    return tuple(
        _turn_plate(p, axis, sun) for p, axis in zip(plates, drives, strict=True)
    )


def _turn_plate(plate: Plate, axis: Vec3, sun: Vec3) -> Plate:
    """Turn one plate about its axis towards the Sun."""
    nx, ny, nz, area, cx, cy, cz, mx, my, mz, specular, diffuse = plate
    along = dot(axis, sun)
    across = sub(sun, scale(along, axis))
    size = norm(across)
    if axis != ZERO and size > 0.0:
        nx, ny, nz = scale(1.0 / size, across)
        mx, my, mz = cross((cx, cy, cz), (nx, ny, nz))
    return (nx, ny, nz, area, cx, cy, cz, mx, my, mz, specular, diffuse)


def drives_of(table: Table, drives: Table) -> tuple[Vec3, ...]:
    """Return the drive axis of each plate that has an area.

    Each is a unit vector; zero: no drive.
    """
    return tuple(
        _unit_or_zero(drives[3 * i : 3 * i + 3])
        for i in range(len(drives) // 3)
        if table[PLATE_COLUMNS * i + 3] > 0.0
    )


def _unit_or_zero(row: Table) -> Vec3:
    """Normalise a row of three; a row of zeros remains zero."""
    x, y, z = row
    size = norm((x, y, z))
    return scale(1.0 / size, (x, y, z)) if size > 0.0 else ZERO


def plates_of(table: Table, offset: Vec3) -> Plates:
    """Read the plates of a table that have an area, with normals of length 1.

    Their centres are moved by the offset (m).

    Raises
    ------
    BlockError
        If an area, a normal or reflected fractions are invalid.
    """
    rows = tuple(
        table[i : i + PLATE_COLUMNS] for i in range(0, len(table), PLATE_COLUMNS)
    )
    for i, (nx, ny, nz, area, _, _, _, specular, diffuse) in enumerate(rows):
        if area < 0.0:
            raise BlockError(f"plates[{i + 1},4] = {area} m2: an area is 0 or more")
        if area > 0.0 and nx == ny == nz == 0.0:
            raise BlockError(
                f"plates[{i + 1},1..3] = 0: a plate with an area needs a normal"
            )
        if not (specular >= 0.0 and diffuse >= 0.0 and specular + diffuse <= 1.0):
            raise BlockError(
                f"plates[{i + 1},8..9] = {specular}, {diffuse}: the specular and the diffuse share "
                "are 0 or more and together 1 or less"
            )
    return tuple(_plate(row, offset) for row in rows if row[3] > 0.0)


def _plate(row: Table, offset: Vec3) -> Plate:
    """Build a plate from a row of the parameter `plates`, moved by the offset (m).

    Unit normal n (1), area (m2), centre c (m), c x n (m), specular and diffuse shares
    of the reflected light (1).
    """
    nx, ny, nz, area, cx, cy, cz, specular, diffuse = row
    nx, ny, nz = unit((nx, ny, nz))
    cx, cy, cz = add((cx, cy, cz), offset)
    mx, my, mz = cross((cx, cy, cz), (nx, ny, nz))
    return (nx, ny, nz, area, cx, cy, cz, mx, my, mz, specular, diffuse)


def lever(plates: Plates) -> float:
    """Compute the sum of area times distance from the centre (m3).

    No pressure makes a torque greater than it times this sum.
    """
    total = 0.0
    for _, _, _, area, cx, cy, cz, _, _, _, _, _ in plates:
        total += area * norm((cx, cy, cz))
    return total
