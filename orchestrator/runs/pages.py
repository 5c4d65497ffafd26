"""Read the pages of the documentation, which an installation has, too: `desat help`."""

from __future__ import annotations

from pathlib import Path

from ..files import paths
from ..system.errors import DesatError, nearest

FOLDERS = ("", "tutorials/", "understand/")  # folders of the pages for users


def titles() -> dict[str, str]:
    """Return the titles of the pages, by name."""
    return {name: _title(path) for name, path in _pages().items()}


def text(name: str) -> str:
    """Return a page as Markdown; raise DesatError where there is none of this name."""
    known = _pages()
    if name not in known:
        raise DesatError(f"desat help {name}: no such topic{nearest(name, known)}")
    return known[name].read_text(encoding="utf-8")


def _pages() -> dict[str, Path]:
    """Return the paths of the pages, by name."""
    files = (p for form in FOLDERS for p in sorted(paths.PAGES.glob(f"{form}*.md")))
    return {p.stem: p for p in files if p.name != "index.md"}


def _title(path: Path) -> str:
    """Return a page's first heading, or its name."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return next(
        (line.removeprefix("# ") for line in lines if line.startswith("# ")), path.stem
    )
