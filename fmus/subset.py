"""`python -m desat.fmus.subset`: hold the blocks to what translates to C.

Every block is translated; what leaves the subset is told with its place and what to
write instead. Blocks that stay Python are in `native.PINNED`; one that is there and
translates is an error, too.
"""

from __future__ import annotations

import sys

from .native import PINNED
from .registry import block_class, names
from .translate.program import translate
from .translate.types import SubsetError


def problems() -> list[str]:
    """A line a block that leaves the subset, and a line a pinned one that need not be."""
    lines = [
        f"fmus/native.py: PINNED has {name}, which is no block"
        for name in PINNED
        if name not in names()
    ]
    for name in names():
        try:
            translate(block_class(name), name, "")
        except SubsetError as refused:
            if name not in PINNED:
                lines.append(
                    f"{refused} ({name} is to be native; else fmus/native.py, PINNED)"
                )
        else:
            if name in PINNED:
                lines.append(
                    f"fmus/native.py: {name} translates and need not be in PINNED"
                )
    return lines


def main() -> int:
    """Print what leaves the subset; 1 where something does."""
    lines = problems()
    print(
        "\n".join(lines)
        or f"{len(names()) - len(PINNED)} blocks translate, {len(PINNED)} are "
        f"pinned to Python: {', '.join(sorted(PINNED))}"
    )
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
