"""`desat convergence NAME`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ...system.quantity import Quantity
from .. import options as o
from ..console import app, name_of, out, print_json

if TYPE_CHECKING:
    from ...system.options import Algorithm


STEPS = Quantity("--steps", "s", 0.0, above=True, what="steps")


@app.command()
def convergence(
    target: o.Target,
    steps: Annotated[
        str | None,
        typer.Option(
            help="Steps, s (default: the scenario's, a half, a quarter, an eighth of it)."
        ),
    ] = None,
    algorithm: Annotated[
        list[o.Semantics] | None, typer.Option(help="Only this one (default: both).")
    ] = None,
    sets: o.Sets = None,
    stop: o.Stop = None,
    inner: o.Inner = None,
    blocks: o.Blocks = False,
    jobs: o.Jobs = o.CPUS,
    html: Annotated[
        Path | None,
        o.written("--html", "Where the page goes (default: runs/convergence-NAME.html)."),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Hold a gyrostat scenario at several steps against its monolithic reference."""
    from ...studies import convergence as convergence_module

    options = o.options_of(sets, stop, None, o.Semantics.conserving, blocks, inner=inner)
    sizes: tuple[float, ...] | None = None
    if steps is not None:
        sizes = STEPS.many(steps)
    wanted: tuple[Algorithm, ...] = tuple(a.value for a in algorithm or list(o.Semantics))
    result = convergence_module.study(target, options, sizes, wanted, jobs, not as_json)
    if as_json:
        print_json(result)
        if html is not None:
            convergence_module.write_html(result, html)
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    columns = {
        "step": "step s", "attitude_error": "attitude rad", "estimate": "its estimate",
        "wheel_momentum_error": "wheel momentum N m s", "estimate_wheel_momentum": "its estimate",
        "momentum_drift": "momentum residual N m s",
        "attitude_error_same_delays": "attitude, same delays",
        "wheel_momentum_error_same_delays": "wheel momentum, same delays",
    }  # fmt: skip
    table.add_column("algorithm")
    for title in columns.values():
        table.add_column(title, justify="right")
    for row in result["rows"]:
        cells = ["" if row[key] is None else f"{row[key]:.2e}" for key in columns]
        table.add_row(row["algorithm"], f"{row['step']:g}", *cells[1:])
    out.print(table)
    for note in dict.fromkeys(filter(None, (row["note"] for row in result["rows"]))):
        out.print(f"same delays: {note}")
    if result["order"] is not None:
        out.print(f"observed order (conserving): {result['order']:.2f} in attitude, "
                  f"{result['order_wheel_momentum']:.2f} in the wheels' momentum")  # fmt: skip
    page = convergence_module.write_html(
        result, html or Path("runs") / f"convergence-{name_of(target)}.html"
    )
    out.print(f"page: {page.resolve()}")
