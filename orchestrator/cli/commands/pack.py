"""`desat pack`."""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from .. import options as o
from ..console import app, err, out, print_json


@app.command()
def pack(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME|FILE]...",
            autocompletion=o.complete_name,
            help="Scenarios (default: all that have changed since); one of a file of your own "
            "(.toml) is packed beside it.",
        ),
    ] = None,
    fmus: Annotated[
        o.FmuKind | None,
        typer.Option(
            help="Which of our FMUs (default: native ones as soon as they are for linux64 "
            "and win64, `make fmus PLATFORMS=all`; else those of Python).",
            show_default=False,
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Pack scenarios as self-contained .ssp files into ssp/dist/; with native FMUs into
    ssp/dist/native/."""
    from ...export import packing as pack_module
    from ...files import library, paths
    from ...files.scenario import find, own, scenarios
    from ...runs.substep_choice import settled

    kind = fmus.value if fmus else "native" if library.portable() else "python"
    files = [Path(n) for n in names or () if n.endswith(".toml")]
    ours = [find(n) for n in names if not n.endswith(".toml")] if names else scenarios().values()
    wanted = [*((own(f), f.with_suffix(".ssp")) for f in files), *((s, None) for s in ours)]
    told: list[str] = []
    packed = [
        str(
            pack_module.pack_scenario(
                scenario,
                target,
                force=bool(names),
                fmus=kind,
                choose=partial(settled, scenario.name),
                tell=told.append,
            )
        )
        for scenario, target in wanted
    ]
    if not names:
        for left in paths.packed_folder().rglob("*.part"):  # of a command that was killed
            if time.time() - left.stat().st_mtime > 60.0:
                left.unlink(missing_ok=True)
    for text in told:
        err.print(f"note: {text}")
    if as_json:
        print_json(packed)
    else:
        python = library.python_alone() if kind == "native" else []
        if python:
            text = f"{', '.join(python)}: of Python, also where it is packed: its host needs one"
            err.print(f"note: {text}")
        out.print(f"{len(packed)} packed: {os.path.commonpath(packed)}")
