"""A family's page, from the template beside its scenarios to Markdown with figures.

    ssp/FAMILY/page.md         -> docs/papers/FAMILY/README.md
    ssp/FAMILY/NAME.page.md    -> docs/papers/FAMILY/NAME.md

A template is Markdown with Jinja2: prose, and in `{{ }}` the verbs of `verbs.py`, whose
numbers and figures come from runs made now. A paragraph is set as one line; a table has
a line a row.
"""

from __future__ import annotations

import platform
import traceback
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import FileSystemLoader, StrictUndefined, TemplateError, TemplateSyntaxError
from jinja2.sandbox import SandboxedEnvironment

from desat.files import paths, scenario
from desat.files.identity import PACKAGES
from desat.report.report import write_page
from desat.system.errors import DesatError, RunError, nearest

from .sources import Sources
from .verbs import FILTERS, Verbs

PAGE = "page.md"
VERBS = Path(__file__).with_name("verbs.py")


def templates(family: str) -> dict[str, Path]:
    """The templates of a family by the name of the file that each becomes."""
    folder = scenario.ROOT / family
    named = {
        f"{p.name.removesuffix(f'.{PAGE}')}.md": p for p in folder.glob(f"*.{PAGE}")
    }
    first = folder / PAGE
    return ({"README.md": first} if first.exists() else {}) | dict(
        sorted(named.items())
    )


def families() -> tuple[str, ...]:
    """The families that have a page."""
    return tuple(f for f in scenario.families() if templates(f))


def write(
    family: str,
    into: Path | None = None,
    jobs: int = 1,
    draft: float | None = None,
    verbs: type[Verbs] = Verbs,
) -> list[Path]:
    """Write the pages of a family and their figures into a folder; figures there that
    no page has any more are removed. `into` None: the family's folder under
    docs/papers.

    `verbs`: what templates may call. `draft`: to try a template in a short time, runs
    end after so many seconds at the latest, stored draws stay as they are, and the page
    says so. Raises DesatError, with the template's line, for what is wrong with it.
    """
    if not (known := templates(family)):
        hint = nearest(family, families())
        raise DesatError(
            f"no page {family}{hint}; {PAGE} beside its scenarios would be one"
        )
    if into is None:
        paths.writable("benchmarks.pages", "--into FOLDER")
        if draft is not None:
            raise DesatError(
                "--draft: --into FOLDER is needed, too; a draft is not for docs/papers"
            )
    folder = into or paths.DRAWS / family
    texts = [p.read_text(encoding="utf-8") for p in known.values()]
    of = verbs(Sources(family, texts, jobs, draft))
    pages = {
        file: _rendered(template, of) + _origin(draft)
        for file, template in known.items()
    }
    folder.mkdir(parents=True, exist_ok=True)
    for name, svg in of.figures.items():
        write_page(folder / name, svg)
    for old in folder.glob("*.svg"):
        if old.name not in of.figures:
            old.unlink()
    return [write_page(folder / file, text) for file, text in pages.items()]


class _Sandbox(SandboxedEnvironment):
    """A template computes and draws; it reaches no files, modules or private
    attributes."""

    def is_safe_attribute(self, obj: Any, attr: str, value: Any) -> bool:
        outside = attr in ("ctypes", "dump", "tofile") and isinstance(
            obj, (np.ndarray, np.generic)
        )
        return not outside and super().is_safe_attribute(obj, attr, value)


def _rendered(file: Path, verbs: Verbs) -> str:
    """The Markdown of a template. Raises DesatError with file and line."""
    environment = _Sandbox(
        loader=FileSystemLoader(file.parent),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
        autoescape=False,
    )
    environment.globals.update(verbs.known())
    environment.filters.update(FILTERS)
    try:
        text = environment.get_template(file.name).render()
    except Exception as error:
        placed = _at(file, error)
        raise placed from (None if placed is error else error)
    return f"{_set(text)}\n\n"


def _at(file: Path, error: Exception) -> Exception:
    """An error with the template's line before it; a bug of ours as it is."""
    place = paths.shown(file)
    if isinstance(error, TemplateSyntaxError):
        return DesatError(f"{place}:{error.lineno}: {error.message}")
    frames = traceback.extract_tb(error.__traceback__)
    lines = [f.lineno for f in frames if f.filename == str(file)]
    text = f"{place}:{lines[-1] if lines else 1}: {error}"
    if isinstance(error, RunError):
        return RunError(text, error.code)
    innermost = Path(frames[-1].filename)
    of_template = innermost in (file, VERBS) or "jinja2" in innermost.parts
    if isinstance(error, (DesatError, TemplateError)) or of_template:
        return DesatError(text)
    return error


def _set(text: str) -> str:
    """Markdown with each paragraph in one line, and a line between blocks."""
    blocks: list[list[str]] = []
    open_ = ""  # the kind of the block that the next line may belong to
    for line in (line.strip() for line in text.splitlines()):
        kind = (
            "table"
            if line.startswith("|")
            else "item"
            if line.startswith("- ")
            else "prose"
        )
        if line and kind == open_:
            blocks[-1].append(line)
        elif line:
            blocks.append([line])
        open_ = kind if line and not line.startswith("#") else ""
    return "\n\n".join(
        ("\n" if b[0].startswith(("|", "- ")) else " ").join(b) for b in blocks
    )


def _origin(draft: float | None) -> str:
    versions = ", ".join(f"{p} {version(p)}" for p in PACKAGES)
    cut = (
        ""
        if draft is None
        else f" DRAFT: runs end after {draft:g} s; nan: nothing to measure."
    )
    return (
        f"---\nGenerated by `make papers` on {datetime.now(UTC):%Y-%m-%d} from runs made then: "
        f"Python {platform.python_version()}, {versions}.{cut}\n"
    )
