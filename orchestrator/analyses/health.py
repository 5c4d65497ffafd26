"""Whether a run went well whatever its scenario requires: sensors that never measured,
an attitude that was lost, wheels that were full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..numbers.derived import pointing
from ..numbers.text import Value
from ..system.interface import role_classes
from ..system.model import System
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

KEY = "health"
NUMBERS = ()
LOST = 30.0
"""An attitude whose error is above this (deg), rms over the second half of a run, is
lost."""
SELDOM = 0.05
"""A sensor that is valid for less of the time is told of."""
TIME = 600.0
"""A run that lasts so long (s) has time to reach it."""
HELD, WHILE = 10.0, 60.0
"""One whose error stayed below this (deg) for so long (s) before had been held."""
FULL = 0.01
"""Of the time: wheels at their limit for longer are said to be full."""
BRAKES = "velocity_dumping"
"""A manager's option that lets the attitude go while the craft turns fast."""


@dataclass(frozen=True)
class HealthParts(Parts):
    """What is looked at; `attitude`: the attitude and the reference that it is to
    follow."""

    sensors: tuple[str, ...] = ()
    """that somebody reads and that no scenario has fail at once"""
    attitude: tuple[str, str] | None = None
    wheels: str | None = None


PARTS = HealthParts


def applies(system: System) -> HealthParts | None:
    """What of a system can go wrong; None: nothing that is known of."""
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
    """Whether a scenario has a sensor fail before its first measurement."""
    since = system.components[name].values.get("fail_time", -1.0)
    return bool(0.0 <= since <= system.start)


def _attitude(system: System) -> tuple[str, str] | None:
    """The attitude of the craft and the reference that a controller which is on
    follows; None: nobody controls it so, or a manager brakes the craft first (paper
    004, section 4)."""
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
    """None of its own: scenarios and roles have theirs."""
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """A line for each sensor that was never valid, and one for an attitude that was
    lost."""
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
    if error > LOST and held:
        lines.append(
            f"the attitude was lost: {error:.3g} deg from its reference, rms in the "
            "second half of the run"
        )
    return lines


def _reason(manifest: Manifest, results: Results, name: str) -> str:
    """What a sensor says of why it is not valid, most often; empty where it says
    nothing."""
    series = f"{name}.lost_to"
    if series not in set(results.names()) or not len(codes := results.values(series)):
        return ""
    most = int(np.bincount(np.maximum(codes.astype(int), 0)).argmax())
    return f" (lost_to = {most} most often: {results.attribute(series, 'description')})"


def _attitude_error(parts: HealthParts, results: Results) -> tuple[float, bool]:
    """The rms error of the attitude (deg) in the second half, and whether it had been
    held before; 0 where it is not known."""
    if parts.attitude is None or not set(parts.attitude) <= set(results.names()):
        return 0.0, False
    q, reference = (results.values(s) for s in parts.attitude)
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
    """A line for wheels that were full, for sensors that were seldom valid, and for an
    attitude that was never reached."""
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
    if error > LOST and not held and times[-1] - times[0] >= TIME:
        lines.append(
            f"the attitude never stayed within {HELD:g} deg of its reference for "
            f"{WHILE:g} s: {error:.3g} deg rms in the second half of the run"
        )
    return lines
