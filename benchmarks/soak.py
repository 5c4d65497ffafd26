"""Many short runs in one process, or one of very many steps: do handles, memory and
temporary files stay what they are?

`python -m benchmarks.soak native [RUNS]` (1000) makes runs of native FMUs,
`python [RUNS]` (200) of Python FMUs, both in memory, into a folder, and in processes of
their own, in turn; `steps [STEPS]` (10,000,000) makes one run of so many steps, which
records two outputs at each. A line a tenth of them is printed. With `--keep` the lines
go to seen.json, too.

pythonfmu's library makes the class of an FMU of Python anew for each instance, where
the entry script lets it, and never lets go of it: `classes` counts them.
"""

from __future__ import annotations

import gc
import os
import shutil
import sys
import tempfile
import threading
import time
from abc import ABCMeta
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, cast

from desat.engine.recording.results import Results
from desat.files import library
from desat.runs.run import Options, execute

from . import seen

TARGET = "nadir_day/day-dipole"
LONG = "gyrostat/free"
COUNTS = {"native": 1000, "python": 200, "steps": 10_000_000}
ROW = 8 * (1 + 3)
"""Bytes on the disk of a row of the long run: time and three momenta."""


def used() -> dict[str, int]:
    """What this process holds (Linux): open files, private memory (kB), temporary
    files, classes of FMUs of Python."""
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    return {
        "handles": len(os.listdir("/proc/self/fd")),
        "memory_kB": int(status.split("RssAnon:")[1].split()[0]),
        "temporary": sum(1 for _ in library._root().rglob("*")),
        "classes": sum(
            isinstance(x, ABCMeta) and x.__name__.endswith("Fmu")
            for x in gc.get_objects()
        ),
    }


def runs(
    count: int, fmus: Literal["native", "python"] = "native"
) -> Iterator[dict[str, int]]:
    """Make so many runs; what is used after each tenth of them."""
    with tempfile.TemporaryDirectory() as folder:
        for i in range(count):
            place = Path(folder) / "run"
            options = Options(stop=20.0, supervised=i % 3 == 2, fmus=fmus)
            execute(TARGET, options, place if i % 3 == 1 else None).results.close()
            shutil.rmtree(place, ignore_errors=True)
            if (i + 1) % max(1, count // 10) == 0:
                yield {"runs": i + 1, **used()}


def steps(count: int) -> Iterator[dict[str, int]]:
    """One run of so many steps, in another thread; what is used after each tenth of
    them."""
    step = 0.01
    options = Options(step=step, stop=step * count, record=("wheels.h_wheel",))
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "run"
        thread = threading.Thread(
            target=execute, args=(LONG, options, place), daemon=True
        )
        thread.start()
        part, message = place / "series.h5.part", 0
        while thread.is_alive():
            time.sleep(0.2)
            size = part.stat().st_size if part.exists() else 0
            if size >= message + ROW * count // 10:
                message = size
                yield {"MB_on_disk": size // 1_000_000, **used()}
        thread.join()
        with Results.open(place) as results:
            yield {"rows": len(results.times()), **used()}


def main() -> None:
    """As many as the command line says."""
    keep, arguments = seen.is_writing(), sys.argv[1:]
    if not arguments or arguments[0] not in COUNTS:
        sys.exit(__doc__)
    subject, count = (
        arguments[0],
        int(arguments[1]) if arguments[1:] else COUNTS[arguments[0]],
    )
    lines = []
    for line in steps(count) if subject == "steps" else runs(count, cast(Any, subject)):
        print(line, flush=True)
        lines.append(line)
        if keep and len(lines) > 1:
            seen.keep("soak", subject, {"lines": lines})


if __name__ == "__main__":
    main()
