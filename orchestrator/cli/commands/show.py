"""Define `desat show NAME`, which prints a scenario as merged."""

from __future__ import annotations

from typing import Annotated

import typer

from .. import options as o
from ..console import app, example, print_rows


@app.command(epilog=example("desat show my12u"))
def show(
    name: Annotated[
        str,
        typer.Argument(
            metavar="NAME|FILE|FOLDER",
            help="A scenario, as "
            "uosat12/table2-ocdc-ilqr-1, a scenario file of your own (.toml), or a "
            "craft's folder.",
            autocompletion=o.complete_name,
        ),
    ],
    as_json: o.Json = False,
) -> None:
    """Print a scenario as merged, and where each value comes from."""
    from ...runs import explain

    print_rows(explain.show(name), as_json)
