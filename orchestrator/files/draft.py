"""Assemble a system: components, connections, and values that are assigned in order.

A craft, a scenario, a design and the options assign values in the same way: each
yields `Assignment`, and a later one replaces an earlier one.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from desat.fmus import registry

from ..system.body import Body
from ..system.errors import DesatError, nearest
from ..system.interface import OutputClass, base_name
from ..system.model import (
    ACCURACY,
    AUTO,
    About,
    Component,
    Connection,
    Fmu,
    Substeps,
)
from ..system.parameters import as_text, expand, is_quantity
from . import library

SHARED = "shared"  # owner of a value for each component with a parameter of that name


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
    # how many wheels and nozzles the craft has, if not the usual number
    sizes: dict[str, int] = field(default_factory=dict)
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    # problems of values by component and variable, until another value replaces one
    refused: dict[tuple[str, str], str] = field(default_factory=dict)
    # warnings about times that the file lacks, which a scenario may give: step, stop
    guesses: dict[str, str] = field(default_factory=dict)
    # components whose wires are not yet compared with their FMU, and what put it there
    # ("": the file of the system)
    unchecked: dict[str, str] = field(default_factory=dict)

    def of_ours(self, name: str) -> tuple[str, Fmu | None]:
        """Return file in an archive and FMU of one of our blocks, with this craft's sizes."""
        is_usual = not self.sizes or name not in registry.names()
        sizes = () if is_usual else registry.sizes_of(name, self.sizes)
        source = f"resources/{registry.sized_name(name, sizes)}.fmu"
        return source, library.of_block(name, sizes)

    def assign(self, assignments: Iterable[Assignment]) -> None:
        """Set parameters (or inputs) in order; what does not fit becomes a problem.

        Arrays of FMI 3.0 follow from the structural parameters, which come first.
        """
        assignments = list(assignments)
        if any(c.interface.structural for c in self.components.values()):
            assignments.sort(key=lambda assignment: not self._is_structural(assignment))
        for assignment in assignments:
            for component in self._owners(assignment):
                try:
                    assign_value(component, assignment)
                except DesatError as error:
                    self.problems.append(str(error))
                self.refused.pop((component.name, base_name(assignment.name)), None)
                if assignment.name in component.interface.structural:
                    self.resize(component)

    def _is_structural(self, assignment: Assignment) -> bool:
        """Return whether a value is that of a structural parameter."""
        component = self.components.get(assignment.owner)
        return (
            component is not None and assignment.name in component.interface.structural
        )

    def _owners(self, assignment: Assignment) -> list[Component]:
        """Return the components to which a value applies; none is a problem."""
        components = self.components.values()
        if assignment.owner != SHARED:
            if assignment.owner in self.components:
                return [self.components[assignment.owner]]
            text = f": no component {assignment.owner}{nearest(assignment.owner, self.components)}"
            if not any(line.endswith(text) for line in self.problems):
                self.problems.append(assignment.origin + text)
            return []
        owners = [c for c in components if assignment.name in c.interface.elements]
        if not owners:
            parameter_names = {
                s.array for c in components for s in c.interface.parameters
            }
            hint = nearest(assignment.name, parameter_names)
            self.problems.append(
                f"{assignment.origin}: no component has a parameter {assignment.name}{hint}"
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


def assign_value(component: Component, assignment: Assignment) -> None:
    """Set a parameter of a component to a value, or to a text that refers to others.

    A text for a Real is a product of parameters (`system/expression.py`).

    Raises
    ------
    DesatError
        If the value does not fit (`expand`).
    """
    interface, name, value = component.interface, assignment.name, assignment.value
    subject = assignment.origin if assignment.subject is None else assignment.subject
    at = f"{subject}: {component.name}" if subject else component.name
    signals = interface.elements.get(name, ())
    kind = signals[0].kind if signals else ""
    if kind == "Real" and isinstance(value, str) and not is_quantity(value):
        expand(interface, name, [s.start or 0.0 for s in signals], at)
        component.references[name] = value
    else:
        if assignment.typed and kind == "String":
            value = as_text(value, assignment.typed, len(signals))
        component.parameters.update(expand(interface, name, value, at, typed=True))
        component.references.pop(base_name(name), None)
    component.origins[base_name(name)] = assignment.origin


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
