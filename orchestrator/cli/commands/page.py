"""`desat page [FAMILY ...]`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from ...system.quantity import Quantity
from .. import options as o
from ..console import app, out


@app.command()
def page(
    families: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FAMILY]...", help="Default: all families that have a page.",
                       show_default=False, autocompletion=o.complete_family),
    ] = None,
    into: Annotated[
        Path | None, typer.Option(help="Write to INTO/FAMILY (default: docs/papers/FAMILY).")
    ] = None,
    draft: Annotated[
        float | None,
        o.number(Quantity("--draft", "s", 1.0), "SECONDS",
                 "To try a template: runs end after so many seconds at the latest."),
    ] = None,
    jobs: o.Jobs = o.CPUS,
) -> None:  # fmt: skip
    """Write the pages of families from their templates, with numbers and figures of runs made now.

    The template is page.md beside the scenarios; draws that are outdated are made anew.
    """
    from ...papers import pages as page_module

    wanted = families or page_module.families()
    for family in wanted:
        folder = into / family if into is not None else None
        for path in page_module.write(family, folder, jobs, draft):
            out.print(os.path.relpath(path))
