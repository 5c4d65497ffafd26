"""Decide which components of a run get processes of their own."""

from __future__ import annotations

from collections.abc import Iterator

from ..engine.instances.isolated import CAN
from ..system.model import System
from ..system.options import Options


def to_isolate(system: System, options: Options) -> frozenset[str]:
    """Return the components for which the options require a process."""
    if options.isolate == "none":
        return frozenset()
    return frozenset(
        c.name
        for c in system.components.values()
        if c.fmu is not None and (options.isolate == "all" or not c.fmu.ours)
    )


def isolated_in(system: System, options: Options) -> frozenset[str]:
    """Return the components that get a process: all required ones, on POSIX."""
    return to_isolate(system, options) if CAN else frozenset()


def isolation_problems(system: System, options: Options) -> Iterator[str]:
    """Yield a line if all components need a process each, and none can have one."""
    if options.isolate != "all":
        return
    if not CAN:
        yield "--isolate all: it needs processes that can be forked (POSIX)"
    elif not to_isolate(system, options):
        yield "--isolate all: it has no effect without an FMU"


def isolation_warnings(system: System, options: Options) -> Iterator[str]:
    """Yield a line if foreign FMUs run in the process of the run, as they have to."""
    if CAN or options.isolate != "foreign":
        return
    if names := sorted(to_isolate(system, options)):
        yield (
            f"{', '.join(names)}: foreign FMUs run in the process of the run, which they may "
            "end: a process each needs POSIX"
        )
