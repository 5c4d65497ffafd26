"""Step a checked system to its end, or until something ends it, and record it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..analyses import energy
from ..analyses.energy import OnlineBalance
from ..analyses.manifest import Manifest, Stopped
from ..engine.checkpoint import Checkpoint, Checkpoints
from ..engine.instances.base import ComponentError, EndedError
from ..engine.loop import interruptible, run, stepping
from ..engine.master import Master
from ..engine.process_state import keep_state
from ..engine.recording.recorder import Recorder
from ..engine.recording.results import SERIES, Results
from ..engine.recording.row_buffer import RowBuffer
from ..system.errors import Exit
from ..system.interface import selects
from ..system.options import as_json
from ..system.refusal import explain as refused
from . import stopping
from .case import Case
from .isolation import isolated_in
from .manifest import attributes, begin_manifest
from .progress import progress as shown


@dataclass
class StepOutcome:
    """Outcome of stepping."""

    status: str
    message: str = ""
    code: int = 0  # exit code, where the status does not imply it
    signal: int = 0  # signal to stop that came while it ran or was recorded; 0: none
    steps: int = 0
    seconds: float = 0.0  # s, wall time of the steps
    # the loop that stepped, and why it was not the compiled one
    loop: dict[str, str] | None = None
    stopped: Stopped | None = None  # condition that ended the run, and its time
    warnings: list[str] = field(default_factory=list)
    rows: int | None = None  # rows that hold values, where the file has more
    # totals of its rigid body's balances that were made while it ran
    # (`analyses/energy.py`)
    balance: dict[str, Any] | None = None


def step(
    case: Case,
    folder: Path | None,
    manifest: Manifest,
    progress: bool,
    checkpoint: Checkpoint | None = None,
    unwritten: RowBuffer | None = None,
    tell: Callable[[str, Any], None] = lambda name, note: None,
) -> tuple[StepOutcome, Results]:
    """Initialise, step and record.

    `tell` receives the layout of rows, and the outcome before the components are freed.
    """
    system, schedule = case.or_raise()
    options, outcome = case.options, StepOutcome("completed")
    options_given = as_json(case.target, options)

    def watched(component: str, signal: Any) -> bool:
        """Return whether the master has to read an output."""
        ends_it = ends is not None and ends.reads(component, signal)
        balanced = along is not None and along.needs(component, signal)
        return ends_it or balanced or selects(options.record, component, signal)

    ends, along = stopping.condition(system), _along(case, manifest)
    keeps = None if along is None else along.recorded

    def make() -> Master:
        """Build a master for the case."""
        return Master(
            system,
            schedule,
            algorithm=options.algorithm,
            solve_loops=options.solve_loops,
            watched=watched,
            halvings=options.halvings,
            isolated=isolated_in(system, options),
            limit=min(options.call_limit, options.time_limit or math.inf),
            recording=keeps,
        )

    # a spare master fits if it reads the same outputs; all else is the same for all
    # cases that share it
    alike = schedule, ends, options.record, None if keeps is None else keeps.outputs
    spare = case.spare if unwritten is None else None
    with (
        keep_state() as changes,
        make() if spare is None else spare.take(alike, system, keeps, make) as master,
    ):
        try:
            master.initialise()
        except EndedError:
            raise
        except ComponentError as error:
            raise ComponentError("\n".join(refused(system, str(error)))) from error
        outcome.warnings += changes("when it was initialised")
        ending, before = stopping.watch(master, ends, options.time_limit), 0.0
        if checkpoint is not None:
            checkpoint.restore(master, ending)
            outcome.warnings[:] = checkpoint.about["warnings"]
            before = checkpoint.about["seconds"]
            if along is not None:
                along.restore(checkpoint.about["balance"])
        recorder = Recorder(
            folder and folder / SERIES,
            master,
            options.record,
            unwritten,
            None if checkpoint is None else checkpoint.rows,
            attributes(manifest),
        )
        tell("layout", recorder.layout)
        if folder is not None:
            begin_manifest(folder, manifest)
        if options.algorithm == "jacobi" and checkpoint is None:
            recorder.record(0, master.live)
        steps = stepping(master, recorder, ending, options.loop)
        outcome.loop = {"name": steps.name, "why": steps.reason}

        def about_now() -> dict[str, Any]:
            """Return the state for a checkpoint.

            Changes by components to the process are undone first, as they are when the
            run continues.
            """
            _add(outcome.warnings, changes("while it ran", handlers=False))
            state = {
                "warnings": outcome.warnings,
                "manifest": manifest.to_json(),
                "balance": None if along is None else along.state(),
            }
            return {**state, "seconds": before + steps.seconds, **options_given}

        checkpoints, sound = None, True
        try:
            if folder is not None and options.checkpoint is not None:
                every = max(1, round(options.checkpoint / system.step))
                checkpoints = Checkpoints(
                    folder, every, master, recorder, ending, about_now
                )
                if checkpoint is None:
                    checkpoints.save()
            with (
                interruptible() as interrupted,
                shown(system.name, system.steps, progress, master.k) as report,
            ):
                reason = run(
                    master,
                    steps,
                    system.steps,
                    recorder,
                    ending,
                    interrupted,
                    lambda k: report(k, ""),
                    checkpoints,
                    along,
                )
            if number := interrupted():
                outcome.status = "interrupted"
                outcome.message = f"stopped by the user at t = {master.t:g} s"
                outcome.code = int(Exit(128 + number))
                outcome.signal = number
            elif reason == stopping.LATE:
                outcome.status = reason
                outcome.message = (
                    f"{options.time_limit:g} s of wall time over at t = {master.t:g} s"
                )
            elif reason:
                outcome.stopped = Stopped(reason, master.t)
            if checkpoints is not None and outcome.status != "completed":
                checkpoints.save()
        except ComponentError as error:
            sound = False
            outcome.status, outcome.message = (
                "failed",
                "\n".join(refused(system, str(error))),
            )
            if isinstance(error, EndedError):
                outcome.code = int(error.code)
                outcome.status = (
                    stopping.LATE if error.code == Exit.TIMEOUT else "failed"
                )
        outcome.seconds = before + steps.seconds
        outcome.steps = master.k
        if along is not None:
            outcome.balance = along.finish(master, outcome.status == "failed")
        if sound:
            _terminate(master, outcome)
        _add(outcome.warnings, [*changes("while it ran"), *master.messages()])
        # compressing a day's series takes seconds; the outcome is reported after that
        with interruptible() as interrupted:
            results = recorder.finish(master)
            outcome.signal = outcome.signal or interrupted()
            tell("outcome", outcome)
        if spare is not None and outcome.status == "completed":
            spare.keep(master)
    if master.unfreed and outcome.status == "completed":  # all is recorded
        outcome.status, outcome.message = (
            "failed",
            f"{master.unfreed[0]}, after the run",
        )
        outcome.code = int(master.unfreed[0].code)
        tell("outcome", outcome)
    return outcome, results


def _terminate(master: Master, outcome: StepOutcome) -> None:
    """Terminate the components of a run that has not failed.

    If one of them does not end, a completed run has failed after all, with everything
    recorded; otherwise it is a warning.
    """
    try:
        master.terminate()
    except ComponentError as error:
        if outcome.status != "completed":  # its status already says why it was stopped
            outcome.warnings += str(error).splitlines()
            return
        outcome.status, outcome.message = "failed", f"{error}, after the run"
        if isinstance(error, EndedError):
            outcome.code = int(error.code)


def _along(case: Case, manifest: Manifest) -> OnlineBalance | None:
    """Return the balances to compute during the run, or None.

    None where its rows suffice, or where no balance is computed: the series that the
    work needs must be recorded.
    """
    (system, _), options = case.or_raise(), case.options
    parts: energy.EnergyParts | None = manifest.parts[energy.KEY]
    if parts is None or parts.why or options.algorithm != "gauss_seidel":
        return None
    if parts.rows:
        return None
    series = [name.partition(".") for name in energy.of_work(parts)]
    all_of_it = all(
        selects(options.record, owner, signal)
        for owner, _, name in series
        for signal in system.components[owner].interface.elements.get(name, ())
    )
    return OnlineBalance(system, parts, manifest.parameters) if all_of_it else None


def _add(lines: list[str], more: list[str]) -> None:
    """Add those lines that are not in the list yet."""
    lines += [line for line in more if line not in lines]
