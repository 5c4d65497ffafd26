"""Print how long the way of a target to its run is, the size of the package, its
commands' cost.

    make house

Ways are counted by tests/way.py, a process each, after one that makes what is made once
for a user. CPU is the least of five (`commands.py`), in seconds and over importing
numpy, h5py, lxml, typer and rich (B).
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
import tempfile
import tokenize
from collections import Counter
from pathlib import Path

from . import commands

HOME = Path(__file__).parents[1]
PACKAGE = HOME / "orchestrator"
TARGETS = (
    "uosat12/table3-ocdc-ilqr-1",
    "nadir_day/day-dipole",
    "space_telescope/ours-nominal",
)
FUNCTIONS = (190, 190, 215, 190)  # aims for TARGETS and the .ssp of the second
ASIDE = ("papers", "web")  # rooms that are not of the core
AIMS = {
    "tokens of the core": 225_000,
    "dict[str, Any] and Mapping[str, Any]": 140,
    "TypedDicts of campaign": 3,
}
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
}
COMMANDS = {
    "run_day": (4.5, "B"),
    "run_60_steps": (2.6, "B"),
    "check": (1.7, "B"),
    "own_run": (7.4, "B"),
    "own_compare": (14.0, "B"),
    "own_campaign": (60.0, "B"),
    "own_size": (19.0, "B"),
    commands.FIRST: (0.8, "s"),
    "help": (0.13, "s"),
    "tables": (5.0, "s of wall"),
}
"""Command of `commands.py` -> aim."""


def ways(folder: Path) -> list[dict[str, int]]:
    """The counts of the three targets and of the .ssp of the second."""
    (folder / "day.toml").write_text('extends = "nadir_day/day-dipole"\n')
    subprocess.run(
        [*desat(), "pack", "day.toml"], check=True, cwd=folder, capture_output=True
    )
    found = []
    for target in (*TARGETS, str(folder / "day.ssp")):
        command = [sys.executable, str(HOME / "tests" / "way.py"), target]
        for _ in range(2):
            done = subprocess.run(
                command, check=True, cwd=folder, capture_output=True, text=True
            )
        found.append(json.loads(done.stdout))
    return found


def desat() -> list[str]:
    """The command."""
    return [str(Path(sys.executable).with_name("desat"))]


def tokens(file: Path) -> int:
    """Count the tokens of a file without comments, docstrings and layout."""
    text = file.read_text(encoding="utf-8")
    docstrings = {
        (node.lineno, node.col_offset)
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    }
    with tokenize.open(file) as lines:
        found = list(tokenize.generate_tokens(lines.readline))
    return sum(t.type not in LAYOUT and t.start not in docstrings for t in found)


def sizes() -> dict[str, int]:
    """Count files, tokens, untyped tables and public class names that stand twice."""
    files = sorted(PACKAGE.rglob("*.py"))
    core = [f for f in files if f.relative_to(PACKAGE).parts[0] not in ASIDE]
    texts = {f: f.read_text(encoding="utf-8") for f in files}
    names = Counter(
        node.name
        for text in texts.values()
        for node in ast.parse(text).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    untyped = ("dict[str, Any]", "Mapping[str, Any]")
    campaign = [text for file, text in texts.items() if file.parent.name == "campaign"]
    return {
        "files": len(files),
        "tokens of the core": sum(map(tokens, core)),
        "tokens of papers and web": sum(tokens(f) for f in files if f not in core),
        "class names twice": sum(n > 1 for n in names.values()),
        "dict[str, Any] and Mapping[str, Any]": sum(
            text.count(x) for text in texts.values() for x in untyped
        ),
        "TypedDicts of campaign": sum(text.count("(TypedDict") for text in campaign),
    }


def main() -> int:
    """Print all of it."""
    with tempfile.TemporaryDirectory() as place:
        counts = ways(Path(place))
    now = ", ".join(str(c["functions"]) for c in counts)
    print(f"functions: {now} (aims {', '.join(map(str, FUNCTIONS))})")
    for name, number in sizes().items():
        aim = f" (aim {AIMS[name]:,})" if name in AIMS else ""
        print(f"{name}: {number:,}{aim}")
    lines = {n: c for n, c in commands.commands().items() if n in ("base", *COMMANDS)}
    costs = commands.measure(lines)
    print(f"B: {costs['base']['cpu']:.3f} s")
    for name, (expected, unit) in COMMANDS.items():
        of = costs[name]
        found = {"B": of["over_base"], "s": of["cpu"], "s of wall": of["wall"]}[unit]
        print(
            f"{' '.join(lines[name][3:])}: {found:.2f} {unit}, {of['cpu']:.2f} s "
            f"(aim {expected:g} {unit})"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
