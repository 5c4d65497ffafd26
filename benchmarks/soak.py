"""Many short runs in one process: do handles, memory and temporary files stay what they are?

`python -m benchmarks.soak [RUNS]` (1000) prints a line a tenth of them. Runs are in memory, into a
folder, and in processes of their own, in turn; of native FMUs, and each tenth one of Python FMUs,
of which pythonfmu is known to keep 8 kB an instance.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from desat.files import library
from desat.study.case import Options, execute

TARGET = "nadir_day/day-dipole"


def used() -> dict[str, int]:
    """What this process holds (Linux): open files, private memory (kB), temporary files."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return {
        "handles": len(os.listdir("/proc/self/fd")),
        "memory_kB": int(status.split("RssAnon:")[1].split()[0]),
        "temporary": sum(1 for _ in library._root().rglob("*")),
    }


def runs(count: int, python: bool = True) -> Iterator[dict[str, int]]:
    """Make so many runs; what is used after each tenth of them."""
    with tempfile.TemporaryDirectory() as folder:
        for i in range(count):
            place = Path(folder) / "run"
            options = Options(stop=20.0, supervised=i % 3 == 2,
                              fmus="python" if python and i % 10 == 9 else "native")  # fmt: skip
            execute(TARGET, options, place if i % 3 == 1 else None).results.close()
            shutil.rmtree(place, ignore_errors=True)
            if (i + 1) % max(1, count // 10) == 0:
                yield {"runs": i + 1, **used()}


def main() -> None:
    """As many as the command line says."""
    for line in runs(int(sys.argv[1]) if len(sys.argv) > 1 else 1000):
        print(line, flush=True)


if __name__ == "__main__":
    main()
