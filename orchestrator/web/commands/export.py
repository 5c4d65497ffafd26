"""Define `desat export web`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...cli import options as o
from ...cli.commands.export import Names, exports
from ...cli.console import err, example, out, print_json


@exports.command(epilog=example("desat export web my12u --law all"))
def web(
    target: o.Target,
    laws: Annotated[
        Names,
        typer.Option(
            "--law",
            metavar="NAME",
            help="A law beside the craft's own, as "
            "`compare --laws` names it; all: each that fits. May be repeated.",
        ),
    ] = None,
    sliders: Annotated[
        Names,
        typer.Option(
            "--slider",
            metavar="NAME=FROM:TO",
            help="What moves, by the name that "
            "--set has for it, also shared.NAME. May be repeated (default: orbit, "
            "coils, residual dipole, gain, wheels; with thrusters their dumps').",
        ),
    ] = None,
    file: Annotated[
        Path | None,
        o.output_file("--out", "The file to write (default: NAME.html)."),
    ] = None,
    author: Annotated[
        str,
        typer.Option(
            "--author", metavar="NAME", help="Who made the page, for its readers."
        ),
    ] = "",
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    as_json: o.Json = False,
) -> None:
    """Write one HTML file that flies a scenario as its sliders move: no server, no
    network. It is compiled by the package ziglang.
    """
    from ...studies.ranking import options_of_laws
    from ..page import check_request, export

    options = o.options_of(
        sets,
        stop,
        step,
        "gauss_seidel",
        False,
        None,
        sources,
        substeps=substeps,
        accuracy=accuracy,
    )
    check_request(sliders or (), file)
    page = export(
        target,
        options_of_laws(target, options, laws or ()),
        sliders or (),
        file,
        author,
    )
    for line in page.notes:
        err.print(f"note: {line}")
    if as_json:
        print_json(
            {
                "page": str(page.path),
                "digest": page.digest,
                "sliders": list(page.sliders),
                "notes": list(page.notes),
            }
        )
    else:
        out.print(str(page.path))
