"""Write the report of a campaign: percentiles, judged requirements, drivers."""

from __future__ import annotations

import json
import math
import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from markupsafe import Markup
from numpy.typing import NDArray

from ..figures.canvas import INCH, Axes, Figure
from ..figures.plots import scattered
from ..figures.style import (
    COLOURS,
    DASHED,
    DOTTED,
    LIMIT,
    axis_label,
    figure,
    time_axis,
)
from ..files.identity import COMPUTING
from ..language.content import content_of, dispersions_of
from ..language.scenario import Plot
from ..numbers.limits import limits_of
from ..numbers.numbers import late
from ..numbers.text import number as shown
from ..numbers.text import short_title, spell_unit
from ..report.cases import CraftCases, find_cases
from ..report.report import data_element, figures_of, render, write_page
from ..report.table import ROW_UNIT, Column, Row, Table, or_not_reached
from ..runs.manifest import write_json
from ..runs.prepare import prepare, resolved
from ..system.errors import DesatError
from ..system.model import table as parameters_of
from ..system.typed import JsonObject
from . import store
from .case import POINTS
from .judged import CaseVerdict, requirement, rerun
from .plan import CampaignPlan, cases_of, changed, read, system
from .sampling import axes, describe_parameter, sensitivity, unit_cube
from .spread import Spread, to_json


@dataclass(frozen=True)
class VersionSet:
    """Number of cases that were made with some versions.

    The text names the versions that are not the same for all cases.
    """

    cases: int
    versions: dict[str, str]
    text: str


@dataclass(frozen=True)
class Driver:
    """Rank correlation of a number with a drawn parameter."""

    input: str
    number: str
    n: int
    correlation: float


@dataclass(frozen=True)
class CampaignSummary:
    """Content of a campaign's report."""

    target: str
    seed: int
    sampling: str
    count: int
    done: int
    completed: int
    failed: Sequence[store.CaseRow]
    changed: str
    versions: Sequence[VersionSet]
    seconds: float
    digest: str
    numbers: Mapping[str, Spread]
    unmet: Sequence[str]
    requirements: Mapping[str, CaseVerdict]
    drivers: Sequence[Driver]
    sobol: Mapping[str, Any] | None
    folder: Path

    @property
    def holds(self) -> bool:
        """Return whether every requirement is shown to be met."""
        verdicts = self.requirements.values()
        return bool(verdicts) and all(v.met for v in verdicts)

    @property
    def answer(self) -> str:
        """Return the sentence that says what the cases show."""
        if not self.requirements:
            return f"{self.completed} of {self.count} cases completed; nothing is required of them"
        name, worst = min(
            self.requirements.items(),
            key=lambda entry: (
                entry[1].met,
                entry[1].shown_within / entry[1].requirement.probability,
            ),
        )
        spread = self.numbers.get(worst.requirement.number)
        title = short_title((spread.title if spread else "") or name)
        share = (
            f"{title}: {worst.outside} of {worst.n} cases are outside, so {worst.shown_within:.3g} % "
            f"or more are within; {100.0 * worst.requirement.probability:g} % are asked, with a "
            f"confidence of {100.0 * worst.requirement.confidence:g} %"
        )
        if self.holds:
            return f"Shown to hold; the least certain is {share}"
        return f"Not shown to hold; {share}"

    def to_json(self) -> JsonObject:
        """Return the content of report.json."""
        failed = [
            {
                "case": row.case,
                "code": row.code,
                "message": row.message,
                "command": rerun(self.folder, row.case),
            }
            for row in self.failed
        ]
        entry = {
            **vars(self),
            "failed": failed,
            "versions": [vars(x) for x in self.versions],
            "numbers": to_json(self.numbers),
            "requirements": {
                name: x.to_json() for name, x in self.requirements.items()
            },
            "drivers": [vars(x) for x in self.drivers],
        }
        del entry["folder"]
        return entry


STRONG = 0.2  # rank correlations from this size on are shown
FEWEST = 10  # cases from which a correlation is computed
CHANCE = 0.01  # probability that one of all those shown is due to chance alone
# Groups of cases from which on Sobol indices are reported. For fewer, the intervals of
# SALib, which are made of the same cases, mean nothing.
BASE = 64
_WORST, _SCATTERS = 3, 4
# Largest number of bars of a histogram, and of named cases of a bar.
_BARS, _NAMED = 40, 12
_NEVER = 1e300
LEVELS = (5.0, 50.0, 95.0, 99.0)  # %


def summary(folder: Path) -> CampaignSummary:
    """Compute the content of the report; raise DesatError where there is no case."""
    plan = read(folder)
    about = content_of(system(plan).about)
    table, descriptions = store.read(folder), store.described(folder)
    completed = _completed_cases(table)
    cases = np.array(table["case"].to_pylist())
    out = {n[4:]: flat(table[n]) for n in table.column_names if n.startswith("out.")}
    first = [name for name in about.numbers if name in out]
    out = {name: out[name] for name in dict.fromkeys([*first, *out])}
    inputs = {
        n[3:]: flat(table[n])
        for n in table.column_names
        if n.startswith("in.") and not n.endswith(".seed") and _is_number(table[n])
    }
    times = late(about)
    numbers = {
        name: _number(
            name,
            descriptions.get(name, {}),
            values[completed],
            cases[completed],
            name in times,
        )
        for name, values in out.items()
    }
    failed_rows = [
        store.CaseRow(row["status"], row["code"], row["message"], number=row["case"])
        for row in table.filter(~completed).to_pylist()
    ]
    if missing := [n for n in out if n not in descriptions]:
        raise DesatError(f"{folder / store.NUMBERS}: damaged: it lacks {missing[0]}")
    unmet = [
        f"case {int(c)}: {line}"
        for c, lines in zip(cases, table["unmet"].to_pylist(), strict=True)
        for line in lines or ()
    ]
    apart = _apart(plan, cases)
    each = {n: v[apart] for n, v in out.items()}
    verdicts = {}
    for name, entry in about.requirements.items():
        unit = descriptions.get(entry.number, {}).get("unit", "")
        verdicts[name] = requirement(
            entry, each, completed[apart], cases[apart], folder, unit
        )
    return CampaignSummary(
        target=plan.target,
        seed=plan.seed,
        sampling=plan.sampling,
        count=plan.count,
        done=len(cases),
        completed=int(completed.sum()),
        failed=failed_rows,
        changed=changed(plan),
        versions=_versions(table["versions"].to_pylist()),
        seconds=float(np.nansum(flat(table["seconds"]))),
        digest=store.digest(folder),
        numbers=numbers,
        unmet=unmet,
        requirements=verdicts,
        drivers=_drivers(
            {n: v[completed & apart] for n, v in inputs.items()},
            {n: v[completed & apart] for n, v in out.items()},
        ),
        sobol=_sobol(plan, cases, completed, out),
        folder=folder,
    )


def _versions(rows: Sequence[str]) -> list[VersionSet]:
    """Collect the sets of versions that cases were made with."""
    sets = [(json.loads(text), n) for text, n in sorted(Counter(rows).items())]
    various = [n for n in COMPUTING if len({one.get(n) for one, _ in sets}) > 1]
    lines = []
    for one, n in sets:
        text = (
            f"{n} with {', '.join(f'{k} {one.get(k)}' for k in various)}"
            if various
            else ""
        )
        lines.append(VersionSet(n, one, text))
    return lines


def _apart(plan: CampaignPlan, cases: Any) -> Any:
    """Select the cases that share no value with another, for intervals and tests.

    These are all cases, except with saltelli sampling. There each point stands for
    itself first and last among the cases that mix it with the next
    (`sampling.saltelli`).
    """
    if plan.sampling != "saltelli":
        return np.ones(len(cases), bool)
    width = sum(axes(system(plan))[1]) + 2
    return np.isin(cases % width, (0, width - 1))


def _is_number(column: Any) -> bool:
    """Return whether a column holds numbers, by its first 50 rows."""
    return all(
        isinstance(v, (int, float)) or v is None
        for v in column.slice(0, 50).to_pylist()
    )


def _number(
    name: str, entry: Mapping[str, str], values: Any, cases: Any, is_late: bool = False
) -> Spread:
    """Compute the spread of a number over all completed cases that have it.

    For a time all completed cases count, and those that do not reach it rank last.
    """
    there = np.isfinite(values)
    spread = Spread(
        title=entry.get("title", name),
        unit=entry.get("unit", ""),
        n=int(there.sum()),
        not_reached=int(np.isnan(values).sum()),
        infinite=int(np.isinf(values).sum()),
    )
    if not there.any():
        return spread
    last = values[there].max()
    counted = np.isfinite(values) | (np.isnan(values) if is_late else False)
    # replace nan by a number that marks any percentile interpolated with it
    values, cases = np.nan_to_num(values[counted], nan=_NEVER), cases[counted]
    ends = {"min": int(np.argmin(values)), "max": int(np.argmax(values))}
    names = ("p5", "median", "p95", "p99", *ends)
    levels = [*np.percentile(values, LEVELS), *(values[i] for i in ends.values())]
    return replace(
        spread,
        percentiles={
            key: float(x) if x <= last else None
            for key, x in zip(names, levels, strict=True)
        },
        cases={f"{key}_case": int(cases[i]) for key, i in ends.items()},
    )


def _drivers(inputs: Mapping[str, Array], out: Mapping[str, Array]) -> list[Driver]:
    """Compute strong rank correlations (Spearman), strongest first.

    They are between inputs and numbers. Among some hundred pairs several would exceed a
    level meant for one pair, so `CHANCE` is shared by all. That of one pair follows
    from Student's t with n - 2 degrees of freedom.
    """
    from pandas import DataFrame  # type: ignore[import-untyped]
    from scipy.special import stdtr  # scipy.stats takes half a second to import

    drivers = []
    level = CHANCE / max(len(inputs) * len(out), 1)
    table = DataFrame({**inputs, **out}).astype(float)
    table = table.where(np.isfinite(table))
    correlations = table.corr("spearman", min_periods=FEWEST)
    for number in out:
        for name in inputs:
            n = int((table[name].notna() & table[number].notna()).sum())
            correlation = float(correlations.loc[name, number])
            if not abs(correlation) >= STRONG:  # nan where one of them is constant
                continue
            rest = 1.0 - correlation**2
            t = math.sqrt((n - 2) / rest) * correlation if rest > 0.0 else math.inf
            if 2.0 * stdtr(n - 2, -abs(t)) < level:
                drivers.append(Driver(name, number, n, correlation))
    return sorted(drivers, key=lambda d: (-abs(d.correlation), d.input, d.number))


def _sobol(
    plan: CampaignPlan, cases: Any, completed: Any, out: Mapping[str, Array]
) -> Mapping[str, Any] | None:
    """Compute Sobol indices of first and total order.

    None where the cases were not sampled for them; a reason where cases are missing or
    too few.
    """
    if plan.sampling != "saltelli":
        return None
    if len(cases) != plan.count or not completed.all():
        return {"missing": "they need every case completed"}
    drafted = system(plan)
    names, sizes = axes(drafted)
    if plan.count < (least := BASE * (sum(sizes) + 2)):
        return {"missing": f"they need -n {least} or more"}
    dispersions = dispersions_of(drafted)
    # in a direction each random number affects all elements
    form = {
        n: "{}, random number {}"
        if dispersions[n].kind in ("attitude", "direction")
        else "{}[{}]"
        for n in names
    }
    elements = [
        n if k == 1 else form[n].format(n, i)
        for n, k in zip(names, sizes, strict=True)
        for i in range(1, k + 1)
    ]
    analyze = sensitivity("analyze")
    indices = {}
    for number, y in out.items():
        if np.isfinite(y).all() and np.ptp(y) > 0.0:
            with (
                warnings.catch_warnings()
            ):  # numbers that hardly differ; their interval shows it
                warnings.simplefilter("ignore")
                cube = unit_cube(len(elements))
                sensitivities = analyze(
                    cube, y, calc_second_order=False, seed=plan.seed
                )
            indices[number] = {
                name: {
                    "first": float(sensitivities["S1"][i]),
                    "first_conf": float(sensitivities["S1_conf"][i]),
                    "total": float(sensitivities["ST"][i]),
                    "total_conf": float(sensitivities["ST_conf"][i]),
                }
                for i, name in enumerate(elements)
            }
    return indices


TERMINAL_COLUMNS = (
    0,
    2,
    1,
    3,
    5,
    6,
    7,
    8,
)  # without the 99th percentile, to keep lines short


def tabulate_numbers(numbers: Mapping[str, Spread]) -> Table:
    """Tabulate the spread of each number over the cases."""
    columns = [
        Column("number", kind="text"),
        Column("5 %", ROW_UNIT, is_detail=True),
        Column("median", ROW_UNIT),
        Column("95 %", ROW_UNIT, is_detail=True),
        Column("99 %", ROW_UNIT, is_detail=True),
        Column("min", ROW_UNIT),
        Column("max", ROW_UNIT),
        Column("unit", kind="unit"),
        Column("not reached"),
    ]
    rows: list[Row] = []
    names = ("p5", "median", "p95", "p99", "min", "max")
    for spread in numbers.values():
        levels = (or_not_reached(spread.percentiles.get(name)) for name in names)
        rows.append((spread.title, *levels, spread.unit, spread.not_reached_text))
    return Table("", columns, rows)


def write(folder: Path) -> tuple[Path, CampaignSummary]:
    """Write report.html and report.json of a campaign.

    Returns the path of the page and the content.
    """
    plan, summarised = read(folder), summary(folder)
    entry = summarised.to_json()
    write_json(folder / "report.json", entry)
    numbers = tabulate_numbers(summarised.numbers)
    figures = _figures(folder, plan, summarised)
    text = render(
        "campaign.html",
        told=entry,
        answer=summarised.answer,
        holds=summarised.holds,
        cases=_cases(folder, plan),
        plan=plan,
        title=f"{_name_of(plan, summarised)}: campaign of {summarised.count} cases",
        **figures_of([(f.caption, f.figure) for f in figures]),
        commands=[f.commands for f in figures],
        small=(small := _histograms(folder, summarised, numbers)),
        data=data_element(
            {
                "command": rerun(folder, "").rstrip(),
                "histograms": [
                    {"edges": s.edges, "cases": s.cases, "counts": s.counts}
                    for s in small
                ],
            }
        ),
        number=shown,
        unit=spell_unit,
        numbers=numbers,
        kept=sorted(p.name for p in (folder / "kept").glob("*")),
    )
    return write_page(folder / "report.html", text), summarised


def _cases(folder: Path, plan: CampaignPlan) -> list[CraftCases]:
    """Return the cases of the craft's sizing, if one is beside the campaign."""
    try:
        craft, _ = resolved(plan.target, plan.options)
    except DesatError:
        return []
    return find_cases(folder.parent, [craft.parameters])


def _name_of(plan: CampaignPlan, summarised: CampaignSummary) -> str:
    """Return the title of a campaign's scenario; its name where that is gone."""
    try:
        title = content_of(system(plan).about).title
    except DesatError:
        title = ""
    return title or Path(summarised.target).name.removesuffix(".toml")


class _PageFigure(NamedTuple):
    """Figure of the report, with the commands of the cases that it names."""

    caption: str
    figure: Figure
    commands: Sequence[str] = ()


def _figures(
    folder: Path, plan: CampaignPlan, summarised: CampaignSummary
) -> list[_PageFigure]:
    """Draw the curves of a campaign, and its strongest drivers as scatter plots."""
    figures = [*_curves(folder, plan)]
    table = store.read(folder)
    good = _completed_cases(table)
    strongest = {d.number: d for d in reversed(summarised.drivers)}  # by number
    for driver in sorted(strongest.values(), key=lambda d: -abs(d.correlation))[
        :_SCATTERS
    ]:
        x = flat(table[f"in.{driver.input}"])[good]
        y = flat(table[f"out.{driver.number}"])[good]
        spread = summarised.numbers[driver.number]
        caption = f"{spread.title} over {driver.input}, rank correlation {driver.correlation:.2f}"
        label = axis_label(short_title(spread.title or ""), spread.unit or "", 2.4)
        below = axis_label(*describe_parameter(system(plan), driver.input), 6.0)
        figures.append(
            _PageFigure(caption, scattered({"": (x, y)}, below, label, size=2.0))
        )
    return figures


class _Small(NamedTuple):
    """Small histogram, one of many.

    It has the edges of its bars as shares of its width, and the numbers of the first
    few cases of each bar.
    """

    title: str
    image: Markup
    limits: str
    edges: Sequence[float]
    counts: Sequence[int]
    cases: Sequence[Sequence[int]]


def _histograms(
    folder: Path, summarised: CampaignSummary, shown_numbers: Table
) -> list[_Small]:
    """Draw a histogram of each number that differs between cases, judged ones first.

    Units are those of the table of the numbers.
    """
    limits: dict[str, list[tuple[str, float]]] = {}
    for verdict in summarised.requirements.values():
        entry = verdict.requirement
        extremes = [("at most", entry.max), ("at least", entry.min)]
        limit_lines = limits.setdefault(entry.number, [])
        limit_lines += [
            (label, value) for label, value in extremes if value is not None
        ]
    table, figures = store.read(folder), []
    good = _completed_cases(table)
    numbers = np.array(table["case"].to_pylist())[good]
    for name in sorted(summarised.numbers, key=lambda name: name not in limits):
        spread = summarised.numbers[name]
        unit, factor = shown_numbers.scale(spread.unit or "")
        values = factor * flat(table[f"out.{name}"])[good]
        there = np.isfinite(values)
        cases, values = numbers[there], values[there]
        if not len(values) or np.ptp(values) <= 1e-9 * np.abs(values).max():
            continue
        lines = [(label, factor * value) for label, value in limits.get(name, [])]
        count, edges = np.histogram(
            values, min(_BARS, max(8, int(np.sqrt(len(values)))))
        )
        near = [value for _, value in lines if _is_near(value, edges)]
        fig, ax = histogram(short_title(spread.title or name), unit, count, edges, near)
        bar = np.clip(np.searchsorted(edges, values, "right") - 1, 0, len(count) - 1)
        figures.append(
            _Small(
                spread.title or "",
                Markup(fig.svg()),
                "; ".join(
                    f"{label} {shown(x)} {spell_unit(unit)}"
                    + ("" if _is_near(x, edges) else " (beyond the figure)")
                    for label, x in lines
                ),
                [round(float(x), 4) for x in ax.across(edges) / (INCH * fig.width)],
                count.tolist(),
                [sorted(cases[bar == k].tolist())[:_NAMED] for k in range(len(count))],
            )
        )
    return figures


def _is_near(limit: float, edges: Array) -> bool:
    """Return whether a limit has room beside a distribution without squeezing it."""
    span = float(edges[-1] - edges[0])
    return bool(edges[0] - 2.0 * span <= limit <= edges[-1] + 2.0 * span)


def _limits(plan: CampaignPlan, plot: Plot, unit: str) -> list[tuple[str, float]]:
    """Return the limit lines of a plot that are the same in all cases, each size once.

    Empty for a system that is not available any more.
    """
    options = plan.options
    try:
        checked, _ = prepare(cases_of(plan).scenario, options).or_raise()
    except DesatError:
        return []
    dispersed_names = dispersions_of(system(plan)).keys()
    same = [
        x for x in plot.limits if not any(name in str(x) for name in dispersed_names)
    ]
    limits = limits_of(same, parameters_of(checked.components.values()), unit)
    return list({abs(value): (name, abs(value)) for name, value, _ in limits}.values())


def _curves(folder: Path, plan: CampaignPlan) -> list[_PageFigure]:
    """Draw the percentiles of the envelopes that the cases keep."""
    drafted = system(plan)
    plots, descriptions = content_of(drafted.about).plots, store.described(folder)
    table = store.read(folder, store.CURVES)
    figures = []
    options = plan.options
    start = drafted.start or 0.0
    stop = drafted.stop or 0.0 if isinstance(options.stop, str | None) else options.stop
    times = start + (np.arange(POINTS) + 0.5) / POINTS * (stop - start)
    for name in plan.curves:
        if name not in table.column_names:
            continue
        rows = [row for row in table.select(["case", name]).to_pylist() if row[name]]
        curves = np.array([row[name] for row in rows], dtype=float)
        largest = np.nanmax(np.where(np.isfinite(curves), curves, -np.inf), axis=1)
        order = sorted(range(len(rows)), key=lambda i: (-largest[i], rows[i]["case"]))[
            :_WORST
        ]
        plot = plots[name]
        unit = descriptions.get(f"curve.{name}", {}).get("unit", "")
        title = "largest size"
        caption = (
            f"{plot.title}: largest size of any line in each of {POINTS} parts of the run, "
            f"percentiles over {len(rows)} cases"
        )
        worst = [(rows[i]["case"], curves[i]) for i in order]
        figure = percentiles(
            title, unit, times, curves, worst, _limits(plan, plot, unit)
        )
        figures.append(
            _PageFigure(caption, figure, [rerun(folder, case) for case, _ in worst])
        )
    return figures


# --- Figures of a campaign ------------------------------------------------------------


Array = NDArray[np.float64]


def percentiles(
    title: str,
    unit: str,
    times: Array,
    curves: Array,
    worst: Sequence[tuple[int, Array]],
    limits: Sequence[tuple[str, float]] = (),
) -> Figure:
    """Draw percentile curves of envelopes (cases, parts) at times (parts,).

    The figure also has their extremes, the worst cases by name, and limits by name.
    """
    fig, ax = figure(3.3)
    scale, time_unit = time_axis(times)
    x = times / scale
    has_values = np.isfinite(curves).any(axis=0)
    bands = np.full((len(LEVELS) + 2, len(times)), np.nan)
    bands[:, has_values] = np.nanpercentile(
        curves[:, has_values], (0.0, *LEVELS, 100.0), axis=0
    )
    low, p5, p50, p95, p99, high = bands
    ax.area(x, low, high, COLOURS[0], alpha=0.12, label="all cases")
    ax.area(x, p5, p95, COLOURS[0], alpha=0.28, label="5 to 95 %")
    ax.plot(x, p50, COLOURS[0], width=1.5, label="median")
    ax.plot(x, p99, COLOURS[4], label="99 %")
    for i, (case, line) in enumerate(worst):
        ax.plot(
            x,
            line,
            COLOURS[1 + 2 * (i % 2)],
            width=0.8,
            dash=((), DASHED, DOTTED)[i % 3],
            label=f"case {case}",
        )
    for i, (name, value) in enumerate(limits):
        ax.level(
            value,
            LIMIT,
            width=1.2,
            dash=(DASHED, (2.0, 2.0), (6.0, 2.0, 1.0, 2.0))[i % 3],
            label=name,
        )
    ax.x.label, ax.y.label = f"time [{time_unit}]", axis_label(title, unit, 2.4)
    ax.y.low = 0.0
    ax.x.seconds = scale
    return fig


def histogram(
    title: str, unit: str, count: Any, edges: Array, limits: Sequence[float]
) -> tuple[Figure, Axes]:
    """Draw a small histogram of a number, and return it with its axes.

    It shows cases (n,) between edges (n + 1,), with the limits of requirements.
    """
    fig = Figure(3.4, 2.0)
    ax = fig.add(left=0.15, right=0.04, top=0.07, bottom=0.27)
    ax.bars(edges[:-1], edges[1:], count, COLOURS[0], alpha=0.7)
    for value in limits:
        ax.upright(value, LIMIT, width=1.2, dash=DASHED)
    ax.x.label, ax.y.label = axis_label(title, unit, 3.0), "cases"
    ax.x.most, ax.y.most, ax.y.low = 5, 5, 0.0
    return fig, ax


def flat(column: pa.ChunkedArray) -> Array:
    """Convert a column to floats, nan where it is empty."""
    return np.array(column.to_pylist(), dtype=float)


def _completed_cases(table: pa.Table) -> Any:
    """Return which cases completed, as a mask."""
    return np.array([status == "completed" for status in table["status"].to_pylist()])
