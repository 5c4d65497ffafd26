"""What a system leaves open: inputs that keep their default, outputs that reach nobody, and the
parameters that have no effect for want of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .interface import Signal, base_name
from .model import Component, System


@dataclass(frozen=True)
class Unwired:
    """A component's inputs that keep their default and outputs that reach nobody, by name."""

    inputs_at_default: tuple[str, ...]
    outputs_unread: tuple[str, ...]

    def text(self, component: str) -> str:
        """A line for people; empty where there is nothing to say."""
        parts = [
            f"{what}: {', '.join(names)}"
            for what, names in (
                ("inputs at their default", self.inputs_at_default),
                ("outputs that reach nobody", self.outputs_unread),
            )
            if names
        ]
        return f"{component}: {'; '.join(parts)}" if parts else ""


def unwired(system: System) -> dict[str, Unwired]:
    """What each component leaves open. `fault` is for the master and counts nowhere."""
    wired = {(c.target, base_name(c.input)) for c in system.connections}
    read = {(c.source, base_name(c.output)) for c in system.connections}
    result = {}
    for c in system.components.values():
        given = {base_name(name) for name in c.parameters}
        inputs = dict.fromkeys(base_name(s.name) for s in c.interface.of("input"))
        outputs = dict.fromkeys(base_name(s.name) for s in c.interface.of("output"))
        result[c.name] = Unwired(
            tuple(n for n in inputs if (c.name, n) not in wired and n not in given),
            tuple(n for n in outputs if (c.name, n) not in read and n != "fault"),
        )
    return result


def without_effect(system: System, open_ends: dict[str, Unwired]) -> Iterator[str]:
    """An error a parameter (or wired input) and each variable that it needs and that is open."""
    wired = {(c.target, base_name(c.input)) for c in system.connections}
    for c in system.components.values():
        mine = open_ends[c.name]
        needed_by = {base_name(s.name): s.needed_by for s in c.interface.signals.values()}
        for name in (*mine.inputs_at_default, *mine.outputs_unread):
            for other in needed_by[name]:
                if (c.name, other) in wired:
                    user = f"{c.name}.{other} is wired and"
                elif any(_values(c, c.interface.elements(other))):
                    user = f"{c.name}.{other}{_value_text(c, other)}"
                else:
                    continue
                lack = (
                    "which is neither wired nor given"
                    if name in mine.inputs_at_default
                    else "an output that reaches nobody"
                )
                yield f"{system.where}: {user} needs {name}, {lack}"


def _values(c: Component, signals: list[Signal]) -> list[object]:
    return [c.parameters.get(s.name, s.start) for s in signals]


def _value_text(c: Component, name: str) -> str:
    """` = value` of a scalar, a choice by its name; nothing for an array."""
    signal = c.interface.signals.get(name)
    if signal is None:
        return ""
    value = _values(c, [signal])[0]
    if not signal.choices and isinstance(value, bool):
        return f" = {str(value).lower()}"
    return f" = {signal.named(value)}"
