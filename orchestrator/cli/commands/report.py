"""`desat report RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..console import app, out


@app.command()
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
) -> None:
    """Write a run's report again; also for a run that was killed."""
    from ...report.report import write_report
    from ...runs.run import load_run

    finished = load_run(folder)
    twin = load_run(folder / "twin") if (folder / "twin").is_dir() else None
    out.print(str(write_report(folder, finished, twin).resolve()))
