"""The verbs of pages: what a template may call.

A scenario is named without its family; `change` gives parameters other values, as
`{"manager.gain": 2.0}`.
"""

from __future__ import annotations

import importlib
import inspect
import json
import math
import re
import statistics
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from importlib.util import find_spec
from typing import Any

import numpy as np

from desat.campaign import sampling
from desat.figures import plots
from desat.figures.plots import lines_of, series_figure
from desat.files import paths
from desat.files.scenario import find
from desat.language.scenario import Plot
from desat.numbers.numbers import late
from desat.numbers.statistics import clopper_pearson, median_interval
from desat.numbers.text import number as text_of
from desat.numbers.text import spell_unit
from desat.papers import comparison as cells
from desat.papers import stored, tables
from desat.runs.cases import draft_to_draw
from desat.runs.prepare import read
from desat.runs.run import Options, prepare, simulate
from desat.runs.substep_choice import begin_at
from desat.studies import faults
from desat.system.errors import DesatError, nearest
from desat.system.expression import factor, product
from desat.system.schedule import schedule

from . import figures as several
from .series import Series
from .sources import Change, Sources

MORE = 5  # times the samples of a fault under which ours is worse than another law


class Verbs:
    """Every public method is a verb; `figures` collects what they draw: file -> SVG."""

    def __init__(self, sources: Sources) -> None:
        self._of = sources
        self._figures: dict[str, str] = {}

    def known(self) -> dict[str, Callable[..., Any]]:
        """The verbs by name."""
        own_value = ("known", "figures")
        names = (
            n for n in dir(type(self)) if not n.startswith("_") and n not in own_value
        )
        return {name: getattr(self, name) for name in names}

    @property
    def figures(self) -> dict[str, str]:
        """What was drawn: file name -> SVG."""
        return self._figures

    # --- faults -----------------------------------------------------------------------

    def where_it_breaks(
        self,
        laws: dict[str, str],
        number: str | None = None,
        limits: dict[str, float] | None = None,
        samples: int = 40,
        tune: dict[str, str] | None = None,
    ) -> str:
        """Under which faults scenarios break (`desat faults`): a sentence and a table
        for scenario -> label. Faults under which the first is worse than another fly
        MORE times as many; `tune` has the parameter of a scenario that is searched first. A
        draft flies two samples and searches nothing."""
        free = {} if self._of.draft is not None else tune or {}
        names = [self._of.name_of(scenario) for scenario in laws]
        found = faults.fly_faults(
            names,
            Options(stop=self._of.end_of(next(iter(laws)), None)),
            faults.chosen([]),
            samples if self._of.draft is None else 2,
            1,
            measured=number,
            limits=limits or {},
            jobs=self._of.jobs,
            more=MORE * samples if self._of.draft is None else 0,
            free={self._of.name_of(scenario): name for scenario, name in free.items()},
        )
        # what was searched is said behind a scenario's name
        labels = tuple(
            label + at_search.removeprefix(name)
            for label, at_search, name in zip(
                laws.values(), found.labels, names, strict=True
            )
        )
        found = replace(found, labels=labels)
        title = f"{found.title} {spell_unit(found.unit)}".rstrip()
        lines = [
            f"**Where it breaks.** {found.answer}",
            "",
            f"| {title}, median; samples that fail | {' | '.join(labels)} |",
            "|---" * (len(laws) + 1) + "|",
        ]
        for fault, outcomes in found.rows.values():
            cells_of = " | ".join(outcome.text for outcome in outcomes)
            lines.append(f"| {fault.title} | {cells_of} |")
        if found.without:
            lines += ["", f"Do not apply: {'; '.join(found.without)}."]
        return "\n".join(lines)

    # --- pairs of scenarios -----------------------------------------------------------

    def handover(
        self,
        first: str,
        second: str,
        reached: str = "detumbled",
        goal: str = "three_axis_10deg",
        samples: int = 40,
    ) -> str:
        """Samples flown by one scenario until its number `reached` (min) and from there
        by another, with attitude, rate and wheels as they are: a sentence on when
        `goal` (min) of the second is reached after the release. A draft flies two."""
        count = samples if self._of.draft is None else 2
        pairs = [
            pair_of(self._of.name_of(first), self._of.name_of(second), reached, goal, k)
            for k in range(count)
        ]
        there = [pair for pair in pairs if pair is not None]
        if not there:
            return f"in none of {count} samples"
        begins, ends = zip(*there, strict=True)
        missing = f", {count - len(ends)} do not" if len(ends) < count else ""
        return (
            f"{statistics.median(ends):.0f} min after the release (median; worst "
            f"{max(ends):.0f}; {len(ends)} of {count} samples{missing}), the first law "
            f"for {statistics.median(begins):.1f} of them"
        )

    # --- values -----------------------------------------------------------------------

    def value(self, scenario: str, number: str, change: Change | None = None) -> float:
        """A number of a run; a time that it does not reach is infinite. Raises
        DesatError where the run has none, or nothing to measure."""
        run = self._of.run(scenario, change).manifest
        numbers = run.numbers
        if number not in numbers:
            raise DesatError(
                f"{scenario} has no number {number}{nearest(number, numbers)}"
            )
        value = numbers[number].value
        if value is None and number in late(run.content):
            return math.inf
        if value is None and self._of.draft is None:
            raise DesatError(f"{scenario}: {number} is not reached")
        return math.nan if value is None else float(value)

    def about(self, scenario: str, number: str) -> dict[str, Any]:
        """What a number is: its `title`, its `unit` as people write it."""
        stated_numbers = self._of.run(scenario).manifest.numbers[number]
        return {**stated_numbers.to_json(), "unit": spell_unit(stated_numbers.unit)}

    def parameter(self, scenario: str, text: str, unit: str = "") -> float:
        """A parameter of a run, or a product of several, in a unit (default: its own)."""
        value, own_value = product(text, self._of.run(scenario).manifest.parameters)
        return value * factor(own_value, unit, f'of "{text}"') if unit else value

    def setting(self, scenario: str, key: str) -> Any:
        """What a scenario's file says for a key at its top, such as stop; `labels`:
        those of its cell of the axes."""
        content = find(self._of.name_of(scenario)).content
        data = {**content.data, "labels": content.labels}
        if key not in data:
            raise DesatError(f"{scenario} has no {key}{nearest(key, data)}")
        return data[key]

    def sweep(
        self, scenario: str, parameter: str, values: Sequence[Any], *numbers: str
    ) -> list[tuple[Any, ...]]:
        """Of each value of a parameter: itself, and the numbers of its run."""
        return [
            (v, *(self.value(scenario, n, {parameter: v}) for n in numbers))
            for v in values
        ]

    # --- draws ------------------------------------------------------------------------

    def drawn(self, scenario: str, number: str) -> list[float]:
        """A number of each draw, in their order; a time that one does not reach is
        infinite."""
        rows = self._of.draws_of(scenario, number)["draws"]
        return cells.values_of(rows, number, find(self._of.name_of(scenario)).content)

    def spread(self, scenario: str, number: str, digits: int = 1) -> str:
        """A number over the draws as `median [least, most]`, and how many have it,
        where some have not; of those that have it, a time (`drawn`) of all."""
        drawn = self.drawn(scenario, number)
        values = [x for x in drawn if x is not None]
        there = sum(math.isfinite(x) for x in values)
        if not there:
            return f"none of {len(drawn)}"
        middle, low, high = three(values, digits)
        return f"{middle} [{low}, {high}]" + (
            f", {there} of {len(drawn)}" * (there < len(drawn))
        )

    def median_of(
        self, scenario: str, number: str, digits: int = 1, factor: float = 1.0
    ) -> str:
        """The median of a number over the draws with its 95 % interval:
        `8.8 (8.4 to 9.3)`; `factor` takes it to the unit of the page."""
        return _with_interval(
            [factor * x for x in self.drawn(scenario, number)], digits
        )

    def median_ratio(
        self, scenario: str, other: str, number: str, digits: int = 2
    ) -> str:
        """The same of the ratios to another scenario's same draws."""
        pairs = zip(
            self.drawn(scenario, number), self.drawn(other, number), strict=True
        )
        return _with_interval([a / b for a, b in pairs], digits)

    def median_less(
        self, scenario: str, other: str, number: str, digits: int = 1
    ) -> str:
        """The same of how much less it is than in another scenario's same draws; those
        that reach it in neither count as equal."""
        pairs = zip(
            self.drawn(other, number), self.drawn(scenario, number), strict=True
        )
        return _with_interval([0.0 if a == b else a - b for a, b in pairs], digits)

    def middle_draw(self, scenario: str, number: str) -> int:
        """The draw whose number is the (lower) median of all: a typical one."""
        values = self.drawn(scenario, number)
        return sorted(range(len(values)), key=lambda i: values[i])[
            (len(values) - 1) // 2
        ]

    def of_draw(self, scenario: str, draw: int) -> Change:
        """What a draw of a scenario changes, for `value`, `series` and `plot`."""
        system = draft_to_draw(read(self._of.name_of(scenario)), True)
        return sampling.draw_of(system, self.seed(), draw)

    def seed(self) -> int:
        """The seed of the draws."""
        return int(self._of.draws["seed"])

    # --- the paper's tables -----------------------------------------------------------

    def paper(self, draws: bool = True) -> dict[str, list[dict[str, str]]]:
        """The paper's cells beside ours as texts: heading -> rows; `draws` False leaves
        out the medians of samples."""
        return {
            heading: [tables.texts_of(row) for row in group]
            for heading, group in tables.groups(self._of.cells(draws))
        }

    def paper_table(self, rows: list[dict[str, str]]) -> str:
        """Rows of `paper` as a table, of the columns that have something to show."""
        columns = tables.columns(rows)
        head = [self.row(*columns.values()), "|" + "---|" * len(columns)]
        return "\n".join(
            [*head, *(self.row(*(row[c] for c in columns)) for row in rows)]
        )

    def items(self, draws: bool = True) -> str:
        """What the paper says, item by item, as a table: how many entries we have for
        it, and how many are within their bands and outside of them; the others have no
        band or no run that decides them."""
        head = ["item", "entries", "within", "outside", "not judged or without a band"]
        lines = [self.row(*head), "|" + "---|" * len(head)]
        for heading, group in tables.groups(self._of.cells(draws)):
            judged = [row.within for row in group if row.within is not None]
            outside = judged.count(False)
            shown = f"**{outside}**" if outside else 0
            lines.append(
                self.row(
                    heading, len(group), sum(judged), shown, len(group) - len(judged)
                )
            )
        return "\n".join(lines)

    def definitions(self, rows: list[dict[str, str]]) -> list[str]:
        """What rows of `paper` measure, each sentence once."""
        return tables.definitions(row["definition"] for row in rows)

    def within(self, draws: bool = True) -> str:
        """How many of the cells that have a band are within it: `62 of 62`."""
        count = cells.count(self._of.cells(draws))
        return f"{count['within']} of {count['banded']}"

    def summed_up(self, draws: bool = True) -> str:
        """How many cells are within their bands, and what that counts for."""
        return tables.summed_up(self._of.cells(draws))

    def share(self, scenario: str, number: str, **limits: float) -> str:
        """The share of draws whose number is within limits (`least`, `most`), with its
        interval: `7 of 20 (of all 15 to 59 %)`."""
        share = cells.share_of(self.drawn(scenario, number), **limits)
        low, high = share.interval
        percent = f"{100.0 * share.count / share.n:.0f} %"
        return (
            f"{share.count} of {share.n} ({percent}, 95 % interval {low:.0f} to "
            f"{high:.0f} %)"
        )

    def share_worse(self, scenario: str, other: str, number: str) -> str:
        """The share of draws whose number is above that of another scenario's same
        draw."""
        pairs = list(
            zip(self.drawn(scenario, number), self.drawn(other, number), strict=False)
        )
        count = sum(a > b for a, b in pairs)
        low, high = clopper_pearson(count, len(pairs))
        percent = f"{100.0 * count / len(pairs):.0f} %"
        return f"{count} of {len(pairs)} ({percent}, 95 % interval {low:.0f} to {high:.0f} %)"

    def missed(self) -> list[dict[str, Any]]:
        """The paper's cells that have no band and are not tuned, but a remark: nothing
        reproduces them."""
        return [
            {**tables.texts_of(row), "table": row.table, "quantity": row.heading}
            for row in self._of.cells(False)
            if row.paper is not None
            and row.band is None
            and row.remark
            and not row.tuned
        ]

    def origin(self) -> str:
        """Where the draws are from."""
        return tables.origin(stored.provenance(self._of.draws, fresh=False))

    # --- series and figures -----------------------------------------------------------

    def series(
        self,
        scenario: str,
        signal: str,
        change: Change | None = None,
        *,
        step: float | None = None,
        stop: float | None = None,
    ) -> Series:
        """A series of a run, in its unit; with another step or end (s) of the run."""
        results = self._of.run(scenario, change, step, stop).results
        return Series(results.times(signal), results.values(signal).astype(float))

    def line(self, scenario: str, plot: str, change: Change | None = None) -> Series:
        """The first line of a scenario's plot, such as one that it derives."""
        spec, results = (
            self._plot(scenario, plot),
            self._of.run(scenario, change).results,
        )
        if not (lines := lines_of(spec, results, spec.unit or "1")):
            raise DesatError(f"{scenario}: plot {plot}: not recorded")
        return Series(lines[0].times, lines[0].values)

    def plot(
        self,
        file: str,
        scenario: str,
        plot: str,
        place: str = "",
        change: Change | None = None,
        stop: float | None = None,
    ) -> str:
        """A plot of a scenario as a figure; `place` stands before its title; with
        another end (s) of the run."""
        spec = self._plot(scenario, plot)
        run = self._of.run(scenario, change, stop=stop)
        drawn = series_figure(spec, [("", run.results, run.manifest.parameters)])
        if drawn is None:
            raise DesatError(f"{scenario}: plot {plot}: not recorded")
        title = spec.title
        return self._figure(
            file,
            f"{place}: {title[0].lower()}{title[1:]}" if place else title,
            drawn.svg(),
        )

    def compare(
        self,
        file: str,
        caption: str,
        lines: Sequence[tuple[str, Series]],
        axis: str,
        **options: Any,
    ) -> str:
        """Labelled series of several runs on one pair of axes; `options` of
        `figures.curves`."""
        return self._figure(file, caption, several.curves(lines, axis, **options))

    def bars(
        self,
        file: str,
        caption: str,
        groups: dict[str, dict[str, float]],
        axis: str,
        **options: Any,
    ) -> str:
        """Bars: group -> label -> value."""
        return self._figure(file, caption, several.bars(groups, axis, **options))

    def scatter(
        self,
        file: str,
        caption: str,
        groups: dict[str, tuple[list[float], list[float]]],
        x: str,
        y: str,
        **options: Any,
    ) -> str:
        """Points: label -> (x, y)."""
        return self._figure(file, caption, plots.scatter(groups, x, y, **options))

    def row(self, *cells: Any) -> str:
        """A row of a table."""
        return f"| {' | '.join(str(cell) for cell in cells)} |"

    # --- from elsewhere ---------------------------------------------------------------

    def data(self, path: str) -> dict[str, Any]:
        """A JSON or TOML file of the repository. Raises DesatError where it is not
        there."""
        home = paths.SCENARIOS.parent
        file = (home / path).resolve()
        if not file.is_relative_to(home.resolve()):
            raise DesatError(f"data: {path}: it is outside {home}")
        if not file.is_file():
            raise DesatError(f"{path}: no such file in {home}")
        text = file.read_text(encoding="utf-8")
        data: dict[str, Any] = (
            json.loads(text) if path.endswith(".json") else tomllib.loads(text)
        )
        return data

    def law(self, module: str, function: str) -> Callable[..., Any]:
        """A function of `components/laws/MODULE.py`. Raises DesatError where there is
        none."""
        name = f"desat.components.laws.{module}"
        if not module.isidentifier() or find_spec(name) is None:
            raise DesatError(f"law: no module {module} in components/laws")
        known = dict(
            inspect.getmembers(importlib.import_module(name), inspect.isfunction)
        )
        verb: Callable[..., Any] | None = known.get(function)
        if verb is None or function.startswith("_") or verb.__module__ != name:
            raise DesatError(
                f"law: no function {function} in components/laws/{module}.py"
            )
        return verb

    def covered(self) -> dict[str, float]:
        """Up to where the exchange is shown to be exact: `turn`, `kick`."""
        from desat.analyses import coverage

        return asdict(coverage.LIMITS)

    def energy_bound(self) -> float:
        """Of the hidden work, where a scenario gives no other."""
        from desat.analyses import energy

        return energy.ENERGY_BOUND

    # --- how --------------------------------------------------------------------------

    def _plot(self, scenario: str, plot: str) -> Plot:
        plots = find(self._of.name_of(scenario)).content.plots
        if plot not in plots:
            raise DesatError(f"{scenario} has no plot {plot}{nearest(plot, plots)}")
        return plots[plot]

    def _figure(self, file: str, caption: str, svg: str) -> str:
        """The Markdown of a figure, which is kept."""
        if not re.fullmatch(r"\w[\w.-]*", file):
            raise DesatError(
                f"figure {file!r}: a name of letters, digits and . _ - is needed"
            )
        name = f"{file}.svg"
        if name in self._figures:
            raise DesatError(f"figure {file}: it is there already")
        self._figures[name] = svg
        return f"\n![{caption}]({name})\n\n*{caption}*\n"

    # --- momentum management by coils -------------------------------------------------

    def least_energy(
        self, scenario: str, change: Change | None = None
    ) -> dict[str, Any]:
        """Of a run that unloads by coils: its `energy` and `peak` and the `least`
        energy with no larger one, as `desat bound` gives them."""
        from desat.analyses import coil_bound

        run = self._of.run(scenario, change)
        return asdict(coil_bound.of_run(run.manifest, run.results))

    def energy_curve(
        self, scenario: str, peaks: Sequence[float]
    ) -> list[tuple[float, float]]:
        """Of the same the least energy of each largest momentum of a wheel (N m s)."""
        from desat.analyses import coil_bound

        run = self._of.run(scenario)
        return coil_bound.curve(run.manifest, run.results, peaks)

    def least_time(self, scenario: str, number: str, held: float) -> dict[str, float]:
        """Of a detumbling run whose `number` (min) says when it is slow, for `held`
        (s): when it is (`law`), when it could be (`found`) and what no law is below
        (`floor`), in min."""
        from . import least_time

        run = self._of.run(scenario)
        if (slow := run.manifest.numbers[number].value) is None:
            if self._of.draft is None:
                raise DesatError(f"{scenario}: {number} is not reached")
            return dict.fromkeys(("law", "found", "floor"), math.nan)
        times = asdict(least_time.of_run(run.manifest, run.results, 60.0 * slow, held))
        return {name: value / 60.0 for name, value in times.items()}

    def periods(
        self, scenario: str, periods: Sequence[float]
    ) -> list[dict[str, float]]:
        """What an open-loop law would do for desaturation periods (s), on the field of
        a run."""
        from . import telescope

        run = self._of.run(scenario)
        return telescope.study(run.manifest, run.results, periods)

    def onboard(self, scenario: str) -> float:
        """Multiplications and divisions a second of a law of momentum management."""
        from . import telescope

        system, _ = prepare(self._of.name_of(scenario), Options(blocks=True)).or_raise()
        return telescope.work(system)


def _with_interval(values: Sequence[float], digits: int) -> str:
    """Their median and its 95 % interval."""
    middle, low, high = (fixed(x, digits) for x in median_interval(values))
    return f"{middle} ({low} to {high})"


# --- The filters of pages: `{{ value(...)|fixed(2) }}` --------------------------------


def fixed(value: float, digits: int = 0) -> str:
    """A number with so many digits after the point; a time that is infinite is not
    reached."""
    return text_of(None) if value == math.inf else f"{value:.{digits}f}"


def plain(value: float) -> str:
    """A number as a scenario has it: 0.25, 12, 3e-5."""
    return re.sub(r"e([+-])0", r"e\1", f"{value:g}").replace("e+", "e")


def short(value: float | None) -> str:
    """An error or a residual: two digits; empty where there is none."""
    return "" if value is None else f"{value:.1e}"


def three(values: Sequence[float], digits: int = 0) -> list[str]:
    """Median, least and most of some values."""
    return [
        fixed(x, digits) for x in (statistics.median(values), min(values), max(values))
    ]


def saving(values: Sequence[float], references: Sequence[float]) -> list[float]:
    """Per cent less than the references, one by one."""
    return [100 * (1 - v / r) for v, r in zip(values, references, strict=True)]


def correlation(x: Sequence[float], y: Sequence[float]) -> float:
    """Pearson's correlation of two lists."""
    return float(np.corrcoef(x, y)[0, 1])


FILTERS: dict[str, Callable[..., Any]] = {
    "fixed": fixed,
    "plain": plain,
    "short": short,
    "text": text_of,
    "three": three,
    "saving": saving,
    "median": statistics.median,
    "correlation": correlation,
    "degrees": math.degrees,
}
"""Beside those of Jinja2: `{{ value(...)|fixed(2) }}`."""


HELD = 60.0  # s for which a rate has to stay small until the next law begins
LONGEST = 36000.0  # s that the second law may take
PAIRED_SEED = 911  # of samples that no tuning saw


def pair_of(
    first: str, second: str, reached: str, goal: str, sample: int
) -> tuple[float, float] | None:
    """Fly a sample by two scenarios, the second from the state that the first leaves.

    Returns the times (min) from the release to the handover and to the goal; None where
    one does not get there.
    """
    source = read(first)
    drawn = sampling.draw_of(
        draft_to_draw(source, False), PAIRED_SEED, sample, "random", sample + 1
    )
    run = simulate(prepare(source, Options(values=drawn)))
    minutes = run.manifest.numbers[reached].value
    if minutes is None:
        return None
    begin = round(60.0 * minutes + HELD)
    row = int(np.searchsorted(run.results.times(), begin))
    state = [
        run.results.values(s)[row]
        for s in ("spacecraft.q_bi", "spacecraft.omega_bi_body", "wheels.h_wheel")
    ]
    there = prepare(second, Options()).or_raise()[0].components
    values = {
        name: value
        for name, value in drawn.items()
        if not name.startswith(("spacecraft.", "wheels."))
        and (owner := name.partition(".")[0]) in there
        and name.partition(".")[2] in there[owner].interface.elements
    }
    case = prepare(second, Options(values=values, stop=begin + LONGEST))
    system, _ = case.or_raise()
    system = begin_at(system, float(begin), state)
    order = schedule(system, case.options.breaks_loops)
    later = simulate(replace(case, system=system, schedule=order, manifest=None))
    after = later.manifest.numbers[goal].value
    return None if after is None else (begin / 60.0, after)
