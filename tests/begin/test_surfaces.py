"""Faces, wings and dish of a new craft: their torques beside an own calculation, their
inertia, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desat.analyses.flight import fly_days, wanted_attitude
from desat.begin.body import body_of
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.begin.surfaces import surfaces_of
from desat.files.hardware import classes, quantity
from desat.numbers.derived import rotate
from desat.runs.prepare import resolved
from desat.system.body import homogeneous_inertia
from desat.system.errors import DesatError
from desat.system.options import Options
from tests.conftest import ROOT

PRESSURE = 4.56e-6  # N/m2
SPIN = 7.292115e-5  # rad/s, of the Earth
THRUST = {"rods": "none", "thrusters": "4 1N", "dump": "thrusters 70:10"}
CRAFTS = {
    "nadir": {"altitude": "400km", "box": "0.1,0.3,0.6", "mass": "12kg"},
    "sun": {"sso": "500km", "pointing": "sun", "wings": ["2 x 0.4m2 0.8m"]},
    "inertial": {
        "altitude": "350km",
        "pointing": "inertial",
        "wings": ["1m2 1.1m +x fixed +z 3kg/m2 0.1/0.2"],
        "mass": "80kg",
    },
    "geo": {
        "orbit": "geo",
        "mass": "2500kg",
        "pointing": "yaw",
        "wings": ["2 x 20m2 6m y"],
        "dish": "1.6m +x 2.4m",
        "cp": "5cm,-3cm,10cm",
        **THRUST,
    },
    "deep": {
        "sun": "1.5AU",
        "mass": "700kg",
        "wings": ["13m2 3.2m +y"],
        "dish": "2m +z 1.5m",
        **THRUST,
    },
    "ahead": {
        "altitude": "420km",
        "mass": "150kg",
        "wings": ["2 x 1.2m2 0,1.6,-0.4m y"],
    },
}


def light_and_drag(system, flight):
    """Return the torques (rows, 3; N m, body) of light and drag, from the craft's
    parameters alone, surface by surface."""
    craft = system.components["spacecraft"].values
    rows = np.reshape(craft["plates"], (-1, 9))
    drives = np.reshape(craft["drive_plate"], (-1, 3))
    q = flight.inputs["q_bi"]
    sun = rotate(q, flight.inputs["sun_eci"])
    wind = flight.inputs["v_eci"] - np.cross([0.0, 0.0, SPIN], flight.inputs["r_eci"])
    wind = rotate(q, wind)
    push = PRESSURE * flight.inputs["sunlight"]
    head = 0.5 * flight.inputs["density"] * craft["drag_coefficient"]
    light, drag = np.zeros_like(sun), np.zeros_like(sun)
    for row, axis in zip(rows, drives, strict=True):
        if row[3] == 0.0:
            continue
        normal, area = np.tile(row[:3], (len(sun), 1)), row[3]
        centre = row[4:7] + craft["offset_plates_body"]
        if axis.any():
            axis = axis / np.linalg.norm(axis)
            normal = sun - (sun @ axis)[:, None] * axis
            normal /= np.linalg.norm(normal, axis=1)[:, None]
        cos = (sun * normal).sum(axis=1, keepdims=True)
        specular, diffuse = row[7:9]
        force = (1 - specular) * sun + 2 * (specular * cos + diffuse / 3) * normal
        light += np.where(cos > 0, np.cross(centre, -push * area * cos * force), 0.0)
        across = (wind * normal).sum(axis=1, keepdims=True)
        across = np.abs(across) if axis.any() else np.maximum(across, 0.0)
        drag += np.cross(centre, -head * area * across * wind)
    return light, drag


@pytest.mark.parametrize("name", CRAFTS)
def test_torques_are_those_of_each_surface(tmp_path, name):
    write(tmp_path / name, CraftFacts(**CRAFTS[name]), "")
    system, _ = resolved(str(tmp_path / name), Options())
    flight = fly_days(system, wanted_attitude(system))
    for source, torque in zip(
        ("radiation", "drag"), light_and_drag(system, flight), strict=True
    ):
        q = flight.inputs["q_bi"].copy()
        q[:, :3] *= -1.0
        ours = np.gradient(flight.sources[source], flight.times, axis=0)
        inertial = rotate(q, torque)
        # a difference over two rows is the mean of the trapezoids around a row
        mean = (inertial[:-2] + 2.0 * inertial[1:-1] + inertial[2:]) / 4.0
        size = np.abs(mean).max()
        assert np.abs(ours[1:-1] - mean).max() <= 1e-3 * size
        if source == "radiation" or name in ("nadir", "ahead", "inertial"):
            assert size > 0.0


def test_the_side_that_the_sun_sees_counts():
    """`--box 3,3,0.5` and `0.5,3,3` both had 9 m2 to the Sun at +z."""
    largest = {}
    for box in ("3,3,0.5", "0.5,3,3"):
        facts = CraftFacts(box=box, mass="500kg", cp="0.1,0.1,0")
        body = body_of(facts)
        surfaces = surfaces_of(facts, body.sides, body.parts, True)
        largest[box] = surfaces.light([(0.0, 0.0, 1.0)])
    arm = math.hypot(0.1, 0.1)
    assert largest["3,3,0.5"] == pytest.approx(PRESSURE * 1.5 * 9.0 * arm)
    assert largest["0.5,3,3"] == pytest.approx(PRESSURE * 1.5 * 1.5 * arm)


@given(
    st.tuples(*(st.floats(0.1, 4.0),) * 3),
    st.tuples(*(st.floats(-1.0, 1.0),) * 3).filter(lambda x: np.linalg.norm(x) > 0.1),
)
@settings(max_examples=50)
def test_a_body_about_its_middle_has_no_torque(sides, sun):
    """Of light as of wind: only an offset gives one."""
    facts = CraftFacts(
        box=",".join(map(str, sides)), mass=f"{200 * math.prod(sides)}kg", cp="0,0,0"
    )
    body = body_of(facts)
    surfaces = surfaces_of(facts, body.sides, body.parts, True)
    size = PRESSURE * max(sides) ** 3
    assert surfaces.light([np.array(sun) / np.linalg.norm(sun)]) <= 1e-12 * size
    assert surfaces.lever <= 1e-12 * max(sides) ** 3


def test_wings_add_to_the_body():
    """They replaced its area: a craft with a panel at its middle had no dump."""
    plain = CraftFacts(mass="500kg", box="1.5,1.5,2")
    winged = CraftFacts(mass="500kg", box="1.5,1.5,2", panel="8m2 0m")
    light = []
    for facts in (plain, winged):
        body = body_of(facts)
        surfaces = surfaces_of(facts, body.sides, body.parts, True)
        light.append(surfaces.light([(0.0, 0.0, 1.0)]))
    assert light[1] > light[0] > 0.0


def test_inertia_of_wings():
    """A pair of 3 m2 at 2 m: the parallel axes, and plates turned about y."""
    facts = CraftFacts(mass="200kg", box="1,1,1", wings=["2 x 3m2 2m y 2kg/m2"])
    body = body_of(facts)
    a, b, c = homogeneous_inertia(200.0 - 12.0, (1.0, 1.0, 1.0))
    length, width = 3.0, 1.0  # from the body's side at 0.5 m to 3.5 m
    along, across = 6.0 * length**2 / 12.0, 6.0 * width**2 / 12.0
    out = 6.0 * 2.0**2 + along + 0.5 * across
    assert body.inertia == pytest.approx((a + 2 * out, b + 2 * across, c + 2 * out))


@pytest.mark.parametrize(
    ("facts", "text"),
    [
        ({"wings": ["2 x 3m2 0.4m y"]}, "lies in the body, whose side is 0.5 m away"),
        ({"wings": ["2 x -3m2 2m"]}, "above 0"),
        ({"wings": ["2 x 3m2 2m +y"]}, "a pair has both sides: y"),
        ({"wings": ["3m2 2m y fixed"]}, r"fixed to which side, as fixed \+z"),
        ({"wings": ["3m2 2m y 0.7/0.6"]}, "0.7/0.6 of the light are reflected: 1 at"),
        ({"wings": ["3m2 2m y steel"]}, r"the form is AREA ARM .*\(steel\?\)"),
        ({"wings": ["3m2"]}, "the form is AREA ARM"),
        ({"wings": ["3m2 0,2,1m"]}, "one arm is needed; a pair may have three"),
        ({"wings": ["2 x 30m2 5m"]}, "weigh 240 kg of 200 kg"),
        ({"wings": ["2 x 1m2 2m fixed +z"] * 3}, "18 surfaces with the body; 16"),
        ({"dish": "1.2m 1m"}, "diameter, side and arm are needed"),
        ({"dish": "1.2m +x 0.3m"}, "lies in the body"),
        ({"panel": "8m2"}, "area and arm are needed"),
        ({"panel": "8m2 -1m"}, "0 to 100 m"),
        ({"cp": "60cm,0cm,0cm"}, "it lies outside the body of 1 x 1 x 1 m"),
        ({"cp": "1cm,2cm"}, "one offset, of unknown direction, or three"),
        ({"mass": "200kg +-100%"}, "less than 100 % is needed"),
        ({"mass": "200kg +-300kg"}, "as wide as the value"),
        ({"mass": "200kg +-10% +-5%"}, "one spread is needed"),
        ({"inertia": "30,30,30 +-40"}, "as wide as the value"),
    ],
)
def test_what_is_refused(facts, text):
    everything = CraftFacts(**{"mass": "200kg", "box": "1,1,1", **facts})

    def surfaces():
        body = body_of(everything)
        return surfaces_of(everything, body.sides, body.parts, True)

    with pytest.raises(DesatError, match=text):
        surfaces()


def test_the_page_of_what_is_assumed_has_the_values_of_the_classes():
    text = " ".join((ROOT / "docs/assumed.md").read_text().split())
    of = classes()
    for name, title in (("nano", "below 30 kg"), ("small", "others")):
        figures = of["dipoles"][name]
        share = 1e3 * quantity("", figures["share"], "A.m2")
        assert f"residual dipole, {title} | {share:g} mA m2 a kilogram" in text
        row = text.partition(f"residual dipole, {title} |")[2].partition(" | NASA")[0]
        assert f"times or divided by {figures['factor']}" in row or name == "small"
        rods = 1e3 * quantity("", figures["rods"], "A.m2")
        assert re.search(rf"\| rods \|.*\b{rods:g}\b", text)
    for name, title in (
        ("offset", "centre of pressure"),
        ("drag", "drag coefficient"),
        ("inertia", "inertia"),
    ):
        row = text.partition(f"| {title} |")[2].partition(" | | ")[0]
        assert f"times or divided by {of['assumed'][name]['factor']}" in row
    body, wings = of["surfaces"]["body"], of["surfaces"]["wings"]
    for figures, title in ((body, "body"), (wings, "wings")):
        mirrored, scattered = (
            100.0 * float(figures[k]) for k in ("specular", "diffuse")
        )
        assert (
            f"reflected light, {title} | {mirrored:g} % mirrored, {scattered:g} % "
            "scattered" in text
        )
    assert f"| {wings['mass'].split()[0]} kg/m2 each" in text
