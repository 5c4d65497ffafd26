"""What the hardware that a craft is bought with does to momentum and pointing:
docs/hardware.md.

`python -m benchmarks.hardware [--draws N] [--only TEXT]` flies the variants below, or
those whose title has the text, in the same draws as the scenario that each is a variant
of, measures what a step of it costs (`--cost`: that alone), keeps both in
`hardware.json`, and writes the page from `docs/hardware.template`. `--page` writes the
page alone. A variant is a few lines of a scenario file; a new one is a line of
VARIANTS.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from typing import Any

from rich.progress import track

from desat.files.hardware import KINDS, known_figures

from .laws import fly as fly_law

STORE = Path(__file__).with_name("hardware.json")
DOCS = Path(__file__).parents[1] / "docs"
SEED = 2900
DRAWS = 20
SURE = 0.9
"""A change is shown where this share of the draws goes the same way."""
STEPS, ROUNDS = 20_000, 15
"""Of a measurement of cost; variant and scenario in turn."""


@dataclass(frozen=True)
class Flight:
    """A scenario that variants are flown in."""

    scenario: str
    title: str
    columns: tuple[tuple[str, str, float], ...]
    """Numbers of it: name, heading with unit, and what it is multiplied by."""
    values: dict[str, str]
    """What of its craft the variants' texts ask for, as {name}."""
    extra: str = ""
    """Lines that all of its variants begin with."""


NADIR = Flight(
    "integrated/mil-nadir",
    "CubeSat at nadir, a day",
    (
        ("coil_load", "coil load, %", 1.0),
        ("dumped", "dumped after, s", 1.0),
        ("pointing", "pointing, deg", 1.0),
    ),
    {
        "motor_constant": "2.63e-3",
        "drag": "[2e-6, 4e-6, 8e-6, 2e-5, 0, 0, 0, 0]",
        "drag_speed": "[0, 30, 200, 625, 0, 0, 0, 0]",
    },
)
TELESCOPE = Flight(
    "space_telescope/closed-me-nominal",
    "telescope, eight orbits",
    (
        ("coil_load", "coil load, %", 1.0),
        ("peak_speed", "peak wheel speed, rpm", 1.0),
        ("pointing", "pointing, mdeg", 1e3),
    ),
    {
        "motor_constant": "0.0743",
        "drag": "[0.004, 0.006, 0.012, 0.03, 0, 0, 0, 0]",
        "drag_speed": "[0, 15, 100, 315, 0, 0, 0, 0]",
    },
    """
[numbers.coil_load]
title = "Load of the most loaded coil, mean"
signal = "torquers.m_coil"
measure = "largest_mean"
percent_of = "torquers.m_limit"
unit = "%"
""",
)
DUMP = Flight(
    "uosat12/flight-ocdc-1",
    "UoSAT-12 dumps in 600 s",
    (
        ("firing_time", "firing, s", 1.0),
        ("final_momentum", "wheels at the end, mN m s", 1e3),
        ("pointing", "pointing, deg", 1.0),
    ),
    {},
)
FLIGHTS = {"cubesat": NADIR, "telescope": TELESCOPE, "dump": DUMP}


@dataclass(frozen=True)
class Variant:
    """Hardware that is otherwise than in the scenario: what it is, and the lines that
    say so."""

    title: str
    text: str
    flights: tuple[str, ...] = ("cubesat", "telescope")


COILS = 'sources.torquers = "torquers_rods"\nparameters.torquers.'
"""Beginning of what is said of one parameter of the coils."""
SUPPLIED = (
    'sources.torquers = "torquers_rods"\nparameters.torquers = { lag = 0.0, resistance = 30.0, '
    'supply_voltage = "%g * torquers.m_limit * torquers.resistance / torquers.area_turns"%s }'
)
WHEELS = 'sources.wheels = "wheels_motor"\nparameters.wheels'
MOTOR = (
    WHEELS + " = { motor_constant = {motor_constant}, torque_constant = 0.01, "
    'supply_voltage = "%g * wheels.speed_limit * wheels.torque_constant" }'
)
VALVES = (
    'sources.thrusters = "thrusters_valves"\n'
    'without = ["parameters.thrusters.tau_level", "plots.pulses"]\n'
)
STUCK = VALVES + "parameters.thrusters = { stuck_nozzle = 1, "

VARIANTS = (
    Variant("coils: remanence 1 %", COILS + "remanence = 0.01"),
    Variant("coils: remanence 3 %", COILS + "remanence = 0.03"),
    Variant("coils: remanence 5 %", COILS + "remanence = 0.05"),
    Variant(
        "coils: L/R = 0.2 s, supply for 1.2 of the limit",
        SUPPLIED % (1.2, ", inductance = 6.0"),
    ),
    Variant(
        "coils: L/R = 1 s, supply for 1.2 of the limit",
        SUPPLIED % (1.2, ", inductance = 30.0"),
    ),
    Variant("coils: supply for half of the limit", SUPPLIED % (0.5, "")),
    Variant(
        "coils: held voltage, windings at 80 °C",
        SUPPLIED % (1.5, ', regulation = "voltage", temperature = 353.15'),
    ),
    Variant(
        "coils: held voltage, windings at -40 °C",
        SUPPLIED % (1.5, ', regulation = "voltage", temperature = 233.15'),
    ),
    Variant("wheels: torque-speed curve, no load at 1.1 of the limit", MOTOR % 1.1),
    Variant("wheels: torque-speed curve, no load at 0.4 of the limit", MOTOR % 0.4),
    Variant(
        "wheels: drag by table",
        WHEELS + " = { viscous = 0.0, coulomb = 0.0, drag_speed = {drag_speed}, "
        "drag_torque = {drag} }",
    ),
    Variant(
        "magnetometer: turned by 1 deg about each axis",
        "parameters.magnetometer.response_error = [0, 0.01745, -0.01745, -0.01745, 0, "
        "0.01745, 0.01745, -0.01745, 0]",
    ),
    Variant(
        "magnetometer: scale 5 % too long",
        "parameters.magnetometer.response_error = [0.05, 0, 0, 0, 0.05, 0, 0, 0, 0.05]",
    ),
    Variant(
        "gyro: bias instability 10 deg/h, over 100 s",
        "parameters.gyro = { bias_instability = 4.848e-5, instability_time = 100.0 }",
        ("cubesat",),
    ),
    Variant(
        "gyro: turned by 1 deg about each axis",
        "parameters.gyro.misalignment_body = [0.01745, 0.01745, 0.01745]",
        ("cubesat",),
    ),
    Variant(
        "thrusters: nozzles, rise and decay 20 ms",
        VALVES + "parameters.thrusters = { rise_time = 0.02, decay_time = 0.02 }",
        ("dump",),
    ),
    Variant(
        "thrusters: nozzles, decay 100 ms longer than rise",
        VALVES + "parameters.thrusters = { rise_time = 0.02, decay_time = 0.12 }",
        ("dump",),
    ),
    Variant(
        "thrusters: nozzles, scatter 5 % a pulse",
        VALVES + "parameters.thrusters.impulse_scatter = 0.05",
        ("dump",),
    ),
    Variant(
        "thrusters: nozzle 1 stuck closed", STUCK + 'stuck = "closed" }', ("dump",)
    ),
    Variant(
        "thrusters: nozzle 1 stuck open, 50 g left",
        STUCK + 'stuck = "open", tank = 0.05 }',
        ("dump",),
    ),
    Variant(
        "thrusters: the same, known to the allocation",
        STUCK + 'stuck = "open", tank = 0.05, failure_known = true }',
        ("dump",),
    ),
)


def file_of(flight: Flight, text: str, folder: Path) -> Path:
    """A scenario file of a variant; an empty text: of the scenario itself."""
    for name, value in flight.values.items():
        text = text.replace("{" + name + "}", value)
    path = folder / "variant.toml"
    path.write_text(
        f'extends = "{flight.scenario}"\ntitle = "A variant"\n{text}\n{flight.extra}'
    )
    return path


def cost(flight: Flight, text: str, folder: Path) -> float:
    """Microseconds a step that a variant takes more than its scenario: the median of
    the differences of ROUNDS, in turn, in a process of their own."""
    files = []
    for k, lines in enumerate(("", text)):
        (folder / str(k)).mkdir(exist_ok=True)
        files.append(str(file_of(flight, lines, folder / str(k))))
    done = subprocess.run(
        [sys.executable, "-c", _IN_TURN, *files],
        capture_output=True,
        text=True,
        check=True,
    )
    return float(done.stdout)


_IN_TURN = f"""
import statistics, sys
from benchmarks.run import _master, _timed
with _master(sys.argv[1], False) as base, _master(sys.argv[2], False) as other:
    print(statistics.median(
        -_timed(base, {STEPS}) + _timed(other, {STEPS}) for _ in range({ROUNDS})))
"""


def fly(count: int, only: str, cost_alone: bool, stored_values: dict[str, Any]) -> None:
    """Fly scenarios and variants, or measure what they cost alone, and keep that."""
    chosen = [v for v in VARIANTS if only in v.title]
    todo = [(name, v) for v in chosen for name in v.flights]
    bases = [
        (name, Variant(FLIGHTS[name].title, "", (name,)))
        for name in dict.fromkeys(name for name, _ in todo)
    ]
    for name, variant in track([*bases, *todo], "variants"):
        flight, key = FLIGHTS[name], f"{name} {variant.title}"
        with tempfile.TemporaryDirectory() as directory:
            folder = Path(directory)
            if not cost_alone:
                numbers = fly_law(
                    str(file_of(flight, variant.text, folder)), SEED, count, ()
                )
                expected = [c for c, _, _ in flight.columns]
                stored_values[key] = {
                    "numbers": {c: [draw[c] for draw in numbers] for c in expected},
                    "made": datetime.now(UTC).strftime("%Y-%m-%d"),
                }
            stored_values[key]["us"] = (
                cost(flight, variant.text, folder) if variant.text else 0.0
            )
        STORE.write_text(json.dumps(stored_values, indent=1, sort_keys=True) + "\n")


def shown(x: float) -> str:
    """A number of a table."""
    return "never" if x == inf else f"{x:.3g}" if abs(x) < 999.5 else f"{x:.0f}"


def signed(x: float) -> str:
    """A difference of a table, to two digits."""
    if x in (0.0, inf):
        return "never" if x else "0"
    return f"{float(f'{x:.2g}'):+g}"


def _change(ours: list[float | None], base: list[float | None], scale: float) -> str:
    """The median, and by how much it differs draw by draw: the median of that where
    nearly all draws go the same way, else from where to where, if that is more than a
    hundredth. Of the draws whose scenario has the number."""
    pairs = [
        (inf if x is None else scale * x, scale * y)
        for x, y in zip(ours, base, strict=True)
        if y is not None
    ]
    middle = statistics.median(x for x, _ in pairs)
    least = 1e-4 * abs(middle)
    apart = [x - y if abs(x - y) > least else 0.0 for x, y in pairs]
    up, down = (sum(x > 0.0 for x in apart), sum(x < 0.0 for x in apart))
    if max(up, down) >= SURE * len(apart):
        return f"{shown(middle)} ({signed(statistics.median(apart))})"
    if max(map(abs, apart)) <= 0.01 * middle:
        return shown(middle)
    return f"{shown(middle)} ({signed(min(apart))} to {signed(max(apart))})"


def table(stored_values: dict[str, Any], flights: tuple[str, ...]) -> str:
    """The table of variants that are flown in these."""
    columns = [
        heading if i else f"{FLIGHTS[name].title}: {heading}"
        for name in flights
        for i, (_, heading, _) in enumerate(FLIGHTS[name].columns)
    ]
    lines = [
        "| hardware | µs a step more | " + " | ".join(columns) + " |",
        "|---|" + "---|" * (len(columns) + 1),
    ]
    base = {
        name: stored_values[f"{name} {FLIGHTS[name].title}"]["numbers"]
        for name in flights
    }
    cells = [
        _change(base[name][c], base[name][c], scale)
        for name in flights
        for c, _, scale in FLIGHTS[name].columns
    ]
    lines.append("| as the scenario has it | | " + " | ".join(cells) + " |")
    for variant in (v for v in VARIANTS if {*v.flights} <= {*flights}):
        if not all(
            f"{name} {variant.title}" in stored_values for name in variant.flights
        ):
            continue
        rows = {
            name: stored_values[f"{name} {variant.title}"] for name in variant.flights
        }
        cells = [
            _change(rows[name]["numbers"][c], base[name][c], scale)
            if name in rows
            else ""
            for name in flights
            for c, _, scale in FLIGHTS[name].columns
        ]
        us = statistics.mean(row["us"] for row in rows.values())
        lines.append(f"| {variant.title} | {us:.2f} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def listed(variant: str) -> str:
    """The table of all classes or products."""
    lines = [f"| component | {variant} | figures | source |", "|---|---|---|---|"]
    if variant == "class":
        lines = [f"| component | {variant} | figures |", "|---|---|---|"]
    for role, kind in KINDS.items():
        for name, its in known_figures(variant)[kind].items():
            shown = ", ".join(
                f"{k} {v}" for k, v in its.items() if k not in ("maker", "source")
            )
            row = f"| `{role}` | `{variant}:{name}` | {shown} |"
            lines.append(
                f"{row} {its['maker']}: {its['source']} |" if "source" in its else row
            )
    return "\n".join(lines)


def page(stored_values: dict[str, Any]) -> str:
    """docs/hardware.md: the template with its tables."""
    text = (DOCS / "hardware.template").read_text()
    text = text.replace("{{ steps }}", f"{STEPS:,}").replace(
        "{{ rounds }}", str(ROUNDS)
    )
    dumped = stored_values[f"cubesat {NADIR.title}"]["numbers"]["dumped"]
    text = text.replace(
        "{{ dumped }}", f"{sum(x is not None for x in dumped)} of {len(dumped)}"
    )
    for kind in ("class", "product"):
        text = text.replace("{{ " + kind + " }}", listed(kind))
    for flights in dict.fromkeys(v.flights for v in VARIANTS):
        text = text.replace(
            "{{ " + " ".join(flights) + " }}", table(stored_values, flights)
        )
    return text


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=DRAWS)
    parser.add_argument("--only", default="", help="variants whose title has this text")
    parser.add_argument("--cost", action="store_true", help="measure the cost alone")
    parser.add_argument("--page", action="store_true", help="write the page alone")
    arguments = parser.parse_args()
    saved: dict[str, Any] = json.loads(STORE.read_text()) if STORE.exists() else {}
    if not arguments.page:
        fly(arguments.draws, arguments.only, arguments.cost, saved)
    (DOCS / "hardware.md").write_text(page(saved))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
