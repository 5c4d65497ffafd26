"""The tree: no circle of imports, rooms that import from those below them, all of it
packaged."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.conftest import ABSENT, ROOT
from tests.style.source import nodes_of

HOME = ROOT / "orchestrator"
ROOMS = (
    "system",
    "language",
    "files",
    "begin",
    "engine",
    "numbers",
    "figures",
    "analyses",
    "runs",
    "report",
    "export",
    "campaign",
    "sizing",
    "studies",
    "telemetry",
    "cli",
    "papers",
    "web",
)
"""The rooms of orchestrator/; each imports from those before it."""
WALLED = ("papers", "web")
"""Rooms that nothing else imports: the package works without them."""
MOST = 25
"""Files of a room."""


def modules(home: Path) -> dict[str, Path]:
    """The files below a folder by the names of their modules; its own name is empty."""
    return {
        ".".join(p.relative_to(home).with_suffix("").parts)
        .removesuffix("__init__")
        .rstrip("."): p
        for p in home.rglob("*.py")
    }


def find_imports(
    module: str, file: Path, known_modules: dict[str, Path], name: str
) -> Iterator[str]:
    """The modules that a file imports, also within functions and for types alone: who
    reads the one must know the other."""
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    for node in nodes_of(file):
        if isinstance(node, ast.Import):
            targets = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = [name, *package.split(".")] if package else [name]
            base = above[: len(above) - node.level + 1] if node.level else []
            start = ".".join([*base, *(node.module or "").split(".")]).rstrip(".")
            targets = [(start, alias.name) for alias in node.names]
        else:
            continue
        for start, attribute in targets:
            if start != name and not start.startswith(f"{name}."):
                continue
            path = start[len(name) + 1 :]
            substeps = f"{path}.{attribute}".lstrip(".")
            yield substeps if substeps in known_modules else path


def circle(home: Path, name: str = "desat") -> list[str]:
    """A circle of modules that import each other, or nothing."""
    known_modules = modules(home)
    edges = {
        m: set(find_imports(m, file, known_modules, name)) & known_modules.keys() - {m}
        for m, file in known_modules.items()
    }
    while leaves := [m for m, targets in edges.items() if not targets & edges.keys()]:
        for leaf in leaves:
            del edges[leaf]
    path = [min(edges)] if edges else []
    while path and path[-1] not in path[:-1]:
        path.append(min(edges[path[-1]] & edges.keys()))
    return path[path.index(path[-1]) :] if path else []


@pytest.mark.parametrize(
    ("folder", "name", "least"),
    [
        ("orchestrator", "desat", 60),
        ("components", "desat.components", 60),
        ("fmus", "desat.fmus", 15),
    ],
)
def test_no_modules_import_each_other_in_a_circle(folder, name, least):
    assert len(modules(ROOT / folder)) > least
    assert " -> ".join(circle(ROOT / folder, name)) == ""


@pytest.mark.parametrize(
    "line",
    [
        "from .b import y",
        "from . import b",
        "from desat.b import y",
        "import desat.b",
        "def f():\n    from .b import y",
        "if TYPE_CHECKING:\n    from .b import y",
    ],
)
def test_a_circle_is_found(tmp_path, line):
    (tmp_path / "__init__.py").write_text("")
    (tmp_path / "a.py").write_text(line)
    (tmp_path / "b.py").write_text("from .c import z")
    (tmp_path / "c.py").write_text("")
    assert circle(tmp_path) == []
    (tmp_path / "c.py").write_text("from desat import a")
    assert circle(tmp_path) == ["a", "b", "c", "a"]


def test_rooms_import_from_those_below_them():
    assert {p.parent.name for p in HOME.glob("*/*.py")} == {*ROOMS} - {*ABSENT}
    known_modules = modules(HOME)
    rooms = {
        (module.partition(".")[0], target.partition(".")[0])
        for module, file in known_modules.items()
        if module
        for target in find_imports(module, file, known_modules, "desat")
    }
    upward = {
        (package, other)
        for package, other in rooms
        if other in ROOMS and ROOMS.index(package) < ROOMS.index(other)
    }
    assert upward == set()
    sizes = Counter(p.parent for p in HOME.rglob("*.py"))
    assert {p.name: n for p, n in sizes.items() if n > MOST} == {}


def test_no_room_imports_one_behind_a_wall():
    """But for `desat.tables`, whose type `desat/__init__.py` names."""
    known_modules = modules(HOME)
    del known_modules[""]
    beyond = []
    for module, file in known_modules.items():
        for target in find_imports(module, file, known_modules, "desat"):
            package = target.partition(".")[0]
            if package in WALLED and module.partition(".")[0] != package:
                beyond.append(f"{module} imports {target}")
    assert beyond == []


COMMANDS_OF = {"papers": ("tables", "design"), "web": ("web",)}
WITHOUT_CHECKOUT = """
import sys
# an editable installation would find the room that is left out in the checkout
sys.meta_path = [finder for finder in sys.meta_path if "__editable__" not in str(finder)]
"""


@pytest.fixture(
    scope="module", params=[package for package in WALLED if package not in ABSENT]
)
def without(request, tmp_path_factory):
    """The room that a copy of the package is without, and Python code run with that
    copy."""
    package, folder = request.param, tmp_path_factory.mktemp("without")
    shutil.copytree(
        HOME, folder / "desat", ignore=shutil.ignore_patterns("__pycache__")
    )
    shutil.rmtree(folder / "desat" / package)
    for name in ("components", "fmus"):
        (folder / "desat" / name).symlink_to(ROOT / name)
    for name in ("ssp", "docs", "fmus"):
        (folder / name).symlink_to(ROOT / name)

    def run(code: str, *arguments: str) -> tuple[int, str]:
        process = subprocess.run(
            [sys.executable, "-c", WITHOUT_CHECKOUT + code, *arguments],
            capture_output=True,
            text=True,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(folder)},
        )
        return process.returncode, process.stdout + process.stderr

    return package, run


COMMAND = "from desat.cli import main; main()"


def test_the_core_works_without_a_room(without):
    _, run = without
    code, text = run(COMMAND, "check", "nadir_day/day-dipole")
    assert (code, "no problem" in text) == (0, True), text
    code, text = run(
        COMMAND, "run", "nadir_day/day-dipole", "--stop", "60", "--out", "flown"
    )
    assert (code, "60 steps" in text) == (0, True), text


def test_commands_of_an_absent_room_are_not_listed(without):
    package, run = without
    help_text = run(COMMAND, "--help")[1] + run(COMMAND, "export", "--help")[1]
    assert "bound" in help_text
    for other, names in COMMANDS_OF.items():
        for name in names:
            assert (f"\n  {name} " in help_text) == (other not in (package, *ABSENT)), (
                name
            )


def test_what_an_absent_room_does_is_refused_in_a_line(without):
    package, run = without
    if package == "papers":
        lines = {
            "check uosat12/fig2-ccpl-1": "uosat12/fig2-ccpl-1: [design]",
            "check uosat12/fig2-ccpl-1 --design now": "--design now",
        }
        for command, requests in lines.items():
            code, text = run(COMMAND, *command.split())
            subject = "designs are computed by desat.papers, which is not installed"
            assert (code, text) == (2, f"error: {requests}: {subject}\n")
        code, text = run("import desat; desat.tables")
        assert text.endswith(
            "desat.tables needs desat.papers, which is not installed\n"
        )
    else:
        code, text = run(COMMAND, "export", "web", "nadir_day/day-dipole")
        assert (code, text.count("\n")) == (2, 1), text


def test_every_package_is_in_the_wheel():
    """setuptools finds no packages under another name than their folder's, so they are
    listed."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = settings["tool"]["setuptools"]["packages"]
    data = {"desat.ssp", "desat.docs"}
    names = {
        "orchestrator": "desat",
        "components": "desat.components",
        "fmus": "desat.fmus",
    }
    code_folders = {
        ".".join([name, *file.parent.relative_to(ROOT / folder).parts])
        for folder, name in names.items()
        for file in (ROOT / folder).rglob("*.py")
    }
    packages = [
        name
        for name in packages
        if name.split(".")[1:2] not in [[package] for package in ABSENT]
    ]
    assert sorted(packages) == sorted(code_folders | data)
    assert not {f"desat.{p.name}" for p in HOME.iterdir()} & data, (
        "data would hide a package"
    )
