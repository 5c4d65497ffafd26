"""Initialise components on trial, for `desat check`, to find what our own FMUs refuse.

Rules that need all parameters of a component are in its start, so that only
initialisation applies them. Our FMUs, recognised by their hash, and those of a list of
trusted ones are initialised together, in a separate process. For other FMUs only the
description is read, and none of their code is loaded.
"""

from __future__ import annotations

from dataclasses import replace

from ..files import library
from ..system.errors import DesatError
from ..system.model import System
from ..system.schedule import Schedule
from . import child
from .instances.base import EndedError

TIMEOUT = 60.0  # s: limit of each call of a component during the trial


def refusals(
    system: System, schedule: Schedule, trusted: frozenset[str] | None = None
) -> tuple[list[str], list[str]]:
    """Find what the components of a checked system refuse at initialisation.

    Return problems and warnings, a line each. Warnings are for components that were
    tried without the outputs of a foreign FMU that they need. `trusted` holds the
    sha256 of FMUs that may run besides ours.
    """
    fmus = {n: c.fmu for n, c in system.components.items() if c.fmu is not None}
    if not fmus:
        return _initialised(system, schedule), []
    ours = {n for n, fmu in fmus.items() if fmu.ours or fmu.sha256 in (trusted or ())}
    if not ours:
        return [], []
    # initial outputs of a foreign FMU are unknown here, and so are all values after them
    blind = {
        c.target
        for c in system.connections
        if c.source not in ours
        and schedule.classes.get((c.source, c.output)) != "interval"
    }
    while more := {c.target for c in system.connections if c.source in blind} - blind:
        blind |= more
    part = _part(system, ours)
    library.unpack(part)
    lines = _in_a_process(part, _part_of(schedule, ours))
    unsure = [line for line in lines if line.partition(":")[0] in blind]
    return (
        [line for line in lines if line not in unsure],
        [
            f"{line} (tried without the foreign FMUs that it depends on)"
            for line in unsure
        ],
    )


def _part(system: System, names: set[str]) -> System:
    """Return the components of these names and the connections between them."""
    components = {n: c for n, c in system.components.items() if n in names}
    connections = tuple(c for c in system.connections if {c.source, c.target} <= names)
    return replace(system, components=components, connections=connections, about=None)


def _part_of(schedule: Schedule, names: set[str]) -> Schedule:
    """Return the schedule of the components of these names."""
    return replace(
        schedule,
        order=tuple(n for n in schedule.order if n in names),
        timing=(),
        loops=tuple(loop for loop in schedule.loops if names.issuperset(loop)),
        start_loops=tuple(
            loop for loop in schedule.start_loops if names.issuperset(loop)
        ),
    )


def _in_a_process(system: System, schedule: Schedule) -> list[str]:
    """Initialise the components in a separate process and return the refusals."""
    if not child.CAN:
        return _initialised(system, schedule)
    library.unpack(system)
    try:
        return child.apart(
            lambda: _initialised(system, schedule), schedule.order, TIMEOUT
        )
    except EndedError as error:
        return [f"{system.place}: {error}"]


def _initialised(system: System, schedule: Schedule) -> list[str]:
    """Initialise the components in this process and return the refusals."""
    from .master import Master

    try:
        with Master(system, schedule, watched=lambda c, s: False) as master:
            master.initialise()
    except DesatError as error:
        return str(error).splitlines()
    return []
