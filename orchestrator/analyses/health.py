"""Whether a run went well whatever its scenario requires: sensors that never measured, an attitude
that was lost, wheels that were full."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..engine.recording.results import Results
from ..numbers.derived import pointing
from ..numbers.text import Value
from ..system.model import System
from ..system.parameters import number_of, value_of
from . import Parts as Named
from .manifest import Manifest

KEY = "health"
NUMBERS = ()
LOST = 30.0
"""An attitude whose error is above this (deg), rms over the second half of a run, is lost."""
FULL = 0.01
"""Of the time: wheels at their limit for longer are said to be full."""
_SENSORS = ("determination", "gyro", "magnetometer", "star_tracker", "sun_sensor", "tachometers")


@dataclass(frozen=True)
class Parts(Named):
    """What is looked at; `attitude`: the attitude and the reference that it is to follow."""

    sensors: tuple[str, ...] = ()
    """that somebody reads and that no scenario has fail at once"""
    attitude: tuple[str, str] | None = None
    wheels: str | None = None


def applies(system: System) -> Parts | None:
    """What of a system can go wrong; None: nothing that is known of."""
    read = {c.source for c in system.connections}
    sensors = tuple(
        c.name for c in system.components.values()
        if c.interface.role in _SENSORS and c.name in read and c.interface.elements("valid")
        and not _fails_at_once(system, c.name)
    )  # fmt: skip
    wheels = next((c.name for c in system.components.values()
                   if c.interface.role == "wheels" and c.interface.elements("saturated_wheel")),
                  None)  # fmt: skip
    found = Parts(sensors, _attitude(system), wheels)
    return found if found != Parts() else None


def _fails_at_once(system: System, name: str) -> bool:
    """Whether a scenario has a sensor fail before its first measurement."""
    component = system.components[name]
    if "fail_time" not in component.interface.signals:
        return False
    return 0.0 <= number_of(component, "fail_time") <= system.start


def _attitude(system: System) -> tuple[str, str] | None:
    """The attitude of the craft and the reference that a controller which is on follows; None:
    nobody controls it so."""
    crafts = [
        c
        for c in system.components.values()
        if c.interface.role == "spacecraft" and c.interface.elements("omega_bi_body")
    ]
    for c in system.connections:
        follower = system.components[c.target]
        if c.input != "q_ref_bi[1]" or follower.interface.role != "controller" or len(crafts) != 1:
            continue
        if "enable" in follower.interface.signals and not value_of(follower, "enable"):
            continue
        return f"{crafts[0].name}.q_bi", f"{c.source}.{c.output.partition('[')[0]}"
    return None


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """None of its own: scenarios and roles have theirs."""
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """A line for each sensor that was never valid, and one for an attitude that was lost."""
    parts: Parts = manifest.parts[KEY]
    if not manifest.completed:
        return []
    there, lines = set(results.names()), []
    for name in parts.sensors:
        series = f"{name}.valid"
        if series in there and len(valid := results.values(series)) and not valid.any():
            lines.append(f"{name}: it was never valid{_reason(manifest, results, name)}")
    if parts.attitude is not None and set(parts.attitude) <= there:
        error = _error(results, parts.attitude)
        if len(error) and error[-1] > LOST and (rms := float(np.sqrt((error**2).mean()))) > LOST:
            lines.append(f"the attitude was lost: {rms:.3g} deg from its reference, rms in the "
                         "second half of the run")  # fmt: skip
    return lines


def _reason(manifest: Manifest, results: Results, name: str) -> str:
    """What a sensor says of why it is not valid, most often; empty where it says nothing."""
    series = f"{name}.lost_to"
    if series not in set(results.names()) or not len(codes := results.values(series)):
        return ""
    most = int(np.bincount(np.maximum(codes.astype(int), 0)).argmax())
    return f" (lost_to = {most} most often: {results.attribute(series, 'description')})"


def _error(results: Results, attitude: tuple[str, str]) -> Any:
    """The error (deg) at the rows of the second half."""
    q, reference = (results.values(s) for s in attitude)
    count = min(len(q), len(reference))
    half = slice(count // 2, count)
    return pointing(q[half], reference[half])


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """A line for wheels that were full."""
    parts: Parts = manifest.parts[KEY]
    series = f"{parts.wheels}.saturated_wheel"
    if series not in set(results.names()) or not len(full := results.values(series)):
        return []
    share = np.atleast_2d(full.astype(float).T).mean(axis=1)
    return [f"{parts.wheels}: wheel {i + 1} was at its speed limit for {100.0 * x:.3g} % of the run"
            for i, x in enumerate(share) if x > FULL]  # fmt: skip
