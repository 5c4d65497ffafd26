"""Write the index of a folder: its crafts and pages, each with verdict and picture."""

from __future__ import annotations

import base64
import os
import re
from collections.abc import Iterator
from datetime import UTC, datetime
from html import unescape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

from ..figures import craft
from ..files.paths import NOMINAL
from ..runs.drawings import craft_of_system
from ..runs.prepare import read, resolved
from ..system.errors import DesatError, plain
from ..system.options import Options
from .cases import find_cases
from .report import GENERATOR, render, versions, write_page

INDEX = "index.html"
DEEPEST = 4  # folders below the one that is listed
HEAD = 4000  # letters of a page within which its generator stands
# headings of the index by the template of a page, in this order
HEADINGS = {
    "craft": "Crafts",
    "report": "Runs",
    "sizing": "Sizings",
    "campaign": "Campaigns",
    "compare": "Comparisons",
    "overlay": "Logs over runs",
    "study": "Sweeps and maps",
    "budget": "Budgets",
    "web": "Live pages",
}
KIND = re.compile(f'<meta name="generator" content="{GENERATOR} ([a-z]+)">')
TITLE = re.compile(r"<title>(.*?)</title>", re.DOTALL)
VERDICT = re.compile(r'<p class="(ok|bad)"><b>(.*?)</b>', re.DOTALL)
PICTURE = re.compile(r'<div class="still">(<svg.*?</svg>)', re.DOTALL)


class Entry(NamedTuple):
    """Craft or page of the index."""

    kind: str
    title: str
    path: str  # relative to the index
    link: str
    date: str
    mark: str  # "ok", "bad" or ""
    verdict: str
    picture: str  # SVG as the address of an image; "" without one


def write_index(folder: Path) -> tuple[Path, int]:
    """Write index.html of a folder, the newest page of a kind first.

    Returns its path and the number of entries.

    Raises
    ------
    DesatError
        If there is no such folder, it has neither crafts nor pages of ours, or its
        index.html is none of ours.
    OSError
        If it cannot be written.
    """
    if not folder.is_dir():
        raise DesatError(f"{folder}: no such folder")
    index = folder / INDEX
    if index.exists() and _kind_of(index) != "index":
        raise DesatError(f"{index}: it is none of desat's, and stays as it is")
    files = list(_files(folder))
    sizings = list(dict.fromkeys(f.parent for f in files if f.match("size-*.json")))
    entries = [
        *(_craft(folder, f.parent, sizings) for f in files if f.name == NOMINAL),
        *(e for f in files if f.suffix == ".html" for e in _page(folder, f)),
    ]
    if not entries:
        raise DesatError(f"{folder}: neither crafts nor pages of desat")
    entries.sort(key=lambda entry: entry.date, reverse=True)
    groups = {
        heading: of_kind
        for kind, heading in HEADINGS.items()
        if (of_kind := [entry for entry in entries if entry.kind == kind])
    }
    title = f"{plain(folder.resolve().name)}: crafts and results"
    page = render("index.html", title=title, groups=groups, versions=versions())
    return write_page(index, page), len(entries)


def _files(folder: Path) -> Iterator[Path]:
    """Yield the files of a folder and of those in it, except hidden ones."""
    for place, folders, names in os.walk(folder):
        depth = len(Path(place).relative_to(folder).parts)
        is_deepest = depth == DEEPEST
        folders[:] = (
            [] if is_deepest else sorted(f for f in folders if f[0] not in "._")
        )
        yield from (Path(place) / name for name in sorted(names))


def _kind_of(page: Path) -> str:
    """Return the template that a page was made from; "" where it is none of ours."""
    with page.open(encoding="utf-8", errors="replace") as file:
        match = KIND.search(file.read(HEAD))
    return match[1] if match else ""


def _page(folder: Path, page: Path) -> Iterator[Entry]:
    """Yield the entry of a page; none where it is not ours."""
    kind = _kind_of(page)
    if kind not in HEADINGS:
        return
    text = page.read_text(encoding="utf-8", errors="replace")
    title, verdict, picture = (p.search(text) for p in (TITLE, VERDICT, PICTURE))
    yield _entry(
        folder,
        page,
        kind,
        unescape(title[1]) if title else page.stem,
        verdict[1] if verdict else "",
        unescape(verdict[2]) if verdict else "",
        picture[1] if picture else "",
    )


def _craft(folder: Path, place: Path, sizings: list[Path]) -> Entry:
    """Return the entry of a craft, with the verdict of a sizing where there is one."""
    nominal = place / NOMINAL
    try:
        title = read(str(place)).content.title
        system, _ = resolved(str(place), Options())
        parts = craft_of_system(system)
    except DesatError as error:
        line = str(error).partition("\n")[0]
        return _entry(folder, nominal, "craft", place.name, "bad", line, "")
    cases = [x for f in sizings for x in find_cases(f, [system.parameters])]
    return _entry(
        folder,
        nominal,
        "craft",
        title or place.name,
        ("ok" if cases[0].holds else "bad") if cases else "",
        cases[0].verdict if cases else f"not sized yet: desat size {place}",
        craft.sketch(parts, title) if parts else "",
    )


def _entry(
    folder: Path, file: Path, kind: str, title: str, mark: str, verdict: str, svg: str
) -> Entry:
    """Return an entry with path, date and address of the picture."""
    path = file.relative_to(folder).as_posix()
    changed_at = datetime.fromtimestamp(file.stat().st_mtime, UTC)
    image = base64.b64encode(svg.encode()).decode()
    return Entry(
        kind,
        plain(title),
        plain(path),
        quote(os.fsencode(path)),
        f"{changed_at:%Y-%m-%d %H:%M}",
        mark,
        plain(verdict),
        f"data:image/svg+xml;base64,{image}" if svg else "",
    )
