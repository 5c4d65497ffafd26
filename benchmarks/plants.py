"""Two plants under given torques: ours and Basilisk's, error against the truth over CPU
time.

`kind` is a heavy, slow craft (`plant/reference`); `light` one of 3 kg m2 with 0.83 N m
s in its wheels and rates to 0.15 rad/s (`plant/light`), where a low order or a long
step shows. Basilisk runs by its RK4 and by its RKF78, at the step of its task; ours at
the master's step.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.environment_kepler import EnvironmentKepler
from desat.engine.loop import stepping
from desat.engine.master import Master
from desat.runs.run import Options, prepare
from desat.system.model import table

AUTHORITIES = Path(__file__).parent.parent / "tests" / "authorities"
SECONDS = 6000
GOAL = 1e-7
"""The attitude error (quaternion, largest over 6000 s) at which tools are compared."""
PLANTS = {
    "kind": ("plant/reference", "plant_reference_highprec.csv", 10, (1, 2, 3, 4)),
    "light": ("plant/light", "plant_light.csv", 100, (4, 1, 2, 3)),
}
"""Of each: scenario, its truth, the truth's interval (s), its columns of q0, q1, q2,
q3."""


def truth(plant: str) -> NDArray[np.float64]:
    """Rows of q (scalar last, body from eci) at the truth's interval."""
    _, file, _, (q0, q1, q2, q3) = PLANTS[plant]
    skip = int(plant == "kind")
    rows = np.loadtxt(AUTHORITIES / file, delimiter=",", skiprows=skip)
    return np.asarray(rows[:, [q1, q2, q3, q0]])


def error(plant: str, found: NDArray[np.float64]) -> float:
    """The largest difference of a quaternion's element from the truth's."""
    expected = truth(plant)[: len(found)]
    sign = np.sign((found * expected).sum(axis=1, keepdims=True))
    return float(np.abs(found - sign * expected).max())


def ours(plant: str, step: float) -> dict[str, Any]:
    """CPU seconds of stepping, all components as FMUs, and the error."""
    scenario, _, every, _ = PLANTS[plant]
    system, schedule = prepare(scenario, Options(step=step)).or_raise()
    rows, seconds = [], 0.0

    def attitude(component: str, signal: Any) -> bool:
        return component == "spacecraft" and bool(signal.name.startswith("q_bi"))

    with Master(system, schedule, watched=attitude) as master:
        master.initialise()
        index = sorted(
            s.index
            for s in master.slots
            if s.component == "spacecraft" and s.signal.name.startswith("q_bi")
        )
        rows.append(master.live["Real"][index].copy())
        stepper = stepping(master, None)
        for _ in range(SECONDS // every):
            until, began = master.k + round(every / step), time.process_time()
            while master.k < until:
                stepper.some(until - master.k)
            seconds += time.process_time() - began
            rows.append(master.live["Real"][index].copy())
    return {"seconds": seconds, "attitude_error": error(plant, np.array(rows))}


def description(plant: str) -> dict[str, Any]:
    """The plant as another tool needs it, from our scenario: SI units; `r0`, `v0` in
    eci, `q0` scalar last, body from eci, `speeds` of the rotors relative to the body,
    `torque` as bias + amplitude sin(2 pi t / period + phase), held for `hold`
    seconds."""
    system, _ = prepare(PLANTS[plant][0], Options(blocks=True)).or_raise()
    p = {
        component: {name: entry.value for name, entry in entries.items()}
        for component, entries in table(system.components.values()).items()
    }
    environment = EnvironmentKepler()
    for variable in environment.variables:
        if variable.causality == "parameter":
            value = p["environment"][variable.name]
            if variable.choices:
                value = variable.choices.index(value)
            setattr(
                environment, variable.name, tuple(value) if variable.shape else value
            )
    environment.start()
    environment.output(0.0)
    axes = np.reshape(p["wheels"]["axes_wheel"], (3, 4))
    omega = np.array(p["spacecraft"]["omega_start_body"])
    speeds = (
        np.array(p["wheels"]["h_start_wheel"]) / p["wheels"]["inertia_wheel"]
        - axes.T @ omega
    )
    manager = p["manager"]
    return {
        "mu": p["environment"]["mu"],
        "inertia": np.reshape(p["spacecraft"]["inertia"], (3, 3)).tolist(),
        "axes": axes.tolist(),
        "inertia_wheel": p["wheels"]["inertia_wheel"],
        "r0": environment.r_eci,
        "v0": environment.v_eci,
        "q0": p["spacecraft"]["q_start_bi"],
        "omega0": omega.tolist(),
        "speeds": speeds.tolist(),
        "torque": {k: manager[k] for k in ("bias", "amplitude", "period", "phase")},
        "hold": manager["sample_time"],
        "every": PLANTS[plant][2],
        "seconds": SECONDS,
    }


def basilisk(python: str, plant: str, step: float, integrator: str) -> list[str]:
    """The command that measures Basilisk; it prints seconds and rows of q for `judged`."""
    file = Path(tempfile.gettempdir()) / f"desat-bench-{plant}.json"
    file.write_text(json.dumps(description(plant)), encoding="utf-8")
    script = str(Path(__file__).parent / "basilisk_plant.py")
    return [python, script, str(file), str(step), integrator]


def judged(plant: str, measured: dict[str, Any]) -> dict[str, Any]:
    """Basilisk's answer with its error in place of its rows."""
    rows = np.array(measured["rows"])
    return {"seconds": measured["seconds"], "attitude_error": error(plant, rows)}


if __name__ == "__main__":
    print("RESULT " + json.dumps(ours(sys.argv[1], float(sys.argv[2]))), flush=True)
