"""Run a system: initialise, step, record, and leave a run folder behind."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType
from typing import Any

from ..analyses import analyses
from ..engine.instances import ComponentError
from ..engine.loop import bar, interruptible, run, stepping
from ..engine.master import Master
from ..engine.results import SERIES, Recorder, Results, selects
from ..system.codes import Exit
from ..system.errors import DesatError, RunError
from . import stopping
from .manifest import MANIFEST, describe, numbers, read_manifest, write_json
from .options import Options
from .prepare import Case, load, prepare

__all__ = ["Case", "Options", "Run", "execute", "load", "load_run", "prepare", "run_or_load",
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
        if self.manifest["status"] == stopping.LATE:
            return Exit.TIMEOUT
        if self.manifest["status"] == "interrupted":
            return Exit(self.manifest.get("exit", Exit.INTERRUPTED))
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


def simulate(case: Case, folder: Path | None = None, progress: bool = False) -> Run:
    """Run a prepared case; `folder` None keeps the series in memory.

    A component that fails, Ctrl-C, SIGTERM and the time limit end the run early: what was recorded
    is kept, and the manifest's status says which. A run that its scenario's `stop_when` ends is
    completed, and the manifest's `stopped_when` says when.
    Raises DesatError where the run cannot begin.
    """
    system, schedule = case.or_raise()
    options = case.options
    began, clock = datetime.now(UTC), time.perf_counter()
    manifest = describe(system, options, case.target)
    manifest.update(started=began.isoformat(timespec="seconds"), steps=system.steps,
                    status="running", warnings=case.checked.warnings)  # fmt: skip

    def watched(component: str, signal: Any) -> bool:
        ends_it = ends is not None and ends.reads(component, signal)
        return ends_it or selects(options.record, component, signal)

    ends = stopping.condition(system)
    with Master(system, schedule, algorithm=options.algorithm, watched=watched) as master:
        master.initialise()
        recorder = Recorder(folder and folder / SERIES, master, options.record, options.every)
        if folder is not None:
            write_json(folder / f"{MANIFEST}.part", manifest)
        if options.algorithm == "jacobi":
            recorder.record(0, master.live)
        ending, stopped = stopping.watch(master, ends, options.time_limit), None
        steps = stepping(master, recorder, ending, options.loop)
        manifest["loop"] = {"name": steps.name, "why": steps.why}
        status, message, stepped = "completed", "", time.perf_counter()
        try:
            with interruptible() as interrupted, bar(system.name, system.steps, progress) as report:
                reason = run(
                    master, steps, system.steps, recorder, ending, interrupted, report
                )  # fmt: skip
            if number := interrupted():
                status, message = "interrupted", f"stopped by the user at t = {master.t:g} s"
                manifest["exit"] = int(Exit(128 + number))
            elif reason == stopping.LATE:
                status = reason
                message = f"{options.time_limit:g} s of wall time over at t = {master.t:g} s"
            elif reason:
                stopped = {"condition": reason, "time": master.t}
        except ComponentError as error:
            status, message = "failed", str(error)
        seconds = time.perf_counter() - stepped
        done = master.k
        results = recorder.finish(master)
    manifest.update(
        status=status,
        message=message,
        steps_done=done,
        end_time=master.t,
        stopped_when=stopped,
        wall_seconds=round(time.perf_counter() - clock, 6),
        us_per_step=round(1e6 * seconds / max(done, 1), 3),
        numbers=numbers(system.about, results, manifest["parameters"]),
        unmet=[],
    )
    for analysis in analyses():
        if manifest[analysis.KEY] is not None:
            manifest["numbers"].update(analysis.numbers(manifest, results))
            manifest["unmet"] += analysis.unmet(manifest, results)
    if folder is not None:
        write_json(folder / MANIFEST, manifest)
        (folder / f"{MANIFEST}.part").unlink(missing_ok=True)
    return Run(manifest, results)


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
