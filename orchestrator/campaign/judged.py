"""A requirement over the cases of a campaign: how many are outside, and what that shows."""

from __future__ import annotations

import math
import shlex
from bisect import bisect_left
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ..study.cells import clopper_pearson


def requirement(
    entry: Mapping[str, Any], out: Mapping[str, Any], completed: Any, cases: Any, folder: Path
) -> dict[str, Any]:  # fmt: skip
    """How many cases are within a requirement, and whether that shows that it is met. A case that
    failed, or has not the number, is outside."""
    probability, confidence = entry.get("probability", 0.95), entry.get("confidence", 0.95)
    values = out.get(entry["number"], np.full(len(cases), np.nan))
    within = (
        completed & (values <= entry.get("max", math.inf)) & (values >= entry.get("min", -math.inf))
    )
    n, inside = len(cases), int(within.sum())
    # one-sided at the confidence: a two-sided interval with twice the tail
    low = clopper_pearson(inside, n, 2.0 * confidence - 1.0)[0] / 100.0
    outside = [int(c) for c in cases[~within][:10]]
    return {
        **dict(entry), "probability": probability, "confidence": confidence, "n": n,
        "within": inside, "outside": n - inside,
        "lacking": int((completed & ~np.isfinite(values)).sum()),
        "share_outside": 100.0 * (n - inside) / n,
        "interval_outside": clopper_pearson(n - inside, n, confidence),
        "shown_within": 100.0 * low, "met": low >= probability,
        "cases_outside": outside,
        "commands": [rerun(folder, c) for c in outside[:3]],
        "more_cases": more(n, inside, probability, confidence),
        "for_half_the_width": 3 * n,
    }  # fmt: skip


def more(n: int, inside: int, probability: float, confidence: float) -> int | None:
    """How many more cases would show the requirement met if the share stayed as it is; 0 where it
    is, None where more cannot show it."""
    share = inside / n

    def shown(total: int) -> bool:
        low = clopper_pearson(round(share * total), total, 2.0 * confidence - 1.0)[0]
        return bool(low >= 100.0 * probability)

    if shown(n):
        return 0
    if share <= probability:
        return None
    few, total = n, math.ceil(n * 1.1)
    while not shown(total):
        few, total = total, math.ceil(total * 1.1)
        if total > 10_000_000:
            return None
    return bisect_left(range(few, total), True, key=shown) + few - n


def rerun(folder: Path, case: int) -> str:
    """The command that makes a case again."""
    return f"desat campaign case {shlex.quote(str(folder))} {case}"
