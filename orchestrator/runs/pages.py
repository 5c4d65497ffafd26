"""Read the pages of the documentation, which an installation has, too: `desat help`."""

from __future__ import annotations

import inspect
import re
import textwrap
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from desat.fmus.registry import block_class, names

from ..files import paths
from ..system.errors import DesatError, nearest

FOLDERS = ("", "tutorials/", "understand/")  # folders of the pages for users
WIDEST = 90  # letters of a line that a search shows
# parts of a page that are directives of the site, and what of them says nothing here
FENCED = re.compile(r"^```\{eval-rst\}\n.*?^```$", re.MULTILINE | re.DOTALL)
CODE = re.compile(r"^(?:```.*?^```$|    \S.*?$)", re.MULTILINE | re.DOTALL)
OTHERS = re.compile(
    r"^(?:```.*|\.\. automodule::.*|   :(?:no-)?members:)\n?", re.MULTILINE
)
# directives of the site that name a function or class of ours
DIRECTIVE = re.compile(
    r"^\.\. auto(?:function|class):: (?P<name>desat\.\w+)$",
    re.MULTILINE,
)


def titles() -> dict[str, str]:
    """Return the titles of the pages, by name."""
    return {name: _title(path) for name, path in _pages().items()}


def text(name: str) -> str:
    """Return a page as Markdown; raise DesatError where there is none of this name."""
    pages = _pages()
    if name not in pages:
        raise DesatError(f"desat help {name}: no such topic{nearest(name, pages)}")
    page = pages[name].read_text(encoding="utf-8")
    for fence in FENCED.findall(page):  # directives of the site
        lines = DIRECTIVE.sub(_signature, OTHERS.sub("", fence))
        page = page.replace(fence, re.sub(r"^\.\. py:\w+::", "-", lines, flags=re.M))
    return page


def _signature(match: re.Match[str]) -> str:
    """Return signature and first line of what a directive of the site names."""
    name = match["name"]
    owner, _, attribute = name.rpartition(".")
    value = getattr(import_module(owner), attribute)
    first = (inspect.getdoc(value) or "").partition("\n")[0]
    if isinstance(value, type) and issubclass(value, Exception):
        return f"- {name}\n\n   {first}"
    signature = str(inspect.signature(value)).replace("'", "")
    return f"- {name}{signature}\n\n   {first}"


def found(words: str) -> list[dict[str, str]]:
    """Search the topics for words that all occur in them.

    Returns a row for each topic, those with a word in their name or title first: its
    name, its title and the first line with a word.
    """
    terms = words.lower().split()
    rows: list[tuple[bool, int, dict[str, str]]] = []
    for name, title, body in _topics():
        text_searched = f"{name} {title} {body}".lower()
        if not all(word in text_searched for word in terms):
            continue
        is_titled = any(word in f"{name} {title}".lower() for word in terms)
        row = {"topic": name, "what it is": title, "first line": _line(body, terms)}
        rows.append((not is_titled, -sum(text_searched.count(w) for w in terms), row))
    rows.sort(key=lambda r: r[:2])
    return [row for _, _, row in rows]


def _line(body: str, terms: list[str]) -> str:
    """Return the first sentence with a term, of whole words and at most WIDEST long.

    Without one it is the first line with a term.
    """
    plain = CODE.sub("", body).partition("\n")[2]
    lines = [x for x in body.splitlines() if any(w in x.lower() for w in terms)]
    for paragraph in plain.split("\n\n"):
        for sentence in re.split(r"(?<=[.:;]) ", " ".join(paragraph.split())):
            if sentence[:1].isalpha() and any(w in sentence.lower() for w in terms):
                return textwrap.shorten(sentence, WIDEST, placeholder=" ...")
    return textwrap.shorten("".join(lines[:1]), WIDEST, placeholder=" ...")


def _topics() -> Iterator[tuple[str, str, str]]:
    """Yield name, title and text of each page and of each block."""
    for name, path in _pages().items():
        yield name, _title(path), path.read_text(encoding="utf-8")
    for name in names():
        text = inspect.getdoc(block_class(name)) or ""
        yield f"blocks {name}", text.partition("\n")[0], text


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
