"""Convert results to xarray data sets that are read on access.

A run has a variable `component.variable` each, over `time`, t_k. A value that holds
from t_k until the next step, as a measurement or a command, has no value at the last
t_k: nan there. Means and slopes over steps are over `interval`, the middles of the
steps. Elements are over `axis` (x, y, z), `quaternion`, `wheel`, `coil`, `nozzle`,
which series share. Units, frames, descriptions and choices are attributes; scenario,
epoch and versions are those of the set.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from ..system.interface import is_mean
from .manifest import attributes

COUNTED = ("wheel", "coil", "nozzle", "thruster")
FRAMES = ("body", "eci", "lvlh")


class Lazy(BackendArray):
    """Array that is read when it is indexed."""

    def __init__(
        self, shape: tuple[int, ...], dtype: Any, read: Callable[[Any], Any]
    ) -> None:
        self.shape, self.dtype, self._read = shape, np.dtype(dtype), read

    def __getitem__(self, key: Any) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )

    def variable(
        self, dims: tuple[str, ...], attributes: dict[str, Any]
    ) -> xr.Variable:
        """Return the array as a variable of a data set."""
        return xr.Variable(dims, indexing.LazilyIndexedArray(self), attributes)


def of_results(manifest: Manifest, results: Results) -> xr.Dataset:
    """Build the data set of a run's series, which are read on access."""
    times = results.times()
    sizes: dict[str, int] = {}
    coordinates: dict[str, Any] = {
        "time": ("time", times, {"units": "s", "long_name": "time t_k"})
    }
    variables: dict[str, xr.Variable] = {}
    for name in results.names():
        dims, labels = dims_of(name, results.values(name, slice(0, 1)).shape[1:])
        if dims and sizes.setdefault(dims[0], len(labels)) != len(labels):
            dims = (
                f"{name}.element",
            )  # a foreign FMU may have another number of wheels
        if dims:
            coordinates[dims[0]] = (dims[0], labels)
        lazy, along = _series(results, name, len(times))
        if along == "interval" and along not in coordinates:
            rows = lazy.shape[0]
            ends = np.append(times[1:], times[-1:])[:rows]
            middle = 0.5 * (times[:rows] + ends)
            time_attributes = {
                "units": "s",
                "long_name": "middle of the step that a mean is over",
            }
            coordinates["interval"] = ("interval", middle, time_attributes)
        variables[name] = lazy.variable((along, *dims), _attributes(results, name))
    time_attributes = {
        **attributes(manifest),
        "status": manifest.status,
        "numbers": json.dumps(manifest.to_json()["numbers"]),
        "manifest": json.dumps(manifest.to_json()),
    }
    return SeriesSet(variables, coordinates, time_attributes)


class SeriesSet(xr.Dataset):  # type: ignore[no-untyped-call]
    """Series of a run, whose table has a column for each element."""

    __slots__ = ()

    def to_dataframe(self, dim_order: Any = None) -> Any:
        """Return a table over `time`: a column each, or `name[label]` for its elements.

        Means over steps stand at the step's beginning, so the last row has none. With
        `dim_order`, of series that share all dimensions, and without `time` it is
        xarray's own, with a row for each combination of dimensions.
        """
        from pandas import (  # type: ignore[import-untyped]
            DataFrame,
            Index,
        )

        begins = {v.dims[:1] for v in self.data_vars.values()}
        elements = {v.dims[1:] for v in self.data_vars.values()}
        is_of_run = begins <= {("time",), ("interval",)}
        shares = len(begins) == 1 and len(elements) == 1
        if dim_order is not None or shares or not is_of_run:
            return super().to_dataframe(dim_order)
        times = self["time"].values
        columns: dict[str, Any] = {}
        for name, variable in self.data_vars.items():
            values = variable.values.reshape(len(variable), -1)
            if len(values) < len(times):
                values = np.vstack([values, np.full((1, values.shape[1]), np.nan)])
            labels = [""]
            if variable.ndim > 1:
                labels = [f"[{x}]" for x in self[variable.dims[1]].values]
            columns |= {f"{name}{x}": values[:, i] for i, x in enumerate(labels)}
        return DataFrame(columns, index=Index(times, name="time"))


def dims_of(name: str, shape: tuple[int, ...]) -> tuple[tuple[str, ...], Sequence[Any]]:
    """Return the dimension of a series' elements, and its labels.

    All series of a kind share the dimension. The labels are x, y and z for vectors, and
    numbers for wheels, coils and nozzles.
    """
    if not shape:
        return (), ()
    (count,) = shape
    variable = name.partition(".")[2]
    kind = variable.rpartition("_")[2]
    if kind in COUNTED:
        return (kind,), range(1, count + 1)
    if kind in FRAMES and count == len("xyz"):
        return ("axis",), list("xyz")
    if variable.startswith("q_") and count == len("xyzw"):
        return ("quaternion",), list("xyzw")
    return (f"{name}.element",), range(1, count + 1)


def _series(results: Results, name: str, length: int) -> tuple[Lazy, str]:
    """Return a lazy series and its dimension, `time` or `interval`.

    Over `time` it has `length` rows, and the last one is nan where a value holds until
    the next step. Over `interval` it has as many rows as there are steps.
    """
    first = results.values(name, slice(0, 1))
    rows = results.count(name)
    along = "interval" if is_mean(name) and rows < length else "time"
    if along == "interval":
        length = rows
    dtype = first.dtype if rows >= length else np.dtype("f8")
    shape = (length, *first.shape[1:])

    return Lazy(shape, dtype, partial(_read, results, name, length, dtype)), along


def _read(
    results: Results, name: str, length: int, dtype: np.dtype[Any], key: tuple[Any, ...]
) -> Any:
    """Read the values of an index of a series of `length` rows."""
    until = partial(_rows, results, name, dtype)
    rows_, *rest = key
    if not isinstance(rows_, slice):
        at = int(rows_)
        value = until(at, at + 1)[0]
        return value[tuple(rest)] if rest else value
    begin, end, step = rows_.indices(length)
    values = until(begin, end)[::step] if step > 0 else until(0, length)[rows_]
    return values[(slice(None), *rest)]


def _rows(
    results: Results, name: str, dtype: np.dtype[Any], begin: int, end: int
) -> Any:
    """Read rows from `begin` to `end`, with nan rows where the series has ended."""
    rows = results.count(name)
    values = results.values(name, slice(begin, min(end, rows))).astype(
        dtype, copy=False
    )
    lacking = max(end - max(begin, rows), 0)
    blank = np.full((lacking, *values.shape[1:]), np.nan)
    return np.concatenate([values, blank.astype(dtype)]) if lacking else values


def _attributes(results: Results, name: str) -> dict[str, Any]:
    """Collect unit, frame, description, class and choices of a series."""
    choices = results.choices(name)
    attributes = {
        "units": results.attribute(name, "unit"),
        "frame": results.attribute(name, "frame"),
        "long_name": results.attribute(name, "description"),
        "class": results.attribute(name, "class"),
    }
    # as one text, which netCDF takes; the value 0 is the first choice
    return attributes | ({"choices": ", ".join(choices)} if choices else {})
