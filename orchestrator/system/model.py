"""A system of components: what a master runs, whichever file it came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit

from .interface import Interface, OutputClass


@dataclass
class Connector:
    """A connector that an SSD lists."""

    name: str
    kind: str  # input, output, parameter, ...
    type: str  # Real, Integer, Boolean, ...
    unit: str = ""
    line: int = 0


@dataclass
class Component:
    """An instance of an FMU (or of the bare block of the same name)."""

    name: str
    source: str
    connectors: dict[str, Connector] = field(default_factory=dict)
    parameters: dict[str, Scalar] = field(default_factory=dict)
    """Scalar values by element name; inputs may be among them."""
    references: dict[str, str] = field(default_factory=dict)
    """Parameters that are given as other parameters: `gain_matrix = "shared.inertia"`."""
    units: dict[str, Unit] = field(default_factory=dict)
    """Units that values in `parameters` were given in, where they are not the component's own."""
    line: int = 0
    fmu: Path | None = None
    """The file that `source` stands for; None where there is none."""
    interface: Interface | None = None
    decimation: int = 1
    """The component steps once in so many steps of the master."""


@dataclass
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

    def __str__(self) -> str:
        return f"{self.source}.{self.output} -> {self.target}.{self.input}"


@dataclass
class System:
    """Components, connections and the experiment. `where` is the SSD, for messages."""

    name: str
    where: str
    components: dict[str, Component]
    connections: list[Connection]
    start: float = 0.0
    stop: float | None = None
    step: float | None = None
    inner: int = 1
    """So many steps within a step, of those that hand means on to each other (`rates.py`)."""
    output_classes: dict[str, OutputClass] = field(default_factory=dict)
    """Overrides: `component.variable` -> class."""
    warnings: list[str] = field(default_factory=list)
    """What was left out as the system was put together."""
    about: dict[str, Any] = field(default_factory=dict)
    """The scenario as data (story, numbers, plots, paper); empty for a foreign system."""
