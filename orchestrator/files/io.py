"""Read and write files within limits; a file is written as a whole or not at all.

`replacing` writes each file that a command produces.
"""

from __future__ import annotations

import errno
import os
import re
import shutil
import stat
import sys
import time
import tomllib
import zipfile
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any, BinaryIO

from ..system.errors import DesatError, Exit, RunError
from . import paths

# Error numbers that mean that there is no room for a file.
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def is_full(error: BaseException | None) -> bool:
    """Return whether an error, or one of its causes, says that the disk is full."""
    seen: list[BaseException] = []  # an error may be its own cause
    while error is not None and error not in seen:
        if isinstance(error, OSError) and error.errno in FULL:
            return True
        seen.append(error)
        error = error.__cause__ or error.__context__
    return False


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Add the name of this file to an OSError that names none.

    An error of writing to a full disk names none.
    """
    try:
        yield
    except OSError as error:
        if error.filename is None:
            error.filename = str(path)
        raise


def place_of(path: Path, option: str = "") -> Path:
    """Return where to write a file that an option names.

    Links are followed and stay.

    Raises
    ------
    DesatError
        If there is something else than a regular file: a folder, a pipe, a device.
    """
    place = f"{option} {paths.shown(path)}".strip()
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise DesatError(
                f"{place}: not a regular file; nothing is written in its place"
            )
    except FileNotFoundError:
        pass
    except (OSError, ValueError) as error:  # a loop of links, or an invalid byte
        raise DesatError(
            f"{place}: {getattr(error, 'strerror', None) or error}"
        ) from error
    return Path(os.path.realpath(path))


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary name to write a file under, then rename it (`place_of`).

    Its folder is created. If that fails nothing is left of the file, and an OSError
    names it.
    """
    place = place_of(path)
    part = place.with_name(
        f"{place.name}.tmp"
    )  # `.part` is the suffix of a run in progress
    place.parent.mkdir(parents=True, exist_ok=True)
    try:
        with naming(path):
            yield part
        part.replace(place)
    except BaseException:
        part.unlink(missing_ok=True)
        raise


@contextmanager
def replacing_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to write that replaces another as a whole (`replacing`).

    It is for packages that accept no name that is not UTF-8.
    """
    with replacing(path) as part, part.open("wb") as file:
        yield file


def encoded(text: str) -> bytes:
    """Encode a text as UTF-8, even if it contains arbitrary file names.

    A name whose bytes Python could not read (a locale without UTF-8, or a name in
    another encoding) holds them as surrogates. Those that are UTF-8 are restored,
    others become U+FFFD.
    """
    try:
        return text.encode()
    except UnicodeEncodeError:
        readable = re.sub("[\ud800-\udc7f\udd00-\udfff]", "\ufffd", text)
        as_named = readable.encode("utf-8", "surrogateescape")
        return as_named.decode("utf-8", "replace").encode()


def utf8_name(name: str) -> str:
    """Convert a file's name to valid UTF-8, for names of systems."""
    return encoded(name).decode()


def replace_text(path: Path, content: str | bytes) -> None:
    """Write a file as a whole (`replacing`).

    Raises OSError if that fails.
    """
    with replacing(path) as part:
        part.write_bytes(encoded(content) if isinstance(content, str) else content)


# ------------------------------------------------------------------------------------------------
# Reading files within limits: only regular files, none larger than allowed, and, for a foreign
# system, none outside its folder


TEXT = 64 << 20  # bytes: upper bound of a text that is read


def contents(path: Path, place: str, most: int = TEXT) -> bytes:
    """Read the bytes of a regular file, which messages call `place`.

    Raises
    ------
    DesatError
        If there is none, if it holds more than `most` bytes, or if it is something that
        may never end (a device, a pipe).
    """
    try:
        regular(path, place)
        # non-blocking, in case a pipe has been put there meanwhile
        with os.fdopen(
            os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0)), "rb"
        ) as file:
            data = file.read(most + 1)
    except FileNotFoundError as error:
        raise DesatError(f"{place}: no such file") from error
    except OSError as error:
        raise DesatError(f"{place}: {error.strerror}") from error
    if len(data) > most:
        raise DesatError(f"{place}: larger than {most >> 20} MiB")
    return data


def regular(path: Path, place: str) -> None:
    """Raise DesatError unless a path is a regular file.

    If there is nothing at the path, OSError is raised.
    """
    if not stat.S_ISREG(path.stat().st_mode):
        raise DesatError(f"{place}: not a regular file")


def inside(folder: Path, source: str) -> Path:
    """Return the path of a file that a system in a folder names.

    It need not exist. Links are followed: an archive has none, and in a folder they are
    its owner's.

    Raises
    ------
    DesatError
        If the path is absolute or leaves the folder.
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


# --- Extracting foreign zip archives: within budgets, only regular files, nothing outside -------


ENTRIES = 20_000  # upper bound of the entries of an archive
LARGEST = 1 << 30  # bytes: upper bound of an archive, extracted
IN_ALL = 8 << 30  # bytes: upper bound of all archives that a process extracts
# Upper bound of the extracted size as a multiple of the file's, above SMALL bytes.
RATIO, SMALL = 200, 16 << 20
DEPTH = 32  # upper bound of nested folders
_extracted = 0


def extract(path: Path, folder: Path) -> None:
    """Extract an archive into a new folder.

    Raises
    ------
    DesatError
        If the file is no archive, exceeds a budget, or has an entry twice, or if an
        entry is no regular file or would leave the folder. The message names archive
        and entry.
    RunError
        If the disk is full.
    """
    global _extracted
    try:
        with zipfile.ZipFile(path) as archive:
            entries = _portable(archive.infolist())
            size = _check(path.name, path.stat().st_size, entries)
            if _extracted + size > IN_ALL:
                raise DesatError(
                    f"{path.name}: with the archives before it more than "
                    f"{IN_ALL >> 20} MiB extracted"
                )
            folder.mkdir(parents=True)
            if size > (free := shutil.disk_usage(folder).free):
                raise RunError(
                    f"{path.name}: {size >> 20} MiB extracted, {free >> 20} MiB are "
                    f"free in {folder.parent}",
                    Exit.SPACE,
                )
            for entry in entries:
                archive.extract(entry, folder)
            _extracted += size
    except DesatError:
        raise
    except Exception as error:  # zipfile raises many kinds
        shutil.rmtree(folder, ignore_errors=True)
        if is_full(error):
            reason = getattr(error, "strerror", None) or error
            raise RunError(
                f"{paths.shown(path)}: it cannot be extracted to {folder.parent} ({reason})",
                Exit.SPACE,
            ) from error
        raise DesatError(
            f"{paths.shown(path)}: not a readable archive ({error})"
        ) from error


def _portable(entries: list[zipfile.ZipInfo]) -> list[zipfile.ZipInfo]:
    """Write the names of entries as a zip archive should: with `/`, without `./`.

    The folder of the archive itself is left out.
    """
    for entry in entries:
        is_absolute = entry.filename.startswith(("/", "\\"))
        parts = [p for p in re.split(r"[/\\]", entry.filename) if p not in ("", ".")]
        is_folder = entry.filename.endswith(("/", "\\", "/.", "\\."))
        name = "/".join(parts) + ("/" if is_folder and parts else "")
        entry.filename = "/" + name if is_absolute else name
    return [entry for entry in entries if entry.filename not in ("", ".")]


def _check(name: str, file_size: int, entries: list[zipfile.ZipInfo]) -> int:
    """Check the entries of an archive and return their extracted size (bytes).

    Raises DesatError for what is not allowed.
    """
    if len(entries) > ENTRIES:
        raise DesatError(f"{name}: {len(entries)} entries; {ENTRIES} allowed")
    counts = Counter(e.filename for e in entries)
    if twice := [n for n, count in counts.items() if count > 1]:
        raise DesatError(f"{name}: holds {twice[0]} twice")
    for entry in entries:
        text, parts = entry.filename, PurePosixPath(entry.filename).parts
        is_absolute = text.startswith("/") or bool(PureWindowsPath(text).drive)
        if not parts or ".." in parts or is_absolute:
            raise DesatError(f"{name}: entry {text!r} would leave the folder")
        if len(parts) > DEPTH:
            raise DesatError(
                f"{name}: entry {text[:80]!r}: {len(parts)} folders; {DEPTH} allowed"
            )
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise DesatError(f"{name}: entry {text!r} is no regular file")
    size = sum(e.file_size for e in entries)
    if size > LARGEST:
        raise DesatError(f"{name}: {size >> 20} MiB extracted, {LARGEST >> 20} allowed")
    if size > max(SMALL, RATIO * file_size):
        raise DesatError(
            f"{name}: {file_size >> 10} KiB would become {size >> 20} MiB; "
            f"{RATIO} times its size is allowed"
        )
    return size


# --- TOML files on disk: their text, their data, and the line of each key -------------


LARGEST_TEXT = 2 << 20  # bytes: upper bound of a TOML file that is read


# A table of a TOML file as parsed; `reader.py` builds the language's object from it.
TomlTable = dict[str, Any]


def toml(file: Path) -> TomlTable:
    """Read the data of a TOML file.

    Raises
    ------
    DesatError
        If it does not exist or cannot be read.
    """
    place = paths.shown(file)
    return parsed(text(file, place), place)


def text(file: Path, place: str) -> str:
    """Read the text of a file, which messages call `place`.

    The mark with which some editors of Windows begin a file is removed.

    Raises
    ------
    DesatError
        If the file cannot be read or is not UTF-8.
    """
    try:
        return contents(file, place, LARGEST_TEXT).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DesatError(f"{place}: not UTF-8 (byte {error.start + 1})") from error


def parsed(source: str, place: str) -> TomlTable:
    """Parse a text in TOML.

    Raises
    ------
    DesatError
        If it is no TOML; the message begins with `place`.
    """
    try:
        return tomllib.loads(source)
    except (
        ValueError,
        RecursionError,
    ) as error:  # ValueError also for a date that does not exist
        raise DesatError(f"{place}: {error}") from error


def lines(source: str) -> dict[str, int]:
    """Find the line of every `table.key` and `table` of a TOML file, for messages."""
    numbers: dict[str, int] = {}
    table = ""
    for number, line in enumerate(source.splitlines(), 1):
        if header := re.match(r"\s*\[([^\[\],]+)\]\s*(?:#.*)?$", line):
            table = re.sub(r"[\s\"']", "", header[1])
            numbers.setdefault(table, number)
        elif key := re.match(r"\s*([\w.*\"'-]+)\s*=", line):
            name = re.sub(r"[\"']", "", key[1])
            numbers.setdefault(f"{table}.{name}" if table else name, number)
    return numbers


def line_of(numbers: dict[str, int], key: str) -> int:
    """Return the line of a key among those of a file (`lines`); 0 if it has none.

    If the key itself has no line, it is that of the first key within it, or of the
    nearest table around it.
    """
    while key:
        if inside := [
            n for k, n in numbers.items() if k == key or k.startswith(f"{key}.")
        ]:
            return inside[0]
        key = key.rpartition(".")[0]
    return 0


def at(place: str, key: str) -> str:
    """Return the name of a TOML file in messages, with the line of a key.

    The line is left out if the key has none.
    """
    files = (paths.SCENARIOS.parent / place, Path(place))
    file = next((f for f in files if f.suffix == ".toml" and f.is_file()), None)
    line = 0 if file is None else line_of(lines(text(file, place)), key)
    return f"{place}:{line}" if line else place


# --- A run folder is one process's at a time, and that of its children ----------------


if sys.platform != "win32":
    import fcntl

LOCK = ".running"


@contextmanager
def claimed(folder: Path, wait: float = 0.0, is_new: bool = False) -> Iterator[None]:
    """Hold a folder for this process and those forked from it.

    The folder is created if necessary. It stays held by forked processes if this one is
    killed first. A folder that was created, here or (`is_new`) for this purpose, is
    removed if it stays empty.

    Raises
    ------
    DesatError
        If another process holds it for longer than `wait` s.
    """
    is_new = is_new or not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    lock = folder.absolute() / LOCK
    number = _locked(lock, time.monotonic() + wait)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(number)
        if is_new:
            with suppress(OSError):  # it is not empty
                lock.parent.rmdir()


def _locked(lock: Path, until: float) -> int:
    """Lock a file until `until` (monotonic time, s) and return its descriptor."""
    while True:
        number = os.open(lock, os.O_CREAT | os.O_RDWR)
        try:
            if sys.platform != "win32":
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if lock.exists() and lock.stat().st_ino == os.fstat(number).st_ino:
                return number  # not a file that its holder has just removed
        except BlockingIOError as error:
            if time.monotonic() > until:
                os.close(number)
                raise DesatError(
                    f"{lock.parent}: another process runs in it"
                ) from error
            time.sleep(0.05)
        os.close(number)
