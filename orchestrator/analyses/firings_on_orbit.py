"""A force of thrusters that is wired to an orbit which it does not move."""

from __future__ import annotations

from ..system.model import System
from ..system.parameters import value_of

INPUT, OPTION = "force_mean_thruster_body", "firings"


def warnings(system: System) -> list[str]:
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
