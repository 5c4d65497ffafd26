"""What a campaign is: the system, how it is changed, what is drawn, and how often."""

from __future__ import annotations

import hashlib
import json
import platform
from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..files import library
from ..study import manifest
from ..study.draws import system_of
from ..study.manifest import write_json
from ..study.modify import modify
from ..study.options import Options
from ..study.prepare import load
from ..study.sampling import FIXED, Sampling, drawn
from ..system.draft import Draft
from ..system.errors import DesatError

PLAN = "campaign.json"
GROWS = ("count", "keep", "limit")
"""What of a plan may be other when a campaign goes on; `count` only upward, and not with a sampling
whose points depend on it."""


@dataclass(frozen=True)
class Plan:
    """A campaign. Two with the same plan have the same rows."""

    target: str
    """A scenario's name, or a file."""
    digest: str
    """sha256 of the system as it is before anything is drawn (`digest_of`)."""
    count: int
    seed: int = 1
    sampling: Sampling = "random"
    options: dict[str, Any] = field(default_factory=dict)
    """Those fields of `Options` that are not as by default."""
    curves: tuple[str, ...] = ()
    """Plots of the scenario of which each case keeps an envelope."""
    keep: tuple[str, ...] = ()
    """Which cases keep their series: `worst:N:NUMBER`, `every:N`."""
    limit: float = 600.0
    """Wall time (s) that a case may take."""

    def run_options(self) -> Options:
        """What its runs are made with."""
        given: dict[str, Any] = self.options
        return Options(**given)

    def values(self, number: int) -> dict[str, Any]:
        """`component.parameter` -> value of a case."""
        drafted = system(self.target, self.run_options().blocks)
        return drawn(drafted, self.seed, number, self.sampling, self.count)

    def write(self, folder: Path) -> None:
        """Keep it in its folder."""
        write_json(folder / PLAN, {**asdict(self), "versions": versions()})


def read(folder: Path) -> Plan:
    """The plan of a campaign's folder. Raises DesatError where it has none, or a damaged one."""
    file = folder / PLAN
    if not file.exists():
        raise DesatError(f"{folder}: no campaign (it has no {PLAN})")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        known = {f.name for f in fields(Plan)}
        given: dict[str, Any] = {k: v for k, v in data.items() if k in known}
        given |= {k: tuple(given.get(k, ())) for k in ("curves", "keep")}
        plan = Plan(**given)
        plan.run_options()
    except (ValueError, TypeError, AttributeError, DesatError) as error:
        raise DesatError(f"{file}: damaged ({error})") from error
    for name, kind in _KINDS.items():
        if not isinstance(value := getattr(plan, name), kind) or isinstance(value, bool):
            raise DesatError(f"{file}: damaged ({name} is {value!r})")
    return plan


_KINDS: dict[str, Any] = {"target": str, "digest": str, "count": int, "seed": int,
                          "sampling": str, "limit": (int, float)}  # fmt: skip


def changed(plan: Plan) -> str:
    """What is to be said where the system is not any more that of the campaign; "" where it is.
    Raises DesatError where it cannot be had."""
    if digest_of(plan.target, plan.run_options()) == plan.digest:
        return ""
    return f"{plan.target} is not what it was when the campaign began: scenario, parameters or FMUs"


def joined(old: Plan, new: Plan, folder: Path) -> None:
    """Raises DesatError where a folder's campaign is not the one that is to go on in it."""
    wanted = json.loads(json.dumps(asdict(new)))  # tuples as the file has them
    for key, before in json.loads(json.dumps(asdict(old))).items():
        now = wanted[key]
        grows = key == "count" and now >= before and old.sampling not in FIXED
        if before == now or grows or key in GROWS[1:]:
            continue
        fixed = f", of which the points of {old.sampling} depend" if key == "count" and (
            old.sampling in FIXED) else ""  # fmt: skip
        raise DesatError(f"{folder}: another campaign: {key} is {_short(before)} there, "
                         f"{_short(now)} here{fixed}; take another --out")  # fmt: skip


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) < 80 else f"{text[:77]}..."


@lru_cache(maxsize=2)
def system(target: str, blocks: bool) -> Draft:
    """A system to draw for, and its plots."""
    return system_of(target, Options(blocks=blocks))


def versions() -> dict[str, str]:
    """What a row depends on beside its plan."""
    return {**manifest.versions(), "python": platform.python_version()}


def digest_of(target: str, options: Options) -> str:
    """sha256 of a system: scenario, parameters, FMUs, times. Raises DesatError where it cannot be
    had."""
    drafted = load(target, options.blocks)
    modify(drafted, options)
    described = {
        "about": drafted.about, "start": drafted.start, "stop": drafted.stop,
        "step": drafted.step, "inner": drafted.inner, "accuracy": drafted.accuracy,
        "components": {
            c.name: [c.parameters, c.references, c.decimation,
                     library.load(c.fmu).sha256 if c.fmu else c.source]
            for c in drafted.components.values()
        },
    }  # fmt: skip
    text = json.dumps(described, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
