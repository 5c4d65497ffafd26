"""The scalar update of a Kalman filter against the formula for several measurements."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.components.maths import kalman


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(1, 4))
def test_scalar_updates_are_the_update_by_a_vector(
    seed: int, states: int, measurements: int
) -> None:
    generator = np.random.default_rng(seed)
    factor = generator.normal(size=(states, states))
    covariance = factor @ factor.T + 0.1 * np.eye(states)
    state = generator.normal(size=states)
    matrix = generator.normal(size=(measurements, states))
    variances = generator.uniform(0.1, 2.0, size=measurements)
    measurement = generator.normal(size=measurements)

    x, p = state.tolist(), covariance.ravel().tolist()
    for c, variance, y in zip(matrix, variances, measurement, strict=True):
        product = np.reshape(p, (states, states)) @ c
        kalman.correct(
            x,
            p,
            product.tolist(),
            float(y - c @ np.array(x)),
            float(c @ product + variance),
            states,
        )

    innovation = matrix @ covariance @ matrix.T + np.diag(variances)
    gain = covariance @ matrix.T @ np.linalg.inv(innovation)
    np.testing.assert_allclose(
        x, state + gain @ (measurement - matrix @ state), rtol=1e-8, atol=1e-10
    )
    np.testing.assert_allclose(
        np.reshape(p, (states, states)),
        covariance - gain @ matrix @ covariance,
        rtol=1e-8,
        atol=1e-10,
    )


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 4))
def test_states_that_are_only_considered_keep_value_and_doubt(
    seed: int, estimated_states: int, considered_states: int
) -> None:
    """Against Joseph's form, which holds for any gain."""
    generator = np.random.default_rng(seed)
    states = estimated_states + considered_states
    factor = generator.normal(size=(states, states))
    covariance = factor @ factor.T + 0.1 * np.eye(states)
    c, variance = generator.normal(size=states), generator.uniform(0.1, 2.0)
    before = generator.normal(size=states)
    x, p = before.tolist(), covariance.ravel().tolist()
    product = covariance @ c
    innovation = 0.7
    total = float(c @ product + variance)
    kalman.correct(x, p, product.tolist(), innovation, total, estimated_states)
    gain = np.where(np.arange(states) < estimated_states, product / total, 0.0)
    remainder = np.eye(states) - np.outer(gain, c)
    np.testing.assert_allclose(x, before + gain * innovation, rtol=1e-12, atol=1e-14)
    after = np.reshape(p, (states, states))
    joseph_covariance = remainder @ covariance @ remainder.T + variance * np.outer(
        gain, gain
    )
    np.testing.assert_allclose(after, joseph_covariance, rtol=1e-8, atol=1e-10)
    assert np.array_equal(after, after.T)


@given(st.integers(0, 10_000), st.integers(1, 6), st.integers(0, 4))
def test_a_covariance_whose_first_states_move_is_f_p_f(
    seed: int, moving: int, constant: int
) -> None:
    generator = np.random.default_rng(seed)
    states = moving + constant
    factor = generator.normal(size=(states, states))
    covariance = factor @ factor.T
    covariance = 0.5 * (covariance + covariance.T)
    transition = np.eye(states)
    transition[:moving] = generator.normal(size=(moving, states))
    p = covariance.ravel().tolist()
    kalman.predict([0.0] * states, p, transition[:moving].ravel().tolist())
    after = np.reshape(p, (states, states))
    np.testing.assert_allclose(
        after, transition @ covariance @ transition.T, rtol=1e-9, atol=1e-10
    )
    assert np.array_equal(after[moving:], after[:, moving:].T)


def test_a_filter_is_lost_by_surprises_in_a_row_or_by_what_is_no_number() -> None:
    count = 0
    for innovation, surprise_count in ((6.1, 1), (6.1, 2), (5.9, 0), (6.1, 1)):
        count = kalman.count_surprises(count, kalman.surprise(innovation, 1.0))
        assert count == surprise_count
    for innovation, variance in (
        (1.0, 0.0),
        (1.0, -1.0),
        (math.nan, 1.0),
        (0.0, math.inf),
    ):
        worst = kalman.surprise(innovation, variance)
        assert kalman.count_surprises(0, worst) == kalman.SURPRISES


@pytest.mark.parametrize(
    ("x", "variance", "sound"),
    [
        (1.0, 0.0, True),
        (1.0, -1e-300, False),
        (1.0, math.nan, False),
        (math.inf, 1.0, False),
    ],
)
def test_a_covariance_that_is_that_of_nothing_is_unsound(
    x: float, variance: float, sound: bool
) -> None:
    assert kalman.is_sound([0.0, x], [1.0, 0.0, 0.0, variance]) is sound
