"""What a run would record, before it begins: is there anything, is there room for it, and can the
components be saved."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from math import inf
from pathlib import Path

from fmpy import read_model_description

from ..engine.recording.results import selects
from ..files import library
from ..system.errors import nearest
from ..system.interface import KINDS, base_name
from ..system.model import System
from ..system.options import Options

_BYTES = {"Real": 8, "Integer": 4, "Boolean": 4}


def problems(system: System, options: Options) -> Iterator[str]:
    """A line for each pattern that no output fits, and for rows too rare to be any."""
    outputs = [(c.name, s) for c in system.components.values() for s in c.interface.of("output")]
    for pattern in options.record:
        if pattern != "*" and not any(selects([pattern], name, signal) for name, signal in outputs):
            known = {f"{name}.{base_name(s.name)}" for name, s in outputs}
            yield f"--record {pattern}: no output fits{nearest(pattern, known)}"
    for name, signal in outputs:
        text = base_name(signal.name)
        if not (text.isprintable() and text.strip(". ") and "/" not in text) and any(
            selects([pattern], name, signal) for pattern in options.record
        ):
            yield f"{system.where}: {name}: the output {text!r} has no name that can be recorded"
    if options.every > system.steps:
        yield f"--every {options.every}: the run has {system.steps} steps"


def not_saved(system: System, options: Options) -> Iterator[str]:
    """A line for each component whose state cannot be saved, where checkpoints are wanted."""
    if options.checkpoint is None:
        return
    if not 0.0 < options.checkpoint < inf:
        yield f"--checkpoint {options.checkpoint:g}: a time above 0 s is needed"
    for c in system.components.values():
        if c.fmu is None:
            continue
        of = read_model_description(library.load(c.fmu).folder).coSimulation
        if not (of.canGetAndSetFMUstate and of.canSerializeFMUstate):
            yield (f"--checkpoint: {c.name}: {c.fmu.name} cannot save its state "
                   "(canGetAndSetFMUstate, canSerializeFMUstate)")  # fmt: skip


def not_halved(system: System, options: Options) -> Iterator[str]:
    """A line for each foreign FMU whose steps cannot be halved, where that is wanted."""
    foreign = [c for c in system.components.values() if c.fmu and not c.interface.role]
    if options.halvings and not foreign:
        yield "--halve: it has no effect without a foreign FMU"
    for c in foreign if options.halvings else ():
        assert c.fmu is not None
        of = read_model_description(library.load(c.fmu).folder).coSimulation
        if not (of.canGetAndSetFMUstate and of.canHandleVariableCommunicationStepSize):
            yield (f"--halve: {c.name}: {c.fmu.name} cannot step anew with another length "
                   "(canGetAndSetFMUstate, canHandleVariableCommunicationStepSize)")  # fmt: skip


def size(system: System, options: Options) -> int:
    """What the series of a run to its stop time take (bytes)."""
    row = 8 + sum(
        _BYTES[s.kind]
        for c in system.components.values() for s in c.interface.of("output")
        if s.kind in KINDS and selects(options.record, c.name, s)
    )  # fmt: skip
    return row * (system.steps // options.every + 1)


def room(system: System, options: Options, folder: Path) -> str:
    """What to say where the series may not fit on the disk of a folder; else nothing."""
    while not folder.exists():
        folder = folder.parent
    needed, disk = size(system, options), shutil.disk_usage(folder)
    if needed < (free := disk.free) or not disk.total:  # no size: no disk
        return ""
    return (f"the series may take {needed / 1e9:.3g} GB, {free / 1e9:.3g} GB are free in {folder}: "
            "record less (--record, --every)")  # fmt: skip
