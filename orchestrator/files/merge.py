"""Merge the data of scenario files and record the source of each value."""

from __future__ import annotations

from typing import Any

from ..system.errors import DesatError, nearest
from .io import TomlTable

Keys = tuple[str, ...]
# Path of a value -> the file that gave it, and the axis' cell in it (`axes.method.dct.`).
DISPERSIONS = ("dispersions",)  # table whose entries are replaced as a whole
Origins = dict[Keys, tuple[str, str]]


def origin(origins: Origins, path: Keys) -> tuple[str, str]:
    """Return file and cell that give a value, or the nearest table around it."""
    for end in range(len(path), 0, -1):
        if path[:end] in origins:
            return origins[path[:end]]
        inside = [o for p, o in origins.items() if p[:end] == path[:end]]
        if inside:
            return inside[-1]
    return "", ""


def leave_out(merged: TomlTable, data: TomlTable, origins: Origins, place: str) -> None:
    """Remove from `merged` what `without` names, and `without` from the data.

    Raises
    ------
    DesatError
        If there is nothing of that name.
    """
    for text in data.pop("without", []):
        owner: Any = merged
        path: Keys = ()
        rest = text
        while isinstance(owner, dict) and rest not in owner and "." in rest:
            table, _, rest = rest.partition(".")  # a name may have dots itself
            owner, path = owner.get(table), (*path, table)
        if not isinstance(owner, dict) or rest not in owner:
            hint = nearest(rest, owner) if isinstance(owner, dict) else ""
            raise DesatError(f"{place}: without {text}: there is none before{hint}")
        del owner[rest]
        path = (*path, rest)
        _forget(origins, path)


def merge(
    into: TomlTable,
    new: TomlTable,
    origins: Origins,
    place: Origins | tuple[str, str],
    path: Keys = (),
) -> None:
    """Merge tables and replace everything else, also entries of [dispersions].

    `place` is the source of the new values.
    """
    for key, value in new.items():
        here = (*path, key)
        if (
            isinstance(value, dict)
            and isinstance(into.get(key), dict)
            and path != DISPERSIONS
        ):
            merge(into[key], value, origins, place, here)
            continue
        if key in into:
            _forget(origins, here)
        into[key] = copy(value)
        for leaf in _leaves(value, here):
            origins[leaf] = place if isinstance(place, tuple) else origin(place, leaf)


def copy(value: Any) -> Any:
    """Copy the tables of a value.

    Lists are shared, because nothing changes them.
    """
    if not isinstance(value, dict):
        return value
    return {k: copy(v) if isinstance(v, dict) else v for k, v in value.items()}


def _forget(origins: Origins, path: Keys) -> None:
    """Remove the sources of a path and of all within it."""
    for old in [p for p in origins if p[: len(path)] == path]:
        del origins[old]


def _leaves(value: Any, path: Keys) -> list[Keys]:
    """Return the paths of the values that are no tables, and of empty tables."""
    if not isinstance(value, dict) or not value:
        return [path]
    leaves: list[Keys] = []
    for k, v in value.items():
        here = (*path, k)
        leaves += _leaves(v, here) if isinstance(v, dict) else [here]
    return leaves


_FILLED = (str, dict, list)


def fill(value: Any, cell: dict[str, str]) -> Any:
    """Replace `{axis}` in texts by the cell's value of that axis."""
    if isinstance(value, str):
        for axis, name in cell.items():
            value = value.replace(f"{{{axis}}}", name)
        return value
    if isinstance(value, dict):
        return {
            k: fill(v, cell) if isinstance(v, _FILLED) else v for k, v in value.items()
        }
    if isinstance(value, list):
        return [fill(v, cell) if isinstance(v, _FILLED) else v for v in value]
    return value
