"""`desat check NAME`."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer
from rich.table import Table

from ...system.errors import Exit
from .. import options as o
from ..console import app, err, example, out, print_json


@app.command(epilog=example("desat check my12u --schedule"))
def check(
    target: o.Target,
    sets: o.Sets = None,
    sources: o.Sources = None,
    stop: o.Stop = None,
    step: o.Step = None,
    substeps: o.Substeps = None,
    accuracy: o.Accuracy = None,
    blocks: o.Blocks = False,
    design: o.DesignOption = None,
    classes: o.Classes = None,
    trust: o.Trust = None,
    strict: o.Strict = False,
    outside: o.Outside = False,
    schedule_too: Annotated[
        bool, typer.Option("--schedule", help="Print in which order components step, and when "
                           "each connection moves its value.")
    ] = False,
    as_json: o.Json = False,
) -> None:  # fmt: skip
    """Find what is wrong with a system before it runs."""
    from ...analyses import attitude_loop
    from ...engine.trial_initialisation import refusals
    from ...files.library import notes
    from ...runs.prepare import prepare
    from ...system.refusal import explain

    options = o.options_of(sets, stop, step, o.Semantics.gauss_seidel, blocks, classes, sources,
                         substeps=substeps, accuracy=accuracy, design=design, trust=trust,
                         strict=strict, outside=outside)  # fmt: skip
    case = prepare(target, options)
    checked, schedule = case.checked, case.checked.schedule
    if checked.system is not None and schedule is not None:
        full = list(attitude_loop.problems_when_full(checked.system))
        checked.problems += full
        checked.warnings = [line for line in checked.warnings if line not in full]
        problems, warnings = refusals(checked.system, schedule, options.trusted)
        checked.problems += explain(checked.system, "\n".join(problems))
        checked.warnings += explain(checked.system, "\n".join(warnings))
        checked.notes += notes(checked.system.components.values())
    timing: dict[str, str] = {}
    for connection, when in schedule.timing if schedule else ():
        key = (f"{connection.source}.{connection.output_array} -> "
               f"{connection.target}.{connection.input_array}")  # fmt: skip
        timing[key] = when
    if as_json:
        print_json(
            {
                "problems": checked.problems,
                "warnings": checked.warnings,
                "unwired": {name: asdict(ends) for name, ends in checked.unwired.items()},
                "order": schedule.order if schedule else [],
                "connections": [{"connection": k, "timing": v} for k, v in timing.items()],
            }
        )
    else:
        for problem in checked.problems:
            err.print(problem)
        for warning in checked.warnings:
            err.print(f"warning: {warning}")
        for note in checked.notes:
            err.print(f"note: {note}")
        if schedule is not None and not checked.problems:
            parts = len(schedule.order), len(schedule.timing)
            out.print(f"{target}: no problem: {parts[0]} components, {parts[1]} connections")
        if schedule is not None and schedule_too:
            out.print("steps in this order: " + ", ".join(schedule.order))
            table = Table("connection", "moves", box=None, header_style="bold", pad_edge=False)
            for key, when in timing.items():
                table.add_row(key, when)
            out.print(table)
    if checked.problems:
        if not as_json:
            err.print(f"{len(checked.problems)} problem(s) in {target}")
        raise typer.Exit(Exit.UNMET)
