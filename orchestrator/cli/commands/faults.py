"""Define `desat faults A B ...`."""

from __future__ import annotations

import math
from typing import Annotated

import typer

from ...system.errors import DesatError, Exit
from .. import options as o
from ..console import Sections, app, example, out, print_json, print_table


@app.command(cls=Sections, epilog=example("desat faults my12u --laws predictive -n 4"))
def faults(
    ctx: typer.Context,
    targets: Annotated[
        list[str],
        typer.Argument(
            metavar="A B ...",
            autocompletion=o.complete_name,
            help="Scenarios, each with its own law, or one craft.",
        ),
    ],
    count: Annotated[
        int,
        typer.Option(
            "-n", "--count", min=1, help="Number of random samples of each fault."
        ),
    ] = 40,
    seed: o.Seed = 1,
    laws: Annotated[
        str | None,
        typer.Option(
            metavar="all|NAME,...",
            help="Fly the one craft also with each manager of ours that fits it, or with "
            "these, gains by rule.",
        ),
    ] = None,
    fault: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Fly this fault alone; again for others (default: all).",
        ),
    ] = None,
    number: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Number of the scenario whose median is given (default: a time that it "
            "measures, else the fill of the fullest wheel).",
        ),
    ] = None,
    limit: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=MOST", help="A sample fails where this number is above MOST."
        ),
    ] = None,
    more: Annotated[
        int,
        typer.Option(
            "--more",
            min=0,
            help="Number of samples of a fault under which the first law is worse than "
            "another (default: --count).",
        ),
    ] = 0,
    tune: Annotated[
        str,
        typer.Option(
            metavar="COMP.VAR",
            help="Parameter that is first searched for each law that has it, without a "
            "fault and over other samples, as by desat tune.",
        ),
    ] = "",
    sets: o.Sets = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    blocks: o.Blocks = False,
    fmus: o.Fmus = "native",
    time_limit: o.TimeLimit = None,
    jobs: o.Jobs = o.CPUS,
    as_json: o.Json = False,
) -> None:
    """Fly a craft under faults that its law does not know of, and say where it breaks.

    Dead, weak and turned coils, a dead wheel, friction, errors of sensors, inertia and
    thrust, a dipole, torques in pulses. A sample fails where its run does not complete or
    misses a requirement, or never reaches what the scenario measures the time of.
    """
    from ...studies import faults as study

    options = o.options_of(
        sets,
        stop,
        step,
        "gauss_seidel",
        blocks,
        substeps=substeps,
        accuracy=accuracy,
        time_limit=time_limit,
        fmus=fmus,
    )
    names = [x.strip() for x in (laws or "").split(",") if x.strip()]
    table = study.fly_faults(
        targets,
        options,
        study.chosen(fault or []),
        count,
        seed,
        names,
        number,
        dict(map(_limit, limit or [])),
        jobs,
        progress=not as_json,
        more=more,
        free=tune,
    )
    if as_json:
        print_json(table.as_json())
    else:
        out.print(table.answer, highlight=False, markup=False)
        print_table(table.table)
        for title, reason in table.without.items():
            out.print(
                f"does not apply: {title}: {reason}", highlight=False, markup=False
            )
    nominal = table.rows[study.NOMINAL][1]
    rows = [
        outcomes for name, (_, outcomes) in table.rows.items() if name != study.NOMINAL
    ]
    if any(x[0].failed > nominal[0].failed for x in rows):
        raise typer.Exit(Exit.UNMET)


def _limit(text: str) -> tuple[str, float]:
    """Parse `NAME=MOST`."""
    name, _, value = text.partition("=")
    try:
        most = float(value)
    except ValueError:
        most = math.nan
    if not name or math.isnan(most):
        raise DesatError(f"--limit {text}: NAME=MOST is needed, as final_momentum=0.1")
    return name, most
