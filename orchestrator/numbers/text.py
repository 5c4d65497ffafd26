"""Format numbers for readers."""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf
from typing import Any

from ..system.typed import JsonObject


def number(x: Any) -> str:
    """Format a number: four significant digits, with separated thousands."""
    if x is None:
        return "not reached"
    if isinstance(x, bool) or not isinstance(x, (int, float)):
        return str(x)
    if x != 0.0 and not 1e-3 <= abs(x) < 1e9:
        return f"{x:.3e}"
    return f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}"


def short_title(title: str) -> str:
    """Return a title without what it says in brackets or after a colon or comma."""
    return re.split(r" \(|[:,;]", title)[0]


def spell_unit(unit: str) -> str:
    """Format a unit: `uN.m.s2` becomes `uN m s2`, and `1` becomes ""."""
    return "" if unit == "1" else unit.replace(".", " ")


def format_duration(seconds: float) -> str:
    """Format a time (s) in days, hours, minutes or seconds."""
    if seconds == inf:
        return "for ever"
    for unit, name in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} s"


def format_momenta(
    momentum: float, other: float | None = None, separator: str = " of "
) -> str:
    """Format a momentum (N m s), and optionally another, as a capacity, in one unit."""
    momenta = [momentum] if other is None else [momentum, other]
    factor, unit = (1.0, "N m s") if max(momenta) >= 1.0 else (1e3, "mN m s")
    # three significant digits, but never 1e+03
    texts = [
        f"{factor * x:.0f}" if factor * x >= 999.5 else f"{factor * x:.3g}"
        for x in momenta
    ]
    return f"{separator.join(texts)} {unit}"


@dataclass(frozen=True)
class Value:
    """Number of a run; with `value` None it is not reached."""

    title: str
    value: float | None
    unit: str
    note: str = ""  # remark, as on how much of its window the run has
    reference: str = ""  # the scenario that it compares with
    samples: int | None = None  # rows that it is measured over; None: not counted

    @property
    def label(self) -> str:
        """Return the title with the note."""
        return f"{self.title} ({self.note})" if self.note else self.title

    def to_json(self) -> JsonObject:
        """Return the number as a manifest has it."""
        return {
            k: v
            for k, v in vars(self).items()
            if v or k not in ("note", "reference", "samples")
        }
