"""What a command writes: a regular file is replaced as a whole, a link stays, anything
else is refused before anything is computed; nothing is written elsewhere, nothing
half-written stays."""

from __future__ import annotations

import ast
import os
import shlex
import stat
from pathlib import Path

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.export.series import export
from desat.files import io
from desat.runs.run import execute
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import module_of
from tests.fuzz import commands

pages = module_of("benchmarks.pages.verbs")

ROOMS = Path(io.__file__).parents[1]
QUICK = "--blocks --stop 3 --step 1 --substeps 1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    result = tmp_path_factory.mktemp("outputs")
    commands.prepare(result)
    return result


WRITERS = {
    "export fmu mine --out OUT": "--out",
    "export fmu mine --fmi 3 --out OUT": "--out",
    "size mine --html OUT": "--html",
    "size mine --map --html OUT": "--html",
    f"compare mine mine --html OUT {QUICK}": "--html",
    f"compare mine --laws manager_cross_product --html OUT {QUICK}": "--html",
}


@pytest.mark.parametrize("line", WRITERS)
def test_a_pipe_stays_and_nothing_is_computed(folder, line, monkeypatch):
    monkeypatch.setattr(commands, "LONGEST", 5)  # all of these take longer
    pipe = folder / "pipe"
    if not pipe.exists():
        os.mkfifo(pipe)
    code, message = commands.run_line(shlex.split(line.replace("OUT", "pipe")), folder)
    assert (code, message) == (
        2,
        f"error: {WRITERS[line]} pipe: not a regular file; nothing is written in its place\n",
    )
    assert stat.S_ISFIFO(pipe.stat().st_mode)


PLANTED = {
    "new craft craft --force": "craft/nominal.toml",
    "new law my_law --force": "my_law.py",
    "new block magnetometer my_block --force": "my_block.py",
    "export c magnetometer --out c": "c/magnetometer.h",
    "build my_own.py": "my_own.fmu",
    "pack own.toml": "own.ssp",
    "pack --ssd own.craft.toml": "own.ssd",
}


@pytest.mark.parametrize("line", PLANTED)
@pytest.mark.parametrize("kind", ["pipe", "link", "loop", "folder"])
def test_what_is_planted_where_a_file_goes(tmp_path, line, kind):
    write(tmp_path / "craft", CraftFacts(size="3U"), "")
    (tmp_path / "own.toml").write_text('extends = "nadir_day/day-dipole"\n')
    (tmp_path / "own.craft.toml").write_bytes(
        (tmp_path / "craft" / "craft.toml").read_bytes()
    )
    if line.startswith("build"):
        assert commands.run_line(["new", "law", "my_own"], tmp_path)[0] == 0
    obstacle, target = tmp_path / PLANTED[line], tmp_path / "target"
    obstacle.parent.mkdir(exist_ok=True)
    obstacle.unlink(missing_ok=True)
    if kind == "pipe":
        os.mkfifo(obstacle)
    elif kind == "folder":
        obstacle.mkdir()
    else:
        obstacle.symlink_to(target if kind == "link" else obstacle)
        if kind == "link":
            target.write_text("before")
    code, message = commands.run_line(shlex.split(line), tmp_path)
    if kind == "link":
        assert code == 0, message
        assert obstacle.is_symlink()
        assert target.read_bytes() != b"before"
    else:
        assert (code, message.count("\n")) == (2, 1), message
        assert message.startswith("error: ")
        assert obstacle.name in message
        is_kept = {"pipe": stat.S_ISFIFO, "folder": stat.S_ISDIR, "loop": stat.S_ISLNK}[
            kind
        ]
        assert is_kept(obstacle.lstat().st_mode)
    assert list(tmp_path.rglob("*.tmp")) == []
    assert list(tmp_path.rglob("*.part")) == []


@pytest.mark.slow
def test_a_loop_is_written_at_the_end_of_a_link(tmp_path):
    commands.prepare(tmp_path)
    (tmp_path / "link.fmu").symlink_to("real.fmu")
    code, message = commands.run_line(
        ["export", "fmu", "mine", "--out", "link.fmu"], tmp_path
    )
    assert code == 0, message
    assert (tmp_path / "link.fmu").is_symlink()
    assert (tmp_path / "real.fmu").read_bytes()[:2] == b"PK"


@pytest.mark.parametrize(
    "name", ["../../escaped", "/escaped", "a/b", "..", "", "a\\b", ".hidden"]
)
def test_a_figure_has_a_name_without_separators(name):
    with pytest.raises(
        DesatError, match=r"figure .*: a name of letters, digits and \. _ - is"
    ):
        pages.Verbs._figure(pages.Verbs.__new__(pages.Verbs), name, "caption", "<svg/>")


def test_a_plot_is_not_written_outside(tmp_path):
    (tmp_path / "own.toml").write_text(
        'extends = "nadir_day/day-dipole"\n[plots."../escaped"]\ntitle = "x"\n'
        'signals = ["wheels.h_wheel"]\nunit = "N.m.s"\n'
    )
    run = tmp_path / "run"
    execute(
        str(tmp_path / "own.toml"),
        Options(stop=3.0, step=1.0, substeps=1, blocks=True),
        run,
    )
    with pytest.raises(DesatError, match=r"plot \.\./escaped: a file's name has no /"):
        export(run, "png")
    assert not (tmp_path / "escaped.png").exists()


INTERNAL = {
    "catalogue.py",
    "checkpoint.py",
    "console.py",
    "recorder.py",
    "row_buffer.py",
    "series_file.py",
    "store.py",
    "io.py",
}
"""Of caches and run folders, which are ours alone, and of streams."""


def test_all_else_is_written_by_one_function():
    """`io.replacing`: no other file of ours opens one to write, or puts one in
    another's place."""
    writers = []
    for path in sorted(ROOMS.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call) or path.name in INTERNAL:
                continue
            function_name = ast.unparse(node.func)
            modes = [
                a.value
                for a in (*node.args, *(k.value for k in node.keywords))
                if isinstance(a, ast.Constant)
            ]
            opens = function_name.endswith("open") and {
                "w",
                "wb",
                "a",
                "ab",
                "x",
                "xb",
            } & {m for m in modes if isinstance(m, str)}
            if function_name.endswith((".write_text", ".write_bytes")) or opens:
                writers.append(f"{path.name}:{node.lineno}: {ast.unparse(node)[:60]}")
    exceptions = [f for f in writers if "self.write_text" in f]
    assert [f for f in writers if f not in exceptions] == []
