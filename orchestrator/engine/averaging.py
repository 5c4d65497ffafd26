"""Means and slopes over windows of different length: between components of different rates.

Over a window a quantity is mean + slope (s - 1/2), s from 0 to 1. Of the parts of a window that
follow each other, each with start a and width w as shares of it, mean m and slope p:

    mean = sum w m,   slope = sum w (6 m (2 a + w - 1) + w p)

which keeps the integral and the first moment; and the part (a, w) of a window has

    mean = m + p (a + w / 2 - 1/2),   slope = w p.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..system.rates import Share

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Places:
    """Where means (m,) and their slopes (m,) lie in an array, a negative number where there is no
    slope."""

    means: NDArray[np.intp]
    slopes: NDArray[np.intp]

    @classmethod
    def of(cls, means: Sequence[int], slopes: Sequence[int]) -> Places:
        """From lists of one length."""
        return cls(np.array(means, np.intp), np.array(slopes, np.intp))

    def read(self, values: Floats) -> tuple[Floats, Floats]:
        """Means (m,) and slopes (m,), zero where there is none."""
        slopes = np.where(self.slopes >= 0, values[self.slopes], 0.0)
        return values[self.means], slopes

    def write(self, values: Floats, means: Floats, slopes: Floats) -> None:
        """Put means (m,) and slopes (m,) in their places."""
        values[self.means] = means
        kept = self.slopes >= 0
        values[self.slopes[kept]] = slopes[kept]


class Whole:
    """Joins the parts of a window: outputs of a fast component for a slower one, or for a row."""

    def __init__(
        self, live: Floats, source: Places, into: Floats, target: Places, parts: Sequence[Share]
    ) -> None:
        self.live, self.source, self.into, self.target = live, source, into, target
        self.weights = [(w, 6.0 * w * (2.0 * a + w - 1.0), w * w) for a, w in parts]
        """Of each part: of its mean in the mean and in the slope, and of its slope there."""
        self.mean = np.zeros(len(source.means))
        self.slope = np.zeros(len(source.means))

    def __call__(self, i: int) -> None:
        """Add part i, which was just computed; the last one completes the window."""
        mean, slope = self.source.read(self.live)
        w, of_mean, of_slope = self.weights[i]
        if i == 0:
            self.mean[:] = self.slope[:] = 0.0
        self.mean += w * mean
        self.slope += of_mean * mean + of_slope * slope
        if i == len(self.weights) - 1:
            self.target.write(self.into, self.mean, self.slope)


class Part:
    """Cuts a window: outputs of a slow component for a faster one."""

    def __init__(
        self, live: Floats, source: Places, target: Places, parts: Sequence[Share]
    ) -> None:
        self.live, self.source, self.target = live, source, target
        self.weights = [(a + 0.5 * w - 0.5, w) for a, w in parts]
        """Of each part: of the window's slope in its mean and in its slope."""

    def __call__(self, i: int) -> None:
        """Put part i where the receiver reads it."""
        mean, slope = self.source.read(self.live)
        in_mean, in_slope = self.weights[i]
        self.target.write(self.live, mean + in_mean * slope, in_slope * slope)
