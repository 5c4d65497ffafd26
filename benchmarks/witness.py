"""`make witness`: the closed loops of `nadir_day/witness-*` beside Basilisk's dynamics.

Each flies in Basilisk (`basilisk_loop.py`) with five steps, each half of the one before; what they
tend to is extrapolated (Romberg's scheme for all orders: the field held over a step makes an error
of first order). How far it moves without the longest or without the shortest step is taken for the
error of Basilisk's trajectory. Trajectories go to tests/authorities/witness.npz, which the tests hold ours against,
differences and errors to witness.json beside it and to docs/witness.md. Where there are stored ones
already, how far the new ones are from them is printed; `--write` is needed to replace them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import desat
from desat.components.physics.orbit import MU
from desat.runs.run import Run

Array = NDArray[np.float64]

HERE = Path(__file__).parent
BASILISK = HERE.parent / ".venv-basilisk" / "bin" / "python"
STORED = HERE.parent / "tests" / "authorities" / "witness.npz"
TOLD = STORED.with_suffix(".json")
CASES = {"light": 1, "orbit": 20, "coils-off": 1, "friction": 10, "tumbling": 10, "heavy-wheels": 10}
"""Cases and every how many seconds a row is kept."""
STEPS = (0.1, 0.05, 0.025, 0.0125, 0.00625)
INNER = (1, 8, 64)
SERIES = {"q_bi": "spacecraft.q_bi", "omega": "spacecraft.omega_bi_body", "h": "wheels.h_wheel"}


def case_of(run: Run, every: int) -> dict[str, Any]:
    """What Basilisk is told of a run: its parameters and its start."""
    of = {c: run.manifest.values_of(c) for c in
          ("environment", "spacecraft", "wheels", "controller", "manager")}  # fmt: skip
    orbit, craft, control = of["environment"], of["spacecraft"], of["controller"]
    start = {name: run.results.values(series)[0].tolist() for name, series in SERIES.items()}
    return {
        "every": every, "stop": float(run.manifest.stop), "mu": MU,
        **{k: orbit[k] for k in ("semi_major_axis", "inclination", "raan", "earth_rate",
                                 "dipole_earth")},
        "earth_angle": orbit["earth_angle_start"],
        "inertia": np.reshape(craft["inertia"], (3, 3)).tolist(),
        "axes_wheel": np.reshape(craft["axes_wheel"], (3, 4)).tolist(),
        "inertia_wheel": craft["inertia_wheel"],
        "q_bi": start["q_bi"], "omega": start["omega"], "h_wheel": start["h"],
        **{k: of["wheels"][k] for k in ("viscous", "coulomb")},
        **{k: control[k] for k in ("kp", "kd", "ki")},
        **{k: of["manager"][k] for k in ("gain", "m_limit")},
    }  # fmt: skip


def flown(case: dict[str, Any]) -> list[dict[str, Array]]:
    """The trajectories of Basilisk, a step each."""
    with tempfile.TemporaryDirectory() as folder:
        told = Path(folder) / "case.json"
        told.write_text(json.dumps(case), encoding="utf-8")

        def fly(step: float) -> dict[str, Array]:
            file = Path(folder) / f"{step}.npz"
            command = [str(BASILISK), str(HERE / "basilisk_loop.py"), str(told), str(step), str(file)]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{' '.join(command)}: {done.stderr[-2000:]}")
            with np.load(file) as rows:
                return {k: rows[k] for k in ("t", *SERIES)}

        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(fly, STEPS))


def aligned(q: Array, to: Array) -> Array:
    """The same attitudes, each quaternion with the sign that is nearer to another's."""
    return q * np.where((q * to).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)


def extrapolated(rows: list[Array]) -> Array:
    """What values at halved steps tend to, by Romberg's scheme."""
    for order in range(1, len(rows)):
        weight = 2.0**order
        rows = [(weight * b - a) / (weight - 1.0) for a, b in pairwise(rows)]
    return rows[0]


def apart(a: Mapping[str, Array], b: Mapping[str, Array]) -> dict[str, float]:
    """The largest differences: attitude (rad), rate (rad/s), momentum of a wheel (N m s)."""
    attitude = 2.0 * np.linalg.norm(a["q_bi"] - aligned(b["q_bi"], a["q_bi"]), axis=1).max()
    return {
        "attitude": float(attitude),
        "rate": float(np.abs(a["omega"] - b["omega"]).max()),
        "momentum": float(np.abs(a["h"] - b["h"]).max()),
    }


def ours(name: str, inner: int | None, every: int) -> dict[str, Array]:
    """The same rows of a run of ours."""
    run = desat.run(f"nadir_day/witness-{name}", inner=inner)
    return {key: run.results.values(series)[::every] for key, series in SERIES.items()}


def measured(name: str, every: int) -> tuple[dict[str, Array], dict[str, Any]]:
    """Basilisk's trajectory of a case, and what is told of it."""
    run = desat.run(f"nadir_day/witness-{name}")
    case = case_of(run, every)
    began = time.perf_counter()
    flights = flown(case)
    seconds = time.perf_counter() - began
    for flight in flights:
        flight["q_bi"] = aligned(flight["q_bi"], flights[-1]["q_bi"])
    best, coarse, fine = (
        {series: extrapolated([f[series] for f in some]) for series in SERIES}
        for some in (flights, flights[:-1], flights[1:])
    )
    errors = apart(best, coarse), apart(best, fine)
    return best, {
        "stop": case["stop"], "every": every, "seconds": round(seconds, 1),
        "basilisk": {str(step): apart(best, f) for step, f in zip(STEPS, flights, strict=True)},
        "error": {k: max(e[k] for e in errors) for k in errors[0]},
        "desat": {str(inner): apart(best, ours(name, inner, every)) for inner in INNER},
    }  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", default=list(CASES), help=", ".join(CASES))
    parser.add_argument("--write", action="store_true", help="replace what is stored")
    given = parser.parse_args()
    for name in given.cases:
        best, told = measured(name, CASES[name])
        print(name, json.dumps(told, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
