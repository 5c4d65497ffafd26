"""Means and slopes over windows of different length: between components of different rates.

Over a window a quantity is mean + slope (s - 1/2), s from 0 to 1. Of the shares of a window that
follow each other, each with start a and width w, sum w = 1, mean m and slope p:

    mean = sum w m,   slope = sum w (6 m (2 a + w - 1) + w p)

which keeps the integral and the first moment; and the share (a, w) of a window has

    mean = m + p (a + w / 2 - 1/2),   slope = w p.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Share = tuple[float, float]
"""Start and width of a part of a window, as shares of it."""


def shares(count: int, ratio: float = 1.0) -> list[Share]:
    """`count` parts of a window, each `ratio` times as wide as the one before."""
    widths = [ratio**i for i in range(count)]
    edges = [sum(widths[:i]) / sum(widths) for i in range(count)] + [1.0]
    return [(a, b - a) for a, b in pairwise(edges)]


class _Window:
    """A window and its parts: `live` (n,) holds all values; of the others, (m,) each, `means` and
    `slopes` say where in it the source's are (a negative place: there is no slope) and `to_means`
    and `to_slopes` where the receiver's are."""

    def __init__(
        self, live: Floats, means: Sequence[int], slopes: Sequence[int], to_means: Sequence[int],
        to_slopes: Sequence[int], parts: Sequence[Share],
    ) -> None:  # fmt: skip
        self._live, self._parts = live, parts
        self._means, self._to_means = np.array(means), np.array(to_means)
        self._slopes, self._to_slopes = np.array(slopes), np.array(to_slopes)
        self._sloped = self._slopes >= 0
        self._slopes = self._slopes[self._sloped]


class Whole(_Window):
    """Joins the parts of a window: outputs of a fast component for a slower one."""

    def __init__(self, *places: Any) -> None:
        super().__init__(*places)
        self._mean, self._slope = np.zeros(self._means.size), np.zeros(self._means.size)

    def __call__(self, i: int) -> None:
        """Add part i, which was just computed; the last one completes the window."""
        live, (a, w) = self._live, self._parts[i]
        mean = live[self._means]
        if i == 0:
            self._mean[:] = self._slope[:] = 0.0
        self._mean += w * mean
        self._slope += 6.0 * w * (2.0 * a + w - 1.0) * mean
        self._slope[self._sloped] += w * w * live[self._slopes]
        if i == len(self._parts) - 1:
            live[self._to_means], live[self._to_slopes] = self._mean, self._slope


class Part(_Window):
    """Cuts a window: outputs of a slow component for a faster one."""

    def __call__(self, i: int) -> None:
        """Put part i where the receiver reads it."""
        live, (a, w) = self._live, self._parts[i]
        slope = np.zeros(self._means.size)
        slope[self._sloped] = live[self._slopes]
        live[self._to_means] = live[self._means] + (a + 0.5 * w - 0.5) * slope
        live[self._to_slopes] = w * slope
