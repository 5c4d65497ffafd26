"""`desat design`."""

from __future__ import annotations

import os
from typing import Annotated

import typer
from rich.table import Table

from ..common import Json, app, err, out, print_json


@app.command()
def design(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="[NAME]...", help="Scenarios (default: all with a design)."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Compute what laws need beforehand (gain tables, costates) into ssp/FAMILY/design/."""
    from rich.progress import track

    from ...designs import dumping as design_module

    wanted = design_module.designable(names or [])
    made = [
        (s, d := design_module.design(s), design_module.write(s, d))
        for s in track(wanted, "design", console=err, transient=True,
                       disable=as_json or not err.is_terminal)
    ]  # fmt: skip
    if as_json:
        print_json([design_module.as_json(*each) for each in made])
        return
    table = Table("scenario", box=None, header_style="bold", pad_edge=False)
    for column in ("|h_f| N m s", "dipole energy A2 m4 s"):
        table.add_column(column, justify="right")
    table.add_column("tuned")
    for s, d, _ in made:
        tuned = ", ".join(f"{n} = {v:.6g} {u}" for n, (v, u) in d.tuned.items())
        table.add_row(s.name, f"{d.flight.size:.3g}", f"{d.flight.energy:.6g}", tuned)
    out.print(table)
    for folder in sorted({path.parent for _, _, path in made}):
        out.print(f"written to {os.path.relpath(folder)}", highlight=False, markup=False)
