"""What of a scenario travels with a packed system: story, numbers, plots and the like, as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from ..system.errors import DesatError, nearest
from .io import contents

KEYS = ("title", "story", "source", "twin", "numbers", "plots", "output_classes", "labels",
        "dispersions", "requirements", "inner", "accuracy", "stop_when", "residual_bound",
        "impulse_bound", "energy_bound")  # fmt: skip
_OWN = ("name", "cell", "labels")
"""Keys beside those of the language."""


def of(data: dict[str, Any]) -> dict[str, Any]:
    """What travels of a scenario's data."""
    kept = {k: data[k] for k in KEYS if k in data}
    if "plots" in kept:
        # a list keeps its order in JSON
        kept["plots"] = [{"name": name, **plot} for name, plot in kept["plots"].items()]
    return kept


def data_of(about: dict[str, Any]) -> dict[str, Any]:
    """What travelled, as data of a scenario: its plots with names again."""
    data = {k: v for k, v in about.items() if k not in _OWN}
    if isinstance(plots := data.get("plots"), list):
        data["plots"] = {}
        for i, plot in enumerate(plots, 1):
            named = isinstance(plot, dict) and isinstance(plot.get("name"), str)
            name = plot["name"] if named else str(i)
            own = {k: v for k, v in plot.items() if k != "name"} if named else plot
            data["plots"][f"{name} ({i})" if name in data["plots"] else name] = own
    return data


def read(path: Path, where: str) -> dict[str, Any]:
    """What travelled in a file, which messages call `where`.

    Raises DesatError, a line a problem, for what is no JSON or not in the scenario language.
    """
    try:
        about: dict[str, Any] = json.loads(contents(path, where).decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise DesatError(f"{where}: not JSON in UTF-8 ({error})") from error
    if wrong := list(_problems(about)):
        raise DesatError("\n".join(f"{where}: {text}" for text in wrong))
    return about


def _problems(about: Any) -> list[str]:
    from .reader import problems  # pydantic, only where there is something to check

    if not isinstance(about, dict):
        return ["a table is needed"]
    known = (*_OWN, *KEYS)
    wrong = [f"{k}: unknown key{nearest(k, known)}" for k in about if k not in known]
    if not isinstance(about.get("name", ""), str):
        wrong.append(f"name: got {about['name']!r}; a text is needed")
    for key in ("cell", "labels"):
        table = about.get(key, {})
        if not isinstance(table, dict) or not all(isinstance(v, str) for v in table.values()):
            wrong.append(f"{key}: a table of texts is needed")
    if not isinstance(about.get("plots", []), list):
        wrong.append("plots: a list is needed")
    return wrong or [f"{'.'.join(p)}: {t}" for p, t in problems(data_of(about), part=False)]
