"""When each component of a system steps, where not all step alike.

A step may have inner steps: those components that hand means on to each other, and what feeds them
from them alone (an environment), step so many times within it, in parts that grow from its start
on, for a motor's torque bends most after a new command. All others step at their own rate, once in
so many whole steps, and hold what they give.

A component that is slower than another covers a window of its steps. It steps at the window's start
where its means are cut for faster receivers, and at its end where it takes the mean of a faster
source: then its other inputs are those of the window's start all the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import lcm

from .interface import Interface
from .model import System

GROWTH = 4.5
"""Of the widths of a step's parts: n of them grow by the n-th root of it from each to the next."""

Share = tuple[float, float]
"""Start and width of a part of a window, as shares of it."""


def graded(count: int) -> tuple[Share, ...]:
    """The parts of a step, the first the shortest."""
    widths = [GROWTH ** (i / count) for i in range(count)]
    edges = [0.0, *accumulate(widths)]
    return tuple((a / edges[-1], (b - a) / edges[-1]) for a, b in pairwise(edges))


@dataclass(frozen=True)
class Rates:
    """How often the components of a system step."""

    parts: tuple[Share, ...]
    """Of the master's step."""
    every: Mapping[str, int]
    """A component steps once in so many parts."""
    late: frozenset[str]
    """The components that step at the end of their window."""

    @property
    def cycle(self) -> int:
        """The number of steps after which all comes again."""
        return lcm(len(self.parts), *self.every.values()) // len(self.parts)

    def edge(self, part: int) -> float:
        """The time in steps at which a part begins, counted from the start of a cycle."""
        steps, i = divmod(part, len(self.parts))
        return steps + self.parts[i][0]

    def window(self, fast: int, slow: int) -> list[Share]:
        """The windows of `fast` parts within one of `slow` parts."""
        edges = [self.edge(i) / self.edge(slow) for i in range(0, slow + 1, fast)]
        return [(a, b - a) for a, b in pairwise(edges)]


@dataclass(frozen=True)
class Link:
    """A connection from an output that is a mean over the step, or the slope of one."""

    source: str
    target: str
    text: str


def rates(system: System, links: Sequence[Link]) -> tuple[Rates, list[str]]:
    """How often the components of a system step, and what cannot be done, a line each."""
    inner = system.parts
    decimation = {name: c.decimation for name, c in system.components.items()}
    if inner == 1:
        slow, problems = late(links, decimation)
        return Rates(graded(1), decimation, slow), problems
    group = _group(system, links)
    problems = [
        f"{name} has a decimation of {decimation[name]}, but is one of those that step {inner} "
        "times within a step (inner): only one of the two can be"
        for name in sorted(group) if decimation[name] != 1
    ]  # fmt: skip
    if not group:
        problems = [f"inner = {inner}, but no component hands means on to another"]
    every = {n: 1 if n in group else inner * d for n, d in decimation.items()}
    slow, more = late(links, every)
    return Rates(graded(inner), every, slow), problems + more


def _group(system: System, links: Iterable[Link]) -> set[str]:
    """The components that have inner steps."""
    group = {name for link in links for name in (link.source, link.target)}
    incoming: dict[str, set[str]] = {name: set() for name in system.components}
    outgoing: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        incoming[c.target].add(c.source)
        outgoing[c.source].add(c.target)
    while more := {
        name for name, c in system.components.items()
        if name not in group and _continuous(c.interface)
        and incoming[name] <= group and outgoing[name] & group
    }:  # fmt: skip
        group |= more
    return group


def _continuous(interface: Interface) -> bool:
    """Whether a component is none that takes samples."""
    return "sample_time" not in interface.signals


def late(links: Iterable[Link], every: Mapping[str, int]) -> tuple[frozenset[str], list[str]]:
    """The components that step at the end of their window, and what cannot be done, a line each.

    `every` gives each component's rate: it steps once in so many parts.
    """
    links = list(links)
    problems = [
        f"{x.text}: rates of 1 in {every[x.source]} and 1 in {every[x.target]} steps: one must be "
        "a multiple of the other, or the mean would not be handed on whole"
        for x in links
        if max(every[x.source], every[x.target]) % min(every[x.source], every[x.target])
    ]
    reasons = {x.target: x for x in links if every[x.source] < every[x.target]}
    todo = list(reasons)
    while todo:
        source = todo.pop()
        for x in links:
            if x.source == source and every[x.target] == every[source] and x.target not in reasons:
                reasons[x.target] = reasons[source]
                todo.append(x.target)
    problems += [
        f"{x.text}: {x.target} steps {every[x.source] // every[x.target]} times within the step of "
        f"{x.source}, which needs the mean over it first ({reasons[x.source].text}): give "
        f"{x.target} a decimation of {every[x.source]}, or {x.source} one of {every[x.target]}"
        for x in links
        if every[x.source] > every[x.target] and x.source in reasons
    ]
    return frozenset(reasons), list(dict.fromkeys(problems))
