"""`desat convergence`: a scenario at several steps, held against its monolithic
reference."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.analyses.manifest import SubstepChoice
from desat.figures.canvas import Ticks
from desat.figures.style import COLOURS, DASHED, figure
from desat.runs.run import Options, prepare, simulate
from desat.system.choices import Algorithm
from desat.system.errors import DesatError
from desat.system.options import ALGORITHMS

from .estimate import companion, difference, estimate
from .reference import Gyrostat, Trajectory

STEPS = (1.0, 0.5, 0.25, 0.125)
"""Of the scenario's own step."""
SERIES = (
    "spacecraft.q_bi",
    "spacecraft.omega_bi_body",
    "spacecraft.impulse_eci",
    "wheels.h_wheel",
)


@dataclass
class Row:
    """One run: the largest errors over its samples (rad, N m s) and the largest
    momentum residual (N m s). `*_same_delays`: under `jacobi`, against the reference
    with the same delays. `estimate*`: what a `gauss_seidel` run says of its own errors
    (`estimate.py`)."""

    algorithm: str
    step: float
    attitude_error: float
    wheel_momentum_error: float
    momentum_drift: float
    attitude_error_same_delays: float | None = None
    wheel_momentum_error_same_delays: float | None = None
    estimate: float | None = None
    estimate_wheel_momentum: float | None = None
    note: str = ""
    """Why there is nothing with the same delays."""


@dataclass
class Flight:
    """A run at the controller's samples: q (n, 4), h (n, 4, N m s), its momentum
    residual (N m s), and under `jacobi` the reference with its delays, or why there is
    none."""

    q: NDArray[Any]
    h: NDArray[Any]
    residual: float
    delayed: Trajectory | None = None
    note: str = ""
    choice: SubstepChoice | None = None
    """How it came to its substeps, where it chose them."""


def fly(target: str, options: Options) -> Flight:
    """Run a system once."""
    case = prepare(target, replace(options, record=SERIES, supervised=True))
    system, _ = case.or_raise()
    gyrostat = Gyrostat(system)
    run = simulate(case).or_raise(target)
    every = round(gyrostat.sample / system.step)
    flight = Flight(
        run.results.values("spacecraft.q_bi")[::every],
        run.results.values("wheels.h_wheel")[::every],
        run.manifest.numbers["momentum_residual"].value or 0.0,
    )
    flight.choice = run.manifest.substep_choice
    run.results.close()
    if options.algorithm == "jacobi":
        try:
            flight.delayed = gyrostat.delayed(system.step)
        except DesatError as error:
            flight.note = str(error)
    return flight


def _row(
    case: Options, with_flights: Flight, ideal: Trajectory, finer: Flight | None
) -> Row:
    assert case.step is not None
    q, h = with_flights.q, with_flights.h
    row = Row(
        case.algorithm,
        case.step,
        *difference(q, h, ideal.q, ideal.h),
        with_flights.residual,
    )
    row.note = with_flights.note
    if (late := with_flights.delayed) is not None:
        row.attitude_error_same_delays, row.wheel_momentum_error_same_delays = (
            difference(q, h, late.q, late.h)
        )
    if finer is not None:
        row.estimate, row.estimate_wheel_momentum = estimate(q, h, finer.q, finer.h)
    return row


def study(
    target: str,
    options: Options,
    steps: tuple[float, ...] | None = None,
    algorithms: tuple[Algorithm, ...] = ALGORITHMS,
    jobs: int = 2,
    progress: bool = False,
) -> dict[str, Any]:
    """Rows for every algorithm and step (s; default: the scenario's and three finer
    ones), and the observed order of the gauss_seidel master; `substeps = "auto"` is one
    here, for what it chooses depends on the step."""
    options = replace(options, substeps=prepare(target, options).or_raise()[0].parts)
    if steps is None:
        own_value = prepare(target, options).or_raise()[0].step
        steps = tuple(own_value * share for share in STEPS)
    if not steps or any(s <= 0 for s in steps):
        raise DesatError("--steps: positive numbers are needed, as 1,0.5,0.25")
    system, _ = prepare(target, replace(options, step=steps[0])).or_raise()
    ideal = Gyrostat(system).ideal()
    cases = [replace(options, step=s, algorithm=a) for a in algorithms for s in steps]
    companions = [companion(system, c) for c in cases if c.algorithm == "gauss_seidel"]
    runs = cases + companions
    # every run loads this module, as all of this folder
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from rich.console import Console
    from rich.progress import track

    with ProcessPoolExecutor(
        min(jobs, len(runs)), mp_context=get_context("spawn")
    ) as pool:
        results = pool.map(fly, [target] * len(runs), runs)
        console = Console(stderr=True)
        flight = list(
            track(
                results,
                target,
                total=len(runs),
                console=console,
                transient=True,
                disable=not (progress and console.is_terminal),
            )
        )
    finer = {c.step: f for c, f in zip(companions, flight[len(cases) :], strict=True)}
    rows = [
        _row(
            case,
            run,
            ideal,
            finer[case.step] if case.algorithm == "gauss_seidel" else None,
        )
        for case, run in zip(cases, flight[: len(cases)], strict=True)
    ]
    gauss_seidel = [r for r in rows if r.algorithm == "gauss_seidel"]
    return {
        "scenario": target,
        "rows": [asdict(r) for r in rows],
        "order": order(
            [r.step for r in gauss_seidel], [r.attitude_error for r in gauss_seidel]
        ),
        "order_wheel_momentum": order(
            [r.step for r in gauss_seidel],
            [r.wheel_momentum_error for r in gauss_seidel],
        ),
    }


def order(steps: list[float], errors: list[float]) -> float | None:
    """The slope of log error over log step; None with less than two steps."""
    if len(set(steps)) < 2 or min(errors) <= 0.0:
        return None
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def plot(result: dict[str, Any], key: str, unit: str) -> str:
    """Errors over steps as SVG."""
    fig, ax = figure()
    lines: list[tuple[str, str, tuple[float, ...]]] = [(a, key, ()) for a in ALGORITHMS]
    if f"{key}_same_delays" in result["rows"][0]:
        lines.append(("jacobi", f"{key}_same_delays", DASHED))
    for i, (algorithm, field, style) in enumerate(lines):
        rows = [r for r in result["rows"] if r["algorithm"] == algorithm and r[field]]
        label = algorithm + (", same delays" if field != key else "")
        ax.plot(
            [r["step"] for r in rows],
            [r[field] for r in rows],
            COLOURS[i],
            width=1.4,
            dash=style,
            marker=4.0,
            label=label,
        )
    steps = sorted({r["step"] for r in result["rows"]})
    ax.x.ticks = Ticks(tuple(steps), tuple(f"{s:g}" for s in steps))
    ax.x.log = ax.y.log = True
    ax.x.label, ax.y.label = "step [s]", f"largest error [{unit}]"
    return fig.svg()
