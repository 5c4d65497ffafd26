"""What `make demo` ends with: one dump of the paper's, its value beside ours, the least
possible.

python -m benchmarks.demo RUN
"""

from __future__ import annotations

import sys
from pathlib import Path

from desat.analyses import lower_bound
from desat.files.scenario import find
from desat.runs.run import load_run

SCENARIO = "uosat12/table3-ocdc-ilqr-1"


def main() -> int:
    folder = Path(sys.argv[1])
    run = load_run(folder)
    run_manifest = run.manifest
    with run.results as results:
        least = lower_bound.of_run(run_manifest, results).least_same_end
    row = find(SCENARIO).content.paper["firing_time"]
    assert isinstance(row.values, dict)
    printed = row.values["ocdc"][row.columns.index("ilqr-1")]
    ours = run_manifest.numbers["firing_time"].value
    print(f"""
What was flown: UoSAT-12, pointing to nadir, empties its wheels through coils and thrusters
together, for {run_manifest.stop:g} s: the optimal combined dumping (OCDC) of Chen & Steyn, their Table 3.

firing time of the thrusters     paper     ours     least that any law could do with
                              {printed:6.2f} s {ours:6.2f} s {least:6.2f} s

Its report, with plots:        {folder}/report.html
The paper's tables, all of it: .venv/bin/desat tables uosat12    or docs/papers/uosat12/README.md
A craft of your own:           .venv/bin/desat new craft my12u --size 12U""")
    return 0


if __name__ == "__main__":
    sys.exit(main())
