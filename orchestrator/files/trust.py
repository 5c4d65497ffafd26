"""Whose code an FMU is: ours, that of a list of hashes, or somebody's; and what it is built for.

A foreign FMU is native code that runs with the rights of who runs it. Ours are told by their hash,
for a description may say anything.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

import fmpy

from ..system.errors import DesatError
from ..system.model import Component
from . import library, paths
from .toml import text

_LINE = re.compile(r"([0-9a-fA-F]{64})(\s+\*?.*)?")


def hashes(path: Path) -> frozenset[str]:
    """The sha256 of a list, as sha256sum writes it: a hash a line, and what it is of. Raises
    DesatError with the line that is no such."""
    known = set()
    for number, line in enumerate(text(path, str(path)).splitlines(), 1):
        line = line.partition("#")[0].strip()
        if line and not (match := _LINE.fullmatch(line)):
            raise DesatError(f"{path}:{number}: {line[:40]!r}: a sha256 of 64 digits is needed")
        if line and match:
            known.add(match[1].lower())
    return frozenset(known)


def is_ours(fmu: Path) -> bool:
    """True for an FMU that is, byte by byte, one that we have built."""
    if fmu.is_dir():
        return False
    return any(library.sha256(p) == library.sha256(fmu) for p in _ours().get(_size(fmu), ()))


def _size(path: Path) -> int:
    return path.stat().st_size


@cache
def _ours() -> dict[int, list[Path]]:
    """Our FMUs by their size, so that few need be hashed."""
    by_size: dict[int, list[Path]] = {}
    for path in paths.fmus().rglob("*.fmu"):
        by_size.setdefault(_size(path), []).append(path)
    return by_size


def runs(fmu: Path, trusted: frozenset[str] | None) -> bool:
    """Whether the code of an FMU is ours or that of a list."""
    return is_ours(fmu) or library.load(fmu).sha256 in (trusted or ())


def problems(components: Iterable[Component], trusted: frozenset[str] | None) -> Iterator[str]:
    """A line for each FMU that has no code for this platform or, with a list, is not of it."""
    for c in components:
        if c.fmu is None or is_ours(c.fmu):
            continue
        fmu = library.load(c.fmu)
        if trusted is not None and fmu.sha256 not in trusted:
            yield f"{c.name}: {fmu.path.name} is not of the list of --trust (sha256 {fmu.sha256})"
        if fmpy.platform not in (known := platforms(fmu.folder)):
            there = ", ".join(known) or "none"
            yield f"{c.name}: {fmu.path.name} has no binary for {fmpy.platform}; there is {there}"


def notes(components: Iterable[Component]) -> Iterator[str]:
    """A line for each foreign FMU: what it is built for, and its hash."""
    for c in components:
        if c.fmu is not None and not is_ours(c.fmu):
            fmu = library.load(c.fmu)
            known = ", ".join(platforms(fmu.folder)) or "no platform"
            what = f"is foreign native code, for {known}; sha256 {fmu.sha256}"
            yield f"{c.name}: {fmu.path.name} {what}"


def platforms(folder: Path) -> list[str]:
    """The platforms that an extracted FMU has a library for, as FMI 2.0 names them."""
    folders = (p for p in (folder / "binaries").glob("*") if p.is_dir())
    return sorted(p.name for p in folders if any(q.is_file() for q in p.iterdir()))
