"""Paper 001: laws against their definitions, the ground's tables, what is refused,
short runs."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from benchmarks.pages import telescope
from desat.analyses import coil_bound
from desat.campaign import pairs
from desat.campaign.draws import RunRow
from desat.components.contract.block import BlockError
from desat.components.laws import momentum_learning as learning
from desat.components.laws import momentum_management as laws
from desat.components.laws import momentum_offline as offline
from desat.components.maths.vector import IDENTITY, cross, dot, norm
from desat.components.physics.wheel_array import pseudo_inverse, to_wheels
from desat.files.scenario import find, scenarios
from desat.numbers import measures, numbers
from desat.papers import stored, tables
from desat.papers.designs import making, momentum_tables
from desat.runs.run import Options, execute, prepare
from desat.system.errors import DesatError
from tests.conftest import but
from tests.contract.test_block import begin, fresh

S, C = (
    math.sin(math.radians(35.264389682754654)),
    math.cos(math.radians(35.264389682754654)),
)
COILS = (
    S,
    S,
    S,
    S,
    C / 2**0.5,
    -C / 2**0.5,
    -C / 2**0.5,
    C / 2**0.5,
    C / 2**0.5,
    C / 2**0.5,
    -C / 2**0.5,
    -C / 2**0.5,
)
A20, B20 = math.sin(math.radians(20.0)), math.cos(math.radians(20.0)) / 2**0.5
WHEELS = (A20, -A20, A20, -A20, -B20, -B20, B20, B20, -B20, -B20, -B20, -B20)
J = (36046.0, -706.0, 1491.0, -706.0, 86868.0, 449.0, 1491.0, 449.0, 93848.0)
R, V = (6878137.0, 0.0, 0.0), (0.0, 6690.0, 3632.3)
IDLE, DUMPING, _, FALLBACK = range(4)

component = st.floats(-1.0, 1.0)
vectors = st.tuples(component, component, component).filter(lambda v: norm(v) > 1e-2)
fields = vectors.map(lambda v: tuple(3e-5 * x for x in v))
torques = vectors.map(lambda v: tuple(0.2 * x for x in v))
mountings = st.sampled_from([COILS, WHEELS])


# --- the laws -------------------------------------------------------------------------


def test_eq_6_and_eq_8_with_its_last_sign_turned_have_the_products_that_the_text_implies():
    assert laws.weighting(WHEELS) == pytest.approx(
        (0.468, 0.0, 0.0, 0.0, 1.766, 0.0, 0.0, 0.0, 1.766), abs=1e-4
    )
    assert laws.weighting(COILS) == pytest.approx(
        [4.0 / 3.0 * x for x in IDENTITY], abs=1e-4
    )


def test_eq_8_as_printed_has_two_equal_columns_and_is_no_multiple_of_the_identity():
    printed_coils = (*COILS[:11], -COILS[11])
    assert printed_coils[0::4] == printed_coils[3::4]
    assert laws.weighting(printed_coils) != pytest.approx(
        [4.0 / 3.0 * x for x in IDENTITY], abs=0.3
    )


@settings(max_examples=20)
@given(torques, fields)
def test_with_the_identity_the_torque_is_the_part_of_the_wanted_one_across_the_field(
    torque, b
):
    m = laws.closed_loop_dipole(torque, b, IDENTITY)
    size = dot(b, b)
    assert m == pytest.approx(
        [x / size for x in cross(b, torque)], rel=1e-14, abs=1e-12
    )
    across = [t - dot(torque, b) / size * x for t, x in zip(torque, b, strict=True)]
    assert cross(m, b) == pytest.approx(across, abs=1e-15)


@settings(max_examples=4)
@given(torques, fields, mountings)
def test_closed_loop_torque_is_the_nearest_across_the_field_in_the_weighting(
    torque, b, axes
):
    s = laws.weighting(axes)
    given_torque = np.array(cross(laws.closed_loop_dipole(torque, b, s), b))
    assert abs(given_torque @ b) <= 1e-16
    across = np.linalg.svd(np.array([b]))[2][1:]  # two directions across B
    inverse = np.linalg.inv(np.reshape(s, (3, 3)))

    def miss(x):
        gap = np.array(torque) - x @ across
        return gap @ inverse @ gap

    best = minimize(miss, np.zeros(2), method="BFGS", options={"gtol": 1e-10})
    assert given_torque == pytest.approx(best.x @ across, abs=1e-6)


@settings(max_examples=20)
@given(fields, mountings)
def test_the_field_product_is_that_of_skew_matrices(b, axes):
    x, y, z = b
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s = laws.weighting(axes)
    product = skew.T @ np.reshape(s, (3, 3)) @ skew
    assert np.reshape(laws.field_product(b, s), (3, 3)) == pytest.approx(
        product, abs=1e-24
    )


@settings(max_examples=10)
@given(st.lists(fields, min_size=4, max_size=9), vectors, mountings)
def test_eq_3_the_open_loop_gives_the_wanted_momentum_exactly(
    course, target_momentum, axes
):
    s, dt = laws.weighting(axes), 50.0
    products = np.array([laws.field_product(b, s) for b in course])
    full = tuple((dt * products.sum(axis=0)).tolist())
    if laws.condition(full) > 1e4:
        return
    p = laws.open_loop_costate(full, target_momentum)
    given_momentum = np.zeros(3)
    for b in course:
        given_momentum += dt * np.array(cross(laws.open_loop_dipole(p, b, s), b))
    assert given_momentum == pytest.approx(target_momentum, abs=1e-9)


@settings(max_examples=20)
@given(st.lists(fields, min_size=1, max_size=4))
def test_the_condition_is_that_of_its_eigenvalues(course):
    product = sum(np.array(laws.field_product(b, IDENTITY)) for b in course) * 1e9
    values = np.linalg.eigvalsh(product.reshape(3, 3))
    condition_number = laws.condition(tuple(product.tolist()))
    if values[0] > 1e-6 * values[2]:
        assert condition_number == pytest.approx(values[2] / values[0], rel=1e-6)
    else:
        assert condition_number > 1e5
    assert laws.condition((0.0,) * 9) == math.inf


def test_the_allocation_is_the_least_of_all_that_give_the_dipole():
    m = (1000.0, -2000.0, 500.0)
    pinv = np.reshape(pseudo_inverse(COILS), (4, 3))
    axes = np.reshape(COILS, (3, 4))
    assert pinv == pytest.approx(axes.T @ np.linalg.inv(axes @ axes.T), abs=1e-12)
    coils = to_wheels(pseudo_inverse(COILS), m)
    assert laws.reduced(m, coils, 1e4) == m
    half = laws.reduced(m, coils, max(map(abs, coils)) / 2.0)
    assert half == pytest.approx([0.5 * x for x in m])


def test_a_dead_coil_is_left_out_of_the_axes():
    rest = laws.without(COILS, 2)
    assert rest[1::4] == (0.0, 0.0, 0.0)
    assert rest[0::4] == COILS[0::4]
    assert laws.without(COILS, 0) == COILS


def test_the_held_field_is_exact_for_a_parabola():
    def field(t):
        return (1e-5 + 2e-8 * t, -3e-5 + 1e-10 * t * t, 2e-5 - 5e-9 * t)

    def mean(i):  # from 0 to 50 s
        return sum(field(x)[i] for x in np.linspace(0.005, 49.995, 5000)) / 5000

    zero = (0.0, 0.0, 0.0)
    for third in (zero, field(-150.0)):
        mean_field = laws.held_field(field(0.0), field(-50.0), field(-100.0), third)
        assert mean_field == pytest.approx([mean(i) for i in range(3)], rel=1e-7)
    assert laws.held_field(field(0.0), zero, zero, zero) == field(0.0)


def test_a_profile_s_rows_keep_to_their_period():
    times = 150.0 * np.arange(12)
    table = np.where(times <= 750.0, times**2, 750.0**2 + 9e3 * (times - 750.0))
    rows = tuple(np.repeat(table, 3))
    for t in (40.0, 700.0, 749.0, 760.0, 1000.0, 1649.0):
        i, share = laws.place(12, 150.0, t)
        profile = t * t if t <= 750.0 else 750.0**2 + 9e3 * (t - 750.0)
        assert laws.profile3(rows, 12, 5, i, share) == pytest.approx(
            (profile,) * 3, rel=1e-12
        )


# --- what is learnt in flight ---------------------------------------------------------


def updates(truth, count, noise=0.0, seed=1):
    """Estimates, covariances and the coil found lost after each of `count` updates of
    50 s."""
    random, x, p, missing = (
        np.random.default_rng(seed),
        learning.FIRST,
        learning.first_covariance(),
        0,
    )
    estimates = []
    for k in range(count):
        u = 2.0 * math.pi / 5700.0 * 50.0 * k
        b = (2e-5 * math.cos(u), 8e-6, 4e-5 * math.sin(u))
        gravity = (0.05 * math.sin(2 * u), 0.02 + 0.05 * math.cos(2 * u), 0.03)
        coils = tuple(random.uniform(-800.0, 800.0, 4).tolist())
        rows = learning.effects(50.0, gravity, COILS, coils, b)
        change = np.reshape(rows, (3, 5)) @ truth + noise * random.normal(size=3)
        x, p = learning.update(x, p, tuple(change.tolist()), rows, 0.1, 0.01)
        missing = learning.find_lost_coil(x, p, missing)
        estimates.append((x, p, missing))
    return estimates


@pytest.mark.parametrize("dead", [1, 2, 3, 4])
def test_without_noise_the_scale_and_each_coil_are_found_and_the_dead_one_is_named(
    dead,
):
    truth = np.array([1.25, 1.0, 1.0, 0.9, 1.0])
    truth[dead] = 0.0
    estimates = updates(truth, 60)
    assert estimates[-1][0] == pytest.approx(truth, abs=2e-3)
    assert [missing for _, _, missing in estimates[20:]] == [dead] * 40
    assert {missing for _, _, missing in estimates} == {
        0,
        dead,
    }  # no other is ever taken for it


def test_the_filter_is_that_of_information_form():
    rows, p = (
        np.arange(15.0).reshape(3, 5) ** 1.5 / 10.0,
        np.reshape(learning.first_covariance(), (5, 5)),
    )
    change, x = np.array([1.0, -2.0, 3.0]), np.ones(5)
    prior = np.linalg.inv(p + 0.01**2 * np.eye(5))
    full = prior + rows.T @ rows / 0.3**2
    information_state = np.linalg.solve(full, prior @ x + rows.T @ change / 0.3**2)
    estimate, spread = learning.update(
        learning.FIRST,
        learning.first_covariance(),
        tuple(change),
        tuple(rows.ravel()),
        0.3,
        0.01,
    )
    assert estimate == pytest.approx(information_state, rel=1e-9)
    assert np.reshape(spread, (5, 5)) == pytest.approx(
        np.linalg.inv(full), rel=1e-7, abs=1e-12
    )


def test_noise_as_large_as_said_makes_no_coil_lost_and_a_whole_one_is_no_more():
    estimates = updates(np.ones(5), 2000, 0.1)
    assert {missing for _, _, missing in estimates} == {0}
    assert np.abs(np.array(estimates[-1][0]) - 1.0).max() < 0.3
    x, p, _ = updates(np.array([1.0, 1.0, 0.0, 1.0, 1.0]), 60)[-1]
    assert learning.find_lost_coil(x, p, 0) == 2
    assert learning.find_lost_coil(learning.FIRST, p, 2) == 0
    assert (
        learning.find_lost_coil((1.0, 1.0, 0.5, 1.0, 1.0), p, 2) == 2
    )  # neither is sure: as it was
    assert learning.shares((1.0, -0.1, 0.4, 1.0, 1.2)) == (0.0, 0.4, 1.0, 1.0)


def test_the_passed_field_is_exact_for_a_parabola():
    def field(t):
        return (1e-5 + 2e-8 * t, -3e-5 + 1e-10 * t * t, 2e-5 - 5e-9 * t)

    mean = (
        1e-5 + 2e-8 * 25.0,
        -3e-5 + 1e-10 * 2500.0 / 3.0,
        2e-5 - 5e-9 * 25.0,
    )  # 0 to 50 s
    assert learning.passed_field(
        field(50.0), field(0.0), field(-50.0)
    ) == pytest.approx(mean)
    straight = learning.passed_field(field(50.0), field(0.0), (0.0, 0.0, 0.0))
    assert straight[0] == pytest.approx(mean[0])


# --- the ground -----------------------------------------------------------------------


def a_course(count=114):
    """Half an orbit a period of 57, field and gravity gradient of a telescope."""
    t = 50.0 * (np.arange(count) + 0.5)
    u = 2.0 * math.pi / 5700.0 * t
    field = 2e-5 * np.stack([np.cos(u), 0.4 + 0.1 * np.sin(u), 2.0 * np.sin(u)], axis=1)
    gravity = 0.05 * np.stack(
        [np.sin(2 * u), 0.3 + np.cos(2 * u), 0.2 - np.sin(2 * u)], axis=1
    )
    eye = np.broadcast_to(np.eye(3), (count, 3, 3))
    to_wheels_ = np.broadcast_to(
        np.linalg.pinv(np.reshape(WHEELS, (3, 4))), (count, 4, 3)
    )
    return offline.Course(50.0, field, gravity, 4.0 / 3.0 * eye, to_wheels_)


def test_the_profile_ends_where_it_shall_and_dumps_across_the_field_alone():
    course = a_course()
    ends = offline.periodic_ends(course, 2.0 * math.pi / 5700.0, 57)
    values, conditions = offline.profile(course, ends, 57, np.zeros(3))
    assert values[[57, 114]] == pytest.approx(ends[1:], abs=1e-9)
    torque = np.diff(values, axis=0) / 50.0 - course.gravity
    assert np.abs((torque * course.field).sum(axis=1)).max() < 1e-17
    assert (conditions > 1.0).all()


def test_only_what_is_not_periodic_is_dumped_over_half_an_orbit():
    course = a_course()
    ends = offline.periodic_ends(course, 2.0 * math.pi / 5700.0, 57)
    assert ends[1] == pytest.approx(ends[2], abs=1e-9)  # of an amplitude of 23 N m s
    dumped_momentum = ends[2] - ends[1] - 50.0 * course.gravity[57:].sum(axis=0)
    assert dumped_momentum == pytest.approx(
        [0.0, -0.015 * 2850.0, -0.01 * 2850.0], abs=1e-9
    )


def test_the_cheapest_course_is_that_of_a_dense_solution():
    course = a_course(20)
    q = np.array([600.0, 500.0, 700.0])
    cheapest = offline.cheapest(course, q, 0.0, 20.0, np.array([1.0, -2.0, 3.0]))
    n = 20
    effect = np.zeros((3 * n, 3 * n))  # momenta by dipoles
    for k in range(n):
        for j in range(k + 1):
            effect[3 * k : 3 * k + 3, 3 * j : 3 * j + 3] = course.effect[j]
    free = (
        np.array([1.0, -2.0, 3.0]) + 50.0 * np.cumsum(course.gravity, axis=0)
    ).ravel()
    weight = np.kron(np.eye(n), np.diag(q))
    effort = np.kron(np.eye(n), 0.75 * np.eye(3))
    m = np.linalg.solve(effort + effect.T @ weight @ effect, -effect.T @ weight @ free)
    assert cheapest.dipole == pytest.approx(m.reshape(n, 3), rel=1e-6, abs=1e-3)
    assert cheapest.momentum[1:].ravel() == pytest.approx(free + effect @ m, abs=1e-6)


def test_a_weight_on_the_fastest_wheel_slows_it():
    course = a_course()
    peaks = [
        np.abs(
            np.einsum(
                "kwi,ki->kw",
                course.to_wheels,
                offline.cheapest(
                    course, np.full(3, 100.0), weight, 15.0, np.zeros(3)
                ).momentum[1:],
            )
        ).max()
        for weight in (0.0, 1e4, 1e6)
    ]
    assert peaks[0] > peaks[1] > peaks[2]


def test_the_cheapest_course_is_found_in_a_few_steps(monkeypatch):
    steps, once = [], offline._newton
    monkeypatch.setattr(
        offline, "_newton", lambda *values: steps.append(1) or once(*values)
    )
    offline.cheapest(a_course(), np.full(3, 100.0), 1e6, 15.0, np.zeros(3))
    assert 3 < len(steps) < 20


def test_feedback_is_the_cost_to_go():
    course = dataclasses.replace(a_course(30), gravity=np.zeros((30, 3)))
    start = np.array([3.0, -1.0, 2.0])
    best = offline.cheapest(course, np.full(3, 800.0), 0.0, 20.0, start)
    cost = 50.0 * (
        0.75 * (best.dipole**2).sum() + 800.0 * (best.momentum[1:] ** 2).sum()
    )
    k = offline.feedback(course, np.full(3, 800.0))[0]
    assert start @ k @ start == pytest.approx(cost, rel=1e-9)
    assert -k @ start == pytest.approx(best.costate[0] + 0.0, rel=0.15, abs=2e5)


# --- the blocks -----------------------------------------------------------------------


def manager(name, **parameters):
    block = fresh(name)
    block.axes_coil, block.axes_wheel, block.inertia = COILS, WHEELS, J
    block.sample_time = 50.0
    block.r_eci, block.v_eci, block.b_body = R, V, (2e-5, -1e-5, 3e-5)
    block.h_wheel = (5.0, -3.0, 8.0, 2.0)
    for key, value in parameters.items():
        setattr(block, key, value)
    return block


def step_block(block, count=1, start=0):
    if start == 0:
        block.check()
        begin(block)
    for k in range(start, start + count):
        block.advance(50.0 * k, 50.0)
    return block


NAMES = [
    "manager_closed_loop",
    "manager_mixed_mode",
    "manager_open_loop",
    "manager_preview",
    "manager_preview_learning",
]
ZEROS = (0.0,) * 4


@pytest.mark.parametrize("name", NAMES)
def test_without_an_attitude_or_a_field_there_is_no_dipole(name):
    for missing in (
        {"valid_q": False, "q_bi": (math.nan,) * 4},
        {"valid_b": False, "b_body": (math.nan,) * 3},
    ):
        block = step_block(manager(name, **missing))
        assert block.m_cmd_body == (0.0, 0.0, 0.0)
        assert block.mode == IDLE


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("change", "text"),
    [
        (
            {"axes_coil": (*COILS[:8], *COILS[4:8])},
            "axes_coil: the axes do not span space",
        ),
        (
            {"axes_wheel": (*WHEELS[:8], 0.0, 0.0, 0.0, 0.0)},
            "axes_wheel: the axes do not span",
        ),
        ({"sample_time": 0.0}, "sample_time = 0.0 s: a time above 0 is needed"),
        ({"dead_coil": 5}, r"dead_coil = 5 is outside \[0, 4\]"),
    ],
)
def test_what_no_law_can_work_with_is_refused(name, change, text):
    with pytest.raises(BlockError, match=text):
        step_block(manager(name, **change))


def test_a_dead_coil_without_which_the_rest_do_not_span_space_is_refused():
    three = (1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    with pytest.raises(
        BlockError, match="axes_coil: the axes that are left do not span space"
    ):
        step_block(manager("manager_closed_loop", axes_coil=three, dead_coil=3))


@pytest.mark.parametrize(
    ("name", "change", "text"),
    [
        ("manager_closed_loop", {"gain": 0.0}, "gain = 0.0 is outside"),
        (
            "manager_open_loop",
            {"update_period": 800.0},
            "longer than desaturation_period = 600.0",
        ),
        (
            "manager_open_loop",
            {"update_period": 120.0},
            "no multiple of sample_time = 50.0 s",
        ),
        (
            "manager_open_loop",
            {"manoeuvre": True, "t_begin": 9.0, "t_end": 8.0},
            "must be after",
        ),
    ],
)
def test_periods_and_gains_that_make_no_sense_are_refused(name, change, text):
    with pytest.raises(BlockError, match=text):
        step_block(manager(name, **change))


def test_a_coil_s_limit_keeps_the_direction_of_the_dipole():
    free = step_block(manager("manager_closed_loop", gain=1.0, m_limit=1e12)).m_cmd_body
    limited_dipole = step_block(
        manager("manager_closed_loop", gain=1.0, m_limit=4000.0)
    ).m_cmd_body
    assert max(
        map(abs, to_wheels(pseudo_inverse(COILS), limited_dipole))
    ) == pytest.approx(4000.0)
    assert norm(cross(free, limited_dipole)) <= 1e-9 * norm(free) * norm(limited_dipole)


def test_the_centre_loop_turns_the_middle_of_the_momentum_into_a_bias():
    block = manager("manager_closed_loop", centre_gain=0.5, centre_period=200.0)
    step_block(block, 5)
    a = np.reshape(WHEELS, (3, 4)) @ block.h_wheel
    assert block.h_bias_eci == pytest.approx(0.5 * a)


def test_beyond_its_table_a_law_has_none():
    for name in ("manager_mixed_mode", "manager_preview", "manager_preview_learning"):
        block = step_block(manager(name, table_nodes=4, table_spacing=150.0), 13)
        assert block.mode == FALLBACK
        assert block.m_cmd_body == (0.0, 0.0, 0.0)


def test_with_a_coil_lost_its_own_costates_are_used_where_there_are_some():
    rows = tuple(float(12 * i + k) for i in range(312) for k in range(12))
    for coil, table, costate in (
        (2, rows, (9.0, 10.0, 11.0)),
        (1, (0.0,) * 3744, (2.0,) * 3),
    ):
        block = step_block(
            manager("manager_preview_learning", table_nodes=20, lost_table=table)
        )
        block.costate_table = (2.0,) * 936
        block.lost_coil = coil
        assert block.offset(0, 0.5) == pytest.approx(costate)
        block._x = (5.0, *block._x[1:])  # no more than twice
        assert block.offset(0, 0.5) == pytest.approx([2.0 * g for g in costate])
        block.learn = False
        assert block.offset(0, 0.5) == (2.0,) * 3


def test_a_period_of_one_sample_is_singular_and_the_law_says_so():
    for subject, choice in (("hold", 0), ("none", 1)):
        block = manager(
            "manager_open_loop", desaturation_period=50.0, update_period=50.0
        )
        block.on_singular = choice
        step_block(block)
        assert block.condition > 1e12, subject
        assert block.mode == FALLBACK
        assert block.m_cmd_body == (0.0, 0.0, 0.0)  # there was none before


def test_a_costate_that_turns_bad_leaves_the_last_command_or_none():
    for subject, choice in (("hold", 0), ("none", 1)):
        block = manager("manager_open_loop", on_singular=choice, table_nodes=20)
        step_block(block)
        assert block.mode == DUMPING
        assert block.condition > 3.0
        before = block.m_cmd_body
        block.condition_limit = 1.0
        step_block(block, 4, 1)
        assert block.mode == FALLBACK, subject
        assert any(before)
        assert any(block.m_cmd_body) != bool(choice)


def test_the_prediction_of_the_open_loop_misses_by_rounding():
    block = step_block(manager("manager_open_loop"))
    assert 0.0 <= block.miss_predicted < 1e-9


def test_a_manoeuvre_has_one_desaturation_period():
    block = manager(
        "manager_open_loop",
        manoeuvre=True,
        q_end_bi=(0.0, 0.0, 0.6, 0.8),
        t_begin=300.0,
        t_end=420.0,
        lead_time=200.0,
        lag_time=100.0,
        table_nodes=20,
    )
    step_block(block, 2)
    before = block._costate
    step_block(block, 1, 2)
    during = block._costate
    assert during != before
    step_block(block, 8, 3)  # to t = 500 s < 550 s
    assert block._costate == during
    step_block(block, 1, 11)
    assert block._costate != during


# --- scenarios, designs, runs ---------------------------------------------------------

FAMILY = "space_telescope"


def test_every_leaf_of_figure_1_has_a_scenario():
    names = {n.partition("/")[2] for n in scenarios(FAMILY)}
    cases = {"nominal", "dead-known", "dead-unknown", "gravity-0-8"}
    for law in ("closed-cp", "closed-me"):  # they have no model of the field
        assert {f"{law}-{case}" for case in cases} <= names
    for law in ("open-me", "open-mw", "me", "me-short", "mixed-me", "mixed-mw", "ours"):
        assert {f"{law}-{case}" for case in cases | {"field-0-8", "no-tilt"}} <= names
    draws_by_name = stored.read(FAMILY)["scenarios"]
    compared_names = {f"{FAMILY}/{n}" for n in names if not n.startswith("predictive-")}
    assert all(len(draws_by_name[n]["draws"]) == 200 for n in compared_names)


def test_what_a_row_compares_flew_the_same_draws_and_two_hundred_for_the_rows_asked_for():
    draws_by_name = stored.read(FAMILY)["scenarios"]
    for name, scenario in scenarios(FAMILY).items():
        for entry in scenario.content.numbers.values():
            if entry.reference:
                other = draws_by_name[f"{FAMILY}/{entry.reference}"]["draws"]
                assert len(draws_by_name[name]["draws"]) == len(other), name
        bands = [
            e for e in scenario.content.entries.values() if e.tolerance is not None
        ]
        if bands:
            assert len(draws_by_name[name]["draws"]) == 200, name


def test_a_run_on_tables_of_another_attitude_or_beyond_them_is_refused_before_it_begins():
    name = f"{FAMILY}/mixed-me-nominal"
    rotated_target = Options(blocks=True, sets=["guidance.q_target_bi=1,0,0,0"])
    assert any(
        "tables are of another orbit" in p
        for p in prepare(name, rotated_target).problems
    )
    other = Options(blocks=True, sets=["environment.inclination=0.6"])
    assert any(
        "tables are of another orbit" in p for p in prepare(name, other).problems
    )
    longer = Options(blocks=True, stop=50000.0)
    assert any(
        "end at 46200 s, the run at 50000 s" in p
        for p in prepare(name, longer).problems
    )
    missing = Options(blocks=True, sets=["manager.made_for=0"])
    assert any("tables are missing" in p for p in prepare(name, missing).problems)
    assert prepare(name, Options(blocks=True)).problems == []


def test_a_kept_design_is_that_of_today_s_code():
    for name in ("mixed-me-nominal", "ours-nominal"):
        scenario = find(f"{FAMILY}/{name}")
        result = making.design(scenario).parameters
        manager_design = scenario.parameters()["manager"]
        for key, value in result.items():
            scale = np.abs(np.array(manager_design[key], float)).max()
            assert np.array(manager_design[key]) == pytest.approx(
                np.array(value), abs=1e-6 * scale
            ), key


def test_the_rows_of_the_profile_lose_less_than_half_a_newton_metre_second():
    for name in ("mixed-me-nominal", "mixed-mw-nominal"):
        text = find(f"{FAMILY}/{name}").design.read_text(encoding="utf-8")
        error = float(text.partition("interpolation_error = ")[2].partition(" ")[0])
        assert 0.0 < error < 0.5


def test_a_period_of_one_sample_falls_back_in_flight_and_one_source_replaces_the_manager():
    singular = {"manager.desaturation_period": 50.0, "manager.update_period": 50.0}
    options = Options(
        blocks=True, stop=600.0, values=singular, record=("*",), design=None
    )
    run = execute(f"{FAMILY}/open-me-nominal", options).or_raise("singular")
    assert (run.results.values("manager.mode") == FALLBACK).all()
    assert not run.results.values("torquers.m_coil").any()
    run.results.close()
    other = Options(stop=600.0, sources=["manager=manager_closed_loop"], record=("*",))
    run = execute(f"{FAMILY}/mixed-me-nominal", other).or_raise("replaced")
    assert (run.results.values("manager.mode") == DUMPING).all()
    run.results.close()


@pytest.mark.parametrize("name", ["closed-cp", "mixed-me", "me", "ours"])
def test_an_orbit_conserves_momentum_and_holds_the_attitude(name):
    options = Options(blocks=True, stop=2850.0, record=("*",))
    values = {
        "wheels.seed": 1
    }  # a value as of a draw, so that the design is made for this stop
    run = execute(
        f"{FAMILY}/{name}-nominal", dataclasses.replace(options, values=values)
    )
    numbers = run.or_raise(name).manifest["numbers"]
    momentum = run.results.values("spacecraft.impulse_eci")
    largest = np.linalg.norm(momentum, axis=1).max()
    assert numbers["momentum_residual"]["value"] <= 1e-12 * largest
    assert (run.results.values("manager.mode") == DUMPING).all()
    assert numbers["pointing"]["value"] < 0.01
    if (
        name == "mixed-me"
    ):  # it meets the profile where a period ends: at momentum of mean zero
        assert largest > 5.0
    run.results.close()


def test_in_flight_the_dead_coil_is_found_and_how_wrong_gravity_gradient_is_known():
    options = Options(
        blocks=True,
        stop=2850.0,
        record=("*",),
        design=None,
        values={"manager.inertia_scale": 0.8},
    )
    run = execute(f"{FAMILY}/ours-dead-unknown", options).or_raise("learns")
    lost_coils = run.results.values("manager.lost_coil").astype(int).ravel()
    assert set(lost_coils.tolist()) == {0, 1}
    assert lost_coils[-1] == 1
    assert run.results.values("manager.effectiveness")[-1] == pytest.approx(
        [0, 1, 1, 1], abs=0.05
    )
    assert run.results.values("manager.gravity_scale")[-1] == pytest.approx(
        1.25, abs=0.01
    )
    run.results.close()


def test_a_design_says_when_a_wheel_is_large_in_one_way():
    scenario = find(f"{FAMILY}/ours-nominal")
    for change, text in (
        ({"peak_momentum": 20.0}, "peak_momentum and peak_share: one of them"),
        ({"peak_share": None}, "peak_share is needed, for lost_peak_share"),
        (
            {"lost_momentum_weight": [0.0, 1.0, 1.0]},
            "lost_momentum_weight = .*: above 0 is needed",
        ),
    ):
        requests = scenario.content.design.written | change
        about = {k: v for k, v in requests.items() if v is not None}
        other = dataclasses.replace(
            scenario, content=but(scenario.content, design=about)
        )
        with pytest.raises(DesatError, match=f"^{scenario.name}: design: {text}"):
            making.design(other)


@pytest.fixture(scope="module")
def half_orbits():
    """Two orbits of the open loop and a half, bare."""
    options = Options(
        blocks=True, stop=14250.0, record=("*",), values={"wheels.seed": 1}
    )
    run = execute(f"{FAMILY}/open-me-nominal", options).or_raise("open-me")
    yield run
    run.results.close()


def test_the_open_loop_meets_its_momentum_at_the_end_of_the_period(half_orbits):
    numbers = {k: n["value"] for k, n in half_orbits.manifest["numbers"].items()}
    assert half_orbits.results.values("manager.miss_predicted").max() < 1e-9
    assert 0.0 < numbers["end_miss"] < 0.5
    assert 0.0 < numbers["off_profile"] < 0.05
    # a value a sample and 57 a half orbit
    assert numbers["field_models"] == pytest.approx(
        3600.0 * (1.0 / 50.0 + 57.0 / 2850.0)
    )


def test_the_periodic_momentum_is_kept_and_the_coils_move_less_than_gravity(
    half_orbits,
):
    numbers = {k: n["value"] for k, n in half_orbits.manifest["numbers"].items()}
    assert 80.0 < numbers["amplitude_kept"] < 100.0
    assert 0.0 < numbers["moved_by_coils"] < 0.5 * numbers["moved_by_gravity"]
    assert (
        numbers["time_above_100"]
        > numbers["time_above_200"]
        >= numbers["time_above_300"]
    )


def test_the_least_energy_is_below_the_run_and_grows_as_the_peak_shrinks(half_orbits):
    bound = coil_bound.of_run(half_orbits.manifest, half_orbits.results)
    assert 0.0 < bound.above_percent < 50.0
    assert bound.above_percent == pytest.approx(
        100.0 * (bound.energy / bound.least - 1.0)
    )
    curve = coil_bound.curve(
        half_orbits.manifest,
        half_orbits.results,
        [0.8 * bound.peak, bound.peak, 1.5 * bound.peak],
    )
    energies = [energy for _, energy in curve]
    assert energies[1] == pytest.approx(bound.least)
    assert energies[0] > energies[1] > energies[2]


def test_short_periods_are_ill_conditioned_and_may_turn_against_the_momentum(
    half_orbits,
):
    manifest, results = half_orbits.manifest, half_orbits.results
    rows = telescope.study(manifest, results, (50.0, 200.0, 600.0, 2850.0, 14250.0))
    assert rows[0]["condition"] == math.inf
    assert (
        rows[1]["condition"] > 4.0 * rows[2]["condition"] > 16.0 * rows[3]["condition"]
    )
    assert rows[1]["angle"] > 150.0 > 130.0 > rows[3]["angle"]
    assert rows[1]["torque"] > 2.0 * rows[2]["torque"] > 4.0 * rows[3]["torque"]
    # one period alone spans the run: that of the law itself on the measured field
    field = results.values("environment.b_eci")[5::10]
    product = np.sum(
        [laws.field_product(tuple(b), IDENTITY) for b in field.tolist()], axis=0
    )
    assert rows[4]["condition"] == pytest.approx(
        laws.condition(tuple(product)), rel=1e-2
    )


def test_the_mixed_law_multiplies_less_than_the_open_loop():
    work = {}
    for name in ("mixed-mw", "me"):
        system, _ = prepare(f"{FAMILY}/{name}-nominal", Options(blocks=True)).or_raise()
        work[name] = telescope.work(system)
    assert 1.0 < work["mixed-mw"] < 0.5 * work["me"]


def test_a_paired_ratio_is_of_the_same_draw():
    def make_draws(*values):
        return [
            RunRow("completed", 0, "", numbers={"e": x}, number=i)
            for i, x in enumerate(values)
        ]

    ratios = pairs.each_draw(
        make_draws(2.0, 9.0, None, 8.0), make_draws(1.0, 3.0, 5.0, 0.0), "e", ratio=True
    )
    assert ratios == {0: 2.0, 1: 3.0}
    assert numbers.related("paired_ratio", 6.0, 4.0) == 1.5


def test_claims_that_hold_are_within_their_bands(monkeypatch):
    monkeypatch.setattr(tables, "scenarios", stored.with_draws)
    stored_draws = stored.read(FAMILY)
    rows = [
        r
        for r in tables.rows(FAMILY, Options(), drawn=stored_draws)
        if r.table == "claims"
    ]
    assert len(rows) >= 15
    for row in rows:
        if row.remark.startswith("holds") and row.band:
            assert row.within, row


def test_the_share_of_a_vector_along_another():
    t = np.arange(2.0)
    a, b = (
        np.array([[3.0, 4.0, 0.0], [0.0, 5.0, 0.0]]),
        np.array([[2.0, 0, 0], [0, 0, 1.0]]),
    )
    assert measures.share_along(t, a, b) == pytest.approx(100.0 * math.sqrt(9.0 / 50.0))
    assert (
        measures.growth_in(np.array([0.0, 10.0]), np.array([[1.0], [6.0]]), 4.0, 2.0)
        == 4.0
    )
    assert measures.rms(t, a, 1) == pytest.approx(measures.rms(t, a) / math.sqrt(3.0))


def test_a_design_s_number_is_of_orbit_and_attitude_alone():
    case = prepare(f"{FAMILY}/ours-nominal", Options(blocks=True))
    system, _ = case.or_raise()
    dead = Options(blocks=True, sets=["torquers.failed_coil=1"])
    other, _ = prepare(f"{FAMILY}/ours-nominal", dead).or_raise()
    assert momentum_tables.made_for(system) == momentum_tables.made_for(other) > 0.0
