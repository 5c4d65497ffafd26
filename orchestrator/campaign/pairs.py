"""Paired differences: two scenarios that fly the same draws, number by number.

What is drawn depends on seed, draw and name alone, so what both scenarios disperse alike has the
same values in both, and the difference of a number within a draw has no scatter of that in it.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from ..runs.run import Options
from ..system.draft import dispersed
from ..system.errors import DesatError
from .draws import draws, system_of
from .sampling import drawn

EQUAL = 1e-12
"""Relative difference up to which two numbers are equal."""


def paired(
    target: str, other: str, count: int, seed: int, options: Options, jobs: int = 2,
    progress: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Run the same `count` draws of two systems and return both results (as `draws` does) with the
    differences of their numbers. `sets`, `sources` and `design` of the options are the target's.

    Raises DesatError where nothing is drawn in both, or not in the same way.
    """
    plain = replace(options, sets=[], sources=[], values={}, design=None)
    shared = common(target, other, seed, options, plain)
    ours = draws(target, count, seed, options, jobs, progress)
    theirs = draws(other, count, seed, plain, jobs, progress)
    return {
        "scenario": target, "against": other, "seed": seed, **shared,
        "differences": differences(ours, theirs), "draws": [ours, theirs],
    }  # fmt: skip


def common(
    target: str, other: str, seed: int, options: Options, plain: Options
) -> dict[str, list[str]]:  # fmt: skip
    """The names that two systems both draw, as `drawn_in_both`, and those that only one draws.

    Raises DesatError where there is none of the former, or one is drawn in another way.
    """
    systems = system_of(target, options), system_of(other, plain)
    ours, theirs = (dispersed(s) for s in systems)
    names = sorted(ours.keys() & theirs.keys())
    if not names:
        raise DesatError(f"{target} and {other}: there is nothing that both draw")
    values = [drawn(s, seed, 0) for s in systems]
    for name in names:
        if ours[name] != theirs[name] or values[0][name] != values[1][name]:
            raise DesatError(f"{target} and {other}: dispersions: {name} is drawn as {ours[name]} "
                             f"and as {theirs[name]}; the same is needed")  # fmt: skip
    return {
        "drawn_in_both": names,
        "drawn_only_in_it": sorted(ours.keys() - theirs.keys()),
        "drawn_only_in_the_other": sorted(theirs.keys() - ours.keys()),
    }


def ratios(ours: dict[str, Any], theirs: dict[str, Any], name: str) -> dict[str, Any]:
    """Of a number that two results of the same draws have: ours over theirs of each draw, its
    median, least and largest. Draws where one has not reached it, or theirs is 0, count nowhere."""
    other = {row["draw"]: row["numbers"].get(name) for row in theirs["draws"]}
    each = {
        row["draw"]: mine / other[row["draw"]] for row in ours["draws"]
        if (mine := row["numbers"].get(name)) is not None and other.get(row["draw"])
    }  # fmt: skip
    values = list(each.values())
    return {
        "unit": "1",
        "median": statistics.median(values) if values else None,
        "min": min(values, default=None),
        "max": max(values, default=None),
        "n": len(values),
        "each": [{"draw": draw, "ratio": x} for draw, x in each.items()],
    }


def differences(ours: dict[str, Any], theirs: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Of each number that two results of the same draws (as `draws` gives them, or stored ones)
    have by name and unit: ours less theirs of each draw, its median, least and largest, and in how
    many draws ours is lower, higher or equal. Draws where one has not reached it count nowhere:
    `n` is how many there are of the others, `not_reached` how many of these.
    """
    other = {row["draw"]: row["numbers"] for row in theirs["draws"]}
    compared = {}
    for name, entry in ours["summary"].items():
        if theirs["summary"].get(name, {}).get("unit") != entry["unit"]:
            continue
        pairs = {
            row["draw"]: (row["numbers"].get(name), other[row["draw"]].get(name))
            for row in ours["draws"] if row["numbers"] and other.get(row["draw"])
        }  # fmt: skip
        each = {
            draw: difference(a, b)
            for draw, (a, b) in pairs.items() if a is not None and b is not None
        }  # fmt: skip
        compared[name] = {
            "unit": entry["unit"],
            **spread(list(each.values())),
            "not_reached": len(pairs) - len(each),
            "each": [{"draw": draw, "difference": x} for draw, x in each.items()],
        }
    return compared


def difference(ours: float, theirs: float) -> float:
    """Ours less theirs, 0 where they are equal but for rounding (EQUAL)."""
    return 0.0 if math.isclose(ours, theirs, rel_tol=EQUAL) else ours - theirs


def spread(each: Sequence[float]) -> dict[str, Any]:
    """Median, least and largest of differences, how many are below, above and at 0."""
    return {
        "median": statistics.median(each) if each else None,
        "min": min(each, default=None),
        "max": max(each, default=None),
        "n": len(each),
        "lower": sum(x < 0.0 for x in each),
        "higher": sum(x > 0.0 for x in each),
        "equal": sum(x == 0.0 for x in each),
    }
