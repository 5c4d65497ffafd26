"""The International Geomagnetic Reference Field, 14th generation: its coefficients.

`igrf14.json` beside this file holds them with their source.
"""

from __future__ import annotations

import json
from bisect import bisect_right
from functools import cache
from pathlib import Path

from ..contract.block import BlockError

Gauss = tuple[tuple[int, int, float], ...]
"""Gauss coefficients: (degree n, order m, T), m negative for h; Schmidt semi-normalised."""

DEGREE = 13
"""Of the field since 2000; before it is 10."""

FIRST_YEAR, LAST_YEAR = 1900.0, 2030.0

_LEEWAY = 1e-5
"""Years beyond either end, five minutes: for the points around the first and the last step."""


@cache
def _table() -> tuple[tuple[float, ...], tuple[tuple[int, int, tuple[float, ...]], ...]]:
    """The years, and (n, m, nT in each year)."""
    data = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
    rows = tuple((n, m, tuple(map(float, values))) for n, m, *values in data["coefficients"])
    return tuple(map(float, data["years"])), rows


def model_of(year: float) -> int:
    """The number of the last model, counted from 0, that is not after a decimal year (2026.5).

    Raises BlockError outside 1900 to 2030.
    """
    if not FIRST_YEAR - _LEEWAY <= year <= LAST_YEAR + _LEEWAY:
        raise BlockError(
            f"the year {year:.2f} is outside [{FIRST_YEAR:.0f}, {LAST_YEAR:.0f}], which IGRF-14 "
            "covers; use the dipole, or another epoch"
        )
    years, _ = _table()
    return min(max(bisect_right(years, year) - 1, 0), len(years) - 2)


def model_year(k: int) -> float:
    """The decimal year of model number k."""
    return _table()[0][k]


def model(k: int, degree: int = DEGREE) -> tuple[Gauss, Gauss]:
    """The coefficients (T) of model number k and their change (T a year) to the next, up to a
    degree from 1 to 13.

    The field is linear between the models, which are five years apart; after 2025 its change is
    the published secular variation.
    """
    years, rows = _table()
    span = years[k + 1] - years[k]
    return tuple((n, m, 1e-9 * values[k]) for n, m, values in rows if n <= degree), tuple(
        (n, m, 1e-9 * (values[k + 1] - values[k]) / span) for n, m, values in rows if n <= degree
    )
