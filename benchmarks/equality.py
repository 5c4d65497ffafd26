"""Native FMUs in the compiled loop and Python FMUs in the Python loop: every output of
every scenario over its first 600 steps, are they the same bits?

`python -m benchmarks.equality [--seconds S] [FAMILY ...]` (default: all families) flies
those scenarios that have no row of today in `equality.json`, those that have none at
all first, and writes `docs/equality.md`. After S seconds it stops; called again it goes
on. It ends with 1 where something differs.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

import numpy as np

from desat.engine.ending import NEVER
from desat.engine.instances.base import ComponentError
from desat.engine.loop import run, stepping
from desat.engine.master import Master
from desat.engine.recording.recorder import Recorder
from desat.files.scenario import families, scenarios
from desat.runs.run import Options, prepare
from desat.system.choices import Loop

STEPS = 600
STORE = Path(__file__).with_name("equality.json")
PAGE = Path(__file__).parents[1] / "docs" / "equality.md"


def fly(scenario: str, fmus: Literal["native", "python"], loop: Loop) -> dict[str, Any]:
    """The first steps of a scenario: the sha256 of each output, how many values, the
    loop, and how it failed where it did."""
    system, schedule = prepare(scenario, Options(fmus=fmus)).or_raise()
    failed, steps = "", min(STEPS, system.steps)
    with Master(system, schedule) as master:
        master.initialise()
        recorder = Recorder(None, master)
        stepper = stepping(master, recorder, NEVER, loop)
        try:
            run(master, stepper, steps, recorder)
        except ComponentError as error:
            failed = str(error)
        done = master.k
        with recorder.finish(master) as results:
            series = {
                n: np.ascontiguousarray(results.values(n)) for n in results.names()
            }
    return {
        "series": {
            n: hashlib.sha256(v.tobytes()).hexdigest() for n, v in series.items()
        },
        "values": sum(v.size for v in series.values()),
        "steps": done,
        "loop": stepper.name,
        "failed": failed,
    }


def compared(scenario: str) -> dict[str, Any]:
    """A scenario flown both ways: what differs, and how much was compared."""
    native, python = (
        fly(scenario, "native", "compiled"),
        fly(scenario, "python", "python"),
    )
    names = native["series"].keys() | python["series"].keys()
    different = [n for n in names if native["series"].get(n) != python["series"].get(n)]
    different += [k for k in ("values", "steps", "failed") if native[k] != python[k]]
    return {
        "date": datetime.now(UTC).date().isoformat(),
        "series": len(names),
        "values": native["values"],
        "steps": native["steps"],
        "loop": native["loop"],
        "failed": native["failed"],
        "different": sorted(different),
    }


def page(store: dict[str, dict[str, Any]]) -> str:
    """What is stored, as a page."""
    lines = [
        "# Native and Python FMUs: the same bits?",
        "",
        f"Each scenario's first {STEPS} steps (or all it has) by native FMUs in the compiled loop",
        "and by Python FMUs in the Python loop; all outputs of all components are compared at each",
        "step. Written by `python -m benchmarks.equality`.",
        "",
        f"{len(store)} of {sum(len(scenarios(f)) for f in families())} scenarios are flown.",
        "",
        "| family | scenarios | of these in the compiled loop | series | values | differ | run |",
        "|---|---|---|---|---|---|---|",
    ]
    total: Counter[str] = Counter()
    for family in families():
        rows = {n: r for n, r in store.items() if n.split("/")[0] == family}
        if not rows:
            continue
        sums = Counter(
            scenarios=len(rows),
            compiled=sum(r["loop"] == "compiled" for r in rows.values()),
            series=sum(r["series"] for r in rows.values()),
            values=sum(r["values"] for r in rows.values()),
            differ=sum(bool(r["different"]) for r in rows.values()),
        )
        total += sums
        dates = sorted({r["date"] for r in rows.values()})
        lines.append(
            _row(f"`{family}`", sums, " to ".join(dict.fromkeys((dates[0], dates[-1]))))
        )
    lines += [_row("all", total, ""), ""]
    lines += [
        f"`{n}` differs in {', '.join(r['different'])}."
        for n, r in store.items()
        if r["different"]
    ]
    lines += [
        f"`{n}` ends at step {r['steps']} both ways: {r['failed'].splitlines()[0]}"
        for n, r in store.items()
        if r["failed"] and not r["different"]
    ]
    return "\n".join(lines).rstrip() + "\n"


def _row(name: str, sums: Counter[str], date: str) -> str:
    cells = (
        f"{sums[k]:,}" for k in ("scenarios", "compiled", "series", "values", "differ")
    )
    return f"| {name} | {' | '.join(cells)} | {date} |"


def main() -> int:
    """Fly what is asked for, and store it after each scenario."""
    parser = argparse.ArgumentParser(prog="benchmarks.equality")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    parser.add_argument("family", nargs="*")
    arguments = parser.parse_args()
    store = json.loads(STORE.read_text()) if STORE.exists() else {}
    began, today = time.monotonic(), datetime.now(UTC).date().isoformat()
    names = [s for f in arguments.family or families() for s in scenarios(f)]
    every = {s for f in families() for s in scenarios(f)}
    store = {name: row for name, row in store.items() if name in every}
    remaining = [n for n in names if store.get(n, {}).get("date") != today]
    remaining.sort(key=lambda name: name in store)
    for name in remaining:
        if time.monotonic() - began > arguments.seconds:
            break
        store[name] = compared(name)
        lines = (f"{json.dumps(n)}: {json.dumps(r)}" for n, r in sorted(store.items()))
        STORE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
        if store[name]["different"]:
            print(f"{name}: {', '.join(store[name]['different'])} differ", flush=True)
    PAGE.write_text(page(store), encoding="utf-8")
    done = sum(store.get(n, {}).get("date") == today for n in names)
    print(f"{done} of {len(names)} scenarios flown today")
    return int(any(store[n]["different"] for n in names if n in store))


if __name__ == "__main__":
    sys.exit(main())
