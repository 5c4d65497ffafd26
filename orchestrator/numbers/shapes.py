"""Shorten lines to the minimum and maximum of each of many parts, as a plot shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .derived import BLOCK

Array = NDArray[np.float64]
LONG = 400_000  # rows; lines of more are shortened as they are read
PARTS = 10_000  # of such a line


def split(x: Array, parts: int) -> tuple[Array, NDArray[np.intp]]:
    """Split growing x into parts of equal length.

    Returns
    -------
    tuple
        Two values of x for each part (2 parts,), and the row at which each begins
        (parts,).
    """
    edges = np.linspace(x[0], x[-1], parts + 1)
    quarter = 0.25 * (edges[1] - edges[0])
    middles = np.column_stack([edges[:-1] + quarter, edges[1:] - quarter]).ravel()
    middles[0], middles[-1] = x[0], x[-1]
    return middles, np.searchsorted(x, edges[:-1])


def extremes(y: Array, starts: NDArray[np.intp]) -> Array:
    """Compute minimum and maximum of the parts that begin at these rows (2 parts,).

    They are in about the order in which they occur, and nan where a part has no value.
    """
    counts = np.diff(np.minimum(starts, len(y)), append=len(y))
    some = counts > 0
    begin = starts[some]
    least, most = (
        (np.fmin, np.fmax) if np.isnan(y.min()) else (np.minimum, np.maximum)
    )  # the latter are faster
    low, high = least.reduceat(y, begin), most.reduceat(y, begin)
    falls = y[begin] > y[begin + counts[some] - 1]
    ends = np.full((len(starts), 2), np.nan)
    ends[some, 0], ends[some, 1] = (
        np.where(falls, high, low),
        np.where(falls, low, high),
    )
    return ends.ravel()


def shape_of(times: Array, read: Callable[[slice], Any]) -> tuple[Array, Array, int]:
    """Return times, values (rows, elements) and the number of rows of all samples.

    A line of more than `LONG` rows has the extremes of each of its parts.

    Parameters
    ----------
    times
        Times (s) of all rows.
    read
        Function that returns rows of the values, (rows,) or (rows, elements).
    """
    rows = len(times)
    if rows <= LONG:
        values = np.asarray(read(slice(0, rows)), float)
        return times, values if values.ndim > 1 else values[:, None], rows
    middles, starts = split(times, PARTS)
    parts = [
        _extremes_of(np.asarray(read(r), float), s) for r, s in _groups(rows, starts)
    ]
    return middles, np.concatenate(parts), rows


def alternate(times: Array, least: Array, most: Array) -> tuple[Array, Array]:
    """Return times (2 rows,) and values (2 rows, elements) of extremes, in turn.

    Those of a row (rows,) or (rows, elements) hold until the next.
    """
    halves = 0.5 * np.diff(times, append=times[-1:] + np.diff(times)[-1:])
    both = np.stack([least, most], axis=1).astype(float)
    values = both.reshape(2 * len(least), -1)
    return np.column_stack([times, times + halves])[: len(least)].ravel(), values


def _groups(
    rows: int, starts: NDArray[np.intp]
) -> Iterator[tuple[slice, NDArray[np.intp]]]:
    """Yield the rows of some whole parts, and where the parts begin among them."""
    some = max(1, len(starts) * BLOCK // rows)
    for first in range(0, len(starts), some):
        begins = starts[first : first + some]
        end = starts[first + some] if first + some < len(starts) else rows
        yield slice(int(begins[0]), int(end)), begins - begins[0]


def _extremes_of(values: Array, starts: NDArray[np.intp]) -> Array:
    """Compute the extremes of each element (2 parts, elements)."""
    columns = values.reshape(len(values), -1).T
    return np.column_stack([extremes(y, starts) for y in columns])
