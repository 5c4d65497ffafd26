"""Words of the house that the field does not use are in no message, title, help or page.

docs/terms.md lists them: left what was written until now, right what is written instead.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from conftest import ROOT

TERMS = ROOT / "docs" / "terms.md"
TEXTS = ("docs/**/*.md", "docs/*.template", "ssp/*/*.md", "ssp/*/scenarios/*.toml",
         "ssp/*/family.toml", "orchestrator/templates/*.html", "orchestrator/templates/**/*.toml",
         "benchmarks/*.md", "*.md")  # fmt: skip
CODE = ("orchestrator", "components", "fmus")
PRINTED = ("orchestrator/cli/commands/", "orchestrator/numbers/measures.py", "components/blocks/",
           "orchestrator/__init__.py")  # fmt: skip
"""Code whose docstrings users read: help, measures, blocks, Python."""
LEFT_OUT = {"CHANGELOG.md", "docs/terms.md"}


def words() -> dict[str, str]:
    """Words until now -> what is written instead."""
    table = TERMS.read_text(encoding="utf-8").partition("| until now |")[2].partition("\n\n")[0]
    rows = [line.strip("|").split("|") for line in table.splitlines()[2:]]
    return {left.strip(): right.strip() for left, right in rows}


def pattern(word: str) -> re.Pattern[str]:
    """Where a word stands alone: in no name, path or code."""
    text = re.escape(word).replace("58\\ to\\ 72", r"\d+ to \d+").replace("\\ ", r"\s+")
    return re.compile(rf"(?<![\w./`=-]){text}(?![\w/`(=]|\.\w|-\w|\s*=)")


def of_code(file: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of a file that are no single words, as names and keys, and no docstrings
    that are for its readers alone."""
    printed = file.relative_to(ROOT).as_posix().startswith(PRINTED)
    tree = ast.parse(file.read_text(encoding="utf-8"))
    docs = set() if printed else {id(n.value) for n in ast.walk(tree) if isinstance(n, ast.Expr)}
    for node in ast.walk(tree):
        text = node.value if isinstance(node, ast.Constant) and id(node) not in docs else None
        if isinstance(text, str) and " " in text.strip():
            equations = "\n".join(x for x in text.splitlines() if " = " not in x)
            yield node.lineno, equations if printed else text


def of_page(file: Path) -> Iterator[tuple[int, str]]:
    """Lines and their texts without what is code: spans, blocks, expressions of a template."""
    block = False
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        block ^= line.startswith("```")
        if not (block or line.startswith("    ")):
            yield number, re.sub(r"`[^`]*`|\{\{.*?\}\}|\{%.*?%\}|\]\([^)]*\)", " ", line)


def all_texts() -> Iterator[tuple[str, str]]:
    """Places and texts that users read."""
    for folder in CODE:
        for file in sorted((ROOT / folder).rglob("*.py")):
            for number, text in of_code(file):
                yield f"{file.relative_to(ROOT)}:{number}", text
    for form in TEXTS:
        for file in sorted(ROOT.glob(form)):
            name = file.relative_to(ROOT).as_posix()
            if name not in LEFT_OUT and not name.startswith("docs/generated/"):  # made of the code
                for number, text in of_page(file):
                    yield f"{name}:{number}", text


def test_words_of_the_house_are_gone() -> None:
    """But where the command line says what takes the place of an option of before."""
    old = {word: pattern(word) for word in words()}
    assert len(old) >= 15
    found = [
        f"{place}: {word!r} (now: {words()[word]}): {' '.join(text.split())[:100]}"
        for place, text in all_texts() for word, where in old.items() if where.search(text)
    ]  # fmt: skip
    assert not found, "\n".join(found)


@pytest.mark.parametrize(
    ("text", "is_found"),
    [
        ("medians of 20 draws", True), ("draws of a law", True), ("docs/draws.parquet", False),
        ("of all 3 to 12 % of them", True), ("a_draws", False), ("it withdraws", False),
        ("5 draws.", True),
    ],
)  # fmt: skip
def test_a_word_is_found_where_it_stands_alone(text: str, is_found: bool) -> None:
    assert any(pattern(word).search(text) for word in words()) == is_found
