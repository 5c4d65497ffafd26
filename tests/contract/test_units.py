"""Units: what converts, what is one, what is refused."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.components.contract.units import (
    PREFIXES,
    SI,
    Unit,
    conversion,
    times,
    unit_of,
)


def test_units_convert_by_dimension():
    assert conversion(unit_of("deg/s"), unit_of("rad/s")) == (math.pi / 180, 0)
    assert conversion(unit_of("rpm"), unit_of("rad/s")) == (math.pi / 30, 0)
    assert conversion(unit_of("uT"), unit_of("nT")) == (pytest.approx(1000), 0)
    assert conversion(unit_of("N.m"), unit_of("J")) == (
        1,
        0,
    )  # one dimension, two names
    assert conversion(unit_of("N.m"), unit_of("N.m.s")) is None
    assert conversion(unit_of("rad/s"), unit_of("1/s")) == (1, 0)


names = st.sampled_from(
    [*SI, *(p + n for n in SI for p in PREFIXES if p + n not in ("min", "kg"))]
)

factors = st.lists(
    st.tuples(names, st.integers(-4, 4).filter(bool)), min_size=1, max_size=4
)


@given(factors, factors)
def test_any_product_is_a_unit(above, below):
    def text(parts):
        return ".".join(f"{n}{p}" if p != 1 else n for n, p in parts)

    def product(parts):
        unit = Unit()
        for name, power in parts:
            unit = times(unit, unit_of(name), power)
        return unit

    result, product_unit = unit_of(f"{text(above)}/({text(below)})"), product(above)
    product_unit = times(product_unit, product(below), -1)
    assert result[:6] == product_unit[:6]
    assert result.factor == pytest.approx(product_unit.factor, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "like", "factor"),
    [
        ("rad/s2", "1/s2", 1),
        ("kg.m2/s", "N.m.s", 1),
        ("N.m.s/rad", "J.s", 1),
        ("mT", "T", 1e-3),
        ("1/(T2.s2)", "T-2.s-2", 1),
        ("mA.m2", "A.m2", 1e-3),
        ("Hz", "1/s", 1),
        ("V.s", "Wb", 1),
        ("W.h", "J", 3600),
        ("km2", "m2", 1e6),
        ("min", "s", 60),
        ("mm", "m", 1e-3),
        ("%", "1", 0.01),
        ("(N.m)/(rad/s)", "N.m.s", 1),
    ],
)
def test_units_by_name(text, like, factor):
    assert conversion(unit_of(text), unit_of(like)) == (pytest.approx(factor), 0)


@pytest.mark.parametrize(
    "text",
    [
        "sek",
        "m/",
        "/s",
        "m//s",
        "N/m.s",
        "m/s/s",
        "(m",
        "m)",
        "m^2",
        "12",
        "m.1/0",
        "mmin",
        "Gm9.Gm9.Gm9.Gm9",
        "1/(nm9.nm9.nm9.nm9)",
        "1/(1/(Gm9.Gm9.Gm9.Gm9))",
        "(" * 2000,
        "kkg",
        "m s",
        "m12",
    ],
)
def test_what_is_no_unit_is_refused(text):
    with pytest.raises(ValueError, match=r"\w"):
        unit_of(text)
