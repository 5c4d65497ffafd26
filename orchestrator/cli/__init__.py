"""The command `desat`: a file of a folder `commands/` each, or a few that belong
together."""

from __future__ import annotations

import os
import re
import signal
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated, Any, NoReturn

import typer
from typer.main import get_command

from ..engine.process_state import THREADS, stop_signals
from ..files.io import is_full
from ..system import discovery
from ..system.errors import DesatError, Exit, nearest
from .console import app, err, out
from .spare import spare

REPEAT_AFTER = 0.05  # s: a callback of the interpreter or of ctypes is over by then


def _version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        out.print(f"desat {version('desat')}")
        raise typer.Exit


@app.callback()
def _desat(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_version, is_eager=True
        ),
    ] = False,
) -> None:
    pass


def _terminate(number: int, frame: Any) -> NoReturn:
    """SIGTERM and SIGHUP end as an exception does: what is open is closed, what is
    temporary removed."""
    sys.exit(128 + number)


def _repeat_swallowed(unraisable: Any) -> None:
    """Send a signal to stop once more where Python swallowed the exception that it
    raised.

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
    # to whatever handler there is then; at once would be inside this hook
    signal.signal(signal.SIGALRM, lambda *_: os.kill(os.getpid(), number))
    signal.setitimer(signal.ITIMER_REAL, REPEAT_AFTER)


def app_for(words: Sequence[str]) -> typer.Typer:
    """The application with the command that these words begin with, where that has a
    file of its own: to make all of them takes as long as to list the families. Else
    with all."""
    one = words[0] if words and words[0].isidentifier() else "*"
    if not discovery.load("commands", one):
        discovery.load("commands")
    return app


def main() -> None:
    """Entry of the command: every error is a line, never a traceback."""
    os.environ.setdefault(THREADS, "1")  # before numpy is loaded
    for number in stop_signals():
        if number != signal.SIGINT:
            signal.signal(number, _terminate)
    sys.unraisablehook = _repeat_swallowed
    if hasattr(
        signal, "SIGCHLD"
    ):  # some who start us ignore it: then nobody hears how a child ends
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    sys.exit(_code())


def _code() -> int:
    """Do what the command line says; how it ended."""
    try:
        _refuse_empty(sys.argv[1:])
        command = get_command(app_for(sys.argv[1:]))
        spare(command)
        # typer.Exit comes back as a number
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
    except OSError as error:
        what = error.strerror or str(error)
        _say(f"{error.filename}: {what}" if error.filename else what)
        if not is_full(error):
            return Exit.INPUT
        _drop_output()
        return Exit.SPACE
    except Exception as error:
        if hasattr(error, "format_message"):  # click's own messages
            _say_usage(error)
            return int(getattr(error, "exit_code", Exit.INPUT))
        if os.environ.get("DESAT_TRACEBACK"):
            traceback.print_exc()
        _say(
            f"internal: {type(error).__name__}: {error} (DESAT_TRACEBACK=1 shows where)"
        )
        return Exit.BUG


def _refuse_empty(words: Sequence[str]) -> None:
    """Raise DesatError for an empty word, which a path would take for the current
    folder."""
    for before, word in zip(("", *words), words, strict=False):
        name, equals, value = word.partition("=")
        if word == "":
            name = before
        elif not (name.startswith("--") and equals and not value):
            continue
        place = name if name.startswith("-") else "an argument"
        raise DesatError(f"{place}: an empty text is given, a value is needed")


def _say(text: str) -> None:
    err.print(f"error: {text}")


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
"""What takes the place of options and commands of before."""
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
"""Options by what other programs call them."""


def _say_usage(error: Any) -> None:
    """What is wrong with a command line; without a command, what there is."""
    text, context = error.format_message(), getattr(error, "ctx", None)
    if context is not None and text == context.get_help():
        error.show()
        return
    path = context.command_path if context is not None else "desat"
    text = " ".join(text.replace("Value error, ", "").split())
    if (name := getattr(error, "option_name", None)) and context is not None:
        if name.startswith("-") and text.startswith("No such option"):
            known = [
                x for p in context.command.params for x in (*p.opts, *p.secondary_opts)
            ]
            text = f"no option {name}{_instead(name, known)}"
    elif (unknown := re.fullmatch(r"No such command '(.*?)'\..*", text)) is not None:
        known = list(getattr(getattr(context, "command", None), "commands", {}))
        text = f"no command {unknown[1]}{_instead(unknown[1], known)}"
    _say(f"{path}: {text} (`{path} --help`)")


def _instead(name: str, known: Sequence[str]) -> str:
    """What an option or a command that is not known is called, as far as can be
    guessed."""
    if name in RENAMED:
        return f"; {RENAMED[name]}"
    for option, others in MEANT.items():
        if name in others and option in known:
            return f"; did you mean {option}?"
    said = nearest(name, known)
    return said if "did you mean" in said else ""


def _drop_output() -> None:
    """Nobody takes our output: the interpreter must not try once more when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
