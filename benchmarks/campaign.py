"""Cases a second of a campaign: through the pool and through Dask, on one and two
cores; what of that is no case; memory and bytes; and Basilisk's own Monte Carlo on the
same kind of day.

    python -m benchmarks.campaign FOLDER CASES pool:N|local:N SECONDS [NAME]  # one, in its process
    python -m benchmarks.campaign split CASES SECONDS NAME                    # where its time goes
"""

from __future__ import annotations

import json
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from desat.engine.process_state import one_thread

NAME, ORBIT = "nadir_day/day-dipole", 5740.0
"""An orbit of the day that `basilisk_day.py` flies too, at 1 s."""
DAY = 86400.0
CASES = 50
MANY, DAYS = 500, 4
ROUNDS = 2
MORE, FEWER = 220, 20
"""What a case costs beside the start: these cases less those."""
EMPTY = 2020
"""As MORE, through Dask, of the shortest cases: what its head takes for each."""
KINDS = {
    "an orbit": (NAME, ORBIT),
    "613 steps": ("alsat1/basin-y-wheel", 6130.0),
    "a day": (NAME, DAY),
}
BASILISK = Path(__file__).parent.parent / ".venv-basilisk" / "bin" / "python"


def one(
    folder: str, cases: str, way: str, stop: str, name: str = NAME
) -> dict[str, Any]:
    """A campaign of cases until `stop` (s): wall seconds, those within cases, the
    head's own CPU and that of all, and peaks of memory (MB)."""
    from desat.campaign import coordinator, store
    from desat.system.options import Options

    place, kind, size = Path(folder), *way.split(":")
    plan, _ = coordinator.planned(
        name, int(cases), options=Options(stop=float(stop)), curves=()
    )
    began, cpu = time.perf_counter(), time.process_time()
    cluster = way if kind == "local" else None
    coordinator.run(plan, place, int(size), cluster, progress=False)
    seconds, cpu = time.perf_counter() - began, time.process_time() - cpu
    rows = store.read(place)
    own_value = [s for s in rows["seconds"].to_pylist() if s is not None]
    files = [p for p in place.rglob("*") if p.is_file()]
    scopes = {"head": resource.RUSAGE_SELF, "worker": resource.RUSAGE_CHILDREN}
    peak = {
        name: resource.getrusage(subject).ru_maxrss / 1024.0
        for name, subject in scopes.items()
    }
    used = [resource.getrusage(subject) for subject in scopes.values()]
    return {
        "cases": int(cases),
        "completed": len(own_value),
        "cpu_seconds": sum(x.ru_utime + x.ru_stime for x in used),
        "seconds": seconds,
        "in_cases": sum(own_value),
        "least": min(own_value),
        "head_ms_per_case": 1e3 * cpu / int(cases),
        "head_mb": peak["head"],
        "worker_mb": peak["worker"],
        "bytes_per_case": sum(p.stat().st_size for p in files) / int(cases),
        "digest": store.digest(place),
    }


def measure() -> dict[str, Any]:
    """In turn, medians over ROUNDS; start-up is in all of them."""
    hows = ["pool:1", "pool:2", "local:1", "local:2"]
    found: dict[str, list[dict[str, Any]]] = {way: [] for way in hows}
    basilisk: dict[int, list[float]] = {1: [], 2: []}
    with TemporaryDirectory() as folder:
        for i in range(ROUNDS):
            for way in hows:
                found[way].append(_run(folder, f"{i}-{way}", CASES, way))
            for processes in basilisk if BASILISK.exists() else ():
                basilisk[processes].append(_basilisk(CASES, processes))
        many = {
            name: _run(folder, name, MANY, way)
            for name, way in {"many": "pool:2", "many_dask": "local:2"}.items()
        }
        day = _run(folder, "day", DAYS, "pool:1", DAY)
        marginal = {kind: _marginal(folder, kind) for kind in KINDS}
        split = {kind: _split(kind) for kind in KINDS}
        dask = _marginal(folder, "613 steps", "local:2", EMPTY)
        many_basilisk = _basilisk(MANY, 2) if BASILISK.exists() else None
    digests = {r["digest"] for rows in found.values() for r in rows}
    few = {way: _median(rows) for way, rows in found.items()}
    for way, entry in few.items():
        size = int(way.partition(":")[2])
        entry["cases_per_second"] = CASES / entry["seconds"]
        entry["ms_per_case_beside_it"] = (
            1e3 * (size * entry["seconds"] - entry["in_cases"]) / CASES
        )
    return {
        "system": f"{NAME}, {ORBIT:g} s at 1 s",
        "cases": CASES,
        "same_bits": len(digests) == 1,
        **few,
        **{n: {**m, "cases_per_second": MANY / m["seconds"]} for n, m in many.items()},
        "day": day,
        "marginal": marginal,
        "split": split,
        "head_dask_ms": dask["head_ms"],
        "date": str(date.today()),
        "basilisk": {
            f"processes:{n}": {"cases_per_second": CASES / statistics.median(seconds)}
            for n, seconds in basilisk.items()
            if seconds
        }
        | (
            {"many": {"cases": MANY, "cases_per_second": MANY / many_basilisk}}
            if many_basilisk
            else {}
        ),
    }


def _basilisk(cases: int, processes: int) -> float:
    """The seconds of Basilisk's own Monte Carlo."""
    script = Path(__file__).with_name("basilisk_campaign.py")
    command = [str(BASILISK), str(script), str(cases), str(processes), f"{ORBIT:.0f}"]
    return float(_result(command)["seconds"])


def _split(kind: str) -> dict[str, float]:
    name, stop = KINDS[kind]
    cases = "20" if stop == DAY else "100"
    with one_thread():
        return _result(
            [
                sys.executable,
                "-m",
                "benchmarks.campaign",
                "split",
                cases,
                str(stop),
                name,
            ]
        )


def split(cases: str, stop: str, name: str) -> dict[str, float]:
    """CPU of a case in its worker (ms): its steps, its numbers and verdicts, and all
    else."""
    from desat.campaign import case, coordinator
    from desat.engine.compiled import CompiledSteps
    from desat.runs import run
    from desat.system.options import Options

    spent = {"steps": 0.0, "numbers": 0.0}

    def clocked(fault: str, call: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*inputs: Any) -> Any:
            began = time.process_time()
            try:
                return call(*inputs)
            finally:
                spent[fault] += time.process_time() - began

        return timed

    plan, _ = coordinator.planned(
        name, 1000, options=Options(stop=float(stop)), curves=()
    )
    for i in range(3):
        case.row(plan, i)
    CompiledSteps.some = clocked("steps", CompiledSteps.some)  # type: ignore[method-assign]
    run._measure = clocked("numbers", run._measure)
    began = time.process_time()
    for i in range(3, 3 + int(cases)):
        case.row(plan, i)
    full = time.process_time() - began
    ms = {fault: 1e3 * seconds / int(cases) for fault, seconds in spent.items()}
    return {**ms, "rest": 1e3 * full / int(cases) - sum(ms.values())}


def _marginal(
    folder: str, kind: str, way: str = "pool:1", most: int = MORE
) -> dict[str, float]:
    """CPU of a case (ms), start-up left out: of all, and of the head. Least of ROUNDS."""
    name, stop = KINDS[kind]
    rounds = []
    for i in range(ROUNDS):
        fewer, more = (
            _run(folder, f"{kind}-{way}-{i}-{n}".replace(" ", "-"), n, way, stop, name)
            for n in (FEWER, most)
        )
        head = [x["head_ms_per_case"] * x["cases"] for x in (fewer, more)]
        cpu = more["cpu_seconds"] - fewer["cpu_seconds"]
        rounds.append(
            (1e3 * cpu / (most - FEWER), (head[1] - head[0]) / (most - FEWER))
        )
    return {"ms": min(x for x, _ in rounds), "head_ms": min(x for _, x in rounds)}


def _median(rows: list[dict[str, Any]]) -> dict[str, Any]:
    keys = [k for k, v in rows[0].items() if isinstance(v, (int, float))]
    return {k: statistics.median(r[k] for r in rows) for k in keys}


def _run(
    folder: str,
    name: str,
    cases: int,
    way: str,
    stop: float = ORBIT,
    system: str = NAME,
) -> dict[str, Any]:
    place = str(Path(folder) / name.replace(":", "-"))
    arguments = place, str(cases), way, str(stop), system
    return _result([sys.executable, "-m", "benchmarks.campaign", *arguments])


def _result(command: list[str]) -> dict[str, Any]:
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    (line,) = [x for x in done.stdout.splitlines() if x.startswith("RESULT ")]
    result: dict[str, Any] = json.loads(line.removeprefix("RESULT "))
    return result


def main(values: list[str]) -> None:
    """A campaign, or where its time goes."""
    result = split(*values[1:]) if values[0] == "split" else one(*values)
    print("RESULT " + json.dumps(result), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
