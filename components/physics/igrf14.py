"""Provide the coefficients of the International Geomagnetic Reference Field, IGRF-14.

`igrf14.json` beside this file holds them with their source.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from functools import cache
from pathlib import Path

from ..contract.block import BlockError

# Gauss coefficients (T), Schmidt semi-normalised: g_n0, g_n1, h_n1, g_n2, h_n2 to g_nn,
# h_nn for each degree n = 1, 2, ... in order.
Gauss = tuple[float, ...]

DEGREE = 13  # of the field since 2000; before it is 10

FIRST_YEAR, LAST_YEAR = 1900.0, 2030.0

_COEFFICIENTS = DEGREE * (DEGREE + 2)

# Years accepted beyond either end, five minutes: for the points around the first and
# the last step.
_LEEWAY = 1e-5


@cache
def _table() -> tuple[tuple[float, ...], tuple[tuple[float, ...], ...]]:
    """Read the years, and the values (nT) of each coefficient in them.

    The coefficients are in the order of `Gauss`.
    """
    data = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
    by_name = {
        (n, m): tuple(map(float, values)) for n, m, *values in data["coefficients"]
    }
    rows = tuple(
        by_name[n, m]
        for n in range(1, DEGREE + 1)
        for order in range(n + 1)
        for m in ((order, -order) if order else (0,))
    )
    return tuple(map(float, data["years"])), rows


def model_of(year: float) -> int:
    """Return the number, from 0, of the last model that is not after a decimal year.

    Raises
    ------
    BlockError
        If the year (2026.5) is outside 1900 to 2030.
    """
    if not FIRST_YEAR - _LEEWAY <= year <= LAST_YEAR + _LEEWAY:
        raise BlockError(
            f"the year {year:.2f} is outside [{FIRST_YEAR:.0f}, {LAST_YEAR:.0f}], which IGRF-14 "
            "covers; use the dipole, or another epoch"
        )
    years, _ = _table()
    return min(max(bisect_right(years, year) - 1, 0), len(years) - 2)


def model_year(k: int) -> float:
    """Return the decimal year of model number k."""
    return _table()[0][k]


def model(k: int, degree: int = DEGREE) -> tuple[Gauss, Gauss]:
    """Return the coefficients (T) of model number k and their change (T a year).

    They go up to a degree from 1 to 13. The change is that to the next model: the field
    is linear between the models, which are five years apart. After 2025 the change is
    the published secular variation.
    """
    years, rows = _table()
    span = years[k + 1] - years[k]
    count = min(degree * (degree + 2), _COEFFICIENTS)
    return tuple(1e-9 * rows[j][k] for j in range(count)), tuple(
        1e-9 * (rows[j][k + 1] - rows[j][k]) / span for j in range(count)
    )
