"""Campaigns: the same rows whatever ran where and however often it was stopped; what
fails is kept with its reason; what comes out says how sure it is."""

from __future__ import annotations

import copy
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.special import ndtr
from scipy.stats import spearmanr

import desat
from desat.campaign import case as case_module
from desat.campaign import coordinator, judged, report, sampling, store
from desat.campaign import pairs as comparing
from desat.campaign import plan as plan_module
from desat.campaign.pairs import compare
from desat.campaign.plan import CampaignPlan
from desat.campaign.sampling import axes, draw_of
from desat.campaign.workers import Local, NoResult, results
from desat.engine.master import Master
from desat.runs import case as case_of_draft
from desat.runs import prepare as prepare_module
from desat.runs import progress
from desat.runs.cases import Cases, draft_to_draw
from desat.runs.prepare import prepare
from desat.runs.prepare import read as read_source
from desat.runs.run import simulate
from desat.system.errors import DesatError, Exit
from desat.system.options import Options
from tests.conftest import but
from tests.dying import dies_or_not
from tests.engine.test_failures import FAILURES, binary, drawn_to_fail  # noqa: F401

COUNT = 200
RATE = """
extends = "integrated/mil-nadir"
stop = 20.0
[numbers.rate]
title = "Rate at the end"
signal = "spacecraft.omega_bi_body"
measure = "norm_last"
unit = "deg/s"
"""
OWN_SCENARIO = f"""{RATE}
[requirements.load]
number = "coil_load"
max = 1000.0
[requirements.rate]
number = "rate"
min = 1.0
max = 2.0
"""


@pytest.fixture(scope="module")
def own_scenario(tmp_path_factory) -> Path:
    """A scenario file of a user's own."""
    path = tmp_path_factory.mktemp("own") / "mine.toml"
    path.write_text(OWN_SCENARIO)
    return path


@pytest.fixture(scope="module")
def full_campaign(own_scenario, tmp_path_factory) -> Path:
    """The folder of a campaign in one go, over two processes, made by a program."""
    folder = tmp_path_factory.mktemp("whole") / "campaign"
    keep = ["worst:1:coil_load", "every:150"]
    result = desat.cases(own_scenario, COUNT, folder, keep=keep, jobs=2)
    assert result["out.rate"].values.shape == (COUNT,)
    return folder


# --- processes ------------------------------------------------------------------------


def test_processes_that_die_lose_their_calls_alone():
    tasks = [(n, (n,)) for n in range(12)]
    with Local(dies_or_not, 2, limit=3.0) as workers:
        answers = dict(results(workers, tasks, lambda key, reason: ()))
    assert sorted(answers) == list(range(12))
    for number, result in answers.items():
        if number == 6:
            assert result == NoResult("it was not over within 3 s", timeout=True)
        elif number % 3 == 1:
            assert result == NoResult(f"its process ended by exit({number})")
        else:
            assert result == number**2


def test_a_process_that_ends_without_an_answer_is_lost():
    with Local(os._exit, 1, limit=3.0) as workers:
        answers = dict(results(workers, [(0, (0,))], lambda key, reason: ()))
    assert answers == {0: NoResult("its process ended by exit(0)")}


# --- sampling -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def system():
    return draft_to_draw(read_source("integrated/mil-nadir"), False)


@pytest.mark.parametrize("kind", ["latin-hypercube", "sobol", "saltelli"])
def test_samplings_fill_the_space_evenly(system, kind):
    """Of each element, exactly half of the cases lie below its median, where of 256
    random ones 8 more or less do."""
    width = sum(axes(system)[1]) + 2
    count = 16 * width if kind == "saltelli" else 256
    cases = [draw_of(system, 3, i, kind, count) for i in range(count)]
    assert cases[5] == draw_of(system, 3, 5, kind, count)
    assert cases[5] != draw_of(system, 4, 5, kind, count)
    momenta = np.array([c["wheels.h_start_wheel"] for c in cases])
    mean, _ = system.about.dispersions["wheels.h_start_wheel"].normal
    assert (momenta < mean).sum(axis=0).tolist() == [count // 2] * momenta.shape[1]
    attitudes = np.array([c["spacecraft.q_start_bi"] for c in cases])
    np.testing.assert_allclose(np.linalg.norm(attitudes, axis=1), 1.0, rtol=1e-12)
    assert len({c["determination.seed"] for c in cases}) == count


def test_latin_hypercube_has_one_case_in_each_stratum(system):
    draws = [draw_of(system, 1, i, "latin-hypercube", 50) for i in range(50)]
    cases = [x["wheels.h_start_wheel"] for x in draws]
    spec = system.about.dispersions["wheels.h_start_wheel"]
    mean, deviation = spec.normal
    low, high = ndtr((np.array(spec.within) - mean) / deviation)
    for element in np.array(cases).T:
        share = (ndtr((element - mean) / deviation) - low) / (high - low)
        assert sorted(np.floor(50 * share).astype(int)) == list(range(50))


def test_a_cut_normal_stays_within_and_leaves_the_other_draws_as_they_were(system):
    """Draw 33 of seed 1 has a wheel beyond its limit without the cut."""
    name = "wheels.h_start_wheel"
    dispersions = copy.deepcopy(system.about.written["dispersions"])
    del dispersions[name]["within"]
    free = copy.copy(system)
    free.about = but(system.about, dispersions=dispersions)
    cut_draws, full_campaign = (
        [draw_of(s, 1, i)[name] for i in range(100)] for s in (system, free)
    )
    changed_draws = [i for i in range(100) if cut_draws[i] != full_campaign[i]]
    assert changed_draws == [
        i for i in range(100) if max(map(abs, full_campaign[i])) > 0.02
    ]
    assert 33 in changed_draws
    assert np.abs(cut_draws).max() <= 0.02


@pytest.mark.parametrize(
    ("values", "share"),
    [
        ("{ uniform = [0.5, 2.0] }", lambda x: (x - 0.5) / 1.5),
        ("{ normal = [3.0, 2.0] }", lambda x: ndtr((x - 3.0) / 2.0)),
        (
            "{ normal = [3.0, 2.0], within = [2.0, 9.0] }",
            lambda x: (ndtr((x - 3.0) / 2.0) - ndtr(-0.5)) / (ndtr(3.0) - ndtr(-0.5)),
        ),
        ("{ signs = [1.0, 2.0, 3.0, 4.0] }", None),
    ],
)
def test_a_sampling_draws_what_a_dispersion_says(tmp_path, values, share):
    """One of 20 cases in each twentieth of the distribution; of signs, half of them."""
    path = tmp_path / "mine.toml"
    path.write_text(
        f'extends = "gyrostat/light"\n[dispersions]\n"wheels.h_start_wheel" = {values}\n'
    )
    draft = draft_to_draw(read_source(str(path)), False)
    cases = [
        draw_of(draft, 1, i, "latin-hypercube", 20)["wheels.h_start_wheel"]
        for i in range(20)
    ]
    for size, element in enumerate(np.array(cases).T, 1):
        if share is None:
            assert sorted(element) == [-size] * 10 + [size] * 10
        else:
            assert sorted(np.floor(20 * share(element)).astype(int)) == list(range(20))


def test_saltelli_has_its_own_counts():
    with pytest.raises(
        DesatError, match=r"saltelli: -n 100: with .* a power of two times"
    ) as error:
        coordinator.planned("integrated/mil-nadir", 100, sampling="saltelli")
    numbers, width, near = (
        int(x)
        for x in re.findall(r"with (\d+) .* (\d+), such as (\d+)", str(error.value))[0]
    )
    assert width == numbers + 2
    assert near == width * 2 ** round(np.log2(100 / width)), "the nearest power"


# --- rows -----------------------------------------------------------------------------


@pytest.mark.study
def test_a_campaign_of_two_hundred(full_campaign):
    table = store.read(full_campaign)
    assert table["case"].to_pylist() == list(range(COUNT))
    assert len(set(table["worker"].to_pylist())) == 2
    target = json.loads((full_campaign / "campaign.json").read_text())["target"]
    system = draft_to_draw(read_source(str(target)), False)
    row = table.slice(77, 1).to_pylist()[0]
    assert (
        row["in.wheels.h_start_wheel[3]"]
        == draw_of(system, 1, 77)["wheels.h_start_wheel"][2]
    )
    curves = store.read(full_campaign, store.CURVES)
    assert curves.num_rows == COUNT
    assert coordinator.status(full_campaign)["state"] == "done"


def test_a_case_is_the_draw_of_the_same_number(full_campaign, own_scenario, tmp_path):
    from desat.campaign.draws import one

    with pytest.raises(
        DesatError, match=r"mean_anomaly: it is sampled, and so never has this value"
    ):
        desat.cases(own_scenario, 2, tmp_path / "c", {"environment.mean_anomaly": 1.0})

    again = one(Cases(read_source(str(own_scenario))), Options(), 1, 123)
    row = store.read(full_campaign).slice(123, 1).to_pylist()[0]
    assert {k[4:]: v for k, v in row.items() if k.startswith("out.")} == again.numbers


def test_kept_cases_have_their_series(full_campaign):
    kept_numbers = {0, 150, *coordinator.worst(full_campaign, "coil_load", 1)}
    assert {int(p.name) for p in (full_campaign / "kept").iterdir()} == kept_numbers
    folder = coordinator.kept_in(full_campaign, 150)
    assert (folder / "report.html").exists()
    kept_value = json.loads((folder / "manifest.json").read_text())["numbers"][
        "coil_load"
    ]["value"]
    assert kept_value == store.read(full_campaign)["out.coil_load"][150].as_py()


@pytest.mark.study
def test_killed_head_and_killed_worker_lose_nothing(
    full_campaign, own_scenario, tmp_path
):
    """SIGKILL of a worker, then of the head, then once more to the end: the same data."""
    folder = tmp_path / "campaign"
    command = [
        sys.executable,
        "-m",
        "desat.cli",
        "campaign",
        str(own_scenario),
        "-n",
        "80",
        "--jobs",
        "2",
        "--out",
        str(folder),
    ]
    with subprocess.Popen(
        command, stderr=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        _until(lambda: _rows(folder) > 10)
        workers = _children(process.pid)
        os.kill(workers[-1], signal.SIGKILL)
        before = _rows(folder)
        _until(lambda: _rows(folder) > before + 10)
        process.kill()
        process.communicate()
    _until(lambda: not any(map(_there, workers)))
    assert coordinator.status(folder)["state"] == "killed"
    assert before < _rows(folder) < 80
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert result.returncode in (Exit.UNMET, Exit.COMPONENT), result.stderr
    _first_alike(folder, full_campaign, 80)


def _rows(folder: Path) -> int:
    return sum(
        path.read_text().count("\n") for path in (folder / "cases").glob("*.jsonl")
    )


def _until(condition) -> None:
    end = time.monotonic() + 120
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.1)


def _children(pid: int) -> list[int]:
    text = Path(f"/proc/{pid}/task/{pid}/children")
    children = [
        int(p)
        for t in text.parent.parent.iterdir()
        for p in (t / "children").read_text().split()
    ]
    return [
        p for p in children if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()
    ]


def _there(pid: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().split()[2]
    except FileNotFoundError:
        return False


def test_a_dask_cluster_gives_the_same(full_campaign, own_scenario, tmp_path):
    pytest.importorskip("distributed", reason="Dask is not installed")
    folder = tmp_path / "campaign"
    script = (
        f"from desat.campaign import coordinator as head\nfrom pathlib import Path\n"
        f"if __name__ == '__main__':\n"
        f"    plan, _ = head.planned({str(own_scenario)!r}, 40)\n"
        f"    where = Path({str(folder)!r})\n"
        f"    head.run(plan, where, cluster='local:2', progress=False)\n"
    )
    path = tmp_path / "run.py"
    path.write_text(script)
    subprocess.run([sys.executable, path], check=True, timeout=300, capture_output=True)
    _first_alike(folder, full_campaign, 40)


WORKER = """
import importlib.metadata as metadata, pathlib, sys, time
version, come = sys.argv[1:3]
known = metadata.version
metadata.version = lambda name: version or known(name) if name == "desat" else known(name)
from distributed.cli.dask_worker import main
while not pathlib.Path(come).exists():
    time.sleep(0.02)
main(sys.argv[3:])
"""
"""A worker, perhaps of another version, that is ready and comes as soon as there is a
file."""


def test_a_worker_says_why_it_cannot_make_the_cases(own_scenario):
    from desat.campaign import cluster

    plan, _ = coordinator.planned(str(own_scenario), 4)
    here = cluster.versions()
    assert cluster.unfit(plan, False, here) == ""
    numpy = f"has numpy {here['numpy']}, here it is 0.1; the same is needed"
    assert cluster.unfit(plan, False, {**here, "numpy": "0.1"}) == numpy
    assert cluster.unfit(plan, True, here) == "has not got the system"
    cluster.keep(plan, cluster.shipped(plan.target))
    assert cluster.unfit(plan, True, here) == ""
    other = cluster.unfit(replace(plan, digest="0"), False, here)
    assert (
        other
        == f"has another {own_scenario}: its wiring, times, content, parameters or FMUs differ"
    )


def test_a_packed_system_has_the_same_case_on_a_worker(
    own_scenario, full_campaign, tmp_path
):
    from desat.campaign import cluster
    from desat.export.packing import pack_scenario
    from desat.files.scenario import read_foreign as scenario

    file = pack_scenario(
        scenario(own_scenario), tmp_path / "mine.ssp", force=True, fmus="native"
    )
    plan, _ = coordinator.planned(str(file), 4)
    cluster.keep(plan, cluster.shipped(plan.target))
    file.unlink()
    result = cluster.on_worker(plan, True, cluster.versions(), (3,), 1, "")
    row = store.read(full_campaign).slice(3, 1).to_pylist()[0]
    [answer] = map(json.loads, result.lines)
    assert answer["numbers"] == {
        k[4:]: v for k, v in row.items() if k.startswith("out.")
    }


@pytest.mark.study
def test_clusters_that_do_not_serve(
    own_scenario, full_campaign, tmp_path, monkeypatch, capfd
):
    """One that does not answer, one without workers, one whose worker has another
    version: from the beginning, and when it comes in the middle, where it costs
    nothing; one that ends."""
    pytest.importorskip("distributed", reason="Dask is not installed")
    from desat.campaign import cluster

    plan, _ = coordinator.planned(str(own_scenario), 20)
    monkeypatch.setitem(cluster.SETTINGS, "distributed.comm.timeouts.connect", "4s")
    with monkeypatch.context() as patch:
        patch.setattr(cluster, "WAIT", "1s")
        text = r"--cluster tcp://127\.0\.0\.1:9: no scheduler answers"
        with pytest.raises(DesatError, match=text):
            coordinator.run(
                plan, tmp_path / "a", cluster="tcp://127.0.0.1:9", progress=False
            )
    (tmp_path / "worker.py").write_text(WORKER)
    file, early, good, late = (
        tmp_path / n for n in ("scheduler.json", "early", "good", "late")
    )
    of = ["--scheduler-file", file, "--no-dashboard"]
    worker = [sys.executable, tmp_path / "worker.py"]
    alone = [*of, "--no-nanny", "--nthreads", "1"]
    # all at once: to import what they need takes longest
    with (
        _start(
            sys.executable,
            "-m",
            "distributed.cli.dask_scheduler",
            "--port",
            "0",
            "--host",
            "127.0.0.1",
            *of,
        ) as scheduler,
        _start(*worker, "0.0.9", early, *alone) as first,
        _start(*worker, "", good, *alone),
        _start(*worker, "0.0.9", late, *alone) as older,
    ):
        _until(file.exists)
        with pytest.raises(DesatError, match="it has no workers"):
            coordinator.run(plan, tmp_path / "b", cluster=str(file), progress=False)
        from distributed import Client

        with Client(scheduler_file=str(file)) as client:
            early.touch()
            client.wait_for_workers(1, timeout=60)
            with pytest.raises(
                DesatError, match=r"has desat 0\.0\.9, here it is .*the same"
            ):
                coordinator.run(plan, tmp_path / "c", cluster=str(file), progress=False)
            first.kill()
            _until(lambda: not client.nthreads())
            good.touch()
            client.wait_for_workers(1, timeout=60)
            add = store.Store.add

            def later(self: store.Store, batch: store.Batch) -> list[store.CaseRow]:
                result = add(self, batch)
                if self.done() >= 5 and not late.exists():
                    late.touch()
                    client.wait_for_workers(2, timeout=60)
                elif self.done() >= 25 and scheduler.poll() is None:
                    client.close()
                    scheduler.kill()
                return result

            monkeypatch.setattr(store.Store, "add", later)
            coordinator.run(plan, tmp_path / "c", cluster=str(file), progress=False)
            older.wait(60)
            plan, _ = coordinator.planned(str(own_scenario), 40)
            with pytest.raises(
                DesatError, match="the scheduler is gone; the same command"
            ):
                coordinator.run(plan, tmp_path / "c", cluster=str(file), progress=False)
    assert capfd.readouterr().err.count("has desat 0.0.9") == 1
    there = store.read(tmp_path / "c")
    assert there["case"].to_pylist()[:20] == [*range(20)]
    assert (
        25 <= there.num_rows == store.read(tmp_path / "c", store.CURVES).num_rows < 40
    )
    _first_alike(tmp_path / "c", full_campaign, 20, there.num_rows)
    assert set(there["attempts"].to_pylist()) == {1}


@contextmanager
def _start(*command: object) -> Iterator[subprocess.Popen[bytes]]:
    """A process for as long as it is needed."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen([*map(str, command)], **quiet) as process:
        try:
            yield process
        finally:
            process.kill()


def _first_alike(
    folder: Path, full_campaign: Path, count: int, of: int | None = None
) -> None:
    """The first cases of a campaign are so many of the other, bit for bit, rows and
    curves; `of`: how many it has (default: these)."""
    for kind in (store.CASES, store.CURVES):
        mine, theirs = (
            store.read(folder, kind),
            store.read(full_campaign, kind).slice(0, count),
        )
        assert mine.num_rows == (of or count)
        mine = mine.slice(0, count)
        names = [n for n in theirs.column_names if n not in store.BOOKKEEPING]
        # as texts, of which that of a float is all of it: nan is not equal to itself
        assert str(mine.select(names).to_pydict()) == str(
            theirs.select(names).to_pydict()
        )


def test_crashes_and_hangs_leave_a_complete_dataset(tmp_path, binary):  # noqa: F811
    ways = ["NOTHING"] * 7 + ["SEGFAULT", "EXIT_0", "HANG", "STEP_ERROR"]
    system = drawn_to_fail(tmp_path / "s", binary, ways)
    plan, _ = coordinator.planned(system, 30, options=Options(step=1.0), limit=1.5)
    folder = tmp_path / "campaign"
    coordinator.run(plan, folder, 2, progress=False)
    rows = store.read(folder).to_pylist()
    assert [r["case"] for r in rows] == list(range(30))
    by = {FAILURES[r["in.bad.how"]]: r for r in rows}
    assert set(by) == set(ways)
    text = "bad: the step from t = 3 s"
    assert by["NOTHING"]["status"] == "completed"
    assert by["NOTHING"]["out.y"] == 10.0
    assert by["SEGFAULT"]["message"].startswith(f"{text} ended its process: SIGSEGV")
    assert by["EXIT_0"]["message"].startswith(f"{text} ended its process: exit(0)")
    assert "did not return within 1.5 s" in by["HANG"]["message"]
    assert by["HANG"]["attempts"] == 2
    summary_value = report.summary(folder).to_json()
    assert summary_value["completed"] + len(summary_value["failed"]) == 30
    assert (
        summary_value["failed"][0]["command"]
        == f"desat campaign case {folder} {summary_value['failed'][0]['case']}"
    )


def test_daemons_do_not_outlive_a_campaign(tmp_path, binary, apart, daemons):  # noqa: F811
    """They held the pipes of whoever called: this waits for their end."""
    system = drawn_to_fail(tmp_path / "s", binary, ["DAEMON"])
    command = apart(
        "campaign",
        system,
        "-n",
        "3",
        "--step",
        "1",
        "--jobs",
        "2",
        "--out",
        str(tmp_path / "campaign"),
    )
    assert command.returncode == Exit.COMPLETED, command.stderr
    assert [r["status"] for r in store.read(tmp_path / "campaign").to_pylist()] == [
        "completed"
    ] * 3
    assert daemons() == []


# --- what comes out -------------------------------------------------------------------


def test_requirements_are_judged_with_their_confidence(full_campaign):
    answer = json.loads((full_campaign / "report.json").read_text())
    load, rate = answer["requirements"]["load"], answer["requirements"]["rate"]
    completed_count = answer["completed"]
    assert load["within"] == completed_count
    assert load["lacking"] == 0
    assert (
        answer["requirements"]["pointing"]["lacking"] == completed_count
    )  # it is over before
    assert load["met"] == (
        completed_count >= 195
    )  # 196 of 200 show 95 % within with 95 % confidence
    assert not rate["met"]
    values = [
        v for v in store.read(full_campaign)["out.rate"].to_pylist() if v is not None
    ]
    assert rate["within"] == sum(1.0 <= v <= 2.0 for v in values)
    assert rate["cases_outside"]
    low, high = rate["interval_outside"]
    assert low < rate["share_outside"] < high or rate["share_outside"] in (0.0, 100.0)
    text = (full_campaign / "report.html").read_text()
    assert "NOT SHOWN" in text
    assert "<b>Not shown to hold; " in text
    assert "% are asked, with a confidence of" in text
    assert text.count("<svg") >= len(answer["numbers"]) / 2
    largest = np.nanmax(
        store.read(full_campaign, store.CURVES)["momentum"].to_pylist(), axis=1
    )
    for case in np.argsort(-largest, kind="stable")[:3]:
        assert report.rerun(full_campaign, int(case)) in text, (
            "the worst of the percentile curves"
        )
    assert (
        answer["numbers"]["rate"]["unit"]
        == answer["requirements"]["rate"]["unit"]
        == "deg/s"
    )
    of_analyses = {
        "null_rms": "N.m.s",
        "coil_duty": "%",
        "limit_time": "s",
        "crossings": "1",
    }
    assert {n: answer["numbers"][n]["unit"] for n in of_analyses} == of_analyses
    assert answer["numbers"]["coil_duty"]["title"].startswith(
        "Coil duty: mean dipole of the coils"
    )
    assert answer["digest"] == store.digest(full_campaign)


def test_more_cases_show_a_requirement():
    """59 cases without one outside show 95 % with 95 %, 93 with one: known of order
    statistics."""
    assert judged.more(50, 50, 0.95, 0.95) == 9
    assert judged.more(59, 59, 0.95, 0.95) == 0
    assert judged.more(92, 91, 0.95, 0.95) == 1
    assert judged.more(100, 95, 0.95, 0.95) is None


def test_progress_is_a_line_where_nobody_looks(capsys, monkeypatch):
    monkeypatch.setattr(progress, "MINUTE", 0.0)
    with progress.progress("cases", 40, True, 11) as tell:
        time.sleep(0.05)
        tell(31, "2 failed")
    line = capsys.readouterr().err
    assert re.fullmatch(r"cases: 78 % done, 2 failed, 0 s left\n", line), line
    with progress.progress("cases", 40, False) as tell:
        tell(31, "")
    assert capsys.readouterr().err == ""


def test_what_drives_a_number_is_named():
    """A number that falls with one of two inputs, and one that neither drives."""
    rng = np.random.default_rng(1)
    a, b, c = rng.normal(size=(3, 400))
    a[7] = np.nan
    (driver,) = report._drivers({"a": a, "b": b}, {"falls": -np.exp(a), "other": c})
    assert (driver.input, driver.number, driver.n) == ("a", "falls", 399)
    assert driver.correlation == pytest.approx(-1.0, abs=1e-12)


def test_a_flag_drives_a_number_and_what_does_not_change_drives_none():
    flag = np.arange(40.0) % 2.0
    inputs = {"flag": flag, "same": np.ones(40)}
    (driver,) = report._drivers(
        inputs, {"jumps": flag + 1e-3 * np.arange(40.0), "never": 0.0 * flag}
    )
    assert (driver.input, driver.number) == ("flag", "jumps")


def test_what_one_of_many_inputs_does_by_chance_is_not_named():
    """A correlation that one pair in a hundred would have by chance, alone and of ten
    inputs."""
    rng = np.random.default_rng(3)
    a = rng.normal(size=150)
    y = 0.25 * a + rng.normal(size=150)
    of = spearmanr(a, y)
    assert of.statistic > 0.2
    assert 0.001 < of.pvalue < 0.01
    (driver,) = report._drivers({"a": a}, {"y": y})
    assert driver.correlation == pytest.approx(of.statistic, rel=1e-12)
    others = {f"c{k}": np.zeros(150) for k in range(9)}
    assert report._drivers({"a": a, **others}, {"y": y}) == []


def test_sobol_indices_of_a_linear_function(system):
    """Of y = 2 u + v, u and v even over (0, 1): 4/5 and 1/5 of its variance, the others
    none."""
    names, sizes = axes(system)
    count = 256 * (sum(sizes) + 2)
    plan, _ = coordinator.planned("integrated/mil-nadir", count, sampling="saltelli")
    points = sampling._points("saltelli", plan.seed, count, tuple(names), tuple(sizes))
    y = np.array([2.0 * points(i)[0] + points(i)[1] for i in range(count)])
    every = np.ones(count, bool)
    first = [e["first"] for e in report._sobol(plan, y, every, {"y": y})["y"].values()]
    assert first == pytest.approx([0.8, 0.2] + [0.0] * (sum(sizes) - 2), abs=0.02)
    cases = np.arange(count)
    apart = report._apart(plan, cases)
    assert apart.sum() == 2 * 256
    alone = np.array([points(i) for i in cases[apart]])
    assert all(len(np.unique(column)) == len(column) for column in alone.T), (
        "they share no value"
    )
    few = replace(plan, count=32 * (sum(sizes) + 2))
    some = slice(few.count)
    answer = report._sobol(few, cases[some], every[some], {"y": y[some]})
    assert answer == {"missing": f"they need -n {2 * few.count} or more"}
    every[0] = False
    assert report._sobol(plan, y, every, {"y": y}) == {
        "missing": "they need every case completed"
    }


def test_campaigns_are_compared_case_by_case(full_campaign, own_scenario, tmp_path):
    other = own_scenario.with_name("other.toml")
    other.write_text(
        f'extends = "{own_scenario.stem}"\nparameters.manager.torque_limit = 2e-5\n'
    )
    folder = tmp_path / "campaign"
    plan, _ = coordinator.planned(str(other), 30)
    coordinator.run(plan, folder, 2, progress=False)
    comparison = compare(full_campaign, folder).to_json()
    entry = comparison["numbers"]["coil_load"]
    assert comparison["pairs"] == entry["n"] <= 30
    assert comparison["warnings"] == []
    longer = replace(coordinator.read(full_campaign), options=Options(stop=40.0))
    text = "the first runs until 40 s, the second until 20 s"
    assert comparing._warnings(longer, coordinator.read(folder)) == [text]
    assert entry["unit"] == "%"
    assert entry["lower"] + entry["higher"] + entry["equal"] == entry["n"]
    assert entry["interval"][0] <= entry["median"] <= entry["interval"][1]
    a, b = (
        store.read(f)["out.coil_load"].to_pylist()[:30] for f in (full_campaign, folder)
    )
    differences = [
        x - y for x, y in zip(a, b, strict=True) if x is not None and y is not None
    ]
    assert entry["median"] == pytest.approx(float(np.median(differences)), rel=1e-9)
    plan, _ = coordinator.planned(str(other), 3, seed=2)
    coordinator.run(plan, tmp_path / "seed", 1, progress=False)
    with pytest.raises(DesatError, match="seed is 1 and 2; pairs need the same"):
        compare(full_campaign, tmp_path / "seed")
    path = folder / store.NUMBERS
    path.write_text(path.read_text().replace("deg/s", "rad/s"))
    with pytest.raises(
        DesatError, match=r"rate is in deg/s and in rad/s; pairs need the same"
    ):
        compare(full_campaign, folder)


# --- wrong input ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("more", "text"),
    [
        (
            '[requirements.a]\nnumber = "nothing"\nmax = 1.0',
            "a.number: no number nothing",
        ),
        (
            '[requirements.a]\nnumber = "coil_load"',
            "requirements.a: max or min is needed",
        ),
        (
            '[requirements.a]\nnumber = "coil_load"\nmax = 1.0\nmin = 2.0',
            "it is above max",
        ),
        (
            '[requirements.a]\nnumber = "coil_load"\nmaximum = 1.0',
            "requirements.a.maximum",
        ),
        (
            '[dispersions]\n"wheels.h_start_wheel" = { normal = [0.0, -1.0] }',
            "deviation is -1; at",
        ),
        (
            '[dispersions]\n"wheels.nothing" = { uniform = [0.0, 1.0] }',
            "dispersions.wheels.nothing: wheels has no parameter nothing; there is",
        ),
        (
            '[dispersions]\n"wheels.speed_limit" = { uniform = [-2.0, -1.0] }',
            "mine.toml: dispersions.wheels.speed_limit: wheels.speed_limit = -1.76943 rad/s: allowed "
            "is 0.001 to",
        ),
    ],
)
def test_what_nothing_can_meet_or_draw(tmp_path, more, text):
    path = tmp_path / "mine.toml"
    path.write_text(f'extends = "integrated/mil-nadir"\n{more}\n')
    with pytest.raises(DesatError) as error:
        coordinator.planned(str(path), 5)
    assert text in str(error.value)
    assert str(error.value).startswith(str(path))


def test_a_folder_has_one_campaign(full_campaign, own_scenario, tmp_path):
    plan, _ = coordinator.planned(str(own_scenario), COUNT, seed=7)
    with pytest.raises(DesatError, match="another campaign: seed is 1 there, 7 here"):
        coordinator.run(plan, full_campaign, 1, progress=False)
    (tmp_path / "letter.txt").write_text("x")
    with pytest.raises(DesatError, match="it has other files, and no campaign"):
        coordinator.run(plan, tmp_path, 1, progress=False)
    assert coordinator.status(full_campaign)["done"] == COUNT


def test_damaged_files_and_a_changed_system_are_said(
    full_campaign, own_scenario, tmp_path, desat
):
    """Nothing is read that is not whole, and no case is made of another system than its
    row."""
    folder = tmp_path / "campaign"
    shutil.copytree(full_campaign, folder, ignore=shutil.ignore_patterns("kept"))
    mine = own_scenario.with_name("changed.toml")
    mine.write_text(OWN_SCENARIO)
    plan = json.loads((folder / "campaign.json").read_text()) | {"target": str(mine)}
    (folder / "campaign.json").write_text(json.dumps(plan))
    mine.write_text(OWN_SCENARIO.replace("stop = 20.0", "stop = 30.0"))
    outcome = desat("campaign", "case", str(folder), "3")
    assert outcome.returncode == Exit.INPUT
    assert "changed.toml is not what it was when the campaign began" in outcome.stderr
    assert not (folder / "kept").exists()
    for name, text in {
        "cases/part-00000.parquet": f"without {folder}/cases/part-00000.parquet the same command",
        "curves/part-00000.parquet": f"without {folder}/cases/part-00000.parquet the same command",
        "numbers.json": "damaged (",
        "status.json": "damaged (",
        "campaign.json": "damaged (",
    }.items():
        file = folder / name
        whole_file = file.read_bytes()
        file.write_bytes(whole_file[: len(whole_file) // 2])
        outcome = desat(
            "campaign", "status" if name == "status.json" else "report", str(folder)
        )
        assert outcome.returncode == Exit.INPUT, outcome.stderr
        assert outcome.stderr.startswith(f"error: {file}: damaged ("), outcome.stderr
        assert text in outcome.stderr
        assert outcome.stderr.count("\n") == 1
        file.write_bytes(whole_file)
    (folder / "campaign.json").write_text(json.dumps(plan | {"count": "200"}))
    assert "damaged (count is '200')" in desat("campaign", "status", str(folder)).stderr
    (folder / "campaign.json").write_text(
        json.dumps(plan | {"keep": ["worst:3:bound"]})
    )
    lines = coordinator.unreached(coordinator.read(folder), folder)
    assert lines == [
        "--keep worst:3:bound: no case has a number bound: nothing is kept by it"
    ]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (("integrated/mil-nadir", "--keep", "worst:3"), "--keep worst:3: no number"),
        (("integrated/mil-nadir", "--curve", "momentun"), "did you mean momentum?"),
        (("integrated/mil-nadir", "--sampling", "sobl"), "did you mean sobol?"),
        (
            ("integrated/mil-nadir", "--by", "rate"),
            "--by rate: it goes with --keep worst:N",
        ),
        (("plant/light",), "no [dispersions]"),
        (("integrated/mil-nadir", "--cluster", "local:x"), "local:N is needed"),
        (
            ("integrated/mil-nadir", "--cluster", "none.json"),
            "no such file, and no address",
        ),
    ],
)
def test_wrong_words_are_one_line(desat, tmp_path, arguments, text):
    result = desat("campaign", *arguments, "-n", "4", "--out", str(tmp_path / "c"))
    assert result.returncode == Exit.INPUT
    assert text in result.stderr
    lines = [
        x for x in result.stderr.splitlines() if not x.startswith("warning: ")
    ]  # of jitter
    assert len(lines) == 1, result.stderr


def test_a_campaign_is_a_data_set(full_campaign, tmp_path):
    ds = desat.load(full_campaign)
    table = store.read(full_campaign)
    assert ds.sizes["case"] == COUNT
    rates = [np.nan if v is None else v for v in table["out.rate"].to_pylist()]
    np.testing.assert_array_equal(ds["out.rate"].values, rates)
    assert ds["out.rate"].attrs["units"] == "deg/s"
    assert ds["status"][3].item() == table["status"][3].as_py()
    assert len(ds.to_dataframe()) == COUNT
    ds.to_netcdf(tmp_path / "cases.nc")
    assert xr.open_dataset(tmp_path / "cases.nc").equals(ds.load())
    curves = desat.load(full_campaign, curves=True)
    assert curves["curve.momentum"].shape == (COUNT, 200)
    assert ds["in.wheels.h_start_wheel[1]"].attrs["units"] == "N.m.s"
    assert curves["curve.momentum"].attrs["units"] == "mN.m.s"
    assert np.isfinite(curves["curve.momentum"].values).all(), (
        "parts without a sample are between some"
    )
    assert ds["in.wheels.h_start_wheel[1]"].sel(case=9).item() == (
        table["in.wheels.h_start_wheel[1]"][9].as_py()
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "call",
    [
        "cases(name, 4, sys.argv[1], stop=20.0, jobs=2)",
        "draws(name, 4, stop=20.0, jobs=2)",
    ],
)
def test_a_script_without_a_guard_is_told_so(tmp_path, call):
    """Its processes import it first, and would start processes themselves: all cases
    failed, for "its process ended by exit(1)"."""
    script = tmp_path / "script.py"
    script.write_text(
        f"import sys, desat\nname = 'integrated/mil-nadir'\ndesat.{call}\n"
    )
    script_run = subprocess.run(
        [sys.executable, str(script), str(tmp_path / "campaign")],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert script_run.returncode == 1
    assert script_run.stderr.count("Traceback") == 1
    assert (
        'needs `if __name__ == "__main__":` before it does'
        in script_run.stderr.splitlines()[-1]
    )
    cases = tmp_path / "campaign" / "cases"
    assert not cases.exists() or not any(cases.iterdir())


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("alsat1/basin-y-wheel", ""),
        ("hausat2/start-up-ours", ""),
        ("integrated/mil-nadir", ""),
        ("nadir_day/day-igrf", ""),
        ("space_telescope/ours-nominal", ""),
        ("uosat12/robust-ocdc-nominal", ""),
        # of a shared value, of one that others follow, and of one that a number names
        ("nadir_day/day-dipole", '"shared.inertia_wheel" = { uniform = [5e-4, 7e-4] }'),
        ("nadir_day/day-dipole", '"torquers.m_limit" = { uniform = [1.0, 4.0] }'),
        ("integrated/mil-nadir", '"wheels.speed_limit" = { uniform = [500.0, 600.0] }'),
        # of one that is refused in some
        ("nadir_day/day-dipole", '"torquers.lag" = { uniform = [-0.1, 0.1] }'),
    ],
)
def test_a_case_that_changes_values_alone_is_the_case_prepared_anew(
    tmp_path, monkeypatch, name, more
):
    """A worker resolves and checks its system once."""
    own_scenario = tmp_path / "own.toml"
    own_scenario.write_text(
        f'extends = "{name}"\nstop = 100.0\n'
        + (f"[dispersions]\n{more}\n" if more else "")
    )
    plan = CampaignPlan(str(own_scenario), "", 5)
    rows = []
    anew = lambda cases, options: prepare(cases.scenario, options)  # noqa: E731
    for result in (Cases.prepare, anew):
        monkeypatch.setattr(Cases, "prepare", result)
        rows.append([replace(case_module.row(plan, n), seconds=0.0) for n in range(5)])
    assert rows[0] == rows[1]
    if "lag" in more:
        assert {row.code for row in rows[0]} == {0, 2}


@pytest.mark.parametrize(
    ("name", "more"),
    [
        ("alsat1/basin-y-wheel", ""),
        ("hausat2/start-up-ours", ""),
        ("integrated/mil-nadir", ""),
        ("nadir_day/day-igrf", ""),
        ("nadir_day/day-dipole", "substeps = 4"),
        ("nadir_day/day-dipole", 'substeps = "auto"'),
        ("space_telescope/ours-nominal", ""),
        ("uosat12/robust-ocdc-nominal", ""),
    ],
)
def test_a_master_that_begins_anew_makes_the_bits_of_a_new_one(
    tmp_path, monkeypatch, name, more
):
    """Every series, not the numbers alone; a worker makes one master for all its cases."""
    own_scenario = tmp_path / "own.toml"
    own_scenario.write_text(f'extends = "{name}"\nstop = 100.0\n{more}\n')
    source = prepare_module.read(str(own_scenario))
    system, result, runs = draft_to_draw(source, False), [], {}
    init = Master.__init__
    monkeypatch.setattr(
        Master, "__init__", lambda *a, **k: result.append(1) or init(*a, **k)
    )
    cases = Cases(source)
    anew = lambda options: prepare(source, options)  # noqa: E731
    for prepare_case in (cases.prepare, anew):
        if prepare_case is anew:
            # not where others follow what is drawn; "auto" makes some to try
            assert len(result) == 1 or "telescope" in name or "auto" in more
        for draw in range(3):
            options = Options(values=draw_of(system, 1, draw))
            run = simulate(prepare_case(options))
            assert run.manifest.completed, run.manifest.message
            results = run.results
            series = {n: results.values(n).tobytes() for n in results.names()}
            runs[prepare_case is anew, draw] = (
                series,
                run.manifest.numbers,
                run.manifest.balance,
            )
    for draw in range(3):
        assert runs[False, draw] == runs[True, draw]
    assert runs[True, 0][0] != runs[True, 1][0]


def test_a_worker_prepares_once(monkeypatch):
    results = []
    complete = case_of_draft.complete
    monkeypatch.setattr(
        case_of_draft, "complete", lambda draft: results.append(1) or complete(draft)
    )
    plan = CampaignPlan("alsat1/basin-y-wheel", "", 5, options=Options(stop=600.0))
    plan_module._cases.cache_clear()
    for n in range(5):
        assert case_module.row(plan, n).code == 0
    assert len(results) == 1


def test_a_worker_takes_one_thread_of_products_unless_told():
    """Threads that wait for the next product took a quarter of a day's CPU."""
    with Local(os.getenv, 1) as workers:
        answers = dict(
            results(workers, [(0, ("OPENBLAS_NUM_THREADS",))], lambda key, reason: ())
        )
    assert answers == {0: os.environ.get("OPENBLAS_NUM_THREADS", "1")}
