"""Write what a log shows into the craft file, whose other lines stay as they are.

A value goes into [parameters.spacecraft], its spread into [dispersions]. The file as it
was is kept beside, with the ending `.bak`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..campaign.sampling import NINETY
from ..files import io, paths
from ..files.craft import FILE
from ..system.errors import DesatError
from .fit import Fit, ParameterFit

VALUES, SPREADS = "parameters.spacecraft", "dispersions"
BACKUP = ".bak"
_NOTES = ("fit of ", "before [")  # begins of what an earlier fit has noted
# texts and comments of a line of TOML, whose brackets do not count
_ASIDE = re.compile(r"\"(?:\\.|[^\"\\])*\"|'[^']*'|#.*")


def craft_file_of(target: str) -> Path:
    """Return the craft file of an own craft, by its folder.

    Raises
    ------
    DesatError
        If the target is no folder with a craft file.
    """
    file = Path(target) / FILE
    if not file.is_file():
        raise DesatError(
            f"{target}: only the {FILE} of a craft of one's own is written: --dry-run "
            "shows the fit"
        )
    return file


def write_fit(file: Path, fit: Fit, source: str) -> Path:
    """Write the observed parameters of a fit into a craft file; return the backup.

    `source` names the log in a comment.

    Raises
    ------
    DesatError
        If the file has a fit of that log already, or cannot be changed without changing
        more than that; it is as it was.
    """
    place = paths.shown(file)
    before = io.text(file, place)
    if re.search(rf"# fit of {re.escape(source)}, 90 %", before):
        raise DesatError(
            f"{place}: it has a fit of {source} already, which would count twice: "
            f"{file.name}{BACKUP} is the file before"
        )
    data = io.parsed(before, place)
    after = before
    for parameter in fit.parameters.values():
        if not parameter.is_observed.any():
            continue
        value, widths = _entries(parameter)
        name = f"spacecraft.{parameter.name}"
        old = ", ".join(f"{x:.4g}" for x in parameter.before)
        note = f"fit of {source}; before [{old}]"
        after = _assign(after, VALUES, parameter.name, _array(value), note)
        spread = f"{{ plus_minus = {_array(widths)} }}"
        after = _assign(after, SPREADS, f'"{name}"', spread, f"fit of {source}, 90 %")
        table = data.setdefault("parameters", {}).setdefault("spacecraft", {})
        table[parameter.name] = value
        data.setdefault(SPREADS, {})[name] = {"plus_minus": widths}
    in_tables = data.get(SPREADS, {}).get("spacecraft", {})
    if io.parsed(after, place) != data or fit.parameters.keys() & in_tables:
        raise DesatError(
            f"{place}: {VALUES} or {SPREADS} cannot be changed alone; it is as it was"
        )
    backup = file.with_name(file.name + BACKUP)
    io.replace_text(backup, before)
    io.replace_text(file, after)
    return backup


def overriding_files(file: Path, fit: Fit) -> list[str]:
    """Return which scenarios beside a craft file give what is written there, too."""
    texts = []
    for other in sorted(set(file.parent.glob("*.toml")) - {file}):
        table = io.toml(other).get("parameters", {}).get("spacecraft", {})
        names = [n for n, x in fit.parameters.items() if x.is_observed.any()]
        if same := [n for n in names if n in table]:
            texts.append(f"{paths.shown(other)} has its own {', '.join(same)}")
    return texts


def _entries(parameter: ParameterFit) -> tuple[list[float], list[float]]:
    """Return value (3) and spread at 90 % (3) as they are written.

    An element that is not observed has those that it had.
    """
    value = np.where(parameter.is_observed, parameter.value, parameter.before)
    deviation = np.where(parameter.is_observed, parameter.deviation, parameter.spread)
    widths = [float(f"{NINETY * x:.3g}") for x in deviation]
    return [float(f"{x:.6g}") for x in value], widths


def _array(values: Sequence[Any]) -> str:
    """Format numbers as a TOML list."""
    return "[" + ", ".join(map(repr, values)) + "]"


def _assign(text: str, table: str, key: str, value: str, note: str) -> str:
    """Give a key of a table in a text another value, with a note before its comment."""
    lines = text.splitlines(keepends=True)
    numbers = io.lines(text)
    if table not in numbers:
        end = "" if text.endswith("\n") else "\n"
        return f"{text}{end}\n[{table}]\n{key} = {value}   # {note}\n"
    name = key.strip('"')
    line = numbers.get(f"{table}.{name}")
    if line is None:
        lines.insert(numbers[table], f"{key} = {value}   # {note}\n")
        return "".join(lines)
    first, last = line - 1, _end_of(lines, line - 1)
    _, _, comment = _ASIDE.sub(_keep_comment, lines[last]).partition("#")
    parts = [x for x in comment.strip().split("; ") if not x.startswith(_NOTES)]
    more = "".join(f"; {x}" for x in parts if x)
    indent = lines[first][: len(lines[first]) - len(lines[first].lstrip())]
    lines[first : last + 1] = [f"{indent}{key} = {value}   # {note}{more}\n"]
    return "".join(lines)


def _keep_comment(match: re.Match[str]) -> str:
    """Return a comment, and nothing for a text."""
    return match[0] if match[0].startswith("#") else ""


def _end_of(lines: Sequence[str], first: int) -> int:
    """Return the last line of the value that begins in a line, by its brackets."""
    depth = 0
    for number in range(first, len(lines)):
        code = _ASIDE.sub("", lines[number])
        depth += sum(code.count(x) for x in "[{") - sum(code.count(x) for x in "]}")
        if depth <= 0:
            return number
    return first
