"""Runs that were ended and go on: the same bits as those of a run without a break.

`python tests/test_checkpoint.py 100` kills so many runs, each at a random moment; CI a few.
"""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import h5py
import pytest
from test_failures import binary, system
from test_rates import scenario

from desat.engine import checkpoint, wide
from desat.files.claim import claimed
from desat.study.case import Options, prepare, simulate
from desat.study.resume import resume
from desat.system.codes import Exit
from desat.system.errors import DesatError

__all__ = ["binary", "system"]  # fixtures

ROOT = Path(__file__).resolve().parent.parent
OF_WALL_TIME = {"started", "wall_seconds", "us_per_step"}


def series(folder: Path) -> dict[str, tuple]:
    """All that the series of a run folder hold."""
    found = {}

    def add(name: str, of: h5py.Dataset | h5py.Group) -> None:
        if isinstance(of, h5py.Dataset):
            value = of[()]
            data = value if isinstance(value, bytes) else value.tobytes()
            own = {k: v for k, v in of.attrs.items() if isinstance(v, str | bytes)}
            found[name] = (of.dtype.str, of.shape, data, own)

    with h5py.File(folder / "series.h5") as file:
        file.visititems(add)
    return found


def differences(one: Path, other: Path) -> list[str]:
    """What differs between two run folders, but for wall times."""
    ours, theirs = series(one), series(other)
    assert len(ours) > 5
    manifests = [json.loads((x / "manifest.json").read_text()) for x in (one, other)]
    lines = [f"series {n}" for n in ours.keys() | theirs.keys() if ours.get(n) != theirs.get(n)]
    for key in set().union(*manifests) - OF_WALL_TIME:
        if manifests[0].get(key) != manifests[1].get(key):
            lines.append(f"manifest {key}")
    return lines


# --- killed in the middle, within this process's tests ------------------------------------------


def broken(target: str, given: Options, folder: Path, monkeypatch, at: int) -> None:
    """A run that is killed while it has just written the checkpoint of step `at` or a later one."""
    save = checkpoint.Checkpoints.save

    def last(self: checkpoint.Checkpoints) -> None:
        save(self)
        if self._master.k >= at:
            os.kill(os.getpid(), signal.SIGKILL)

    with monkeypatch.context() as patched:
        patched.setattr(checkpoint.Checkpoints, "save", last)
        run = simulate(prepare(target, replace(given, supervised=True)), folder)
    assert "SIGKILL" in run.manifest["message"]
    run.results.close()


HELD = "signal = 'manager.mode'\nreaches = 1\nheld = 7.0"


@pytest.mark.parametrize(
    "more",
    [{}, {"fmus": "python", "isolate": "all"}, {"blocks": True}, {"algorithm": "jacobi"},
     {"inner": 3, "every": 4}],
    ids=str,
)  # fmt: skip
def test_it_goes_on_with_the_same_bits(tmp_path, monkeypatch, more):
    """Both loops, both kinds of FMUs and bare blocks, both semantics, several rates."""
    if "algorithm" in more:
        monkeypatch.setattr(wide, "MANY", 3)  # series that share tables
    slow = {"manager": 5} if "inner" in more else {"spacecraft": 10, "wheels": 2, "manager": 5}
    file = scenario(tmp_path, step=0.1, decimation=slow)
    given = Options(stop=14.0, **more)
    simulate(prepare(file, given), tmp_path / "whole").results.close()
    saved = replace(given, checkpoint=1.1)
    broken(file, saved, tmp_path / "broken", monkeypatch, 77)
    run = resume(tmp_path / "broken")
    run.results.close()
    assert run.ok
    assert differences(tmp_path / "whole", tmp_path / "broken") == []


def test_a_condition_that_holds_goes_on_holding(tmp_path, monkeypatch):
    file = tmp_path / "mine.toml"
    file.write_text(
        f'extends = "integrated/mil-nadir"\nstop = 18.0\ntitle = "T"\n[stop_when]\n{HELD}\n'
    )
    given = Options(checkpoint=3.0)
    whole = simulate(prepare(str(file), given), tmp_path / "whole")
    assert whole.manifest["stopped_when"]["time"] < 18.0
    broken(str(file), given, tmp_path / "broken", monkeypatch, 12)
    resume(tmp_path / "broken").results.close()
    assert differences(tmp_path / "whole", tmp_path / "broken") == []


def test_the_newest_whole_one_counts(tmp_path, monkeypatch):
    given = Options(stop=40.0, checkpoint=10.0)
    broken("nadir_day/day-dipole", given, tmp_path / "a", monkeypatch, 30)
    old, new = sorted((tmp_path / "a" / checkpoint.FOLDER).iterdir())
    new.write_bytes(new.read_bytes()[:-500])
    assert checkpoint.newest(tmp_path / "a").path == old
    old.write_bytes(b"")
    with pytest.raises(DesatError, match="it has no checkpoint"):
        resume(tmp_path / "a")


def test_what_has_changed_is_said(tmp_path, monkeypatch):
    file = tmp_path / "mine.toml"
    text = 'extends = "nadir_day/day-dipole"\ntitle = "T"\n[parameters.wheels]\nspeed_limit = '
    file.write_text(text + "600.0\n")
    broken(str(file), Options(stop=40.0, checkpoint=10.0), tmp_path / "a", monkeypatch, 30)
    file.write_text(text + "601.0\n")
    with pytest.raises(DesatError, match=r"wheels.* was .*600\.0.*is .*601\.0"):
        resume(tmp_path / "a")


# --- what cannot be ------------------------------------------------------------------------------


def test_one_that_cannot_save_is_named_before_the_run(desat, system, tmp_path):
    result = desat("run", str(system), "--step", "1", "--checkpoint", "5",
                   "--out", str(tmp_path / "out"))  # fmt: skip
    assert result.returncode == Exit.INPUT
    assert "--checkpoint: bad: failing.fmu cannot save its state (canGetAndSet" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_is_one_runs_alone(desat, tmp_path):
    with claimed(tmp_path / "a"):
        result = desat("run", "nadir_day/day-dipole", "--stop", "5", "--out", str(tmp_path / "a"))
    assert result.returncode == Exit.INPUT
    assert "a: another process runs in it" in result.stderr
    assert not (tmp_path / "a").exists()
    result = desat("resume", str(tmp_path))
    assert (result.returncode, "it has no checkpoint" in result.stderr) == (Exit.INPUT, True)


# --- killed at random moments --------------------------------------------------------------------


def command(*given: str) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "desat.cli", *given], cwd=ROOT, text=True,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                            start_new_session=True)  # fmt: skip


def children(process: int) -> list[int]:
    text = Path(f"/proc/{process}/task/{process}/children").read_text()
    return [int(x) for x in text.split()]


def kill(process: subprocess.Popen[str], whom: str) -> None:
    """Both processes of a run, the one that waits, or the one that steps."""
    with suppress(ProcessLookupError, FileNotFoundError):
        if whom == "both":
            os.killpg(process.pid, signal.SIGKILL)
        for number in [process.pid] if whom == "parent" else children(process.pid):
            os.kill(number, signal.SIGKILL)


def trials(count: int, given: tuple[str, ...], folder: Path, seed: int) -> Iterator[str]:
    """Runs that are killed at random moments, and again while they go on, until one is left to
    complete. Of each how it went; it begins with `equal` where nothing differs."""
    chance = random.Random(seed)
    began = time.monotonic()
    error = command("run", *given, "--out", str(folder / "whole")).communicate()[1]
    assert (folder / "whole/report.html").exists(), error
    seconds = time.monotonic() - began
    i = left = count
    while left:
        i += 1
        place, kills, started = folder / str(i), [], False
        for attempt in range(4):
            whom = chance.choice(("both", "parent", "child"))
            verb = ("resume", str(place)) if started else ("run", *given, "--out", str(place))
            process = command(*verb)
            moment = chance.uniform(0.3, 0.9) * seconds if attempt < 3 else 600.0
            with suppress(subprocess.TimeoutExpired):
                process.wait(moment)
            if process.poll() is None:
                kill(process, whom)
                kills.append(f"{whom} at {moment:.2f} s")
            error = process.communicate()[1]
            if process.returncode == 0 or error.strip().endswith("it has completed"):
                break
            assert "Traceback" not in error, error
            assert "internal" not in error, error
            started = started or checkpoint.newest(place) is not None
            if not started:  # killed before there was anything: it begins anew
                place = folder / f"{i}-{attempt + 1}"
        done = (place / "report.html").exists()
        found = differences(folder / "whole", place) if done else [error]
        if kills:  # else it was too quick, and is no trial
            left -= 1
            yield f"{'; '.join(found) or 'equal'}: killed {', '.join(kills)}"


@pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")
def test_killed_at_random_moments(tmp_path):
    """Checkpoints so frequent that it is often killed while it writes one."""
    given = ("nadir_day/day-dipole", "--stop", "3000", "--checkpoint", "100", "--no-twin")
    found = list(trials(2, given, tmp_path, 1))
    assert [x for x in found if not x.startswith("equal")] == []


def main() -> None:
    """So many trials, by the seed that is given next (1)."""
    count, seed = (*map(int, sys.argv[1:]), 1)[:2]
    given = ("nadir_day/day-igrf", "--stop", "4000", "--checkpoint", "40", "--no-twin")
    equal = killed = 0
    with tempfile.TemporaryDirectory() as folder:
        for line in trials(count, given, Path(folder), seed):
            equal += line.startswith("equal")
            killed += line.count(" at ")
            print(line, flush=True)
    print(f"{equal} of {count} equal to the run without a break, killed {killed} times")


if __name__ == "__main__":
    main()
