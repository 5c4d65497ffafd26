"""What a campaign is: the system, how it is changed, what is drawn, and how often."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..files.builder import Builder
from ..files.identity import of_system, other, versions
from ..runs.manifest import write_json
from ..runs.prepare import Target, resolved
from ..runs.prepare import read as read_source
from ..system.digest import comparable
from ..system.errors import DesatError
from ..system.options import Options, as_arguments
from ..system.typed import JsonObject
from .sampling import FIXED, Drawn, Sampling, draw_of

PLAN = "campaign.json"
GROWS = ("count", "keep", "limit")
"""What of a plan may be other when a campaign goes on; `count` only upward, and not
with a sampling whose points depend on it."""


@dataclass(frozen=True)
class KeptSeries:
    """Which cases keep their series: so many, the worst by a number, or without one
    every such."""

    count: int
    number: str = ""

    def __str__(self) -> str:
        """As `--keep` has it."""
        return (
            f"worst:{self.count}:{self.number}"
            if self.number
            else f"every:{self.count}"
        )

    @classmethod
    def parsed(cls, text: str) -> KeptSeries:
        """From `worst:N:NUMBER` or `every:N`. Raises DesatError for another form."""
        kind, _, rest = text.partition(":")
        count, _, number = rest.partition(":")
        if kind not in ("worst", "every") or not count.isdecimal() or int(count) < 1:
            raise DesatError(
                f"--keep {text}: worst:N:NUMBER or every:N is needed, N from 1 on"
            )
        if kind == "worst" and not number:
            raise DesatError(
                f"--keep {text}: no number; worst:N:NUMBER, or --by NUMBER, is needed"
            )
        return cls(int(count), number if kind == "worst" else "")


@dataclass(frozen=True)
class CampaignPlan:
    """A campaign. Two with the same plan have the same rows."""

    target: str
    """A scenario's name, or a file."""
    digest: str
    """Of the system as it is before anything is drawn (`digest_of`)."""
    count: int
    seed: int = 1
    sampling: Sampling = "random"
    options: Options = field(default_factory=Options)
    """What its runs are made with."""
    curves: tuple[str, ...] = ()
    """Plots of the scenario of which each case keeps an envelope."""
    keep: tuple[KeptSeries, ...] = ()
    limit: float = 600.0
    """Wall time (s) that a case may take."""

    def values(self, number: int) -> dict[str, Drawn]:
        """`component.parameter` -> value of a case."""
        return draw_of(system(self), self.seed, number, self.sampling, self.count)

    def to_json(self) -> JsonObject:
        """As its file has it: of the options those that are not as by default."""
        usual = vars(Options())
        told = {k: v for k, v in vars(self.options).items() if v != usual[k]}
        return {
            **vars(self),
            "options": told,
            "curves": list(self.curves),
            "keep": list(map(str, self.keep)),
        }

    def write(self, folder: Path) -> None:
        """Keep it in its folder."""
        write_json(folder / PLAN, {**self.to_json(), "versions": versions()})


def read(folder: Path) -> CampaignPlan:
    """The plan of a campaign's folder. Raises DesatError where it has none, or a
    damaged one."""
    file = folder / PLAN
    if not file.exists():
        raise DesatError(f"{folder}: no campaign (it has no {PLAN})")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        known = {f.name for f in fields(CampaignPlan)}
        given: JsonObject = {k: v for k, v in data.items() if k in known}
        given["curves"] = tuple(given.get("curves", ()))
        given["keep"] = tuple(map(KeptSeries.parsed, given.get("keep", ())))
        given["options"] = Options(**given.get("options", {}))
        plan = CampaignPlan(**given)
    except (ValueError, TypeError, AttributeError, DesatError) as error:
        raise DesatError(f"{file}: damaged ({error})") from error
    for name, kind in _KINDS.items():
        if not isinstance(value := getattr(plan, name), kind) or isinstance(
            value, bool
        ):
            raise DesatError(f"{file}: damaged ({name} is {value!r})")
    return plan


_KINDS: dict[str, Any] = {
    "target": str,
    "digest": str,
    "count": int,
    "seed": int,
    "sampling": str,
    "limit": (int, float),
}


def changed(plan: CampaignPlan) -> str:
    """What is to be said where the system is not any more that of the campaign, or
    where that cannot be told; "" where it is. Raises DesatError where it cannot be
    had."""
    if not comparable(plan.digest):
        return (
            f"{plan.target}: the desat that the campaign began with kept no digest of it that "
            "this one can compare"
        )
    if digest_of(plan.target, plan.options) == plan.digest:
        return ""
    return (
        f"{plan.target} is not what it was when the campaign began: wiring, times, content, "
        "parameters or FMUs differ"
    )


def anew(plan: CampaignPlan) -> str:
    """What to say of the command that makes a campaign anew."""
    sampling = "" if plan.sampling == "random" else f" --sampling {plan.sampling}"
    return (
        f"`desat campaign {shlex.quote(plan.target)} -n {plan.count} --seed {plan.seed}"
        f"{sampling}{as_arguments(plan.options)} --out ANOTHER` begins anew"
    )


def versions_here() -> str:
    """With which versions cases are made here, as their rows have it."""
    return json.dumps(versions(), sort_keys=True)


def kept_versions(folder: Path) -> dict[str, str]:
    """With which versions a campaign was last gone on with."""
    told: dict[str, str] = json.loads((folder / PLAN).read_text(encoding="utf-8")).get(
        "versions"
    )
    return told or {}


def same_versions(
    folder: Path, before: Mapping[str, str], accepted: bool, what: str
) -> None:
    """Raises DesatError where what computes is of other versions than before, and none
    are accepted; `what`: what they would mix in."""
    if not accepted and (text := other(before, versions())):
        raise DesatError(
            f"{folder}: {text}: {what} may differ in their bits; "
            "--accept-versions continues, and each case records its own"
        )


def joined(old: CampaignPlan, new: CampaignPlan, folder: Path) -> None:
    """Raises DesatError where a folder's campaign is not the one that is to go on in
    it."""
    if not comparable(old.digest):
        raise DesatError(f"{folder}: it cannot go on: {changed(old)}; {anew(new)}")
    wanted, told = (json.loads(json.dumps(plan.to_json())) for plan in (new, old))
    for key, before in told.items():
        now = wanted[key]
        grows = key == "count" and now >= before and old.sampling not in FIXED
        if before == now or grows or key in GROWS[1:]:
            continue
        if key == "digest" and told["options"] != wanted["options"]:
            continue  # which is the reason, and said
        if key == "digest":
            raise DesatError(f"{folder}: another campaign: {changed(old)}; {anew(new)}")
        fixed = (
            f", of which the points of {old.sampling} depend"
            if key == "count" and (old.sampling in FIXED)
            else ""
        )
        raise DesatError(
            f"{folder}: another campaign: {key} is {_short(before)} there, "
            f"{_short(now)} here{fixed}; take another --out"
        )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) < 80 else f"{text[:77]}..."


def source(plan: CampaignPlan) -> Target:
    """What a campaign's system is read from, read once a process. Raises DesatError
    where there is none."""
    return _source(plan.target, plan.digest)


@lru_cache(maxsize=2)
def _source(target: str, digest: str) -> Target:
    return read_source(target)


def system(plan: CampaignPlan) -> Builder:
    """A campaign's system to draw for, and its plots. Raises DesatError where it cannot
    be had."""
    return source(plan).to_draw(plan.options.blocks)


def digest_of(target: str | Target, options: Options) -> str:
    """The digest of a system before anything is drawn: of all that a row depends on
    beside seed, number and sampling. Raises DesatError where it cannot be had."""
    system, design = resolved(target, options)
    return of_system(system, options, design)
