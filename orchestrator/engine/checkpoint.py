"""Checkpoints of a run: all that its next step depends on, to go on from with the same
bits.

`checkpoints/K.npz` of a run folder, K the step that is next: the states of the
components as FMI serialises them, the arrays of the master that outlive a step, how
many rows of the series are on the disk, and what the caller wants to find again, as
JSON. A file is written under another name, synchronised with the disk, and renamed; the
two newest are kept, and the newest whole one counts.
"""

from __future__ import annotations

import json
import os
import shutil
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..system.errors import DesatError
from ..system.typed import JsonObject
from .current_call import RESTORE, SAVE, time, word
from .ending import Ending
from .instances.base import Array
from .master import Master
from .recording.recorder import Recorder

FOLDER = "checkpoints"
KEPT = 2


@dataclass(frozen=True)
class Checkpoint:
    """One that was read: what was saved at the beginning of step k."""

    path: Path
    k: int
    rows: int
    """Rows of the series until then."""
    ending: JsonObject
    messages: dict[str, list[str]]
    """What each component had logged."""
    about: JsonObject
    """What the caller wanted to find again."""
    arrays: dict[str, Array]
    states: dict[str, bytes]

    def restore(self, master: Master, ending: Ending) -> None:
        """Put it back into an initialised master. Raises DesatError for one of another
        system."""
        memory = master.memory()
        shapes = {name: (a.shape, a.dtype) for name, a in memory.items()}
        if shapes != {name: (a.shape, a.dtype) for name, a in self.arrays.items()} or (
            master.members.keys() != self.states.keys()
        ):
            raise DesatError(f"{self.path}: it is of another system")
        for name, values in memory.items():
            values[:] = self.arrays[name]
        master.k = self.k
        for name, member in master.members.items():
            word[0] = member.instance.place + RESTORE
            member.instance.restore(self.states[name])
            member.instance.messages[:] = self.messages[name]
        word[0] = 0
        ending.memory.clear()
        ending.memory.update(self.ending)


class Checkpoints:
    """Writes those of a run, one every `every` steps; `tell` gives what the caller
    wants saved."""

    def __init__(
        self,
        folder: Path,
        every: int,
        master: Master,
        recorder: Recorder,
        ending: Ending,
        tell: Callable[[], Mapping[str, Any]],
    ) -> None:
        self._folder, self.every = folder / FOLDER, every
        self._master, self._recorder, self._ending, self._tell = (
            master,
            recorder,
            ending,
            tell,
        )
        self._folder.mkdir(exist_ok=True)

    def next(self, k: int) -> int:
        """The step before which the one after that of step k is due."""
        return (k // self.every + 1) * self.every

    def due(self) -> bool:
        """Whether one is due now."""
        return self._master.k % self.every == 0

    def save(self) -> None:
        """Write one. Raises ComponentError where a component does not give its state."""
        master, states = self._master, _states(self._master)
        memory = master.memory()
        head = {
            "k": master.k,
            "rows": self._recorder.on_disk(),
            "ending": self._ending.memory,
            "messages": {n: m.instance.messages for n, m in master.members.items()},
            "about": dict(self._tell()),
            "arrays": list(memory),
            "states": list(states),
        }
        blobs = [json.dumps(head).encode(), *states.values()]
        path = self._folder / f"{master.k:012}.npz"
        part = path.with_suffix(".part")
        with part.open("wb") as file:
            np.savez(
                file,
                *memory.values(),
                **{f"_{i}": _bytes(b) for i, b in enumerate(blobs)},  # type: ignore[arg-type]
            )
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        _synchronise(self._folder)
        for old in _checkpoints(self._folder)[KEPT:]:
            old.unlink(missing_ok=True)


def _states(master: Master) -> dict[str, bytes]:
    """The state of each component. Raises ComponentError where it cannot be had."""
    time[0], saved = master.t, {}
    for name, member in master.members.items():
        word[0] = member.instance.place + SAVE
        saved[name] = member.instance.save()
    word[0] = 0
    return saved


def remove(folder: Path) -> None:
    """Remove those of a run folder."""
    shutil.rmtree(folder / FOLDER, ignore_errors=True)


def newest(folder: Path) -> Checkpoint | None:
    """The newest whole checkpoint of a run folder."""
    for path in _checkpoints(folder / FOLDER):
        try:
            return _load(path)
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            continue  # it is not whole; the one before it is
    return None


def _checkpoints(folder: Path) -> list[Path]:
    """Those of a folder, the newest first."""
    return sorted((p for p in folder.glob("*.npz") if p.is_file()), reverse=True)


def _load(path: Path) -> Checkpoint:
    with path.open("rb") as opened, np.load(opened, allow_pickle=False) as file:
        head = json.loads(file["_0"].tobytes())
        arrays = {name: file[f"arr_{i}"] for i, name in enumerate(head["arrays"])}
        states = {
            name: file[f"_{i + 1}"].tobytes() for i, name in enumerate(head["states"])
        }
    return Checkpoint(
        path,
        int(head["k"]),
        int(head["rows"]),
        head["ending"],
        head["messages"],
        head["about"],
        arrays,
        states,
    )


def _bytes(data: bytes) -> Array:
    return np.frombuffer(data, np.uint8)


def _synchronise(folder: Path) -> None:
    """The names in a folder are on the disk."""
    if os.name == "posix":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
