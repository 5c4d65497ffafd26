"""The scalar update of a Kalman filter against the formula for several measurements."""

from __future__ import annotations

import numpy as np
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
    measured = generator.normal(size=measurements)

    x, p = state.tolist(), covariance.ravel().tolist()
    for c, variance, y in zip(matrix, variances, measured, strict=True):
        product = np.reshape(p, (states, states)) @ c
        kalman.correct(
            x,
            p,
            product.tolist(),
            float(y - c @ np.array(x)),
            float(c @ product + variance),
        )

    innovation = matrix @ covariance @ matrix.T + np.diag(variances)
    gain = covariance @ matrix.T @ np.linalg.inv(innovation)
    np.testing.assert_allclose(
        x, state + gain @ (measured - matrix @ state), rtol=1e-8, atol=1e-10
    )
    np.testing.assert_allclose(
        np.reshape(p, (states, states)),
        covariance - gain @ matrix @ covariance,
        rtol=1e-8,
        atol=1e-10,
    )
