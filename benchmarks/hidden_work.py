"""Every scenario with a rigid body, its first steps flown as it is and with 64 inner steps: how far
is its attitude off, and how much work do its steps hide (`analyses/energy.py`)?

    python -m benchmarks.hidden_work

writes docs/papers/gyrostat/hidden_work.json, which the page of `gyrostat` reads.
"""

from __future__ import annotations

import json
import sys
from datetime import UTC, datetime
from importlib.metadata import version

from desat.analyses import energy, separation
from desat.files import places
from desat.files.scenario import scenarios
from desat.study.case import Options, prepare
from desat.system.errors import DesatError

STEPS = 6000


def main() -> int:
    """Fly them and write."""
    file = places.DRAWS / "gyrostat" / "hidden_work.json"
    rows, left_out = [], {}
    for name in scenarios():
        system, _ = prepare(name, Options()).or_raise()
        if energy.applies(system) is None:
            continue
        stop = system.start + min(system.steps, STEPS) * system.step
        try:
            (row,) = separation.held(name, name, (None,), stop=stop)
        except DesatError as error:
            left_out[name] = str(error).rpartition(": ")[2]
            continue
        rows.append(row._asdict())
        print(f"{name}: {row.error:.1e} rad, {row.hidden:.1e}", flush=True)
    data = {"date": f"{datetime.now(UTC):%Y-%m-%d}", "steps": STEPS, "left_out": left_out,
            "versions": {p: version(p) for p in ("desat", "numpy")}, "runs": rows}  # fmt: skip
    file.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
