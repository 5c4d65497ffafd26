"""`python -m benchmarks.validation`: a scenario against the reference."""

from __future__ import annotations

import argparse
import json
import os
import sys

from desat.runs.run import Options
from desat.system.errors import DesatError

from . import convergence

COLUMNS = {
    "step": "step s",
    "attitude_error": "attitude rad",
    "estimate": "its estimate",
    "wheel_momentum_error": "wheel momentum N m s",
    "estimate_wheel_momentum": "its estimate",
    "momentum_drift": "momentum residual N m s",
    "attitude_error_same_delays": "attitude, same delays",
    "wheel_momentum_error_same_delays": "wheel momentum, same delays",
}


def _convergence(inputs: argparse.Namespace) -> None:
    """Print the errors of a scenario at several steps."""
    steps = None if inputs.steps is None else tuple(map(float, inputs.steps.split(",")))
    options = Options(stop=inputs.stop, substeps=inputs.substeps)
    result = convergence.study(
        inputs.target, options, steps, jobs=inputs.jobs, progress=True
    )
    if inputs.json:
        print(json.dumps(result, indent=1))
        return
    print(" | ".join(("algorithm", *COLUMNS.values())))
    for row in result["rows"]:
        cells = ["" if row[key] is None else f"{row[key]:.2e}" for key in COLUMNS]
        print(" | ".join((row["algorithm"], f"{row['step']:g}", *cells[1:])))
    for note in dict.fromkeys(filter(None, (row["note"] for row in result["rows"]))):
        print(f"same delays: {note}")
    if result["order"] is not None:
        print(
            f"observed order (gauss_seidel): {result['order']:.2f} in attitude, "
            f"{result['order_wheel_momentum']:.2f} in the wheels' momentum"
        )


def main() -> int:
    """The command."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("convergence", help=_convergence.__doc__)
    one.add_argument("target")
    one.add_argument(
        "--steps", help="s, as 1,0.5 (default: the scenario's, and three finer ones)"
    )
    one.add_argument("--stop", type=float, help="s")
    one.add_argument("--substeps", type=int)
    one.add_argument("--json", action="store_true")
    one.set_defaults(does=_convergence)
    one.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    try:
        arguments.does(arguments)
    except (DesatError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
