"""Convert a campaign to an xarray data set that is read on access.

It has drawn values `in.*` and numbers `out.*` over `case`, or the envelopes of curves.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from ..runs.dataset import Lazy
from ..system.errors import DesatError
from . import store
from .case import POINTS
from .plan import read


def of_campaign(folder: Path, curves: bool = False) -> xr.Dataset:
    """Build the data set of the cases of a campaign, a variable per column.

    With `curves` it has the envelopes (case, part) of each curve instead.

    Raises
    ------
    DesatError
        If there are no cases yet.
    """
    plan = read(folder)
    cases = store.read(folder, columns=["case"])["case"].to_numpy()
    descriptions = store.described(folder)
    variables: dict[str, xr.Variable] = {}
    for field in () if curves else store.schema(folder):
        if field.name == "case":
            continue
        lazy = Lazy(
            (len(cases),), _dtype(field.type), _column(folder, field.name, cases)
        )
        # drawn arrays are described as a whole, but have a column per element
        description = descriptions.get(
            field.name.removeprefix("out.").partition("[")[0], {}
        )
        variables[field.name] = lazy.variable(
            ("case",),
            {
                "long_name": description.get("title", ""),
                "units": description.get("unit", ""),
            },
        )
    for name in plan.curves if curves else ():
        lazy = Lazy((len(cases), POINTS), float, _envelopes(folder, name, cases))
        description = descriptions.get(f"curve.{name}", {})
        variables[f"curve.{name}"] = lazy.variable(
            ("case", "part"),
            {
                "long_name": f"{description.get('title', name)}: largest size in each part of the run",
                "units": description.get("unit", ""),
            },
        )
    attributes = {
        "target": plan.target,
        "seed": plan.seed,
        "sampling": plan.sampling,
        "count": plan.count,
    }
    return xr.Dataset(variables, {"case": cases}, attributes)


def _dtype(kind: Any) -> Any:
    """Return the numpy type of a column."""
    return np.dtype({"double": "f8", "int64": "i8", "int32": "i4"}.get(str(kind), "O"))


def _column(folder: Path, name: str, cases: Any) -> Callable[[Any], Any]:
    """Build the function that reads a column for these cases, in their order.

    Other cases may have come since.
    """

    def read(key: tuple[Any, ...]) -> Any:
        """Read the column, and select cases by an index."""
        table = store.read(folder, columns=["case", name])
        if name not in table.column_names:
            return np.full(len(cases), np.nan)[key]
        column = table.to_pandas().set_index("case")[name]
        if missing := [case for case in cases if case not in column.index]:
            raise DesatError(
                f"{folder}: case {missing[0]} no longer exists: load the campaign again"
            )
        values = column.loc[cases].to_numpy()
        if str(table.schema.field(name).type).startswith("list"):
            values = np.array(["; ".join(each) for each in values], dtype=object)
        return values[key]

    return read


def _envelopes(folder: Path, name: str, cases: Any) -> Callable[[Any], Any]:
    """Build the function that reads the envelopes of a curve for these cases."""

    def read(key: tuple[Any, ...]) -> Any:
        """Read the envelopes, and select by an index; nan for cases without one."""
        table = store.read(folder, store.CURVES)
        known = (
            table[name].to_pylist()
            if name in table.column_names
            else [None] * table.num_rows
        )
        rows = dict(zip(table["case"].to_pylist(), known, strict=True))
        blank = [np.nan] * POINTS
        return np.array([rows.get(int(c)) or blank for c in cases], dtype=float)[key]

    return read
