"""Build the cells of a paper's tables from [paper.NAME] and our numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from ..campaign.draws import RunRow
from ..files.scenario import Scenario
from ..language.content import Content, PaperEntry
from ..language.paper import OfNumber
from ..numbers.measures import LATE
from ..numbers.numbers import defined, late, ranks, related
from ..numbers.statistics import clopper_pearson
from ..system.errors import DesatError
from .stored import StoredScenario

Numbers = Mapping[str, Any]  # numbers of a run by name; None: not reached


@dataclass(frozen=True)
class PaperSpread:
    """Spread of a median of samples.

    `n` samples have the number, between `min` and `max`; `band` is that of each sample,
    and `not_reached` counts the samples that do not reach a time.
    """

    n: int
    min: float | None
    max: float | None
    band: tuple[float, ...] | None
    not_reached: int = 0


@dataclass(frozen=True)
class Share:
    """Share of samples within limits.

    `count` of `n` samples are within; `interval` (%, Clopper-Pearson, 95 %) contains
    the share of all possible samples.
    """

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
    heading: str  # the quantity in words
    unit: str
    paper: float | None
    # None: no run decides what the paper says, and `remark` gives the reason; infinite:
    # a time that is not reached
    ours: float | None
    band: tuple[float, float] | None
    within: bool | None
    # the paper's own value is within the band; None where either is missing
    paper_within: bool | None
    tuned: bool
    # the paper gives a value that nothing was tuned to, that had no part in a choice
    # and that repeats no other cell
    out_of_sample: bool
    definition: str  # what is measured, in a sentence
    flag: bool  # 0 means no and 1 means yes
    remark: str
    scenario: str
    # where `ours` is a median or a share of samples
    draws: PaperSpread | Share | None = None


def band_of(entry: PaperEntry, values: Numbers) -> tuple[float, float] | None:
    """Return the band [low, high] of a row by its `tolerance`, or None without one.

    `values` are the numbers of the run, for a band that is a multiple of another
    number.
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


def _remark(entry: PaperEntry) -> str:
    """Return the remarks on a row as text."""
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
    """Return the cells that a scenario gives.

    Parameters
    ----------
    scenario
        The scenario.
    values
        Numbers of its run.
    everything
        Numbers of all scenarios, by name.
    drawn
        Its samples with their summary, where it has some.

    Raises
    ------
    DesatError
        If a number is not reached or belongs to a run that was not made, or if a share
        of samples is required and there are none.
    """
    rows = []
    content = scenario.content
    for row, entry in content.judged.items():
        spread: PaperSpread | Share | None
        if entry.share is not None:
            if drawn is None:
                place = scenario.place(("paper", row))
                raise DesatError(
                    f"{place}: a share of samples, and {scenario.name} has none"
                )
            values_drawn = values_of(drawn["draws"], entry.of, content)
            counts = spread = share_of(
                values_drawn, entry.share.least, entry.share.most
            )
            ours = 100.0 * counts.count / counts.n
        else:
            ours = _value(scenario, row, entry.of, values, everything)
            spread = _spread_of(entry, drawn, content) if drawn else None
        rows.append(_row(scenario, entry, ours, values, spread))
    undecided = (e for e in content.entries.values() if e.not_judged)
    return [*rows, *(_row(scenario, e, None, values, None) for e in undecided)]


def _spread_of(
    entry: PaperEntry, samples: StoredScenario, content: Content
) -> PaperSpread | None:
    """Return the spread of a row's number, or None if its samples lack it."""
    if (summary := samples["summary"].get(entry.of)) is None:
        return None
    number = content.numbers.get(entry.of)
    is_time = number is not None and number.measure in LATE
    missing = len(samples["draws"]) - summary.n if is_time else 0
    least, most = summary.levels["min"], summary.levels["max"]
    return PaperSpread(summary.n, least, most, entry.each or None, missing)


def values_of(draws: Iterable[RunRow], name: str, content: Content) -> list[Any]:
    """Return a number of each sample of a scenario, as `ranks` orders it."""
    return ranks([row.numbers.get(name) for row in draws], name in late(content))


def share_of(
    values: list[Any], least: float = -math.inf, most: float = math.inf
) -> Share:
    """Return the share of samples whose value lies within [least, most].

    `values` are as from `values_of`; a sample without a value is not within.
    """
    count = sum(x is not None and least <= x <= most for x in values)
    return Share(len(values), count, clopper_pearson(count, len(values)))


def _row(
    scenario: Scenario,
    entry: PaperEntry,
    ours: float | None,
    values: Numbers,
    draws: PaperSpread | Share | None,
) -> PaperCell:
    """Return the cell of a row."""
    band, paper = band_of(entry, values), entry.values
    within = None if band is None or ours is None else band[0] <= ours <= band[1]
    if isinstance(draws, PaperSpread) and draws.band is not None:
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
    """Count the rows of a table.

    The counts are of all rows and of those that no run decides. Of the rows with a band
    they are: those within it, tuned, without a value of the paper, in sample otherwise,
    out of sample, and of the latter those within.
    """
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
    """Return our number of a row, from this run or in relation to another."""
    number = scenario.content.numbers.get(name)
    if number is not None and number.reference and name not in values:
        other = everything.get(f"{scenario.family}/{number.reference}")
        if other is None:
            raise DesatError(
                f"{scenario.name}: {name} refers to {number.reference}: not run"
            )
        value = related(str(number.form), values[number.of], other[number.of])
    elif name not in values:
        raise DesatError(f"{scenario.place(('numbers', name))}: no run gives it")
    else:
        value = values[name]
    if value is None and name in late(scenario.content):
        return math.inf
    if value is None:
        place = scenario.place(("paper", row))
        raise DesatError(
            f"{place}: {scenario.name} does not reach {name}, and a table has it"
        )
    return float(value)
