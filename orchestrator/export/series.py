"""Export a run's series for other programs, with quantity and unit in every name.

csv, parquet: a column for each element, `component.variable[i] [unit]`, and `time [s]`.

mat: a struct for each component, with `time`, `interval` and `units` (MATLAB, Octave,
scipy).

png, pdf: the scenario's plots, a file each.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from ..figures.painting import paint
from ..files import io
from ..runs.run import Run, load_run
from ..system.errors import DesatError, plain

FORMATS = ("csv", "parquet", "mat", "png", "pdf")


def export(folder: Path, form: str, into: Path | None = None) -> tuple[list[Path], str]:
    """Write a run folder's series or plots in a format; return the files and a note.

    Raises
    ------
    DesatError
        If the format is unknown, or the folder has no series.
    """
    if form not in FORMATS:
        raise DesatError(f"--format {form}: there are {', '.join(FORMATS)}")
    run = load_run(folder)
    into = into or folder
    if form in ("png", "pdf"):
        return _plots(run, form, folder, into), ""
    path, note = into / f"series.{form}", ""
    with io.replacing_file(path) as file:
        if form == "mat":
            from scipy.io import savemat

            structs = _structs(run)
            savemat(
                file,
                structs,
                appendmat=False,
                do_compression=True,
                long_field_names=True,
            )
        else:
            table, note = _table(run)
            _write_table(table, form, file)
    return [path], note


def _write_table(table: pa.Table, form: str, file: BinaryIO) -> None:
    """Write a table as csv or parquet."""
    if form == "csv":
        from pyarrow import csv

        names = [no_formula(name) for name in table.column_names]
        csv.write_csv(table.rename_columns(names), file)
    else:
        from pyarrow import parquet

        parquet.write_table(
            table,
            file,
            compression="zstd",
            use_dictionary=False,
            use_byte_stream_split=True,
        )


def no_formula(text: str) -> str:
    """Return a user's name as a cell that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text


def _table(run: Run) -> tuple[pa.Table, str]:
    """Return all series side by side, and a note.

    Interval outputs have no value at the last state. Where there are such, the last
    state is left out and the note says so.
    """
    results = run.results
    rows = min((results.count(n) for n in results.names()), default=0)
    times = results.times()
    columns: dict[str, Any] = {"time [s]": times[:rows]}
    for name in results.names():
        unit = results.attribute(name, "unit")
        suffix = f" [{unit}]" if unit not in ("", "1") else ""
        values = results.values(name, slice(0, rows))
        if values.ndim == 1:
            columns[f"{name}{suffix}"] = values
        else:
            columns |= {
                f"{name}[{i + 1}]{suffix}": values[:, i] for i in range(values.shape[1])
            }
    remaining_rows = len(times) - rows
    note = (
        f"states at t = {times[-1]:g} s have no interval after them, and no row"
        if remaining_rows
        else ""
    )
    return pa.table(columns), note


def _structs(run: Run) -> dict[str, Any]:
    """Return a struct for each component, with an array for each variable and `units`.

    The times stand beside the structs.
    """
    results = run.results
    times = results.times()
    rows = min((results.count(n) for n in results.names()), default=0)
    structs: dict[str, Any] = {"time": times, "interval": times[:rows]}
    for name in results.names():
        component, _, variable = name.partition(".")
        struct = structs.setdefault(component, {"units": {}})
        struct[variable] = np.asarray(results.values(name))
        struct["units"][variable] = results.attribute(name, "unit") or "1"
    return structs


def _plots(run: Run, form: str, folder: Path, into: Path) -> list[Path]:
    """Write the scenario's plots and return their paths."""
    from ..figures.plots import series_figure
    from ..report.report import label_of

    plots = []
    runs = [(label_of(run.manifest), run.results, run.manifest.parameters)]
    for name, plot in run.manifest.content.plots.items():
        figure = series_figure(plot, runs)
        if figure is None:
            continue
        if "/" in name or "\\" in name:
            raise DesatError(
                f"{folder}: plot {plain(name)}: a file's name has no / and no \\"
            )
        path = into / f"{name}.{form}"
        with io.replacing(path) as part:
            paint(figure, part, form)
        plots.append(path)
    if not plots:
        raise DesatError(f"{into}: the scenario has no plots of recorded series")
    return plots
