"""Detumbling by rollout: flights of the model, the search, the filter of the rate, the
block."""

from __future__ import annotations

from itertools import pairwise
from math import inf

import numpy as np
import pytest

from desat.components.blocks.manager_detumbling_rollout import (
    BRAKING,
    DETUMBLED,
    FILTER,
    IDLE,
    MISSES,
    MOST_STEPS,
    PLANNED,
    ManagerDetumblingRollout,
    count_misses,
)
from desat.components.contract.block import BlockError, Vec3, Vec4
from desat.components.laws import craft_filter, rate_observer, rollout
from desat.components.laws.acquisition import all_coils
from desat.components.maths import kalman
from desat.components.maths.vector import ZERO, add, cross, mat_vec, scale
from desat.components.physics.gyrostat import carrier_inertia, inverse_inertia
from desat.components.physics.wheel_array import body_momentum

INERTIA = (0.3078, 0.0, 0.0, 0.0, 0.2865, 0.0, 0.0, 0.0, 0.2747)
AXES = (0.0, 0.6, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.8, 0.0, 0.0)
"""Two wheels: along -y, and between x and z."""
CARRIER = carrier_inertia(INERTIA, AXES, (3e-4, 3e-4, 0.0, 0.0))
MODEL = rollout.Model(
    CARRIER,
    inverse_inertia(CARRIER),
    AXES,
    2.0,
    (1e-3, 1e-3, 0.0, 0.0),
    0.18,
    3e7,
    1e-2,
    3e-3,
    1.0,
)
PITCH = (0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ALONE = MODEL._replace(axes=PITCH, torque_limit=(1e-3, 0.0, 0.0, 0.0))
STILL: Vec4 = (0.0, 0.0, 0.0, 0.0)
FIELD: Vec3 = (2e-5, -1e-5, 2.5e-5)


def cost_of(
    sequence: rollout.Sequence, best: float = inf, fastest: float = inf
) -> float:
    return rollout.predict_cost(
        ALONE,
        (0.1, -0.1, 0.1),
        FIELD,
        STILL,
        sequence.torques,
        sequence.segments,
        sequence.elapsed_steps,
        20,
        900,
        best,
        fastest,
    )


def test_a_step_without_coils_keeps_the_momentum_and_follows_a_finer_one() -> None:
    u: Vec4 = (1e-3, -5e-4, 0.0, 0.0)

    def ended(parts: int) -> tuple[Vec3, Vec3, Vec4]:
        model = MODEL._replace(step=1.0 / parts)
        omega, b, h = (0.1, -0.1, 0.1), FIELD, STILL
        for _ in range(30 * parts):
            omega, b = rollout.propagate_step(model, omega, b, h, ZERO, u)
            h = (h[0] + u[0] / parts, h[1] + u[1] / parts, 0.0, 0.0)
        return omega, b, h

    first = np.linalg.norm(mat_vec(CARRIER, (0.1, -0.1, 0.1)))
    errors = []
    exact = ended(64)[0]
    for parts in (1, 2, 4):
        omega, b, h = ended(parts)
        total = np.add(mat_vec(CARRIER, omega), body_momentum(AXES, h))
        assert np.linalg.norm(total) == pytest.approx(first, rel=2e-3)
        assert np.linalg.norm(b) == pytest.approx(np.linalg.norm(FIELD), rel=5e-3)
        errors.append(float(np.linalg.norm(np.subtract(omega, exact))))
    assert errors[0] < 5e-3
    assert all(
        3.0 < coarse / fine < 6.0 for coarse, fine in pairwise(errors)
    )  # order 2


def test_the_search_is_never_later_than_the_law_or_what_was_chosen_before() -> None:
    law = cost_of(rollout.none(MODEL))
    before, cost = rollout.none(MODEL), law
    for index in range(3):
        found, result = rollout.sought(
            ALONE, (0.1, -0.1, 0.1), FIELD, STILL, before, index, 2, 8, 20, 900
        )
        assert result <= cost
        assert result == pytest.approx(cost_of(found), rel=1e-12)
        before, cost = found, result
    assert cost < 0.8 * law
    assert all(abs(u) <= 1e-3 for u in before.torques)
    for absent in (1, 2, 3):
        assert not any(before.torques[absent::4])


def test_a_flight_is_dropped_once_it_is_later_or_too_fast_for_the_model() -> None:
    law = cost_of(rollout.none(MODEL))
    assert cost_of(rollout.none(MODEL), best=law - 5.0) == inf
    spun = rollout.Sequence((1e-3, 0.0, 0.0, 0.0) * 4, 4, 0)
    assert cost_of(spun) < 901.0
    assert cost_of(spun, fastest=0.15) == inf
    omega = (2e-3, 0.0, 0.0)
    found, cost = rollout.sought(ALONE, omega, FIELD, STILL, spun, 0, 4, 64, 20, 900)
    assert found == rollout.none(MODEL)
    assert cost < 0.0


def test_a_sequence_that_has_begun_goes_on_where_it_was() -> None:
    """Its segments are counted from its own beginning: as one of what is left of it."""
    a, b, c, d = (1e-3, -5e-4, -1e-3, 7e-4)
    begun = rollout.Sequence(
        tuple(x for u in (a, b, c, d) for x in (u, 0.0, 0.0, 0.0)), 4, 20
    )
    remaining = rollout.Sequence(
        tuple(x for u in (b, c, d, 0) for x in (u, 0.0, 0.0, 0.0)), 3, 0
    )
    assert cost_of(begun) == cost_of(remaining)
    assert cost_of(begun) != cost_of(remaining._replace(segments=2))
    half = rollout.Sequence(remaining.torques, 2, 10)
    parts = rollout.Sequence(
        tuple(x for u in (b, c, c, 0) for x in (u, 0.0, 0.0, 0.0)), 3, 0
    )
    by_tens = rollout.predict_cost(
        ALONE, (0.1, -0.1, 0.1), FIELD, STILL, parts.torques, 3, 0, 10, 900, inf, inf
    )
    assert cost_of(half) == by_tens


def test_a_rate_at_its_limit_is_above_it_and_a_wheel_at_its_limit_is_not_driven() -> (
    None
):
    at = (MODEL.rate_limit, 0.0, 0.0)
    still = MODEL._replace(
        carrier=INERTIA, inverse=inverse_inertia(INERTIA), gain=0.0, gain_wheel=0.0
    )
    full = rollout.predict_cost(
        still, at, ZERO, STILL, rollout.none(MODEL).torques, 0, 0, 20, 7, inf, inf
    )
    assert full == 7.0 + 1.0  # turning about a principal axis
    spun = rollout.predict_cost(
        still, at, ZERO, STILL, rollout.none(MODEL).torques, 0, 0, 20, 7, inf, at[0]
    )
    assert spun == full  # as fast as is believed, and no faster
    assert (
        rollout.predict_cost(
            still, at, ZERO, STILL, rollout.none(MODEL).torques, 0, 0, 20, 7, 6.0, inf
        )
        == full
    )
    assert (
        rollout.predict_cost(
            still, at, ZERO, STILL, rollout.none(MODEL).torques, 0, 0, 20, 7, 5.0, inf
        )
        == inf
    )
    u, limit = (1e-3, -1e-3, 1e-3, -1e-3), 0.1
    assert rollout.stop_overspeed(u, (limit, limit, -limit, -limit), limit) == (
        0.0,
        -1e-3,
        1e-3,
        0.0,
    )
    assert rollout.stop_overspeed(u, (0.09, 0.09, -0.09, -0.09), limit) == u


def test_what_a_wheel_gave_is_counted_from_a_third_of_its_limit_on() -> None:
    assert count_misses(2, 0.3, 0.0, 1.0) == 2  # says nothing
    assert count_misses(2, 0.31, 0.0, 1.0) == 3
    assert count_misses(2, -0.31, 0.0, 1.0) == 3
    assert count_misses(2, 1.0, 0.2, 1.0) == 0  # a fifth is enough
    assert count_misses(2, 1.0, 0.19, 1.0) == 3
    assert count_misses(2, 1.0, 0.0, 0.0) == 2  # there is none, or none any more


def test_the_filter_knows_the_rate_along_the_field_and_how_well() -> None:
    """Body and field integrated in fine steps here; errors over their own covariance."""
    random = np.random.default_rng(5)
    inverse = inverse_inertia(CARRIER)
    noise, squares, aligned = 3e-7, [], []
    doubts = craft_filter.Doubts(0.2, noise, 0.0, 0.0, 0.0)
    setting = craft_filter.Setting(doubts, CARRIER, 3e-5, 3e-8)
    for _ in range(12):
        omega = tuple(random.choice([-0.1, 0.1], 3).tolist())
        b = random.normal(size=3)
        b = tuple((b * 3e-5 / np.linalg.norm(b)).tolist())
        x, p = craft_filter.begin(
            tuple(b + noise * random.normal(size=3)), ZERO, setting
        )
        for k in range(200):
            for _ in range(20):
                slope = mat_vec(inverse, cross(mat_vec(CARRIER, omega), omega))
                middle = add(omega, scale(0.025, slope))
                slope = mat_vec(inverse, cross(mat_vec(CARRIER, middle), middle))
                omega = add(omega, scale(0.05, slope))
                half = add(b, scale(0.025, cross(b, middle)))
                b = add(b, scale(0.05, cross(half, middle)))
            seen = tuple(b + noise * random.normal(size=3))
            passed = craft_filter.Interval(1.0, ZERO, ZERO, ZERO, seen, ZERO, 0.0)
            x, p, _ = craft_filter.update(x, p, passed, setting, True)
            if k >= 100 and k % 10 == 0:
                error = np.subtract(craft_filter.rate_of(x), omega)
                covariance = np.reshape(craft_filter.rates_covariance(p), (3, 3))
                squares.append(error @ np.linalg.solve(covariance, error))
                aligned.append(abs(error @ b) / np.linalg.norm(b))
    assert np.median(aligned) < 2e-3  # of 0.1 rad/s, which no single sample shows
    # of three degrees of freedom; the field here is held, so that the filter errs to
    # the safe side
    assert 0.3 < np.mean(squares) < 4.5


class Flight:
    """A block and a model of the craft that differs by a wheel that is dead or rubs."""

    def __init__(
        self,
        friction: float = 0.0,
        dead: bool = False,
        coils: Vec3 = (1.0, 1.0, 1.0),
        coupling: float = 0.0,
        **parameters: object,
    ) -> None:
        self.block = ManagerDetumblingRollout()
        values = {
            "axes_wheel": AXES,
            "inertia": INERTIA,
            "inertia_wheel": (3e-4, 3e-4, 0.0, 0.0),
            "rounds": 1,
            "candidates": 4,
            "hold_time": 10.0,
            **parameters,
        }
        for name, value in values.items():
            setattr(self.block, name, value)
        self.block.omega_bi_body = self.omega = (0.05, -0.05, 0.05)
        self.b, self.h, self.t = FIELD, STILL, 0.0
        self.friction, self.dead = friction, dead
        self.coils, self.coupling = np.array(coils), coupling
        self.block.start()

    def go(self, steps: int) -> ManagerDetumblingRollout:
        block = self.block
        for _ in range(steps):
            gives = self.coils * block.m_cmd_body
            block.omega_bi_body, block.h_wheel = self.omega, self.h
            block.b_body = tuple(self.b + self.coupling * gives)
            block.compute(self.t, 1.0)
            u = block.tau_cmd_wheel
            first = 0.0 if self.dead else u[0] - self.friction
            u = (first, u[1], 0.0, 0.0)
            self.omega, self.b = rollout.propagate_step(
                MODEL,
                self.omega,
                self.b,
                self.h,
                tuple(self.coils * block.m_cmd_body),
                u,
            )
            self.h = (self.h[0] + u[0], self.h[1] + u[1], 0.0, 0.0)
            self.t += 1.0
        return block


def test_it_detumbles_and_says_so_after_the_hold_time() -> None:
    flight = Flight()
    modes = [flight.go(1).mode for _ in range(300)]
    assert modes[-1] == DETUMBLED
    assert max(map(abs, flight.omega)) < 3e-3
    slow = modes.index(DETUMBLED)
    assert slow > 20
    assert BRAKING in modes[:slow]
    flight.omega = (0.02, 0.0, 0.0)
    assert flight.go(1).mode != DETUMBLED


def test_friction_is_given_beside_the_law() -> None:
    plain, rubbed = Flight(), Flight(friction=2e-4)
    for flight in (plain, rubbed):
        flight.go(300)
    assert rubbed.block._friction[0] == pytest.approx(2e-4, rel=0.05)
    assert rubbed.block.mode == DETUMBLED


def test_a_dead_wheel_is_noticed_and_the_coils_take_the_gain_that_lets_the_field_turn() -> (
    None
):
    flight = Flight(dead=True)
    block = flight.go(60)
    assert block._limits == (0.0, 1e-3, 0.0, 0.0)
    assert block.wheels_dead == 1
    block.enable = False
    flight.go(1)
    assert block._limits == (1e-3, 1e-3, 0.0, 0.0)
    assert block.wheels_dead == 0
    only = Flight(
        dead=True,
        axes_wheel=(0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )
    block = only.go(60)
    assert not any(block._limits)
    assert block._coil_gain() == pytest.approx(
        block.gain_alone / np.dot(only.b, only.b), rel=0.01
    )
    assert block._segments == 0


def test_without_a_rate_nothing_is_commanded_and_without_a_field_no_dipole() -> None:
    flight = Flight()
    flight.block.valid_omega = False
    block = flight.go(1)
    assert block.mode == IDLE
    assert not any(block.m_cmd_body)
    assert not any(block.tau_cmd_wheel)
    flight.block.valid_omega, flight.block.valid_b = True, False
    block = flight.go(1)
    assert not any(block.m_cmd_body)
    assert any(block.tau_cmd_wheel)


def test_it_is_detumbled_at_the_end_of_the_hold_time_and_no_more_above_its_second_limit() -> (
    None
):
    """By rates that are given: both limits count as not reached."""
    flight = Flight(plan_time=1e3)
    block, modes = flight.block, []

    def at(rate: float) -> int:
        flight.omega = (rate, 0.0, 0.0)
        return flight.go(1).mode

    assert at(block.rate_limit) != DETUMBLED
    assert block._slow_since < 0.0
    assert not block._is_slow
    modes = [at(0.9 * block.rate_limit) for _ in range(12)]
    assert modes.index(DETUMBLED) == 10  # the eleventh sample is 10 s after the first
    assert at(block.rate_again) == DETUMBLED
    assert at(1.01 * block.rate_again) != DETUMBLED
    assert block.mode in (BRAKING, PLANNED)


def test_what_is_slow_from_the_start_is_detumbled_after_the_hold_time_too() -> None:
    flight = Flight(plan_time=1e3)
    flight.omega = (1e-3, 0.0, 0.0)
    assert [flight.go(1).mode for _ in range(11)].index(DETUMBLED) == 10


def test_a_rate_is_sure_where_its_error_is_below_the_limit() -> None:
    block = Flight(rate_from=FILTER).block
    limit = block.rate_limit * block.rate_limit
    for axis in range(3):
        for variance, sure in ((limit, False), (0.99 * limit, True)):
            parts = [0.5 * limit] * 3
            parts[axis] = variance
            x, y, z = parts
            block._rates = (x, 0.0, 0.0, 0.0, y, 0.0, 0.0, 0.0, z)
            assert block._is_sure() == sure


def test_a_dead_wheel_is_one_at_the_fifth_sample_and_a_plan_is_made_anew_when_it_is_due() -> (
    None
):
    flight = Flight(gain_wheel=0.0, rounds=0, plan_time=3.0)
    block = flight.block
    for k in range(1, 8):
        flight.go(1)
        assert block._searches == 1 + (k - 1) // 3
    flight = Flight(dead=True, gain_wheel=1.0, rounds=0)
    counts = [flight.go(1).wheels_dead for _ in range(MISSES + 2)]
    assert counts == [0] * MISSES + [1, 1]  # the first sample has no torque before it
    first = flight.block._planned_at
    assert first == MISSES


def test_a_sequence_is_followed_for_its_segments_and_no_longer() -> None:
    flight = Flight(rounds=0, plan_time=1e3, segment=2.0, gain_wheel=0.0)
    block = flight.go(1)
    block._plan_torques = (5e-4, 0.0, 0.0, 0.0, -5e-4, 0.0, 0.0, 0.0) + (0.0,) * 8
    block._segments, block._elapsed_steps = 2, 0
    block.torque_limit = block.h_limit = 1.0
    block._watch = lambda t: None  # type: ignore[method-assign]
    seen = [(flight.go(1).mode, block.tau_cmd_wheel[0]) for _ in range(4)]
    assert seen == [(PLANNED, 5e-4), (PLANNED, -5e-4), (PLANNED, -5e-4), (BRAKING, 0.0)]


def test_a_coil_at_its_limit_is_saturated() -> None:
    flight = Flight(m_limit=0.5)
    assert flight.go(1).coil_saturated
    assert max(map(abs, flight.block.m_cmd_body)) == 0.5
    assert not Flight(gain=1e3).go(1).coil_saturated


def test_the_longest_flight_is_allowed_and_equal_limits_are_not() -> None:
    Flight(horizon=float(MOST_STEPS))
    with pytest.raises(BlockError, match=r"4001 steps"):
        Flight(horizon=MOST_STEPS + 1.0)
    with pytest.raises(
        BlockError, match=r"rate_again = 0\.003 rad/s is not above rate_limit"
    ):
        Flight(rate_again=3e-3)


def test_a_limit_above_that_of_going_on_is_refused() -> None:
    with pytest.raises(
        BlockError, match=r"rate_again = 0\.001 rad/s is not above rate_limit"
    ):
        Flight(rate_again=1e-3)


def test_a_search_without_end_is_refused() -> None:
    with pytest.raises(
        BlockError, match=r"horizon = 900\.0 s is 9000 steps of model_step = 0\.1 s"
    ):
        Flight(model_step=0.1)


def test_the_known_field_of_the_coils_is_taken_off() -> None:
    flight = Flight(coil_coupling=(1e-5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    flight.go(1)
    m = flight.block.m_cmd_body
    assert m[0] != 0.0
    seen = flight.b
    flight.go(1)
    assert flight.block._b == pytest.approx((seen[0] - 1e-5 * m[0], seen[1], seen[2]))


DOUBTS = {"inertia_spread": 0.1, "coil_spread": 0.5, "coupling_spread": 4e-6}
OFF = tuple(
    1.1 * x if k == 0 else 0.9 * x if k == 4 else x for k, x in enumerate(INERTIA)
)


def setting(moment: float, coil: float, coupling: float) -> craft_filter.Setting:
    doubts = craft_filter.Doubts(0.2, 3e-7, moment, coil, coupling)
    return craft_filter.Setting(doubts, CARRIER, 3e-5, 3e-7)


def test_what_a_constant_does_is_what_another_one_would_have_done() -> None:
    """The columns of inertia and coils against two predictions by other constants."""
    carrier = tuple(np.add(CARRIER, (0, 0.01, -0.02, 0.01, 0, 0.015, -0.02, 0.015, 0)))
    omega, dipole, wheel = (0.09, -0.06, 0.11), (2.0, -1.5, 1.0), (0.01, -0.02, 0.005)
    begun = craft_filter.Setting(
        craft_filter.Doubts(0.2, 3e-7, 0.01, 0.5, 0.0), carrier, 0.0, 0.0
    )
    x, _ = craft_filter.begin(FIELD, ZERO, begun)
    x = omega + x[3:]
    tau = (1e-3, -5e-4, 2e-4)

    def ended(x: tuple[float, ...]) -> np.ndarray:
        j = craft_filter.carrier_of(x)
        m = tuple(np.multiply(x[12:15], dipole))
        ends = rate_observer.predict(
            x[:3], x[3:6], m, tau, wheel, j, inverse_inertia(j), 0.5
        )
        return np.concatenate(ends)

    effects = [0.0] * (6 * craft_filter.STATES)
    inverse = inverse_inertia(carrier)
    craft_filter._fill_moving(effects, x, wheel, inverse, 0.5)
    after = tuple(ended(x)[:3])
    craft_filter._fill_constants(effects, x, after, dipole, inverse, 0.5)
    matrix = np.reshape(effects, (6, craft_filter.STATES))
    for state in range(15):
        step = 1e-4 * (3e-5 if 3 <= state < 6 else 1.0)
        more, less = (
            tuple(v + s * (k == state) for k, v in enumerate(x)) for s in (step, -step)
        )
        slope = (ended(more) - ended(less)) / (2.0 * step)
        size = np.max(np.abs(slope[:3])), np.max(np.abs(slope[3:]))
        # what the field's error does to the rate by a dipole is left out
        if not 3 <= state < 6:
            of_rate = pytest.approx(slope[:3], abs=0.05 * size[0] + 1e-12)
            assert matrix[:3, state] == of_rate
        assert matrix[3:, state] == pytest.approx(slope[3:], abs=0.1 * size[1] + 1e-12)
    assert not matrix[:, 15:].any()


def test_what_is_certain_stays_and_what_is_unknown_is_only_considered() -> None:
    passed = craft_filter.Interval(
        1.0, (2.0, -2.0, 2.0), ZERO, ZERO, (3e-5, -1e-5, 2e-5), ZERO, 0.0
    )
    for certain in (setting(0.0, 0.0, 0.0), setting(0.03, 0.5, 4e-6)):
        x, p = craft_filter.begin(FIELD, ZERO, certain)
        first = x
        learns = certain.doubts.moment == 0.0
        x, p, _ = craft_filter.update(x, p, passed, certain, learns)
        assert x[6:] == first[6:]
        assert x[:6] != first[:6]
    matrix = np.reshape(p, (24, 24))
    assert np.array_equal(matrix, matrix.T)
    begun = np.reshape(craft_filter.begin(FIELD, ZERO, certain)[1], (24, 24))
    assert np.array_equal(matrix[6:, 6:], begun[6:, 6:])
    x, p, _ = craft_filter.update(x, p, passed, certain, True)
    assert x[12:15] != first[12:15]


def test_a_field_that_is_no_number_or_a_negative_variance_is_unsound() -> None:
    it = setting(0.03, 0.5, 4e-6)
    x, p = craft_filter.begin(FIELD, ZERO, it)
    passed = craft_filter.Interval(1.0, ZERO, ZERO, ZERO, FIELD, ZERO, 0.0)
    assert craft_filter.update(x, p, passed, it, True)[2] < 1.0
    wrong = passed._replace(field=(inf, 0.0, 0.0))
    assert craft_filter.update(x, p, wrong, it, True)[2] == kalman.UNSOUND
    negative = tuple(-1.0 if k == 25 * 12 else v for k, v in enumerate(p))
    assert craft_filter.update(x, negative, passed, it, True)[2] == kalman.UNSOUND


def test_the_filter_begins_with_what_it_is_told() -> None:
    """Moments and products in their order, doubts by state, a dipole's doubt with it."""
    carrier = (2.0, 0.1, 0.2, 0.1, 3.0, 0.3, 0.2, 0.3, 4.0)
    doubts = craft_filter.Doubts(0.2, 3e-7, 0.5, 0.4, 4e-6)
    begun = craft_filter.Setting(doubts, carrier, 0.0, 0.0)
    x, p = craft_filter.begin(FIELD, (2.0, -1.0, 0.5), begun)
    assert x == (
        0.0,
        0.0,
        0.0,
        *FIELD,
        2.0,
        3.0,
        4.0,
        0.1,
        0.2,
        0.3,
        *[1.0] * 3,
        *[0] * 9,
    )
    assert craft_filter.carrier_of(x) == carrier
    coupled = (3e-7) ** 2 + (4e-6) ** 2 * 5.25
    variances = [0.04] * 3 + [coupled] * 3 + [0.25] * 3 + [0.01] * 3
    variances += [0.16] * 3 + [1.6e-11] * 9
    assert np.reshape(p, (24, 24)) == pytest.approx(
        np.diag(variances), rel=1e-12, abs=0.0
    )


def test_parts_of_the_state_are_where_they_belong() -> None:
    x, p = tuple(np.arange(24.0).tolist()), tuple(np.arange(576.0).tolist())
    coupling = np.arange(15.0, 24.0).reshape(3, 3)
    dipole = (0.3, -0.5, 0.7)
    field = craft_filter.coupled_field(x, dipole)
    assert field == pytest.approx(tuple(coupling @ dipole), rel=1e-12)
    covariance = np.reshape(craft_filter.rates_covariance(p), (3, 3))
    assert np.array_equal(covariance, np.reshape(p, (24, 24))[:3, :3])


def test_a_coil_counts_as_turned_from_a_deviation_below_zero_on() -> None:
    x = (0.0,) * 12 + (-0.21, -0.19, 0.9) + (0.0,) * 9
    p = tuple((0.04 * np.eye(24)).ravel().tolist())
    assert craft_filter.coil_signs(x, p) == (-1.0, 1.0, 1.0)


def test_rate_and_field_walk_with_the_root_of_time() -> None:
    """Of a state that is known and at rest."""
    doubts = craft_filter.Doubts(0.0, 0.0, 0.0, 0.0, 0.0)
    begun = craft_filter.Setting(doubts, CARRIER, 3e-5, 2e-7)
    x, p = craft_filter.begin(FIELD, ZERO, begun)
    state, covariance = list(x), list(p)
    passed = craft_filter.Interval(4.0, ZERO, ZERO, ZERO, FIELD, ZERO, 0.0)
    craft_filter._predict(state, covariance, x, passed, begun)
    assert tuple(state) == x
    variances = [(3e-5) ** 2 * 4.0] * 3 + [(2e-7) ** 2 * 4.0] * 3 + [0.0] * 18
    found = np.reshape(covariance, (24, 24))
    assert found == pytest.approx(np.diag(variances), rel=1e-12, abs=0.0)


# kg m2: bounds of random moments and products, some of which belong to a body
RANDOM_LEAST = (0.3, 0.3, 0.3, -0.8, -0.8, -0.8)
RANDOM_MOST = (1.5, 1.5, 1.5, 0.8, 0.8, 0.8)


@pytest.mark.parametrize(
    "elements",
    [
        (2.0, 3.0, 4.0, 0.1, 0.2, 0.3),
        (1.0, 1.0, -1.0, 2.0, 0.0, 0.0),  # its determinant is positive
        (1.0, 1.0, 1.0, 0.6, 0.6, 0.6),
        (1.0, 1.0, 1.0, 0.6, 0.6, -0.6),
        (1.0, 2.0, 1.0, 0.0, 1.1, 0.0),
        (1.0, 1.0, 2.0, 0.0, 0.0, 1.5),
        (-1.0, -1.0, 1.0, 0.0, 0.0, 0.0),
        *np.random.default_rng(5).uniform(RANDOM_LEAST, RANDOM_MOST, (40, 6)).tolist(),
    ],
)
def test_an_inertia_is_sound_where_its_eigenvalues_are_positive(elements) -> None:
    state = [0.0] * 6 + list(elements) + [0.0] * 12
    matrix = np.reshape(craft_filter.carrier_of(tuple(state)), (3, 3))
    is_positive = bool((np.linalg.eigvalsh(matrix) > 0.0).all())
    assert craft_filter._is_sound(state, [0.0] * 576) is is_positive


@pytest.mark.parametrize("is_of_rate", [True, False])
def test_a_measurement_corrects_as_a_kalman_filter(is_of_rate: bool) -> None:
    """By numpy: the rate at once, the field by axis with its variance underweighted."""
    random = np.random.default_rng(6)
    x, root = random.normal(size=24), 0.1 * random.normal(size=(24, 24))
    dipole, noise = (0.2, -0.3, 0.1), 0.3
    seen = (0.5, -0.4, 0.3)
    passed = craft_filter.Interval(1.0, dipole, ZERO, ZERO, seen, seen, noise)
    state, covariance = x.tolist(), (root @ root.T).ravel().tolist()
    p, more = root @ root.T, 0.0 if is_of_rate else craft_filter.UNDERWEIGHT
    if is_of_rate:
        craft_filter._correct_rate(state, covariance, passed, True)
    else:
        craft_filter._correct(state, covariance, passed, noise, True)
    for axis in range(3):
        c = np.zeros(24)
        c[axis if is_of_rate else 3 + axis] = 1.0
        if not is_of_rate:
            c[15 + 3 * axis : 18 + 3 * axis] = dipole
        variance = (1.0 + more) * (c @ p @ c) + noise**2
        x = x + p @ c * (seen[axis] - c @ x) / variance
        p = p - np.outer(p @ c, c @ p) / variance
    assert state == pytest.approx(x.tolist(), rel=1e-9, abs=1e-12)
    assert np.reshape(covariance, (24, 24)) == pytest.approx(p, rel=1e-9, abs=1e-12)


def test_a_constant_is_held_within_four_deviations() -> None:
    it = setting(0.5, 0.5, 4e-6)
    x, p = craft_filter.begin(FIELD, ZERO, it)
    far = x[:6] + (-9.0, 9.0, 0.3, 9.0, 0.0, 0.0) + (-7.0, 1.0, 8.0) + (1.0,) * 9
    state = list(far)
    craft_filter._limit_constants(state, it)
    assert state[6] == pytest.approx(craft_filter.LEAST_MOMENT * CARRIER[0])
    assert state[7] == pytest.approx(CARRIER[4] + 2.0)
    assert state[9] == pytest.approx(0.4)
    assert state[12:15] == [-1.0, 1.0, 3.0]
    assert state[15:] == pytest.approx([1.6e-5] * 9)
    # moments so small, with such a product, belong to nothing
    still = craft_filter.Interval(1.0, ZERO, ZERO, ZERO, FIELD, ZERO, 0.0)
    thin = (*x[:6], 0.06, 0.06, 0.06, 0.05, 0.05, -0.05, *x[12:])
    assert craft_filter.update(thin, p, still, it, False)[2] == kalman.UNSOUND


def test_it_learns_the_inertia_and_the_coupling_once_the_rate_is_known() -> None:
    flight = Flight(rate_from=FILTER, coupling=5e-6, inertia=OFF, **DOUBTS)
    flight.omega = (0.1, -0.1, 0.1)
    block = flight.go(1)
    assert not any(block.m_cmd_body)
    assert not block._is_familiar()
    block = flight.go(900)
    assert block.mode == DETUMBLED
    assert max(map(abs, flight.omega)) < block.rate_limit
    assert block.filter_restarts == 0
    # what the rates show are ratios of moments
    first = np.reshape(block._setting.carrier, (3, 3)).diagonal()
    now = np.reshape(block._carrier, (3, 3)).diagonal()
    true = np.reshape(CARRIER, (3, 3)).diagonal()
    error = abs(now[0] / now[1] - true[0] / true[1])
    assert error < 0.3 * abs(first[0] / first[1] - true[0] / true[1])
    assert np.diag(np.reshape(block._craft[15:], (3, 3))) == pytest.approx(
        5e-6, rel=0.2
    )
    assert block.inertia == OFF


def test_with_a_gyro_it_learns_the_inertia_from_the_first_rates_on() -> None:
    flight = Flight(coupling=5e-6, inertia=OFF, **DOUBTS)
    flight.omega = (0.1, -0.1, 0.1)
    block = flight.go(2)
    assert any(block.m_cmd_body)
    assert block.omega_est_body == block.omega_bi_body
    block = flight.go(600)
    assert block.mode == DETUMBLED
    assert block.filter_restarts == 0
    first = np.reshape(block._setting.carrier, (3, 3)).diagonal()
    now = np.reshape(block._carrier, (3, 3)).diagonal()
    true = np.reshape(CARRIER, (3, 3)).diagonal()
    assert np.max(np.abs(now / true - 1.0)) < 0.3 * np.max(np.abs(first / true - 1.0))
    # without a field it learns nothing and still brakes by the gyro
    flight = Flight(inertia=OFF, **DOUBTS)
    flight.block.valid_b = False
    block = flight.go(5)
    assert np.array_equal(block._carrier, block._setting.carrier)
    assert any(block.tau_cmd_wheel)


def test_a_coil_that_turns_out_to_be_turned_is_commanded_the_other_way() -> None:
    flight = Flight(
        rate_from=FILTER,
        coils=(1.0, -1.0, 1.0),
        coil_spread=0.5,
        gain_wheel=0.0,
        rounds=0,
    )
    flight.omega = (0.1, -0.1, 0.1)
    block = flight.go(300)
    assert block._signs == (1.0, -1.0, 1.0)
    assert block._craft[12:15] == pytest.approx((1.0, -1.0, 1.0), abs=0.5)
    by_law = all_coils(block.omega_est_body, block._b, block.gain)
    assert block.m_cmd_body[1] * by_law[1] < 0.0 < block.m_cmd_body[0] * by_law[0]


def test_a_filter_that_is_lost_begins_anew_and_says_so() -> None:
    flight = Flight(rate_from=FILTER, **DOUBTS)
    block = flight.go(60)
    assert block._is_familiar()
    counts = []
    for k in range(6):
        flight.b = (2e-5, -1e-5, 2.5e-5) if k % 2 else (-2e-5, 3e-5, 1e-5)
        counts.append(flight.go(1).filter_restarts)
    assert counts == [0, 0, 0, 0, 1, 1]
    assert not block._is_familiar()


def test_an_inertia_of_no_body_and_spreads_beyond_one_are_refused() -> None:
    for inertia in (
        (1.0, 0.0, 0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.1),
        (0.3, 0.5, 0.0, 0.5, 0.3, 0.0, 0.0, 0.0, 0.3),
    ):
        with pytest.raises(BlockError, match="principal moment"):
            Flight(inertia=inertia)
    bounds = {v.name: v for v in ManagerDetumblingRollout.variables}
    assert bounds["inertia_spread"].maximum == 1.0
    assert bounds["coil_spread"].maximum == 1.0
    block = Flight(rate_from=FILTER, inertia_spread=1.0).go(100)
    assert all(map(np.isfinite, block.m_cmd_body))
