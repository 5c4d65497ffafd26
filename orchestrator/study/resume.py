"""Going on with a run that was ended, from its newest checkpoint: the same bits as without a break.

Series, numbers and manifest are then those of a run that was never ended, but for wall times.
"""

from __future__ import annotations

from contextlib import chdir
from pathlib import Path

from ..engine.checkpoint import FOLDER, newest
from ..engine.results import MANIFEST
from ..system.errors import DesatError
from .case import Run, load_run, prepare, simulate
from .options import Options, as_asked


def has_checkpoints(folder: Path) -> bool:
    """Whether a run folder is one to go on with."""
    return (folder / FOLDER).is_dir()


def options_of(folder: Path) -> tuple[str, Options]:
    """The target and the options of a run with checkpoints. Raises DesatError where there is
    none."""
    if (checkpoint := newest(folder)) is None:
        raise DesatError(f"{folder}: it has no checkpoint; `desat run --checkpoint` writes them")
    return checkpoint.told["target"], as_asked(checkpoint.told)


def resume(folder: Path, progress: bool = False) -> Run:
    """Go on with a run; one that has completed is loaded. Raises DesatError where there is no
    checkpoint, or where what it was made of has changed."""
    folder = folder.absolute()
    if not has_checkpoints(folder) and (folder / MANIFEST).exists():
        run = load_run(folder)
        if run.ok:
            return run
        run.results.close()
    target, options = options_of(folder)
    checkpoint = newest(folder)
    assert checkpoint is not None
    try:
        with chdir(checkpoint.told["from"]):
            case = prepare(target, options)
            case.or_raise()
            return simulate(case, folder, progress, checkpoint)
    except OSError as error:
        if error.filename == checkpoint.told["from"]:
            raise DesatError(f"{error.filename}: {error.strerror}: the run began there") from error
        raise
