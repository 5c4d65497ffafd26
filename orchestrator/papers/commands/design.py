"""Define `desat design`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from ...cli import options as o
from ...cli.console import app, example, out, print_json, print_table
from ...numbers.text import spell_unit
from ...report.table import Column, Table
from ...runs.progress import progress
from ...system.errors import DesatError


@app.command(epilog=example("desat design uosat12/fig2-ccpl-1"))
def design(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[NAME]...",
            help="Scenarios (default: all with a design; takes minutes).",
        ),
    ] = None,
    sets: o.Sets = None,
    stop: o.Stop = None,
    step: o.Step = None,
    file: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="Another file than the scenario's own; needed with other "
            "values, for `desat run NAME --set ... --design FILE`.",
        ),
    ] = None,
    as_json: o.Json = False,
) -> None:
    """Compute the gain tables and costates that laws need beforehand.

    They are kept in ssp/FAMILY/design/.
    """
    from ...files import paths
    from ..designs import making as design_module

    if file is None:
        paths.writable("`desat design`", "--out FILE")
    options = o.options_of(sets, stop, step, "gauss_seidel", True)
    scenarios = design_module.designable(names or [])
    if file is not None and len(scenarios) != 1:
        raise DesatError(f"--out {file}: one scenario is needed")
    if file is None and (sets or stop is not None or step is not None):
        raise DesatError(
            "a design for other values needs --out FILE: the scenario's own file stays what it is "
            "(or make it within the run: `desat run NAME --set ... --design now`)"
        )
    designs = []
    with progress("design", len(scenarios), not as_json) as tell:
        for s in scenarios:
            d = design_module.design(s, options)
            designs.append((s, d, design_module.write(s, d, options, file)))
            tell(len(designs), s.name)
    if as_json:
        print_json([design_module.as_json(*each) for each in designs])
        return
    columns = [Column(title, kind="text") for title in ("scenario", "reached", "tuned")]
    rows = [(s.name, _values(d.reached), _values(d.tuned)) for s, d, _ in designs]
    print_table(Table("", columns, rows), is_folded=True)
    for folder in sorted({path.parent for _, _, path in designs}):
        out.print(f"written to {os.path.relpath(folder)}")


def _values(entries: Mapping[str, tuple[object, str]]) -> str:
    """Return the numbers among values by name, each with its unit."""
    return ", ".join(
        f"{name} = {value:.6g} {spell_unit(unit)}"
        for name, (value, unit) in entries.items()
        if isinstance(value, float)
    )
