"""Find analyses, commands, providers and templates in the package's folders.

A folder of a name counts at the top of the package and in each of its rooms, so that a
room contributes its content without being imported by others: `papers/commands/` adds
to `cli/commands/`. A room that is absent adds nothing.
"""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType

PACKAGE = __name__.split(".")[0]
HOME = Path(__file__).parents[1]


def folders(name: str) -> list[Path]:
    """Return the folders of this name, the one at the top of the package first."""
    return [
        path for path in (HOME / name, *sorted(HOME.glob(f"*/{name}"))) if path.is_dir()
    ]


def load(folder: str, name: str = "*") -> list[ModuleType]:
    """Import the modules in the folders of this name, ordered by file name.

    `name` selects the modules of one file name.
    """
    files = [*HOME.glob(f"{folder}/{name}.py"), *HOME.glob(f"*/{folder}/{name}.py")]
    parts = [
        file.relative_to(HOME).with_suffix("").parts
        for file in sorted(files, key=lambda file: file.name)
        if file.stem != "__init__"
    ]
    return [importlib.import_module(".".join([PACKAGE, *names])) for names in parts]
