"""Pages that people read: the front door is short, links lead somewhere, commands are
commands, and every number is made by a generator, checked by a test, or accepted with a
reason."""

from __future__ import annotations

import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from desat import cli
from desat.files.scenario import scenarios
from tests.conftest import ROOT
from tests.site.test_site import SCRIPTS

PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "CHANGELOG.md",
    *(p for p in sorted((ROOT / "docs").rglob("*.md")) if "generated" not in p.parts),
]
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


# --- commands in pages ----------------------------------------------------------------


CURRENT_PAGES = [p for p in PAGES if p.name != "CHANGELOG.md"]
"""Pages about today; a changelog names what is gone."""
FENCED = re.compile(r"^```[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"^(?: {4}|\t)(desat .*)$", re.MULTILINE)
SPAN = re.compile(r"(?<!`)`([^`]+)`(?!`)")
LIST = re.compile(r"`[^`\n]+`(?:(?:,| and| or|, and|, or)?\s+`[^`\n]+`)+")
TREE = get_command(cli.app_for([]))
NO_COMMANDS = {
    "new",
    "list",
    "check",
    "pack",
    "build",
    "report",
    "show",
    "size",
    "design",
    "help",
}
"""Commands whose names are those of much else, too: a list is not one of commands for
them."""


def command_lines(text: str) -> Iterator[str]:
    """Yield the command lines of a page: of its blocks and of its running text."""
    for block in FENCED.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            yield line.strip()
    prose = FENCED.sub("", text)
    for line in re.sub(r"\\\n\s*", " ", prose).splitlines():
        if match := INDENTED.match(line):
            yield match[1]
    for span in SPAN.findall(prose):
        yield " ".join(span.split())


def wrong_with(line: str) -> str:
    """Return what of a command line there is not; nothing where all is there, or it is
    none."""
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
    options = {x for p in command.params for x in (*p.opts, *p.secondary_opts)} | {
        "--help"
    }
    if (
        hasattr(command, "commands")
        and command is not TREE
        and "run" in command.commands
    ):
        options |= {x for p in command.commands["run"].params for x in p.opts}
    cases = (
        w.partition("=")[0].rstrip(".,;") for w in words if re.match(r"--?[a-zA-Z]", w)
    )
    return ", ".join(f"no option {w}" for w in cases if w not in options)


def lists_of_commands(text: str) -> Iterator[list[str]]:
    """Yield lists of inline code that are lists of commands: `desat run`, `sweep` and
    `tables`."""
    for list_text in LIST.findall(FENCED.sub("", text)):
        spans = SPAN.findall(list_text)
        if any(s.startswith(("desat.", "{{")) for s in spans):
            continue  # of functions of Python, or of the verbs of a template
        bare = [s.removeprefix("desat ") for s in spans]
        sure = [s for s in bare if s in TREE.commands and s not in NO_COMMANDS]
        if any(s.startswith("desat ") for s in spans) or len(sure) > 1:
            yield [s for s in bare if re.fullmatch(r"[a-z]+", s)]


@pytest.mark.parametrize("page", CURRENT_PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_commands_of_pages_are_there(page: Path) -> None:
    """In blocks, and in running text; with the options that they name."""
    text = page.read_text(encoding="utf-8")
    wrong = {
        line: reason for line in command_lines(text) if (reason := wrong_with(line))
    }
    for names in lists_of_commands(text):
        wrong |= {
            ", ".join(names): f"no command {n}" for n in names if n not in TREE.commands
        }
    assert wrong == {}


@pytest.mark.parametrize(
    ("text", "reason"),
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
def test_a_command_that_is_not_there_is_found(text: str, reason: str) -> None:
    complaints = [w for line in command_lines(text) if (w := wrong_with(line))]
    for names in lists_of_commands(text):
        complaints += [f"no command {n}" for n in names if n not in TREE.commands]
    assert complaints == ([reason] if reason else [])


@pytest.mark.parametrize(
    "family", ["uosat12", "space_telescope", "alsat1", "hausat2", "integrated"]
)
def test_the_front_door_says_how_many_values_of_each_paper_are_within_their_bands(
    family,
) -> None:
    page = (ROOT / "docs" / "papers" / family / "README.md").read_text(encoding="utf-8")
    band_count, within = re.findall(
        r"Of (\d+) values with a band, (\d+) lie within it", page
    )[0]
    front = re.sub(r"\s+", " ", (ROOT / "README.md").read_text(encoding="utf-8"))
    before = front[: front.index(f"(docs/papers/{family}/")]
    assert re.findall(r"(\d+) of (\d+)", before)[-1] == (within, band_count)


def test_the_page_of_equality_says_of_how_many_scenarios_it_is() -> None:
    page = (ROOT / "docs" / "equality.md").read_text(encoding="utf-8")
    ((flight, every),) = re.findall(r"(\d+) of (\d+) scenarios are flown", page)
    assert int(every) == len(scenarios()), "python -m benchmarks.equality --seconds 0"
    assert f"| all | {flight} |" in page


# --- numbers that nothing holds -------------------------------------------------------

GENERATED = {
    "equality.md": "benchmarks/equality.py",
    "flown.md": "benchmarks/flown.py",
    "hardware.md": "benchmarks/hardware.py",
    "language.md": "Makefile",
    "laws-measured.md": "benchmarks/laws.py",
    "mutations.md": "tests/mutations.py",
    "questions.md": "benchmarks/questions.py",
    "sizing-thrusters.md": "benchmarks/dumps.py",
    "sizing.md": "benchmarks/sizing.py",
    "witness.md": "benchmarks/witness.py",
    "your-craft.md": "benchmarks/your_craft.py",
}
"""Pages that a generator writes, where they do not lie in docs/papers
(benchmarks/pages)."""
UNIT = (
    r"%|deg(?:/s)?|rad(?:/s)?|kg|g|[kMG]B|[mun\u00b5]?s|min|h|days?|weeks?|years?|"
    r"[mun\u00b5]?N m s|[mun\u00b5]?N m|[mun\u00b5]?N|A m2|W|J|V|u?T|km|mm?|rpm|Hz|times|"
    r"blocks|scenarios|of(?: today's)? \d+"
)
NUMBER = re.compile(rf"(?<![\w.,/^-])\d[\d,.]*(?:e-?\d+)? (?:{UNIT})(?![\w/])")
BY_HAND = "measured once by hand; nothing measures it anew"
LIMIT = "a limit or a choice in the code, not a result"
TABLE = "read by hand off the table of the same page, which a generator makes"
SOURCE = "of a paper, a standard or another program"
TESTED = "a test holds it: of this file, test_loop_fmu, test_fmus, or the one named on the page"
ACCEPTED: dict[str, dict[str, str]] = {
    "README.md": {
        "48 of 49": "docs/sizing-thrusters.md",
        "5 %": "docs/sizing-thrusters.md",
        "159 of 166": TESTED,
        "18 of 20": TESTED,
        "50 of 51": TESTED,
        "51 of 58": TESTED,
        "20 of 62": TESTED,
        "3e-12 rad": "docs/witness.md",
    },
    "docs/assumed.md": {
        "0.5 deg/s": TESTED,
        "1 deg/s": TESTED,
        "1 m": TESTED,
        "1.5 kg": TESTED,
        "1.5 times": TESTED,
        "10 ms": BY_HAND,
        "15 %": SOURCE,
        "220 s": TESTED,
        "2 ms": BY_HAND,
        "20 %": SOURCE,
        "20 ms": BY_HAND,
        "28 %": SOURCE,
        "3 %": TESTED,
        "3.2 m": TESTED,
        "30 %": TESTED,
        "30 kg": TESTED,
        "5 %": TESTED,
        "500 kg": TESTED,
        "500 times": TESTED,
        "90 %": TESTED,
        "95 %": TESTED,
    },
    "docs/campaigns.md": {"40 ms": BY_HAND, "2 s": LIMIT, "24 s": BY_HAND},
    "docs/failures.md": {
        "300 s": LIMIT,
        "200 times": TESTED,
        "20 ms": BY_HAND,
        "50 kB": BY_HAND,
        "1 s": LIMIT,
        "10 s": LIMIT,
    },
    "docs/forms.md": {
        "30 %": TESTED,
        "300,000 km": TESTED,
        "5 deg": TESTED,
        "15 s": BY_HAND,
    },
    "docs/hosts.md": {
        "284 kB": TESTED,
        "344 kB": TESTED,
        "10 ms": BY_HAND,
        "101 MB": SOURCE,
        "413 MB": SOURCE,
        "10 s": BY_HAND,
        "2 min": BY_HAND,
        "210 kB": BY_HAND,
    },
    "docs/foreign.md": {"1 %": LIMIT, "5 s": SOURCE},
    "docs/translation.md": {
        "1 kB": LIMIT,
        "256 kB": LIMIT,
        "8 kB": LIMIT,
        "38 of today's 50": BY_HAND,
        "36 of 38": BY_HAND,
        "38 of 38": BY_HAND,
        "9 of 38": BY_HAND,
        "1e-4 s": BY_HAND,
        "0.014 %": BY_HAND,
        "0.8 ms": BY_HAND,
        "15 ms": BY_HAND,
        "8.7 ms": BY_HAND,
    },
    "docs/live.md": {
        "1.2 s": BY_HAND,
        "2.6 s": BY_HAND,
        "0.25 s": BY_HAND,
        "4e-15 N m s": "an example",
    },
    "docs/loop-fmu.md": {"0.072 deg": BY_HAND, "267 kB": TESTED, "2.8 us": BY_HAND},
    "docs/own-block.md": {
        "27 kB": BY_HAND,
        "40 kB": BY_HAND,
        "94 kB": BY_HAND,
        "9 kB": BY_HAND,
        "820 kB": BY_HAND,
        "90 kB": BY_HAND,
        "14 kB": BY_HAND,
        "8 kB": BY_HAND,
    },
    "docs/reference.md": {
        "0.36 deg": "precession since J2000: 50.3 arc seconds a year",
        "1e-7 rad": LIMIT,
        "3e-12 rad": "docs/witness.md",
        "0.063 deg": "a second of the orbit's rate",
        "540 MB": BY_HAND,
    },
    "docs/results.md": {
        "1 GB": LIMIT,
        "1 s": LIMIT,
        "400 kg": LIMIT,
        "58 MB": BY_HAND,
    },
    "docs/hardware.template": {
        "10 %": TESTED,
        "1 %": LIMIT,
        "15 %": TABLE,
        "24 %": TABLE,
        "5 %": LIMIT,
        "2.45 N m s": SOURCE,
        "600 s": SOURCE,
        "0.1 N": SOURCE,
    },
    "docs/laws-measured.template": {
        "30 s": LIMIT,
        "95 %": LIMIT,
        "600 s": SOURCE,
    },
}
"""By page: the numbers that neither a generator nor a script makes, each with why it
may stand."""


def unheld(text: str) -> set[str]:
    """Return the numbers with a unit in a page's prose, without code and what is
    generated."""
    result = r"<!--[^>]*python -m benchmarks\.\w+[^>]*-->.*?<!-- (?:to|until) here -->"
    text = re.sub(result, "", text, flags=re.DOTALL)
    text = re.sub(r"^```.*?^```|^    .*?$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"`[^`]*`|\{\{.*?\}\}|\]\([^)]*\)", "`", text)
    return set(NUMBER.findall(re.sub(r"\s+", " ", text)))


def test_a_number_on_a_page_is_held_or_accepted() -> None:
    """A new number in prose is made by a generator or a script of tests/site/test_site.py,
    or stands in ACCEPTED with its reason; one that is gone leaves there."""
    docs = ROOT / "docs"
    generated_pages = {docs / page for page in GENERATED} | set(SCRIPTS)
    pages = [p for p in PAGES if p.name != "CHANGELOG.md" and p not in generated_pages]
    pages = [p for p in pages if docs / "papers" not in p.parents]
    numbers_by_page = {
        str(page.relative_to(ROOT)): unheld(page.read_text(encoding="utf-8"))
        for page in [*pages, *sorted(docs.glob("*.template"))]
    }
    accepted_numbers = {page: set(numbers) for page, numbers in ACCEPTED.items()}
    assert {
        page: numbers for page, numbers in numbers_by_page.items() if numbers
    } == accepted_numbers


@pytest.mark.parametrize(("page", "generator"), GENERATED.items())
def test_a_generated_page_has_its_generator(page: str, generator: str) -> None:
    assert (ROOT / "docs" / page).exists()
    assert page in (ROOT / generator).read_text(encoding="utf-8")


def test_a_new_number_is_found() -> None:
    text = "It takes 3.5 kg\na year, `4 N` of code and\n\n    5 mN m s of output, 7 of 9 times.\n"
    assert unheld(text) == {"3.5 kg"}
    assert unheld("7 of 9 do, 12 % in\n3 weeks") == {"7 of 9", "12 %", "3 weeks"}
