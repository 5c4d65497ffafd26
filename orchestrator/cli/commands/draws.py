"""`desat draws NAME`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from .. import options as o
from ..console import app, err, out, print_json, print_numbers, warn

if TYPE_CHECKING:
    from ...campaign.draws import Draws


@app.command()
def draws(
    target: o.Target,
    count: Annotated[int, typer.Option("-n", "--count", help="Number of draws.", min=1)] = 20,
    seed: Annotated[int, typer.Option(help="Seed of the draws.", min=0)] = 1,
    sets: o.Sets = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    algorithm: o.Alg = o.Semantics.gauss_seidel,
    blocks: o.Blocks = False,
    fmus: o.Fmus = o.FmuKind.native,
    design: o.DesignOption = None,
    time_limit: o.TimeLimit = None,
    jobs: o.Jobs = o.CPUS,
    every: Annotated[bool, typer.Option("--each", help="A column for each draw.")] = False,
    as_json: o.Json = False,
) -> None:  # fmt: skip
    """Run seeded draws of a scenario's dispersions."""
    from ...campaign import draws as study

    options = o.options_of(sets, stop, step, algorithm, blocks, substeps=substeps,
                         accuracy=accuracy, design=design, time_limit=time_limit,
                         fmus=fmus.value)  # fmt: skip
    result = study.draws(target, count, seed, options, jobs, progress=not as_json)
    warn(result["warnings"])
    if as_json:
        print_json(result)
    else:
        _print_draws(result, every)
    failed = [r for r in result["draws"] if r["status"] != "completed"]
    for row in failed:
        err.print(f"draw {row['draw']}: {row['status']}: {row['message']}")
    unmet = [r for r in result["draws"] if r["unmet"]]
    for row in unmet:
        err.print(f"draw {row['draw']}: not met: {'; '.join(row['unmet'])}")
    if failed or unmet:
        raise typer.Exit(max(row["code"] for row in failed + unmet))


def _print_draws(result: Draws, every: bool) -> None:
    """A row a number: median with its interval, least, largest; and every draw's, if asked."""
    from ...figures.style import pretty_unit
    from ...numbers.text import not_reached, number

    table = Table("number", box=None, header_style="bold", pad_edge=False)
    rows = result["draws"] if every else []
    for column in ("median", "95 % from", "to", "min", "max", *(f"draw {r['draw']}" for r in rows)):
        table.add_column(column, justify="right")
    table.add_column("unit")
    table.add_column("not reached", justify="right")
    for name, entry in result["summary"].items():
        values = [entry[key] for key in ("median", "low", "high", "min", "max")]
        values += [row["numbers"].get(name) for row in rows]
        share = not_reached(entry)
        table.add_row(name, *map(number, values), pretty_unit(entry["unit"]), share)
    print_numbers(table)
    conditions = {r["stopped_when"]["condition"] for r in result["draws"] if r["stopped_when"]}
    if conditions:
        share = f"{result['stopped']} of {len(result['draws'])}"
        out.print(f"ended early: {share} ({', '.join(conditions)})")
