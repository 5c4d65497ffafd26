"""A series of a run as a value to compute with: what pages compare and draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from desat.numbers.derived import pointing
from desat.system.errors import DesatError


@dataclass(frozen=True)
class Series:
    """Times (rows,) in s and values (rows,) or (rows, elements); each operation gives
    another."""

    times: Any
    values: Any

    def norm(self) -> Series:
        """The size of a vector."""
        return Series(self.times, np.linalg.norm(self.values, axis=1))

    def mean_size(self) -> Series:
        """The mean size of the elements."""
        return Series(self.times, np.abs(self.values).mean(axis=1))

    def largest_size(self) -> Series:
        """The largest size of the elements."""
        return Series(self.times, np.abs(self.values).max(axis=1))

    def sum_of_sizes(self) -> Series:
        """The sum of the elements' sizes."""
        return Series(self.times, np.abs(self.values).sum(axis=1))

    def element(self, number: int) -> Series:
        """One element, from 1 on."""
        return Series(self.times, self.values[:, number - 1])

    def until(self, end: float) -> Series:
        """The rows up to a time (s)."""
        saved = self.times <= end + 1e-6
        return Series(self.times[saved], self.values[saved])

    def every(self, seconds: float) -> Series:
        """The rows whose time is a multiple of so many seconds."""
        saved = np.abs(self.times / seconds - np.round(self.times / seconds)) < 1e-6
        return Series(self.times[saved], self.values[saved])

    def mean_over(self, seconds: float) -> Series:
        """The mean of each so many seconds, at their middle: of what is switched on and
        off from row to row, where `every` would show chance. An end that is shorter is
        left out."""
        rows = round(seconds / float(self.times[1] - self.times[0]))
        n = len(self.times) // rows

        def mean(x: Any) -> Any:
            return x[: n * rows].reshape(n, rows, *x.shape[1:]).mean(axis=1)

        return Series(mean(self.times), mean(self.values))

    def largest(self, since: float = 0.0) -> float:
        """The largest size of any element from a time (s) on; nan where there is no
        row."""
        sizes = np.abs(self.values[self.times >= since - 1e-6])
        return float(sizes.max()) if sizes.size else float("nan")

    def __mul__(self, factor: float) -> Series:
        return Series(self.times, self.values * factor)

    def __truediv__(self, divisor: float) -> Series:
        return Series(self.times, self.values / divisor)

    def __sub__(self, other: Series) -> Series:
        _, here, there = self._both(other)
        return Series(self.times[: len(here)], here - there)

    def angle(self, other: Series) -> Series:
        """The angle (deg) between this attitude and another."""
        times, here, there = self._both(other)
        return Series(times, pointing(here, there))

    def _both(self, other: Series) -> tuple[Any, Any, Any]:
        """Times and both values where both have rows (an interval output has no last
        one)."""
        n = min(len(self.times), len(other.times))
        if not np.allclose(self.times[:n], other.times[:n], atol=1e-6):
            raise DesatError(
                "two series of different times; `every` takes those that both have"
            )
        return self.times[:n], self.values[:n], other.values[:n]
