"""What blocks, and Python files, compute, as a hash in which texts, layout and the
place of a file do not count."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

from . import own

COMPONENTS = Path(__file__).parents[1] / "components"


def sources(which: str) -> list[Path]:
    """The files of components/ that a block needs, found through its imports: of ours
    itself first; one of the user's own is not among them."""
    place = COMPONENTS / "blocks" / f"{own.identifier(which)}.py"
    todo, found = [place], list[Path]()
    if own.is_own(which):
        todo = [place.parent / "__init__.py", *_imported(place, own.shipped(which))]
    while todo:
        path = todo.pop()
        if path in found:
            continue
        found.append(path)
        if (initial := path.parent / "__init__.py").exists():
            todo.append(initial)
        todo += _imported(path, path.read_text(encoding="utf-8"))
    data = [p.with_suffix(".json") for p in found if p.with_suffix(".json").is_file()]
    return found + data


@cache
def _imported(path: Path, text: str) -> list[Path]:
    """The files that a file with this text imports of its own package."""
    found = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = path.parents[node.level - 1].joinpath(
                *(node.module or "").split(".")
            )
            candidates = (base, *(base / alias.name for alias in node.names))
            found += [
                c.with_suffix(".py")
                for c in candidates
                if c.with_suffix(".py").is_file()
            ]
    return found


def computed(which: str) -> dict[str, Any]:
    """What a block computes: `computes`, its hash; the files that it is of, and the
    hash of their bytes, by which it is told in a moment whether they are still the same
    (`is_as`); those not of one of the user's own, whose file may be gone."""
    files = sources(which)
    if own.is_own(which):
        return {"computes": of_files([Path(which), *files])}
    data = [p for p in files if p.suffix != ".py"]
    said = {*used_by(files[0]), *(p.read_text(encoding="utf-8") for p in data)}
    return {
        "computes": _hash_of(said),
        "files": [p.relative_to(COMPONENTS).as_posix() for p in files],
        "files_sha256": _hashed(files),
    }


def is_as(entry: dict[str, Any]) -> bool:
    """Whether the files of a block are as they were when an entry of the index was
    made."""
    files = [COMPONENTS / file for file in entry.get("files", ())]
    return (
        bool(files)
        and all(f.is_file() for f in files)
        and (_hashed(files) == entry["files_sha256"])
    )


def _hashed(files: list[Path]) -> str:
    digest = hashlib.sha256()
    for path in files:
        data = path.read_bytes()
        digest.update(f"\0{len(data)}\0".encode() + data)
    return digest.hexdigest()


def of_files(files: Iterable[Path], imports: bool = True) -> str:
    """sha256 of what files define, whichever of them it is in: of Python the
    definitions, of others (C, tables of numbers) the text."""
    texts = ((p.suffix, p.read_text(encoding="utf-8")) for p in files)
    return _hash_of(
        {
            x
            for kind, t in texts
            for x in (definitions(t, imports) if kind == ".py" else {t})
        }
    )


def _hash_of(said: Iterable[str]) -> str:
    return hashlib.sha256("\0".join(sorted(said)).encode()).hexdigest()


@cache
def definitions(text: str, imports: bool = True) -> frozenset[str]:
    """What a Python file defines: the syntax trees of its statements, without comments,
    docstrings and layout. Of an import the names count, and the file's, not its folder;
    none without `imports`, for files that are moved and renamed."""
    tree = ast.parse(text)
    if imports:
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom):
                node.level, node.module = 0, (node.module or "").rpartition(".")[2]
    kept = [
        x
        for x in tree.body
        if imports or not isinstance(x, (ast.Import, ast.ImportFrom))
    ]
    return frozenset(_dump(x, imports) for x in kept if not _is_aside(x))


def _dump(node: Any, imports: bool) -> str:
    """A syntax tree as a text that is the same for every version of Python: unlike
    `ast.dump`, it leaves out every field that is empty."""
    if isinstance(node, list):
        kept = [
            x
            for x in node
            if imports or not isinstance(x, (ast.Import, ast.ImportFrom))
        ]
        return f"[{','.join(_dump(x, imports) for x in kept if not _is_aside(x))}]"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = ((k, v) for k, v in ast.iter_fields(node) if v is not None and v != [])
    return f"{type(node).__name__}({','.join(f'{k}={_dump(v, imports)}' for k, v in fields)})"


def _is_aside(node: Any) -> bool:
    """True for a statement that computes nothing: what is for types alone, and what is
    only a text, as a docstring."""
    if isinstance(node, ast.If):
        return isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


# --- What a file uses of the files that it imports ------------------------------------


class _Module:
    """The top-level statements of a file, the names that they define, and its imports."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.statements: list[ast.stmt] = []
        self.defined: dict[str, list[int]] = {}  # name -> statements that define it
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
        place = len(self.statements)
        self.statements.append(node)
        names = _names_defined(node)
        for name in names:
            self.defined.setdefault(name, []).append(place)
        if not names:
            self.always.append(place)


@cache
def _module(path: Path, _modified: int) -> _Module:
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
        A file of components/; all of it counts, of others what is used, directly or not.

    Returns
    -------
    set
        A text for each definition, and for each name of another package.
    """
    texts = set[str]()
    done = set[tuple[Path, int]]()
    first = _module(path, path.stat().st_mtime_ns)
    todo = [(first, place) for place in range(len(first.statements))]
    while todo:
        module, place = todo.pop()
        if (module.path, place) in done:
            continue
        done.add((module.path, place))
        node = module.statements[place]
        texts.add(_dump(node, True))
        todo += [(module, other) for other in module.always]
        for name, attribute in _names_used(node):
            if name in module.defined:
                todo += [(module, other) for other in module.defined[name]]
            elif name in module.outside:
                texts.add(f"import {module.outside[name]}")
            elif name in module.local:
                todo += _found(*module.local[name], attribute)
    return texts


def _found(path: Path, name: str, attribute: str) -> list[tuple[_Module, int]]:
    """Return the statements of a file that a name stands for; without one, all or an
    attribute."""
    module = _module(path, path.stat().st_mtime_ns)
    wanted = name or attribute
    if wanted in module.defined:
        return [(module, place) for place in module.defined[wanted]]
    if wanted in module.local:  # it hands on what it imports
        return _found(*module.local[wanted], "")
    return [(module, place) for place in range(len(module.statements))]


def _names_used(node: ast.AST) -> set[tuple[str, str]]:
    """Return the names that a statement reads, each with the attribute that is taken of
    it."""
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
