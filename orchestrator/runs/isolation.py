"""Which components run in processes of their own, and what to say where there can be none."""

from __future__ import annotations

from collections.abc import Iterator

from ..engine.instances.isolated import CAN
from ..files import library
from ..system.model import System
from ..system.options import Options


def wanted(system: System, options: Options) -> frozenset[str]:
    """The components for which the options ask for a process."""
    if options.isolate == "none":
        return frozenset()
    return frozenset(
        c.name for c in system.components.values()
        if c.fmu is not None and (options.isolate == "all" or not library.is_ours(c.fmu))
    )  # fmt: skip


def isolated(system: System, options: Options) -> frozenset[str]:
    """Those that get one: all that are wanted, on POSIX."""
    return wanted(system, options) if CAN else frozenset()


def problems(system: System, options: Options) -> Iterator[str]:
    """A line where all are to have a process each, and none can."""
    if options.isolate != "all":
        return
    if not CAN:
        yield "--isolate all: it needs processes that can be forked (POSIX)"
    elif not wanted(system, options):
        yield "--isolate all: it has no effect without an FMU"


def warnings(system: System, options: Options) -> Iterator[str]:
    """A line where foreign FMUs are to have a process each, and none can."""
    if not CAN and options.isolate == "foreign" and (names := sorted(wanted(system, options))):
        yield (f"{', '.join(names)}: foreign FMUs run in the process of the run, which they may "
               "end: a process each needs POSIX")  # fmt: skip
