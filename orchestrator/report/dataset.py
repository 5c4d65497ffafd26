"""Results as xarray data sets, read when they are looked at.

Of a run: a variable `component.variable` each, over `time` (states, at t_k) or `interval` (outputs
that hold over [t_k, t_k+1), which have no last row), and over its elements. Units, frames,
descriptions and choices are its attributes; scenario, epoch, versions those of the set.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from xarray.backends import BackendArray
from xarray.core import indexing

from ..engine.recording.results import Results
from ..runs.manifest import attributes
from ..runs.run import load_run


class Lazy(BackendArray):
    """An array that is read where it is indexed."""

    def __init__(self, shape: tuple[int, ...], dtype: Any, read: Callable[[Any], Any]) -> None:
        self.shape, self.dtype, self._read = shape, np.dtype(dtype), read

    def __getitem__(self, key: Any) -> Any:
        return indexing.explicit_indexing_adapter(
            key, self.shape, indexing.IndexingSupport.BASIC, self._read
        )

    def variable(self, dims: tuple[str, ...], attributes: dict[str, Any]) -> xr.Variable:
        """It as a variable of a data set."""
        return xr.Variable(dims, indexing.LazilyIndexedArray(self), attributes)


def of_run(folder: Path) -> xr.Dataset:
    """A run's series. Raises DesatError where the folder has none."""
    run = load_run(folder)
    results, manifest = run.results, run.manifest
    times = results.times()
    variables: dict[str, xr.Variable] = {}
    lengths = {"time": len(times)}
    for name in results.names():
        lazy, dims = _series(results, name)
        lengths[dims[0]] = min(lazy.shape[0], lengths.get(dims[0], lazy.shape[0]))
        variables[name] = lazy.variable(dims, _attributes(results, name))
    told = {
        **attributes(manifest), "status": manifest.status,
        "numbers": json.dumps(manifest.to_json()["numbers"]),
        "manifest": json.dumps(manifest.to_json()),
    }  # fmt: skip
    coordinates = {
        "time": ("time", times, {"units": "s", "long_name": "time t_k of states"}),
        **({"interval": ("interval", times[: lengths["interval"]],
                         {"units": "s", "long_name": "begin t_k of the interval"})}
           if "interval" in lengths else {}),
    }  # fmt: skip
    return xr.Dataset(variables, coordinates, told)


def _series(results: Results, name: str) -> tuple[Lazy, tuple[str, ...]]:
    first = results.values(name, slice(0, 1))
    rows = results.count(name)
    along = "interval" if results.attribute(name, "class") == "interval" else "time"
    dims = (along,) if first.ndim == 1 else (along, f"{name}.element")
    shape = (rows, *first.shape[1:])

    def read(key: tuple[Any, ...]) -> Any:
        rows_, *rest = key
        if isinstance(rows_, slice):
            begin, end, step = rows_.indices(rows)
            if step > 0:
                values = results.values(name, slice(begin, end))[::step]
            else:
                values = results.values(name)[rows_]
        else:
            at = int(rows_)
            values = results.values(name, slice(at, at + 1))[0]
            return values[tuple(rest)] if rest else values
        return values[(slice(None), *rest)]

    return Lazy(shape, first.dtype, read), dims


def _attributes(results: Results, name: str) -> dict[str, Any]:
    choices = results.choices(name)
    told = {
        "units": results.attribute(name, "unit"), "frame": results.attribute(name, "frame"),
        "long_name": results.attribute(name, "description"),
        "class": results.attribute(name, "class"),
    }  # fmt: skip
    return told | ({"choices": list(choices)} if choices else {})
