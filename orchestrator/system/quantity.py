"""Parse quantities that people type, with a unit or in the usual one.

A quantity is a finite number within a range. Each option that takes one has a
`Quantity`, which parses it and names the option in its messages.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from math import inf, isfinite

from .errors import DesatError
from .program_values import plain_argument

_NUMBER = re.compile(
    r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*([A-Za-z%/.0-9]*)\s*"
)


def is_number(text: str) -> bool:
    """Return whether a text is a number, with or without a unit."""
    return _NUMBER.fullmatch(text) is not None


def is_float(text: str) -> bool:
    """Return whether Python parses a text as a number, including nan and inf."""
    try:
        float(text)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Quantity:
    """A number that an option takes, from `least` to `most`.

    It is in `unit`, or in another unit that fits.
    """

    option: str  # as messages name it: --altitude
    unit: str = "1"
    least: float = -inf
    most: float = inf
    above: bool = False  # `least` itself is not allowed
    noun: str = ""  # noun for the value in messages, such as "a factor of"
    bare: bool = True  # whether a typed value may have no unit

    def __call__(self, value: str | float) -> float:
        """Parse what a person typed, or check what a program gave, in `unit`.

        Raises
        ------
        DesatError
            If it is no such quantity or out of range.
        """
        value = plain_argument(value)
        if isinstance(value, (int, float)):
            return self._within(float(value), f"{value:g}")
        return self._within(self._read(value, value), value)

    def many(self, text: str) -> tuple[float, ...]:
        """Parse numbers separated by commas, in `unit`.

        Raises
        ------
        DesatError
            If one is no such quantity or out of range.
        """
        return tuple(
            self._within(self._read(x, text, many=True), text) for x in text.split(",")
        )

    def _read(self, text: str, typed: str, many: bool = False) -> float:
        """Parse a number with or without a unit, and convert it to `unit`."""
        match = _NUMBER.fullmatch(text)
        if match is None:
            form_needed = (
                "numbers are needed, as 1,2,3" if many else "a number is needed"
            )
            unit = f", with its unit or in {self.unit}" if self.unit != "1" else ""
            raise DesatError(f"{self.option} {typed}: {form_needed}{unit}")
        if match[2]:
            return self._converted(float(match[1]), match[2], typed)
        if not self.bare and self.unit != "1":
            example = f"{match[1]}{self.unit.replace('.', '')}"
            raise DesatError(f"{self.option} {typed}: a unit is needed, as {example}")
        return float(match[1])

    def _converted(self, number: float, unit: str, text: str) -> float:
        """Convert a number from a typed unit to `unit`."""
        from desat.components.contract.units import conversion

        from .parameters import known_unit, unit_of, with_dots

        if unit == "d" and self.unit == "s":
            return 86400.0 * number
        target, meant = unit_of(self.unit), with_dots(unit)
        if meant is not None and conversion(unit_of(meant), target) is not None:
            unit = meant
        if known_unit(unit) is None:
            unit_needed = (
                "no unit" if self.unit == "1" else f"one that fits {self.unit}"
            )
            raise DesatError(
                f"{self.option} {text}: unit {unit} is not known; {unit_needed} is needed"
            )
        converted = conversion(unit_of(unit), target)
        if converted is None:
            expected = self.unit if self.unit != "1" else "a number without a unit"
            raise DesatError(f"{self.option} {text}: {unit} does not fit {expected}")
        return number * converted[0] + converted[1]

    def _within(self, value: float, text: str) -> float:
        """Check that a value is finite and within the range."""
        low = value <= self.least if self.above else value < self.least
        if isfinite(value) and not low and value <= self.most:
            return value
        raise DesatError(f"{self.option} {text}: {self._needed(isfinite(value))}")

    def _needed(self, finite: bool) -> str:
        """Describe the range that is allowed."""
        unit = f" {self.unit}" if self.unit != "1" else ""
        if (
            finite
            and self.least > -inf
            and self.most < inf
            and not (self.above or self.noun)
        ):
            return f"{self.least:g} to {self.most:g}{unit} are covered"
        range_ = ""
        if self.least > -inf:
            range_ = (
                f"above {self.least:g}" if self.above else f"{self.least:g} or more"
            )
        words = " ".join(filter(None, (self.noun, range_)))
        if not finite or not words:
            words = " ".join(filter(None, ("a finite number", range_)))
        verb = "are" if self.noun.endswith("s") else "is"
        most = f", {self.most:g}{unit} at most" if self.most < inf else ""
        return f"{words} {verb} needed{most}"
