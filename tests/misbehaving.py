"""A campaign of a component that now and then ends its process, or never returns:
`python tests/misbehaving.py [--keep] [CASES]` (3000), in 1 % and in 0.1 % of the cases.

Every case has to have its row, those that were drawn to fail, and no others, one that
says how. With `--keep` what came of it goes to benchmarks/seen.json.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks import seen  # noqa: E402
from desat.campaign import coordinator, store  # noqa: E402
from desat.runs.run import Options  # noqa: E402
from tests.engine.test_failures import FAILURES, compile_failing, drawn_to_fail  # noqa: E402

WAYS = ["NOTHING"] * 989 + ["SEGFAULT"] * 10 + ["HANG"]
LIMIT = 2.0
"""Seconds that a case may take."""
MESSAGES = {
    "SEGFAULT": "ended its process: SIGSEGV",
    "HANG": f"did not return within {LIMIT:g} s",
}


def fly(folder: Path, cases: int) -> dict[str, object]:
    """Make the campaign; what became of its cases."""
    system = drawn_to_fail(folder / "s", compile_failing(folder), WAYS)
    plan, _ = coordinator.planned(system, cases, options=Options(step=1.0), limit=LIMIT)
    began = time.monotonic()
    coordinator.run(plan, folder / "campaign", 2, progress=False)
    seconds = time.monotonic() - began
    rows = store.read(folder / "campaign").to_pylist()
    failure_counts = Counter(FAILURES[r["in.bad.how"]] for r in rows)
    wrong = [
        r["case"]
        for r in rows
        if (r["status"] == "completed") != (FAILURES[r["in.bad.how"]] == "NOTHING")
        or MESSAGES.get(FAILURES[r["in.bad.how"]], "") not in r["message"]
    ]
    return {
        "cases": cases,
        "each_once": [r["case"] for r in rows] == list(range(cases)),
        "crashed": failure_counts["SEGFAULT"],
        "hung": failure_counts["HANG"],
        "wrong": wrong,
        "seconds": round(seconds, 1),
    }


def main() -> int:
    """1 where a case is missing, twice, or says something else."""
    keep = seen.is_writing()
    with tempfile.TemporaryDirectory() as folder:
        outcome = fly(Path(folder), int(sys.argv[1]) if sys.argv[1:] else 3000)
    print(outcome)
    if keep:
        seen.keep("misbehaving", "pool", outcome)
    return int(bool(outcome["wrong"]) or not outcome["each_once"])


if __name__ == "__main__":
    sys.exit(main())
