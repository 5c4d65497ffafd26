"""Define `desat fit CRAFT LOG`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ...system.quantity import Quantity
from .. import options as o
from ..console import app, example, out, print_json, print_table, warn

FIELD_ERROR = Quantity("--field-error", "T", 0.0, 1e-4)
ATTITUDE_ERROR = Quantity("--attitude-error", "rad", 0.0, 0.5)


@app.command(epilog=example("desat fit my12u log.csv --dry-run"))
def fit(
    target: o.Target,
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG.csv",
            help="Columns by name with their unit: time [s] or utc first, speed_1 [rpm] or "
            "h_1 [N.m.s], q_bi[1] to q_bi[4], m_coil[1] [A.m2]; the csv of `desat run --csv`; or "
            "dates of dumps alone, utc.",
        ),
    ],
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="Print the fit and write nothing.")
    ] = False,
    scalar_first: Annotated[
        bool, typer.Option("--scalar-first", help="q_bi[1] is the scalar.")
    ] = False,
    field_error: Annotated[
        float,
        o.number(FIELD_ERROR, "T", "Deviation of the model of the field, each axis."),
    ] = 100e-9,
    attitude_error: Annotated[
        float,
        o.number(
            ATTITUDE_ERROR,
            "RAD",
            "Deviation of the attitude, each axis: 0.1deg (default).",
        ),
    ] = 0.00174533,
    sets: o.Sets = None,
    as_json: o.Json = False,
) -> None:
    """Fit residual dipole, centre of pressure and steady torque to telemetry.

    What the log shows goes into craft.toml with its spread, so that `desat size` has
    narrower intervals; craft.toml.bak is the file before. What the log cannot show is
    printed, and stays.
    """
    from ...files.paths import shown
    from ...telemetry import craft_file
    from ...telemetry.tables import describe_fit, fit_as_json, tabulate_fit
    from ...telemetry.target import fit_target

    file = None if dry_run else craft_file.craft_file_of(target)
    options = o.options_of(sets, None, None, "gauss_seidel", False)
    errors = field_error, attitude_error
    result = fit_target(target, options, log, scalar_first, errors)
    backup = None
    if file is not None:
        backup = craft_file.write_fit(file, result, log.name)
        warn(craft_file.overriding_files(file, result))
    if as_json:
        place = None if file is None else shown(file)
        print_json({**fit_as_json(result), "written": place})
        return
    print_table(tabulate_fit(result))
    for line in describe_fit(result):
        out.print(line, highlight=False, markup=False)
    if file is not None:
        out.print(f"written: {shown(file)}; before: {shown(Path(str(backup)))}")
