"""docs/flown.md: what desat says of spacecraft that flew, beside what was published.

benchmarks/flown.toml has what was typed and where each published value was read.

python -m benchmarks.flown (make flown)
"""

from __future__ import annotations

import json
import math
import os
import shlex
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from desat.language.content import dispersions_of
from desat.runs.prepare import resolved
from desat.system.options import Options

HERE = Path(__file__).parent
MISSIONS, TEXT, STORED = (
    HERE / name for name in ("flown.toml", "flown.md", "flown.json")
)
PAGE = HERE.parent / "docs" / "flown.md"
DAY = 86400.0
# quantity -> its title, unit, and the factor to it from what `desat size` gives
INTERVALS = {
    "interval": ("Time between dumps", "d", 1.0 / DAY),
    "momentum": ("Momentum a day", "N m s", 1.0),
    "propellant": ("Propellant a year", "kg", 1.0),
    "dump propellant": ("Propellant of a dump", "kg", 1.0),
    "wheel": ("Fullest wheel without the secular part", "N m s", 1.0),
}
UNITS = {
    "net velocity": "m/s",
    "ratio of dumps": "1",
    "rate after 60 s": "deg/s",
    "inertia x": "kg m2",
    "inertia y": "kg m2",
    "inertia z": "kg m2",
    "dipole": "A m2",
}
AXES = "xyz"


@dataclass(frozen=True)
class Prediction:
    """What desat says: a value with its interval, equal ends where it states none."""

    value: float
    low: float
    high: float

    @property
    def has_width(self) -> bool:
        """Return whether an interval is stated."""
        return self.high > self.low

    def factor(self, value: float) -> float:
        """Return the larger of prediction and a published value over the smaller."""
        return max(self.value / value, value / self.value)


def missions() -> dict[str, dict[str, Any]]:
    """Read the missions; a line that names another mission is that one's."""
    table = tomllib.loads(MISSIONS.read_text(encoding="utf-8"))
    for entry in table.values():
        other = table.get(entry.get("line", ""))
        if other is not None:
            entry["line"] = other["line"]
    return table


def desat(*arguments: str) -> str:
    """Run a command and return what it prints; sizes that do not hold count too."""
    command = [sys.executable, "-m", "desat.cli", *arguments]
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    process = subprocess.run(command, capture_output=True, text=True, env=environment)
    if not process.stdout:
        raise RuntimeError(f"{shlex.join(arguments)}: {process.stderr}")
    return process.stdout


def predict(entry: Mapping[str, Any]) -> Prediction:
    """Predict what was published of a mission."""
    with tempfile.TemporaryDirectory() as folder:
        craft = f"{folder}/craft"
        desat("new", "craft", craft, *shlex.split(entry["line"]))
        quantity = entry["quantity"]
        if quantity.startswith("inertia"):
            return _inertia(craft, AXES.index(quantity[-1]))
        if quantity == "dipole":
            return _dipole(craft)
        if quantity == "rate after 60 s":
            return _rate(craft, entry["start"])
        sizes = _sizes(craft)
        rows = _intervals_of(sizes)
        if quantity == "net velocity":
            row, dump = rows["Propellant of a dump"], sizes["steady"]
            per_kg = dump["impulse"] / dump["propellant"] / entry["mass"]
            return Prediction(*(per_kg * x for x in (row.value, row.low, row.high)))
        if quantity == "ratio of dumps":
            other = f"{folder}/beside"
            desat("new", "craft", other, *shlex.split(entry["beside"]))
            one = rows["Time between dumps"]
            two = _intervals_of(_sizes(other))["Time between dumps"]
            return Prediction(
                two.value / one.value, two.low / one.value, two.high / one.value
            )
        title, _, factor = INTERVALS[quantity]
        row = rows[title]
        return Prediction(*(factor * x for x in (row.value, row.low, row.high)))


def _sizes(craft: str) -> dict[str, Any]:
    """Return the sizes of a craft."""
    sizes: dict[str, Any] = json.loads(desat("size", craft, "--no-loop", "--json"))
    return sizes


def _intervals_of(sizes: Mapping[str, Any]) -> dict[str, Prediction]:
    """Return the intervals of sizes by their titles."""
    return {
        title: Prediction(*(math.inf if x is None else x for x in values))
        for title, _, *values in sizes["intervals"]
    }


def _inertia(craft: str, axis: int) -> Prediction:
    """Return a moment of inertia (kg m2), and its ends where the spread has them."""
    values, spreads = _spacecraft(craft)
    value = float(np.reshape(values["inertia"], (3, 3))[axis][axis])
    factor = spreads.get("spacecraft.inertia", 1.0)
    return Prediction(value, value / factor, value * factor)


def _dipole(craft: str) -> Prediction:
    """Return the size of the residual dipole (A m2), and its ends."""
    values, spreads = _spacecraft(craft)
    size = float(np.linalg.norm(values["residual_dipole_body"]))
    factor = spreads["spacecraft.residual_dipole_body"]
    return Prediction(size, size / factor, size * factor)


def _spacecraft(craft: str) -> tuple[dict[str, Any], dict[str, float]]:
    """Return values of a craft's spacecraft, and the factors of what is not known."""
    system, _ = resolved(craft, Options())
    spreads = {k: x.factor for k, x in dispersions_of(system).items() if x.factor}
    return dict(system.components["spacecraft"].values), spreads


def _rate(craft: str, start: str) -> Prediction:
    """Return the rate (deg/s) 60 s after B-dot began at a start rate (rad/s)."""
    case = f"{craft}/detumbling.toml"
    options = ("--set", f"spacecraft.omega_start_body={start}", "--stop", "60")
    out = json.loads(desat("run", case, *options, "--out", f"{craft}/run", "--json"))
    value = float(out["numbers"]["last_rate"]["value"])
    return Prediction(value, value, value)


def unit_of(quantity: str) -> str:
    """Return the unit of a quantity."""
    return INTERVALS[quantity][1] if quantity in INTERVALS else UNITS[quantity]


def predict_all(
    table: Mapping[str, Mapping[str, Any]],
) -> dict[str, Prediction]:
    """Predict all missions that can be said."""
    names = [name for name, entry in table.items() if "line" in entry]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        each = pool.map(lambda name: predict(table[name]), names)
        return dict(zip(names, each, strict=True))


def factors(
    table: Mapping[str, Mapping[str, Any]], predictions: Mapping[str, Prediction]
) -> dict[str, float]:
    """Return the factors of all missions whose published value is no bound."""
    return {
        name: prediction.factor(table[name]["value"])
        for name, prediction in predictions.items()
        if "bound" not in table[name]
    }


def _row(entry: Mapping[str, Any], prediction: Prediction) -> str:
    """Return the row of a mission."""
    value = _span(entry["value"], entry.get("low"), entry.get("high"))
    unit = unit_of(entry["quantity"])
    ends = _span(prediction.value, prediction.low, prediction.high)
    inside = prediction.low <= entry["value"] <= prediction.high
    stated_text = (
        ("yes" if inside else "**no**") if prediction.has_width else "none stated"
    )
    blind = "yes" if entry.get("blind") else ""
    return (
        f"| {entry['title']} | {value} {unit} | {ends} | "
        f"{prediction.factor(entry['value']):.2f} | {stated_text} | {blind} | "
        f"{entry.get('cause', '')} |"
    )


def _span(value: float, low: float | None, high: float | None) -> str:
    """Return a value with its ends, if it has some."""
    if low is None or high is None or low == high:
        return f"{value:.3g}"
    return f"{value:.3g} ({low:.3g} to {high:.3g})"


def _bound_row(entry: Mapping[str, Any], prediction: Prediction) -> str:
    """Return the row of a mission whose published value is a bound."""
    least = entry["bound"] == "least"
    value = entry["value"]
    does = prediction.high >= value if least else prediction.low <= value
    unit = unit_of(entry["quantity"])
    span = _span(value, entry.get("low"), entry.get("high"))
    return (
        f"| {entry['title']} | at {entry['bound']} {span} {unit} | "
        f"{_span(prediction.value, prediction.low, prediction.high)} | "
        f"{'yes' if does else '**no**'} | {entry.get('cause', '')} |"
    )


def _page(
    table: Mapping[str, Mapping[str, Any]], predictions: Mapping[str, Prediction]
) -> str:
    """Return the page."""
    of_flight = factors(table, predictions)
    with_width = [predictions[n] for n in of_flight if predictions[n].has_width]
    inside = sum(
        predictions[n].low <= table[n]["value"] <= predictions[n].high
        for n in of_flight
        if predictions[n].has_width
    )
    widths = [p.high / p.low for p in with_width]
    rows = [_row(table[n], predictions[n]) for n in of_flight]
    bounds = [
        _bound_row(table[n], p) for n, p in predictions.items() if "bound" in table[n]
    ]
    mute = [
        f"| {entry['title']} | {entry['cannot']} | {entry['source']} |"
        for entry in table.values()
        if "cannot" in entry
    ]
    lines = [
        f"- {entry['title']}: `{entry['line']}`. {entry['source']} "
        f"({entry.get('evidence', 'text')}). "
        f"Assumed: {entry['assumed']}."
        for entry in table.values()
        if "line" in entry
    ]
    close = list(of_flight.values())
    values = {
        "count": len(of_flight),
        "stated": len(with_width),
        "inside": inside,
        "median": f"{np.median(close):.2f}",
        "within_1_5": sum(x <= 1.5 for x in close),
        "within_2": sum(x <= 2.0 for x in close),
        "width": f"{np.median(widths):.1f}",
        "missions": len({entry["title"].partition(",")[0] for entry in table.values()}),
        "rows": "\n".join(rows),
        "bounds": "\n".join(bounds),
        "mute": "\n".join(mute),
        "lines": "\n".join(lines),
        "made": f"{datetime.now(UTC).date().isoformat()}, desat {version('desat')}, "
        f"numpy {np.__version__}",
    }
    text = TEXT.read_text(encoding="utf-8")
    for name, value in values.items():
        text = text.replace(f"[{name}]", str(value))
    return text


def main(arguments: Sequence[str] = ()) -> None:
    """Predict all missions, write the page and the factors."""
    table = missions()
    predictions = predict_all(table)
    PAGE.write_text(_page(table, predictions), encoding="utf-8")
    rows = {n: round(x, 4) for n, x in factors(table, predictions).items()}
    STORED.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    print(PAGE.read_text(encoding="utf-8").partition("## What was typed")[0])


if __name__ == "__main__":
    main(sys.argv[1:])
