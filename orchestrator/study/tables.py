"""`desat tables FAMILY`: a paper's tables beside ours, computed by runs made now.

A scenario with `draws` gives the median of so many draws instead; these are read from the file that
`make papers` has stored (`stored.py`), or made now.
"""

from __future__ import annotations

from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..files.pack import pack_scenario
from ..files.scenario import Scenario, scenarios
from ..system.errors import DesatError
from .case import Options, execute
from .cells import Numbers, Row, rows_of
from .draws import pool_of
from .manifest import PACKAGES
from .meaning import words
from .paired import differences
from .plots import pretty_unit
from .report import number, render, write_page


def _numbers(path: str, options: Options) -> Numbers:
    run = execute(path, options).or_raise(path)
    values = {name: n["value"] for name, n in run.manifest["numbers"].items()}
    run.results.close()
    return values


def rows(
    family: str, options: Options, jobs: int = 2, drawn: dict[str, Any] | None = None
) -> list[Row]:
    """Pack and run every scenario of a family that a paper's table has a cell for.

    `drawn`: the draws of the scenarios that have some (`stored.read` or `stored.compute`).
    """
    given = {n: s for n, s in scenarios(family).items() if s.data.get("paper")}
    if wrong := [line for s in given.values() for line in words(s)]:
        raise DesatError("\n".join(dict.fromkeys(wrong)))
    if not given:
        raise DesatError(f"{family}: no scenario has paper values")
    kept = (drawn or {}).get("scenarios", {})
    summaries = {n: d["summary"] | _paired(given[n], kept) for n, d in kept.items() if n in given}
    if missing := [n for n, s in given.items() if s.data.get("draws") and n not in summaries]:
        raise DesatError(f"{missing[0]}: no draws; `desat tables {family} --fresh` makes them")
    values = {n: {k: d["median"] for k, d in summaries[n].items()} for n in given if n in summaries}
    values |= _single([s for n, s in given.items() if n not in values], options, jobs)
    # first what the paper has values for, then what is ours alone
    ranked = sorted(
        given.values(), key=lambda s: not any("values" in e for e in s.data["paper"].values())
    )
    made = [
        row for s in ranked
        for row in rows_of(s, values[s.name], values, summaries.get(s.name, {}))
    ]  # fmt: skip
    entries = (e for s in ranked for e in s.data["paper"].values())
    quantities = list(dict.fromkeys((e["table"], e["quantity"]) for e in entries))
    methods = list(dict.fromkeys(row.method for row in made))
    return sorted(
        made, key=lambda r: (quantities.index((r.table, r.quantity)), methods.index(r.method))
    )


def _paired(scenario: Scenario, drawn: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Of each number of form `difference`: the summary of the differences draw by draw."""
    found = {}
    for name, entry in scenario.data["numbers"].items():
        theirs = drawn.get(f"{scenario.family}/{entry.get('reference', '')}")
        if theirs is not None and entry["form"] == "difference":
            found[name] = differences(drawn[scenario.name], theirs)[entry["of"]]
    return found


def _single(given: list[Scenario], options: Options, jobs: int) -> dict[str, Numbers]:
    """The numbers of a run of each scenario, packed."""
    paths = [str(pack_scenario(s)) for s in given]
    with pool_of(jobs if paths else 1) as map_:
        results = map_(_numbers, paths, [options] * len(paths))
        return {s.name: numbers for s, numbers in zip(given, results, strict=True)}


def as_json(family: str, table: list[Row], drawn: dict[str, Any] | None = None) -> dict[str, Any]:
    """What `--json` prints; `drawn`: which run the draws are from (`stored.provenance`)."""
    data = {"family": family, "rows": [asdict(row) for row in table]}
    return data if drawn is None else {**data, "run": drawn}


def shown(row: Row) -> dict[str, str]:
    """A row as texts for people."""
    digits = 2 if row.unit in ("s", "%") else 3
    difference = ""
    if row.paper is not None:
        delta = row.ours - row.paper
        difference = _signed(delta, digits)
        if row.paper and row.unit == "s":
            difference += f" ({_signed(100 * delta / row.paper, 1)} %)"
    large = abs(row.ours) >= 1e5
    verdict = {True: "within", False: "OUTSIDE", None: ""}[row.within]
    return {
        "method": row.method,
        "case": row.case,
        "paper": "" if row.paper is None else f"{row.paper:.2f}",
        "ours": number(row.ours) if large else f"{row.ours:.{digits}f}",
        "difference": difference,
        "band": "" if row.band is None else f"{row.band[0]:.{digits}f} to {row.band[1]:.{digits}f}",
        "draws": "" if row.draws is None else _of_draws(row.draws, digits),
        "verdict": verdict,
        "mark": {"within": "ok", "OUTSIDE": "bad", "": ""}[verdict],
        "remark": row.remark,
    }


COLUMNS = ("method", "case", "paper", "ours", "difference", "draws", "band", "verdict", "remark")
NUMBERS = ("paper", "ours", "difference")


def columns(lines: list[dict[str, str]]) -> dict[str, str]:
    """The columns that have something to show in these rows, and their headings."""
    found = (c for c in COLUMNS if any(line[c] for line in lines))
    return {c: "" if c == "verdict" else c for c in found}


def _of_draws(draws: dict[str, Any], digits: int) -> str:
    text = f"{draws['min']:.{digits}f} to {draws['max']:.{digits}f} of {draws['n']}"
    if draws["band"]:
        text += f" (each: {draws['band'][0]:g} to {draws['band'][1]:g})"
    return text


def _signed(x: float, digits: int) -> str:
    return f"{round(x, digits) + 0.0:+.{digits}f}"  # + 0.0: no minus before a zero


def grouped(table: list[Row]) -> list[tuple[str, list[Row]]]:
    """(heading, rows) for each table and quantity."""
    groups: dict[str, list[Row]] = {}
    for row in table:
        unit = f" [{pretty_unit(row.unit)}]" if pretty_unit(row.unit) else ""
        place = f"Table {row.table}" if row.table[0].isdigit() else row.table
        heading = f"{place}: {row.quantity.replace('_', ' ')}{unit}"
        groups.setdefault(heading, []).append(row)
    return list(groups.items())


def origin(drawn: dict[str, Any]) -> str:
    """Where the numbers of draws are from, for people."""
    how = "just now" if drawn["file"] == "computed now" else f"on {drawn['date']} ({drawn['file']})"
    return f"computed {how} with seed {drawn['seed']} by {drawn['components_as']}"


def write_html(
    family: str, table: list[Row], path: Path, options: Options, drawn: dict[str, Any] | None = None
) -> Path:
    """The tables as a self-contained page."""
    from importlib.metadata import version

    pages = []
    for heading, group in grouped(table):
        lines = [shown(row) for row in group]
        pages.append((heading, lines, columns(lines)))
    banded = [r for r in table if r.within is not None]
    inside = sum(1 for r in banded if r.within)
    text = render(
        "tables.html",
        title=f"{family}: the paper's tables beside ours",
        lead=(
            f"{inside} of {len(banded)} cells with a band are within it. Every number of ours was "
            "computed by a run of the packed scenario when this page was written"
            + (f", medians of draws {origin(drawn)}." if drawn else ".")
        ),
        tables=pages,
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
