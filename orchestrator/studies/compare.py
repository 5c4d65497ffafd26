"""Compare scenarios and runs side by side, or scenarios draw by draw in pairs.

This is `desat compare`. All others are compared with the first: a difference is the
first's number less the other's, as in `campaign/pairs.py`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from desat.components.contract.units import conversion

from ..analyses.manifest import Manifest
from ..campaign.draws import Draws, draws
from ..campaign.pairs import Pairs, common, difference, differences
from ..campaign.plan import PLAN
from ..engine.recording.results import MANIFEST
from ..figures.plots import series_figure
from ..numbers.text import Value, number, spell_unit
from ..report.cases import find_cases
from ..report.report import figures_of, render, write_page
from ..report.table import ROW_UNIT, Column, Row, Table, or_not_reached
from ..runs.cases import Cases
from ..runs.prepare import prepare, read
from ..runs.run import Options, Run, load_run, simulate
from ..system.errors import DesatError
from ..system.parameters import known_unit
from ..system.typed import JsonObject

if TYPE_CHECKING:
    from pandas import DataFrame  # type: ignore[import-untyped]


@dataclass(frozen=True)
class ComparedNumber:
    """Number of several runs."""

    title: str
    unit: str
    values: tuple[float | None, ...]  # one per run; None: not reached
    there: tuple[bool, ...]  # which runs have it, in this unit

    @property
    def differences(self) -> tuple[float | None, ...]:
        """Compute the first's value less each other's; None where one is missing."""
        first, *others = self.values
        return tuple(
            None if first is None or x is None else difference(first, x) for x in others
        )

    @property
    def row(self) -> Row:
        """Return the title, the values, the differences and the unit."""
        values = [
            or_not_reached(x) if is_there else None
            for x, is_there in zip(self.values, self.there, strict=True)
        ]
        return [self.title, *values, *self.differences, self.unit]


@dataclass(frozen=True, repr=False)
class Comparison:
    """Runs side by side."""

    targets: tuple[str, ...]
    runs: tuple[Run, ...]
    # By name: numbers of the first run in its order, then those that only others have.
    rows: dict[str, ComparedNumber]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        return f"<Comparison {', '.join(self.targets)}: {len(self.rows)} numbers>"

    @property
    def numbers(self) -> DataFrame:
        """Return the numbers by name as a table.

        Its columns are title, unit, the value of each target, and `less TARGET`: the
        first's value less the target's.
        """
        from pandas import DataFrame

        rows = {
            name: [row.title, row.unit, *row.values, *row.differences]
            for name, row in self.rows.items()
        }
        columns = [
            "title",
            "unit",
            *self.targets,
            *(f"less {x}" for x in self.targets[1:]),
        ]
        return DataFrame.from_dict(rows, orient="index", columns=columns)

    def _repr_html_(self) -> str:
        return str(self.numbers.to_html(na_rep=""))

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of the runs: scenarios, or the targets as typed.

        The targets serve where two runs are of one scenario. For laws the names are
        those of the laws.
        """
        files = [t.endswith((".toml", ".ssp")) for t in self.targets]
        scenarios = tuple(
            run.manifest.scenario if is_file else target
            for target, run, is_file in zip(self.targets, self.runs, files, strict=True)
        )
        return scenarios if len(set(scenarios)) == len(scenarios) else self.targets

    @property
    def table(self) -> Table:
        """Tabulate the numbers side by side, with the first's less each other's."""
        first, *others = self.names
        titles = [*self.names, *(f"{first} less {x}" for x in others)]
        columns = [
            Column("", kind="text"),
            *(Column(title, ROW_UNIT) for title in titles),
            Column("unit", kind="unit"),
        ]
        return Table("", columns, [row.row for row in self.rows.values()])

    def as_json(self) -> JsonObject:
        """Return the comparison for programs.

        A run that lacks a number is not among its values; null means not reached.
        """
        return {
            "targets": list(self.targets),
            "warnings": list(self.warnings),
            "difference": difference_text(self),
            "not_met": {
                t: list(r.manifest.not_met)
                for t, r in zip(self.targets, self.runs, strict=True)
            },
            "numbers": {
                name: {
                    "title": row.title,
                    "unit": row.unit,
                    "values": {
                        t: x
                        for t, x, there in zip(
                            self.targets, row.values, row.there, strict=True
                        )
                        if there
                    },
                    "differences": dict(
                        zip(self.targets[1:], row.differences, strict=True)
                    ),
                }
                for name, row in self.rows.items()
            },
        }


def are_campaigns(targets: Sequence[str]) -> bool:
    """Return whether the targets are folders of campaigns.

    Raises
    ------
    DesatError
        If only some are, there are fewer than two, or one comes twice.
    """
    if len(targets) < 2:
        raise DesatError(f"{' '.join(targets)}: two or more are needed to compare")
    if twice := [t for i, t in enumerate(targets) if t in targets[:i]]:
        raise DesatError(f"{twice[0]}: it is there twice")
    folders = [(Path(t) / PLAN).is_file() for t in targets]
    if any(folders) and not all(folders):
        raise DesatError(
            f"{targets[folders.index(True)]} is a campaign, "
            f"{targets[folders.index(False)]} is none: campaigns compare with "
            "campaigns alone"
        )
    return all(folders)


def is_run(target: str) -> bool:
    """Return whether a target is the folder of a run."""
    return (Path(target) / MANIFEST).is_file()


def side_by_side(
    targets: Sequence[str | Run],
    options: Options,
    progress: Callable[[str], None] = lambda text: None,
) -> Comparison:
    """Run scenarios now with these options, load run folders, and compare them.

    A target may be a run.

    Raises DesatError (or its subclass RunError) where a run cannot begin or does not
    complete.
    """
    # check all targets before the first flies
    cases = [
        None if isinstance(t, Run) or is_run(t) else prepare(t, options)
        for t in targets
    ]
    names = [t.manifest.scenario if isinstance(t, Run) else t for t in targets]
    names = [f"{n} ({k})" if n in names[:k] else n for k, n in enumerate(names)]
    warnings: list[str] = []
    for case in cases:
        if case is not None:
            case.or_raise()
    runs = []
    for k, (target, case) in enumerate(zip(targets, cases, strict=True)):
        progress(f"{k + 1} of {len(targets)}: {names[k]}")
        if isinstance(target, Run):
            run = target
        else:
            run = load_run(Path(target)) if case is None else simulate(case)
        runs.append(run.or_raise(names[k]))
        warnings += [f"{names[k]}: {line}" for line in run.manifest.warnings]
    return of_runs(names, runs, warnings)


def of_runs(
    targets: Sequence[str], runs: Sequence[Run], warnings: Sequence[str]
) -> Comparison:
    """Compare completed runs side by side, by their names."""
    ends = [run.manifest.end_time for run in runs]
    uneven = [
        f"{targets[0]} ends at {ends[0]:g} s, {target} at {end:g} s"
        for target, end in zip(targets[1:], ends[1:], strict=True)
        if end != ends[0] and end is not None and ends[0] is not None
    ]
    return Comparison(tuple(targets), tuple(runs), rows_of(runs), (*warnings, *uneven))


MENTIONED = 3  # values and numbers that the sentence of a comparison names
WORTH = 0.01  # relative difference from which it names a number


def difference_text(comparison: Comparison) -> str:
    """Return a sentence that says what differs between two runs, and what follows.

    It names parameters, components and settings that differ, then those numbers of
    requirements that differ by `WORTH` or more. "" for more than two runs.
    """
    if len(comparison.runs) != 2:
        return ""
    causes = _causes(*(run.manifest for run in comparison.runs))
    judged = {
        v.number for run in comparison.runs for v in run.manifest.verdicts.values()
    }
    effects = []
    for name, row in comparison.rows.items():
        first, second = row.values
        if name not in judged or not all(row.there):
            continue
        if first is None or second is None:
            if first is not second:
                effects.append((np.inf, row))
            continue
        size = max(abs(first), abs(second))
        if size > 0.0 and abs(first - second) >= WORTH * size:
            effects.append((abs(first - second) / size, row))
    effects.sort(key=lambda e: -e[0])
    names = " and ".join(comparison.names)
    text = f"{names} differ in {_listed(causes)}" if causes else f"{names} are alike"
    if not judged:
        return f"{text}."
    if not effects:
        return f"{text}; no number of a requirement differs by {100.0 * WORTH:g} %."
    return f"{text}; with that, {_listed([_effect(row) for _, row in effects])}."


def _causes(first: Manifest, second: Manifest) -> list[str]:
    """Return what differs in the inputs of two runs, a text each."""
    causes = [
        f"{name} ({a} and {b})"
        for name, a, b in (
            ("algorithm", first.algorithm, second.algorithm),
            ("step", f"{first.step:g} s", f"{second.step:g} s"),
            ("substeps", first.substeps, second.substeps),
            ("stop", f"{first.stop:g} s", f"{second.stop:g} s"),
        )
        if a != b
    ]
    sources = [
        {name: Path(fmu["source"]).stem for name, fmu in m.fmus.items()}
        for m in (first, second)
    ]
    for name in dict.fromkeys([*sources[0], *sources[1]]):
        a, b = (of.get(name, "absent") for of in sources)
        if a != b:
            causes.append(f"{name} ({a} and {b})")
    for name, table in first.parameters.items():
        others = second.parameters.get(name, {})
        for key, parameter in table.items():
            if key in others and others[key].value != parameter.value:
                a, b = (_value_text(x.value) for x in (parameter, others[key]))
                unit = "" if parameter.unit == "1" else f" {spell_unit(parameter.unit)}"
                causes.append(f"{name}.{key} ({a} and {b}{unit})")
    return causes


def _value_text(value: Any) -> str:
    """Return a parameter's value; of an array its elements that differ from 0."""
    if not isinstance(value, list):
        return number(value) if isinstance(value, float) else str(value)
    if len(value) > 4:
        return f"{len(value)} values"
    return "[" + ", ".join(number(x) for x in value) + "]"


def _effect(row: ComparedNumber) -> str:
    """Return the two values of a number."""
    values = ["not reached" if x is None else f"{number(x)}" for x in row.values]
    unit = f" {spell_unit(row.unit)}".rstrip()
    return f"{row.title}: {values[0]} and {values[1]}{unit}"


def _listed(texts: Sequence[str]) -> str:
    """Join the first `MENTIONED` texts, and count the others; a lone one is named too."""
    is_lone = len(texts) == MENTIONED + 1
    texts_shown = list(texts if is_lone else texts[:MENTIONED])
    if more := len(texts) - len(texts_shown):
        texts_shown.append(f"{more} more")
    return (
        ", ".join(texts_shown[:-1]) + " and " + texts_shown[-1]
        if len(texts_shown) > 1
        else texts_shown[0]
    )


def rows_of(runs: Sequence[Run]) -> dict[str, ComparedNumber]:
    """Collect the numbers of runs, by name, in the unit of the first run with the name.

    A number whose unit does not convert to that has a row of its own, `NAME (UNIT)`.
    """
    rows = {}
    for name in dict.fromkeys(n for run in runs for n in run.manifest.numbers):
        each = [run.manifest.numbers.get(name) for run in runs]
        units = list(dict.fromkeys(x.unit for x in each if x is not None))
        while units:
            unit = units[0]
            scales = {u: scale for u in units if (scale := _scale(u, unit)) is not None}
            units = [u for u in units if u not in scales]
            there = tuple(x is not None and x.unit in scales for x in each)
            title = next(x.title for x in each if x is not None and x.unit == unit)
            rows[f"{name} ({unit})" if name in rows else name] = ComparedNumber(
                title,
                unit,
                tuple(_value_in(x, scales) for x in each),
                there,
            )
    return rows


def _value_in(number: Value | None, scales: Mapping[str, float]) -> float | None:
    """Return a number by the scale of its unit; None where there is none."""
    if number is None or number.value is None or number.unit not in scales:
        return None
    return number.value * scales[number.unit]


def _scale(unit: str, other: str) -> float | None:
    """Return the factor from a unit to another one; None if they do not convert.

    Numbers without a dimension, as percentages, are not converted: what they are shares
    of may differ.
    """
    if unit == other:
        return 1.0
    first, second = known_unit(unit), known_unit(other)
    if first is None or second is None or first.rad != second.rad:
        return None
    factor_and_offset = conversion(first, second)
    if (
        factor_and_offset is None
        or factor_and_offset[1] != 0.0
        or not any((*first.dimension, first.rad))
    ):
        return None
    return factor_and_offset[0]


def write(comparison: Comparison, path: Path, **more: Any) -> Path:
    """Write the page: the table, and each plot of the first run over all runs.

    `more` is for the template. Raises OSError where it cannot be written.
    """
    overlaid = [
        (t, run.results, run.manifest.parameters)
        for t, run in zip(comparison.names, comparison.runs, strict=True)
    ]
    plots = comparison.runs[0].manifest.content.plots.values()
    figures = [
        (p.title, figure) for p in plots if (figure := series_figure(p, overlaid))
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    pairs = list(zip(comparison.names, comparison.runs, strict=True))
    return write_page(
        path,
        render(
            "compare.html",
            made=comparison,
            pairs=pairs,
            cases=find_cases(
                path.parent, [run.manifest.parameters for run in comparison.runs]
            ),
            **figures_of(figures),
            difference=difference_text(comparison),
            **{"choice": None, "pareto": (), **more},
        ),
    )


def paired_draws(
    targets: Sequence[str],
    count: int,
    seed: int,
    options: Options,
    jobs: int = 2,
    progress: bool = False,
) -> tuple[list[Pairs], list[Draws]]:
    """Run the same draws of several scenarios, and pair each with the first.

    Returns the pairs of each other scenario with the first, in the form of
    `pairs.compare`, and the draws of each as `draws` returns them.

    Raises
    ------
    DesatError
        If one draws nothing, another does not draw like the first, or a target is a run
        folder.
    """
    for target in targets:
        if is_run(target):
            raise DesatError(f"{target}: a run cannot be sampled; name its scenario")
    sources = [Cases(read(t)) for t in targets]
    shared = [
        common(sources[0], other, seed, options, options) for other in sources[1:]
    ]
    results = [draws(s, count, seed, options, jobs, progress) for s in sources]
    pairs = list[Pairs]()
    for target, other, names in zip(targets[1:], results[1:], shared, strict=True):
        first, second = (
            {r.number for r in x.rows if r.completed} for x in (results[0], other)
        )
        alone = {"drawn_only_in_it": targets[0], "drawn_only_in_the_other": target}
        warnings = [
            f"drawn in {owner} alone: {', '.join(names[key])}"
            for key, owner in alone.items()
            if names[key]
        ]
        numbers = differences(results[0], other)
        pairs.append(Pairs(targets[0], target, len(first & second), warnings, numbers))
    return pairs, results
