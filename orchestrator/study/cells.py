"""The cells of a paper's tables: what a scenario's [paper.NAME] says, and our numbers beside it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..files.scenario import Scenario
from ..system.errors import DesatError
from .meaning import numbers_of_rows
from .numbers import relative

Numbers = dict[str, Any]
"""A run's numbers by name; None: not reached."""


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


@dataclass(frozen=True)
class Entry:
    """A scenario's [paper.NAME], read for one method and one case: the values of its axes."""

    data: dict[str, Any]
    method: str
    case: str

    def cell(self, key: str) -> Any:
        """What `values`, `tolerance` or `remark` has for this method and case, or None.

        A table has a row a method; where there are columns, a list has a value a case. What is
        neither holds for all, as a band [low, high] does.
        """
        row = self.data.get(key)
        if isinstance(row, dict):
            row = row.get(self.method)
        one_band = key == "tolerance" and all(isinstance(x, (int, float)) for x in row or ())
        if isinstance(row, list) and "columns" in self.data and not one_band:
            return row[self.data["columns"].index(self.case)]
        return row

    def band(self, values: Numbers) -> tuple[float, float] | None:
        """[low, high] of what counts as within; None where anything does.

        `values`: the run's, for a band that is a multiple of another number.
        """
        tolerance, paper = self.cell("tolerance"), self.cell("values")
        if isinstance(tolerance, list):
            low, high = tolerance
            return float(low), float(high)
        if isinstance(tolerance, dict):
            of = values[tolerance["of"]]
            return tolerance["from"] * of, tolerance["to"] * of
        if not tolerance or paper is None:
            return None
        if tolerance.endswith("%"):
            width = abs(paper) * float(tolerance[:-1]) / 100
        else:
            width = float(tolerance)
        return paper - width, paper + width

    @property
    def tuning(self) -> str:
        """What was tuned to this cell; empty where nothing was."""
        tuned = self.data.get("tuned")
        if isinstance(tuned, dict):
            tuned = tuned.get(self.method)
        if isinstance(tuned, dict):
            hit = any(self.case.startswith(c) for c in tuned["cases"])
            return str(tuned["what"]) if hit else ""
        return str(tuned or "")

    @property
    def remark(self) -> str:
        """What a reader should know of the cell."""
        tuned = f"tuned: {self.tuning}" if self.tuning else ""
        return "; ".join(text for text in (tuned, self.cell("remark")) if text)


def rows_of(
    scenario: Scenario, values: Numbers, everything: dict[str, Numbers],
    summary: dict[str, dict[str, Any]],
) -> list[Row]:  # fmt: skip
    """The rows that a scenario gives. `values`: its numbers, `everything`: those of all scenarios;
    `summary`: of its draws, where it has some, by number.

    Raises DesatError where a number is not reached or is of a run that was not made.
    """
    method, case = (scenario.cell.get(axis, "") for axis in ("method", "case"))
    return [
        _row(scenario, Entry(scenario.data["paper"][row], method, case),
             _value(scenario, row, name, values, everything), values, summary.get(name))
        for row, name in numbers_of_rows(scenario.data, scenario.cell).items()
    ]  # fmt: skip


def _row(
    scenario: Scenario, entry: Entry, ours: float, values: Numbers, draws: dict[str, Any] | None
) -> Row:  # fmt: skip
    band = entry.band(values)
    within = None if band is None else band[0] <= ours <= band[1]
    drawn = None
    if draws is not None:
        each = entry.data.get("each")
        drawn = {"n": draws["n"], "min": draws["min"], "max": draws["max"], "band": each}
        if each is not None:
            within = within is not False and each[0] <= draws["min"] and draws["max"] <= each[1]
    labels = scenario.data["labels"]
    name = labels.get("case", "") if entry.method or entry.case else scenario.name.partition("/")[2]
    return Row(
        table=entry.data["table"],
        method=entry.data.get("label", labels.get("method", "")),
        case=entry.data.get("case", name),
        quantity=entry.data["quantity"],
        unit=entry.data["unit"],
        paper=entry.cell("values"),
        ours=ours,
        band=band,
        within=within,
        tuned=bool(entry.tuning),
        remark=entry.remark,
        scenario=scenario.name,
        draws=drawn,
    )


def _value(
    scenario: Scenario, row: str, name: str, values: Numbers, everything: dict[str, Numbers]
) -> float:  # fmt: skip
    """Our number of a row, from this run or in relation to another."""
    definition = scenario.data["numbers"].get(name, {})
    if "reference" in definition:
        other = everything.get(f"{scenario.family}/{definition['reference']}")
        if other is None:
            text = f"{scenario.name}: {name} refers to {definition['reference']}: not run"
            raise DesatError(text)
        of = definition["of"]
        value = relative(definition["form"], values[of], other[of])
    elif name not in values:
        raise DesatError(f"{scenario.where(('numbers', name))}: no run gives it")
    else:
        value = values[name]
    if value is None:
        where = scenario.where(("paper", row))
        raise DesatError(f"{where}: {scenario.name} does not reach {name}, and a table has it")
    return float(value)
