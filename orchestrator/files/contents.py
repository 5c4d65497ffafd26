"""What a file holds, read within limits: regular files alone, none larger than allowed, and, of a
system that others have made, none outside its folder."""

from __future__ import annotations

import os
import stat
from pathlib import Path, PurePosixPath, PureWindowsPath

from ..system.errors import DesatError

TEXT = 64 << 20
"""The largest text that is read (bytes)."""


def contents(path: Path, where: str, most: int = TEXT) -> bytes:
    """The bytes of a regular file, which messages call `where`.

    Raises DesatError where there is none, it holds more than `most` bytes, or it is something that
    may never end (a device, a pipe).
    """
    try:
        regular(path, where)
        # a pipe put there meanwhile does not keep us waiting
        with os.fdopen(os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb") as file:
            data = file.read(most + 1)
    except FileNotFoundError as error:
        raise DesatError(f"{where}: no such file") from error
    except OSError as error:
        raise DesatError(f"{where}: {error.strerror}") from error
    if len(data) > most:
        raise DesatError(f"{where}: larger than {most >> 20} MiB")
    return data


def regular(path: Path, where: str) -> None:
    """Raise DesatError, or OSError where there is nothing, unless a path is a regular file."""
    if not stat.S_ISREG(path.stat().st_mode):
        raise DesatError(f"{where}: not a regular file")


def inside(folder: Path, source: str) -> Path:
    """The path of what a system in a folder names, which need not be there.

    Links are followed: an archive has none, and in a folder they are its owner's. Raises DesatError
    for an absolute path and one that leaves the folder.
    """
    parts = PurePosixPath(source).parts
    strange = "\\" in source or "\0" in source or PureWindowsPath(source).drive
    if not parts or strange or ".." in parts or source.startswith("/"):
        raise DesatError(f"{source[:80]!r} is outside the folder of the system")
    path = folder / source
    try:
        path.exists()
    except OSError as error:  # a name that is too long, a loop of links
        raise DesatError(f"{source[:80]!r}: {error.strerror}") from error
    return path
