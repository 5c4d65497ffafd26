"""Numbers from series: the measures that a scenario's `[numbers.NAME]` may name.

A measure takes times (rows,), values (rows, elements) and its options, and gives one number in
the unit of the values unless its text says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import DesatError, nearest
from .results import Results

Array = NDArray[np.float64]
Measure = Callable[..., float]
MEASURES: dict[str, Measure] = {}


def measure(function: Measure) -> Measure:
    """Make a function known by its name."""
    MEASURES[function.__name__] = function
    return function


@measure
def last(times: Array, values: Array) -> float:
    """The last value of a scalar."""
    return float(values[-1, 0])


@measure
def norm_last(times: Array, values: Array) -> float:
    """The size of a vector at the end."""
    return float(np.linalg.norm(values[-1]))


@measure
def largest(times: Array, values: Array) -> float:
    """The largest size of any element at any time."""
    return float(np.abs(values).max())


@measure
def norm_largest(times: Array, values: Array) -> float:
    """The largest size of a vector."""
    return float(np.linalg.norm(values, axis=1).max())


@measure
def rms(times: Array, values: Array) -> float:
    """The root of the mean square size."""
    return float(np.sqrt((values**2).sum(axis=1).mean()))


@measure
def pointing_last(times: Array, q: Array, q_ref: Array) -> float:
    """The angle between two attitudes at the end (deg)."""
    return float(pointing(q, q_ref)[-1])


@measure
def pointing_largest(times: Array, q: Array, q_ref: Array) -> float:
    """The largest angle between two attitudes (deg)."""
    return float(pointing(q, q_ref).max())


@measure
def pointing_rms(times: Array, q: Array, q_ref: Array) -> float:
    """The root mean square angle between two attitudes (deg)."""
    return float(np.sqrt((pointing(q, q_ref) ** 2).mean()))


def pointing(q: Array, q_ref: Array) -> Array:
    """The angle between attitudes (deg), row by row; exact for small ones."""
    sign = np.where((q * q_ref).sum(axis=1, keepdims=True) < 0.0, -1.0, 1.0)
    half_chord = np.linalg.norm(q - sign * q_ref, axis=1) / 2.0
    return np.asarray(np.degrees(4.0 * np.arcsin(np.clip(half_chord, 0.0, 1.0))))


def evaluate(number: dict[str, Any], results: Results) -> float:
    """The number that a scenario describes: `signal`, `measure` and the measure's options.

    Raises DesatError for an unknown measure or series.
    """
    name = number.get("measure", "last")
    if name not in MEASURES:
        raise DesatError(f"no measure {name}{nearest(name, MEASURES)}")
    signals = number["signal"]
    series = [results.values(s) for s in ([signals] if isinstance(signals, str) else signals)]
    columns = [(s if s.ndim > 1 else s[:, None]).astype(float) for s in series]
    rows = min(len(c) for c in columns)
    times = results.times()[:rows]
    if rows == 0:
        return float("nan")
    with np.errstate(over="ignore"):  # a run that diverges has infinite numbers
        return MEASURES[name](times, *(c[:rows] for c in columns), **number.get("options", {}))


def relative(form: str, value: float, reference: float) -> float:
    """`saving`: percent less than the reference; `ratio`: value over reference."""
    if reference == 0.0:
        return float("nan")
    if form == "saving":
        return 100.0 * (1.0 - value / reference)
    if form == "ratio":
        return value / reference
    raise DesatError(f"no form {form}; there is ratio, saving")
