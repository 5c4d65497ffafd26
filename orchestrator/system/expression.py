"""Evaluate products of parameters, which a scenario may have in place of numbers.

    percent_of = "wheels.inertia_wheel * wheels.speed_limit"
    limits = [{ value = "0.1 * manager.h_limit", name = "not unloaded" }]

A text is a product or quotient of numbers and parameters, evaluated from left to right.
A parameter is `component.name`, `component.name[i]`, or `shared.name` for one that
several components have with the same value (the craft's, where a flight computer's
model is in error). Its unit counts: N m / N m s is 1/s.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit, conversion, times

from .errors import DesatError, nearest, require
from .interface import Signal, base_name, computers
from .model import Component, Parameter, table
from .parameters import expand, unit_of

# Component -> parameter, as in a manifest.
Table = Mapping[str, Mapping[str, Parameter]]

_TOKEN = re.compile(r"\s*(?:([*/])|([^\s*/]+))")
# a name begins with no digit: 0.3 is a number
_NAME = re.compile(r"([^\W\d]\w*)\.(\w+)(?:\[(\d+)\])?\Z")
FORM = "a Real is needed, or a product of numbers and component.parameter"


def factor(source: Unit, target: str, subject: str) -> float:
    """Return the factor that converts a value from `source` to `target`.

    Raises
    ------
    DesatError
        If the dimensions differ; `subject` names the value with the unit.
    """
    converted = conversion(source, unit_of(target))
    if converted is None:
        raise DesatError(f"unit {subject} does not fit {target or '1'}")
    return converted[0]


def is_name(text: str) -> bool:
    """Return whether a text is the name of one parameter, without a product."""
    return _NAME.match(text.strip()) is not None


def parsed(text: str) -> list[tuple[str, str]]:
    """Parse a text into pairs of operator (`*` or `/`) and number or name.

    Raises
    ------
    DesatError
        If the text has another form.
    """
    tokens = [m.groups() for m in _TOKEN.finditer(text.strip())]
    operators, factors = [t[0] for t in tokens[1::2]], [t[1] for t in tokens[::2]]
    if not tokens or len(tokens) % 2 == 0 or None in operators or None in factors:
        raise DesatError(f'"{text}": {FORM}')
    return list(zip(["*", *operators], factors, strict=True))


def product(text: str, parameters: Table) -> tuple[float, Unit]:
    """Compute the value of a text and its unit.

    Raises
    ------
    DesatError
        If it has no value; the message names the text.
    """
    result, unit = 1.0, Unit()
    for operator, name in parsed(text):
        own_unit = Unit()
        try:
            number = float(name)
        except ValueError:
            try:
                number, own_unit = _scalar(name, parameters)
            except DesatError as error:
                reason = str(error).removeprefix(f"{text}: ")
                raise DesatError(f'"{text}": {reason}') from error
        if operator == "/":
            if number == 0.0:
                raise DesatError(f'"{text}": {name} is 0')
            result, unit = result / number, times(unit, own_unit, -1)
        else:
            result, unit = result * number, times(unit, own_unit)
    return result, unit


class ParameterEntry(NamedTuple):
    """Parameter that a text names, or one of its elements."""

    value: Any
    unit: str
    # `component.parameter`; for `shared.parameter` the component whose value counts
    name: str
    element: int  # from 1 on; 0: the whole


def entry(name: str, table: Table) -> ParameterEntry:
    """Look up `component.parameter`, or one of its elements.

    Raises
    ------
    DesatError
        If there is none.
    """
    match = _NAME.match(name.strip())
    if match is None:
        raise DesatError(f"{name}: {FORM}")
    owner, parameter, index = match.groups()
    if owner == "shared":
        owner = _owner_of_shared(parameter, table)
    require(owner, table, "no component")
    if parameter not in table[owner]:
        hint = nearest(parameter, table[owner])
        raise DesatError(f"{owner} has no parameter {parameter}{hint}")
    value, unit = table[owner][parameter].value, table[owner][parameter].unit
    if index:
        if not isinstance(value, list) or not 1 <= int(index) <= len(value):
            raise DesatError(f"{owner}.{parameter} has no element {index}")
        value = value[int(index) - 1]
    return ParameterEntry(value, unit, f"{owner}.{parameter}", int(index or 0))


def _owner_of_shared(parameter: str, table: Table) -> str:
    """Find the component whose value of a shared parameter counts."""
    owners = sorted(c for c, parameters in table.items() if parameter in parameters)
    if not owners:
        raise DesatError(f"no component has a parameter {parameter}")
    # if a flight computer's model is in error, the craft's own value counts; flight
    # computers are recognised by their names, which begin with their role
    of_craft = [c for c in owners if not c.startswith(tuple(computers()))] or owners
    value = table[of_craft[0]][parameter].value
    if any(table[c][parameter].value != value for c in of_craft):
        raise DesatError(
            f"{parameter} differs between {', '.join(owners)}; name one of them"
        )
    return of_craft[0]


def _scalar(name: str, table: Table) -> tuple[float, Unit]:
    """Return a parameter as one number, with its unit.

    For an array it is the common value of all elements that are not zero (a wheel that
    does not exist has inertia 0).
    """
    value, unit, *_ = entry(name, table)
    if isinstance(value, list):
        different = sorted({float(x) for x in value if x})
        if len(different) > 1:
            raise DesatError(f"{name} has elements that differ; name one, as {name}[1]")
        value = different[0] if different else 0.0
    if isinstance(value, (str, bool)):
        raise DesatError(f"{name} = {value} is no number")
    return float(value), unit_of(unit)


# ------------------------------------------------------------------------------------------------
# References: parameters set to other parameters, or products of them: `gain = "shared.inertia"`


# Component and parameter -> the text that gives its value.
References = Mapping[tuple[str, str], str]


def evaluate(
    components: Mapping[str, Component], references: References, place: str
) -> tuple[dict[str, Component], list[str], list[str]]:
    """Set the parameters that are references; list problems and warnings about these.

    A name alone stands for the whole array. Units are converted. A parameter in "1"
    takes the number in SI units whatever its unit is (a gain matrix that is the
    inertia). A number without a unit, which only a foreign FMU has, is taken as it is,
    with a warning.
    """
    result, waiting = dict(components), dict(references)
    problems: list[str] = []
    warnings: list[str] = []
    while waiting:
        # the names by which a text would refer to those that wait
        names_waiting = {
            f"{owner}.{name}" for c, name in waiting for owner in (c, "shared")
        }
        ready = [
            key for key, text in waiting.items() if not names_in(text) & names_waiting
        ]
        if not ready:
            chain = ", ".join(f'{c}.{n} = "{text}"' for (c, n), text in waiting.items())
            circle = f"{place}: parameters name each other in a circle: {chain}"
            return result, [*problems, circle], warnings
        parameters = table(result.values())
        for owner, name in ready:
            text, component = waiting.pop((owner, name)), result[owner]
            by = component.origins.get(base_name(name), place)
            try:
                if bare := unitless_in(text, parameters):
                    warnings.append(
                        f'{by}: {owner}.{name}: "{text}": {bare} has no unit: its value '
                        "is taken as it is"
                    )
                values = {
                    **component.parameters,
                    **values_of(component, name, text, parameters),
                }
                result[owner] = replace(component, parameters=values)
            except DesatError as error:
                problems.append(f"{by}: {owner}.{name}: {error}")
    return result, problems, warnings


def names_in(text: str) -> set[str]:
    """Return the parameters that a product names, without their indices."""
    return {
        base_name(word) for word in text.replace("*", " ").replace("/", " ").split()
    }


def unitless_in(text: str, parameters: Table) -> str:
    """Return the first parameter of a product that is a Real without a unit, or ""."""
    for name in sorted(names_in(text)):
        if is_name(name):
            value, unit, *_ = entry(name, parameters)
            first = value[0] if isinstance(value, list) and value else value
            if isinstance(first, float) and not unit:
                return name
    return ""


def values_of(
    component: Component, name: str, text: str, parameters: Table
) -> dict[str, Scalar]:
    """Compute the scalars that a text gives to a parameter.

    Raises
    ------
    DesatError
        If the value does not fit.
    """
    signals = component.interface.elements.get(name, ())
    value: Any
    if is_name(text):
        value, unit = entry(text, parameters)[0], unit_of(entry(text, parameters)[1])
    else:
        value, unit = product(text, parameters)
    if isinstance(value, (str, bool)):
        raise DesatError(f'"{text}" = {value} is no number')
    scale = 1.0 if unitless_in(text, parameters) else scale_of(signals[0], unit, text)
    values = value if isinstance(value, list) else [value] * len(signals)
    return expand(
        component.interface, name, [scale * x for x in values], component.name
    )


def scale_of(signal: Signal, unit: Unit, text: str) -> float:
    """Return the factor that converts a text's value in `unit` to the parameter's unit.

    Raises
    ------
    DesatError
        If the dimensions differ.
    """
    own_unit = signal.unit
    if own_unit is not None and own_unit.dimension == unit.dimension:
        return unit.factor / own_unit.factor
    if own_unit is not None and any(own_unit.dimension):
        raise DesatError(f'"{text}": its unit does not fit {signal.unit_name}')
    return unit.factor
