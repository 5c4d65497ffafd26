"""The predictive law beside each family's own: draws of the same seeds, paired, and
their page.

`python -m benchmarks.laws [--draws N] [FAMILY ...]` flies the rows of these families
(default: all) with the seed of the judged column, or with `--tuned` of those that
settings were tuned on, keeps their numbers in `laws.json`, and writes `docs/laws-measured.md`
from `docs/laws-measured.template`. `--page` writes the page alone, `--cost` measures what a plan
takes. All rows with 200 draws: `--draws 200`.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import os
import statistics
import sys
import tempfile
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from desat.campaign.draws import draws as draw
from desat.system.options import Options

STORE = Path(__file__).with_name("laws.json")
DOCS = Path(__file__).parents[1] / "docs"
TUNED = {"nadir_day": 1, "space_telescope": 7, "uosat12": 3, "integrated": 5}
"""Seeds of the draws that settings were chosen on."""
JUDGED = 3601
"""The seed of those that they are judged by."""
GAINS = (1.5e-4, 2.5e-4, 4e-4, 6e-4, 1e-3)
"""1/s; of the cross-product law."""
Numbers = list[dict[str, float | None]]


@dataclass(frozen=True)
class Row:
    """A comparison: a scenario, what it is held against, in which number and form, and
    the aim.

    form: `ratio` or `difference` of two scenarios by draw; `equal`: the ratio to the
    least that the cross product has with any of GAINS at no more energy; `bound`: less
    `bound_same_end` of the same run, or, where `other` is given, of that scenario in
    the same draw; `value`: as it is.
    """

    scenario: str
    label: str
    number: str
    form: str
    other: str = ""
    aim: float | None = None
    set: tuple[str, ...] = ()


def _rows() -> tuple[Row, ...]:
    rows = []
    for field, label in (("dipole", "dipole"), ("igrf", "IGRF")):
        name, other = f"nadir_day/laws-predictive-{field}", f"nadir_day/laws-cp-{field}"
        rows.append(Row(name, label, "peak_momentum", "equal", other, 0.35))
        rows.append(Row(name, label, "energy_per_orbit", "value"))
    telescope = {
        "nominal": ("nominal", 1.05),
        "dead-known": ("a coil dead, known", 1.05),
        "dead-unknown": ("a coil dead, unknown", 1.12),
        "gravity-0-8": ("gravity gradient known as 0.8", 1.05),
    }
    for case, (label, energy) in telescope.items():
        name, other = (
            f"space_telescope/predictive-{case}",
            f"space_telescope/ours-{case}",
        )
        rows.append(Row(name, label, "peak_speed", "ratio", other, 1.0))
        rows.append(Row(name, label, "rms_momentum", "ratio", other, 1.0))
        rows.append(Row(name, label, "energy_per_orbit", "ratio", other, energy))
    turned = ("torquers.failed_coil=1", "torquers.failed_share=-1")
    name, other = "space_telescope/predictive-flipped", "space_telescope/ours-nominal"
    rows.append(
        Row(name, "a coil turned, unknown", "peak_speed", "ratio", other, 0.3, turned)
    )
    rows.append(
        Row(
            name,
            "a coil turned, unknown",
            "energy_per_orbit",
            "ratio",
            other,
            1,
            turned,
        )
    )
    emptied = {
        "nominal": ("nominal", 0.2),
        "dead_known": ("y coil dead, known", 0.2),
        "field_weak": ("field 10 % weaker", 0.2),
        "field_strong": ("field 10 % stronger", 0.2),
        "noise": ("1 uT of noise", 0.5),
        "roll": ("attitude 5 deg off in roll", 0.6),
        "yaw": ("attitude 5 deg off in yaw", 0.6),
        "yaw_10": ("attitude 10 deg off in yaw", None),
        "dead_unknown": ("y coil dead, unknown", 0.4),
        "thrusters_0_7": ("thrusters of 0.7", None),
    }
    for case, (label, aim) in emptied.items():
        name = f"uosat12/predictive-{case}"
        rows.append(Row(name, label, "firing_time", "bound", "", aim))
        rows.append(
            Row(
                name,
                label,
                "final_momentum",
                "value",
                "",
                0.1 if case == "thrusters_0_7" else 0.01,
            )
        )
    name = "uosat12/predictive-flipped"
    rows.append(
        Row(
            name,
            "y coil turned, unknown",
            "firing_time",
            "bound",
            "uosat12/predictive-nominal",
        )
    )
    rows.append(
        Row(name, "y coil turned, unknown", "final_momentum", "value", "", 0.01)
    )
    name, other = "integrated/predictive", "integrated/mil-nadir"
    for number in ("dumped", "pointing", "near_zero", "coil_load", "coil_load_steady"):
        rows.append(Row(name, "nadir, noisy sensors", number, "difference", other, 0.0))
    for weight in ("0.05", "1", "2", "4"):
        name = f"integrated/predictive-standstill-{weight}"
        for number in ("near_zero", "null_end"):
            rows.append(Row(name, f"standstill_weight {weight}", number, "value"))
    return tuple(rows)


ROWS = _rows()


def key(scenario: str, seed: int, values: tuple[str, ...] = ()) -> str:
    """What a set of draws is kept under."""
    return " ".join((scenario, str(seed), *values))


def campaigns_of(rows: tuple[Row, ...]) -> list[tuple[str, tuple[str, ...]]]:
    """The scenarios with their overrides that these rows need, each once."""
    found: dict[tuple[str, tuple[str, ...]], None] = {}
    for row in rows:
        found[row.scenario, ()] = None
        if row.form == "equal":
            for gain in GAINS:
                found[row.other, (f"manager.gain={gain:g}",)] = None
        elif row.other:
            found[row.other, row.set] = None
    return list(found)


def fly(scenario: str, seed: int, count: int, values: tuple[str, ...]) -> Numbers:
    """The numbers of each draw; a draw that did not complete ends all."""
    options = Options(sets=list(values))
    draws = draw(scenario, count, seed, options, jobs=os.cpu_count() or 1).rows
    bad = [row.message for row in draws if not row.completed]
    if bad or len(draws) != count:
        raise SystemExit(f"{scenario}: {bad[0] if bad else 'not all were made'}")
    return [dict(row.numbers) for row in draws]


def least_at(curve: list[tuple[float, float]], energy: float) -> float:
    """The least number that a law has at no more than an energy, of (energy, number) by
    gain: between gains, linear in logarithms."""
    best = min((n for e, n in curve if e <= energy), default=math.inf)
    for (e0, n0), (e1, n1) in itertools.pairwise(curve):
        if min(e0, e1) <= energy <= max(e0, e1) and e0 != e1:
            share = math.log(energy / e0) / math.log(e1 / e0)
            best = min(
                best, math.exp((1.0 - share) * math.log(n0) + share * math.log(n1))
            )
    if best == math.inf:  # it never takes so little: where it takes least
        best = min(curve)[1]
    return best


def values(row: Row, seed: int, stored_values: dict[str, Any]) -> list[float] | None:
    """The row's value of each draw; None where draws are missing."""

    def of(scenario: str, inputs: tuple[str, ...] = ()) -> Numbers:
        return stored_values[key(scenario, seed, inputs)]["numbers"]  # type: ignore[no-any-return]

    def number(x: dict[str, float | None], name: str) -> float:
        value = x[name]
        return math.inf if value is None else value

    try:
        ours = of(row.scenario)
        if row.form == "value":
            return [number(x, row.number) for x in ours]
        if row.form == "bound":
            theirs = of(row.other) if row.other else ours
            return [
                number(x, row.number) - number(y, "bound_same_end")
                for x, y in zip(ours, theirs, strict=True)
            ]
        if row.form == "equal":
            all_gains = [of(row.other, (f"manager.gain={g:g}",)) for g in GAINS]
            result = []
            for k, x in enumerate(ours):
                curve = [
                    (number(g[k], "energy_per_orbit"), number(g[k], row.number))
                    for g in all_gains
                ]
                least = least_at(curve, number(x, "energy_per_orbit"))
                result.append(number(x, row.number) / least)
            return result
        pairs = [
            (number(x, row.number), number(y, row.number))
            for x, y in zip(ours, of(row.other, row.set), strict=True)
        ]
    except KeyError:
        return None
    if row.form == "ratio":
        return [x / y for x, y in pairs]
    return [0.0 if x == y else x - y for x, y in pairs]


def interval(sample: list[float]) -> tuple[float, float]:
    """The 95 % interval of the median by order statistics (binomial, conservative)."""
    n, ordered = len(sample), sorted(sample)
    tail, k = 0.0, 0
    while k < n // 2 and tail + math.comb(n, k) / 2**n <= 0.025:
        tail += math.comb(n, k) / 2**n
        k += 1
    k = max(k - 1, 0)
    return ordered[k], ordered[n - 1 - k]


def shown(x: float) -> str:
    """A number of a table."""
    return "never" if x == math.inf else "always" if x == -math.inf else f"{x:.3g}"


def cost() -> dict[str, str]:
    """What a plan takes on this machine: a native FMU of the law, alone, with the
    recorded inputs of flights; and the memory that `desat export c` states by gcc."""
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    from desat.fmus.alone import alone, sources_of
    from desat.fmus.registry import block_class
    from desat.runs.run import Options, execute

    path = Path(__file__).parents[1] / "fmus/dist/native/manager_predictive.fmu"
    found: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as folder:
        unpacked = extract(str(path), unzipdir=str(Path(folder) / "fmu"))
        described = read_model_description(unpacked)
        variables = {v.name: v for v in described.modelVariables}
        choices = {
            v.name: v.choices for v in block_class("manager_predictive").variables
        }
        for name, scenario, stop in (
            ("hold", "nadir_day/laws-predictive-dipole", 40000.0),
            ("igrf", "nadir_day/laws-predictive-igrf", 40000.0),
            ("telescope", "space_telescope/predictive-nominal", 45600.0),
            ("empty", "uosat12/predictive-nominal", 600.0),
        ):
            run = execute(scenario, Options(stop=stop), Path(folder) / name)
            slave = FMU2Slave(
                guid=described.guid,
                unzipDirectory=unpacked,
                instanceName="manager",
                modelIdentifier=described.coSimulation.modelIdentifier,
            )
            slave.instantiate()
            slave.setupExperiment(startTime=0.0)
            slave.enterInitializationMode()

            def put(key: str, value: Any, slave: Any = slave) -> None:
                flat = np.ravel(np.asarray(value)).tolist()
                names = (
                    [key]
                    if key in variables
                    else [n for n in variables if n.startswith(key + "[")]
                )
                for n, x in zip(names, flat, strict=True):
                    variable = variables[n]
                    if variable.type == "Real":
                        slave.setReal([variable.valueReference], [float(x)])
                    elif variable.type == "Boolean":
                        slave.setBoolean([variable.valueReference], [bool(x)])
                    else:
                        names_of = choices.get(key, ())
                        number = names_of.index(x) if x in names_of else x
                        slave.setInteger([variable.valueReference], [int(number)])

            for key, value in run.manifest.values_of("manager").items():
                put(key, value)
            series = {
                "r_eci": "environment.r_eci",
                "v_eci": "environment.v_eci",
                "b_body": "magnetometer.b_body",
                "h_wheel": "wheels.h_wheel",
                "q_bi": "spacecraft.q_bi",
                "omega_bi_body": "spacecraft.omega_bi_body",
            }
            if name == "empty":
                series["h_wheel"] = "spacecraft.h_copy_wheel"
            inputs = {k: run.results.values(s) for k, s in series.items()}
            period = run.manifest.values_of("manager")["sample_time"]
            every = round(period / run.manifest.step)
            slave.exitInitializationMode()
            plans: list[float] = []
            steps = variables["plan_steps"].valueReference
            for k in range(int(stop / period)):
                for key, values_ in inputs.items():
                    put(key, values_[min(k * every, len(values_) - 2)])
                begin = time.thread_time_ns()
                slave.doStep(
                    currentCommunicationPoint=k * period, communicationStepSize=period
                )
                plans.append(1e-3 * (time.thread_time_ns() - begin))
            assert slave.getInteger([steps])[0] > 0
            slave.terminate()
            plan_every = max(1, -(-30 // int(period))) if name != "empty" else 1
            sizes = sorted(plans[plan_every::plan_every])
            found[name] = f"{statistics.median(sizes):.0f} ({sizes[-1]:.0f})"
    _, (size,) = alone(path.stem, sources_of(path), [["gcc"]])
    return found | {"stack_igrf": f"{size.stack:,}", "static_igrf": f"{size.static:,}"}


FORMS = {
    "ratio": "over that of",
    "difference": "less that of",
    "equal": "over the best of",
    "bound": "above the bound",
    "value": "",
}


def table(rows: tuple[Row, ...], stored_values: dict[str, Any]) -> list[str]:
    """The lines of the table of some rows."""
    lines = [
        "| case | number | aim | tuned on | judged by | worst sample | samples | met |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = []
        for seed in (TUNED[row.scenario.split("/")[0]], JUDGED):
            sample = values(row, seed, stored_values)
            if not sample:
                cells.append(("not flown", "", 0, math.nan))
                continue
            median = statistics.median(sample)
            low, high = interval(sample)
            text = f"{shown(median)} [{shown(low)}, {shown(high)}]"
            cells.append((text, shown(max(sample)), len(sample), median))
        (tuned, _, n_tuned, _), (judged, worst, n, median) = cells
        against = row.other.split("/")[-1] if row.form != "bound" else ""
        name = f"{row.number} {FORMS[row.form]} {against}".strip()
        met = "" if row.aim is None or n == 0 else "yes" if median <= row.aim else "no"
        aim = "" if row.aim is None else f"{row.aim:g}"
        lines.append(
            f"| {row.label} | {name} | {aim} | {tuned} | {judged} | {worst} | "
            f"{n_tuned}, {n} | {met} |"
        )
    return lines


def page(stored_values: dict[str, Any]) -> str:
    """docs/laws-measured.md: the template with its tables."""
    text = (DOCS / "laws-measured.template").read_text()
    for family in dict.fromkeys(row.scenario.split("/")[0] for row in ROWS):
        rows = tuple(row for row in ROWS if row.scenario.startswith(family + "/"))
        text = text.replace(
            "{{ " + family + " }}", "\n".join(table(rows, stored_values))
        )
    cost = stored_values.get("cost")
    if cost:
        for name, value in cost.items():
            text = text.replace("{{ cost." + name + " }}", str(value))
    return text


def store(saved: dict[str, Any]) -> None:
    """Write what is stored, a scenario and seed in each line."""
    rows = (
        f"{json.dumps(key)}: {json.dumps(saved[key], sort_keys=True)}"
        for key in sorted(saved)
    )
    STORE.write_text("{\n" + ",\n".join(rows) + "\n}\n")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("families", nargs="*")
    parser.add_argument("--draws", type=int, default=20)
    parser.add_argument(
        "--tuned", action="store_true", help="the draws that were tuned on"
    )
    parser.add_argument("--page", action="store_true", help="write the page alone")
    parser.add_argument("--cost", action="store_true", help="measure what a plan takes")
    arguments = parser.parse_args()
    saved: dict[str, Any] = json.loads(STORE.read_text()) if STORE.exists() else {}
    if arguments.cost:
        saved["cost"] = cost()
        store(saved)
    elif not arguments.page:
        rows = tuple(
            r
            for r in ROWS
            if not arguments.families or r.scenario.split("/")[0] in arguments.families
        )
        numbers = {r.number for r in ROWS} | {"energy_per_orbit", "bound_same_end"}
        jobs = campaigns_of(rows)
        for k, (scenario, sets) in enumerate(jobs):
            print(f"{k + 1} of {len(jobs)}: {scenario} {' '.join(sets)}", flush=True)
            seed = TUNED[scenario.split("/")[0]] if arguments.tuned else JUDGED
            draws = fly(scenario, seed, arguments.draws, sets)
            saved[key(scenario, seed, sets)] = {
                "date": datetime.now(UTC).date().isoformat(),
                "numbers": [
                    {n: d[n] for n in sorted(numbers) if n in d} for d in draws
                ],
            }
            store(saved)
    (DOCS / "laws-measured.md").write_text(page(saved))
    return 0


if __name__ == "__main__":
    sys.exit(main())
