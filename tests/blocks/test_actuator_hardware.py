"""Actuators as they are bought, beside closed forms, quadrature and scipy's
integrators."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from desat.components.contract.block import BlockError
from desat.components.physics import rod
from tests.blocks.test_actuators import (
    IDEAL,
    LIMITED,
    PULSED,
    SKEWED,
    begin,
    moments_of,
    run,
)

CURRENT, VOLTAGE = range(2)
amount = st.floats(-15, 15)
command = st.tuples(amount, amount, amount)

# --- rods -----------------------------------------------------------------------------

DRIVEN = {
    "supply_voltage": 9.0,
    "inductance": 12.0,
    "resistance": 40.0,
    "area_turns": 60.0,
    "m_limit": 10.0,
    "sample_time": 1.0,
}
"""0.3 s of time constant; 13.5 A m2 held at 293 K."""


def driven(**parameters):
    return begin("torquers_rods", **{**DRIVEN, **parameters})


@pytest.mark.parametrize("drive", [IDEAL, LIMITED, PULSED])
@pytest.mark.parametrize("lag", [0.0, 0.3])
def test_without_its_options_a_rod_is_a_torquer(drive, lag):
    same = {
        "drive": drive,
        "lag": lag,
        "sample_time": 2.0,
        "quiet_time": 0.3,
        "duty_max": 0.6,
        "axes_coil": tuple(SKEWED.ravel()),
        "failed_coil": 2,
        "failed_from": 5.1,
        "failed_share": -0.5,
    }
    plain, rods = begin("torquers", **same), begin("torquers_rods", **same)
    for k in range(9):
        for block in (plain, rods):
            block.m_cmd_body = (10.0 - 7.0 * k, 50.0 * (-1) ** k, 3.0 * k)
        a, b = (
            run(plain, 0.5, 2.0 * (k + 1), 2.0 * k),
            run(rods, 0.5, 2.0 * (k + 1), 2.0 * k),
        )
        assert np.array(b) == pytest.approx(np.array(a), rel=1e-12, abs=1e-11)
        for name in ("m_coil", "power", "on_time", "dipole_energy", "electric_energy"):
            assert getattr(rods, name) == pytest.approx(
                getattr(plain, name), rel=1e-12, abs=1e-11
            )


@pytest.mark.parametrize("remanence", [0.01, 0.05])
def test_what_remains_and_what_a_cycle_loses(remanence):
    """Rayleigh's law: m_limit at m_limit, `remanence` of it at 0, the area of the loop."""
    block = begin("torquers_rods", remanence=remanence, m_limit=10.0)
    path = np.concatenate(
        [np.linspace(0, 10, 101), np.linspace(10, -10, 201), np.linspace(-10, 10, 201)]
    )
    dipoles = []
    for k, u in enumerate(path):
        block.m_cmd_body = (u, 0.0, 0.0)
        block.advance(float(k), 1.0)
        block.output(k + 1.0)
        dipoles.append(block.m_coil[0])
    m = np.array(dipoles)
    assert m[100] == pytest.approx(10.0, rel=1e-14)
    assert m[201] == pytest.approx(10.0 * remanence, rel=1e-13)
    assert m[301] == pytest.approx(-10.0, rel=1e-13)
    x, loop = path[101:], m[101:]
    area = abs(np.trapezoid(np.append(loop, loop[0]), np.append(x, x[0])))
    exact = 8.0 / 3.0 * remanence * 10.0**2 * (1.0 + 0.5 / rod.PLAYS**2)
    assert area == pytest.approx(exact, rel=2e-3)  # of paths of 0.1 A m2
    # on the way up first: (1 - 2 rho) x + 2 rho x^2 / X, Rayleigh's parabola, but for
    # eight plays
    parabola = (1 - 2 * remanence) * path[:101] + 0.2 * remanence * path[:101] ** 2
    assert m[:101] == pytest.approx(
        parabola, abs=10.0 * remanence / (2 * rod.PLAYS**2) * 1.01
    )


def reference(block, u: float, x0: float, regulation: int, stop: float) -> np.ndarray:
    """Dipole of a rod from m = 0, x = x0 over fine steps: the current by Euler's method
    of small steps, the plays one by one."""
    n = 100_000
    dt, x = stop / n, x0
    ohm = 40.0 * (1.0 + 0.00393 * (block.temperature - 293.15))
    full, tau = 60.0 * 9.0 / ohm, 12.0 / ohm
    aim = u * 40.0 / ohm if regulation == VOLTAGE else u
    aim = min(max(aim, -full), full)
    width = [(k + 0.5) * 10.0 / 8 for k in range(8)]
    plays, dipole = [0.0] * 8, np.empty(n)
    for i in range(n):
        if regulation == VOLTAGE:
            x = aim + (x - aim) * math.exp(-dt / tau)
        else:
            to = math.copysign(full, aim - x)
            after = to + (x - to) * math.exp(-dt / tau)
            x = aim if (after - aim) * (x - aim) <= 0.0 else after
        plays = [min(max(p, x - r), x + r) for p, r in zip(plays, width, strict=True)]
        dipole[i] = (1 - 2 * block.remanence) * x + 4 * block.remanence / 8 * sum(plays)
    return dipole


@pytest.mark.parametrize(
    ("regulation", "temperature", "u"),
    [
        (CURRENT, 293.15, 9.0),
        (CURRENT, 373.15, -10.0),
        (CURRENT, 460.0, 10.0),
        (VOLTAGE, 353.0, 8.0),
    ],
)
def test_rise_of_a_rod(regulation, temperature, u):
    block = driven(regulation=regulation, temperature=temperature, remanence=0.05)
    fine = reference(block, u, 0.0, regulation, 1.0)
    block.m_cmd_body = (0.0, u, 0.0)
    impulse, first = run(block, 1.0, 1.0)
    t = (np.arange(fine.size) + 0.5) / fine.size
    assert impulse[1] == pytest.approx(fine.mean(), rel=2e-5)
    assert first[1] == pytest.approx((t * fine).mean(), rel=2e-5)
    assert block.m_coil[1] == pytest.approx(fine[-1], rel=2e-5)
    assert block.dipole_energy == pytest.approx(0.5 * (fine**2).mean(), rel=4e-5)


def test_current_is_there_when_the_supply_has_driven_it():
    """x = X (1 - exp(-t R / L)): 9 of 13.5 A m2 after 0.3 s ln 3."""
    block = driven(remanence=0.0)
    block.m_cmd_body = (9.0, 0.0, 0.0)
    there = 0.3 * math.log(3.0)
    run(block, there / 8, there)
    assert block.m_coil[0] == pytest.approx(9.0, rel=1e-12)
    run(block, 0.01, 1.0 - there, there)
    assert block.m_mean_body == pytest.approx((9.0, 0.0, 0.0), rel=1e-12)
    block.m_cmd_body = (0.0, 0.0, 0.0)  # and gone sooner, for the supply is against it
    rise_time = 0.3 * math.log((13.5 + 9.0) / 13.5)
    block.advance(1.0, 0.5 * rise_time)
    block.advance(1.0 + 0.5 * rise_time, 0.5 * rise_time)
    block.output(1.0 + rise_time)
    assert block.m_coil[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(
    ("parameters", "dipole", "share"),
    [
        ({"temperature": 373.15}, 10.0, 1.0),
        (
            {"temperature": 393.15, "supply_voltage": 6.0},
            10.0,
            60.0 * 6.0 / (40.0 * 1.393) / 10.0,
        ),
        (
            {"temperature": 253.15, "regulation": VOLTAGE},
            8.0,
            1.0 / (1.0 - 0.00393 * 40.0),
        ),
        (
            {"temperature": 353.15, "regulation": VOLTAGE},
            -8.0,
            1.0 / (1.0 + 0.00393 * 60.0),
        ),
    ],
)
def test_what_supply_and_temperature_hold(parameters, dipole, share):
    block = driven(**parameters)
    block.m_cmd_body = (dipole, 0.0, 0.0)
    run(block, 1.0, 20.0)
    assert block.m_coil[0] == pytest.approx(dipole * share, rel=1e-12)
    ohm = 40.0 * (1.0 + 0.00393 * (block.temperature - 293.15))
    assert block.power == pytest.approx(ohm * (block.m_coil[0] / 60.0) ** 2, rel=1e-12)


@settings(max_examples=40)
@given(
    commands=st.tuples(command, command, command),
    count=st.integers(2, 60),
    drive=st.sampled_from([LIMITED, PULSED]),
    regulation=st.sampled_from([CURRENT, VOLTAGE]),
    quiet=st.floats(0, 3),
    remanence=st.sampled_from([0.0, 0.05]),
    failed_coil=st.integers(0, 4),
    failed_from=st.floats(0, 30),
    share=st.sampled_from([0.0, 0.5, -1.0]),
)
def test_small_steps_of_rods_add_up_to_large_ones(
    commands,
    count,
    drive,
    regulation,
    quiet,
    remanence,
    failed_coil,
    failed_from,
    share,
):
    rows = []
    for dt in (10.0, 10.0 / count):
        block = driven(
            axes_coil=tuple(SKEWED.ravel()),
            drive=drive,
            regulation=regulation,
            sample_time=10.0,
            quiet_time=quiet,
            duty_max=0.6,
            pulse_delay=0.7,
            remanence=remanence,
            failed_coil=failed_coil,
            failed_from=failed_from,
            failed_share=share,
            temperature=333.0,
        )
        row = []
        for k, m in enumerate(commands):
            block.m_cmd_body = m
            row += [*run(block, dt, 10.0 * (k + 1), 10.0 * k)]
        rows.append(
            np.hstack(
                [
                    *row,
                    block.m_coil,
                    block.dipole_energy,
                    block.electric_energy,
                    block.on_time,
                ]
            )
        )
    size = max(1.0, np.abs(rows[0]).max())
    assert rows[1] == pytest.approx(rows[0], rel=1e-10, abs=1e-11 * size)


@pytest.mark.parametrize("lag", [0.0, 0.4])
@pytest.mark.parametrize("drive", [LIMITED, PULSED])
def test_a_turned_coil_is_turned_at_every_sample(drive, lag):
    """`failed_share` of a coil with lag: the same steps, the same dipole turned."""
    results = []
    for share in (1.0, -1.0):
        block = begin(
            "torquers",
            drive=drive,
            lag=lag,
            sample_time=2.0,
            duty_max=0.5,
            failed_coil=1,
            failed_share=share,
        )
        block.m_cmd_body = (30.0, 0.0, 0.0)
        row = []
        for k in range(12):
            block.advance(0.5 * k, 0.5)
            row.append(moments_of(block))
        results.append(np.array(row))
    assert np.abs(results[0]).max() > 20.0
    assert results[1] == pytest.approx(-results[0], abs=1e-12)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"lag": 0.1}, "lag = 0.1 s beside a supply_voltage"),
        ({"resistance": 0.0}, "resistance = 0 Ohm: with a supply_voltage"),
        ({"supply_voltage": 0.0}, "inductance = 12.0 H needs a supply_voltage"),
        ({"temperature": 30.0}, "temperature = 30.0 K: .* resistance is not above 0"),
        ({"remanence": 0.05, "drive": IDEAL}, "remanence = 0.05 is a share of m_limit"),
        ({"remanence": 0.6}, r"remanence = 0.6 is outside \[0.0, 0.5\]"),
    ],
)
def test_rods_that_cannot_be_are_refused(parameters, message):
    with pytest.raises(BlockError, match=message):
        driven(**parameters)


def test_a_supply_that_does_not_reach_the_limit_is_foreseen():
    messages = list(
        driven(supply_voltage=5.0).foresee(0.0, 10.0, frozenset({"m_cmd_body"}))
    )
    assert any(
        "supply_voltage = 5 V holds 7.5 A m2 at 293.15 K" in line for line in messages
    )
    assert not list(driven().foresee(0.0, 10.0, frozenset({"m_cmd_body"})))


# --- wheels ---------------------------------------------------------------------------

J = 2e-5
MOTOR = {
    "inertia_wheel": (J, 0.0, 0.0, 0.0),
    "torque_limit": 2e-3,
    "speed_limit": 800.0,
    "supply_voltage": 8.0,
    "torque_constant": 0.01,
    "motor_constant": 2e-3,
    "friction_speed": 1.0,
}
"""800 rad/s without load, K_m^2 = 4e-6: 2 mN m up to 300 rad/s, J / K_m^2 = 5 s."""
TABLE = {
    "drag_speed": (0.0, 50.0, 200.0, 700.0, 0.0, 0.0, 0.0, 0.0),
    "drag_torque": (2e-5, 3e-5, 9e-5, 1.5e-4, 0.0, 0.0, 0.0, 0.0),
}


def spun(stop: float, dt: float, command: float = 0.0, **parameters):
    block = begin("wheels_motor", **{**MOTOR, **parameters})
    impulse = first = 0.0
    block.tau_cmd_wheel = (command, 0.0, 0.0, 0.0)
    for k in range(round(stop / dt)):
        block.advance(k * dt, dt)
        mean, slope = block.tau_mean_wheel[0], block.tau_slope_wheel[0]
        impulse += dt * mean
        first += dt * (mean * (k + 0.5) * dt + slope * dt / 12.0)
    block.output(stop)
    return block, impulse, first


def test_without_its_options_a_motor_turns_as_any_wheel():
    same = {
        "torque_limit": 3e-3,
        "viscous": 2e-6,
        "coulomb": 1e-4,
        "motor_lag": 0.1,
        "compensation": 0.4,
        "failed": 2,
        "failed_from": 3.3,
        "motor_constant": 0.01,
        "h_start_wheel": (1.0, -2.0, 0.3, 0.0),
    }
    plain, other = begin("wheels", **same), begin("wheels_motor", **same)
    for k in range(20):
        for block in (plain, other):
            block.tau_cmd_wheel = (1e-3 * (-1) ** (k // 5), 2e-3, 5e-3, 0.0)
            block.omega_bi_body = (1e-3 * k, 0.0, -2e-3)
            block.advance(0.5 * k, 0.5)
            block.output(0.5 * (k + 1))
        for name in (
            "h_wheel",
            "tau_mean_wheel",
            "tau_slope_wheel",
            "power",
            "saturated_wheel",
        ):
            assert getattr(other, name) == getattr(plain, name)


@pytest.mark.parametrize("dt", [0.1, 0.5, 1.0])
def test_a_motor_on_its_curve(dt):
    """2 mN m to 300 rad/s, reached after 3 s; from there 800 - 500 exp(-(t - 3) / 5 s)."""
    block, impulse, _ = spun(2.0, dt, 0.5)
    assert block.h_wheel[0] == pytest.approx(2.0 * 2e-3, rel=1e-12)
    block, impulse, first = spun(10.0, dt, 0.5)
    speed = 800.0 - 500.0 * math.exp(-7.0 / 5.0)
    assert block.h_wheel[0] == pytest.approx(J * speed, abs=J * 1e-7)
    assert impulse == pytest.approx(J * speed, abs=J * 1e-7)
    # int t tau dt = [t h] - int h dt
    integral = 2e-3 * 4.5 + J * (800.0 * 7.0 - 500.0 * 5.0 * (1.0 - math.exp(-1.4)))
    assert first == pytest.approx(10.0 * J * speed - integral, rel=1e-8)
    assert not block.saturated_wheel[0]
    drive = 4e-6 * (800.0 - speed)
    assert block.power == pytest.approx(
        8.0 * drive / 0.01, rel=1e-6
    )  # voltage times current


def test_a_motor_brakes_with_its_whole_torque_and_beyond_no_load_by_itself():
    block, *_ = spun(1.0, 0.5, -0.5, h_start_wheel=(J * 700.0, 0.0, 0.0, 0.0))
    assert block.h_wheel[0] == pytest.approx(J * 700.0 - 2e-3, rel=1e-12)
    block, *_ = spun(
        1.0, 0.5, 0.0, h_start_wheel=(J * 750.0, 0.0, 0.0, 0.0), supply_voltage=5.0
    )
    assert block.h_wheel[0] == pytest.approx(
        J * (500.0 + 250.0 * math.exp(-0.2)), rel=1e-9
    )
    failure = {
        "failed": 1,
        "h_start_wheel": (J * 750.0, 0.0, 0.0, 0.0),
        "supply_voltage": 5.0,
    }
    block, *_ = spun(1.0, 0.5, 0.0, **failure)
    assert block.h_wheel[0] == pytest.approx(J * 750.0, rel=1e-14)  # nothing drives it


def test_a_wheel_coasts_as_its_table_says():
    """Between two entries the speed decays exponentially; times from one entry to the
    next."""
    block = begin(
        "wheels_motor",
        **{**MOTOR, **TABLE, "failed": 1, "h_start_wheel": (J * 700.0, 0.0, 0.0, 0.0)},
    )
    slope, rest = (1.5e-4 - 9e-5) / 500.0, 9e-5 - 200.0 * (1.5e-4 - 9e-5) / 500.0
    decays = slope / J
    to_200 = math.log((700.0 + rest / slope) / (200.0 + rest / slope)) / decays
    slope, rest = (9e-5 - 3e-5) / 150.0, 1e-5
    decays = slope / J
    to_50 = to_200 + math.log((200.0 + rest / slope) / (50.0 + rest / slope)) / decays
    for k in range(1, 5):
        for begins, ends, speed in ((0.0, to_200, 200.0), (to_200, to_50, 50.0)):
            for i in range(2**k):
                dt = (ends - begins) / 2**k
                block.advance(begins + i * dt, dt)
            block.output(ends)
            assert block.h_wheel[0] == pytest.approx(J * speed, abs=J * 1e-6)
        block.start()


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize(("lag", "compensation"), [(0.0, 0.0), (0.3, 0.0), (0.3, 0.8)])
def test_all_of_a_motor_beside_scipy(lag, compensation, way):
    """Curve, table, lag and compensation, from 350 rad/s through a reversal, while the
    body turns."""
    from scipy.integrate import solve_ivp

    start = (way * J * 350.0, 0.0, 0.0, 0.0)
    block = begin(
        "wheels_motor",
        **{
            **MOTOR,
            **TABLE,
            "motor_lag": lag,
            "speed_limit": 1000.0,
            "compensation": compensation,
            "h_start_wheel": start,
        },
    )
    speeds, drags = TABLE["drag_speed"][:4], TABLE["drag_torque"][:4]
    state = np.array([way * J * 350.0, 0.0, 0.0])
    turning = 0.02

    def derivative(t, y, command, rate):
        omega = y[0] / J - rate - turning * t
        drag = np.interp(abs(omega), speeds, drags) * math.tanh(omega)
        drive = np.clip(
            (y[1] if lag else command) + y[2],
            4e-6 * (-800.0 - omega),
            4e-6 * (800.0 - omega),
        )
        return [
            np.clip(drive, -2e-3, 2e-3) - drag,
            (command - y[1]) / lag if lag else 0.0,
            compensation * (drag - y[2]),
        ]

    for k, command in enumerate([2e-3] * 4 + [-2e-3] * 6 + [1e-4] * 3):
        rate = turning * k
        block.omega_bi_body = (rate, 0.0, 0.0)
        block.tau_cmd_wheel = (way * command, 0.0, 0.0, 0.0)
        if k < 2:  # until the block foresees that the body turns
            block._past = (((rate - turning, 0.0, 0.0, 0.0), 1.0),) * 2
        block.advance(float(k), 1.0)
        state = solve_ivp(
            derivative,
            (0.0, 1.0),
            state,
            args=(way * command, rate),
            rtol=1e-10,
            atol=1e-14,
            max_step=0.005,
            method="DOP853",
        ).y[:, -1]
        block.output(k + 1.0)
        assert block.h_wheel[0] == pytest.approx(state[0], abs=J * 3e-6)
    assert abs(state[0]) < J * 350.0


def test_a_motor_stays_at_the_speed_limit():
    block, *_ = spun(10.0, 0.5, 0.5, speed_limit=400.0, **TABLE)
    assert block.h_wheel[0] == pytest.approx(J * 400.0, rel=1e-12)
    assert block.saturated_wheel[0]
    block.tau_cmd_wheel = (-1e-3, 0.0, 0.0, 0.0)
    block.advance(10.0, 0.5)
    block.output(10.5)
    loss = 0.5 * (1e-3 + 9e-5 + 200.0 / 500.0 * 6e-5)
    assert block.h_wheel[0] == pytest.approx(J * 400.0 - loss, rel=1e-3)


ROW = (0.0,) * 4


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"motor_constant": 0.0}, "motor_constant = 0 N m: with a supply_voltage"),
        ({"stiction": 1e-4}, "stiction = 0.0001 N m: not with"),
        ({"drag_torque": (1e-5,) * 8}, "drag_torque is given, but no drag_speed"),
        ({**TABLE, "viscous": 1e-6}, "the table of the drag stands for both"),
        (
            {"drag_speed": (0.0, 50.0, 50.0, 60.0, *ROW)},
            r"drag_speed\[3\] = 50.0 rad/s is not",
        ),
        (
            {"drag_speed": (1.0, 50.0, 60.0, 70.0, *ROW)},
            r"drag_speed\[1\] = 1.0 rad/s: the table",
        ),
        (
            {"drag_torque": (-1e-5, *ROW, 0.0, 0.0, 0.0)},
            r"drag_torque\[1\] = -1e-05 is outside",
        ),
    ],
)
def test_motors_that_cannot_be_are_refused(parameters, message):
    with pytest.raises(BlockError, match=message):
        begin("wheels_motor", **{**MOTOR, **parameters})


def test_a_voltage_and_a_table_that_end_below_the_speed_limit_are_foreseen():
    one = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    values = {**MOTOR, **TABLE, "supply_voltage": 6.0, "axes_wheel": one}
    block = begin("wheels_motor", **values)
    messages = list(block.foresee(0.0, 10.0, frozenset()))
    assert any(
        "supply_voltage = 6 V turns the wheels at 600 rad/s at most" in x
        for x in messages
    )
    assert any(
        "drag_speed ends at 700 rad/s, below speed_limit = 800" in x for x in messages
    )


# --- thrusters ------------------------------------------------------------------------

CLOSED, OPEN = range(2)
torque = st.floats(-0.06, 0.06)


def valves(**parameters):
    return begin("thrusters_valves", **{"sample_time": 10.0, **parameters})


def test_without_their_options_valves_are_nozzles():
    same = {
        "sample_time": 5.0,
        "placement": 1,
        "schedule_start": (7.0,) + (0.0,) * 7,
        "schedule_duration": (3.3,) + (0.0,) * 7,
        "schedule_nozzle": (0.0, 0.5, 0.0, 1.0) + (0.0,) * 60,
    }
    plain, other = begin("thrusters_nozzles", **same), begin("thrusters_valves", **same)
    for k, command in enumerate(
        [(0.01, -0.02, 0.03), (-0.1, 0.0012, -0.04), (0.0, 0.02, 0.0)]
    ):
        results = []
        for block in (plain, other):
            block.tau_cmd_thruster_body = command
            results.append(np.hstack(run(block, 0.5, 5.0 * (k + 1), 5.0 * k)))
        assert results[1] == pytest.approx(results[0], rel=1e-12, abs=1e-13)
        for name in ("on_time", "propellant", "on_time_nozzle", "schedule_propellant"):
            assert getattr(other, name) == pytest.approx(
                getattr(plain, name), rel=1e-13
            )


@pytest.mark.parametrize("dt", [0.1, 0.5, 10.0])
def test_impulse_and_centre_of_a_pulse_with_edges(dt):
    """Of 2 s from 4 s on: u (1 - exp) and its decay; all of the impulse is there,
    later."""
    rise, decay = 0.2, 0.35
    block = valves(rise_time=rise, decay_time=decay, placement=1)
    block.tau_cmd_thruster_body = (0.04 * 0.2, 0.0, 0.0)
    impulse, first = run(block, dt, 10.0)
    end, decay_left = 1.0 - math.exp(-2.0 / rise), math.exp(-4.0 / decay)
    up, down = (
        2.0 - rise * end,
        decay * end * (1.0 - decay_left),
    )  # of s while the valve is open, shut
    assert impulse[0] == pytest.approx(0.04 * (up + down), rel=1e-11)
    moment = 2.0 - rise * (rise * end - 2.0 * (1.0 - end))  # int t s dt, from 4 s on
    moment += decay * end * ((2.0 + decay) * (1.0 - decay_left) - 4.0 * decay_left)
    assert first[0] == pytest.approx(0.04 * (moment + 4.0 * (up + down)), rel=1e-11)
    assert block.on_time == pytest.approx(2.0, rel=1e-12)
    used = 0.1 * (up + down) / (9.80665 * 68.0)
    assert block.propellant == pytest.approx(used, rel=1e-11)


@settings(max_examples=40)
@given(
    commands=st.tuples(*[st.tuples(torque, torque, torque)] * 3),
    count=st.integers(2, 60),
    rise=st.sampled_from([0.0, 0.03, 2.0]),
    decay=st.sampled_from([0.0, 0.05, 3.0]),
    stuck=st.integers(0, 6),
    way=st.sampled_from([CLOSED, OPEN]),
    since=st.floats(0, 30),
    failure_known=st.booleans(),
    scatter=st.sampled_from([0.0, 0.1]),
)
def test_small_steps_of_valves_add_up_to_large_ones(
    commands, count, rise, decay, stuck, way, since, failure_known, scatter
):
    rows = []
    for dt in (10.0, 10.0 / count):
        block = valves(
            rise_time=rise,
            decay_time=decay,
            stuck_nozzle=stuck,
            stuck=way,
            stuck_from=since,
            impulse_scatter=scatter,
            failure_known=failure_known,
        )
        row = []
        for k, command in enumerate(commands):
            block.tau_cmd_thruster_body = command
            row += [*run(block, dt, 10.0 * (k + 1), 10.0 * k)]
        rows.append(np.hstack([*row, block.on_time_nozzle, block.propellant]))
    assert rows[1] == pytest.approx(rows[0], rel=1e-9, abs=1e-10)


@pytest.mark.parametrize("count", [3, 7, 11, 49])
def test_a_valve_open_over_two_samples_rises_once(count):
    """Steps that no power of two divides: the samples' times are rounded."""
    impulses = []
    for dt in (10.0, 10.0 / count):
        block = valves(rise_time=0.03, decay_time=0.0)
        total = 0.0
        for k in range(2):
            block.tau_cmd_thruster_body = (0.0, -0.05, 0.0)
            impulse, *_ = run(block, dt, 10.0 * (k + 1), 10.0 * k)
            total += impulse[1]
        impulses.append(total)
    assert impulses[0] == pytest.approx(-0.04 * (20.0 - 0.03), rel=1e-9)
    assert impulses[1] == pytest.approx(impulses[0], rel=1e-9)


def test_scatter_is_of_each_pulse_and_has_its_deviation():
    block = valves(impulse_scatter=0.05, sample_time=1.0)
    impulses = []
    for k in range(3000):
        block.tau_cmd_thruster_body = (0.02, -0.02, 0.02)
        block.advance(float(k), 1.0)
        impulses.append(block.tau_mean_thruster_body)
    ratios = np.abs(np.array(impulses)) / 0.02
    assert ratios.mean(axis=0) == pytest.approx(np.ones(3), abs=4 * 0.05 / 3000**0.5)
    assert ratios.std(axis=0) == pytest.approx(0.05 * np.ones(3), rel=0.06)
    assert np.abs(np.corrcoef(ratios.T)[np.triu_indices(3, 1)]).max() < 0.06
    assert abs(np.corrcoef(ratios[1:, 0], ratios[:-1, 0])[0, 1]) < 0.06
    other = valves(impulse_scatter=0.05, sample_time=1.0, seed=2)
    other.tau_cmd_thruster_body = (0.02, -0.02, 0.02)
    other.advance(0.0, 1.0)
    assert other.tau_mean_thruster_body[0] != impulses[0][0]


def test_a_valve_stuck_closed_and_one_stuck_open():
    """Nozzle 1 is the one of +x: shut from 12.5 s on; or open from then on."""
    command = (0.04 * 0.5, 0.0, 0.0)
    for way, impulses in ((CLOSED, (5.0, 2.5, 0.0)), (OPEN, (5.0, 2.5 + 7.5, 10.0))):
        block = valves(stuck_nozzle=1, stuck=way, stuck_from=12.5)
        for k, seconds in enumerate(impulses):
            block.tau_cmd_thruster_body = command
            impulse, _ = run(block, 2.5, 10.0 * (k + 1), 10.0 * k)
            assert impulse == pytest.approx((0.04 * seconds, 0.0, 0.0), abs=1e-12)
        assert block.on_time == pytest.approx(sum(impulses), rel=1e-12)
    block = valves(stuck_nozzle=1, stuck=OPEN, failure_known=True)
    block.tau_cmd_thruster_body = (0.01, 0.004, 0.0)
    impulse, _ = run(block, 2.5, 10.0)  # nozzle 2 fires against it
    assert impulse == pytest.approx((0.1, 0.04, 0.0), abs=0.04 * 0.026)
    assert block.on_time_nozzle[1] == pytest.approx(7.5, abs=0.026)


@pytest.mark.parametrize("dt", [0.5, 0.01])
def test_a_tank_blows_down_and_ends(dt):
    """thrust = F p, p = 1 / (1 + (B - 1) m / M): m + (B - 1) m^2 / (2 M) = F t / (g0
    I_sp)."""
    flow = 0.1 / (9.80665 * 68.0)
    tank = 20.0 * flow
    block = valves(tank=tank, blowdown=3.0, stuck_nozzle=1, stuck=OPEN, sample_time=dt)
    for k in range(round(20.0 / dt)):
        block.advance(k * dt, dt)
    block.output(20.0)
    share = (math.sqrt(1.0 + 4.0) - 1.0) / 2.0  # of 20 s of full flow: m + m^2 = 1
    assert block.propellant / tank == pytest.approx(share, rel=0.6 * dt / 10.0)
    assert block.propellant_left == pytest.approx(tank - block.propellant, rel=1e-12)
    impulse = 0.0
    for k in range(round(20.0 / dt), round(60.0 / dt)):
        block.advance(k * dt, dt)
        impulse += dt * block.tau_mean_thruster_body[0]
    block.output(60.0)
    assert block.propellant == tank
    assert block.propellant_left == 0.0
    assert block.tau_mean_thruster_body == (0.0, 0.0, 0.0)
    remaining = tank * (1.0 - share) * 9.80665 * 68.0 * 0.4
    assert impulse == pytest.approx(remaining, rel=0.6 * dt / 10.0)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"stuck_nozzle": 7}, "stuck_nozzle = 7: its thrust or direction is 0: no"),
        (
            {"stuck_nozzle": 1, "schedule_nozzle": (0.5,) + (0.0,) * 63},
            "not beside scheduled",
        ),
        (
            {"tank": 1.0, "schedule_duration": (1.0,) + (0.0,) * 7},
            "tank = 1.0 kg: not beside",
        ),
        ({"blowdown": 4.0}, "blowdown = 4.0 needs a tank above 0 kg"),
        ({"impulse_scatter": -0.1}, "impulse_scatter = -0.1 is outside"),
    ],
)
def test_valves_that_cannot_be_are_refused(parameters, message):
    with pytest.raises(BlockError, match=message):
        valves(**parameters)


def test_a_valve_that_stays_open_without_a_tank_is_foreseen():
    block = valves(stuck_nozzle=1, stuck=OPEN)
    assert any("there is no tank" in x for x in block.foresee(0.0, 10.0, frozenset()))
    block = valves(stuck_nozzle=1, stuck=OPEN, tank=1.0)
    assert not list(block.foresee(0.0, 10.0, frozenset()))
