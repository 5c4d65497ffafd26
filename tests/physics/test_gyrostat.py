"""The check of an inertia."""

from __future__ import annotations

import pytest

from desat.components.contract.block import BlockError
from desat.components.physics import (
    gyrostat,
)


def test_an_inertia_with_two_moments_below_zero_is_none():
    with pytest.raises(BlockError, match="principal moments must be above 0"):
        gyrostat.check_inertia((2.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, -1.0))


def test_an_inertia_that_is_not_symmetric_says_where():
    with pytest.raises(
        BlockError, match=r"inertia\[2,3\] = 0.1 and inertia\[3,2\] = 0"
    ):
        gyrostat.check_inertia((2.0, 0.0, 0.0, 0.0, 2.0, 0.1, 0.0, 0.0, 2.0))
