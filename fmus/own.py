"""Read a user's own block: one Python file, anywhere, that holds one block.

It is written like the files of components/blocks/, with absolute imports
(`from desat.components.contract.roles import Manager`). In an FMU it stands among these
files and imports their modules as they do.
"""

from __future__ import annotations

import ast
import difflib
import hashlib
import inspect
import pkgutil
import re
import sys
import textwrap
import traceback
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from desat.components import blocks
from desat.components.contract.block import Block, Sampled
from desat.components.contract.roles import Computer

SUFFIX = ".py"
_OURS = "desat.components."


class OwnBlockError(Exception):
    """A file that cannot be a block; the text gives file, line and a replacement."""


def is_own(block_ref: str) -> bool:
    """Return whether a block is given by its file, not by a name of the project."""
    return block_ref.endswith(SUFFIX)


def identifier(block_ref: str) -> str:
    """Return the name of a block and of its FMU.

    It is a name of the project, or the name of the file without its suffix.

    Raises
    ------
    OwnBlockError
        If the file's name cannot be a name in C, or a block of the project has it.
    """
    if not is_own(block_ref):
        return block_ref
    file = Path(block_ref)
    if not (file.stem.isascii() and file.stem.isidentifier()):
        better = re.sub(r"\W", "_", file.stem, flags=re.ASCII)
        better = f"block_{better}" if better[:1].isdigit() else better
        raise OwnBlockError(
            f"{file.name}: its name becomes one of C: call it {better}{SUFFIX}"
        )
    if file.stem in (m.name for m in pkgutil.iter_modules(blocks.__path__)):
        raise OwnBlockError(
            f"{file.name}: a block of ours has this name: call the file otherwise"
        )
    return file.stem


def shipped_text(block_ref: str) -> str:
    """Return the text of a block file as an FMU holds it, line by line the same.

    Imports of `desat.components` become relative.

    Raises
    ------
    OwnBlockError
        If the file has an import that an FMU cannot resolve.
    """
    path = Path(block_ref)
    text = _text(path)
    lines = text.splitlines(keepends=True)
    for node in ast.walk(_tree(path, text)):
        if not isinstance(node, (ast.Import, ast.ImportFrom)):
            continue
        at = f"{path.name}:{node.lineno}"
        if isinstance(node, ast.ImportFrom) and node.level:
            raise OwnBlockError(
                f"{at}: a relative import: write `from desat.components...`, and "
                "put functions of your own into this file"
            )
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(_OURS):
            line = lines[node.lineno - 1]
            head, tail = line[: node.col_offset], line[node.col_offset :]
            match = re.match(r"from\s+desat\.components\.", tail)
            if match is None:
                raise OwnBlockError(
                    f"{at}: write `from {node.module} import` on one line"
                )
            lines[node.lineno - 1] = f"{head}from ..{tail[match.end() :]}"
            continue
        names = (
            [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else [alias.name for alias in node.names]
        )
        for name in names:
            _importable(name, path, at)
    return "".join(lines)


def _importable(name: str, path: Path, at: str) -> None:
    """Raise OwnBlockError for a module that an FMU would not find."""
    top = name.partition(".")[0]
    if top == "desat":
        raise OwnBlockError(
            f"{at}: import of {name}: a block uses desat.components alone, as in "
            "`from desat.components.maths import vector`"
        )
    if top in sys.stdlib_module_names:
        return
    if (path.parent / f"{top}.py").exists() or (
        path.parent / top / "__init__.py"
    ).exists():
        raise OwnBlockError(
            f"{at}: import of {name}, which lies beside it: one file is one FMU: "
            "put what it needs into this file"
        )
    if find_spec(top) is None:
        raise OwnBlockError(f"{at}: import of {name}: there is no such module")


def block_class(block_ref: str) -> type[Block]:
    """Return the block class that a file holds.

    Raises
    ------
    OwnBlockError
        If the file does not hold exactly one complete block, or as in `shipped_text`.
    """
    path = Path(block_ref)
    name = identifier(block_ref)
    shipped_text(block_ref)
    text = _text(path)
    module = ModuleType(
        f"desat_own_{name}_{hashlib.sha256(text.encode()).hexdigest()[:16]}"
    )
    module.__file__ = str(path.absolute())
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, module.__file__, "exec", dont_inherit=True), vars(module))
    except Exception as error:
        here = [
            f.lineno
            for f in traceback.extract_tb(error.__traceback__)
            if f.filename == module.__file__
        ]
        line = f":{here[-1]}" if here else ""
        raise OwnBlockError(
            f"{path.name}{line}: {type(error).__name__}: {error}"
        ) from error
    classes = [
        c
        for c in vars(module).values()
        if inspect.isclass(c)
        and issubclass(c, Block)
        and c.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise OwnBlockError(
            f"{path.name}: it must hold one class that derives from a role of "
            "desat.components.contract.roles, or from Block; it has "
            f"{len(classes)}"
        )
    (block,) = classes
    first = next(
        n.lineno
        for n in ast.walk(_tree(path, text))
        if isinstance(n, ast.ClassDef) and n.name == block.__name__
    )
    open_ = [
        n
        for n in dir(block)
        if getattr(getattr(block, n), "__isabstractmethod__", False)
    ]
    if open_:
        raise OwnBlockError(
            f"{path.name}:{first}: {block.__name__} lacks what its role leaves to "
            f"it: write `def {open_[0]}`"
        )
    if missing := find_unassigned(block):
        raise OwnBlockError(f"{path.name}:{first}: {block.__name__}.{missing[0]}")
    if issubclass(block, Sampled):
        _bound_sample_time(block)
    return block


def _bound_sample_time(block: type[Sampled]) -> None:
    """Allow no `sample_time` but 0 where a block's steps do not use it.

    A block uses it itself or through `due`.
    """
    _, read = _attributes(block, "advance")
    if read & {"due", "sample_time", "*"}:
        return
    method = "compute" if issubclass(block, Computer) else "advance"
    text = f"no effect: {method} does not call self.due(t), so it runs at every step"
    block.variables = tuple(
        replace(v, maximum=0.0, description=text) if v.name == "sample_time" else v
        for v in block.variables
    )


def find_unassigned(block: type[Block]) -> list[str]:
    """Return a line for each output of a block that keeps its start value for ever.

    A state output must be assigned by `output`, an interval output by `advance`, or by
    methods that these call. An output assigned in `start` alone is reported only where
    a similar name is assigned that is not declared. The list is empty where `setattr`
    or `vars` hides assignments.
    """
    declared_names = {v.name for v in block.variables}
    start_names, *rest = (
        _attributes(block, name)[0] for name in ("start", "output", "advance")
    )
    if any("*" in names for names in (start_names, *rest)):
        return []  # setattr or vars: assignments cannot be found
    strange = {
        n for names in (start_names, *rest) for n in names if n[0] != "_"
    } - declared_names
    lines = []
    for v in block.variables:
        method = "advance" if v.interval else "output"
        if v.causality != "output" or v.name == "fault" or v.name in rest[v.interval]:
            continue
        close_names = difflib.get_close_matches(v.name, strange, 1)
        if close_names or v.name not in start_names:
            hint = (
                f"; it assigns self.{close_names[0]}, which is not declared"
                if close_names
                else ""
            )
            lines.append(f"{v.name}: {method} does not assign this output{hint}")
    return lines


def _attributes(block: type[Block], method: str) -> tuple[set[str], set[str]]:
    """Return the attributes of `self` that a method and its callees assign, and read.

    `*` is among both where setattr or vars is used.
    """
    mro, assigned_names, read = block.__mro__[:-1], set[str](), set[str]()
    methods_visited, todo = set[Any](), [(method, mro)]
    while todo:
        name, classes = todo.pop()
        owner = next((c for c in classes if name in vars(c)), None)
        attribute = owner and vars(owner)[name]
        attribute = attribute.fget if isinstance(attribute, property) else attribute
        if (
            owner is None
            or not inspect.isfunction(attribute)
            or attribute in methods_visited
        ):
            continue
        methods_visited.add(attribute)
        for node in ast.walk(ast.parse(textwrap.dedent(inspect.getsource(attribute)))):
            if isinstance(node, ast.Name) and node.id in ("setattr", "vars"):
                assigned_names.add("*")
                read.add("*")
            if not isinstance(node, ast.Attribute):
                continue
            of = ast.unparse(node.value)
            if of == "self" and isinstance(node.ctx, ast.Store):
                assigned_names.add(node.attr)
            elif of == "self":
                read.add(node.attr)
                todo.append((node.attr, mro))
            elif of == "super()":
                todo.append((node.attr, mro[mro.index(owner) + 1 :]))
    return assigned_names, read


def _text(path: Path) -> str:
    """Read a block file, or raise OwnBlockError."""
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise OwnBlockError(f"{path}: {reason}") from error


def _tree(path: Path, text: str) -> ast.Module:
    """Parse a block file, or raise OwnBlockError with the line."""
    try:
        return ast.parse(text)
    except (SyntaxError, ValueError) as error:
        line = getattr(error, "lineno", None)
        reason = getattr(error, "msg", str(error))
        raise OwnBlockError(
            f"{path.name}{f':{line}' if line else ''}: {reason}"
        ) from error
