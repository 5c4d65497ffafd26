"""Vectors: invariants and analytic cases."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.components.maths import vector

number = st.floats(-10, 10, allow_nan=False)

vec3 = st.tuples(number, number, number)


@given(vec3, vec3)
def test_cross_is_numpys(a, b):
    assert vector.cross(a, b) == pytest.approx(tuple(np.cross(a, b)), abs=1e-12)


@given(
    st.tuples(*[number] * 9).filter(
        lambda m: abs(np.linalg.det(np.reshape(m, (3, 3)))) > 0.1
    )
)
def test_inverse(m):
    numpy_inverse = np.linalg.inv(np.reshape(m, (3, 3))).ravel()
    assert np.allclose(vector.inverse(m), numpy_inverse, rtol=1e-9, atol=1e-9)
