"""Define `desat pack`."""

from __future__ import annotations

import os
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ...system import choices
from .. import options as o
from ..console import app, err, example, out, print_json


@app.command(epilog=example("desat pack uosat12/table3-ocdc-ilqr-1"))
def pack(
    ctx: typer.Context,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME|FILE]...",
            autocompletion=o.complete_name,
            help="Scenarios (default: all that have changed since); one of a file of your own "
            "(.toml) is packed beside it. With --ssd families and craft files (default: all).",
        ),
    ] = None,
    ssd: Annotated[
        bool,
        typer.Option(
            "--ssd",
            help="Instead, write the standard SSD of crafts beside their files.",
        ),
    ] = False,
    fmus: Annotated[
        choices.Fmus | None,
        typer.Option(
            help="Which of our FMUs (default: native ones as soon as they are for linux64 "
            "and win64, `make fmus PLATFORMS=all`; else those of Python).",
            show_default=False,
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Pack scenarios as self-contained .ssp files, or write the SSD of crafts.

    The files go to ssp/dist/, with native FMUs to ssp/dist/native/.
    """
    from ...export import packing as pack_module
    from ...files import library, paths
    from ...files.scenario import find, read_foreign, scenarios
    from ...runs.substep_choice import settled

    if ssd:
        o.refuse(ctx, "an SSD names FMUs, it has none inside", "fmus")
        _write_ssds(names or [], as_json)
        return
    kind = fmus if fmus else "native" if library.portable() else "python"
    files = [Path(n) for n in names or () if n.endswith(".toml")]
    ours = (
        [find(n) for n in names if not n.endswith(".toml")]
        if names
        else scenarios().values()
    )
    sources = [
        *((read_foreign(f), f.with_suffix(".ssp")) for f in files),
        *((s, None) for s in ours),
    ]
    messages: list[str] = []
    packed = [
        str(
            pack_module.pack_scenario(
                scenario,
                target,
                force=bool(names),
                fmus=kind,
                choose=partial(settled, scenario.name),
                tell=messages.append,
            )
        )
        for scenario, target in sources
    ]
    if not names:
        for unfinished in paths.packed_folder().rglob(
            "*.part"
        ):  # left by a command that was killed
            if time.time() - unfinished.stat().st_mtime > 60.0:
                unfinished.unlink(missing_ok=True)
    for text in messages:
        err.print(f"note: {text}")
    if as_json:
        print_json(packed)
    else:
        python = library.python_alone() if kind == "native" else []
        if python:
            text = f"{', '.join(python)}: of Python, also where it is packed: its host needs one"
            err.print(f"note: {text}")
        out.print(f"{len(packed)} packed: {os.path.commonpath(packed)}")


def _write_ssds(names: list[str], as_json: bool) -> None:
    """Write the SSDs of crafts, or of all of ssp/ where none is named."""
    from ...export import packing
    from ...files import paths

    paths.writable("`desat pack --ssd`")
    written = {}
    for file in packing.craft_files(names):
        path, changed = packing.write(file)
        written[os.path.relpath(path)] = changed
    if as_json:
        print_json(written)
        return
    for name, changed in written.items():
        out.print(f"{name}: {'written' if changed else 'current'}")
