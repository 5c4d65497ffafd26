"""Momentum of every scenario of a family, flown whole: does what craft and wheels have
add up to their start and the external impulse?

    python -m benchmarks.residuals FAMILY ...

writes docs/papers/FAMILY/residuals.json: of each scenario the largest residual (N m s,
computed outside the spacecraft: `analyses/residual.py`), the largest momentum, and one
over the other. What was flown on the day of the file already is kept, so that it may be
stopped and go on.
"""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import numpy as np

from desat.analyses import residual
from desat.files import paths
from desat.files.scenario import scenarios
from desat.runs.run import Options, execute

RECORDED = (
    "spacecraft.q_bi",
    "spacecraft.omega_bi_body",
    "spacecraft.impulse_eci",
    "wheels.h_wheel",
)


def of(name: str) -> dict[str, Any]:
    """Of one scenario, by its FMUs."""
    run = execute(name, Options(record=RECORDED, supervised=True)).or_raise(name)
    found = residual.momentum(run.manifest, run.results)
    assert found is not None, name
    largest = float(np.linalg.norm(found.residual, axis=1).max())
    row = {
        "steps": run.manifest["steps_done"],
        "residual": largest,
        "momentum": found.largest,
        "share": largest / found.largest,
    }
    run.results.close()
    return row


def measure(family: str) -> None:
    """Write the file of a family, after each scenario."""
    file = paths.DRAWS / family / "residuals.json"
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    data = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    saved = data.get("runs", {}) if data.get("date") == today else {}
    runs: dict[str, Any] = {}
    for name in scenarios(family):
        runs[name] = saved.get(name) or of(name)
        data = {
            "date": today,
            "versions": {p: version(p) for p in ("desat", "numpy")},
            "runs": runs,
        }
        file.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")


def main() -> int:
    """Measure and write."""
    for family in sys.argv[1:]:
        measure(family)
    return 0


if __name__ == "__main__":
    sys.exit(main())
