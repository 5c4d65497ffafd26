"""Results as xarray data sets, read when they are looked at.

Of a run: a variable `component.variable` each, over `time`, t_k. What holds from t_k on
until the next step, as a measured or a commanded value, has no value at the last t_k:
nan there. Means and slopes over steps are over `interval`, the middles of the steps.
Elements are over `axis` (x, y, z), `quaternion`, `wheel`, `coil`, `nozzle`, which
series share. Units, frames, descriptions and choices are attributes; scenario, epoch,
versions those of the set.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from ..analyses.manifest import Manifest
from ..engine.recording.results import Results
from .manifest import attributes

COUNTED = ("wheel", "coil", "nozzle", "thruster")
FRAMES = ("body", "eci", "lvlh")


class Lazy(BackendArray):
    """An array that is read where it is indexed."""

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
        """It as a variable of a data set."""
        return xr.Variable(dims, indexing.LazilyIndexedArray(self), attributes)


def of_results(manifest: Manifest, results: Results) -> xr.Dataset:
    """The series of a run, read when they are looked at."""
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
            )  # as of a foreign FMU with another number of wheels
        if dims:
            coordinates[dims[0]] = (dims[0], labels)
        lazy, along = _series(results, name, len(times))
        if along == "interval" and along not in coordinates:
            rows = lazy.shape[0]
            ends = np.append(times[1:], times[-1:])[:rows]
            middle = 0.5 * (times[:rows] + ends)
            told = {"units": "s", "long_name": "middle of the step that a mean is over"}
            coordinates["interval"] = ("interval", middle, told)
        variables[name] = lazy.variable((along, *dims), _attributes(results, name))
    told = {
        **attributes(manifest),
        "status": manifest.status,
        "numbers": json.dumps(manifest.to_json()["numbers"]),
        "manifest": json.dumps(manifest.to_json()),
    }
    return xr.Dataset(variables, coordinates, told)


def dims_of(name: str, shape: tuple[int, ...]) -> tuple[tuple[str, ...], Sequence[Any]]:
    """The dimension of a series' elements, which all series of its kind share, and its
    labels: x, y and z of vectors, numbers of wheels, coils and nozzles."""
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


def is_mean(name: str) -> bool:
    """Whether a series is of means, or slopes, over each step."""
    return "_mean_" in name or "_slope_" in name


def _series(results: Results, name: str, length: int) -> tuple[Lazy, str]:
    """A series of `length` rows over `time`, the last of which is not a number where it
    holds until the next; or over `interval`, with as many rows as there are steps."""
    first = results.values(name, slice(0, 1))
    rows = results.count(name)
    along = "interval" if is_mean(name) and rows < length else "time"
    if along == "interval":
        length = rows
    dtype = first.dtype if rows >= length else np.dtype("f8")
    shape = (length, *first.shape[1:])

    def until(begin: int, end: int) -> Any:
        values = results.values(name, slice(begin, min(end, rows))).astype(
            dtype, copy=False
        )
        lacking = max(end - max(begin, rows), 0)
        blank = np.full((lacking, *values.shape[1:]), np.nan)
        return np.concatenate([values, blank.astype(dtype)]) if lacking else values

    def read(key: tuple[Any, ...]) -> Any:
        rows_, *rest = key
        if not isinstance(rows_, slice):
            at = int(rows_)
            value = until(at, at + 1)[0]
            return value[tuple(rest)] if rest else value
        begin, end, step = rows_.indices(length)
        values = until(begin, end)[::step] if step > 0 else until(0, length)[rows_]
        return values[(slice(None), *rest)]

    return Lazy(shape, dtype, read), along


def _attributes(results: Results, name: str) -> dict[str, Any]:
    choices = results.choices(name)
    told = {
        "units": results.attribute(name, "unit"),
        "frame": results.attribute(name, "frame"),
        "long_name": results.attribute(name, "description"),
        "class": results.attribute(name, "class"),
    }
    return told | ({"choices": list(choices)} if choices else {})
