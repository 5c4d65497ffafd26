"""Coordinate a campaign: hand out cases, keep their rows, and continue later."""

from __future__ import annotations

import math
import os
import platform
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ..analyses import analyses
from ..files.io import LOCK, claimed
from ..files.scenario import Scenario
from ..language.content import Content, content_of, dispersions_of
from ..runs.case import Case
from ..runs.cases import draft_to_draw
from ..runs.manifest import write_json
from ..runs.prepare import prepare, with_stop
from ..runs.prepare import read as read_source
from ..runs.progress import progress as shown
from ..system.errors import DesatError, Exit, RunError, nearest
from ..system.model import System
from ..system.options import Options
from ..system.typed import JsonObject
from . import store
from .case import batch, repeat
from .draws import lost_row, never, whole_numbers
from .plan import (
    PLAN,
    CampaignPlan,
    KeptSeries,
    digest_of,
    joined,
    kept_versions,
    read,
    same_versions,
    versions_here,
)
from .sampling import SAMPLINGS, Sampling, allowed, draw_of
from .workers import Local, NoResult, Workers, guarded, results

_EACH = 2.0  # s, from one status to the next


def planned(
    target: str,
    count: int,
    *,
    seed: int = 1,
    sampling: Sampling = "random",
    options: Options | None = None,
    curves: Sequence[str] | None = None,
    keep: Sequence[str] = (),
    limit: float = 600.0,
) -> tuple[CampaignPlan, list[str]]:
    """Return the checked plan of a campaign, and warnings.

    With `curves` None it has the envelope of the first plot, if there is one.

    Raises
    ------
    DesatError
        If the system, its dispersions, a requirement, the sampling or the series to
        keep are wrong.
    """
    _check_request(target, count, seed, sampling, limit)
    options = options or Options()
    if Path(target).exists():
        target = str(Path(target).resolve())
    source = read_source(target)
    system = draft_to_draw(source, options.blocks)
    options = with_stop(source, options)
    if not (content := content_of(system.about)).dispersions:
        raise DesatError(
            f"{target}: it has no [dispersions], so there is nothing to sample"
        )
    for name in dispersions_of(system):
        if "[" in name:
            raise DesatError(
                f"{target}: dispersions: {name}: one element cannot be sampled alone; sample all of "
                f"{name.partition('[')[0]}"
            )
    if lines := never(system, options):
        raise DesatError("\n".join(lines))
    try:
        allowed(sampling, count, system)
        first = {**options.values, **draw_of(system, seed, 0, sampling, count)}
    except DesatError:
        prepare(source, options).or_raise()  # its error names file and key
        raise
    case = _first(source, options, first)
    selected = _curves_of(content, curves)
    plan = CampaignPlan(
        target,
        digest_of(source, options),
        count,
        seed,
        sampling,
        options,
        selected,
        tuple(map(KeptSeries.parsed, keep)),
        limit,
    )
    checked, _ = case.or_raise()
    _check_kept_series(plan, content, checked)
    warnings = [
        *case.warnings,
        *_unmissable(content, checked.steps * checked.step),
    ]
    if sampling == "sobol" and count & (count - 1):
        warnings.append(
            f"--sampling sobol: -n {count} is no power of two, as {_power(count)} is: "
            "its points are not quite even"
        )
    return plan, warnings


def _check_request(
    target: str, count: int, seed: int, sampling: str, limit: float
) -> None:
    """Raise DesatError for a sampling, a count, a seed or a time limit (s) in error."""
    if sampling not in SAMPLINGS:
        raise DesatError(
            f"--sampling {sampling}: there are {', '.join(SAMPLINGS)}"
            f"{nearest(sampling, SAMPLINGS)}"
        )
    if limit <= 0.0:
        raise DesatError(
            f"{target}: a limit of {limit:g} s for a case: above 0 is needed"
        )
    whole_numbers(target, seed=(seed, 0), count=(count, 1))


def _curves_of(content: Content, curves: Sequence[str] | None) -> tuple[str, ...]:
    """Return the plots whose envelopes a campaign draws; by default the first one."""
    plots = content.plots
    if curves is None:
        return tuple(plots)[:1]
    if unknown := [c for c in curves if c not in plots]:
        raise DesatError(
            f"--curve {unknown[0]}: no plot of that name{nearest(unknown[0], plots)}"
        )
    return tuple(curves)


def _check_kept_series(plan: CampaignPlan, content: Content, system: System) -> None:
    """Raise DesatError where series are to be kept by a number that does not exist."""
    numbers = {n for n, e in content.numbers.items() if not e.of}
    numbers |= {n for a in analyses() if a.applies(system) for n in a.NUMBERS}
    for rule in plan.keep:
        if rule.number and rule.number not in numbers:
            raise DesatError(
                f"--keep {rule}: no number {rule.number}{nearest(rule.number, numbers)}; "
                "worst:N:NUMBER, or --by NUMBER, is needed"
            )


def _unmissable(content: Content, duration: float) -> list[str]:
    """Return a line for each time limit that no run of this length (s) can exceed."""
    return [
        f"requirements.{name}: max = {entry.max:g} s is not before the end of a run, "
        f"{duration:g} s: no case can be above"
        for name, entry in content.requirements.items()
        if entry.max is not None
        and entry.max >= duration
        and entry.number in content.numbers
        and content.numbers[entry.number].unit == "s"
    ]


def _power(count: int) -> int:
    """Return the smallest power of two that is not below `count`."""
    return 1 << (count - 1).bit_length()


def _first(source: Scenario, options: Options, values: Mapping[str, Any]) -> Case:
    """Prepare the first case; raise DesatError where it is wrong."""
    case = prepare(source, replace(options, values=values))
    try:
        case.or_raise()
        return case
    except DesatError as error:
        prepare(
            source, options
        ).or_raise()  # an error independent of the drawn values comes first
        raise DesatError(f"{source.target}: case 0: {error}") from error


def run(
    plan: CampaignPlan,
    folder: Path,
    jobs: int = 1,
    cluster: str | None = None,
    progress: bool = True,
    accept_versions: bool = False,
) -> None:
    """Run the missing cases of a campaign, and keep the series that the plan selects.

    Whatever is done when it is stopped is not repeated when it continues. It may
    continue with other versions of the packages that compute, if these are accepted.

    Raises
    ------
    DesatError
        If the folder has another campaign or one of other versions, or if another
        coordinator is at work in it.
    """
    guarded()  # a worker cannot claim the folder of its coordinator
    with claimed(folder):
        _run(plan, folder, jobs, cluster, progress, accept_versions)


def _run(
    plan: CampaignPlan,
    folder: Path,
    jobs: int,
    cluster: str | None,
    progress: bool,
    accept_versions: bool,
) -> None:
    """Run a campaign in a folder that is claimed."""
    longer = False
    if (folder / PLAN).exists():
        joined(old := read(folder), plan, folder)
        same_versions(
            folder, kept_versions(folder), accept_versions, "old and new cases"
        )
        longer = plan.limit > old.limit
    elif any(p.name != LOCK for p in folder.iterdir()):
        raise DesatError(
            f"{folder}: it has other files, and no campaign; take another --out"
        )
    plan.write(folder)
    rows = store.Store(folder, plan.count)
    if longer:
        rows.forget(Exit.TIMEOUT)  # the new limit may suffice
    at = Progressed(plan.count, rows.done(), rows.failed())
    at.first = at.done
    write_json(folder / STATUS, at.as_json("running"))
    state = "stopped"
    try:
        if at.done < plan.count:
            with _workers(plan, jobs, cluster) as workers:
                _make(plan, workers, rows, at, folder, progress)
        _keep(plan, folder, jobs)
        state = "done"
    finally:
        write_json(folder / STATUS, at.as_json(state))


def _workers(plan: CampaignPlan, jobs: int, cluster: str | None) -> Workers:
    """Return the pool that runs the cases, local or on a cluster."""
    if cluster is None:
        return Local(
            batch, jobs, 1.25 * plan.limit + 2.0
        )  # a supervised case ends itself earlier
    from .cluster import Cluster

    return Cluster(cluster, plan)


def _make(
    plan: CampaignPlan,
    workers: Workers,
    rows: store.Store,
    at: Progressed,
    folder: Path,
    progress: bool,
) -> None:
    """Run the missing cases, add their rows, and write the status now and then."""
    local, versions = isinstance(workers, Local), versions_here()
    attempts: dict[int, int] = {}
    sizes = _Sizes(plan, workers.size)

    def task(numbers: Sequence[int], attempt: int = 1) -> tuple[Any, tuple[Any, ...]]:
        """Return key and arguments of a call that runs these cases."""
        key = tuple(numbers)
        return key, (plan, key, attempt, versions) if local else (
            key,
            attempt,
            versions,
        )

    def again(
        numbers: Sequence[int], reason: NoResult
    ) -> list[tuple[Any, tuple[Any, ...]]]:
        """Return the calls that replace a lost one: its cases singly, then retries."""
        if len(numbers) > 1:  # it is not known which of them was lost
            return [task([number]) for number in numbers]
        attempts[numbers[0]] = attempt = attempts.get(numbers[0], 1) + 1
        return [task(numbers, attempt)] if attempt <= _TRIES else []

    write_time = time.monotonic()
    with shown("cases", at.count, progress, at.done) as tell:
        tasks = map(task, _together(list(rows.missing()), sizes))
        for numbers, result in results(workers, tasks, again):
            if isinstance(result, NoResult):
                lost_row = _without_row(plan, numbers[0], result)
                result = store.Batch.of([replace(lost_row, versions=versions)])
            rows_stored = rows.add(result)
            sizes.learn(rows_stored)
            at.done += len(rows_stored)
            at.failed += sum(not row.completed for row in rows_stored)
            tell(at.done, f"{at.failed} failed, {at.rate:.1f} a second")
            if time.monotonic() - write_time > _EACH:
                write_time = time.monotonic()
                write_json(folder / STATUS, at.as_json("running"))


class _Sizes:
    """Number of cases that are handed out together.

    They take at most `TOGETHER` s, or a quarter of the limit of one case where that is
    shorter, so that the coordinator has little to do for each. Towards the end the
    number falls, so that each worker has some.
    """

    def __init__(self, plan: CampaignPlan, workers: int) -> None:
        self._workers = workers
        self._longest = min(TOGETHER, 0.25 * plan.limit)
        self._seconds, self._cases, self._recent = 0.0, 0, math.inf

    def learn(self, rows: Sequence[store.CaseRow]) -> None:
        """Update the time per case from cases that are over."""
        seconds = sum(row.seconds or 0.0 for row in rows)
        self._seconds, self._cases = self._seconds + seconds, self._cases + len(rows)
        self._recent = max(seconds / len(rows), self._seconds / self._cases)

    def next(self, remaining: int) -> int:
        """Choose the number of cases to hand out next, with `remaining` cases to do."""
        most = self._longest / max(self._recent, 1e-6)
        return max(
            1, min(store.BLOCK, int(most), remaining // (_SHARES * self._workers))
        )


def _together(missing: Sequence[int], sizes: _Sizes) -> Iterator[Sequence[int]]:
    """Yield cases to hand out together, none from two blocks."""
    first = 0
    while first < len(missing):
        last = first + sizes.next(len(missing) - first)
        block = missing[first] // store.BLOCK
        yield (some := [n for n in missing[first:last] if n // store.BLOCK == block])
        first += len(some)


def _without_row(plan: CampaignPlan, number: int, reason: NoResult) -> store.CaseRow:
    """Build the row of a case that never returned one."""
    row = store.CaseRow(**vars(lost_row(reason)))
    return replace(row, number=number, values=plan.values(number), attempts=_TRIES)


TOGETHER = 2.0  # s, that cases which are handed out together may take
# each worker gets at most one part in _SHARES of its share of the remaining cases at
# once
_SHARES = 4
# Attempts of a case whose process dies. Repeated attempts are supervised, which names
# the cause; after the last one the case has no row of its own.
_TRIES = 3


def cases_to_keep(plan: CampaignPlan, folder: Path) -> list[int]:
    """Find the cases that are to be kept.

    The worst cases are those with the largest number, or with the smallest where a
    requirement on it has only a `min`. Those that never reach it come first.
    """
    from .plan import system

    content = content_of(system(plan).about)
    least = {r.number for r in content.requirements.values() if r.max is None}
    cases: set[int] = set()
    for keep in plan.keep:
        if keep.number:
            cases |= set(worst(folder, keep.number, keep.count, keep.number in least))
        else:
            cases |= set(range(0, plan.count, keep.count))
    return sorted(cases)


def unreached(plan: CampaignPlan, folder: Path) -> list[str]:
    """Return a line for each `--keep` whose number no case has, or none reaches."""
    lines = []
    for keep in plan.keep:
        if not (number := keep.number):
            continue
        table = store.read(folder, columns=["case", f"out.{number}"])
        if f"out.{number}" not in table.column_names:
            lines.append(
                f"--keep {keep}: no case has a number {number}: nothing is kept by it"
            )
        elif table[f"out.{number}"].null_count == table.num_rows:
            lines.append(
                f"--keep {keep}: no case reaches {number}: kept are the first "
                f"{keep.count}"
            )
    return lines


def worst(folder: Path, number: str, count: int, least: bool = False) -> list[int]:
    """Return the worst completed cases by a number, worst first.

    Those that never reach it come before those with its largest (or smallest) values.
    """
    table = store.read(folder, columns=["case", "status", f"out.{number}"])
    if f"out.{number}" not in table.column_names:
        return []
    sign = 1.0 if least else -1.0
    rows = [
        (-math.inf if value is None else sign * value, case)
        for case, status, value in zip(
            table["case"].to_pylist(),
            table["status"].to_pylist(),
            table[f"out.{number}"].to_pylist(),
            strict=True,
        )
        if status == "completed"
    ]
    rows.sort()
    return [case for _, case in rows[:count]]


def _keep(plan: CampaignPlan, folder: Path, jobs: int) -> None:
    """Run the cases to be kept again for their series, which gives the same bits."""
    todo = [n for n in cases_to_keep(plan, folder) if not _is_kept(kept_in(folder, n))]
    if not todo:
        return
    tasks: Iterator[tuple[Any, tuple[Any, ...]]] = (
        (n, (plan, n, kept_in(folder, n))) for n in todo
    )
    with Local(_keep_series, min(jobs, len(todo)), 1.25 * plan.limit) as workers:
        for number, result in results(workers, tasks, lambda key, reason: ()):
            if isinstance(result, NoResult):
                raise RunError(
                    f"{kept_in(folder, number)}: not kept: {result.text}",
                    Exit.COMPONENT,
                )


def _is_kept(folder: Path) -> bool:
    """Return whether a case ran there to its own end.

    It did not if the disk was full, or its coordinator ended.
    """
    try:
        status = str(store.table(folder / "manifest.json").get("status"))
    except (FileNotFoundError, DesatError):
        return False
    return status not in ("no space", "interrupted") and not status.startswith("killed")


def _keep_series(plan: CampaignPlan, number: int, into: Path) -> None:
    """Run a case again and keep its series.

    A case that cannot begin has no series, and its row says why.
    """
    try:
        repeat(plan, number, into).results.close()
    except DesatError as error:
        if getattr(error, "code", 0) == Exit.SPACE:
            raise
        # otherwise the case cannot begin and has no series; its row says why


def kept_in(folder: Path, number: int) -> Path:
    """Return the run folder of a case that is kept."""
    return folder / "kept" / f"{number:06}"


# --- Progress of a campaign -----------------------------------------------------------


STATUS = "status.json"


@dataclass
class Progressed:
    """Progress of a campaign."""

    count: int
    done: int
    failed: int
    began: float = field(default_factory=time.monotonic)
    first: int = 0

    @property
    def rate(self) -> float:
        """Return the cases per second since this coordinator began."""
        return (self.done - self.first) / max(time.monotonic() - self.began, 1e-9)

    def as_json(self, state: str) -> JsonObject:
        """Return the content of `status.json`."""
        remaining = (self.count - self.done) / self.rate if self.rate else None
        return {
            "state": state,
            "count": self.count,
            "done": self.done,
            "failed": self.failed,
            "cases_per_second": round(self.rate, 3),
            "seconds_left": None if remaining is None else round(remaining),
            "head": f"{platform.node()}:{os.getpid()}",
            "written": time.time(),
        }


def status(folder: Path) -> JsonObject:
    """Read the progress of a campaign, as its coordinator wrote it last.

    Raises
    ------
    DesatError
        If there is no campaign.
    """
    plan = read(folder)
    blank = {"state": "running", "count": plan.count, "done": 0, "failed": 0}
    try:
        state = {**blank, **store.table(folder / STATUS)}
    except FileNotFoundError:
        state = blank
    head, _, pid = str(state.get("head", "")).rpartition(":")
    if (
        state["state"] == "running"
        and head == platform.node()
        and not (pid.isdecimal() and _lives(int(pid)))
    ):
        state["state"] = "killed"
    return state


def _lives(pid: int) -> bool:
    """Return whether a process exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        pass
    return True
