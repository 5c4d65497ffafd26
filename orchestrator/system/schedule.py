"""Compute when each component steps and each connection moves, under gauss_seidel.

The order follows from the interval connections alone. Ties are broken by name, so that
the order of components in an SSD does not matter.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from graphlib import CycleError, TopologicalSorter
from heapq import heappop, heappush
from itertools import accumulate, pairwise
from math import lcm

from .errors import DesatError
from .interface import Interface, OutputClass, Signal, base_name
from .model import Connection, System

# --- When each component of a system steps, if their rates differ -------------------------------
# A step may have substeps. Components that exchange means, and those that feed them and take
# inputs from them alone (an environment), step several times within it. The parts of a step become
# longer towards its end, because a motor's torque changes most after a new command. All other
# components step at their own rate, once in a number of whole steps, and hold their outputs.
#
# A component that is slower than another covers a window of the other's steps. It steps at the
# window's start if its means are cut for faster receivers, and at its end if it takes the mean of
# a faster source; in both cases its other inputs are those of the window's start.


GROWTH = 4.5  # n parts of a step grow by the n-th root of this from each to the next

Share = tuple[float, float]  # start and width of a part of a window, as shares of it


def graded(count: int) -> tuple[Share, ...]:
    """Compute start and width of `count` parts of a step, as shares of it.

    The first part is the shortest.
    """
    widths = [GROWTH ** (i / count) for i in range(count)]
    edges = [0.0, *accumulate(widths)]
    return tuple((a / edges[-1], (b - a) / edges[-1]) for a, b in pairwise(edges))


@dataclass(frozen=True)
class StepRates:
    """Rates at which the components of a system step."""

    parts: tuple[Share, ...]  # of the master's step
    every: Mapping[str, int]  # parts for each step of a component
    late: frozenset[str]  # components that step at the end of their window

    @property
    def cycle(self) -> int:
        """Return the number of steps after which the pattern of steps repeats."""
        return lcm(len(self.parts), *self.every.values()) // len(self.parts)

    def edge(self, part: int) -> float:
        """Return when a part begins, in steps from the start of a cycle."""
        steps, i = divmod(part, len(self.parts))
        return steps + self.parts[i][0]

    def window(self, fast: int, slow: int) -> list[Share]:
        """Return the windows of `fast` parts within one of `slow` parts, as shares."""
        edges = [self.edge(i) / self.edge(slow) for i in range(0, slow + 1, fast)]
        return [(a, b - a) for a, b in pairwise(edges)]


def rates(system: System, links: Sequence[Connection]) -> tuple[StepRates, list[str]]:
    """Compute the components' rates, and a line for each conflict between them."""
    substeps = system.parts
    step_ratio = {name: c.step_ratio for name, c in system.components.items()}
    if substeps == 1:
        slow, problems = late(links, step_ratio)
        return StepRates(graded(1), step_ratio, slow), problems
    group = _group(system, links)
    problems = [
        f"{name} has a step ratio of {step_ratio[name]}, but is one of those that step {substeps} "
        "times within a step (substeps): only one of the two can be"
        for name in sorted(group)
        if step_ratio[name] != 1
    ]
    if not group:
        problems = [
            f"substeps = {substeps}, but no component exchanges step averages with another"
        ]
    every = {n: 1 if n in group else substeps * d for n, d in step_ratio.items()}
    slow, more = late(links, every)
    return StepRates(graded(substeps), every, slow), problems + more


def _group(system: System, links: Iterable[Connection]) -> set[str]:
    """Find the components that have substeps."""
    group = {name for link in links for name in (link.source, link.target)}
    incoming: dict[str, set[str]] = {name: set() for name in system.components}
    outgoing: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        incoming[c.target].add(c.source)
        outgoing[c.source].add(c.target)
    while more := {
        name
        for name, c in system.components.items()
        if name not in group
        and _continuous(c.interface)
        and incoming[name] <= group
        and outgoing[name] & group
    }:
        group |= more
    return group


def _continuous(interface: Interface) -> bool:
    """Return whether a component takes no samples."""
    return "sample_time" not in interface.signals


def late(
    links: Iterable[Connection], every: Mapping[str, int]
) -> tuple[frozenset[str], list[str]]:
    """Find the components that step at the end of their window, and conflicts.

    There is one line for each conflict. `every` gives each component's rate: it steps
    once in that many parts.
    """
    links = list(links)
    problems = [
        f"{x}: rates of 1 in {every[x.source]} and 1 in {every[x.target]} steps: one must be "
        "a multiple of the other, or the exchanged average would be incomplete"
        for x in links
        if max(every[x.source], every[x.target]) % min(every[x.source], every[x.target])
    ]
    reasons = {x.target: x for x in links if every[x.source] < every[x.target]}
    todo = list(reasons)
    while todo:
        source = todo.pop()
        for x in links:
            if (
                x.source == source
                and every[x.target] == every[source]
                and x.target not in reasons
            ):
                reasons[x.target] = reasons[source]
                todo.append(x.target)
    problems += [
        f"{x}: {x.target} steps {every[x.source] // every[x.target]} times within the step of "
        f"{x.source}, which needs the mean over it first ({reasons[x.source]}): give "
        f"{x.target} a step ratio of {every[x.source]}, or {x.source} one of {every[x.target]}"
        for x in links
        if every[x.source] > every[x.target] and x.source in reasons
    ]
    return frozenset(reasons), list(dict.fromkeys(problems))


AT, OVER, LATE, START = "at t_k", "over the step", "one step late", "at the start"


@dataclass(frozen=True)
class Schedule:
    """Stepping order, class of every output, rates and timing of every connection."""

    order: tuple[str, ...]
    classes: dict[tuple[str, str], OutputClass]
    rates: StepRates
    timing: tuple[tuple[Connection, str], ...]
    warnings: tuple[str, ...] = ()
    """Loss of accuracy by different rates, and undeclared dependencies."""
    loops: tuple[tuple[str, ...], ...] = ()
    """Components whose outputs depend on each other at once: algebraic loops."""
    start_loops: tuple[tuple[str, ...], ...] = ()
    """The same at the start, where what is not declared depends on every input."""


def output_class(system: System, component: str, signal: Signal) -> OutputClass:
    """Return the class of an output.

    A scenario's override takes precedence over the component's declaration.
    """
    for name in (signal.name, signal.array):
        if override := system.output_classes.get(f"{component}.{name}"):
            return override
    return signal.output_class


def schedule(system: System, breaks_loops: bool = False) -> Schedule:
    """Order the components by their interval connections.

    Parameters
    ----------
    system
        The system.
    breaks_loops
        Whether interval connections may form a cycle: their values are then those of
        the step's beginning, also of outputs that declare no dependencies.

    Raises
    ------
    DesatError
        If the interval connections form a cycle (with its chain), or if means cannot be
        handed on between components of different rates.
    """
    classes: dict[tuple[str, str], OutputClass] = {}
    for name, component in system.components.items():
        for signal in component.interface.outputs:
            classes[name, signal.name] = output_class(system, name, signal)
    silent = {key for key, of in classes.items() if of == "undeclared"}
    classes |= dict.fromkeys(silent, "interval")
    before = _before(system, classes)
    order = _order(before)
    if silent and not breaks_loops and len(order) < len(before):
        late = {
            (c.source, c.output)
            for c in system.connections
            if (c.source, c.output) in silent and _reaches(before, c.source, c.target)
        }
        classes |= dict.fromkeys(late, "undeclared")
        before = _before(system, classes)
        order = _order(before)
    loops: tuple[tuple[str, ...], ...] = ()
    if len(order) < len(before):
        waiting = {
            name: needs for name, needs in before.items() if name not in set(order)
        }
        if not breaks_loops:
            raise DesatError(_circle(system, waiting, classes))
        loops = _loops(waiting)
        for c in system.connections:
            is_within = any({c.source, c.target} <= {*loop} for loop in loops)
            if is_within and classes[c.source, c.output] == "interval":
                classes[c.source, c.output] = "undeclared"
        before = _before(system, classes)
        order = _order(before)
        in_loops = {name for loop in loops for name in loop}
        silent = {key for key in silent if key[0] not in in_loops}
    start_loops = loops
    if silent or loops or system.output_classes:
        start_loops = _loops_at_start(system, classes)
    means = {
        c: None
        for c in system.connections
        if _is_mean(system, c, classes[c.source, c.output])
    }
    paces, problems = rates(system, list(means))
    if problems:
        raise DesatError("\n".join(f"{system.place}: {text}" for text in problems))
    timing = tuple(
        (
            c,
            START
            if system.components[c.target].interface.signals[c.input].initial
            else _timing(c, classes[c.source, c.output], c in means, paces),
        )
        for c in system.connections
    )
    warnings = (
        *_undeclared(system, silent, classes),
        *_warnings(means, timing),
        *(
            f"{system.place}: algebraic loop of {', '.join(loop)}: what they exchange is "
            "that of the step's beginning"
            for loop in loops
        ),
    )
    return Schedule(tuple(order), classes, paces, timing, warnings, loops, start_loops)


def _loops_at_start(
    system: System, classes: Mapping[tuple[str, str], OutputClass]
) -> tuple[tuple[str, ...], ...]:
    """Return the algebraic loops at the start.

    There an output depends on inputs as its FMU declares, and on all of them where it
    declares nothing, whatever the class for which steps take it.
    """
    dependent: dict[tuple[str, str], OutputClass] = {
        (name, s.name): "interval"
        for name, component in system.components.items()
        for s in component.interface.outputs
        if s.output_class != "state" or classes[name, s.name] == "interval"
    }
    before = _before(system, {**dict.fromkeys(classes, "state"), **dependent})
    ordered = set(_order(before))
    return _loops({n: needs for n, needs in before.items() if n not in ordered})


def _loops(waiting: Mapping[str, set[str]]) -> tuple[tuple[str, ...], ...]:
    """Return the components of each cycle; cycles with a common one are one."""
    needs_of = {name: needs & waiting.keys() for name, needs in waiting.items()}
    in_loops = {
        tuple(
            sorted(
                other
                for other in needs_of
                if _reaches(needs_of, name, other) and _reaches(needs_of, other, name)
            )
        )
        for name in needs_of
    }
    return tuple(
        sorted(
            loop for loop in in_loops if len(loop) > 1 or loop[0] in needs_of[loop[0]]
        )
    )


def _before(
    system: System, classes: Mapping[tuple[str, str], OutputClass]
) -> dict[str, set[str]]:
    """Return the components whose interval outputs each component takes."""
    before: dict[str, set[str]] = {name: set() for name in system.components}
    for c in system.connections:
        if classes[c.source, c.output] == "interval":
            before[c.target].add(c.source)
    return before


def _reaches(before: Mapping[str, set[str]], name: str, start: str) -> bool:
    """Check whether interval outputs of `name` depend on the component `start`.

    If they do, a connection from `name` back to it would close a cycle.
    """
    components_seen, todo = {name}, [name]
    while todo:
        for other in before[todo.pop()] - components_seen:
            components_seen.add(other)
            todo.append(other)
    return start in components_seen


def _undeclared(
    system: System,
    silent: Iterable[tuple[str, str]],
    classes: Mapping[tuple[str, str], OutputClass],
) -> Iterator[str]:
    """Describe the assumed class of outputs whose dependencies are not declared.

    Such outputs may depend on all inputs (FMI 2.0.4, section 2.2.8), so they are taken
    over the step, or one step late if that would close a cycle.
    """
    read = {(c.source, c.output) for c in system.connections}
    lines: dict[tuple[str, OutputClass], list[str]] = {}
    for name, output in sorted(read & set(silent)):
        lines.setdefault((name, classes[name, output]), []).append(base_name(output))
    for (name, of), outputs in lines.items():
        listed = ", ".join(dict.fromkeys(outputs))
        taken = (
            "over the step"
            if of == "interval"
            else "one step late, as they close a circle"
        )
        other = "state" if of == "interval" else "interval"
        yield (
            f"{system.place}: {name} declares no dependencies: {listed} may depend on every "
            f"input and are taken {taken}; otherwise: --output-class {name}.{outputs[0]}="
            f"{other}"
        )


def _order(before: dict[str, set[str]]) -> list[str]:
    """Sort the names after their predecessors, then alphabetically, without cycles."""
    sorter = TopologicalSorter(before)
    with suppress(CycleError):
        sorter.prepare()
    ready: list[str] = []
    order: list[str] = []
    while sorter.is_active():
        for name in sorter.get_ready():
            heappush(ready, name)
        if not ready:
            break  # the rest is in a cycle, or after one
        order.append(heappop(ready))
        sorter.done(order[-1])
    return order


def _is_mean(system: System, c: Connection, output_class: OutputClass) -> bool:
    """Return whether a connection carries a mean over the step, or its slope."""
    interface = system.components[c.source].interface
    return output_class == "interval" and (
        interface.signals[c.output].mean or c.output in interface.slopes
    )


def _timing(
    c: Connection, output_class: OutputClass, mean: bool, paces: StepRates
) -> str:
    """Describe when a connection moves its value."""
    source, target = paces.every[c.source], paces.every[c.target]
    if mean and source < target:
        return f"mean of {target // source} {_steps(paces, target)}"
    if mean and source > target:
        return f"its part of {source // target} {_steps(paces, source)}"
    if output_class == "interval" and source < target:
        return f"one of {target // source} values"
    if source > max(target, len(paces.parts)):
        return f"held for {source // max(target, len(paces.parts))} steps"
    if (
        c.source in paces.late
        and output_class == "interval"
        and c.target not in paces.late
    ):
        return LATE
    return {"interval": OVER, "state": AT, "undeclared": LATE}[output_class]


def _steps(paces: StepRates, window: int) -> str:
    """Return the word for the unit of a window: substeps or steps."""
    return "substeps" if window <= len(paces.parts) else "steps"


def _warnings(
    means: Iterable[Connection], timing: Iterable[tuple[Connection, str]]
) -> Iterator[str]:
    """Warn of values that are held or left out between components exchanging means.

    The exchanged quantities are still conserved, but they are less accurate.
    """
    exchanging = {c.source for c in means} | {c.target for c in means}
    lines: dict[tuple[str, str, str], list[str]] = {}
    for c, text in timing:
        if text.startswith(("held", "one of")) and {c.source, c.target} <= exchanging:
            outputs = lines.setdefault((c.source, c.target, text), [])
            outputs.append(c.output_array)
    for (source, target, text), outputs in lines.items():
        listed = ", ".join(f"{source}.{name}" for name in dict.fromkeys(outputs))
        yield f"{target} takes {listed}: {text}, which costs accuracy (step_ratio)"


def _circle(
    system: System,
    waiting: dict[str, set[str]],
    classes: dict[tuple[str, str], OutputClass],
) -> str:
    """Format the message for a cycle: its chain and the line that would break it."""
    members = _cycle_of(waiting, min(waiting))
    links = []
    for source, target in zip(members, [*members[1:], members[0]], strict=True):
        connection = next(
            c
            for c in system.connections
            if (c.source, c.target) == (source, target)
            and classes[c.source, c.output] == "interval"
        )
        links.append(connection)
    text = " -> ".join(f"{c.source}.{c.output_array}" for c in links)
    late = f"{links[-1].source}.{base_name(links[-1].output)}"
    return (
        f"{system.place}: cycle over the step: {text} -> {members[0]}; to take one of them a "
        f"step late: --output-class {late}=state, or in a scenario's [output_classes]: "
        f'"{late}" = "state"; to take all of them late: --algorithm jacobi; to solve for '
        "them: --solve-loops"
    )


def _cycle_of(waiting: dict[str, set[str]], start: str) -> list[str]:
    """Find one cycle among the waiting components, in the direction of the signals."""
    path = [start]
    while True:
        previous = min(waiting[path[-1]] & set(waiting))
        if previous in path:
            cycle = path[path.index(previous) :][::-1]
            first = cycle.index(min(cycle))
            return cycle[first:] + cycle[:first]
        path.append(previous)
