"""Detect and undo what components change in the process that they run in."""

from __future__ import annotations

import ctypes
import errno
import faulthandler
import locale
import os
import platform
import signal
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

_HANDLERS = "signal handlers"
_HANDLER = 512  # bytes: more than any `struct sigaction` has
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGPIPE", "SIGFPE", "SIGSEGV", "SIGCHLD")
_FULL = {
    errno.ENOSPC: "no space left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than is allowed (ulimit -f)",
}


@contextmanager
def keep_state(
    subject: str = "a component", possessive: str = "the process"
) -> Iterator[Callable[..., list[str]]]:
    """Yield a function that restores the state the process had at the beginning.

    That function returns a line for each thing that was changed. Without `handlers` it
    leaves signal handlers alone, for use where signals have handlers of ours.
    """
    before = {name: get() for name, (get, _) in _STATE.items()}

    def changes(occasion: str, handlers: bool = True) -> list[str]:
        lines = []
        for name, (get, put) in _STATE.items():
            if (handlers or name != _HANDLERS) and get() != before[name]:
                put(before[name])
                lines.append(
                    f"{subject} changed the {name} of {possessive} {occasion}; put back"
                )
        return lines

    try:
        yield changes
    finally:
        changes("")


class _Handler(bytes):
    """A `struct sigaction`.

    Only its beginning, the handler, counts in comparisons.
    """

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Handler) and self[:8] == other[:8]

    __hash__ = None  # type: ignore[assignment]


def _handlers() -> list[_Handler]:
    """Read the handlers of the signals in _SIGNALS (Linux)."""
    handlers = []
    for name in _SIGNALS:
        if hasattr(signal, name) and sys.platform == "linux":
            state = ctypes.create_string_buffer(_HANDLER)
            _C.sigaction(int(getattr(signal, name)), None, state)
            handlers.append(_Handler(state.raw))
    return handlers


def _put_handlers(states: list[_Handler]) -> None:
    """Restore signal handlers."""
    names = [n for n in _SIGNALS if hasattr(signal, n)]
    for name, state in zip(names, states, strict=False):
        _C.sigaction(int(getattr(signal, name)), bytes(state), None)


def _rounding() -> int:
    """Return the rounding mode of the processor."""
    return int(_M.fegetround()) if _M is not None else 0


def _put_rounding(mode: int) -> None:
    """Set the rounding mode of the processor."""
    if _M is not None:
        _M.fesetround(mode)


def _modes() -> int:
    """Return the floating-point modes other than rounding.

    These are traps, and whether values that are too small become 0.
    """
    return int.from_bytes(_state(), "little") & _MODES if _MODES else 0


def _put_modes(modes: int) -> None:
    """Set the floating-point modes other than rounding."""
    state = int.from_bytes(_state(), "little") & ~_MODES | modes
    _M.fesetenv(state.to_bytes(_LARGEST, "little"))


def _state() -> bytes:
    """Return the floating-point environment as bytes."""
    state = ctypes.create_string_buffer(_LARGEST)
    _M.fegetenv(state)
    return state.raw


def _permissions() -> int:
    """Return the umask."""
    now = os.umask(0o077)
    os.umask(now)
    return now


def _folder() -> str:
    """Return the working directory; empty if it was removed."""
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return ""


def _put_folder(path: str) -> None:
    """Change to the working directory, unless it was removed."""
    if path:
        os.chdir(path)


_C: Any = ctypes.CDLL(None) if os.name == "posix" else None
_M: Any = _C if hasattr(_C, "fegetround") else None
if _M is None and sys.platform == "linux":
    _M = ctypes.CDLL("libm.so.6")
_LARGEST = 64  # bytes: more than the `fenv_t` of any of these has
# The bits of a `fenv_t` of Linux that hold the modes: of MXCSR and the x87's word, or of
# FPCR.
_MODES = {"x86_64": 0x9FC0 << 8 * 28 | 0x033F, "aarch64": 0x0308_9F00}.get(
    platform.machine() if _M is not None and sys.platform == "linux" else "", 0
)
_STATE: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {
    "rounding mode": (_rounding, _put_rounding),
    "floating-point modes": (_modes, _put_modes),
    "file permissions (umask)": (_permissions, os.umask),
    "locale": (
        lambda: locale.setlocale(locale.LC_ALL),
        lambda x: locale.setlocale(locale.LC_ALL, x),
    ),
    "working directory": (_folder, _put_folder),
    _HANDLERS: (_handlers, _put_handlers),
}


# Number of threads for numpy's products, read when numpy is loaded. One is enough for
# matrices of three columns. More would wait busily for the next product (a quarter of the
# CPU time of a day's numbers), and bits would depend on the number of processors.
THREADS = "OPENBLAS_NUM_THREADS"


@contextmanager
def one_thread() -> Iterator[None]:
    """Let processes started within use one thread, unless the user chose a number."""
    threads = os.environ.get(THREADS)
    os.environ.setdefault(THREADS, "1")
    try:
        yield
    finally:
        if threads is None:
            del os.environ[THREADS]


CAN_FORK = hasattr(os, "fork")


def fork() -> int:
    """Call `os.fork` without its warning about threads.

    The child must use nothing that another thread may hold.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def die_with(parent: int, number: int) -> None:
    """Prepare a forked process to end with its parent and without traces.

    A fault of a component prints no trace, and the process gets a signal when its
    parent dies (Linux).
    """
    faulthandler.disable()
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if hasattr(libc, "on_exit"):  # glibc
            # a component that calls exit() ends here, because the exit handlers of the
            # parent's libraries need threads that a fork does not have
            libc.on_exit(ctypes.cast(libc._exit, ctypes.c_void_p), None)
        libc.prctl(1, number)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os.kill(os.getpid(), number)


def stop_signals() -> list[int]:
    """Return the signals that stop a run.

    SIGHUP is not among them if the process was started with it ignored (nohup).
    """
    hung_up = getattr(signal, "SIGHUP", None)  # Windows has none
    if hung_up is None or signal.getsignal(hung_up) == signal.SIG_IGN:
        return [signal.SIGINT, signal.SIGTERM]
    return [signal.SIGINT, signal.SIGTERM, hung_up]


def no_space(text: str) -> str:
    """Explain why there is no room, from the text of an HDF5 or system error.

    The result is empty for any other error.
    """
    for number, meaning in _FULL.items():
        if f"errno = {number}," in text or f"[Errno {number}]" in text:
            return meaning
    return ""


# --- What components start and leave behind, ended with the call or the run in which they did ---


_PATIENCE = 0.5  # s: time to look for children, as a killed one may leave others


def adopt() -> None:
    """Make this process the parent of its children's orphans (Linux).

    Otherwise daemons that FMUs start would become children of the system.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER


def end() -> None:
    """Kill all children of this process.

    No children of our own are left when this is called.
    """
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        files = Path("/proc/self/task").glob("*/children")
        with suppress(OSError):
            if not (
                remaining := [
                    int(n) for file in files for n in file.read_text().split()
                ]
            ):
                return
            for process in remaining:
                os.kill(process, signal.SIGKILL)
            for process in remaining:  # their children become ours
                os.waitpid(process, 0)
