"""Compare a paper's tables with numbers of runs made now (`desat tables FAMILY`).

A scenario with samples gives their median instead; they are read from the file that
`make papers` has stored (`stored.py`), or computed now.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Unpack

from ..campaign.draws import rows_of as rows_of_runs
from ..campaign.pairs import each_draw
from ..campaign.spread import spreads
from ..files.identity import PACKAGES
from ..files.scenario import Scenario, abbreviations, find, scenarios
from ..numbers.text import number, spell_unit
from ..report.report import render, write_page
from ..runs.program import options_of
from ..runs.validation import content_problems
from ..system.errors import DesatError, Exit, RunError
from ..system.options import Options, RunOptions
from . import stored
from .comparison import Numbers, PaperCell, PaperSpread, Share, count, rows_of
from .stored import Provenance, StoredDraws, StoredScenario

LARGEST = sys.float_info.max  # open end of a band in JSON


def tables(
    family: str, *, jobs: int = 1, **options: Unpack[RunOptions]
) -> list[PaperCell]:
    """Run a family's scenarios and return the cells of its paper's tables.

    Each cell has the paper's value, ours, the unit and the band. Medians of samples are
    the stored ones.

    Parameters
    ----------
    family
        Name of the family.
    jobs
        Number of processes, as for `draws`.
    **options
        Fields of `desat.Options`.

    Raises
    ------
    DesatError
        If the family is unknown.
    RunError
        If a run does not complete.
    """
    draws = stored.read(family) if stored.with_draws(family) else None
    return rows(family, options_of(None, None, None, options), jobs, draws)


def rows(
    family: str, options: Options, jobs: int = 2, samples: StoredDraws | None = None
) -> list[PaperCell]:
    """Run every scenario of a family that a paper's table has a cell for.

    `drawn` are the samples of the scenarios that have some (from `stored.read` or
    `stored.compute`). Rows of scenarios that are not among them are left out;
    `stored.outdated` names these.
    """
    with_entries = {n: s for n, s in scenarios(family).items() if s.content.entries}
    if wrong := [
        f"{s.place(path)}: {text}"
        for s in with_entries.values()
        for path, text in content_problems(s.content, None)
    ]:
        raise DesatError("\n".join(dict.fromkeys(wrong)))
    if not with_entries:
        raise DesatError(f"{family}: no scenario has paper values")
    there = samples["scenarios"] if samples else {}
    pairs = {
        n: _pairs_of(s, there)
        for n, s in with_entries.items()
        if s.content.samples and n in there
    }
    with_entries = {
        n: s for n, s in with_entries.items() if not s.content.samples or n in pairs
    }
    if not with_entries:
        raise DesatError(
            f"{family}: no samples; `desat tables {family} --fresh` makes them"
        )
    values: dict[str, Numbers] = {
        n: {k: d.levels["median"] for k, d in pairs[n]["summary"].items()}
        for n in pairs
    }
    alone = {**with_entries, **_references(with_entries.values())}
    values |= _single([s for n, s in alone.items() if n not in values], options, jobs)
    # values that the paper gives come before those that it lacks
    ranked = sorted(
        with_entries.values(),
        key=lambda s: not any(e.values is not None for e in s.content.paper.values()),
    )
    table = [
        row
        for s in ranked
        for row in rows_of(s, values[s.name], values, pairs.get(s.name))
    ]
    entries = (e for s in ranked for e in s.content.paper.values())
    quantities = list(dict.fromkeys((e.table, e.quantity) for e in entries))
    methods = list(dict.fromkeys(row.method for row in table))
    return sorted(
        table,
        key=lambda r: (
            quantities.index((r.table, r.quantity)),
            methods.index(r.method),
        ),
    )


def _references(scenarios_compared: Iterable[Scenario]) -> dict[str, Scenario]:
    """Return the scenarios without samples that numbers of these are compared with."""
    names = {
        f"{s.family}/{number.reference}"
        for s in scenarios_compared
        for number in s.content.numbers.values()
        if number.reference
    }
    named = {name: find(name) for name in sorted(names)}
    return {n: s for n, s in named.items() if not s.content.samples}


def _pairs_of(
    scenario: Scenario, drawn: Mapping[str, StoredScenario]
) -> StoredScenario:
    """Add paired numbers and their summaries to the stored samples of a scenario.

    Paired numbers are those of form `difference` or `paired_ratio`, computed sample by
    sample.
    """
    samples = drawn[scenario.name]
    summary, draws = (
        dict(samples["summary"]),
        [dict(row.numbers) for row in samples["draws"]],
    )
    for name, entry in scenario.content.numbers.items():
        theirs = drawn.get(f"{scenario.family}/{entry.reference}")
        if theirs is None or entry.form not in ("difference", "paired_ratio"):
            continue
        paired = entry.form == "paired_ratio"
        each = each_draw(samples["draws"], theirs["draws"], entry.of, paired)
        for row, numbers in zip(samples["draws"], draws, strict=True):
            if row.number in each:
                numbers[name] = each[row.number]
        summary |= spreads(
            draws, {name: "1" if paired else samples["units"][entry.of]}, ()
        )
    rows = [
        replace(row, numbers=x) for row, x in zip(samples["draws"], draws, strict=True)
    ]
    return {**samples, "summary": summary, "draws": rows}


def _single(
    selected: list[Scenario], options: Options, jobs: int
) -> dict[str, Numbers]:
    """Run each scenario once and return its numbers.

    Little more is recorded than these need. Raises RunError for a run that does not
    complete.
    """
    results = rows_of_runs(
        [(s.name, options, 0, None) for s in selected], jobs, "runs", progress=False
    )
    for scenario, row in zip(selected, results, strict=True):
        if not row.completed:
            raise RunError(
                f"{scenario.name}: {row.status}: {row.message}", Exit(row.code)
            )
    return {s.name: dict(row.numbers) for s, row in zip(selected, results, strict=True)}


def as_json(
    family: str, table: list[PaperCell], samples: Provenance | None = None
) -> Mapping[str, Any]:
    """Return the data that `--json` prints.

    JSON has no infinity: an open end of a band is the largest number, and a time that
    is not reached is null. `drawn` is the run that the samples come from
    (`stored.provenance`).
    """
    entries = [
        asdict(replace(row, ours=None) if row.ours == math.inf else row)
        for row in table
    ]
    for banded in (*entries, *(row["draws"] for row in entries if row["draws"])):
        if banded.get("band"):
            banded["band"] = [min(max(x, -LARGEST), LARGEST) for x in banded["band"]]
    data = {"family": family, "count": count(table), "rows": entries}
    return data if samples is None else {**data, "run": samples}


def texts_of(row: PaperCell) -> dict[str, str]:
    """Format a row for the reader."""
    digits = 2 if row.unit in ("s", "%") else 3
    difference = ""
    if row.paper is not None and row.ours is not None and row.ours != math.inf:
        delta = row.ours - row.paper
        difference = _signed(delta, digits)
        if row.paper and row.unit == "s":
            difference += f" ({_signed(100 * delta / row.paper, 1)} %)"
    verdict = {True: "within", False: "outside", None: ""}[row.within]
    mark = {"within": "ok", "outside": "bad", "": ""}[verdict]
    if row.ours is None:
        verdict = "not judged"
    if row.paper_within is False:
        verdict += "; paper outside"
    kind = (
        "tuned" if row.tuned else "out of sample" if row.out_of_sample else "in sample"
    )
    return {
        "method": row.method,
        "case": row.case,
        "paper": ""
        if row.paper is None
        else _value(row.paper, _of_paper(row.paper), row.flag),
        "ours": "" if row.ours is None else _value(row.ours, digits, row.flag),
        "difference": "" if row.flag else difference,
        "band": "" if row.band is None else _band(row, digits),
        "draws": "" if row.draws is None else _of_draws(row.draws, digits, row.flag),
        "verdict": verdict,
        "mark": mark,
        "sample": kind if row.paper is not None and row.ours is not None else "",
        "definition": row.definition,
        "remark": row.remark,
    }


COLUMNS = (
    "method",
    "case",
    "paper",
    "ours",
    "difference",
    "draws",
    "band",
    "verdict",
    "sample",
    "remark",
)
NUMBERS = ("paper", "ours", "difference")


def columns(lines: list[dict[str, str]]) -> dict[str, str]:
    """Return the columns that are not empty in these rows, with their headings."""
    filled = (c for c in COLUMNS if any(line[c] for line in lines))
    named = {"verdict": "", "draws": "samples"}
    return {c: named.get(c, c) for c in filled}


def _of_paper(value: float) -> int:
    """Return the digits of a paper's value: two, unless that would show it as 0."""
    return 3 if 0.0 < abs(value) < 0.005 else 2


def _value(value: float | None, digits: int, flag: bool = False) -> str:
    """Format a value, or yes and no for a flag."""
    if value is None or value == math.inf:
        return number(None)
    if flag and value in (0.0, 1.0):
        return "yes" if value else "no"
    return number(value) if abs(value) >= 1e5 else f"{value:.{digits}f}"


def _band(row: PaperCell, digits: int) -> str:
    """Format the band of a row."""
    assert row.band is not None
    return _within(row.band, lambda x: _value(x, digits, row.flag))


def _within(band: Sequence[float], text: Callable[[float], str]) -> str:
    """Format a band in words; one that is open at an end has one bound."""
    (low, high), (least, most) = band, map(text, band)
    if math.isinf(low):
        return f"at most {most}"
    if math.isinf(high):
        return f"at least {least}"
    return least if least == most else f"{least} to {most}"


def _of_draws(draws: PaperSpread | Share, digits: int, flag: bool = False) -> str:
    """Format the spread or the share of samples."""
    if isinstance(draws, Share):
        low, high = draws.interval
        share = f"{100.0 * draws.count / draws.n:.0f} %"
        return f"{draws.count} of {draws.n} ({share}, 95 % interval {low:.0f} to {high:.0f} %)"
    if flag and draws.min == draws.max:
        return f"{_value(draws.min, 0, flag)} in all {draws.n}"
    least, most = (_value(x, digits) for x in (draws.min, draws.max))
    missing, count = draws.not_reached, draws.n + draws.not_reached
    text = f"{least} to {most} of {count}" if draws.n else f"of {count}"
    text += f", not reached by {missing}" if missing else ""
    if draws.band:
        text += f" (each: {_within(draws.band, '{:g}'.format)})"
    return text


def _signed(x: float, digits: int) -> str:
    """Format a number with its sign."""
    return f"{round(x, digits) + 0.0:+.{digits}f}"  # + 0.0: no minus before a zero


def groups(table: list[PaperCell]) -> list[tuple[str, list[PaperCell]]]:
    """Group rows by table and quantity; return (heading, rows) for each."""
    groups: dict[str, list[PaperCell]] = {}
    for row in table:
        unit = f" [{spell_unit(row.unit)}]" if spell_unit(row.unit) else ""
        place = f"Table {row.table}" if row.table[0].isdigit() else row.table
        heading = f"{place}: {row.heading}{unit}"
        groups.setdefault(heading, []).append(row)
    return list(groups.items())


def definitions(entries: Iterable[str]) -> list[str]:
    """Return what the rows of a heading measure, each sentence once.

    Sentences that differ only in the scenario that they compare with are joined.
    """
    texts = dict.fromkeys(text for text in entries if text)
    others: dict[str, list[str]] = {}
    for text in texts:
        compared = re.fullmatch(r"(.* to that of )(\S+)\)", text)
        if compared:
            others.setdefault(compared[1], []).append(compared[2])
        else:
            others[text] = []
    return [
        f"{text}{', '.join(names)}{', row by row' * (len(names) > 1)})"
        if names
        else text
        for text, names in others.items()
    ]


def summed_up(table: list[PaperCell]) -> str:
    """Summarise how many cells lie within their bands, and how independent they are."""
    n = count(table)
    lacking = (
        f" {n['not_judged']} rows cannot be tested by simulation; each gives the reason."
        if n["not_judged"]
        else ""
    )
    return (
        f"Of {n['banded']} values with a band, {n['within']} lie within it. {n['out_of_sample']} "
        "of them are out of sample, independent of our tuning: "
        f"{n['out_of_sample_within']} of these lie within. {n['tuned']} were tuned to the paper, "
        f"{n['in_sample']} had a part in a choice of ours or repeat another value, and "
        f"{n['without_paper']} have no value in the paper. The paper's own value lies outside the "
        f"band in {n['paper_outside']}.{lacking}"
    )


def spelt(family: str, table: list[PaperCell]) -> str:
    """Return the abbreviations in the tables of a family with their meaning."""
    texts = (
        x for row in table for x in (row.method, row.case, row.heading, row.remark)
    )
    return abbreviations(family, " ".join(texts))


def origin(samples: Provenance) -> str:
    """Describe where the numbers of samples come from."""
    origin_of_samples = (
        "just now"
        if samples["file"] == "computed now"
        else f"on {samples['date']} ({samples['file']})"
    )
    return f"computed {origin_of_samples} with seed {samples['seed']} by {samples['components_as']}"


def write_html(
    family: str,
    table: list[PaperCell],
    path: Path,
    options: Options,
    samples: Provenance | None = None,
) -> Path:
    """Write the tables as a self-contained page and return its path."""
    from importlib.metadata import version

    pages = []
    for heading, group in groups(table):
        lines = [texts_of(row) for row in group]
        sentences = definitions(row.definition for row in group)
        pages.append((heading, sentences, lines, columns(lines)))
    text = render(
        "tables.html",
        title=f"{family}: the paper's tables beside ours",
        lead=(
            f"{summed_up(table)} Every number of ours was computed by a run of the scenario when "
            "this page was written"
            + (f", medians of samples {origin(samples)}." if samples else ".")
        ),
        tables=pages,
        spelt=spelt(family, table),
        numbers=NUMBERS,
        provenance=(
            f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC; {options.algorithm}; "
            + ("bare blocks" if options.blocks else "FMUs")
            + "; "
            + ", ".join(f"{p} {version(p)}" for p in PACKAGES)
        ),
    )
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_page(path, text)
