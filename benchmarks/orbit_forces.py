"""How far a day's orbit of environment_propagated (J2 to J4) is from one with the
forces that it leaves out, and what that does to the field and to the gravity gradient:
`of_a_day`.

Left out are the harmonics of EGM96 that turn with the Earth (here to degree and order
4), the Sun and the Moon, in whose place stand point masses on orbits of a few arc
minutes' accuracy. Integrated by scipy's DOP853 to 1e-12; the harmonics by Cunningham's
recursion. Drag is in neither.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from desat.components.physics import earth, geomagnetic
from desat.components.physics.orbit import (
    EARTH_RATE,
    MU,
    Elements,
    gravity,
    state_from_elements,
)

Array = NDArray[np.float64]

RADIUS = 6378136.3
MU_SUN, MU_MOON = 1.32712440018e20, 4.9028e12
EPOCH = 820497600.0
"""2026-01-01, s since J2000"""
NODE, NODES = 1.0, 12
"""Right ascension of the ascending node (rad), and how many others are looked at
besides."""
# EGM96, fully normalised: n, m, C, S. The zonals are those of `gravity`.
TESSERALS = (
    (2, 2, 2.43914352398e-06, -1.40016683654e-06),
    (3, 1, 2.02998882184e-06, 2.48513158716e-07),
    (3, 2, 9.04627768605e-07, -6.19025944205e-07),
    (3, 3, 7.21072657057e-07, 1.41435626958e-06),
    (4, 1, -5.36321616971e-07, -4.73440265853e-07),
    (4, 2, 3.50694105785e-07, 6.62671572540e-07),
    (4, 3, 9.90771803829e-07, -2.00928369177e-07),
    (4, 4, -1.88560802735e-07, 3.08853169333e-07),
)


def tesserals(r: Array) -> Array:
    """Acceleration (m/s2) by TESSERALS at r (m), both Earth-fixed: Montenbruck & Gill,
    Satellite Orbits, section 3.2.5."""
    x, y, z = r
    square = r @ r
    rho = RADIUS / square
    v, w = np.zeros((6, 6)), np.zeros((6, 6))
    v[0, 0] = RADIUS / math.sqrt(square)
    for m in range(6):
        if m:
            v[m, m] = (2 * m - 1) * rho * (x * v[m - 1, m - 1] - y * w[m - 1, m - 1])
            w[m, m] = (2 * m - 1) * rho * (x * w[m - 1, m - 1] + y * v[m - 1, m - 1])
        for n in range(m + 1, 6):
            before = (n + m - 1) / (n - m) * rho * RADIUS
            for of in (v, w):
                older = of[n - 2, m] if n > m + 1 else 0.0
                of[n, m] = (2 * n - 1) / (n - m) * z * rho * of[
                    n - 1, m
                ] - before * older
    a = np.zeros(3)
    for n, m, c, s in TESSERALS:
        norm = math.sqrt(
            2 * (2 * n + 1) * math.factorial(n - m) / math.factorial(n + m)
        )
        c, s, f = c * norm, s * norm, (n - m + 2) * (n - m + 1) / 2.0
        a += (
            0.5 * (-c * v[n + 1, m + 1] - s * w[n + 1, m + 1])
            + f * (c * v[n + 1, m - 1] + s * w[n + 1, m - 1]),
            0.5 * (-c * w[n + 1, m + 1] + s * v[n + 1, m + 1])
            + f * (-c * w[n + 1, m - 1] + s * v[n + 1, m - 1]),
            (n - m + 1) * (-c * v[n + 1, m] - s * w[n + 1, m]),
        )
    scaled: Array = MU / RADIUS**2 * a
    return scaled


def moon(epoch: float) -> Array:
    """The Moon (m, of date): the largest terms of its motion (Astronomical Almanac; 0.3
    deg)."""
    c = epoch / (36525.0 * 86400.0)

    def angle(start: float, rate: float) -> float:
        return math.radians((start + rate * c) % 360.0)

    longitude = math.radians(218.32 + 481267.8813 * c) + math.radians(
        6.29 * math.sin(angle(134.9, 477198.85))
        - 1.27 * math.sin(angle(259.2, -413335.38))
        + 0.66 * math.sin(angle(235.7, 890534.23))
        + 0.21 * math.sin(angle(269.9, 954397.70))
        - 0.19 * math.sin(angle(357.5, 35999.05))
        - 0.11 * math.sin(angle(186.6, 966404.05))
    )
    latitude = math.radians(
        5.13 * math.sin(angle(93.3, 483202.03))
        + 0.28 * math.sin(angle(228.2, 960400.87))
        - 0.28 * math.sin(angle(318.3, 6003.18))
        - 0.17 * math.sin(angle(217.6, -407332.20))
    )
    parallax = math.radians(
        0.9508
        + 0.0518 * math.cos(angle(134.9, 477198.85))
        + 0.0095 * math.cos(angle(259.2, -413335.38))
        + 0.0078 * math.cos(angle(235.7, 890534.23))
        + 0.0028 * math.cos(angle(269.9, 954397.70))
    )
    size, tilt = 6378137.0 / math.sin(parallax), math.radians(23.4393)
    x = math.cos(latitude) * math.cos(longitude)
    y, z = math.cos(latitude) * math.sin(longitude), math.sin(latitude)
    return size * np.array(
        [
            x,
            math.cos(tilt) * y - math.sin(tilt) * z,
            math.sin(tilt) * y + math.cos(tilt) * z,
        ]
    )


def third(r: Array, body: Array, mu: float) -> Array:
    """The tidal acceleration (m/s2) by a body (m) of mu (m3/s2)."""
    d = body - r
    pulled: Array = mu * (d / np.linalg.norm(d) ** 3 - body / np.linalg.norm(body) ** 3)
    return pulled


def day(
    altitude: float,
    inclination: float,
    forces: tuple[str, ...],
    seconds: float,
    node: float = NODE,
) -> Array:
    """Position and velocity (rows, 6) each minute of an orbit (m, rad) under J2 to J4
    and more."""
    start = Elements(6378137.0 + altitude, 1e-3, inclination, node, 0.5, 0.3)
    angle = earth.earth_angle(EPOCH)

    def slope(t: float, y: Array) -> Array:
        r = y[:3]
        a = np.array(gravity((r[0], r[1], r[2]), 4))
        if "tesserals" in forces:
            c, s = math.cos(angle + EARTH_RATE * t), math.sin(angle + EARTH_RATE * t)
            turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            a += turn.T @ tesserals(turn @ r)
        if "sun" in forces:
            direction, distance = earth.sun(EPOCH + t)
            a += third(r, distance * np.array(direction), MU_SUN)
        if "moon" in forces:
            a += third(r, moon(EPOCH + t), MU_MOON)
        return np.concatenate([y[3:], a])

    times = np.arange(0.0, seconds + 1.0, 60.0)
    r, v = state_from_elements(start)
    found = solve_ivp(
        slope,
        (0.0, seconds),
        np.array([*r, *v]),
        "DOP853",
        times,
        rtol=1e-12,
        atol=1e-6,
    )
    rows: Array = found.y.T
    return rows


def by_node(
    altitude: float, inclination: float, seconds: float = 86400.0
) -> tuple[float, float]:
    """The least and the largest of the largest distance by all that is left out (m),
    over nodes all around: where the Earth's tesseral harmonics stand as the orbit
    begins decides it."""
    found = []
    for k in range(NODES):
        node = 2.0 * math.pi * k / NODES
        saved, full = (
            day(altitude, inclination, f, seconds, node)
            for f in ((), ("tesserals", "sun", "moon"))
        )
        found.append(float(np.linalg.norm((full - saved)[:, :3], axis=1).max()))
    return min(found), max(found)


def of_a_day(
    altitude: float, inclination: float, seconds: float = 86400.0
) -> dict[str, Any]:
    """By force left out: the largest distance (m), by all also the largest difference
    of field (T), as a share of it, and of the direction to nadir (rad)."""
    saved = day(altitude, inclination, (), seconds)
    every = ("tesserals", "sun", "moon")
    away = {f: day(altitude, inclination, (f,), seconds) for f in every}
    full = day(altitude, inclination, every, seconds)
    angle = earth.earth_angle(EPOCH)

    def field(t: float, r: Array) -> Array:
        c, s = math.cos(angle + EARTH_RATE * t), math.sin(angle + EARTH_RATE * t)
        turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        x, y, z = turn @ r
        fixed = np.array(geomagnetic.igrf((x, y, z), earth.decimal_year(EPOCH + t)))
        return np.asarray(turn.T @ fixed)

    rows = range(0, len(saved), 5)
    fields = [
        (field(60.0 * k, saved[k, :3]), field(60.0 * k, full[k, :3])) for k in rows
    ]
    up = [
        x[:, :3] / np.linalg.norm(x[:, :3], axis=1, keepdims=True)
        for x in (saved, full)
    ]
    return {
        "altitude": altitude,
        "inclination": inclination,
        "seconds": seconds,
        "distance": {
            **{
                f: float(np.linalg.norm((x - saved)[:, :3], axis=1).max())
                for f, x in away.items()
            },
            "all": float(np.linalg.norm((full - saved)[:, :3], axis=1).max()),
        },
        "by_node": by_node(altitude, inclination, seconds),
        "field": max(float(np.linalg.norm(a - b)) for a, b in fields),
        "field_share": max(
            float(np.linalg.norm(a - b) / np.linalg.norm(a)) for a, b in fields
        ),
        "nadir": float(np.linalg.norm(up[0] - up[1], axis=1).max()),
    }
