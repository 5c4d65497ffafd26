"""Parameters that are given as other parameters, or products of them: `gain = "shared.inertia"`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from desat.components.contract.block import Scalar

from .errors import DesatError
from .expression import Table, entry, is_name, product, unit_of
from .interface import base_name
from .model import Component
from .parameters import expand, table

References = Mapping[tuple[str, str], str]
"""Component and parameter -> the text that it is given as."""


def evaluate(
    components: Mapping[str, Component], references: References, where: str
) -> tuple[dict[str, Component], list[str]]:
    """The components with the values of their references, and what is wrong with these.

    A name alone stands for the whole array. Units are converted; a parameter in "1" takes the
    number in SI units whatever its unit (a gain matrix that is the inertia).
    """
    result, waiting = dict(components), dict(references)
    problems: list[str] = []
    while waiting:
        ready = [key for key, text in waiting.items() if not named(text) & _names(waiting)]
        if not ready:
            chain = ", ".join(f'{c}.{n} = "{text}"' for (c, n), text in waiting.items())
            return result, [*problems, f"{where}: parameters name each other in a circle: {chain}"]
        known = table(result.values())
        for owner, name in ready:
            text, component = waiting.pop((owner, name)), result[owner]
            try:
                values = {**component.parameters, **values_of(component, name, text, known)}
                result[owner] = replace(component, parameters=values)
            except DesatError as error:
                by = component.given.get(base_name(name), where)
                problems.append(f"{by}: {owner}.{name}: {error}")
    return result, problems


def named(text: str) -> set[str]:
    """The parameters that a product names, without their elements."""
    return {base_name(word) for word in text.replace("*", " ").replace("/", " ").split()}


def _names(waiting: Iterable[tuple[str, str]]) -> set[str]:
    """What a text would call these parameters."""
    return {f"{owner}.{name}" for c, name in waiting for owner in (c, "shared")}


def values_of(component: Component, name: str, text: str, known: Table) -> dict[str, Scalar]:
    """The scalars that a text gives to a parameter. Raises DesatError where it does not fit."""
    signals = component.interface.elements(name)
    value: Any
    if is_name(text):
        value, unit = entry(text, known)[0], unit_of(entry(text, known)[1])
    else:
        value, unit = product(text, known)
    if isinstance(value, (str, bool)):
        raise DesatError(f'"{text}" = {value} is no number')
    own, scale = signals[0].unit, unit.factor
    if own is not None and own.dimension == unit.dimension:
        scale = unit.factor / own.factor
    elif own is not None and any(own.dimension):
        raise DesatError(f'"{text}": its unit does not fit {signals[0].unit_name}')
    values = value if isinstance(value, list) else [value] * len(signals)
    return expand(component.interface, name, [scale * x for x in values], component.name)
