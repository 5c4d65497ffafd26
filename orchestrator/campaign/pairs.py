"""Compute paired differences: two scenarios fly the same draws, number by number.

A drawn value depends on seed, draw and name alone. So parameters that both scenarios
disperse alike have the same values in both, and the difference of a number within a
draw is free of their scatter.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..language.content import dispersions_of
from ..numbers.statistics import clopper_pearson, median_interval
from ..runs.cases import Cases
from ..runs.run import Options
from ..system.errors import DesatError
from ..system.typed import JsonObject
from .draws import Draws, RunRow
from .plan import CampaignPlan, read, system
from .sampling import draw_of
from .spread import Spread, to_json

if TYPE_CHECKING:
    from pandas import DataFrame, Index  # type: ignore[import-untyped]

EQUAL = 1e-12  # relative difference up to which two numbers are equal


@dataclass(frozen=True)
class Pairs:
    """Differences of each number over pairs of runs, the first's less the second's."""

    first: str
    second: str
    pairs: int
    warnings: Sequence[str]
    numbers: Mapping[str, Spread]

    def to_json(self) -> JsonObject:
        """Return the pairs as `desat compare --json` prints them."""
        return {**vars(self), "numbers": to_json(self.numbers)}


def common(
    one: Cases, another: Cases, seed: int, options: Options, plain: Options
) -> dict[str, list[str]]:
    """Find the names that two systems both draw, and those that only one draws.

    The keys are `drawn_in_both`, `drawn_only_in_it` and `drawn_only_in_the_other`.

    Raises
    ------
    DesatError
        If there is no common name, or one is drawn in another way.
    """
    target, other = one.scenario.target, another.scenario.target
    systems = one.draft(options.blocks), another.draft(plain.blocks)
    ours, theirs = (dispersions_of(s) for s in systems)
    names = sorted(ours.keys() & theirs.keys())
    if not names:
        raise DesatError(f"{target} and {other}: the two sample nothing in common")
    values = [draw_of(s, seed, 0) for s in systems]
    for name in names:
        if ours[name] != theirs[name] or values[0][name] != values[1][name]:
            raise DesatError(
                f"{target} and {other}: dispersions: {name} is drawn as "
                f"{ours[name].written} and as {theirs[name].written}; the same is "
                "needed"
            )
    return {
        "drawn_in_both": names,
        "drawn_only_in_it": sorted(ours.keys() - theirs.keys()),
        "drawn_only_in_the_other": sorted(theirs.keys() - ours.keys()),
    }


def each_draw(
    ours: Iterable[RunRow], theirs: Iterable[RunRow], name: str, ratio: bool = False
) -> dict[int | None, float]:
    """Compute a number of ours less that of theirs, or over it, for each draw.

    Both are of the same draws. Draws are left out where one has not reached the number,
    or where theirs is 0 and would divide.
    """
    other = {row.number: row.numbers.get(name) for row in theirs}
    differences = {}
    for row in ours:
        a, b = row.numbers.get(name), other.get(row.number)
        if a is not None and b is not None and (b or not ratio):
            differences[row.number] = a / b if ratio else difference(a, b)
    return differences


def differences(ours: Draws, theirs: Draws) -> dict[str, Spread]:
    """Compute the spread of ours less theirs for each number of the same draws.

    The numbers are those that both have by name and unit. Draws where one has not
    reached a number count as `not_reached` alone.
    """
    rows = [[row for row in x.rows if row.numbers] for x in (ours, theirs)]
    both = len({row.number for row in rows[0]} & {row.number for row in rows[1]})
    compared: dict[str, Spread] = {}
    for name, spread in ours.summary.items():
        if name in theirs.summary and theirs.summary[name].unit == spread.unit:
            each = each_draw(rows[0], rows[1], name)
            compared[name] = replace(
                confident(list(each.values())),
                title=spread.title,
                unit=spread.unit,
                not_reached=both - len(each),
            )
    return compared


def difference(ours: float, theirs: float) -> float:
    """Compute ours less theirs, 0 where they are equal to within `EQUAL`."""
    return 0.0 if math.isclose(ours, theirs, rel_tol=EQUAL) else ours - theirs


# --- Two campaigns over the same cases, in pairs --------------------------------------


def compare(first: Path, second: Path, level: float = 0.95) -> Pairs:
    """Compare two campaigns case by case: the first's numbers less the second's.

    For each common number the result has the median with its interval (order
    statistics), and the share of cases in which the first's is lower.

    Raises
    ------
    DesatError
        If they are not of the same draws.
    """
    from . import store  # needs pyarrow, which other comparisons do not

    one, other = read(first), read(second)
    for key in ("seed", "sampling"):
        if getattr(one, key) != getattr(other, key):
            raise DesatError(
                f"{first} and {second}: {key} is {getattr(one, key)} and "
                f"{getattr(other, key)}; pairs need the same"
            )
    frames = [
        store.read(folder)
        .to_pandas(integer_object_nulls=True)
        .set_index("case")
        .sort_index()
        for folder in (first, second)
    ]
    completed = [frame[frame["status"] == "completed"] for frame in frames]
    cases = completed[0].index.intersection(completed[1].index)
    if cases.empty:
        raise DesatError(f"{first} and {second}: no case is completed in both")
    matched = [frame.loc[cases] for frame in completed]
    _same_inputs(first, second, matched)
    names = [
        n for n in frames[0].columns if n.startswith("out.") and n in frames[1].columns
    ]
    titles_and_units = _same_units(first, second, names)
    numbers = {
        name[4:]: replace(
            _differences(matched, name, level),
            title=titles_and_units[name]["title"],
            unit=titles_and_units[name]["unit"],
        )
        for name in names
    }
    warnings = [*_warnings(one, other), *_apart(frames, cases)]
    return Pairs(str(first), str(second), len(cases), warnings, numbers)


def _warnings(one: CampaignPlan, other: CampaignPlan) -> list[str]:
    """Return a line if the two end at different times, as far as that is known."""
    try:
        ends = [p.options.stop or system(p).stop for p in (one, other)]
    except DesatError:
        return []
    if None in ends or ends[0] == ends[1]:
        return []
    return [f"the first runs until {ends[0]:g} s, the second until {ends[1]:g} s"]


def _apart(frames: Sequence[DataFrame], cases: Index) -> list[str]:
    """Return a line for cases that one has completed and that failed in the other."""
    lines = []
    both = frames[0].index.intersection(frames[1].index)
    for frame, name, other in zip(
        frames, ("first", "second"), ("second", "first"), strict=True
    ):
        completed = frame.index[frame["status"] == "completed"]
        failed = completed.intersection(both).difference(cases)
        if len(failed):
            failed_cases = f"case {failed[0]}" + (
                f" and {len(failed) - 1} more" if len(failed) > 1 else ""
            )
            lines.append(
                f"{failed_cases}: completed in the {name}, failed in the {other}: in no pair"
            )
    return lines


def _same_inputs(first: Path, second: Path, matched: Sequence[DataFrame]) -> None:
    """Raise DesatError if the two drew other values of a name, or share no name."""
    shared = sorted(
        n
        for n in matched[0].columns.intersection(matched[1].columns)
        if n.startswith("in.")
    )
    if not shared:
        raise DesatError(f"{first} and {second}: the two sample nothing in common")
    for name in shared:
        ours, theirs = (frame[name] for frame in matched)
        differing = ours.index[(ours != theirs) & (ours.notna() | theirs.notna())]
        if len(differing):
            case = differing[0]
            raise DesatError(
                f"{first} and {second}: {name[3:]} of case {case} is {ours[case]} "
                f"and {theirs[case]}; pairs need the same samples"
            )


def _same_units(
    first: Path, second: Path, names: list[str]
) -> dict[str, dict[str, str]]:
    """Return title and unit of each number; raise DesatError if units differ."""
    from . import store

    descriptions = [store.described(f) for f in (first, second)]
    for name in names:
        ours, theirs = (t[name[4:]]["unit"] for t in descriptions)
        if ours != theirs:
            raise DesatError(
                f"{first} and {second}: {name[4:]} is in {ours} and in {theirs}; "
                "pairs need the same"
            )
    return {name: descriptions[0][name[4:]] for name in names}


def _differences(matched: Sequence[DataFrame], name: str, level: float) -> Spread:
    """Compute the spread of the differences of a number over matched cases."""
    a, b = (frame[name].to_list() for frame in matched)
    each = [
        difference(x, y)
        for x, y in zip(a, b, strict=True)
        if math.isfinite(x) and math.isfinite(y)
    ]
    return confident(each, level)


def confident(each: Sequence[float], level: float = 0.95) -> Spread:
    """Compute the spread of differences.

    The median has its interval (order statistics), and the share below 0 its own
    (Clopper-Pearson), both at a level.
    """
    n = len(each)
    lower = sum(x < 0.0 for x in each)
    spread = Spread(
        levels={
            "median": statistics.median(each) if each else None,
            "min": min(each, default=None),
            "max": max(each, default=None),
        },
        n=n,
        lower=lower,
        higher=sum(x > 0.0 for x in each),
        equal=each.count(0.0),
    )
    if not n:
        return spread
    _, smallest, largest = median_interval(each, level)
    return replace(
        spread,
        interval=[smallest, largest],
        # that from the smallest to the largest value fails with this probability
        interval_holds=2.0 ** (1 - n) <= 1.0 - level,
        share_lower=100.0 * lower / n,
        share_lower_interval=clopper_pearson(lower, n, level),
    )
