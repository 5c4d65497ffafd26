"""The pseudo-inverse of wheel axes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.components.physics import wheel_array


@pytest.mark.parametrize("wheels", [1, 2, 3])
def test_too_few_axes_have_a_pseudo_inverse_too(wheels):
    """One axis, two, and three in a plane, against numpy's singular values."""
    axes = np.zeros((3, 4))
    axes[:, :wheels] = np.array([[0.6, 0.8, 0.0], [0.0, 0.6, 0.8], [0.6, 1.4, 0.8]]).T[
        :, :wheels
    ]
    inverse = np.reshape(wheel_array.pseudo_inverse(tuple(axes.ravel())), (4, 3))
    assert inverse == pytest.approx(np.linalg.pinv(axes), abs=1e-12)


number = st.floats(-10, 10, allow_nan=False)

vec3 = st.tuples(number, number, number)


@given(st.lists(number, min_size=12, max_size=12).map(tuple), vec3)
def test_wheel_allocation_is_the_pseudo_inverse(axes, v):
    matrix = np.reshape(axes, (3, 4))
    if np.linalg.cond(matrix) > 1e3:
        return
    wheel_values = wheel_array.to_wheels(wheel_array.pseudo_inverse(axes), v)
    assert np.allclose(wheel_values, np.linalg.pinv(matrix) @ v, rtol=1e-6, atol=1e-7)
    assert np.allclose(
        wheel_array.body_momentum(axes, wheel_values), v, rtol=1e-7, atol=1e-7
    )
