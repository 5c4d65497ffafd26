"""Put the series of a run side by side in one table, a column for each element."""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa

from ..engine.recording.results import Results
from ..system.errors import DesatError, plain


def table_of(results: Results, with_last: bool = False) -> tuple[pa.Table, str]:
    """Return all series side by side, and a note.

    Interval outputs have no value at the last state. Where there are such, the last
    state is left out and the note says so; or they are nan there (`with_last`).
    """
    counts = [results.count(n) for n in results.names()]
    rows = (max if with_last else min)(counts, default=0)
    times = results.times()
    columns: dict[str, Any] = {"time [s]": times[:rows]}
    for name in results.names():
        unit = results.attribute(name, "unit")
        suffix = f" [{unit}]" if unit not in ("", "1") else ""
        values = results.values(name, slice(0, rows))
        if missing := rows - len(values):
            blank = np.full((missing, *values.shape[1:]), np.nan)
            values = np.concatenate([values, blank])
        if values.ndim == 1:
            added = {f"{name}{suffix}": values}
        else:
            added = {
                f"{name}[{i + 1}]{suffix}": values[:, i] for i in range(values.shape[1])
            }
        for heading in added.keys() & columns.keys():
            raise DesatError(f"{plain(name)}: two series would be the column {heading}")
        columns |= added
    remaining_rows = len(times) - rows
    note = (
        f"states at t = {times[-1]:g} s have no interval after them, and no row"
        if remaining_rows
        else ""
    )
    return pa.table(columns), note
