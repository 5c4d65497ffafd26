"""`desat sweep NAME component.parameter=a,b,c`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from .. import options as o
from ..console import app, err, example, out, print_json, print_numbers, warn

if TYPE_CHECKING:
    from ...campaign.draws import Sweep, SweepPoint


@app.command(epilog=example("desat sweep my12u manager.gain=0.001,0.002,0.004 --stop 2orbits"))
def sweep(
    ctx: typer.Context,
    target: o.Target,
    axes: Annotated[
        list[str],
        typer.Argument(metavar="COMP.VAR=A,B,C...",
                       help="A parameter and its values (arrays with ; between them); several "
                       "give every combination."),
    ],
    draws: Annotated[
        int,
        typer.Option("--samples", min=0,
                     help="Print medians of this many random samples (0: none)."),
    ] = 0,
    seed: Annotated[int, typer.Option(help="Seed of the random samples.", min=0)] = 1,
    sets: o.Sets = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    algorithm: o.Alg = o.Semantics.gauss_seidel,
    blocks: o.Blocks = False,
    fmus: o.Fmus = o.FmuKind.native,
    time_limit: o.TimeLimit = None,
    jobs: o.Jobs = o.CPUS,
    as_json: o.Json = False,
) -> None:  # fmt: skip
    """Run a system at several values of parameters, and print its numbers by value."""
    from ...campaign import draws as study

    if not draws:
        o.refuse(ctx, "it goes with --samples", "seed")
    options = o.options_of(sets, stop, step, algorithm, blocks, substeps=substeps,
                         accuracy=accuracy, time_limit=time_limit, fmus=fmus.value)  # fmt: skip
    result = study.sweep(target, study.axes_of(axes), options, jobs, not as_json, draws=draws,
                         seed=seed)  # fmt: skip
    warn(result["warnings"])
    if as_json:
        print_json(result)
    else:
        _print(result)
    failed = [p for p in result["points"] if p["status"] != "completed"]
    for point in failed:
        at = ", ".join(f"{name} = {value}" for name, value in point["values"].items())
        err.print(f"{at}: {point['status']}: {point['message']}")
    if failed:
        raise typer.Exit(max(point["code"] for point in failed))


def _print(result: Sweep) -> None:
    from ...figures.style import pretty_unit
    from ...numbers.text import not_reached, number

    def cell(point: SweepPoint, name: str) -> str:
        share = not_reached(point["summary"][name]) if name in point.get("summary", {}) else ""
        return number(point["numbers"].get(name)) + (f" (not reached: {share})" if share else "")

    points, units = result["points"], result["units"]
    rows = [[*result["axes"], *units]]
    rows += [
        [*map(_cell, p["values"].values()), *(cell(p, n) for n in units)]
        for p in points
    ]  # fmt: skip
    rows.append([*("" for _ in result["axes"]), *map(pretty_unit, units.values())])
    if len(units) > len(points):  # the longer side goes down the page
        rows = [list(row) for row in zip(*rows, strict=True)]
    table = Table(box=None, pad_edge=False, show_header=False)
    for i, _ in enumerate(rows[0]):
        table.add_column(justify="right" if i else "left")
    for row in rows:
        table.add_row(*row)
    print_numbers(table)
    if result["draws"]:
        out.print(f"medians of {result['draws']} draws")


def _cell(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(_cell(x) for x in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
