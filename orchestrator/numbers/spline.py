"""Interpolate rows of a run by the cubic spline of scipy, without loading scipy.

Loading scipy takes longer than a run.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Spline:
    """Cubic spline through values (n, ...) at increasing times (n,).

    Its third derivative is continuous at the second time and the last but one ("not a
    knot"). For three values it is a parabola, for two a line.
    """

    def __init__(self, times: Array, values: Array) -> None:
        self._times, self._values = times, values
        self._slopes = _slopes(times, values.reshape(len(times), -1)).reshape(
            values.shape
        )

    def __call__(self, at: Array) -> Array:
        """Interpolate, or extrapolate, to values (*at.shape, ...) at times."""
        interval = np.clip(
            np.searchsorted(self._times, at, "right") - 1, 0, len(self._times) - 2
        )
        tail = (1,) * (self._values.ndim - 1)
        begin, end = (
            self._times[i].reshape(*at.shape, *tail) for i in (interval, interval + 1)
        )
        length, s = end - begin, at.reshape(*at.shape, *tail) - begin
        rise = (self._values[interval + 1] - self._values[interval]) / length
        d0, d1 = self._slopes[interval], self._slopes[interval + 1]
        third = (d0 + d1 - 2.0 * rise) / length
        # in scipy's order of operations, for the same bits
        value = (
            self._values[interval] + d0 * s + ((rise - d0) / length - third) * (s * s)
        )
        return np.asarray(value + third / length * (s * s * s))


def _slopes(times: Array, y: Array) -> Array:
    """Compute the slopes (n, m) at the times from a tridiagonal system.

    The inner rows are those of any cubic spline. The first and the last require that
    the two pieces there are one cubic.
    """
    h = np.diff(times)[:, None]
    rise = np.diff(y, axis=0) / h
    n = len(times)
    if n == 2:
        return np.repeat(rise, 2, axis=0)
    if n == 3:
        middle = (h[1] * rise[0] + h[0] * rise[1]) / (h[0] + h[1])
        return np.stack([2.0 * rise[0] - middle, middle, 2.0 * rise[1] - middle])
    below, above = np.ones((2, n, 1))
    diagonal, right = np.empty((n, 1)), np.empty_like(y)
    below[1:-1], above[1:-1] = h[1:], h[:-1]
    diagonal[1:-1] = 2.0 * (h[:-1] + h[1:])
    right[1:-1] = 3.0 * (h[1:] * rise[:-1] + h[:-1] * rise[1:])
    diagonal[0], above[0] = h[1], times[2] - times[0]
    diagonal[-1], below[-1] = h[-2], times[-1] - times[-3]
    first, last = above[0], below[-1]
    right[0] = ((h[0] + 2.0 * first) * h[1] * rise[0] + h[0] ** 2 * rise[1]) / first
    right[-1] = (h[-1] ** 2 * rise[-2] + (2.0 * last + h[-1]) * h[-2] * rise[-1]) / last
    for i in range(1, n):
        factor = below[i] / diagonal[i - 1]
        diagonal[i] -= factor * above[i - 1]
        right[i] -= factor * right[i - 1]
    right[-1] /= diagonal[-1]
    for i in range(n - 2, -1, -1):
        right[i] = (right[i] - above[i] * right[i + 1]) / diagonal[i]
    return right
