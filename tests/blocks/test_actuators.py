"""Torquers and thrusters against closed forms, quadrature and scipy's optimisers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import linprog, nnls

from desat.components.bases.pulses import STANDARD_GRAVITY
from desat.components.contract.block import Block, BlockError
from desat.components.maths import moments
from desat.components.maths.allocation import least_on_times
from desat.components.physics.wheel_array import pseudo_inverse
from desat.fmus import registry
from tests.contract.test_block import begin as begin_block
from tests.contract.test_block import fresh

STEPS = (0.01, 0.05, 0.1, 0.125, 0.25, 0.5, 1.0, 2.0, 10.0)
IDEAL, LIMITED, PULSED = range(3)
CENTRED = 1
# four coils in general position, as columns
SKEWED = (
    np.array([[1.0, -1.0, -1.0, 1.0], [1.0, 1.0, -1.0, -1.0], [1.0, 1.0, 1.0, 1.0]])
    / 3**0.5
)
OUTPUT = {"torquers": "m_{}_body", "thrusters": "tau_{}_thruster_body"}

dipole = st.floats(-60, 60)
command = st.tuples(dipole, dipole, dipole)


def begin(name: str, **parameters) -> Block:
    block = registry.block_class(name)()
    for key, value in parameters.items():
        assert hasattr(block, key)
        setattr(block, key, value)
    block.check()
    block.start()
    block.output(0.0)
    return block


def moments_of(block: Block) -> tuple[np.ndarray, np.ndarray]:
    """Mean and slope of the step just made."""
    return tuple(
        np.array(getattr(block, OUTPUT[block.role].format(x)))
        for x in ("mean", "slope")
    )  # type: ignore[return-value]


def run(
    block: Block, dt: float, stop: float, begin: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Impulse, and first moment about t = begin, over the steps to `stop`."""
    impulse, first = np.zeros(3), np.zeros(3)
    for k in range(round((stop - begin) / dt)):
        t = begin + k * dt
        block.advance(t, dt)
        mean, slope = moments_of(block)
        impulse += dt * mean
        first += dt * (mean * (k + 0.5) * dt + slope * dt / 12.0)
    block.output(stop)
    return impulse, first


def response(t: float, u: float, lag: float, on: float, off: float) -> float:
    """A coil's dipole, at rest at t = 0, commanded to u from `on` to `off`."""
    up = 1.0 - math.exp(-max(t - on, 0.0) / lag)
    down = 1.0 - math.exp(-max(t - off, 0.0) / lag)
    return u * (up - down)


# --- moments --------------------------------------------------------------------------


@given(st.floats(0, 20), st.floats(0, 20), st.floats(0, 10), st.floats(0.01, 10))
def test_window(a, b, t, dt):
    begin, end = min(a, b), max(a, b)
    mean, slope, seconds = moments.window(begin, end, t, dt)
    first, last = np.clip([begin, end], t, t + dt)
    assert seconds == pytest.approx(last - first, abs=1e-12)
    assert mean * dt == pytest.approx(seconds, abs=1e-12)
    exact = (last**2 - first**2) / 2 - (t + dt / 2) * (last - first)
    assert slope * dt * dt / 12 == pytest.approx(exact, abs=1e-11)


@given(dipole, dipole, st.floats(1e-3, 200))
def test_first_order(x0, x1, ratio):
    def x(s):
        return x1 + (x0 - x1) * math.exp(-ratio * s)

    mean, slope, end, square = moments.first_order(x0, x1, ratio)
    knee = [min(k / ratio, 1.0) for k in (1, 5, 20)]
    assert mean == pytest.approx(quad(x, 0, 1, points=knee)[0], rel=1e-9, abs=1e-9)
    first = quad(lambda s: 12 * (s - 0.5) * x(s), 0, 1, points=knee)[0]
    assert slope == pytest.approx(first, rel=1e-8, abs=1e-8)
    assert end == pytest.approx(x(1), abs=1e-12)
    assert square == pytest.approx(
        quad(lambda s: x(s) ** 2, 0, 1, points=knee)[0], 1e-9, 1e-9
    )


# --- torquers -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("quiet", "drive", "off"),
    [
        (0.0, LIMITED, 10.0),
        (1.3, LIMITED, 8.7),
        (1.3, IDEAL, 8.7),
        (0.0, PULSED, 5.0),
        (1.3, PULSED, 5.0),
    ],
)
@pytest.mark.parametrize("lag", [0.08, 0.5, 30.0])
def test_lag_mean_slope_and_energy(quiet, drive, off, lag):
    """One step of 10 s with all edges inside it, against quadrature of the closed form."""
    u = 20.0 if drive == PULSED else 10.0
    block = begin(
        "torquers",
        lag=lag,
        sample_time=10.0,
        quiet_time=quiet,
        drive=drive,
        m_limit=20.0,
        duty_max=0.8,
        least_pulse=0.1,
        resistance=25.0,
        area_turns=150.0,
    )
    block.m_cmd_body = (0.0, -10.0, 0.0)
    impulse, first = run(block, 10.0, 10.0)

    def integral(f):
        knees = [lag, 8 * lag, off, off + lag, off + 8 * lag]
        points = sorted({p for p in knees if 0.0 < p < 10.0})
        return quad(f, 0.0, 10.0, points=points, epsabs=1e-12, epsrel=1e-12, limit=200)[
            0
        ]

    def m(t):
        return response(t, -u, lag, 0.0, off)

    square = integral(lambda t: m(t) ** 2)
    assert impulse == pytest.approx([0.0, integral(m), 0.0], rel=1e-11)
    assert first == pytest.approx([0.0, integral(lambda t: t * m(t)), 0.0], rel=1e-11)
    assert block.dipole_energy == pytest.approx(0.5 * square, rel=1e-11)
    assert block.electric_energy == pytest.approx(25.0 * square / 150.0**2, rel=1e-11)
    assert block.m_body == pytest.approx((0.0, m(10.0), 0.0), rel=1e-11)
    assert block.power == pytest.approx(25.0 * (m(10.0) / 150.0) ** 2, rel=1e-11)
    assert block.on_time == pytest.approx(off)


def test_lag_of_the_gyrostat_reference():
    """Limit 20 A m2, lag 0.08 s: the second row of gyrostat_full.csv."""
    block = begin("torquers", m_limit=20.0, lag=0.08, sample_time=1.0)
    block.m_cmd_body = (-500.0, -20.5, 90.0)
    run(block, 0.1, 1.0)
    reference = (-19.999925466936023, -19.999925466936023, 19.999925466936023)
    assert block.m_body == pytest.approx(reference, rel=1e-14)


@given(
    commands=st.tuples(command, command, command),
    count=st.integers(2, 130),
    drive=st.sampled_from([IDEAL, LIMITED, PULSED]),
    lag=st.sampled_from([0.0, 0.05, 3.0]),
    quiet=st.floats(0, 3),
    failed_coil=st.integers(0, 4),
    failed_from=st.floats(0, 30),
    failure_known=st.booleans(),
)
def test_small_steps_add_up_to_large_ones(
    commands, count, drive, lag, quiet, failed_coil, failed_from, failure_known
):
    """Impulse, first moment, energies and on-time do not depend on the step."""
    rows = []
    for dt in (10.0, 10.0 / count):
        block = begin(
            "torquers",
            axes_coil=tuple(SKEWED.ravel()),
            drive=drive,
            lag=lag,
            sample_time=10.0,
            quiet_time=quiet,
            duty_max=0.6,
            pulse_delay=0.7,
            failed_coil=failed_coil,
            failed_from=failed_from,
            failure_known=failure_known,
        )
        row = []
        for k, m in enumerate(commands):
            block.m_cmd_body = m
            row += [*run(block, dt, 10.0 * (k + 1), 10.0 * k)]
        rows.append(
            np.hstack([*row, block.dipole_energy, block.electric_energy, block.on_time])
        )
    size = max(1.0, np.abs(rows[0]).max())
    assert rows[1] == pytest.approx(rows[0], rel=1e-11, abs=1e-12 * size)


@pytest.mark.parametrize("dt", STEPS)
def test_pulses_are_quantised_and_capped(dt):
    block = begin(
        "torquers",
        drive=PULSED,
        sample_time=10.0,
        m_limit=40.0,
        duty_max=0.8,
        least_pulse=0.2,
        pulse_delay=0.5,
    )
    block.m_cmd_body = (10.3, -2.0, 70.0)
    impulse, first = run(block, dt, 10.0)
    widths = np.array(
        [2.6, 0.6, 8.0]
    )  # 2.575 and 0.5 (the half upwards) to 0.2; 80 % of 10
    sign = (1, -1, 1)
    assert impulse == pytest.approx(40.0 * widths * sign, rel=1e-12)
    assert first == pytest.approx(impulse * (0.5 + widths / 2), rel=1e-12)
    assert block.on_time == pytest.approx(widths.sum(), rel=1e-12)
    assert block.dipole_energy == pytest.approx(0.5 * 40.0**2 * widths.sum(), rel=1e-12)
    assert block.m_body == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("drive", [IDEAL, LIMITED, PULSED])
def test_no_dipole_in_the_quiet_time(drive):
    block = begin(
        "torquers",
        drive=drive,
        sample_time=1.0,
        quiet_time=0.25,
        duty_max=0.5,
        least_pulse=0.125,
    )
    block.m_cmd_body = (30.0, 30.0, -30.0)
    for k in range(3000):
        block.advance(k * 1e-3, 1e-3)
        block.output((k + 1) * 1e-3)
        on = k % 1000 < (500 if drive == PULSED else 750)  # pulses: 0.5 s of 1 s
        mean, _ = moments_of(block)
        assert np.abs(mean) == pytest.approx(
            (30.0 if drive != PULSED else 40.0) * on, abs=1e-8
        )
        assert block.m_body == pytest.approx(mean, abs=1e-8)


@pytest.mark.parametrize("name", ["torquers", "torquers_rods"])
@pytest.mark.parametrize("drive", [IDEAL, LIMITED, PULSED])
@pytest.mark.parametrize(("step", "period"), [(0.05, 1.0), (0.25, 0.5), (1.0, 1.0)])
def test_the_quiet_time_ends_at_the_sample(name, drive, step, period):
    """A magnetometer that samples with the coils measures exp(-quiet / lag) of them."""
    quiet, lag = 0.2, 0.05
    block = begin(
        name,
        drive=drive,
        lag=lag,
        sample_time=period,
        quiet_time=quiet,
        m_limit=5.0,
        duty_max=1.0 - quiet / period,
        least_pulse=0.05,
    )
    block.m_cmd_body = (5.0, -5.0, 5.0)
    run(block, step, 3.0 * period)
    dipole = 5.0 * (1.0 - np.exp(-(period - quiet) / lag))  # where the pause begins
    share = np.exp(-quiet / lag)  # 1.8 %
    assert np.abs(block.m_body) == pytest.approx(dipole * share, rel=1e-3)


@pytest.mark.parametrize(
    "axes", [np.eye(3, 4), SKEWED, SKEWED * [1, 1, 1, 0], SKEWED * [1, 1, 0, 0]]
)
def test_allocation_to_coils(axes):
    block = begin("torquers", axes_coil=tuple(axes.ravel()), drive=IDEAL)
    block.m_cmd_body = (3.0, -7.0, 11.0)
    run(block, 1.0, 1.0)
    coils = np.linalg.pinv(axes) @ block.m_cmd_body
    assert block.m_coil == pytest.approx(coils, abs=1e-13)
    assert block.m_body == pytest.approx(axes @ coils, abs=1e-13)
    assert block.m_mean_body == block.m_body
    assert block.dipole_energy == pytest.approx(0.5 * coils @ coils)


def test_each_coil_has_its_limit():
    block = begin("torquers", axes_coil=tuple(SKEWED.ravel()), m_limit=10.0)
    block.m_cmd_body = (12.0, 0.5, 12.0)
    run(block, 1.0, 1.0)
    coils = np.clip(np.linalg.pinv(SKEWED) @ block.m_cmd_body, -10.0, 10.0)
    assert np.count_nonzero(np.abs(coils) == 10.0) == 2
    assert block.m_coil == pytest.approx(coils)
    assert block.on_time == 4.0


@pytest.mark.parametrize("lag", [0.0, 0.02])
@pytest.mark.parametrize("failure_known", [True, False])
@pytest.mark.parametrize("axes", [np.eye(3, 4), SKEWED])
def test_failed_coil(axes, failure_known, lag):
    """Dead from 1.25 s on, inside a step and a sample period; allocated anew from the
    sample on."""
    block = begin(
        "torquers",
        axes_coil=tuple(axes.ravel()),
        failed_coil=2,
        failed_from=1.25,
        failure_known=failure_known,
        sample_time=1.0,
        lag=lag,
    )
    block.m_cmd_body = command = np.array((5.0, -8.0, 3.0))
    alive = axes * [1, 0, 1, 1]
    before = np.linalg.pinv(axes) @ command
    after = (
        np.linalg.pinv(alive)
        if failure_known
        else np.diag([1, 0, 1, 1]) @ np.linalg.pinv(axes)
    ) @ (command)
    run(block, 0.5, 1.0)
    assert block.m_coil == pytest.approx(before)
    run(block, 0.5, 1.5, 1.0)
    assert block.m_mean_body == pytest.approx(
        (axes * [1, 0.5, 1, 1]) @ before, abs=1e-12
    )  # 1.25 s is half way
    assert block.m_coil == pytest.approx(before * [1, 0, 1, 1])
    run(block, 0.5, 4.0, 1.5)
    assert block.m_coil == pytest.approx(after)
    assert block.m_mean_body == pytest.approx(axes @ after, abs=1e-12)
    if failure_known and axes is SKEWED:
        assert block.m_body == pytest.approx(command), "three of four still span space"


@given(st.integers(0, 10_000), st.integers(0, 3))
def test_pseudo_inverse_of_any_rank(seed, rank):
    rng = np.random.default_rng(seed)
    u, v = (
        np.linalg.qr(rng.normal(size=(3, 3)))[0],
        np.linalg.qr(rng.normal(size=(4, 4)))[0],
    )
    matrix = u[:, :rank] @ np.diag(rng.uniform(0.3, 2, rank)) @ v[:rank]
    inverse = np.reshape(pseudo_inverse(tuple(matrix.ravel())), (4, 3))
    assert inverse == pytest.approx(np.linalg.pinv(matrix, rcond=1e-9), abs=1e-11)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"drive": PULSED}, "pulsed drive needs a sample_time"),
        ({"drive": PULSED, "sample_time": 1.0, "m_limit": 0.0}, "m_limit above 0"),
        (
            {
                "drive": PULSED,
                "sample_time": 1.0,
                "quiet_time": 0.1,
                "pulse_delay": 0.1,
            },
            "exceeds",
        ),
        ({"axes_coil": (2.0,) + (0.0,) * 11}, "column 1 .* is not a unit vector"),
        ({"quiet_time": 0.5}, "quiet_time = 0.5 s must be shorter"),
        ({"quiet_time": 1.0, "sample_time": 1.0}, "quiet_time = 1.0 s must be shorter"),
    ],
)
def test_parameters_that_do_not_fit_are_refused(parameters, message):
    with pytest.raises(BlockError, match=message):
        begin("torquers", **parameters)


# --- thrusters ------------------------------------------------------------------------

KINDS = ("thrusters", "thrusters_nozzles")


@pytest.mark.parametrize("start", [0.0, 1000.0])
@pytest.mark.parametrize("placement", [0, CENTRED])
@pytest.mark.parametrize("dt", STEPS)
@pytest.mark.parametrize("name", KINDS)
def test_a_pulse_of_37_ms_is_exact_at_any_step(name, dt, placement, start):
    block = begin(name, sample_time=10.0, least_pulse=0.037, placement=placement)
    block.tau_cmd_thruster_body = (0.04 * 0.0037, 0.0, -0.04 * 0.0037)
    impulse, first = run(block, dt, start + 10.0, start)
    exact = 0.04 * 0.037 * np.array((1, 0, -1))
    middle = 5.0 if placement == CENTRED else 0.037 / 2
    ulps = max(start, 10.0) * 2**-52 / 0.037 * 8
    assert impulse == pytest.approx(exact, rel=ulps)
    assert first == pytest.approx(exact * middle, rel=10 * ulps)
    assert block.on_time == pytest.approx(2 * 0.037, rel=ulps)


@given(
    commands=st.tuples(*[st.tuples(*[st.floats(-0.06, 0.06)] * 3)] * 3),
    count=st.integers(2, 200),
    name=st.sampled_from(KINDS),
    placement=st.integers(0, 1),
    firing=st.tuples(st.floats(-5, 25), st.floats(0, 20), st.floats(-1, 1)),
)
def test_thrusters_small_steps_add_up_to_large_ones(
    commands, count, name, placement, firing
):
    rows = []
    for dt in (10.0, 10.0 / count):
        block = begin(
            name,
            sample_time=10.0,
            placement=placement,
            schedule_start=(firing[0],) + (0.0,) * 7,
            schedule_duration=(firing[1],) + (0.0,) * 7,
            schedule_tau_body=(firing[2],) * 3 + (0.0,) * 21,
        )
        row = []
        for k, torque in enumerate(commands):
            block.tau_cmd_thruster_body = torque
            row += [*run(block, dt, 10.0 * (k + 1), 10.0 * k)]
        rows.append(
            np.hstack([*row, block.on_time, block.propellant, block.schedule_on_time])
        )
    assert rows[1] == pytest.approx(rows[0], rel=1e-10, abs=1e-11)


@pytest.mark.parametrize("name", KINDS)
def test_on_times_are_quantised_bounded_and_not_too_short(name):
    def widths(least_on_time=0.0, **torque):
        block = begin(
            name, sample_time=1.0, least_pulse=0.02, least_on_time=least_on_time
        )
        block.tau_cmd_thruster_body = (torque.get("x", 0.0), torque.get("y", 0.0), 0.0)
        impulse, _ = run(block, 1.0, 1.0)
        assert block.on_time == pytest.approx(np.abs(impulse).sum() / 0.04)
        return impulse[:2] / 0.04

    assert widths(x=0.04 * 0.109) == pytest.approx([0.10, 0])
    assert widths(x=-0.04 * 0.111) == pytest.approx([-0.12, 0])
    assert widths(x=0.04 * 0.009) == pytest.approx([0, 0])
    assert widths(x=7.0, y=-0.02) == pytest.approx([1, -0.5])
    assert widths(0.06, x=0.04 * 0.06, y=0.04 * 0.04) == pytest.approx([0.06, 0])


@pytest.mark.parametrize("dt", [0.1, 0.5, 4.0])
@pytest.mark.parametrize("name", KINDS)
def test_schedule(name, dt):
    """Paper 002's firing of 30 s, an overlap, and edges inside steps: all exact, all
    apart."""
    firings = [
        (3.3, 30.0, (5e-6, 1.5e-3, 1.5e-3)),
        (20.17, 1.234, (-1.0, 0.0, 2.0)),
        (39.95, 0.03, (0.0, 0.5, 0.0)),
    ]
    pad = 8 - len(firings)
    block = begin(
        name,
        sample_time=40.0,
        schedule_start=tuple(f[0] for f in firings) + (0.0,) * pad,
        schedule_duration=tuple(f[1] for f in firings) + (0.0,) * pad,
        schedule_tau_body=tuple(x for f in firings for x in f[2]) + (0.0,) * 3 * pad,
    )
    impulse, first = run(block, dt, 40.0)
    exact = [np.array(f[2]) * f[1] for f in firings]
    assert impulse == pytest.approx(sum(exact), rel=1e-11)
    middle = [f[0] + f[1] / 2 for f in firings]
    assert first == pytest.approx(
        sum(x * t for x, t in zip(exact, middle, strict=True)), rel=1e-11
    )
    assert block.schedule_on_time == pytest.approx(31.264, rel=1e-11)
    assert (block.on_time, block.propellant) == (0.0, 0.0)


def test_default_nozzles_are_the_axis_pairs():
    pairs, nozzles = (begin(name, sample_time=5.0) for name in KINDS)
    for k, torque in enumerate(
        [(0.01, -0.02, 0.03), (-0.1, 0.0012, -0.04), (0.0, 0.02, 0.0)]
    ):
        for i in range(10):
            for block in (pairs, nozzles):
                block.tau_cmd_thruster_body = torque
                run(block, 0.5, 5.0 * k + 0.5 * (i + 1), 5.0 * k + 0.5 * i)
            for a, b in zip(moments_of(nozzles), moments_of(pairs), strict=True):
                assert a == pytest.approx(b, abs=1e-12)
        assert nozzles.on_time == pytest.approx(pairs.on_time, rel=1e-13)
        assert nozzles.propellant == pytest.approx(pairs.propellant, rel=1e-13)


def test_propellant():
    """thrust * on-time / (g0 Isp), each nozzle with its own thrust."""
    thrust = (0.1, 0.1, 0.3, 0.1, 0.1, 0.1, 0.1, 0.1)
    block = begin(
        "thrusters_nozzles", sample_time=10.0, specific_impulse=220.0, thrust=thrust
    )
    block.tau_cmd_thruster_body = (0.02, 0.03, 0.0)
    run(block, 0.5, 10.0)
    assert block.on_time == pytest.approx(5.0 + 2.5)
    used = (5.0 * 0.1 + 2.5 * 0.3) / (STANDARD_GRAVITY * 220.0)
    assert block.propellant == pytest.approx(used, rel=1e-12)


def test_a_direction_is_a_unit_vector():
    with pytest.raises(BlockError, match=r"row 1 .* is not a unit vector"):
        begin("thrusters_nozzles", direction_nozzle=(1.0, 1.0) + (0.0,) * 22)


# --- allocation to nozzles ------------------------------------------------------------


def nozzles(rng: np.random.Generator, are_canted: bool) -> np.ndarray:
    """Torques (N m) of some nozzles as columns: random, or of pairs with equal torques."""
    torques = 0.04 * rng.normal(size=(3, rng.integers(1, 9)))
    return (
        torques
        if are_canted
        else 0.04 * np.hstack([np.eye(3), -np.eye(3), np.eye(3)[:, :2]])
    )


@pytest.mark.parametrize("are_canted", [True, False])
@pytest.mark.parametrize("seed", range(150))
def test_on_times_are_the_optimum_of_the_linear_programme(seed, are_canted):
    rng = np.random.default_rng(seed)
    a = nozzles(rng, are_canted)
    n, longest = a.shape[1], 10.0
    impulses = [
        rng.choice([1e-4, 0.1, 1.0]) * rng.normal(size=3),  # perhaps more than they can
        0.1 * rng.normal(size=3) * rng.integers(0, 2, 3),  # about few axes
        a @ rng.uniform(0, longest, n),  # what they can
    ]
    for impulse in impulses:
        x = np.array(least_on_times(tuple(map(tuple, a.T)), tuple(impulse), longest))
        assert x.min() >= 0
        assert x.max() <= longest
        size = np.abs(a).max()
        error = np.abs(a @ x - impulse).sum() / size
        least_error = linprog(
            np.r_[np.zeros(n), np.ones(6)],
            A_eq=np.c_[a / size, np.eye(3), -np.eye(3)],
            b_eq=impulse / size,
            bounds=[(0, longest)] * n + [(0, None)] * 6,
        ).fun
        assert error <= least_error + 1e-4 * x.sum() + 1e-9
        reference, residual = nnls(a / size, impulse / size)
        if residual > 1e-10 or reference.max() > longest:
            continue
        assert a @ x == pytest.approx(impulse, abs=1e-12 * longest), "feasible: exact"
        least = linprog(
            np.ones(n), A_eq=a / size, b_eq=impulse / size, bounds=(0, longest)
        )
        assert x.sum() <= least.fun * (1 + 1e-9) + 1e-12
        assert x.sum() <= reference.sum() * (1 + 1e-9) + 1e-12


def test_no_nozzles_no_on_time():
    assert least_on_times(((0.0, 0.0, 0.0),) * 8, (1.0, 2.0, 3.0), 10.0) == (0.0,) * 8
    assert least_on_times(((0.1, 0.0, 0.0),), (-1.0, 2.0, 0.0), 10.0) == (0.0,)


@pytest.mark.parametrize("drive", [0, 1, 2])
def test_a_coil_without_a_command_counts_no_time(drive):
    coils = fresh("torquers")
    coils.drive, coils.sample_time, coils.m_limit = drive, 10.0, 40.0
    begin_block(coils)
    coils.m_cmd_body = (36.0, 0.0, 0.0)
    for k in range(10):
        coils.advance(float(k), 1.0)
    coils.output(10.0)
    assert coils.on_time == pytest.approx(9.0 if drive == 2 else 10.0)
