"""[requirements.NAME]: what a campaign's cases are held against, as far as it is to be had."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ..analyses import analyses
from ..system.errors import nearest


def unmeetable(data: dict[str, Any]) -> Iterator[tuple[tuple[str, ...], str]]:
    """Requirements of a number that nobody computes, or that nothing can meet."""
    known = {*data.get("numbers", {}), *(n for a in analyses() for n in a.NUMBERS)}
    for name, entry in data.get("requirements", {}).items():
        path, number = ("requirements", name), entry["number"]
        if number not in known:
            yield (*path, "number"), f"no number {number}{nearest(number, known)}"
        elif "of" in data.get("numbers", {}).get(number, {}):
            yield (*path, "number"), f"{number} compares runs: a case has no such number"
        if {"min", "max"} <= entry.keys() and entry["min"] > entry["max"]:
            yield (*path, "min"), "it is above max: nothing can be within"
