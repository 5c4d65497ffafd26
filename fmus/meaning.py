"""Hash what blocks and Python files compute.

Texts, layout and the folder of a file do not affect the hash.
"""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from . import own

COMPONENTS = Path(__file__).parents[1] / "components"


def sources(block_ref: str) -> list[Path]:
    """Return the files of components/ that a block needs, found by its imports.

    For a block of the project its own file comes first. A user's own block file is not
    included.
    """
    place = COMPONENTS / "blocks" / f"{own.identifier(block_ref)}.py"
    todo, paths = [place], list[Path]()
    if own.is_own(block_ref):
        todo = [
            place.parent / "__init__.py",
            *_imported_files(place, own.shipped_text(block_ref)),
        ]
    while todo:
        path = todo.pop()
        if path in paths:
            continue
        paths.append(path)
        if (initial := path.parent / "__init__.py").exists():
            todo.append(initial)
        todo += _imported_files(path, path.read_text(encoding="utf-8"))
    data = [p.with_suffix(".json") for p in paths if p.with_suffix(".json").is_file()]
    return paths + data


@cache
def _imported_files(path: Path, text: str) -> list[Path]:
    """Return the files of its own package that a file with this text imports."""
    paths = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(
                *(node.module or "").split(".")
            )
            candidates = (base, *(base / alias.name for alias in node.names))
            paths += [
                c.with_suffix(".py")
                for c in candidates
                if c.with_suffix(".py").is_file()
            ]
    return paths


def index_entry(block_ref: str) -> dict[str, Any]:
    """Return the index entry for what a block computes.

    `computes` is its hash; `files` are its files and `files_sha256` is the hash of
    their bytes, so that `is_as` can check quickly whether they are unchanged. A user's
    own block has no such files in the entry, because its file may be gone.
    """
    files = sources(block_ref)
    if own.is_own(block_ref):
        return {"computes": of_files([Path(block_ref), *files])}
    data = [p for p in files if p.suffix != ".py"]
    texts = {*used_by(files[0]), *(p.read_text(encoding="utf-8") for p in data)}
    return {
        "computes": _hash_of(texts),
        "files": [p.relative_to(COMPONENTS).as_posix() for p in files],
        "files_sha256": _hash_files(files),
    }


def is_as(entry: dict[str, Any]) -> bool:
    """Return whether a block's files are as they were when its entry was made."""
    files = [COMPONENTS / file for file in entry.get("files", ())]
    return (
        bool(files)
        and all(f.is_file() for f in files)
        and (_hash_files(files) == entry["files_sha256"])
    )


def _hash_files(files: list[Path]) -> str:
    """Compute the sha256 of the bytes of files."""
    digest = hashlib.sha256()
    for path in files:
        data = path.read_bytes()
        digest.update(f"\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def of_files(files: Iterable[Path], imports: bool = True) -> str:
    """Compute the sha256 of what files define, in whichever file it stands.

    Python files count by their definitions, others (C, tables of numbers) by their
    text.
    """
    texts = ((p.suffix, p.read_text(encoding="utf-8")) for p in files)
    return _hash_of(
        {
            x
            for kind, t in texts
            for x in (definitions(t, imports) if kind == ".py" else {t})
        }
    )


def _hash_of(texts: Iterable[str]) -> str:
    """Compute the sha256 of texts, independent of their order."""
    return hashlib.sha256("\0".join(sorted(texts)).encode()).hexdigest()


@cache
def definitions(text: str, imports: bool = True) -> frozenset[str]:
    """Return the syntax trees of a Python file's statements as texts.

    Comments, docstrings and layout are left out. Of an import the names and the
    module's file name count, but not its folder; without `imports` no import counts,
    for files that are moved and renamed.
    """
    tree = ast.parse(text)
    if imports:
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                node.level, node.module = 0, (node.module or "").rpartition(".")[2]
    statements = [
        x
        for x in tree.body
        if imports or not isinstance(x, (ast.Import, ast.ImportFrom))
    ]
    return frozenset(_dump(x, imports) for x in statements if not _is_aside(x))


def _dump(node: Any, imports: bool) -> str:
    """Format a syntax tree as a text that is the same for every Python version.

    Unlike `ast.dump`, it leaves out every empty field.
    """
    if isinstance(node, list):
        statements = [
            x
            for x in node
            if imports or not isinstance(x, (ast.Import, ast.ImportFrom))
        ]
        return (
            f"[{','.join(_dump(x, imports) for x in statements if not _is_aside(x))}]"
        )
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = ((k, v) for k, v in ast.iter_fields(node) if v is not None and v != [])
    return f"{type(node).__name__}({','.join(f'{k}={_dump(v, imports)}' for k, v in fields)})"


def _is_aside(node: Any) -> bool:
    """Return whether a statement computes nothing.

    Such are statements for types alone and texts, as a docstring.
    """
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


# --- What a file uses of the files that it imports ------------------------------------


class _Module:
    """Top-level statements of a file, the names they define, and its imports."""

    def __init__(self, path: Path) -> None:
        """Read a Python file: its statements, what they define and what it imports."""
        self.path = path
        self.statements: list[ast.stmt] = []
        self.definitions: dict[str, list[int]] = {}  # name -> statements that define it
        self.always: list[int] = []  # statements that define no name, and run
        self.local: dict[
            str, tuple[Path, str]
        ] = {}  # name -> file, and name in it; "": the file
        self.outside: dict[
            str, str
        ] = {}  # name -> what is imported from another package
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                self._add_import(node)
            elif not _is_aside(node):
                self._add(node)

    def _add_import(self, node: ast.Import | ast.ImportFrom) -> None:
        """Record where each imported name comes from."""
        of = (node.module or "") if isinstance(node, ast.ImportFrom) else ""
        for alias in node.names:
            name = alias.asname or alias.name
            if not (isinstance(node, ast.ImportFrom) and node.level):
                self.outside[name] = f"{of}.{alias.name}"
                continue
            base = (
                self.path.parents[node.level - 1].joinpath(*of.split("."))
                if of
                else (self.path.parents[node.level - 1])
            )
            module, inside = (
                (base / alias.name).with_suffix(".py"),
                base.with_suffix(".py"),
            )
            if module.is_file():
                self.local[name] = module, ""
            else:
                self.local[name] = (
                    (inside if inside.is_file() else base / "__init__.py"),
                    alias.name,
                )

    def _add(self, node: ast.stmt) -> None:
        """Record a statement and the names that it defines."""
        place = len(self.statements)
        self.statements.append(node)
        names = _names_defined(node)
        for name in names:
            self.definitions.setdefault(name, []).append(place)
        if not names:
            self.always.append(place)


@cache
def _module(path: Path, _modification_time: int) -> _Module:
    """Read a file once for each of its modification times."""
    return _Module(path)


def _names_defined(node: ast.stmt) -> list[str]:
    """Return the names that a top-level statement defines."""
    if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
        return [node.name]
    targets: list[ast.expr] = []
    if isinstance(node, ast.Assign):
        targets = node.targets
    elif isinstance(node, (ast.AnnAssign, ast.AugAssign)):
        targets = [node.target]
    return [x.id for t in targets for x in ast.walk(t) if isinstance(x, ast.Name)]


def used_by(path: Path) -> set[str]:
    """Return what a file defines, and what that uses of the files that it imports.

    Parameters
    ----------
    path
        A file of components/. All its definitions count; of other files those that are
        used, directly or indirectly.

    Returns
    -------
    set
        A text for each definition, and for each name of another package.
    """
    texts = set[str]()
    places_visited = set[tuple[Path, int]]()
    first = _module(path, path.stat().st_mtime_ns)
    todo = [(first, place) for place in range(len(first.statements))]
    while todo:
        module, place = todo.pop()
        if (module.path, place) in places_visited:
            continue
        places_visited.add((module.path, place))
        node = module.statements[place]
        texts.add(_dump(node, True))
        todo += [(module, other) for other in module.always]
        for name, attribute in _names_used(node):
            if name in module.definitions:
                todo += [(module, other) for other in module.definitions[name]]
            elif name in module.outside:
                texts.add(f"import {module.outside[name]}")
            elif name in module.local:
                todo += _defining_statements(*module.local[name], attribute)
    return texts


def _defining_statements(
    path: Path, name: str, attribute: str
) -> list[tuple[_Module, int]]:
    """Return the statements of a file that define a name.

    Without a name, `attribute` is searched for; where that is not found either, all
    statements are returned.
    """
    module = _module(path, path.stat().st_mtime_ns)
    sought_name = name or attribute
    if sought_name in module.definitions:
        return [(module, place) for place in module.definitions[sought_name]]
    if sought_name in module.local:  # the module re-exports it
        return _defining_statements(*module.local[sought_name], "")
    return [(module, place) for place in range(len(module.statements))]


def _names_used(node: ast.AST) -> set[tuple[str, str]]:
    """Return the names that a statement reads, each with the attribute read from it."""
    attributes = {
        id(x.value): x.attr
        for x in ast.walk(node)
        if isinstance(x, ast.Attribute) and isinstance(x.value, ast.Name)
    }
    return {
        (x.id, attributes.get(id(x), ""))
        for x in ast.walk(node)
        if isinstance(x, ast.Name)
    }
