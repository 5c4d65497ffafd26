"""`make witness`: the closed loops of `nadir_day/witness-*` beside Basilisk's dynamics.

Each flies in Basilisk (`basilisk_loop.py`) with five steps, each half of the one
before; what they tend to is extrapolated (Romberg's scheme for all orders: the field
held over a step makes an error of first order). How far it moves without the longest or
without the shortest step is taken for the error of Basilisk's trajectory. Trajectories
go to tests/authorities/witness.npz, which the tests hold ours against, differences and
errors to witness.json beside it and to docs/witness.md. Where there are stored ones
already, how far the new ones are from them is printed; `--write` replaces them.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.progress import track

import desat
from benchmarks.orbit_forces import of_a_day
from desat.components.physics.orbit import MU
from desat.figures.canvas import Figure
from desat.figures.style import COLOURS
from desat.numbers.derived import pointing
from desat.runs.run import Run

Array = NDArray[np.float64]

HERE = Path(__file__).parent
BASILISK = HERE.parent / ".venv-basilisk" / "bin" / "python"
STORED = HERE.parent / "tests" / "authorities" / "witness.npz"
STORED_SUMMARY = STORED.with_suffix(".json")
DOCS = HERE.parent / "docs" / "witness.md"
LAWS = "laws"
CASES = {
    "light": 1,
    "orbit": 20,
    "coils-off": 1,
    "friction": 10,
    "tumbling": 10,
    "heavy-wheels": 10,
    LAWS: 20,
}
"""Cases and every how many seconds a row is kept."""
STEPS = (0.1, 0.05, 0.025, 0.0125, 0.00625)
INNER = (1, 8, 64)
TERMS = {
    "mrp": "the attitude error: Basilisk's is the MRP, tan of a quarter of the angle, ours the "
    "sine of its half",
    "gyroscopic": "the gyroscopic torque: omega_r x (J omega + A h) - J (omega x omega_r), ours "
    "omega x A h",
    "null_space": "Basilisk's manager drives the wheels' null space to nothing, ours leaves it "
    "where `null_gain` is 0",
    "relative": "the momentum to dump: J_s Omega, ours J_s (Omega + g . omega)",
}
ORBITS = (550e3, 1.7033), (650e3, 1.7100), (400e3, 0.9006)
"""Altitude (m) and inclination (rad)."""
SERIES = {
    "q_bi": "spacecraft.q_bi",
    "omega": "spacecraft.omega_bi_body",
    "h": "wheels.h_wheel",
}


def case_of(run: Run, every: int) -> dict[str, Any]:
    """What Basilisk is told of a run: its parameters and its start."""
    of = {
        c: run.manifest.values_of(c)
        for c in ("environment", "spacecraft", "wheels", "controller", "manager")
    }
    orbit, craft, control = of["environment"], of["spacecraft"], of["controller"]
    start = {
        name: run.results.values(series)[0].tolist() for name, series in SERIES.items()
    }
    return {
        "every": every,
        "stop": float(run.manifest.stop),
        "mu": MU,
        **{
            k: orbit[k]
            for k in (
                "semi_major_axis",
                "inclination",
                "raan",
                "earth_rate",
                "dipole_earth",
            )
        },
        "earth_angle": orbit["earth_angle_start"],
        "inertia": np.reshape(craft["inertia"], (3, 3)).tolist(),
        "axes_wheel": np.reshape(craft["axes_wheel"], (3, 4)).tolist(),
        "inertia_wheel": craft["inertia_wheel"],
        "q_bi": start["q_bi"],
        "omega": start["omega"],
        "h_wheel": start["h"],
        **{k: of["wheels"][k] for k in ("viscous", "coulomb")},
        **{k: control[k] for k in ("kp", "kd", "ki")},
        "gain_matrix": np.reshape(control["gain_matrix"], (3, 3)).tolist(),
        "laws": [],
        "late": False,
        **{k: of["manager"][k] for k in ("gain", "m_limit")},
    }


def fly_basilisk(
    case: dict[str, Any], steps: Sequence[float] = STEPS
) -> list[dict[str, Array]]:
    """The trajectories of Basilisk, a step each."""
    with tempfile.TemporaryDirectory() as folder:
        case_file = Path(folder) / "case.json"
        case_file.write_text(json.dumps(case), encoding="utf-8")

        def fly(step: float) -> dict[str, Array]:
            file = Path(folder) / f"{step}.npz"
            command = [
                str(BASILISK),
                str(HERE / "basilisk_loop.py"),
                str(case_file),
                str(step),
                str(file),
            ]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{' '.join(command)}: {done.stderr[-2000:]}")
            with np.load(file) as rows:
                return {k: rows[k] for k in ("t", *SERIES)}

        with ThreadPoolExecutor(2) as pool:
            return list(pool.map(fly, steps))


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
    """The largest differences: attitude (rad), rate (rad/s), momentum of a wheel (N m
    s)."""
    attitude = (
        2.0 * np.linalg.norm(a["q_bi"] - aligned(b["q_bi"], a["q_bi"]), axis=1).max()
    )
    return {
        "attitude": float(attitude),
        "rate": float(np.abs(a["omega"] - b["omega"]).max()),
        "momentum": float(np.abs(a["h"] - b["h"]).max()),
    }


def ours(name: str, substeps: int | None, every: int) -> dict[str, Array]:
    """The same rows of a run of ours."""
    run = desat.run(f"nadir_day/witness-{name}", substeps=substeps)
    return {key: run.results.values(series)[::every] for key, series in SERIES.items()}


def measured(name: str, every: int) -> tuple[dict[str, Array], dict[str, Any]]:
    """Basilisk's trajectory of a case, and what is told of it."""
    run = desat.run(f"nadir_day/witness-{name}")
    case = case_of(run, every)
    began = time.perf_counter()
    flights = fly_basilisk(case)
    seconds = time.perf_counter() - began
    for flight in flights:
        flight["q_bi"] = aligned(flight["q_bi"], flights[-1]["q_bi"])
    best, coarse, fine = (
        {series: extrapolated([f[series] for f in some]) for series in SERIES}
        for some in (flights, flights[:-1], flights[1:])
    )
    errors = apart(best, coarse), apart(best, fine)
    return best, {
        "stop": case["stop"],
        "every": every,
        "seconds": round(seconds, 1),
        "basilisk": {
            str(step): apart(best, f) for step, f in zip(STEPS, flights, strict=True)
        },
        "error": {k: max(e[k] for e in errors) for k in errors[0]},
        "desat": {
            str(substeps): apart(best, ours(name, substeps, every))
            for substeps in INNER
        },
    }


def laws() -> tuple[dict[str, Array], dict[str, Any]]:
    """The trajectories of our laws and of Basilisk's own in Basilisk's dynamics, and
    what of their difference each term makes."""
    run = desat.run(f"nadir_day/witness-{LAWS}")
    every = CASES[LAWS]
    case = case_of(run, every)

    def fly(**other: Any) -> dict[str, Array]:
        return fly_basilisk(case | other, STEPS[:1])[0]

    mine, theirs = fly(), fly(laws="modules")
    recorded_series = {f"{LAWS}.{key}": theirs[key] for key in SERIES}
    return recorded_series, {
        "stop": case["stop"],
        "every": every,
        "step": STEPS[0],
        "equations": apart(
            mine, {k: run.results.values(s)[::every] for k, s in SERIES.items()}
        ),
        "modules": apart(mine, theirs),
        "all_terms": apart(theirs, fly(laws=list(TERMS))),
        "without": {
            term: apart(theirs, fly(laws=[x for x in TERMS if x != term]))
            for term in TERMS
        },
    }


def late() -> dict[str, float]:
    """How far the light craft goes astray with the effectors behind the spacecraft."""
    run = desat.run("nadir_day/witness-light")
    case = case_of(run, 1)
    (orderly,), (late,) = (
        fly_basilisk(case, STEPS[:1]),
        fly_basilisk(case | {"late": True}, STEPS[:1]),
    )
    return apart(orderly, late)


def drawn(recorded_series: Mapping[str, Array]) -> str:
    """Angle to the wanted attitude and wheels' momentum by our laws and by Basilisk's."""
    run = desat.run(f"nadir_day/witness-{LAWS}")
    every = CASES[LAWS]
    reference_attitude = run.results.values("guidance.q_ref_bi")[::every]
    mine = {k: run.results.values(s)[::every] for k, s in SERIES.items()}
    theirs = {k: recorded_series[f"{LAWS}.{k}"] for k in SERIES}
    minutes = run.results.times()[::every] / 60.0
    flights = (
        (mine, COLOURS[0], "desat", ()),
        (theirs, COLOURS[1], "Basilisk", (4.0, 3.0)),
    )
    fig = Figure(9.0, 3.0)
    for i, label in enumerate(
        ("pointing error [deg]", "momentum of each wheel [mN m s]")
    ):
        ax = fig.add(left=0.07 + 0.44 * i, right=0.57 - 0.44 * i, top=0.06, bottom=0.17)
        ax.x.label, ax.y.label, ax.y.log = "time [min]", label, i == 0
        for flight, colour, program, dash in flights:
            y = (
                1e3 * flight["h"]
                if i
                else pointing(
                    flight["q_bi"][: len(reference_attitude)], reference_attitude
                )[:, None]
            )
            for k, column in enumerate(y.T):
                ax.plot(
                    minutes[: len(column)],
                    column,
                    colour,
                    label=program if i and not k else "",
                    dash=dash,
                )
    return fig.svg()


def page(summary: Mapping[str, Any]) -> str:
    """docs/witness.md of what is stored."""
    about, laws, orbit = summary["about"], summary["laws"], summary["orbits"]
    exact = [
        f"| `{name}` | {c['stop']:g} s | "
        + " | ".join(
            f"{c['desat'][str(n)]['attitude']:.1e}, {c['desat'][str(n)]['momentum']:.1e}"
            for n in INNER
        )
        + f" | {c['error']['attitude']:.1e}, {c['error']['momentum']:.1e}"
        f" | {c['basilisk'][str(STEPS[0])]['attitude']:.1e} |"
        for name, c in summary["cases"].items()
    ]
    terms = [
        f"| {text} | {remaining_error['attitude']:.1e} | {remaining_error['momentum']:.1e} |"
        for text, remaining_error in (
            (text, laws["without"][term]) for term, text in TERMS.items()
        )
    ]
    orbits = [
        f"| {o['altitude'] / 1e3:.0f} km, {np.degrees(o['inclination']):.1f} deg | "
        + " | ".join(
            f"{o['distance'][f]:,.0f}" for f in ("tesserals", "sun", "moon", "all")
        )
        + f" | {1e9 * o['field']:.0f} nT, {100 * o['field_share']:.2f} % "
        f"| {np.degrees(o['nadir']):.3f} "
        f"| {o['by_node'][0] / 1e3:.1f} to {o['by_node'][1] / 1e3:.1f} km |"
        for o in orbit
    ]
    most = max(c["desat"]["64"]["attitude"] for c in summary["cases"].values())
    return PAGE.format(
        date=about["date"],
        basilisk=about["basilisk"],
        desat=about["desat"],
        most=most,
        steps=", ".join(map(str, STEPS)),
        exact="\n".join(exact),
        late=summary["late"]["attitude"],
        late_step=STEPS[0],
        modules=laws["modules"],
        all_terms=laws["all_terms"],
        equations=laws["equations"],
        terms="\n".join(terms),
        laws_step=laws["step"],
        orbits="\n".join(orbits),
    )


PAGE = """# Independent verification against Basilisk

The closed loop of this project (attitude, wheels, coils, field, gravity gradient, a PID controller
and a cross-product law at 1 s) in [Basilisk](https://hanspeterschaub.info/basilisk/)'s own modules
of dynamics agrees with `desat run` to **{most:.1e} rad** in the worst of six cases; in each that is
less than what Basilisk's own answer is known to. `benchmarks/basilisk_loop.py` is the loop,
`make witness` flies it again and compares, `tests/benchmarks/test_witness.py` holds ours against the stored
trajectories. Made on {date} with bsk {basilisk} and desat {desat}.

## The same equations

Controller and manager are written anew in numpy for it; everything else is Basilisk's: spacecraft,
wheels with friction, point-mass gravity, gravity gradient, centred dipole, torque bars. Its RK4
flies with steps of {steps} s; what they tend to is extrapolated. Largest differences from that over
the run: attitude in rad, momentum of a wheel in N m s.

| `nadir_day/witness-` | | 1 substep | 8 substeps | 64 substeps | Basilisk's own error | at 0.1 s |
|---|---|---|---|---|---|---|
{exact}

Basilisk holds the field over a step of its dynamics, so its error is of first order in the step.
With its effectors behind the spacecraft in the task, the usual order, commands act a step late:
{late:.1e} rad for the light craft at {late_step:g} s.

## Basilisk's own flight software

`witness-laws`: the 80 kg craft begins 20 deg off nadir; its PD controller and cross-product manager
have the gains of Basilisk's `mrpFeedback` and `mtbMomentumManagement` (Hogan & Schaub, 2015), which
fly the same craft in the same dynamics, at {laws_step:g} s.

![Pointing error and momentum of each wheel by both](witness.svg)

They are apart by up to {modules[attitude]:.1e} rad and {modules[momentum]:.1e} N m s; our equations
in Basilisk and `desat run` by {equations[attitude]:.1e} rad, as Basilisk holds the field over its
step. With the four terms below put into our equations they are **{all_terms[attitude]:.1e} rad**
apart, so these are all that differs. With all but one of them:

| what remains | attitude, rad | momentum, N m s |
|---|---|---|
{terms}

## What the orbits leave out

`environment_propagated` has J2 to J4. Without the harmonics that turn with the Earth (EGM96, here
to degree 4), Sun and Moon it is so far away (m) within 24 h from the same start, with a field
(IGRF) and a direction to nadir (deg) that differ by at most what the columns say for one node; the
last column has the distance over twelve nodes all around, on which it depends most:

| orbit | harmonics | Sun | Moon | all | field | nadir | all, by node |
|---|---|---|---|---|---|---|---|
{orbits}

The distance is along the orbit: the craft meets the same field and the same torques a few seconds
earlier or later. Whoever compares with a flight gives a two-line element set or a position of the
same day.
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", action="store_true", help="replace what is stored")
    options = parser.parse_args()
    if not BASILISK.exists():
        print(
            "Basilisk is not installed here (make .venv-basilisk/.tried): nothing was compared"
        )
        return 1
    rows: dict[str, Array] = {}
    cases: dict[str, Any] = {}
    for name in track([c for c in CASES if c != LAWS], "Basilisk's loops"):
        best, cases[name] = measured(name, CASES[name])
        rows |= {f"{name}.{series}": best[series] for series in SERIES}
    law_series, of_laws = laws()
    rows |= law_series
    summary = {
        "about": {
            "date": datetime.now(UTC).date().isoformat(),
            "basilisk": "2.12.1",
            "desat": version("desat"),
            "steps": STEPS,
        },
        "cases": cases,
        "laws": of_laws,
        "late": late(),
        "orbits": [of_a_day(*o) for o in ORBITS],
    }
    beyond = []
    if STORED.exists():
        before = json.loads(STORED_SUMMARY.read_text(encoding="utf-8"))["cases"]
        with np.load(STORED) as stored:
            for name, case in cases.items():
                a, b = ({k: x[f"{name}.{k}"] for k in SERIES} for x in (stored, rows))
                moved, most = (
                    apart(a, b),
                    {k: e + before[name]["error"][k] for k, e in case["error"].items()},
                )
                print(
                    f"{name}: from what is stored by {moved['attitude']:.1e} rad, "
                    f"{moved['momentum']:.1e} N m s"
                )
                beyond += [name for k in moved if moved[k] > most[k]]
    if options.write or not STORED.exists():
        np.savez_compressed(STORED, **rows)  # type: ignore[arg-type]
        STORED_SUMMARY.write_text(
            json.dumps(summary, indent=1) + "\n", encoding="utf-8"
        )
        DOCS.with_suffix(".svg").write_text(drawn(rows), encoding="utf-8")
        DOCS.write_text(page(summary), encoding="utf-8")
    elif beyond:
        print(
            f"further from what is stored than both may err: {', '.join(sorted(set(beyond)))}"
        )
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
