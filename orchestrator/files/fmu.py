"""An FMU's model description as an interface."""

from __future__ import annotations

import zipfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from fmpy import read_model_description
from lxml import etree

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit
from desat.fmus.description import TOOL

from ..system.errors import DesatError
from ..system.interface import Interface, OutputClass, Signal
from ..system.parameters import known_unit
from .io import contents
from .xml import parse_bytes

LONGEST_NAME = 200
"""Of a library (characters)."""


def of_fmu(path: Path, called: str = "") -> Interface:
    """The interface of an FMI 2.0 co-simulation FMU (a file or an extracted folder); `called`: its
    file's name, for messages.

    Raises DesatError when it is no such FMU.
    """
    return _of_fmu(path, called or path.name, path.stat().st_mtime_ns)


@lru_cache(maxsize=256)
def _of_fmu(path: Path, called: str, _modified: int) -> Interface:
    root, description = _read(path, called)
    try:
        return _interface(root, description)
    except (ValueError, TypeError, AttributeError, ArithmeticError) as error:
        text = str(error) or type(error).__name__  # nobody has validated it
        raise DesatError(f"{called}/modelDescription.xml: {text}") from error


def _interface(root: Any, description: Any) -> Interface:
    units = {
        u.name: Unit(b.kg, b.m, b.s, b.A, b.K, b.rad, b.factor, b.offset)
        for u in description.unitDefinitions if (b := u.baseUnit) is not None
    }  # fmt: skip
    classes = _output_classes(description)
    notes = {
        variable.get("name"): dict(note.attrib)
        for variable in root.iterfind("ModelVariables/ScalarVariable")
        for note in variable.iterfind(f"Annotations/Tool[@name='{TOOL}']/*")
    }
    block = root.find(f"VendorAnnotations/Tool[@name='{TOOL}']/Block")
    return Interface(
        description.modelName,
        description.description or "",
        {
            v.name: _signal(v, units, classes, notes.get(v.name, {}))
            for v in description.modelVariables
        },
        "" if block is None else block.get("role", ""),
    )


def _read(path: Path, called: str) -> tuple[Any, Any]:
    """The XML of an FMU's model description, and what fmpy makes of it. Raises DesatError."""
    try:
        if path.is_dir():
            xml = contents(path / "modelDescription.xml", f"{called}/modelDescription.xml")
        else:
            with zipfile.ZipFile(path) as archive:
                xml = archive.read("modelDescription.xml")
        root = parse_bytes(xml, f"{called}/modelDescription.xml")
        version = root.get("fmiVersion")
        if version != "2.0" or root.find("CoSimulation") is None:
            kind = f"FMI {version}" if version != "2.0" else "FMI 2.0 for model exchange alone"
            raise DesatError(f"{called}: {kind}: FMI 2.0 for co-simulation is needed: export it as "
                             "that")  # fmt: skip
        _identifier(called, root)
        return root, description_of(path)
    except (OSError, KeyError, zipfile.BadZipFile, etree.XMLSyntaxError) as error:
        raise DesatError(f"{called}: not a readable FMU ({error})") from error
    except DesatError:
        raise
    except Exception as error:  # fmpy raises plain Exception
        said = str(error).splitlines() or [type(error).__name__]
        raise DesatError(f"{called}: {said[0]}") from error


def description_of(path: Path) -> Any:
    """What fmpy makes of a model description (of a file or an extracted folder), whatever faults
    against the standard it has."""
    return read_model_description(path, validate=False)


@lru_cache(maxsize=256)
def faults(path: Path) -> tuple[str, ...]:
    """What is wrong with the model description of an extracted FMU by the standard, by fmpy's
    validation, a line each."""
    try:
        read_model_description(path)
    except Exception as error:  # fmpy raises plain Exception
        lines = [line.strip(" -") for line in str(error).splitlines()]
        return tuple(x for x in lines if x and not x.endswith(":")) or (type(error).__name__,)
    return ()


def _identifier(called: str, root: Any) -> None:
    """Raise DesatError unless the name of an FMU's library is one of C, no path to another file."""
    for kind in root.iterfind("CoSimulation"):
        name = kind.get("modelIdentifier", "")
        if not (name.isascii() and name.isidentifier() and len(name) <= LONGEST_NAME):
            raise DesatError(f"{called}: modelIdentifier {name[:80]!r} is no C name")


def _output_classes(description: Any) -> dict[str, OutputClass]:
    """The class of each output: interval where it depends on an input."""
    inputs = {id(v) for v in description.modelVariables if v.causality == "input"}
    classes: dict[str, OutputClass] = {}
    for unknown in description.outputs:
        depends = unknown.dependencies
        classes[unknown.variable.name] = (
            "undeclared" if depends is None
            else "interval" if any(id(v) in inputs for v in depends)
            else "state"
        )  # fmt: skip
    return classes


def _signal(
    v: Any, units: dict[str, Unit], classes: dict[str, OutputClass], note: dict[str, str]
) -> Signal:
    """A scalar variable of fmpy's, with our annotation of it."""
    declared = v.declaredType
    unit_name = v.unit or (declared.unit if declared else None) or ""
    least, largest = (
        x if x is not None else getattr(declared, key, None)
        for key, x in (("min", v.min), ("max", v.max))
    )
    return Signal(
        name=v.name,
        causality=v.causality,
        kind=v.type,
        reference=v.valueReference,
        unit_name=unit_name,
        unit=units.get(unit_name) or (known_unit(unit_name) if unit_name else None),
        start=_value(v.type, v.start),
        minimum=None if least is None else float(least),
        maximum=None if largest is None else float(largest),
        description=v.description or "",
        choices=tuple(note.get("choices", "").split()),
        output_class=classes.get(v.name, "undeclared") if v.causality == "output" else "state",
        initial=note.get("initial") == "true",
        mean=note.get("mean") == "true",
        slope=note.get("slope", ""),
        shared=note.get("shared") == "true",
        follows=note.get("follows", ""),
        needed_by=tuple(note.get("neededBy", "").split()),
        usual=_range(note.get("usual", "")),
    )


def _range(text: str) -> tuple[float, float] | None:
    try:
        low, high = map(float, text.split())
    except ValueError:  # none, or of somebody who writes it otherwise
        return None
    return low, high


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
