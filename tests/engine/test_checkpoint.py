"""Runs that were ended and go on: the same bits as those of a run without a break."""

from __future__ import annotations

import errno
import os
import re
import shutil
import signal
import sys
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

from benchmarks.killed import differences, trials
from desat.analyses import manifest as made_by
from desat.engine import checkpoint
from desat.engine.checkpoint import newest
from desat.engine.recording import shared_tables
from desat.files import identity, paths
from desat.files.io import claimed
from desat.runs.run import prepare, resume, simulate
from desat.system.errors import DesatError, Exit, RunError
from desat.system.options import Options
from tests.engine.test_failures import DESCRIPTION, binary, fmu, options, system
from tests.engine.test_rates import scenario

__all__ = ["binary", "system"]  # fixtures


# --- killed in the middle, within this process's tests --------------------------------


def broken(target: str, values: Options, folder: Path, monkeypatch, at: int) -> None:
    """A run that is killed while it has just written the checkpoint of step `at` or a
    later one."""
    save = checkpoint.Checkpoints.save

    def last(self: checkpoint.Checkpoints) -> None:
        save(self)
        if self._master.k >= at:
            os.kill(os.getpid(), signal.SIGKILL)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.Checkpoints, "save", last)
        run = simulate(prepare(target, replace(values, supervised=True)), folder)
    assert "SIGKILL" in run.manifest["message"]
    run.results.close()


HELD = "signal = 'manager.mode'\nreaches = 1\nheld = 7.0"


@pytest.mark.parametrize(
    "more",
    [
        {},
        {"fmus": "python", "isolate": "all"},
        {"blocks": True},
        {"algorithm": "jacobi"},
        {"substeps": 3, "every": 4},
    ],
    ids=str,
)
def test_it_goes_on_with_the_same_bits(tmp_path, monkeypatch, more):
    """Both loops, both kinds of FMUs and bare blocks, both semantics, several rates."""
    if "algorithm" in more:
        monkeypatch.setattr(shared_tables, "MANY", 3)  # series that share tables
    slow = (
        {"manager": 5}
        if "substeps" in more
        else {"spacecraft": 10, "wheels": 2, "manager": 5}
    )
    file = scenario(tmp_path, step=0.1, step_ratio=slow)
    options = Options(stop=14.0, **more)
    simulate(prepare(file, options), tmp_path / "whole").results.close()
    with_checkpoint = replace(options, checkpoint=1.1)
    broken(file, with_checkpoint, tmp_path / "broken", monkeypatch, 77)
    run = resume(tmp_path / "broken")
    run.results.close()
    assert run.ok
    assert differences(tmp_path / "whole", tmp_path / "broken") == []


def test_a_condition_that_holds_goes_on_holding(tmp_path, monkeypatch):
    file = tmp_path / "mine.toml"
    file.write_text(
        f'extends = "integrated/mil-nadir"\nstop = 18.0\ntitle = "T"\n[stop_when]\n{HELD}\n'
    )
    options = Options(checkpoint=3.0)
    full = simulate(prepare(str(file), options), tmp_path / "whole")
    assert full.manifest["stopped_when"]["time"] < 18.0
    broken(str(file), options, tmp_path / "broken", monkeypatch, 12)
    resume(tmp_path / "broken").results.close()
    assert differences(tmp_path / "whole", tmp_path / "broken") == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs POSIX")
def test_the_newest_whole_one_counts(tmp_path, monkeypatch):
    options = Options(stop=40.0, checkpoint=10.0)
    broken("nadir_day/day-dipole", options, tmp_path / "a", monkeypatch, 30)
    old, new = sorted((tmp_path / "a" / checkpoint.FOLDER).iterdir())
    new.write_bytes(new.read_bytes()[:-500])
    assert checkpoint.newest(tmp_path / "a").path == old
    new.unlink()
    os.mkfifo(new)  # to read which would take forever
    assert checkpoint.newest(tmp_path / "a").path == old
    old.write_bytes(b"")
    with pytest.raises(DesatError, match="it has no checkpoint"):
        resume(tmp_path / "a")


def test_a_full_disk_while_one_is_written(tmp_path, monkeypatch):
    """6, the one before it is whole, and once there is room the run goes on from there."""
    options = Options(stop=40.0, checkpoint=10.0, supervised=True)
    simulate(
        prepare("nadir_day/day-dipole", options), tmp_path / "whole"
    ).results.close()
    count, savez = [0], np.savez

    def full(file: IO[bytes], *arrays: Any, **more: Any) -> None:
        count[0] += 1
        savez(file, *arrays, **more)
        if count[0] == 3:
            file.truncate(1000)
            raise OSError(errno.ENOSPC, "No space left on device", file.name)

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint.np, "savez", full)
        run = simulate(prepare("nadir_day/day-dipole", options), tmp_path / "full")
    assert (run.code, run.manifest["status"]) == (Exit.SPACE, "no space")
    run.results.close()
    assert checkpoint.newest(tmp_path / "full").k == 10
    resume(tmp_path / "full").results.close()
    assert differences(tmp_path / "whole", tmp_path / "full") == []


def test_what_has_changed_is_said(tmp_path, monkeypatch):
    file = tmp_path / "mine.toml"
    text = 'extends = "nadir_day/day-dipole"\ntitle = "T"\n[parameters.wheels]\nspeed_limit = '
    file.write_text(text + "600.0\n")
    broken(
        str(file), Options(stop=40.0, checkpoint=10.0), tmp_path / "a", monkeypatch, 30
    )
    file.write_text(text + "601.0\n")
    with pytest.raises(DesatError, match=r"wheels.* was .*600\.0.*is .*601\.0"):
        resume(tmp_path / "a")


@pytest.mark.parametrize("isolate", ["none", "foreign"])
def test_what_a_component_changes_is_put_back_at_each(
    system, binary, tmp_path, monkeypatch, isolate
):
    """It calculates otherwise from 4 s on, until the checkpoint at 6 s, and says so in
    what it gives; with and without a break."""
    able = 'canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>'
    text = DESCRIPTION.format(identifier="failing").replace("/>", f" {able}", 1)
    fmu(system / "resources/failing.fmu", binary, description=text)
    run_options = options("ROUNDED", isolate=isolate, checkpoint=6.0)
    runs = [simulate(prepare(str(system), run_options), tmp_path / "whole")]
    broken(str(system), run_options, tmp_path / "broken", monkeypatch, 6)
    runs.append(resume(tmp_path / "broken"))
    for run in runs:
        y = run.results.values("bad.y")
        assert (y - run.results.times()).tolist() == [
            0,
            0,
            0,
            0,
            0,
            0.5,
            0.5,
            0,
            0,
            0,
            0,
        ]
        assert [
            w
            for w in run.manifest["warnings"]
            if "rounding mode" in w and "put back" in w
        ]
    assert runs[0].manifest["warnings"] == runs[1].manifest["warnings"]


# --- what cannot be -------------------------------------------------------------------


def test_one_that_cannot_save_is_named_before_the_run(desat, system, tmp_path):
    result = desat(
        "run",
        str(system),
        "--step",
        "1",
        "--checkpoint",
        "5",
        "--out",
        str(tmp_path / "out"),
    )
    assert result.returncode == Exit.INPUT
    assert (
        "--checkpoint: bad: failing.fmu cannot save its state (canGetAndSet"
        in result.stderr
    )
    assert not (tmp_path / "out").exists()


def test_a_folder_is_one_runs_alone(desat, tmp_path):
    with claimed(tmp_path / "a"):
        result = desat(
            "run", "nadir_day/day-dipole", "--stop", "5", "--out", str(tmp_path / "a")
        )
    assert result.returncode == Exit.INPUT
    assert "a: another process runs in it" in result.stderr
    assert not (tmp_path / "a").exists()
    result = desat("resume", str(tmp_path))
    assert (result.returncode, "it has no checkpoint" in result.stderr) == (
        Exit.INPUT,
        True,
    )


# --- killed at random moments ---------------------------------------------------------


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_killed_at_random_moments(tmp_path):
    """Checkpoints so frequent that it is often killed while it writes one. `python -m
    benchmarks.killed` kills a hundred."""
    cases = (
        "nadir_day/day-dipole",
        "--stop",
        "1500",
        "--checkpoint",
        "100",
        "--no-baseline",
    )
    lines = list(trials(2, cases, tmp_path, 1))
    assert [x for x in lines if not x.startswith("equal")] == []


@pytest.mark.parametrize("fault", ["FMU", "file", "package", "machine"])
def test_resume_refuses_what_is_another(tmp_path, monkeypatch, fault):
    """Each of what docs/failures.md names is told as it was and as it is; the folder
    stays."""
    mine = tmp_path / "mine.fmu"
    shutil.copy(paths.fmus() / "native" / "controller_pd.fmu", mine)
    file = tmp_path / "mine.toml"
    file.write_text('extends = "nadir_day/day-dipole"\ntitle = "T"\n')
    options = Options(
        sources=[f"controller={mine}"], stop=40.0, checkpoint=10.0, isolate="none"
    )
    broken(str(file), options, tmp_path / "a", monkeypatch, 30)
    before = {p: p.read_bytes() for p in (tmp_path / "a").rglob("*") if p.is_file()}
    own_versions = identity.versions()
    if fault == "FMU":
        with zipfile.ZipFile(mine, "a") as archive:
            archive.writestr("resources/new.txt", "x")
        message = r"(digest|fmus\.controller) was .*, and is "
    elif fault == "file":
        file.write_text(
            file.read_text() + "[parameters.environment]\neccentricity = 0.1\n"
        )
        message = r"environment.* was .*, and is .*0\.1"
    else:
        name = {"package": "numpy", "machine": "platform"}[fault]
        monkeypatch.setattr(
            made_by, "versions", lambda: {**own_versions, name: "another"}
        )
        message = (
            rf"versions\.{name} was {re.escape(own_versions[name])}, and is another"
        )
    with pytest.raises(DesatError, match=message):
        resume(tmp_path / "a")
    assert {
        p: p.read_bytes() for p in (tmp_path / "a").rglob("*") if p.is_file()
    } == before


def test_jacobi_records_its_first_row_whatever_is_left_out():
    """Row 0 is of the start; each second row beside it."""
    options = Options(algorithm="jacobi", every=2, stop=6.0, blocks=True)
    run = simulate(prepare("nadir_day/day-dipole", options))
    assert run.results.times()[:3].tolist() == [0.0, 2.0, 4.0]


def test_checkpoints_are_so_many_seconds_of_the_run_apart(tmp_path, monkeypatch):
    """Not so many steps: a step of half a second has twice as many between two."""
    apart: list[int] = []
    monkeypatch.setattr(
        "desat.runs.step_case.Checkpoints",
        lambda folder, every, *rest: (
            apart.append(every) or (_ for _ in ()).throw(RunError("seen"))
        ),
    )
    case = prepare(
        "nadir_day/day-dipole", Options(step=0.5, stop=60.0, checkpoint=10.0)
    )
    with pytest.raises(RunError, match="seen"):
        simulate(case, tmp_path / "run")
    assert apart == [20]


def test_a_checkpoint_says_how_long_the_run_took_until_then(tmp_path):
    options = Options(stop=60.0, checkpoint=10.0, blocks=True)
    run = simulate(prepare("nadir_day/day-dipole", options), tmp_path / "run")
    answer = newest(tmp_path / "run").about["seconds"]
    assert 0.0 < answer <= run.manifest.wall_seconds
