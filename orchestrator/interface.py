"""What the orchestrator knows of a component: its scalar variables and the class of its outputs.

Read from an FMU's model description or from a bare block; both give the same.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Literal

from fmpy import read_model_description
from lxml import etree

from components.block import Block, Scalar
from components.units import UNITS, Unit
from fmus.description import TOOL, describe, title

from .errors import DesatError
from .xml import parse_bytes

Kind = Literal["Real", "Integer", "Boolean"]
KINDS: tuple[Kind, ...] = ("Real", "Integer", "Boolean")
OutputClass = Literal["state", "interval", "undeclared"]


@dataclass(frozen=True)
class Signal:
    """One scalar variable of a component."""

    name: str
    causality: str
    kind: str
    reference: int
    unit_name: str = ""
    unit: Unit | None = None
    start: Scalar | str | None = None
    minimum: float | None = None
    maximum: float | None = None
    description: str = ""
    choices: tuple[str, ...] = ()
    output_class: OutputClass = "state"
    shared: bool = False
    """All components of a system that have a parameter of this name must agree on it."""


@dataclass(frozen=True)
class Interface:
    """The variables of a component by name, in the order of its description."""

    model: str
    title: str
    signals: dict[str, Signal]
    role: str = ""

    def of(self, causality: str) -> Iterator[Signal]:
        """The signals of one causality."""
        return (s for s in self.signals.values() if s.causality == causality)

    def elements(self, name: str) -> list[Signal]:
        """The scalar `name`, or the elements `name[...]` of an array; empty when unknown."""
        if name in self.signals:
            return [self.signals[name]]
        return [s for s in self.signals.values() if base_name(s.name) == name]


def base_name(name: str) -> str:
    """`b_eci[2]` -> `b_eci`"""
    return name.partition("[")[0]


def of_block(name: str, block: type[Block]) -> Interface:
    """The interface of a bare block."""
    signals: dict[str, Signal] = {}
    for v in block.variables:
        for element, start in zip(v.elements(), v.flat_start(), strict=True):
            real = v.type == "Real"
            signals[element] = Signal(
                name=element,
                causality=v.causality,
                kind=v.type,
                reference=len(signals),
                unit_name=v.unit if real else "",
                unit=UNITS[v.unit] if real else None,
                start=None if v.causality == "output" else start,
                minimum=v.minimum,
                maximum=v.maximum,
                description=describe(v),
                choices=v.choices,
                output_class="interval" if v.interval else "state",
                shared=v.shared,
            )
    return Interface(name, title(block), signals, block.role)


def of_fmu(path: Path) -> Interface:
    """The interface of an FMI 2.0 co-simulation FMU (a file or an extracted folder).

    Raises DesatError when it is no such FMU.
    """
    return _of_fmu(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=256)
def _of_fmu(path: Path, _modified: int) -> Interface:
    try:
        if path.is_dir():
            xml = (path / "modelDescription.xml").read_bytes()
        else:
            with zipfile.ZipFile(path) as archive:
                xml = archive.read("modelDescription.xml")
        root = parse_bytes(xml, f"{path.name}/modelDescription.xml")
        version = root.get("fmiVersion")
        if version != "2.0" or root.find("CoSimulation") is None:
            raise DesatError(
                f"{path.name}: FMI {version} {'' if version != '2.0' else 'without co-simulation'}"
                "; FMI 2.0 co-simulation is needed"
            )
        description = read_model_description(path)
    except (OSError, KeyError, zipfile.BadZipFile, etree.XMLSyntaxError) as error:
        raise DesatError(f"{path.name}: not a readable FMU ({error})") from error
    except DesatError:
        raise
    except Exception as error:  # fmpy raises plain Exception
        raise DesatError(f"{path.name}: {str(error).splitlines()[0]}") from error

    units = {u.name: u.baseUnit for u in description.unitDefinitions}
    inputs = {id(v) for v in description.modelVariables if v.causality == "input"}
    classes: dict[str, OutputClass] = {}
    for unknown in description.outputs:
        depends = unknown.dependencies
        classes[unknown.variable.name] = (
            "undeclared" if depends is None
            else "interval" if any(id(v) in inputs for v in depends)
            else "state"
        )  # fmt: skip
    choices: dict[str, tuple[str, ...]] = {}
    shared = set()
    for variable in root.iterfind("ModelVariables/ScalarVariable"):
        note = variable.find(f"Annotations/Tool[@name='{TOOL}']/Parameter")
        if note is not None:
            choices[variable.get("name")] = tuple(note.get("choices", "").split())
            if note.get("shared") == "true":
                shared.add(variable.get("name"))
    block = root.find(f"VendorAnnotations/Tool[@name='{TOOL}']/Block")
    signals = {}
    for v in description.modelVariables:
        declared = v.declaredType
        unit_name = v.unit or (declared.unit if declared else None) or ""
        base = units.get(unit_name)
        bound = [
            x if x is not None else getattr(declared, key, None)
            for key, x in (("min", v.min), ("max", v.max))
        ]
        unit = UNITS.get(unit_name)
        if base is not None:
            unit = Unit(base.kg, base.m, base.s, base.A, base.K, base.rad, base.factor, base.offset)
        signals[v.name] = Signal(
            name=v.name,
            causality=v.causality,
            kind=v.type,
            reference=v.valueReference,
            unit_name=unit_name,
            unit=unit,
            start=_value(v.type, v.start),
            minimum=None if bound[0] is None else float(bound[0]),
            maximum=None if bound[1] is None else float(bound[1]),
            description=v.description or "",
            choices=choices.get(v.name, ()),
            output_class=classes.get(v.name, "undeclared") if v.causality == "output" else "state",
            shared=v.name in shared,
        )
    return Interface(
        description.modelName,
        description.description or "",
        signals,
        "" if block is None else block.get("role", ""),
    )


def _value(kind: str, text: str | None) -> Scalar | str | None:
    if text is None:
        return None
    if kind == "Real":
        return float(text)
    if kind in ("Integer", "Enumeration"):
        return int(text)
    if kind == "Boolean":
        return text in ("true", "1")
    return text
