"""The geomagnetic field: centred dipole and spherical harmonics, in Earth-fixed axes.

Earth-fixed: z along the rotation axis to the north pole, x to the meridian of Greenwich.
"""

from __future__ import annotations

from functools import lru_cache
from math import factorial, sqrt

from ..contract.block import Vec3
from . import igrf14

REFERENCE_RADIUS = 6371200.0
"""Of the Gauss coefficients (m)."""

_Row = tuple[float, float, float, float, float, float, float]
Harmonics = tuple[tuple[_Row, ...], ...]
"""What `field` sums: of each order m the rows of its degrees, as `harmonics` writes them."""


def dipole(r: Vec3, moment: Vec3) -> Vec3:
    """B = (3 (m.u) u - m) / r^3 (T) of a centred dipole, with u = r / |r| and r in m.

    `moment` is mu_0 / (4 pi) times the magnetic moment (T m3), or (g11, h11, g10) times the cube of
    the reference radius: it points south. r, moment and B are in the same axes, whichever.
    """
    x, y, z = r
    mx, my, mz = moment
    size2 = x * x + y * y + z * z
    cube = 1.0 / (size2 * sqrt(size2))
    k = 3.0 * cube * (mx * x + my * y + mz * z) / size2
    return (k * x - cube * mx, k * y - cube * my, k * z - cube * mz)


def harmonics(coefficients: igrf14.Gauss) -> Harmonics:
    """Gauss coefficients as the sum that `field` takes.

    The potential R sum (R/r)^(n+1) (g cos m phi + h sin m phi) S_nm is a sum of solid harmonics
    Z_nm = (R/r)^(n+1) P_nm e^(i m phi), without normalisation. The Cartesian derivatives of one are
    harmonics of the next degree (Montenbruck & Gill, Satellite Orbits, eq. 3.33):

        d/dz Z_nm = -(n-m+1) Z_n+1,m
        d/dx Z_nm = (-Z_n+1,m+1 + (n-m+2)(n-m+1) Z_n+1,m-1) / 2    (-Z_n+1,1 for m = 0)

    and likewise d/dy; so each component of B is such a sum itself, of one degree more, and needs
    neither an angle nor a division by the cosine of the latitude. With Z_nm = K_nm (R/r) w^m p_nm,
    w = (x + i y) R/r^2, p_mm = 1, the recursion in n needs but one constant:

        p_n+1 = (z R/r^2) p_n - beta_n (R/r)^2 p_n-1

    A row is beta_n, then K_nm times the real and imaginary part of the factor of Z_nm in B_x, B_y
    and B_z; the imaginary part has its sign turned.
    """
    top = max(n for n, _, _ in coefficients) + 1
    factor = {(n, m): [0j, 0j, 0j] for n in range(top + 1) for m in range(n + 1)}
    for n, m, value in coefficients:
        order = abs(m)
        schmidt = sqrt((2 if m else 1) * factorial(n - order) / factorial(n + order))
        c = value * schmidt * (1 if m >= 0 else -1j)
        factor[n + 1, order][2] += (n - order + 1) * c
        up = factor[n + 1, order + 1]
        up[0] += 0.5 * c if order else c
        up[1] -= 0.5j * c if order else 1j * c
        if order:
            k = 0.5 * (n - order + 2) * (n - order + 1)
            down = factor[n + 1, order - 1]
            down[0] -= k * c
            down[1] -= k * 1j * c
    orders = []
    for m in range(top + 1):
        rows = []
        scale = 1.0
        for odd in range(1, 2 * m, 2):
            scale *= odd
        for n in range(m, top + 1):
            if n > m:
                scale *= (2 * n - 1) / (n - m)
            beta = (n + m) * (n - m) / ((2 * n + 1) * (2 * n - 1))
            x, y, z = (scale * f for f in factor[n, m])
            rows.append((beta, x.real, -x.imag, y.real, -y.imag, z.real, -z.imag))
        orders.append(tuple(rows))
    return tuple(orders)


@lru_cache(maxsize=16)
def _model(k: int, degree: int) -> tuple[Harmonics, Harmonics]:
    """Model number k of IGRF-14 and its change a year, for `field`; remembered, as a block asks for
    it again at each node. The change of today's ends at degree 8."""
    now, change = igrf14.model(k, degree)
    last = max(n for n, _, value in change if value != 0.0)
    return harmonics(now), harmonics(tuple(row for row in change if row[0] <= last))


def igrf(r: Vec3, year: float, degree: int = igrf14.DEGREE) -> Vec3:
    """B (T) of IGRF-14 up to a degree at r (m) in a decimal year, both Earth-fixed.

    Raises BlockError outside of the years that IGRF-14 covers.
    """
    k = igrf14.model_of(year)
    now, change = _model(k, degree)
    since = year - igrf14.model_year(k)
    bx, by, bz = field(r, now)
    dx, dy, dz = field(r, change)
    return (bx + since * dx, by + since * dy, bz + since * dz)


def field(r: Vec3, model: Harmonics) -> Vec3:
    """B (T) of spherical harmonics at r (m), both Earth-fixed; right at the poles too."""
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
