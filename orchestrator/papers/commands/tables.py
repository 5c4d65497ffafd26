"""Define `desat tables FAMILY`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from ...cli import options as o
from ...cli.console import app, err, example, out, print_json, print_table
from ...report.table import Cell, Column, Mark, Table

if TYPE_CHECKING:
    from ..stored import Provenance, StoredDraws


@app.command(epilog=example("desat tables uosat12"))
def tables(
    family: Annotated[
        str,
        typer.Argument(
            help="Scenario family, as uosat12.", autocompletion=o.complete_family
        ),
    ],
    algorithm: o.Alg = "gauss_seidel",
    blocks: o.Blocks = False,
    fmus: o.Fmus = "native",
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None,
        typer.Option(help="Where the page goes (default: runs/tables-FAMILY.html)."),
    ] = None,
    fresh: Annotated[
        bool,
        typer.Option(
            "--fresh",
            help="Compute the random samples now; default: use the stored ones.",
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Run a family's scenarios and print the paper's tables beside ours.

    Scenarios with samples give their median; these are read from
    docs/papers/FAMILY/draws.parquet.
    """
    from .. import tables as tables_module

    options = o.options_of(None, None, None, algorithm, blocks, fmus=fmus)
    draws, origin = _draws_of(family, jobs, fresh, progress=not as_json)
    rows = tables_module.rows(family, options, jobs, draws)
    if as_json:
        print_json(tables_module.as_json(family, rows, origin))
        return
    for heading, group in tables_module.groups(rows):
        lines = [tables_module.texts_of(row) for row in group]
        table_columns = tables_module.columns(lines)
        columns = [
            Column(text, kind="number" if column in tables_module.NUMBERS else "text")
            for column, text in table_columns.items()
        ]
        cells = [
            [
                Cell(line[c], mark=cast(Mark, line["mark"] if c == "verdict" else ""))
                for c in table_columns
            ]
            for line in lines
        ]
        for text in tables_module.definitions(row.definition for row in group):
            out.print(text, style="dim")
        out.print(heading, style="italic")
        print_table(Table(heading, columns, cells), is_folded=True)
        out.print()
    out.print(tables_module.summed_up(rows))
    if spelt := tables_module.spelt(family, rows):
        out.print(spelt, style="dim")
    if origin:
        out.print(f"draws: {tables_module.origin(origin)}")
    page = tables_module.write_html(
        family, rows, html or Path("runs") / f"tables-{family}.html", options, origin
    )
    out.print(f"page: {page.resolve()}")


def _draws_of(
    family: str, jobs: int, fresh: bool, progress: bool
) -> tuple[StoredDraws | None, Provenance | None]:
    """Return the samples of a family, stored or computed now, and their origin.

    Both are None for a family without samples.
    """
    from .. import stored as stored_module

    if not stored_module.with_draws(family):
        return None, None
    if fresh:
        computed = stored_module.compute(family, jobs, progress)
        return computed, stored_module.provenance(computed, fresh=True)
    in_file = stored_module.read(family)
    if old := stored_module.outdated(in_file):
        left_out = [name for name in old if name not in in_file["scenarios"]]
        stale = [name for name in old if name in in_file["scenarios"]]
        for names, problem in (
            (stale, "are not of this version"),
            (left_out, "are not there: their rows are left out"),
        ):
            if names:
                names_text = ", ".join(names[:3]) + (
                    f" and {len(names) - 3} more" if names[3:] else ""
                )
                err.print(
                    f"warning: the stored samples of {names_text} {problem}; --fresh computes them"
                )
    return in_file, stored_module.provenance(in_file, fresh=False)
