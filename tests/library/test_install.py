"""The wheel in an environment of its own, used from an empty folder, without the
checkout."""

from __future__ import annotations

import hashlib
import json
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

from desat.cli import EXTRAS
from desat.files import paths
from desat.files.scenario import scenarios
from desat.fmus import registry
from tests.conftest import ROOT, python


def _do(
    *command: str | Path, code: int = 0, **options: object
) -> subprocess.CompletedProcess[str]:
    process = subprocess.run(
        [str(c) for c in command],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        **options,
    )
    assert process.returncode == code, process.stdout + process.stderr
    return process


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A folder with an environment `env` in which the wheel is, and nothing of the
    checkout.

    What desat needs is taken from the environment of the tests, so that this takes
    seconds; its finder of the checkout is not, for a .pth inside a folder that a .pth
    names is not read.
    """
    folder = tmp_path_factory.mktemp("install")
    source = folder / "source"
    files = _do(
        "git", "ls-files", "-co", "--exclude-standard", cwd=ROOT
    ).stdout.splitlines()
    for name in files:
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, source / name)
    _do(sys.executable, "-m", "venv", "--without-pip", folder / "env")
    python = folder / "env" / "bin" / "python"
    site = Path(
        _do(
            python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"
        ).stdout.strip()
    )
    _do(
        sys.executable,
        "-m",
        "pip",
        "--python",
        python,
        "install",
        "-q",
        "--no-deps",
        "--disable-pip-version-check",
        source,
    )
    shutil.rmtree(source)
    (site / "others.pth").write_text(
        sysconfig.get_path("purelib") + "\n", encoding="utf-8"
    )
    return folder


@pytest.fixture
def run_installed(home, cached_fmus, tmp_path):
    """Run a program of the environment from an empty folder; the cache is in `home`."""
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "DESAT"))
    }
    environment["DESAT_CACHE"] = str(home / "cache")

    def run(program: str, *arguments: str, code: int = 0) -> str:
        process = _do(
            home / "env" / "bin" / program,
            *arguments,
            cwd=tmp_path,
            env=environment,
            code=code,
        )
        return process.stderr if code else process.stdout

    return run


def _contents(folder: Path) -> dict[str, str]:
    return {
        p.relative_to(folder).as_posix(): hashlib.sha256(p.read_bytes()).hexdigest()
        for p in folder.rglob("*")
        if p.is_file() and p.suffix != ".pyc"
    }


#: Blocks whose FMUs the wheel builds in its test; the others are the checkout's.
BUILT = ("environment_kepler", "manager_cross_product")


@pytest.fixture(scope="module")
def cached_fmus(home) -> Path:
    """The FMUs in the cache of the wheel: the checkout's, and some that it builds."""
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "DESAT"))
    }
    environment["DESAT_CACHE"] = str(home / "cache")
    python = home / "env" / "bin" / "python"
    code = "from desat.files import paths; print(paths._cache())"
    cache = Path(_do(python, "-c", code, env=environment).stdout.strip()) / "fmus"
    left_out = shutil.ignore_patterns(*(f"{name}.fmu" for name in BUILT))
    shutil.copytree(paths.fmus(), cache, ignore=left_out)
    _do(python, "-m", "desat.fmus.build", "--into", cache, env=environment)
    return cache


@pytest.mark.slow
def test_from_an_empty_folder(home, run_installed, cached_fmus, tmp_path):
    """All scenarios are there, a run and a paper's tables work, nothing is written
    beside them; the wheel builds FMUs with the checkout's bytes."""
    place = Path(
        run_installed("python", "-c", "import desat; print(desat.__file__)").strip()
    ).parent
    assert place.is_relative_to(home / "env")
    before = _contents(place)
    names = [s["name"] for s in json.loads(run_installed("desat", "list", "--json"))]
    assert names == list(scenarios())
    result = json.loads(
        run_installed(
            "desat",
            "run",
            "integrated/mil-nadir",
            "--stop",
            "600",
            "--json",
            "--no-baseline",
        )
    )
    assert result["status"] == "completed"
    assert result["end_time"] == 600.0
    assert (tmp_path / result["report"]).is_file()
    rows = json.loads(run_installed("desat", "tables", "uosat12", "--json"))["rows"]
    assert len(rows) > 50
    assert any(row["draws"] for row in rows)
    assert _contents(place) == before
    assert [p.name for p in cached_fmus.parent.iterdir()] == ["fmus"]
    cached_bytes = {
        p.relative_to(cached_fmus).as_posix(): p.read_bytes()
        for p in cached_fmus.rglob("*.fmu")
    }
    assert {
        f"{k}{n}.fmu" for k in ("", "native/") for n in BUILT
    } <= cached_bytes.keys()
    assert {n for n in cached_bytes if "/" not in n} == {
        f"{n}.fmu" for n in registry.names()
    }
    assert cached_bytes == {
        n: (paths.fmus() / n).read_bytes() for n in cached_bytes
    }  # the checkout's bytes


@pytest.mark.slow
def test_from_python(run_installed):
    """`import desat` imports nothing heavy and offers run, load, draws and tables."""
    code = """
import json
import sys
import desat
assert "numpy" not in sys.modules
import importlib.resources
assert (importlib.resources.files("desat") / "py.typed").is_file()
name, sets = "uosat12/table3-ocdc-ilqr-1", {"manager.split": "crcp"}
run = desat.run(name, sets, stop=100.0, folder="a")
assert run.manifest["parameters"]["manager"]["split"]["value"] == "crcp"
assert json.loads(desat.load("a").data.attrs["manifest"]) == run.manifest
print(run.results.values("spacecraft.h_copy_wheel").shape)
drawn = desat.draws(name, 2, stop=100.0)
print(len(drawn["draws"]))
"""
    assert run_installed("python", "-c", code).split("\n")[:2] == ["(11, 4)", "2"]


@pytest.mark.slow
def test_what_needs_a_checkout_says_so(run_installed, tmp_path):
    outcome = run_installed("desat", "design", "uosat12/fig2-mec-1", code=2)
    assert outcome.strip().endswith("--out FILE writes elsewhere")
    run_installed("desat", "design", "uosat12/fig2-mec-1", "--out", "mine.toml")
    assert (tmp_path / "mine.toml").is_file()


# --- a newcomer's walk --------------------------------------------------------------------------
# Its first step builds the FMUs, which `make release` does from the wheel; here most are the
# checkout's, the same bytes. In CI each step is short; what it takes in full stands in docs/your-craft.md.

MOST = 30.0
"""CPU (s) of a part of the walk."""


@pytest.fixture
def newcomer(home, cached_fmus, tmp_path):
    """A newcomer's shell in an empty folder: a command that ends well, and what it
    prints."""
    environment = {
        k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "DESAT"))
    }
    environment["DESAT_CACHE"] = str(home / "cache")

    def command(line: str, code: int = 0) -> str:
        process = _do(
            home / "env" / "bin" / "desat",
            *shlex.split(line),
            cwd=tmp_path,
            env=environment,
            code=code,
        )
        return process.stdout

    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command(
        "new craft my12u --altitude 400km --inclination 51.6deg --size 12U "
        "--wheels '4 pyramid 30mNms' --rods 0.2 --residual-dipole 0.05"
    )
    yield command
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < MOST


@pytest.mark.slow
def test_a_newcomer_flies_and_sizes_a_craft(newcomer, tmp_path):
    answer = json.loads(newcomer("run my12u --stop 600 --json --no-baseline"))
    assert answer["status"] == "completed"
    assert (tmp_path / answer["report"]).is_file()
    message = " ".join(newcomer("size my12u --stop 6000").split())
    assert message.startswith("sized: my12u by the model: ")
    assert " my12u holds with margins of " in message
    assert "Rods of " in message
    assert "it has 0.2 A m2" in message
    assert (tmp_path / "runs" / "size-my12u.html").is_file()


@pytest.mark.slow
def test_a_newcomer_chooses_a_law_of_all_and_of_her_own(newcomer, tmp_path):
    newcomer("new law my_law")
    answer = json.loads(
        newcomer("compare my12u --laws all --law my_law.py --stop 300 --json")
    )
    names = {law["name"] for law in answer["laws"]}
    assert {"cross product", "ccpl", "predictive", "my law"} <= names
    assert (tmp_path / answer["page"]).is_file()


@pytest.mark.slow
def test_a_newcomer_is_sure_by_a_campaign(newcomer, tmp_path):
    answer = newcomer("campaign my12u -n 4 --stop 120", code=1)
    assert "4 of 4 completed" in answer
    assert "0 of 4 outside" in answer, "too few to show that requirements hold"
    (report,) = (tmp_path / "runs").glob("*/report.html")
    assert "Total wheel momentum at the end (body frame)" in report.read_text(
        encoding="utf-8"
    )


@pytest.mark.slow
def test_the_pages_of_the_wheel_have_what_they_link_to(run_installed):
    """Other pages, pictures and the table of interfaces."""
    code = "from desat.files import paths; print(paths.PAGES)"
    pages = Path(run_installed("python", "-c", code).strip())
    missing = {
        f"{page.relative_to(pages)}: {link}"
        for page in pages.rglob("*.md")
        for link in re.findall(r"\]\(([^)#\s]+)", page.read_text())
        if "://" not in link and not (page.parent / link).exists()
    }
    assert missing == set()


# --- without the packages of the extras -----------------------------------------------


WITHOUT = """
import sys
from desat.cli import EXTRAS, main
class Absent:
    def find_spec(self, name, path=None, target=None):
        package = name.partition(".")[0]
        if package in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=package)
sys.meta_path.insert(0, Absent())
sys.argv[0] = "desat"
main()
"""


def test_extras_bring_the_packages_that_commands_may_lack():
    document = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = document["optional-dependencies"]
    for package, extra in EXTRAS.items():
        names = [re.split(r"[><=\[]", text)[0] for text in extras[extra]]
        assert package in names, package
    requirements = {re.split(r"[><=\[]", text)[0] for text in document["dependencies"]}
    assert not requirements & EXTRAS.keys()
    assert {"fmpy", "pythonfmu", "numpy", "scipy", "matplotlib"} <= requirements


@pytest.mark.parametrize(
    ("line", "package"),
    [
        ("run NAME --stop 100 --out {0}/run", None),
        ("check NAME", None),
        ("show NAME --diagram --out {0}/loop.svg", None),
        ("compare NAME NAME2 --stop 100 --html {0}/c.html", None),
        ("size nadir_day/day-dipole --no-loop --no-year --html {0}/s.html", None),
        ("campaign NAME -n 2 --stop 100 --out {0}/campaign", "pyarrow"),
        ("run NAME --stop 100 --csv --out {0}/csv", "pyarrow"),
        ("export web NAME --stop 100 --out {0}/page.html", "ziglang"),
    ],
)
def test_a_command_without_its_package_says_which_extra_brings_it(
    tmp_path, line, package
):
    """Nothing is left behind; what needs no package of an extra works."""
    line = line.replace("NAME2", "uosat12/table3-ocdc-ilqr-2")
    line = line.replace("NAME", "uosat12/table3-ocdc-ilqr-1").format(tmp_path)
    script_run = python(WITHOUT, *shlex.split(line))
    if package is None:
        assert script_run.returncode == 0, script_run.stderr
        return
    assert script_run.returncode == 2
    extra = EXTRAS[package]
    assert script_run.stderr == (
        f"error: this needs the package {package}, which is not installed: "
        f"`pip install 'desat[{extra}]'`\n"
    )
    assert not [*tmp_path.iterdir()]
