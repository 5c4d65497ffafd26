"""Run a system: initialise, step, record, and leave a run folder behind."""

from __future__ import annotations

import math
import shlex
import shutil
import time
from collections.abc import Callable
from contextlib import chdir
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import Any

from ..analyses import analyses, coverage, not_checked
from ..analyses.coverage import CHOICE, DECIMATED
from ..engine.checkpoint import FOLDER, Checkpoint, newest, remove
from ..engine.process_state import no_space
from ..engine.recording.results import MANIFEST, SERIES, Results
from ..engine.recording.row_buffer import Layout, Unwritten, recover
from ..files import library
from ..language.content import said
from ..system.errors import DesatError, Exit, RunError
from ..system.model import System
from ..system.options import Options, as_arguments, as_asked
from ..system.schedule import schedule
from . import inner_choice, stopping, supervisor
from .manifest import describe, end_manifest, gone_on, numbers, read_manifest
from .prepare import Case, prepare
from .step_case import Outcome, stepped

__all__ = ["Case", "Options", "Run", "execute", "load_run", "prepare", "run_or_load",
           "simulate"]  # fmt: skip


@dataclass
class Run:
    """A finished (or stopped) run: its manifest and its series."""

    manifest: dict[str, Any]
    results: Results

    @property
    def ok(self) -> bool:
        """True when it reached its stop time."""
        return bool(self.manifest["status"] == "completed")

    @property
    def code(self) -> Exit:
        """The exit code that says how it ended."""
        if self.ok:
            return Exit.UNMET if self.manifest.get("unmet") else Exit.COMPLETED
        if "exit" in self.manifest:
            return Exit(self.manifest["exit"])
        if self.manifest["status"] == stopping.LATE:
            return Exit.TIMEOUT
        return Exit.COMPONENT

    def or_raise(self, target: str) -> Run:
        """Itself where it completed. Raises RunError, which names the target, where not."""
        if self.ok:
            return self
        status, message = self.manifest["status"], self.manifest["message"]
        raise RunError(f"{target}: {status}: {message}", self.code)


def execute(
    target: str, options: Options, folder: Path | None = None, progress: bool = False
) -> Run:  # fmt: skip
    """Prepare and run a scenario, an .ssp or a folder. Raises DesatError where it cannot begin."""
    return simulate(prepare(target, options), folder, progress)


def simulate(
    case: Case, folder: Path | None = None, progress: bool = False,
    checkpoint: Checkpoint | None = None,
) -> Run:  # fmt: skip
    """Run a prepared case; `folder` None keeps the series in memory. With `checkpoint` it goes on
    from there, in the folder of the run that was ended (`resume`).

    A component that fails, a signal to stop and the time limits end the run early: what was
    recorded is kept, and the manifest's status says which. A run that its scenario's `stop_when`
    ends is completed, and the manifest's `stopped_when` says when. With `options.supervised` it
    runs in a process of its own, which a component may end (`supervise.py`).
    Raises DesatError where the run cannot begin, RunError where there is no room for it, and
    KeyboardInterrupt or SystemExit where a signal stops it before it has begun.
    """
    system, _ = case.or_raise()
    choice = inner_choice.chosen(case.target, system, case.options) if checkpoint is None else None
    if checkpoint is not None and (told := checkpoint.told["manifest"].get(CHOICE)):
        choice = inner_choice.Choice.of(told)
    for left in reversed(range(inner_choice.AGAIN)):
        run = _simulated(_with_inner(case, choice), choice, folder, progress, checkpoint)
        if choice is None or not run.ok:
            break
        more = inner_choice.looked_at_again(case.target, system, case.options, choice, run.results)
        if more is None:
            break
        if more.inner == choice.inner or not left:
            _tell(run, more, folder)
            break
        run.results.close()
        if folder is not None:
            remove(folder)
        choice, checkpoint = more, None
    return run


def _with_inner(case: Case, choice: inner_choice.Choice | None) -> Case:
    """A case with the inner steps that were chosen."""
    if choice is None or case.checked.system is None:
        return case
    system = replace(case.checked.system, inner=choice.inner)
    checked = replace(case.checked, system=system, schedule=schedule(system))
    return replace(case, checked=checked)


def _tell(run: Run, choice: inner_choice.Choice, folder: Path | None) -> None:
    """Put what a second look has given into a run's manifest."""
    run.manifest[CHOICE] = choice.told()
    run.manifest["numbers"].update(coverage.numbers(run.manifest, run.results))
    if choice.inner != run.manifest["inner"]:
        run.manifest["warnings"].append(
            f"made {inner_choice.AGAIN} times, it would want {choice.inner} inner steps still: "
            f"{choice.again[-1]}"
        )
    if folder is not None:
        end_manifest(folder, run.manifest)


def _simulated(
    case: Case, choice: inner_choice.Choice | None, folder: Path | None, progress: bool,
    checkpoint: Checkpoint | None,
) -> Run:  # fmt: skip
    """A run of a case whose inner steps are known."""
    system, _ = case.or_raise()
    options, clock = case.options, time.perf_counter()
    began = datetime.now(UTC)
    manifest = describe(system, options, case.target)
    if choice is not None:
        manifest[CHOICE] = choice.told()
    warned = list(case.checked.warnings)
    if choice is not None and choice.estimate is None:
        warned += coverage.warnings(system)
    if checkpoint is None and (slow := inner_choice.decimated(system, options)):
        manifest[DECIMATED] = slow
        warned.append(
            f"{slow['of']}: slower than the step (decimation): the attitude errs by about "
            f"{slow['attitude']:.1e} rad and a wheel's momentum by {slow['momentum']:.1e} N m s, "
            f"until {slow['until']:g} s"
        )
    manifest.update(started=began.isoformat(timespec="seconds"), steps=system.steps,
                    status="running", warnings=warned)  # fmt: skip
    if checkpoint is not None:
        again = f"desat run {shlex.quote(case.target)}{as_arguments(options)}"
        manifest = gone_on(manifest, checkpoint.told["manifest"], str(folder), again)
    if folder is not None:
        folder = folder.absolute()  # a component may change the working directory
    elif options.checkpoint is not None:
        raise DesatError("checkpoints need a run folder")
    if options.supervised and supervisor.CAN:
        outcome, results = _supervised(case, folder, manifest, progress, checkpoint)
    else:
        outcome, results = stepped(case, folder, manifest, progress, checkpoint)
    manifest["warnings"] = [*manifest["warnings"], *outcome.warnings]
    manifest.update(
        status=outcome.status,
        message=outcome.message,
        steps_done=outcome.steps,
        end_time=system.start + outcome.steps * system.step,
        stopped_when=outcome.stopped,
        loop=outcome.loop,
        wall_seconds=round(time.perf_counter() - clock, 6),
        us_per_step=round(1e6 * outcome.seconds / max(outcome.steps, 1), 3),
        numbers={},
        unmet=[],
        not_checked={},
        balance=outcome.balance,
    )
    if outcome.rows is not None:
        manifest["rows"] = outcome.rows
    if outcome.code:
        manifest["exit"] = int(outcome.code)
    try:
        _measure(manifest, system, results)
    finally:  # whatever fails in there, what the run was is kept
        if folder is not None:
            end_manifest(folder, manifest)
    return Run(manifest, results)


def _measure(manifest: dict[str, Any], system: System, results: Results) -> None:
    """Add the numbers of a run, and what is unmet, to its manifest."""
    if not len(results.times()):
        return
    manifest["numbers"] = numbers(said(system.about), results, manifest["parameters"])
    for analysis in analyses():
        if manifest[analysis.KEY] is not None:
            manifest["numbers"].update(analysis.numbers(manifest, results))
            manifest["unmet"] += analysis.unmet(manifest, results)
            if hasattr(analysis, "remarks"):
                manifest["warnings"] += analysis.remarks(manifest, results)
            if hasattr(analysis, "unchecked"):
                manifest["not_checked"].update(analysis.unchecked(manifest, results))
    lines = not_checked(manifest["not_checked"])
    manifest["warnings"] = list(dict.fromkeys([*manifest["warnings"], *lines]))


def _supervised(
    case: Case, folder: Path | None, manifest: dict[str, Any], progress: bool,
    checkpoint: Checkpoint | None = None,
) -> tuple[Outcome, Results]:  # fmt: skip
    """The same in a process of its own: how it ended, or was ended, and the rows until then."""
    system, schedule = case.or_raise()
    options, unwritten = case.options, Unwritten.shared()
    place = folder or library.scratch("run")

    def work(tell: Callable[[str, Any], None], unwritten: Unwritten) -> None:
        stepped(case, place, manifest, progress, checkpoint, unwritten, tell)

    limit = min(options.call_limit, options.time_limit or math.inf)
    try:
        ended = supervisor.watch(work, schedule.order, unwritten, limit)
        layout, outcome = supervisor.layout_of(ended), ended.said.get("outcome")
        if "error" in ended.said and (layout is None or outcome is not None):
            kind, arguments = ended.said["error"]
            raise kind(*arguments)
        full = no_space(ended.said.get("bug", ""))
        if "system" in ended.said and not full and outcome is None:
            raise OSError(*ended.said["system"])
        if "bug" in ended.said and not full and outcome is None and not ended.signal:
            raise RuntimeError(ended.said["bug"])
        if outcome is not None:
            if ended.how:  # all is recorded; it ended when a component was freed
                outcome.status, outcome.message = "failed", f"{ended.text()}, after the run"
            return outcome, Results.open(place)
        if layout is None:
            supervisor.stopped(ended)
        if layout is None and full:
            raise RunError(f"{place}: {full}", Exit.SPACE)
        if layout is None:
            raise RunError(ended.text(), Exit.TIMEOUT if ended.hung else Exit.COMPONENT)
        return _cut_short(system, options, place, ended, layout, unwritten, full)
    finally:
        unwritten.close()
        if folder is None:  # the series stay until they are closed
            shutil.rmtree(place, ignore_errors=True)


def _cut_short(
    system: System, options: Options, place: Path, ended: supervisor.Ended, layout: Layout,
    unwritten: Unwritten, full: str,
) -> tuple[Outcome, Results]:  # fmt: skip
    """How a run ended that could not say so itself, and its rows."""
    outcome = Outcome("failed", ended.text(), Exit.COMPONENT)
    if "error" in ended.said:  # what it could not do while it recorded
        outcome.message = str(ended.said["error"][1][0])
    if full:
        outcome = Outcome("no space", f"{place / SERIES}: {full}", Exit.SPACE)
    elif ended.signal:
        outcome = Outcome("interrupted", "stopped by the user", 128 + ended.signal)
    elif ended.hung:
        outcome = Outcome(stopping.LATE, ended.text(), Exit.TIMEOUT)
    part, path = place / f"{SERIES}.part", place / SERIES
    unwritten.lay_out(layout)
    if full:  # nor for a copy: what is there is read as it is
        outcome.rows = unwritten.written
        results = Results.open(part, outcome.rows)
    elif path.exists() and not part.exists():  # it was ended when all was recorded
        results = Results.open(path)
    else:
        recover(part, path, layout, unwritten)
        results = Results.open(path)
    times, rows = results.times(), len(results.times())
    outcome.steps = round((times[-1] - system.start) / system.step) if len(times) else 0
    outcome.message += f"; {rows} rows are kept"
    return outcome, results


def load_run(folder: Path) -> Run:
    """A run from its folder. Raises DesatError where it is none."""
    manifest = read_manifest(folder)
    manifest.setdefault("numbers", {})
    manifest.setdefault("message", "")
    for key in ("steps_done", "us_per_step", "wall_seconds"):
        manifest.setdefault(key, "?")
    if manifest["status"] == "running":
        manifest["status"] = "killed (or still running)"
    return Run(manifest, Results.open(folder))


def run_or_load(target: str, analysis: ModuleType | None = None) -> Run:
    """The run of a run folder; or of a scenario, .ssp or folder, run now.

    Raises RunError where that run does not complete, and DesatError before it begins where
    `analysis` does not apply to the system.
    """
    folder = Path(target)
    if any((folder / f"{MANIFEST}{end}").exists() for end in ("", ".part")):
        return load_run(folder)
    case = prepare(target, Options())
    if analysis is not None and analysis.applies(case.or_raise()[0]) is None:
        raise DesatError(analysis.NOT_APPLICABLE.format(target))
    return simulate(case).or_raise(target)


# ------------------------------------------------------------------------------------------------
# Going on with a run that was ended, from its newest checkpoint: the same bits as without a break
# Series, numbers and manifest are then those of a run that was never ended, but for wall times.


def has_checkpoints(folder: Path) -> bool:
    """Whether a run folder is one to go on with."""
    return (folder / FOLDER).is_dir()


def options_of(folder: Path) -> Options:
    """The options of a run with checkpoints. Raises DesatError where there is none."""
    return as_asked(_newest(folder).told)


def _newest(folder: Path) -> Checkpoint:
    if (checkpoint := newest(folder)) is None:
        if (folder / MANIFEST).exists() and read_manifest(folder)["status"] == "completed":
            raise DesatError(f"{folder}: it has completed")
        raise DesatError(f"{folder}: it has no checkpoint; `desat run --checkpoint` writes them")
    return checkpoint


def resume(folder: Path, progress: bool = False) -> Run:
    """Go on with a run in its folder, an absolute path; one that has completed is loaded.

    Raises DesatError where there is no checkpoint, or where what it was made of has changed.
    """
    if (folder / MANIFEST).exists():
        run = load_run(folder)
        if run.ok:
            return run
        run.results.close()
    checkpoint = _newest(folder)
    target, options = checkpoint.told["target"], as_asked(checkpoint.told)
    try:
        with chdir(checkpoint.told["from"]):
            return simulate(prepare(target, options), folder, progress, checkpoint)
    except OSError as error:
        if error.filename == checkpoint.told["from"]:
            raise DesatError(f"{error.filename}: {error.strerror}: the run began there") from error
        raise
