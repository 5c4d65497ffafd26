"""Packed scenarios in ssp/dist/: written when missing or when anything they are made of changed."""

from __future__ import annotations

from pathlib import Path

from ..system.check import check
from . import places, ssp
from .scenario import ROOT, Scenario


def pack_scenario(scenario: Scenario, target: Path | None = None, force: bool = False) -> Path:
    """Check a scenario, write its .ssp unless it is up to date, and return its path.

    Raises DesatError with every problem of the scenario.
    """
    path = target or scenario.packed
    inputs = [
        *(ROOT / scenario.family).rglob("*.toml"), *(ROOT / scenario.family).rglob("*.ssd"),
        *places.fmus().glob("*.fmu"), *Path(__file__).parent.glob("*.py"),
    ]  # fmt: skip
    newest = max(p.stat().st_mtime_ns for p in inputs)
    if not force and path.exists() and path.stat().st_mtime_ns > newest:
        return path
    system, problems = scenario.system()
    check(system, problems).or_raise()
    ssp.pack(system, path)
    return path
