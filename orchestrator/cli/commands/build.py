"""Define `desat build FILE.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...system.errors import DesatError
from .. import options as o
from ..console import app, err, example, out, print_json


@app.command(epilog=example("desat build my_law.py"))
def build(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.py", help="A block file of your own.")
    ],
    into: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="The folder to write to (default: that of the file).",
            show_default=False,
        ),
    ] = None,
    platforms: o.Platforms = "",
    fmi: o.Fmi = "2",
    as_json: o.Json = False,
) -> None:
    """Build a block file of your own as FMUs.

    NAME.fmu is of Python, native/NAME.fmu of C where the block translates, else the
    reason is given; fmi3/NAME.fmu comes with --fmi 3.
    """
    from ...files import own
    from ...files.io import replace_text

    built = own.build(file, platforms)
    folder = into or file.parent
    third = fmi == "3"
    printed = (
        {"fmi3": built.fmi3}
        if third
        else {"python": built.python, "native": built.native}
    )
    if third and built.fmi3 is None:
        raise DesatError(
            f"{file.name}: FMI 3.0 is for native FMUs, and there is none of it: "
            f"{built.reason}"
        )
    files_written = {}
    for kind, fmu in printed.items():
        if fmu is not None:
            target = folder / ("" if kind == "python" else kind) / fmu.name
            target.parent.mkdir(parents=True, exist_ok=True)
            replace_text(target, fmu.read_bytes())
            files_written[kind] = str(target)
    if as_json:
        print_json({**files_written, **({"why": built.reason} if built.reason else {})})
        return
    for path in files_written.values():
        out.print(path)
    if built.reason:
        err.print(f"note: there is no native FMU of it: {built.reason}")
