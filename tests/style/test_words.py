"""Words of the house that the field does not use are in no message, title, help or
page; and names in backticks exist in the code.

WORDS lists them with what is written instead.
"""

from __future__ import annotations

import ast
import builtins
import keyword
import re
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path

import pytest

from benchmarks import house
from tests.conftest import ROOT
from tests.style.source import CODE, files_in, nodes_of, tree_of

TEXTS = (
    "docs/**/*.md",
    "docs/*.template",
    "ssp/*/*.md",
    "ssp/*/scenarios/*.toml",
    "ssp/*/family.toml",
    "orchestrator/**/*.html",
    "orchestrator/templates/**/*.toml",
    "benchmarks/*.md",
    "*.md",
)
PRINTED = (
    "orchestrator/cli/commands/",
    "orchestrator/papers/commands/",
    "orchestrator/web/commands/",
    "orchestrator/numbers/measures.py",
    "components/blocks/",
    "orchestrator/__init__.py",
)
"""Code whose docstrings users read: help, measures, blocks, Python."""
LEFT_OUT = {"CHANGELOG.md"}


#: Words of the house until 2026, and what is written instead.
WORDS = {
    "story": "scenario, content",
    "twin": "baseline",
    "draws": "samples",
    "OUTSIDE": "outside the band",
    "strips": "mode bars",
    "cells with a band": "values with a band",
    "no run decides": "cannot be tested by simulation",
    "of all 58 to 72 %": "95 % interval 58 to 72 %",
    "sum g h": "total wheel momentum",
    "hands means over": "exchanges step averages",
    "ends and middle": "unresolved work within a step",
    "work that a step hides": "unresolved work within a step",
    "what the fullest wheel has left": "smallest wheel momentum margin",
    "a wheel is at its limit": "a wheel is saturated",
    "reaches nobody": "unused",
    "nobody of ours": "independent",
    "remembers the momentum": "law with memory",
    "over the least of": "over the best of",
}


def pattern(word: str) -> re.Pattern[str]:
    """Where a word stands alone: in no name, path or code."""
    text = re.escape(word).replace("58\\ to\\ 72", r"\d+ to \d+").replace("\\ ", r"\s+")
    return re.compile(rf"(?<![\w./`=-]){text}(?![\w/`(=]|\.\w|-\w|\s*=)")


def of_code(file: Path) -> Iterator[tuple[int, str]]:
    """Lines and texts of a file that are no single words, as names and keys, and no
    docstrings that are for its readers alone."""
    is_printed = file.relative_to(ROOT).as_posix().startswith(PRINTED)
    nodes = nodes_of(file)
    docs = (
        set() if is_printed else {id(n.value) for n in nodes if isinstance(n, ast.Expr)}
    )
    for node in nodes:
        text = (
            node.value
            if isinstance(node, ast.Constant) and id(node) not in docs
            else None
        )
        if isinstance(text, str) and " " in text.strip():
            equations = "\n".join(x for x in text.splitlines() if " = " not in x)
            yield node.lineno, equations if is_printed else text


def of_page(file: Path) -> Iterator[tuple[int, str]]:
    """Lines and their texts without what is code: spans, blocks, expressions of a
    template."""
    block = False
    for number, line in enumerate(file.read_text(encoding="utf-8").splitlines(), 1):
        block ^= line.startswith("```")
        if not (block or line.startswith("    ")):
            yield (
                number,
                re.sub(r"`[^`]*`|\{\{.*?\}\}|\{%.*?%\}|\]\([^)]*\)", " ", line),
            )


def all_texts() -> Iterator[tuple[str, str]]:
    """Places and texts that users read."""
    for file in files_in(*CODE):
        for number, text in of_code(file):
            yield f"{file.relative_to(ROOT)}:{number}", text
    for form in TEXTS:
        for file in sorted(ROOT.glob(form)):
            name = file.relative_to(ROOT).as_posix()
            if name not in LEFT_OUT and not name.startswith(
                "docs/generated/"
            ):  # made of the code
                for number, text in of_page(file):
                    yield f"{name}:{number}", text


def test_words_of_the_house_are_gone() -> None:
    """But where the command line says what takes the place of an option of before."""
    old = {word: pattern(word) for word in WORDS}
    assert len(old) >= 15
    old_words = [
        f"{place}: {word!r} (now: {WORDS[word]}): {' '.join(text.split())[:100]}"
        for place, text in all_texts()
        for word, location in old.items()
        if location.search(text)
    ]
    assert not old_words, "\n".join(old_words)


@pytest.mark.parametrize(
    ("text", "is_found"),
    [
        ("medians of 20 draws", True),
        ("draws of a law", True),
        ("docs/draws.parquet", False),
        ("of all 3 to 12 % of them", True),
        ("a_draws", False),
        ("it withdraws", False),
        ("5 draws.", True),
    ],
)
def test_a_word_is_found_where_it_stands_alone(text: str, is_found: bool) -> None:
    assert any(pattern(word).search(text) for word in WORDS) == is_found


# --- names in backticks ---------------------------------------------------------------

IDENTIFIER = re.compile(r"[A-Za-z_]\w*")
FILE_NAME = re.compile(r"[\w./]+\.(py|c|js|html|toml)")
OWNED_NAME = re.compile(r"([A-Za-z_]\w*)\.([A-Za-z_]\w*)")
COMMAND = re.compile(r"(desat|make|python) ")
# names of other packages, of units, of SSP, of what a user writes, and placeholders
OF_OTHERS = {
    *("ds", "to_dataframe", "fenv_t", "typing", "kgm2", "uN", "s²", "inner_add"),
    *("NAME.craft.toml", "my_ROLE.py", "PLOT", "UNIT"),
}


def is_text(node: ast.AST) -> bool:
    """Return whether a statement is a docstring, or the text below a constant."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )


class CodeNames:
    """The names that the code of the package has."""

    def __init__(self, files: Iterable[Path]) -> None:
        self.files: set[str] = set()
        self.anywhere = {
            *dir(builtins),
            *keyword.kwlist,
        }  # a definition, attribute, key or value
        self.within: dict[
            Path, set[str]
        ] = {}  # by file, every name and text of its code
        self.members: dict[str, set[str]] = {}  # by module and class
        for file in files:
            module = file.parent.name if file.stem == "__init__" else file.stem
            self.anywhere.update(file.with_suffix("").relative_to(ROOT).parts)
            self.within[file] = set()
            self._add_members(module, tree_of(file))
            self._add_code(file)
        for folder in (*CODE, "tests", "benchmarks"):
            self.files.update(path.name for path in (ROOT / folder).rglob("*"))
        for file in (ROOT / "orchestrator").rglob("*"):
            if file.suffix in (".c", ".js", ".html", ".toml", ".jinja"):
                self.anywhere.update(
                    IDENTIFIER.findall(file.read_text(encoding="utf-8"))
                )

    def _add_members(self, owner: str, tree: ast.Module | ast.ClassDef) -> None:
        """Add what a module or a class defines, imports or assigns."""
        members = self.members.setdefault(owner, set())
        for node in ast.walk(tree):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                members.add(node.name)
            elif isinstance(node, ast.alias):
                members.add(node.asname or node.name)
            elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                members.add(node.id)
            elif isinstance(node, ast.Attribute):
                members.add(node.attr)
            if isinstance(node, ast.ClassDef) and node is not tree:
                self._add_members(node.name, node)

    def _add_code(self, file: Path) -> None:
        """Add the names of a file: a local variable counts in its own file alone."""
        texts = {id(node.value) for node in nodes_of(file) if is_text(node)}
        within = self.within[file]
        for node in nodes_of(file):
            if isinstance(node, ast.FunctionDef | ast.ClassDef):
                self.anywhere.add(node.name)
            elif isinstance(node, ast.Name):
                within.add(node.id)
            elif isinstance(node, ast.arg | ast.keyword) and node.arg:
                self.anywhere.add(node.arg)
            elif isinstance(node, ast.Attribute):
                self.anywhere.add(node.attr)
            elif isinstance(node, ast.alias):
                within.update(IDENTIFIER.findall(node.name))
            elif isinstance(node, ast.Constant) and id(node) not in texts:
                self._add_text(node.value, within)
            if isinstance(node, ast.Module | ast.ClassDef):
                self._add_assigned(node)

    def _add_text(self, text: object, within: set[str]) -> None:
        """Add the words of a text: one without spaces is a key or a value, known
        anywhere."""
        if isinstance(text, str):
            words = IDENTIFIER.findall(text)
            within.update(words)
            if " " not in text.strip():
                self.anywhere.update(words)

    def _add_assigned(self, owner: ast.Module | ast.ClassDef) -> None:
        """Add the constants of a module and the fields of a class."""
        for statement in owner.body:
            targets = getattr(
                statement, "targets", [getattr(statement, "target", None)]
            )
            for target in targets:
                names = ast.walk(target) if target is not None else ()
                self.anywhere.update(n.id for n in names if isinstance(n, ast.Name))

    def unknown_in(self, span: str, file: Path) -> list[str]:
        """Return the names of a text in backticks that the package does not have."""
        if COMMAND.match(span):
            return []
        if FILE_NAME.fullmatch(span):
            name = Path(span).name
            return [] if name in self.files | OF_OTHERS else [name]
        owned_name = OWNED_NAME.match(span)
        if (
            owned_name is not None
            and owned_name[1] in self.members
            and owned_name[1] not in self.within[file]
        ):
            return (
                [] if owned_name[2] in self.members[owned_name[1]] else [owned_name[0]]
            )
        known_names = self.anywhere | self.within[file] | OF_OTHERS
        return [name for name in IDENTIFIER.findall(span) if name not in known_names]


def texts_for_readers(file: Path) -> Iterator[tuple[int, str]]:
    """Yield lines and texts of docstrings and comments."""
    for node in nodes_of(file):
        if is_text(node):
            yield node.lineno, node.value.value
    with tokenize.open(file) as lines:
        for token in tokenize.generate_tokens(lines.readline):
            if token.type == tokenize.COMMENT:
                yield token.start[0], token.string


def stale_names(files: Iterable[Path], code_names: CodeNames) -> Iterator[str]:
    """Yield a line for each text in backticks that names what the package does not
    have."""
    for file in files:
        for line, text in texts_for_readers(file):
            for span in re.findall(r"`([^`]+)`", text):
                if unknown := code_names.unknown_in(span, file):
                    yield f"{file.relative_to(ROOT)}:{line}: `{span}`: no {', '.join(unknown)}"


@pytest.fixture(scope="module")
def code_names() -> CodeNames:
    return CodeNames(files_in(*CODE))


def test_names_in_backticks_exist(code_names: CodeNames) -> None:
    files = files_in("orchestrator")
    assert "\n".join(stale_names(files, code_names)) == ""


@pytest.mark.parametrize(
    ("span", "is_known"),
    [
        ("master.py", True),
        ("supervise.py", False),
        ("Master.initialise", True),
        ("Master.no_such_method", False),
        ("manager.gain", True),
        ("no_such_name", False),
        ("desat run NAME", True),
        ("options.stop", True),
    ],
)
def test_a_stale_name_is_found(
    code_names: CodeNames, span: str, is_known: bool
) -> None:
    file = ROOT / "orchestrator" / "runs" / "prepare.py"
    assert (code_names.unknown_in(span, file) == []) == is_known


#: Names that say nothing of the thing: participles and question words (READABLE, rule 4).
PARTICIPLES = (
    "told said kept wanted asked made given flown fits room lost left whole own beside "
    "what which how where when why who whose whether"
)
BARE_NAMES = frozenset(PARTICIPLES.split())
#: Where such a name stays, and the reason.
KEPT_NAMES = {
    ("orchestrator/__init__.py", "flown"): "a keyword of desat.size",
    ("orchestrator/sizing/requirements.py", "flown"): "the keyword of desat.size",
    ("orchestrator/analyses/energy.py", "why"): "a key of manifest.json",
    ("orchestrator/analyses/energy.py", "given"): "a key of manifest.json",
    ("orchestrator/analyses/fixed.py", "why"): "a key of manifest.json",
    ("orchestrator/analyses/manifest.py", "why"): "a key of manifest.json",
    ("orchestrator/analyses/manifest.py", "flown"): "a key of manifest.json",
    ("orchestrator/sizing/compatibility.py", "why"): "a key of compare --json",
    ("orchestrator/studies/tune.py", "own"): "a key of tune --json",
    ("orchestrator/system/model.py", "given"): "a key of manifest.json",
    ("orchestrator/language/paper.py", "what"): "a key of scenario files",
    ("orchestrator/engine/compiled.py", "how"): "a field of loop.c",
    ("orchestrator/engine/compiled.py", "asked"): "a field of loop.c",
    ("orchestrator/figures/canvas.py", "left"): "a side",
}


def bare_names(nodes: Iterable[ast.AST]) -> set[str]:
    """Return the bare participles and question words that code uses as names."""
    names = set()
    for node in nodes:
        match node:
            case ast.Name(id=name, ctx=ast.Store()):
                names.add(name)
            case ast.Attribute(attr=name, ctx=ast.Store()):
                names.add(name)
            case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
                names.add(name)
            case ast.ExceptHandler(name=str(name)) | ast.alias(asname=str(name)):
                names.add(name)
            case ast.arg(arg=name):
                names.add(name)
    return {name for name in names if name.strip("_").lower() in BARE_NAMES}


def test_names_are_nouns_and_verbs() -> None:
    bare_by_file = {
        (file.relative_to(ROOT).as_posix(), name)
        for file in files_in(*CODE, "tests", "benchmarks")
        for name in bare_names(nodes_of(file))
    }
    assert bare_by_file == set(KEPT_NAMES)


def test_a_bare_name_is_found() -> None:
    tree = ast.parse("def f(wanted): kept, x.own = 1, _LOST\nclass How: pass")
    assert bare_names(ast.walk(tree)) == {"wanted", "kept", "own", "How"}


def find_undocumented(nodes: Iterable[ast.AST]) -> Iterator[str]:
    """Yield the names under `Parameters` of docstrings that are no parameters."""
    for node in nodes:
        if not isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            continue
        _, heading, section = (ast.get_docstring(node) or "").partition(
            "Parameters\n----------\n"
        )
        if not heading:
            continue
        section = re.split(r"\n\n\w+\n-+\n", section)[0]
        section_names = {
            name.strip().lstrip("*")
            for line in section.splitlines()
            if line and not line.startswith(" ")
            for name in line.partition(":")[0].split(",")
        }
        parameters = {x.arg for x in ast.walk(node) if isinstance(x, ast.arg)}
        if isinstance(node, ast.ClassDef):
            parameters |= {x.target.id for x in node.body if is_field(x)}  # type: ignore[attr-defined]
        yield from (
            f"{node.name}: {name}" for name in sorted(section_names - parameters)
        )


def is_field(node: ast.AST) -> bool:
    """Whether a statement of a class declares a field."""
    return isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)


def test_documented_parameters_exist() -> None:
    wrong_names = [
        f"{file.relative_to(ROOT)}: {name}"
        for file in files_in(*CODE, "benchmarks")
        for name in find_undocumented(nodes_of(file))
    ]
    assert wrong_names == []


def test_a_parameter_that_is_not_there_is_found() -> None:
    text = (
        "Do.\n\n    Parameters\n    ----------\n    x, y : float\n        Of it.\n    "
    )
    source = f'def f(x: float) -> None:\n    """{text}"""\n'
    assert list(find_undocumented(ast.walk(ast.parse(source)))) == ["f: y"]


def test_names_do_not_get_worse() -> None:
    """Participles may only become fewer; classes have a name each, methods docstrings."""
    sizes = house.sizes()
    assert sizes["one-word participles"] <= 1_576
    assert sizes["class names in two modules"] == 0
    assert sizes["functions above 8 statements without docstring"] == 0
    assert sizes["files that ask interface.model"] <= 2
