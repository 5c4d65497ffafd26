"""Logs that are wrong are refused in one line that names file and column, and leave the
craft as it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from desat.system.errors import DesatError
from desat.system.model import J2000
from desat.telemetry.log import align_signs, read_log
from tests.telemetry.synthetic import columns_of, write_log


@pytest.fixture(scope="module")
def table(craft):
    """Headings and rows of a log of two hours."""
    return columns_of(craft, {"residual_dipole_body": [0.02, -0.03, 0.01]}, 1, 7200.0)


def with_heading(names, before, after):
    """Return headings of which one is another."""
    assert before in names
    return [after if n == before else n for n in names]


def with_value(rows, at, value):
    """Return rows of which an element, or a column, is another."""
    rows = rows.copy()
    rows[at] = value
    return rows


TIME, SPEED, COIL = "time [s]", "speed_1 [rpm]", "m_mean_body[1] [A.m2]"
REFUSALS = {
    "a quantity first": (
        lambda n, r: (with_heading(n, TIME, "x [m]"), r),
        "no time column: ",
    ),
    "no heading": (
        lambda n, r: ([str(x) for x in r[0]], r),
        "is a number, and no head",
    ),
    "time left out": (
        lambda n, r: (n[1:], r[:, 1:]),
        "no time column: the first, 'speed",
    ),
    "two units": (
        lambda n, r: (with_heading(n, SPEED, "speed_1 [rpm] [rad/s]"), r),
        "column speed_1 [rpm] [rad/s]: two units, rpm and rad/s",
    ),
    "two units of time": (
        lambda n, r: (with_heading(n, TIME, "time [s] (h)"), r),
        "column time [s] (h): two units",
    ),
    "no unit": (
        lambda n, r: (with_heading(n, SPEED, "speed_1"), r),
        "column speed_1: no unit",
    ),
    "an empty unit": (
        lambda n, r: (with_heading(n, SPEED, "speed_1 []"), r),
        "column speed_1 []: no unit",
    ),
    "coils without": (
        lambda n, r: (with_heading(n, COIL, "m_mean_body[1]"), r),
        "column m_mean_body[1]: no unit; one that fits A.m2",
    ),
    "another quantity": (
        lambda n, r: (with_heading(n, SPEED, "speed_1 [kg]"), r),
        "column speed_1 [kg]: unit kg does not fit rad/s",
    ),
    "three wheels": (
        lambda n, r: (n[:4] + n[5:], np.delete(r, 4, 1)),
        "columns of speed: 3 wheels; my6u has 4",
    ),
    "one wheel": (
        lambda n, r: (n[:2] + n[5:], np.delete(r, [2, 3, 4], 1)),
        "1 wheels; my6u has 4",
    ),
    "five wheels": (
        lambda n, r: ([*n, "speed_5 [rpm]"], np.hstack([r, r[:, 1:2]])),
        "5 wheels; my6u has 4",
    ),
    "a wheel twice": (
        lambda n, r: (with_heading(n, "speed_2 [rpm]", SPEED), r),
        "column speed_1 [rpm]: it is there twice",
    ),
    "wheels at rest": (
        lambda n, r: (n, with_value(r, np.s_[:, 1:5], 9.0)),
        "no wheel's",
    ),
    "short": (lambda n, r: (n, r[:500]), "it lasts 4990 s, an orbit 56"),
    "two rows": (lambda n, r: (n, r[:2]), "it lasts 10 s, an orbit 56"),
    "one row": (lambda n, r: (n, r[:1]), "no wheel's value changes"),
    "no row": (lambda n, r: (n, r[:0]), "no row below the heading"),
    "the clock goes back": (
        lambda n, r: (n, with_value(r, (600, 0), 10.0)),
        "column time [s]: the clock jumps back: row 601 is at 10 s, the row before at 5990",
    ),
    "the clock stands": (
        lambda n, r: (n, with_value(r, (600, 0), 5990.0)),
        "the clock jumps back: row 601",
    ),
    "no clock": (lambda n, r: (n, with_value(r, (7, 0), np.nan)), "row 8 has no time"),
    "three of four": (
        lambda n, r: (n[:8] + n[9:], np.delete(r, 8, 1)),
        "the attitude has 3 columns",
    ),
    "an attitude of 0": (
        lambda n, r: (n, with_value(r, np.s_[3, 5:9], 0.0)),
        "unknown attitude: the quaternion of row 4 has the size 0",
    ),
    "an attitude of 2": (
        lambda n, r: (n, with_value(r, np.s_[:, 5:9], 1.0)),
        "unknown attitude: the quaternion of row 1 has the size 2",
    ),
    "no coils": (
        lambda n, r: (n[:9], r[:, :9]),
        "no column of the coils that my6u has",
    ),
    "another epoch": (
        lambda n, r: (n, with_value(r, np.s_[:, 0], r[:, 0] + 1.8e9)),
        "which IGRF-14 covers",
    ),
    "wheels of noise alone": (
        lambda n, r: (
            n,
            with_value(
                r, np.s_[:, 1:5], np.random.default_rng(1).normal(0, 3e3, (len(r), 4))
            ),
        ),
        "do not explain its momentum",
    ),
    "another orbit": (
        lambda n, r: (n, with_value(r, np.s_[:, 0], r[:, 0] + 2900.0)),
        "do not explain its momentum",
    ),
}


@pytest.mark.parametrize("case", REFUSALS)
def test_a_wrong_log_is_refused_in_a_line(craft, table, case, tmp_path, desat):
    change, message = REFUSALS[case]
    file = write_log(tmp_path / "log.csv", *change(*table))
    before = (craft / "craft.toml").read_bytes()
    command = desat("fit", str(craft), str(file))
    assert command.returncode == 2, command.stdout
    assert command.stderr.count("\n") == 1
    assert "log.csv: " in command.stderr
    assert message in command.stderr
    assert (craft / "craft.toml").read_bytes() == before
    assert not (craft / "craft.toml.bak").exists()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"", "empty; a heading and rows are needed"),
        (b"# a comment\n\n", "empty; a heading and rows are needed"),
        (b"\xff\xfe,1\n", "not UTF-8"),
        (b"time [s],speed_1 [rpm]\n0,1\n1\n", "Expected 2 columns, got 1"),
        (
            b"time [s],speed_1 [rpm]\n0,1\n1,12 rpm\n",
            "speed_1 [rpm]: '12 rpm' is no number",
        ),
        (
            b"utc,speed_1 [rpm]\n2027-01-01,1\n2027-99-01,2\n",
            "neither in seconds nor UTC",
        ),
        (b"time [m],speed_1 [rpm]\n0,1\n", "column time [m]: unit m does not fit s"),
    ],
)
def test_a_file_that_is_no_log_is_refused(text, message, tmp_path):
    file = tmp_path / "log.csv"
    file.write_bytes(text)
    with pytest.raises(DesatError) as error:
        read_log(file, J2000)
    assert message in str(error.value)


def test_a_log_may_be_in_any_units_and_order(tmp_path):
    file = tmp_path / "log.csv"
    file.write_text(
        "# of a tool\n"
        "utc;speed_2 [rad/s];text;speed[1] (rpm);q_bi_1;q_bi_2;q_bi_3;q_bi_4\n"
        "2000-01-01T12:00:00Z;2.5;on;60;1;0;0;0\n"
        "2000-01-01T13:00:10+01:00;;off;-30;-1;0;0;0\n"
    )
    log = read_log(file, J2000, is_scalar_first=True)
    assert log.times.tolist() == [0.0, 10.0]
    assert log.values["speed"][:, 0] == pytest.approx([2.0 * np.pi, -np.pi])
    assert log.values["speed"][0, 1] == 2.5
    assert np.isnan(log.values["speed"][1, 1])
    assert log.values["attitude"].tolist() == [[0.0, 0.0, 0.0, 1.0]] * 2


def test_signs_go_over_rows_without_attitude():
    q = np.array([[0.0, 0.0, 0.0, 1.0], [np.nan] * 4, [0.0, 0.0, 0.0, -1.0]])
    assert align_signs(q)[2, 3] == 1.0


def test_an_attitude_that_nothing_says_is_refused(craft, table, tmp_path, desat):
    names, rows = table
    copy = tmp_path / "other"
    copy.mkdir()
    for file in craft.glob("*.toml"):
        (copy / file.name).write_text(file.read_text())
    text = (copy / "craft.toml").read_text()
    (copy / "craft.toml").write_text(text.replace("guidance_nadir", "guidance_slew"))
    file = write_log(
        tmp_path / "log.csv", names[:5] + names[9:], np.delete(rows, range(5, 9), 1)
    )
    command = desat("fit", str(copy), str(file))
    assert command.returncode == 2
    assert "unknown attitude: no column q_bi" in command.stderr


def test_dry_run_takes_any_craft_and_only_own_crafts_are_written(
    table, tmp_path, desat
):
    file = write_log(tmp_path / "log.csv", *table)
    command = desat("fit", "nadir_day/day-dipole", str(file))
    assert command.returncode == 2
    assert "only the craft.toml of a craft of one's own is written" in command.stderr
    assert not Path("craft.toml.bak").exists()
