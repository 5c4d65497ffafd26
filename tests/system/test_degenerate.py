"""Craft and names that cannot be meant: said in a line before a run."""

from __future__ import annotations

import pytest

from desat.files import paths, scenario
from desat.system.errors import DesatError, Exit

PLANE = "1,0,0.6,0.8,0,1,0.8,-0.6,0,0,0,0"
LINE = "1,1,-1,1,0,0,0,0,0,0,0,0"


@pytest.mark.parametrize(
    ("axes", "message"),
    [
        (PLANE, "they lie in a plane: no wheel turns the craft about (0, 0, "),
        (LINE, "all are along (1, 0, 0): no wheel turns the craft about another"),
    ],
)
def test_wheels_that_leave_an_axis_alone_are_refused(desat, axes, message):
    command = desat(
        "check", "nadir_day/day-dipole", "--set", f"shared.axes_wheel={axes}"
    )
    assert command.returncode == Exit.UNMET
    assert [
        x for x in command.stderr.splitlines() if "axes_wheel: " in x and message in x
    ]
    plain = desat("check", "nadir_day/day-dipole", check=True)
    assert "no wheel turns" not in plain.stderr


def test_a_quaternion_of_size_0_is_refused_by_name(desat):
    zero = "spacecraft.q_start_bi=0,0,0,0"
    command = desat("run", "nadir_day/day-dipole", "--stop", "5", "--set", zero)
    assert command.returncode == Exit.INPUT
    assert (
        f"--set {zero}: spacecraft.q_start_bi = (0, 0, 0, 0): a quaternion of"
        in command.stderr
    )


def test_a_singular_inertia_is_a_line_and_no_warning_of_numpy(desat):
    singular = "shared.inertia=1,1,0,1,1,0,0,0,1"
    command = desat("check", "gyrostat/light", "--set", singular)
    assert command.returncode == Exit.UNMET
    assert "RuntimeWarning" not in command.stderr
    assert "its principal moments must be above 0" in command.stdout + command.stderr


def test_two_files_that_make_one_name_are_both_named(monkeypatch, tmp_path):
    folder = tmp_path / "f" / "scenarios"
    folder.mkdir(parents=True)
    base = 'ssd = "s.ssd"\ntitle = "x"\nstep = 1.0\nstop = 1.0\n'
    (folder / "a.toml").write_text(f"{base}[axes.x.b-c]\ntitle = 'a'\n")
    (folder / "a-b.toml").write_text(f"{base}[axes.x.c]\ntitle = 'a-b'\n")
    for cached_function in (
        scenario.families,
        scenario.survey,
        scenario.cells,
        scenario.scenarios,
    ):
        cached_function.cache_clear()
    monkeypatch.setattr(scenario, "ROOT", tmp_path)
    monkeypatch.setattr(paths, "SCENARIOS", tmp_path)
    try:
        for ask in (lambda: scenario.scenarios("f"), lambda: scenario.find("f/a-b-c")):
            with pytest.raises(
                DesatError,
                match=r"a-b\.toml and .*a\.toml: both make a scenario f/a-b-c",
            ):
                ask()
    finally:
        monkeypatch.undo()
        for cached_function in (
            scenario.families,
            scenario.survey,
            scenario.cells,
            scenario.scenarios,
        ):
            cached_function.cache_clear()
