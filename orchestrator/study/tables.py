"""`desat tables FAMILY`: a paper's tables beside ours, computed by runs made now.

A scenario with `draws` gives the median of so many draws instead; these are read from the file that
`make papers` has stored (`stored.py`), or made now.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from ..files.pack import pack_scenario
from ..files.scenario import Scenario, scenarios
from ..system.errors import DesatError
from .case import PACKAGES, Options, execute
from .draws import pool_of
from .meaning import numbers_of_rows, words
from .numbers import relative
from .plots import pretty_unit
from .report import number, render, write_page


@dataclass
class Row:
    """One cell of a table: the paper's value (None where it gives none) and ours."""

    table: str
    method: str
    case: str
    quantity: str
    unit: str
    paper: float | None
    ours: float
    band: tuple[float, float] | None
    within: bool | None
    tuned: bool
    remark: str
    scenario: str
    draws: dict[str, Any] | None = None
    """Where `ours` is a median: number of draws, `min`, `max`, and the `band` of each draw."""


def _numbers(path: str, options: Options) -> dict[str, float]:
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
    cells = {n: s for n, s in scenarios(family).items() if s.data.get("paper")}
    if wrong := [line for s in cells.values() for line in words(s)]:
        raise DesatError("\n".join(dict.fromkeys(wrong)))
    if not cells:
        raise DesatError(f"{family}: no scenario has paper values")
    summaries = {n: d["summary"] for n, d in (drawn or {}).get("scenarios", {}).items()}
    if missing := [n for n, s in cells.items() if s.data.get("draws") and n not in summaries]:
        raise DesatError(f"{missing[0]}: no draws; `desat tables {family} --fresh` makes them")
    values = {n: {k: d["median"] for k, d in summaries[n].items()} for n in cells if n in summaries}
    single = [n for n in cells if n not in values]
    if single:
        paths = [str(pack_scenario(cells[n])) for n in single]
        with pool_of(jobs) as map_:
            results = map_(_numbers, paths, [options] * len(paths))
            values.update(zip(single, results, strict=True))
    # first what the paper has values for, then what is ours alone
    ranked = sorted(
        cells, key=lambda n: not any("values" in e for e in cells[n].data["paper"].values())
    )
    found = [
        row
        for n, s in ((n, cells[n]) for n in ranked)
        for row in _rows_of(s, values[n], values, summaries.get(n, {}))
    ]
    quantities = list(
        dict.fromkeys(
            (e["table"], e["quantity"]) for n in ranked for e in cells[n].data["paper"].values()
        )
    )
    methods = list(dict.fromkeys(row.method for row in found))
    return sorted(
        found,
        key=lambda r: (quantities.index((r.table, r.quantity)), methods.index(r.method)),
    )


def _rows_of(
    scenario: Scenario, values: dict[str, float], everything: dict[str, dict[str, float]],
    summary: dict[str, dict[str, Any]],
) -> list[Row]:  # fmt: skip
    found = []
    method, case = (scenario.cell.get(axis, "") for axis in ("method", "case"))
    labels = scenario.data["labels"]
    for row, name in numbers_of_rows(scenario.data, scenario.cell).items():
        entry = scenario.data["paper"][row]
        paper = _cell(entry, "values", method, case)
        ours = _value(scenario, name, values, everything)
        if ours is None:
            where = scenario.where(("paper", row))
            raise DesatError(f"{where}: {scenario.name} does not reach {name}, and a table has it")
        band = _band(_cell(entry, "tolerance", method, case), paper, values)
        drawn, within = None, None if band is None else band[0] <= ours <= band[1]
        if name in summary:
            n, least, most = (summary[name][k] for k in ("n", "min", "max"))
            each = entry.get("each")
            drawn = {"n": n, "min": least, "max": most, "band": each}
            if each is not None:
                within = within is not False and each[0] <= least and most <= each[1]
        found.append(
            Row(
                table=entry["table"],
                method=entry.get("label", labels.get("method", "")),
                case=labels.get("case", "") if method or case else scenario.name.partition("/")[2],
                quantity=entry["quantity"],
                unit=entry["unit"],
                paper=paper,
                ours=ours,
                band=band,
                within=within,
                tuned=_tuned(entry, method, case),
                remark=_remark(entry, method, case),
                scenario=scenario.name,
                draws=drawn,
            )
        )
    return found


def _value(
    scenario: Scenario, name: str, values: dict[str, float], everything: dict[str, Any]
) -> float | None:
    definition = scenario.data["numbers"].get(name, {})
    if "reference" not in definition:
        if name not in values and name in scenario.data.get("numbers", {}):
            raise DesatError(f"{scenario.where(('numbers', name))}: no run gives it")
        return values.get(name)
    other = everything.get(f"{scenario.family}/{definition['reference']}")
    if other is None:
        raise DesatError(f"{scenario.name}: {name} refers to {definition['reference']}: not run")
    return relative(definition["form"], values[definition["of"]], other[definition["of"]])


def _cell(entry: dict[str, Any], key: str, method: str, case: str) -> Any:
    """The value of a cell in a row by method and columns by case; None where there is none.

    What is no table of rows holds for every cell, and a row without columns for all of it.
    """
    row = entry.get(key)
    if isinstance(row, dict):
        row = row.get(method)
    if not isinstance(row, list) or "columns" not in entry:
        return row
    return row[entry["columns"].index(case)]


def _band(
    tolerance: Any, paper: float | None, values: dict[str, float]
) -> tuple[float, float] | None:  # fmt: skip
    """[low, high]; or `x %` or `x` either way of the paper's; or, of another number of the run,
    { of = NUMBER, from = FACTOR, to = FACTOR }."""
    if isinstance(tolerance, list):
        return float(tolerance[0]), float(tolerance[1])
    if isinstance(tolerance, dict):
        of = values[tolerance["of"]]
        return tolerance["from"] * of, tolerance["to"] * of
    if not tolerance or paper is None:
        return None
    width = (
        abs(paper) * float(tolerance[:-1]) / 100 if tolerance.endswith("%") else float(tolerance)
    )
    return paper - width, paper + width


def _tuned(entry: dict[str, Any], method: str, case: str) -> bool:
    tuned = _tuning(entry, method)
    if isinstance(tuned, dict):
        return any(case.startswith(c) for c in tuned["cases"])
    return bool(tuned)


def _tuning(entry: dict[str, Any], method: str) -> Any:
    tuned = entry.get("tuned")
    return tuned.get(method) if isinstance(tuned, dict) else tuned


def _remark(entry: dict[str, Any], method: str, case: str) -> str:
    parts = []
    if _tuned(entry, method, case):
        tuned = _tuning(entry, method)
        parts.append("tuned: " + (tuned["what"] if isinstance(tuned, dict) else tuned))
    if remark := _cell(entry, "remark", method, case):
        parts.append(remark)
    return "; ".join(parts)


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
