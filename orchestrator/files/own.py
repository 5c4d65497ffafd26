"""A block file of the user's own as FMUs: built once, kept in the user's cache by its
contents."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
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
    """The FMUs of a block file."""

    python: Path
    native: Path | None
    fmi3: Path | None
    """The native one as FMI 3.0."""
    why: str
    """Why there is no native one; else nothing."""


def folder() -> Path:
    """Where the FMUs of users' own block files are, a folder a file's contents."""
    return paths.cache() / "own"


def folder_of(fmu: Path) -> Path | None:
    """The folder with the FMUs of a block file that one of them is of; None for any
    other FMU."""
    parent = fmu.parent.parent if fmu.parent.name in ("native", "fmi3") else fmu.parent
    return parent if parent.parent == folder() else None


def build(file: Path, platforms: str = "") -> Built:
    """The FMUs of a block file, built now where they are not yet; the native one for
    `platforms` (`fmus/native.py`, `targets_of`). Raises DesatError where the file holds
    no block, or it cannot be built."""
    from desat.fmus import build, native  # heavy, and only for who brings a block

    try:
        if platforms:
            native.targets_of(platforms)
        digest = build.made_of(str(file), platforms)
    except (OwnBlockError, NoCompilerError, ValueError) as error:
        raise DesatError(str(error)) from error
    where = folder() / digest[:20]
    if not where.is_dir():
        where.parent.mkdir(parents=True, exist_ok=True)
        with FileLock(where.with_suffix(".lock")):
            if not where.is_dir():
                _build(file, where, platforms)
    said = {
        e["kind"]: e
        for e in json.loads((where / build.INDEX).read_text(encoding="utf-8"))
    }
    of_c, third = (
        where / said[kind]["file"] if kind in said else None
        for kind in ("native", "fmi3")
    )
    return Built(
        where / said["python"]["file"], of_c, third, said["python"].get("why", "")
    )


def _build(file: Path, where: Path, platforms: str) -> None:
    part = Path(tempfile.mkdtemp(suffix=".part", dir=where.parent))
    try:
        # a process of its own: building spawns others, which need a script that can be
        # imported
        done = subprocess.run(
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
        )
        if done.returncode:
            last = (done.stderr.strip().splitlines() or ["no message"])[-1]
            raise DesatError(last.removeprefix("error: "))
        part.replace(where)
    finally:
        shutil.rmtree(part, ignore_errors=True)
