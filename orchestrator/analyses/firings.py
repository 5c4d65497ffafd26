"""Firings of thrusters: scheduled ones that a run does not see to their end or that
wheels cannot take, a force that is wired to an orbit which it does not move, and
commands that never fire."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..numbers.text import Value
from ..system.model import Component, System
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

KEY = "firings"
NUMBERS = ()
COUNTS = 0.01
"""From this share of the largest momentum of a wheel on commanded impulse counts."""
MOST = 0.5
"""Of what is commanded about an axis, no more than this share is fired: a warning."""
START, DURATION, TORQUE = "schedule_start", "schedule_duration", "schedule_tau_body"
LIMIT = "torque_limit"
INPUT, OPTION = "force_mean_thruster_body", "firings"


@dataclass(frozen=True)
class FiringParts(Parts):
    """Who commands, who fires, and whose momentum it is."""

    manager: str
    thrusters: str
    spacecraft: str
    scheduled: bool
    """whether firings are scheduled beside, which the torque holds, too"""


PARTS = FiringParts


def applies(system: System) -> FiringParts | None:
    """By the connections; None where nobody commands thrusters of a craft with wheels."""
    for thrusters, wire in system.by_input["tau_cmd_thruster_body"].items():
        manager, of = wire.source, system.components[thrusters]
        body = system.takers.get((thrusters, "tau_mean_thruster_body"))
        if (
            body is None
            or "h_copy_wheel" not in system.components[body].interface.arrays
        ):
            continue
        if "on_time" in of.interface.arrays:
            times = of.values.get(DURATION, ())
            return FiringParts(manager, thrusters, body, any(times))
    return None


def numbers(manifest: Manifest, results: Results) -> dict[str, Value]:
    """None: what fires has its numbers in the roles' file."""
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """A line where thrusters are commanded and never fire."""
    impulses = _impulses(manifest, results)
    if impulses is None or impulses[2] > 0.0 or not any(impulses[0]):
        return []
    parts: FiringParts = manifest.parts[KEY]
    return [
        f"{parts.thrusters}: commanded {np.sum(impulses[0]):.3g} N m s, never fired: on-times "
        "below half of least_pulse, or below least_on_time, are left out"
    ]


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """A line for a tank that is empty, else for each axis about which most of what is
    commanded is not fired."""
    impulses, parts = _impulses(manifest, results), manifest.parts[KEY]
    if impulses is None or impulses[2] == 0.0 or parts.scheduled:
        return []
    commanded, given, _ = impulses
    tank = manifest.values_of(parts.thrusters).get("tank", 0.0)
    spent = f"{parts.thrusters}.propellant"
    if tank > 0.0 and spent in results.names():
        used, times = results.values(spent), results.times()
        if used[-1] >= tank * (1.0 - 1e-9):
            empty = float(times[int(np.argmax(used >= tank * (1.0 - 1e-9)))])
            return [
                f"{parts.thrusters}: its tank of {tank:g} kg is empty from {empty:g} s on, and "
                "fires nothing more"
            ]
    return [
        f"{parts.thrusters}: commanded {commanded[i]:.3g} N m s about {axis}, fired "
        f"{given[i]:.3g}: shorter on-times than it can give are left out"
        for i, axis in enumerate("xyz")
        if given[i] < MOST * commanded[i]
    ]


def _impulses(
    manifest: Manifest, results: Results
) -> tuple[list[float], list[float], float] | None:
    """What was commanded and what was given about each axis (N m s; 0 where too little
    was commanded to count), and the time on (s); None where it is not recorded."""
    parts: FiringParts = manifest.parts[KEY]
    names = (
        f"{parts.manager}.tau_cmd_thruster_body",
        f"{parts.thrusters}.tau_mean_thruster_body",
        f"{parts.thrusters}.on_time",
        f"{parts.spacecraft}.h_copy_wheel",
    )
    if not set(names) <= set(results.names()):
        return None
    command, torque, on_time, h = (results.values(n) for n in names)
    times = results.times()
    if not len(on_time) or len(times) < 2 or not len(command):
        return None
    steps = np.append(np.diff(times), times[-1] - times[-2])
    commanded, given = (
        np.abs(x * steps[: len(x), None]).sum(axis=0) for x in (command, torque)
    )
    counts = commanded > COUNTS * float(np.abs(h).max())
    return (commanded * counts).tolist(), given.tolist(), float(on_time[-1])


def warnings(system: System) -> list[str]:
    """What to beware of in the firings of a system, a line each."""
    return [*_unmoved(system), *_scheduled(system)]


def _scheduled(system: System) -> list[str]:
    """A line for each firing that begins in the run and lasts beyond it, and for each
    torque that a manager with feed-forward is to cancel and its limit does not let
    it."""
    lines = []
    for component in system.components.values():
        if component.interface.arrays.keys() >= {TORQUE, LIMIT}:
            lines += _too_strong(component)
        if "tau_mean_thruster_body[1]" not in component.interface.signals:
            continue
        values = component.values
        times = zip(values.get(START, ()), values.get(DURATION, ()), strict=True)
        for i, (start, duration) in enumerate(times, 1):
            if duration > 0.0 and start < system.stop < start + duration:
                lines.append(
                    f"{component.name}.{DURATION}[{i}] = {duration:g} s from {start:g} s on: it "
                    f"lasts beyond the run's end at {system.stop:g} s, of which at most "
                    f"{system.stop - start:g} s are flown"
                )
    return lines


def _too_strong(component: Component) -> list[str]:
    most = component.values[component.interface.arrays[LIMIT][0].name]
    durations = component.values.get(DURATION, ())
    names = [s.name for s in component.interface.arrays[TORQUE]]
    lines = []
    for k, torque in enumerate(component.values[TORQUE]):
        if durations[k // 3] > 0.0 and abs(torque) > most:
            lines.append(
                f"{component.name}.{names[k]} = {torque:g} N m: more than {LIMIT} = {most:g} "
                "N m; flown saturated where there is a wheel"
            )
    return lines


def _unmoved(system: System) -> list[str]:
    """A line for each component that is given the force and has not the option, or has
    it off."""
    lines = []
    for name in system.by_input[INPUT]:
        component = system.components[name]
        if OPTION not in component.interface.signals:
            lines.append(
                f"{name}.{INPUT}: {component.source} has no {OPTION}; its orbit does not "
                "move by it (environment_propagated's does)"
            )
        elif not component.values[OPTION]:
            lines.append(
                f"{name}.{INPUT}: {name}.{OPTION} is false, so the orbit does not move by "
                "it"
            )
    return lines
