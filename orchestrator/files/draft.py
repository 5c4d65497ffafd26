"""Assemble a system: components, connections, and values that are assigned in order.

A craft, a scenario, a design and the options assign values in the same way: each
yields `Assignment`, and a later one replaces an earlier one.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from ..system.body import Body
from ..system.errors import DesatError, nearest
from ..system.expression import evaluate
from ..system.interface import OutputClass, base_name
from ..system.model import (
    ACCURACY,
    AUTO,
    About,
    Component,
    Connection,
    Fmu,
    Substeps,
    System,
)
from ..system.parameters import as_text, expand, is_quantity
from . import connect, library

SHARED = "shared"  # owner of a value for each component with a parameter of that name
# no component may have these names: series of times, parameters of all
RESERVED = ("time", SHARED)
# SI; no quantity of a spacecraft is larger, and its square and cube are finite
LARGEST = 1e40
MOST_STEPS = 1e12  # of a run: at a microsecond each they take eleven days


class Assignment(NamedTuple):
    """Value that a file or an option gives to a parameter or an input."""

    owner: str  # a component, or SHARED
    name: str  # of the variable or of one of its elements
    value: Any
    origin: str  # file and key, or option
    typed: str = ""  # the value as it was typed, which a String takes
    subject: str | None = None  # beginning of messages about it; None: the origin


@dataclass
class Draft:
    """System while it is assembled, of a craft or of an SSP file."""

    place: str  # the file, for messages
    name: str = ""
    title: str = ""
    components: dict[str, Component] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)
    start: float = 0.0  # s
    stop: float | None = None
    step: float | None = None
    substeps: Substeps = AUTO
    accuracy: float = ACCURACY
    output_classes: dict[str, OutputClass] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)  # of times and output classes
    about: About | None = None
    body: Body | None = None
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    # problems of values by component and variable, until another value replaces one
    refused: dict[tuple[str, str], str] = field(default_factory=dict)
    # warnings about times that the file lacks, which a scenario may give: step, stop
    guesses: dict[str, str] = field(default_factory=dict)
    # components whose wires are not yet compared with their FMU, and what put it there
    # ("": the file of the system)
    unchecked: dict[str, str] = field(default_factory=dict)

    def assign(self, assignments: Iterable[Assignment]) -> None:
        """Set parameters (or inputs) in order; what does not fit becomes a problem.

        Arrays of FMI 3.0 follow from the structural parameters, which come first.
        """
        assignments = list(assignments)
        if any(c.interface.structural for c in self.components.values()):
            assignments.sort(key=lambda given: not self._is_structural(given))
        for given in assignments:
            for component in self._owners(given):
                try:
                    assign_value(component, given)
                except DesatError as error:
                    self.problems.append(str(error))
                self.refused.pop((component.name, base_name(given.name)), None)
                if given.name in component.interface.structural:
                    self.resize(component)

    def _is_structural(self, given: Assignment) -> bool:
        """Return whether a value is that of a structural parameter."""
        component = self.components.get(given.owner)
        return component is not None and given.name in component.interface.structural

    def _owners(self, given: Assignment) -> list[Component]:
        """Return the components to which a value applies; none is a problem."""
        components = self.components.values()
        if given.owner != SHARED:
            if given.owner in self.components:
                return [self.components[given.owner]]
            text = (
                f": no component {given.owner}{nearest(given.owner, self.components)}"
            )
            if not any(line.endswith(text) for line in self.problems):
                self.problems.append(given.origin + text)
            return []
        owners = [c for c in components if given.name in c.interface.elements]
        if not owners:
            parameter_names = {
                s.array for c in components for s in c.interface.parameters
            }
            hint = nearest(given.name, parameter_names)
            self.problems.append(
                f"{given.origin}: no component has a parameter {given.name}{hint}"
            )
        return owners

    def resize(self, component: Component) -> None:
        """Let the arrays of a component follow from its structural parameters."""
        if component.fmu is None:
            return
        sizes = {
            name: int(value)
            for name, value in component.parameters.items()
            if name in component.interface.structural
        }
        interface = component.fmu.sized(sizes)
        self.components[component.name] = replace(component, interface=interface)

    def complete(self) -> System | None:
        """Build the system, or return None if there are `problems`.

        Parameters that are products of others are evaluated, also where the system has
        problems, so that the components can be compared with what a scenario names.
        """
        self.problems += _name_problems(self)
        if self.unchecked:
            connect.check_connectors(self)
        references = {
            (name, parameter): text
            for name, component in self.components.items()
            for parameter, text in component.references.items()
        }
        self.components, wrong, unsure = evaluate(
            self.components, references, self.place
        )
        self.problems += [*self.refused.values(), *wrong]
        self.warnings += unsure
        self.problems += _too_large(self)
        connections = tuple(self.connections)
        if self.unchecked:
            connections = connect.check_connections(self)
        self.problems = list(dict.fromkeys(self.problems))
        self.warnings += self.guesses.values()
        self.guesses = {}
        try:
            step, stop = _times(self)
        except DesatError as error:
            self.problems.append(str(error))
        if self.problems:
            return None
        return System(
            self.name,
            self.place,
            self.components,
            connections,
            step,
            stop,
            self.start,
            self.substeps,
            self.accuracy,
            self.output_classes,
            self.about,
            self.body,
        )

    def system(self) -> System:
        """Build the system.

        Raises
        ------
        DesatError
            If there are problems, with a line for each.
        """
        system = self.complete()
        if system is None:
            raise DesatError("\n".join(self.problems))
        return system


def assign_value(component: Component, given: Assignment) -> None:
    """Set a parameter of a component to a value, or to a text that refers to others.

    A text for a Real is a product of parameters (`system/expression.py`).

    Raises
    ------
    DesatError
        If the value does not fit (`expand`).
    """
    interface, name, value = component.interface, given.name, given.value
    subject = given.origin if given.subject is None else given.subject
    at = f"{subject}: {component.name}" if subject else component.name
    signals = interface.elements.get(name, ())
    kind = signals[0].kind if signals else ""
    if kind == "Real" and isinstance(value, str) and not is_quantity(value):
        expand(interface, name, [s.start or 0.0 for s in signals], at)
        component.references[name] = value
    else:
        if given.typed and kind == "String":
            value = as_text(value, given.typed, len(signals))
        component.parameters.update(expand(interface, name, value, at, typed=True))
        component.references.pop(base_name(name), None)
    component.origins[base_name(name)] = given.origin


def component_of(
    name: str,
    source: str,
    fmu: Fmu | None,
    blocks: bool,
    is_foreign: bool = False,
    **facts: Any,
) -> Component:
    """Create a component from its FMU or, with `blocks`, from the bare block of its name.

    It begins with the start values of its FMU. `facts` are further fields.

    Raises
    ------
    DesatError
        If there is no such FMU or block.
    """
    interface = library.interface_of(source, fmu, blocks, is_foreign)
    if blocks:
        fmu = None
    start_values = {} if fmu is None else dict(fmu.start_values)
    return Component(name, source, interface, start_values, fmu, **facts)


def _name_problems(draft: Draft) -> Iterator[str]:
    """Find component names with which no name of a series can begin."""
    for c in draft.components.values():
        bad = set("./[]*?=") & set(c.name)
        if bad or not c.name.strip() or not c.name.isprintable() or c.name in RESERVED:
            yield (
                f"{draft.place}:{c.line}: component {c.name!r}: a name is needed without . / ["
                f" ] * ? = and other than {', '.join(RESERVED)}"
            )


def _too_large(draft: Draft) -> Iterator[str]:
    """Find values of our roles that are too large for any quantity, a line each."""
    for component in draft.components.values():
        if not component.interface.role:
            continue
        for name, value in component.parameters.items():
            if isinstance(value, float) and not abs(value) <= LARGEST:
                place = component.origins.get(base_name(name), draft.place)
                yield (
                    f"{place}: {component.name}.{name} = {value:g}: a magnitude of at most "
                    f"{LARGEST:g} is needed"
                )


def _times(draft: Draft) -> tuple[float, float]:
    """Return step and stop time (s).

    Raises
    ------
    DesatError
        If the number of steps from start to stop is not whole, or is too large.
    """
    start, step, stop = draft.start, draft.step, draft.stop
    if step is None or stop is None:
        missing = "step" if step is None else "stop time"
        raise DesatError(
            f"{draft.place}: no {missing} is given; use --{missing.split()[0]}"
        )
    by_step, by_stop = (draft.origins.get(key, draft.place) for key in ("step", "stop"))
    both = by_step if by_step == by_stop else f"{by_stop}, {by_step}"
    if not (math.isfinite(step) and step > 0.0):
        raise DesatError(f"{by_step}: step {step:g} s; a positive number is needed")
    span = (stop - start) / step
    if not 1.0 - 1e-9 <= span < math.inf:
        raise DesatError(
            f"{both}: no step of {step:g} s from {start:g} s to {stop:g} s"
        )
    if span >= MOST_STEPS:
        raise DesatError(
            f"{both}: {span:.3g} steps of {step:g} s; at most {MOST_STEPS:g} are made"
        )
    if start + step == start or stop - step == stop:
        raise DesatError(
            f"{both}: from {start:g} s to {stop:g} s, time does not grow by a step of "
            f"{step:g} s"
        )
    if abs(span - round(span)) > 1e-6:
        raise DesatError(
            f"{both}: {stop - start:g} s is not a multiple of the step {step:g} s"
        )
    return step, stop
