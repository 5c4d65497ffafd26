"""`desat export RUN`, and what else is made for other programs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .. import options as o
from ..console import WithDefault, app, err, out, print_json

exports = typer.Typer(
    cls=WithDefault, no_args_is_help=True, rich_markup_mode=None,
    help="For other programs: `desat export RUN` a run's series or plots, `desat export fmu NAME` "
    "a whole loop as one FMU.",
)  # fmt: skip
app.add_typer(exports, name="export")


@exports.command()
def run(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="A run folder.")],
    form: Annotated[
        str, typer.Option("--format", help="csv, parquet, mat, or, of its plots, png or pdf.")
    ] = "csv",
    into: Annotated[
        Path | None,
        typer.Option("--out", help="The folder to write to (default: RUN).", show_default=False),
    ] = None,
) -> None:
    """Write a run's series or plots for other programs."""
    from ...report.export import export as write

    paths, note = write(folder, form, into)
    for path in paths:
        out.print(str(path))
    if note:
        err.print(f"note: {note}")


Names = list[str] | None


@exports.command()
def fmu(
    target: o.Target,
    outputs: Annotated[
        Names, typer.Option(help="Outputs, `component.output`, `*` and `?` as in file names. May "
                            "be repeated (default: those that the scenario plots).")
    ] = None,
    inputs: Annotated[
        Names, typer.Option(help="Inputs that nothing in the loop feeds. May be repeated.")
    ] = None,
    parameters: Annotated[
        Names, typer.Option(help="Parameters, also shared.NAME. May be repeated.")
    ] = None,
    without: Annotated[
        Names, typer.Option(metavar="COMPONENT", help="Leave a component out: what it gives "
                            "becomes inputs, what it is given outputs. May be repeated.")
    ] = None,
    file: Annotated[
        Path | None,
        typer.Option("--out", help="The file to write (default: NAME.fmu).", show_default=False),
    ] = None,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    inner: o.Inner = None,
    accuracy: o.Accuracy = None,
    platforms: o.Platforms = "",
    fmi: o.Fmi = o.FmiVersion.two,
    as_json: o.Json = False,
) -> None:  # fmt: skip
    """Write the loop of a scenario as one native FMU, with the same bits as `desat run`."""
    from ...runs.loop_fmu import Wanted, export

    options = o.options_of(
        sets, stop, step, o.Semantics.conserving, False, None, sources, inner=inner,
        accuracy=accuracy,
    )  # fmt: skip
    wanted = Wanted(outputs or (), inputs or (), parameters or (), without or ())
    path = export(target, options, wanted, file, platforms, third=fmi is o.FmiVersion.three)
    if as_json:
        print_json({"fmu": str(path)})
    else:
        out.print(str(path))
