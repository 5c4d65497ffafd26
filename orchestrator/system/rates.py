"""Which components of different rates can hand means on to each other, and when each then steps.

A component that steps once in n steps covers a window of n steps. It steps at the window's start
where its means are cut for faster receivers, and at its end where it takes the mean of a faster
source: then its other inputs are those of the window's start all the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Link:
    """A connection from an output that is a mean over the step."""

    source: str
    target: str
    text: str


def late(links: Iterable[Link], every: Mapping[str, int]) -> tuple[frozenset[str], list[str]]:
    """The components that step at the end of their window, and what cannot be done, a line each.

    `every` gives each component's rate: it steps once in so many steps.
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
