"""The cells of a paper's tables: what a scenario's [paper.NAME] says, and our numbers
beside it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..campaign.draws import RunRow
from ..files.scenario import Scenario
from ..language.content import Content, Entry
from ..language.paper import OfNumber
from ..numbers.measures import LATE
from ..numbers.numbers import defined, late, ranks, related
from ..numbers.statistics import clopper_pearson
from ..system.errors import DesatError
from .stored import StoredScenario

Numbers = Mapping[str, Any]
"""A run's numbers by name; None: not reached."""


@dataclass(frozen=True)
class Spread:
    """Of a median of draws: how many `n` have it, the least and the largest, the `band`
    of each draw, and how many do not reach a time."""

    n: int
    min: float | None
    max: float | None
    band: tuple[float, ...] | None
    not_reached: int = 0


@dataclass(frozen=True)
class Share:
    """Of `n` draws the `count` of those that are within, and the `interval` (%,
    Clopper-Pearson, 95 %) in which the share of all possible draws lies."""

    n: int
    count: int
    interval: list[float]


@dataclass
class PaperCell:
    """One cell of a table: the paper's value (None where it gives none) and ours."""

    table: str
    method: str
    case: str
    quantity: str
    heading: str
    """The quantity in words."""
    unit: str
    paper: float | None
    ours: float | None
    """None: no run decides what the paper says, and `remark` says why; infinite: a time
    that is not reached."""
    band: tuple[float, float] | None
    within: bool | None
    paper_within: bool | None
    """Whether the paper's own value is within the band; None where there is none of
    them."""
    tuned: bool
    out_of_sample: bool
    """True: the paper gives a value, nothing was tuned to it, it had no part in a
    choice, and it repeats no other cell."""
    definition: str
    """What is measured, in a sentence."""
    flag: bool
    """True: 0 means no and 1 means yes."""
    remark: str
    scenario: str
    draws: Spread | Share | None = None
    """Where `ours` is of draws: a median of them, or a share."""


def band_of(entry: Entry, values: Numbers) -> tuple[float, float] | None:
    """[low, high] of what counts as within a row's `tolerance`; None where anything
    does.

    `values`: the run's, for a band that is a multiple of another number.
    """
    tolerance, paper = entry.tolerance, entry.values
    if isinstance(tolerance, OfNumber):
        of = values[tolerance.of]
        return tolerance.from_ * of, tolerance.to * of
    if isinstance(tolerance, tuple):
        low, high = tolerance
        return float(low), float(high)
    if not tolerance or paper is None:
        return None
    if tolerance.endswith("%"):
        width = abs(paper) * float(tolerance[:-1]) / 100
    else:
        width = float(tolerance)
    return paper - width, paper + width


def _remark(entry: Entry) -> str:
    """What a reader should know of a row."""
    words = {
        "tuned": "tuned: ",
        "in_sample": "in sample: ",
        "not_judged": "not judged: ",
        "remark": "",
    }
    return "; ".join(
        f"{word}{text}" for key, word in words.items() if (text := getattr(entry, key))
    )


def rows_of(
    scenario: Scenario,
    values: Numbers,
    everything: Mapping[str, Numbers],
    drawn: StoredScenario | None,
) -> list[PaperCell]:
    """The rows that a scenario gives. `values`: its numbers, `everything`: those of all
    scenarios; `drawn`: its draws, where it has some: their `summary` and the `draws`
    themselves.

    Raises DesatError where a number is not reached or is of a run that was not made,
    and for a share of draws where there are none.
    """
    rows = []
    content = scenario.content
    for row, entry in content.judged.items():
        told: Spread | Share | None
        if entry.share is not None:
            if drawn is None:
                where = scenario.where(("paper", row))
                raise DesatError(
                    f"{where}: a share of samples, and {scenario.name} has none"
                )
            values_drawn = values_of(drawn["draws"], entry.of, content)
            counts = told = share_of(values_drawn, entry.share.least, entry.share.most)
            ours = 100.0 * counts.count / counts.n
        else:
            ours = _value(scenario, row, entry.of, values, everything)
            told = _spread_of(entry, drawn, content) if drawn else None
        rows.append(_row(scenario, entry, ours, values, told))
    undecided = (e for e in content.entries.values() if e.not_judged)
    return [*rows, *(_row(scenario, e, None, values, None) for e in undecided)]


def _spread_of(entry: Entry, drawn: StoredScenario, content: Content) -> Spread | None:
    if (summary := drawn["summary"].get(entry.of)) is None:
        return None
    number = content.numbers.get(entry.of)
    is_time = number is not None and number.measure in LATE
    missing = len(drawn["draws"]) - summary.n if is_time else 0
    least, most = summary.levels["min"], summary.levels["max"]
    return Spread(summary.n, least, most, entry.each or None, missing)


def values_of(draws: Iterable[RunRow], name: str, content: Content) -> list[Any]:
    """A number of each draw of a scenario, as `ranked` has it."""
    return ranks([row.numbers.get(name) for row in draws], name in late(content))


def share_of(
    values: list[Any], least: float = -math.inf, most: float = math.inf
) -> Share:
    """Of `values_of` draws the share of those within [least, most]. What a draw has not
    is not within."""
    count = sum(x is not None and least <= x <= most for x in values)
    return Share(len(values), count, clopper_pearson(count, len(values)))


def _row(
    scenario: Scenario,
    entry: Entry,
    ours: float | None,
    values: Numbers,
    draws: Spread | Share | None,
) -> PaperCell:
    band, paper = band_of(entry, values), entry.values
    within = None if band is None or ours is None else band[0] <= ours <= band[1]
    if isinstance(draws, Spread) and draws.band is not None:
        (low, high), least, most = draws.band, draws.min, draws.max
        reached = (
            least is not None and most is not None and low <= least <= most <= high
        )
        within = within is not False and reached
    tuned, seen = bool(entry.tuned), bool(entry.in_sample)
    labels, number = scenario.content.labels, scenario.content.numbers.get(entry.of)
    in_columns = scenario.cell.keys() & {"method", "case"}
    case = labels.get("case", "") if in_columns else scenario.name.partition("/")[2]
    return PaperCell(
        table=entry.table,
        method=entry.label or labels.get("method", ""),
        case=entry.case or case,
        quantity=entry.quantity,
        heading=entry.heading or entry.quantity.replace("_", " "),
        unit=entry.unit,
        paper=paper,
        ours=ours,
        band=band,
        within=within,
        paper_within=None
        if band is None or paper is None
        else band[0] <= paper <= band[1],
        tuned=tuned,
        out_of_sample=ours is not None and paper is not None and not tuned and not seen,
        definition=entry.definition or defined(None if entry.not_judged else number),
        flag=entry.flag,
        remark=_remark(entry),
        scenario=scenario.name,
        draws=draws,
    )


def count(table: list[PaperCell]) -> dict[str, int]:
    """How many rows there are, and how many that no run decides. Of those with a band:
    how many are within it, tuned, without a value of the paper, in sample otherwise,
    out of sample, and of the latter within."""
    banded = [r for r in table if r.within is not None]
    out = [r for r in banded if r.out_of_sample]
    return {
        "rows": len(table),
        "not_judged": sum(r.ours is None for r in table),
        "banded": len(banded),
        "within": sum(r.within is True for r in banded),
        "tuned": sum(r.tuned for r in banded),
        "without_paper": sum(r.paper is None and not r.tuned for r in banded),
        "in_sample": sum(
            r.paper is not None and not (r.tuned or r.out_of_sample) for r in banded
        ),
        "out_of_sample": len(out),
        "out_of_sample_within": sum(r.within is True for r in out),
        "paper_outside": sum(r.paper_within is False for r in banded),
    }


def _value(
    scenario: Scenario,
    row: str,
    name: str,
    values: Numbers,
    everything: Mapping[str, Numbers],
) -> float:
    """Our number of a row, from this run or in relation to another."""
    number = scenario.content.numbers.get(name)
    if number is not None and number.reference and name not in values:
        other = everything.get(f"{scenario.family}/{number.reference}")
        if other is None:
            raise DesatError(
                f"{scenario.name}: {name} refers to {number.reference}: not run"
            )
        value = related(str(number.form), values[number.of], other[number.of])
    elif name not in values:
        raise DesatError(f"{scenario.where(('numbers', name))}: no run gives it")
    else:
        value = values[name]
    if value is None and name in late(scenario.content):
        return math.inf
    if value is None:
        where = scenario.where(("paper", row))
        raise DesatError(
            f"{where}: {scenario.name} does not reach {name}, and a table has it"
        )
    return float(value)
