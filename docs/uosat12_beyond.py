"""What is beyond paper 000 (bounded blends, receding horizon, the bound): a part of
docs/papers/uosat12."""

from __future__ import annotations

import json
import statistics
from collections.abc import Callable
from pathlib import Path
from typing import Any

from desat.study.case import Run

from .figures import bars, curves
from .page import Page

Runner = Callable[..., Run]
Numbers = dict[str, float]

BENCHMARKS = Path(__file__).parent.parent / "benchmarks" / "latest.json"
CASES = {
    "ilqr-1": "[1, 2, -1] at 0.23 orbit",
    "ilqr-2": "[2, -1.2, 0.5] at 0.56",
    "ilqr-3": "[1.2, -0.8, -2] at 0.67",
}
METHODS = {
    "dct": "thrusters only (DCT)",
    "ocdc": "OCDC, eq. 34",
    "bounded_quadratic": "bounded quadratic",
    "bounded_one_norm": "bounded 1-norm",
    "receding_horizon": "receding horizon",
}

# the other two starts of the robustness table: its scenarios have the first
STARTS: tuple[tuple[str, ...], ...] = (
    (),
    ("spacecraft.h_start_body=2.0,-1.2,0.5", "environment.phase=3.5185837720205684"),
    ("spacecraft.h_start_body=1.2,-0.8,-2.0", "environment.phase=4.2097341558103230"),
)
CONDITIONS = {
    "nominal": "all as assumed",
    "torque": "unmodelled torque of 1e-4 N m about each axis",
    "noise": "magnetometer noise of 1 µT",
    "dead_known": "y coil dead, known",
    "dead_unknown": "y coil dead, unknown",
    "weak": "model of the field 10 % too weak",
    "strong": "model of the field 10 % too strong",
    "untilted": "model of the field without tilt",
}
MODEL = ("weak", "strong", "untilted")


def numbers(run: Run) -> Numbers:
    """The numbers of a run by their names."""
    return {name: float(n["value"]) for name, n in run.manifest["numbers"].items()}


def scenario(method: str, case: str) -> str:
    """The scenario of a method in Table 3's setting."""
    table = "table3" if method in ("dct", "ocdc") else "beyond"
    return f"uosat12/{table}-{method}-{case}"


def section(page: Page, run: Runner, made: dict[str, Any]) -> None:
    """The sections of the page, in order; `run` runs a scenario by its name, with `--set` texts."""
    comparison(page, run)
    random_starts(page, made)
    robustness(page, run)
    updates(page)


def comparison(page: Page, run: Runner) -> None:
    """Firing times against the bound, Table 3's setting."""
    page.heading("Beyond the paper: how little would do")
    page.text(
        """Eq. 34 cuts the dipole that is optimal without a limit down to the limit, and lets the
        thrusters make up for it. The **bounded blends** know the limit while they optimise: the
        quadratic one has the cost of OCDC (with a ratio b/a of 1e12, as within its limit a dipole
        costs nothing here), the 1-norm one has the thrusters' on-time itself as its cost. They are
        drop-ins that need no prediction. The **receding horizon** plans at each sample the dipoles
        and on-times of all samples that are left, for the least on-time, by a linear programme with
        a predicted field, and does the first of them. **The bound** (`desat bound`) is the least
        firing time for the same run by one such programme that knows the field that was; it is in
        the report of every dumping run."""
    )
    data = {c: {m: numbers(run(scenario(m, c))) for m in METHODS} for c in CASES}
    rows: list[list[str]] = []
    for case, start in CASES.items():
        dct = data[case]["dct"]["firing_time"]
        for method, label in METHODS.items():
            n = data[case][method]
            rows.append([
                start if method == "dct" else "", label, f"{n['firing_time']:.2f}",
                f"{100 * (1 - n['firing_time'] / dct):.1f}", f"{n['above_bound']:.2f}",
                f"{1e3 * n['final_momentum']:.1f}", f"{n['dipole_energy'] / 1e6:.3f}",
            ])  # fmt: skip
        least = data[case]["receding_horizon"]["bound"]
        rows.append(["", "bound", f"{least:.2f}", f"{100 * (1 - least / dct):.1f}", "", "0", ""])
    page.table(
        ["start", "law (ILQR torque but for the last)", "firing s", "saving %",
         "above the bound of its end %", "end mN m s", "energy, 10⁶ A² m⁴ s"],
        rows,
    )  # fmt: skip
    page.figure(
        "beyond-bars",
        "Firing time in Table 3's setting",
        bars(
            {
                f"start {number}": {
                    **{label: data[case][m]["firing_time"] for m, label in METHODS.items()},
                    "bound": data[case]["receding_horizon"]["bound"],
                }
                for number, case in enumerate(CASES, 1)
            },
            "firing time [s]",
        ),
    )
    lines = []
    for method, label in METHODS.items():
        results = run(scenario(method, "ilqr-1")).results
        lines.append((label, results.times(), results.values("thrusters.on_time")))
    page.figure(
        "beyond-firing",
        "Firing time used so far, first start",
        curves(lines, "firing time [s]", height=3.2),
    )
    best = max(data[c]["receding_horizon"]["above_bound"] for c in CASES)
    saved = [
        100 * (1 - data[c]["receding_horizon"]["firing_time"] / data[c]["dct"]["firing_time"])
        for c in CASES
    ]
    page.text(
        f"""The receding horizon is at most {best:.2f} % above the bound and saves {min(saved):.0f}
        to {max(saved):.0f} % where the paper's OCDC saves 22 to 27 %. What the blends lose is not
        in the split but in the torque that is split: ILQR asks for most of it at once, when the
        thrusters must give it. The plan instead keeps the coils at their limit from the first to
        the last sample and fires for the rest, as late as that is safe: what need not be fired now
        may not have to be. It pays with dipole energy, which comes from the Sun.""",
        """A percentage below zero is not a law better than the bound: a plan holds torque at its
        mean over the 10 s of a sample, a pulse stands at their beginning, and the body turns by
        0.01 rad in between.""",
    )


def random_starts(page: Page, made: dict[str, Any]) -> None:
    """Firing times over seeded draws."""
    drawn = {
        m: [d["numbers"] for d in made["scenarios"][f"uosat12/starts-{m}"]["draws"]]
        for m in METHODS
    }
    count = len(drawn["dct"])
    page.heading(f"{count} random starts")
    page.text(
        f"""Momentum of 2.45 N m s, as the paper's, in a random direction, from a random place on
        the orbit, and B_y = +2.4 µT; the same {count} for every law
        (`desat draws uosat12/starts-ocdc --count {count} --seed {made["seed"]}`)."""
    )
    dct = [d["firing_time"] for d in drawn["dct"]]
    seconds = {label: [d["firing_time"] for d in drawn[m]] for m, label in METHODS.items()}
    seconds["bound"] = [d["bound"] for d in drawn["receding_horizon"]]
    above = {label: [d["above_bound"] for d in drawn[m]] for m, label in METHODS.items()}
    left = {label: [d["final_momentum"] for d in drawn[m]] for m, label in METHODS.items()}
    rows = []
    for label, values in seconds.items():
        saving = [100 * (1 - v / d) for v, d in zip(values, dct, strict=True)]
        rows.append([
            label, *_spread(values, 2), *_spread(saving, 1),
            *(_spread(above[label], 1) if label in above else ("", "", "")),
            f"{1e3 * max(left[label]):.1f}" if label in left else "0",
        ])  # fmt: skip
    page.table(
        ["law", "firing s, median", "least", "most", "saving %, median", "least", "most",
         "above the bound %, median", "least", "most", "end mN m s, most"],
        rows,
    )  # fmt: skip


def _spread(values: list[float], digits: int) -> tuple[str, str, str]:
    low, high = min(values), max(values)
    return tuple(f"{x:.{digits}f}" for x in (statistics.median(values), low, high))  # type: ignore[return-value]


def robustness(page: Page, run: Runner) -> None:
    """Firing times and ends when something is not as assumed."""
    page.heading("When something is not as assumed")
    page.text(
        """Seconds and momentum at the end of each law over the three starts, with B_y = +2.4 µT. A
        wrong model of the field can only hurt the law that has one; the others measure the field
        and predict nothing."""
    )
    rows = []
    for condition, text in CONDITIONS.items():
        shown = False
        for method, label in METHODS.items():
            if method == "dct" or (condition in MODEL and method != "receding_horizon"):
                continue
            file = "robust-model" if condition in MODEL else "robust"
            found = [numbers(run(f"uosat12/{file}-{method}-{condition}", *s)) for s in STARTS]
            rows.append([
                "" if shown else text, label, *(f"{n['firing_time']:.2f}" for n in found),
                *(f"{1e3 * n['final_momentum']:.1f}" for n in found),
                f"{max(n['above_bound'] for n in found):.1f}",
            ])  # fmt: skip
            shown = True
    page.table(
        ["what", "law", "firing s, start 1", "2", "3", "end mN m s, start 1", "2", "3",
         "above the bound %, most"],
        rows,
    )  # fmt: skip
    page.text(
        """The bound knows the disturbance and the dead coil. A dead coil that nobody knows of
        leaves the feedback laws with momentum: what they ask of it is missing at every sample. The
        plan is made anew from what is measured and fires at the end what the coil did not do;
        what it leaves is that coil's part of the last sample."""
    )


def updates(page: Page) -> None:
    """Microseconds per update, as the benchmark last measured them."""
    page.heading("Microseconds per update")
    data: dict[str, Any] = json.loads(BENCHMARKS.read_text(encoding="utf-8"))
    page.text(
        f"""Time in the manager FMU's step at a sample, in CPython {data["about"]["python"]} on one
        core of the machine of `benchmarks/latest.json` (`make bench`). The first update prepares
        (LQR, MEC) or has the whole horizon to plan. The plan is HiGHS through scipy; all other laws
        are plain Python, without numpy. All are meant for one update in 10 s."""
    )
    page.table(
        ["law", "µs per update, mean of 60", "first update"],
        [[name, f"{x['us_per_update']:.0f}", f"{x['first_us']:.0f}"]
         for name, x in data["laws"].items()],
    )  # fmt: skip
