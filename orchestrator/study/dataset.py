"""Results as xarray data sets, read when they are looked at.

Of a run: a variable `component.variable` each, over `time` (states, at t_k) or `interval` (outputs
that hold over [t_k, t_k+1), which have no last row), and over its elements. Units, frames,
descriptions and choices are its attributes; scenario, epoch, versions those of the set.

Of a campaign: `in.*` what was drawn and `out.*` the numbers over `case`, and the envelopes.
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

from ..engine.results import Results
from ..system.errors import DesatError
from .case import load_run
from .manifest import attributes


class _Lazy(BackendArray):
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
        **attributes(manifest), "status": manifest["status"],
        "numbers": json.dumps(manifest["numbers"]), "manifest": json.dumps(manifest),
    }  # fmt: skip
    coordinates = {
        "time": ("time", times, {"units": "s", "long_name": "time t_k of states"}),
        **({"interval": ("interval", times[: lengths["interval"]],
                         {"units": "s", "long_name": "begin t_k of the interval"})}
           if "interval" in lengths else {}),
    }  # fmt: skip
    return xr.Dataset(variables, coordinates, told)


def _series(results: Results, name: str) -> tuple[_Lazy, tuple[str, ...]]:
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

    return _Lazy(shape, first.dtype, read), dims


def _attributes(results: Results, name: str) -> dict[str, Any]:
    choices = results.choices(name)
    told = {
        "units": results.attribute(name, "unit"), "frame": results.attribute(name, "frame"),
        "long_name": results.attribute(name, "description"),
        "class": results.attribute(name, "class"),
    }  # fmt: skip
    return told | ({"choices": list(choices)} if choices else {})


def of_campaign(folder: Path) -> xr.Dataset:
    """The cases of a campaign, a column each, and of each curve the envelopes (case, part). Raises
    DesatError where no case is there yet."""
    from ..campaign import store
    from ..campaign.case import POINTS
    from ..campaign.plan import read

    plan = read(folder)
    cases = store.read(folder, columns=["case"])["case"].to_numpy()
    described = store.described(folder)
    variables: dict[str, xr.Variable] = {}
    for field in store.schema(folder):
        if field.name == "case":
            continue
        lazy = _Lazy((len(cases),), _dtype(field.type), _column(folder, field.name, cases))
        # what is drawn is told of as a whole, and has a column an element
        told = described.get(field.name.removeprefix("out.").partition("[")[0], {})
        variables[field.name] = lazy.variable(
            ("case",), {"long_name": told.get("title", ""), "units": told.get("unit", "")}
        )
    for name in plan.curves:
        lazy = _Lazy((len(cases), POINTS), float, _envelopes(folder, name, cases))
        told = described.get(f"curve.{name}", {})
        variables[f"curve.{name}"] = lazy.variable(
            ("case", "part"),
            {"long_name": f"{told.get('title', name)}: largest size in each part of the run",
             "units": told.get("unit", "")},
        )  # fmt: skip
    attributes = {"target": plan.target, "seed": plan.seed, "sampling": plan.sampling,
                  "count": plan.count}  # fmt: skip
    return xr.Dataset(variables, {"case": cases}, attributes)


def _dtype(kind: Any) -> Any:
    return np.dtype({"double": "f8", "int64": "i8", "int32": "i4"}.get(str(kind), "O"))


def _column(folder: Path, name: str, cases: Any) -> Callable[[Any], Any]:
    """Of these cases, in their order: others may have come since."""

    def read(key: tuple[Any, ...]) -> Any:
        from ..campaign import store

        table = store.read(folder, columns=["case", name])
        if name not in table.column_names:
            return np.full(len(cases), np.nan)[key]
        there = {case: row for row, case in enumerate(table["case"].to_pylist())}
        if lost := [int(case) for case in cases if int(case) not in there]:
            raise DesatError(f"{folder}: case {lost[0]} is not there any more: load it again")
        return table[name].to_pandas().to_numpy()[[there[int(case)] for case in cases]][key]

    return read


def _envelopes(folder: Path, name: str, cases: Any) -> Callable[[Any], Any]:
    def read(key: tuple[Any, ...]) -> Any:
        from ..campaign import store
        from ..campaign.case import POINTS

        table = store.read(folder, store.CURVES)
        known = table[name].to_pylist() if name in table.column_names else [None] * table.num_rows
        rows = dict(zip(table["case"].to_pylist(), known, strict=True))
        blank = [np.nan] * POINTS
        return np.array([rows.get(int(c)) or blank for c in cases], dtype=float)[key]

    return read
