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

from ..files.io import replace_text
from ..system.errors import DesatError


def signature(path: Path) -> Path:
    """Where the sha256 of a Parquet file lies; readers of the whole folder pass names with _ by."""
    return path.with_name(f"_{path.stem}.sha256")


def replace(part: Path, path: Path, octets: bytes) -> None:
    """Put a written file in the place of a Parquet file, and keep its sha256 beside. While it is
    replaced that of the old one stands there, too: a reader may find either."""
    made = hashlib.sha256(octets).hexdigest()
    replace_text(signature(path), f"{_signed(path)}\n{made}" if path.exists() else made)
    part.replace(path)
    replace_text(signature(path), made)


def _signed(path: Path) -> str:
    """The sha256 that a file was written with, and while it is replaced that of the new one;
    "" where there is none."""
    try:
        return signature(path).read_text(encoding="ascii", errors="replace")
    except FileNotFoundError:
        return ""


def _check(path: Path) -> None:
    """Raises DesatError where a file is not what was written, or nothing says what that was."""
    state = path.stat()
    if not (said := _signed(path)):
        raise _said(path, ValueError(f"{signature(path).name}, its sha256, is missing"))
    _as_signed(path, said, state.st_mtime_ns, state.st_size)


@lru_cache(maxsize=4096)
def _as_signed(path: Path, said: str, *_: int) -> None:
    """What is raised is not remembered: a file may be mended within a tick of the clock."""
    found = hashlib.sha256(path.read_bytes()).hexdigest()
    if found not in said.split() and _signed(path) == said:  # else it has been replaced meanwhile
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
