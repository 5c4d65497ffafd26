"""Work in a process of its own: how it ends, with what takes long replaced."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.engine import child
from desat.engine.child import Ended
from desat.engine.instances.base import EndedError
from desat.engine.master import Master
from desat.runs import run as runs
from desat.runs import step_case
from desat.runs.step_case import Outcome
from desat.runs.stopping import LATE
from desat.system.errors import DesatError, Exit, RunError
from desat.system.options import Options

FULL = "errno = 28, "

DIED = {"component": "a", "call": "stepping", "exit_text": "SIGSEGV"}

HUNG = {**DIED, "hung": 2.0}


def catch_error(function, *args: object) -> tuple[str, object] | object:
    try:
        return function(*args)
    except (
        KeyboardInterrupt,
        SystemExit,
        OSError,
        RuntimeError,
        DesatError,
        EndedError,
    ) as error:
        return type(error).__name__, getattr(error, "code", str(error))


@pytest.mark.parametrize(
    ("end", "result"),
    [
        (Ended({"made": 7}), 7),
        (Ended({}, signal=signal.SIGINT), ("KeyboardInterrupt", "")),
        (Ended({"made": 7}, signal=signal.SIGTERM), ("SystemExit", 143)),
        (Ended({"error": (DesatError, ("no",))}), ("DesatError", Exit.INPUT)),
        (Ended({"error": (RunError, ("no", Exit.SPACE))}), ("RunError", Exit.SPACE)),
        (Ended({"system": (2, "gone")}), ("FileNotFoundError", "[Errno 2] gone")),
        (Ended({"bug": "why"}), ("RuntimeError", "why")),
        (Ended({}, **DIED), ("EndedError", Exit.COMPONENT)),
        (Ended({}, **HUNG), ("EndedError", Exit.TIMEOUT)),
    ],
)
def test_what_is_done_apart_ends_as_its_process(monkeypatch, end, result):
    monkeypatch.setattr(child, "watch", lambda *_: end)
    assert catch_error(child.apart, lambda: 7, [], 1.0) == result


DONE = ("completed", "", 0)

ROWS = SimpleNamespace()


@pytest.mark.parametrize(
    ("end", "result"),
    [
        (Ended({"layout": ROWS, "outcome": DONE}), DONE),
        (
            Ended({"layout": ROWS, "outcome": DONE}, **DIED),
            ("failed", "a: stepping ended the process: SIGSEGV, after the run", 0),
        ),
        (Ended({"error": (DesatError, ("no",))}), ("DesatError", Exit.INPUT)),
        (Ended({"layout": ROWS, "error": (DesatError, ("no",))}), "cut short"),
        (
            Ended({"layout": ROWS, "outcome": DONE, "error": (DesatError, ("no",))}),
            ("DesatError", Exit.INPUT),
        ),
        (Ended({"system": (2, "gone")}), ("FileNotFoundError", "[Errno 2] gone")),
        (Ended({"layout": ROWS, "system": (2, "gone"), "outcome": DONE}), DONE),
        (Ended({"layout": ROWS, "system": (2, "gone"), "bug": FULL}), "cut short"),
        (Ended({"bug": "why"}), ("RuntimeError", "why")),
        (Ended({"layout": ROWS, "bug": "why", "outcome": DONE}), DONE),
        (Ended({"layout": ROWS, "bug": "why"}, signal=2), "cut short"),
        (Ended({"bug": FULL}), ("RunError", Exit.SPACE)),
        (Ended({"layout": ROWS, "bug": FULL}), "cut short"),
        (Ended({}, **DIED), ("RunError", Exit.COMPONENT)),
        (Ended({}, **HUNG), ("RunError", Exit.TIMEOUT)),
        (Ended({}, signal=2), ("KeyboardInterrupt", "")),
        (Ended({"layout": ROWS}, signal=2), "cut short"),
        (Ended({"layout": ROWS}, **DIED), "cut short"),
    ],
)
@pytest.mark.parametrize("stored_values", [True, False])
def test_a_supervised_run_ends_as_its_process(
    monkeypatch, tmp_path, end, result, stored_values
):
    """Its folder is removed where nobody has asked for one, whatever comes; the shorter
    of both limits holds for a call."""
    if isinstance(end.reports.get("outcome"), tuple):
        end = replace(end, reports={**end.reports, "outcome": Outcome(*DONE)})
    limits, scratch = [], tmp_path / "scratch"
    monkeypatch.setattr(child, "watch", lambda *args: limits.append(args[-1]) or end)
    monkeypatch.setattr(runs.Results, "open", lambda place: place)
    monkeypatch.setattr(runs, "_cut_short", lambda *args: ("cut short", args[2]))
    if not end.exit_text:  # else it is gone already
        scratch.mkdir()
    monkeypatch.setattr(runs.library, "scratch", lambda name: scratch)
    options = SimpleNamespace(call_limit=3.0, time_limit=2.0 if stored_values else None)
    system, schedule = SimpleNamespace(components={}), SimpleNamespace(order=[])
    case = SimpleNamespace(or_raise=lambda: (system, schedule), options=options)
    inputs = catch_error(
        runs._simulate_apart, case, tmp_path if stored_values else None, None, False
    )
    assert limits == [2.0 if stored_values else 3.0]
    if inputs[1] == (tmp_path if stored_values else scratch):
        outcome = inputs[0]
        inputs = (
            outcome
            if isinstance(outcome, str)
            else (outcome.status, outcome.message, outcome.code)
        )
    assert inputs == result
    assert scratch.exists() == (stored_values and not end.exit_text)


@pytest.mark.parametrize(
    ("end", "full", "status", "code", "message"),
    [
        (
            Ended({}, **DIED),
            "",
            "failed",
            Exit.COMPONENT,
            "a: stepping ended the process: SIGSEGV",
        ),
        (
            Ended({}, **HUNG),
            "",
            LATE,
            Exit.TIMEOUT,
            "a: stepping did not return within 2 s",
        ),
        (Ended({"error": (RunError, ("no", 4))}), "", "failed", Exit.COMPONENT, "no"),
        (Ended({}, signal=2), "", "interrupted", 130, "stopped by the user"),
        (Ended({}, signal=15, **HUNG), "", "interrupted", 143, "stopped by the user"),
        (Ended({}, signal=15), "disk full", "no space", Exit.SPACE, "{}: disk full"),
    ],
)
@pytest.mark.parametrize("files", ["series.h5", "series.h5.part", "both"])
@pytest.mark.parametrize("times", [[], [5.0], [5.0, 7.0, 9.0]])
def test_a_run_cut_short_says_how_far_it_came(
    monkeypatch, tmp_path, end, full, status, code, message, files, times
):
    for name in ("series.h5", "series.h5.part") if files == "both" else (files,):
        (tmp_path / name).touch()
    calls, results = [], SimpleNamespace(times=lambda: np.array(times))
    monkeypatch.setattr(
        runs.Results, "open", lambda *args: calls.append(args) or results
    )
    monkeypatch.setattr(
        runs, "recover", lambda part, path, *_: calls.append((part, "recovered"))
    )
    unwritten = SimpleNamespace(lay_out=lambda layout: None, written=2)
    system = SimpleNamespace(start=5.0, step=2.0)
    outcome, _ = runs._cut_short(system, None, tmp_path, end, ROWS, unwritten, full)
    path, part = tmp_path / "series.h5", tmp_path / "series.h5.part"
    expected_message = f"{message.format(path)}; {len(times)} rows are kept"
    assert (outcome.status, outcome.code, outcome.message) == (
        status,
        code,
        expected_message,
    )
    assert outcome.steps == max(0, len(times) - 1)
    if full:
        assert (calls, outcome.rows) == ([(part, 2)], 2)
    else:
        full_run = files == "series.h5"
        assert calls == ([] if full_run else [(part, "recovered")]) + [(path,)]
        assert outcome.rows is None


@pytest.mark.parametrize(
    ("seconds", "every"), [(1.0, 1), (0.1, 1), (2.6, 3), (10.0, 10)]
)
def test_a_checkpoint_is_saved_every_so_many_steps(
    monkeypatch, tmp_path, seconds, every
):
    def checkpoints(folder: Path, every: int, *_: object) -> None:
        raise AskedError(every)

    monkeypatch.setattr(step_case, "Checkpoints", checkpoints)
    options = Options(blocks=True, stop=20.0, substeps=1, checkpoint=seconds)
    with pytest.raises(AskedError) as requests:
        runs.simulate(runs.prepare("gyrostat/light", options), tmp_path)
    assert requests.value.args == (every,)


def test_the_time_of_a_run_is_that_of_its_steps(monkeypatch):
    results, stepping = [], step_case.stepping
    monkeypatch.setattr(
        step_case, "stepping", lambda *x: results.append(stepping(*x)) or results[0]
    )
    options = Options(blocks=True, stop=20.0, substeps=1)
    run = runs.simulate(runs.prepare("gyrostat/light", options))
    assert run.manifest.us_per_step == pytest.approx(
        1e6 * results[0].seconds / 20, abs=1.0
    )


@pytest.mark.parametrize("number", [1, 2, 15])
def test_a_run_that_a_signal_stops_says_which(monkeypatch, number):
    monkeypatch.setattr(step_case, "interruptible", lambda: nullcontext(lambda: number))
    options = Options(blocks=True, stop=20.0, substeps=1)
    case = runs.prepare("gyrostat/light", options)
    run = runs.simulate(case, partial=True)
    assert (run.manifest.status, run.code) == ("interrupted", 128 + number)
    assert run.manifest.message.startswith("stopped by the user at t = ")
    # a run of a study takes the study with it
    error_type = KeyboardInterrupt if number == signal.SIGINT else SystemExit
    with pytest.raises(error_type):
        runs.simulate(case)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    "line",
    [
        "faults c -n 2 --stop 2orbits --jobs 1",
        "compare c --laws all --stop 6orbits",
        "size c",
        "sweep c manager.gain=1e-4,1e-3,2e-3,4e-3 --stop 6orbits --jobs 1",
        "bound c",
    ],
)
def test_a_signal_at_any_moment_ends_a_study(tmp_path, line, number):
    """Sent to the whole group of processes, as a terminal does, and to the first alone."""
    write(tmp_path / "c", CraftFacts(size="12U", rods="0.2"), "")
    draw = random.Random(f"{line} {number}")
    for stop in (os.kill, os.killpg):
        process = subprocess.Popen(
            [sys.executable, "-m", "desat.cli", *line.split()],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            cwd=tmp_path,
        )
        time.sleep(draw.uniform(0.7, 1.6))
        if process.poll() is None:
            stop(process.pid, number)
        began = time.monotonic()
        _, errors = process.communicate(timeout=60)
        assert process.returncode in (128 + number, -number), errors
        assert time.monotonic() - began < 5.0
        assert b"Traceback" not in errors


def test_a_run_whose_components_cannot_be_freed_ends_as_the_first(monkeypatch):
    errors, leave = (
        [EndedError("a hangs", Exit.TIMEOUT), EndedError("b died")],
        Master.__exit__,
    )

    def fail_to_free(self: Master, *values: object) -> None:
        leave(self, *values)
        self.unfreed = errors

    monkeypatch.setattr(Master, "__exit__", fail_to_free)
    run = runs.simulate(
        runs.prepare("gyrostat/light", Options(blocks=True, stop=20.0, substeps=1))
    )
    assert (run.manifest.status, run.code) == ("failed", Exit.TIMEOUT)
    assert run.manifest.message == "a hangs, after the run"


class AskedError(Exception):
    """What a run was to record."""
