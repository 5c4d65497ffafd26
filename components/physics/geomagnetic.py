"""Compute the geomagnetic field of a centred dipole or of spherical harmonics.

Axes are Earth-fixed: z along the rotation axis to the north pole, x to the meridian of
Greenwich.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial, sqrt

from ..contract.block import Vec3
from . import igrf14

REFERENCE_RADIUS = 6371200.0  # m, of the Gauss coefficients
LEAST_SHARE, MOST_SHARE = 0.6, 2.5  # of the dipole's field at its equator (1)

_Row = tuple[float, float, float, float, float, float, float]
# Terms that `field` sums: for each order m the rows of its degrees, as `harmonics`
# computes them.
Harmonics = tuple[tuple[_Row, ...], ...]


def dipole(r: Vec3, moment: Vec3) -> Vec3:
    """Compute the field B (T) of a centred dipole at r (m).

    B = (3 (m.u) u - m) / r^3 with u = r / |r|. `moment` is mu_0 / (4 pi) times the
    magnetic moment (T m3), or (g11, h11, g10) times the cube of the reference radius:
    it points south. r, moment and B are in the same axes, whichever these are.
    """
    x, y, z = r
    mx, my, mz = moment
    size2 = x * x + y * y + z * z
    cube = 1.0 / (size2 * sqrt(size2))
    k = 3.0 * cube * (mx * x + my * y + mz * z) / size2
    return (k * x - cube * mx, k * y - cube * my, k * z - cube * mz)


def is_plausible(b: float, moment: float, radius: float) -> bool:
    """Return whether a field of the size b (T) may be the Earth's at a radius (m).

    It is from 0.6 to 2.5 times that of a dipole (moment, T m3) at its equator: of IGRF-14
    at the surface from 0.74 times, in the South Atlantic, to 2.25 times, near the south
    magnetic pole.
    """
    share = b * radius * radius * radius / moment
    return LEAST_SHARE < share < MOST_SHARE


# Factors from Schmidt's normalisation to none, of degree n and order m.
_SCHMIDT = tuple(
    tuple(
        sqrt((2 if m else 1) * factorial(n - m) / factorial(n + m)) if m <= n else 0.0
        for m in range(igrf14.DEGREE + 1)
    )
    for n in range(igrf14.DEGREE + 1)
)


def harmonics(coefficients: igrf14.Gauss, degree: int) -> Harmonics:
    """Convert Gauss coefficients up to a degree to the terms that `field` sums.

    The potential R sum (R/r)^(n+1) (g cos m phi + h sin m phi) S_nm is a sum of solid
    harmonics Z_nm = (R/r)^(n+1) P_nm e^(i m phi), without normalisation. The Cartesian
    derivatives of one are harmonics of the next degree (Montenbruck & Gill, Satellite
    Orbits, eq. 3.33):

        d/dz Z_nm = -(n-m+1) Z_n+1,m
        d/dx Z_nm = (-Z_n+1,m+1 + (n-m+2)(n-m+1) Z_n+1,m-1) / 2    (-Z_n+1,1 for m = 0)

    and likewise d/dy. Each component of B is therefore such a sum itself, of one degree
    more, and needs neither an angle nor a division by the cosine of the latitude. With
    Z_nm = K_nm (R/r) w^m p_nm, w = (x + i y) R/r^2, p_mm = 1, the recursion in n needs
    only one constant:

        p_n+1 = (z R/r^2) p_n - beta_n (R/r)^2 p_n-1

    A row is beta_n, then K_nm times the real and imaginary part of the factor of Z_nm
    in B_x, B_y and B_z; the sign of the imaginary part is reversed.
    """
    top = min(degree, igrf14.DEGREE) + 1
    return tuple(
        tuple(_row(coefficients, top - 1, n, m) for n in range(m, top + 1))
        for m in range(top + 1)
    )


def _row(coefficients: igrf14.Gauss, degree: int, n: int, m: int) -> _Row:
    """Compute the row of Z_nm.

    It takes the coefficients of degree n - 1 and of the orders m - 1, m and m + 1.
    """
    scale = 1.0
    for odd in range(1, 2 * m, 2):
        scale *= odd
    for degree_now in range(m + 1, n + 1):
        scale *= (2 * degree_now - 1) / (degree_now - m)
    g_below, h_below = _gauss(coefficients, degree, n - 1, m - 1)
    g, h = _gauss(coefficients, degree, n - 1, m)
    g_above, h_above = _gauss(coefficients, degree, n - 1, m + 1)
    half = 0.5 if m > 1 else 1.0
    k = 0.5 * (n - m) * (n - m - 1)
    return (
        (n + m) * (n - m) / ((2 * n + 1) * (2 * n - 1)),
        scale * (half * g_below - k * g_above),
        scale * (half * h_below - k * h_above),
        scale * (-half * h_below - k * h_above),
        scale * (half * g_below + k * g_above),
        scale * ((n - m) * g),
        scale * ((n - m) * h),
    )


def _gauss(
    coefficients: igrf14.Gauss, degree: int, n: int, m: int
) -> tuple[float, float]:
    """Return g_nm and h_nm (T) without normalisation; 0 where there is none."""
    if not (1 <= n <= degree and 0 <= m <= n):
        return 0.0, 0.0
    first, schmidt = n * n - 1, _SCHMIDT[n][m]
    if m == 0:
        return coefficients[first] * schmidt, 0.0
    return coefficients[first + 2 * m - 1] * schmidt, coefficients[
        first + 2 * m
    ] * schmidt


@lru_cache(maxsize=16)
def _model(k: int, degree: int) -> tuple[Harmonics, Harmonics]:
    """Return the harmonics of IGRF-14 model number k and of their change per year.

    They are cached, as a block needs them again at each node. The change of the present
    model ends at degree 8.
    """
    now, change = igrf14.model(k, degree)
    last = 0
    for n in range(1, degree + 1):
        if any(change[j] != 0.0 for j in range(n * n - 1, n * (n + 2))):
            last = n
    return harmonics(now, degree), harmonics(change, last)


def igrf(r: Vec3, year: float, degree: int = igrf14.DEGREE) -> Vec3:
    """Compute the field B (T) of IGRF-14 up to a degree at r (m) in a decimal year.

    Position and field are Earth-fixed.

    Raises
    ------
    BlockError
        If the year is outside of those that IGRF-14 covers.
    """
    k = igrf14.model_of(year)
    now, change = _model(k, degree)
    since = year - igrf14.model_year(k)
    bx, by, bz = field(r, now)
    dx, dy, dz = field(r, change)
    return (bx + since * dx, by + since * dy, bz + since * dz)


def field(r: Vec3, model: Harmonics) -> Vec3:
    """Compute the field B (T) of spherical harmonics at r (m), both Earth-fixed.

    The result is also valid at the poles.
    """
    x, y, z = r
    size2 = x * x + y * y + z * z
    s = REFERENCE_RADIUS / size2
    q = REFERENCE_RADIUS * s
    x, y, z = x * s, y * s, z * s
    bx = by = bz = 0.0
    wr, wi = 1.0, 0.0  # w^m
    for rows in model:
        xr = xi = yr = yi = zr = zi = before = 0.0
        p = 1.0
        for beta, fxr, fxi, fyr, fyi, fzr, fzi in rows:
            xr += fxr * p
            xi += fxi * p
            yr += fyr * p
            yi += fyi * p
            zr += fzr * p
            zi += fzi * p
            before, p = p, z * p - beta * q * before
        bx += xr * wr + xi * wi
        by += yr * wr + yi * wi
        bz += zr * wr + zi * wi
        wr, wi = wr * x - wi * y, wr * y + wi * x
    k = sqrt(q)
    return (k * bx, k * by, k * bz)
