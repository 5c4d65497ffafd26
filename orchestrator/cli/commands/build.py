"""Define `desat build FILE.py`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from ...system.errors import DesatError
from .. import options as o
from ..console import app, err, example, out, print_json


@app.command(epilog=example("desat build my_law.py"))
def build(
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE.py",
            help="A block file of your own; with --reals also one of our blocks, or `all`.",
        ),
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
    reals: Annotated[
        bool,
        typer.Option(
            "--reals",
            help="The native FMU with Reals alone, for hosts that know no other type: "
            "reals/NAME.fmu.",
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Build a block file of your own as FMUs.

    NAME.fmu is of Python, native/NAME.fmu of C where the block translates, else the
    reason is given; fmi3/NAME.fmu comes with --fmi 3.
    """
    from ...files import own
    from ...files.io import replace_text

    if reals and fmi == "3":
        raise DesatError("--fmi 3: --reals is of FMI 2.0")
    if reals and not own.is_own(str(file)):
        if platforms:
            raise DesatError(
                f"--platforms {platforms}: our blocks stay as they were built; "
                f"`make fmus PLATFORMS={platforms}` builds them"
            )
        _print(_write_reals(str(file), into or Path()), as_json)
        return
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
    if reals:
        from desat.fmus.reals import repack

        if built.native is None:
            raise DesatError(
                f"{file.name}: --reals: there is no native FMU: {built.reason}"
            )
        place = folder / "reals" / built.native.name
        _print({"reals": str(repack(built.native, place))}, as_json)
        return
    files_written = {}
    for kind, fmu in printed.items():
        if fmu is not None:
            target = folder / ("" if kind == "python" else kind) / fmu.name
            target.parent.mkdir(parents=True, exist_ok=True)
            replace_text(target, fmu.read_bytes())
            files_written[kind] = str(target)
    reason = {"why": built.reason} if built.reason and as_json else {}
    _print({**files_written, **reason}, as_json)
    if built.reason and not as_json:
        err.print(f"note: there is no native FMU of it: {built.reason}")


def _print(files_written: Mapping[str, str], as_json: bool) -> None:
    """Print the paths of what was built."""
    if as_json:
        print_json(dict(files_written))
        return
    for path in files_written.values():
        out.print(path)


def _write_reals(name: str, folder: Path) -> dict[str, str]:
    """Write a block of ours, or all, with Reals alone; return the paths by name.

    Raises DesatError where there is no such block, or no native FMU of it.
    """
    from desat.fmus import registry
    from desat.fmus.native import PINNED
    from desat.fmus.reals import repack

    from ...files import library
    from ...system.errors import nearest

    native_names = [x for x in registry.names() if x not in PINNED]
    if name not in ("all", *native_names):
        raise DesatError(
            f"{name}: no native block of ours{nearest(name, native_names)}"
        )
    paths = {}
    for block in native_names if name == "all" else [name]:
        fmu = library.of_block(block, ())
        if fmu is None or fmu.path.parent.name != "native":
            raise DesatError(f"{block}: there is no native FMU of it here")
        paths[block] = str(repack(fmu.path, folder / "reals" / fmu.path.name))
    return paths
