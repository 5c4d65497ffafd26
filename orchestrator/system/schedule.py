"""When each component steps and when each connection moves: the conserving master's order.

The order follows from the interval connections alone; names break ties, so the listing order of
an SSD does not matter.
"""

from __future__ import annotations

from dataclasses import dataclass

from .errors import DesatError
from .interface import OutputClass, Signal, base_name
from .model import Connection, System

AT, OVER, LATE = "at t_k", "over the step", "one step late"


@dataclass(frozen=True)
class Schedule:
    """The stepping order, the class of every output, and the timing of every connection."""

    order: tuple[str, ...]
    classes: dict[tuple[str, str], OutputClass]
    timing: tuple[tuple[Connection, str], ...]


def output_class(system: System, component: str, signal: Signal) -> OutputClass:
    """The class of an output: a scenario's override, else what its component declares."""
    for name in (signal.name, base_name(signal.name)):
        if override := system.output_classes.get(f"{component}.{name}"):
            return override
    return signal.output_class


def schedule(system: System) -> Schedule:
    """Order the components. Raises DesatError, with the chain, where the interval connections go
    in a circle."""
    classes: dict[tuple[str, str], OutputClass] = {}
    for name, component in system.components.items():
        for signal in component.interface.of("output"):
            classes[name, signal.name] = output_class(system, name, signal)
    before: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        if classes[c.source, c.output] == "interval":
            before[c.target].add(c.source)
    order: list[str] = []
    waiting = dict(before)
    while waiting:
        ready = min((n for n, needs in waiting.items() if needs <= set(order)), default=None)
        if ready is None:
            raise DesatError(_circle(system, waiting, classes))
        order.append(ready)
        del waiting[ready]
    names = {"interval": OVER, "state": AT, "undeclared": LATE}
    timing = tuple((c, names[classes[c.source, c.output]]) for c in system.connections)
    return Schedule(tuple(order), classes, timing)


def _circle(
    system: System, waiting: dict[str, set[str]], classes: dict[tuple[str, str], OutputClass]
) -> str:
    """The message for a circle: its chain and the line that would break it."""
    members = _cycle_of(waiting, min(waiting))
    links = []
    for source, target in zip(members, [*members[1:], members[0]], strict=True):
        connection = next(
            c for c in system.connections
            if (c.source, c.target) == (source, target)
            and classes[c.source, c.output] == "interval"
        )  # fmt: skip
        links.append(connection)
    text = " -> ".join(f"{c.source}.{base_name(c.output)}" for c in links)
    silent = sorted(
        {c.source for c in system.connections if classes[c.source, c.output] == "undeclared"}
        & set(members)
    )
    note = f"; {', '.join(silent)} declare no dependencies" if silent else ""
    example = f'"{links[-1].source}.{base_name(links[-1].output)}" = "state"'
    return (
        f"{system.where}: cycle over the step: {text} -> {members[0]}{note}; to take one of them a "
        f"step late, write under [output_classes]: {example}"
    )


def _cycle_of(waiting: dict[str, set[str]], start: str) -> list[str]:
    """One cycle among the waiting components, in the direction of the signals."""
    path = [start]
    while True:
        previous = min(waiting[path[-1]] & set(waiting))
        if previous in path:
            cycle = path[path.index(previous) :][::-1]
            first = cycle.index(min(cycle))
            return cycle[first:] + cycle[:first]
        path.append(previous)
