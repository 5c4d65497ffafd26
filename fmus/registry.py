"""List the blocks of the project: every module of `components.blocks` holds one."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from functools import cache

from desat.components import blocks
from desat.components.contract.block import Block

from . import own


@cache
def names() -> tuple[str, ...]:
    """Return the sorted names of all blocks.

    The name of a block is that of its file and of its FMU.
    """
    return tuple(sorted(m.name for m in pkgutil.iter_modules(blocks.__path__)))


def block_class(block_ref: str) -> type[Block]:
    """Return the class of a block, given by name or by a user's own file.

    Raises
    ------
    KeyError
        If no block has this name.
    TypeError
        If a file of components/blocks does not hold exactly one block.
    OwnBlockError
        If the user's own file is no block.
    """
    return own.block_class(block_ref) if own.is_own(block_ref) else _ours(block_ref)


@cache
def _ours(name: str) -> type[Block]:
    """Import a block of the project by its name."""
    if name not in names():
        raise KeyError(name)
    module = importlib.import_module(f"desat.components.blocks.{name}")
    classes = [
        c
        for c in vars(module).values()
        if inspect.isclass(c)
        and issubclass(c, Block)
        and c.__module__ == module.__name__
    ]
    if len(classes) != 1:
        raise TypeError(
            f"components/blocks/{name}.py must hold one block, it has {len(classes)}"
        )
    return classes[0]
