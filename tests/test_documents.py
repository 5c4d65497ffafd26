"""Pages that people read: the front door is short, links lead somewhere, commands are commands."""

from __future__ import annotations

import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from typer.main import get_command

from desat import cli

PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md",
         *(p for p in sorted((ROOT / "docs").rglob("*.md"))
           if "generated" not in p.parts)]  # fmt: skip
LINK = re.compile(r"\]\(([^)\s]+)\)")


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as they are made of them."""
    heads = re.findall(r"^#+ (.+)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.strip().lower()).replace(" ", "-") for h in heads}


def test_the_front_door_is_short() -> None:
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 80
    assert max(map(len, lines)) <= 200


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for link in LINK.findall(text):
        if link.startswith(("http:", "https:", "mailto:")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.name}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{page.name}: {link}"


# --- commands in pages --------------------------------------------------------------------------


TOLD = [p for p in PAGES if p.name != "CHANGELOG.md"]
"""Pages about today; a changelog names what is gone."""
FENCED = re.compile(r"^```[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^(?: {4}|\t)(desat .*)$", re.MULTILINE)
SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")
LIST = re.compile(r"`[^`\n]+`(?:(?:,| and| or|, and|, or)?\s+`[^`\n]+`)+")
TREE = get_command(cli.app_for([]))
NO_COMMANDS = {"new", "list", "check", "pack", "build", "report", "show", "size", "design", "help"}
"""Commands whose names are those of much else, too: a list is not one of commands for them."""


def command_lines(text: str) -> Iterator[str]:
    """Yield the command lines of a page: of its blocks and of its running text."""
    for block in FENCED.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            yield line.strip()
    prose = FENCED.sub("", text)
    for line in re.sub(r"\\\n\s*", " ", prose).splitlines():
        if found := INDENTED.match(line):
            yield found[1]
    for span in SPAN.findall(prose):
        yield " ".join(span.split())


def wrong_with(line: str) -> str:
    """Return what of a command line there is not; nothing where all is there, or it is none."""
    if line.startswith("python -m "):
        module = line.split()[2].rstrip(".,;")
        ours = module.partition(".")[0] in ("desat", "benchmarks")
        return "" if not ours or is_module(module) else f"no module {module}"
    if not re.match(r"desat(\s|$)", line):
        return ""
    try:
        words = shlex.split(line, comments=True)[1:]
    except ValueError as error:
        return str(error)
    return wrong_words(TREE, words)


def is_module(name: str) -> bool:
    """Return whether there is a module of this name."""
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def wrong_words(command: Any, words: list[str]) -> str:
    """Return which of the words after a command are no command or option of it."""
    while hasattr(command, "commands") and words and not words[0].startswith("-"):
        name = words[0]
        if name in command.commands:
            words = words[1:]
        elif name.isupper() and command is TREE:  # `desat COMMAND`
            return ""
        elif "run" in command.commands and command is not TREE:
            name = "run"
        else:
            return f"no command {name}"
        command = command.commands[name]
    known = {x for p in command.params for x in (*p.opts, *p.secondary_opts)} | {"--help"}
    if hasattr(command, "commands") and command is not TREE and "run" in command.commands:
        known |= {x for p in command.commands["run"].params for x in p.opts}
    given = (w.partition("=")[0].rstrip(".,;") for w in words if re.match(r"--?[a-zA-Z]", w))
    return ", ".join(f"no option {w}" for w in given if w not in known)


def lists_of_commands(text: str) -> Iterator[list[str]]:
    """Yield lists of inline code that are lists of commands: `desat run`, `sweep` and `tables`."""
    for found in LIST.findall(FENCED.sub("", text)):
        spans = SPAN.findall(found)
        if any(s.startswith(("desat.", "{{")) for s in spans):
            continue  # of functions of Python, or of the verbs of a template
        bare = [s.removeprefix("desat ") for s in spans]
        sure = [s for s in bare if s in TREE.commands and s not in NO_COMMANDS]
        if any(s.startswith("desat ") for s in spans) or len(sure) > 1:
            yield [s for s in bare if re.fullmatch(r"[a-z]+", s)]


@pytest.mark.parametrize("page", TOLD, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_of_pages_are_there(page: Path) -> None:
    """In blocks, and in running text; with the options that they name."""
    text = page.read_text(encoding="utf-8")
    wrong = {line: why for line in command_lines(text) if (why := wrong_with(line))}
    for names in lists_of_commands(text):
        wrong |= {", ".join(names): f"no command {n}" for n in names if n not in TREE.commands}
    assert wrong == {}


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("Say `desat check FILE` first.", ""),
        ("Say `desat chek FILE` first.", "no command chek"),
        ("```shell\ndesat run x --duration 5\n```\n", "no option --duration"),
        ("    desat run x --stopp 5\n", "no option --stopp"),
        ("a `desat export web\nx --law ccpl`, and", ""),
        ("`desat export web x --lawn ccpl`", "no option --lawn"),
        ("`desat export RUN --format csv`", ""),
        ("`desat new planet x`", "no command planet"),
        ("`python -m desat.no.such`", "no module desat.no.such"),
        ("`desat run`, `draws` and `tables` take", "no command draws"),
        ("`sweep`, `resume` and `draws` take", "no command draws"),
        ("`desat.run` is Python", ""),
    ],
)
def test_a_command_that_is_not_there_is_found(text: str, why: str) -> None:
    found = [w for line in command_lines(text) if (w := wrong_with(line))]
    for names in lists_of_commands(text):
        found += [f"no command {n}" for n in names if n not in TREE.commands]
    assert found == ([why] if why else [])
