"""Scenarios with a rigid body, their first steps flown as they are and with 64
substeps: how far is the attitude off, and how much work do steps hide
(`analyses/energy.py`)?

    python -m benchmarks.hidden_work [FAMILY ...]

writes docs/papers/gyrostat/hidden_work.json after each scenario; the page of `gyrostat`
reads it. What was flown on the day of the file already is kept, so that it may be
stopped and go on.
"""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

from benchmarks.validation import calibration
from desat.analyses import energy
from desat.files import paths
from desat.files.scenario import families, scenarios
from desat.runs.run import Options, prepare

STEPS = 6000


def of(name: str) -> dict[str, Any] | None:
    """Of one scenario; None for one without a rigid body, or without substeps."""
    case = prepare(name, Options(substeps=calibration.FINEST))
    if case.problems:
        return None
    system, _ = case.or_raise()
    if energy.applies(system) is None:
        return None
    stop = system.start + min(system.steps, STEPS) * system.step
    return calibration.held(name, name, (None,), stop=stop)[0]._asdict()


def main() -> int:
    """Fly them and write."""
    file = paths.DRAWS / "gyrostat" / "hidden_work.json"
    today = f"{datetime.now(UTC):%Y-%m-%d}"
    data = json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}
    runs = data["runs"] if data.get("date") == today else []
    for family in sys.argv[1:] or families():
        for name in scenarios(family):
            if name in [r["name"] for r in runs] or (row := of(name)) is None:
                continue
            runs.append(row)
            data = {
                "date": today,
                "steps": STEPS,
                "runs": runs,
                "versions": {p: version(p) for p in ("desat", "numpy")},
            }
            file.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
