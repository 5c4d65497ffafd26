"""Numbers as people read them."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf
from typing import Any

from ..system.typed import JsonObject


def number(x: Any) -> str:
    """A number for people: four significant digits, thousands apart."""
    if x is None:
        return "not reached"
    if isinstance(x, bool) or not isinstance(x, (int, float)):
        return str(x)
    if x != 0.0 and not 1e-3 <= abs(x) < 1e9:
        return f"{x:.3e}"
    return f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}"


def spell_unit(unit: str) -> str:
    """Return a unit as people read it: `uN.m.s2` -> `uN m s2`; nothing for `1`."""
    return "" if unit == "1" else unit.replace(".", " ")


def format_duration(seconds: float) -> str:
    """Return a time (s) in days, hours, minutes or seconds."""
    if seconds == inf:
        return "for ever"
    for unit, name in ((86400.0, "d"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2.0 * unit:
            return f"{seconds / unit:.3g} {name}"
    return f"{seconds:.3g} s"


def format_momenta(momentum: float, capacity: float | None = None) -> str:
    """Return a momentum (N m s), and the capacity that it is held against, in one unit."""
    momenta = [momentum] if capacity is None else [momentum, capacity]
    factor, unit = (1.0, "N m s") if max(momenta) >= 1.0 else (1e3, "mN m s")
    # three significant digits, but never 1e+03
    texts = [
        f"{factor * x:.0f}" if factor * x >= 999.5 else f"{factor * x:.3g}"
        for x in momenta
    ]
    return f"{' of '.join(texts)} {unit}"


@dataclass(frozen=True)
class Value:
    """A number of a run; `value` None: it is not reached."""

    title: str
    value: float | None
    unit: str
    note: str = ""
    """How much of its window the run has, or of what it is."""
    reference: str = ""
    """The scenario that it compares with."""

    @property
    def label(self) -> str:
        """Its title, with what there is to say of it."""
        return f"{self.title} ({self.note})" if self.note else self.title

    def to_json(self) -> JsonObject:
        """As a manifest has it."""
        return {
            k: v for k, v in vars(self).items() if v or k not in ("note", "reference")
        }
