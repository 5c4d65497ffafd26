"""What usually follows from the craft does so in all families, and a difference is
said."""

from __future__ import annotations

import re

import numpy as np
import pytest

from desat.components.contract.units import unit_of
from desat.files import library
from desat.files.fmu import of_fmu
from desat.files.scenario import scenarios
from desat.fmus import registry
from desat.runs.run import Options, execute, prepare
from desat.system.expression import names_in
from desat.system.interface import interface_of_block
from desat.system.model import table

INERTIA = "[[21.0, 0.6, -0.4], [0.6, 18.0, 0.3], [-0.4, 0.3, 13.0]]"
ANOTHER = "does it belong to another craft?"


@pytest.fixture
def write_own(tmp_path):
    """Write a scenario of one's own; its path."""

    def write(text: str) -> str:
        path = tmp_path / "own.toml"
        path.write_text(text)
        return str(path)

    return write


def messages_of(target: str, *sets: str) -> list[str]:
    """What a check warns of in a craft that may be another's."""
    case = prepare(target, Options(blocks=True, sets=list(sets)))
    assert not case.problems, case.problems
    return [x for x in case.warnings if ANOTHER in x]


def test_a_craft_that_extends_another_is_one_craft(write_own):
    """The issue's own: nadir_day with another inertia. Its gains were those of the old
    one, and pointing 5.13 deg for 0.05, with no word."""
    target = write_own(
        f'extends = "nadir_day/day-dipole"\nstop = 6000.0\nshared.inertia = {INERTIA}\n'
    )
    assert messages_of(target) == []
    run = execute(target, Options(blocks=True))
    parameters = run.manifest["parameters"]
    assert (
        parameters["controller"]["gain_matrix"]["value"]
        == parameters["spacecraft"]["inertia"]["value"]
    )
    results = run.results
    dot = np.abs(
        (results.values("spacecraft.q_bi") * _read_target(results)).sum(axis=1)
    )
    late = 2.0 * np.degrees(np.arccos(np.minimum(dot, 1.0)))[3000:]
    assert late.max() < 0.2


def _read_target(results):
    q = results.values("guidance.q_ref_bi")
    return np.vstack([q, q[-1:]])[: len(results.values("spacecraft.q_bi"))]


@pytest.mark.parametrize(
    "family", ["nadir_day", "integrated", "uosat12", "space_telescope"]
)
def test_every_gain_matrix_is_derived(family):
    """In the file, so that it follows whatever a scenario that extends it says."""
    others = {
        "nadir_day/witness-laws"
    }  # the gains of Basilisk's law, which knows no matrix
    those = [
        s
        for name, s in scenarios(family).items()
        if name not in others and "gain_matrix" in str(s.content.parameters)
    ]
    assert those
    for scenario in those:
        assert (
            scenario.content.parameters["controller"]["gain_matrix"] == "shared.inertia"
        )


OTHERS = [
    (
        "nadir_day/day-dipole",
        "spacecraft.inertia=20,0,0,0,18,0,0,0,12",
        "controller.gain_matrix=10.5,0.3,-0.2,0.3,9.0,0.15,-0.2,0.15,6.5",
        "controller.gain_matrix[1,1] = 10.5, where spacecraft.inertia is 20",
    ),
    (
        "nadir_day/day-dipole",
        "torquers.m_limit=20",
        "manager.m_limit=5",
        "manager.m_limit = 5 A.m2, where torquers.m_limit is 20 A.m2",
    ),
    (
        "integrated/mil-nadir",
        "wheels.speed_limit=2500",
        "manager.h_limit=0.02",
        "manager.h_limit = 0.02 N.m.s, where wheels.inertia_wheel * wheels.speed_limit is",
    ),
    (
        "hausat2/detumbling-wheel",
        "wheels.torque_limit=2e-3",
        "manager.torque_limit=5e-3",
        "manager.torque_limit = 0.005 N.m, where wheels.torque_limit is 0.002 N.m",
    ),
    (
        "alsat1/ours-two-wheels",
        "torquers.duty_max=0.5",
        "manager.duty_max=0.8",
        "manager.duty_max = 0.8, where torquers.duty_max is 0.5",
    ),
    (
        "alsat1/ours-two-wheels",
        "torquers.least_pulse=0.1",
        "manager.least_pulse=0.2",
        "manager.least_pulse = 0.2 s, where torquers.least_pulse is 0.1 s",
    ),
    (
        "uosat12/flight-receding_horizon-3",
        "thrusters.tau_level=0.03,0.04,0.04",
        "manager.tau_level=0.04,0.04,0.04",
        "manager.tau_level[1] = 0.04 N.m, where thrusters.tau_level is 0.03 N.m",
    ),
]


@pytest.mark.parametrize(("target", "craft", "stays", "text"), OTHERS)
def test_what_is_of_another_craft_is_said(target, craft, stays, text):
    before = messages_of(target)
    new_messages = [x for x in messages_of(target, craft, stays) if x not in before]
    name = stays.partition("=")[0]
    assert any(text in x and "Written as " in x for x in new_messages), new_messages
    assert [x for x in messages_of(target, stays) if name in x] == [], "equal: silent"
    assert all(x.startswith("--set") for x in new_messages if name in x), (
        "it names who gave it"
    )


def test_run_and_check_say_it(desat, write_own, tmp_path):
    matrix = "[[10.5, 0.3, -0.2], [0.3, 9.0, 0.15], [-0.2, 0.15, 6.5]]"
    target = write_own(
        f'extends = "nadir_day/day-dipole"\nstop = 10.0\nshared.inertia = {INERTIA}\n'
        f"parameters.controller.gain_matrix = {matrix}\n"
    )
    for command in (("check",), ("run", "--blocks", "--out", str(tmp_path / "run"))):
        out = desat(*command, target)
        assert out.returncode == 0
        text = re.sub(r"\s+", " ", out.stdout + out.stderr)
        assert (
            "controller.gain_matrix[1,1] = 10.5, where spacecraft.inertia is 21: does it"
            in text
        )
        assert "own.toml: parameters.controller.gain_matrix" in text


def test_what_a_scenario_says_follows_is_silent():
    name = "nadir_day/day-dipole"
    assert messages_of(name, "manager.m_limit=4.0")
    assert messages_of(name, "manager.m_limit=0.8 * torquers.m_limit") == []
    assert messages_of(name, "manager.m_limit=0.0") == [], "off"
    one = "controller.gain_matrix=2,0,0,0,2,0,0,0,2"
    assert messages_of(name, one) == [], "the identity is of no craft"
    assert messages_of(name, one.replace("2,0,0,0,2", "2,0,0,0,3"))


def test_a_default_that_is_not_the_crafts_is_said(write_own):
    text = (
        'extends = "nadir_day/day-dipole"\nwithout = ["parameters.manager.m_limit"]\n'
    )
    warnings = messages_of(write_own(text))
    assert len(warnings) == 1
    assert (
        "default: manager.m_limit = 20 A.m2, where torquers.m_limit is 5 A.m2"
        in warnings[0]
    )


def test_what_is_followed_is_there():
    """Each names the role and parameter of some block, in the parameter's own unit."""
    blocks = [registry.block_class(n) for n in registry.names()]
    known_parameters = {f"{b.role}.{v.name}": v for b in blocks for v in b.variables}
    following = [(b, v) for b in blocks for v in b.variables if v.follows]
    assert {v.name for _, v in following} == {
        "gain_matrix",
        "m_limit",
        "h_limit",
        "torque_limit",
        "duty",
        "duty_max",
        "least_pulse",
        "tau_level",
        "attitude_noise",
        "mu",
    }
    for block, v in following:
        ends = names_in(v.follows)
        assert ends <= known_parameters.keys(), f"{block.__name__}.{v.name}"
        if v.name == "gain_matrix":
            continue
        factors = [
            unit_of(known_parameters[end].unit).dimension for end in sorted(ends)
        ]
        total = tuple(map(sum, zip(*factors, strict=True)))
        assert total == unit_of(v.unit).dimension, f"{block.__name__}.{v.name}"


def test_fmus_say_what_their_blocks_say():
    """So the interface of one of ours need not be read: `FmuFile.interface` takes the
    block's."""
    for name in registry.names():
        for kind in ("native", "python"):
            file = library.our_file(f"{name}.fmu", kind)
            assert of_fmu(file) == interface_of_block(name), (name, kind)


MEANT = {
    # what differs on purpose, and no product of parameters says exactly
    "manager.h_limit": {
        "hausat2/start-up-ours",
        "hausat2/basin-",
        "hausat2/gain-gamma-",
    },
    "manager.tau_level": {"uosat12/robust-receding_horizon-weak_thrusters"},
    "manager.least_pulse": {"uosat12/robust-receding_horizon-least_pulse"},
}


def test_no_scenario_of_ours_is_half_another_craft():
    for name in list(scenarios())[::2]:  # of a family most differ in one value
        case = prepare(name, Options())
        for line in case.warnings:
            if ANOTHER in line:
                table_of_case = table(case.system.components.values())
                parameter = next(p for p in MEANT if f" {p}" in line)
                owner, _, key = parameter.partition(".")
                assert key in table_of_case[owner]
                assert any(name.startswith(x) for x in MEANT[parameter]), (
                    f"{name}: {line}"
                )
