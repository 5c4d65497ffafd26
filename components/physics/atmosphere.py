"""Compute the density of the upper atmosphere: by a table, or by solar activity.

The table is piecewise exponential.
"""

from __future__ import annotations

from bisect import bisect_right
from math import asin, atan2, copysign, cos, exp, pi, radians, remainder, sin, sqrt, tau

from ..contract.block import Vec3

# m: range in which the densities of `table` and `by_activity` are those of an orbit.
# Below it the air is not in free molecular flow; above it the outermost layer
# continues.
HEIGHTS = (100e3, 1000e3)

# base altitude (km), nominal density (kg/m3), scale height (km)
_LAYERS = (
    (0.0, 1.225, 7.249),
    (25.0, 3.899e-2, 6.349),
    (30.0, 1.774e-2, 6.682),
    (40.0, 3.972e-3, 7.554),
    (50.0, 1.057e-3, 8.382),
    (60.0, 3.206e-4, 7.714),
    (70.0, 8.770e-5, 6.549),
    (80.0, 1.905e-5, 5.799),
    (90.0, 3.396e-6, 5.382),
    (100.0, 5.297e-7, 5.877),
    (110.0, 9.661e-8, 7.263),
    (120.0, 2.438e-8, 9.473),
    (130.0, 8.484e-9, 12.636),
    (140.0, 3.845e-9, 16.149),
    (150.0, 2.070e-9, 22.523),
    (180.0, 5.464e-10, 29.740),
    (200.0, 2.789e-10, 37.105),
    (250.0, 7.248e-11, 45.546),
    (300.0, 2.418e-11, 53.628),
    (350.0, 9.518e-12, 53.298),
    (400.0, 3.725e-12, 58.515),
    (450.0, 1.585e-12, 60.828),
    (500.0, 6.967e-13, 63.822),
    (600.0, 1.454e-13, 71.835),
    (700.0, 3.614e-14, 88.667),
    (800.0, 1.170e-14, 124.64),
    (900.0, 5.245e-15, 181.05),
    (1000.0, 3.019e-15, 268.00),
)
_BASES = tuple(1e3 * layer[0] for layer in _LAYERS)


def exponential(
    altitude: float, base: float, density: float, scale_height: float
) -> float:
    """Compute the density (kg/m3) of one exponential layer; heights in m.

    rho = density exp(-(altitude - base) / scale_height).
    """
    return density * exp((base - altitude) / scale_height)


def table(altitude: float) -> float:
    """Look up the static density (kg/m3) at a height (m) above the ellipsoid.

    It is that of moderate solar activity: Vallado, Fundamentals of Astrodynamics and
    Applications, 4th ed., table 8-4 (US Standard Atmosphere 1976, CIRA-72). Between two
    layers it jumps by at most 1e-4 (relative), but by 1.4e-3 at 25 km. Below 0 and
    above 1000 km the outermost layers continue.
    """
    base, density, scale_height = _LAYERS[max(bisect_right(_BASES, altitude) - 1, 0)]
    return exponential(altitude, 1e3 * base, density, 1e3 * scale_height)


# --- by solar activity ----------------------------------------------------------------

# F10.7 (1e-22 W/(m2 Hz)) and Ap of low, moderate and high long-term activity:
# ECSS-E-ST-10-04C, Space environment (2008), and ISO 14222.
ACTIVITY = ((65.0, 0.0), (140.0, 15.0), (250.0, 45.0))

# ap (2 nT) of Kp = 0, 1/3, 2/3 to 9, by its definition (Bartels).
_AP = (
    0,
    2,
    3,
    4,
    5,
    6,
    7,
    9,
    12,
    15,
    18,
    22,
    27,
    32,
    39,
    48,
    56,
    67,
    80,
    94,
    111,
    132,
    154,
    179,
    207,
    236,
    300,
    400,
)

_BASE = 120e3  # m: height above which the gases separate
_BASE_TEMPERATURE = 355.0
# N2, O2, O, He: number at the base (1/m3), mass (u), factor of thermal diffusion.
_GASES = (
    (4.0e17, 28.0134, 0.0),
    (7.5e16, 31.9988, 0.0),
    (7.6e16, 15.9994, 0.0),
    (3.4e13, 4.0026, -0.38),
)
_RADIUS = 6356766.0
_GAS_CONSTANT, _DALTON = 8314.462618, 1.66053906660e-27  # J/(kmol K), kg
_OBLIQUITY = radians(23.44)


def kp_of_ap(ap: float) -> float:
    """Convert an index ap to Kp, linear between thirds; 9 above 400."""
    k = min(bisect_right(_AP, ap), len(_AP) - 1)
    low, high = _AP[k - 1], _AP[k]
    return (k - 1 + min((ap - low) / (high - low), 1.0)) / 3.0


def coldest_temperature(f107: float) -> float:
    """Compute the lowest temperature (K) of the exosphere without magnetic disturbance.

    It is the lowest of the day, by F10.7 (1e-22 W/(m2 Hz)), which also stands for its
    mean over 81 days. Jacchia (1971).
    """
    return 379.0 + 3.24 * f107


def exosphere(
    latitude: float, hour_angle: float, declination: float, coldest: float, kp: float
) -> float:
    """Compute the temperature of the exosphere (K).

    Its bulge lies two hours after noon. Angles in rad: geographic latitude, hour angle
    and declination of the Sun. `coldest` is the temperature of `coldest_temperature`
    (K). Jacchia (1971); Montenbruck & Gill, Satellite Orbits, section 3.5.3.
    """
    theta, eta = 0.5 * abs(latitude + declination), 0.5 * abs(latitude - declination)
    lag = hour_angle - radians(37.0) + radians(6.0) * sin(hour_angle + radians(43.0))
    day = max(cos(0.5 * remainder(lag, tau)), 0.0)
    night: float = sin(theta) ** 2.2
    noon: float = cos(eta) ** 2.2
    return (
        coldest * (1.0 + 0.3 * (night + (noon - night) * day * day * day))
        + 28.0 * kp
        + 0.03 * exp(kp)
    )


def semiannual(epoch: float) -> float:
    """Compute the factor g of the semiannual variation at an epoch (s since J2000).

    Jacchia (1971).
    """
    phase = (epoch / 86400.0 + 51544.5 - 36204.0) / 365.2422
    turn: float = phase + 0.09544 * (
        (0.5 + 0.5 * sin(tau * phase + 6.035)) ** 1.65 - 0.5
    )
    return 0.02835 + (0.3817 + 0.17829 * sin(tau * turn + 4.137)) * sin(
        2.0 * tau * turn + 4.259
    )


def diffusive_density(altitude: float, temperature: float, helium: float) -> float:
    """Compute the density (kg/m3) at a height (m) from 120 km on.

    `temperature` is that of the exosphere (K). Each gas is in diffusive equilibrium by
    itself above 120 km, where its number density is fixed; `helium` multiplies that of
    helium. Jacchia, Static diffusion models of the upper atmosphere with empirical
    temperature profiles, Smithsonian Astrophys. Obs. Special Report 170 (1964), in the
    closed form of Walker, J. Atmos. Sci. 22 (1965) 462.
    """
    x = temperature - 800.0
    x /= 750.0 + 1.722e-4 * x * x
    base = _RADIUS + _BASE
    gradient = 2.91e-5 * exp(-0.5 * x * x) + 1.0 / base
    up = (altitude - _BASE) * base / (_RADIUS + altitude)
    decay = exp(-gradient * up)
    cooler = _BASE_TEMPERATURE / (
        temperature - (temperature - _BASE_TEMPERATURE) * decay
    )
    gravity = 9.80665 * (_RADIUS / base) ** 2
    k = gravity / (_GAS_CONSTANT * temperature * gradient)
    density = 0.0
    for number, mass, diffusion in _GASES:
        gamma = mass * k
        amount = (
            number * cooler ** (1.0 + diffusion + gamma) * exp(-gamma * gradient * up)
        )
        density += mass * _DALTON * (amount if diffusion == 0.0 else helium * amount)
    return density


def by_activity(
    altitude: float, r: Vec3, sun: Vec3, epoch: float, coldest: float, kp: float
) -> float:
    """Compute the density (kg/m3) by solar activity, place, local time and season.

    altitude (m) above the ellipsoid; r (m) and the unit vector to the Sun in axes of
    the equator; epoch (s since J2000); `coldest`, the temperature of
    `coldest_temperature` (K); Kp for magnetic activity. The density is that of
    `diffusive_density` at the temperature of `exosphere`, with the semiannual and the seasonal
    variation of Jacchia (1971). Below 120 km it is that of `table`, scaled to be
    continuous.

    Jacchia, Revised static models of the thermosphere and exosphere with empirical
    temperature profiles, Smithsonian Astrophys. Obs. Special Report 332 (1971).
    """
    x, y, z = r
    latitude = asin(max(min(z / sqrt(x * x + y * y + z * z), 1.0), -1.0))
    declination = asin(max(min(sun[2], 1.0), -1.0))
    hour_angle = atan2(y, x) - atan2(sun[1], sun[0])
    temperature = exosphere(latitude, hour_angle, declination, coldest, kp)

    season = sin(0.25 * pi - 0.5 * copysign(latitude, latitude * declination))
    helium = 0.65 * abs(declination) / _OBLIQUITY * (season * season * season - 0.35355)
    above = max(altitude, _BASE)
    density = diffusive_density(above, temperature, 10.0**helium)
    km = 1e-3 * above
    strength: float = (5.876e-7 * km**2.331 + 0.06328) * exp(-2.868e-3 * km)
    with_season: float = density * 10.0 ** (strength * semiannual(epoch))
    return (
        with_season
        if altitude >= _BASE
        else with_season * table(altitude) / table(_BASE)
    )
