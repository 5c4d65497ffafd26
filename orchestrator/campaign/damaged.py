"""A campaign's files as they are read: one that is damaged is a line that says what to do."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..system.errors import DesatError


def signature(path: Path) -> Path:
    """Where the sha256 of a Parquet file lies; readers of the whole folder pass names with _ by."""
    return path.with_name(f"_{path.stem}.sha256")


def replace(part: Path, path: Path, octets: bytes) -> None:
    """Put a written file in the place of a Parquet file, and keep its sha256 beside."""
    signature(path).unlink(missing_ok=True)  # of what was there before
    part.replace(path)
    signature(path).write_text(hashlib.sha256(octets).hexdigest(), encoding="ascii")


def _signed(path: Path) -> str:
    """The sha256 that a file was written with; "" where it is not known, or being replaced."""
    try:
        return signature(path).read_text(encoding="ascii")
    except FileNotFoundError:
        return ""


def _check(path: Path) -> None:
    """Raises DesatError where a file is not what was written."""
    state = path.stat()
    if said := _signed(path):
        _as_signed(path, said, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4096)
def _as_signed(path: Path, said: str, *_: int) -> None:
    """What is raised is not remembered: a file may be mended within a tick of the clock."""
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found != said and _signed(path) == said:  # else a head has replaced it meanwhile
        raise _said(path, ValueError("its sha256 is another"))


def columns(path: Path) -> pa.Schema:
    """The columns of a Parquet file. Raises DesatError where it is damaged."""
    try:
        _check(path)
        return pq.read_schema(path)
    except (pa.ArrowException, OSError) as error:
        raise _said(path, error) from error


def rows(path: Path, wanted: Sequence[str] | None = None) -> pa.Table:
    """Its rows, of columns those of these that it has. Raises DesatError where it is damaged."""
    names = columns(path).names
    try:
        return pq.read_table(path, columns=wanted and [c for c in wanted if c in names])
    except (pa.ArrowException, OSError) as error:
        raise _said(path, error) from error


def _said(path: Path, error: Exception) -> DesatError:
    cases = path.parent.parent / "cases" / path.name  # without it the block is not there
    return DesatError(f"{path}: damaged ({' '.join(str(error).split())}); without {cases} the same "
                      "command makes its cases again")  # fmt: skip


def table(path: Path) -> dict[str, Any]:
    """A JSON file that is a table. Raises DesatError where it is none."""
    try:
        if isinstance(found := json.loads(path.read_text(encoding="utf-8")), dict):
            return found
        raise DesatError(f"{path}: damaged (no table)")
    except ValueError as error:
        raise DesatError(f"{path}: damaged ({error})") from error
