"""`desat size NAME`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from ...system.errors import Exit
from .. import options as o
from ..console import app, err, out, print_json


@app.command()
def size(
    target: o.Target,
    duty: Annotated[
        float, typer.Option(metavar="PERCENT", help="Duty of the coils to recommend rods for.")
    ] = 50.0,
    loop: Annotated[
        bool, typer.Option("--loop/--no-loop", help="Fly the sizes that count in the closed loop.")
    ] = True,
    sets: o.Sets = None,
    stop: o.Stop = None,
    blocks: o.Blocks = False,
    as_json: o.Json = False,
) -> None:
    """Size the wheels and rods of a craft: what its disturbances ask of them, the least rod that
    any law can do with, and duty and momentum over rods. Ends with 1 where the craft cannot hold.
    """
    from ...studies import sizing

    options = o.options_of(sets, stop, None, o.Semantics.conserving, blocks)
    with err.status("") as status:
        made = sizing.size(
            target, options, duty / 100.0, loop, lambda text: status.update(f"{text} ...")
        )
    if as_json:
        print_json(made.as_json())
    else:
        _print(made)
    for line in made.problems:
        err.print(f"it cannot hold: {line}")
    if made.problems:
        raise typer.Exit(Exit.UNMET)


def _print(made: object) -> None:
    from ...studies.sizing import Sizing

    assert isinstance(made, Sizing)
    rod = "none of up to 8 times the least" if made.recommended is None else (
        f"{made.recommended:.4g} A m2"
    )  # fmt: skip
    out.print(
        f"{made.target}: rods of at least {made.least:.4g} A m2, {rod} for a duty of "
        f"{100.0 * made.duty:.3g} %; it has {made.rod:.4g} A m2. The fullest wheel needs "
        f"{1e3 * made.wheel_needed:.4g} mN m s beside what is dumped; the smallest holds "
        f"{1e3 * made.wheel_capacity:.4g} mN m s.",
    )  # fmt: skip
    out.print()
    rows = (
        ("Secular torque", f"{1e6 * sum(x * x for x in made.secular) ** 0.5:.4g}", "uN m"),
        ("Secular momentum of an orbit", f"{1e3 * made.per_orbit:.4g}", "mN m s"),
        ("Cyclic momentum, largest about its middle", f"{1e3 * made.cyclic:.4g}", "mN m s"),
        ("Time without dumping until a wheel is full", f"{made.hours_without / 3600.0:.4g}", "h"),
        ("Least rod, |s| / mean sum |(a x B) . n|", f"{made.least_formula:.4g}", "A m2"),
        ("Least rod for any law, linear programme", f"{made.least:.4g}", "A m2"),
        ("Margin of the rods that it has", f"{made.rod / made.least:.3g}" if made.least else "",
         "times"),
    )  # fmt: skip
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_column()
    table.add_column(justify="right")
    for row in rows:
        table.add_row(*row)
    out.print(table)
    if made.curve:
        out.print()
        curve = Table(box=None, header_style="bold", pad_edge=False)
        for name in ("rod, A m2", "times the least", "rms, mN m s", "largest", "duty, %",
                     "closed loop: rms", "largest", "duty, %"):  # fmt: skip
            curve.add_column(name, justify="right")
        for r in made.curve:
            flown = [] if r.loop_rms is None or r.loop_largest is None or r.loop_duty is None else [
                f"{1e3 * r.loop_rms:.4g} ({100.0 * (r.rms / r.loop_rms - 1.0):+.1f} %)",
                f"{1e3 * r.loop_largest:.4g} ({100.0 * (r.largest / r.loop_largest - 1.0):+.1f} %)",
                f"{100.0 * r.loop_duty:.3g}",
            ]  # fmt: skip
            curve.add_row(f"{r.rod:.4g}", f"{r.multiple:.3g}", f"{1e3 * r.rms:.4g}",
                          f"{1e3 * r.largest:.4g}", f"{100.0 * r.duty:.3g}", *flown)  # fmt: skip
        out.print(curve)
    for line in made.notes:
        out.print(f"note: {line}")
