"""Judge a requirement over the cases of a campaign, with its confidence."""

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
    """Verdict on a requirement over the cases.

    It has the numbers of cases within and outside with the interval, whether that shows
    that the requirement is met, and how many more cases would. Shares are in %.
    """

    requirement: Requirement
    n: int
    within: int
    outside: int
    lacking: int
    share_outside: float
    interval_outside: Sequence[float]
    shown_within: float
    met: bool
    cases_outside: Sequence[int]  # the first ten
    commands: Sequence[str]  # of the first three, to run them again
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
    """Count the cases within a requirement, and judge whether it is shown to be met.

    A case that failed, lacks the number, or has an infinite one, is outside.
    """
    probability, confidence = entry.probability, entry.confidence
    values = out.get(entry.number, np.full(len(cases), np.nan))
    within = completed & entry.holds(values)
    n, inside = len(cases), int(within.sum())
    # one-sided at the confidence: a two-sided interval with twice the tail
    assured_share = clopper_pearson(inside, n, 2.0 * confidence - 1.0)[0] / 100.0
    outside = [int(c) for c in cases[~within][:10]]
    return CaseVerdict(
        requirement=entry,
        n=n,
        within=inside,
        outside=n - inside,
        lacking=int((completed & ~np.isfinite(values)).sum()),
        share_outside=100.0 * (n - inside) / n,
        interval_outside=clopper_pearson(n - inside, n, confidence),
        shown_within=100.0 * assured_share,
        met=assured_share >= probability,
        cases_outside=outside,
        commands=[rerun(folder, c) for c in outside[:3]],
        more_cases=more(n, inside, probability, confidence),
        for_half_the_width=for_half_the_width(n, n - inside, confidence),
        unit=unit,
    )


def more(n: int, inside: int, probability: float, confidence: float) -> int | None:
    """Compute how many more cases would show that the requirement is met.

    With that number and any larger one it is shown, if the share outside stays as it
    is. The result is 0 where it is shown already, and None where more cases cannot show
    it.
    """
    share = (n - inside) / n

    def shown(total: int, outside: int) -> bool:
        """Return whether a total with `outside` cases outside shows it met."""
        low = clopper_pearson(total - outside, total, 2.0 * confidence - 1.0)[0]
        return bool(low >= 100.0 * probability)

    if shown(n, n - inside):
        return 0
    if 1.0 - share <= probability:
        return None
    if not share:
        few = bisect_left(range(n, _MOST), True, key=lambda total: shown(total, 0))
        return few if n + few < _MOST else None
    # each further case outside makes a total show least: check these totals
    first = n - inside + 1

    def least(outside: int) -> int:
        """Return the smallest total with `outside` cases outside at this share."""
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
    """Compute how many more cases would halve the interval of the share outside.

    The share itself is assumed constant. None where the number is too large.
    """

    def width(total: int) -> float:
        """Return the width (%) of the interval for a total number of cases."""
        low, high = clopper_pearson(round(outside / n * total), total, confidence)
        return high - low

    half_width = 0.5 * width(n)
    few = bisect_left(
        range(n, _MOST), True, key=lambda total: width(total) <= half_width
    )
    return few if n + few < _MOST else None


_MOST = 10_000_000  # a larger number of cases is not reported


def rerun(folder: Path, case: int | str) -> str:
    """Return the command that runs a case again."""
    return f"desat campaign case {shlex.quote(str(folder))} {case}"
