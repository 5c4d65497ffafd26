"""100,000 cases of one orbit through the pool, and the first 20,000 of them through a
local Dask cluster of two workers, of which one is killed, and later the head: seconds,
memory, and whether the data are equal.

    python -m benchmarks.many_cases FOLDER [SECONDS]    # what is left of it, for so long at most
    python -m benchmarks.many_cases FOLDER write        # into latest.json

Each head is a `desat campaign` of its own, which goes on where the last one stopped.
"""

from __future__ import annotations

import json
import os
import signal
import statistics
import subprocess
import sys
import time
from datetime import date
from pathlib import Path
from typing import Any

NAME, ORBIT = "alsat1/basin-y-wheel", "6130"
HOWS = {"pool": ["--jobs", "2"], "dask": ["--cluster", "local:2"]}
CASES = {"pool": 100_000, "dask": 20_000}
KILL, KILL_HEAD = 6000, 12_000
"""Cases after which, through Dask, a worker and the head die by SIGKILL."""
_PATIENCE = 90.0
"""Seconds that a head has to end."""


def go_on(folder: Path, way: str, end: float) -> bool:
    """A head until it is done, killed or out of time; what was seen goes to HOW.json.
    True when all cases are there."""
    place, notes = folder / way, folder / f"{way}.json"
    seen: dict[str, Any] = (
        json.loads(notes.read_text())
        if notes.exists()
        else {"heads": [], "killed": [], "memory": []}
    )
    command = [
        sys.executable,
        "-m",
        "desat.cli",
        "campaign",
        NAME,
        "-n",
        str(CASES[way]),
        "--stop",
        ORBIT,
        *HOWS[way],
        "--out",
        str(place),
    ]
    head: dict[str, Any] = {"from": _done(place)[1]}
    began, load = time.monotonic(), [os.getloadavg()[0]]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as process:
        while process.poll() is None:
            time.sleep(2.0)
            load.append(os.getloadavg()[0])
            state, done = _done(place)
            workers = _workers(process.pid)
            if state == "done":
                head.setdefault("cases_seconds", time.monotonic() - began)
            elif workers and done > head["from"]:
                seen["memory"].append(
                    [done, _memory(process.pid), statistics.mean(map(_memory, workers))]
                )
            if way == "dask" and done >= KILL and not seen["killed"] and workers:
                seen["killed"].append({"worker": workers[-1], "at": done})
                os.kill(workers[-1], signal.SIGKILL)
            if way == "dask" and done >= KILL_HEAD > head["from"] and state != "done":
                head["killed_at"] = done
                process.kill()
                process.wait(_PATIENCE)
            elif time.monotonic() > end and state != "done":
                head["interrupted_at"] = done
                process.send_signal(signal.SIGINT)
                process.wait(_PATIENCE)
    head["seconds"], head["exit"] = time.monotonic() - began, process.returncode
    head["load"] = statistics.mean(load)
    state, head["to"] = _done(place)
    seen["heads"].append(head)
    notes.write_text(json.dumps(seen))
    print(way, head, flush=True)
    return state == "done"


def _done(place: Path) -> tuple[str, int]:
    path = place / "status.json"
    results: dict[str, Any] = {"state": "new", "done": 0}
    if path.exists():
        results = json.loads(path.read_text())
    return results["state"], results["done"]


def _workers(pid: int) -> list[int]:
    """The processes of a head that make cases."""
    processes = []
    for thread in Path(f"/proc/{pid}/task").glob("*/children"):
        try:
            children = [int(p) for p in thread.read_text().split()]
            processes += [
                p
                for p in children
                if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()
            ]
        except OSError:  # it has just ended
            continue
    return sorted(processes)


def _memory(pid: int) -> float:
    """Resident memory, MB; 0 of a process that is gone."""
    try:
        text = Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return 0.0
    return next(
        (int(x.split()[1]) / 1024 for x in text.splitlines() if x[:6] == "VmRSS:"), 0.0
    )


def judged(folder: Path) -> dict[str, Any]:
    """What came of both: equal or not, nothing lost, nothing twice, seconds, memory."""
    from desat.campaign import store
    from desat.campaign.cluster import SETTINGS

    result: dict[str, Any] = {
        "system": f"{NAME}, {ORBIT} s at 10 s",
        "date": str(date.today()),
    }
    for way, expected in CASES.items():
        seen = json.loads((folder / f"{way}.json").read_text())
        rows = store.read(
            folder / way, columns=["case", "status", "attempts", "seconds"]
        )
        cases, heads = rows["case"].to_pylist(), seen["heads"]
        seconds = sum(h.get("cases_seconds", h["seconds"]) for h in heads)
        files = [p for p in (folder / way).rglob("*.parquet") if p.is_file()]
        result[way] = {
            "cases": expected,
            "rows": len(cases),
            "each_case_once": cases == list(range(expected)),
            "completed": rows["status"].to_pylist().count("completed"),
            "made_again": sum(a > 1 for a in rows["attempts"].to_pylist()),
            "heads": len(heads),
            "workers_killed": len(seen["killed"]),
            "worker_killed_at": [x["at"] for x in seen["killed"]],
            "head_killed_at": [h["killed_at"] for h in heads if "killed_at" in h],
            "seconds": seconds,
            "cases_per_second": expected / seconds,
            "ms_per_case": 1e3 * statistics.median(rows["seconds"].to_pylist()),
            "report_seconds": heads[-1]["seconds"] - heads[-1]["cases_seconds"],
            "bytes_per_case": sum(p.stat().st_size for p in files) / expected,
            "load": [round(h["load"], 1) for h in heads if "load" in h],
            "memory_mb": _memory_over(seen["memory"], expected),
            "digest": store.digest(folder / way),
        }
    common = min(CASES.values())
    digests = {store.digest(folder / way, first=common) for way in HOWS}
    return result | {
        "common": common,
        "same_bits": len(digests) == 1,
        "profiled": SETTINGS["distributed.worker.profile.enabled"],
    }


def _memory_over(samples: list[list[float]], cases: int) -> list[dict[str, float]]:
    """Of each tenth of the cases: the largest of head and worker."""
    largest = []
    for i in range(10):
        low, high = i * cases / 10, (i + 1) * cases / 10
        part = [s for s in samples if low < s[0] <= high]
        if part:
            largest.append(
                {
                    "cases": high,
                    "head": round(max(s[1] for s in part), 1),
                    "worker": round(max(s[2] for s in part), 1),
                }
            )
    return largest


def main() -> int:
    """Go on, or write."""
    folder, subject = Path(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "inf"
    # a shell has its jobs in the background ignore it, and the heads would do so, too
    signal.signal(signal.SIGINT, signal.default_int_handler)
    folder.mkdir(parents=True, exist_ok=True)
    if subject == "write":
        from .run import LATEST

        data = json.loads(LATEST.read_text())
        data["many_cases"] = judged(folder)
        LATEST.write_text(json.dumps(data, indent=1) + "\n", encoding="utf-8")
        print(json.dumps(data["many_cases"], indent=1))
        return 0
    end = time.monotonic() + float(subject)
    for way in HOWS:
        while _done(folder / way)[0] != "done":
            if time.monotonic() > end:
                return 1
            go_on(folder, way, end)
    return 0


if __name__ == "__main__":
    sys.exit(main())
