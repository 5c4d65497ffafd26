"""Convert an FMU's model description to an interface."""

from __future__ import annotations

import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from math import prod
from pathlib import Path
from typing import Any

from fmpy import read_model_description
from lxml import etree

from desat.components.contract.block import Scalar
from desat.components.contract.units import Unit
from desat.fmus.description import TOOL

from ..system.errors import DesatError, plain
from ..system.interface import Interface, OutputClass, Signal, apart
from ..system.parameters import known_unit
from .io import contents, replace_text
from .model_structure import LONGEST, mend_structure
from .xml import parse_bytes

LONGEST_NAME = 200  # characters of a library's name
MOST_ELEMENTS = 1_000_000  # of an array
_INTEGERS = (
    "Int8",
    "Int16",
    "Int32",
    "Int64",
    "UInt8",
    "UInt16",
    "UInt32",
    "UInt64",
    "Enumeration",
)
# FMI type -> kind of signal; other types have the same name as their kind.
SIGNAL_KINDS = {
    "Float32": "Real",
    "Float64": "Real",
    **dict.fromkeys(_INTEGERS, "Integer"),
}


def of_fmu(
    path: Path, called: str = "", sizes: Sequence[tuple[str, int]] = ()
) -> Interface:
    """Read the interface of a co-simulation FMU of FMI 1.0, 2.0 or 3.0.

    Parameters
    ----------
    path
        The FMU, a file or an extracted folder.
    called
        Its file's name, for messages.
    sizes
        Structural parameters with other values than their start values; arrays follow
        from them, and have then no start values.

    Raises
    ------
    DesatError
        If it is no such FMU.
    """
    return _of_fmu(path, called or path.name, path.stat().st_mtime_ns, tuple(sizes))


@lru_cache(maxsize=256)
def _of_fmu(
    path: Path, called: str, _modified: int, sizes: tuple[tuple[str, int], ...]
) -> Interface:
    """Read an interface, cached until the file changes."""
    root, description = _read(path, called)
    _resize(description, dict(sizes))
    try:
        return _interface(root, description)
    except (ValueError, TypeError, AttributeError, ArithmeticError) as error:
        # the description has not been validated
        text = str(error) or type(error).__name__
        raise DesatError(f"{called}/modelDescription.xml: {text}") from error


def _resize(description: Any, sizes: Mapping[str, int]) -> None:
    """Give structural parameters other values, and the arrays their shapes."""
    for v in description.modelVariables:
        if v.causality == "structuralParameter" and v.name in sizes:
            v.start = str(sizes[v.name])
    for v in description.modelVariables:
        if any(getattr(d.variable, "name", "") in sizes for d in v.dimensions):
            dimensions = [d.start or d.variable.start for d in v.dimensions]
            v.shape, v.start = tuple(map(int, dimensions)), None


def _interface(root: Any, description: Any) -> Interface:
    """Build the interface from the XML and fmpy's model description."""
    units = {
        u.name: Unit(b.kg, b.m, b.s, b.A, b.K, b.rad, b.factor, b.offset)
        for u in description.unitDefinitions
        if (b := u.baseUnit) is not None
    }
    third = description.fmiVersion.startswith("3.")
    if third:
        _check_references(description)
    if negated := root.xpath("ModelVariables/ScalarVariable[@alias='negatedAlias']"):
        raise ValueError(
            f"{negated[0].get('name')} is a negated alias, which FMI 2.0 has no more: "
            "export it without"
        )
    variables, ours = (_VARIABLES_3, _OURS_3) if third else (_VARIABLES_2, _OURS_2)
    notes = {
        variable.get("name"): dict(note.attrib)
        for variable in root.iterfind(variables)
        for note in variable.iterfind(f"{ours}/*")
    }
    block = root.find(f"{'' if third else 'Vendor'}{ours}/Block")
    classes = _output_classes(description)
    signals: dict[str, Signal] = {}
    for v in description.modelVariables:
        note = notes.get(v.name, {})
        for name, start, element in (
            _elements(v) if third else ((v.name, v.start, None),)
        ):
            signals[name] = _signal(v, units, classes, note, name, start, element)
    signals |= apart(s for s in signals.values() if s.causality == "output")
    return Interface(
        description.modelName,
        description.description or "",
        signals,
        "" if block is None else block.get("role", ""),
        "3.0" if third else description.fmiVersion,
    )


def _check_references(description: Any) -> None:
    """Raise ValueError if two variables of FMI 3.0 have one value reference."""
    names: dict[int, str] = {}
    for v in description.modelVariables:
        other = names.setdefault(v.valueReference, v.name)
        if other != v.name:
            raise ValueError(
                f"{other} and {v.name} have one value reference, {v.valueReference}: "
                "in FMI 3.0 each variable has its own"
            )


# Element of a description that says that an FMU is for co-simulation without a tool.
_KIND = {"1.0": "Implementation/CoSimulation_StandAlone"}
_ALONE = (
    ("scheduled execution", "ScheduledExecution"),
    ("a tool of its own", "Implementation/CoSimulation_Tool"),
)
_VARIABLES_2, _OURS_2 = (
    "ModelVariables/ScalarVariable",
    f"Annotations/Tool[@name='{TOOL}']",
)
_VARIABLES_3, _OURS_3 = "ModelVariables/*", f"Annotations/Annotation[@type='{TOOL}']"


def _elements(v: Any) -> Iterator[tuple[str, str | None, int]]:
    """Yield the scalars of a variable of FMI 3.0: name, start value, index.

    The names are those that FMI 2.0 would use.
    """
    if v.type == "Clock":
        raise ValueError(
            f"{v.name} is a clock: there is no event mode here, in which clocks tick; "
            "export it without"
        )
    count = prod(v.shape)
    if count > MOST_ELEMENTS:
        raise ValueError(f"{v.name}: {count} elements, more than {MOST_ELEMENTS}")
    if not v.shape or v.type in ("String", "Binary"):
        yield v.name, v.start, 0
        return
    starts = v.start.split() if v.start else [None]
    starts = starts * count if len(starts) == 1 else starts
    if len(starts) != count:
        raise ValueError(f"{v.name}: {len(starts)} start values for {count} elements")
    for i, index in enumerate(product(*(range(1, n + 1) for n in v.shape))):
        yield f"{v.name}[{','.join(map(str, index))}]", starts[i], i


def root_of(folder: Path, called: str) -> Any:
    """Return the root of the model description of an extracted FMU.

    Raises
    ------
    DesatError
        If it is no XML, or not that of an FMU of FMI 1.0, 2.0 or 3.0.
    """
    place = f"{called}/modelDescription.xml"
    root = parse_bytes(contents(folder / "modelDescription.xml", place), place)
    version = root.get("fmiVersion") or "of no version"
    if root.tag != "fmiModelDescription" or not _is_known(version):
        raise DesatError(
            f"{place}: {root.tag}, FMI {version}: the description of an FMU of FMI "
            "1.0, 2.0 or 3.0 is needed"
        )
    return root


def _is_known(version: str) -> bool:
    """Return whether a version of FMI is supported."""
    return version in ("1.0", "2.0") or bool(re.fullmatch(r"3\.0(\.\d+)?", version))


def _read(path: Path, called: str) -> tuple[Any, Any]:
    """Read the model description of an FMU, as XML and parsed by fmpy.

    Raises DesatError if it is not for co-simulation or not readable.
    """
    try:
        xml = _description_bytes(path, called)
        root = parse_bytes(xml, f"{called}/modelDescription.xml")
        version = root.get("fmiVersion") or "of no version"
        is_supported = _is_known(version)
        if not is_supported or root.find(_KIND.get(version, "CoSimulation")) is None:
            alone = next(
                (kind for kind, element in _ALONE if root.find(element) is not None),
                "model exchange",
            )
            kind = (
                f"FMI {version} for {alone} alone" if is_supported else f"FMI {version}"
            )
            raise DesatError(
                f"{called}: {kind}: FMI 1.0, 2.0 or 3.0 for co-simulation is needed: "
                "export it as that"
            )
        _identifier(called, root)
        return root, description_of(path, called)
    except (OSError, KeyError, zipfile.BadZipFile, etree.XMLSyntaxError) as error:
        raise DesatError(f"{called}: not a readable FMU ({error})") from error


def _description_bytes(path: Path, called: str) -> bytes:
    """Read the bytes of an FMU's model description."""
    if path.is_dir():
        return contents(path / "modelDescription.xml", f"{called}/modelDescription.xml")
    with zipfile.ZipFile(path) as archive:
        return archive.read("modelDescription.xml")


def description_of(path: Path, called: str = "") -> Any:
    """Parse the model description of an FMU with fmpy.

    It is not checked for violations of the standard; those of `mend_structure` are
    mended.

    Parameters
    ----------
    path
        The FMU, a file or an extracted folder.
    called
        The name of its file in messages; by default that of `path`.

    Raises
    ------
    DesatError
        If the description cannot be read.
    """
    place = f"{called or path.name}/modelDescription.xml"
    root = parse_bytes(_description_bytes(path, called or path.name), place)
    mended = mend_structure(root, place)
    try:
        if not mended:
            return read_model_description(path, validate=False)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "modelDescription.xml"
            replace_text(file, etree.tostring(root))
            return read_model_description(folder, validate=False)
    except Exception as error:  # fmpy raises plain Exception, KeyError, IndexError, ...
        lines = str(error).splitlines() or [type(error).__name__]
        kind = "" if type(error) is Exception else f"{type(error).__name__}: "
        raise DesatError(f"{place}: {kind}{plain(lines[0])}") from error


@lru_cache(maxsize=256)
def faults(path: Path) -> tuple[str, ...]:
    """Find violations of the standard in the model description of an extracted FMU.

    They are those that fmpy's validation finds, a line each.
    """
    return _faults(path, is_archive=False)


def structure_faults(path: Path) -> tuple[str, ...]:
    """Find what `faults` does, and errors in names and ModelStructure."""
    return _faults(path, is_archive=True)


def _faults(path: Path, is_archive: bool) -> tuple[str, ...]:
    """Return the findings of fmpy's validation, a line each."""
    place = "modelDescription.xml"
    root = parse_bytes(contents(path / place, place), place)
    names: list[str] = []
    if is_archive:
        names = list(_name_faults(root))
    elif mended := mend_structure(root, place):
        return mended
    try:
        read_model_description(path, validate_model_structure=is_archive)
    except Exception as error:  # fmpy raises plain Exception
        lines = [line.strip(" -") for line in str(error).splitlines()]
        names += [x for x in lines if x and not x.endswith(":")] or [
            type(error).__name__
        ]
    return tuple(names)


# A name of the naming convention "structured", FMI 2.0.4, section 2.2.9. Within quotes a
# bare " is accepted as well, as fmpy does.
_PART = (
    r"""(?:[A-Za-z_]\w*|'(?:[\w!"#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['"?\\abfnrtv])+')"""
    r"(?:\[\d+(?:,\d+)*\])?"
)
_PATH = rf"{_PART}(?:\.{_PART})*"
_STRUCTURED = re.compile(rf"{_PATH}|der\({_PATH}(?:,\d+)?\)", re.ASCII)


def _name_faults(root: Any) -> Iterator[str]:
    """Yield a line for each variable whose name breaks the naming convention.

    fmpy checks the same with a general parser, which takes 2 ms for each name.
    """
    is_structured = root.get("variableNamingConvention", "flat") != "flat"
    for variable in root.iterfind("ModelVariables/*"):
        name = variable.get("name", "")
        if is_structured and not _STRUCTURED.fullmatch(name):
            allowed = 'no name of the naming convention "structured"'
        elif not is_structured and any(c in name for c in "\r\n\t"):
            allowed = "line ends and tabs are not allowed in a name"
        else:
            continue
        yield f"{name[:LONGEST]!r} (line {variable.sourceline}): {allowed}"


def _identifier(called: str, root: Any) -> None:
    """Raise DesatError unless the name of an FMU's library is a C identifier.

    It must not be a path to another file.
    """
    for kind in (
        [root] if root.get("fmiVersion") == "1.0" else root.iterfind("CoSimulation")
    ):
        name = kind.get("modelIdentifier", "")
        if not (name.isascii() and name.isidentifier() and len(name) <= LONGEST_NAME):
            raise DesatError(f"{called}: modelIdentifier {name[:80]!r} is no C name")


def _output_classes(description: Any) -> dict[str, OutputClass]:
    """Determine the class of each output: interval if it depends on an input."""
    inputs = {id(v) for v in description.modelVariables if v.causality == "input"}
    classes: dict[str, OutputClass] = {}
    for unknown in description.outputs:
        depends = unknown.dependencies
        classes[unknown.variable.name] = (
            "undeclared"
            if depends is None
            else "interval"
            if any(id(v) in inputs for v in depends)
            else "state"
        )
    return classes


def _signal(
    v: Any,
    units: dict[str, Unit],
    classes: dict[str, OutputClass],
    note: dict[str, str],
    name: str,
    start: str | None,
    element: int | None,
) -> Signal:
    """Build a signal from a variable of fmpy, with our annotation of it.

    For FMI 3.0 it may be an element of the variable.
    """
    declared = v.declaredType
    unit_name = v.unit or (declared.unit if declared else None) or ""
    least = v.min if v.min is not None else getattr(declared, "min", None)
    largest = v.max if v.max is not None else getattr(declared, "max", None)
    kind = SIGNAL_KINDS.get(v.type, v.type)
    if v.type == "Enumeration" and declared and declared.items:
        values = [int(i.value) for i in declared.items]
        least, largest = min(values), max(values)
    slope = note.get("slope", "")
    return Signal(
        name=name,
        causality=v.causality,
        kind=kind,
        reference=v.valueReference + (element or 0),
        type="" if element is None else v.type,
        element=element or 0,
        unit_name=unit_name,
        unit=units.get(unit_name) or (known_unit(unit_name) if unit_name else None),
        start=None if start is None else _READ.get(kind, str)(start),
        minimum=None if least is None else float(least),
        maximum=None if largest is None else float(largest),
        description=v.description or "",
        choices=tuple(note["choices"].split())
        if note.get("choices")
        else ()
        if declared is None or element
        else _items(declared),
        output_class=classes.get(getattr(v.alias, "name", v.name), "undeclared")
        if v.causality == "output"
        else "state",
        initial=note.get("initial") == "true",
        settable=_is_settable(v),
        mean=note.get("mean") == "true",
        slope=slope and (slope if element is None else name.replace(v.name, slope, 1)),
        shared=note.get("shared") == "true",
        follows=note.get("follows", ""),
        needed_by=tuple(note.get("neededBy", "").split()),
        usual=_range(note["usual"]) if "usual" in note else None,
    )


def _is_settable(v: Any) -> bool:
    """Return whether a variable may be set before initialisation.

    FMI 1.0 has no `initial`; there what has a start value may be set.
    """
    if v.causality in ("input", "parameter"):
        return True
    if v.variability == "constant":
        return False
    initial = v.initial or ("exact" if v.start is not None else "calculated")
    return initial in ("exact", "approx")


# How a start value is parsed, by the variable's kind; any other is a text.
_READ: dict[str, Callable[[str], Scalar]] = {
    "Real": float,
    "Integer": int,
    "Boolean": frozenset(("true", "1")).__contains__,
}


def _items(declared: Any) -> tuple[str, ...]:
    """Return the names of an enumeration's values, counted from 0.

    The tuple is empty if a value is negative or above 999, or if a name has a blank.
    """
    values = {int(i.value): i.name for i in getattr(declared, "items", None) or ()}
    if (
        not values
        or min(values) < 0
        or max(values) > 999
        or any(" " in n for n in values.values())
    ):
        return ()
    return tuple(values.get(i, "-") for i in range(max(values) + 1))


def _range(text: str) -> tuple[float, float] | None:
    """Parse a usual range; None if it has another form."""
    try:
        low, high = map(float, text.split())
    except ValueError:  # it has another form
        return None
    return low, high
