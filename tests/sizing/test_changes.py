"""The smallest change with which a craft that cannot hold its momentum would."""

from __future__ import annotations

import re
from dataclasses import replace
from math import radians

import pytest

from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.sizing import dumps, sizing
from desat.sizing.requirements import SizingRequirements
from desat.system.options import Options
from tests.conftest import slow_after

ALONE = SizingRequirements(flown=False, year=False, laws=False)
GEO = CraftFacts(
    orbit="geo",
    mass="2500kg",
    wheels="4 pyramid 20Nms",
    thrusters="4 10N",
    dump="thrusters 90:10",
)


def size_rods(folder, **values):
    return sizing.size(str(folder), Options(values=values), ALONE)


@pytest.fixture(scope="module")
def cubesat(tmp_path_factory):
    folder = tmp_path_factory.mktemp("changes") / "mine"
    write(folder, CraftFacts(size="12U", sso="550km"), "")
    return folder


@pytest.mark.parametrize(
    ("name", "factor", "pattern"),
    slow_after(
        1,
        [
            ("torquers.m_limit", 0.05, r"Rods of (\S+) A m2 would do"),
            ("wheels.speed_limit", 0.2, r"Wheels of (\S+) mN m s each would do"),
        ],
        "study",
    ),
)
def test_what_would_do_does(cubesat, name, factor, pattern):
    first = size_rods(cubesat)
    assert not first.problems
    assert first.change == ""
    value = {"torquers.m_limit": first.rod, "wheels.speed_limit": 680.678}[name]
    short = size_rods(cubesat, **{name: factor * value})
    assert short.problems
    match = re.search(pattern, short.answer)
    assert match is not None, short.answer
    value_needed = float(match[1])
    if name == "wheels.speed_limit":
        value_needed *= value / (1e3 * first.wheel_capacity)
    enough = size_rods(cubesat, **{name: value_needed})
    assert not enough.problems
    assert min(m.margin for m in enough.margins if m.case.startswith("the day")) < 0.4


def size_dumps(folder, requirements=ALONE, **values):
    return dumps.size(str(folder), Options(values=values), requirements)


@pytest.fixture(scope="module")
def geo(tmp_path_factory):
    folder = tmp_path_factory.mktemp("changes") / "geo"
    write(folder, GEO, "")
    return folder


@pytest.mark.study
def test_a_longer_slew_does(geo):
    slew = replace(ALONE, slew_angle=radians(30.0), slew_time=60.0)
    short = size_dumps(geo, slew)
    match = re.search(r"A slew of (\S+) min would do", short.change)
    assert match is not None, short.answer
    longer = replace(slew, slew_time=60.0 * float(match[1]) * 1.005)
    assert not size_dumps(geo, longer).problems


@pytest.mark.study
def test_an_earlier_dump_does(geo):
    short = size_dumps(geo, **{"manager.begin": 19.9})
    match = re.search(r"Dumps that begin at (\S+) % of a wheel", short.change)
    assert match is not None, short.answer
    enough = size_dumps(geo, **{"manager.begin": 0.2 * float(match[1])})
    assert not enough.problems
