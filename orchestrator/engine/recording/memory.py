"""Keep series in arrays, without a file: the part of h5py's `File` that is used here.

HDF5's own file in memory takes as long to record a short run as all steps of the run
take.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Rows:
    """Rows that grow, with their attributes."""

    def __init__(
        self, name: str, tail: tuple[int, ...], dtype: Any, capacity: int
    ) -> None:
        self.name = name
        self.attrs: dict[str, str] = {}
        self._all = np.zeros((capacity, *tail), dtype)
        self._rows = 0

    @property
    def shape(self) -> tuple[int, ...]:
        """Return (rows,) or (rows, elements)."""
        return (self._rows, *self._all.shape[1:])

    @property
    def ndim(self) -> int:
        """Return 1 for a scalar and 2 otherwise."""
        return self._all.ndim

    def append(self, rows: NDArray[Any]) -> None:
        """Append rows."""
        there, rows_needed = self._rows, self._rows + len(rows)
        if rows_needed > len(self._all):
            tail = self._all.shape[1:]
            grown = np.zeros(
                (max(rows_needed, 2 * len(self._all)), *tail), self._all.dtype
            )
            grown[:there] = self._all[:there]
            self._all = grown
        self._all[there:rows_needed] = rows
        self._rows = rows_needed

    def thin(self, every: int) -> None:
        """Keep every `every`-th row, from the first on."""
        self._all = self._all[: self._rows : every].copy()
        self._rows = len(self._all)

    def __getitem__(self, at: Any) -> NDArray[Any]:
        # a copy, as from a file, so that changing it does not change the series
        return np.array(self._all[: self._rows][at])


class File:
    """Data sets by name: `time`, `component/variable`, tables."""

    def __init__(self) -> None:
        self.attrs: dict[str, str] = {}
        self._groups: dict[str, Any] = {}

    def create_dataset(
        self,
        name: str,
        tail: tuple[int, ...] = (),
        dtype: Any = None,
        capacity: int = 1,
        *,
        data: str | None = None,
    ) -> Any:
        """Create a data set with room for `capacity` rows, or one that holds a text."""
        members = {(): data} if data is not None else Rows(name, tail, dtype, capacity)
        group, _, variable = name.strip("/").partition("/")
        (self._groups.setdefault(group, {}) if variable else self._groups)[
            variable or group
        ] = members
        return members

    def __getitem__(self, name: str) -> Any:
        group, _, variable = name.strip("/").partition("/")
        return self._groups[group][variable] if variable else self._groups[group]

    def __contains__(self, name: str) -> bool:
        return name in self._groups

    def __iter__(self) -> Iterator[str]:
        return iter(sorted(self._groups))

    def thin(self, every: int) -> None:
        """Keep every `every`-th row of every data set, from the first on."""
        for group in self._groups.values():
            for rows in group.values() if isinstance(group, dict) else (group,):
                if isinstance(rows, Rows):
                    rows.thin(every)

    def flush(self) -> None:
        """Do nothing, as there is no file to write to."""

    def close(self) -> None:
        """Release all data sets."""
        self._groups.clear()
