"""Values for parameters and inputs: from a scenario, an SSV or the command line to scalars."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable
from typing import Any

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit, conversion

from .errors import DesatError, nearest
from .expression import Table, entry, is_name, product, unit_of
from .interface import Interface, Signal, base_name
from .model import Component, System


def expand(interface: Interface, name: str, value: Any, where: str) -> dict[str, Scalar]:
    """The scalars of `name = value` by element name.

    `where` (file and component) begins every message. A list gives an array's elements row by
    row; a text gives a choice by its name. Raises DesatError for an unknown or set-only-by-others
    variable, a wrong count or type, and a value outside the bounds.
    """
    signals = interface.elements(name)
    if not signals:
        known = {base_name(s.name) for c in ("parameter", "input") for s in interface.of(c)}
        raise DesatError(f"{where} has no variable {name}{nearest(name, known)}")
    if signals[0].causality not in ("parameter", "input"):
        raise DesatError(f"{where}.{name} is an {signals[0].causality}: it cannot be set")
    values = _flat(value)
    if len(values) != len(signals):
        raise DesatError(f"{where}.{name} needs {len(signals)} values, got {len(values)}")
    return {
        s.name: _scalar(s, x, f"{where}.{s.name}") for s, x in zip(signals, values, strict=True)
    }


def _flat(value: Any) -> list[Any]:
    if isinstance(value, (list, tuple)):
        return [x for item in value for x in _flat(item)]
    return [value]


def _scalar(signal: Signal, value: Any, where: str) -> Scalar:
    if signal.choices and isinstance(value, str):
        if value not in signal.choices:
            raise DesatError(f"{where} = {value}: not a choice{nearest(value, signal.choices)}")
        return signal.choices.index(value)
    if signal.kind == "Boolean":
        if isinstance(value, bool):
            return value
    elif signal.kind == "Integer":
        if isinstance(value, int) and not isinstance(value, bool):
            return int(_within(signal, value, where))
    elif signal.kind == "Real":
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            return _within(signal, float(value), where)
    else:
        raise DesatError(f"{where} is of type {signal.kind}: it cannot be set")
    wanted = f"one of {', '.join(signal.choices)}" if signal.choices else f"a {signal.kind}"
    raise DesatError(f"{where} = {value!r}: {wanted} is needed")


def _within(signal: Signal, value: float, where: str) -> float:
    if not math.isfinite(value):
        raise DesatError(f"{where} = {value}: a finite number is needed")
    low, high = signal.minimum, signal.maximum
    if (low is not None and value < low) or (high is not None and value > high):
        unit = f" {signal.unit_name}" if signal.unit_name not in ("", "1") else ""
        lowest = "-inf" if low is None else f"{low:g}"
        highest = "inf" if high is None else f"{high:g}"
        raise DesatError(f"{where} = {value:g}{unit}: allowed is {lowest} to {highest}")
    return value


def assign(component: Component, name: str, value: Any, where: str) -> None:
    """Give a parameter (or input) its value, or the text of one that follows from others.

    A text for a Real is a product of parameters (`expression.py`), evaluated by `resolve`. Raises
    DesatError as `expand` does.
    """
    assert component.interface is not None
    signals = component.interface.elements(name)
    if isinstance(value, str) and signals and signals[0].kind == "Real":
        expand(component.interface, name, [s.start or 0.0 for s in signals], where)
        component.references[name] = value
        return
    component.parameters.update(expand(component.interface, name, value, where))
    component.references.pop(base_name(name), None)


def resolve(system: System) -> list[str]:
    """Evaluate what components have as `references`; what is wrong with them.

    A name alone stands for the whole array. Units are converted; a parameter in "1" takes the
    number in SI units whatever its unit (a gain matrix that is the inertia).
    """
    waiting = {
        (c.name, name): text
        for c in system.components.values() if c.interface is not None
        for name, text in c.references.items()
    }  # fmt: skip
    problems: list[str] = []
    while waiting:
        ready = [key for key, text in waiting.items() if not _named(text) & _names(waiting)]
        if not ready:
            chain = ", ".join(f'{c}.{n} = "{text}"' for (c, n), text in waiting.items())
            return [*problems, f"{system.where}: parameters name each other in a circle: {chain}"]
        known = table(system)
        for owner, name in ready:
            text = waiting.pop((owner, name))
            try:
                _evaluate(system.components[owner], name, text, known)
            except DesatError as error:
                problems.append(f"{system.where}: {owner}.{name}: {error}")
    return problems


def _named(text: str) -> set[str]:
    """The parameters that a product names, without their elements."""
    return {base_name(word) for word in text.replace("*", " ").replace("/", " ").split()}


def _names(waiting: Iterable[tuple[str, str]]) -> set[str]:
    """What a text would call these parameters."""
    return {f"{owner}.{name}" for c, name in waiting for owner in (c, "shared")}


def _evaluate(component: Component, name: str, text: str, known: Table) -> None:
    assert component.interface is not None
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
    scaled = [scale * x for x in values]
    component.parameters.update(expand(component.interface, name, scaled, component.name))


def value_of(component: Component, name: str) -> object:
    """The value of a parameter: the scenario's, or the start value of its declaration."""
    assert component.interface is not None
    signal = component.interface.signals[name]
    return component.parameters.get(name, signal.start)


def table(system: System) -> dict[str, dict[str, Any]]:
    """Every parameter of every component: value, unit, and whether the scenario gave it."""
    parameters: dict[str, dict[str, Any]] = {}
    for c in system.components.values():
        for s in c.interface.signals.values() if c.interface else ():
            if s.causality != "parameter" and s.name not in c.parameters:
                continue
            value = value_of(c, s.name)
            row = parameters.setdefault(c.name, {}).setdefault(
                base_name(s.name),
                {"value": [], "unit": s.unit_name, "given": False, "text": s.description},
            )
            named = s.choices[value] if s.choices and isinstance(value, int) else value
            row["value"] = named if s.name == base_name(s.name) else [*row["value"], named]
            row["given"] = row["given"] or s.name in c.parameters
    return parameters


def in_unit_of(signal: Signal, value: Scalar, unit: Unit) -> Scalar:
    """A value given in `unit` in the unit of its variable. Raises DesatError where it does not
    fit."""
    if signal.unit is None or isinstance(value, bool):
        raise DesatError(f"{signal.name} has no unit, but its value was given with one")
    converted = conversion(unit, signal.unit)
    if converted is None:
        raise DesatError(f"the unit of {signal.name} = {value} does not fit {signal.unit_name}")
    return value if converted == (1.0, 0.0) else converted[0] * value + converted[1]


def parse_assignment(text: str) -> tuple[str, str, Any]:
    """`manager.k=1,2` -> ("manager", "k", [1, 2]). Raises DesatError for another form."""
    left, equals, right = text.partition("=")
    component, dot, name = left.strip().partition(".")
    if not (equals and dot and component and name and right.strip()):
        raise DesatError(f"--set {text}: the form is COMPONENT.VARIABLE=VALUE")
    return component, name, parse_value(right.strip())


def parse_value(text: str) -> Any:
    """A value from the command line: a TOML value, a comma list, or a bare word."""
    for candidate in (text, f"[{text}]") if "," in text else (text,):
        try:
            return tomllib.loads(f"x = {candidate}")["x"]
        except tomllib.TOMLDecodeError:
            continue
    if "," in text:
        return [parse_value(part.strip()) for part in text.split(",")]
    try:
        return float(text)  # "10." and ".5" are no TOML
    except ValueError:
        return text
