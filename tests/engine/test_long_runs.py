"""Long flights: rows in blocks, files with some rows and extremes, and bounded memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from desat.engine.recording import series_file
from desat.engine.recording.results import Results
from desat.figures.plots import keep_derived_lines, lines_of
from desat.language.scenario import Plot
from desat.numbers import derived, shapes
from desat.runs import validation
from desat.runs.run import prepare, simulate
from desat.system.errors import Exit
from desat.system.options import Options

POINTING = ("spacecraft.q_bi", "guidance.q_ref_bi")
TARGETS = ("nadir_day/day-dipole", "alsat1/firing-ours", "uosat12/fig2-ccpl-1")


@pytest.mark.parametrize("target", TARGETS)
def test_blocks_of_rows_give_the_numbers_of_all(monkeypatch, target):
    """The sums differ by their rounding; what is found at a row is the same."""
    case = prepare(target, Options(stop=900.0))
    full = simulate(case)
    monkeypatch.setattr(derived, "BLOCK", 101)
    in_blocks = simulate(case)
    assert in_blocks.manifest.warnings == full.manifest.warnings
    assert in_blocks.manifest.unmet == full.manifest.unmet
    assert in_blocks.manifest.numbers.keys() == full.manifest.numbers.keys()
    for name, number in full.manifest.numbers.items():
        value = in_blocks.manifest.numbers[name].value
        close = None if number.value is None else pytest.approx(number.value, rel=1e-9)
        # balances are differences of rounding errors
        if number.value is None or abs(number.value) > 1e-12:
            assert value == close, name


def test_a_series_reads_its_rows_as_an_array_has_them():
    run = simulate(prepare(TARGETS[0], Options(stop=60.0)))
    name = "wheels.h_wheel"
    values, series = run.results.values(name), run.results.series(name)
    assert len(series) == len(values)
    assert np.array_equal(series, values)
    assert np.array_equal(series[3:9], values[3:9])
    assert np.array_equal(series[-1], values[-1])
    assert series[-1, 2] == values[-1, 2]
    assert np.array_equal(2.0 * series, 2.0 * values)
    assert series.shape == values.shape
    some = np.arange(len(values)) % 7 == 0
    assert np.array_equal(series.at(some)[1:], values[some][1:])
    assert np.array_equal(series.head(5).at(np.array([False, True])), values[1:2])
    two = np.array([True, False, True, False])
    assert np.array_equal(run.results.series(name, two), values[:, two])
    scalar = run.results.series("environment.sunlight", slice(None))
    assert scalar[:4].shape == (4, 1)


@pytest.fixture(scope="module")
def pair_of_files(tmp_path_factory) -> tuple[Results, Results, dict[str, object]]:
    """All rows of a run, its shortened file, and the numbers of both."""
    folder = tmp_path_factory.mktemp("long")
    case = prepare(TARGETS[1], Options(stop=500.0))
    with pytest.MonkeyPatch.context() as patch:
        full = simulate(case, folder / "whole")
        patch.setattr(validation, "LONG", 400)
        patch.setattr(validation, "KEPT_ROWS", 30)
        short = replace(case, options=replace(case.options, shortens=True))
        run = simulate(short, folder / "short")
    numbers = {
        name: (x, full.manifest.numbers[name])
        for name, x in run.manifest.numbers.items()
    }
    run.write_report()
    text = (folder / "short" / "report.html").read_text(encoding="utf-8")
    assert f"one row of {run.results.every}, with minimum, maximum and mean" in text
    return full.results, Results.open(folder / "short"), numbers


def test_a_shortened_file_has_rows_and_extremes(pair_of_files):
    all_rows, short, numbers = pair_of_files
    every = short.every
    assert every == -(-(len(all_rows.times()) - 1) // 30)
    assert all_rows.every == 1
    assert all_rows.extremes("wheels.h_wheel") is None
    assert all(a == b for a, b in numbers.values())
    assert short.names() == all_rows.names()
    for name in short.names():
        rows = all_rows.values(name)
        assert np.array_equal(short.values(name), rows[::every]), name
        least, most = short.extremes(name)
        firsts = range(0, len(rows), every)
        assert np.array_equal(least, [rows[k : k + every].min(axis=0) for k in firsts])
        assert np.array_equal(most, [rows[k : k + every].max(axis=0) for k in firsts])


def test_what_is_said_of_thinned_rows(tmp_path, pair_of_files):
    all_rows, short, _ = pair_of_files
    assert validation.describe_kept(all_rows) == ""
    assert "minimum, maximum and mean" in validation.describe_kept(short)
    run = simulate(prepare(TARGETS[0], Options(stop=60.0, every=20)), tmp_path / "run")
    text = " (one row of 20; numbers are of all rows)"
    assert validation.describe_kept(run.results) == text


def test_a_plot_of_a_shortened_file_has_all_extremes(pair_of_files):
    all_rows, short, _ = pair_of_files
    plot = Plot(title="t", signals=("thrusters.tau_mean_thruster_body",))
    for line, full in zip(
        lines_of(plot, short, "N.m"), lines_of(plot, all_rows, "N.m"), strict=True
    ):
        assert (line.values.min(), line.values.max()) == (
            full.values.min(),
            full.values.max(),
        )
        assert (np.diff(line.times) > 0.0).all()
        assert line.rows >= len(full.values)


def test_what_a_plot_derives_is_of_all_rows_before_a_file_is_shortened(tmp_path):
    case = prepare(TARGETS[0], Options(stop=500.0, shortens=True))
    plots = {"error": Plot(title="e", derive="pointing", signals=POINTING)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(validation, "LONG", 400)
        patch.setattr(validation, "KEPT_ROWS", 30)
        full = simulate(case)
        (line,) = lines_of(plots["error"], full.results, "deg")
        run = simulate(case, tmp_path / "short")
        before = simulate(replace(case, options=Options(stop=500.0)), tmp_path / "all")
        keep_derived_lines(plots, before.results, before.manifest.parameters)
        before.results.thin(17, extremes=True)
    (after,) = lines_of(plots["error"], before.results, "deg")
    assert np.array_equal(after.values, line.values)
    assert run.results.every == 17


def test_a_long_line_has_the_extremes_of_its_parts(monkeypatch):
    monkeypatch.setattr(shapes, "LONG", 1000)
    monkeypatch.setattr(shapes, "PARTS", 50)
    monkeypatch.setattr(shapes, "BLOCK", 64)
    times = np.arange(3000.0)
    values = np.random.default_rng(5).normal(size=(3000, 2))
    x, y, rows = shapes.shape_of(times, values.__getitem__)
    assert (len(x), y.shape, rows) == (100, (100, 2), 3000)
    assert (np.diff(x) > 0.0).all()
    _, starts = shapes.split(times, 50)
    for part, (begin, end) in enumerate(zip(starts, [*starts[1:], 3000], strict=True)):
        pair = np.sort(y[2 * part : 2 * part + 2], axis=0)
        assert np.array_equal(pair[0], values[begin:end].min(axis=0))
        assert np.array_equal(pair[1], values[begin:end].max(axis=0))


def test_without_room_for_both_the_file_keeps_all_rows(tmp_path, monkeypatch):
    monkeypatch.setattr(validation, "LONG", 40)
    monkeypatch.setattr(validation, "KEPT_ROWS", 10)
    monkeypatch.setattr(series_file.Packing, "leave_room", lambda self, _: self.drop())
    case = prepare(TARGETS[0], Options(stop=60.0, shortens=True))
    run = simulate(case, tmp_path / "run")
    assert run.code == Exit.COMPLETED
    assert (run.results.every, len(run.results.times())) == (1, 61)
    assert run.results.extremes("wheels.h_wheel") is None


# runs a command and prints its exit code and its peak memory
COUNT = """
import os, subprocess, sys
process = subprocess.Popen(sys.argv[1:])
_, status, usage = os.wait4(process.pid, 0)
process.returncode = os.waitstatus_to_exitcode(status)
print(process.returncode, usage.ru_maxrss, file=sys.stderr)
"""


@pytest.mark.study
@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs POSIX")
def test_a_million_steps_stay_below_400_mb(tmp_path):
    """The memory is the kernel's count; all rows would take 0.6 GB on disk."""
    command = [sys.executable, "-m", "desat.cli"]
    orbit = ["--altitude", "520km", "--inclination", "97.5deg"]
    body = ["--mass", "400kg", "--box", "1,1,2.5", "--rods", "none", "--isp", "65s"]
    parts = ["--wheels", "4 pyramid 8Nms", "--thrusters", "4 0.5N"]
    dump = ["--dump", "thrusters 70:10"]
    craft = ["new", "craft", "sar", *orbit, *body, *parts, *dump]
    subprocess.run([*command, *craft], cwd=tmp_path, check=True, capture_output=True)
    run = [*command, "run", "sar", "--stop", "1000002", "--out", "out"]
    # the kernel's count begins with that of the process that starts another
    count = subprocess.run(
        [sys.executable, "-c", COUNT, *run],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    text = count.stdout + count.stderr
    code, peak = map(int, text.splitlines()[-1].split())
    assert code == 0, text
    assert peak // (1024 if sys.platform == "darwin" else 1) < 400_000
    assert "one row of 11, with minimum, maximum and mean" in text
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert manifest["steps_done"] == 1_000_002
    assert Path(tmp_path, "out", "series.h5").stat().st_size < 300e6
