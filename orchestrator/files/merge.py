"""A scenario's file and its bases, merged; each value remembers where it was given."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

from ..system.errors import DesatError, nearest
from . import places

Keys = tuple[str, ...]
Origins = dict[Keys, tuple[str, str]]
"""Path of a value -> the file that gave it, and the axis' cell in it (`axes.method.dct.`)."""


def origin(origins: Origins, path: Keys) -> tuple[str, str]:
    """Where a value, or the nearest table around it, was given: file and cell."""
    for end in range(len(path), 0, -1):
        if path[:end] in origins:
            return origins[path[:end]]
        inside = [o for p, o in origins.items() if p[:end] == path[:end]]
        if inside:
            return inside[-1]
    return "", ""


def toml(file: Path) -> dict[str, Any]:
    """The data of a TOML file. Raises DesatError where there is none or it cannot be read."""
    where = places.shown(file)
    try:
        return tomllib.loads(file.read_bytes().decode("utf-8"))
    except FileNotFoundError as error:
        raise DesatError(f"{where}: no such file") from error
    except UnicodeDecodeError as error:
        raise DesatError(f"{where}: not UTF-8 (byte {error.start + 1})") from error
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise DesatError(f"{where}: {error}") from error


def load(file: Path, origins: Origins, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    """The data of a file merged over that of its bases. Raises DesatError, a line a problem."""
    from .refuse import problems  # pydantic, only where a scenario is read

    where = places.shown(file)
    data = toml(file)
    if wrong := [f"{where}: {'.'.join(p)}: {text}" for p, text in problems(data, part=True)]:
        raise DesatError("\n".join(wrong))
    bases = data.pop("extends", [])
    if file in seen:
        chain = " -> ".join(f.stem for f in (*seen[seen.index(file) :], file))
        raise DesatError(f"{where}: extends itself ({chain})")
    merged: dict[str, Any] = {}
    known = [f.stem for f in file.parent.glob("*.toml")]
    for base in [bases] if isinstance(bases, str) else bases:
        below: Origins = {}
        if "/" in base and not file.is_relative_to(places.SCENARIOS):
            table = _ours(base, where, below, (*seen, file))
        elif base in known:
            table = load(file.with_name(f"{base}.toml"), below, (*seen, file))
        else:
            raise DesatError(f"{where}: extends: no file {base}.toml{nearest(base, known)}")
        merge(merged, table, origins, below)
    merged.pop("abstract", None)
    leave_out(merged, data, origins, where)
    merge(merged, data, origins, (where, ""))
    return merged


def _ours(name: str, where: str, origins: Origins, seen: tuple[Path, ...]) -> dict[str, Any]:
    """What a scenario file that is not one of ours extends as FAMILY/NAME: a scenario, or a file
    of the family. Its `family` says which."""
    from .scenario import families, find

    family, _, stem = name.partition("/")
    if family not in families():
        raise DesatError(f"{where}: extends: no family {family}{nearest(family, families())}")
    file = places.SCENARIOS / family / "scenarios" / f"{stem}.toml"
    if file.is_file() and "axes" not in (data := load(file, origins, seen)):
        pass
    else:
        try:
            scenario = find(name)
        except DesatError as error:
            raise DesatError(f"{where}: extends: {error}") from error
        data = copy(scenario.data)
        data.pop("labels", None)
        origins.update(scenario.origins)
    if "design" in data:  # it stays that of the scenario that it was made for
        data["design"].setdefault("of", stem)
    return {**data, "family": family}


def leave_out(merged: dict[str, Any], data: dict[str, Any], origins: Origins, where: str) -> None:
    """Take out of `merged` what data's `without` names, and `without` out of data."""
    for text in data.pop("without", []):
        owner: Any = merged
        path: Keys = ()
        rest = text
        while isinstance(owner, dict) and rest not in owner and "." in rest:
            table, _, rest = rest.partition(".")  # a name may have dots itself
            owner, path = owner.get(table), (*path, table)
        if not isinstance(owner, dict) or rest not in owner:
            hint = nearest(rest, owner) if isinstance(owner, dict) else ""
            raise DesatError(f"{where}: without {text}: there is none before{hint}")
        del owner[rest]
        path = (*path, rest)
        _forget(origins, path)


def merge(
    into: dict[str, Any], new: dict[str, Any], origins: Origins,
    given: Origins | tuple[str, str], path: Keys = (),
) -> None:  # fmt: skip
    """Tables are merged, everything else is replaced; `given`: where the new values are from."""
    for key, value in new.items():
        here = (*path, key)
        if isinstance(value, dict) and isinstance(into.get(key), dict):
            merge(into[key], value, origins, given, here)
            continue
        into[key] = copy(value)
        _forget(origins, here)
        for leaf in _leaves(value, here):
            origins[leaf] = given if isinstance(given, tuple) else origin(given, leaf)


def copy(value: Any) -> Any:
    """Its own tables; lists are shared, for nobody changes them."""
    return {k: copy(v) for k, v in value.items()} if isinstance(value, dict) else value


def _forget(origins: Origins, path: Keys) -> None:
    for old in [p for p in origins if p[: len(path)] == path]:
        del origins[old]


def _leaves(value: Any, path: Keys) -> list[Keys]:
    if isinstance(value, dict) and value:
        return [leaf for k, v in value.items() for leaf in _leaves(v, (*path, k))]
    return [path]


def fill(value: Any, cell: dict[str, str]) -> Any:
    """Texts with `{axis}` replaced by the axis' value of the cell."""
    if isinstance(value, str):
        for axis, name in cell.items():
            value = value.replace(f"{{{axis}}}", name)
        return value
    if isinstance(value, dict):
        return {k: fill(v, cell) for k, v in value.items()}
    if isinstance(value, list):
        return [fill(v, cell) for v in value]
    return value
