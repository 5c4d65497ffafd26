"""Define `desat sweep NAME component.parameter=a,b,c`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from ...report.table import ROW_UNIT, Cell, Column, Row, Table, or_not_reached
from .. import options as o
from ..console import app, err, example, out, print_json, print_table, warn

if TYPE_CHECKING:
    from ...campaign.draws import Sweep, SweepPoint


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
    as_json: o.Json = False,
) -> None:
    """Run a system at several values of parameters, and print its numbers by value."""
    from ...campaign import draws as study

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
    if as_json:
        print_json(result.to_json())
    else:
        _print(result)
    failed_points = [point for point in result.points if not point.worst.completed]
    for point in failed_points:
        at = ", ".join(f"{name} = {value}" for name, value in point.values.items())
        err.print(f"{at}: {point.worst.status}: {point.message}")
    if failed_points:
        raise typer.Exit(max(point.worst.code for point in failed_points))


def _print(result: Sweep) -> None:
    """Print the numbers of a sweep."""
    print_table(_tabulate(result))
    if result.draws:
        out.print(f"medians of {result.draws} draws")


def _tabulate(result: Sweep) -> Table:
    """Tabulate the numbers by value; the longer side goes down the page."""
    points, units = result.points, result.units
    if len(units) <= len(points):
        columns = [
            *(Column(name) for name in result.axes),
            *(Column(name, unit) for name, unit in units.items()),
        ]
        rows: list[Row] = [
            [
                *map(_text, point.values.values()),
                *(_cell(point, name) for name in units),
            ]
            for point in points
        ]
        return Table("", columns, rows)
    columns = [
        Column("", kind="text"),
        *(Column("", ROW_UNIT) for _ in points),
        Column("", kind="unit"),
    ]
    rows = [
        [axis, *(_text(point.values[axis]) for point in points), ""]
        for axis in result.axes
    ]
    rows += [
        [name, *(_cell(point, name) for point in points), unit]
        for name, unit in units.items()
    ]
    return Table("", columns, rows, has_header=False)


def _cell(point: SweepPoint, name: str) -> Cell:
    """Return a number at a point, and in how many samples it is not reached."""
    spread = point.summary.get(name)
    value = or_not_reached(spread.levels["median"] if spread else None)
    missing = spread.not_reached_text if spread and point.has_draws else ""
    return Cell(value, note=f"not reached: {missing}" if missing else "")


def _text(value: Any) -> str:
    """Format a value."""
    if isinstance(value, list):
        return ", ".join(_text(x) for x in value)
    return f"{value:g}" if isinstance(value, float) else str(value)
