"""`python -m desat.fmus.subset`: hold the blocks and what they use to what translates to C.

Plain floats and flat tuples of a fixed length, and the standard library's mathematics: no dict, no
set, no list that grows, no generator function, no `sum` (compensated from Python 3.12 on), no
`hypot` (CPython's is not libm's), no other import. What stays outside is named in EXCEPTIONS, each
with its reason; one that is no longer needed is an error, too.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from .build import COMPONENTS, sources
from .registry import names

CONTRACT = ("block.py", "units.py", "__init__.py")
"""What declares variables; of these a translator takes the values, not the code."""

IMPORTS = {"__future__", "abc", "bisect", "collections", "functools", "math", "typing"}
GROWS = {"append", "extend", "insert", "pop", "remove", "add", "update", "setdefault", "discard"}
BUILT_INS = {"dict": "dict", "set": "set", "frozenset": "set", "sum": "sum", "hypot": "hypot"}

_PROGRAMME = "solves a programme of run-time size with numpy and scipy"
_ORDER = "flags in its place sum in another order: 1 of 1000 programmes of 8 nozzles changes bits"
EXCEPTIONS = {
    "blocks/manager_magnetic_ilqr.py:import numpy": "eigenvectors of the Hamiltonian matrix",
    "laws/riccati.py:import numpy": "eigenvectors of the Hamiltonian matrix",
    "laws/receding_horizon.py:import numpy": _PROGRAMME,
    "laws/least_firing.py:import numpy": _PROGRAMME,
    "laws/least_firing.py:import scipy": _PROGRAMME,
    "physics/tle.py:import importlib": "the package sgp4, looked for when it is first used",
    "physics/tle.py:tle_parameters:sum": "of integers, and no block calls it",
    "physics/tle.py:tle_parameters:dict": "no block calls it: it reads two lines of text",
    "bases/near_earth.py:import inspect": "a block's page, as its class is made",
    "physics/igrf14.py:import json": "a table, read once and without arguments",
    "physics/igrf14.py:import pathlib": "a table, read once and without arguments",
    "physics/geomagnetic.py:harmonics:dict": "coefficients of one year, as a block starts",
    "physics/geomagnetic.py:harmonics:growing list": "coefficients of one year, as a block starts",
    "laws/dumping.py:lqr_offsets:growing list": "a row a sample: its length is the horizon's",
    "maths/simplex.py:least_cost:set": _ORDER,
    "maths/simplex.py:least_cost:growing list": _ORDER,
}
"""File (below components/), function and rule -> why it stays; an import counts a file."""


@dataclass(frozen=True)
class Outside:
    """A place that leaves the subset."""

    file: str
    line: int
    function: str
    rule: str

    @property
    def key(self) -> str:
        """As EXCEPTIONS name it."""
        inside = "" if self.rule.startswith("import ") else f"{self.function}:"
        return f"{self.file}:{inside}{self.rule}"


def outside(text: str, file: str) -> Iterator[Outside]:
    """The places of a source text that leave the subset, in its order; annotations do not count."""

    def walk(node: ast.AST, function: str) -> Iterator[Outside]:
        if isinstance(node, ast.FunctionDef):
            function = node.name
        for rule in _rules(node):
            yield Outside(file, getattr(node, "lineno", 0), function, rule)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from walk(child, function)

    yield from walk(ast.parse(text), "")


def _rules(node: ast.AST) -> Iterator[str]:
    match node:
        case ast.Dict() | ast.DictComp():
            yield "dict"
        case ast.Set() | ast.SetComp():
            yield "set"
        case ast.Yield() | ast.YieldFrom():
            yield "generator function"
        case ast.AsyncFunctionDef() | ast.Await():
            yield "coroutine"
        case ast.Call(func=ast.Name(id=name)) if name in BUILT_INS:
            yield BUILT_INS[name]
        case ast.Call(func=ast.Attribute(attr="hypot")):
            yield "hypot"
        case ast.Call(func=ast.Attribute(attr=name)) if name in GROWS:
            yield "growing list"
        case ast.Import(names=modules):
            for module in modules:
                if (top := module.name.partition(".")[0]) not in IMPORTS:
                    yield f"import {top}"
        case ast.ImportFrom(level=0, module=str(name)):
            if (top := name.partition(".")[0]) not in IMPORTS:
                yield f"import {top}"


def files() -> list[Path]:
    """Every file that a block uses, the blocks themselves included; not the contract."""
    found = {path for name in names() for path in sources(name) if path.suffix == ".py"}
    return sorted(path for path in found if path.name not in CONTRACT)


def problems() -> list[str]:
    """A line a place that leaves the subset, and a line an exception that nothing needs."""
    lines, needed = [], set[str]()
    for path in files():
        name = path.relative_to(COMPONENTS).as_posix()
        for place in outside(path.read_text(encoding="utf-8"), name):
            needed.add(place.key)
            if place.key not in EXCEPTIONS:
                within = f" in {place.function}" if place.function else ""
                lines.append(
                    f"components/{name}:{place.line}: {place.rule}{within}: blocks and what they "
                    f'use do without; or name "{place.key}" in fmus/subset.py with its reason'
                )
    lines += [
        f'fmus/subset.py: exception "{key}" is no longer needed'
        for key in EXCEPTIONS if key not in needed
    ]  # fmt: skip
    return lines


def main() -> int:
    """Print what leaves the subset; 1 where something does."""
    lines = problems()
    print(
        "\n".join(lines) or f"{len(files())} files within the subset, {len(EXCEPTIONS)} exceptions"
    )
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
