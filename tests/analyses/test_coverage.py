"""The monolithic reference itself, the ten cases of the exchange against it, a run's
estimate of its own error, and the bound that it warns by."""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.validation import convergence, estimate
from benchmarks.validation.reference import Gyrostat
from benchmarks.validation.reference_events import advance
from benchmarks.validation.reference_plant import STANDING, H, Held, L, Q
from desat.analyses import coverage
from desat.analyses.manifest import SubstepChoice
from desat.components.maths import attitude
from desat.components.physics.rotor import friction
from desat.runs.run import prepare
from desat.system.errors import DesatError
from desat.system.options import Options

# attitude error (rad): as it was with one exchange a step, and what is promised with
# the scenario's substeps
CASES = {
    "light": (1.5e-6, 1e-7),
    "zero-crossing": (5.5e-7, 1e-6),
    "saturating": (3.3e-6, 1e-6),
    "pulses": (1.5e-5, 1e-6),
    "tumbling": (2.6e-5, 1e-6),
    "stiff-loop": (6.9e-5, 1e-5),
    "tumbling-friction": (6.8e-4, 1e-6),
    "failing-wheel": (1.5e-3, 1e-6),
    "heavy-wheels": (8.2e-3, 1e-5),
    "slow-samples": (5.0e-4, 1e-5),
}
QUIET = {
    "controller.kp": 0.0,
    "controller.kd": 0.0,
    "controller.ki": 0.0,
    "manager.enable": False,
    "spacecraft.gravity_gradient": False,
    "spacecraft.omega_start_body": [0.0, 0.0, 0.0],
    "wheels.viscous": 0.0,
    "wheels.coulomb": 0.0,
}


def gyrostat(name="gyrostat/free", stop=None, **values) -> Gyrostat:
    system, _ = prepare(name, Options(blocks=True, stop=stop, values=values)).or_raise()
    return Gyrostat(system)


def inertial(plant, y):
    """The total momentum in eci."""
    return np.array(attitude.rotate_back(tuple(y[Q]), tuple(y[L])))


# --- the reference: analytic cases ----------------------------------------------------


PRINCIPAL = {"spacecraft.inertia": [[40.0, 0, 0], [0, 42.0, 0], [0, 0, 36.0]]}
K = 1.0 / 0.008 + 1.0 / (40.0 - 0.008)
"""1/(kg m2): by the torque of its motor a wheel about x and the body turn against each
other."""


def motor(command, t):
    """What a motor has given t (s) after a command (N m), its lag 0.3 s (N m s)."""
    return command * (t + 0.3 * math.expm1(-t / 0.3))


@given(st.floats(0.002, 0.02), st.floats(0.0, 1.0))
@settings(max_examples=6)
def test_a_saturating_wheel(command, h0):
    """Without any momentum in all Omega = K h: the wheel takes what its motor gives,
    until |Omega| is at its limit; there it stays until the motor's torque turns."""
    plant = gyrostat(
        **QUIET
        | PRINCIPAL
        | {
            "wheels.speed_limit": 140.0,
            "wheels.h_start_wheel": [h0, 0.0, 0.0, 0.0],
            "spacecraft.omega_start_body": [-h0 / (40.0 - 0.008), 0.0, 0.0],
        }
    ).plant
    y, full = plant.start_state(), 140.0 / K
    y, wheel_state, (_, there) = advance(
        plant, 0.0, 900.0, y, Held((command, 0.0, 0.0, 0.0))
    )
    assert h0 + motor(command, there.begin) == pytest.approx(full, abs=1e-12)
    assert y[H] == pytest.approx([full, 0.0, 0.0, 0.0], rel=1e-12)
    assert inertial(plant, y) == pytest.approx([0.0] * 3, abs=1e-13)
    back = Held((-command, 0.0, 0.0, 0.0), pinned=wheel_state.pinned)
    y, wheel_state, (there, _) = advance(plant, 900.0, 910.0, y, back)
    assert there.end - 900.0 == pytest.approx(0.3 * math.log(2.0), abs=1e-9)
    # from there on its torque goes from zero to the command, as from the start
    remaining = motor(command, 910.0 - there.end)
    assert y[7] == pytest.approx(full - remaining, abs=1e-10)


def test_a_full_wheel_on_a_turning_body():
    """Nothing is lost; a wheel at its limit of speed turns with the body."""
    plant = gyrostat(
        **QUIET
        | {
            "wheels.speed_limit": 140.0,
            "wheels.h_start_wheel": [1.0, 0.3, -0.9, 0.0],
            "spacecraft.omega_start_body": [0.2, -0.1, 0.3],
        }
    ).plant
    y = plant.start_state()
    start, momenta = inertial(plant, y), []
    wheel_state, t = Held((0.02, 0.0, -0.01, 0.0)), 0.0
    for t in range(60):
        y, wheel_state, _ = advance(plant, float(t), t + 1.0, y, wheel_state)
        omega, h = plant.motion(t + 1.0, y, wheel_state)
        assert min(plant.margin(i, omega, h) for i in range(3)) > -1e-12
        momenta.append(h[0])
    assert wheel_state.pinned == (1, 0, -1, 0)
    assert inertial(plant, y) == pytest.approx(start, abs=1e-11)
    assert np.ptp(momenta[-20:]) > 1e-6


@given(st.floats(0.002, 0.02), st.floats(0.05, 0.5), st.sampled_from([0.2, 2.0]))
@settings(max_examples=12)
def test_coulomb_friction_through_zero(command, h0, eps):
    """One wheel about a principal axis, at rest in all: Omega' = k (c - c_c tanh(Omega
    / eps)) with k = K has t = eps / k (F(u1) - F(u0)), F = (c u + c_c ln|c cosh u - c_c
    sinh u|) / (c^2 - c_c^2), u = Omega / eps."""
    dry = 1e-3
    plant = gyrostat(
        **QUIET
        | PRINCIPAL
        | {
            "wheels.coulomb": dry,
            "wheels.friction_speed": eps,
            "wheels.motor_lag": 0.0,
            "wheels.h_start_wheel": [h0, 0.0, 0.0, 0.0],
            "wheels.torque_limit": 1.0,
            "spacecraft.omega_start_body": [-h0 / (40.0 - 0.008), 0.0, 0.0],
        }
    ).plant
    y = plant.start_state()
    y[11] = -command
    y, _, pieces = advance(
        plant, 0.0, 1.5 * h0 / command, y, Held((-command, 0.0, 0.0, 0.0))
    )
    assert len(pieces) == 2, "cut where the speed is zero"

    def time(u):
        size = (
            abs(-command * math.cosh(u) - dry * math.sinh(u)) if abs(u) < 300 else None
        )
        logarithm = (
            math.log(size)
            if size
            else abs(u) + math.log(abs(-command - dry * math.copysign(1.0, u)) / 2.0)
        )
        return (-command * u + dry * logarithm) / (command**2 - dry**2)

    omega, h = plant.motion(0.0, y, Held())
    u0, u1 = h0 * K / eps, plant.speed(0, omega, h) / eps
    assert u1 < 0.0 < u0
    assert eps / K * (time(u1) - time(u0)) == pytest.approx(
        1.5 * h0 / command, rel=1e-10
    )
    assert eps / K * (time(0.0) - time(u0)) == pytest.approx(pieces[1].begin, rel=1e-10)


def test_a_standing_wheel_breaks_loose():
    """At rest, when c (1 - exp(-t / lag)) is the stiction; from then on it has what its
    motor gives less Coulomb friction. Back at rest it stands."""
    plant = gyrostat(
        **QUIET
        | PRINCIPAL
        | {
            "wheels.stiction": 8e-3,
            "wheels.coulomb": 5e-3,
            "wheels.h_start_wheel": [0.0] * 4,
        }
    ).plant
    y = plant.start_state()
    wheel_state = replace(plant.start_held(), command=(0.01, 0.0, 0.0, 0.0))
    y, wheel_state, (still, _) = advance(plant, 0.0, 4.0, y, wheel_state)
    loose = -0.3 * math.log(1.0 - 0.8)
    assert still.end == pytest.approx(loose, abs=1e-12)
    h = motor(0.01, 4.0) - motor(0.01, loose) - 5e-3 * (4.0 - loose)
    assert y[H] == pytest.approx([h, 0.0, 0.0, 0.0], abs=1e-14)
    y, wheel_state, (moving, there) = advance(
        plant, 4.0, 14.0, y, replace(wheel_state, command=(0.0,) * 4)
    )
    # the motor's torque dies out against friction
    torque, t = 0.01 * -math.expm1(-4.0 / 0.3), moving.end - 4.0
    assert h - 0.3 * torque * math.expm1(-t / 0.3) == pytest.approx(5e-3 * t, abs=1e-13)
    assert there.held.pinned == (STANDING,) * 3 + (0,)
    assert not any(y[H])


def test_a_pulse_train_gives_its_momentum():
    """About one principal axis, from rest; firings overlap and one lasts beyond the
    end."""
    begin, long = [1.37, 4.0, 4.25, 9.81], [0.11, 0.5, 1.77, 1.0]
    torque = [0.04, -0.03, 0.02, 0.01]
    values = (
        QUIET
        | PRINCIPAL
        | {
            "thrusters.schedule_start": begin + [0.0] * 4,
            "thrusters.schedule_duration": long + [0.0] * 4,
            "thrusters.schedule_tau_body": [[x, 0.0, 0.0] for x in torque]
            + [[0.0] * 3] * 4,
            "wheels.h_start_wheel": [0.0] * 4,
        }
    )
    trajectory = gyrostat("gyrostat/pulses", stop=10.0, **values).ideal()
    for t, omega in zip(trajectory.times, trajectory.omega, strict=True):
        impulse = sum(
            x * min(max(t - b, 0.0), n)
            for b, n, x in zip(begin, long, torque, strict=True)
        )
        assert 39.992 * omega[0] == pytest.approx(impulse, abs=1e-15)
        assert not omega[1:].any()


def test_a_failed_wheel_coasts():
    """Without friction its momentum stays from the failure on, at 7.3 s as commanded
    until then."""
    values = QUIET | {
        "wheels.failed": "1",
        "wheels.failed_from": 7.3,
        "controller.kp": 0.8,
        "controller.kd": 5.6,
    }
    h = gyrostat(stop=12.0, **values).ideal().h
    well = gyrostat(stop=12.0, **values | {"wheels.failed": "none"}).ideal().h
    assert np.array_equal(h[:8], well[:8])
    assert np.ptp(h[8:, 0]) == 0.0
    # the command is at its limit of 20 mN m, the motor with its lag of 0.3 s long there
    assert abs(h[8, 0] - h[7, 0]) == pytest.approx(0.3 * 0.02, abs=1e-9)
    assert abs(well[8, 0] - h[8, 0]) == pytest.approx(0.7 * 0.02, abs=1e-9)


def test_a_loop_learns_the_friction():
    """At a speed where Coulomb friction is constant: learnt = c_c (1 - exp(-c t))."""
    plant = gyrostat(
        **QUIET
        | {
            "wheels.coulomb": 5e-4,
            "wheels.compensation": 0.7,
            "wheels.h_start_wheel": [0.5, -1.5, 0.8, 0.0],
        }
    ).plant
    y, _, _ = advance(plant, 0.0, 5.0, plant.start_state(), Held())
    loss = 5e-4 * -math.expm1(-3.5) / 0.7
    assert y[H] == pytest.approx([0.5 - loss, -1.5 + loss, 0.8 - loss, 0.0], abs=1e-14)
    assert y[15] == pytest.approx(5e-4 * -math.expm1(-3.5), abs=1e-15)
    # what the motor gives in all stays within its limit
    strong = gyrostat(
        **QUIET
        | {
            "wheels.coulomb": 5e-3,
            "wheels.compensation": 5.0,
            "wheels.torque_limit": 2e-3,
        }
    ).plant
    y, _, pieces = advance(strong, 0.0, 5.0, strong.start_state(), Held())
    omega, h = strong.motion(5.0, y, Held())
    assert strong.rotor(0, y, omega, h, Held())[0] == pytest.approx(
        2e-3 - friction(strong.speed(0, omega, h), 0.0, 5e-3, 2.0), abs=1e-15
    )
    assert len(pieces) > 1, "cut where the motor comes to its limit"


# --- the reference and the blocks -----------------------------------------------------


@pytest.mark.study
@pytest.mark.parametrize(
    ("name", "values", "least_order"),
    [
        ("full", {"manager.gyroscopic": True, "manager.feedforward": True}, 2.5),
        ("full", {"wheels.compensation": 0.5, "controller.torque_limit": 0.015}, 1.0),
        (
            "full",
            {
                "controller.sample_time": 2.0,
                "magnetometer.sample_time": 4.0,
                "torquers.sample_time": 2.0,
            },
            2.5,
        ),
        (
            "full",
            {
                "manager.law": "ccpl",
                "manager.gain": 200.0,
                "magnetometer.bias_body": [1e-6] * 3,
                "spacecraft.residual_dipole_body": [0.1, 0.2, -0.1],
                "spacecraft.tau_disturbance_body": [1e-5, 0, -2e-5],
                "controller.anti_windup": True,
                "environment.eccentricity": 0.01,
            },
            2.5,
        ),
        (
            "full",
            {
                "controller.delay": 1.0,
                "manager.delay": 2.0,
                "torquers.drive": "pulsed",
                "torquers.sample_time": 4.0,
                "torquers.pulse_delay": 0.13,
            },
            2.5,
        ),
        (
            "full",
            {
                "wheels.stiction": 6e-3,
                "wheels.coulomb": 3e-3,
                "manager.enable": False,
                "wheels.h_start_wheel": [0.05, -0.04, 0.0, 0.0],
            },
            1.5,
        ),
    ],
)
def test_the_blocks_converge_to_it(name, values, least_order):
    """With compensation more slowly: its loop takes friction as linear over a step.
    With stiction one wheel stands from 0.004 to 0.107 s, and two stop at once on their
    way through zero."""
    stop = (
        6.0 if "torquers.drive" in values else 24.0
    )  # its reference takes a second a pulse
    name, options = f"gyrostat/{name}", Options(blocks=True, stop=stop, values=values)
    ideal = gyrostat(name, stop=stop, **values).ideal()
    errors = []
    for step in (1.0, 0.5, 0.25):
        run = convergence.fly(name, replace(options, step=step))
        errors.append(estimate.difference(run.q, run.h, ideal.q, ideal.h)[0])
    assert errors[0] < 2e-6
    assert convergence.order([1.0, 0.5, 0.25], errors) > least_order, errors


@pytest.fixture(scope="module", params=CASES)
def case(request):
    """Its name, error at the scenario's step, what the run itself estimates (rad),
    warnings."""
    name = f"gyrostat/{request.param}"
    options = Options(blocks=True)
    scenario_case = prepare(name, options)
    system, _ = scenario_case.or_raise()
    ideal = Gyrostat(system).ideal()
    finer = convergence.fly(name, estimate.companion(system, options))
    run = convergence.fly(name, options)
    once = convergence.fly(name, replace(options, substeps=1))
    assert run.residual < 1e-13
    truth, single = (
        estimate.difference(f.q, f.h, ideal.q, ideal.h)[0] for f in (run, once)
    )
    error_estimate = estimate.estimate(run.q, run.h, finer.q, finer.h)[0]
    return request.param, truth, single, error_estimate, scenario_case.warnings


@pytest.mark.study
def test_a_case_of_the_exchange(case):
    name, truth, single, error_estimate, warnings = case
    was, error_bound = CASES[name]
    assert truth <= error_bound
    assert single <= 2.0 * was
    assert 0.2 <= error_estimate / truth <= 5.0, name
    harmless_warnings = ("no wheel gives torque", "attitude control")
    assert not [w for w in warnings if not any(x in w for x in harmless_warnings)]


unit = st.floats(-1.0, 1.0)
share = st.floats(0.0, 1.0)


@st.composite
def craft(draw):
    """Parameters of a craft of 1 to 100 kg m2 whose wheels, motor, friction, loop and
    rate suit its size, over one to two decades each."""

    def decades(low, high):
        return 10.0 ** draw(st.floats(low, high))

    size, torque, spin = decades(0, 2), decades(-3.5, -2.5), decades(-5, -3)
    x, y, z = (size * (1.0 + 0.2 * draw(unit)) for _ in range(3))
    xy, xz, yz = (0.1 * size * draw(unit) for _ in range(3))
    return {
        "spacecraft.inertia": [[x, xy, xz], [xy, y, yz], [xz, yz, z]],
        "shared.inertia_wheel": [spin * size] * 3 + [0.0],
        "spacecraft.omega_start_body": [0.1 * draw(unit) for _ in range(3)],
        "wheels.h_start_wheel": [0.2 * size * draw(unit) for _ in range(3)] + [0.0],
        "wheels.speed_limit": 1e6,
        "wheels.torque_limit": torque * size,
        "wheels.motor_lag": decades(-1.5, 0),
        "wheels.viscous": spin * size * decades(-4, -1.5),
        "wheels.coulomb": 0.1 * torque * size * draw(share),
        "controller.torque_limit": torque * size,
        "controller.kp": size * (0.005 + 0.045 * draw(share)),
        "controller.kd": size * (0.05 + 0.25 * draw(share)),
    }


@pytest.mark.study
@given(craft())
@settings(max_examples=20)
def test_the_estimate_of_any_craft(values):
    """Within a factor of 10 for all 20; measured over 50 others, 20 s each: 0.85 to
    2.63."""
    name, options = (
        "gyrostat/full",
        Options(blocks=True, values=values, stop=5.0, step=1.0),
    )
    system, _ = prepare(name, options).or_raise()
    ideal = Gyrostat(system).ideal()
    run = convergence.fly(name, options)
    finer = convergence.fly(name, estimate.companion(system, options))
    truth = estimate.difference(run.q, run.h, ideal.q, ideal.h)[0]
    error_estimate = estimate.estimate(run.q, run.h, finer.q, finer.h)[0]
    # below the rounding of the angle between two quaternions there is nothing to
    # estimate
    assert truth < 1e-13 or 0.1 <= error_estimate / truth <= 10.0


def test_the_limits_are_what_the_cases_reach():
    runs = [(name, None) for name in (*CASES, "stress")]
    runs += [(name, 1) for name in ("light", "zero-crossing", "saturating", "pulses")]
    bounds = []
    for name, substeps in runs:
        case = prepare(f"gyrostat/{name}", Options(blocks=True, substeps=substeps))
        bounds.append(coverage.bound(case.or_raise()[0]))
    for f in fields(coverage.StepCriteria):
        limit = getattr(coverage.LIMITS, f.name)
        assert 0.9 * limit <= max(getattr(b, f.name) for b in bounds) <= limit


def of_range(options):
    """The warnings of a run, but for values that are not usual and an unstable loop."""
    warnings = prepare("gyrostat/full", options).warnings
    return [
        w for w in warnings if ": usual is" not in w and "attitude control" not in w
    ]


def test_a_run_beyond_the_cases_warns():
    for values, text in (
        (
            {"wheels.h_start_wheel": [200.0, 0.0, 0.0, 0.0], "wheels.speed_limit": 3e4},
            "turn and nutation in a substep: ",
        ),
        (
            {"wheels.torque_limit": 4.0},
            "turn by the largest torque of wheels in a substep: ",
        ),
        (
            {"torquers.m_limit": 1e4},
            "turn by the largest torque of torquers in a substep: ",
        ),
    ):
        options = Options(blocks=True, values=values)
        (warning,) = of_range(options)
        assert warning.startswith(text), warning
        assert "--substeps auto chooses their number" in warning
        for substeps in (64, "auto"):
            assert not of_range(replace(options, substeps=substeps))


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"environment.field": "igrf"}, "needs environment.field = none or dipole"),
        ({"controller.sample_time": 0.0}, "needs controller.sample_time above 0 s"),
        (
            {"magnetometer.coil_coupling": [[1e-9, 0, 0], [0] * 3, [0] * 3]},
            r"needs magnetometer.coil_coupling\[1,1\] = 0.0, it is 1e-09",
        ),
        (
            {"magnetometer.resolution": 1e-9},
            "needs magnetometer.resolution = 0.0, it is 1e-09",
        ),
        ({"torquers.failed_coil": "1"}, "needs torquers.failed_coil = 0, it is 1"),
        ({"controller.enable": False}, "needs controller.enable = True, it is False"),
    ],
)
def test_it_refuses_what_it_does_not_know(values, text):
    with pytest.raises(DesatError, match=text):
        gyrostat("gyrostat/full", **values)


def test_the_reference_of_another_master_refuses_what_it_does_not_know():
    late = gyrostat(
        "gyrostat/full",
        **{
            "wheels.stiction": 1e-3,
            "controller.delay": 2.0,
            "torquers.drive": "pulsed",
            "torquers.sample_time": 4.0,
        },
    )
    with pytest.raises(
        DesatError, match=r"not know wheels.stiction, torquers.drive = pulsed, con"
    ):
        late.delayed(1.0)


def test_it_refuses_other_wires():
    options = Options(blocks=True, values={"manager.gyroscopic": True})
    system, _ = prepare("gyrostat/full", options).or_raise()
    wires = (
        c for c in system.connections if (c.target, c.input[:5]) != ("manager", "omega")
    )
    system = replace(system, connections=tuple(wires))
    with pytest.raises(
        DesatError, match=r"needs spacecraft.omega_bi_body wired to manager"
    ):
        Gyrostat(system)


# --- the commands ---------------------------------------------------------------------


@pytest.mark.slow
def test_convergence_has_estimates():
    options = Options(blocks=True, substeps=1)
    study = convergence.study(
        "gyrostat/slow-samples", options, (10.0, 5.0), ("gauss_seidel",)
    )
    rows = study["rows"]
    assert [r["step"] for r in rows] == [10.0, 5.0]
    for row in rows:
        assert 0.2 < row["estimate"] / row["attitude_error"] < 5.0
        assert 0.2 < row["estimate_wheel_momentum"] / row["wheel_momentum_error"] < 5.0


def test_a_number_at_the_limit_of_the_range_is_no_warning():
    limits = coverage.LIMITS
    assert (limits.turn, limits.kick, coverage.TOGETHER, coverage.JITTER) == (
        0.46,
        0.0076,
        0.0103,
        1e-6,
    )
    for scale in (1.0, 1.0 + 1e-9):
        assert (
            list(
                coverage._beyond(
                    coverage.StepCriteria(limits.turn * scale, limits.kick)
                )
            )
            == []
        )
    above = coverage.StepCriteria(limits.turn * (1.0 + 2e-9), limits.kick)
    assert list(coverage._beyond(above)) == [("turn", above.turn)]
    assert coverage._of_jitter(1e-6, "now") == []
    assert len(coverage._of_jitter(math.nextafter(1e-6, 1.0), "now")) == 1


PARTS = coverage.StepParts(
    ["a.q", "a.w", "w.h", "a.i"],
    np.eye(3, 4).tolist(),
    np.eye(3).tolist(),
    [0.01] * 4,
    0.0,
)


def collect_remarks(
    turning=0.0, kick=0.0, h=0.0, last=0.0, unbalance=0.0, lacking=(), **message
):
    """Remarks about rows of a body that reached so much, of wheels with momenta h to
    `last`."""
    extremes = coverage.Reached(
        np.array([0.0, 1.0, 2.0]),
        np.array([0.0, turning, 0.0]),
        np.array([0.0, kick]),
        np.zeros(1),
    )
    results = SimpleNamespace(
        names=lambda: [x for x in PARTS.series if x not in lacking],
        values=lambda name, rows: np.array([[h] * 4, [last] * 4])[rows],
    )
    manifest = SimpleNamespace(
        substep_choice=None,
        parts={coverage.KEY: replace(PARTS, unbalance=unbalance)},
        algorithm="gauss_seidel",
        step=2.0,
        substeps=4,
    )
    vars(manifest).update(message)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            coverage, "of_run", lambda parts, results: None if lacking else extremes
        )
        return coverage.remarks(manifest, results)


def test_a_run_says_where_it_left_the_range():
    turn, kick = 0.46 / 0.5, 0.0103 / 0.25
    assert collect_remarks(turn, kick) == []
    assert (
        collect_remarks(0.46 * (1.0 + 1e-9) / 0.5, 0.0103 * (1.0 + 1e-9) / 0.25) == []
    )
    assert collect_remarks(2.0 * turn, 2.0 * kick, lacking=["a.q"]) == []
    assert collect_remarks(2.0 * turn, 2.0 * kick, algorithm="jacobi") == []
    line, other = collect_remarks(turn * (1.0 + 3e-9), kick * (1.0 + 3e-9))
    assert line.startswith(
        "at t = 1 s, turn and nutation in a substep: 0.46 rad, accuracy"
    )
    assert other.startswith(
        "at t = 1 s, turn by the largest torque of all actuators in a substep"
    )


def test_a_run_says_how_much_the_jitter_of_faster_wheels_leaves():
    """8 unbalance Omega H / J of four wheels, where they turn once within a step and
    more."""
    assert collect_remarks(h=1.0, last=1.9, unbalance=1e-9) == []
    assert collect_remarks(h=1.0, last=2.0, unbalance=1e-9) == []
    (line,) = collect_remarks(h=1.0, last=2.1, unbalance=1e-9)
    assert "attitude error of about 3.4e-06 rad, at their largest speeds" in line
    assert collect_remarks(h=0.0, last=2.1, unbalance=1e-10) == []


def test_a_run_that_chose_says_what_it_could_not_look_at():
    flight = SubstepChoice(4, 1e-7, 5e-8, steps=30, reached=(1.0, 1.0, 1.0))
    assert collect_remarks(substep_choice=flight) == []
    (line,) = collect_remarks(substep_choice=flight, lacking=["a.w", "a.i"])
    assert line == (
        "its substeps are chosen by its first 30 steps, and not looked at again: "
        "not recorded: a.i, a.w"
    )
    assert (
        collect_remarks(substep_choice=replace(flight, reached=None), lacking=["a.w"])
        == []
    )
    assert collect_remarks(substep_choice=flight, parts={coverage.KEY: None}) == []
    far = {"turning": 9.0, "kick": 9.0}
    assert (
        len(collect_remarks(substep_choice=replace(flight, estimate=None), **far)) == 2
    )
    assert collect_remarks(substep_choice=flight, **far) == []
