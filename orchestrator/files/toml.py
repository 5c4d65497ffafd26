"""TOML files on disk: their text, their data, and the line of each key."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

from ..system.errors import DesatError
from . import paths
from .contents import contents

LARGEST = 2 << 20
"""The largest TOML file that is read (bytes)."""


def toml(file: Path) -> dict[str, Any]:
    """The data of a TOML file. Raises DesatError where there is none or it cannot be read."""
    where = paths.shown(file)
    return parsed(text(file, where), where)


def text(file: Path, where: str) -> str:
    """The text of a file, which messages call `where`, without the mark that some editors of
    Windows begin it with. Raises DesatError."""
    try:
        return contents(file, where, LARGEST).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise DesatError(f"{where}: not UTF-8 (byte {error.start + 1})") from error


def parsed(source: str, where: str) -> dict[str, Any]:
    """The data of a text in TOML. Raises DesatError, which begins with `where`."""
    try:
        return tomllib.loads(source)
    except (ValueError, RecursionError) as error:  # ValueError also of a date that there is not
        raise DesatError(f"{where}: {error}") from error


def lines(source: str) -> dict[str, int]:
    """The line of every `table.key` and `table` of a TOML file, for messages."""
    numbers: dict[str, int] = {}
    table = ""
    for number, line in enumerate(source.splitlines(), 1):
        if header := re.match(r"\s*\[([^\[\]]+)\]", line):
            table = re.sub(r"[\s\"']", "", header[1])
            numbers.setdefault(table, number)
        elif key := re.match(r"\s*([\w.\"'-]+)\s*=", line):
            name = re.sub(r"[\"']", "", key[1])
            numbers.setdefault(f"{table}.{name}" if table else name, number)
    return numbers
