"""The filters of pages: `{{ value(...)|fixed(2) }}`."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..numbers.text import number as text_of


def fixed(value: float, digits: int = 0) -> str:
    """A number with so many digits after the point; a time that is infinite is not reached."""
    return text_of(None) if value == math.inf else f"{value:.{digits}f}"


def plain(value: float) -> str:
    """A number as a scenario has it: 0.25, 12, 3e-5."""
    return re.sub(r"e([+-])0", r"e\1", f"{value:g}").replace("e+", "e")


def short(value: float | None) -> str:
    """An error or a residual: two digits; empty where there is none."""
    return "" if value is None else f"{value:.1e}"


def three(values: Sequence[float], digits: int = 0) -> list[str]:
    """Median, least and most of some values."""
    return [fixed(x, digits) for x in (statistics.median(values), min(values), max(values))]


def saving(values: Sequence[float], references: Sequence[float]) -> list[float]:
    """Per cent less than the references, one by one."""
    return [100 * (1 - v / r) for v, r in zip(values, references, strict=True)]


def correlation(x: Sequence[float], y: Sequence[float]) -> float:
    """Pearson's correlation of two lists."""
    return float(np.corrcoef(x, y)[0, 1])


FILTERS: dict[str, Callable[..., Any]] = {
    "fixed": fixed,
    "plain": plain,
    "short": short,
    "text": text_of,
    "three": three,
    "saving": saving,
    "median": statistics.median,
    "correlation": correlation,
    "degrees": math.degrees,
}
"""Beside those of Jinja2: `{{ value(...)|fixed(2) }}`."""
