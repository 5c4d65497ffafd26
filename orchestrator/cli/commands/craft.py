"""`desat craft`."""

from __future__ import annotations

import os
from typing import Annotated

import typer

from .. import options as o
from ..console import app, out, print_json


@app.command()
def craft(
    families: Annotated[
        list[str] | None,
        typer.Argument(metavar="[FAMILY|FILE.toml]...", help="Crafts (default: all of ssp/)."),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Write the standard SSD of every craft file beside it."""
    from ...files import paths, ssp_write

    paths.writable("`desat craft`")
    written = {}
    for file in ssp_write.craft_files(families or []):
        path, changed = ssp_write.write(file)
        written[os.path.relpath(path)] = changed
    if as_json:
        print_json(written)
        return
    for name, changed in written.items():
        out.print(f"{name}: {'written' if changed else 'current'}")
