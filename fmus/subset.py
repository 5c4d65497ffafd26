"""`python -m desat.fmus.subset`: check that the blocks translate to C.

Every block is translated; what leaves the subset is reported with its place and a
replacement. Blocks that stay Python are listed in `native.PINNED`; a pinned block that
does translate is an error, too.
"""

from __future__ import annotations

import sys

from .native import PINNED
from .registry import block_class, names
from .translate.program import translate
from .translate.types import SubsetError


def problems() -> list[str]:
    """Return a line for each block that leaves the subset or is pinned needlessly."""
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
    """Print what leaves the subset and return the exit code, 1 if anything does."""
    lines = problems()
    print(
        "\n".join(lines)
        or f"{len(names()) - len(PINNED)} blocks translate, {len(PINNED)} are "
        f"pinned to Python: {', '.join(sorted(PINNED))}"
    )
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main())
