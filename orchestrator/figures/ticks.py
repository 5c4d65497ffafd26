"""Where an axis has its ticks, and what stands at them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)
_LARGE, _SMALL = 1e5, 1e-3
"""Sizes from and below which a power of ten is taken out of all labels of an axis."""
_FEW = 3
"""Decades of a logarithmic axis up to which those between the powers have ticks."""


class Ticks(NamedTuple):
    """The ticks of an axis: values, a label each (empty: a short tick without one), and what is
    taken out of all labels, as `×10⁻⁶` or `+ 7000`."""

    values: tuple[float, ...]
    labels: tuple[str, ...]
    aside: str = ""


def raised(number: int) -> str:
    """A whole number as an exponent: -3 -> `⁻³`."""
    return str(number).translate(_RAISED)


def linear(low: float, high: float, most: int) -> Ticks:
    """At most so many ticks, 1, 2, 2.5 or 5 times a power of ten apart, from low to high."""
    step = nice((high - low) / max(most - 1, 1))
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    values = [k * step for k in range(first, last + 1)]
    largest = max(abs(low), abs(high))
    aside, shift, power = "", 0.0, 0
    if step < 1e-4 * largest:  # all labels would begin alike
        shift = math.floor(low / (1000.0 * step) + 1e-3) * 1000.0 * step
        aside = f"{'−' if shift < 0.0 else '+'} {abs(shift):.15g}"
        largest = high - shift
    if not _SMALL <= largest < _LARGE:
        power = math.floor(math.log10(largest))
        aside = f"×10{raised(power)} {aside}".strip()
    # decimals of the step, of which 2.5 has one more
    size = step / 10.0**power
    digits = next((d for d in range(12) if abs(round(size, d) - size) < 1e-6 * size), 12)
    texts = [f"{(v - shift) / 10.0**power:.{digits}f}" for v in values]
    return Ticks(tuple(values), tuple(minus(t) for t in texts), aside)


def nice(step: float) -> float:
    """The least of 1, 2, 2.5 and 5 times a power of ten that is not below a step."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(s * power for s in _STEPS if s * power >= step * (1.0 - 1e-9))


def logarithmic(low: float, high: float, most: int) -> Ticks:
    """At powers of ten, every so many that there are at most so many labels; of few decades also
    between."""
    first, last = math.floor(math.log10(low) + 1e-9), math.ceil(math.log10(high) - 1e-9)
    every = -(-(last - first + 1) // max(most, 2))
    ticks: list[tuple[float, str]] = []
    inside = sum(low <= 10.0**k <= high for k in range(first, last + 1))
    for k in range(first, last + 1):
        ticks.append((10.0**k, f"10{raised(k)}" if k % every == 0 else ""))
        if last - first > _FEW:
            continue
        for digit in range(2, 10):
            named = inside < 2 and digit in (2, 5)
            ticks.append((digit * 10.0**k, f"{digit}×10{raised(k)}" if named else ""))
    kept = [(v, t) for v, t in ticks if low * (1 - 1e-9) <= v <= high * (1 + 1e-9)]
    return Ticks(tuple(v for v, _ in kept), tuple(t for _, t in kept))


def given(values: Sequence[float], labels: Sequence[str]) -> Ticks:
    """Ticks where somebody wants them."""
    return Ticks(tuple(values), tuple(labels))


def minus(text: str) -> str:
    """A number's text with the sign that is as wide as a plus; no minus before a zero."""
    return text.replace("-", "−") if float(text) else text.lstrip("-")
