"""Where scenarios, FMUs, packed systems and stored draws are: in a checkout and in an
installation.

In a checkout all is in its folders: ssp/, fmus/dist/, ssp/dist/, docs/papers/. An
installation brings scenarios, pages and draws below the package and keeps what it
builds, FMUs and packed systems, in the user's cache, in a folder named after version
and contents of what they are made of; nothing is written beside the package. What
`desat list` has found is in the user's cache, too, in `lists`. `DESAT_CACHE` names
another folder than the user's usual one; who has none that he can write gets one below
the temporary folder.
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from functools import cache as memoised
from pathlib import Path

from ..system.errors import DesatError

PACKAGE = Path(__file__).resolve().parents[1]
INSTALLED = (PACKAGE / "ssp").is_dir()
"""True where the package has its scenarios inside: it comes from a wheel."""

SCENARIOS = PACKAGE / "ssp" if INSTALLED else PACKAGE.parent / "ssp"
PAGES = PACKAGE / "docs" if INSTALLED else PACKAGE.parent / "docs"
DRAWS = PAGES / "papers"

NOMINAL = "nominal.toml"
"""The scenario of a craft's folder that its name stands for."""
_TEMPORARY = "desat-cache-"


def fmus() -> Path:
    """The folder with our FMUs. In an installation they are built now where they are
    not yet, by one process at a time; raises DesatError where that fails. In a checkout
    `make fmus` builds."""
    return _build() if INSTALLED else PACKAGE.parent / "fmus" / "dist"


def are_built() -> bool:
    """Whether `fmus` is there without being built now."""
    return not INSTALLED or (_cache() / "fmus").is_dir()


def packed_folder() -> Path:
    """The folder where `desat pack` puts its .ssp files."""
    return _cache() / "ssp" if INSTALLED else SCENARIOS / "dist"


def writable(what: str, instead: str = "") -> None:
    """Raise DesatError in an installation, whose scenarios are not to be written;
    `instead`: the option that writes elsewhere."""
    if INSTALLED:
        hint = f"; {instead} writes elsewhere" if instead else ""
        raise DesatError(
            f"{what} writes beside the scenarios and needs a checkout of desat; this "
            f"is an installation, {PACKAGE}{hint}"
        )


def shown(path: Path) -> str:
    """A file's name for people: from our folder on where it is in it, else as it is."""
    home = SCENARIOS.parent
    return path.relative_to(home).as_posix() if path.is_relative_to(home) else str(path)


def cache() -> Path:
    """The folder of desat in the user's cache; for a user who can write none, a
    temporary one."""
    if given := os.environ.get("DESAT_CACHE"):
        return Path(given).absolute()
    return _users()


def user() -> int:
    """The user's number; 0 where there is none (Windows)."""
    return os.getuid() if sys.platform != "win32" else 0


def _users() -> Path:
    from platformdirs import user_cache_path

    usual = user_cache_path("desat", appauthor=False).absolute()
    there = next((p for p in (usual, *usual.parents) if p.exists()), usual)
    if sys.platform == "win32" or (
        there.is_dir() and os.access(there, os.W_OK | os.X_OK)
    ):
        return usual
    own = Path(tempfile.gettempdir()) / f"{_TEMPORARY}{user()}"
    with suppress(OSError):
        own.mkdir(mode=0o700, exist_ok=True)
        state = own.lstat()
        # code is loaded from there: it must be this user's alone
        if (
            stat.S_ISDIR(state.st_mode)
            and state.st_uid == user()
            and not state.st_mode & 0o77
        ):
            return own
    return usual


def no_home() -> bool:
    """Whether the user has no folder of his own that he can write caches into."""
    return cache().name == f"{_TEMPORARY}{user()}"


@memoised
def _cache() -> Path:
    """The folder of this version and these contents in the user's cache."""
    import hashlib
    from importlib.metadata import version

    digest = hashlib.sha256(version("pythonfmu").encode())
    for file in _sources():
        digest.update(f"\0{file.relative_to(PACKAGE)}\0".encode() + file.read_bytes())
    return cache() / f"{version('desat')}-{digest.hexdigest()[:16]}"


def _sources() -> Iterable[Path]:
    """All that FMUs and packed systems are made of."""
    rooms = ("components", "export", "files", "fmus", "language", "ssp", "system")
    folders = (PACKAGE / name for name in rooms)
    return sorted(
        p
        for folder in folders
        for p in folder.rglob("*")
        if p.is_file() and p.suffix not in (".pyc", ".fmu", ".ssp")
    )


@memoised
def _build() -> Path:
    """The folder of the FMUs, which is there as a whole or not at all."""
    import shutil
    import subprocess

    from filelock import FileLock

    folder = _cache() / "fmus"
    if folder.is_dir():
        return folder
    folder.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(folder.with_suffix(".lock")):
        if folder.is_dir():
            return folder
        part = Path(tempfile.mkdtemp(prefix="fmus-", suffix=".part", dir=folder.parent))
        try:
            if sys.stderr.isatty():
                print(f"building the FMUs, this once, into {folder}", file=sys.stderr)
            # a process of its own: building spawns others, which need a script that can
            # be imported
            done = subprocess.run(
                [sys.executable, "-m", "desat.fmus.build", "--into", str(part)],
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode:
                last = (done.stderr.strip().splitlines() or ["no message"])[-1]
                raise DesatError(f"{folder}: our FMUs could not be built: {last}")
            part.replace(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    return folder
