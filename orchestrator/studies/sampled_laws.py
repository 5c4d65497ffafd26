"""Rank the laws of a craft over random samples: `desat compare CRAFT --laws all -n 20`.

Every law flies the same samples. A sample fails under a law where the run does not
complete or misses a requirement; a wheel that never empties is not reached.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..campaign.draws import RunRow, SourceReader, ran, rows_of
from ..campaign.sampling import draw_of
from ..campaign.spread import Spread, spreads
from ..language.content import content_of
from ..numbers.text import number, spell_unit
from ..report.table import Column, Row, Table
from ..runs.cases import draft_to_draw
from ..runs.prepare import prepare, read
from ..runs.run import Options, Run
from ..sizing.compatibility import ROLE, Fitting, Refused
from ..system.errors import DesatError
from ..system.typed import JsonObject
from .criteria import (
    CRITERIA,
    EMPTY,
    STANDARD,
    START,
    Criterion,
    half_full,
    measured_run,
    time_to_empty,
)
from .ranking import laws_of, recorded

EMPTYING = "emptying"


class JudgedSample(SourceReader):
    """Runner of samples whose numbers are the criteria of laws."""

    def __call__(
        self,
        target: str,
        options: Options,
        seed: int,
        draw: int | None,
        names: tuple[str, ...],
        changes: Mapping[str, Any],
        is_emptied: bool = False,
    ) -> RunRow:
        """Fly a sample and measure it by the criteria of these names.

        With `draw` None nothing is drawn. `changes` are values that replace drawn ones.
        If `is_emptied`, only the time until the wheels are empty is measured.
        """
        cases = self.cases(target)
        is_own = not any(text.startswith(f"{ROLE}=") for text in options.sources)
        measures: dict[str, float | None] = {}
        not_met: list[str] = []

        def look(run: Run) -> None:
            """Measure the run before its results are closed."""
            not_met.extend(run.manifest.not_met)
            if is_emptied:
                time = time_to_empty(run.manifest, run.results)
                measures[EMPTYING] = time if np.isfinite(time) else None
                return
            seen = measured_run(run.manifest, run.results) if names else None
            for name in names:
                of = CRITERIA[name].of
                measures[name] = None if of is None or seen is None else of(seen)

        def values_of(k: int) -> Mapping[str, Any]:
            """Return the drawn values of a sample, without those of another law."""
            values = draw_of(cases.draft(options.blocks), seed, k)
            return {
                name: x
                for name, x in values.items()
                if is_own or not name.startswith(f"{ROLE}.")
            }

        values = {**({} if draw is None else values_of(draw)), **changes}
        system, _ = prepare(cases.scenario, options).or_raise()
        drawing = None if draw is None else values_of
        row = ran(cases, options, values, recorded(system), look, drawing)
        return replace(
            row, number=draw, numbers={**row.numbers, **measures}, unmet=not_met
        )


@dataclass(frozen=True)
class SampledLaw:
    """A law over the samples."""

    law: Fitting
    spreads: Mapping[str, Spread]  # by the name of the criterion
    failed: int  # samples that do not complete or miss a requirement
    reasons: tuple[str, ...]  # why they fail, each once

    def median(self, criterion: str) -> float:
        """Return the median of a criterion; infinite where it is not reached."""
        middle = self.spreads[criterion].levels["median"]
        return np.inf if middle is None else middle


@dataclass(frozen=True)
class SampledRanking:
    """Laws of a craft, ranked by the median of the first criterion over samples.

    Those with the fewest failed samples come first.
    """

    target: str
    count: int
    seed: int
    by: tuple[Criterion, ...]
    ranked: tuple[SampledLaw, ...]
    refused: tuple[Refused, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]  # of the run with the craft's own law

    @property
    def answer(self) -> str:
        """Return the sentence that answers which law is best."""
        best, criterion = self.ranked[0], self.by[0]
        spread = best.spreads[criterion.name]
        text = (
            f"{self.target}: of {self.count} samples {best.law.name} fails {best.failed}, "
            f"with the least median {criterion.title} among those that fail no more: "
            f"{_interval(spread)} {spell_unit(criterion.unit)} (median and its interval of "
            "95 %)"
        )
        close = [
            e.law.name
            for e in self.ranked[1:]
            if e.failed == best.failed and _overlap(spread, e.spreads[criterion.name])
        ]
        return (
            f"{text}; the intervals of {', '.join(close)} overlap with it."
            if close
            else f"{text}."
        )

    @property
    def table(self) -> Table:
        """Return the laws in order as a table of the report."""
        columns = [
            Column("law", kind="text"),
            *(Column(c.heading, kind="text") for c in self.by),
            Column("failed", form="d"),
            Column("why", kind="text"),
        ]
        rows: list[Row] = [
            [
                e.law.label,
                *(_interval(e.spreads[c.name]) for c in self.by),
                e.failed,
                "; ".join(e.reasons),
            ]
            for e in self.ranked
        ]
        return Table("", columns, rows)

    def as_json(self) -> JsonObject:
        """Return the ranking for programs."""
        return {
            "target": self.target,
            "answer": self.answer,
            "samples": self.count,
            "seed": self.seed,
            "by": [c.name for c in self.by],
            "laws": [
                {
                    "name": e.law.name,
                    "manager": e.law.manager,
                    "own": e.law.is_own,
                    "failed": e.failed,
                    "reasons": list(e.reasons),
                    "criteria": {k: x.to_json() for k, x in e.spreads.items()},
                }
                for e in self.ranked
            ],
            "notes": list(self.notes),
            "warnings": list(self.warnings),
            "refused": [vars(r) for r in self.refused],
        }


def rank_samples(
    target: str,
    options: Options,
    criteria: Sequence[Criterion],
    laws: Sequence[str],
    others: Sequence[str],
    count: int,
    seed: int,
    jobs: int = 2,
    progress: Callable[[str], None] | None = None,
) -> SampledRanking:
    """Fly samples of a craft with each law that fits it, and rank the laws.

    Parameters
    ----------
    target, options
        The craft.
    criteria
        By which laws are ranked; empty: `STANDARD`, but for the least torquer, which is
        one for all samples.
    laws, others
        Laws by name, or all, and files of the user's own.
    count, seed
        Samples.
    jobs
        Processes.
    progress
        Called with a text for each stage; None: no progress is shown.

    Raises
    ------
    DesatError
        If the craft has nothing to sample, cannot fly with its own law, or a criterion
        is not known for it.
    """
    source, tell = read(target), progress or (lambda text: None)
    chosen = list(criteria or map(CRITERIA.__getitem__, STANDARD))
    if criteria and "torquer" in [c.name for c in criteria]:
        raise DesatError(
            "--by torquer: the least torquer is found once for a craft, not for each "
            "sample: leave -n out"
        )
    if not content_of(draft_to_draw(source, options.blocks).about).dispersions:
        raise DesatError(
            f"{target}: it has no [dispersions], so there is nothing to sample"
        )
    first, laws_fitting, refused = laws_of(source, options, laws, others, tell)
    system, _ = prepare(source, options).or_raise()
    measured = measured_run(first.manifest, first.results)
    of_flights = tuple(
        c.name for c in chosen if c.of is not None and c.of(measured) is not None
    )
    for c in criteria:
        if c.of is not None and c.name not in of_flights:
            raise DesatError(
                f"{target}: --by {c.name}: the {c.title} is not available for it"
            )
    notes = [
        f"measured from t = {measured.first:.0f} s on; {count} samples of seed {seed}, "
        "the same for each law"
    ]
    names = tuple(dict.fromkeys(("peak", *of_flights)))
    flights = _fly_all(
        target, laws_fitting, count, seed, jobs, progress is not None, (names, {})
    )
    start = half_full(system)
    emptied: list[list[RunRow]] = [[] for _ in laws_fitting]
    if EMPTYING in [c.name for c in chosen] and start is not None:
        notes.append(f"empty: every wheel below {number(EMPTY)} % of its capacity")
        emptied = _fly_all(
            target,
            laws_fitting,
            count,
            seed,
            jobs,
            progress is not None,
            ((), {START: start}, True),
        )
        of_flights = (*of_flights, EMPTYING)
    elif EMPTYING in [c.name for c in criteria]:
        raise DesatError(
            f"{target}: --by {EMPTYING}: the {CRITERIA[EMPTYING].title} is not available for it"
        )
    by = tuple(c for c in chosen if c.name in of_flights)
    ranked = [
        _of_samples(law, by, rows, more)
        for law, rows, more in zip(laws_fitting, flights, emptied, strict=True)
    ]
    ranked.sort(key=lambda e: (e.failed, [e.median(c.name) for c in by]))
    return SampledRanking(
        target,
        count,
        seed,
        by,
        tuple(ranked),
        tuple(refused),
        tuple(notes),
        tuple(first.manifest.warnings),
    )


def _fly_all(
    target: str,
    laws: Sequence[Fitting],
    count: int,
    seed: int,
    jobs: int,
    progress: bool,
    rest: tuple[Any, ...],
) -> list[list[RunRow]]:
    """Fly all samples of all laws, and return the rows of each law."""
    tasks = [
        (target, law.options, seed, draw, *rest)
        for law in laws
        for draw in range(count)
    ]
    rows = rows_of(tasks, jobs, target, progress, runner=JudgedSample)
    return [rows[k * count : (k + 1) * count] for k in range(len(laws))]


def _of_samples(
    law: Fitting,
    by: Sequence[Criterion],
    rows: Sequence[RunRow],
    emptied: Sequence[RunRow],
) -> SampledLaw:
    """Summarise the samples of a law."""
    numbers = [dict(row.numbers) for row in rows if row.completed]
    units = {c.name: c.unit for c in by if c.name != EMPTYING}
    spreads_of_numbers = spreads(numbers, units, ())
    if emptied:
        times = [dict(row.numbers) if row.completed else {} for row in emptied]
        spreads_of_numbers |= spreads(
            times, {EMPTYING: CRITERIA[EMPTYING].unit}, (EMPTYING,)
        )
    reasons = [
        reason
        for row in rows
        for reason in (row.unmet if row.completed else [row.message or row.status])
    ]
    failed_samples = sum(not row.completed or bool(row.unmet) for row in rows)
    return SampledLaw(
        law,
        spreads_of_numbers,
        failed_samples,
        tuple(dict.fromkeys(x.partition(":")[0] for x in reasons)),
    )


def _interval(spread: Spread) -> str:
    """Return a median with its interval as text."""
    middle, low, high = (spread.levels[k] for k in ("median", "low", "high"))
    if not spread.n and middle is None:
        return "not reached"
    text = "not reached" if middle is None else number(middle)
    if low is None and high is None:
        return text
    ends = ["not reached" if x is None else number(x) for x in (low, high)]
    return f"{text} ({ends[0]} to {ends[1]})"


def _overlap(one: Spread, other: Spread) -> bool:
    """Return whether the intervals of two medians overlap."""

    def end(spread: Spread, name: str) -> float:
        """Return an end of the interval; infinite where it is not reached."""
        value = spread.levels[name]
        return np.inf if value is None else value

    return end(one, "low") <= end(other, "high") and end(other, "low") <= end(
        one, "high"
    )
