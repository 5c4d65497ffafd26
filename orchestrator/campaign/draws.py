"""Run seeded draws of a scenario's dispersions over processes, one row a draw.

The values are drawn in `sampling.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from ..analyses import Analysis, analyses, coverage
from ..analyses.manifest import Stopped
from ..files.draft import Draft
from ..language.content import Content, content_of, overridden_by
from ..numbers.numbers import late
from ..numbers.verdicts import Verdict
from ..runs.cases import Cases
from ..runs.prepare import prepare, read, with_stop
from ..runs.progress import progress as shown
from ..runs.run import Options, Run, simulate
from ..runs.substep_choice import choose_for_cases
from ..system.errors import DesatError, Exit, RunError
from ..system.model import AUTO, System
from ..system.typed import JsonObject
from .sampling import Drawn, draw_of
from .spread import Spread, spreads, to_json
from .workers import Here, Local, NoResult, Workers, results

STOPPED = 128  # exit codes above this are those of a run that somebody stopped


@dataclass(frozen=True)
class RunRow:
    """Row of a run: how it ended, its numbers, and the values that were set."""

    status: str
    code: int
    message: str
    unmet: Sequence[str] = ()
    stopped_when: Stopped | None = None
    numbers: Mapping[str, float | None] = field(default_factory=dict)
    values: Mapping[str, Drawn] = field(default_factory=dict)
    # title and unit of the numbers, and of other values of a row
    described: Mapping[str, dict[str, str]] = field(default_factory=dict)
    number: int | None = None  # of the draw or of the case; None: nothing was drawn
    # on the requirements that the run decides
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)

    @property
    def completed(self) -> bool:
        """Return whether the run reached its end."""
        return self.status == "completed"

    def to_json(self) -> JsonObject:
        """Return the row as `draws` reports it."""
        return {
            "draw": self.number,
            "status": self.status,
            "code": self.code,
            "message": self.message,
            "unmet": list(self.unmet),
            "stopped_when": None
            if self.stopped_when is None
            else self.stopped_when.to_json(),
            "numbers": dict(self.numbers),
            "values": dict(self.values),
        }


@dataclass(frozen=True)
class Draws:
    """Draws of a scenario: one row each, and the spreads of their numbers."""

    scenario: str
    seed: int
    rows: Sequence[RunRow]
    summary: Mapping[str, Spread]
    warnings: Sequence[str]

    def to_json(self) -> JsonObject:
        """Return the draws as `desat.draws` reports them."""
        return {
            "scenario": self.scenario,
            "seed": self.seed,
            "draws": [row.to_json() for row in self.rows],
            "stopped": count_stopped(self.rows),
            "summary": to_json(self.summary),
            "warnings": self.warnings,
        }


def count_stopped(rows: Sequence[RunRow]) -> int:
    """Count the runs that ended early."""
    return sum(row.stopped_when is not None for row in rows)


class SourceReader:
    """Reader of sources by target, each once a process.

    (Sources are not sent to processes that start: an object larger than a pipe blocks
    if the process ends before it has read it.)
    """

    def __init__(self, *known: Cases) -> None:
        self._known = {cases.scenario.target: cases for cases in known}

    def cases(self, target: str) -> Cases:
        """Return the cases of a target."""
        if target not in self._known:
            self._known[target] = Cases(read(target))
        return self._known[target]


class One(SourceReader):
    """Runner of samples of sources by target."""

    def __call__(
        self, target: str, options: Options, seed: int, draw: int | None
    ) -> RunRow:
        """Run a draw of a target (`one`)."""
        return one(self.cases(target), options, seed, draw)


def one(cases: Cases, options: Options, seed: int, draw: int | None) -> RunRow:
    """Run a case with drawn values; with `draw` None nothing is drawn.

    Raises
    ------
    DesatError
        If the run could not begin or was stopped; the message names target and draw.
    """
    target = cases.scenario.target
    values, values_of = {}, None
    if draw is not None:
        values_of = partial(draw_of, cases.draft(options.blocks), seed)
        values = values_of(draw)
    try:
        row = ran(cases, options, values, values_of=values_of)
        return replace(row, number=draw)
    except DesatError as error:
        place = target if draw is None else f"{target}: draw {draw}"
        lines = "\n".join(f"{place}: {x}" for x in str(error).splitlines())
        raise RunError(lines, error.code) from error


def ran(
    cases: Cases,
    options: Options,
    values: Mapping[str, Any],
    also: Sequence[str] = (),
    look: Callable[[Run], None] = lambda run: None,
    values_of: Callable[[int], Mapping[str, Any]] | None = None,
) -> RunRow:
    """Run a case with some values, and return its row.

    `values_of` gives those of the first cases, from which substeps are chosen for all;
    None: the run chooses its own. Recorded are the series that the numbers need, and
    `also`. `look` may inspect the run before its results are closed.
    """
    case = cases.prepare(replace(options, values={**options.values, **values}))
    system, _ = case.or_raise()
    if options.record == ("*",):
        series_needed = (*series_of_numbers(system), *also)
        case = replace(case, options=replace(case.options, record=series_needed))
    choice = None
    if values_of is not None:
        choice = choose_for_cases(case, cases, options, values_of)
    run = simulate(case, choice=choice)
    if run.code > STOPPED:
        run.or_raise(case.target)
    manifest = run.manifest
    # requirements apply to all draws or cases together, not to one
    code = Exit.COMPLETED if run.ok and not manifest.unmet else run.code
    row = RunRow(
        manifest.status,
        int(code),
        manifest.message or "",
        manifest.unmet,
        manifest.stopped_when,
        {name: n.value for name, n in manifest.numbers.items()},
        values,
        {
            name: {"title": n.title, "unit": n.unit}
            for name, n in manifest.numbers.items()
        },
        verdicts=manifest.verdicts,
    )
    look(run)
    run.results.close()
    return row


def series_of_numbers(system: System) -> tuple[str, ...]:
    """Return the series that the numbers and checks of a run need.

    The others need not be recorded.
    """
    content = content_of(system.about)
    series_needed = tuple(needed_signals(content))
    if system.substeps == AUTO and (parts := coverage.applies(system)):
        series_needed += tuple(parts.series)  # the substep choice checks them again
    for analysis in analyses():
        if parts := analysis.applies(system):
            series_needed += tuple(analysis.signals(parts))
            if _asks_for(content, analysis):
                series_needed += tuple(analysis.balanced(parts))
    return series_needed


def _asks_for(content: Content, analysis: Analysis) -> bool:
    """Return whether a scenario needs those series of an analysis that draws may omit.

    It does if it sets a bound of the analysis, or has a requirement on one of its
    numbers.
    """
    numbers = {r.number for r in content.requirements.values()}
    bounds = content.written.keys() & set(analysis.BOUND_KEYS)
    return bool(bounds or numbers & set(analysis.NUMBERS))


def never(system: Draft, options: Options) -> list[str]:
    """Return a line for each option that sets a value which is drawn instead."""
    names = [*(text.partition("=")[0] for text in options.sets), *options.values]
    return [
        f"--set {name}: {'it' if name == parameter else parameter} is sampled, and so never has this "
        "value"
        for name in names
        if "." in name
        for parameter in overridden_by(system, name)
    ]


def lost_row(reason: NoResult) -> RunRow:
    """Return the row of a run that never came back."""
    return RunRow(
        "failed", int(Exit.TIMEOUT if reason.timeout else Exit.COMPONENT), reason.text
    )


def needed_signals(content: Content) -> list[str]:
    """Return the series that a scenario's numbers need."""
    return sorted({s for number in content.numbers.values() for s in number.signals})


def rows_of(
    tasks: Sequence[tuple[Any, ...]],
    jobs: int,
    title: str,
    progress: bool,
    *known: Cases,
    runner: Callable[..., Callable[..., RunRow]] = One,
) -> list[RunRow]:
    """Run all tasks over `jobs` processes, and return their rows.

    A task has the arguments of the runner: target, options, seed and draw for `one`.
    The sources in `known` are not read again. A run whose process dies is repeated in a
    supervised process, which can report the reason. With one job, which is this
    process, every run is supervised.
    """
    jobs, tried = max(1, min(jobs, len(tasks))), set()

    def again(key: Any, reason: NoResult) -> list[tuple[Any, tuple[Any, ...]]]:
        """Return the supervised repetition of a lost run, once."""
        if key in tried:
            return []
        tried.add(key)
        target, options, *rest = tasks[key]
        return [(key, (target, replace(options, supervised=True), *rest))]

    if jobs == 1:
        tasks = [(t, replace(o, supervised=True), *rest) for t, o, *rest in tasks]
    rows: dict[Any, RunRow] = {}
    workers: Workers = Here(runner(*known)) if jobs == 1 else Local(runner(), jobs)
    with workers, shown(title, len(tasks), progress) as tell:
        for key, result in results(workers, iter(enumerate(tasks)), again):
            is_lost = isinstance(result, NoResult)
            rows[key] = (
                replace(lost_row(result), number=tasks[key][3]) if is_lost else result
            )
            tell(len(rows), "")
    return [rows[key] for key in range(len(tasks))]


def draws(
    target: str | Cases,
    count: int,
    seed: int,
    options: Options,
    jobs: int = 2,
    progress: bool = False,
    first: int = 0,
) -> Draws:
    """Run the draws from `first` to before `count`, and summarise their numbers.

    The result has the rows and, for each number, median, smallest and largest value.
    Draw i of a seed is the same whatever the count and the number of processes.
    """
    cases = Cases(read(target)) if isinstance(target, str) else target
    target, system = cases.scenario.target, cases.draft(options.blocks)
    options = with_stop(cases.scenario, options)
    if not content_of(system.about).dispersions:
        raise DesatError(
            f"{target}: it has no [dispersions], so there is nothing to sample"
        )
    whole_numbers(target, seed=(seed, 0), count=(count, first + 1))
    typical = replace(options, values={**options.values, **draw_of(system, seed, 0)})
    warnings = prepare(cases.scenario, typical).warnings
    warnings += never(system, options)
    tasks = [(target, options, seed, draw) for draw in range(first, count)]
    rows = rows_of(tasks, jobs, target, progress, cases)
    return Draws(
        target, seed, rows, summary(rows, late(content_of(system.about))), warnings
    )


def whole_numbers(target: str, **entry: tuple[Any, int]) -> None:
    """Raise DesatError for a value that is no integer, or is below its lower bound."""
    for name, (value, least) in entry.items():
        if not isinstance(value, int) or isinstance(value, bool) or value < least:
            raise DesatError(
                f"{target}: {name} = {value!r}: an integer from {least} on is needed"
            )


def summary(rows: Sequence[RunRow], late: Collection[str]) -> dict[str, Spread]:
    """Compute the `spreads` of each number of the draws that completed."""
    completed = [r for r in rows if r.completed]
    descriptions = completed[0].described if completed else {}
    units = {name: d["unit"] for name, d in descriptions.items()}
    return spreads([r.numbers for r in completed], units, late)
