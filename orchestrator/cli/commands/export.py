"""`desat export RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..console import app, err, out


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    form: Annotated[
        str, typer.Option("--format", help="csv, parquet, mat, or, of its plots, png or pdf.")
    ] = "csv",
    into: Annotated[
        Path | None,
        typer.Option("--out", help="The folder to write to (default: RUN).", show_default=False),
    ] = None,
) -> None:
    """Write a run's series or plots for other programs."""
    from ...report.export import export as write

    paths, note = write(folder, form, into)
    for path in paths:
        out.print(str(path))
    if note:
        err.print(f"note: {note}")
