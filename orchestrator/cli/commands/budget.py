"""Define `desat budget CRAFT`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...runs.progress import stages
from ...sizing import quantities
from ...system.errors import DesatError, Exit, choices
from .. import options as o
from ..console import app, err, example, name_of, out


@app.command(epilog=example("desat budget my12u --format md"))
def budget(
    target: o.Target,
    form: Annotated[
        str,
        typer.Option(
            "--format", help="html, pdf (pip install 'desat[pdf]'), md, tex, csv."
        ),
    ] = "html",
    factor: Annotated[
        float,
        o.number(
            quantities.NEEDS,
            "FACTOR",
            "On every need, before it is held against limits.",
        ),
    ] = 1.0,
    loop: Annotated[
        bool,
        typer.Option("--loop/--no-loop", help="Fly the sizes in the closed loop."),
    ] = True,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    path: Annotated[
        Path | None,
        o.output_file("--out", "Where it goes (default: runs/budget-NAME.FORMAT)."),
    ] = None,
) -> None:
    """Write the momentum budget of a craft for a design review, one sheet of A4.

    The verdict, each case beside what is allowed, worst first, what drives it, how far
    it spreads over what is assumed, and what was given and what assumed. Ends with 1
    where the craft cannot hold.
    """
    from ...files.identity import of_system
    from ...runs.prepare import prepare, read
    from ...sizing import budget as sheet
    from ...sizing import dumps, sizing
    from ...sizing.requirements import SizingRequirements

    if form not in sheet.FORMATS:
        raise DesatError(f"--format {form}: no format{choices(form, sheet.FORMATS)}")
    options = o.options_of(sets, stop, None, "gauss_seidel", False, sources=sources)
    requirements = SizingRequirements(flown=loop)
    with stages() as progress:
        size = dumps.size if dumps.is_of(target, options) else sizing.size
        sizing_result = size(target, options, requirements, progress)
    source = read(target)
    system, _ = prepare(source, options).or_raise()
    result = sheet.budget_of(
        sizing_result, of_system(system, options), source.folder, factor
    )
    file = path or Path("runs") / f"budget-{name_of(target)}.{form}"
    sheet.write(result, form, file)
    out.print(result.answer, highlight=False, markup=False)
    out.print(f"budget: {file.resolve()}", highlight=False, markup=False)
    for line in sizing_result.problems:
        err.print(f"it cannot hold: {line}", highlight=False, markup=False)
    if not result.holds:
        raise typer.Exit(Exit.UNMET)
