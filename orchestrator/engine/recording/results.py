"""Read the time series of a run, which are written in HDF5 while it runs.

The file has `/time` and one data set per variable, `/component/variable`, with one row
per recorded step and one column per element. Attributes give unit, frame, description,
output class and the names of the values. A row of a state output belongs to its time
t_k, a row of an interval output to [t_k, t_k+1), so that interval outputs have no last
row. Thousands of variables share data sets (`shared_tables.py`).
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
from numpy.lib.mixins import NDArrayOperatorsMixin
from numpy.typing import NDArray

from ...files.io import regular
from ...system.errors import DesatError, nearest, plain
from . import memory, shared_tables
from .series_file import CACHE, EVERY, pack

T = TypeVar("T")
Array = NDArray[Any]
SOME = 1 << 16  # rows of a long series that are read together where some are kept
RECENT = 128 << 20  # bytes: cache of unpacked series and of results derived from them
SERIES, MANIFEST = "series.h5", "manifest.json"
_FRAMES = {
    "eci": "eci",
    "body": "body",
    "lvlh": "lvlh",
    "wheel": "wheel axes",
    "bi": "body from eci",
    "coil": "coil axes",
}

# Bytes of the superblock that give the end of the file, and the tolerance (bytes) by
# which a file that is being written may fall short of it: up to two of HDF5's blocks of
# 2 KiB were missing in 399 of 43,233 readings.
_END, _BEHIND = slice(28, 36), 1 << 16
_ATTEMPTS = 10  # readings of metadata that the writer is changing, in some milliseconds


def frame_of(variable: str) -> str:
    """Return the readable frame that a name ends with; empty if there is none."""
    return _FRAMES.get(variable.rpartition("_")[2], "")


def _unclosed(path: Path) -> Any:
    """Open a file that is being written, or whose writer was killed.

    Raises OSError for a file whose end is missing: HDF5 would read zeros for the
    missing part, or try to read it for hours.
    """
    with path.open("rb") as file:
        end = int.from_bytes(file.read(_END.stop)[_END], "little")
        if file.seek(0, os.SEEK_END) + _BEHIND < end:
            raise OSError(f"its end is missing, from {end} bytes")
    access = h5py.h5p.create(h5py.h5p.FILE_ACCESS)
    # h5py lacks this function; HDF5 may export it
    with suppress(AttributeError, OSError):
        of_hdf5 = ctypes.CDLL(h5py.h5p.__file__)
        of_hdf5.H5Pset_metadata_read_attempts(ctypes.c_int64(access.id), _ATTEMPTS)
    flags = h5py.h5f.ACC_RDONLY | h5py.h5f.ACC_SWMR_READ
    return h5py.File(h5py.h5f.open(os.fsencode(path), flags, access))


def _open_whole(path: Path) -> Any:
    """Open a file whose writing has ended."""
    return h5py.File(path, "r", rdcc_nbytes=CACHE)


def _grown(file: Any) -> int:
    """Count the rows that all series of an unclosed file have while time increases."""
    times = np.asarray(file["time"][:])
    least = min((d.shape[0] for d in shared_tables.data_sets(file)), default=len(times))
    stops = np.flatnonzero(np.diff(times) <= 0.0)
    return int(min(len(times), least, *(stops[:1] + 1).tolist()))


def _row_count(manifest: Path) -> int:
    """Read from a manifest the number of rows that hold values.

    On a full disk the file has further rows.
    """
    try:
        return int(json.loads(manifest.read_text(encoding="utf-8"))["rows"])
    except (OSError, ValueError, KeyError, TypeError):
        return sys.maxsize


# Errors that h5py, or the code after it, raises for a damaged file.
DAMAGED = (OSError, RuntimeError, LookupError, ValueError, TypeError, AttributeError)


def _reason(error: Exception) -> str:
    """Return the message of an error in one line."""
    return plain(" ".join(str(error).split())) or type(error).__name__


def _check_series(file: Any, rows: int | None) -> None:
    """Raise ValueError if times or series of a closed file are invalid."""
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


class Series(NDArrayOperatorsMixin):
    """A series that is read as its rows are used, in place of an array.

    A long one would fill the memory. It is an array to numpy and to operators, which
    read it whole; slices of rows, and functions of `derived.by_rows`, do not.
    """

    def __init__(
        self,
        results: Results,
        name: str,
        columns: NDArray[np.bool_] | slice | None = None,
        rows: NDArray[np.intp] | range | None = None,
    ) -> None:
        """Take the columns and rows of a series; None: as they are, and all rows.

        With columns its values are floats (rows, columns).
        """
        self._results, self._name, self._columns = results, name, columns
        self._rows = range(results.count(name)) if rows is None else rows

    def __len__(self) -> int:
        return len(self._rows)

    def head(self, count: int) -> Series:
        """Return the series without the rows after the first `count`."""
        return Series(self._results, self._name, self._columns, self._rows[:count])

    def at(self, rows: NDArray[np.bool_]) -> Series:
        """Return the series at these of its first rows."""
        at = np.flatnonzero(rows)
        if not isinstance(self._rows, range):
            at = self._rows[at]
        return Series(self._results, self._name, self._columns, at)

    def __getitem__(self, at: Any) -> Any:
        """Return a row, or an array of rows or elements, as that of all rows would."""
        if isinstance(at, tuple) and isinstance(at[0], int):
            return self[at[0]][at[1:]]
        if isinstance(at, int):
            row = range(len(self))[at]
            return self[row : row + 1][0]
        if not isinstance(at, slice):
            return np.asarray(self)[at]
        rows = self._rows[at]
        if isinstance(rows, range):
            values = self._results.values(self._name, slice(rows.start, rows.stop))
        else:
            values = self._read(rows)
        if self._columns is None:
            return values
        table = values.reshape(len(values), -1)[:, self._columns]
        return table.astype(float, copy=False)

    def _read(self, rows: NDArray[np.intp]) -> Array:
        """Read rows, some thousands of the series at a time."""
        firsts = np.arange(rows[0], rows[-1] + 1, SOME) if len(rows) else rows
        bounds = np.searchsorted(rows, firsts)
        parts = [
            self._results.values(self._name, slice(at[0], at[-1] + 1))[at - at[0]]
            for at in np.split(rows, bounds[1:])
            if len(at)
        ]
        return np.concatenate(parts or [self._results.values(self._name, slice(0, 0))])

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> Array:
        return np.asarray(self[:], dtype)

    def __array_ufunc__(
        self, ufunc: Any, method: str, *inputs: Any, **options: Any
    ) -> Any:
        arrays = (np.asarray(x) if isinstance(x, Series) else x for x in inputs)
        return getattr(ufunc, method)(*arrays, **options)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # numpy asks for protocols that it has not
            raise AttributeError(name)
        return getattr(np.asarray(self), name)


class Results:
    """Series of a run."""

    def __init__(self, file: Any, rows: int | None = None) -> None:
        """Take an open file of series, of which `rows` rows hold values; None: all."""
        self._file = file
        self._computed: dict[str, Any] = {}  # results that are kept, by key
        self._recent: dict[
            Hashable, Array
        ] = {}  # arrays kept until others displace them
        self._found: dict[str, Any] = {}  # data sets or columns, by series
        self._names: list[str] = []
        self._index = shared_tables.index(file)
        self._rows = rows

    @property
    def folder(self) -> Path | None:
        """Return the folder of the series' file; None for series in memory."""
        name = getattr(self._file, "filename", None)
        return Path(name).parent if name else None

    def __reduce_ex__(self, protocol: Any) -> Any:
        """Pickle and copy series of a file as its folder, which is opened again."""
        if self.folder is None:
            return super().__reduce_ex__(protocol)
        return Results.open, (self.folder, self._rows)

    def once(self, key: str, make: Callable[[], T]) -> T:
        """Compute a result of these series once, at the first request, and keep it."""
        if key not in self._computed:
            self._computed[key] = make()
        result: T = self._computed[key]
        return result

    def recent(self, key: Hashable, make: Callable[[], Array]) -> Array:
        """Return a read-only array computed from these series, cached by `key`.

        It stays cached until more recently used arrays exceed RECENT bytes.
        """
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
        """Open the series of a run folder or an HDF5 file, also of a killed run.

        `rows` limits the rows to those known to hold values.

        Raises
        ------
        DesatError
            If there is no readable series.
        """
        file = path / SERIES if path.is_dir() else path
        if not file.exists():
            file = file.with_name(file.name + ".part")
        try:
            regular(file, str(file))
            opened = _unclosed(file) if file.suffix == ".part" else _open_whole(file)
            if file.suffix == ".part":
                grown = min(_grown(opened), _row_count(file.with_name(MANIFEST)))
                rows = grown if rows is None else min(grown, rows)
            results = cls(opened, rows)
            if file.suffix != ".part":
                _check_series(opened, rows)
            return results
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
        """Close the file, and release what was read of it."""
        self._file.close()
        for cache in (self._computed, self._recent, self._found):
            cache.clear()

    def thin(self, every: int, extremes: bool = False) -> None:
        """Keep every `every`-th row of every series, from the first on.

        The file is thinned, too. With `extremes` it has the minimum, maximum and mean
        of each series between these rows, and what was computed from all is kept.
        """
        if not extremes:
            self._computed.clear()
        self._recent.clear()
        self._found.clear()
        if isinstance(self._file, memory.File):
            self._file.thin(every)
            return
        path = Path(self._file.filename)
        self._file.close()
        pack(path, every, extremes)
        self._file = _open_whole(path)
        self._index = shared_tables.index(self._file)

    def names(self) -> list[str]:
        """Return `component.variable` of every series."""
        if self._index:
            return list(self._index)
        if not self._names:
            components = [c for c in self._file if c != "time" and c[0] != "."]
            self._names = [
                f"{c}.{shared_tables.variable_of(v)}"
                for c in components
                for v in sorted(self._file[c])
            ]
        return list(self._names)

    def _unreadable(self, subject: str, error: Exception) -> DesatError:
        """Return the error for a file that is damaged where it is read."""
        file = getattr(self._file, "filename", SERIES)
        return DesatError(f"{file}: {subject} cannot be read ({_reason(error)})")

    def _find(self, name: str) -> Any:
        """Find the data set or the columns of a series, once."""
        if name in self._index:
            return self._index[name]
        if name in self._found:
            return self._found[name]
        component, _, variable = name.partition(".")
        try:
            link = shared_tables.link_of(variable)
            if component in self._file and link in self._file[component]:
                column = self._found[name] = self._file[component][link]
                return column
            series_names = self.names()
        except DAMAGED as error:
            raise self._unreadable(name, error) from error
        raise DesatError(f"no series {name}{nearest(name, series_names)}")

    def raw(self, path: str, rows: slice) -> NDArray[Any]:
        """Read rows of a data set of the file."""
        try:
            return np.asarray(self._file[path][rows])
        except DAMAGED as error:
            raise self._unreadable(path, error) from error

    def values(self, name: str, rows: slice = slice(None)) -> NDArray[Any]:
        """Return the rows of `component.variable`, read-only.

        The shape is (rows, elements), or (rows,) for a scalar.
        """
        last = (
            rows.stop
            if self._rows is None
            else min(self._rows, rows.stop or self._rows)
        )
        column = self._find(name)
        most = RECENT // (16 if rows == slice(None) else 32)
        try:
            if not isinstance(column, h5py.Dataset) or column.nbytes > most:
                return np.asarray(column[rows.start : last])
            series = self.recent(("values", name), lambda: np.asarray(column[:]))
            return series[rows.start : last]
        except DAMAGED as error:
            raise self._unreadable(name, error) from error

    def series(
        self, name: str, columns: NDArray[np.bool_] | slice | None = None
    ) -> Any:
        """Return a `Series`, or columns of it, for functions that take an array."""
        self._find(name)
        return Series(self, name, columns)

    @property
    def every(self) -> int:
        """Return of how many rows of the run one is kept."""
        return int(self.about(EVERY) or 1)

    def extremes(self, name: str) -> tuple[Array, Array] | None:
        """Return least and largest value from each row of a series to the next.

        They have the shape of its rows. None where the file has all rows, or was
        thinned without them.
        """
        component, _, variable = name.partition(".")
        link = f"{component}/{shared_tables.link_of(variable)}"
        groups = (shared_tables.LEAST, shared_tables.MOST)
        if self._index or any(group not in self._file for group in groups):
            return None
        least, most = (np.asarray(self._file[group][link][:]) for group in groups)
        return least, most

    def count(self, name: str) -> int:
        """Return the number of rows of a series."""
        n = int(self._find(name).shape[0])
        return n if self._rows is None else min(n, self._rows)

    def times(self, name: str | None = None) -> NDArray[np.float64]:
        """Return the time (s) of each row of a series (default: of all steps)."""
        try:
            every_time = self.recent(
                "time", lambda: np.asarray(self._file["time"][: self._rows])
            )
        except DAMAGED as error:
            raise self._unreadable("time", error) from error
        return every_time if name is None else every_time[: self._find(name).shape[0]]

    def attribute(self, name: str, key: str) -> str:
        """Read `unit`, `frame`, `description` or `class` of a series."""
        try:
            return str(self._find(name).attrs[key])
        except DAMAGED as error:
            raise self._unreadable(f"{name}, attribute {key},", error) from error

    def about(self, key: str) -> str:
        """Read an attribute of the file; empty if it has none of this name."""
        return str(self._file.attrs.get(key, ""))

    def choices(self, name: str) -> tuple[str, ...]:
        """Read the names of an Integer's values; empty if it has none.

        `-` stands for a value that it never takes.
        """
        try:
            return tuple(str(self._find(name).attrs.get("choices", "")).split())
        except DAMAGED as error:
            raise self._unreadable(f"{name}, attribute choices,", error) from error
