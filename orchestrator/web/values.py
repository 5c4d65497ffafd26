"""Find which parameters of a system follow from others, and by which expressions."""

from __future__ import annotations

from collections.abc import Iterator, Set
from typing import Any

from ..system.expression import Table, entry, is_name, parsed, product, scale_of
from ..system.model import System, Values
from ..system.parameters import unit_of
from ..system.typed import JsonObject

# `factors`: operator `*` or `/`, and a number, or a parameter and its element (0:
# whole); `scale`: multiplies their product; `text`
Expression = dict[str, Any]


def expression(text: str, parameters: Table, scale: float = 1.0) -> Expression:
    """Parse a product of parameters.

    Raises
    ------
    DesatError
        If it names an unknown parameter.
    """
    return {
        "text": text,
        "scale": scale,
        "factors": [
            [operator, _factor(word, parameters)] for operator, word in parsed(text)
        ],
    }


def _factor(word: str, parameters: Table) -> float | list[Any]:
    """Return a factor: a number, or a parameter and its element."""
    try:
        return float(word)
    except ValueError:
        named = entry(word, parameters)
        return [named.name, named.element]


def names_of(of: Expression) -> set[str]:
    """Return the parameters in an expression."""
    return {factor[0] for _, factor in of["factors"] if isinstance(factor, list)}


def follows(system: System) -> list[JsonObject]:
    """Return the parameters of a system that follow from others, in evaluation order.

    Each has its name, its expression (`of`), its number of elements (`count`, 0: no
    array), and whether it equals another one (`whole`).
    """
    parameters = system.parameters
    waiting = {
        f"{c.name}.{name}": _reference(system, c.name, name, text, parameters)
        for c in system.components.values()
        for name, text in c.references.items()
    }
    ordered = []
    while waiting:  # there is no cycle: the system is resolved
        for name in [
            n for n, f in waiting.items() if not names_of(f["of"]) & waiting.keys()
        ]:
            ordered.append(waiting.pop(name))
    return ordered


def _reference(
    system: System, owner: str, name: str, text: str, parameters: Table
) -> JsonObject:
    """Return the entry of one parameter that follows from others."""
    signals = system.components[owner].interface.elements[name]
    is_whole_name = is_name(text)
    unit = (
        unit_of(entry(text, parameters).unit)
        if is_whole_name
        else product(text, parameters)[1]
    )
    return {
        "name": f"{owner}.{name}",
        "whole": is_whole_name,
        "count": 0 if signals[0].name == name else len(signals),
        "of": expression(text, parameters, scale_of(signals[0], unit, text)),
    }


def reached(moved: Set[str], ordered: list[JsonObject]) -> set[str]:
    """Return parameters and all that follow from them."""
    names = set(moved)
    for each in ordered:
        if names_of(each["of"]) & names:
            names.add(each["name"])
    return names


def numbers_of(system: System) -> Iterator[tuple[str, Any]]:
    """Yield every numeric parameter: its name, and its number or list of elements."""
    for owner, parameters in system.parameters.items():
        for name, of in parameters.items():
            values = of.value if isinstance(of.value, list) else [of.value]
            if all(isinstance(x, (int, float)) for x in values):
                yield f"{owner}.{name}", of.value


def differing(a: System, b: System) -> set[str]:
    """Return the parameters in which two systems of the same components differ."""
    one, other = (_all(s) for s in (a, b))
    return {name for name, value in one.items() if other[name] != value}


def _all(system: System) -> Values:
    """Return the values of all parameters by name."""
    parameters = system.parameters
    return {
        f"{owner}.{n}": p.value
        for owner, of in parameters.items()
        for n, p in of.items()
    }
