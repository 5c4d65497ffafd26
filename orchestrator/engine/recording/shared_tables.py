"""Store thousands of series in few tables.

With a data set for each, HDF5 takes minutes, or fails. Beyond MANY variables, those of
one type and class are side by side in one data set, such as `/.interval.Real`, with a
column per element. `/.index` lists in JSON the columns of each variable, with the
attributes that a separate data set would have. No component has a dot in its name.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ...system.interface import Kind

MANY = 512
INDEX = ".index"
# Prefix of the scale of a vector's second axis, followed by the number of elements.
ELEMENT = ".element."
# groups with the same data sets as the file: what the series did between the rows kept
LEAST, MOST, MEAN = EXTREMES = (".least", ".most", ".mean")
INTERVAL = ".interval"  # times of outputs that hold over an interval (`series_file.py`)
_SIDE = 64  # columns of a chunk, all of which are read for one


@dataclass(frozen=True)
class SeriesColumns:
    """A recorded variable.

    It has its name, and its columns among the outputs of its type.
    """

    component: str
    variable: str
    kind: Kind
    columns: slice
    interval: bool
    scalar: bool
    attributes: dict[str, str]


@dataclass(frozen=True)
class _SharedTable:
    """Location of a variable in the tables."""

    table: str
    first: int
    end: int
    scalar: bool
    attributes: dict[str, str]


def tables(
    series: Sequence[SeriesColumns],
) -> tuple[dict[tuple[Kind, bool], NDArray[np.intp]], str]:
    """Return the columns of each table, by type and class, and the index as JSON.

    The class is interval or not.
    """
    columns: dict[tuple[Kind, bool], list[int]] = {}
    entries = {}
    for s in sorted(series, key=lambda s: (s.component, s.variable)):
        signals = columns.setdefault((s.kind, s.interval), [])
        first = len(signals)
        signals += range(s.columns.start, s.columns.stop)
        entry = _SharedTable(
            name_of(s.kind, s.interval), first, len(signals), s.scalar, s.attributes
        )
        entries[f"{s.component}.{s.variable}"] = asdict(entry)
    return {key: np.array(c, np.intp) for key, c in columns.items()}, json.dumps(
        entries
    )


def name_of(kind: Kind, interval: bool) -> str:
    """Return the name of the data set of a type and class."""
    return f".{'interval' if interval else 'state'}.{kind}"


def link_of(variable: str) -> str:
    """Return the name of the data set of a variable within its component's group.

    HDF5 divides names at `/`, and `.` is the group itself; they are written as in an
    address, `%2F` and `%2E`.
    """
    name = variable.replace("%", "%25").replace("/", "%2F")
    return name if name.strip(".") else name.replace(".", "%2E")


def variable_of(link: str) -> str:
    """Return the variable whose data set has a name."""
    return unquote(link)


def chunk(rows: int, columns: int) -> tuple[int, int]:
    """Return the shape of a chunk of a table."""
    return rows, min(columns, _SIDE)


class SharedColumns:
    """Columns of a variable in a table, read like a separate data set."""

    def __init__(self, file: Any, entry: _SharedTable) -> None:
        self._table, self._entry, self.attrs = (
            file[entry.table],
            entry,
            entry.attributes,
        )

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (rows,) for a scalar, otherwise (rows, elements)."""
        rows = int(self._table.shape[0])
        return (
            (rows,)
            if self._entry.scalar
            else (rows, self._entry.end - self._entry.first)
        )

    def __getitem__(self, rows: slice) -> NDArray[Any]:
        block = np.asarray(self._table[rows, self._entry.first : self._entry.end])
        return block[:, 0] if self._entry.scalar else block


def index(file: Any) -> dict[str, SharedColumns]:
    """Map `component.variable` to its columns in a file with tables.

    The result is empty for any other file.
    """
    if INDEX not in file:
        return {}
    entries = json.loads(file[INDEX][()])
    return {
        name: SharedColumns(file, _SharedTable(**entry))
        for name, entry in entries.items()
    }


def data_sets(file: Any) -> Iterator[Any]:
    """Yield all data sets of a file that hold rows of a run, except the times."""
    for name, of in file.items():
        if name in ("time", INDEX, INTERVAL, *EXTREMES) or name.startswith(ELEMENT):
            continue
        yield from (of.values() if hasattr(of, "values") else (of,))
