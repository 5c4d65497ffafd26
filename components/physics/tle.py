"""Propagate two-line elements with SGP4, by the package sgp4.

sgp4 is the only package outside of the standard library that a block needs; it is
imported at its first use.
"""

from __future__ import annotations

import importlib
from functools import lru_cache
from typing import Any

from ..contract.block import BlockError, Vec3

_DAY = 86400.0
_J2000 = 2451545.0
_SGP4_EPOCH = 18263.5  # days from 1949-12-31T00:00, where SGP4 counts from, to J2000

# Epoch (s since J2000, UTC), B* (per Earth radius), eccentricity, argument of perigee,
# inclination, mean anomaly (rad), mean motion (rad/s), raan (rad): of Kozai's theory,
# TEME.
MeanElements = tuple[float, float, float, float, float, float, float, float]


def _package() -> Any:
    """Import sgp4; raise BlockError if it is not installed."""
    try:
        return importlib.import_module("sgp4.api")
    except ImportError as error:
        raise BlockError(
            "two-line elements need the Python package sgp4 in the host's Python: pip install sgp4"
        ) from error


@lru_cache(maxsize=16)
def _satellite(elements: MeanElements) -> Any:
    """Initialise the record of sgp4.

    A block cannot hold the record, as it is not JSON-able.
    """
    sgp4 = _package()
    epoch, bstar, eccentricity, perigee, inclination, anomaly, motion, raan = elements
    record = sgp4.Satrec()
    # SGP4 itself uses neither the catalogue number nor the derivatives of the mean
    # motion
    record.sgp4init(
        sgp4.WGS72,
        "i",
        0,
        epoch / _DAY + _SGP4_EPOCH,
        bstar,
        0.0,
        0.0,
        eccentricity,
        perigee,
        inclination,
        anomaly,
        60.0 * motion,
        raan,
    )
    return record


def teme_state(elements: MeanElements, time: float) -> tuple[Vec3, Vec3]:
    """Compute r (m) and v (m/s) in TEME, `time` (s) after the epoch of the elements.

    Raises
    ------
    BlockError
        If sgp4 is missing, or with SGP4's own error.
    """
    error, (x, y, z), (vx, vy, vz) = _satellite(elements).sgp4_tsince(time / 60.0)
    if error:
        text = _package().SGP4_ERRORS.get(error, f"error {error}")
        raise BlockError(f"SGP4, {time:g} s after the epoch of the elements: {text}")
    return (1e3 * x, 1e3 * y, 1e3 * z), (1e3 * vx, 1e3 * vy, 1e3 * vz)


def tle_parameters(line1: str, line2: str) -> dict[str, float]:
    """Convert two lines to the parameters of the block environment_tle.

    They are for a scenario. `epoch_j2000` is not among them: t = 0 may be any time,
    best within days of `epoch_tle_j2000`.

    Raises
    ------
    BlockError
        If the lines are not those of a two-line element set.
    """
    api, lines = _package(), (line1, line2)
    for number, line in enumerate(lines, 1):
        digits = sum(int(c) if c.isdigit() else c == "-" for c in line[:68])
        if not line.startswith(f"{number} ") or line[68:69] != str(digits % 10):
            raise BlockError(
                f"line {number} of the elements is not one, or its checksum is wrong: {line!r}"
            )
    record = api.Satrec.twoline2rv(*lines)
    return {
        "epoch_tle_j2000": (record.jdsatepoch - _J2000 + record.jdsatepochF) * _DAY,
        "bstar": record.bstar,
        "eccentricity": record.ecco,
        "argument_of_perigee": record.argpo,
        "inclination": record.inclo,
        "mean_anomaly": record.mo,
        "mean_motion": record.no_kozai / 60.0,
        "raan": record.nodeo,
    }
