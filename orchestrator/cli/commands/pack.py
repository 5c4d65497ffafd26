"""`desat pack`."""

from __future__ import annotations

import os
import time
from typing import Annotated

import typer

from ..common import FmuKind, Fmus, Json, app, complete_name, out, print_json


@app.command()
def pack(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...", help="Scenarios (default: all).", autocompletion=complete_name
        ),
    ] = None,
    fmus: Fmus = FmuKind.python,
    as_json: Json = False,
) -> None:
    """Pack scenarios as self-contained .ssp files into ssp/dist/; with native FMUs into
    ssp/dist/native/."""
    from ...files import pack as pack_module
    from ...files import places
    from ...files.scenario import find, scenarios

    wanted = [find(n) for n in names] if names else list(scenarios().values())
    packed = [str(pack_module.pack_scenario(s, force=True, fmus=fmus.value)) for s in wanted]
    if not names:
        for left in places.packed().rglob("*.part"):  # of a command that was killed
            if time.time() - left.stat().st_mtime > 60.0:
                left.unlink(missing_ok=True)
    if as_json:
        print_json(packed)
    else:
        out.print(f"{len(packed)} packed: {os.path.commonpath(packed)}", highlight=False)
