"""Fly a craft with every law that fits it, and rank the laws by criteria.

This is `desat compare CRAFT --laws all`; `sizing/compatibility.py` finds the laws that
fit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from markupsafe import Markup

from ..analyses import analyses
from ..analyses.flight import attitude_of, values_of
from ..analyses.manifest import Manifest
from ..analyses.motion import period_of
from ..campaign.draws import series_of_numbers
from ..engine.recording.results import Results
from ..figures.canvas import Figure
from ..figures.style import COLOURS, DASHED, figure
from ..language.content import content_of
from ..numbers.derived import pointing
from ..numbers.text import number, spell_unit
from ..report.table import Column, Table
from ..runs.prepare import Target, prepare, read
from ..runs.run import Options, Run, simulate
from ..sizing.compatibility import (
    ALL,
    ROLE,
    Fitting,
    Refused,
    check_names,
    fitting,
    law_name,
    prepare_with,
    terms_of,
)
from ..system.errors import DesatError, RunError, nearest
from ..system.model import System
from ..system.typed import JsonObject
from .compare import Comparison, of_runs, write

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]

ORBIT = (
    "environment.r_eci",
    "environment.v_eci",
    "environment.b_eci",
    "spacecraft.q_bi",
)
REFERENCE = "guidance.q_ref_bi"
DIPOLE, ENERGY = "torquers.m_mean_body", "torquers.electric_energy"
TORQUE, FIRING = "thrusters.tau_mean_thruster_body", "thrusters.on_time"
# Default criteria for the ranking, as far as they are known for the craft.
STANDARD = ("peak", "duty", "energy", "pointing", "firing")


class Criterion(NamedTuple):
    """Criterion by which laws are ranked; a smaller value is better."""

    name: str
    title: str
    unit: str
    # value for a run; None: it is not known
    of: Callable[[Manifest, Results], float | None]

    @property
    def heading(self) -> str:
        """Return the title with unit, for a column or an axis."""
        return f"{self.title} [{spell_unit(self.unit)}]"


def _filled(manifest: Manifest, results: Results) -> float | None:
    """Return the fill of the fullest wheel (%), or None if it is not known."""
    margin = manifest.numbers.get("momentum_margin")
    return None if margin is None or margin.value is None else 100.0 - margin.value


def _stored_runs(manifest: Manifest, results: Results) -> float | None:
    """Return the largest total wheel momentum (N m s), or None if it is not known."""
    largest = manifest.numbers.get("sum_largest")
    return None if largest is None else largest.value


def _duty(manifest: Manifest, results: Results) -> float | None:
    """Return the coil duty (%), or None if it is not known."""
    duty = manifest.numbers.get("coil_duty")
    return None if duty is None else duty.value


def _pointing(manifest: Manifest, results: Results) -> float | None:
    """Compute the rms pointing error (deg), or None without a reference."""
    if REFERENCE not in results.names():
        return None
    q, reference = results.values(ORBIT[3]), results.values(REFERENCE)
    n = min(len(q), len(reference))
    return float(np.sqrt((pointing(q[:n], reference[:n]) ** 2).mean()))


def _last(signal: str) -> Callable[[Manifest, Results], float | None]:
    """Build the criterion that takes the last value of a series, or None without it."""

    def of(manifest: Manifest, results: Results) -> float | None:
        """Return the last value of the series, or None without it."""
        return float(results.values(signal)[-1]) if signal in results.names() else None

    return of


CRITERIA = {
    c.name: c
    for c in (
        Criterion("peak", "fill of the fullest wheel", "%", _filled),
        Criterion("stored", "momentum of the wheels", "N.m.s", _stored_runs),
        Criterion("duty", "coil duty", "%", _duty),
        Criterion("energy", "coil energy", "J", _last(ENERGY)),
        Criterion("pointing", "pointing error, rms", "deg", _pointing),
        Criterion("firing", "firing time", "s", _last(FIRING)),
    )
}


@dataclass(frozen=True)
class RankedLaw:
    """Law with its result in the ranking."""

    law: Fitting
    values: tuple[float, ...]  # one per criterion; inf where it is not known
    front: bool  # whether no other law is as good in all criteria and better in one
    not_met: tuple[str, ...]

    @property
    def name(self) -> str:
        """Return the name of the law."""
        return self.law.name

    @property
    def label(self) -> str:
        """Return the name, marked if the law is the craft's own."""
        return f"{self.name} (own)" if self.law.is_own else self.name

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

    def __repr__(self) -> str:
        return f"<Ranking {self.answer}>"

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
        return (
            f"{self.target}: {best.name} has the least {c.title}, {number(best.values[0])} "
            f"{spell_unit(c.unit)}{more}."
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
        reasons: dict[str, list[str]] = {}
        for each in self.refused:
            reasons.setdefault(each.why, []).append(each.name)
        return [(", ".join(names), text) for text, names in reasons.items()]

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
                *(x if np.isfinite(x) else None for x in entry.values),
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
        pareto = [(caption, Markup(drawn.svg())) for caption, drawn in self.figures()]
        return write(self.comparison, path, choice=self, pareto=pareto)

    def _pareto(self, k: int) -> Figure:
        """Draw each law as a point, and the front across the whole picture."""
        fig, ax = figure()
        points = [(e.values[k], e.values[0]) for e in self.ranked]
        known = [
            (x, y, e.name, i)
            for i, (e, (x, y)) in enumerate(zip(self.ranked, points, strict=True))
            if np.isfinite(x) and np.isfinite(y)
        ]
        best: list[tuple[float, float]] = []
        for x, y, *_ in sorted(known):
            if not best or y < best[-1][1]:
                best += [(x, best[-1][1])] if best else []
                best.append((x, y))
        if known:
            best = [
                (best[0][0], max(y for _, y, *_ in known)),
                *best,
                (max(x for x, *_ in known), best[-1][1]),
            ]
        ax.plot(
            [x for x, _ in best],
            [y for _, y in best],
            "#999999",
            width=1.0,
            dash=DASHED,
        )
        for x, y, name, i in known:
            ax.plot(
                [x], [y], COLOURS[i % len(COLOURS)], width=0.0, marker=8.0, label=name
            )
        ax.x.label, ax.y.label = self.by[k].heading, self.by[0].heading
        ax.x.low = ax.y.low = 0.0
        return fig


def criteria(by: str) -> tuple[Criterion, ...]:
    """Parse a list of criteria, as `peak,duty`.

    Raises
    ------
    DesatError
        If there is no such criterion.
    """
    names = [x.strip() for x in by.split(",") if x.strip()]
    for name in names or [by]:
        if name not in CRITERIA:
            raise DesatError(
                f"--by {by}: no {name or 'name'}{nearest(name, CRITERIA)}; there is "
                f"{', '.join(CRITERIA)}"
            )
    return tuple(CRITERIA[name] for name in dict.fromkeys(names))


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
    first, found, refused = laws_of(source, options, laws, others, progress)
    compared, runs, warnings = [found[0]], [first], [*first.manifest.warnings]
    for k, law in enumerate(found[1:], 2):
        progress(f"{k} of {len(found)}: {law.name}")
        try:
            run = _fly(law.options, source, prepare_with(source, law).or_raise()[0])
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
    known = [
        c
        for c in criteria or map(CRITERIA.__getitem__, STANDARD)
        if any(c.of(run.manifest, run.results) is not None for run in runs)
    ]
    for c in criteria or known:
        if c not in known:
            raise DesatError(
                f"{target}: --by {c.name}: the {c.title} is not available for it"
            )
    rows = [tuple(c.of(run.manifest, run.results) for c in known) for run in runs]
    comparable = [tuple(np.inf if x is None else x for x in row) for row in rows]
    entries = [
        RankedLaw(
            law,
            row,
            not any(_beats(other, row) for other in comparable),
            tuple(run.manifest.not_met),
        )
        for law, row, run in zip(compared, comparable, runs, strict=True)
    ]
    ranked = sorted(entries, key=lambda e: (bool(e.not_met), e.values))
    names = [law.name for law in compared]
    comparison = of_runs(names, runs, warnings)
    return Ranking(target, tuple(known), tuple(ranked), tuple(refused), comparison)


def laws_of(
    source: Target,
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
        If the craft cannot fly with its own law.
    """
    check_names(laws, others)
    case = prepare(source, options)
    system, _ = case.or_raise()
    values_of(system)  # checks that the roles exist
    progress("its own law")
    first = _fly(case.options, source, system).or_raise(source.text)
    r, v, b, q = (first.results.values(s) for s in ORBIT)
    inertial = attitude_of(system, q, r, v).kind in ("inertial", "sun")
    terms = terms_of(period_of(r[0], v[0]), b, inertial)
    return first, *fitting(source, options, terms, laws, others)


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
    _, found, refused = laws_of(
        source, options, [x for x in names if x not in files], files
    )
    for law in refused:
        if ALL not in names:
            raise DesatError(f"--law {law.name}: {law.why}")
    return {law.name: _following(source, law) for law in found}


def _following(source: Target, law: Fitting) -> Options:
    """Return a law's options, with products in place of values that follow them."""
    component = prepare_with(source, law).or_raise()[0].components[ROLE]
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


def _fly(options: Options, source: Target, system: System) -> Run:
    """Fly a craft and record the series that judge it and that its plots show."""
    plots = content_of(system.about).plots.values()
    series = {
        *series_of_numbers(system),
        *(s for p in plots for s in p.signals),
        *ORBIT,
        REFERENCE,
        DIPOLE,
        ENERGY,
        TORQUE,
        FIRING,
    }
    for analysis in analyses():
        if parts := analysis.applies(system):
            series.update(analysis.balanced(parts))
    there = {
        f"{c.name}.{s.series}"
        for c in system.components.values()
        for s in c.interface.outputs
    }
    return simulate(
        prepare(source, replace(options, record=tuple(sorted(series & there))))
    )


def _of_the_other(warning: str) -> bool:
    """Return whether a warning concerns unused values of the craft's own manager.

    They do not matter, because the law has its own values by rule.
    """
    return warning.startswith(f"{ROLE}: ") and " does not take " in warning


def _idle(run: Run) -> bool:
    """Return whether neither coils nor thrusters received a command."""
    known = set(run.results.names())
    return not any(run.results.values(s).any() for s in (DIPOLE, TORQUE) if s in known)


def _beats(one: Sequence[float], other: Sequence[float]) -> bool:
    """Return whether one law is as good in all criteria and better in one."""
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))
