"""`python tests/fuzz [--seed N] [--count N] [--lines N] [--hours H]`: fuzz all readers,
and the commands with their options; 1 where one failed."""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests import fuzz
from tests.fuzz import commands


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--count", type=int, default=5000, help="inputs a round")
    parser.add_argument(
        "--hours", type=float, default=0.0, help="rounds, each with the next seed"
    )
    parser.add_argument("--lines", type=int, default=200, help="command lines a round")
    arguments = parser.parse_args()
    end, seed, failure_count = (
        time.monotonic() + 3600.0 * arguments.hours,
        arguments.seed,
        0,
    )
    while True:
        with tempfile.TemporaryDirectory() as folder:
            outcome = fuzz.run(Path(folder) / "in", seed, arguments.count)
        print(f"seed {seed}: {outcome}", flush=True)
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "in").mkdir()
            every = (*commands.QUICK, *commands.SLOW)
            line_count, wrong = commands.run(
                Path(folder) / "in", seed, arguments.lines, every
            )
        print(
            f"seed {seed}: {line_count} command lines, {len(wrong)} failed", flush=True
        )
        for line in (*outcome.failures, *wrong):
            print(f"  {line}")
        failure_count += len(outcome.failures) + len(wrong)
        seed += 1
        if time.monotonic() >= end:
            return int(failure_count > 0)


if __name__ == "__main__":
    sys.exit(main())
