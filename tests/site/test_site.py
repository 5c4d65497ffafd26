"""The site: it builds without a warning, every page can be reached, and pages do what
they say.

The start, the tutorials and the pages below docs/understand are scripts: their blocks
run in order, in one temporary folder a page.

    ```shell     lines that begin with `desat`
    ```python    in one process; a block with a caption is written to the file of that name
    ```text      what the block before prints: words as they stand, `...` for what is left out, and
                 numbers within one unit of their last digit

A drawing that a page makes lies beside it in git; DESAT_WRITE=1 writes them anew.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib
import pytest

from tests.conftest import ROOT, slow_value

DOCS = ROOT / "docs"
SCRIPTS = [
    DOCS / "start.md",
    *sorted((DOCS / "tutorials").glob("[0-9]*.md")),
    *sorted((DOCS / "understand").glob("[a-z]*.md")),
]
LONG = ("2-geo", "3-law", "5-campaign", "8-from-telemetry-to-a-craft")
FIRST = [ROOT / "README.md", DOCS / "index.md", *SCRIPTS]
BLOCK = re.compile(
    r"^```(?:\{code-block\} )?(shell|python|text)[^\n]*\n(?::caption: (\S+)\n\n?)?(.*?)^```$",
    re.M | re.S,
)
NUMBER = re.compile(r"[-+]?\d[\d,]*(?:\.\d+)?(?:e[-+]?\d+)?")
STRIPPED = "()[]{}%,;:.'"
CPU = {
    "start": 27.0,
    "1-cubesat": 10.0,
    "2-geo": 19.0,
    "3-law": 6.0,
    "4-exchange": 6.0,
    "5-campaign": 14.0,
    "6-results": 5.0,
    "8-from-telemetry-to-a-craft": 12.0,
    "coils": 4.0,
    "null-space": 2.0,
    "laws": 5.0,
    "exchange": 2.0,
    "substeps": 2.0,
}
"""Seconds that each page takes, on a machine that does nothing else; beside others up
to twice."""


@dataclass(frozen=True)
class Block:
    """A block of a page, the line where it begins, and the file that it is, if it is
    one."""

    kind: str
    line: int
    text: str
    file: str


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    return [
        Block(m[1], text.count("\n", 0, m.start()) + 1, m[3], m[2] or "")
        for m in BLOCK.finditer(text)
    ]


def same(message: str, word: str) -> bool:
    """Whether a word of a page is what was printed; a number within a unit of its last
    digit."""
    if message == word:
        return True
    a, b = (
        NUMBER.fullmatch(message.strip(STRIPPED)),
        NUMBER.fullmatch(word.strip(STRIPPED)),
    )
    if not a or not b:
        return False
    plain = a[0].replace(",", "").lower()
    mantissa, _, power = plain.partition("e")
    digit = 10.0 ** (int(power or 0) - len(mantissa.partition(".")[2]))
    return abs(float(plain) - float(b[0].replace(",", ""))) <= 1.001 * digit


def matches(message: list[str], words: list[str]) -> bool:
    """Whether words are those that were printed; `...` stands for any number of them."""
    if not message:
        return not words
    if message[0] == "...":
        return any(matches(message[1:], words[i:]) for i in range(len(words) + 1))
    parts = message.index("...") if "..." in message else len(message)
    if len(words) < parts or not all(map(same, message[:parts], words)):
        return False
    return matches(message[parts:], words[parts:])


def shell(text: str, folder: Path) -> str:
    """What commands print."""
    output = ""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if not words:
            continue
        assert words[0] == "desat", line
        process = subprocess.run(
            [sys.executable, "-m", "desat.cli", *words[1:]],
            cwd=folder,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            check=False,
            env={**os.environ, "COLUMNS": "160"},
        )
        assert process.returncode in (0, 1), f"{line}: {process.stdout}"
        output += process.stdout
    return output


def cpu() -> float:
    kids = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + kids.ru_utime + kids.ru_stime


def run(page: Path, folder: Path) -> list[tuple[Block, str]]:
    """Run a page's blocks; each with what it printed."""
    names: dict[str, object] = {"__name__": "page"}
    outputs = []
    for block in blocks(page):
        output = ""
        if block.file:
            (folder / block.file).write_text(block.text, encoding="utf-8")
        elif block.kind == "shell":
            output = shell(block.text, folder)
        elif block.kind == "python":
            out = io.StringIO()
            with contextlib.redirect_stdout(out):
                code = "\n" * block.line + block.text
                exec(compile(code, str(page), "exec", dont_inherit=True), names)
            output = out.getvalue()
        outputs.append((block, output))
    return outputs


@pytest.fixture(scope="module")
def cache(tmp_path_factory) -> Path:
    """A cache that all pages share: none finds in it what another has not made."""
    return tmp_path_factory.mktemp("cache")


@pytest.mark.slow
@pytest.mark.parametrize(
    "page",
    [slow_value(p, "study") if p.stem in LONG else p for p in SCRIPTS],
    ids=lambda p: p.stem,
)
def test_a_page_does_what_it_says(page, cache, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "0")
    monkeypatch.setenv("DESAT_CACHE", str(cache))
    before = cpu()
    with matplotlib.rc_context(fname=DOCS / "matplotlibrc"):
        matplotlib.use("svg")
        ran = run(page, tmp_path)
    spent = cpu() - before
    for (_, output), (block, _) in pairwise(ran):
        if block.kind == "text":
            assert matches(block.text.split(), output.split()), (
                f"{page.name}:{block.line}: printed\n{output}"
            )
    for name in set(
        re.findall(r"!\[[^\]]*\]\(([^)/]+\.svg)\)", page.read_text(encoding="utf-8"))
    ):
        if (tmp_path / name).exists():
            if os.environ.get("DESAT_WRITE"):
                shutil.copy(tmp_path / name, page.parent / name)
            size = (page.parent / name).stat().st_size
            assert size < 60_000, f"{name}: {size} bytes"
    assert spent < 2.0 * CPU[page.stem]


def test_the_pages_take_at_most_two_minutes_of_cpu():
    assert set(CPU) == {page.stem for page in SCRIPTS}
    assert sum(CPU.values()) <= 120.0


@pytest.mark.parametrize("page", FIRST, ids=lambda p: p.stem)
def test_pages_that_are_read_first_are_short(page):
    assert len(page.read_text(encoding="utf-8").splitlines()) <= 160


@pytest.mark.parametrize(
    ("message", "output", "is_so"),
    [
        ("a 1.23 ... b", "a 1.2349 x y b", True),
        ("a 1.23 ... b", "a 1.25 x y b", False),
        ("a b", "a b c", False),
        ("... 8.5e-04 %", "x 8.517e-04 %", True),
        ("met", "not", False),
        ("-1.0", "1.0", False),
        ("...", "", True),
    ],
)
def test_the_runner_tells_numbers_and_words_apart(message, output, is_so):
    assert matches(message.split(), output.split()) is is_so


@pytest.mark.parametrize(
    ("plain", "tex"),
    [
        (
            "M = gain (h x B) / |B|^2",
            r"M = \frac{\mathrm{gain}\, {\left(h \times B\right)}}{\left|B\right|^{2}}",
        ),
        ("p = exp(-T / tau)", r"p = \exp{\left(- \frac{T}{\tau}\right)}"),
        ("x_k = p x_(k-1)", r"x_{k} = p\, x_{k - 1}"),
        (
            "q' = 1/2 Omega(omega) q",
            r"q' = \tfrac{1}{2}\, \Omega{\left(\omega\right)}\, q",
        ),
        ("a = b ) c", None),
        ("a = b ? c", None),
    ],
)
def test_plain_equations_become_latex_or_stay_as_they_are(monkeypatch, plain, tex):
    monkeypatch.syspath_prepend(DOCS)
    import equations

    result = equations.block([plain])
    assert result is None if tex is None else tex in result


def find_linked_pages(html: Path) -> set[str]:
    """The pages that links lead to, from the first on."""
    page_names: set[str] = set()
    remaining = ["index.html"]
    while remaining:
        name = remaining.pop()
        if name not in page_names and name != "12u.html":  # which `make site` adds
            page_names.add(name)
            text = (html / name).read_text(encoding="utf-8")
            remaining += [
                os.path.relpath((html / name).parent / link, html)
                for link in re.findall(r'href="([^"#:]+\.html)', text)
            ]
    return page_names


@pytest.mark.study
def test_the_site_builds_in_a_minute_every_page_is_reached_and_none_needs_a_network(
    tmp_path,
):
    pytest.importorskip("sphinx")
    before = cpu()
    html = tmp_path / "html"
    process = subprocess.run(
        [
            sys.executable,
            "-m",
            "sphinx",
            "-q",
            "-W",
            "--keep-going",
            "-n",
            "-b",
            "html",
            "-d",
            str(tmp_path / "doctrees"),
            str(DOCS),
            str(html),
        ],
        text=True,
        capture_output=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr[-4000:]
    assert cpu() - before < 60.0
    pages = {
        p.relative_to(DOCS).with_suffix(".html").as_posix() for p in DOCS.rglob("*.md")
    }
    assert pages <= find_linked_pages(html)
    page = (html / "generated/blocks/manager_cross_product.html").read_text(
        encoding="utf-8"
    )
    assert (
        r"\frac{\mathrm{gain}\, {\left(h \times B\right)}}{\left|B\right|^{2}}" in page
    )
    for file in html.rglob("*.html"):
        text = file.read_text(encoding="utf-8")
        assert not re.findall(
            r'<(?:script|link)[^>]*(?:src|href)="https?:[^"]*"', text
        ), file.name


@pytest.mark.slow
def test_the_notebook_gives_its_outputs(tmp_path):
    """Every cell runs, and prints and shows what is stored."""
    nbformat = pytest.importorskip("nbformat")
    nbclient = pytest.importorskip("nbclient")
    notebook = nbformat.read(DOCS / "tutorials" / "7-notebook.ipynb", 4)
    again = nbformat.reads(nbformat.writes(notebook), 4)
    nbclient.NotebookClient(
        again,
        timeout=200,
        kernel_name="python3",
        resources={"metadata": {"path": tmp_path}},
    ).execute()

    def list_outputs(cell):
        prints = "".join(
            o["text"]
            for o in cell.outputs
            if o.output_type == "stream" and o.name == "stdout"
        )
        results = [
            o["data"]["text/plain"]
            for o in cell.outputs
            if o.output_type == "execute_result"
        ]
        pictures = sum("image/png" in o.get("data", {}) for o in cell.outputs)
        return prints.strip(), results, pictures

    cells = [c for c in again.cells if c.cell_type == "code"]
    assert len(cells) >= 6
    for cell, before in zip(
        cells, [c for c in notebook.cells if c.cell_type == "code"], strict=True
    ):
        assert list_outputs(cell) == list_outputs(before), cell.source
