"""Going on with a run that was ended, from its newest checkpoint: the same bits as without a break.

Series, numbers and manifest are then those of a run that was never ended, but for wall times.
"""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

from ..engine.checkpoint import FOLDER, Checkpoint, newest
from ..engine.recording.results import MANIFEST
from ..system.errors import DesatError
from ..system.options import Options, as_asked
from .manifest import read_manifest
from .run import Run, load_run, prepare, simulate


def has_checkpoints(folder: Path) -> bool:
    """Whether a run folder is one to go on with."""
    return (folder / FOLDER).is_dir()


def options_of(folder: Path) -> Options:
    """The options of a run with checkpoints. Raises DesatError where there is none."""
    return as_asked(_newest(folder).told)


def _newest(folder: Path) -> Checkpoint:
    if (checkpoint := newest(folder)) is None:
        if (folder / MANIFEST).exists() and read_manifest(folder)["status"] == "completed":
            raise DesatError(f"{folder}: it has completed")
        raise DesatError(f"{folder}: it has no checkpoint; `desat run --checkpoint` writes them")
    return checkpoint


def resume(folder: Path, progress: bool = False) -> Run:
    """Go on with a run in its folder, an absolute path; one that has completed is loaded.

    Raises DesatError where there is no checkpoint, or where what it was made of has changed.
    """
    if (folder / MANIFEST).exists():
        run = load_run(folder)
        if run.ok:
            return run
        run.results.close()
    checkpoint = _newest(folder)
    target, options = checkpoint.told["target"], as_asked(checkpoint.told)
    try:
        with chdir(checkpoint.told["from"]):
            return simulate(prepare(target, options), folder, progress, checkpoint)
    except OSError as error:
        if error.filename == checkpoint.told["from"]:
            raise DesatError(f"{error.filename}: {error.strerror}: the run began there") from error
        raise
