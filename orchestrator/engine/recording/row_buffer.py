"""Buffer unwritten rows of a run in memory that outlives the process.

The recorder of a supervised process keeps its rows here. If that process crashes, its
parent appends them to those that are written.
"""

from __future__ import annotations

import mmap
import os
import tempfile
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...system.interface import Kind

Places = slice | NDArray[np.intp]  # columns of a data set among those of its type
_HEAD = 64
# Indices of the counts; 0 and 1 are the rows taken in each half.
_WRITTEN, _NEXT, _BUFFER_INDEX, _ACTIVE, _FINAL = range(2, 7)


@dataclass(frozen=True)
class Layout:
    """Layout of the rows of each data set: (path, type, columns, interval)."""

    capacity: int  # rows of a half
    widths: dict[Kind, tuple[int, str]]  # columns and dtype of each type's table
    sets: tuple[tuple[str, Kind, Places, bool], ...]


@dataclass(frozen=True, eq=False)
class Bank:
    """Times and tables of rows; the first `taken[0]` rows are filled."""

    taken: NDArray[np.int64]
    times: NDArray[np.float64]
    rows: dict[Kind, NDArray[Any]]


class RowBuffer:
    """Two halves: one takes rows while the other is written.

    `written` rows are on disk.
    """

    def __init__(self, file: int | None = None) -> None:
        self._file = file

    @classmethod
    def shared(cls) -> RowBuffer:
        """Create a buffer that a forked process fills and its parent reads."""
        if hasattr(os, "memfd_create"):
            return cls(os.memfd_create("desat-rows"))
        with tempfile.TemporaryFile() as file:
            return cls(os.dup(file.fileno()))

    def lay_out(self, layout: Layout) -> None:
        """Lay out counts and tables; existing content is preserved."""
        parts = [
            layout.capacity * n * np.dtype(d).itemsize
            for n, d in layout.widths.values()
        ]
        octets = (
            -(-(8 * layout.capacity + sum(parts)) // 8) * 8
        )  # align doubles to 8 bytes
        size = _HEAD + 2 * octets
        if self._file is None:
            memory: Any = np.zeros(
                size, np.uint8
            )  # its pages are allocated at first use
        else:
            os.ftruncate(self._file, size)
            memory = mmap.mmap(self._file, size)
        self._counts = np.frombuffer(memory, np.int64, _HEAD // 8)
        self._halves: list[Bank] = []
        for i in range(2):
            at = _HEAD + i * octets
            times = np.frombuffer(memory, np.float64, layout.capacity, at)
            at += 8 * layout.capacity
            rows: dict[Kind, NDArray[Any]] = {}
            for (kind, (columns, dtype)), part in zip(
                layout.widths.items(), parts, strict=True
            ):
                flat = np.frombuffer(memory, dtype, layout.capacity * columns, at)
                rows[kind] = flat.reshape(layout.capacity, columns)
                at += part
            self._halves.append(Bank(self._counts[i : i + 1], times, rows))

    @property
    def active(self) -> Bank:
        """Return the half that takes rows."""
        return self._halves[int(self._counts[_ACTIVE])]

    def swap(self) -> Bank:
        """Make the other half, which is empty, the active one, and return this one."""
        half = self.active
        self._counts[_ACTIVE] = 1 - self._counts[_ACTIVE]
        return half

    @property
    def written(self) -> int:
        """Return the number of rows on disk."""
        return int(max(self._counts[_WRITTEN], self._counts[_NEXT]))

    def read_unwritten(self) -> tuple[NDArray[np.float64], dict[Kind, NDArray[Any]]]:
        """Return times and tables of the rows that are only in the buffer."""
        active, parts = int(self._counts[_ACTIVE]), []
        for i in (1 - active, active):
            half = self._halves[i]
            gone = (
                self._counts[_NEXT] > self._counts[_WRITTEN]
                and self._counts[_BUFFER_INDEX] == i
            )
            parts.append((half, 0 if gone else int(half.taken[0])))
        return (
            np.concatenate([half.times[:n] for half, n in parts]),
            {
                k: np.concatenate([half.rows[k][:n] for half, n in parts])
                for k in self.active.rows
            },
        )

    def wrote(self, half: Bank) -> None:
        """Mark the rows of a half as written.

        The order of the updates prevents rows from being counted twice if the process
        dies here.
        """
        self._counts[_BUFFER_INDEX] = self._halves.index(half)
        self._counts[_NEXT] = self._counts[_WRITTEN] + half.taken[0]
        half.taken[0] = 0
        self._counts[_WRITTEN] = self._counts[_NEXT]

    def ends_next(self) -> None:
        """Mark the next row as the run's final one, which has no interval values."""
        self._counts[_FINAL] = (
            self.written + sum(int(half.taken[0]) for half in self._halves) + 1
        )

    @property
    def final(self) -> int:
        """Return the number of rows at the run's final row, or 0 before it is marked.

        The final row has no interval values.
        """
        return int(self._counts[_FINAL])

    def go_on(self, rows: int) -> None:
        """Count rows that an earlier process has written to disk."""
        self._counts[[_WRITTEN, _NEXT]] = rows

    def close(self) -> None:
        """Release the memory."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
