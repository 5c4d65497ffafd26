"""`desat draws NAME`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from ..common import (
    CPUS,
    Alg,
    Blocks,
    DesignOption,
    Jobs,
    Json,
    Semantics,
    Sets,
    Step,
    Stop,
    Target,
    TimeLimit,
    app,
    err,
    options_of,
    out,
    print_json,
)


@app.command()
def draws(
    target: Target,
    count: Annotated[int, typer.Option("-n", "--count", help="Number of draws.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 1,
    sets: Sets = None,
    stop: Stop = None,
    step: Step = None,
    algorithm: Alg = Semantics.conserving,
    blocks: Blocks = False,
    design: DesignOption = None,
    time_limit: TimeLimit = None,
    jobs: Jobs = CPUS,
    as_json: Json = False,
) -> None:
    """Run seeded draws of a scenario's dispersions."""
    from ...study import draws as draws_module
    from ...study.plots import pretty_unit
    from ...study.report import number

    options = options_of(sets, stop, step, algorithm, blocks, design=design,
                         time_limit=time_limit)  # fmt: skip
    result = draws_module.draws(target, count, seed, options, jobs, progress=not as_json)
    for warning in result["warnings"]:
        err.print(f"warning: {warning}", highlight=False, markup=False)
    failed = [r for r in result["draws"] if r["status"] != "completed"]
    if as_json:
        print_json(result)
    else:
        names = list(result["summary"])
        table = Table("draw", *names, box=None, header_style="bold", pad_edge=False)
        for row in result["draws"]:
            cells = [number(row["numbers"].get(n)) for n in names]
            table.add_row(str(row["draw"]), *cells)
        for key in ("median", "min", "max"):
            cells = [number(result["summary"][n][key]) for n in names]
            table.add_row(key, *cells, style="bold")
        table.add_row("unit", *(pretty_unit(result["summary"][n]["unit"]) for n in names))
        out.print(table)
    for row in failed:
        err.print(f"draw {row['draw']}: {row['status']}: {row['message']}", markup=False)
    if failed:
        raise typer.Exit(max(row["code"] for row in failed))
