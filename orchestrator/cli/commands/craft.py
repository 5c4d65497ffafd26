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
    from ...export import packing
    from ...files import paths

    paths.writable("`desat craft`")
    written = {}
    for file in packing.craft_files(families or []):
        path, changed = packing.write(file)
        written[os.path.relpath(path)] = changed
    if as_json:
        print_json(written)
        return
    for name, changed in written.items():
        out.print(f"{name}: {'written' if changed else 'current'}")
