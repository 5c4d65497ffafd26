"""A campaign's files as they are read: one that is damaged is a line that says what to do."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from ..system.errors import DesatError


def columns(path: Path) -> pa.Schema:
    """The columns of a Parquet file. Raises DesatError where it is damaged."""
    try:
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
