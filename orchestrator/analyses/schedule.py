"""Scheduled firings that a run does not see to their end, or that wheels cannot take."""

from __future__ import annotations

from typing import Any

from ..system.model import Component, System
from ..system.parameters import value_of

START, DURATION, TORQUE = "schedule_start", "schedule_duration", "schedule_tau_body"
LIMIT = "torque_limit"


def warnings(system: System) -> list[str]:
    """A line for each firing that begins in the run and lasts beyond it, and for each torque that
    a manager with feed-forward is to cancel and its limit does not let it."""
    lines = []
    for component in system.components.values():
        if component.interface.elements(TORQUE) and component.interface.elements(LIMIT):
            lines += _too_strong(component)
        if "tau_mean_thruster_body[1]" not in component.interface.signals:
            continue
        times = zip(_values(component, START), _values(component, DURATION), strict=True)
        for i, (start, duration) in enumerate(times, 1):
            if duration > 0.0 and start < system.stop < start + duration:
                lines.append(
                    f"{component.name}.{DURATION}[{i}] = {duration:g} s from {start:g} s on: it "
                    f"lasts beyond the run's end at {system.stop:g} s, of which at most "
                    f"{system.stop - start:g} s are flown"
                )
    return lines


def _too_strong(component: Component) -> list[str]:
    most, durations = _values(component, LIMIT)[0], _values(component, DURATION)
    names = [s.name for s in component.interface.elements(TORQUE)]
    lines = []
    for k, torque in enumerate(_values(component, TORQUE)):
        if durations[k // 3] > 0.0 and abs(torque) > most:
            lines.append(
                f"{component.name}.{names[k]} = {torque:g} N m: more than {LIMIT} = {most:g} "
                "N m; flown saturated where there is a wheel"
            )
    return lines


def _values(component: Component, name: str) -> list[Any]:
    return [value_of(component, s.name) for s in component.interface.elements(name)]
