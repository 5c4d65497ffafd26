"""Our Python files and their syntax trees, each read and parsed once a process."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

from tests.conftest import ROOT

CODE = ("orchestrator", "components", "fmus")


@cache
def files_of(folder: Path) -> tuple[Path, ...]:
    """Return the Python files below a folder, sorted."""
    return tuple(sorted(folder.rglob("*.py")))


def tree_of(file: Path) -> ast.Module:
    """Return the syntax tree of a file."""
    return parse_text(file.read_text(encoding="utf-8"))[0]


def nodes_of(file: Path) -> tuple[ast.AST, ...]:
    """Return all nodes of a file's tree."""
    return parse_text(file.read_text(encoding="utf-8"))[1]


@cache
def parse_text(text: str) -> tuple[ast.Module, tuple[ast.AST, ...]]:
    """Return the syntax tree of a source, and all its nodes."""
    tree = ast.parse(text)
    return tree, tuple(ast.walk(tree))


def files_in(*folders: str) -> list[Path]:
    """Return the Python files below folders of the repository, folder by folder."""
    return [file for folder in folders for file in files_of(ROOT / folder)]


def forget() -> None:
    """Free the trees, some 300 MB, which every later garbage collection would visit."""
    files_of.cache_clear()
    parse_text.cache_clear()
