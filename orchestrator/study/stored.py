"""Draws that take long: computed once by `make papers`, kept under docs/papers, read by `tables`.

docs/papers/FAMILY/draws.json: date, seed, versions, and of each scenario with `draws` its rows
and, of every number, median, least and largest
"""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..files import places
from ..files.scenario import Scenario, scenarios
from ..system.codes import Exit
from ..system.errors import DesatError, RunError
from .case import PACKAGES, Options, write_json
from .draws import draws

SEED = 1
_TEXTS = ("title", "story", "source", "twin", "plots", "paper", "labels")
"""What of a scenario changes no number."""


def file_of(family: str) -> Path:
    """Where the draws of a family are stored."""
    return places.DRAWS / family / "draws.json"


def with_draws(family: str) -> dict[str, Scenario]:
    """The scenarios of a family that say `draws`."""
    return {n: s for n, s in scenarios(family).items() if s.data.get("draws")}


def digest(scenario: Scenario) -> str:
    """A hash of all of a scenario that its numbers depend on."""
    data = {k: v for k, v in scenario.data.items() if k not in _TEXTS}
    return hashlib.sha256(json.dumps(data, sort_keys=True, default=str).encode()).hexdigest()


def compute(
    family: str,
    jobs: int,
    progress: bool = False,
    known: dict[str, Any] | None = None,
    names: Iterable[str] | None = None,
) -> dict[str, Any]:
    """Run the draws of a family (or of the scenarios named) on bare blocks, which give the same
    bits as the FMUs. Raises DesatError where a draw fails.

    What `known` (an older result) has for the other scenarios is kept.
    """
    kept = dict((known or {}).get("scenarios", {}))
    found = {}
    for name, scenario in with_draws(family).items():
        if names is not None and name not in names:
            if name in kept:
                found[name] = kept[name]
            continue
        result = draws(name, scenario.data["draws"], SEED, Options(blocks=True), jobs, progress)
        if failed := [r for r in result["draws"] if r["status"] != "completed"]:
            worst = failed[0]
            text = f"{name}: draw {worst['draw']}: {worst['message']}"
            raise RunError(text, Exit(worst["code"]))
        found[name] = {
            "sha256": digest(scenario),
            "date": f"{datetime.now(UTC):%Y-%m-%d}",
            "summary": result["summary"],
            "draws": [{"draw": r["draw"], "numbers": r["numbers"]} for r in result["draws"]],
        }
    return {
        "family": family,
        "date": f"{datetime.now(UTC):%Y-%m-%d}",
        "seed": SEED,
        "components_as": "bare blocks",
        "versions": {**{p: version(p) for p in PACKAGES}, "python": platform.python_version()},
        "scenarios": found,
    }


def write(result: dict[str, Any]) -> Path:
    """Store the draws of a family."""
    path = file_of(result["family"])
    write_json(path, result)
    return path


def read(family: str) -> dict[str, Any]:
    """The stored draws of a family. Raises DesatError where there are none."""
    path = file_of(family)
    try:
        result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise DesatError(
            f"{places.shown(path)}: no such file; `desat tables {family} --fresh` "
            "computes the draws now"
        ) from error
    return result


def outdated(stored: dict[str, Any]) -> list[str]:
    """The scenarios whose stored draws are missing or of another version of the scenario."""
    return [
        name for name, scenario in with_draws(stored["family"]).items()
        if stored["scenarios"].get(name, {}).get("sha256") != digest(scenario)
    ]  # fmt: skip


def provenance(stored: dict[str, Any], fresh: bool) -> dict[str, Any]:
    """Which run the numbers of the draws are from."""
    keys = ("date", "seed", "components_as", "versions")
    file = "" if fresh else places.shown(file_of(stored["family"]))
    return {"file": file or "computed now", **{k: stored[k] for k in keys}}
