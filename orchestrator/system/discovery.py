"""What the package finds in its folders: analyses, commands, providers, templates.

A folder of a name counts at the top of the package and in each of its rooms, so that a room adds
what it has without being imported by others: `papers/commands/` adds to `cli/commands/`. A room
that is absent adds nothing.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from pathlib import Path
from types import ModuleType

PACKAGE = __name__.split(".")[0]
HOME = Path(__file__).parents[1]


def folders(name: str) -> list[Path]:
    """Return the folders of this name, that at the top of the package first."""
    return [path for path in (HOME / name, *sorted(HOME.glob(f"*/{name}"))) if path.is_dir()]


def modules(name: str) -> list[tuple[str, str]]:
    """Return the modules in the folders of this name: file name and full name, in this order."""
    files = (file for folder in folders(name) for file in folder.glob("*.py"))
    return sorted(
        (file.stem, ".".join([PACKAGE, *file.relative_to(HOME).with_suffix("").parts]))
        for file in files
        if file.stem != "__init__"
    )


def imported(names: Iterable[str]) -> list[ModuleType]:
    """Return the modules of these full names, imported."""
    return [importlib.import_module(name) for name in names]
