"""What components may do to the process that they run in, noticed and undone."""

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
_HANDLER = 512
"""More bytes than any `struct sigaction` has."""
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGPIPE", "SIGFPE", "SIGSEGV", "SIGCHLD")
_FULL = {
    errno.ENOSPC: "no space left on the disk",
    errno.EDQUOT: "the disk quota is used up",
    errno.EFBIG: "the file is larger than is allowed (ulimit -f)",
}


@contextmanager
def keep_state(
    who: str = "a component", whose: str = "the process"
) -> Iterator[Callable[..., list[str]]]:
    """Within: a function that puts the process back as it was at the beginning, and
    gives a line for each thing that was changed; without `handlers`, where signals have
    handlers of ours, all but those."""
    before = {name: get() for name, (get, _) in _STATE.items()}

    def changes(when: str, handlers: bool = True) -> list[str]:
        lines = []
        for name, (get, put) in _STATE.items():
            if (handlers or name != _HANDLERS) and get() != before[name]:
                put(before[name])
                lines.append(f"{who} changed the {name} of {whose} {when}; put back")
        return lines

    try:
        yield changes
    finally:
        changes("")


class _Handler(bytes):
    """A `struct sigaction`, which begins with the handler; the rest does not count."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Handler) and self[:8] == other[:8]

    __hash__ = None  # type: ignore[assignment]


def _handlers() -> list[_Handler]:
    handlers = []
    for name in _SIGNALS:
        if hasattr(signal, name) and sys.platform == "linux":
            state = ctypes.create_string_buffer(_HANDLER)
            _C.sigaction(int(getattr(signal, name)), None, state)
            handlers.append(_Handler(state.raw))
    return handlers


def _put_handlers(states: list[_Handler]) -> None:
    names = [n for n in _SIGNALS if hasattr(signal, n)]
    for name, state in zip(names, states, strict=False):
        _C.sigaction(int(getattr(signal, name)), bytes(state), None)


def _rounding() -> int:
    return int(_M.fegetround()) if _M is not None else 0


def _put_rounding(mode: int) -> None:
    if _M is not None:
        _M.fesetround(mode)


def _modes() -> int:
    """How the processor calculates, beside rounding: traps, and what is too small taken
    as 0."""
    return int.from_bytes(_state(), "little") & _MODES if _MODES else 0


def _put_modes(modes: int) -> None:
    state = int.from_bytes(_state(), "little") & ~_MODES | modes
    _M.fesetenv(state.to_bytes(_LARGEST, "little"))


def _state() -> bytes:
    state = ctypes.create_string_buffer(_LARGEST)
    _M.fegetenv(state)
    return state.raw


def _permissions() -> int:
    now = os.umask(0o077)
    os.umask(now)
    return now


def _folder() -> str:
    try:
        return os.getcwd()
    except OSError:  # it was removed
        return ""


def _put_folder(path: str) -> None:
    if path:
        os.chdir(path)


_C: Any = ctypes.CDLL(None) if os.name == "posix" else None
_M: Any = _C if hasattr(_C, "fegetround") else None
if _M is None and sys.platform == "linux":
    _M = ctypes.CDLL("libm.so.6")
_LARGEST = 64
"""More bytes than any `fenv_t` of these has."""
_MODES = {"x86_64": 0x9FC0 << 8 * 28 | 0x033F, "aarch64": 0x0308_9F00}.get(
    platform.machine() if _M is not None and sys.platform == "linux" else "", 0
)
"""The bits of a `fenv_t` of Linux that hold the modes: of MXCSR and the x87's word, or
of FPCR."""
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


THREADS = "OPENBLAS_NUM_THREADS"
"""How many threads numpy's products take, read when numpy is loaded. With one, which is
enough for matrices of three columns, none of them waits busily for the next product, as
those of a day's numbers do for a quarter of its CPU, and no bit hangs on the number of
processors."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Within: processes that begin take one thread, but where the user has said how
    many."""
    given = os.environ.get(THREADS)
    os.environ.setdefault(THREADS, "1")
    try:
        yield
    finally:
        if given is None:
            del os.environ[THREADS]


CAN_FORK = hasattr(os, "fork")


def fork() -> int:
    """As `os.fork`, of a process whose child uses nothing that another thread may hold."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        return os.fork()


def die_with(parent: int, number: int) -> None:
    """Let no fault of a component print a trace in a forked process, and let it get a
    signal when its parent dies (Linux)."""
    faulthandler.disable()
    if sys.platform == "linux":
        libc = ctypes.CDLL(None)
        if hasattr(libc, "on_exit"):  # glibc
            # a component that calls exit() ends here: what the parent's libraries have
            # registered for their end needs threads that a fork does not have
            libc.on_exit(ctypes.cast(libc._exit, ctypes.c_void_p), None)
        libc.prctl(1, number)  # PR_SET_PDEATHSIG
        if os.getppid() != parent:
            os.kill(os.getpid(), number)


def stop_signals() -> list[int]:
    """The signals that stop a run; SIGHUP not where whoever started us has it ignored
    (nohup)."""
    hung_up = getattr(signal, "SIGHUP", None)  # Windows has none
    if hung_up is None or signal.getsignal(hung_up) == signal.SIG_IGN:
        return [signal.SIGINT, signal.SIGTERM]
    return [signal.SIGINT, signal.SIGTERM, hung_up]


def no_space(text: str) -> str:
    """Why there is no room, of the text of an error of HDF5 or of the system; else
    nothing."""
    for number, meaning in _FULL.items():
        if f"errno = {number}," in text or f"[Errno {number}]" in text:
            return meaning
    return ""


# --- What components start and leave behind, ended with the call or the run in which they did ---


_PATIENCE = 0.5
"""So long (s) they are looked for: what is ended may leave others."""


def adopt() -> None:
    """Orphans of this process' children come to it, not to the system (Linux): daemons
    of FMUs."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(36, 1)  # PR_SET_CHILD_SUBREAPER


def end() -> None:
    """End all children of this process: of those that are ours none is left when this
    is asked."""
    until = time.monotonic() + _PATIENCE
    while time.monotonic() < until:
        files = Path("/proc/self/task").glob("*/children")
        with suppress(OSError):
            if not (
                left := [int(n) for file in files for n in file.read_text().split()]
            ):
                return
            for process in left:
                os.kill(process, signal.SIGKILL)
            for process in left:  # theirs come next
                os.waitpid(process, 0)
