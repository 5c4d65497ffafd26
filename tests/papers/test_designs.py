"""Designs that were made for other values, and how they are made again."""

from __future__ import annotations

from dataclasses import replace

import pytest

from desat.files.io import toml
from desat.files.scenario import find, scenarios
from desat.runs.prepare import resolved
from desat.runs.run import Options, execute, prepare
from tests.conftest import but, module_of

making = module_of("desat.papers.designs.making")

origin = module_of("desat.papers.designs.origin")

MEC = "uosat12/fig2-mec-1"

START = "spacecraft.h_start_body=2,0,0"


def _of_design(scenario) -> list[str]:
    """What is said of the kept design of a scenario that runs as it is."""
    system, _ = resolved(scenario, Options())
    return origin.warnings(scenario, Options(), system)


def test_no_kept_design_is_for_other_values():
    with_design = [s for s in scenarios("uosat12").values() if s.design]
    assert len(with_design) > 36
    assert [line for s in with_design for line in _of_design(s)] == []


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        ({"sets": [START]}, "h_start_body = [1.0, 2.0, -1.0], now [2.0, 0.0, 0.0]"),
        (
            {"values": {"environment.phase": 0.5}},
            "environment.phase = 1.4451326206513049, now 0.5",
        ),
        ({"stop": 1500.0}, "stop = 3000.0, now 1500.0"),
        ({"step": 5.0}, "step = 10.0, now 5.0"),
        (
            {"sources": ["manager=manager_cross_product"]},
            "source.manager = manager_magnetic, now",
        ),
    ],
)
def test_a_design_for_other_values_is_said(options, fault):
    case = prepare(MEC, Options(**options))
    (line,) = [w for w in case.warnings if "its design" in w]
    assert fault in line
    assert f"`desat run {MEC} ... --design now`" in line


def test_what_cannot_matter_to_a_design_is_not_said():
    same = Options(
        sets=["spacecraft.h_start_body=1,2,-1", "manager.costate=1,0,0"], stop=3000.0
    )
    assert prepare(MEC, same).warnings == []
    blind = find("uosat12/fig2-offnadir-mec-blind")
    ((name, table),) = blind.content.design.assume.items()
    values = {
        f"{name}.{k}": [[2.0 * x for x in row] for row in v] for k, v in table.items()
    }
    assert prepare(blind.name, Options(values=values)).warnings == []


def test_a_design_of_another_scenario_follows_its_values():
    flight = "uosat12/fig2-flight-mec-1"
    (line,) = prepare(flight, Options(values={"torquers.quiet_time": 2.0})).warnings
    assert "torquers.quiet_time = 0.0, now 2.0" in line
    (line,) = prepare(
        flight, Options(values={"wheels.h_start_wheel": [1.0, 1.0, 1.0, 0.0]})
    ).warnings
    assert "that of uosat12/fig2-mec-1, which has no wheels.h_start_wheel" in line


@pytest.mark.real_units
def test_one_command_gets_the_right_gains(tmp_path):
    wrong = execute(MEC, Options(sets=[START], blocks=True))
    right = execute(MEC, Options(sets=[START], blocks=True, design="now"))
    assert any("its design" in w for w in wrong.manifest["warnings"])
    assert right.manifest["warnings"] == []
    assert wrong.manifest["numbers"]["final_momentum"]["value"] > 2.0
    assert right.manifest["numbers"]["final_momentum"]["value"] == pytest.approx(
        0.05, abs=1e-9
    )
    options = Options(sets=[START])
    file = making.write(
        find(MEC), making.design(find(MEC), options), options, tmp_path / "d.toml"
    )
    again = execute(MEC, Options(sets=[START], blocks=True, design=str(file)))
    assert again.manifest["numbers"] == right.manifest["numbers"]
    assert toml(file)["made_of"]["spacecraft.h_start_body"] == [2.0, 0.0, 0.0]


def test_a_design_is_stamped_only_if_its_numbers_are_reached(monkeypatch, tmp_path):
    scenario = find("uosat12/fig2-ccpl-1")
    design_text = scenario.design.read_text(encoding="utf-8")
    bare = design_text.partition("\n[made_of]\n")[0]
    file = tmp_path / "x.toml"
    monkeypatch.setattr(type(scenario), "design", property(lambda self: file))
    parameters = {
        **scenario.content.parameters,
        "spacecraft": {"h_start_body": [2.0, 0.0, 0.0]},
    }
    other = replace(scenario, content=but(scenario.content, parameters=parameters))
    file.write_text(bare, encoding="utf-8")
    assert not making.confirm(other)
    assert file.read_text(encoding="utf-8") == bare
    assert "does not say" in _of_design(scenario)[0]
    assert making.confirm(scenario)
    assert file.read_text(encoding="utf-8") == design_text


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ("run", "plant/reference", "--design", "now"),
            "plant/reference has no [design]",
        ),
        (("run", MEC, "--design", "no.toml"), "no.toml: no such file"),
        (("design", MEC, "--set", START), "a design for other values needs --out FILE"),
        (("design", MEC, "--set", "spacecraft.h_stat=1", "--out", "x"), "did you mean"),
    ],
)
def test_a_bad_design_is_a_line(desat, tmp_path, arguments, message):
    result = desat(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert message in result.stderr
    assert len(result.stderr.splitlines()) == 1
