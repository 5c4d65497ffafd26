"""Check what a model description says about its own variables, before fmpy reads it.

fmpy takes an index that points nowhere for one from the end of the list, or fails
without naming the element. What other tools tolerate, and whose meaning is clear, is
mended in what fmpy reads. The standards are FMI 2.0.4, section 2.2.7, and FMI 3.0.1,
section 2.4.7.4.
"""

from __future__ import annotations

from collections.abc import Container, Iterator
from typing import Any

from ..system.errors import DesatError, plain

_OF_PARAMETERS = ("fixed", "tunable")
_OF_SIGNALS = ("discrete", "continuous")
_OF_OUTPUTS = ("constant", *_OF_SIGNALS)
_OF_ALL = ("constant", *_OF_PARAMETERS, *_OF_SIGNALS)
# The variabilities that each causality may have.
ALLOWED: dict[str, tuple[str, ...]] = {
    "parameter": _OF_PARAMETERS,
    "calculatedParameter": _OF_PARAMETERS,
    "structuralParameter": _OF_PARAMETERS,
    "input": _OF_SIGNALS,
    "output": _OF_OUTPUTS,
    "local": _OF_ALL,
    "independent": ("continuous",),
}
# The elements that give a variable of FMI 1.0 and 2.0 its type.
OLDER_TYPES = ("Real", "Integer", "Boolean", "String", "Enumeration")
# The lists of ModelStructure in FMI 2.0, whose elements refer to variables by index.
LISTS_2 = ("Outputs", "Derivatives", "InitialUnknowns")
LONGEST = 80  # characters of a foreign text that a message repeats


def mend_structure(root: Any, place: str) -> tuple[str, ...]:
    """Check the variables of a model description and all references to them.

    A variability that the causality does not allow is replaced by the nearest one that
    it does. Dependencies that point nowhere are removed, so that an output depends on
    everything, and so are unknowns and derivatives that point nowhere.

    Parameters
    ----------
    root
        The root element of modelDescription.xml, which is mended.
    place
        The file's name in messages.

    Returns
    -------
    tuple
        What was mended, a line each.

    Raises
    ------
    DesatError
        If a variable has no name, type, value reference or known causality and
        variability, or if a dimension or a clock refers to a variable that does not
        exist.
    """
    model_variables = root.find("ModelVariables")
    if model_variables is None:
        raise DesatError(f"{place}: it has no ModelVariables")
    variables = [v for v in model_variables if isinstance(v.tag, str)]
    version = root.get("fmiVersion", "")
    references = set()
    types = {t.get("name") for t in root.iterfind("TypeDefinitions/*")}
    mended: list[str] = []
    for variable in variables:
        if not variable.get("name"):
            raise DesatError(
                f"{place}:{variable.sourceline}: a variable without a name"
            )
        references.add(_parse_natural(variable, "valueReference", place))
        if version != "1.0":
            mended += _mend_variability(variable, place, version)
        if not version.startswith("3."):
            _check_type(variable, place)
        mended += _mend_type(variable, types, place)
    if version == "2.0":
        mended += _mend_references_2(root, variables, place)
    elif version.startswith("3."):
        mended += _mend_references_3(root, variables, references, place)
    return tuple(mended)


def _mend_references_2(root: Any, variables: list[Any], place: str) -> Iterator[str]:
    """Mend references by index, as FMI 2.0 has them."""
    indices = range(1, len(variables) + 1)
    for name in LISTS_2:
        for unknown in root.findall(f"ModelStructure/{name}/Unknown"):
            yield from _mend_unknown(unknown, "index", indices, place)
    for variable in variables:
        for real in variable.iterfind("Real[@derivative]"):
            yield from _mend_derivative(real, indices, place)


def _mend_references_3(
    root: Any, variables: list[Any], references: Container[int], place: str
) -> Iterator[str]:
    """Mend references by value reference, as FMI 3.0 has them."""
    for unknown in root.findall("ModelStructure/*"):
        if isinstance(unknown.tag, str):
            yield from _mend_unknown(unknown, "valueReference", references, place)
    for variable in variables:
        if variable.get("derivative") is not None:
            yield from _mend_derivative(variable, references, place)
        for text in variable.get("clocks", "").split():
            if fault := _fault_of(variable, "clocks", text, references, place):
                raise DesatError(fault)
        for dimension in variable.iterfind("Dimension[@valueReference]"):
            text = dimension.get("valueReference", "")
            if fault := _fault_of(dimension, "valueReference", text, references, place):
                raise DesatError(fault)


def _mend_unknown(
    unknown: Any, key: str, references: Container[int], place: str
) -> Iterator[str]:
    """Remove an unknown that points nowhere, or its dependencies that do."""
    if fault := _fault_of(unknown, key, unknown.get(key, ""), references, place):
        unknown.getparent().remove(unknown)
        yield f"{fault}: it is left out"
        return
    for text in unknown.get("dependencies", "").split():
        if fault := _fault_of(unknown, "dependencies", text, references, place):
            for attribute in ("dependencies", "dependenciesKind"):
                unknown.attrib.pop(attribute, None)
            yield f"{fault}: it is taken to depend on everything"
            return


def _mend_derivative(
    element: Any, references: Container[int], place: str
) -> Iterator[str]:
    """Remove a derivative's reference that points nowhere."""
    text = element.get("derivative", "")
    if fault := _fault_of(element, "derivative", text, references, place):
        del element.attrib["derivative"]
        yield f"{fault}: it is left out"


# The variability that is meant where a causality has one of the other kind.
_MEANT = {
    **dict.fromkeys(_OF_SIGNALS, "tunable"),
    **dict.fromkeys(_OF_PARAMETERS, "discrete"),
}


def _mend_variability(variable: Any, place: str, version: str) -> Iterator[str]:
    """Replace a variability that the causality of a variable does not allow.

    Raises DesatError for a causality or variability that FMI does not know.
    """
    causality = variable.get("causality", "local")
    at = f"{_place(variable, place)}: causality {_short(causality)}"
    if causality not in ALLOWED:
        raise DesatError(f"{at}: there are {', '.join(ALLOWED)}")
    allowed = ALLOWED[causality]
    by_default = allowed[0] if version.startswith("3.") else "continuous"
    variability = variable.get("variability", by_default)
    if variability in allowed:
        return
    text = f"{at} with variability {_short(variability)}: {' or '.join(allowed)} is allowed"
    if variability not in _OF_ALL:
        raise DesatError(text)
    is_real = variable.find("Real") is not None or variable.tag.startswith("Float")
    meant = _MEANT.get(variability, allowed[0])
    if meant == "discrete" and is_real and "continuous" in allowed:
        meant = "continuous"
    meant = meant if meant in allowed else allowed[0]
    variable.set("variability", meant)
    if causality == "input" or variable.get("initial") == "calculated":
        variable.attrib.pop("initial", None)
    yield f"{text}: taken for {meant}"


def _mend_type(
    variable: Any, types: Container[str | None], place: str
) -> Iterator[str]:
    """Remove a declared type that is not defined."""
    for element in (variable, *variable):
        name = element.get("declaredType") if isinstance(element.tag, str) else None
        if name is not None and name not in types:
            del element.attrib["declaredType"]
            yield (
                f"{_place(variable, place)}: declaredType {_short(name)} is not defined: "
                "it is left out"
            )


def _check_type(variable: Any, place: str) -> None:
    """Raise DesatError if a variable of FMI 1.0 or 2.0 has no type."""
    if not any(child.tag in OLDER_TYPES for child in variable):
        raise DesatError(
            f"{_place(variable, place)}: it has none of {', '.join(OLDER_TYPES)}"
        )


def _fault_of(
    element: Any, key: str, text: str, references: Container[int], place: str
) -> str:
    """Return a line if a reference is not among the known ones, else an empty text."""
    if _read(text) in references:
        return ""
    allowed = (
        f"1 to {len(references)}"
        if isinstance(references, range)
        else "value references of variables"
    )
    return (
        f"{_place(element, place)}: {key} {_short(text)!r} is no variable; {allowed} "
        "are allowed"
    )


def _parse_natural(element: Any, key: str, place: str) -> int:
    """Parse an attribute that is a whole number from 0 on.

    Raises DesatError if it is none.
    """
    text = element.get(key, "")
    number = _read(text)
    if number is None:
        raise DesatError(
            f"{_place(element, place)}: {key} {_short(text)!r}: a whole number from 0 on is needed"
        )
    return number


def _read(text: str) -> int | None:
    """Parse a whole number from 0 on; None if the text is none."""
    digits = text.strip()
    return (
        int(digits)
        if digits.isascii() and digits.isdigit() and len(digits) < 20
        else None
    )


def _place(element: Any, place: str) -> str:
    """Return file, line and name of an element for messages."""
    name = element.get("name") or element.tag
    return f"{place}:{element.sourceline}: {_short(name)}"


def _short(text: str) -> str:
    """Shorten a text for messages."""
    return plain(text[:LONGEST])
