"""Check what a model description says about its own variables, before fmpy reads it.

fmpy takes an index that points nowhere for one from the end of the list, or fails
without naming the element. The standards are FMI 2.0.4, section 2.2.7, and FMI 3.0.1,
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


def check_structure(root: Any, place: str) -> None:
    """Check the variables of a model description and all references to them.

    Parameters
    ----------
    root
        The root element of modelDescription.xml.
    place
        The file's name in messages.

    Raises
    ------
    DesatError
        If a variable has no name, type or value reference, or a variability that its
        causality does not allow, or if an index, dependency, dimension, derivative or
        clock refers to a variable that does not exist.
    """
    found = root.find("ModelVariables")
    if found is None:
        raise DesatError(f"{place}: it has no ModelVariables")
    variables = [v for v in found if isinstance(v.tag, str)]
    version = root.get("fmiVersion", "")
    references = set()
    for variable in variables:
        if not variable.get("name"):
            raise DesatError(
                f"{place}:{variable.sourceline}: a variable without a name"
            )
        references.add(_parse_natural(variable, "valueReference", place))
        if version != "1.0":
            _check_variability(variable, place, version)
        if not version.startswith("3."):
            _check_type(variable, place)
    if version == "2.0":
        _check_references_2(root, variables, place)
    elif version.startswith("3."):
        _check_references_3(root, variables, references, place)


def _check_references_2(root: Any, variables: list[Any], place: str) -> None:
    """Check references by index, as FMI 2.0 has them."""
    indices = range(1, len(variables) + 1)
    for unknown in _unknowns_2(root):
        _check_reference(unknown, "index", indices, place)
        _check_references(unknown, "dependencies", indices, place)
    for variable in variables:
        for real in variable.iterfind("Real[@derivative]"):
            _check_reference(real, "derivative", indices, place)


def _unknowns_2(root: Any) -> Iterator[Any]:
    """Yield the unknowns of ModelStructure in FMI 2.0."""
    for name in LISTS_2:
        yield from root.iterfind(f"ModelStructure/{name}/Unknown")


def _check_references_3(
    root: Any, variables: list[Any], references: Container[int], place: str
) -> None:
    """Check references by value reference, as FMI 3.0 has them."""
    for unknown in root.iterfind("ModelStructure/*"):
        _check_reference(unknown, "valueReference", references, place)
        _check_references(unknown, "dependencies", references, place)
    for variable in variables:
        if variable.get("derivative") is not None:
            _check_reference(variable, "derivative", references, place)
        _check_references(variable, "clocks", references, place)
        for dimension in variable.iterfind("Dimension[@valueReference]"):
            _check_reference(dimension, "valueReference", references, place)


def _check_variability(variable: Any, place: str, version: str) -> None:
    """Raise DesatError if a variable's causality does not allow its variability."""
    causality = variable.get("causality", "local")
    at = f"{_place(variable, place)}: causality {_short(causality)}"
    if causality not in ALLOWED:
        raise DesatError(f"{at}: there are {', '.join(ALLOWED)}")
    allowed_by_default = (
        ALLOWED[causality][0] if version.startswith("3.") else "continuous"
    )
    variability = variable.get("variability", allowed_by_default)
    if variability not in ALLOWED[causality]:
        allowed = " or ".join(ALLOWED[causality])
        raise DesatError(
            f"{at} with variability {_short(variability)}: {allowed} is allowed"
        )


def _check_type(variable: Any, place: str) -> None:
    """Raise DesatError if a variable of FMI 1.0 or 2.0 has no type."""
    if not any(child.tag in OLDER_TYPES for child in variable):
        raise DesatError(
            f"{_place(variable, place)}: it has none of {', '.join(OLDER_TYPES)}"
        )


def _check_references(
    element: Any, key: str, known: Container[int], place: str
) -> None:
    """Raise DesatError if a reference in a list points nowhere."""
    for text in element.get(key, "").split():
        _check_known(element, key, text, known, place)


def _check_reference(element: Any, key: str, known: Container[int], place: str) -> None:
    """Raise DesatError if a reference is missing or points nowhere."""
    _check_known(element, key, element.get(key, ""), known, place)


def _check_known(
    element: Any, key: str, text: str, known: Container[int], place: str
) -> None:
    """Raise DesatError if a reference is not among the known ones."""
    if _read(text) in known:
        return
    allowed = (
        f"1 to {len(known)}"
        if isinstance(known, range)
        else "value references of variables"
    )
    raise DesatError(
        f"{_place(element, place)}: {key} {_short(text)!r} is no variable; {allowed} are allowed"
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
