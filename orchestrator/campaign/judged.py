"""A requirement over the cases of a campaign: how many are outside, and what that
shows."""

from __future__ import annotations

import math
import shlex
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..language.scenario import Requirement
from ..numbers.statistics import clopper_pearson
from ..system.typed import JsonObject


@dataclass(frozen=True)
class CaseVerdict:
    """A requirement over the cases: how many are within and outside, with which
    interval, and whether that shows that it is met; how many more would. Shares are in
    %."""

    requirement: Requirement
    n: int
    within: int
    outside: int
    lacking: int
    share_outside: float
    interval_outside: Sequence[float]
    shown_within: float
    met: bool
    cases_outside: Sequence[int]
    """The first ten."""
    commands: Sequence[str]
    """Of the first three, to make them again."""
    more_cases: int | None
    for_half_the_width: int | None
    unit: str

    def to_json(self) -> JsonObject:
        """Return the requirement as it is written, and the verdict."""
        verdict = {
            name: value for name, value in vars(self).items() if name != "requirement"
        }
        entry = self.requirement
        levels = {"probability": entry.probability, "confidence": entry.confidence}
        return {**entry.written, **levels, **verdict}


def requirement(
    entry: Requirement,
    out: Mapping[str, NDArray[np.float64]],
    completed: Any,
    cases: Any,
    folder: Path,
    unit: str = "",
) -> CaseVerdict:
    """How many cases are within a requirement, and whether that shows that it is met. A
    case that failed, or has not the number, or an infinite one, is outside."""
    probability, confidence = entry.probability, entry.confidence
    values = out.get(entry.number, np.full(len(cases), np.nan))
    within = completed & entry.holds(values)
    n, inside = len(cases), int(within.sum())
    # one-sided at the confidence: a two-sided interval with twice the tail
    shown = clopper_pearson(inside, n, 2.0 * confidence - 1.0)[0] / 100.0
    outside = [int(c) for c in cases[~within][:10]]
    return CaseVerdict(
        requirement=entry,
        n=n,
        within=inside,
        outside=n - inside,
        lacking=int((completed & ~np.isfinite(values)).sum()),
        share_outside=100.0 * (n - inside) / n,
        interval_outside=clopper_pearson(n - inside, n, confidence),
        shown_within=100.0 * shown,
        met=shown >= probability,
        cases_outside=outside,
        commands=[rerun(folder, c) for c in outside[:3]],
        more_cases=more(n, inside, probability, confidence),
        for_half_the_width=for_half_the_width(n, n - inside, confidence),
        unit=unit,
    )


def more(n: int, inside: int, probability: float, confidence: float) -> int | None:
    """How many more cases would show the requirement met, and go on to show it with any
    number above, if the share outside stayed as it is; 0 where it is shown, None where
    more cannot."""
    share = (n - inside) / n

    def shown(total: int, outside: int) -> bool:
        low = clopper_pearson(total - outside, total, 2.0 * confidence - 1.0)[0]
        return bool(low >= 100.0 * probability)

    if shown(n, n - inside):
        return 0
    if 1.0 - share <= probability:
        return None
    if not share:
        few = bisect_left(range(n, _MOST), True, key=lambda total: shown(total, 0))
        return few if n + few < _MOST else None
    # with one more outside a total shows least: these are the totals that decide
    first = n - inside + 1

    def least(outside: int) -> int:
        return math.ceil((outside - 0.5) / share)  # the share rounded to whole cases

    last = int(share * _MOST)
    k = first + bisect_left(range(first, last), True, key=lambda k: shown(least(k), k))
    if k >= last:
        return None
    before = range(max(n, least(k - 1)), least(k))
    return (
        before.start
        + bisect_left(before, True, key=lambda total: shown(total, k - 1))
        - n
    )


def for_half_the_width(n: int, outside: int, confidence: float) -> int | None:
    """How many more cases would make the interval of the share outside half as wide, if
    that share stayed as it is; None where so many are not made."""

    def width(total: int) -> float:
        low, high = clopper_pearson(round(outside / n * total), total, confidence)
        return high - low

    wanted = 0.5 * width(n)
    few = bisect_left(range(n, _MOST), True, key=lambda total: width(total) <= wanted)
    return few if n + few < _MOST else None


_MOST = 10_000_000
"""More cases are not told of."""


def rerun(folder: Path, case: int | str) -> str:
    """The command that makes a case again."""
    return f"desat campaign case {shlex.quote(str(folder))} {case}"
