"""Define `desat export RUN`, and other exports for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import options as o
from ..console import Commands, WithDefault, app, err, example, out, print_json

exports = Commands(
    cls=WithDefault,
    no_args_is_help=True,
    rich_markup_mode=None,
    help="Write a run, a loop or a law for other programs: `desat export RUN` series or plots, "
    "`export fmu NAME` a loop as one FMU, `export c BLOCK` a law alone.",
)
app.add_typer(exports, name="export")


@exports.command(epilog=example("desat export runs/my12u --format parquet"))
def run(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    form: Annotated[
        str,
        typer.Option(
            "--format", help="csv, parquet, mat, or, of its plots, svg, png or pdf."
        ),
    ] = "csv",
    into: Annotated[
        Path | None,
        typer.Option(
            "--out", help="The folder to write to (default: RUN).", show_default=False
        ),
    ] = None,
) -> None:
    """Write a run's series or plots for other programs."""
    from ...export.series import export as write

    paths, note = write(folder, form, into)
    for path in paths:
        out.print(str(path))
    if note:
        err.print(f"note: {note}")


Names = list[str] | None


@exports.command(epilog=example("desat export fmu my12u --fmi 3"))
def fmu(
    target: o.Target,
    outputs: Annotated[
        Names,
        typer.Option(
            help="Outputs, `component.output`, `*` and `?` as in file names. May "
            "be repeated (default: those that the scenario plots)."
        ),
    ] = None,
    inputs: Annotated[
        Names,
        typer.Option(help="Inputs that nothing in the loop feeds. May be repeated."),
    ] = None,
    parameters: Annotated[
        Names, typer.Option(help="Parameters, also shared.NAME. May be repeated.")
    ] = None,
    without: Annotated[
        Names,
        typer.Option(
            metavar="COMPONENT",
            help="Leave a component out: what it gives "
            "becomes inputs, what it is given outputs. May be repeated.",
        ),
    ] = None,
    file: Annotated[
        Path | None,
        o.output_file("--out", "The file to write (default: NAME.fmu)."),
    ] = None,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    platforms: o.Platforms = "",
    fmi: o.Fmi = "2",
    reals: Annotated[
        bool,
        typer.Option(
            "--reals", help="Real outputs alone, for hosts that know no other type."
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Write the loop of a scenario as one native FMU, with the same bits as
    `desat run`.
    """
    from ...export.loop_fmu import LoopEnds, export

    options = o.options_of(
        sets,
        stop,
        step,
        "gauss_seidel",
        False,
        None,
        sources,
        substeps=substeps,
        accuracy=accuracy,
    )
    ends = LoopEnds(outputs or (), inputs or (), parameters or (), without or (), reals)
    path = export(target, options, ends, file, platforms, third=fmi == "3")
    if as_json:
        print_json({"fmu": str(path)})
    else:
        out.print(str(path))


@exports.command(epilog=example("desat export c manager_cross_product"))
def c(
    block: Annotated[
        str,
        typer.Argument(
            metavar="BLOCK|FILE.py",
            help="A block of ours by its name, or a block file of your own.",
        ),
    ],
    into: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="The folder to write to (default: this one).",
            show_default=False,
        ),
    ] = None,
    compilers: Annotated[
        list[str] | None,
        typer.Option(
            "--compiler",
            metavar="COMMAND",
            show_default=False,
            help="A compiler whose sizes the header states, with its options: "
            '"arm-none-eabi-gcc -mcpu=cortex-m7 -mthumb". May be repeated (default: '
            "that of this machine).",
        ),
    ] = None,
    samples: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            show_default=False,
            help="Largest number of samples of a plan, from which the stack follows "
            "(default: the block's own, 600 of manager_receding_horizon).",
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Write a block alone as C99, NAME.h and NAME.c: a struct, init, start and step; no
    FMI, no heap. Its header states the memory that it takes.
    """
    from ...export.block_c import export

    paths, sizes = export(block, into or Path(), compilers, samples)
    if as_json:
        print_json(
            {"files": [str(p) for p in paths], "sizes": [vars(size) for size in sizes]}
        )
        return
    for path in paths:
        out.print(str(path))
    for size in sizes:
        err.print(f"note: {size}")
