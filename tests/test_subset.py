"""Blocks and what they use stay within what translates to C."""

from __future__ import annotations

import pytest

from desat.fmus import subset


def rules(text: str) -> list[str]:
    return [place.key.removeprefix("x.py:") for place in subset.outside(text, "x.py")]


def test_the_blocks_are_within():
    assert subset.problems() == []
    names = {path.name for path in subset.files()}
    assert {"wheels.py", "vector.py", "simplex.py", "dumping.py", "tle.py"} <= names
    assert "block.py" not in names


@pytest.mark.parametrize(
    ("line", "rule"),
    [
        ("return {1: x}", "f:dict"),
        ("return {i: x for i in range(3)}", "f:dict"),
        ("return dict(a=x)", "f:dict"),
        ("return {x, y}", "f:set"),
        ("return {i for i in range(3)}", "f:set"),
        ("return set()", "f:set"),
        ("y.append(x)", "f:growing list"),
        ("yield x", "f:generator function"),
        ("return sum(x * v for v in y)", "f:sum"),
        ("return hypot(x, y)", "f:hypot"),
        ("return math.hypot(x, y)", "f:hypot"),
        ("import numpy as np", "import numpy"),
        ("from datetime import datetime", "import datetime"),
        ("import scipy.linalg", "import scipy"),
    ],
)
def test_what_leaves_it(line, rule):
    assert rules(f"def f(x, y):\n    {line}\n") == [rule]


def test_what_does_not():
    text = """
from math import sqrt
from functools import lru_cache
from .vector import add

def f(x: dict[str, float], y: Vec3) -> set[int]:
    rows = [0.0] * 3
    rows[1] = sqrt(x * x)
    return tuple(v for v in rows if v > 0.0)
"""
    assert rules(text) == []


def test_a_new_place_and_a_stale_exception_are_told(monkeypatch):
    pinned = dict(subset.EXCEPTIONS)
    reason = pinned.pop("maths/simplex.py:least_cost:set")
    monkeypatch.setattr(subset, "EXCEPTIONS", {**pinned, "vector.py:norm:hypot": reason})
    new, stale = subset.problems()
    assert new.startswith("components/maths/simplex.py:")
    assert "set in least_cost" in new
    assert stale == 'fmus/subset.py: exception "vector.py:norm:hypot" is no longer needed'
    assert subset.main() == 1
