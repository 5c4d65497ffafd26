"""Write a block class of a program or a notebook to a file, so that FMUs follow from it.

The file has the class, the functions and constants of its module that it uses, and an
import for every other name. It lies in the user's cache, under a hash of its text.
"""

from __future__ import annotations

import ast
import builtins
import hashlib
import inspect
import linecache
import pkgutil
import re
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import desat.components
from desat.components.contract.block import Block
from desat.fmus.own import OwnBlockError, block_class, identifier

from ..system.errors import DesatError
from . import paths
from .io import replace_text


def file_of(block: type[Block]) -> Path:
    """Return a file that holds this block class alone.

    It is the class's own file if that is a block file, otherwise one in the cache.

    Raises
    ------
    DesatError
        If its source is not known, it uses a name that no file can have, or its name is
        that of a block of the project.
    """
    node, path = _definition(block)
    try:
        if path.suffix == ".py" and block_class(str(path)).__name__ == block.__name__:
            return path
    except OwnBlockError:
        pass  # the file holds more than the block
    texts: dict[str, str] = {}
    _collect(node, vars(sys.modules[block.__module__]), block.__name__, texts)
    imports = sorted(x for x in texts.values() if _is_import(x))
    others = [x for x in texts.values() if not _is_import(x)]
    parts = ["from __future__ import annotations", "\n".join(imports), *others]
    text = "\n\n\n".join(filter(None, [*parts, ast.unparse(node)])) + "\n"
    name = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", block.__name__).lower()
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    file = paths.cache() / "classes" / digest / f"{name}.py"
    try:
        identifier(str(file))
    except OwnBlockError as error:
        raise DesatError(f"{block.__name__}: {error}") from None
    file.parent.mkdir(parents=True, exist_ok=True)
    replace_text(file, text)
    return file


def _definition(block: type[Block]) -> tuple[ast.ClassDef, Path]:
    """Return the statement that defines a class, and the file where it stands.

    A notebook's cells are files for `linecache`, which its functions name.
    """
    functions = [f for f in vars(block).values() if isinstance(f, FunctionType)]
    for function in functions:
        file = inspect.unwrap(function).__code__.co_filename
        try:
            tree = ast.parse("".join(linecache.getlines(file)))
        except SyntaxError:
            continue
        for node in ast.walk(tree):
            if isinstance(node, ast.ClassDef) and node.name == block.__name__:
                return node, Path(file)
    raise DesatError(
        f"{block.__name__}: its source is not known: write the class to a file, and give "
        "the file"
    )


def _is_import(text: str) -> bool:
    """Return whether a text is an import."""
    return text.startswith(("import ", "from "))


def _collect(
    node: ast.AST, scope: dict[str, Any], name: str, texts: dict[str, str]
) -> None:
    """Add a text for each name of a module's `scope` that a definition uses."""
    for used in _names(node):
        if used in texts or used == name or used not in scope:
            continue
        value = scope[used]
        if isinstance(value, FunctionType) and value.__globals__ is scope:
            function = ast.parse(inspect.getsource(value)).body[0]
            _collect(function, scope, used, texts)
            texts[used] = ast.unparse(function)
        else:
            texts[used] = _text(used, value, name)


def _names(node: ast.AST) -> Iterator[str]:
    """Yield the names that a definition reads, those in annotations too."""
    for inner in ast.walk(node):
        if isinstance(inner, ast.Name) and not hasattr(builtins, inner.id):
            yield inner.id


def _text(name: str, value: Any, block: str) -> str:
    """Return the statement that defines a name in the file."""
    if isinstance(value, ModuleType):
        package, _, last = value.__name__.rpartition(".")
        alias = "" if last == name else f" as {name}"
        start = f"from {package} " if package else ""
        return f"{start}import {last}{alias}"
    origin = getattr(value, "__module__", None), getattr(value, "__name__", None)
    loaded_module = sys.modules.get(origin[0] or "")
    is_there = getattr(loaded_module, origin[1] or "", None) is value
    if is_there and origin[0] not in ("__main__", "builtins", None):
        alias = "" if origin[1] == name else f" as {name}"
        return f"from {origin[0]} import {origin[1]}{alias}"
    for module in _contract():
        if getattr(module, name, None) is value:
            return f"from {module.__name__} import {name}"
    if isinstance(value, (bool, int, float, str, tuple)):
        return f"{name} = {value!r}"
    raise DesatError(
        f"{block}: {name}, a {type(value).__name__} of its module, cannot stand in a "
        "block file: a number, a text, a function or an import is needed"
    )


def _contract() -> Iterator[ModuleType]:
    """Yield the modules that blocks import aliases as `Vec3` from."""
    yield import_module("desat.components.contract.block")
    for folder in ("contract", "maths", "laws", "physics", "bases"):
        package = import_module(f"{desat.components.__name__}.{folder}")
        for info in pkgutil.iter_modules(package.__path__):
            yield import_module(f"{package.__name__}.{info.name}")
