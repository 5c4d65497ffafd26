"""A system of components: what a master runs, whichever file it came from. Nothing of
it changes.

`layer.py` has what is read from files; `files/builder.py` builds a `System` of it.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Set
from dataclasses import dataclass, field
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

from desat.components.contract.block import Scalar

from .body import Body
from .interface import Interface, OutputClass

J2000 = datetime(2000, 1, 1, 12, tzinfo=UTC)
"""What `epoch_j2000` counts from."""
AUTO: Literal["auto"] = "auto"
Substeps = int | Literal["auto"]
"""Substeps within a step; `auto`: a run chooses them (`runs/substep_choice.py`)."""
MOST_SUBSTEPS = 1000
ACCURACY = 1e-7
"""Attitude error (rad) that a run which chooses its substeps keeps below, where none is
given.
"""

Values = Mapping[str, Any]
"""Values of a component's parameters by name, arrays as lists."""


@dataclass(frozen=True)
class Connector:
    """A connector that an SSD lists."""

    name: str
    kind: str  # input, output, parameter, ...
    type: str  # Real, Integer, Boolean, ...
    unit: str = ""
    line: int = 0


@dataclass(frozen=True)
class Connection:
    """From an output to an input: target = factor * source + offset."""

    source: str
    output: str
    target: str
    input: str
    line: int = 0
    factor: float = 1.0
    offset: float = 0.0
    converts: bool = True
    """False: units are not converted (suppressUnitConversion)."""
    output_array: str = field(init=False, repr=False, compare=False)
    """The variable that the output is an element of."""
    input_array: str = field(init=False, repr=False, compare=False)
    series: str = field(init=False, repr=False, compare=False)
    """Of the output, `component.variable`."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "output_array", self.output.partition("[")[0])
        object.__setattr__(self, "input_array", self.input.partition("[")[0])
        object.__setattr__(self, "series", f"{self.source}.{self.output_array}")

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


class Fmu(Protocol):
    """What is known of an FMU; `files/library.py` reads it."""

    path: Path

    @property
    def sha256(self) -> str:
        """Of its file."""

    @property
    def ours(self) -> bool:
        """Whether we have built it."""

    @property
    def folder(self) -> Path:
        """Where it is extracted."""

    @property
    def interface(self) -> Interface:
        """Its variables."""

    @property
    def description(self) -> Any:
        """What fmpy makes of its model description."""

    @property
    def faults(self) -> tuple[str, ...]:
        """What is wrong with that by the standard, a line each."""

    @property
    def platforms(self) -> list[str]:
        """Those that it has a library for."""


@dataclass(frozen=True)
class Component:
    """An instance of an FMU or of a bare block."""

    name: str
    source: str
    interface: Interface
    parameters: Mapping[str, Scalar] = field(default_factory=dict)
    """Scalar values by element name, in the variable's own unit; inputs may be among
    them."""
    fmu: Fmu | None = None
    """None: it is the bare block of the interface's name."""
    step_ratio: int = 1
    """The component steps once in so many steps of the master."""
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    """What an SSD lists of it."""
    line: int = 0
    given: Mapping[str, str] = field(default_factory=dict, compare=False, repr=False)
    """Who gave a variable its value: name -> file and key, or option."""
    references: Mapping[str, str] = field(
        default_factory=dict, compare=False, repr=False
    )
    """Parameters that are given as products of others:
    `gain_matrix = "shared.inertia"`."""

    @cached_property
    def values(self) -> Values:
        """The value of each variable, in its own unit: the scenario's, or the start
        value of its declaration. An array stands by its name with the list of its
        elements, and each of these by its own."""
        found: dict[str, Any] = {}
        for name, signals in self.interface.arrays.items():
            values = [self.parameters.get(s.name, s.start) for s in signals]
            found.update(zip([s.name for s in signals], values, strict=True))
            if name not in found:
                found[name] = values
        return found

    def choice(self, name: str) -> str:
        """The choice that a parameter with choices has, by its name; its value as text
        without."""
        return str(self.interface.signals[name].named(self.values[name]))


class Told(Protocol):
    """What a scenario says beside its system, such as numbers and plots."""

    def as_json(self) -> Mapping[str, Any]:
        """It as JSON, for files."""

    def counted(self) -> Mapping[str, Any]:
        """What of that moves bits, and is not resolved into its system."""


@dataclass(frozen=True)
class System:
    """Components, connections and the experiment. `where` is the SSD, for messages."""

    name: str
    where: str
    components: Mapping[str, Component]
    connections: tuple[Connection, ...]
    step: float
    """s; `stop` is a whole number of them after `start`"""
    stop: float
    start: float = 0.0
    substeps: Substeps = 1
    """So many steps within a step, of those that hand means on to each other
    (`schedule.py`)."""
    accuracy: float = ACCURACY
    """Attitude error (rad) that `substeps = "auto"` is to keep below."""
    output_classes: Mapping[str, OutputClass] = field(default_factory=dict)
    """Overrides: `component.variable` -> class."""
    about: Told | None = None
    """What its scenario says (`language/content.py`, `content_of`); None of a foreign
    system."""
    body: Body | None = None
    """Mass and sides, where its craft file says them."""

    parts: int = field(init=False, repr=False, compare=False)
    """The substeps of a step; one as long as they are not chosen."""
    steps: int = field(init=False, repr=False, compare=False)
    """From start to stop."""
    roles: Mapping[str, Component] = field(init=False, repr=False, compare=False)
    """The component of each role that is filled; of several the last."""
    fed: Mapping[tuple[str, str], Connection] = field(
        init=False, repr=False, compare=False
    )
    """Of each wired input, by component and array, the connection of its first element.
    """
    by_input: Mapping[str, Mapping[str, Connection]] = field(
        init=False, repr=False, compare=False
    )
    """The same by the input's name (an array) and the component; empty for a name
    nobody wires."""
    takers: Mapping[tuple[str, str], str] = field(init=False, repr=False, compare=False)
    """By a component and the name of an input (an array) the component that takes there
    what it gives; of several the first."""
    read: Set[tuple[str, str]] = field(init=False, repr=False, compare=False)
    """The outputs that are read, by component and array."""

    def __post_init__(self) -> None:
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
