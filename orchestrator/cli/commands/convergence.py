"""`desat convergence NAME`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.table import Table

from ...system.errors import DesatError
from ..common import (
    CPUS,
    Blocks,
    Jobs,
    Json,
    Semantics,
    Sets,
    Stop,
    Target,
    app,
    name_of,
    options_of,
    out,
    print_json,
)

if TYPE_CHECKING:
    from ...engine.master import Algorithm


@app.command()
def convergence(
    target: Target,
    steps: Annotated[str, typer.Option(help="Steps, s.")] = "1,0.5,0.25,0.125",
    algorithm: Annotated[
        list[Semantics] | None, typer.Option(help="Only this one (default: both).")
    ] = None,
    sets: Sets = None,
    stop: Stop = None,
    blocks: Blocks = False,
    jobs: Jobs = CPUS,
    html: Annotated[
        Path | None, typer.Option(help="Where the page goes (default: runs/convergence-NAME.html).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Hold a gyrostat scenario at several steps against its monolithic reference."""
    from ...analyses import convergence as convergence_module
    from ...system.parameters import parse_value

    options = options_of(sets, stop, None, Semantics.conserving, blocks)
    sizes = parse_value(steps)
    sizes = tuple(sizes if isinstance(sizes, list) else [sizes])
    if not all(isinstance(s, (int, float)) for s in sizes):
        raise DesatError(f"--steps {steps}: positive numbers are needed, as 1,0.5,0.25")
    wanted: tuple[Algorithm, ...] = tuple(a.value for a in algorithm or list(Semantics))
    result = convergence_module.study(
        target, options, tuple(float(s) for s in sizes), wanted, jobs, progress=not as_json
    )
    if as_json:
        print_json(result)
        return
    table = Table(box=None, header_style="bold", pad_edge=False)
    table.add_column("algorithm")
    for name in ("step s", "attitude rad", "wheel momentum N m s", "momentum residual N m s",
                 "attitude, same delays", "wheel momentum, same delays"):  # fmt: skip
        table.add_column(name, justify="right")
    for row in result["rows"]:
        values = list(row.values())
        cells = [f"{values[1]:g}", *("" if v is None else f"{v:.2e}" for v in values[2:])]
        table.add_row(values[0], *cells)
    out.print(table)
    if result["order"] is not None:
        out.print(f"observed order (conserving): {result['order']:.2f} in attitude, "
                  f"{result['order_wheel_momentum']:.2f} in the wheels' momentum")  # fmt: skip
    page = convergence_module.write_html(
        result, html or Path("runs") / f"convergence-{name_of(target)}.html"
    )
    out.print(f"page: {page.resolve()}", highlight=False, markup=False)
