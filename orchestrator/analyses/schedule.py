"""Scheduled firings that a run does not see to their end."""

from __future__ import annotations

from typing import Any

from ..system.model import Component, System
from ..system.parameters import value_of

START, DURATION = "schedule_start", "schedule_duration"


def warnings(system: System) -> list[str]:
    """A line for each firing that begins in the run and lasts beyond it."""
    lines = []
    for component in system.components.values():
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


def _values(component: Component, name: str) -> list[Any]:
    return [value_of(component, s.name) for s in component.interface.elements(name)]
