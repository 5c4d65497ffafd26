"""Define a campaign: the system, its options, what is drawn, and how often."""

from __future__ import annotations

import json
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..files.draft import Draft
from ..files.identity import of_system, other, versions
from ..files.scenario import Scenario
from ..runs.cases import Cases
from ..runs.manifest import write_json
from ..runs.prepare import read as read_source
from ..runs.prepare import resolved
from ..system.digest import comparable
from ..system.errors import DesatError
from ..system.options import Options, as_arguments
from ..system.typed import JsonObject
from .sampling import FIXED, Drawn, Sampling, draw_of

PLAN = "campaign.json"
# Fields of a plan that may change when a campaign continues. The count may only grow,
# and not with a sampling whose points depend on it.
GROWS = ("count", "keep", "limit")


@dataclass(frozen=True)
class KeptSeries:
    """Selection of the cases that keep their series.

    These are the `count` worst cases by a number, or without a number every `count`-th.
    """

    count: int
    number: str = ""

    def __str__(self) -> str:
        """Return the text of `--keep`."""
        return (
            f"worst:{self.count}:{self.number}"
            if self.number
            else f"every:{self.count}"
        )

    @classmethod
    def parsed(cls, text: str) -> KeptSeries:
        """Parse `worst:N:NUMBER` or `every:N`; raise DesatError for another form."""
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
    """Plan of a campaign; two with the same plan have the same rows."""

    target: str  # a scenario's name, or a file
    digest: str  # of the system before anything is drawn (`digest_of`)
    count: int
    seed: int = 1
    sampling: Sampling = "random"
    options: Options = field(default_factory=Options)  # options of its runs
    # plots of the scenario for which each case keeps an envelope
    curves: tuple[str, ...] = ()
    keep: tuple[KeptSeries, ...] = ()
    limit: float = 600.0  # s, wall time that a case may take

    def values(self, number: int) -> dict[str, Drawn]:
        """Draw the values of a case: `component.parameter` -> value."""
        return draw_of(system(self), self.seed, number, self.sampling, self.count)

    def sample_values(self, number: int) -> dict[str, Drawn]:
        """Draw the values of a case that stands for all, which may lie beyond `count`.

        A sampling that is made for a count of cases has no others.
        """
        return self.values(number % self.count if self.sampling in FIXED else number)

    def to_json(self) -> JsonObject:
        """Return the plan as its file has it, without default options."""
        usual = vars(Options())
        options = {k: v for k, v in vars(self.options).items() if v != usual[k]}
        return {
            **vars(self),
            "options": options,
            "curves": list(self.curves),
            "keep": list(map(str, self.keep)),
        }

    def write(self, folder: Path) -> None:
        """Write the plan to its folder, with the versions."""
        write_json(folder / PLAN, {**self.to_json(), "versions": versions()})


def read(folder: Path) -> CampaignPlan:
    """Read the plan of a campaign's folder.

    Raises
    ------
    DesatError
        If it has none, or a damaged one.
    """
    file = folder / PLAN
    if not file.exists():
        raise DesatError(f"{folder}: no campaign (it has no {PLAN})")
    try:
        data = json.loads(file.read_text(encoding="utf-8"))
        field_names = {f.name for f in fields(CampaignPlan)}
        entries: JsonObject = {k: v for k, v in data.items() if k in field_names}
        entries["curves"] = tuple(entries.get("curves", ()))
        entries["keep"] = tuple(map(KeptSeries.parsed, entries.get("keep", ())))
        entries["options"] = Options(**entries.get("options", {}))
        plan = CampaignPlan(**entries)
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
    """Return a message if the system is not that of the campaign any more, else "".

    There is one, too, where that cannot be compared. Raises DesatError where the system
    cannot be built.
    """
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
    """Return the hint with the command that begins the campaign again."""
    sampling = "" if plan.sampling == "random" else f" --sampling {plan.sampling}"
    return (
        f"`desat campaign {shlex.quote(plan.target)} -n {plan.count} --seed {plan.seed}"
        f"{sampling}{as_arguments(plan.options)} --out ANOTHER` begins anew"
    )


def versions_here() -> str:
    """Return the versions with which cases are made here, as their rows have them."""
    return json.dumps(versions(), sort_keys=True)


def kept_versions(folder: Path) -> dict[str, str]:
    """Read the versions with which a campaign was last continued."""
    versions: dict[str, str] = json.loads(
        (folder / PLAN).read_text(encoding="utf-8")
    ).get("versions")
    return versions or {}


def same_versions(
    folder: Path, before: Mapping[str, str], accepted: bool, subject: str
) -> None:
    """Raise DesatError if versions have changed and no others are accepted.

    These are versions of the packages that compute; `subject` names what would be mixed.
    """
    if not accepted and (text := other(before, versions())):
        raise DesatError(
            f"{folder}: {text}: {subject} may differ in their bits; "
            "--accept-versions continues, and each case records its own"
        )


def joined(old: CampaignPlan, new: CampaignPlan, folder: Path) -> None:
    """Raise DesatError if a folder's campaign is not the one to continue in it."""
    if not comparable(old.digest):
        raise DesatError(f"{folder}: it cannot go on: {changed(old)}; {anew(new)}")
    expected, stored = (json.loads(json.dumps(plan.to_json())) for plan in (new, old))
    for key, before in stored.items():
        now = expected[key]
        grows = key == "count" and now >= before and old.sampling not in FIXED
        if before == now or grows or key in GROWS[1:]:
            continue
        if key == "digest" and stored["options"] != expected["options"]:
            continue  # the options are the reason, and are reported themselves
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
    """Format a value as JSON of at most 80 characters."""
    text = json.dumps(value)
    return text if len(text) < 80 else f"{text[:77]}..."


def cases_of(plan: CampaignPlan) -> Cases:
    """Read the system of a campaign's cases, once a process.

    Raises DesatError where there is none.
    """
    return _cases(plan.target, plan.digest)


@lru_cache(maxsize=2)
def _cases(target: str, digest: str) -> Cases:
    """Read a target; the digest only distinguishes what is cached."""
    return Cases(read_source(target))


def system(plan: CampaignPlan) -> Draft:
    """Return a campaign's system to draw for, with its plots.

    Raises DesatError where it cannot be built.
    """
    return cases_of(plan).draft(plan.options.blocks)


def digest_of(target: str | Scenario, options: Options) -> str:
    """Compute the digest of a system before anything is drawn.

    It covers everything that a row depends on except seed, number and sampling. Raises
    DesatError where the system cannot be built.
    """
    system, design = resolved(target, options)
    return of_system(system, options, design)
