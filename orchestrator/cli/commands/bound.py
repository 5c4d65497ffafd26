"""Define `desat bound NAME`."""

from __future__ import annotations

from pathlib import Path
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
    as_json: o.Json = False,
) -> None:
    """Compute the least effort with which a run could have done.

    Of a run that dumps by thrusters it is the firing time; of momentum management by
    coils the energy for the same peak momentum of a wheel.
    """
    from ...analyses import coil_bound
    from ...analyses import lower_bound as lower_bound
    from ...runs.run import run_or_load

    coils = _by_coils(target)
    finished = run_or_load(target, None if coils else lower_bound)
    manifest = finished.manifest
    with finished.results as results:
        least = (coil_bound if coils else lower_bound).of_run(manifest, results)
    if as_json:
        print_json({"scenario": manifest.scenario, **least.as_json()})
        return
    if least.least is None and not coils:
        err.print("no momentum left: more than can be dumped in this time")
    columns = [Column("", kind="text"), Column(""), Column("", kind="unit")]
    rows = []
    if isinstance(least, lower_bound.LowerBound):
        rows.append(("Thruster firing time of the run", f"{least.seconds:.2f}", "s"))
    for n in least.numbers().values():
        assert n.value is not None
        form = ".4g" if abs(n.value) >= 1e5 else ".2f"
        rows.append((n.title, format(n.value, form), n.unit))
    print_table(Table("", columns, rows, has_header=False), is_folded=True)


def _by_coils(target: str) -> bool:
    """Return whether the manager of a scenario, .ssp or run folder knows single coils.

    Then it is a law of momentum management by coils.
    """
    from ...runs.run import Options, load_run, prepare

    if any(
        (Path(target) / name).exists()
        for name in ("manifest.json", "manifest.json.part")
    ):
        with (run := load_run(Path(target))).results:
            return "axes_coil" in run.manifest.values_of("manager")
    system, _ = prepare(target, Options()).or_raise()
    manager = system.components.get("manager")
    return manager is not None and "axes_coil" in manager.interface.arrays
