"""Export a run's series for other programs, with quantity and unit in every name.

csv, parquet: a column for each element, `component.variable[i] [unit]`, and `time [s]`.

mat: a struct for each component, with `time`, `interval` and `units` (MATLAB, Octave,
scipy).

svg, png, pdf: the scenario's plots, a file each, and `management`: the momentum of the
fullest wheel with management and without.
"""

from __future__ import annotations

import re
from collections.abc import Container
from os import PathLike
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa

from ..analyses import management
from ..figures.painting import save
from ..files import io
from ..runs.run import Run, load_run
from ..runs.table import table_of
from ..system.errors import DesatError, plain

FORMATS = ("csv", "parquet", "mat", "svg", "png", "pdf")


def export(folder: Path, form: str, into: Path | None = None) -> tuple[list[Path], str]:
    """Write a run folder's series or plots in a format; return the files and a note.

    Raises
    ------
    DesatError
        If the format is unknown, the folder has no series, or two elements of them
        have one name.
    """
    _check_form(form)
    return _write(load_run(folder), form, into or folder)


def export_run(
    run: Run, form: str, folder: str | PathLike[str] | None = None
) -> list[Path]:
    """Write a run's series or plots in a format; return the files.

    Raises
    ------
    DesatError
        If the format is unknown, or neither is a folder given nor has the run one.
    """
    _check_form(form)
    into = run.results.folder if folder is None else Path(folder)
    if into is None:
        raise DesatError(
            "folder: the run's series are in memory: the folder to write to is needed"
        )
    into.mkdir(parents=True, exist_ok=True)
    return _write(run, form, into)[0]


def _check_form(form: str) -> None:
    if form not in FORMATS:
        raise DesatError(f"--format {form}: there are {', '.join(FORMATS)}")


def _write(run: Run, form: str, into: Path) -> tuple[list[Path], str]:
    """Write the files of a format, and return them with a note."""
    if form in ("svg", "png", "pdf"):
        return _plots(run, form, into), ""
    path, note = into / f"series.{form}", ""
    with io.replacing_file(path) as file:
        if form == "mat":
            from scipy.io import savemat

            structs, note = _structs(run)
            savemat(
                file,
                structs,
                appendmat=False,
                do_compression=True,
                long_field_names=True,
            )
        else:
            table, note = table_of(run.results)
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


def _structs(run: Run) -> tuple[dict[str, Any], str]:
    """Return a struct for each component, and a note on names that were changed.

    A struct has an array for each variable, `units`, and `names` where a name was
    changed, as MATLAB does not allow it. The times stand beside the structs.
    """
    results = run.results
    times = results.times()
    rows = min((results.count(n) for n in results.names()), default=0)
    structs: dict[str, Any] = {"time": times, "interval": times[:rows]}
    fields: dict[str, str] = {}
    renamed_series = []
    for name in results.names():
        component, _, variable = name.partition(".")
        if component not in fields:
            fields[component] = _field(component, structs)
            structs[fields[component]] = {"units": {}, "names": {}}
        struct = structs[fields[component]]
        field = _field(variable, struct)
        struct[field] = np.asarray(results.values(name))
        struct["units"][field] = results.attribute(name, "unit") or "1"
        if (fields[component], field) != (component, variable):
            struct["names"][field] = name
            renamed_series.append(f"{plain(name)} is {fields[component]}.{field}")
    for field in fields.values():
        if not structs[field]["names"]:
            del structs[field]["names"]
    return structs, "; ".join(renamed_series)


def _field(name: str, used: Container[str]) -> str:
    """Return a name that MATLAB allows and that is not used: the name itself if it is.

    MATLAB allows ASCII letters, digits and `_`, 63 characters, a letter first.
    """
    field_name = re.sub(r"\W", "_", name, flags=re.ASCII)
    if not field_name[:1].isalpha():
        field_name = f"x{field_name}"
    field_name = field_name[:63]
    field, number = field_name, 1
    while field in used:
        number += 1
        field = f"{field_name[: 62 - len(str(number))]}_{number}"
    return field


def _plots(run: Run, form: str, into: Path) -> list[Path]:
    """Write the scenario's plots and return their paths."""
    from ..figures.plots import series_figure
    from ..report.report import label_of

    plots = []
    runs = [(label_of(run.manifest), run.results, run.manifest.parameters)]
    figures = {
        name: series_figure(plot, runs)
        for name, plot in run.manifest.content.plots.items()
    }
    if run.manifest.parts.get(management.KEY):
        for _, figure in management.figures(run.manifest, run.results):
            figures.setdefault("management", figure)
    for name, drawn in figures.items():
        if drawn is None:
            continue
        if "/" in name or "\\" in name:
            raise DesatError(
                f"{into}: plot {plain(name)}: a file's name has no / and no \\"
            )
        path = into / f"{name}.{form}"
        save(drawn, path)
        plots.append(path)
    if not plots:
        raise DesatError(f"{into}: the scenario has no plots of recorded series")
    return plots
