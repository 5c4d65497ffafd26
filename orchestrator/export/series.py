"""`desat export`: a run's series for other programs, with quantity and unit in every name.

csv, parquet  a column an element, `component.variable[i] [unit]`, and `time [s]`
mat           a struct a component, with `time`, `interval` and `units` (MATLAB, Octave, scipy)
png, pdf      the scenario's plots, a file each
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..figures.canvas import INCH, INK, Dots, Figure, Words
from ..files import io, paths
from ..runs.run import Run, load_run
from ..system.errors import DesatError, plain

FORMATS = ("csv", "parquet", "mat", "png", "pdf")
ANCHORS = {"start": "left", "middle": "center", "end": "right"}


def export(folder: Path, form: str, into: Path | None = None) -> tuple[list[Path], str]:
    """Write a run folder's series (or plots) in a format; the files, and what is to be said.

    Raises DesatError for an unknown format, and where the folder has no series.
    """
    if form not in FORMATS:
        raise DesatError(f"--format {form}: there are {', '.join(FORMATS)}")
    run = load_run(folder)
    into = into or folder
    if form in ("png", "pdf"):
        return _plots(run, form, folder, into), ""
    path, note = into / f"series.{form}", ""
    with io.replacing(path) as part:
        if form == "mat":
            from scipy.io import savemat

            structs = _structs(run)
            savemat(part, structs, appendmat=False, do_compression=True, long_field_names=True)
        else:
            table, note = _table(run)
            if form == "csv":
                from pyarrow import csv

                csv.write_csv(table.rename_columns([*map(no_formula, table.column_names)]), part)
            else:
                from pyarrow import parquet

                parquet.write_table(table, part, compression="zstd", use_dictionary=False,
                                    use_byte_stream_split=True)  # fmt: skip
    return [path], note


def no_formula(text: str) -> str:
    """A name of somebody's as a cell that no spreadsheet takes for a formula."""
    return f"'{text}" if text.startswith(("=", "+", "-", "@")) else text


def _table(run: Run) -> tuple[pa.Table, str]:
    """All series side by side. Where there are outputs of intervals, whose last row is that before
    the last state, the last state has no place: what is said of it."""
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
            columns |= {f"{name}[{i + 1}]{suffix}": values[:, i] for i in range(values.shape[1])}
    left = len(times) - rows
    note = f"states at t = {times[-1]:g} s have no interval after them, and no row" if left else ""
    return pa.table(columns), note


def _structs(run: Run) -> dict[str, Any]:
    """A struct a component: an array a variable, `units`; times beside them."""
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
    from ..figures.plots import series_figure
    from ..report.report import label_of

    made = []
    runs = [(label_of(run.manifest), run.results, run.manifest.parameters)]
    for name, plot in run.manifest.content.plots.items():
        figure = series_figure(plot, runs)
        if figure is None:
            continue
        if "/" in name or "\\" in name:
            raise DesatError(f"{folder}: plot {plain(name)}: a file's name has no / and no \\")
        path = into / f"{name}.{form}"
        with io.replacing(path) as part:
            _paint(figure, part, form)
        made.append(path)
    if not made:
        raise DesatError(f"{into}: the scenario has no plots of recorded series")
    return made


def _paint(figure: Figure, path: Path, form: str) -> None:
    """Have matplotlib paint a figure's shapes, as they are, into a file."""
    if paths.no_home():  # it would say where it keeps what it finds of fonts
        os.environ.setdefault("MPLCONFIGDIR", str(paths.cache() / "matplotlib"))
    backend = os.environ.pop("MPLBACKEND", None)  # we need none, and one that is unknown is refused
    try:
        from matplotlib import figure as painter
        from matplotlib.patches import PathPatch, Rectangle
        from matplotlib.path import Path as Outline
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    page = painter.Figure(figsize=(figure.width, figure.height))
    width, height = INCH * figure.width, INCH * figure.height
    ax = page.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, width), ylim=(height, 0.0))
    ax.set_axis_off()
    for layer, shape in enumerate(figure.shapes()):
        if isinstance(shape, Words):
            ax.text(*shape.at, shape.text, fontsize=shape.size / 10.0, color=INK, va="baseline",
                    ha=ANCHORS[shape.anchor], rotation=90.0 * shape.turned, zorder=layer,
                    rotation_mode="anchor", parse_math=False)  # fmt: skip
        elif isinstance(shape, Dots):
            ax.plot(*shape.at.T, "o", color=shape.colour, alpha=shape.alpha, zorder=layer,
                    markersize=shape.width, markeredgewidth=0.0)  # fmt: skip
        elif shape.parts:
            outline = Outline.make_compound_path(
                *(Outline(p, closed=False) for p in map(np.asarray, shape.parts))
            )
            patch = PathPatch(
                outline, facecolor=shape.fill or "none", edgecolor=shape.colour or "none",
                linewidth=shape.width, alpha=shape.alpha, zorder=layer,
                linestyle=(0, [d / shape.width for d in shape.dash]) if shape.dash else "-",
            )  # fmt: skip
            ax.add_patch(patch)
            if shape.within is not None:
                left, top, across, down = shape.within
                patch.set_clip_path(Rectangle((left, top), across, down, transform=ax.transData))
    page.savefig(path, format=form, dpi=150)
