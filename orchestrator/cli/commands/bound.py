"""`desat bound NAME`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from ..common import Json, app, complete_name, err, out, print_json


@app.command()
def bound(
    target: Annotated[
        str, typer.Argument(metavar="NAME|RUN|FILE.ssp", help="A scenario, or a run's folder.",
                            show_default=False, autocompletion=complete_name)
    ],
    as_json: Json = False,
) -> None:  # fmt: skip
    """Compute the least thruster seconds that a dumping run could have done with."""
    from ...analyses import bound as bound_module
    from ...study.case import run_or_load

    finished = run_or_load(target, bound_module)
    with finished.results as results:
        manifest, found = finished.manifest, bound_module.of_run(finished.manifest, results)
    if as_json:
        print_json({"scenario": manifest["scenario"], **found.as_json()})
        return
    if found.least is None:
        err.print("no momentum left: more than can be dumped in this time", markup=False)
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("Thruster firing time of the run", f"{found.seconds:.2f}", "s")
    for n in found.numbers().values():
        table.add_row(n["title"], f"{n['value']:.2f}", n["unit"])
    out.print(table)
