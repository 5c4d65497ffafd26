"""What a scenario means, beyond its words: measures and their options; and, of a system that it
describes, series, units, limits and dispersions. A line for each thing that is not there."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from ..files.scenario import Scenario
from ..system.errors import DesatError, nearest
from ..system.interface import Signal, base_name
from ..system.model import System
from ..system.parameters import expand
from .measures import MEASURES, OWN_UNIT, SIZES, scale

Path = tuple[str, ...]


def options_of(measure: str) -> tuple[list[str], dict[str, Any]]:
    """The series that a measure takes after the times, and its options with their defaults (or
    `inspect.Parameter.empty`)."""
    given = list(inspect.signature(MEASURES[measure]).parameters.values())[1:]
    series = [p.name for p in given if p.annotation == "Array"]
    return series, {p.name: p.default for p in given if p.name not in series}


def words(scenario: Scenario) -> list[str]:
    """Measures, options and derived quantities that there are not; no system is needed."""
    return [f"{scenario.where(path)}: {text}" for path, text in _words(scenario.data)]


def _words(data: dict[str, Any]) -> Iterator[tuple[Path, str]]:
    numbers = data.get("numbers", {})
    for name, number in numbers.items():
        path = ("numbers", name)
        if "of" in number:
            if number["of"] not in numbers:
                yield (*path, "of"), f"no number {number['of']}{nearest(number['of'], numbers)}"
            continue
        measure = number.get("measure", "last")
        if measure not in MEASURES:
            yield (*path, "measure"), f"no measure {measure}{nearest(measure, MEASURES)}"
            continue
        series, options = options_of(measure)
        signals = number["signal"]
        count = 1 if isinstance(signals, str) else len(signals)
        if count != len(series):
            yield (*path, "signal"), f"{count} given; {measure} takes {len(series)}"
        for option in number.get("options", {}):
            if option not in options:
                hint = nearest(option, options) or "; it has none"
                yield (*path, "options", option), f"{measure} has no option {option}{hint}"
        kinds = inspect.get_annotations(MEASURES[measure])
        for option, value in number.get("options", {}).items():
            if option in options and (wanted := _unfit(option, kinds[option], value)):
                yield (*path, "options", option), f"got {value!r}; {wanted} is needed"
        unknown = number.get("options", {}).keys() - options.keys()
        for option, default in () if unknown else options.items():
            if default is inspect.Parameter.empty and option not in number.get("options", {}):
                yield (*path, "options"), f"{measure} needs {option}"
    from .plots import DERIVED  # matplotlib

    for name, plot in data.get("plots", {}).items():
        if "derive" in plot and plot["derive"] not in DERIVED:
            yield (
                ("plots", name, "derive"),
                f"no {plot['derive']}{nearest(plot['derive'], DERIVED)}",
            )
        if "sequence" in plot and plot.get("derive") != "euler":
            yield ("plots", name, "sequence"), 'only with derive = "euler"'


def _unfit(option: str, annotation: str, value: Any) -> str:
    """What an option of a measure needs, where the value is not that. A text may stand for a
    number: it names parameters."""
    if option == "kind":
        return "" if value in SIZES else " or ".join(SIZES)
    if annotation.startswith("list"):
        good = isinstance(value, list) and all(type(x) in (int, float) for x in value)
        return "" if good else "a list of numbers"
    if annotation == "int":
        return "" if type(value) is int else "a whole number"
    return "" if type(value) in (int, float, str) else "a number"


def names(scenario: Scenario, system: System) -> list[str]:
    """Series, units, limits and dispersions that do not fit the system, interfaces loaded."""
    found = (*_series(scenario.data, system), *_dispersions(scenario.data, system))
    return [f"{scenario.where(path)}: {text}" for path, text in found]


def _elements(system: System, name: str, causalities: tuple[str, ...]) -> list[Signal] | str:
    """The elements of `component.variable`, or what is wrong with the name; none where the
    component's FMU is missing, which is said elsewhere."""
    owner, _, variable = name.partition(".")
    component = system.components.get(owner)
    if component is None:
        return f"no component {owner}{nearest(owner, system.components)}"
    if component.interface is None:
        return []
    elements = component.interface.elements(variable)
    if not elements or elements[0].causality not in causalities:
        known = {base_name(s.name) for c in causalities for s in component.interface.of(c)}
        return f"{owner} has no {causalities[0]} {variable}{nearest(variable, known)}"
    return elements


def _unit(elements: list[Signal], unit: str | None) -> str:
    if not elements or unit is None:
        return ""
    try:
        scale(elements[0].unit_name, unit)
    except DesatError as error:
        return str(error)
    return ""


def _series(data: dict[str, Any], system: System) -> Iterator[tuple[Path, str]]:
    for table, key in (("numbers", "signal"), ("plots", "signals")):
        for name, entry in data.get(table, {}).items():
            signals = entry.get(key, [])
            signals = [signals] if isinstance(signals, str) else signals
            found = [_elements(system, signal, ("output",)) for signal in signals]
            for problem in found:
                if isinstance(problem, str):
                    yield (table, name, key), problem
            own = entry.get("measure") in OWN_UNIT or "derive" in entry or "percent_of" in entry
            for elements in found[:1] if table == "numbers" else found:
                if isinstance(elements, list) and not own:
                    if text := _unit(elements, entry.get("unit")):
                        yield (table, name, "unit"), text
                    names = entry.get("components", [])
                    if elements and len(names) > len(elements):
                        text = f"{len(names)} names for {len(elements)} elements"
                        yield (table, name, "components"), text
    for name, plot in data.get("plots", {}).items():
        for limit in plot.get("limits", []):
            value = limit["value"] if isinstance(limit, dict) else limit
            for factor in re.split(r"[*/]", value) if isinstance(value, str) else ():
                if not _is_number(factor):
                    parameter = base_name(factor.strip())
                    problem = _elements(system, parameter, ("parameter", "input"))
                    if isinstance(problem, str):
                        yield ("plots", name, "limits"), problem


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _dispersions(data: dict[str, Any], system: System) -> Iterator[tuple[Path, str]]:
    for key, spec in data.get("dispersions", {}).items():
        path = ("dispersions", key)
        owner, _, variable = key.partition(".")
        owners = [owner]
        if owner == "*":
            owners = [n for n, c in system.components.items()
                      if c.interface and c.interface.elements(variable)]  # fmt: skip
            if not owners and all(c.interface for c in system.components.values()):
                yield path, f"no component has a parameter {variable}"
        for name in owners:
            elements = _elements(system, f"{name}.{variable}", ("parameter", "input"))
            if isinstance(elements, str):
                yield path, elements
            elif elements and (text := _misfit(system, name, variable, elements, spec)):
                yield path, text


def _misfit(
    system: System, owner: str, variable: str, elements: list[Signal], spec: dict[str, Any]
) -> str:
    ((kind, given),) = spec.items()
    wanted = {"signs": len(given) if kind == "signs" else 0, "attitude": 4, "seed": 1}
    if len(elements) != wanted.get(kind, len(elements)):
        return f"{kind}: {variable} has {len(elements)} elements, not {wanted[kind]}"
    if kind == "direction" and len(elements) < 2:
        return f"direction: {variable} is no vector"
    if kind != "one_of":
        type_ = "Integer" if kind == "seed" else "Real"
        other = elements[0].kind != type_
        return f"{kind}: {variable} is of type {elements[0].kind}, not {type_}" if other else ""
    interface = system.components[owner].interface
    assert interface is not None
    for value in given:
        try:
            expand(interface, variable, value, owner)
        except DesatError as error:
            return f"one_of: {error}"
    return ""
