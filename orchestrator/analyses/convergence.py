"""`desat convergence`: a scenario at several steps, held against its monolithic reference."""

from __future__ import annotations

from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track

from ..engine.master import ALGORITHMS, Algorithm
from ..study.case import Options, prepare, simulate
from ..study.derived import pointing
from ..study.plots import COLOURS, figure, legend, svg
from ..study.report import render, write_page
from ..system.errors import DesatError
from .reference import Gyrostat, Trajectory

STEPS = (1.0, 0.5, 0.25, 0.125)
SERIES = ("spacecraft.q_bi", "spacecraft.omega_bi_body", "spacecraft.impulse_eci",
          "wheels.h_wheel")  # fmt: skip


@dataclass
class Row:
    """One run: the largest errors over its samples (rad, N m s) and the largest momentum residual
    (N m s). `*_same_delays`: under `jacobi`, against the reference with the same delays."""

    algorithm: str
    step: float
    attitude_error: float
    wheel_momentum_error: float
    momentum_drift: float
    attitude_error_same_delays: float | None = None
    wheel_momentum_error_same_delays: float | None = None


def _errors(q: NDArray[Any], h: NDArray[Any], reference: Trajectory) -> tuple[float, float]:
    return float(np.radians(pointing(q, reference.q)).max()), float(np.abs(h - reference.h).max())


def measure(target: str, options: Options, ideal: Trajectory) -> Row:
    """Run a system once and compare."""
    case = prepare(target, replace(options, record=SERIES))
    system, _ = case.or_raise()
    gyrostat = Gyrostat(system)
    run = simulate(case)
    if not run.ok:
        raise DesatError(f"{target}: {run.manifest['message']}")
    every = round(gyrostat.sample / system.step)
    q = run.results.values("spacecraft.q_bi")[::every]
    h = run.results.values("wheels.h_wheel")[::every]
    drift = run.manifest["numbers"]["momentum_residual"]["value"]
    run.results.close()
    row = Row(options.algorithm, system.step, *_errors(q, h, ideal), drift)
    if options.algorithm == "jacobi":
        delayed = _errors(q, h, gyrostat.delayed(system.step))
        row.attitude_error_same_delays, row.wheel_momentum_error_same_delays = delayed
    return row


def _ideal(target: str, options: Options) -> Trajectory:
    system, _ = prepare(target, options).or_raise()
    return Gyrostat(system).ideal()


def study(
    target: str, options: Options, steps: tuple[float, ...] = STEPS,
    algorithms: tuple[Algorithm, ...] = ALGORITHMS, jobs: int = 2, progress: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Rows for every algorithm and step, and the observed order of the conserving master."""
    if not steps or any(s <= 0 for s in steps):
        raise DesatError("--steps: positive numbers are needed, as 1,0.5,0.25")
    ideal = _ideal(target, replace(options, step=steps[0]))
    cases = [replace(options, step=s, algorithm=a) for a in algorithms for s in steps]
    with ProcessPoolExecutor(min(jobs, len(cases)), mp_context=get_context("spawn")) as pool:
        results = pool.map(measure, [target] * len(cases), cases, [ideal] * len(cases))
        console = Console(stderr=True)
        rows = list(
            track(results, target, total=len(cases), console=console, transient=True,
                  disable=not (progress and console.is_terminal))
        )  # fmt: skip
    conserving = [r for r in rows if r.algorithm == "conserving"]
    return {
        "scenario": target,
        "rows": [asdict(r) for r in rows],
        "order": order([r.step for r in conserving], [r.attitude_error for r in conserving]),
        "order_wheel_momentum": order(
            [r.step for r in conserving], [r.wheel_momentum_error for r in conserving]
        ),
    }


def order(steps: list[float], errors: list[float]) -> float | None:
    """The slope of log error over log step; None with less than two steps."""
    if len(set(steps)) < 2 or min(errors) <= 0.0:
        return None
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])


def write_html(result: dict[str, Any], path: Path) -> Path:
    """The study as a self-contained page."""
    from markupsafe import Markup

    figures = [
        (
            "Largest attitude error against the monolithic reference",
            Markup(plot(result, "attitude_error", "rad")),
        ),
        (
            "Largest error of the wheels' momentum",
            Markup(plot(result, "wheel_momentum_error", "N m s")),
        ),
        (
            "Momentum residual: what the exchange loses",
            Markup(plot(result, "momentum_drift", "N m s")),
        ),
    ]
    text = render("convergence.html", result=result, figures=figures)
    path.parent.mkdir(parents=True, exist_ok=True)
    return write_page(path, text)


def plot(result: dict[str, Any], key: str, unit: str) -> str:
    """Errors over steps as SVG."""
    fig, ax = figure()
    lines = [(a, key, "-") for a in ALGORITHMS]
    if f"{key}_same_delays" in result["rows"][0]:
        lines.append(("jacobi", f"{key}_same_delays", "--"))
    for i, (algorithm, field, style) in enumerate(lines):
        rows = [r for r in result["rows"] if r["algorithm"] == algorithm and r[field]]
        label = algorithm + (", same delays" if field != key else "")
        ax.loglog(
            [r["step"] for r in rows], [r[field] for r in rows], style, marker="o",
            color=COLOURS[i], label=label, markersize=4,
        )  # fmt: skip
    steps = sorted({r["step"] for r in result["rows"]})
    ax.set_xticks(steps, [f"{s:g}" for s in steps])
    ax.minorticks_off()
    ax.set_xlabel("step [s]")
    ax.set_ylabel(f"[{unit}]")
    legend(ax)
    return svg(fig)
