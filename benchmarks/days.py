"""The 24 h of `nadir_day/day-dipole` as a tool beside ours needs it."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from desat.study.case import Options, execute

SCENARIO = "nadir_day/day-dipole"
SIGNALS = (
    "spacecraft.q_bi", "spacecraft.omega_bi_body", "environment.r_eci", "environment.v_eci",
    "environment.sun_eci", "environment.density",
)  # fmt: skip


def description() -> dict[str, Any]:
    """Parameters and start values, SI; `q0` scalar last, body from eci, `sun` a unit vector,
    `dipole` the moment (T m3), `speeds` of the rotors relative to the body."""
    run = execute(SCENARIO, Options(stop=2.0, blocks=True, record=SIGNALS)).or_raise(SCENARIO)
    q, omega, r, v, sun, density = (run.results.values(s)[0].tolist() for s in SIGNALS)
    given = {
        component: {name: entry["value"] for name, entry in entries.items()}
        for component, entries in run.manifest["parameters"].items()
    }
    wheels, craft = given["wheels"], given["spacecraft"]
    axes = np.reshape(wheels["axes_wheel"], (3, 4))
    spin = np.array(wheels["inertia_wheel"])
    return {
        "inertia": np.reshape(craft["inertia"], (3, 3)).tolist(),
        "mu": given["environment"]["mu"],
        "dipole": given["environment"]["dipole_earth"],
        "r0": r, "v0": v, "q0": q, "omega0": omega, "sun": sun, "density": density,
        "axes": axes.tolist(),
        "inertia_wheel": spin.tolist(),
        "speeds": (np.array(wheels["h_start_wheel"]) / spin - axes.T @ omega).tolist(),
        **{k: wheels[k] for k in ("torque_limit", "viscous", "coulomb")},
    }  # fmt: skip


def basilisk(python: str, seconds: float, out: str = "") -> list[str]:
    """The command that flies so many seconds of the day in Basilisk."""
    file = Path(tempfile.gettempdir()) / "desat-bench-day.json"
    file.write_text(json.dumps(description()), encoding="utf-8")
    script = str(Path(__file__).parent / "basilisk_day.py")
    return [python, script, str(file), str(seconds), *([out] if out else [])]
