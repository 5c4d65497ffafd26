"""The field of a bench."""

from __future__ import annotations

import math

import pytest

from tests.conftest import started


def test_a_benchs_field_turns_at_its_rate() -> None:
    bench = started(
        "environment_bench", field=(3e-5, 0.0, 1e-5), field_rate=(0.0, 0.0, 0.1)
    )
    bench.output(math.pi / 0.2)
    assert bench.b_eci == pytest.approx((0.0, 3e-5, 1e-5), abs=1e-18)
    assert bench.b_rate_eci == pytest.approx((-3e-6, 0.0, 0.0), abs=1e-18)
    assert bench.b_accel_eci == pytest.approx((0.0, -3e-7, 0.0), abs=1e-18)
