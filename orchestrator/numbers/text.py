"""Numbers as people read them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any


def number(x: Any) -> str:
    """A number for people: four significant digits, thousands apart."""
    if x is None:
        return "not reached"
    if isinstance(x, bool) or not isinstance(x, (int, float)):
        return str(x)
    if x != 0.0 and not 1e-3 <= abs(x) < 1e9:
        return f"{x:.3e}"
    return f"{x:.4g}" if abs(x) < 1000 else f"{x:,.0f}"


def not_reached(entry: Mapping[str, Any]) -> str:
    """Of a number over several runs, in how many it is not reached: `3 of 20 (15 %)`; empty where
    there is none."""
    missing, count = entry["not_reached"], entry["n"] + entry["not_reached"]
    return f"{missing} of {count} ({100.0 * missing / count:.3g} %)" if missing else ""


def title_of(number: dict[str, Any]) -> str:
    """A number's title, with what there is to say of it."""
    return f"{number['title']} ({number['note']})" if "note" in number else str(number["title"])
