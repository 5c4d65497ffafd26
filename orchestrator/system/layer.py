"""Layers of values: what a craft, a scenario, a design, an SSP file or the options say
of a system.

`files/builder.py` makes a system of a craft's (or an SSP file's) layer and of those
above it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from desat.components.contract.units import Unit

from .body import Body
from .interface import Interface, OutputClass
from .model import Connection, Connector, Fmu, Substeps, Told

SHARED = (
    "shared"  # the owner of a value for each component that has a parameter of its name
)


@dataclass(frozen=True, slots=True)
class Value:
    """A value that is given to a parameter or an input."""

    owner: str  # a component, or SHARED
    name: str  # of the variable or of one of its elements
    value: Any
    origin: str  # who gave it: file and key, or option
    prefix: (
        str  # how a message about the value begins, before the name of its component
    )
    raises: bool = (
        False  # a value that does not fit ends the building; else it is a problem
    )
    unit: Unit | str | None = None  # that it was given in, where a file names one
    conflict: str = ""  # what to say where one parameter set gives two values
    unchecked: bool = False  # of an SSP file: checked when the last layer is known


@dataclass(frozen=True)
class Place:
    """An FMU or a block in the place of a component."""

    name: str  # of the component
    source: str
    fmu: Fmu | None = None  # what `source` stands for; None where there is none
    interface: Interface | None = None  # where it is known without a file
    line: int = 0
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    step_ratio: int = 1
    origin: str = ""  # who put it there; "" in the layer of the craft
    label: str = ""  # what people call the FMU


@dataclass
class Layer:
    """What one source says of a system. Times are None where it says nothing."""

    where: str  # the file, for messages
    name: str = ""
    title: str = ""
    places: list[Place] = field(default_factory=list)
    connections: list[Connection] = field(default_factory=list)
    values: list[Value] = field(
        default_factory=list
    )  # a later one replaces an earlier one
    step_ratios: dict[str, int] = field(default_factory=dict)
    start: float | None = None
    stop: float | None = None
    step: float | None = None
    substeps: Substeps | None = None
    accuracy: float | None = None
    output_classes: dict[str, OutputClass] = field(default_factory=dict)
    origins: dict[str, str] = field(default_factory=dict)  # of times and output classes
    about: Told | None = None
    body: Body | None = None
    of_options: bool = False
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
