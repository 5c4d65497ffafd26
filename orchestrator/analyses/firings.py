"""Firings of thrusters: scheduled ones that a run does not see to their end or that wheels cannot
take, and a force that is wired to an orbit which it does not move."""

from __future__ import annotations

from typing import Any

from ..system.model import Component, System
from ..system.parameters import value_of

START, DURATION, TORQUE = "schedule_start", "schedule_duration", "schedule_tau_body"
LIMIT = "torque_limit"
INPUT, OPTION = "force_mean_thruster_body", "firings"


def warnings(system: System) -> list[str]:
    """What to beware of in the firings of a system, a line each."""
    return [*_unmoved(system), *_scheduled(system)]


def _scheduled(system: System) -> list[str]:
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


def _unmoved(system: System) -> list[str]:
    """A line for each component that is given the force and has not the option, or has it off."""
    wired = dict.fromkeys(
        c.target for c in system.connections if c.input.partition("[")[0] == INPUT
    )  # fmt: skip
    lines = []
    for name in wired:
        component = system.components[name]
        if OPTION not in component.interface.signals:
            lines.append(f"{name}.{INPUT}: {component.source} has no {OPTION}; its orbit does not "
                         "move by it (environment_propagated's does)")  # fmt: skip
        elif not value_of(component, OPTION):
            lines.append(f"{name}.{INPUT}: {name}.{OPTION} is false, so the orbit does not move by "
                         "it")  # fmt: skip
    return lines
