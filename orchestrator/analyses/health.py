"""Check the health of a run, independent of the requirements of its scenario.

The checks are for sensors that never measured, an attitude that was lost, and full
wheels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..numbers.derived import pointing, wanted_attitude
from ..numbers.text import Value
from ..system.interface import role_classes
from ..system.model import System
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

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
    found = HealthParts(sensors, _attitude(system), wheels)
    return found if found != HealthParts() else None


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
    there, lines = set(results.names()), []
    for name in parts.sensors:
        series = f"{name}.valid"
        if series in there and len(valid := results.values(series)) and not valid.any():
            lines.append(
                f"{name}: it was never valid{_reason(manifest, results, name)}"
            )
    error, held = _attitude_error(parts, results)
    if error > ATTITUDE_LOST_DEG and held:
        lines.append(
            f"the attitude was lost: {error:.3g} deg from its reference, rms in the "
            "second half of the run"
        )
    return lines


def _reason(manifest: Manifest, results: Results, name: str) -> str:
    """Return the most frequent reason why a sensor is not valid, or ""."""
    series = f"{name}.lost_to"
    if series not in set(results.names()) or not len(codes := results.values(series)):
        return ""
    most = int(np.bincount(np.maximum(codes.astype(int), 0)).argmax())
    return f" (lost_to = {most} most often: {results.attribute(series, 'description')})"


def _attitude_error(parts: HealthParts, results: Results) -> tuple[float, bool]:
    """Compute the rms attitude error (deg) in the second half of the run.

    The second value is whether the attitude had been held. The error is 0 where it is
    not known.
    """
    recorded = set(results.names())
    if parts.attitude is None or not set(parts.attitude) <= recorded:
        return 0.0, False
    attitude, held = parts.attitude
    q, reference = (
        results.values(s) for s in (attitude, wanted_attitude(held, recorded))
    )
    count = min(len(q), len(reference))
    if count < 2:
        return 0.0, False
    error, times = pointing(q[:count], reference[:count]), results.times()[:count]
    away = np.flatnonzero(np.append(error >= HELD, True))
    begins = np.append(0, away[:-1] + 1)
    lasts = times[np.minimum(away, count - 1)] - times[np.minimum(begins, count - 1)]
    late = error[count // 2 :]
    return float(np.sqrt((late**2).mean())), bool((lasts >= WHILE).any())


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for each full wheel, rarely valid sensor and missed attitude."""
    parts: HealthParts = manifest.parts[KEY]
    series, lines = f"{parts.wheels}.saturated_wheel", []
    if series in set(results.names()) and len(full := results.values(series)):
        share = np.atleast_2d(full.astype(float).T).mean(axis=1)
        lines += [
            f"{parts.wheels}: wheel {i + 1} was at its speed limit for {100.0 * x:.3g} % of "
            "the run"
            for i, x in enumerate(share.tolist())
            if x > FULL
        ]
    for name in parts.sensors:
        there = f"{name}.valid" in set(results.names())
        valid = results.values(f"{name}.valid") if there else np.empty(0)
        if len(valid) and 0.0 < (share := float(valid.mean())) < SELDOM:
            lines.append(
                f"{name}: it was valid in {100.0 * share:.2g} % of the run"
                f"{_reason(manifest, results, name)}"
            )
    error, held = _attitude_error(parts, results)
    times = results.times()
    if error > ATTITUDE_LOST_DEG and not held and times[-1] - times[0] >= TIME:
        lines.append(
            f"the attitude never stayed within {HELD:g} deg of its reference for "
            f"{WHILE:g} s: {error:.3g} deg rms in the second half of the run"
        )
    return lines
