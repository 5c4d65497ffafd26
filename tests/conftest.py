"""What several tests need. The FMUs are built by `make fmus`, which `make test` runs first."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from desat.files import places
from desat.files.scenario import scenarios
from desat.fmus import registry

settings.register_profile("desat", deadline=None, max_examples=60, derandomize=True)
settings.load_profile("desat")

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="session", autouse=True)
def _fmus_are_built() -> None:
    missing = [n for n in registry.names() if not (places.fmus() / f"{n}.fmu").exists()]
    assert not missing, f"run `make fmus` first: {missing}"


@pytest.fixture
def desat():
    """Run the command `desat` in a process of its own, in the repository's folder."""

    def run(*arguments: str, check: bool = False, **options: object):
        return subprocess.run(
            [sys.executable, "-m", "desat.cli", *arguments],
            capture_output=True, text=True, cwd=options.pop("cwd", ROOT), check=check, timeout=300,
            **options,
        )  # fmt: skip

    return run


def one_of_each_craft() -> list[str]:
    """The first scenario of each craft and choice of FMUs."""
    found: dict[str, str] = {}
    for name, scenario in scenarios().items():
        kind = [scenario.family, *(scenario.data.get(k) for k in ("craft", "ssd", "sources"))]
        found.setdefault(repr(kind), name)
    return list(found.values())


def python(code: str, *arguments: str, timeout: float = 300) -> subprocess.CompletedProcess[str]:
    """Run Python code in a process of its own."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True, text=True, cwd=ROOT, timeout=timeout, check=False,
    )  # fmt: skip
