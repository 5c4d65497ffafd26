"""Define `desat bound NAME`."""

from __future__ import annotations

from typing import Annotated

import typer

from ...report.table import Column, Table
from .. import options as o
from ..console import app, err, example, print_json, print_table


@app.command(epilog=example("desat bound uosat12/table3-ocdc-ilqr-1"))
def bound(
    target: Annotated[
        str,
        typer.Argument(
            metavar="NAME|RUN|FILE.ssp",
            help="A scenario, or a run's folder.",
            show_default=False,
            autocompletion=o.complete_name,
        ),
    ],
    first: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="TIME",
            parser=o.time_or_orbits("--from"),
            help="By coils: time from which the wheels' largest momentum counts, as --stop. "
            "Default: the start, or half of the run where the start's momentum is the largest.",
            show_default=False,
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Compute the least effort with which a run could have done.

    Of a run that dumps by thrusters it is the firing time; of momentum management by
    coils the energy for the same peak momentum of a wheel, with coils that keep to their
    limit.
    """
    from ...analyses.lower_bound import LowerBound
    from ...runs.bounds import bound as bound_of
    from ...runs.progress import stages

    with stages(not as_json) as progress:
        progress("the run, and the least effort with which it could have done")
        manifest, least = bound_of(target, first)
    if as_json:
        print_json({"scenario": manifest.scenario, **least.as_json()})
        return
    if isinstance(least, LowerBound) and least.least is None:
        err.print("no momentum left: more than can be dumped in this time")
    if not isinstance(least, LowerBound):
        if least.least is None:
            err.print(
                "no least energy: no course was found that keeps wheels and coils within "
                "their limits"
            )
        if least.ease > 0.0:
            err.print(
                "the least energy is that of limits of wheels and coils "
                f"{100.0 * least.ease:g} % wider: the coils reach their limit"
            )
    columns = [Column("", kind="text"), Column(""), Column("", kind="unit")]
    rows = []
    if isinstance(least, LowerBound):
        rows.append(("Thruster firing time of the run", f"{least.seconds:.2f}", "s"))
    for n in least.numbers().values():
        assert n.value is not None
        form = ".2f" if 0.1 <= abs(n.value) < 1e5 else ".4g"
        rows.append((n.title, format(n.value, form), n.unit))
    print_table(Table("", columns, rows, has_header=False), is_folded=True)
