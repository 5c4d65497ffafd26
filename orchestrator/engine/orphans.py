"""What components start and leave behind, ended with the call or the run in which they did."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

_PATIENCE = 0.5
"""So long (s) they are looked for: what is ended may leave others."""


def adopt() -> None:
    """Orphans of this process' children come to it, not to the system (Linux): daemons of FMUs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER


def end() -> None:
    """End all children of this process: of those that are ours none is left when this is asked."""
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        files = Path("/proc/self/task").glob("*/children")
        with suppress(OSError):
            if not (left := [int(n) for file in files for n in file.read_text().split()]):
                return
            for process in left:
                os.kill(process, signal.SIGKILL)
            for process in left:  # theirs come next
                os.waitpid(process, 0)
