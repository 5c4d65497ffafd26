"""The plant's reference trajectory, and the torques on a rigid body."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import desat as library
from desat.analyses import motion
from desat.begin.craft import write
from desat.begin.facts import CraftFacts
from desat.components.blocks.spacecraft_rigid import SpacecraftRigid
from desat.components.contract.block import BlockError
from desat.components.maths import vector
from desat.components.maths.attitude import normalise, rotate, rotate_back
from desat.components.maths.vector import ZERO
from desat.components.physics import torques
from desat.components.physics.gyrostat import carrier_inertia, inverse_inertia
from desat.components.physics.orbit import MU
from desat.runs.run import execute
from desat.system.model import Parameter
from desat.system.options import Options
from tests.conftest import ROOT

TRUTH = np.loadtxt(
    ROOT / "tests" / "authorities" / "plant_reference_highprec.csv",
    delimiter=",",
    skiprows=1,
)
number = st.floats(-1, 1, allow_nan=False)
vec3 = st.tuples(number, number, number)


def axes_of(run) -> np.ndarray:
    return np.reshape(
        run.manifest["parameters"]["wheels"]["axes_wheel"]["value"], (3, 4)
    )


@pytest.mark.parametrize("step", [1.0, 10.0])
def test_reference_trajectory(step):
    """|dq| < 1e-7 and |d Omega| < 1e-8 rad/s over 6000 s at the default step (1 s)."""
    run = execute(
        "plant/reference", Options(step=step, record=("spacecraft.*", "wheels.*"))
    )
    every = round(10 / step)
    q = run.results.values("spacecraft.q_bi")[::every]
    truth = TRUTH[:, [2, 3, 4, 1]]  # scalar first there
    sign = np.sign((q * truth).sum(axis=1, keepdims=True))
    assert np.abs(q - sign * truth).max() < 1e-7
    omega = run.results.values("spacecraft.omega_bi_body")[::every]
    assert np.abs(omega - TRUTH[:, 5:8]).max() < 1e-9
    spin = run.manifest["parameters"]["wheels"]["inertia_wheel"]["value"]
    speed = run.results.values("wheels.h_wheel")[::every] / spin - omega @ axes_of(run)
    assert np.abs(speed - TRUTH[:, 8:]).max() < 1e-8
    answer = run.results.values("wheels.speed_wheel")[::every]  # of each step's begin
    assert np.abs(answer - speed[: len(answer)]).max() < 1e-10
    assert run.manifest["numbers"]["momentum_residual"]["value"] < 1e-14


def test_gravity_gradient_is_the_differential_force():
    """Against point masses in the field of a point."""
    r, rng = np.array([4e6, -5e6, 2.5e6]), np.random.default_rng(3)
    places, masses = rng.normal(size=(6, 3)), rng.uniform(1, 5, 6)
    places -= (masses[:, None] * places).sum(axis=0) / masses.sum()
    inertia = sum(
        m * (p @ p * np.eye(3) - np.outer(p, p))
        for m, p in zip(masses, places, strict=True)
    )
    total = np.zeros(3)
    for m, p in zip(masses, places, strict=True):
        # the quadratic term in p/r is 1e-7 of it
        total += np.cross(p, -MU * m * (r + p) / np.linalg.norm(r + p) ** 3)
    torque = torques.gravity_gradient(tuple(r), tuple(inertia.ravel()))
    assert np.allclose(torque, total, rtol=1e-5, atol=1e-12)


@given(vec3, vec3)
def test_drag_and_radiation_on_an_area(v, centre):
    speed = vector.scale(7500.0, v)
    torque = np.cross(
        centre, -0.5 * 1e-12 * 2.2 * np.linalg.norm(speed) * np.array(speed)
    )
    # torques of up to 3e-4 N m: what cancels in one leaves 1e-20 in the other
    assert np.allclose(
        torques.drag(speed, 1e-12, 2.2, centre), torque, rtol=1e-12, atol=1e-18
    )
    torque = np.cross(centre, -4.56e-6 * 1.5 * np.array(v))
    assert np.allclose(torques.radiation(v, 4.56e-6, 1.5, centre), torque, atol=1e-20)


def plate(normal, area, centre, specular=0.0, diffuse=0.0) -> torques.Plates:
    row = (*normal, area, *centre, specular, diffuse)
    return torques.plates_of(row + (0.0,) * 9, ZERO)


def test_plates():
    box = plate((1, 0, 0), 2.0, (0, 0.1, 0)) + plate((-1, 0, 0), 2.0, (0, 0.1, 0))
    v = (7500.0, 0.0, 0.0)
    # only the plate that faces the flow counts, and head on it is its area
    assert torques.drag_on_plates(
        v, 1e-12, 2.2, box, (ZERO,) * len(box)
    ) == pytest.approx(torques.drag(v, 1e-12, 2.2 * 2.0, (0, 0.1, 0)))
    black = torques.radiation_on_plates((1, 0, 0), 4.56e-6, box)
    assert black == pytest.approx(
        torques.radiation((1, 0, 0), 4.56e-6, 2.0, (0, 0.1, 0))
    )
    mirror = plate((1, 0, 0), 2.0, (0, 0.1, 0), specular=1.0)
    # a mirror is pushed twice as hard, along its normal
    assert torques.radiation_on_plates((1, 0, 0), 4.56e-6, mirror) == pytest.approx(
        [2 * x for x in black]
    )
    s = (0.6, 0.8, 0.0)
    mirror_torque = torques.radiation_on_plates(s, 4.56e-6, mirror)
    assert mirror_torque == pytest.approx(
        np.cross((0, 0.1, 0), [-4.56e-6 * 2 * 2 * 0.36, 0, 0])
    )


def rigid(**values) -> SpacecraftRigid:
    block = SpacecraftRigid()
    block.gravity_gradient = False
    for name, value in values.items():
        setattr(block, name, value)
    block.start()
    block.output(0.0)
    return block


@given(
    vec3, st.tuples(number, number, number, number), st.sampled_from([0.1, 1.0, 10.0])
)
def test_momentum_is_constant_to_the_last_bit_without_torque(omega, h, dt):
    block = rigid(omega_start_body=vector.scale(0.1, omega), h_wheel=h)
    start = block._momentum
    block.tau_mean_wheel, block.tau_slope_wheel = (
        (0.01, -0.02, 0.005, 0.0),
        (0.1, 0.2, 0.0, 0.0),
    )
    for k in range(5):
        block.advance(k * dt, dt)
        block.output((k + 1) * dt)
    assert block._momentum == start
    assert block.impulse_eci == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("source", ["thruster", "dipole", "ext", "disturbance"])
def test_impulse_is_torque_times_time(source):
    """A body that cannot turn (huge inertia) takes the impulse of each source."""
    values = {
        "inertia": tuple(x * 1e9 for x in (1, 0, 0, 0, 1, 0, 0, 0, 1)),
        "b_eci": (0, 3e-5, 0),
    }
    if source == "thruster":
        values["tau_mean_thruster_body"] = (0.01, 0.0, 0.0)
    elif source == "dipole":
        values["m_mean_body"] = (0.0, 0.0, -0.01 / 3e-5)  # m x B = +x
    elif source == "ext":
        values["tau_ext_body"] = (0.01, 0.0, 0.0)
    else:
        values["tau_disturbance_body"] = (0.01, 0.0, 0.0)
    block = rigid(**values)
    block.advance(0.0, 2.0)
    block.output(2.0)
    assert block.impulse_eci == pytest.approx((0.02, 0.0, 0.0), abs=1e-9)


@given(vec3)
def test_slope_moves_impulse_in_time(direction):
    """A torque with mean 0 and a slope S turns the body by -S T^2 / 12 J; about several
    axes it gives the impulse of second order, -T^3 (J^-1 S) x S / 120."""
    slope = vector.scale(0.1, direction)
    moments = (40.0, 50.0, 30.0)
    inertia = (40.0, 0, 0, 0, 50.0, 0, 0, 0, 30.0)
    block = rigid(
        inertia=inertia, inertia_wheel=(0.0,) * 4, tau_slope_thruster_body=slope
    )
    block.advance(0.0, 1.0)
    block.output(1.0)
    tilt = [s / j for s, j in zip(slope, moments, strict=True)]
    assert block.impulse_eci == pytest.approx(-np.cross(tilt, slope) / 120.0, abs=1e-9)
    rotation = [2 * x for x in block.q_bi[:3]]
    assert rotation == pytest.approx([-x / 12 for x in tilt], abs=2e-8)


def test_starts_relative_to_the_orbit():
    block = rigid(start_frame=1, r_eci=(7e6, 0, 0), v_eci=(0, 0, 7.5e3))
    assert rotate(block.q_bi, (-1, 0, 0)) == pytest.approx(
        (0, 0, 1), abs=1e-15
    )  # z to nadir
    rate = rotate_back(block.q_bi, block.omega_bi_body)
    assert rate == pytest.approx(
        (0, -7.5e3 / 7e6, 0), abs=1e-15
    )  # about the orbit normal


def test_bad_inertia_is_named():
    for bad in ((1, 0, 0, 0, 1, 0, 0, 0, -1), (1, 0.5, 0, 0, 1, 0, 0, 0, 1)):
        with pytest.raises(BlockError, match="not symmetric and positive"):
            inverse_inertia(tuple(float(x) for x in bad))
    carrier = carrier_inertia(
        (1, 0, 0, 0, 1, 0, 0, 0, 1), (1, 0, 0, 0) + (0,) * 8, (2.0, 0, 0, 0)
    )
    with pytest.raises(BlockError):
        inverse_inertia(carrier)


def test_a_driven_panel_faces_the_sun_as_a_flat_area_does() -> None:
    sun = normalise((0.3, 0.5, -0.8, 0.0))[:3]
    rows = (1.0, 0.0, 0.0, 2.0, 0.0, -1.5, 0.0, 0.0, 0.0) + (0.0,) * 9 * 15
    drives = (0.0, 3.0, 0.0) + (0.0,) * 45
    plates = torques.plates_of(rows, ZERO)
    sunward_plates = torques.facing(plates, torques.drives_of(rows, drives), sun)
    across = math.sqrt(sun[0] ** 2 + sun[2] ** 2)
    # a black plate whose normal is as near to the Sun as its drive lets it: cos is |s
    # across|
    flat_torque = torques.radiation(sun, 1.0, 2.0 * across, (0.0, -1.5, 0.0))
    assert torques.radiation_on_plates(sun, 1.0, sunward_plates) == pytest.approx(
        flat_torque
    )
    undriven_plates = torques.facing(plates, torques.drives_of(rows, (0.0,) * 48), sun)
    assert undriven_plates == plates


@pytest.mark.parametrize("source", ["radiation", "drag"])
def test_a_wing_whose_axis_points_to_the_sun_stays(source: str) -> None:
    """Beside the block: where nothing turns it, it was not a number."""
    rows = (0.0, 1.0, 0.0, 2.0, 0.0, -1.5, 0.3, 0.1, 0.1) + (0.0,) * 9 * 15
    craft = SpacecraftRigid()
    craft.plates, craft.drive_plate = rows, (1.0, 0.0, 0.0) + (0.0,) * 45
    craft.radiation = craft.aerodynamics = 2
    craft.sun_eci, craft.sunlight = (1.0, 0.0, 0.0), 1.0
    craft.r_eci, craft.v_eci = (7e6, 0.0, 0.0), (0.0, 7.5e3, 0.0)
    craft.density = 1e-12 if source == "drag" else 0.0
    craft.check()
    craft.start()
    inputs = {
        name: np.array([getattr(craft, name)], float).reshape(1, -1)
        for name in motion.INPUTS
    }
    values = {v.name: getattr(craft, v.name) for v in craft.variables}
    parameters = {k: Parameter(x, "1") for k, x in values.items()} | {
        "radiation": Parameter("plates", "1"),
        "aerodynamics": Parameter("plates", "1"),
        "gravity_gradient": Parameter(False, "1"),
    }
    torque = motion.torque(parameters, inputs, 1.0)(0.0, np.array([[0.0, 0, 0, 1.0]]))
    surfaces = craft._surfaces(1.0)
    assert surfaces is not None
    ours = surfaces(0.0, (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0))
    assert torque[0] == pytest.approx(ours, rel=1e-12, abs=1e-20)
    assert np.any(torque) == (source == "drag")


def test_driven_panels_balance_in_a_run(tmp_path: Path) -> None:
    """The torque that is computed outside the body, from its parameters, is its own."""
    write(
        tmp_path / "mine",
        CraftFacts(
            orbit="geo",
            size="12U",
            rods="none",
            thrusters="4 50mN",
            dump="thrusters 70:10",
            pointing="yaw",
        ),
        "",
    )
    rows = [[1, 0, 0, 0.5, 0, -0.4, 0, 0.1, 0.1], [1, 0, 0, 0.3, 0, 0.4, 0, 0.0, 0.2]]
    run = library.run(
        str(tmp_path / "mine"),
        {
            "spacecraft.radiation": "plates",
            "spacecraft.plates": rows,
            "spacecraft.drive_plate": [[0, 1, 0], [0, 1, 0]],
        },
        stop=20000.0,
    )
    residual = run.manifest.numbers["impulse_mismatch"].value
    largest = np.abs(run.results.values("spacecraft.impulse_eci")).max()
    assert residual < 1e-6 * largest
