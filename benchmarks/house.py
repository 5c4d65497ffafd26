"""Print how long the way of a target to its run is, the size of the package, its names,
and what its commands cost, beside the aims.

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
from pathlib import Path

from . import commands

HOME = Path(__file__).parents[1]
PACKAGE = HOME / "orchestrator"
TARGETS = ("uosat12/table3-ocdc-ilqr-1", "nadir_day/day-dipole", "my12u")
OWN_CRAFT = "my12u --size 12U --altitude 400km --inclination 51.6deg --rods 0.2"
WAYS = {  # way of tests/way.py -> what it leads to, and aims for TARGETS
    "system": ("target to System", (115, 110, 120)),
    "spine": ("spine to a prepared run", (165, 150, 165)),
}
ASSEMBLY = (  # what assembles a system
    "build.py",
    "completion.py",
    "connect.py",
    "craft.py",
    "draft.py",
    "replacement.py",
)
AIMS = {
    "tokens of what assembles a system": 6_000,
    "tokens of the orchestrator": 315_000,
    "class names in two modules": 0,
    "files that ask interface.model": 8,
    "functions above 8 statements without docstring": 0,
    "one-word participles": 1_900,
}
# participles that do not end with "ed", and nouns that do
IRREGULAR = frozenset(
    [
        "held",
        "told",
        "given",
        "left",
        "kept",
        "said",
        "made",
        "found",
        "seen",
        "known",
        "taken",
        "shown",
        "written",
        "lost",
        "flown",
        "fed",
        "drawn",
        "sent",
        "chosen",
        "begun",
        "built",
        "run",
        "met",
        "put",
        "cut",
        "bound",
        "borne",
        "meant",
        "got",
        "gone",
        "done",
        "thrown",
        "grown",
        "worn",
        "torn",
    ]
)
NOUNS = frozenset(
    ["speed", "need", "seed", "feed", "exceed", "embed", "shared", "bed", "reed"]
)
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


def ways(folder: Path) -> dict[str, list[int]]:
    """Count the functions of each way for each target."""
    subprocess.run(
        [*desat(), "new", "craft", *OWN_CRAFT.split()],
        check=True,
        cwd=folder,
        capture_output=True,
    )
    functions: dict[str, list[int]] = {}
    for way in WAYS:
        functions[way] = []
        for target in TARGETS:
            command = [sys.executable, str(HOME / "tests" / "way.py"), target, way]
            for _ in range(2):
                counted = subprocess.run(
                    command, check=True, cwd=folder, capture_output=True, text=True
                )
            functions[way].append(json.loads(counted.stdout)["functions"])
    return functions


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
    """Count tokens and names of the package, as AIMS names them."""
    texts = {f: f.read_text(encoding="utf-8") for f in sorted(PACKAGE.rglob("*.py"))}
    assembly = [PACKAGE / "files" / name for name in ASSEMBLY]
    classes: dict[str, set[Path]] = {}
    names, bare = 0, 0
    for folder in (PACKAGE, HOME / "components", HOME / "fmus", HOME / "tests"):
        for file in folder.rglob("*.py"):
            for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
                names += sum(map(is_participle, bound_names(node)))
                if folder == PACKAGE and isinstance(node, ast.ClassDef):
                    classes.setdefault(node.name.lstrip("_"), set()).add(file)
                if folder.name != "tests" and isinstance(node, ast.FunctionDef):
                    bare += is_undocumented(node)
    return {
        "tokens of what assembles a system": sum(map(tokens, assembly)),
        "tokens of the orchestrator": sum(map(tokens, texts)),
        "class names in two modules": sum(len(of) > 1 for of in classes.values()),
        "files that ask interface.model": sum(
            "interface.model" in text for text in texts.values()
        ),
        "functions above 8 statements without docstring": bare,
        "one-word participles": names,
    }


def bound_names(node: ast.AST) -> list[str]:
    """Return the names that a node of the syntax tree binds."""
    match node:
        case ast.Name(id=name, ctx=ast.Store()) | ast.arg(arg=name):
            return [name]
        case ast.Attribute(attr=name, ctx=ast.Store()):
            return [name.lstrip("_")]
        case ast.FunctionDef(name=name):
            return [name.lstrip("_")]
    return []


def is_participle(name: str) -> bool:
    """Return whether a name is one word and a participle."""
    if "_" in name or name in NOUNS:
        return False
    return name in IRREGULAR or (name.endswith("ed") and len(name) > 4)


def is_undocumented(function: ast.FunctionDef) -> bool:
    """Return whether a function above eight statements has no docstring."""
    statements = sum(isinstance(x, ast.stmt) for x in ast.walk(function)) - 1
    return statements > 8 and ast.get_docstring(function) is None


def main() -> int:
    """Print all of it."""
    with tempfile.TemporaryDirectory() as place:
        counts = ways(Path(place))
    print(f"functions for {', '.join(TARGETS)}:")
    for way, (title, aims) in WAYS.items():
        shown = (", ".join(map(str, x)) for x in (counts[way], aims))
        print("{}: {} (aims {})".format(title, *shown))
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
