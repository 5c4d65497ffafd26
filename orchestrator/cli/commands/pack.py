"""Define `desat pack`."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...system import choices
from ...system.errors import DesatError
from .. import options as o
from ..console import app, err, example, out, print_json

if TYPE_CHECKING:
    from ...files.scenario import Scenario


@app.command(epilog=example("desat pack uosat12/table3-ocdc-ilqr-1"))
def pack(
    ctx: typer.Context,
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME|FILE|FOLDER]...",
            autocompletion=o.complete_name,
            help="Scenarios (default: all that have changed since); one of a craft or file of "
            "your own is packed beside it. With --ssd families and craft files (default: all).",
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
    arrays: Annotated[
        bool,
        typer.Option(
            "--arrays",
            help="SSP 2.0: FMUs of FMI 3.0, and one connection for an array.",
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Pack scenarios as self-contained .ssp files, or write the SSD of crafts.

    The files go to ssp/dist/, with native FMUs to ssp/dist/native/.
    """
    from ...files import library

    if ssd:
        o.refuse(ctx, "an SSD names FMUs, it has none inside", "fmus", "arrays")
        _write_ssds(names or [], as_json)
        return
    kind = fmus if fmus else "native" if library.portable() else "python"
    messages: list[str] = []
    if names:
        packed = [_pack(name, kind, arrays, messages.append) for name in names]
    else:
        packed = _pack_all(kind, arrays, messages.append)
    for text in messages:
        err.print(f"note: {text}")
    if as_json:
        print_json([str(path) for path in packed])
        return
    python = library.python_alone() if kind == "native" else []
    if python:
        text = f"{', '.join(python)}: of Python, also where it is packed: its host needs one"
        err.print(f"note: {text}")
    out.print(f"{len(packed)} packed: {os.path.commonpath(packed)}")


def _pack(name: str, fmus: str, arrays: bool, tell: Callable[[str], None]) -> Path:
    """Pack what a name, a file or a folder names."""
    from ...runs.prepare import read

    scenario = read(name)
    if scenario.is_system_file:
        return _pack_system(name, fmus, arrays)
    return _pack_scenario(scenario, _place_of(name), True, fmus, arrays, tell)


def _pack_all(fmus: str, arrays: bool, tell: Callable[[str], None]) -> list[Path]:
    """Pack all scenarios that have changed, and remove unfinished files."""
    from ...files import paths
    from ...files.scenario import scenarios

    packed = [
        _pack_scenario(scenario, None, False, fmus, arrays, tell)
        for scenario in scenarios().values()
    ]
    for unfinished in paths.packed_folder().rglob("*.part"):
        if time.time() - unfinished.stat().st_mtime > 60.0:  # of a killed command
            unfinished.unlink(missing_ok=True)
    return packed


def _pack_scenario(
    scenario: Scenario,
    place: Path | None,
    force: bool,
    fmus: str,
    arrays: bool,
    tell: Callable[[str], None],
) -> Path:
    """Pack a scenario with the substeps that a run of it begins with."""
    from ...export.packing import pack_scenario
    from ...runs.substep_choice import settled

    return pack_scenario(
        scenario,
        place,
        force=force,
        fmus=fmus,
        choose=partial(settled, scenario.name),
        tell=tell,
        arrays=arrays,
    )


def _pack_system(target: str, fmus: str, arrays: bool) -> Path:
    """Pack a system file of SSP beside it, or the folder of one into the folder."""
    from ...export.packing import pack
    from ...runs.prepare import prepare
    from ...system.options import Options

    path = Path(target)
    if path.suffix == ".ssp":
        raise DesatError(f"{target}: it is packed already")
    system, _ = prepare(target, Options()).or_raise()
    place = path / f"{path.resolve().name}.ssp" if path.is_dir() else path
    place = place.resolve().with_suffix(".ssp")
    pack(system, place, fmus, arrays)
    return place


def _place_of(target: str) -> Path | None:
    """Return where a scenario of a user's own is packed; None for one of ours."""
    path = Path(target)
    if path.is_dir():
        return path / f"{path.resolve().name}.ssp"
    if path.suffix != ".toml":
        path = Path(f"{target}.toml")
    return path.with_suffix(".ssp") if path.is_file() else None


def _write_ssds(names: list[str], as_json: bool) -> None:
    """Write the SSDs of crafts, or of all of ssp/ where none is named."""
    from ...export import packing
    from ...files import paths

    paths.writable("`desat pack --ssd`")
    files_written = {}
    for file in packing.craft_files(names):
        path, is_changed = packing.write(file)
        files_written[os.path.relpath(path)] = is_changed
    if as_json:
        print_json(files_written)
        return
    for name, is_changed in files_written.items():
        out.print(f"{name}: {'written' if is_changed else 'current'}")
