"""Zip archives of others, extracted: within budgets, regular files alone, nothing outside."""

from __future__ import annotations

import shutil
import stat
import zipfile
from collections import Counter
from pathlib import Path, PurePosixPath

from ..system.codes import Exit
from ..system.errors import DesatError, RunError
from . import paths

ENTRIES = 20_000
"""The most entries of an archive."""
LARGEST = 1 << 30
"""The most that an archive may hold, extracted (bytes)."""
IN_ALL = 8 << 30
"""The most that all archives that a process extracts may hold (bytes)."""
RATIO, SMALL = 200, 16 << 20
"""The most that an archive may grow to, as a multiple of its file, once above so many bytes."""
DEPTH = 32
"""The most folders within each other."""
_extracted = 0


def extract(path: Path, folder: Path) -> None:
    """Extract an archive into a new folder.

    Raises DesatError, which names archive and entry, for a file that is no archive, is above a
    budget, has an entry twice, or an entry that is no regular file or would leave the folder.
    """
    global _extracted
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            size = _check(path.name, path.stat().st_size, entries)
            if _extracted + size > IN_ALL:
                raise DesatError(f"{path.name}: with the archives before it more than "
                                 f"{IN_ALL >> 20} MiB extracted")  # fmt: skip
            folder.mkdir(parents=True)
            if size > (free := shutil.disk_usage(folder).free):
                raise RunError(f"{path.name}: {size >> 20} MiB extracted, {free >> 20} MiB are "
                               f"free in {folder.parent}", Exit.SPACE)  # fmt: skip
            archive.extractall(folder)
            _extracted += size
    except DesatError:
        raise
    except Exception as error:  # zipfile raises many kinds
        shutil.rmtree(folder, ignore_errors=True)
        raise DesatError(f"{paths.shown(path)}: not a readable archive ({error})") from error


def _check(name: str, file_size: int, entries: list[zipfile.ZipInfo]) -> int:
    """The size of the entries, extracted (bytes). Raises DesatError for what is not allowed."""
    if len(entries) > ENTRIES:
        raise DesatError(f"{name}: {len(entries)} entries; {ENTRIES} allowed")
    counts = Counter(e.filename for e in entries)
    if twice := [n for n, count in counts.items() if count > 1]:
        raise DesatError(f"{name}: holds {twice[0]} twice")
    for entry in entries:
        text, parts = entry.filename, PurePosixPath(entry.filename).parts
        if not parts or ".." in parts or text.startswith("/") or "\\" in text or ":" in text:
            raise DesatError(f"{name}: entry {text!r} would leave the folder")
        if len(parts) > DEPTH:
            raise DesatError(f"{name}: entry {text[:80]!r}: {len(parts)} folders; {DEPTH} allowed")
        kind = stat.S_IFMT(entry.external_attr >> 16)
        if kind not in (0, stat.S_IFREG, stat.S_IFDIR):
            raise DesatError(f"{name}: entry {text!r} is no regular file")
    size = sum(e.file_size for e in entries)
    if size > LARGEST:
        raise DesatError(f"{name}: {size >> 20} MiB extracted, {LARGEST >> 20} allowed")
    if size > max(SMALL, RATIO * file_size):
        raise DesatError(f"{name}: {file_size >> 10} KiB would become {size >> 20} MiB; "
                         f"{RATIO} times its size is allowed")  # fmt: skip
    return size
