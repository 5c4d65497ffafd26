"""The C compiler of this machine: what native FMUs and the compiled loop are built
with."""

from __future__ import annotations

import os
import shlex
import shutil
import sys
from functools import cache
from importlib.util import find_spec


class NoCompilerError(Exception):
    """There is no C compiler on this machine."""


@cache
def compiler() -> tuple[str, ...]:
    """The command of the C compiler: CC, gcc, cc, clang, or of the package ziglang.

    Raises NoCompilerError.
    """
    try:
        wanted = shlex.split(os.environ.get("CC", ""))
    except ValueError as error:
        raise NoCompilerError(
            f"CC = {os.environ['CC']}: {str(error).lower()}"
        ) from None
    for command in [wanted] if wanted else (["gcc"], ["cc"], ["clang"]):
        if found := shutil.which(command[0]):
            return (found, *command[1:])
    if wanted:
        raise NoCompilerError(f"CC = {os.environ['CC']}: there is no such command")
    try:
        return zig()
    except NoCompilerError:
        raise NoCompilerError(
            "no C compiler: install gcc or clang, or `pip install ziglang`"
        ) from None


def zig() -> tuple[str, ...]:
    """The command of the C compiler of the package ziglang, which knows other machines,
    too.

    Raises NoCompilerError.
    """
    if not find_spec("ziglang"):
        raise NoCompilerError(
            "for other platforms the package ziglang is needed: `pip install ziglang`"
        )
    return (sys.executable, "-m", "ziglang", "cc", "-fno-sanitize=undefined")
