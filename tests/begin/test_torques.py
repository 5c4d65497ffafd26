"""Torques that a craft is given as files."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import desat as library
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.begin.torques import given_torque
from desat.begin.torques import read as read_torques
from desat.system.errors import DesatError


def test_a_csv_of_torques_flies(tmp_path: Path) -> None:
    (tmp_path / "tau.csv").write_text(
        "t,x,y,z\n0,1e-6,0,0\n3000,-1e-6,0,2e-7\n6000,1e-6,0,0\n"
    )
    facts = CraftFacts(
        altitude="600km", size="12U", torque=f"{tmp_path / 'tau.csv'} lvlh"
    )
    write(tmp_path / "mine", facts, "")
    rows = tomllib.loads((tmp_path / "mine" / "craft.toml").read_text())["parameters"]
    assert rows["disturbance"]["frame"] == "lvlh"
    assert rows["disturbance"]["torque"][1] == [3000.0, -1e-6, 0.0, 2e-7]
    run = library.run(str(tmp_path / "mine"), stop=6000.0)
    impulse = run.results.values("disturbance.tau_ext_body")
    assert np.linalg.norm(impulse[0]) == pytest.approx(1e-6, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("t,x,y,z\n", "there is no row of 4 numbers"),
        ("0,1,2\n0,1,2,3\n1,2,3\n", r":1: 4 numbers are needed, t in s"),
        ("t,x,y,z\n0,1,2,3\n1,2,3\n", r":3: 4 numbers are needed, t in s"),
        ("inf,x,y,z\n0,1,2,3\n", r":1: 4 numbers are needed.*got inf,x,y,z"),
        ("0,1,2,3\n0,1,2,3\n", r": its time 0 s is not after that of the row before"),
        ("0,1,2,nan\n1,1,1,1\n2,x,1,1\n", r":1: 4 numbers are needed"),
        ("t,x,y\n0,1,2\n", r":1: no column z; the columns are t \[s\], x \[N\.m\], y"),
        ("t,x,y,y\n0,1,2,3\n", r":1: column y: twice; the columns are"),
        ("t,x,y,z,w\n0,1,2,3,4\n", r":1: column w: no such column; the columns are"),
        ("t [m],x,y,z\n0,1,2,3\n", r":1: t \[m\]: unit m does not fit s"),
        (
            "t,x [furlong],y,z\n0,1,2,3\n",
            r":1: x \[furlong\]: unit furlong is not known",
        ),
        (
            "\n".join(f"{k},0,0,0" for k in range(300)),
            "300 rows; 256 are taken at most",
        ),
    ],
)
def test_a_csv_that_is_wrong_is_refused_by_its_line(
    tmp_path: Path, text: str, message: str
) -> None:
    (tmp_path / "tau.csv").write_text(text)
    with pytest.raises(DesatError, match=message):
        write(tmp_path / "mine", CraftFacts(torque=str(tmp_path / "tau.csv")), "")


@pytest.mark.parametrize(
    ("heading", "row"),
    [
        ("t,z,y,x", "10,3,2,1"),
        ("x,y,z,t", "1,2,3,10"),
        ("t [ms],x [N m],y [N m],z [N m]", "10000,1,2,3"),
        ("time (s);x [mN m];y [mN.m];z [uNm]", "10;1000;2000;3000000"),
        ('"t [min]","tau_z [N m]","tau_x [N m]","tau_y [N m]"', f"{1 / 6!r},3,1,2"),
    ],
)
def test_a_heading_names_columns_and_units(
    tmp_path: Path, heading: str, row: str
) -> None:
    file = tmp_path / "tau.csv"
    file.write_text(f"# a comment\n{heading}\n{row}\n")
    (torque_row,) = read_torques(file)
    assert torque_row == pytest.approx((10.0, 1.0, 2.0, 3.0), rel=1e-12)


def test_torques_of_several_files_add_up(tmp_path: Path) -> None:
    for name, text in {
        "a": "0,1e-6,0,0\n100,3e-6,0,0\n",
        "b": "0,0,1e-6,0\n50,0,2e-6,0\n100,0,1e-6,0\n",
        "c": "0,0,0,4e-6\n",
        "d": "0,1,0,0\n70,1,0,0\n",
    }.items():
        (tmp_path / f"{name}.csv").write_text(text)
    a, b, c, d = (f"{tmp_path / name}.csv lvlh" for name in "abcd")
    total = given_torque(CraftFacts(torque=(a, b, c)))
    assert total is not None
    assert np.array(total.rows) == pytest.approx(
        np.array(
            [[0, 1e-6, 1e-6, 4e-6], [50, 2e-6, 2e-6, 4e-6], [100, 3e-6, 1e-6, 4e-6]]
        )
    )
    with pytest.raises(DesatError, match=r"from 0 to 70 s, and --torque .*to 100 s"):
        given_torque(CraftFacts(torque=(a, d)))
    with pytest.raises(DesatError, match=r"it is in body, and --torque .* in lvlh"):
        given_torque(CraftFacts(torque=(a, f"{tmp_path / 'b'}.csv")))


def test_the_mean_torque_is_that_of_the_sum(tmp_path: Path) -> None:
    file = tmp_path / "tau.csv"
    file.write_text("0,9e-5,0,0\n")
    torque = given_torque(CraftFacts(torque=str(file), secular="0uNm,90uNm,0uNm"))
    assert torque is not None
    assert torque.size == pytest.approx(9e-5 * 2.0**0.5)
