"""List the blocks of the project: every module of `components.blocks` holds one."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
from collections.abc import Mapping
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


# Lengths of a block's arrays that are not the usual ones, by kind, sorted.
Sizes = tuple[tuple[str, int], ...]


def block_class(block_ref: str, sizes: Sizes = ()) -> type[Block]:
    """Return the class of a block, given by name or by a user's own file.

    `sizes` are those of a block of ours.

    Raises
    ------
    KeyError
        If no block has this name.
    TypeError
        If a file of components/blocks does not hold exactly one block.
    OwnBlockError
        If the user's own file is no block.
    """
    if own.is_own(block_ref):
        return own.block_class(block_ref)
    return _with_sizes(block_ref, sizes) if sizes else _ours(block_ref)


def sizes_of(name: str, sizes: Mapping[str, int]) -> Sizes:
    """Return which of some lengths are not the usual ones of a block."""
    usual = {k: n for v in block_class(name).variables for k, n in v.sizes.items()}
    return tuple(sorted((k, n) for k, n in sizes.items() if usual.get(k, n) != n))


def sized_name(name: str, sizes: Sizes) -> str:
    """Return the name of a block with such lengths, which is one of C."""
    return name + "".join(f"_of_{n}_{kind}" for kind, n in sizes)


def sized_text(name: str, sizes: Sizes) -> str:
    """Return a block file that gives a block of ours such lengths."""
    base = _ours(name)
    title = (base.__doc__ or "").partition("\n")[0]
    words = ", ".join(f"{n} {kind}" for kind, n in sizes)
    keywords = ", ".join(f"{kind}={n}" for kind, n in sizes)
    return (
        f"from __future__ import annotations\n\n"
        f"from desat.components.blocks.{name} import {base.__name__}\n\n\n"
        f"class {base.__name__}{''.join(f'Of{n}' for _, n in sizes)}"
        f'({base.__name__}, {keywords}):\n    """{title}: {words}"""\n'
    )


@cache
def _with_sizes(name: str, sizes: Sizes) -> type[Block]:
    """Return a block of ours with such lengths."""
    base = _ours(name)
    of_base = {"__doc__": base.__doc__, "__module__": base.__module__}
    return type(base.__name__, (base,), of_base, **dict(sizes))


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
