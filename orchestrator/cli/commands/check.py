"""Define `desat check NAME`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...report.table import Column, Table
from ...system.errors import Exit, plain
from .. import options as o
from ..console import Sections, app, err, example, out, print_json, print_table

if TYPE_CHECKING:
    from ...files.inspection import InspectedFmu
    from ...runs.case import Case

# options without meaning for a single FMU
OF_SYSTEMS = (
    "sets",
    "sources",
    "stop",
    "step",
    "substeps",
    "accuracy",
    "blocks",
    "design",
    "classes",
    "algorithm",
    "solve_loops",
    "strict",
    "outside",
    "schedule_too",
)
CheckedTarget = Annotated[
    str,
    typer.Argument(
        metavar="NAME|FILE|FOLDER",
        help="The folder of a craft of your own, a scenario (see `desat list`), a scenario file "
        "(.toml), an .ssp file, a folder with a SystemStructure.ssd, or an FMU (.fmu, or its "
        "folder).",
        show_default=False,
        autocompletion=o.complete_name,
    ),
]


@app.command(cls=Sections, epilog=example("desat check my12u --schedule"))
def check(
    ctx: typer.Context,
    target: CheckedTarget,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    blocks: o.Blocks = False,
    design: o.DesignOption = None,
    classes: o.Classes = None,
    algorithm: o.Alg = "gauss_seidel",
    solve_loops: o.SolveLoops = False,
    trust: o.Trust = None,
    strict: o.Strict = False,
    outside: o.Outside = False,
    schedule_too: Annotated[
        bool,
        typer.Option(
            "--schedule",
            help="Print in which order components step, and when "
            "each connection moves its value.",
        ),
    ] = False,
    as_json: o.Json = False,
) -> None:
    """Find what is wrong with a system before it runs, or with an FMU.

    Of an FMU its description is read, its binary is not loaded: interface, platforms,
    hash, and what breaks the FMI standard.
    """
    from ...files.inspection import is_fmu

    if is_fmu(target):
        o.refuse(ctx, "it is of a system, and this is an FMU", *OF_SYSTEMS)
        _check_fmu(Path(target), trust, as_json)
        return
    from ...runs.checking import check as find

    options = o.options_of(
        sets,
        stop,
        step,
        algorithm,
        blocks,
        classes,
        sources,
        substeps=substeps,
        accuracy=accuracy,
        design=design,
        trust=trust,
        strict=strict,
        outside=outside,
        solve_loops=solve_loops,
    )
    checked = find(target, options)
    if as_json:
        _print_as_json(checked)
    else:
        _print_checked(checked, target, schedule_too)
    if checked.problems:
        raise typer.Exit(Exit.UNMET)


def _timing_of(checked: Case) -> dict[str, str]:
    """Return when each connection moves its value, by the connection's text."""
    schedule = checked.schedule
    return {
        f"{connection.source}.{connection.output_array} -> "
        f"{connection.target}.{connection.input_array}": cause
        for connection, cause in (schedule.timing if schedule else ())
    }


def _print_as_json(checked: Case) -> None:
    """Print what a check has found as JSON."""
    print_json(
        {
            "problems": checked.problems,
            "warnings": checked.warnings,
            "unwired": {name: asdict(ends) for name, ends in checked.unwired.items()},
            "order": checked.schedule.order if checked.schedule else [],
            "connections": [
                {"connection": k, "timing": v} for k, v in _timing_of(checked).items()
            ],
        }
    )


def _print_checked(checked: Case, target: str, with_schedule: bool) -> None:
    """Print what a check has found, and the order of steps where it is wanted."""
    for problem in checked.problems:
        err.print(problem)
    for warning in checked.warnings:
        err.print(f"warning: {warning}")
    for note in checked.notes:
        err.print(f"note: {note}")
    schedule = checked.schedule
    if schedule is not None and not checked.problems:
        parts = len(schedule.order), len(schedule.timing)
        out.print(
            f"{target}: no problem: {parts[0]} components, {parts[1]} connections"
        )
    if schedule is not None and with_schedule:
        out.print("steps in this order: " + ", ".join(schedule.order))
        columns = [Column("connection", kind="text"), Column("moves", kind="text")]
        print_table(Table("", columns, list(_timing_of(checked).items())))
    if checked.problems:
        err.print(f"{len(checked.problems)} problem(s) in {target}")


def _check_fmu(path: Path, trust: Path | None, as_json: bool) -> None:
    """Print what an FMU is, and how it breaks the standard."""
    from ...files.inspection import inspect_fmu
    from ...files.library import hashes

    trusted = None if trust is None else hashes(trust)
    inspected = inspect_fmu(path)
    problems = list(inspected.problems)
    if trusted is not None and not inspected.ours and inspected.sha256 not in trusted:
        problems.append(
            f"{path.name} is not of the list of --trust (sha256 {inspected.sha256})"
        )
    if as_json:
        print_json({**asdict(inspected), "problems": problems})
    else:
        _print_fmu(inspected)
        for problem in problems:
            err.print(problem, markup=False)
        for warning in inspected.warnings:
            err.print(f"warning: {warning}", markup=False)
    if problems:
        if not as_json:
            err.print(f"{len(problems)} problem(s) in {path}", markup=False)
        raise typer.Exit(Exit.UNMET)


def _print_fmu(inspected: InspectedFmu) -> None:
    """Print the interface of an FMU, its platforms and its hash."""
    kinds = ", ".join(inspected.kinds) or "nothing that it names"
    out.print(
        plain(f"{inspected.model}: FMI {inspected.fmi} for {kinds}"), markup=False
    )
    out.print(
        f"platforms: {plain(', '.join(inspected.platforms)) or 'none'}", markup=False
    )
    owner = " (ours)" if inspected.ours else ""
    out.print(f"sha256: {inspected.sha256}{owner}", markup=False)
    for causality, variables in inspected.of_causality().items():
        rows = []
        for v in variables:
            size = f"[{','.join(map(str, v.shape))}]" if v.shape else ""
            rows.append((f"{v.name}{size}", v.type, v.unit, v.description))
        columns = [
            Column(title, kind="text") for title in (causality, "type", "unit", "")
        ]
        out.print()
        print_table(Table("", columns, rows))
    if inspected.roles:
        out.print()
        out.print("roles (`desat help blocks ROLE`):")
    for role in inspected.roles:
        out.print(f"  {role.text()}", markup=False, highlight=False)
