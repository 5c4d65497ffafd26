"""Check firings of thrusters.

Scheduled firings may outlast the run or exceed the wheels, a force may be wired to an
orbit that it does not move, and commands may never fire.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..numbers.derived import by_rows
from ..numbers.measures import largest_elements
from ..numbers.text import Value
from ..system.model import Component, System
from . import Parts
from .manifest import Manifest

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[Any]

KEY = "firings"
NUMBERS = ()
# commanded impulse below this share of a wheel's largest momentum is ignored
COUNTS = 0.01
MOST = 0.5  # a fired share of the command about an axis below this gives a warning
START, DURATION, TORQUE = "schedule_start", "schedule_duration", "schedule_tau_body"
LIMIT = "torque_limit"
INPUT, OPTION = "force_mean_thruster_body", "firings"


@dataclass(frozen=True)
class FiringParts(Parts):
    """Components that command and fire, and the craft."""

    manager: str
    thrusters: str
    spacecraft: str
    # whether there are scheduled firings, too, which the torque includes
    scheduled: bool


PARTS = FiringParts


def applies(system: System) -> FiringParts | None:
    """Find the parts by the connections, or None without commanded thrusters.

    The craft must have wheels.
    """
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
    """Return no numbers: those of firings belong to the file of the roles."""
    return {}


def unmet(manifest: Manifest, results: Results) -> list[str]:
    """Return a line if thrusters are commanded and never fire."""
    series = _series(manifest, results)
    parts: FiringParts = manifest.parts[KEY]
    return [] if series is None else describe_silence(parts.thrusters, *series)


def remarks(manifest: Manifest, results: Results) -> list[str]:
    """Return a line for an empty tank, or for each axis with little impulse fired."""
    series, parts = _series(manifest, results), manifest.parts[KEY]
    if series is None or parts.scheduled:
        return []
    tank = manifest.values_of(parts.thrusters).get("tank", 0.0)
    spent = f"{parts.thrusters}.propellant"
    used = results.series(spent) if spent in results.names() else np.zeros(1)
    return describe_firings(parts.thrusters, tank, used, *series)


def series_of(parts: FiringParts) -> tuple[str, str, str, str]:
    """Return the series of command, torque, on-time and momentum of the wheels."""
    return (
        f"{parts.manager}.tau_cmd_thruster_body",
        f"{parts.thrusters}.tau_mean_thruster_body",
        f"{parts.thrusters}.on_time",
        f"{parts.spacecraft}.h_copy_wheel",
    )


def _series(manifest: Manifest, results: Results) -> tuple[Array, ...] | None:
    """Return times (s) and the series of `series_of`; None if not recorded."""
    names = series_of(manifest.parts[KEY])
    if not set(names) <= set(results.names()):
        return None
    return results.times(), *(results.series(n) for n in names)


# --- Lines from series, which a live page makes by the same functions -----------------


def describe_silence(
    name: str, times: Array, command: Array, torque: Array, on_time: Array, h: Array
) -> list[str]:
    """Return a line if thrusters are commanded and never fire."""
    if not has_rows(times, command, on_time) or float(on_time[-1]) > 0.0:
        return []
    commanded = sum_commands(times, command, h)
    if not commanded.any():
        return []
    return [
        f"{name}: commanded {commanded.sum():.3g} N m s, never fired: on-times "
        "below half of least_pulse, or below least_on_time, are left out"
    ]


def describe_firings(
    name: str,
    tank: float,
    used: Array,
    times: Array,
    command: Array,
    torque: Array,
    on_time: Array,
    h: Array,
) -> list[str]:
    """Return a line for an empty tank, or for each axis with little impulse fired.

    It is little if most of the commanded impulse is not fired. `used` is the propellant
    used until each row (kg), of a `tank` (kg; 0: without an end).
    """
    if not has_rows(times, command, on_time) or float(on_time[-1]) == 0.0:
        return []
    full = tank * (1.0 - 1e-9)
    if tank > 0.0 and float(used[-1]) >= full:
        empty = float(times[int(np.argmax(np.asarray(used).reshape(-1) >= full))])
        return [
            f"{name}: its tank of {tank:g} kg is empty from {empty:g} s on, and "
            "fires nothing more"
        ]
    commanded = sum_commands(times, command, h)
    delivered = sum_impulses(times, torque)
    lines: list[str] = []
    for i, axis in enumerate(["x", "y", "z"]):
        if delivered[i] < MOST * commanded[i]:
            lines = [
                *lines,
                f"{name}: commanded {commanded[i]:.3g} N m s about {axis}, fired "
                f"{delivered[i]:.3g}: shorter on-times than it can give are left out",
            ]
    return lines


def has_rows(times: Array, command: Array, on_time: Array) -> bool:
    """Return whether there are enough rows to sum firings."""
    return len(on_time) > 0 and len(command) > 0 and len(times) > 1


def sum_impulses(times: Array, torque: Array) -> Array:
    """Compute the impulse (3,; N m s) of torques (rows, 3; N m), each sign counted."""
    steps = np.append(np.diff(times), times[-1] - times[-2])[: len(torque), None]
    impulses: Array = impulse_sizes(torque, steps).sum(axis=0)
    return impulses


@by_rows(2)
def impulse_sizes(torque: Array, steps: Array) -> Array:
    """Compute the sizes (rows, 3; N m s) of impulses of torques over steps (rows, 1)."""
    return np.asarray(np.abs(torque * steps))


def sum_commands(times: Array, command: Array, h: Array) -> Array:
    """Compute the commanded impulse (3,; N m s), 0 where it is too small to count."""
    commanded = sum_impulses(times, command)
    counted: Array = commanded * (commanded > COUNTS * float(largest_elements(h).max()))
    return counted


def warnings(system: System) -> list[str]:
    """Return a line for each warning about the firings of a system."""
    return [*_unmoved(system), *_scheduled(system)]


def _scheduled(system: System) -> list[str]:
    """Return a line for each scheduled firing that outlasts the run or exceeds a limit.

    The limit is that of a manager with feed-forward which has to cancel the torque.
    """
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
    """Return a line for each scheduled torque above the torque limit of a manager."""
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
    """Return a line for each component that receives the force without moving by it.

    Its model lacks the option, or the option is off.
    """
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
