"""Define `desat tune CRAFT component.parameter --for NUMBER`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from ...runs.progress import stages
from ...system.errors import DesatError, Exit
from ...system.quantity import Quantity
from .. import options as o
from ..console import app, example, out, print_json, print_table

if TYPE_CHECKING:
    from ...studies.tune import Tuned

BETWEEN = Quantity("--between")


@app.command(
    epilog=example("desat tune my12u manager.gain --for sum_rms --stop 2orbits")
)
def tune(
    target: o.Target,
    parameter: Annotated[
        str, typer.Argument(metavar="COMP.VAR", help="What is tuned: manager.gain.")
    ],
    number: Annotated[
        str,
        typer.Option(
            "--for",
            metavar="NUMBER",
            help="Of the scenario, or a standard one such as coil_duty: its median over "
            "the random samples is minimised.",
        ),
    ],
    most: Annotated[
        bool, typer.Option("--most", help="Make it as large as can be.")
    ] = False,
    between: Annotated[
        str | None,
        typer.Option(
            metavar="LOW,HIGH",
            help="The range (default: a tenth to ten times what it has).",
        ),
    ] = None,
    count: Annotated[
        int,
        typer.Option(
            "-n", "--count", min=1, help="Random samples that it is tuned with."
        ),
    ] = 8,
    unseen: Annotated[
        int, typer.Option(help="Further random samples that test the result.", min=1)
    ] = 16,
    seed: o.Seed = 1,
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
    """Find the best value of a parameter over random samples.

    The median of a number over the samples is minimised, and no requirement may be
    missed more often than now. Further samples test the result: 1 where they do not
    confirm it.
    """
    from ...studies import tune as study

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
    ends = None
    if between is not None:
        numbers = BETWEEN.many(between)
        if len(numbers) != 2:
            raise DesatError(
                f"--between {between}: two numbers are needed, as 1e-4,1e-2"
            )
        ends = numbers[0], numbers[1]
    with stages(not as_json) as tell:
        tuned = study.tune(
            target,
            parameter,
            number,
            options,
            most=most,
            between=ends,
            draws=count,
            unseen=unseen,
            seed=seed,
            jobs=jobs,
            progress=tell,
        )
    if as_json:
        print_json(tuned.as_json())
    else:
        _print(tuned)
    if not tuned.confirmed:
        raise typer.Exit(Exit.UNMET)


def _print(tuned: Tuned) -> None:
    """Print the result of a tuning."""
    from ...numbers.text import number, spell_unit

    out.print(tuned.answer, highlight=False, markup=False)
    print_table(tuned.table)
    unseen = tuned.unseen
    within = "too few for an interval"
    if unseen.interval_holds:
        within = " to ".join(map(number, unseen.interval))
    out.print(
        f"unseen samples, own less best: median {number(unseen.levels['median'])} ({within}, 95 %) "
        f"{spell_unit(tuned.number_unit)}, {unseen.n} pairs; a requirement is missed in "
        f"{unseen.missed_own} and {unseen.missed_best}",
        highlight=False,
    )
