"""Fly a craft with every law that fits it, and rank the laws by criteria.

This is `desat compare CRAFT --laws all`; `sizing/compatibility.py` finds the laws that
fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from markupsafe import Markup

from desat.fmus.registry import block_class, names

from ..analyses import analyses
from ..analyses.flight import attitude_of, flight_of, series_for, values_of
from ..analyses.management import is_braking
from ..analyses.manifest import SubstepChoice
from ..analyses.motion import mu_of, period_of
from ..campaign.draws import series_of_numbers
from ..figures.canvas import Figure
from ..figures.style import COLOURS, DASHED, figure
from ..files.scenario import Scenario
from ..language.content import content_of
from ..numbers.text import number, spell_unit
from ..report.table import Column, Table, or_not_reached
from ..runs.case import Case
from ..runs.prepare import prepare, read
from ..runs.run import Options, Run, simulate
from ..sizing.compatibility import (
    ALL,
    PLAINEST,
    ROLE,
    Fitting,
    Refused,
    check_names,
    fitting,
    law_name,
    terms_of,
)
from ..sizing.law import UnsuitedError, law_of
from ..sizing.requirements import SizingRequirements
from ..sizing.rods import CLOSE, find_rod_by_flights, find_rods_of_laws
from ..system.errors import DesatError, RunError
from ..system.model import System
from ..system.typed import JsonObject
from .compare import Comparison, of_runs, write
from .criteria import (
    AT_EASE,
    CRITERIA,
    DIPOLE,
    EMPTY,
    ORBIT,
    RECORDED,
    STANDARD,
    START,
    TORQUE,
    Criterion,
    beats,
    half_full,
    measured_run,
    time_to_empty,
)

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]

CROSS_PRODUCT = "cross product"  # the plainest law of the block PLAINEST


@dataclass(frozen=True)
class RankedLaw:
    """Law with its result in the ranking."""

    law: Fitting
    # one per criterion; NaN: not known, inf: not reached, as wheels that never empty
    values: tuple[float, ...]
    front: bool  # whether no other law is as good in all criteria and better in one
    not_met: tuple[str, ...]

    @property
    def name(self) -> str:
        """Return the name of the law."""
        return self.law.name

    @property
    def label(self) -> str:
        """Return the name, marked if the law is the craft's own."""
        return self.law.label

    @property
    def gains(self) -> str:
        """Return the gains as text."""
        if self.law.is_own:
            return "as the craft has it"
        return "; ".join(f"{k}: {x}" for k, x in self.law.gains.items()) or "its own"


@dataclass(frozen=True, repr=False)
class Ranking:
    """Laws of a craft, ranked by the first criterion.

    Those that meet all requirements come first.
    """

    target: str
    by: tuple[Criterion, ...]
    ranked: tuple[RankedLaw, ...]
    refused: tuple[Refused, ...]
    comparison: Comparison
    notes: tuple[str, ...] = ()  # how the criteria were measured, a line each

    def __repr__(self) -> str:
        return f"<Ranking {self.answer}>"

    @property
    def plainest(self) -> RankedLaw | None:
        """Return the plainest law where the choice does not matter, else None.

        That is where all laws meet all requirements with three quarters of the wheels
        free.
        """
        places = [k for k, c in enumerate(self.by) if c.name == "peak"]
        if len(self.ranked) < 2 or not places:
            return None
        is_at_ease = all(
            not e.not_met and e.values[places[0]] <= AT_EASE for e in self.ranked
        )
        return min(self.ranked, key=lambda e: plainness(e.law)) if is_at_ease else None

    @property
    def answer(self) -> str:
        """Return the sentence that answers which law is best."""
        best, c = self.ranked[0], self.by[0]
        if best.not_met:
            return (
                f"{self.target}: no law meets all requirements; {best.name} has the least "
                f"{c.title}."
            )
        front = [e.name for e in self.ranked if e.front]
        more = f"; not dominated: {', '.join(front)}" if len(self.by) > 1 else ""
        more += ". One run each, gains by rule: `desat tune` may change the order"
        least = (
            f"{best.name} has the least {c.title}, {number(best.values[0])} "
            f"{spell_unit(c.unit)}{more}."
        )
        if self.plainest is None:
            return f"{self.target}: {least}"
        return (
            f"{self.target}: all {len(self.ranked)} laws meet every requirement and leave "
            f"three quarters of the wheels free; the plainest is {self.plainest.name}. "
            f"{least[0].upper()}{least[1:]}"
        )

    @property
    def numbers(self) -> DataFrame:
        """Return the laws in order as a table.

        It has a column per criterion, one that says whether no other law dominates it,
        and one with the requirements that are not met.
        """
        from pandas import DataFrame

        columns = [*(f"{c.heading}" for c in self.by), "not dominated", "not met"]
        rows = {
            e.label: [*e.values, e.front, "; ".join(e.not_met)] for e in self.ranked
        }
        return DataFrame.from_dict(rows, orient="index", columns=columns)

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.answer)}</p>{self.numbers.to_html(na_rep='')}"

    def declined(self) -> list[tuple[str, str]]:
        """Return the managers that do not fit, grouped by reason, with the reason."""
        return by_reason(self.refused)

    @property
    def table(self) -> Table:
        """Return the laws in order as a table of the report."""
        columns = [
            Column("law", kind="text"),
            *(Column(criterion.heading) for criterion in self.by),
            Column("not dominated", kind="text"),
            Column("requirements", kind="text"),
        ]
        rows = [
            (
                entry.label,
                *(None if np.isnan(x) else _or_never(x) for x in entry.values),
                "yes" if entry.front else "",
                "; ".join(entry.not_met) or "met",
            )
            for entry in self.ranked
        ]
        return Table("", columns, rows)

    def as_json(self) -> JsonObject:
        """Return the ranking for programs; a value that is not known is null."""
        return {
            "target": self.target,
            "answer": self.answer,
            "plainest": self.plainest and self.plainest.name,
            "notes": list(self.notes),
            "by": [c.name for c in self.by],
            "laws": [
                {
                    "name": e.name,
                    "manager": e.law.manager,
                    "own": e.law.is_own,
                    "gains": dict(e.law.gains),
                    "set": dict(e.law.options.values),
                    "values": {
                        c.name: x if np.isfinite(x) else None
                        for c, x in zip(self.by, e.values, strict=True)
                    },
                    "front": e.front,
                    "not_met": list(e.not_met),
                }
                for e in self.ranked
            ],
            "refused": [asdict(r) for r in self.refused],
            "comparison": self.comparison.as_json(),
        }

    def figures(self) -> list[tuple[str, Figure]]:
        """Draw the first criterion over each other one, with captions."""
        return [
            (
                f"{self.by[0].title.capitalize()} over {other.title}: right of and above the dashed "
                "line a law is beaten in both",
                self._pareto(k),
            )
            for k, other in enumerate(self.by)
            if k
        ]

    def write(self, path: Path) -> Path:
        """Write the page with the ranking and the comparison of the runs.

        Raises OSError where it cannot be written.
        """
        pareto = [(caption, Markup(figure.svg())) for caption, figure in self.figures()]
        return write(self.comparison, path, choice=self, pareto=pareto)

    def _pareto(self, k: int) -> Figure:
        """Draw each law as a point, and the front across the whole picture."""
        fig, ax = figure()
        points = [(e.values[k], e.values[0]) for e in self.ranked]
        # a law has one colour on the page, by its place in the comparison
        places = {name: i for i, name in enumerate(self.comparison.names)}
        rows_measured = [
            (x, y, e.name, places.get(e.name, len(places)))
            for e, (x, y) in zip(self.ranked, points, strict=True)
            if np.isfinite(x) and np.isfinite(y)
        ]
        best: list[tuple[float, float]] = []
        for x, y, *_ in sorted(rows_measured):
            if not best or y < best[-1][1]:
                best += [(x, best[-1][1])] if best else []
                best.append((x, y))
        if rows_measured:
            best = [
                (best[0][0], max(y for _, y, *_ in rows_measured)),
                *best,
                (max(x for x, *_ in rows_measured), best[-1][1]),
            ]
        ax.plot(
            [x for x, _ in best],
            [y for _, y in best],
            "#999999",
            width=1.0,
            dash=DASHED,
        )
        for x, y, name, i in rows_measured:
            ax.plot(
                [x], [y], COLOURS[i % len(COLOURS)], width=0.0, marker=8.0, label=name
            )
        ax.x.label, ax.y.label = self.by[k].heading, self.by[0].heading
        ax.x.low = ax.y.low = 0.0
        return fig


def choose(
    target: str,
    options: Options,
    criteria: Sequence[Criterion],
    laws: Sequence[str],
    others: Sequence[str] = (),
    progress: Callable[[str], None] = lambda text: None,
) -> Ranking:
    """Fly a craft with its own law and with those that fit it, and rank them.

    The laws are `laws` by name, or all, and the user's own files `others`. They are
    ranked by `criteria`, or by `STANDARD` if it is empty.

    Raises
    ------
    DesatError
        If the craft cannot fly with its own law, or a criterion is not known for it.
    """
    source = read(target)
    first, laws_fitting, refused = laws_of(source, options, laws, others, progress)
    compared, runs, warnings = [laws_fitting[0]], [first], [*first.manifest.warnings]
    for k, law in enumerate(laws_fitting[1:], 2):
        progress(f"{k} of {len(laws_fitting)}: {law.name}")
        try:
            run = _fly(law.case, _choice_for_others(first))
            run.or_raise(law.name)
        except RunError as error:
            refused.append(Refused(law.name, str(error).removeprefix(f"{law.name}: ")))
            continue
        if _idle(run):
            refused.append(
                Refused(law.name, "it flew, and commanded neither dipole nor thrusters")
            )
            continue
        compared.append(law)
        runs.append(run)
        warnings += [
            f"{law.name}: {x}"
            for x in run.manifest.warnings
            if x not in warnings and not _of_the_other(x)
        ]
    measured = _Measured(source, compared, runs, progress)
    columns = {
        c.name: measured.column(c)
        for c in criteria or map(CRITERIA.__getitem__, STANDARD)
    }
    for name, column in columns.items():
        if criteria and np.isnan(column).all():
            raise DesatError(
                f"{target}: --by {name}: the {CRITERIA[name].title} is not available for it"
            )
    columns_measured = {n: x for n, x in columns.items() if not np.isnan(x).all()}
    rows = list(zip(*columns_measured.values(), strict=True))
    entries = [
        RankedLaw(
            law,
            row,
            not any(beats(other, row) for other in rows),
            tuple(run.manifest.not_met),
        )
        for law, row, run in zip(compared, rows, runs, strict=True)
    ]
    ranked = sorted(
        entries,
        key=lambda e: (bool(e.not_met), np.nan_to_num(e.values, nan=np.inf).tolist()),
    )
    of_laws = [law.name for law in compared]
    return Ranking(
        target,
        tuple(CRITERIA[name] for name in columns_measured),
        tuple(ranked),
        tuple(refused),
        of_runs(of_laws, runs, warnings),
        tuple(measured.notes),
    )


class _Measured:
    """Criteria of the laws that flew; `notes` says how they were measured."""

    def __init__(
        self,
        source: Scenario,
        laws: Sequence[Fitting],
        runs: Sequence[Run],
        progress: Callable[[str], None],
    ) -> None:
        self._source, self._laws, self._progress = source, laws, progress
        self._runs = [measured_run(run.manifest, run.results) for run in runs]
        first = self._runs[0]
        self.notes = [
            f"measured from the end of the first orbit on, t = {first.first:.0f} s"
            if first.first > first.manifest.start
            else "measured from the start: the run is shorter than two orbits"
        ]

    def column(self, criterion: Criterion) -> list[float]:
        """Return the values of a criterion, one for each law; NaN: not known."""
        if criterion.of is None:
            return {"emptying": self._emptying, "torquer": self._torquers}[
                criterion.name
            ]()
        values = [criterion.of(run) for run in self._runs]
        return [np.nan if x is None else x for x in values]

    def _emptying(self) -> list[float]:
        """Fly each law with half-full wheels and return the times (min) to empty them."""
        start = half_full(self._laws[0].case.or_raise()[0])
        if start is None:
            return [np.nan] * len(self._laws)
        self.notes.append(f"empty: every wheel below {number(EMPTY)} % of its capacity")
        times = []
        for law, run_of_law in zip(self._laws, self._runs, strict=True):
            self._progress(f"{law.name} from half-full wheels")
            run = self._from_half_full(law, start, run_of_law.manifest.substeps)
            times.append(time_to_empty(run.manifest, run.results) if run.ok else np.inf)
        return times

    def _from_half_full(self, law: Fitting, start: list[float], substeps: int) -> Run:
        """Fly a law with half-full wheels, for an orbit if they are emptied in that."""
        values = {**law.options.values, START: start}
        options = replace(law.options, values=values, substeps=substeps)
        case, first = prepare(self._source, options), self._runs[0]
        orbit = first.first - first.manifest.start
        if orbit > 0.0:
            step = first.manifest.step
            end = first.manifest.start + step * round(orbit / step)
            run = _fly(prepare(self._source, replace(options, stop=end)))
            if run.ok and np.isfinite(time_to_empty(run.manifest, run.results)):
                return run
        return _fly(case)

    def _torquers(self) -> list[float]:
        """Return the least coils (A m2) on the worst day.

        They are found by the momentum-only model, or by flights of a law that it lacks.
        """
        system, _ = self._laws[0].case.or_raise()
        if "torquers" not in system.components:
            return [np.nan] * len(self._laws)
        self._progress("the worst day of the year")
        requirements = SizingRequirements()
        models, without = {}, list[Fitting]()
        for law in self._laws:
            flying, _ = law.case.or_raise()
            try:
                models[law.name] = law_of(flying.components[ROLE])
            except UnsuitedError:
                without.append(law)
        try:
            flight = flight_of(system, self._runs[0].results)
            hardest, rods = find_rods_of_laws(
                system, flight, list(models.values()), requirements
            )
        except DesatError as error:
            self.notes.append(f"no least torquer: {error}")
            return [np.nan] * len(self._laws)
        rods_of_models = dict(zip(models, rods, strict=True))
        for law in without:
            self._progress(f"{law.name} on the worst day, rods by bisection")
            rods_of_models[law.name] = find_rod_by_flights(
                self._source, law.options, hardest, requirements
            )
        names_without = [law.name for law in without]
        self.notes.append(
            f"the worst day is {hardest.day}; the model of `desat size` has "
            f"{_but(names_without)}"
        )
        if without:
            self.notes.append(
                f"least torquer of {', '.join(names_without)}: by flights of that day, to "
                f"{100.0 * (CLOSE - 1.0):.0f} %"
            )
        return [_or_infinite(rods_of_models[law.name]) for law in self._laws]


def _but(names: Sequence[str]) -> str:
    """Return the text of a list of exceptions."""
    return f"all laws but {', '.join(names)}" if names else "all laws"


def _or_infinite(value: float | None) -> float:
    """Return a value, infinite in place of None."""
    return np.inf if value is None else value


def _or_never(value: float) -> str | float:
    """Return a value, or the text that it is not reached where it is infinite."""
    return or_not_reached(None if np.isinf(value) else value)


def by_reason(refused: Sequence[Refused]) -> list[tuple[str, str]]:
    """Return the names of managers, joined for each reason, with the reason."""
    reasons: dict[str, list[str]] = {}
    for each in refused:
        reasons.setdefault(each.why, []).append(each.name)
    return [(", ".join(texts), reason) for reason, texts in reasons.items()]


def plainness(law: Fitting) -> tuple[bool, bool, float]:
    """Return a key by which laws are sorted from the plainest on.

    The cross product comes first, then a law by the number of its block's parameters;
    files of the user's own come last.
    """
    is_other = law.name != CROSS_PRODUCT
    if law.manager not in names():
        return True, is_other, np.inf
    variables = block_class(law.manager)().variables
    count = sum(v.causality == "parameter" for v in variables)
    return law.manager != PLAINEST, is_other, count


def laws_of(
    source: Scenario,
    options: Options,
    laws: Sequence[str],
    others: Sequence[str] = (),
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Run, list[Fitting], list[Refused]]:
    """Fly a craft with its own law, and find the laws that fit it.

    The own law comes first. Gains by rule follow from its run. The laws that do not fit
    are returned last.

    Raises
    ------
    DesatError
        If the craft cannot fly with its own law, or brakes its rotation.
    """
    check_names(laws, others)
    case = prepare(source, options)
    system, _ = case.or_raise()
    values_of(system)  # checks that the roles exist
    _check_holding(source, system)
    progress("its own law")
    first = _fly(case).or_raise(source.target)
    r, v, b, q = (first.results.values(s) for s in ORBIT)
    inertial = attitude_of(system, q, r, v).kind in ("inertial", "sun")
    terms = terms_of(period_of(r[0], v[0], mu_of(system)), b, inertial)
    return first, *fitting(case, terms, laws, others)


def _check_holding(source: Scenario, system: System) -> None:
    """Refuse a craft whose law brakes its rotation: the laws compared hold wheels."""
    manager = system.roles.get(ROLE)
    if manager is not None and is_braking(manager):
        raise DesatError(
            f"{source.target}: {ROLE} = {manager.model} brakes a tumbling craft, and "
            "the laws to compare keep the momentum of wheels low; compare two scenarios that "
            "brake instead, as `desat compare CRAFT/detumbling.toml CRAFT/rollout.toml`"
        )


def options_of_laws(
    target: str, options: Options, names: Sequence[str]
) -> dict[str, Options]:
    """Return the options of a run for each law, by its name.

    The laws are the craft's own, or those in `names`. A gain that follows from the
    craft stays a product of its parameters.

    Raises
    ------
    DesatError
        If a law does not fit.
    """
    source = read(target)
    system, _ = prepare(source, options).or_raise()
    if not names:
        manager = system.roles.get(ROLE)
        return {law_name(manager) if manager else system.name: options}
    files = [name for name in names if Path(name).suffix in (".py", ".fmu")]
    _, laws_fitting, refused = laws_of(
        source, options, [x for x in names if x not in files], files
    )
    for law in refused:
        if ALL not in names:
            raise DesatError(f"--law {law.name}: {law.why}")
    return {law.name: _following(law) for law in laws_fitting}


def _following(law: Fitting) -> Options:
    """Return a law's options, with products in place of values that follow them."""
    component = law.case.or_raise()[0].components[ROLE]
    follows = {
        f"{ROLE}.{s.array}": s.follows
        for s in component.interface.parameters
        if s.follows
    }
    values = {
        name: follows[name]
        if law.gains.get(name.partition(".")[2]) == follows.get(name)
        else value
        for name, value in law.options.values.items()
    }
    return replace(law.options, values=values)


def _fly(case: Case, choice: SubstepChoice | None = None) -> Run:
    """Fly a craft and record the series that judge it and that its plots show.

    `choice` is that of the substeps with which the run begins; None: it chooses itself.
    """
    system, _ = case.or_raise()
    options = replace(case.options, record=recorded(system))
    return simulate(replace(case, options=options), choice=choice)


def _choice_for_others(run: Run) -> SubstepChoice | None:
    """Return the substeps with which the other laws begin; None: each chooses itself.

    A run that leaves the range in which they were chosen is checked again.
    """
    choice = run.manifest.substep_choice
    if choice is None or choice.reached is None:
        return None
    return replace(choice, steps=0, flown=0, seconds=0.0)


def recorded(system: System) -> tuple[str, ...]:
    """Return the series that judge a craft and that its plots show."""
    plots = content_of(system.about).plots.values()
    series = {
        *series_of_numbers(system),
        *(s for p in plots for s in p.signals),
        *RECORDED,
        *series_for(system),
    }
    for analysis in analyses():
        if parts := analysis.applies(system):
            series.update(analysis.balanced(parts))
    there = {
        f"{c.name}.{s.series}"
        for c in system.components.values()
        for s in c.interface.outputs
    }
    return tuple(sorted(series & there))


def _of_the_other(warning: str) -> bool:
    """Return whether a warning concerns unused values of the craft's own manager.

    They do not matter, because the law has its own values by rule.
    """
    return warning.startswith(f"{ROLE}: ") and " does not take " in warning


def _idle(run: Run) -> bool:
    """Return whether neither coils nor thrusters received a command."""
    series_names = set(run.results.names())
    return not any(
        run.results.values(s).any() for s in (DIPOLE, TORQUE) if s in series_names
    )
