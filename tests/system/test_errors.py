"""The nearest of known names."""

from __future__ import annotations

import pytest

from desat.system.errors import nearest


@pytest.mark.parametrize(
    ("name", "candidates", "message"),
    [
        (
            "abcx",
            ["abcxyz", "abcxaa"],
            "; did you mean abcxaa?",
        ),  # the first that it begins
        ("abc", ["abcdefghijkl"], "; did you mean abcdefghijkl?"),
        (
            "ab",
            ["abcdefghijkl"],
            "; there is abcdefghijkl",
        ),  # two letters begin too much
        (
            "yaw_rate",
            ["yaw_ratio", "yaw_rates_of_all"],
            "; did you mean yaw_rates_of_all?",
        ),
        ("x" * 200, ["y"], "; there is y"),
        ("x" * 201, ["y"], ""),
    ],
)
def test_the_nearest_name(name, candidates, message):
    assert nearest(name, candidates) == message


@pytest.mark.parametrize(
    ("count", "message"), [(2000, "; did you mean n7?"), (2001, "")]
)
def test_no_nearest_of_very_many_names(count, message):
    assert nearest("n7 ", (f"n{i}" for i in range(count))) == message
