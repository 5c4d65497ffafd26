"""Products of parameters in the place of numbers; parameters that follow others."""

from __future__ import annotations

import math

import pytest

from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError
from desat.system.expression import entry, factor, product, times
from desat.system.model import Parameter
from desat.system.parameters import parse_assignment, unit_of

TABLE = {
    "wheels": {
        "inertia_wheel": Parameter([0.008, 0.008, 0.008, 0.0], "kg.m2"),
        "speed_limit": Parameter(500.0, "rad/s"),
        "drive": Parameter("ideal", ""),
        "axes": Parameter([1.0, 2.0], "1"),
    },
    "manager": {"h_limit": Parameter(2.0, "N.m.s"), "k": Parameter(0.0, "1")},
    "spacecraft": {"inertia": Parameter([1.0, 2.0], "kg.m2")},
}


def test_products_have_values_and_units():
    value, unit = product("0.5 * wheels.inertia_wheel * wheels.speed_limit", TABLE)
    assert value == 0.5 * 0.008 * 500.0
    assert unit.dimension == unit_of("N.m.s").dimension
    value, unit = product("manager.h_limit/wheels.inertia_wheel[1]", TABLE)
    assert value == 2.0 / 0.008
    assert unit.dimension == unit_of("rad/s").dimension
    assert entry("shared.inertia", TABLE)[:2] == ([1.0, 2.0], "kg.m2")
    assert times(unit_of("km"), unit_of("s"), -1).factor == 1000.0
    assert factor(unit_of("s"), "min", "of it") == pytest.approx(1 / 60)


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("wheels.sped_limit", "did you mean speed_limit"),
        ("wheel.speed_limit", "did you mean wheels"),
        ("wheels.drive", "is no number"),
        ("wheels.axes", "elements that differ"),
        ("wheels.axes[3]", "no element 3"),
        ("2 *", "or a product of numbers"),
        ("2 3", "or a product of numbers"),
        ("nonsense", "or a product of numbers"),
        ("1 / manager.k", "is 0"),
        ("shared.mass", "no component has a parameter mass"),
        ("", "or a product of numbers"),
    ],
)
def test_bad_products_are_a_line(text, fault):
    with pytest.raises(DesatError, match=fault) as error:
        product(text, TABLE)
    assert "\n" not in str(error.value)


def numbers(*sets: str, target: str = "integrated/ideal-inertial", stop: float = 5.0):
    run = execute(target, Options(sets=list(sets), stop=stop, blocks=True))
    with run.results:
        return run.manifest["numbers"], run.manifest.parameters


def test_capacity_is_the_wheels():
    """Twice the speed limit is twice the capacity, whatever the manager thinks of it."""
    one, _ = numbers()
    two, _ = numbers("wheels.speed_limit=1250", "manager.h_limit=0.04")
    assert two["largest_wheel"]["value"] == pytest.approx(
        one["largest_wheel"]["value"] / 2, rel=1e-3
    )


def test_what_derives_from_the_craft_follows_it():
    _, parameters = numbers("spacecraft.inertia=0.2,0,0,0,0.3,0,0,0,0.1")
    assert parameters["controller"]["gain_matrix"].value == [
        0.2,
        0,
        0,
        0,
        0.3,
        0,
        0,
        0,
        0.1,
    ]
    _, parameters = numbers("controller.gain_matrix=1,0,0,0,1,0,0,0,1")
    assert parameters["controller"]["gain_matrix"].value == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    _, parameters = numbers("manager.h_limit=wheels.inertia_wheel * wheels.speed_limit")
    assert parameters["manager"]["h_limit"].value == 3.2e-5 * 625.0


@pytest.mark.parametrize(
    ("sets", "fault"),
    [
        (["manager.h_limit=wheels.torque_limit"], "its unit does not fit N.m.s"),
        (["manager.h_limit=wheels.none"], "wheels has no parameter none"),
        (["controller.kp=controller.kd", "controller.kd=controller.kp"], "in a circle"),
        (["controller.kp=manager.velocity_dumping"], "is no number"),
    ],
)
def test_references_that_make_no_sense_are_refused(sets, fault):
    case = prepare("integrated/ideal-inertial", Options(sets=sets, blocks=True))
    assert any(fault in problem for problem in case.problems)


def test_a_window_that_is_not_reached_is_said():
    some, _ = numbers(stop=1000.0)
    assert some["wheels_3h"]["value"] is None
    assert some["pointing"]["note"] == "only to 1000 s of 14400 s"
    assert not any(
        isinstance(n["value"], float) and math.isnan(n["value"]) for n in some.values()
    )


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ('"a,b", "c"', ["a,b", "c"]),
        ("[1, 2], [3, 4]", [[1, 2], [3, 4]]),
        ("1,2", [1, 2]),
        ("a, 2", ["a", 2]),
        ("[1, 2]", [1, 2]),
        (".5", 0.5),
        ("word", "word"),
    ],
)
def test_values_as_the_command_line_has_them(text, value):
    assert parse_assignment(f"a.b={text}") == ("a", "b", value)
