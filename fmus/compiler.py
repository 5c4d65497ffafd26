"""Find the C compiler for native FMUs and for the compiled loop."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from functools import cache
from importlib.util import find_spec


class NoCompilerError(Exception):
    """No C compiler on this machine."""


@cache
def compiler() -> tuple[str, ...]:
    """Return the command of the C compiler: CC, gcc, cc, clang, or ziglang's.

    Raises
    ------
    NoCompilerError
        If there is none, or CC names no command.
    """
    try:
        cc_command = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(
            f"CC = {os.environ['CC']}: {str(error).lower()}"
        ) from None
    for command in [cc_command] if cc_command else (["gcc"], ["cc"], ["clang"]):
        if executable := shutil.which(command[0]):
            return (executable, *command[1:])
    if cc_command:
        raise NoCompilerError(f"CC = {os.environ['CC']}: there is no such command")
    try:
        return zig()
    except NoCompilerError:
        raise NoCompilerError(
            "no C compiler: install gcc or clang, or `pip install ziglang`"
        ) from None


def zig() -> tuple[str, ...]:
    """Return the command of the package ziglang's C compiler.

    It can also compile for other platforms.

    Raises
    ------
    NoCompilerError
        If the package ziglang is missing.
    """
    if not find_spec("ziglang"):
        raise NoCompilerError(
            "for other platforms the package ziglang is needed: `pip install ziglang`"
        )
    return (sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined")
