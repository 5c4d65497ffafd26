"""Explain the language: `desat list`, `keys`, `measures`, `show` and `help`."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_args, get_origin

from desat.components.contract.block import Block, Sampled
from desat.components.contract.fitting import needs_of
from desat.components.contract.roles import Manager
from desat.fmus import registry
from desat.fmus.description import describe

from ..engine.recording.results import frame_of
from ..files import paths, reader, scenario
from ..files.build import build
from ..files.completion import complete
from ..files.merge import origin
from ..files.scenario import Scenario
from ..numbers.measures import LATE, MEASURES
from ..numbers.numbers import options_of
from ..system.errors import DesatError, nearest
from ..system.interface import Interface, Signal, interface_of_block, role_classes
from ..system.options import Options
from ..system.typed import JsonObject
from . import validation


def readable(
    family: str | None, of_systems: bool = True
) -> tuple[dict[str, Scenario], list[str]]:
    """Return the scenarios without problems, and a line for each problem of the others.

    With `of_systems` False they are checked without the systems that they describe.
    """
    good, lines = scenario.readable(family)
    for name in list(good):
        wrong = _design(good[name])
        if wrong := wrong or _of_content(good[name], of_systems):
            lines += wrong
            del good[name]
    return good, list(dict.fromkeys(lines))


def _of_content(scenario_checked: Scenario, of_systems: bool) -> list[str]:
    """Return the problems of a scenario's content, and of its system on bare blocks."""
    if not of_systems:
        wrong = validation.content_problems(scenario_checked.content, None)
        return [f"{scenario_checked.place(path)}: {text}" for path, text in wrong]
    try:
        draft = build(scenario_checked, Options(blocks=True))
    except DesatError as error:
        return str(error).splitlines()
    if draft.problems:
        return draft.problems
    system = complete(draft)
    wrong = validation.content_problems(
        scenario_checked.content, draft.components, system
    )
    return [f"{scenario_checked.place(path)}: {text}" for path, text in wrong]


def _design(scenario_checked: Scenario) -> list[str]:
    """Return the problems of the file of a scenario's design."""
    try:
        if scenario_checked.design is not None and scenario_checked.design.exists():
            reader.design(scenario_checked.design)
    except DesatError as error:
        return str(error).splitlines()
    return []


def _tables() -> JsonObject:
    """Return the models of the language's tables, by the names that readers use."""
    from ..language import paper as p
    from ..language import scenario as l

    return {
        "scenario": l.ScenarioFile,
        "number": l.Number,
        "plot": l.Plot,
        "limit": l.LimitLine,
        "paper": p.PaperRow,
        "of_number": p.OfNumber,
        "share": p.ShareOfDraws,
        "tuning": p.Tuning,
        "dispersion": l.Dispersion,
        "requirement": l.Requirement,
        "axis": l.AxisCell,
        "design": l.Design,
        "stop_when": l.StopWhen,
    }


def keys(selection: str | None) -> list[dict[str, str]]:
    """List the keys of a table of the language, or of all tables.

    Raises
    ------
    DesatError
        If there is no such table.
    """
    from ..language.kinds import declared

    tables = _tables()
    if selection is not None and selection not in tables:
        raise DesatError(f"no table {selection}{nearest(selection, tables)}")
    return [
        {
            "table": name,
            "key": field.alias or key,
            "type": _type(field.annotation),
            "unit": of[key].unit,
            "what": field.description or "",
        }
        for name, table in tables.items()
        if selection in (None, name)
        for of in (declared(table),)
        for key, field in table.model_fields.items()
    ]


def _type(annotation: Any) -> str:
    """Describe a type for readers."""
    plain = {
        float: "number",
        int: "whole number",
        str: "text",
        bool: "true or false",
        Any: "value",
    }
    if annotation in plain:
        return plain[annotation]
    kind, inner = get_origin(annotation), get_args(annotation)
    if kind is tuple:
        return f"list of {_type(inner[0])}"
    if kind is dict:
        return f"table of {_type(inner[1])}"
    if kind is None:
        named = {model: name for name, model in _tables().items()}
        name: str = getattr(annotation, "__name__", str(annotation)).lower()
        return named.get(annotation, name)
    if str(kind).endswith("Literal"):
        return ", ".join(str(x) for x in inner)
    if hasattr(annotation, "__metadata__"):
        return _type(inner[0])
    return " or ".join(dict.fromkeys(_type(x) for x in inner))


def page() -> str:
    """Return the language as a Markdown page, with tables of `keys` and `measures`."""
    lines = [
        "# The scenario language",
        "",
        "Made by `desat help keys --markdown`; how files are merged: ",
    ]
    lines[-1] += 'reference.md, "Add a scenario".'
    for name in _tables():
        lines += ["", f"## {name}", "", "| key | type | unit | |", "|---|---|---|---|"]
        lines += [
            _row(f"`{r['key']}`", r["type"], r["unit"], r["what"]) for r in keys(name)
        ]
    lines += [
        "",
        "## measures",
        "",
        "| measure | series | options | |",
        "|---|---|---|---|",
    ]
    lines += [_row(f"`{r['measure']}`", *list(r.values())[1:]) for r in measures()]
    return "\n".join(lines) + "\n"


def _row(*cells: str) -> str:
    """Format cells as a row of a Markdown table."""
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def schema() -> JsonObject:
    """Return the language as a JSON schema, for editors."""
    schemas: JsonObject = _tables()["scenario"].model_json_schema()
    return schemas


def measures() -> list[dict[str, str]]:
    """Describe every measure: its series, its options and its sentence."""
    rows = []
    for name in sorted(MEASURES):
        series, options, _ = options_of(name)
        texts = [
            o if d is inspect.Parameter.empty else f"{o} = {d}"
            for o, d in options.items()
        ]
        meaning = " ".join((MEASURES[name].__doc__ or "").split())
        meaning += " If never, it is not reached." if name in LATE else ""
        rows.append(
            {
                "measure": name,
                "series": ", ".join(series),
                "options": ", ".join(texts),
                "what": meaning,
            }
        )
    return rows


def show(name: str) -> list[JsonObject]:
    """Return every value of a merged scenario, with its file, axis cell or design."""
    nominal = Path(name) / paths.NOMINAL
    named_file = nominal if nominal.is_file() else Path(name)
    entries = (
        scenario.read_foreign(named_file)
        if named_file.suffix == ".toml"
        else scenario.find(name)
    )
    rows = [
        {
            "key": ".".join(path),
            "value": value,
            "from": entries.origin_of(path)[0],
            "cell": origin(entries.origins, path)[1].rstrip("."),
        }
        for path, value in _leaves(entries.content.data)
    ]
    if entries.design is not None and entries.design.exists():
        own_keys = {row["key"] for row in rows}
        file = entries.design.relative_to(scenario.ROOT.parent).as_posix()
        rows += [
            {"key": key, "value": value, "from": file, "cell": "design"}
            for path, value in _leaves(entries.parameters(), ("parameters",))
            if (key := ".".join(path)) not in own_keys
        ]
    return [{**row, "value": _plain(row["value"])} for row in rows]


def _leaves(
    value: Any, path: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield path and value of each leaf of nested tables."""
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            yield from _leaves(inner, (*path, key))
    else:
        yield path, value


def _plain(value: Any) -> Any:
    """Convert dates to text for JSON."""
    return value.isoformat() if hasattr(value, "isoformat") else value


def blocks(selection: str | None) -> tuple[str, list[dict[str, str]]]:
    """Return a text and rows on all blocks, or on the variables of a role or of one.

    Raises
    ------
    DesatError
        If there is no such block or role.
    """
    interfaces = {name: interface_of_block(name) for name in registry.names()}
    if selection in interfaces:
        assert selection is not None
        interface = interfaces[selection]
        rows = []
        for kind in ("parameter", "input", "output"):
            for name in dict.fromkeys(s.array for s in interface.of(kind)):
                elements = interface.elements.get(name, ())
                first = elements[0]
                rows.append(
                    {
                        "name": name
                        + (f" ({len(elements)})" if len(elements) > 1 else ""),
                        "kind": kind,
                        "unit": first.unit_name or "1",
                        "start": _start(elements) if kind != "output" else "",
                        "allowed": ", ".join(first.choices) or _bounds(first),
                        "usually": first.follows,
                        "needed by": ", ".join(first.needed_by),
                        "meaning": first.description,
                    }
                )
        block = registry.block_class(selection)
        role = role_classes().get(selection)
        parts = [inspect.getdoc(block), _laws(block), _to_write(role) if role else ""]
        return "\n\n".join(filter(None, parts)), rows
    roles = sorted({i.role for i in interfaces.values()})
    if selection is not None and selection not in roles:
        raise DesatError(
            f"{selection}: no block and no role{nearest(selection, [*interfaces, *roles])}"
        )
    if selection is not None:
        return _role(selection, interfaces)
    return "", [
        {"role": i.role, "block": name, "title": i.title}
        for name, i in sorted(interfaces.items(), key=lambda x: (x[1].role, x[0]))
    ]


def _role(
    role: str, interfaces: Mapping[str, Interface]
) -> tuple[str, list[dict[str, str]]]:
    """Return what a role is, with its blocks, and rows of its variables."""
    declared = role_classes()[role]
    blocks_of_role = [
        f"{name}: {i.title}" for name, i in sorted(interfaces.items()) if i.role == role
    ]
    rows = [
        {
            "name": v.name + (f" {list(v.shape)}" if v.shape else ""),
            "kind": v.causality,
            "type": v.type,
            "unit": v.unit if v.type == "Real" else "",
            "frame": frame_of(v.name),
            "usually from": ", ".join(v.source) if v.causality == "input" else "",
            "meaning": describe(v),
        }
        for v in declared.variables
    ]
    parts = [
        inspect.getdoc(declared) or "",
        "Blocks:\n" + "\n".join(blocks_of_role),
        _to_write(declared),
    ]
    return "\n\n".join(parts), rows


def _to_write(role: type[Block]) -> str:
    """Describe what a user's block of a role writes."""
    lines = "\n".join(_methods(role))
    return (
        f"A block of your own in the role {role.role} writes (desat help own-block):\n"
        f"{lines}"
    )


def _methods(role: type[Block]) -> Iterator[str]:
    """Describe the methods that a block of a role writes, a line each."""
    names = [
        n for n in dir(role) if getattr(getattr(role, n), "__isabstractmethod__", False)
    ]
    for name in names or ("start", "output", "advance"):
        method = getattr(role, name)
        arguments = ", ".join(inspect.signature(method).parameters)
        text = " ".join((inspect.getdoc(method) or "").split())
        yield f"{name}({arguments}): {text}".replace("(self, ", "(").replace(
            "(self)", "()"
        )
    if not names and issubclass(role, Sampled):
        yield (
            "due(t), which is there: whether a sample falls on the step from t (s) on; "
            "call it once a step"
        )


def _laws(block: type[Block]) -> str:
    """Describe a manager: what it needs of a craft, and its laws with gains by rule."""
    if not issubclass(block, Manager):
        return ""
    if block.no_law:
        return f"No law that holds the wheels' momentum: {block.no_law}."
    lines = [f"Needs: {'; '.join(need.value for need in needs_of(block))}."]
    for law in block.offers:
        gains = ", ".join(f"{k} = {rule}" for k, rule in law.gains.items())
        lines.append(f"Law: {law.name}{f' ({gains})' if gains else ''}")
    return "\n".join(lines)


def _start(elements: Sequence[Signal]) -> str:
    """Format the start values of a variable."""
    values = [s.named(s.start) for s in elements]
    text = (
        str(values[0])
        if len(set(map(str, values))) == 1
        else ", ".join(map(str, values))
    )
    return text if len(text) <= 40 else f"{text[:39]}…"


def _bounds(signal: Signal) -> str:
    """Format the bounds of a variable."""
    low, high = signal.minimum, signal.maximum
    return " ".join(
        filter(
            None,
            (
                "" if low is None else f">= {low:g}",
                "" if high is None else f"<= {high:g}",
            ),
        )
    )
