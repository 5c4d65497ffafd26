"""Thousands of series in few tables: with a data set for each, HDF5 takes minutes, or
fails.

Beyond MANY variables those of one type and class lie side by side in one data set, such
as `/.interval.Real`, a column per element; `/.index` says in JSON, of each variable, in
which columns it is, with the attributes that a data set of its own would have. No
component has a dot in its name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...system.interface import Kind

MANY = 512
INDEX = ".index"
ELEMENT = ".element."
"""Of vectors: the scale of their second axis, followed by how many elements they have.
"""
INTERVAL = ".interval"
"""The times of outputs that hold over an interval (`series_file.py`)."""
_SIDE = 64
"""Columns of a chunk: so many are read for one."""


@dataclass(frozen=True)
class SeriesColumns:
    """A variable that is recorded: its name, and its columns among the outputs of its
    type."""

    component: str
    variable: str
    kind: Kind
    columns: slice
    interval: bool
    scalar: bool
    attributes: dict[str, str]


@dataclass(frozen=True)
class _Entry:
    """Where a variable is in the tables."""

    table: str
    first: int
    end: int
    scalar: bool
    attributes: dict[str, str]


def tables(
    series: Sequence[SeriesColumns],
) -> tuple[dict[tuple[Kind, bool], NDArray[np.intp]], str]:
    """Of each type and class (interval or not) the columns that its table takes; and
    the index."""
    columns: dict[tuple[Kind, bool], list[int]] = {}
    entries = {}
    for s in sorted(series, key=lambda s: (s.component, s.variable)):
        taken = columns.setdefault((s.kind, s.interval), [])
        first = len(taken)
        taken += range(s.columns.start, s.columns.stop)
        entry = _Entry(
            name_of(s.kind, s.interval), first, len(taken), s.scalar, s.attributes
        )
        entries[f"{s.component}.{s.variable}"] = asdict(entry)
    return {key: np.array(c, np.intp) for key, c in columns.items()}, json.dumps(
        entries
    )


def name_of(kind: Kind, interval: bool) -> str:
    """The data set of a type and class."""
    return f".{'interval' if interval else 'state'}.{kind}"


def chunk(rows: int, columns: int) -> tuple[int, int]:
    """The chunk of a table."""
    return rows, min(columns, _SIDE)


class Columns:
    """A variable's columns of a table, read like a data set of its own."""

    def __init__(self, file: Any, entry: _Entry) -> None:
        self._table, self._entry, self.attrs = (
            file[entry.table],
            entry,
            entry.attributes,
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Rows, and elements where it is no scalar."""
        rows = int(self._table.shape[0])
        return (
            (rows,)
            if self._entry.scalar
            else (rows, self._entry.end - self._entry.first)
        )

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        block = np.asarray(self._table[rows, self._entry.first : self._entry.end])
        return block[:, 0] if self._entry.scalar else block


def index(file: Any) -> dict[str, Columns]:
    """`component.variable` -> its columns, of a file with tables; empty for any other."""
    if INDEX not in file:
        return {}
    entries = json.loads(file[INDEX][()])
    return {name: Columns(file, _Entry(**entry)) for name, entry in entries.items()}


def data_sets(file: Any) -> Iterator[Any]:
    """All data sets of a file whose rows are those of a run, but for the times."""
    for name, of in file.items():
        if name in ("time", INDEX, INTERVAL) or name.startswith(ELEMENT):
            continue
        yield from (of.values() if hasattr(of, "values") else (of,))
