"""What several tests need. The FMUs are built by `make fmus`, which `make test` runs
first."""

from __future__ import annotations

import contextlib
import gc
import importlib
import importlib.util
import io
import os
import shlex
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
import psutil
import pytest
from hypothesis import settings
from jinja2 import Environment

from desat import cli
from desat.files import paths
from desat.files.scenario import scenarios
from desat.fmus import registry
from desat.fmus.compiler import compiler

settings.register_profile("desat", deadline=None, max_examples=60, derandomize=True)
settings.load_profile("desat")

ROOT = Path(__file__).resolve().parent.parent


# --- rooms behind walls: the package works without them -------------------------------

TESTS_OF = {"papers": ("papers", "site/test_pages.py"), "web": ("web",)}
ABSENT = [
    package
    for package in TESTS_OF
    if importlib.util.find_spec(f"desat.{package}") is None
]
collect_ignore = [path for package in ABSENT for path in TESTS_OF[package]]


class AbsentModule:
    """Skip the test that uses a module of a room that is absent."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __getattr__(self, attribute: str) -> None:
        pytest.skip(f"{self._name} is absent")


def module_of(name: str) -> Any:
    """Return a module that needs a room that may be absent: who uses it is skipped
    where it is."""
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if error.name not in [f"desat.{package}" for package in ABSENT]:
            raise
        return AbsentModule(error.name)


@pytest.fixture(scope="session", autouse=True)
def _fmus_are_built() -> None:
    missing = [n for n in registry.names() if not (paths.fmus() / f"{n}.fmu").exists()]
    assert not missing, f"run `make fmus` first: {missing}"


@pytest.fixture(scope="session", autouse=True)
def _templates_are_compiled_once() -> Iterator[None]:
    """Keep what Jinja makes of a template: a process of tests writes hundreds of craft
    and reports, a command one."""
    anew, templates = Environment.compile, dict[tuple[object, ...], Any]()

    def compile_once(self: Environment, source: Any, *args: Any, **options: Any) -> Any:
        switches = [
            (name, value)
            for name, value in vars(self).items()
            if isinstance(value, str | bool)
        ]
        key = (
            source,
            *args,
            *sorted(options.items()),
            *switches,
            self.undefined,
            *self.extensions,
            *self.filters,
            *self.tests,
        )
        if key not in templates:
            templates[key] = anew(self, source, *args, **options)
        return templates[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Environment, "compile", compile_once)
        yield


description_of = cache(fmpy.read_model_description)
"""The model description of an FMU: fmpy takes 0.1 s to read one, and many tests want
the same."""


def started(name: str, **values: object):
    """A bare block with these values, checked and started."""
    block = registry.block_class(name)()
    for key, value in values.items():
        assert hasattr(block, key), key
        setattr(block, key, value)
    block.check()
    block.start()
    return block


@pytest.fixture(scope="module")
def quick_builds(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of a module's own, into which block files are compiled without
    optimising: for tests of what is built, not of how fast it is."""
    folder = tmp_path_factory.mktemp("builds")
    script = folder / "cc"  # this process keeps its compiler, a build asks for one
    script.write_text(f'#!/bin/sh\nexec {shlex.join(compiler())} "$@" -O0\n')
    script.chmod(0o755)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CC", str(script))
        patch.setenv("DESAT_CACHE", str(folder / "cache"))
        yield folder / "cache"


def cross3(a: Any, b: Any) -> np.ndarray:
    """The cross product of two vectors, by the operations of np.cross: that takes ten
    times as long, most of an integration in a test."""
    (a1, a2, a3), (b1, b2, b3) = a, b
    return np.array((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1))


# --- a browser ------------------------------------------------------------------------

CHROMIUM = (
    os.environ.get("DESAT_CHROMIUM")
    or shutil.which("chromium")
    or shutil.which("google-chrome")
)


@pytest.fixture(scope="session", params=["chromium", "firefox"])
def browser(request):
    """Chromium, by its name or that of DESAT_CHROMIUM, and the Firefox of playwright
    (`playwright install firefox`), driven by that package."""
    api = pytest.importorskip("playwright.sync_api", reason="no playwright")
    if request.param == "chromium" and CHROMIUM is None:
        pytest.skip("no Chromium")
    with api.sync_playwright() as playwright:
        if request.param == "firefox":
            if not Path(playwright.firefox.executable_path).exists():
                pytest.skip("no Firefox of playwright")
            result = playwright.firefox.launch(timeout=30_000)
        else:
            result = playwright.chromium.launch(
                executable_path=CHROMIUM,
                timeout=30_000,
                args=["--no-sandbox", "--headless", "--lang=en-US"],
            )
        yield result
        result.close()


def wait_until(tab: Any, expression: str, seconds: float = 20.0) -> None:
    """Wait until an expression is true in a page.

    Playwright's own function makes code of text in the page, which the page's policy
    forbids.
    """
    end = time.monotonic() + seconds
    while not tab.evaluate(expression):
        assert time.monotonic() < end, f"{expression} is not true after {seconds:g} s"
        time.sleep(0.05)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that need a browser."""
    for item in items:
        if "browser" in getattr(item, "fixturenames", ()):
            item.add_marker("in_browser")


gc.disable()  # while thousands of tests are collected: nothing of that goes


def pytest_collection_finish() -> None:
    """Collect garbage again, and look at none of the tests for it."""
    gc.collect()
    gc.freeze()
    gc.enable()


SLOW_LEFT_OUT = pytest.StashKey[int]()


def pytest_deselected(items: Sequence[pytest.Item]) -> None:
    """Count the slow tests that are left out, for who collects them."""
    count = sum(item.get_closest_marker("slow") is not None for item in items)
    if count:
        config = items[0].config
        config.stash[SLOW_LEFT_OUT] = config.stash.get(SLOW_LEFT_OUT, 0) + count


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Hand the count of a worker on to the process that reports."""
    output = getattr(session.config, "workeroutput", None)
    if output is not None:
        output["slow_left_out"] = session.config.stash.get(SLOW_LEFT_OUT, 0)


@pytest.hookimpl(optionalhook=True)
def pytest_testnodedown(node: Any) -> None:
    """Keep the count of a worker; all of them collect the same tests."""
    output = getattr(node, "workeroutput", None) or {}  # none where it died
    if count := output.get("slow_left_out"):
        node.config.stash[SLOW_LEFT_OUT] = count


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say whether the tests in a browser ran, and which tests did not: the slow ones,
    and those for want of a room."""
    if count := terminalreporter.config.stash.get(SLOW_LEFT_OUT, 0):
        terminalreporter.write_line(
            f"slow tests left out: {count}; `make test-slow` runs them"
        )
    for package in ABSENT:
        places = ", ".join(f"tests/{path}" for path in TESTS_OF[package])
        terminalreporter.write_line(f"desat.{package} is absent: not run: {places}")
    reports = {
        way: [
            report
            for report in terminalreporter.getreports(way)
            if "in_browser"
            in getattr(report, "keywords", ())  # of a file that is left out: none
        ]
        for way in ("passed", "failed", "skipped")
    }
    ran = sum(r.when == "call" for r in [*reports["passed"], *reports["failed"]])
    if ran:
        terminalreporter.write_line(f"tests in a browser: {ran} ran ({CHROMIUM})")
    elif reports["skipped"]:
        reason = reports["skipped"][0].longrepr
        text = reason[2] if isinstance(reason, tuple) else str(reason)
        terminalreporter.write_line(f"tests in a browser: DID NOT RUN: {text}")


Command = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def apart() -> Command:
    """Run the command `desat` in a process apart, in the repository's folder."""

    def run(*arguments: str, check: bool = False, **options: object):
        return subprocess.run(
            [sys.executable, "-m", "desat.cli", *arguments],
            capture_output=True,
            text=True,
            cwd=options.pop("cwd", ROOT),
            check=check,
            timeout=300,
            **options,
        )

    return run


@pytest.fixture
def daemons(monkeypatch) -> Callable[[], list[psutil.Process]]:
    """The daemons that an FMU of tests/failing.c has left, of this process' tests
    alone: others run the same tests at the same time."""
    name = f"daemon_{os.getpid()}"  # a name has 15 characters
    monkeypatch.setenv("DAEMON", name)

    def alive() -> list[psutil.Process]:
        processes = psutil.process_iter(["name", "status"])
        mine = [p for p in processes if p.info["name"] == name]
        return [p for p in mine if p.info["status"] != psutil.STATUS_ZOMBIE]

    return alive


@pytest.fixture
def desat(monkeypatch) -> Command:
    """The same in this process: to start another takes longer than most commands."""

    def run(*arguments: str, check: bool = False, cwd: Path = ROOT):
        out, err = io.StringIO(), io.StringIO()
        with (
            monkeypatch.context() as patch,
            contextlib.chdir(cwd),
            contextlib.redirect_stdout(out),
            contextlib.redirect_stderr(err),
        ):
            patch.setattr(sys, "argv", ["desat", *arguments])
            code = int(cli._code())
        command = subprocess.CompletedProcess(
            arguments, code, out.getvalue(), err.getvalue()
        )
        if check:
            command.check_returncode()
        return command

    return run


def slow_after(count: int, values: Iterable[Any], mark: str = "slow") -> list[Any]:
    """Return values of a test of which all but the first few are slow, or studies."""
    return [
        value if k < count else slow_value(value, mark)
        for k, value in enumerate(values)
    ]


def slow_value(value: Any, mark: str = "slow") -> Any:
    """Return a value, or a tuple of several, with which a test is slow, or a study."""
    values = value if isinstance(value, tuple) else (value,)
    return pytest.param(*values, marks=getattr(pytest.mark, mark))


def one_of_each_craft() -> list[str]:
    """The first scenario of each craft and choice of FMUs."""
    names: dict[str, str] = {}
    for name, scenario in scenarios().items():
        of = scenario.content
        kind = (scenario.family, of.craft, of.ssd, of.sources)
        names.setdefault(repr(kind), name)
    return list(names.values())


def python(
    code: str, *arguments: str, timeout: float = 300, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        cwd=ROOT,
        timeout=timeout,
        check=False,
        env=env,
    )


def but(content, **changes):
    """What a scenario says with other keys, as they would be written; None leaves one
    out."""
    data = {k: v for k, v in {**content.written, **changes}.items() if v is not None}
    return type(content).model_validate(data)
