"""What thrusters push and use by schedule, and what a magnetometer sees of the coils."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.analyses import firings
from desat.analyses.firings import FiringParts
from desat.analyses.manifest import Manifest
from desat.components.blocks.magnetometer import Magnetometer
from desat.components.blocks.thrusters import Thrusters
from desat.components.blocks.thrusters_nozzles import NOZZLES, ThrustersNozzles
from desat.components.blocks.torquers import Torquers
from desat.components.contract.block import Block
from desat.engine.recording.memory import File
from desat.engine.recording.results import Results

EXHAUST = 9.80665 * 68.0  # m/s, of the start value of the specific impulse


def begin(block: Block, **parameters: object) -> Block:
    variables = {v.name: v for v in block.variables}
    for name, value in parameters.items():
        v = variables[name]
        if v.choices:
            value = v.choices.index(value)
        if v.shape and len(value) < v.size:
            value = (*value, *(0.0,) * (v.size - len(value)))
        setattr(block, name, value)
    block.check()
    block.start()
    block.output(0.0)
    return block


def run(block: Block, stop: float, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Angular impulse and impulse of the force over the steps to `stop`."""
    turn, push = np.zeros(3), np.zeros(3)
    for k in range(round(stop / dt)):
        block.advance(k * dt, dt)
        turn += dt * np.array(block.tau_mean_thruster_body)
        push += dt * np.array(block.force_mean_thruster_body)
    block.output(stop)
    return turn, push


# --- scheduled firings ----------------------------------------------------------------


@pytest.mark.parametrize("kind", [Thrusters, ThrustersNozzles])
@pytest.mark.parametrize("dt", [0.1, 1.0, 10.0])
def test_force_and_propellant_of_scheduled_firings(kind, dt):
    """I = F t, m = |F| t / (g0 I_sp), whatever the step; no part of the momentum
    manager's."""
    block = begin(
        kind(),
        sample_time=40.0,
        schedule_start=(3.3, 20.17),
        schedule_duration=(10.0, 1.234),
        schedule_tau_body=(1e-3, 0.0, 0.0, 0.0, 2e-3, 0.0),
        schedule_force_body=(3.0, 0.0, 4.0, 0.0, 0.0, 1.0),
    )
    turn, push = run(block, 40.0, dt)
    assert push == pytest.approx([30.0, 0.0, 41.234], rel=1e-12)
    assert turn == pytest.approx([1e-2, 2e-3 * 1.234, 0.0], rel=1e-12)
    assert block.schedule_propellant == pytest.approx(
        (5.0 * 10.0 + 1.234) / EXHAUST, rel=1e-12
    )
    assert block.schedule_on_time == pytest.approx(11.234, rel=1e-12)
    assert (block.on_time, block.propellant) == (0.0, 0.0)


def test_scheduled_nozzles():
    """Two nozzles push along x at +-0.3 m, one at 60 % so that its torque turns the
    craft."""
    block = begin(
        ThrustersNozzles(),
        sample_time=40.0,
        position_nozzle=(0.0, 0.3, 0.0, 0.0, -0.3, 0.0),
        direction_nozzle=(1.0, 0.0, 0.0, 1.0, 0.0, 0.0),
        thrust=(2.0, 2.0),
        schedule_start=(5.5,),
        schedule_duration=(20.0,),
        schedule_nozzle=(1.0, 0.6),
    )
    turn, push = run(block, 40.0, 1.0)
    assert push == pytest.approx([2.0 * 1.6 * 20.0, 0.0, 0.0], rel=1e-12)
    assert turn == pytest.approx([0.0, 0.0, -0.3 * 2.0 * 0.4 * 20.0], rel=1e-12)
    assert block.on_time_nozzle == pytest.approx((20.0, 12.0, *(0.0,) * 6), rel=1e-12)
    assert block.schedule_propellant == pytest.approx(2.0 * 32.0 / EXHAUST, rel=1e-12)
    assert (block.on_time, block.propellant) == (0.0, 0.0)


command = st.floats(-0.05, 0.05)


@given(st.tuples(command, command, command), st.sampled_from([0.25, 1.0, 5.0]))
def test_force_of_commanded_nozzles(torque, dt):
    """Each nozzle's on-time times its force and torque; their sum is the on-time."""
    block = begin(ThrustersNozzles(), sample_time=5.0)
    block.tau_cmd_thruster_body = torque
    turn, push = run(block, 15.0, dt)
    times = np.array(block.on_time_nozzle)
    assert times.sum() == pytest.approx(block.on_time, abs=1e-12)
    force = 0.1 * np.reshape(block.direction_nozzle, (NOZZLES, 3))
    assert push == pytest.approx(times @ force, abs=1e-12)
    arms = np.reshape(block.position_nozzle, (NOZZLES, 3))
    assert turn == pytest.approx(times @ np.cross(arms, force), abs=1e-12)


def test_a_pair_has_no_force():
    block = begin(Thrusters(), sample_time=1.0)
    block.tau_cmd_thruster_body = (0.03, -0.02, 0.01)
    turn, push = run(block, 10.0, 1.0)
    assert any(turn)
    assert not any(push)


# --- coils seen by the magnetometer ---------------------------------------------------


def of_dipole(r: tuple[float, float, float]) -> tuple[float, ...]:
    """mu_0 / (4 pi r^3) (3 u u' - 1): the field of a dipole at the origin, at r (m)."""
    size = math.dist(r, (0.0, 0.0, 0.0))
    u = np.array(r) / size
    return tuple((1e-7 / size**3 * (3 * np.outer(u, u) - np.eye(3))).ravel().tolist())


def test_field_of_a_coil_at_the_magnetometer():
    """On the axis mu_0 m / (2 pi r^3), beside it minus half of that, turned by no
    attitude."""
    block = begin(Magnetometer(), coil_coupling=of_dipole((0.0, 0.0, 0.5)))
    block.q_bi, block.b_eci, block.m_body = (
        (0.5, 0.5, 0.5, 0.5),
        (0.0, 0.0, 0.0),
        (0.0, 0.0, 2.0),
    )
    block.advance(0.0, 1.0)
    on_axis = 4e-7 * math.pi * 2.0 / (2 * math.pi * 0.5**3)
    assert block.b_body == pytest.approx((0.0, 0.0, on_axis), rel=1e-12)
    block.m_body = (2.0, 0.0, 0.0)
    block.advance(1.0, 1.0)
    assert block.b_body == pytest.approx((-on_axis / 2, 0.0, 0.0), rel=1e-12)


def test_without_coupling_no_dipole_is_seen():
    block = begin(Magnetometer())
    block.b_eci, block.m_body = (1e-5, 2e-5, 3e-5), (math.nan,) * 3
    block.advance(0.0, 1.0)
    assert block.b_body == (1e-5, 2e-5, 3e-5)


@pytest.mark.parametrize("lags", [3, 4, 5])
def test_interleaving_leaves_the_decay(lags):
    """Coils on for half of each period and off for some of their lags before each
    sample: what the magnetometer still sees is e^-lags of the dipole, as paper 004 asks
    for three at least."""
    lag, step = 0.08, 0.02
    on = 0.5
    period = round((on + lags * lag) / step) * step
    coils = begin(
        Torquers(),
        drive="pulsed",
        sample_time=period,
        lag=lag,
        m_limit=0.3,
        duty_max=on / period,
        least_pulse=step,
    )
    sensor = begin(
        Magnetometer(), sample_time=period, coil_coupling=of_dipole((0.3, 0.0, 0.0))
    )
    always = begin(
        Magnetometer(), sample_time=step, coil_coupling=of_dipole((0.3, 0.0, 0.0))
    )
    coils.m_cmd_body = (0.3, 0.0, 0.0)
    at_samples, at_all = [], []
    for k in range(round(5 * period / step)):
        coils.output(k * step)
        sensor.m_body = always.m_body = coils.m_body
        sensor.advance(k * step, step)
        always.advance(k * step, step)
        at_samples.append(sensor.b_body[0])
        at_all.append(always.b_body[0])
        coils.advance(k * step, step)
    full = 2e-7 * 0.3 / 0.3**3
    assert max(at_all) == pytest.approx(full, rel=3e-3)
    off = period - on
    assert max(at_samples) == pytest.approx(full * math.exp(-off / lag), rel=0.01)
    assert max(at_samples) < 1.01 * full * math.exp(-lags)


# --- what is said of firings ----------------------------------------------------------


def remarks_of(command: tuple[float, ...], firing: tuple[float, ...]) -> list[str]:
    """Return what is said of two firings of 10 s about each axis (N m s).

    The wheels hold 1 N m s at most.
    """
    series = {
        "manager/tau_cmd_thruster_body": np.array([command, command]) / 20.0,
        "thrusters/tau_mean_thruster_body": np.array([firing, firing]) / -20.0,
        "thrusters/on_time": np.array([0.0, 0.5, 1.0]),
        "craft/h_copy_wheel": np.array([[0.2, -1.0], [0.1, 0.3], [0.0, 0.1]]),
    }
    file = File()
    file.create_dataset("time", dtype=float).append(np.array([0.0, 10.0, 20.0]))
    for name, rows in series.items():
        file.create_dataset(name, rows.shape[1:], float).append(rows)
    parts = FiringParts("manager", "thrusters", "craft", scheduled=False)
    manifest = Manifest(status="completed", parts={firings.KEY: parts})
    return firings.remarks(manifest, Results(file))


def test_an_axis_that_fires_less_than_half_of_its_command_is_told():
    (line,) = remarks_of((0.4, 0.4, 0.0), (0.204, 0.196, 0.0))
    assert "commanded 0.4 N m s about y, fired 0.196" in line


def test_a_command_below_a_hundredth_of_the_momentum_is_ignored():
    assert remarks_of((0.0099, 0.0, 0.0), (0.0, 0.0, 0.0)) == []
    (line,) = remarks_of((0.0101, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert "commanded 0.0101 N m s about x, fired 0" in line
