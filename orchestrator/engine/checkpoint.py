"""Save and restore checkpoints of a run, from which it continues with the same bits.

`checkpoints/K.npz` of a run folder, where K is the next step, holds the states of the
components as FMI serialises them, the arrays of the master that outlive a step, the
number of rows of the series on disk, and the caller's own data as JSON. A file is
written under another name, synchronised with the disk, and renamed. The two newest
files are kept, and the newest complete one is used.
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
STORED_CHECKPOINTS = 2


@dataclass(frozen=True)
class Checkpoint:
    """A checkpoint that was read, of the beginning of step k."""

    path: Path
    k: int
    rows: int  # rows of the series until then
    ending: JsonObject
    messages: dict[str, list[str]]  # logged by each component
    counts: dict[str, dict[str, int]]  # how often each of them was
    about: JsonObject  # the caller's own data
    arrays: dict[str, Array]
    states: dict[str, bytes]

    def restore(self, master: Master, ending: Ending) -> None:
        """Restore the checkpoint into an initialised master.

        Raises
        ------
        DesatError
            If the checkpoint is of another system.
        """
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
            member.instance.counts.update(self.counts.get(name, {}))
        word[0] = 0
        ending.memory.clear()
        ending.memory.update(self.ending)


class Checkpoints:
    """Writer of a run's checkpoints, one every `every` steps.

    `tell` returns the data that the caller wants to save.
    """

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
        """Return the step before which the next checkpoint after step k is due."""
        return (k // self.every + 1) * self.every

    def due(self) -> bool:
        """Return whether a checkpoint is due now."""
        return self._master.k % self.every == 0

    def save(self) -> None:
        """Write a checkpoint.

        Raises ComponentError if a component does not provide its state.
        """
        master, states = self._master, _states(self._master)
        memory = master.memory()
        head = {
            "k": master.k,
            "rows": self._recorder.on_disk(),
            "ending": self._ending.memory,
            "messages": {n: m.instance.messages for n, m in master.members.items()},
            "counts": {n: m.instance.counts for n, m in master.members.items()},
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
        for old in _checkpoints(self._folder)[STORED_CHECKPOINTS:]:
            old.unlink(missing_ok=True)


def _states(master: Master) -> dict[str, bytes]:
    """Return the state of each component.

    Raises ComponentError if one cannot be had.
    """
    time[0], saved = master.t, {}
    for name, member in master.members.items():
        word[0] = member.instance.place + SAVE
        saved[name] = member.instance.save()
    word[0] = 0
    return saved


def remove(folder: Path) -> None:
    """Remove the checkpoints of a run folder."""
    shutil.rmtree(folder / FOLDER, ignore_errors=True)


def newest(folder: Path) -> Checkpoint | None:
    """Find the newest complete checkpoint of a run folder."""
    for path in _checkpoints(folder / FOLDER):
        try:
            return _load(path)
        except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
            continue  # it is incomplete; the one before it is not
    return None


def _checkpoints(folder: Path) -> list[Path]:
    """Return the checkpoints of a folder, the newest first."""
    return sorted((p for p in folder.glob("*.npz") if p.is_file()), reverse=True)


def _load(path: Path) -> Checkpoint:
    """Read a checkpoint."""
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
        head.get("counts", {}),
        head["about"],
        arrays,
        states,
    )


def _bytes(data: bytes) -> Array:
    """Return data as an array of bytes."""
    return np.frombuffer(data, np.uint8)


def _synchronise(folder: Path) -> None:
    """Force the names in a folder to disk."""
    if os.name == "posix":
        number = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(number)
        finally:
            os.close(number)
