"""Which managers fit a craft, and with which gains: what the blocks declare of
themselves."""

from __future__ import annotations

from math import pi

import pytest

from desat.components.contract.roles import Manager
from desat.fmus.registry import block_class
from desat.runs.prepare import prepare, read
from desat.runs.run import Options
from desat.sizing import compatibility
from desat.sizing.compatibility import Terms
from desat.system.errors import DesatError

DAY = "nadir_day/day-dipole"
TERMS = Terms(orbit_rate=1.1e-3, field=3e-5, inertial=False)
MANAGERS = compatibility.managers()


def of(target, terms=TERMS, requests=(compatibility.ALL,), **options):
    laws, refusals = compatibility.fitting(
        read(target), Options(**options), terms, requests
    )
    return {f.name: f for f in laws}, {r.name: r.why for r in refusals}


@pytest.mark.parametrize("name", MANAGERS)
def test_every_manager_has_a_law_or_says_why_not(name):
    block = block_class(name)
    assert issubclass(block, Manager)
    assert bool(block.offers) != bool(block.no_law)
    parameters = {v.name: v for v in block.variables if v.causality == "parameter"}
    for law in block.offers:
        assert law.gains.keys() <= parameters.keys()
        assert not law.rate or law.rate in law.gains
        for key, rule in law.gains.items():
            assert not parameters[key].choices or rule in parameters[key].choices


def test_each_manager_fits_or_is_refused_by_name():
    laws, refusals = of(DAY)
    assert list(laws) == [
        "cross product",
        "ccpl",
        "CP with gravity",
        "integrated",
        "quasi-static LQR",
        "predictive",
    ]
    managers = {f.manager for f in laws.values()}
    managers |= {f"manager_{name.replace(' ', '_')}" for name in refusals}
    assert managers == set(MANAGERS)
    assert refusals["combined"] == (
        "it needs thrusters that take its command; the craft has none"
    )
    assert refusals["magnetic"].endswith(
        "those of this craft are for its own law alone"
    )
    assert (
        refusals["b dot"]
        == "it brakes a tumbling craft and leaves the wheels as they are"
    )


def test_thrusters_and_an_attitude_that_stays_let_more_in():
    laws, refusals = of("uosat12/table3-ocdc-ilqr-1")
    assert {"ocdc", "bounded 1-norm"} <= laws.keys()
    assert next(iter(laws.values())).is_own
    assert "desat design" in refusals["preview"], "its tables are made for one craft"
    laws, _ = of(
        "space_telescope/closed-cp-nominal", Terms(1.1e-3, 3e-5, inertial=True)
    )
    assert next(iter(laws)) == "CP with gravity"


def test_a_craft_with_one_wheel_has_no_such_law():
    laws, refusals = of("hausat2/along-field")
    assert [f.is_own for f in laws.values()] == [True]
    assert (
        refusals["predictive"]
        == "it needs wheels about three axes; the craft's span 1 of them"
    )


def test_gains_are_the_rules_with_the_crafts_numbers():
    laws, _ = of(DAY)
    system, _ = prepare(DAY, Options()).or_raise()
    own_value = {n: system.components["manager"].values[n] for n in ("gain", "m_limit")}
    rate, most = own_value["gain"], own_value["m_limit"]
    gain = {n: f.options.values for n, f in laws.items()}
    assert gain["ccpl"]["manager.gain"] == pytest.approx(rate / 3e-5)
    assert gain["CP with gravity"]["manager.gain"] == pytest.approx(rate)
    weight = gain["quasi-static LQR"]["manager.momentum_weight"]
    assert weight == pytest.approx([(rate / 3e-5) ** 2] * 3)
    assert gain["integrated"]["manager.torque_limit"] == pytest.approx(
        4.0 * most * 3e-5
    )
    assert gain["predictive"]["manager.m_limit"] == most, "follows the coils"
    assert laws["ccpl"].gains["gain"].startswith("craft.rate / craft.field = ")
    without, _ = of(DAY, sources=["manager=manager_predictive"])
    rate = without["cross product"].options.values["manager.gain"]
    assert rate == pytest.approx(5.0 * 1.1e-3), "five times the orbit's"


def test_some_are_asked_for_by_name():
    laws, refusals = of(DAY, requests=["ccpl", "predictive"])
    assert list(laws) == ["cross product", "ccpl", "predictive"]
    assert refusals == {}
    _, refusals = of(DAY, requests=["manager_combined"])
    assert list(refusals) == ["combined"]
    with pytest.raises(
        DesatError, match=r"predictve: no law and no manager.*predictive"
    ):
        of(DAY, requests=["predictve"])


def test_terms_of_a_field():
    result = compatibility.terms_of(5400.0, [[3e-5, 0.0, 4e-5]], True)
    assert (result.orbit_rate, result.field) == (
        pytest.approx(2.0 * pi / 5400.0),
        pytest.approx(5e-5),
    )
