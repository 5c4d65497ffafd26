"""Build FMUs from a user's own block file.

They are built once and stored in the user's cache by the contents of the file.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock

from desat.fmus.compiler import NoCompilerError
from desat.fmus.own import OwnBlockError, is_own

from ..system.errors import DesatError
from . import paths

__all__ = ["Built", "build", "folder_of", "is_own"]


@dataclass(frozen=True)
class Built:
    """FMUs of a block file."""

    python: Path
    native: Path | None
    fmi3: Path | None  # the native one as FMI 3.0
    reason: str  # why there is no native one; otherwise empty


def folder() -> Path:
    """Return the folder with the FMUs of users' own block files.

    It has a folder for the contents of each file.
    """
    return paths.cache() / "own"


def folder_of(fmu: Path) -> Path | None:
    """Return the folder with all FMUs of a block file, given one of them.

    The result is None for any other FMU.
    """
    parent = fmu.parent.parent if fmu.parent.name in ("native", "fmi3") else fmu.parent
    return parent if parent.parent == folder() else None


def build(file: Path, platforms: str = "") -> Built:
    """Return the FMUs of a block file, which are built if necessary.

    The native one is for `platforms` (`fmus/native.py`, `targets_of`).

    Raises
    ------
    DesatError
        If the file holds no block, or it cannot be built.
    """
    from desat.fmus import (
        build,
        native,
    )  # slow imports, needed only for a user's own block

    try:
        if platforms:
            native.targets_of(platforms)
        digest = build.made_of(str(file), platforms)
    except (OwnBlockError, NoCompilerError, ValueError) as error:
        raise DesatError(str(error)) from error
    target = folder() / digest[:20]
    if not target.is_dir():
        target.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(target.with_suffix(".lock")):
            if not target.is_dir():
                _build(file, target, platforms)
    entries = {
        e["kind"]: e
        for e in json.loads((target / build.INDEX).read_text(encoding="utf-8"))
    }
    of_c, third = (
        target / entries[kind]["file"] if kind in entries else None
        for kind in ("native", "fmi3")
    )
    return Built(
        target / entries["python"]["file"],
        of_c,
        third,
        entries["python"].get("why", ""),
    )


def _build(file: Path, target: Path, platforms: str) -> None:
    """Build the FMUs of a block file into a folder, as a whole."""
    from desat.fmus.build import INDEX

    part = target.with_suffix(".part")
    shutil.rmtree(part, ignore_errors=True)  # left by a process that was killed
    temporary = part / "temporary"  # of the build and of its compiler
    temporary.mkdir(parents=True)
    try:
        # a separate process, because building spawns others, which need an importable
        # script
        build_process = subprocess.run(
            [
                sys.executable,
                "-m",
                "desat.fmus.build",
                "--into",
                str(part),
                "--platforms",
                platforms,
                str(file),
            ],
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "TMPDIR": str(temporary)},
        )
        if build_process.returncode:
            last = (build_process.stderr.strip().splitlines() or ["no message"])[-1]
            raise DesatError(last.removeprefix("error: "))
        if not (part / INDEX).exists():
            raise DesatError(
                f"{file}: it ended the process that builds it, with code 0, before an FMU "
                "was written: a block file must not exit when it is imported"
            )
        shutil.rmtree(temporary)
        part.replace(target)
    finally:
        shutil.rmtree(part, ignore_errors=True)
