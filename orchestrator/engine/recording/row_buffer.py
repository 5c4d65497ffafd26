"""Rows of a run that are not on the disk yet, in memory that outlives the process that
runs it.

A recorder of a process that is watched keeps its rows here; where that process ends by
a crash, its parent puts them after those that are written.
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

Places = slice | NDArray[np.intp]
"""Columns of a data set among those of its type."""
_HEAD = 64
_WRITTEN, _NEXT, _WHICH, _ACTIVE, _FINAL = range(2, 7)
"""Counts, after the rows taken in each half."""


@dataclass(frozen=True)
class Layout:
    """Where the rows of each data set lie: (path, type, columns, interval)."""

    capacity: int
    """Rows of a half."""
    widths: dict[Kind, tuple[int, str]]
    """Columns and dtype of each type's table."""
    sets: tuple[tuple[str, Kind, Places, bool], ...]


@dataclass(frozen=True, eq=False)
class Bank:
    """Times and tables of rows, of which `taken[0]` are there."""

    taken: NDArray[np.int64]
    times: NDArray[np.float64]
    rows: dict[Kind, NDArray[Any]]


class RowBuffer:
    """Two halves, one of which takes rows while the other is written; `written` are on
    the disk."""

    def __init__(self, file: int | None = None) -> None:
        self._file = file

    @classmethod
    def shared(cls) -> RowBuffer:
        """Memory that a forked process fills, and its parent reads."""
        if hasattr(os, "memfd_create"):
            return cls(os.memfd_create("desat-rows"))
        with tempfile.TemporaryFile() as file:
            return cls(os.dup(file.fileno()))

    def lay_out(self, layout: Layout) -> None:
        """Make counts and tables; what is there already stays."""
        parts = [
            layout.capacity * n * np.dtype(d).itemsize
            for n, d in layout.widths.values()
        ]
        whole = (
            -(-(8 * layout.capacity + sum(parts)) // 8) * 8
        )  # so that doubles lie well
        size = _HEAD + 2 * whole
        if self._file is None:
            memory: Any = np.zeros(
                size, np.uint8
            )  # whose pages are made when they are used
        else:
            os.ftruncate(self._file, size)
            memory = mmap.mmap(self._file, size)
        self._counts = np.frombuffer(memory, np.int64, _HEAD // 8)
        self._halves: list[Bank] = []
        for i in range(2):
            at = _HEAD + i * whole
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
        """The half that takes rows."""
        return self._halves[int(self._counts[_ACTIVE])]

    def swap(self) -> Bank:
        """Let the other half take rows, which is empty; this one."""
        half = self.active
        self._counts[_ACTIVE] = 1 - self._counts[_ACTIVE]
        return half

    @property
    def written(self) -> int:
        """The rows on the disk."""
        return int(max(self._counts[_WRITTEN], self._counts[_NEXT]))

    def left(self) -> tuple[NDArray[np.float64], dict[Kind, NDArray[Any]]]:
        """Times and tables of the rows that only the halves have."""
        active, parts = int(self._counts[_ACTIVE]), []
        for i in (1 - active, active):
            half = self._halves[i]
            gone = (
                self._counts[_NEXT] > self._counts[_WRITTEN]
                and self._counts[_WHICH] == i
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
        """Count the rows of a half that are on the disk now, so that none is counted
        twice if we die here."""
        self._counts[_WHICH] = self._halves.index(half)
        self._counts[_NEXT] = self._counts[_WRITTEN] + half.taken[0]
        half.taken[0] = 0
        self._counts[_WRITTEN] = self._counts[_NEXT]

    def ends_next(self) -> None:
        """Say that the next row is the run's final one, which has no interval values."""
        self._counts[_FINAL] = (
            self.written + sum(int(half.taken[0]) for half in self._halves) + 1
        )

    @property
    def final(self) -> int:
        """The number of rows of which the last has no interval values; 0: of none."""
        return int(self._counts[_FINAL])

    def go_on(self, rows: int) -> None:
        """Count rows that an earlier process has put on the disk."""
        self._counts[[_WRITTEN, _NEXT]] = rows

    def close(self) -> None:
        """Give the memory back."""
        if self._file is not None:
            os.close(self._file)
            self._file = None
