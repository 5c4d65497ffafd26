"""Time series of a run: written in HDF5 while it runs, read afterwards.

`/time` and one data set per variable, `/component/variable`, a row per recorded step
and a column per element, with unit, frame, description, output class and the names of
its values as attributes. A row of a state output belongs to its time t_k, a row of an
interval output to [t_k, t_k+1), so these have no last row. Thousands of variables share
data sets (`shared_tables.py`).
"""

from __future__ import annotations

import ctypes
import json
import os
import sys
from collections.abc import Callable, Hashable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, Self, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from ...files.io import regular
from ...system.errors import DesatError, nearest, plain
from . import memory, shared_tables
from .series_file import pack

T = TypeVar("T")
Array = NDArray[Any]
RECENT = 128 << 20
"""So much is kept of series that a file has packed, and of what is made of series
(bytes)."""
SERIES, MANIFEST = "series.h5", "manifest.json"
_FRAMES = {
    "eci": "eci",
    "body": "body",
    "lvlh": "lvlh",
    "wheel": "wheel axes",
    "bi": "body from eci",
    "coil": "coil axes",
}

_END, _BEHIND = slice(28, 36), 1 << 16
"""Where the superblock of our files says where they end, and how far behind that
(bytes) one may be that is being written: by up to two of HDF5's blocks of 2 KiB, seen
in 399 of 43,233 looks."""
_ATTEMPTS = 10
"""So often what its writer is just changing is read again, in some milliseconds."""


def frame_of(variable: str) -> str:
    """The frame that a name ends with, for people; empty where it has none."""
    return _FRAMES.get(variable.rpartition("_")[2], "")


def _unclosed(path: Path) -> Any:
    """A file that is being written, or was when its writer was killed. Raises OSError
    for one that has lost its end: HDF5 would take what is not there for zeros, or try
    to read it for hours."""
    with path.open("rb") as file:
        end = int.from_bytes(file.read(_END.stop)[_END], "little")
        if file.seek(0, os.SEEK_END) + _BEHIND < end:
            raise OSError(f"its end is missing, from {end} bytes")
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    with suppress(AttributeError, OSError):  # h5py does not have it; where it is found
        of_hdf5 = ctypes.CDLL(h5py.h5p.__file__)
        of_hdf5.H5Pset_metadata_read_attempts(ctypes.c_int64(access.id), _ATTEMPTS)
    how = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(os.fsencode(path), how, access))


def _grown(file: Any) -> int:
    """The rows of a file that was not closed which all its series have, as long as time
    grows."""
    times = np.asarray(file["time"][:])
    least = min((d.shape[0] for d in shared_tables.data_sets(file)), default=len(times))
    stops = np.flatnonzero(np.diff(times) <= 0.0)
    return int(min(len(times), least, *(stops[:1] + 1).tolist()))


def _row_count(manifest: Path) -> int:
    """The rows that hold values, where a manifest says so: a disk that is full has
    others too."""
    try:
        return int(json.loads(manifest.read_text(encoding="utf-8"))["rows"])
    except (OSError, ValueError, KeyError, TypeError):
        return sys.maxsize


DAMAGED = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError)
"""What h5py raises, and what follows, where a file is not as it was written."""


def _reason(error: Exception) -> str:
    """Return what an error says in one line."""
    return plain(" ".join(str(error).split())) or type(error).__name__


def _check_series(file: Any, rows: int | None) -> None:
    """Raise ValueError unless a file that was closed has times and series of as many
    rows."""
    times = np.asarray(file["time"][:rows], np.float64)
    if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) <= 0.0).any():
        raise ValueError("its times do not increase")
    for data in shared_tables.data_sets(file):
        is_of_numbers = isinstance(data, h5py.Dataset) and data.dtype.kind in "fiub"
        if not is_of_numbers or data.ndim not in (1, 2):
            raise ValueError(f"{data.name}: it holds no series")
        if rows is None and data.shape[0] not in (len(times) - 1, len(times)):
            raise ValueError(
                f"{data.name}: {data.shape[0]} rows for {len(times)} times"
            )


class Results:
    """The series of a run."""

    def __init__(self, file: Any, rows: int | None = None) -> None:
        self._file = file
        self._made: dict[str, Any] = {}
        self._recent: dict[Hashable, Array] = {}
        self._index = shared_tables.index(file)
        self._rows = rows
        """So many rows hold values; None: all."""

    def once(self, key: str, make: Callable[[], T]) -> T:
        """What `make` makes of these series, made when it is first asked for."""
        if key not in self._made:
            self._made[key] = make()
        made: T = self._made[key]
        return made

    def recent(self, key: Hashable, make: Callable[[], Array]) -> Array:
        """What `make` makes of these series, not to be written to; kept until others
        that take more than RECENT have been asked for."""
        array = self._recent.pop(key, None)
        if array is None:
            array = make().view()
            array.flags.writeable = False
        self._recent[key] = array
        while (
            sum(a.nbytes for a in self._recent.values()) > RECENT
            and len(self._recent) > 1
        ):
            del self._recent[next(iter(self._recent))]
        return array

    @classmethod
    def open(cls, path: Path, rows: int | None = None) -> Results:
        """The series of a run folder or of an HDF5 file, also of a run that was killed;
        of those `rows` rows, where so many are known to hold values.

        Raises DesatError where there is none.
        """
        file = path / SERIES if path.is_dir() else path
        if not file.exists():
            file = file.with_name(file.name + ".part")
        try:
            regular(file, str(file))
            opened = _unclosed(file) if file.suffix == ".part" else h5py.File(file, "r")
            if file.suffix == ".part":
                grown = min(_grown(opened), _row_count(file.with_name(MANIFEST)))
                rows = grown if rows is None else min(grown, rows)
            found = cls(opened, rows)
            if file.suffix != ".part":
                _check_series(opened, rows)
            return found
        except DAMAGED as error:
            raise DesatError(
                f"{path}: no readable series ({_reason(error)})"
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def thin(self, every: int) -> None:
        """Keep each so many-th row of every series, from the first on, in the file as
        well."""
        self._made.clear()
        self._recent.clear()
        if isinstance(self._file, memory.File):
            self._file.thin(every)
            return
        path = Path(self._file.filename)
        self._file.close()
        pack(path, every)
        self._file = h5py.File(path, "r")
        self._index = shared_tables.index(self._file)

    def names(self) -> list[str]:
        """`component.variable` of every series."""
        if self._index:
            return list(self._index)
        components = (c for c in self._file if c != "time" and not c.startswith("."))
        return [f"{c}.{v}" for c in components for v in sorted(self._file[c])]

    def _unreadable(self, what: str, error: Exception) -> DesatError:
        """Return the error of a file that is damaged where it is read."""
        file = getattr(self._file, "filename", SERIES)
        return DesatError(f"{file}: {what} cannot be read ({_reason(error)})")

    def _find(self, name: str) -> Any:
        if name in self._index:
            return self._index[name]
        component, _, variable = name.partition(".")
        try:
            if component in self._file and variable in self._file[component]:
                return self._file[component][variable]
            known = self.names()
        except DAMAGED as error:
            raise self._unreadable(name, error) from error
        raise DesatError(f"no series {name}{nearest(name, known)}")

    def raw(self, path: str, rows: slice) -> NDArray[Any]:
        """Rows of a data set of the file."""
        try:
            return np.asarray(self._file[path][rows])
        except DAMAGED as error:
            raise self._unreadable(path, error) from error

    def values(self, name: str, rows: slice = slice(None)) -> NDArray[Any]:
        """The rows of `component.variable` as (rows, elements), or (rows,) for a
        scalar; not to be written to."""
        last = (
            rows.stop
            if self._rows is None
            else min(self._rows, rows.stop or self._rows)
        )
        found = self._find(name)
        try:
            if not isinstance(found, h5py.Dataset) or found.nbytes > RECENT // 16:
                return np.asarray(found[rows.start : last])
            whole = self.recent(("values", name), lambda: np.asarray(found[:]))
            return whole[rows.start : last]
        except DAMAGED as error:
            raise self._unreadable(name, error) from error

    def count(self, name: str) -> int:
        """The number of rows of a series."""
        n = int(self._find(name).shape[0])
        return n if self._rows is None else min(n, self._rows)

    def times(self, name: str | None = None) -> NDArray[np.float64]:
        """The time (s) of each row of a series (default: of all recorded steps)."""
        try:
            whole = self.recent(
                "time", lambda: np.asarray(self._file["time"][: self._rows])
            )
        except DAMAGED as error:
            raise self._unreadable("time", error) from error
        return whole if name is None else whole[: self._find(name).shape[0]]

    def attribute(self, name: str, key: str) -> str:
        """`unit`, `frame`, `description` or `class` of a series."""
        try:
            return str(self._find(name).attrs[key])
        except DAMAGED as error:
            raise self._unreadable(f"{name}, attribute {key},", error) from error

    def choices(self, name: str) -> tuple[str, ...]:
        """The names of an Integer's values, `-` for one that it never has; empty
        without names."""
        try:
            return tuple(str(self._find(name).attrs.get("choices", "")).split())
        except DAMAGED as error:
            raise self._unreadable(f"{name}, attribute choices,", error) from error
