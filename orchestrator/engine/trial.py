"""A trial of the initialisation, for `desat check`: what our own FMUs refuse.

Rules that need all of a component's parameters live in its start, so only initialising tells. Our
FMUs, told by their hash, and those of a list of trusted ones are initialised together, in a process
of their own; of others only the description is read, and nothing of theirs is loaded.
"""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

from ..files import library, trust
from ..system.errors import DesatError
from ..system.model import System
from ..system.schedule import Schedule

TIMEOUT = 60.0
"""Of the process that initialises (s)."""


def refusals(
    system: System, schedule: Schedule, trusted: frozenset[str] | None = None
) -> tuple[list[str], list[str]]:
    """What the components of a checked system refuse when they are initialised, a line each:
    problems, and warnings for those that were tried without the outputs of a foreign FMU that
    they need. `trusted`: the sha256 of FMUs that may run besides ours."""
    files = {n: c.fmu for n, c in system.components.items() if c.fmu is not None}
    if not files:
        return _initialised(system, schedule), []
    ours = {n: library.load(file).folder for n, file in files.items() if trust.runs(file, trusted)}
    if not ours:
        return [], []
    # what a foreign FMU shows at the start is not known here, nor what follows from it
    blind = {
        c.target for c in system.connections
        if c.source not in ours and schedule.classes.get((c.source, c.output)) != "interval"
    }  # fmt: skip
    while more := {c.target for c in system.connections if c.source in blind} - blind:
        blind |= more
    lines = _in_a_process(_part(system, ours), _part_of(schedule, set(ours)))
    unsure = [line for line in lines if line.partition(":")[0] in blind]
    return (
        [line for line in lines if line not in unsure],
        [f"{line} (tried without the foreign FMUs that it depends on)" for line in unsure],
    )


def _part(system: System, folders: dict[str, Path]) -> System:
    """The components that have these extracted folders, and what connects them."""
    components = {n: replace(system.components[n], fmu=folder) for n, folder in folders.items()}
    connections = tuple(c for c in system.connections if {c.source, c.target} <= set(folders))
    return replace(system, components=components, connections=connections, about={})


def _part_of(schedule: Schedule, names: set[str]) -> Schedule:
    return replace(schedule, order=tuple(n for n in schedule.order if n in names), timing=())


def _in_a_process(system: System, schedule: Schedule) -> list[str]:
    command = [sys.executable, "-m", __name__]
    try:
        done = subprocess.run(
            command, input=pickle.dumps((system, schedule)), capture_output=True, timeout=TIMEOUT,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return [f"{system.where}: initialising our FMUs takes longer than {TIMEOUT:g} s"]
    try:
        lines: list[str] = json.loads(done.stdout)
        return lines
    except ValueError:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        why = f"signal {-done.returncode}" if done.returncode < 0 else f"exit {done.returncode}"
        return [
            f"{system.where}: the process that initialised our FMUs crashed ({why})"
            + (f": {said[-1]}" if said else "")
        ]


def _initialised(system: System, schedule: Schedule) -> list[str]:
    from .master import Master

    try:
        with Master(system, schedule, watched=lambda c, s: False) as master:
            master.initialise()
    except DesatError as error:
        return str(error).splitlines()
    return []


def main() -> None:
    """The process: a system and its schedule on stdin, the refusals on stdout, as JSON."""
    result = os.dup(1)
    os.dup2(2, 1)  # what an FMU prints is no result
    system, schedule = pickle.load(sys.stdin.buffer)
    os.write(result, json.dumps(_initialised(system, schedule)).encode())
    os._exit(0)  # the interpreters within have nothing to say any more


if __name__ == "__main__":
    main()
