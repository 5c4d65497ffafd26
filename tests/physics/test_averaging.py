"""Mean and osculating elements."""

from __future__ import annotations

import pytest

from desat.components.physics import (
    averaging,
    orbit,
)


def test_osculating_elements_are_the_inverse_of_mean_ones():
    mean = orbit.Elements(6.7e6, 0.001, 0.9, 0.3, 0.9, 1.0)
    back = averaging.mean_elements(
        averaging.osculating_elements(mean, 4, orbit.MU), 4, orbit.MU
    )
    assert back.semi_major_axis == pytest.approx(mean.semi_major_axis, abs=1e-6)
    assert back.inclination == pytest.approx(mean.inclination, abs=1e-13)
