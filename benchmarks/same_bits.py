"""A whole day at nadir in many ways: is every output, at each of its 86,400 steps, the
same bits?

`python -m benchmarks.same_bits [--of SCENARIO] [WAY ...]` makes the day once as it is
and once in each of the ways below (default: all of them), each in a process of its own,
and prints a line for each: whether all is equal, how many values are compared, and the
beginning of their sha256. It ends with 1 where something differs. With `--keep` the
lines go to seen.json, too.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from desat.export.packing import pack_scenario
from desat.files.build import build
from desat.files.scenario import find
from desat.runs.checks import check_draft
from desat.runs.prepare import read
from desat.runs.run import Case, Options, prepare, simulate

from . import seen

TARGET = "nadir_day/day-igrf"
REFERENCE = "as it is"
WAYS: dict[str, dict[str, Any]] = {
    "again": {},
    "components and connections permuted": {"permuted": 1},
    "permuted otherwise": {"permuted": 2},
    "PYTHONHASHSEED=0": {"hash_seed": "0"},
    "PYTHONHASHSEED=12345": {"hash_seed": "12345"},
    "both processors busy with other work": {"busy": True},
    "from the packed file": {"packed": True},
    "in a process that is watched": {"options": {"supervised": True}},
    "with checkpoints": {"options": {"checkpoint": 6000.0}},
    "Python loop": {"options": {"loop": "python"}},
    "FMUs of Python": {"options": {"fmus": "python"}},
    "FMUs of Python, Python loop, another hash seed": {
        "options": {"fmus": "python", "loop": "python"},
        "hash_seed": "99",
    },
    "bare blocks": {"options": {"blocks": True}},
    "each FMU in a process of its own": {"options": {"isolate": "all"}},
}


def _case(target: str, options: Options, seed: int) -> Case:
    """A target prepared; with a seed, its components and connections in another order."""
    if not seed:
        return prepare(target, options)
    source, rng = read(target), np.random.default_rng(seed)
    draft = build(source, options)
    names = list(draft.components)
    rng.shuffle(names)
    draft.components = {n: draft.components[n] for n in names}
    rng.shuffle(draft.connections)
    return check_draft(draft, options, source)


def make(way: dict[str, Any]) -> dict[str, Any]:
    """A day: the sha256 of all that was recorded, how many values, and how long it
    took."""
    options = Options(**way.get("options", {}))
    if "stop" in way:
        options = replace(options, stop=way["stop"])
    target = way.get("of", TARGET)
    if way.get("packed"):
        target = str(pack_scenario(find(target)))
    digest, values, began = hashlib.sha256(), 0, time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        run = simulate(
            _case(target, options, way.get("permuted", 0)), Path(folder) / "run"
        )
        seconds = time.perf_counter() - began
        for name in ["", *sorted(run.results.names())]:
            series = run.results.values(name) if name else run.results.times()
            digest.update(
                name.encode() + b"\0" + np.ascontiguousarray(series).tobytes()
            )
            values += series.size
        steps, loop = run.manifest["steps_done"], run.manifest["loop"]["name"]
        run.results.close()
    return {
        "sha256": digest.hexdigest(),
        "values": values,
        "steps": steps,
        "loop": loop,
        "seconds": round(seconds, 1),
        "status": run.manifest["status"],
    }


def apart(way: dict[str, Any]) -> dict[str, Any]:
    """The same in a new process."""
    environment = {**os.environ, "PYTHONHASHSEED": way.get("hash_seed", "1")}
    command = [sys.executable, "-m", "benchmarks.same_bits", json.dumps(way)]
    spin = [sys.executable, "-c", "while True: pass"]
    neighbour = [subprocess.Popen(spin) for _ in range(2 if way.get("busy") else 0)]
    try:
        done = subprocess.run(
            command, env=environment, stdout=subprocess.PIPE, check=True
        )
    finally:
        for process in neighbour:
            process.kill()
            process.wait()
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def differing(
    ways: dict[str, dict[str, Any]], more: dict[str, Any], keep: bool = False
) -> list[str]:
    """The ways in which something differs; prints a line for each. `more` holds for all
    of them."""
    reference, found = apart(more), []
    print(f"{REFERENCE}: {reference}", flush=True)
    for name, way in ways.items():
        got = apart({**way, **more})
        keys = ("sha256", "values", "steps", "status")
        equal = all(got[k] == reference[k] for k in keys)
        found += [] if equal else [name]
        print(
            f"{'equal' if equal else 'DIFFERS'}: {name}: {got['values']} values in "
            f"{got['steps']} steps, {got['sha256'][:16]}, {got['loop']} loop, "
            f"{got['seconds']} s",
            flush=True,
        )
        if keep:
            of = f"{seen.OF}{more['of']}" if "of" in more else "same bits"
            seen.keep(of, name, {**got, "equal": equal})
    return found


def main() -> int:
    """All ways, or those that the command line names; a way as JSON is made here."""
    keep, arguments = seen.is_writing(), sys.argv[1:]
    if arguments and arguments[0].startswith("{"):
        print(json.dumps(make(json.loads(arguments[0]))))
        return 0
    more = {}
    if arguments[:1] == ["--of"]:
        more, arguments = {"of": arguments[1]}, arguments[2:]
    return int(bool(differing({n: WAYS[n] for n in arguments or WAYS}, more, keep)))


if __name__ == "__main__":
    sys.exit(main())
