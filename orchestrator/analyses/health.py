"""Check the health of a run, independent of the requirements of its scenario.

The checks are for sensors that never measured, an attitude that was lost, and full
wheels.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import pointing, wanted_attitude
from ..numbers.text import Value
from ..system.interface import role_classes
from ..system.model import System
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[Any]

KEY = "health"
NUMBERS = ()
# deg: an attitude with a larger rms error over the second half of a run is lost
ATTITUDE_LOST_DEG = 30.0
SELDOM = 0.05  # a sensor that is valid for a smaller share of the time is reported
TIME = 600.0  # s: a run of this length has time to reach its attitude
# An attitude counts as held after its error has stayed below HELD (deg) for WHILE (s).
HELD, WHILE = 10.0, 60.0
FULL = 0.01  # share of the time at their limit above which wheels are reported as full
# option of a manager that lets the attitude go while the craft turns fast
BRAKES = "velocity_dumping"


@dataclass(frozen=True)
class HealthParts(Parts):
    """Series and components that the health check needs.

    `attitude` has the attitude and the reference that it follows.
    """

    # those that a component reads and that do not fail at once by the scenario
    sensors: tuple[str, ...] = ()
    attitude: tuple[str, str] | None = None
    wheels: str | None = None


PARTS = HealthParts


def applies(system: System) -> HealthParts | None:
    """Find the parts that the health check needs, or None without any."""
    read = {source for source, _ in system.read}
    of_roles = role_classes()
    sensors = tuple(
        c.name
        for c in system.components.values()
        if c.name in read
        and getattr(of_roles.get(c.interface.role), "is_sensor", False)
        and "valid" in c.interface.arrays
        and not _fails_at_once(system, c.name)
    )
    wheels = next(
        (
            c.name
            for c in system.components.values()
            if c.interface.role == "wheels" and "saturated_wheel" in c.interface.arrays
        ),
        None,
    )
    parts = HealthParts(sensors, _attitude(system), wheels)
    return parts if parts != HealthParts() else None


def _fails_at_once(system: System, name: str) -> bool:
    """Return whether a sensor fails before its first measurement."""
    since = system.components[name].values.get("fail_time", -1.0)
    return bool(0.0 <= since <= system.start)


def _attitude(system: System) -> tuple[str, str] | None:
    """Return the series of attitude and reference where a controller follows it.

    None where no enabled controller does, or a manager brakes the craft first (paper
    004, section 4).
    """
    parts = system.components.values()
    if any(BRAKES in c.interface.signals and c.values[BRAKES] for c in parts):
        return None
    crafts = [
        c
        for c in system.components.values()
        if c.interface.role == "spacecraft" and "omega_bi_body" in c.interface.arrays
    ]
    for target, c in system.by_input["q_ref_bi"].items():
        follower = system.components[target]
        if follower.interface.role != "controller" or len(crafts) != 1:
            continue
        if "enable" in follower.interface.signals and not follower.values["enable"]:
            continue
        return f"{crafts[0].name}.q_bi", c.series
    return None


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """Return no numbers: scenarios and roles have theirs."""
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each sensor that was never valid, and for a lost attitude."""
    parts: HealthParts = manifest.parts[KEY]
    if not manifest.completed:
        return []
    lines = []
    for name, valid, codes, meaning in _sensors(parts, results):
        lines += describe_dead_sensor(name, valid, codes, meaning)
    attitude = _attitude_series(parts, results)
    return lines if attitude is None else lines + describe_lost_attitude(*attitude)


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each full wheel, rarely valid sensor and missed attitude."""
    parts: HealthParts = manifest.parts[KEY]
    series, lines = f"{parts.wheels}.saturated_wheel", []
    if series in set(results.names()) and len(full := results.values(series)):
        lines += describe_full_wheels(str(parts.wheels), full)
    for name, valid, codes, meaning in _sensors(parts, results):
        lines += describe_rare_sensor(name, valid, codes, meaning)
    attitude = _attitude_series(parts, results)
    return lines if attitude is None else lines + describe_missed_attitude(*attitude)


def _sensors(
    parts: HealthParts, results: Results
) -> Iterator[tuple[str, Array, Array, str]]:
    """Yield name, `valid`, `lost_to` and what its codes mean of each recorded sensor."""
    there = set(results.names())
    for name in parts.sensors:
        if f"{name}.valid" not in there or not len(results.values(f"{name}.valid")):
            continue
        codes, meaning = np.empty(0), ""
        if (lost_to := f"{name}.lost_to") in there:
            codes = results.values(lost_to)
            meaning = results.attribute(lost_to, "description")
        yield name, results.values(f"{name}.valid"), codes, meaning


def _attitude_series(
    parts: HealthParts, results: Results
) -> tuple[Array, Array, Array] | None:
    """Return times (s), attitude and reference (rows, 4) alike; None if not recorded."""
    recorded = set(results.names())
    if parts.attitude is None or not set(parts.attitude) <= recorded:
        return None
    attitude, held = parts.attitude
    q = results.series(attitude)
    reference = results.series(wanted_attitude(held, recorded))
    count = min(len(q), len(reference))
    return results.times(), q.head(count), reference.head(count)


# --- Lines from series, which a live page makes by the same functions -----------------


def describe_full_wheels(name: str, saturated: Array) -> list[str]:
    """Return a line for each wheel that is saturated for a share of the time."""
    shares = saturated.reshape(len(saturated), -1).mean(axis=0)
    lines: list[str] = []
    for i, share in enumerate(shares):
        if share > FULL:
            lines = [
                *lines,
                f"{name}: wheel {i + 1} was at its speed limit for {100.0 * share:.3g} % "
                "of the run",
            ]
    return lines


def describe_dead_sensor(
    name: str, valid: Array, codes: Array, meaning: str
) -> list[str]:
    """Return a line if a sensor was never valid, with the most frequent reason."""
    if valid.any():
        return []
    return [f"{name}: it was never valid{describe_reason(codes, meaning)}"]


def describe_rare_sensor(
    name: str, valid: Array, codes: Array, meaning: str
) -> list[str]:
    """Return a line if a sensor was valid, but rarely, with the most frequent reason."""
    share = float(valid.astype(float).mean())
    if share == 0.0 or share >= SELDOM:
        return []
    reason = describe_reason(codes, meaning)
    return [f"{name}: it was valid in {100.0 * share:.2g} % of the run{reason}"]


def describe_reason(codes: Array, meaning: str) -> str:
    """Return the most frequent code why a sensor is not valid; "" without codes."""
    if len(codes) == 0:
        return ""
    most = int(np.bincount(np.ravel(np.maximum(codes.astype(int), 0))).argmax())
    return f" (lost_to = {most} most often: {meaning})"


def compute_attitude_error(
    times: Array, q: Array, reference: Array
) -> tuple[float, float]:
    """Compute rms attitude error (deg) in the second half, and the longest time held (s).

    An attitude is held while its error is below `HELD`. Both are 0 for less than two
    rows.
    """
    count = len(q)
    if count < 2:
        return 0.0, 0.0
    error = pointing(q, reference)
    away = np.flatnonzero(np.append(error >= HELD, True))
    begins = np.append(0, away[:-1] + 1)
    ends = times[np.minimum(away, count - 1)]
    spans = ends - times[np.minimum(begins, count - 1)]
    late = error[count // 2 :]
    return float(np.sqrt((late**2).mean())), float(spans.max())


def describe_lost_attitude(times: Array, q: Array, reference: Array) -> list[str]:
    """Return a line if an attitude that had been held was lost."""
    error, held = compute_attitude_error(times, q, reference)
    if error <= ATTITUDE_LOST_DEG or held < WHILE:
        return []
    return [
        f"the attitude was lost: {error:.3g} deg from its reference, rms in the "
        "second half of the run"
    ]


def describe_missed_attitude(times: Array, q: Array, reference: Array) -> list[str]:
    """Return a line if an attitude was never held, though there was time for it."""
    error, held = compute_attitude_error(times, q, reference)
    is_short = times[-1] - times[0] < TIME
    if error <= ATTITUDE_LOST_DEG or held >= WHILE or is_short:
        return []
    return [
        f"the attitude never stayed within {HELD:g} deg of its reference for "
        f"{WHILE:g} s: {error:.3g} deg rms in the second half of the run"
    ]
