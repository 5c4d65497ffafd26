"""Represent layers of values, from a craft, scenario, design, SSP file or options.

`files/builder.py` builds a system from the layer of a craft (or of an SSP file) and the
layers above it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from desat.components.contract.units import Unit

from .body import Body
from .interface import Interface, OutputClass
from .model import About, Connection, Connector, Fmu, Substeps

SHARED = "shared"  # owner of a value for each component with a parameter of that name


@dataclass(frozen=True, slots=True)
class Value:
    """Value that is given to a parameter or an input."""

    owner: str  # a component, or SHARED
    name: str  # of the variable or of one of its elements
    value: Any
    origin: str  # source: file and key, or option
    prefix: (
        str  # beginning of messages about the value, before the name of its component
    )
    raises: bool = (
        False  # a value that does not fit raises an error; otherwise it is a problem
    )
    text: str = ""  # the value as it was typed, which a String takes
    unit: Unit | str | None = None  # unit of the value, if a file names one
    unit_name: str = ""  # the same, as it is written
    conflict: str = ""  # message if one parameter set gives two values
    unchecked: bool = False  # of an SSP file: checked when the last layer is known


@dataclass(frozen=True)
class Place:
    """FMU or block in the place of a component."""

    name: str  # of the component
    source: str
    fmu: Fmu | None = None  # the FMU of `source`; None if there is none
    interface: Interface | None = None  # if it is known without a file
    line: int = 0
    connectors: Mapping[str, Connector] = field(default_factory=dict)
    step_ratio: int = 1
    origin: str = ""  # source of the replacement; "" in the layer of the craft
    label: str = ""  # readable name of the FMU


@dataclass
class Layer:
    """Contribution of one source to a system.

    Times are None where the source gives none.
    """

    place: str  # the file, for messages
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
    about: About | None = None
    body: Body | None = None
    of_options: bool = False
    problems: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    # warnings about times that the source lacks, which other layers may give: step, stop
    guesses: dict[str, str] = field(default_factory=dict)
