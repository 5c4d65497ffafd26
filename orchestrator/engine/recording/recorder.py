"""Write the series of a run while it runs; `results.py` describes the file layout.

A thread writes and packs rows while the compiled loop, which releases the interpreter
lock, takes further ones. With foreign FMUs rows are written at once.
"""

from __future__ import annotations

import errno
import os
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

import h5py
import numpy as np
from numpy.typing import NDArray

from ...system.errors import DesatError
from ...system.interface import KINDS, Kind, selects
from ..instances.base import DTYPE
from ..master import Master
from ..node import Slot
from . import memory, shared_tables
from .results import Results, frame_of
from .row_buffer import Bank, Layout, Places, RowBuffer
from .series_file import TIME, DataSetPlan, Packing, aside, path_while_packing

T = TypeVar("T")
ROWS = 8192  # rows of each half of the buffer and of a chunk of the file
FLUSH_SECONDS = 1.0
_CACHE = 1 << 18  # bytes: HDF5 would keep 8 MiB of written chunks for each data set
_MOST_ROWS = 1 << 24  # rows for which there is room in memory from the start
_MEMORY = 64 << 20  # bytes: upper bound of the rows that are not written yet


# Type of a data set's values, their columns among those of that type, interval or not.
_Place = tuple[Kind, Places, bool]


class Recorder:
    """Recorder of those outputs of a master that match `patterns`, at every step.

    The numbers of a run use all rows, whichever rows are stored afterwards
    (`Results.thin`). With `path` None the series stay in memory. On disk the file is
    `NAME.part` until `finish`. With `go_on` the first `go_on` rows are copied from the
    existing file of a run that was ended. `about` holds attributes of the file.
    """

    def __init__(
        self,
        path: Path | None,
        master: Master,
        patterns: Iterable[str] = ("*",),
        unwritten: RowBuffer | None = None,
        go_on: int | None = None,
        about: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Open the series file of a run, or memory without a path, for the outputs chosen.

        `patterns` select the series, `unwritten` buffers rows, and `go_on` is the number of
        rows that a continued run has written before.
        """
        self.path = path
        self._part = None if path is None else path.with_name(path.name + ".part")
        if self._part is None:
            self._file: Any = memory.File()
        else:
            self._part.parent.mkdir(parents=True, exist_ok=True)
            new = (
                self._part
                if go_on is None
                else self._part.with_name(self._part.name + ".new")
            )
            self._file = h5py.File(new, "w", libver="latest", rdcc_nbytes=_CACHE)
            self._file.attrs.update(about)
        self._start, self._step = master.start, master.step_size
        live = {k: master.live[k] for k in KINDS if len(master.live[k])}
        fit = _MEMORY // (2 * (8 + sum(a.nbytes for a in live.values())))
        self._chunk = max(1, min(ROWS, fit, master.system.steps + 1))
        # in memory there is room for all rows at once: pages are taken as they fill
        self._capacity = min(master.system.steps + 1, _MOST_ROWS)
        groups: dict[tuple[str, str], list[Slot]] = defaultdict(list)
        for slot in master.slots:
            if slot.kind in KINDS and selects(patterns, slot.component, slot.signal):
                groups[slot.component, slot.signal.series].append(slot)
        series = [
            _series(*name, slots)
            for group in groups.items()
            for name, slots in _rows(*group)
        ]
        index, sets = None, [self._own_data_set(s) for s in series]
        if len(series) > shared_tables.MANY:
            index, sets = self._tables(series)
        about_time = {"unit": "s", "description": "communication points t_k"}
        plans = [
            self._plan(TIME, 0, np.float64, about_time),
            *(plan for plan, _ in sets),
        ]
        self._plans = plans
        self._places = [places for _, places in sets]
        # the times, then the data sets of `_places`
        self._sets = [self._create_data_set(plan) for plan in plans]
        if index is not None:
            self._file.create_dataset(shared_tables.INDEX, data=index)
        self.layout = Layout(
            self._chunk,
            {k: (len(a), a.dtype.str) for k, a in live.items()},
            tuple((plan.name, *places) for plan, places in sets),
        )
        self.unwritten = unwritten or RowBuffer()
        self.unwritten.lay_out(self.layout)
        self._rooms: dict[np.dtype[Any], NDArray[Any]] = {}
        self._gauss_seidel = master.algorithm == "gauss_seidel"
        self._flushed = time.monotonic()
        self._packing = None if path is None else Packing(path, plans, index, about)
        self._writer, self._job = ThreadPoolExecutor(1), Future[None]()
        self._job.set_result(None)
        if path is not None and go_on is not None:
            self._aside(self._take_over, path, go_on)
            self._file.flush()
        if self._part is not None:
            self._file.swmr_mode = (
                True  # flushed rows stay readable if the process is killed
            )
        if path is not None and self._part is not None and go_on is not None:
            self._synchronise()
            new.replace(self._part)
            path.unlink(missing_ok=True)
        # a foreign FMU may call exit(), which makes HDF5 close its files: no thread may
        # be writing at that moment
        self._at_once = path is None or not all(
            member.component.interface.role for member in master.members.values()
        )

    def _take_over(self, path: Path, rows: int) -> None:
        """Copy the first `rows` rows of the existing series."""
        with Results.open(path) as old:
            if (there := len(old.times())) < rows:
                raise DesatError(
                    f"{path.parent}: the series have {there} rows of {rows}"
                )
            for at in range(0, rows, self._chunk):
                block = slice(at, min(rows, at + self._chunk))
                self._append(
                    (i, old.raw(d.name, block)) for i, d in enumerate(self._sets)
                )
        self.unwritten.go_on(rows)

    def on_disk(self) -> int:
        """Write all rows taken so far, so that they survive a power failure.

        Return the number of rows of the run on disk.
        """
        self.flush()
        self._synchronise()
        return self.unwritten.written

    def _synchronise(self) -> None:
        """Force the file to disk."""
        if self._part is not None:
            os.fsync(self._file.id.get_vfd_handle())

    def _own_data_set(
        self, s: shared_tables.SeriesColumns
    ) -> tuple[DataSetPlan, _Place]:
        """Plan a separate data set for a series."""
        columns = 0 if s.scalar else s.columns.stop - s.columns.start
        plan = self._plan(
            f"/{s.component}/{shared_tables.link_of(s.variable)}",
            columns,
            DTYPE[s.kind],
            s.attributes,
        )
        return plan, (s.kind, s.columns, s.interval)

    def _tables(
        self, series: list[shared_tables.SeriesColumns]
    ) -> tuple[str, list[tuple[DataSetPlan, _Place]]]:
        """Plan data sets that many series share, and the index that locates each."""
        tables, index = shared_tables.tables(series)
        return index, [
            (
                self._plan(
                    f"/{shared_tables.name_of(kind, interval)}",
                    len(columns),
                    DTYPE[kind],
                    {},
                ),
                (kind, columns, interval),
            )
            for (kind, interval), columns in tables.items()
        ]

    def _plan(
        self, name: str, columns: int, dtype: Any, attributes: dict[str, str]
    ) -> DataSetPlan:
        """Plan a data set with its chunk size."""
        tail = (columns,) if columns else ()
        chunk = shared_tables.chunk(self._chunk, columns) if columns else (self._chunk,)
        return DataSetPlan(name, tail, np.dtype(dtype), chunk, attributes)

    def _create_data_set(self, plan: DataSetPlan) -> Any:
        """Create a data set in the file."""
        if isinstance(self._file, memory.File):
            data_set = self._file.create_dataset(
                plan.name, plan.tail, plan.dtype, self._capacity
            )
            data_set.attrs.update(plan.attributes)
            return data_set
        # compressed Reals would take seven times as long to write: they are packed beside
        return plan.make(self._file, compressed=plan.dtype != np.float64)

    def record(self, k: int, live: dict[Kind, Any]) -> None:
        """Record the row of step k."""
        self._take(k, live)
        self.make_room()

    def _take(self, k: int, live: dict[Kind, Any]) -> None:
        """Copy the row of step k into the active half of the buffer."""
        half = self.unwritten.active
        row = int(half.taken[0])
        half.times[row] = self._start + k * self._step
        for kind, rows in half.rows.items():
            rows[row] = live[kind]
        half.taken[0] = row + 1

    def make_room(self) -> None:
        """Hand the rows over for writing if the buffer is full."""
        half = self.unwritten.active
        if half.taken[0] == len(half.times):
            self._hand_over()

    def tick(self) -> None:
        """Hand the rows over for writing if a second has passed since the last time.

        Call it now and then.
        """
        if time.monotonic() - self._flushed > FLUSH_SECONDS:
            self._hand_over()

    def _hand_over(self) -> None:
        """Start writing the rows taken so far, after the previous rows are written.

        Raises the error of the previous write, if any.
        """
        self._job.result()
        self._flushed = time.monotonic()
        half = self.unwritten.swap()
        if self._at_once:
            self._aside(self._write, half)
        else:
            self._job = self._writer.submit(self._write, half)

    def _aside(self, work: Callable[..., T], *argument: Any) -> T:
        """Run the work now, in the writer's thread if there is one (`_packing`)."""
        if self._packing is None:
            return work(*argument)
        return self._writer.submit(work, *argument).result()

    def flush(self) -> None:
        """Write the rows taken so far."""
        self._job.result()
        self._aside(self._write, self.unwritten.active)

    def _write(self, half: Bank, last: bool = False) -> None:
        """Write the rows of a half and pack them.

        With `last` they are not packed, and the final row has no interval values.
        """
        try:
            if half.taken[0] and self._packing is not None:
                self._packing.leave_room(self._file.id.get_filesize())
            self._append(self._rows(half, last), pack=not last)
            self._file.flush()
        except BaseException:
            if self._packing is not None:
                self._packing.drop()
            raise
        self.unwritten.wrote(half)

    def _rows(self, half: Bank, last: bool) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield the rows of a half for each data set, if there are any.

        The rows of the next data set reuse the same memory.
        """
        if not (n := int(half.taken[0])):
            return
        yield 0, half.times[:n]
        for i, (kind, columns, interval) in enumerate(self._places, 1):
            if many := n - (last and interval):
                rows = half.rows[kind][:many, columns]
                if self._packing is not None:
                    rows = self._together(rows)
                yield i, rows.reshape(many, *self._plans[i].tail)

    def _append(
        self, rows_of: Iterable[tuple[int, NDArray[Any]]], pack: bool = True
    ) -> None:
        """Append rows to data sets."""
        for i, rows in rows_of:
            if self._packing is None:
                self._sets[i].append(rows)
            elif len(rows):
                self._plans[i].append(self._sets[i].id, rows)
                if pack:
                    self._packing.take(i, rows)

    def _together(self, rows: NDArray[Any]) -> NDArray[Any]:
        """Copy rows into contiguous memory.

        The copy goes column by column, which takes half the time. It always uses the
        same memory, because new pages cost more than the values.
        """
        if rows.flags.c_contiguous:
            return rows
        if (buffer := self._rooms.get(rows.dtype)) is None or len(buffer) < rows.size:
            buffer = self._rooms[rows.dtype] = np.empty(rows.size, rows.dtype)
        together = buffer[: rows.size].reshape(rows.shape)
        for j in range(rows.shape[1]):
            together[:, j] = rows[:, j]
        return together

    def finish(self, master: Master) -> Results:
        """Record the last row, rename the closed file and open it for reading."""
        last = self._gauss_seidel
        if last:
            self.unwritten.ends_next()
            self._take(master.k, master.live)
        self._job.result()
        half = self.unwritten.active
        if self._part is None or self.path is None or self._packing is None:
            self._write(half, last)
            return Results(self._file)
        packed = self._aside(self._packing.finish, self._rows(half, last))
        if packed is None:
            self._aside(self._write, half, last)
        self._writer.shutdown()
        self._file.close()
        (packed or self._part).replace(self.path)
        self._part.unlink(missing_ok=True)
        return Results.open(self.path)


def _rows(
    name: tuple[str, str], slots: list[Slot]
) -> Iterator[tuple[tuple[str, str], list[Slot]]]:
    """Yield the name and slots of a series.

    Each slot is a series by itself if a scenario has made some of its elements interval
    outputs, so that they are not contiguous.
    """
    slots.sort(key=lambda s: s.index)
    if slots[-1].index - slots[0].index == len(slots) - 1:
        yield name, slots
        return
    yield from (((name[0], s.signal.name), [s]) for s in slots)


def _series(
    component: str, variable: str, slots: list[Slot]
) -> shared_tables.SeriesColumns:
    """Describe a variable from the slots of its elements."""
    signal = slots[0].signal
    attributes = {
        "unit": signal.unit_name,
        "frame": frame_of(variable),
        "description": signal.description,
        "class": "interval" if slots[0].interval else "state",
    }
    if signal.choices:
        attributes["choices"] = " ".join(signal.choices)
    columns = slice(slots[0].index, slots[-1].index + 1)
    return shared_tables.SeriesColumns(
        component,
        variable,
        slots[0].kind,
        columns,
        slots[0].interval,
        signal.name == variable,
        attributes,
    )


def recover(part: Path, path: Path, layout: Layout, unwritten: RowBuffer) -> int:
    """Complete the series of a process that died and return the number of rows.

    The rows are those surely on disk, in `part`, followed by those in memory. Raises
    OSError if there is no space left.
    """
    unwritten.lay_out(layout)
    written, (times, tables) = unwritten.written, unwritten.read_unwritten()
    rows = written + len(times)
    without = int(0 < rows == unwritten.final)
    path_while_packing(path).unlink(missing_ok=True)
    lasts = [(times, rows)]
    for _, kind, columns, interval in layout.sets:
        lasts.append((tables[kind][:, columns], rows - without * interval))
    packed = aside(
        _packed,
        part,
        path,
        ["time", *(name for name, *_ in layout.sets)],
        written,
        lasts,
    )
    if packed is None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
    packed.replace(path)
    part.unlink()
    return rows


def _packed(
    part: Path,
    path: Path,
    names: list[str],
    written: int,
    lasts: list[tuple[NDArray[Any], int]],
) -> Path | None:
    """Pack the rows of each data set into a new file.

    They are the first `written` rows of the old file, followed by the rows in `lasts`.
    Return None if the disk is full.
    """
    with h5py.File(part, "r", swmr=True) as old:
        index = old[shared_tables.INDEX][()] if shared_tables.INDEX in old else None
        plans = [DataSetPlan.of(old[name]) for name in names]
        packing = Packing(path, plans, index, dict(old.attrs))
        for i, (name, (last, rows)) in enumerate(zip(names, lasts, strict=True)):
            there, many = min(written, rows), plans[i].chunk[0]
            for first in range(0, there, many):
                packing.take(i, old[name][first : min(there, first + many)])
            missing_rows = last[: rows - there].reshape(-1, *plans[i].tail)
            packing.take(i, np.ascontiguousarray(missing_rows))
        return packing.finish()
