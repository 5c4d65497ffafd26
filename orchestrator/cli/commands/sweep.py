"""Define `desat sweep NAME component.parameter=a,b,c`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import options as o
from ..console import app, err, example, name_of, out, print_json, print_table, warn


@app.command(
    epilog=example("desat sweep my12u manager.gain=0.001,0.002,0.004 --stop 2orbits")
)
def sweep(
    ctx: typer.Context,
    target: o.Target,
    axes: Annotated[
        list[str],
        typer.Argument(
            metavar="COMP.VAR=A,B,C...",
            help="A parameter and its values (arrays with ; between them); several "
            "give every combination.",
        ),
    ],
    draws: Annotated[
        int,
        typer.Option(
            "--samples",
            min=0,
            help="Print medians of this many random samples (0: none).",
        ),
    ] = 0,
    seed: o.Seed = 1,
    sets: o.Sets = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    algorithm: o.Alg = "gauss_seidel",
    blocks: o.Blocks = False,
    fmus: o.Fmus = "native",
    time_limit: o.TimeLimit = None,
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None,
        o.output_file("--html", "Where the page goes (default: runs/sweep-NAME.html)."),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Run a system at several values of parameters, and print its numbers by value.

    The first line says where the requirements hold. A page has the curves with the
    requirements drawn, of two parameters with many values a map.
    """
    from ...campaign import sweep as study
    from ...campaign import sweep_page

    if not draws:
        o.refuse(ctx, "it goes with --samples", "seed")
    options = o.options_of(
        sets,
        stop,
        step,
        algorithm,
        blocks,
        substeps=substeps,
        accuracy=accuracy,
        time_limit=time_limit,
        fmus=fmus,
    )
    result = study.sweep(
        target, study.axes_of(axes), options, jobs, not as_json, draws=draws, seed=seed
    )
    warn(result.warnings)
    page = html or Path("runs") / f"sweep-{name_of(target)}.html"
    sweep_page.write(result, page)
    if as_json:
        print_json({**result.to_json(), "page": str(page)})
    else:
        if result.answer:
            out.print(result.answer, highlight=False, markup=False)
        print_table(sweep_page.tabulate(result))
        if result.draws:
            out.print(f"medians of {result.draws} draws")
        out.print(f"page: {page.resolve()}")
    failed_points = [point for point in result.points if not point.worst.completed]
    for point in failed_points:
        err.print(f"{point.place}: {point.worst.status}: {point.message}")
    if failed_points:
        raise typer.Exit(max(point.worst.code for point in failed_points))
