"""Define `desat report RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..console import app, example, out, warn


@app.command(epilog=example("desat report runs/my12u --open"))
def report(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    show: Annotated[
        bool, typer.Option("--open", help="Open it in the browser, too.")
    ] = False,
) -> None:
    """Write the report of a run again, also of one that was killed."""
    from ...report.report import write_report
    from ...runs.run import load_run

    finished = load_run(folder)
    baseline = load_run(folder / "baseline") if (folder / "baseline").is_dir() else None
    page = write_report(folder, finished, baseline).resolve()
    out.print(str(page))
    if show:
        import webbrowser

        if not webbrowser.open(page.as_uri()):
            warn([f"{page}: not opened, for no browser was found"])
