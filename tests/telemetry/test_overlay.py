"""A log lies over a run, with differences in numbers."""

from __future__ import annotations

import json

import numpy as np
import pytest

from desat.export.series import export
from desat.runs.prepare import prepare
from desat.runs.run import simulate
from desat.system.options import Options
from desat.telemetry.overlay import _begins
from tests.telemetry.synthetic import write_log


@pytest.fixture(scope="module")
def flight(craft, tmp_path_factory):
    """The folder of a run of half an hour, with its csv."""
    out = tmp_path_factory.mktemp("overlay") / "run"
    simulation = simulate(prepare(str(craft), Options(stop=1800.0)), out)
    export(simulation.or_raise("run").results.folder, "csv")
    return out


def test_a_run_lies_over_itself(flight, tmp_path, desat):
    page = tmp_path / "page.html"
    command = desat(
        *("compare", str(flight), str(flight / "series.csv")),
        *("--html", str(page), "--json"),
        check=True,
    )
    answer = json.loads(command.stdout)
    rows = answer["differences"]
    speeds = [x for title, x in rows.items() if title.startswith("Wheel speed")]
    assert [x["largest"] for x in speeds] == pytest.approx([0.0] * 4, abs=1e-9)
    momenta = [x for title, x in rows.items() if title.startswith("Wheel momentum")]
    # the tachometers' noise is 7.3e-6 N m s
    assert [x["rms"] for x in momenta] == pytest.approx([7.3e-3] * 4, rel=0.1)
    text = page.read_text()
    assert "wheel 1 measured" in text
    assert "wheel 1 simulated" in text


def test_differences_are_those_of_the_log(flight, tmp_path, desat):
    times = np.arange(0.0, 1200.0, 30.0)
    rows = np.column_stack([times, *[np.full(len(times), 5.0)] * 3])
    rows[3, 1] = np.nan
    names = ["time [s]", "omega_1 [deg/s]", "omega_2 [deg/s]", "omega_3 [deg/s]"]
    file = write_log(tmp_path / "log.csv", names, rows)
    command = desat(
        "compare", str(flight), str(file), "--json", cwd=tmp_path, check=True
    )
    rows = json.loads(command.stdout)["differences"]
    assert rows["Body rate, x"]["rms"] == pytest.approx(5.0, abs=0.01)
    assert rows["Body rate, y"]["rms"] == pytest.approx(5.063, abs=0.01)


@pytest.mark.parametrize(
    ("heading", "start", "message"),
    [
        ("time [s],h_1 [N.m.s]", 9e5, "from 900000 to 900001 s; "),
        ("time [s],x [m]", 0.0, "no column of what "),
        ("time [s],h_1 [N.m.s]", 0.0, "columns of momentum: 1 elements; the run has 4"),
        ("time [s],h_1", 0.0, "column h_1: no unit"),
    ],
)
def test_a_log_that_does_not_fit_is_refused(
    flight, tmp_path, desat, heading, start, message
):
    file = tmp_path / "log.csv"
    file.write_text(f"{heading}\n{start},1\n{start + 1},2\n")
    command = desat("compare", str(flight), str(file))
    assert (command.returncode, command.stderr.count("\n")) == (2, 1)
    assert message in command.stderr


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("a.csv", "b.csv"), "a run and a log after it are needed"),
        (("a", "b", "c.csv"), "a run and a log after it are needed"),
        (("a", "b.csv", "-n", "3"), "-n: a log is laid over a run as it is"),
    ],
)
def test_other_targets_are_refused(arguments, message, desat):
    command = desat("compare", *arguments)
    assert command.returncode == 2
    assert message in command.stderr


def test_dumps_begin_after_a_pause():
    torque = np.zeros((5000, 3))
    torque[[100, 150, 700, 2000, 2001], 1] = 1.0
    assert _begins(np.arange(5000.0), torque) == [100.0, 2000.0]
