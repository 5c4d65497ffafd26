"""Locate scenarios, FMUs, packed systems and stored draws.

A checkout has all of them in its folders: ssp/, fmus/dist/, ssp/dist/, docs/papers/. An
installation has scenarios, pages and draws below the package. It stores what it builds,
FMUs and packed systems, in the user's cache, in a folder named after version and
contents of their sources; nothing is written beside the package. What `desat list` has
found is in the user's cache, too, in `lists`. `DESAT_CACHE` names another folder than
the user's usual one. A user without a writable cache gets one below the temporary
folder.
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
# Whether the package contains its scenarios, as it does if installed from a wheel.
INSTALLED = (PACKAGE / "ssp").is_dir()

SCENARIOS = PACKAGE / "ssp" if INSTALLED else PACKAGE.parent / "ssp"
PAGES = PACKAGE / "docs" if INSTALLED else PACKAGE.parent / "docs"
DRAWS = PAGES / "papers"

NOMINAL = "nominal.toml"  # the scenario for which the name of a craft's folder stands
_TEMPORARY = "desat-cache-"


def fmus() -> Path:
    """Return the folder with our FMUs.

    In an installation they are built now if necessary, by one process at a time. In a
    checkout `make fmus` builds them.

    Raises
    ------
    DesatError
        If they cannot be built.
    """
    return _build() if INSTALLED else PACKAGE.parent / "fmus" / "dist"


def are_built() -> bool:
    """Return whether `fmus` exists without being built now."""
    return not INSTALLED or (_cache() / "fmus").is_dir()


def packed_folder() -> Path:
    """Return the folder to which `desat pack` writes its .ssp files."""
    return _cache() / "ssp" if INSTALLED else SCENARIOS / "dist"


def writable(purpose: str, instead: str = "") -> None:
    """Raise DesatError in an installation, whose scenarios must not be written.

    `instead` is the option that writes elsewhere.
    """
    if INSTALLED:
        hint = f"; {instead} writes elsewhere" if instead else ""
        raise DesatError(
            f"{purpose} writes beside the scenarios and needs a checkout of desat; this "
            f"is an installation, {PACKAGE}{hint}"
        )


def shown(path: Path) -> str:
    """Return a file's name for people.

    It is relative to our folder if the file is in it, and otherwise unchanged.
    """
    home = SCENARIOS.parent
    return path.relative_to(home).as_posix() if path.is_relative_to(home) else str(path)


def cache() -> Path:
    """Return the folder of desat in the user's cache.

    It is a temporary folder for a user who cannot write any.
    """
    if path := os.environ.get("DESAT_CACHE"):
        return Path(path).absolute()
    return _users()


def user() -> int:
    """Return the user's number; 0 if there is none (Windows)."""
    return os.getuid() if sys.platform != "win32" else 0


def _users() -> Path:
    """Return the user's usual cache folder, or a private temporary one."""
    from platformdirs import user_cache_path

    usual = user_cache_path("desat", appauthor=False).absolute()
    there = next((p for p in (usual, *usual.parents) if p.exists()), usual)
    if sys.platform == "win32" or (
        there.is_dir() and os.access(there, os.W_OK | os.X_OK)
    ):
        return usual
    temporary = Path(tempfile.gettempdir()) / f"{_TEMPORARY}{user()}"
    with suppress(OSError):
        temporary.mkdir(mode=0o700, exist_ok=True)
        state = temporary.lstat()
        # code is loaded from there, so only this user may have access
        if (
            stat.S_ISDIR(state.st_mode)
            and state.st_uid == user()
            and not state.st_mode & 0o77
        ):
            return temporary
    return usual


def no_home() -> bool:
    """Return whether the user has no writable folder of their own for caches."""
    return cache().name == f"{_TEMPORARY}{user()}"


@memoised
def _cache() -> Path:
    """Return the folder of this version and these contents in the user's cache."""
    import hashlib
    from importlib.metadata import version

    digest = hashlib.sha256(version("pythonfmu").encode())
    for file in _sources():
        digest.update(f"\0{file.relative_to(PACKAGE)}\0".encode() + file.read_bytes())
    return cache() / f"{version('desat')}-{digest.hexdigest()[:16]}"


def _sources() -> Iterable[Path]:
    """Return all sources of FMUs and packed systems."""
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
    """Build the FMUs unless they exist, and return their folder.

    It exists as a whole or not at all.
    """
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
            # a separate process, because building spawns others, which need an importable
            # script
            build_process = subprocess.run(
                [sys.executable, "-m", "desat.fmus.build", "--into", str(part)],
                capture_output=True,
                text=True,
                check=False,
            )
            if build_process.returncode:
                last = (build_process.stderr.strip().splitlines() or ["no message"])[-1]
                raise DesatError(f"{folder}: our FMUs could not be built: {last}")
            part.replace(folder)
        finally:
            shutil.rmtree(part, ignore_errors=True)
    return folder
