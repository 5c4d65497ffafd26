"""The Content Security Policy: every page that we write has one, and runs under it."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import re
import shlex
from pathlib import Path

import pytest
from jinja2 import DictLoader
from lxml import html
from typer.testing import CliRunner

from desat import cli
from desat.components.blocks.wheels import Wheels
from desat.fmus.description import documentation
from desat.report import policy
from desat.report.report import render
from tests.conftest import ABSENT, ROOT

TEMPLATES = sorted((ROOT / "orchestrator").rglob("*.html"))
SOURCES = sorted(
    file
    for folder in ("orchestrator", "components", "fmus", "benchmarks")
    for file in (ROOT / folder).rglob("*")
    if file.suffix in (".py", ".html", ".js", ".jinja")
)
PAGE_BEGINS = re.compile(r"<!doctype html|<html\b", re.IGNORECASE)
META = "//meta[@http-equiv='Content-Security-Policy']/@content"
PARTIAL = {"table.html", "figures.html", "scene.html"}
"""Templates of macros alone, which other templates import."""


def policy_of(page: str) -> str:
    """Return the policy of a page, which has exactly one."""
    (meta_policy,) = html.fromstring(page).xpath(META)
    return str(meta_policy)


def hash_of(code: str) -> str:
    """Return the source expression that allows an inline script."""
    digest = hashlib.sha256(code.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode()}'"


def check(page: str) -> None:
    """Assert that a page has a policy that allows what the page runs, and no more."""
    tree = html.fromstring(page)
    page_policy = policy_of(page)
    assert "default-src 'none'" in page_policy
    assert "'unsafe-eval'" not in page_policy.replace("'wasm-unsafe-eval'", "")
    scripts = page_policy.partition("script-src")[2].partition(";")[0].split()
    assert "'unsafe-inline'" not in scripts
    run = [e.text for e in tree.iter("script") if not e.get("type")]
    assert {hash_of(code) for code in run} == {s for s in scripts if "sha256" in s}
    assert not tree.xpath("//@*[starts-with(name(), 'on')]"), (
        "a handler in an attribute"
    )
    assert not tree.xpath("//*[starts-with(@href, 'javascript:')]")
    # a policy holds from where it stands on
    before = page[: page.index("Content-Security-Policy")]
    assert "<script" not in before
    assert "<style" not in before


def test_a_page_begins_only_where_it_gets_its_policy():
    """A file that begins a page has the policy in it; each of our templates extends
    that one."""
    begins = [f for f in SOURCES if PAGE_BEGINS.search(f.read_text(encoding="utf-8"))]
    assert begins
    for file in begins:
        assert "Content-Security-Policy" in file.read_text(encoding="utf-8"), file
    assert {f.name for f in begins} == {"page.html", "description.py"}
    for template in TEMPLATES:
        text = template.read_text(encoding="utf-8")
        if template.name not in {"page.html", *PARTIAL}:
            # or one that extends it
            assert re.match(r'{% extends "(page|study)\.html" %}', text), template.name


@pytest.mark.parametrize("template", TEMPLATES, ids=lambda p: p.name)
def test_a_template_runs_no_script_of_its_own(template):
    """Scripts come by `run_script`, which allows them; a policy forbids all others."""
    text = template.read_text(encoding="utf-8")
    assert not re.search(r"<script(?![^>]*\btype=)", text)
    assert not re.search(r"<[^>{]*\son\w+\s*=", text)


def test_a_new_template_without_a_policy_is_refused(monkeypatch):
    pages = {"new.html": "<!doctype html><title>{{ title }}</title>"}
    monkeypatch.setattr("jinja2.FileSystemLoader", lambda _: DictLoader(pages))
    with pytest.raises(ValueError, match="page without a policy"):
        render("new.html", title="x")


def test_a_script_of_somebody_else_is_not_allowed(monkeypatch):
    """Also where it came into the page as it is: only scripts by name have a hash."""
    base = str(policy.part("page.html"))
    body = '{% extends "page.html" %}{% block body %}{{ text|safe }}{{ run_script(["locale.js"]) }}'
    pages = {"page.html": base, "new.html": body + "{% endblock %}"}
    monkeypatch.setattr("jinja2.FileSystemLoader", lambda _: DictLoader(pages))
    page = render(
        "new.html", title=policy.PLACEHOLDER, text="<script>alert(1)</script>"
    )
    page_policy = policy_of(page)
    assert hash_of("alert(1)") not in page_policy
    assert hash_of(policy.part("locale.js")) in page_policy


def test_the_page_within_an_fmu_has_a_policy():
    check(documentation(Wheels, "wheels"))


# --- pages of each kind ---------------------------------------------------------------


CRAFT = "new craft my12u --size 12U --altitude 400km --inclination 51.6deg --rods 0.2"
LINES = {
    "report": "run my12u --stop 200 --out report",
    "compare": "compare my12u my12u/worst.toml --stop 200 --html compare.html",
    "laws": "compare my12u --laws ccpl --stop 200 --html laws.html",
    "campaign": "campaign my12u -n 2 --stop 100 --jobs 1 --out campaign",
    "tables": "tables space_telescope --html tables.html",
    "map": "size my12u --map --rods 0.2 --inclinations 51.6 --altitudes 400 --dipoles 0.05 "
    "--html map.html",
}
if "papers" in ABSENT:
    del LINES["tables"]
"""How a page of each kind is written; those of `desat size` and `export web` take
longer, and are checked where they are made (tests/sizing/test_sizing.py, tests/web/test_page.py)."""


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, Path]:
    """A page of each kind."""
    folder = tmp_path_factory.mktemp("pages")
    page_files = {}
    for kind, line in {"craft": CRAFT, **LINES}.items():
        with contextlib.chdir(folder):
            invocation = CliRunner().invoke(cli.app_for([]), shlex.split(line))
        assert invocation.exit_code in (0, 1), (
            invocation.output
        )  # 1: a requirement is not met
        path = folder / f"{kind}.html"
        page_files[kind] = path if path.exists() else folder / kind / "report.html"
    del page_files["craft"]
    return page_files


@pytest.mark.parametrize("kind", LINES)
def test_a_page_allows_what_it_runs_and_no_more(pages, kind):
    check(pages[kind].read_text(encoding="utf-8"))


def test_pages_run_under_their_policy(browser, pages):
    """No browser says that the policy of a page forbade a part of it."""
    for kind, path in pages.items():
        tab = browser.new_page()
        messages: list[str] = []
        tab.on(
            "console", lambda message, messages=messages: messages.append(message.text)
        )
        tab.on(
            "pageerror", lambda error, messages=messages: messages.append(str(error))
        )
        tab.goto(path.as_uri())
        assert tab.evaluate("document.readyState") == "complete"
        assert messages == [], kind
        tab.close()
