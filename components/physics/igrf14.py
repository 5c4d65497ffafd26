"""The International Geomagnetic Reference Field, 14th generation: its coefficients.

`igrf14.json` beside this file holds them with their source.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

from ..contract.block import BlockError

Gauss = tuple[tuple[int, int, float], ...]
"""Gauss coefficients: (degree n, order m, T), m negative for h; Schmidt semi-normalised."""

DEGREE = 13
"""Of the field since 2000; before it is 10."""

FIRST_YEAR, LAST_YEAR = 1900.0, 2030.0


@cache
def _table() -> tuple[tuple[float, ...], tuple[tuple[int, int, tuple[float, ...]], ...]]:
    """The years, and (n, m, nT in each year)."""
    data = json.loads(Path(__file__).with_suffix(".json").read_text(encoding="utf-8"))
    rows = tuple((n, m, tuple(map(float, values))) for n, m, *values in data["coefficients"])
    return tuple(map(float, data["years"])), rows


def coefficients(year: float, degree: int = DEGREE) -> Gauss:
    """The coefficients of a decimal year (2026.5) up to a degree from 1 to 13.

    Linear between the models, which are five years apart; after 2025 by their secular variation.
    Raises BlockError outside 1900 to 2030.
    """
    if not FIRST_YEAR <= year <= LAST_YEAR:
        raise BlockError(
            f"the year {year:.2f} is outside [{FIRST_YEAR:.0f}, {LAST_YEAR:.0f}], which IGRF-14 "
            "covers; use the dipole, or another epoch"
        )
    years, rows = _table()
    k = max(i for i, y in enumerate(years[:-1]) if y <= year)
    share = (year - years[k]) / (years[k + 1] - years[k])
    return tuple(
        (n, m, 1e-9 * ((1.0 - share) * values[k] + share * values[k + 1]))
        for n, m, values in rows
        if n <= degree
    )
