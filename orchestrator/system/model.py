"""Represent a system of components, which a master runs, as immutable data.

It may come from any kind of file: `files/build.py` builds a `System` from it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

from desat.components.contract.block import Block, Scalar
from desat.fmus.registry import block_class, names

from .body import Body
from .interface import Interface, OutputClass, Signal, base_name

J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)  # origin of `epoch_j2000`
AUTO: Literal["auto"] = "auto"
# Substeps within a step; with `auto` a run chooses them (`runs/substep_choice.py`).
Substeps = int | Literal["auto"]
MOST_SUBSTEPS = 1000
# rad: default tolerance of the attitude error when a run chooses its substeps.
ACCURACY = 1e-7

# Values of a component's parameters by name, arrays as lists.
Values = Mapping[str, Any]


@dataclass(frozen=True)
class Connector:
    """Connector that an SSD lists."""

    name: str
    kind: str  # input, output, parameter, ...
    type: str  # Real, Integer, Boolean, ...
    unit: str = ""
    line: int = 0


@dataclass(frozen=True)
class Connection:
    """Connection from an output to an input: target = factor * source + offset."""

    source: str
    output: str
    target: str
    input: str
    line: int = 0
    factor: float = 1.0
    offset: float = 0.0
    converts: bool = True  # False: units are not converted (suppressUnitConversion)
    # the variables of which output and input are elements
    output_array: str = field(init=False, repr=False, compare=False)
    input_array: str = field(init=False, repr=False, compare=False)
    # the series of the output, `component.variable`
    series: str = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "output_array", base_name(self.output))
        object.__setattr__(self, "input_array", base_name(self.input))
        object.__setattr__(self, "series", f"{self.source}.{self.output_array}")

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


class Fmu(Protocol):
    """Properties of an FMU.

    `files/library.py` reads them.
    """

    path: Path

    @property
    def sha256(self) -> str:
        """Return the sha256 of its file."""

    @property
    def ours(self) -> bool:
        """Return whether we built it."""

    @property
    def folder(self) -> Path:
        """Return the folder into which it is extracted."""

    @property
    def interface(self) -> Interface:
        """Return its variables."""

    @property
    def origin(self) -> str:
        """Return the sha256 of the FMU of ours that it is, but for start values."""

    @property
    def start_values(self) -> Mapping[str, Scalar]:
        """Return the values that a copy of one of ours starts with, by name."""

    def sized(self, sizes: Mapping[str, int]) -> Interface:
        """Return its variables where structural parameters have these values."""

    @property
    def description(self) -> Any:
        """Return its model description, parsed by fmpy."""

    @property
    def faults(self) -> tuple[str, ...]:
        """Return a line for each violation of the standard in its description."""

    @property
    def platforms(self) -> list[str]:
        """Return the platforms for which it has a library."""


@dataclass(frozen=True)
class Component:
    """Instance of an FMU or of a bare block."""

    name: str
    source: str
    interface: Interface
    # scalar values by element name, in the variable's own unit; may include inputs
    parameters: dict[str, Scalar] = field(default_factory=dict)
    fmu: Fmu | None = None  # None: it is the bare block of the interface's name
    step_ratio: int = 1  # steps of the master for each step of the component
    # connectors that an SSD lists
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    line: int = 0
    # source of a variable's value: name -> file and key, or option
    origins: dict[str, str] = field(default_factory=dict, compare=False, repr=False)
    # parameters that are given as products of others: `gain_matrix = "shared.inertia"`
    references: dict[str, str] = field(default_factory=dict, compare=False, repr=False)

    @cached_property
    def values(self) -> Values:
        """Return the value of each variable, in its own unit.

        It is the scenario's value, or the start value of the declaration. An array is
        found by its name, as the list of its elements, and each element by its own
        name.
        """
        table_of_values: dict[str, Any] = {}
        for name, signals in self.interface.arrays.items():
            values = [self.parameters.get(s.name, s.start) for s in signals]
            table_of_values.update(zip([s.name for s in signals], values, strict=True))
            if name not in table_of_values:
                table_of_values[name] = values
        return table_of_values

    @property
    def model(self) -> str:
        """Return the name of its block, or of its FMU's model."""
        return self.interface.model

    @cached_property
    def block(self) -> type[Block] | None:
        """Return the class of its block; None for an FMU that is not of ours."""
        if self.model not in names():
            return None
        return block_class(self.model, self.interface.sizes)

    def choice(self, name: str) -> str:
        """Return the choice of a parameter by its name.

        Without choices it is the value as text.
        """
        return str(self.interface.signals[name].named(self.values[name]))


@dataclass(frozen=True)
class Parameter:
    """Parameter of a component in the form that people read."""

    value: Any  # a number, a text, or a list of an array's elements
    unit: str
    given: bool = False  # whether the scenario gave it
    text: str = ""


def table(components: Iterable[Component]) -> dict[str, dict[str, Parameter]]:
    """Collect every parameter of every component."""
    parameters: dict[str, dict[str, Parameter]] = {}
    for c in components:
        elements: dict[str, list[Signal]] = {}
        for s in c.interface.signals.values():
            if s.causality == "parameter" or s.name in c.parameters:
                elements.setdefault(s.array, []).append(s)
        if elements:
            parameters[c.name] = {
                name: _parameter(c, name, of) for name, of in elements.items()
            }
    return parameters


def _parameter(component: Component, name: str, elements: list[Signal]) -> Parameter:
    """Build the readable form of a parameter, with choices by name."""
    set_values, first = component.parameters, elements[0]
    values = [set_values.get(s.name, s.start) for s in elements]
    if first.choices:
        values = [first.named(value) for value in values]
    is_given = not set_values.keys().isdisjoint([s.name for s in elements])
    value = values[0] if first.name == name else values
    return Parameter(value, first.unit_name, is_given, first.description)


class About(Protocol):
    """What a scenario defines besides its system, such as numbers and plots."""

    def as_json(self) -> Mapping[str, Any]:
        """Return it as JSON, for files."""

    def counted(self) -> Mapping[str, Any]:
        """Return the entries that affect bits and are not resolved into the system."""


@dataclass(frozen=True)
class System:
    """Components, connections and the experiment.

    `where` is the SSD, for messages.
    """

    name: str
    place: str
    components: Mapping[str, Component]
    connections: tuple[Connection, ...]
    step: float  # s; `stop` is a whole number of steps after `start`
    stop: float  # s
    start: float = 0.0  # s
    # steps, within each step, of components that exchange means (`schedule.py`)
    substeps: Substeps = 1
    accuracy: float = ACCURACY  # rad: attitude error for `substeps = "auto"`
    # overrides: `component.variable` -> class
    output_classes: Mapping[str, OutputClass] = field(default_factory=dict)
    # content of its scenario (`language/content.py`, `content_of`); None for a foreign
    # system
    about: About | None = None
    body: Body | None = None  # mass and sides, if its craft file gives them

    # substeps of a step; 1 as long as they are not chosen
    parts: int = field(init=False, repr=False, compare=False)
    # number of steps from start to stop
    steps: int = field(init=False, repr=False, compare=False)
    # the component of each role that is filled; of several the last
    roles: Mapping[str, Component] = field(init=False, repr=False, compare=False)
    # the connection of the first element of each wired input, by component and array
    fed: Mapping[tuple[str, str], Connection] = field(
        init=False, repr=False, compare=False
    )
    # the same by name of the input (an array) and component; empty if nothing is wired
    by_input: Mapping[str, Mapping[str, Connection]] = field(
        init=False, repr=False, compare=False
    )
    # the component that receives from a component at an input (an array); of several the
    # first
    takers: Mapping[tuple[str, str], str] = field(init=False, repr=False, compare=False)
    # the outputs that are read, by component and array
    read: Set[tuple[str, str]] = field(init=False, repr=False, compare=False)
    # what each analysis has found in it, by the key of the analysis
    parts_of_analyses: dict[str, Any] = field(
        init=False, repr=False, compare=False, default_factory=dict
    )

    def __post_init__(self) -> None:
        """Derive steps, roles and the tables of connections, once."""
        object.__setattr__(self, "parts", 1 if self.substeps == AUTO else self.substeps)
        object.__setattr__(self, "steps", round((self.stop - self.start) / self.step))
        roles = {
            c.interface.role: c for c in self.components.values() if c.interface.role
        }
        fed: dict[tuple[str, str], Connection] = {}
        takers: dict[tuple[str, str], str] = {}
        for c in self.connections:
            key = c.target, c.input_array
            if key not in fed or c.input.endswith("[1]"):
                fed[key] = c
            takers.setdefault((c.source, c.input_array), c.target)
        object.__setattr__(self, "roles", roles)
        by_input = defaultdict[str, dict[str, Connection]](dict)
        for (name, array), c in fed.items():
            by_input[array][name] = c
        object.__setattr__(self, "fed", fed)
        object.__setattr__(self, "by_input", by_input)
        object.__setattr__(self, "takers", takers)
        object.__setattr__(
            self, "read", {(c.source, c.output_array) for c in self.connections}
        )

    @cached_property
    def parameters(self) -> Mapping[str, Mapping[str, Parameter]]:
        """Return every parameter of every component, by component and name."""
        return table(self.components.values())
