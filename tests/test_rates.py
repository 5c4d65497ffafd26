"""Exchange between components of different rates: what is handed on is handed on whole."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from desat.engine.windows import Part, Places, Whole
from desat.system.rates import Link, graded, late

numbers = st.floats(-1e3, 1e3)
counts = st.integers(1, 12)
TARGET = Places.of([2], [3])


def source(sloped: bool = True) -> Places:
    return Places.of([0], [1 if sloped else -1])


@given(counts)
def test_parts_fill_the_step_and_grow(count):
    parts = graded(count)
    assert parts[0][0] == 0.0
    assert sum(w for _, w in parts) == pytest.approx(1.0, abs=1e-15)
    growth = [b[1] / a[1] for a, b in pairwise(parts)]
    assert growth == pytest.approx([4.5 ** (1 / count)] * (count - 1))


@given(numbers, numbers, counts)
def test_a_line_cut_and_joined_is_itself(mean, slope, count):
    parts = graded(count)
    cut = np.array([mean, slope, 0.0, 0.0])
    joined = np.zeros(4)
    part, whole = Part(cut, source(), TARGET, parts), Whole(joined, source(), joined, TARGET, parts)
    for i in range(count):
        part(i)
        joined[:2] = cut[2:]
        whole(i)
    size = max(abs(mean), abs(slope), 1.0)
    assert joined[2:] == pytest.approx([mean, slope], abs=1e-13 * size)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=9), st.booleans())
def test_joined_parts_keep_integral_and_first_moment(values, sloped):
    parts = graded(len(values))
    live = np.zeros(4)
    whole = Whole(live, source(sloped), live, TARGET, parts)
    integral = moment = 0.0
    for i, ((m, p), (a, w)) in enumerate(zip(values, parts, strict=True)):
        p = p if sloped else 0.0
        live[0], live[1] = m, p
        whole(i)
        integral += w * m
        # of m + p (u - 1/2) times s = a + w u, u from 0 to 1
        moment += w * (m * (a + 0.5 * w) + p * w / 12.0)
    assert live[2] == pytest.approx(integral, abs=1e-11)
    assert live[2] / 2.0 + live[3] / 12.0 == pytest.approx(moment, abs=1e-10)


def links(*pairs: str) -> list[Link]:
    return [Link(*pair.split(">"), text=pair) for pair in pairs]


def test_equal_rates_step_as_they_are():
    assert late(links("a>b", "b>c"), {"a": 3, "b": 3, "c": 3}) == (frozenset(), [])


def test_a_slow_receiver_steps_at_the_end_and_so_do_those_after_it():
    every = {"a": 1, "b": 10, "c": 10, "d": 10}
    assert late(links("a>b", "b>c", "d>c"), every) == (frozenset("bc"), [])


def test_a_slow_source_steps_at_the_start():
    assert late(links("a>b"), {"a": 10, "b": 1}) == (frozenset(), [])


def test_rates_that_do_not_nest_are_refused():
    _, problems = late(links("a>b"), {"a": 2, "b": 3})
    assert len(problems) == 1
    assert "a>b" in problems[0]
    assert "multiple" in problems[0]


def test_a_slow_one_between_two_fast_ones_is_refused_by_name():
    stepping, problems = late(links("a>b", "b>c"), {"a": 1, "b": 10, "c": 1})
    assert stepping == {"b"}
    assert len(problems) == 1
    for word in ("b>c", "a>b", "decimation of 10", "c steps 10 times"):
        assert word in problems[0]
