"""Judge a single run by its scenario's requirements: met or not, with the margin."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..system.expression import factor
from ..system.parameters import unit_of
from ..system.typed import JsonObject
from .measures import OF_ENDS, OF_EVENTS
from .numbers import late
from .text import Value, number

if TYPE_CHECKING:
    from ..language.content import Content
    from ..language.scenario import Requirement

FEW_EVENTS = "fewer than two events"
FEWEST_SAMPLES = 10  # of a number that a requirement is judged by


def margin_of(used: float, limit: float) -> float:
    """Return the margin (limit - used) / limit; below 0 it does not hold.

    It is -inf where nothing is allowed and something used.
    """
    if limit == 0.0:
        return -math.inf if used > 0.0 else 0.0
    return 1.0 - used / limit if math.isfinite(limit) else 1.0


@dataclass(frozen=True)
class Verdict:
    """Verdict on a requirement in a run.

    With `value` None the number is not reached, which is not met.
    """

    number: str
    title: str
    value: float | None
    unit: str
    met: bool
    min: float | None = None
    max: float | None = None

    @property
    def margin(self) -> float | None:
        """Compute the margin to the nearer limit, as a share of that limit.

        It is below zero where the requirement is not met, and None where there is no
        value, or the limit is zero.
        """
        if self.value is None or not math.isfinite(self.value):
            return None
        shares = [
            sign * math.copysign(1.0, limit) * margin_of(self.value, limit)
            for sign, limit in ((1.0, self.max), (-1.0, self.min))
            if limit
        ]
        return min(shares, default=None)

    @property
    def bounds(self) -> list[tuple[str, float]]:
        """Return `at least` and `at most` with their limits, in the number's unit."""
        bounds = (("at least", self.min), ("at most", self.max))
        return [(word, x) for word, x in bounds if x is not None]

    @property
    def limits(self) -> str:
        """Return the limits as `at least 1, at most 2`, in the number's unit."""
        return ", ".join(f"{word} {number(x)}" for word, x in self.bounds)

    def to_json(self) -> JsonObject:
        """Return the verdict as a manifest has it."""
        return {k: v for k, v in vars(self).items() if v is not None or k == "value"}


def describe_verdicts(verdicts: Mapping[str, Verdict], unmet: int) -> str:
    """Return the sentence on whether a run holds, with its least margin.

    `unmet` is the number of checks of the run that are not met. Empty without any
    requirement or unmet check.
    """
    titles = [v.title for v in verdicts.values() if not v.met]
    reasons = [f"{unmet} check{'s' * (unmet > 1)} of the run not met"] * (unmet > 0)
    if titles:
        reasons.append(
            f"{len(titles)} of {len(verdicts)} requirements not met: {', '.join(titles)}"
        )
    if reasons:
        return f"Does not hold: {'; '.join(reasons)}"
    margins = [(v.margin, v.title) for v in verdicts.values() if v.margin is not None]
    if not margins:
        return "Holds" if verdicts else ""
    least, title = min(margins)
    return f"Holds with a margin of {100.0 * least:.3g} % ({title})"


def judge(
    content: Content, numbers: Mapping[str, Value], start: float, end: float
) -> tuple[dict[str, Verdict], dict[str, str]]:
    """Judge a run from `start` to `end` (s) by its numbers.

    Returns the verdicts, and by a number's name the reason why there is none: it is not
    recorded, or the run is too short.
    """
    verdicts, unjudged = {}, {}
    times = late(content)
    for name, entry in content.requirements.items():
        if reason := _too_little(
            content, entry, numbers, entry.number in times, start, end
        ):
            unjudged[entry.number] = reason
            continue
        number = numbers[entry.number]
        met = number.value is not None and entry.holds(number.value)
        verdicts[name] = Verdict(
            entry.number,
            number.title,
            number.value,
            number.unit,
            met,
            entry.min,
            entry.max,
        )
    return verdicts, unjudged


def _too_little(
    content: Content,
    entry: Requirement,
    numbers: Mapping[str, Value],
    is_late: bool,
    start: float,
    end: float,
) -> str:
    """Return the reason why a run does not decide a requirement, else ""."""
    if entry.number not in numbers:
        return "not recorded"
    measured = numbers[entry.number]
    number = content.numbers.get(entry.number)
    if measured.value is not None:
        samples = measured.samples
        if samples is None or samples >= FEWEST_SAMPLES or number is None:
            return ""
        if number.measure in OF_ENDS:
            return ""
        return "1 sample" if samples == 1 else f"{samples} samples"
    if number is not None and number.measure in OF_EVENTS:
        return FEW_EVENTS
    if is_late and entry.max is not None:
        limit = entry.max * factor(unit_of(measured.unit), "s", f"of {entry.number}")
        if end - start < limit * (1.0 - 1e-9):
            return f"not reached at {end:g} s, where the run ends; it has until {start + limit:g} s"
    if number is not None and number.window and end < number.window[0]:
        return f"the run ends at {end:g} s, before {number.window[0]:g} s, where its window begins"
    return ""


def lines(verdicts: Mapping[str, Verdict]) -> Iterator[str]:
    """Yield a line for each requirement that is not met."""
    for name, v in verdicts.items():
        if not v.met:
            unit = "" if v.unit in ("", "1") else f" {v.unit}"
            value = number(v.value) if v.value is None else f"{number(v.value)}{unit}"
            yield f"{name}: {v.title}: {value}; required: {v.limits}{unit}"
