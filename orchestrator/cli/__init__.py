"""Define the command `desat`; each file in a folder `commands/` adds commands."""

from __future__ import annotations

import atexit
import gc
import os
import re
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from typer.main import get_command

from ..engine.process_state import THREADS, stop_signals
from ..files.io import is_full
from ..system import discovery
from ..system.errors import DesatError, Exit, nearest
from .console import app, err, out
from .spare import spare

PROGRESS = "desat.runs.progress"
# Allocations between two searches for cycles: with Python's 700 they take a thirtieth of
# a command, which leaves few cycles behind.
COLLECT_AFTER = 50_000
REPEAT_AFTER = 0.05  # s: a callback of the interpreter or of ctypes has ended by then
SIGNALS = 3  # stop signals at most that arrive while the first is repeated


def _version(print_it: bool) -> None:
    """Print the version and exit."""
    if print_it:
        from importlib.metadata import version

        out.print(f"desat {version('desat')}")
        raise typer.Exit


@app.callback()
def _desat(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            "-V",
            help="Print the version.",
            callback=_version,
            is_eager=True,
        ),
    ] = False,
    quiet: Annotated[
        bool,
        typer.Option(
            "--quiet",
            "-q",
            help="Print errors, warnings and what --json asks for alone; also after the "
            "command.",
        ),
    ] = False,
) -> None:
    out.quiet = quiet
    if quiet or PROGRESS in sys.modules:  # loading it is slow
        import_module(PROGRESS).quiet(quiet)


def _terminate(number: int, frame: Any) -> NoReturn:
    """End on SIGTERM and SIGHUP by an exception.

    Open files are closed and temporary ones removed.
    """
    sys.exit(128 + number)


def _repeat_swallowed(unraisable: Any) -> None:
    """Send a stop signal again where Python swallowed the exception that it raised.

    Python ignores an exception inside a weakref callback, a finaliser or a callback of
    ctypes, and each import has a weakref callback: the signal would be lost, and a
    traceback printed.
    """
    error = unraisable.exc_value
    number = 0
    if isinstance(error, KeyboardInterrupt):
        number = signal.SIGINT
    elif isinstance(error, SystemExit) and isinstance(error.code, int):
        number = error.code - 128
    if number not in stop_signals() or not hasattr(signal, "setitimer"):
        sys.__unraisablehook__(unraisable)
        return
    for _ in range(SIGNALS):  # another one may arrive in here, and stands for both
        with suppress(KeyboardInterrupt, SystemExit):
            # later, because an immediate signal would arrive inside this hook
            signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), number))
            signal.setitimer(signal.ITIMER_REAL, REPEAT_AFTER)
            return


def app_for(words: Sequence[str]) -> typer.Typer:
    """Return the application with the command that words begin with.

    Only that command is loaded where it has a file of its own, because loading all
    takes as long as `desat list`; otherwise all are loaded.
    """
    one = words[0] if words and words[0].isidentifier() else "*"
    if not discovery.load("commands", one):
        discovery.load("commands")
    return app


def main() -> NoReturn:
    """Run the command; every error is printed as a line, never as a traceback."""
    os.environ.setdefault(THREADS, "1")  # before numpy is loaded
    gc.set_threshold(COLLECT_AFTER)
    for number in stop_signals():
        if number != signal.SIGINT:
            signal.signal(number, _terminate)
    sys.unraisablehook = _repeat_swallowed
    if hasattr(
        signal, "SIGCHLD"
    ):  # a parent may have set it to be ignored: then the end of children is not reported
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    _end(_code())


def _end(code: int) -> NoReturn:
    """End the process with this exit code, without freeing its objects.

    Python takes a tenth of a second for that, and the system does it anyway.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # whoever read it has gone
            stream.flush()
    os._exit(code)


def _code() -> int:
    """Run the command line and return its exit code."""
    try:
        words = _quiet_first()
        _refuse_empty(words)
        command = get_command(app_for(words))
        spare(command)
        # typer returns an Exit as a number
        code = command(prog_name="desat", standalone_mode=False)
        sys.stdout.flush()
        return code if isinstance(code, int) else Exit.COMPLETED
    except DesatError as error:
        for line in str(error).splitlines():
            _say(line)
        refused = error.code is Exit.INPUT
        return Exit.SPACE if refused and is_full(error) else error.code
    except (typer.Abort, KeyboardInterrupt):
        return Exit.INTERRUPTED
    except SystemExit as end:  # of a signal, or of a process that `run` has forked
        return end.code if isinstance(end.code, int) else Exit.COMPLETED
    except OSError as error:
        description = error.strerror or str(error)
        _say(f"{error.filename}: {description}" if error.filename else description)
        if not is_full(error):
            return Exit.INPUT
        _drop_output()
        return Exit.SPACE
    except ModuleNotFoundError as error:
        return _say_absent(error)
    except Exception as error:
        if hasattr(error, "format_message"):  # click's own messages
            _say_usage(error)
            return int(getattr(error, "exit_code", Exit.INPUT))
        return _say_bug(error)


# packages that only some commands use, and the extra of desat that brings each
EXTRAS = {
    "pyarrow": "campaign",
    "pandas": "tables",
    "xarray": "tables",
    "ziglang": "web",
    "distributed": "cluster",
    "SALib": "cluster",
}


def _say_absent(error: ModuleNotFoundError) -> int:
    """Print which extra brings a package that is absent; return the exit code."""
    if (extra := EXTRAS.get(str(error.name).partition(".")[0])) is None:
        return _say_bug(error)
    _say(
        f"this needs the package {error.name}, which is not installed: "
        f"`pip install 'desat[{extra}]'`"
    )
    return Exit.INPUT


def _quiet_first() -> list[str]:
    """Move `--quiet` before the command in sys.argv; return the other words."""
    words = [word for word in sys.argv[1:] if word not in QUIET]
    if len(words) < len(sys.argv) - 1:
        sys.argv[1:] = ["--quiet", *words]
    return words


def _say_bug(error: Exception) -> int:
    """Print an error that no user can have caused; return its exit code.

    A manifest that was changed by hand may have caused it: then that is said.
    """
    from ..runs.manifest import changed_manifest

    folders = [Path(word) for word in sys.argv[1:] if not word.startswith("-")]
    if changed := next(filter(None, map(changed_manifest, folders)), ""):
        _say(
            f"{changed}: it was changed after the run wrote it, and does not fit the run "
            f"({type(error).__name__}: {error})"
        )
        return Exit.INPUT
    if os.environ.get("DESAT_TRACEBACK"):
        traceback.print_exc()
    _say(f"internal: {type(error).__name__}: {error} (DESAT_TRACEBACK=1 shows where)")
    return Exit.BUG


QUIET = ("--quiet", "-q")


def _refuse_empty(words: Sequence[str]) -> None:
    """Raise DesatError for an empty word.

    A path would take it for the current folder.
    """
    for before, word in zip(("", *words), words, strict=False):
        name, equals, value = word.partition("=")
        if word == "":
            name = before
        elif not (name.startswith("--") and equals and not value):
            continue
        place = name if name.startswith("-") else "an argument"
        raise DesatError(f"{place}: an empty text is given, a value is needed")


def _say(text: str) -> None:
    """Print an error."""
    err.print(f"error: {text}")


# former options and commands, and their replacement
RENAMED = {
    "--inner": "it is called --substeps",
    "--twin": "it is called --baseline",
    "--no-twin": "it is called --no-baseline",
    "--against": "desat compare NAME OTHER -n COUNT does it",
    "--draws": "it is called --samples",
    "--estimate": "--substeps auto says how much a run errs",
    "keys": "desat help keys prints them",
    "measures": "desat help measures prints them",
    "blocks": "desat help blocks prints them",
    "craft": "desat pack --ssd writes the SSD of crafts, desat new craft begins one",
    "draws": "desat campaign NAME -n COUNT makes them, the same of a seed",
}
# options, by their names in other programs
MEANT = {
    "--stop": (
        "--duration",
        "--time",
        "--end",
        "--until",
        "--t-end",
        "--tend",
        "--stop-time",
    ),
    "--step": ("--dt", "--timestep", "--time-step", "--step-size"),
    "--out": ("--output", "--output-dir", "--dir", "--folder", "-o"),
    "--set": ("--param", "--parameter", "--with", "-s", "-p"),
    "--source": ("--fmu", "--replace"),
    "-n": ("--samples", "--runs", "--cases", "-N"),
    "--jobs": ("--workers", "--threads", "--processes", "-j"),
    "--orbit": ("--apogee", "--perigee"),
}


def _say_usage(error: Any) -> None:
    """Print the error of a command line, or the help where no command was given."""
    text, context = error.format_message(), getattr(error, "ctx", None)
    if context is not None and text == context.get_help():
        error.show()
        return
    path = context.command_path if context is not None else "desat"
    text = " ".join(text.replace("Value error, ", "").split())
    if (name := getattr(error, "option_name", None)) and context is not None:
        if name.startswith("-") and text.startswith("No such option"):
            option_names = [
                x for p in context.command.params for x in (*p.opts, *p.secondary_opts)
            ]
            text = f"no option {name}{_instead(name, option_names)}"
    elif (unknown := re.fullmatch(r"No such command '(.*?)'\..*", text)) is not None:
        option_names = list(getattr(getattr(context, "command", None), "commands", {}))
        text = f"no command {unknown[1]}{_instead(unknown[1], option_names)}"
    _say(f"{path}: {text} (`{path} --help`)")


def _instead(name: str, names: Sequence[str]) -> str:
    """Suggest a name in place of an unknown option or command, or return ""."""
    if name in RENAMED:
        return f"; {RENAMED[name]}"
    for option, others in MEANT.items():
        if name in others and option in names:
            return f"; did you mean {option}?"
    suggestion = nearest(name, names)
    return suggestion if "did you mean" in suggestion else ""


def _drop_output() -> None:
    """Redirect standard output to nowhere, so that no flush is tried at the end."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
