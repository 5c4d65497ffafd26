"""Check a scenario's data against the language.

Problems are pairs of path and one line.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin

from pydantic import ValidationError

from ..language import scenario
from ..language.content import KEYS, OF_THE_CELL, Content, data_of
from ..language.kinds import LanguageTable
from ..system.errors import DesatError, nearest
from . import paths
from .io import TomlTable, at, contents, parsed, text
from .merge import Keys

T = TypeVar("T", bound=LanguageTable)
NEEDED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "string_type": "a text",
    "bool_type": "true or false",
    "tuple_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "datetime_type": "a UTC time, 2026-01-01T00:00:00Z,",
    "finite_number": "a finite number",
}
# Former name of a key -> its name now.
RENAMED = {
    "twin": "baseline",
    "story": "description",
    "draws": "samples",
    "inner": "substeps",
    "decimation": "step_ratio",
}
_KINDS = {
    "<table>": "a table",
    "<list>": "a list",
    "<text>": "a text",
    "<number>": "a number",
}


class WrongError(Exception):
    """Data that are not in the language.

    `problems` has the path of each, and what is wrong there in one line.
    """

    def __init__(self, problems: list[tuple[Keys, str]]) -> None:
        super().__init__(problems)
        self.problems = problems


def read(model: type[T], data: TomlTable, part: bool = False) -> T | None:
    """Build the object of a table's data.

    For a `part`, which other data may complete, it is None if the table is incomplete.

    Raises
    ------
    WrongError
        If the data are not in the language.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        wrong = [
            (tuple(str(p) for p in e["loc"] if not str(p).startswith("<")), dict(e))
            for e in error.errors(include_url=False)
        ]
    lines = [
        (p, _text(model, p, e))
        for p, e in wrong
        if not (part and e["type"] == "incomplete")
    ]
    if lines:
        raise WrongError(lines)
    return None


def build_complete(model: type[T], data: TomlTable) -> T:
    """Build the object of data that are complete.

    Raises
    ------
    WrongError
        If the data are incomplete or not in the language.
    """
    built = read(model, data)
    assert built is not None
    return built


def design(file: Path) -> scenario.DesignFile:
    """Read a design's file.

    Raises
    ------
    DesatError
        If there are problems, with a line for each.
    """
    place = paths.shown(file)
    return _design(text(file, place), place)


@lru_cache(maxsize=32)
def _design(source: str, place: str) -> scenario.DesignFile:
    """Parse a design's text.

    It is cached, because it has long tables that many cells of a scenario share.
    """
    try:
        return build_complete(scenario.DesignFile, parsed(source, place))
    except WrongError as wrong:
        problems = ((".".join(path), text) for path, text in wrong.problems)
        lines = [": ".join(filter(None, (at(place, k), k, t))) for k, t in problems]
        raise DesatError("\n".join(lines)) from wrong


def read_packed(path: Path, place: str) -> Content:
    """Read the content of a scenario from a file of an .ssp.

    Messages call the file `place`.

    Raises
    ------
    DesatError
        If it is no JSON or not in the scenario language, with a line for each problem.
    """
    try:
        about = json.loads(contents(path, place).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise DesatError(f"{place}: not JSON in UTF-8 ({error})") from error
    keys_allowed = (*OF_THE_CELL, *KEYS)
    if not isinstance(about, dict):
        wrong = ["a table is needed"]
    else:
        wrong = [
            f"{k}: unknown key{nearest(k, keys_allowed)}"
            for k in about
            if k not in keys_allowed
        ]
        if not isinstance(about.get("plots", []), list):
            wrong.append("plots: a list is needed")
    if not wrong:
        try:
            return build_complete(Content, data_of(about)).travelled(about)
        except WrongError as error:
            wrong = [f"{'.'.join(p)}: {t}" for p, t in error.problems]
    raise DesatError("\n".join(f"{place}: {text}" for text in wrong))


def _text(model: type[LanguageTable], path: Keys, error: dict[str, Any]) -> str:
    """Describe an error of pydantic in one line."""
    kind, context = error["type"], error.get("ctx", {})
    of_scenario = len(path) == 1 or (path[:1] == ("axes",) and len(path) == 4)
    if kind == "extra_forbidden" and of_scenario and path[-1] in RENAMED:
        return f"unknown key; it is called {RENAMED[path[-1]]}"
    if kind == "extra_forbidden":
        return (
            f"unknown key{nearest(path[-1], keys(table_at(model, path[:-1]) or model))}"
        )
    if kind == "incomplete":
        return str(context["text"])
    got = repr(error["input"])
    got = got if len(got) <= 60 else f"{got[:57]}..."
    if kind == "literal_error" and isinstance(error["input"], str):
        choices = [
            c.strip("' ") for c in context["expected"].replace(" or ", ", ").split(", ")
        ]
        return f"got {got}{nearest(error['input'], choices)}"
    if kind == "union_tag_invalid":
        expected = context["expected_tags"].replace("'", "").split(", ")
        return f"got {got}; {' or '.join(_KINDS.get(t, t) for t in expected)} is needed"
    if kind in ("too_short", "too_long"):
        length = context.get("min_length", context.get("max_length"))
        return f"got {context['actual_length']} values; {length} needed"
    if kind == "value_error":
        return f"got {got}: {context['error']!s}"
    if kind in NEEDED:
        return f"got {got}; {NEEDED[kind]} is needed"
    return f"got {got}: {error['msg'][0].lower()}{error['msg'][1:]}"


def keys(table: type[LanguageTable]) -> list[str]:
    """Return the keys of a table of the language, as they are written."""
    return [field.alias or name for name, field in table.model_fields.items()]


def table_at(kind: Any, path: Keys) -> type[LanguageTable] | None:
    """Find the table of the language at a path within a type; None without one."""
    if isinstance(kind, type) and issubclass(kind, LanguageTable):
        if not path:
            return kind
        fields = {
            field.alias or name: field for name, field in kind.model_fields.items()
        }
        return (
            table_at(fields[path[0]].annotation, path[1:])
            if path[0] in fields
            else None
        )
    inner = get_args(kind)
    if get_origin(kind) in (dict, tuple):
        return (
            table_at(inner[-1 if get_origin(kind) is dict else 0], path[1:])
            if path
            else None
        )
    return next((found for x in inner if (found := table_at(x, path))), None)


def paper_problems(content: Content, axes: TomlTable) -> Iterator[tuple[Keys, str]]:
    """Find methods and cases in rows of a paper's tables that do not exist."""
    methods, case = axes.get("method", {}), content.cell.get("case", "")
    for name, row in content.paper.items():
        for key in ("values", "tolerance", "tuned", "in_sample", "remark", "only"):
            value = getattr(row, key)
            if not isinstance(value, dict if key != "only" else tuple):
                continue
            for method in value:
                if method not in methods:
                    text = f"no value {method} of the axis method{nearest(method, methods)}"
                    yield (
                        ("paper", name, key, *([method] if key != "only" else [])),
                        text,
                    )
        if row.columns and case not in row.columns:
            text = f"no column {case}, a value of the axis case{nearest(case, row.columns)}"
            yield ("paper", name, "columns"), text
