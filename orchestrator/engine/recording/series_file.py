"""Compress the series of a run and make them readable by other programs.

While a run goes on its Reals are written uncompressed, so that what is flushed stays
readable if the run is killed. The final file grows beside it: each complete chunk is
compressed (shuffle and deflate, which every HDF5 reader has) where that saves a
quarter, otherwise stored as it is, and at the end each data set gets its times as
dimension scale: `/time` for states, `/.interval` for outputs that hold over [t_k,
t_k+1).

HDF5's own filters would take 17.3 us per step of a day at nadir (129 signals, one core
of a busy machine). ISA-L's deflate takes 1.6 us for files that are 2 % larger. Data
sets and attributes are also made by direct HDF5 calls, because those of h5py take twice
as long and a day is simulated in half a second.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5p, h5s, h5t
from isal import isal_zlib
from numpy.typing import NDArray

from . import shared_tables
from .shared_tables import ELEMENT, EXTREMES, INTERVAL, MEAN

T = TypeVar("T")
TIME = "/time"
EVERY = "every"  # attribute of the file: one of so many rows of the run is kept
_LEVEL = 1
# A chunk is stored as it is if a sample of its values, one in so many, keeps more than
# this share of its size. Reading it back then takes a tenth of the time.
_SAMPLED, _WORTH = 8, 0.75
_NO_FILTERS = 0b11  # HDF5's mask of a chunk without shuffle and deflate
_OF_SCALES = ("CLASS", "NAME", "DIMENSION_LABELS", "DIMENSION_LIST", "REFERENCE_LIST")
CACHE = 1 << 20  # bytes of unpacked chunks; HDF5 would keep 8 MiB for each data set
_FULL = (OSError, RuntimeError)  # errors that h5py raises for a full disk


def path_while_packing(path: Path) -> Path:
    """Return the path at which the packed file of series grows.

    A process that is killed leaves that file behind.
    """
    return path.with_name(f"{path.name}.packing")


def aside(work: Callable[..., T], *argument: Any) -> T:
    """Run the work in a separate thread.

    ISA-L leaves the vector registers of its thread in a state in which C that is not
    built for AVX, such as that of FMUs, takes up to six times as long. Therefore no
    thread that steps, or that forks one that does, may pack.
    """
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(work, *argument).result()


def pack(path: Path, every: int = 1, extremes: bool = False) -> None:
    """Pack a closed file in place, keeping every `every`-th row from the first on.

    With `extremes` it has minimum, maximum and mean of each series from one of these
    rows to the next, too. The file is unchanged if the disk has no room for both.
    """
    aside(_pack, path, every, extremes)


def _pack(path: Path, every: int, extremes: bool) -> None:
    """Pack a closed file in this thread."""
    with h5py.File(path, "r", rdcc_nbytes=CACHE) as file:
        names = [TIME, *(d.name for d in shared_tables.data_sets(file))]
        index = file[shared_tables.INDEX][()] if shared_tables.INDEX in file else None
        plans = [DataSetPlan.of(file[name]) for name in names]
        if extremes:
            plans += [plan.within(group) for plan in plans[1:] for group in EXTREMES]
        about = {**file.attrs, EVERY: str(every)}
        packing = Packing(path, plans, index, about)
        packing.leave_room(file.id.get_filesize())
        for i, name in enumerate(names):
            source = file[name]  # one at a time is open
            many = source.chunks[0]
            for first in range(0, len(source), many * every):
                rows = source[first : first + many * every]
                packing.take(i, np.ascontiguousarray(rows[::every]))
                if extremes and i > 0:
                    at = len(names) + len(EXTREMES) * (i - 1)
                    for k, values in enumerate(extremes_of(rows, every)):
                        packing.take(at + k, values)
        packed = packing.finish()
    if packed is not None:
        packed.replace(path)


def extremes_of(
    rows: NDArray[Any], every: int
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Compute minimum, maximum and mean of each `every` rows; the last may be fewer."""
    firsts = np.arange(0, len(rows), every)
    counts = np.diff(firsts, append=len(rows)).reshape(-1, *(1,) * (rows.ndim - 1))
    return (
        np.minimum.reduceat(rows, firsts),
        np.maximum.reduceat(rows, firsts),
        np.add.reduceat(rows, firsts, dtype=np.float64) / counts,
    )


@dataclass(frozen=True)
class DataSetPlan:
    """Plan of a data set whose rows grow."""

    name: str
    tail: tuple[int, ...]  # (), or (columns,)
    dtype: np.dtype[Any]
    chunk: tuple[int, ...]
    attributes: Mapping[str, str]

    @classmethod
    def of(cls, source: Any) -> DataSetPlan:
        """Derive the plan of an existing data set.

        Attributes of dimension scales are left out, because they are made anew.
        """
        attributes = {k: v for k, v in source.attrs.items() if k not in _OF_SCALES}
        return cls(
            source.name, source.shape[1:], source.dtype, source.chunks, attributes
        )

    def within(self, group: str) -> DataSetPlan:
        """Return the plan of the data set in a group of extremes or means."""
        dtype = np.dtype(np.float64) if group == MEAN else self.dtype
        return replace(self, name=f"/{group}{self.name}", dtype=dtype)

    @property
    def interval(self) -> bool:
        """Return whether the rows hold over an interval."""
        shared = self.name.startswith(f"/{INTERVAL}.")
        return shared or self.attributes.get("class") == "interval"

    def make(self, file: Any, compressed: bool) -> Any:
        """Create the data set in a file, without rows."""
        properties = h5p.create(h5p.DATASET_CREATE)
        # otherwise equal runs would give different files
        properties.set_obj_track_times(False)
        properties.set_chunk(self.chunk)
        if compressed:
            properties.set_shuffle()
            properties.set_deflate(_LEVEL)
        link = h5p.create(h5p.LINK_CREATE)
        link.set_create_intermediate_group(True)
        place = h5s.create_simple((0, *self.tail), (h5s.UNLIMITED, *self.tail))
        name, dtype = self.name.encode(), h5t.py_create(self.dtype)
        data_set = h5d.create(file.id, name, dtype, place, properties, link)
        text, one = (
            h5t.py_create(h5py.string_dtype(), logical=True),
            h5s.create(h5s.SCALAR),
        )
        for key, value in self.attributes.items():
            h5a.create(data_set, key.encode(), text, one).write(
                np.array(value, dtype=object)
            )
        return h5py.Dataset(data_set)

    def append(self, dataset: Any, rows: NDArray[Any]) -> None:
        """Append rows to a data set that was created by `make`.

        A complete chunk is written directly, and uncompressed if it holds Reals. The
        calls are HDF5's own: `dataset[n:] = rows` takes twice as long, and a day has
        thousands of them.
        """
        n, *tail = dataset.shape
        dataset.set_extent((n + len(rows), *tail))
        if rows.shape == self.chunk and n % len(rows) == 0:
            packed_rows = rows if rows.dtype == np.float64 else deflated(rows)
            dataset.write_direct_chunk((n, *(0 for _ in tail)), packed_rows)
            return
        place = dataset.get_space()
        place.select_hyperslab((n, *(0 for _ in tail)), rows.shape)
        dataset.write(h5s.create_simple(rows.shape), place, rows)


def chunks(
    plan: DataSetPlan, rows: NDArray[Any]
) -> Iterable[tuple[tuple[int, ...], NDArray[Any]]]:
    """Yield the chunks that contain the rows, padded with zeros, and their offsets.

    There are at most as many rows as a chunk has. Offsets count from the first row.
    """
    width = plan.chunk[1:]
    if rows.shape == plan.chunk:
        yield (0,) * rows.ndim, rows
        return
    for first in range(0, plan.tail[0], width[0]) if width else (0,):
        part = rows[:, first : first + width[0]] if width else rows
        chunk = np.zeros(plan.chunk, plan.dtype)
        chunk[tuple(slice(n) for n in part.shape)] = part
        yield ((0, first) if width else (0,)), chunk


class _Packed:
    """A data set of the packed file, with its rows that do not fill a chunk yet."""

    def __init__(self, plan: DataSetPlan) -> None:
        self.plan = plan
        self._waiting: list[NDArray[Any]] = []
        self._many = 0
        self._id: Any = None

    def make(self, file: Any) -> None:
        """Create the data set in the file."""
        self._id = self.plan.make(file, compressed=True).id

    def fills(self, more: int) -> bool:
        """Return whether `more` further rows complete a chunk."""
        return self._many + more >= self.plan.chunk[0]

    def keep(self, rows: NDArray[Any]) -> None:
        """Keep a copy of further rows."""
        if len(rows):
            self._waiting.append(rows.copy())
            self._many += len(rows)

    def write(self, rows: NDArray[Any], to_the_end: bool) -> None:
        """Pack the waiting rows and further ones.

        With `to_the_end` only rows that fill chunks are packed, otherwise all.
        """
        if self._waiting:
            rows = np.concatenate([*self._waiting, rows])
            self._waiting, self._many = [], 0
        many, done = self.plan.chunk[0], self._id.shape[0]
        end = len(rows) - len(rows) % many if to_the_end else len(rows)
        self._id.set_extent((done + end, *self.plan.tail))
        for first in range(0, end, many):
            for (_, *column), values in chunks(
                self.plan, rows[first : min(end, first + many)]
            ):
                place = done + first, *column
                # `_scale` reads the times, and HDF5 reads no chunk stored as it is before
                # the file is closed
                if self.plan.name == TIME or _is_compressible(values):
                    self._id.write_direct_chunk(place, deflated(values))
                else:
                    self._id.write_direct_chunk(place, values, _NO_FILTERS)
        self.keep(rows[end:])

    def finish(self) -> Any:
        """Pack the remaining rows."""
        self.write(np.empty((0, *self.plan.tail), self.plan.dtype), to_the_end=False)
        return self._id


def deflated(values: NDArray[Any]) -> bytes:
    """Compress a chunk as HDF5's shuffle and deflate filters would.

    Shuffling puts the first bytes of all values first, then the second bytes.
    """
    octets = values.reshape(-1).view(np.uint8).reshape(-1, values.itemsize)
    packed: bytes = isal_zlib.compress(np.ascontiguousarray(octets.T), _LEVEL)
    return packed


def _is_compressible(values: NDArray[Any]) -> bool:
    """Return whether compressing a chunk saves enough, judged by its first rows."""
    sample = values[: max(1, len(values) // _SAMPLED)]
    return len(deflated(sample)) <= _WORTH * sample.nbytes


class Packing:
    """The packed file that is built beside `path`.

    Packing is abandoned if the disk has no room for both files.
    """

    def __init__(
        self,
        path: Path,
        plans: Sequence[DataSetPlan],
        index: str | None,
        about: Mapping[str, str],
    ) -> None:
        self._path, self._index, self._about = path_while_packing(path), index, about
        self._sets = [_Packed(plan) for plan in plans]
        self._file: Any = None
        self._is_lost = False

    def take(self, i: int, rows: NDArray[Any]) -> None:
        """Pack further rows of data set i, or keep a copy until they fill a chunk."""
        if self._is_lost:
            return
        one = self._sets[i]
        if not one.fills(len(rows)):
            one.keep(rows)
            return
        try:
            self._begin()
            one.write(rows, to_the_end=True)
        except _FULL:
            self.drop()

    def leave_room(self, octets: int) -> None:
        """Abandon the packing if the disk has less free space than `octets` bytes."""
        if not self._is_lost and shutil.disk_usage(self._path.parent).free < octets:
            self.drop()

    def finish(self, last: Iterable[tuple[int, NDArray[Any]]] = ()) -> Path | None:
        """Pack the remaining rows and the `last` rows of data sets, and close the file.

        Return its path, or None if it could not be made.
        """
        if self._is_lost:
            return None
        try:
            self._begin()
            for i, rows in last:
                self._sets[i].write(rows, to_the_end=False)
            self._scale([one.finish() for one in self._sets])
            self._file.close()
        except _FULL:
            self.drop()
        return None if self._is_lost else self._path

    def drop(self) -> None:
        """Abandon the packing and remove its file."""
        try:
            if self._file:
                self._file.close()
        except _FULL:
            pass
        self._path.unlink(missing_ok=True)
        self._sets.clear()
        self._is_lost = True

    def _begin(self) -> None:
        """Create the file and its data sets, once."""
        if self._file is not None:
            return
        self._file = h5py.File(self._path, "w")
        self._file.attrs.update(self._about)
        for one in self._sets:
            one.make(self._file)
        if self._index is not None:
            self._file.create_dataset(shared_tables.INDEX, data=self._index)

    def _scale(self, data_sets: list[Any]) -> None:
        """Attach the dimension scales."""
        time, *sets = data_sets
        interval = [one.plan.interval for one in self._sets[1:]]
        h5ds.set_scale(time, b"time")
        rows = [d.shape[0] for d, holds in zip(sets, interval, strict=True) if holds]
        if rows:
            begin = self._file.create_dataset(
                INTERVAL, data=self._file[TIME][: rows[0]]
            )
            begin.attrs.update(
                {"unit": "s", "description": "begin t_k of the interval"}
            )
            h5ds.set_scale(begin.id, b"interval")
        elements: dict[int, Any] = {}
        for dataset, holds in zip(sets, interval, strict=True):
            h5ds.set_label(dataset, 0, b"interval" if holds else b"time")
            h5ds.attach_scale(dataset, begin.id if holds else time, 0)
            for many in dataset.shape[
                1:
            ]:  # readers of netCDF need a scale for each axis
                if many not in elements:
                    name = f"{ELEMENT}{many}"
                    elements[many] = self._file.create_dataset(
                        name, data=np.arange(1, many + 1)
                    )
                    h5ds.set_scale(elements[many].id, name.encode())
                h5ds.set_label(dataset, 1, b"element")
                h5ds.attach_scale(dataset, elements[many].id, 1)
