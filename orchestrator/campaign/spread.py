"""Compute the spread of a number over runs: draws, campaign cases, or pairs of them."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

from ..numbers.numbers import ranks
from ..numbers.statistics import median_interval
from ..system.typed import JsonObject


@dataclass(frozen=True)
class Spread:
    """Spread of a number over runs, in its unit.

    Levels and percentiles are None where they are a time that is not reached. Other
    fields are None or empty, and not in JSON, where they do not apply.
    """

    title: str | None = None
    unit: str | None = None
    # `median`, `min`, `max`; for draws also `low` and `high`, the 95 % interval of the
    # median
    levels: Mapping[str, float | None] = field(default_factory=dict)
    n: int = 0  # runs that have the number
    lower: int | None = None  # differences below 0
    higher: int | None = None
    equal: int | None = None
    interval: Sequence[float] = ()  # interval of the median of differences
    # whether there are enough differences for that interval
    interval_holds: bool | None = None
    share_lower: float | None = None  # %, share of differences below 0
    share_lower_interval: Sequence[float] = ()
    not_reached: int | None = None  # runs that do not reach the number
    infinite: int | None = None
    # for a campaign: `p5`, `median`, `p95`, `p99`, `min`, `max`
    percentiles: Mapping[str, float | None] = field(default_factory=dict)
    cases: Mapping[str, int] = field(default_factory=dict)  # min_case and max_case

    @property
    def not_reached_text(self) -> str:
        """Return how many runs do not reach it, as `3 of 20 (15 %)`; "" for none."""
        missing = self.not_reached or 0
        count = self.n + missing
        return (
            f"{missing} of {count} ({100.0 * missing / count:.3g} %)" if missing else ""
        )

    def to_json(self) -> JsonObject:
        """Return the fields that apply, and the levels under their own names."""
        entry: JsonObject = {}
        for name, value in vars(self).items():
            if isinstance(value, Mapping):
                entry |= value
            elif value not in (None, ()):
                entry[name] = value
        return entry


def to_json(numbers: Mapping[str, Spread]) -> dict[str, JsonObject]:
    """Return the spreads of numbers by name."""
    return {name: spread.to_json() for name, spread in numbers.items()}


def spreads(
    rows: Sequence[Mapping[str, float | None]],
    units: Mapping[str, str],
    late: Collection[str],
) -> dict[str, Spread]:
    """Compute the spread of each number that has a unit.

    Numbers in `late` (`numbers.late`) are ranked over all rows, others over the rows
    that have them.
    """
    numbers: dict[str, Spread] = {}
    for name, unit in units.items():
        column = [row.get(name) for row in rows]
        values = [x for x in ranks(column, name in late) if x is not None]
        middle, low, high = median_interval(values) if values else (None, None, None)
        levels = {
            "median": middle,
            "low": low,
            "high": high,
            "min": min(values, default=None),
            "max": max(values, default=None),
        }
        if name in late:
            levels = {key: None if x == math.inf else x for key, x in levels.items()}
        there = sum(x is not None for x in column)
        numbers[name] = Spread(
            unit=unit, levels=levels, n=there, not_reached=len(rows) - there
        )
    return numbers
