"""`desat compare CRAFT --laws all`: a craft flown with every law that fits it
(`sizing/compatibility.py`), and the laws ranked by what is asked for."""

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
STANDARD = ("peak", "duty", "energy", "pointing", "firing")
"""What laws are ranked by where nothing is asked for, as far as it can be told of the
craft."""


class Criterion(NamedTuple):
    """What laws are ranked by: the less, the better."""

    name: str
    title: str
    unit: str
    of: Callable[[Manifest, Results], float | None]
    """of a run; None: it cannot be told"""

    @property
    def heading(self) -> str:
        """Of a column, and of an axis."""
        return f"{self.title} [{spell_unit(self.unit)}]"


def _filled(manifest: Manifest, results: Results) -> float | None:
    margin = manifest.numbers.get("momentum_margin")
    return None if margin is None or margin.value is None else 100.0 - margin.value


def _stored_runs(manifest: Manifest, results: Results) -> float | None:
    largest = manifest.numbers.get("sum_largest")
    return None if largest is None else largest.value


def _duty(manifest: Manifest, results: Results) -> float | None:
    duty = manifest.numbers.get("coil_duty")
    return None if duty is None else duty.value


def _pointing(manifest: Manifest, results: Results) -> float | None:
    if REFERENCE not in results.names():
        return None
    q, wanted = results.values(ORBIT[3]), results.values(REFERENCE)
    n = min(len(q), len(wanted))
    return float(np.sqrt((pointing(q[:n], wanted[:n]) ** 2).mean()))


def _last(signal: str) -> Callable[[Manifest, Results], float | None]:
    def of(manifest: Manifest, results: Results) -> float | None:
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
    """A law as it flew."""

    law: Fitting
    values: tuple[float, ...]
    """one a criterion; inf where it cannot be told"""
    front: bool
    """whether no other law is as good in all criteria and better in one"""
    not_met: tuple[str, ...]

    @property
    def name(self) -> str:
        """Of the law."""
        return self.law.name

    @property
    def label(self) -> str:
        """The name, and whether it is the craft's own."""
        return f"{self.name} (own)" if self.law.own else self.name

    @property
    def gains(self) -> str:
        """Its gains."""
        if self.law.own:
            return "as the craft has it"
        return "; ".join(f"{k}: {x}" for k, x in self.law.gains.items()) or "its own"


@dataclass(frozen=True, repr=False)
class Ranking:
    """The laws of a craft, by the first criterion, those that meet all requirements
    first."""

    target: str
    by: tuple[Criterion, ...]
    ranked: tuple[RankedLaw, ...]
    refused: tuple[Refused, ...]
    comparison: Comparison

    def __repr__(self) -> str:
        return f"<Ranking {self.answer}>"

    @property
    def answer(self) -> str:
        """The sentence that answers."""
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
        """The laws in their order: a column a criterion, whether another law is better
        in all of them, and the requirements that are not met."""
        from pandas import DataFrame

        columns = [*(f"{c.heading}" for c in self.by), "not dominated", "not met"]
        rows = {
            e.label: [*e.values, e.front, "; ".join(e.not_met)] for e in self.ranked
        }
        return DataFrame.from_dict(rows, orient="index", columns=columns)

    def _repr_html_(self) -> str:
        return f"<p>{escape(self.answer)}</p>{self.numbers.to_html(na_rep='')}"

    def declined(self) -> list[tuple[str, str]]:
        """Managers that do not fit, those of one reason together, and the reason."""
        why: dict[str, list[str]] = {}
        for each in self.refused:
            why.setdefault(each.why, []).append(each.name)
        return [(", ".join(names), text) for text, names in why.items()]

    @property
    def table(self) -> Table:
        """Return the laws in their order."""
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
        """For programs; a value that cannot be told is null."""
        return {
            "target": self.target,
            "answer": self.answer,
            "by": [c.name for c in self.by],
            "laws": [
                {
                    "name": e.name,
                    "manager": e.law.manager,
                    "own": e.law.own,
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
        """Caption and picture of the first criterion over each other."""
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
        """The page: the ranking, and what `compare` has of runs. Raises OSError where
        it cannot be written."""
        pareto = [(caption, Markup(drawn.svg())) for caption, drawn in self.figures()]
        return write(self.comparison, path, choice=self, pareto=pareto)

    def _pareto(self, k: int) -> Figure:
        """A law of its own at each point; the front from one edge of the picture to the
        other."""
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
    """The criteria of a list, `peak,duty`. Raises DesatError for one that there is not."""
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
    asked: Sequence[Criterion],
    laws: Sequence[str],
    others: Sequence[str] = (),
    progress: Callable[[str], None] = lambda text: None,
) -> Ranking:
    """Fly a craft with its own law and with those that fit it: `laws` by name, or all,
    and the `others` of the user's own, files; `asked` is what they are ranked by,
    nothing: STANDARD. Raises DesatError for a craft that cannot fly with its own, and
    where a criterion is of something that it has not."""
    source = read(target)
    first, found, refused = laws_of(source, options, laws, others, progress)
    flown, runs, warnings = [found[0]], [first], [*first.manifest.warnings]
    for k, law in enumerate(found[1:], 2):
        progress(f"{k} of {len(found)}: {law.name}")
        try:
            run = _fly(law.options, source, prepare_with(source, law).or_raise()[0])
            run.or_raise(law.name)
        except RunError as why:
            refused.append(Refused(law.name, str(why).removeprefix(f"{law.name}: ")))
            continue
        if _idle(run):
            refused.append(
                Refused(law.name, "it flew, and commanded neither dipole nor thrusters")
            )
            continue
        flown.append(law)
        runs.append(run)
        warnings += [
            f"{law.name}: {x}"
            for x in run.manifest.warnings
            if x not in warnings and not _of_the_other(x)
        ]
    known = [
        c
        for c in asked or map(CRITERIA.__getitem__, STANDARD)
        if any(c.of(run.manifest, run.results) is not None for run in runs)
    ]
    for c in asked or known:
        if c not in known:
            raise DesatError(
                f"{target}: --by {c.name}: the {c.title} is not available for it"
            )
    rows = [tuple(c.of(run.manifest, run.results) for c in known) for run in runs]
    whole = [tuple(np.inf if x is None else x for x in row) for row in rows]
    entries = [
        RankedLaw(
            law,
            row,
            not any(_beats(other, row) for other in whole),
            tuple(run.manifest.not_met),
        )
        for law, row, run in zip(flown, whole, runs, strict=True)
    ]
    ranked = sorted(entries, key=lambda e: (bool(e.not_met), e.values))
    names = [law.name for law in flown]
    beside = of_runs(names, runs, warnings)
    return Ranking(target, tuple(known), tuple(ranked), tuple(refused), beside)


def laws_of(
    source: Target,
    options: Options,
    laws: Sequence[str],
    others: Sequence[str] = (),
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[Run, list[Fitting], list[Refused]]:
    """A craft flown with its own law, which gains by rule go by, and the laws that fit
    it, its own first, with their gains, and those that do not. Raises DesatError as
    `choose`."""
    check_names(laws, others)
    own = prepare(source, options)
    system, _ = own.or_raise()
    values_of(system)  # the roles that this asks of
    progress("its own law")
    first = _fly(own.options, source, system).or_raise(source.text)
    r, v, b, q = (first.results.values(s) for s in ORBIT)
    inertial = attitude_of(system, q, r, v).kind in ("inertial", "sun")
    terms = terms_of(period_of(r[0], v[0]), b, inertial)
    return first, *fitting(source, options, terms, laws, others)


def options_of_laws(
    target: str, options: Options, asked: Sequence[str]
) -> dict[str, Options]:
    """Of a craft's own law, and of those that are asked for beside it, by name, the
    options of a run; what a gain follows of the craft stays a product of its
    parameters. Raises DesatError for a law that does not fit."""
    source = read(target)
    system, _ = prepare(source, options).or_raise()
    if not asked:
        manager = system.roles.get(ROLE)
        return {law_name(manager) if manager else system.name: options}
    files = [name for name in asked if Path(name).suffix in (".py", ".fmu")]
    _, found, refused = laws_of(
        source, options, [x for x in asked if x not in files], files
    )
    for law in refused:
        if ALL not in asked:
            raise DesatError(f"--law {law.name}: {law.why}")
    return {law.name: _following(source, law) for law in found}


def _following(source: Target, law: Fitting) -> Options:
    """The options of a law, with the products that its parameters follow in place of
    their values."""
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
    """A run that has recorded what it is judged by and what its plots show."""
    plots = content_of(system.about).plots.values()
    wanted = {
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
            wanted.update(analysis.balanced(parts))
    there = {
        f"{c.name}.{s.series}"
        for c in system.components.values()
        for s in c.interface.outputs
    }
    return simulate(
        prepare(source, replace(options, record=tuple(sorted(wanted & there))))
    )


def _of_the_other(warning: str) -> bool:
    """Whether it says that values of the craft's own manager go: the law has its own by
    rule."""
    return warning.startswith(f"{ROLE}: ") and " does not take " in warning


def _idle(run: Run) -> bool:
    """Whether neither coils nor thrusters were commanded to do anything."""
    known = set(run.results.names())
    return not any(run.results.values(s).any() for s in (DIPOLE, TORQUE) if s in known)


def _beats(one: Sequence[float], other: Sequence[float]) -> bool:
    return one != other and all(a <= b for a, b in zip(one, other, strict=True))
