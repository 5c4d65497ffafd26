"""The blocks that there are: every module of `components.blocks` holds one."""

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
    """The names of all blocks, sorted; the name of a block is that of its file and its
    FMU."""
    return tuple(sorted(m.name for m in pkgutil.iter_modules(blocks.__path__)))


def block_class(which: str) -> type[Block]:
    """The block of a name, or of a file of the user's own. Raises KeyError for an
    unknown name, TypeError where a file of the folder does not hold exactly one block,
    OwnBlockError."""
    return own.block_class(which) if own.is_own(which) else _ours(which)


@cache
def _ours(name: str) -> type[Block]:
    if name not in names():
        raise KeyError(name)
    module = importlib.import_module(f"desat.components.blocks.{name}")
    found = [
        c
        for c in vars(module).values()
        if inspect.isclass(c)
        and issubclass(c, Block)
        and c.__module__ == module.__name__
    ]
    if len(found) != 1:
        raise TypeError(
            f"components/blocks/{name}.py must hold one block, it has {len(found)}"
        )
    return found[0]
