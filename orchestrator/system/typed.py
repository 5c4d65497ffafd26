"""Check values that were read from JSON against the types that a dataclass declares."""

from __future__ import annotations

import types
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from .errors import plain

LARGEST = 1e300  # upper bound of an integer's magnitude that also counts as a float
_NEEDED = {
    str: "a text",
    bool: "true or false",
    int: "a whole number",
    float: "a number",
    type(None): "null",
}

JsonObject = dict[str, Any]  # an object of a JSON file, or of the output of `--json`


def fault_of(value: Any, declared: Any, place: str) -> str:
    """Describe a mismatch between a value and its declared type.

    Parameters
    ----------
    value
        What was read: a dataclass, or a value as JSON has it.
    declared
        The type, as `typing.get_type_hints` gives it.
    place
        The key of the value, for the message.

    Returns
    -------
    str
        The key, the value and what is needed; empty if the value is of the type.
    """
    if declared is Any:
        return ""
    origin, arguments = get_origin(declared), get_args(declared)
    if origin in (Union, types.UnionType):
        return _fault_of_union(value, arguments, place)
    if origin is Literal:
        return (
            ""
            if value in arguments
            else _fault(value, place, " or ".join(map(str, arguments)))
        )
    if isinstance(declared, type) and is_dataclass(declared):
        return _fault_of_dataclass(value, declared, place)
    kind = origin or declared
    if isinstance(kind, type) and issubclass(kind, Mapping):
        return _fault_of_mapping(value, arguments, place)
    if isinstance(kind, type) and issubclass(kind, Sequence) and kind is not str:
        return _fault_of_sequence(value, arguments, place)
    return "" if _is_of(value, kind) else _fault(value, place, _name_of(kind))


def _fault_of_union(value: Any, choices: Sequence[Any], place: str) -> str:
    """Describe a mismatch between a value and all types of a union."""
    if not all(fault_of(value, choice, place) for choice in choices):
        return ""
    for choice in choices:
        if (
            isinstance(choice, type)
            and is_dataclass(choice)
            and isinstance(value, choice)
        ):
            return fault_of(value, choice, place)
    return _fault(
        value, place, " or ".join(_name_of(get_origin(c) or c) for c in choices)
    )


def _fault_of_dataclass(value: Any, declared: type, place: str) -> str:
    """Describe the first mismatch in the fields of a dataclass."""
    if not isinstance(value, declared):
        return _fault(value, place, "a table")
    hints = _hints(declared)
    faults = (
        fault_of(getattr(value, f.name), hints[f.name], f"{place}.{f.name}".lstrip("."))
        for f in fields(declared)
    )
    return next(filter(None, faults), "")


def _fault_of_mapping(value: Any, arguments: Sequence[Any], place: str) -> str:
    """Describe the first mismatch in the keys and values of a table."""
    if not isinstance(value, Mapping):
        return _fault(value, place, "a table")
    if not arguments:
        return ""
    of_key, of_value = arguments
    for key, entry in value.items():
        inner = f"{place}.{key}"
        if text := fault_of(key, of_key, inner) or fault_of(entry, of_value, inner):
            return text
    return ""


def _fault_of_sequence(value: Any, arguments: Sequence[Any], place: str) -> str:
    """Describe the first mismatch in the elements of a list."""
    if not isinstance(value, (list, tuple)):
        return _fault(value, place, "a list")
    if not arguments:
        return ""
    is_of_any_length = len(arguments) == 1 or arguments[-1] is Ellipsis
    if not is_of_any_length and len(value) != len(arguments):
        return _fault(value, place, f"a list of {len(arguments)}")
    declared = [arguments[0]] * len(value) if is_of_any_length else arguments
    faults = (
        fault_of(x, of, f"{place}[{i}]")
        for i, (x, of) in enumerate(zip(value, declared, strict=True), 1)
    )
    return next(filter(None, faults), "")


def _is_of(value: Any, kind: Any) -> bool:
    """Return whether a value is of a plain type; an int also counts as a float."""
    if kind in (int, float) and isinstance(value, bool):
        return False
    if kind is float and isinstance(value, int):
        return abs(value) < LARGEST
    return not isinstance(kind, type) or isinstance(value, kind)


def _name_of(kind: Any) -> str:
    """Return the readable name of a type."""
    if kind in _NEEDED:
        return _NEEDED[kind]
    if isinstance(kind, type) and issubclass(kind, Sequence):
        return "a list"
    return "a table"


def _fault(value: Any, place: str, needed: str) -> str:
    """Format the message of a mismatch."""
    return f"{place} is {plain(repr(value)[:60])}; {needed} is needed"


@cache
def _hints(declared: type) -> dict[str, Any]:
    """Return the types of a dataclass's fields."""
    return get_type_hints(declared)
