"""Write a craft of a user's own, once its scenarios are found sound."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from desat.components.contract.block import BlockError

from ..analyses.flight import fly_days, wanted_attitude
from ..begin import craft
from ..begin.craft import NewCraft
from ..begin.facts import CraftFacts
from ..files import io
from ..files.paths import shown
from ..system.errors import DesatError
from ..system.model import System
from ..system.options import Options
from .checking import check
from .prepare import resolved


def write_craft(
    folder: Path, facts: CraftFacts, command: str, force: bool = False
) -> tuple[NewCraft, list[str]]:
    """Write the folder of a craft that `desat check` finds sound.

    The sign of a residual dipole, of which only the size is known, is the one with which
    it adds to the other torques.

    Returns
    -------
    written
        The files, and the figures that were assumed.
    warnings
        Those of `desat check` on the nominal scenario, a line each.

    Raises
    ------
    DesatError
        If the folder exists and `force` is not set, a fact is impossible, or the craft
        cannot fly; then nothing is written.
    """
    craft.check_folder(folder, force)
    with TemporaryDirectory() as place:
        draft = Path(place) / folder.absolute().name
        files_written = craft.write(draft, facts, command)
        if _dipole_opposes(resolved(str(draft), Options())[0]):
            files_written = craft.write(
                draft, facts, command, force=True, dipole_sign=-1.0
            )
        checked = check(str(draft), Options())
        if checked.problems:
            text = "\n".join(checked.problems)
            raise DesatError(text.replace(str(draft), shown(folder)))
        files = _moved(files_written.files, folder)
    warnings = [x.replace(str(draft), shown(folder)) for x in checked.warnings]
    return NewCraft(files, files_written.assumptions), warnings


def _moved(drafts: tuple[Path, ...], folder: Path) -> tuple[Path, ...]:
    """Write copies of files into a folder; one that is new is removed if that fails."""
    fresh = not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    files = tuple(folder / draft.name for draft in drafts)
    try:
        for draft, file in zip(drafts, files, strict=True):
            io.replace_text(file, draft.read_text(encoding="utf-8"))
    except (OSError, DesatError):
        if fresh:
            for file in files:
                file.unlink(missing_ok=True)
            os.rmdir(folder)
        raise
    return files


def _dipole_opposes(system: System) -> bool:
    """Return whether the residual dipole's secular torque opposes that of the others.

    False where there is no dipole, or the attitude is not known without a run.
    """
    spacecraft = system.roles["spacecraft"]
    if not any(spacecraft.values.get("residual_dipole_body", (0.0,))):
        return False
    try:
        flight = fly_days(system, wanted_attitude(system))
    except (DesatError, BlockError):
        return False
    impulses = {name: x[-1] - x[0] for name, x in flight.sources.items()}
    dipole = impulses.pop("residual dipole")
    others = np.sum(list(impulses.values()), axis=0)
    return bool(dipole @ others < 0.0)
