"""When each component steps and when each connection moves: the conserving master's order.

The order follows from the interval connections alone; names break ties, so the listing order of
an SSD does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

from .errors import DesatError
from .interface import OutputClass, Signal, base_name
from .model import Connection, System
from .rates import Link, Rates, rates

AT, OVER, LATE, START = "at t_k", "over the step", "one step late", "at the start"


@dataclass(frozen=True)
class Schedule:
    """The stepping order, the class of every output, the rates of the components, and the timing of
    every connection."""

    order: tuple[str, ...]
    classes: dict[tuple[str, str], OutputClass]
    rates: Rates
    timing: tuple[tuple[Connection, str], ...]
    warnings: tuple[str, ...] = ()
    """What different rates cost."""


def output_class(system: System, component: str, signal: Signal) -> OutputClass:
    """The class of an output: a scenario's override, else what its component declares."""
    for name in (signal.name, base_name(signal.name)):
        if override := system.output_classes.get(f"{component}.{name}"):
            return override
    return signal.output_class


def schedule(system: System) -> Schedule:
    """Order the components. Raises DesatError, with the chain, where the interval connections go
    in a circle, and where means cannot be handed on between components of different rates."""
    classes: dict[tuple[str, str], OutputClass] = {}
    for name, component in system.components.items():
        for signal in component.interface.of("output"):
            classes[name, signal.name] = output_class(system, name, signal)
    before: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        if classes[c.source, c.output] == "interval":
            before[c.target].add(c.source)
    order = _order(before)
    if len(order) < len(before):
        waiting = {name: needs for name, needs in before.items() if name not in set(order)}
        raise DesatError(_circle(system, waiting, classes))
    means = {
        c: None for c in system.connections if _is_mean(system, c, classes[c.source, c.output])
    }
    paces, problems = rates(system, [Link(c.source, c.target, str(c)) for c in means])
    if problems:
        raise DesatError("\n".join(f"{system.where}: {text}" for text in problems))
    timing = tuple(
        (c, START if system.components[c.target].interface.signals[c.input].initial
            else _timing(c, classes[c.source, c.output], c in means, paces))
        for c in system.connections
    )  # fmt: skip
    return Schedule(tuple(order), classes, paces, timing, tuple(_warnings(means, timing)))


def _order(before: dict[str, set[str]]) -> list[str]:
    """The names, each after those before it, else by the alphabet; without those in a circle."""
    after: dict[str, list[str]] = {name: [] for name in before}
    open_ends = {name: len(needs) for name, needs in before.items()}
    for name, needs in before.items():
        for need in needs:
            after[need].append(name)
    ready, order = [name for name, count in open_ends.items() if not count], []
    heapify(ready)
    while ready:
        order.append(heappop(ready))
        for name in after[order[-1]]:
            open_ends[name] -= 1
            if not open_ends[name]:
                heappush(ready, name)
    return order


def _is_mean(system: System, c: Connection, output_class: OutputClass) -> bool:
    """Whether a connection carries a mean over the step, or the slope of one."""
    interface = system.components[c.source].interface
    return output_class == "interval" and (
        interface.signals[c.output].mean or c.output in interface.slopes
    )


def _timing(c: Connection, output_class: OutputClass, mean: bool, paces: Rates) -> str:
    source, target = paces.every[c.source], paces.every[c.target]
    if mean and source < target:
        return f"mean of {target // source} {_steps(paces, target)}"
    if mean and source > target:
        return f"its part of {source // target} {_steps(paces, source)}"
    if output_class == "interval" and source < target:
        return f"one of {target // source} values"
    if source > max(target, len(paces.parts)):
        return f"held for {source // max(target, len(paces.parts))} steps"
    if c.source in paces.late and output_class == "interval" and c.target not in paces.late:
        return LATE
    return {"interval": OVER, "state": AT, "undeclared": LATE}[output_class]


def _steps(paces: Rates, window: int) -> str:
    return "inner steps" if window <= len(paces.parts) else "steps"


def _warnings(
    means: Iterable[Connection], timing: Iterable[tuple[Connection, str]]
) -> Iterator[str]:
    """Values that are held, or of which some are left out, between components that exchange
    means: what is exchanged is conserved all the same, but is less exact."""
    exchanging = {c.source for c in means} | {c.target for c in means}
    lines: dict[tuple[str, str, str], list[str]] = {}
    for c, text in timing:
        if text.startswith(("held", "one of")) and {c.source, c.target} <= exchanging:
            outputs = lines.setdefault((c.source, c.target, text), [])
            outputs.append(base_name(c.output))
    for (source, target, text), outputs in lines.items():
        listed = ", ".join(f"{source}.{name}" for name in dict.fromkeys(outputs))
        yield f"{target} takes {listed}: {text}, which costs accuracy (decimation)"


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
