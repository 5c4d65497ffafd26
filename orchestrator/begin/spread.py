"""Read what is given with its spread, and write the spreads of what is assumed.

A spread is that of 90 %: a factor by which a value may be larger or smaller, or how much
it may be more or less, as `[dispersions]` has them.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ..files.hardware import classes, quantity
from ..system.errors import DesatError
from ..system.quantity import Quantity

_MARK = re.compile(r"\s*(?:\+-|\+/-|±)\s*")


@dataclass(frozen=True)
class SpreadValues:
    """Numbers that a user gave, in the unit of their quantity."""

    values: tuple[float, ...]
    factor: float = 1.0  # times or divided by it, at 90 %
    plus_minus: float = 0.0  # more or less, at 90 %

    @property
    def share(self) -> float:
        """Return the spread as a factor of the largest value, at least 1."""
        size = max(map(abs, self.values))
        return self.factor + (self.plus_minus / size if size > 0.0 else 0.0)

    @property
    def text(self) -> str:
        """Return the spread for a reader, "" for none."""
        if self.plus_minus > 0.0:
            return f"+-{self.plus_minus:.4g}"
        return f"+-{100.0 * (self.factor - 1.0):.4g} %" if self.factor > 1.0 else ""


def parse_values(form: Quantity, text: str) -> SpreadValues:
    """Parse numbers with the spread that follows them, as `350kg +-10%`.

    Raises
    ------
    DesatError
        If they are no such quantity, or the spread is wider than they allow.
    """
    value, *spreads = _MARK.split(text)
    values = form.many(value) if "," in value else (form(value),)
    if not spreads:
        return SpreadValues(values)
    place = f"{form.option} {text}"
    if len(spreads) > 1:
        raise DesatError(f"{place}: one spread is needed, as +-10%")
    if spreads[0].endswith("%"):
        share = Quantity(f"{place}: +-", "%", 0.0, 1e4)(spreads[0]) / 100.0
        if form.least >= 0.0 and share >= 1.0:
            raise DesatError(f"{place}: less than 100 % is needed: it may not be 0")
        return SpreadValues(values, factor=1.0 + share)
    width = Quantity(f"{place}: +-", form.unit, 0.0, 1e9)(spreads[0])
    if form.least >= 0.0 and width >= min(values):
        raise DesatError(
            f"{place}: it is as wide as the value, which is above {form.least:g}"
        )
    return SpreadValues(values, plus_minus=width)


def split_spread(place: str, text: str) -> tuple[str, float]:
    """Split a text from the spread in % that follows it, as `4 pyramid 11Nms +-50%`.

    Returns the text and the spread as a factor, 1 without one.

    Raises
    ------
    DesatError
        If what follows is no spread in %.
    """
    value, *spreads = _MARK.split(text)
    if not spreads:
        return text, 1.0
    if len(spreads) > 1 or not spreads[0].endswith("%"):
        raise DesatError(f"{place}: one spread in % is needed, as +-10%")
    share = Quantity(f"{place}: +-", "%", 0.0, 1e4)(spreads[0]) / 100.0
    if share >= 1.0:
        raise DesatError(f"{place}: less than 100 % is needed: it may not be 0")
    return value, 1.0 + share


def class_factor(name: str) -> float:
    """Return the spread of a class value as a factor (templates/classes.toml)."""
    return quantity("", classes()["assumed"][name]["factor"], "1")


def combine_factors(*factors: float) -> float:
    """Return the factor of independent ones: their logarithms add as squares."""
    return math.exp(math.hypot(*map(math.log, factors)))


def format_spread(
    factor: float = 1.0, plus_minus: float = 0.0, direction: float = 0.0
) -> str:
    """Return an entry of [dispersions]; "" where there is no spread."""
    entries = []
    if direction > 0.0:
        entries.append(f"direction = {direction:.6g}")
    if factor > 1.0:
        entries.append(f"factor = {factor:.3g}")
    if plus_minus > 0.0:
        entries.append(f"plus_minus = {plus_minus:.4g}")
    return f"{{ {', '.join(entries)} }}" if entries else ""
