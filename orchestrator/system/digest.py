"""Compute the digest of a system: equal digests mean that the same bits come out.

The digest covers the *resolved* system. It is found by walking the system's
dataclasses, so that a new field is included automatically; what affects no bit is left
out by name (`ASIDE`). Each component stands with what computes it (`files/library.py`,
`computes`): for a foreign FMU the sha256 of its file, for a block of ours the hash of
the Python that is translated. That hash is the same for the native FMU, the Python FMU
and the bare block, as these give the same bits (`make builds`, and the tests of all
blocks). So a run, a worker with another build, and draws that are looked up without
FMUs agree. It is the hash of what an FMU was built of, not of the sources beside it.
Values are in the variables' own units, which are in the digest, too: SI for all of
ours. A value that a file gives in another unit has been converted when the system is
resolved.

Versions, compiler and libm are stored beside it (`files/identity.py`, `versions`).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Set
from dataclasses import fields, is_dataclass, replace
from functools import cache
from operator import attrgetter
from typing import Any

from .interface import Interface
from .model import Connection, System

# Form of the digest, before a colon; digests of different forms cannot be compared.
FORM = "2"

_OF_CODE = "is of what computes it, which stands beside"
# Fields that are in no digest, by class, and why. Fields of `Options` and keys of a
# scenario declare it themselves (`aside`, `use`).
ASIDE: Mapping[str, Mapping[str, str]] = {
    "System": {
        "name": "a name for people",
        "place": "a file, for messages",
    },
    "Component": {
        "source": _OF_CODE,
        "fmu": _OF_CODE,
        "connectors": "what an SSD lists, held against the interface when it is resolved",
        "line": "of a file, for messages",
        "origins": "who gave a value, for messages",
        "references": "how values are given, which are resolved",
    },
    "Connection": {
        "line": "of a file, for messages",
        "converts": "what comes of it are factor and offset",
    },
    "Interface": {
        "title": "a text",
    },
    "Signal": {
        "description": "a text",
        "unit_name": "how the unit is written; it stands beside",
        "reference": "the number of a variable in its FMU's file",
        "choices": "names of values, which are resolved",
        "minimum": "a value beyond it is refused",
        "maximum": "a value beyond it is refused",
        "shared": "values that differ are refused, or said",
        "usual": "a value outside of it is said",
        "needed_by": "what is missing is refused",
    },
}


def digest(
    system: System,
    computes: Mapping[str, str],
    conditions: Any = None,
    without: Set[str] = frozenset(),
) -> str:
    """Compute FORM and sha256 of a system and of all else that affects bits.

    Parameters
    ----------
    computes
        What computes each component, by its name.
    conditions
        What else affects bits: dataclasses, tables, lists, numbers, texts.
    without
        Keys of the scenario's content that do not count for this use.

    Raises
    ------
    TypeError
        If a value has a type that cannot be digested.
    KeyError
        If nothing computes a component.
    """
    about = system.about.counted() if system.about else {}
    content: Any = {k: _untitled(v) for k, v in about.items() if k not in without}
    content_hashed = [
        _as_json(replace(system, about=content)),
        {n: computes[n] for n in system.components},
        _as_json(conditions),
    ]
    text = json.dumps(content_hashed, sort_keys=True)
    return f"{FORM}:{hashlib.sha256(text.encode()).hexdigest()}"


def comparable(other: str) -> bool:
    """Return whether a stored digest has the form of those computed now."""
    return other.startswith(f"{FORM}:")


def wiring(connections: tuple[Connection, ...]) -> dict[str, dict[str, Any]]:
    """Return the source of each connection by `component.input`.

    A transformation, input = factor * source + offset, is included where there is one.
    """
    return {
        f"{c.target}.{c.input}": {
            "source": f"{c.source}.{c.output}",
            **(
                {}
                if (c.factor, c.offset) == (1.0, 0.0)
                else {"factor": c.factor, "offset": c.offset}
            ),
        }
        for c in sorted(connections, key=lambda c: (c.target, c.input))
    }


def _untitled(value: Any) -> Any:
    """Remove titles from numbers, plots or requirements of a scenario.

    Any other value is returned unchanged.
    """
    if isinstance(value, Mapping):
        return {name: _entry(entry) for name, entry in value.items()}
    return [_entry(entry) for entry in value] if isinstance(value, list) else value


def _entry(entry: Any) -> Any:
    """Remove the title of an entry."""
    is_table = isinstance(entry, Mapping)
    return {k: v for k, v in entry.items() if k != "title"} if is_table else entry


@cache
def _fields_of(kind: Any) -> Callable[[Any], tuple[Any, ...]] | None:
    """Return a getter of the class name and digested fields of a dataclass.

    Only fields that are given count, not those derived from them. The result is None
    for any other class.
    """
    if not isinstance(kind, type) or not is_dataclass(kind):
        return None
    aside = ASIDE.get(kind.__name__, {})
    names = tuple(
        f.name
        for f in fields(kind)
        if f.init and f.name not in aside and not f.metadata.get("aside")
    )
    return attrgetter("__class__.__name__", *names)


def _of_interface(x: Interface) -> str:
    """Compute the hash of an interface and cache it there.

    An interface has hundreds of variables, and components share it.
    """
    fields_of = vars(x)
    if "_digest" not in fields_of:
        values = (
            [_as_json(v) for v in values_of(x)]
            if (values_of := _fields_of(Interface))
            else []
        )
        fields_of["_digest"] = hashlib.sha256(
            json.dumps(values, sort_keys=True).encode()
        ).hexdigest()
    return str(fields_of["_digest"])


_PLAIN = frozenset((float, str, int, bool, type(None)))


def _as_json(x: Any) -> Any:
    """Convert a value to JSON that is equal only if the value is equal to the bit.

    The order of dataclasses in a list, such as connections, does not count.
    """
    kind = type(x)
    if kind in _PLAIN:
        return x
    if kind is Interface:
        return _of_interface(x)
    if values_of := _fields_of(kind):  # type: ignore[arg-type]
        return [v if type(v) in _PLAIN else _as_json(v) for v in values_of(x)]
    if isinstance(x, Mapping):
        return {str(k): v if type(v) in _PLAIN else _as_json(v) for k, v in x.items()}
    if isinstance(x, (list, tuple)):
        if _PLAIN.issuperset(map(type, x)):
            return x
        entries = [_as_json(v) for v in x]
        return sorted(entries, key=json.dumps) if is_dataclass(x[0]) else entries
    if hasattr(x, "tolist"):  # of numpy
        return _as_json(x.tolist())
    raise TypeError(f"{kind.__name__}: a digest cannot tell it")
