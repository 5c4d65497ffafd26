"""Define `desat resume RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...files.io import claimed
from ...system.errors import DesatError
from .. import options as o
from ..console import app, example, warn
from .run import conclude

WAIT = 10.0  # s: a run whose parent was killed ends by itself within this time


@app.command(epilog=example("desat resume runs/my12u"))
def resume(
    folder: Annotated[
        Path,
        typer.Argument(
            metavar="RUN",
            show_default=False,
            help="The folder of a run with --checkpoint that was ended.",
        ),
    ],
    csv: Annotated[bool, typer.Option("--csv", help="Write series.csv too.")] = False,
    baseline: Annotated[
        bool, typer.Option(help="Also run the scenario's baseline, and show it beside.")
    ] = True,
    everything: o.Everything = False,
    as_json: o.Json = False,
) -> None:
    """Continue a run from its newest checkpoint, with the same bits."""
    from ...runs import run as study

    if not folder.is_dir():
        raise DesatError(f"{folder}: no folder of a run")
    with claimed(folder, WAIT):
        options = study.options_of(folder)
        finished = study.resume(folder.absolute(), progress=not as_json)
        warn(finished.manifest.warnings)
        conclude(
            finished,
            options,
            folder,
            csv=csv,
            baseline=baseline,
            everything=everything,
            as_json=as_json,
        )
