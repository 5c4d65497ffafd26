"""What is wrong with a scenario's data, held against the language: (path, one line) each."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ..language import paper, scenario
from ..language.kinds import Table
from ..system.errors import DesatError, nearest
from . import paths
from .io import parsed, text
from .merge import Keys

NEEDED = {
    "float_type": "a number", "int_type": "a whole number", "string_type": "a text",
    "bool_type": "true or false", "list_type": "a list", "dict_type": "a table",
    "model_type": "a table", "datetime_type": "a UTC time, 2026-01-01T00:00:00Z,",
    "finite_number": "a finite number",
}  # fmt: skip
_KINDS = {"<table>": "a table", "<list>": "a list", "<text>": "a text", "<number>": "a number"}


def problems(data: dict[str, Any], part: bool) -> Iterator[tuple[Keys, str]]:
    """What is wrong with the data of a file (`part`: others may complete it) or, whole, with the
    merged data of a scenario."""
    model = scenario.ScenarioFile if part else scenario.Scenario
    for path, error in _errors(model, data):
        if error["type"] == "extra_forbidden":
            yield path, f"unknown key{nearest(path[-1], keys(table_of(path[:-1], part)))}"
        elif not (part and error["type"] == "incomplete"):
            yield path, _text(error)


def design(file: Path) -> dict[str, Any]:
    """The data of a design's file, not to be changed. Raises DesatError, a line a problem."""
    where = paths.shown(file)
    return _design(text(file, where), where)


@lru_cache(maxsize=32)
def _design(source: str, where: str) -> dict[str, Any]:
    """The data of a design's text: long tables, which many cells of a scenario share."""
    data, lines = parsed(source, where), []
    for path, error in _errors(scenario.DesignFile, data):
        said = _text(error)
        if error["type"] == "extra_forbidden":
            said = f"unknown key{nearest(path[-1], keys(scenario.DesignFile))}"
        lines.append(": ".join([where, *([".".join(path)] if path else []), said]))
    if lines:
        raise DesatError("\n".join(lines))
    return data


def _errors(model: type[Table], data: dict[str, Any]) -> Iterator[tuple[Keys, dict[str, Any]]]:
    """Path and pydantic's error of each thing that is wrong with the data of a table."""
    try:
        model.model_validate(data)
    except ValidationError as error:
        for e in error.errors(include_url=False):
            yield tuple(str(p) for p in e["loc"] if not str(p).startswith("<")), dict(e)


def _text(error: dict[str, Any]) -> str:
    kind, context = error["type"], error.get("ctx", {})
    if kind == "incomplete":
        return str(context["text"])
    got = repr(error["input"])
    got = got if len(got) <= 60 else f"{got[:57]}..."
    if kind == "literal_error" and isinstance(error["input"], str):
        choices = [c.strip("' ") for c in context["expected"].replace(" or ", ", ").split(", ")]
        return f"got {got}{nearest(error['input'], choices)}"
    if kind == "union_tag_invalid":
        expected = context["expected_tags"].replace("'", "").split(", ")
        return f"got {got}; {' or '.join(_KINDS.get(t, t) for t in expected)} is needed"
    if kind in ("too_short", "too_long"):
        wanted = context.get("min_length", context.get("max_length"))
        return f"got {context['actual_length']} values; {wanted} needed"
    if kind == "value_error":
        return f"got {got}: {context['error']!s}"
    if kind in NEEDED:
        return f"got {got}; {NEEDED[kind]} is needed"
    return f"got {got}: {error['msg'][0].lower()}{error['msg'][1:]}"


def keys(table: type[Table]) -> list[str]:
    """The keys of a table of the language, as they are written."""
    return [field.alias or name for name, field in table.model_fields.items()]


def table_of(path: Keys, part: bool = True) -> type[Table]:
    """The table of the language that stands at a path of a scenario."""
    if path[:1] == ("axes",):
        return table_of(path[3:], False) if path[3:] else scenario.Cell
    if not path:
        return scenario.ScenarioFile if part else scenario.Scenario
    inner: dict[str, type[Table]] = {
        "limits": scenario.LimitLine, "tolerance": paper.OfNumber,
        "tuned": paper.Tuning, "in_sample": paper.Tuning,
        "share": paper.ShareOfDraws,
    }  # fmt: skip
    outer: dict[str, type[Table]] = {
        "numbers": scenario.Number, "plots": scenario.Plot, "paper": paper.PaperRow,
        "dispersions": scenario.Dispersion, "design": scenario.Design,
        "stop_when": scenario.StopWhen, "requirements": scenario.Requirement,
    }  # fmt: skip
    return inner.get(path[2], outer[path[0]]) if len(path) > 2 else outer[path[0]]


def rows_of_cell(data: dict[str, Any], cell: dict[str, str]) -> None:
    """Leave of each row of a paper's tables what it says of one cell: of tables by method and of
    lists with a value for each of `columns` the cell's own; rows of other methods go."""
    method, case = (cell.get(axis, "") for axis in ("method", "case"))
    for name, row in list(data.get("paper", {}).items()):
        values = row.get("values")
        mine = "not_judged" in row or not isinstance(values, dict) or method in values
        if not mine or method not in row.get("only", [method]):
            del data["paper"][name]
            continue
        columns = row.get("columns")
        for key in ("values", "tolerance", "remark", "tuned", "in_sample"):
            said = row.get(key)
            if isinstance(said, dict):
                said = said.get(method)
            if isinstance(said, dict) and "cases" in said:
                said = said["what"] if case.startswith(tuple(said["cases"])) else None
            band = key == "tolerance" and all(isinstance(x, (int, float)) for x in said or ())
            if isinstance(said, list) and columns is not None and not band:
                said = said[columns.index(case)]
            row |= {key: said}
            if said is None:
                del row[key]
        for key in {"columns", "only"} & row.keys():
            del row[key]


def paper_problems(
    data: dict[str, Any], cell: dict[str, str], axes: dict[str, Any]
) -> Iterator[tuple[Keys, str]]:
    """What rows of a paper's tables say of methods and cases that there are not."""
    methods = axes.get("method", {})
    for name, row in data.get("paper", {}).items():
        for key in ("values", "tolerance", "tuned", "in_sample", "remark", "only"):
            given = row.get(key)
            if not isinstance(given, dict if key != "only" else list):
                continue
            for method in given:
                if method not in methods:
                    text = f"no value {method} of the axis method{nearest(method, methods)}"
                    yield ("paper", name, key, *([method] if key != "only" else [])), text
        columns = row.get("columns")
        if columns is not None and cell.get("case", "") not in columns:
            text = f"no column {cell.get('case', '')}, a value of the axis case"
            yield ("paper", name, "columns"), f"{text}{nearest(cell.get('case', ''), columns)}"
