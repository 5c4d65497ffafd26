"""A run folder is one process's at a time, and that of its children."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from ..system.errors import DesatError

if sys.platform != "win32":
    import fcntl

LOCK = ".running"


@contextmanager
def claimed(folder: Path, wait: float = 0.0, made: bool = False) -> Iterator[None]:
    """Within: a folder, made where there is none, is held by this process and those forked from
    it, also when it is killed before them. Raises DesatError where another holds it for longer
    than `wait` s. A folder that was made, here or (`made`) for this, and stays empty is removed."""
    made = made or not folder.exists()
    folder.mkdir(parents=True, exist_ok=True)
    lock = folder.absolute() / LOCK
    number = _locked(lock, time.monotonic() + wait)
    try:
        yield
    finally:
        lock.unlink(missing_ok=True)
        os.close(number)
        if made:
            with suppress(OSError):  # it is not empty
                lock.parent.rmdir()


def _locked(lock: Path, until: float) -> int:
    while True:
        number = os.open(lock, os.O_CREAT | os.O_RDWR)
        try:
            if sys.platform != "win32":
                fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if lock.exists() and lock.stat().st_ino == os.fstat(number).st_ino:
                return number  # and not one that its holder has just removed
        except BlockingIOError as error:
            if time.monotonic() > until:
                os.close(number)
                raise DesatError(f"{lock.parent}: another process runs in it") from error
            time.sleep(0.05)
        os.close(number)
