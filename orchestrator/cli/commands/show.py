"""Define `desat show NAME`, which prints a scenario as merged."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...system.errors import DesatError
from .. import options as o
from ..console import app, example, name_of, out, print_json, print_rows


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
    diagram: Annotated[
        bool,
        typer.Option(
            "--diagram",
            help="Instead, draw the loop: components by role, and the signals between "
            "them with their units (.svg).",
        ),
    ] = False,
    sketch: Annotated[
        bool,
        typer.Option(
            "--sketch",
            help="Instead, draw the craft: body axes, plates or box, wheels, coils and "
            "nozzles (.svg).",
        ),
    ] = False,
    file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            metavar="FILE.svg",
            help="The drawing's file (default: runs/loop-NAME.svg or runs/craft-NAME.svg).",
            show_default=False,
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Print a scenario as merged, and where each value comes from; or draw it."""
    if diagram and sketch:
        raise DesatError("--diagram and --sketch: one at a time")
    if diagram or sketch:
        kind = "loop" if diagram else "craft"
        default = Path("runs") / f"{kind}-{name_of(name)}.svg"
        _draw(name, kind, file or default, as_json)
        return
    if file is not None:
        raise DesatError(f"--out {file}: it goes with --diagram or --sketch")
    from ...runs import explain

    print_rows(explain.show(name), as_json)


def _draw(name: str, kind: str, file: Path, as_json: bool) -> None:
    """Write the drawing of a system's loop or craft and print its path."""
    from ...figures.craft import sketch
    from ...files.io import replace_text
    from ...runs import drawings
    from ...runs.prepare import prepare
    from ...system.options import Options

    if file.suffix != ".svg":
        raise DesatError(f"--out {file}: a drawing is an .svg file")
    system, _ = prepare(name, Options()).or_raise()
    if kind == "loop":
        text = drawings.loop_of_system(system)
    else:
        parts = drawings.craft_of_system(system)
        if not parts:
            raise DesatError(
                f"{name}: it has no spacecraft of ours, whose parts are known"
            )
        text = sketch(parts, f"Craft of {system.name}")
    file.parent.mkdir(parents=True, exist_ok=True)
    replace_text(file, text)
    if as_json:
        print_json({"drawing": str(file)})
    else:
        out.print(str(file))
