"""End a run before its stop time: by the scenario's `stop_when` or a wall time limit.

    [stop_when]
    signal = "wheels.h_wheel"
    below = "0.05 * manager.h_limit"   # the size of every element; or `above`: of any of them
    held = 60.0                        # so long without a break (s); default: at once

    [stop_when]
    signal = "manager.mode"
    reaches = "nominal"                # an Integer's value or its name, or true or false

The condition is evaluated after each step. A state output then belongs to t_k, an
interval output to the step just made, as in the rows of the results; so a run ends
where the measure `first_below` is known.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..engine.ending import Ending, EndingKind
from ..engine.master import Master
from ..engine.node import Slot
from ..language.content import content_of
from ..language.scenario import StopWhen
from ..system.errors import DesatError, MisfitError, nearest
from ..system.expression import factor, product
from ..system.interface import Signal, find_elements
from ..system.model import System
from ..system.parameters import unit_of

# Result of `watch`, and status in the manifest, when the wall time limit is over.
LATE = "timed out"


@dataclass(frozen=True)
class StopCondition:
    """Condition `stop_when` of a system: output, limit, and holding time (s)."""

    component: str
    variable: str
    kind: EndingKind
    limit: float
    held: float
    text: str

    def met(self, values: NDArray[Any]) -> bool:
        """Return whether the values of all elements meet the condition."""
        if self.kind == "reaches":
            return bool((values == self.limit).all())
        largest = np.abs(values).max()
        return bool(
            largest < self.limit if self.kind == "below" else largest > self.limit
        )

    def reads(self, component: str, signal: Signal) -> bool:
        """Return whether a signal is an element of the condition's output."""
        return component == self.component and signal.series == self.variable


def condition(system: System) -> StopCondition | None:
    """Return the condition of a system with its interfaces loaded, or None.

    Raises
    ------
    MisfitError
        If it does not fit the system.
    """
    if (stop_when := content_of(system.about).stop_when) is None:
        return None
    signal = _signal(system, stop_when.signal)
    if stop_when.reaches is not None:
        kind: EndingKind = "reaches"
        limit, limit_text = (
            float(_reaches(signal, stop_when.reaches)),
            str(stop_when.reaches),
        )
    else:
        kind = "below" if stop_when.below is not None else "above"
        limit, limit_text = _limit(system, signal, stop_when, kind)
    text = f"{stop_when.signal} {kind} {limit_text}" + (
        f" for {stop_when.held:g} s" if stop_when.held else ""
    )
    owner, _, variable = stop_when.signal.partition(".")
    return StopCondition(owner, variable, kind, limit, stop_when.held, text)


def _signal(system: System, name: str) -> Signal:
    """Return the first element of the signal."""
    try:
        return find_elements(system.components, name, "output")[0]
    except DesatError as error:
        raise MisfitError(str(error), "stop_when", "signal") from error


def _reaches(signal: Signal, value: Any) -> int:
    """Return the number that the signal has to reach."""
    place = f"got {value!r}; {signal.array} is"
    keys = ("stop_when", "reaches")
    if signal.kind == "Real":
        raise MisfitError(f"{place} a Real, which has below and above", *keys)
    if (signal.kind == "Boolean") != isinstance(value, bool):
        type_needed = (
            "Boolean: true or false" if signal.kind == "Boolean" else "an Integer"
        )
        raise MisfitError(f"{place} {type_needed}", *keys)
    if isinstance(value, str):
        if value not in signal.choices:
            raise MisfitError(
                f"no value {value}{nearest(value, signal.choices)}", *keys
            )
        return signal.choices.index(value)
    return int(value)


def _limit(
    system: System, signal: Signal, stop_when: StopWhen, side: Literal["below", "above"]
) -> tuple[float, str]:
    """Return the limit in the signal's unit, and as text."""
    if signal.kind != "Real":
        text = f"{stop_when.signal} is of type {signal.kind}; `reaches`"
        raise MisfitError(text, "stop_when", side)
    value = getattr(stop_when, side)
    own_unit, unit = signal.unit_name, stop_when.unit or signal.unit_name
    try:
        if isinstance(value, str):
            number, of = product(value, system.parameters)
            value = number * factor(of, unit, f'of "{value}"')
        scale = (
            1.0
            if unit == own_unit
            else factor(unit_of(unit), own_unit, f"{unit} of the limit")
        )
    except DesatError as error:
        raise MisfitError(str(error), "stop_when", side) from error
    return value * scale, f"{value:g} {'' if unit == '1' else unit}".rstrip()


def watch(master: Master, stop: StopCondition | None, seconds: float | None) -> Ending:
    """Build the `Ending` of a run: its condition, or a limit of wall time.

    The master is initialised. The reason is the text of the condition, or `LATE` once
    `seconds` of wall time are over from now.
    """
    slots = [s for s in master.slots if stop and stop.reads(s.component, s.signal)]
    memory: dict[str, Any] = {}
    met = _hold(master, stop, slots, memory) if stop else lambda: False
    text = stop.text if stop else ""
    end = None if seconds is None else time.monotonic() + seconds

    def reason() -> str:
        """Return the reason to end now, or ""."""
        if met():
            return text
        return LATE if end is not None and time.monotonic() > end else ""

    if stop is None:
        return Ending(reason, "never")
    return Ending(reason, stop.kind, slots, stop.limit, memory)


def _hold(
    master: Master, stop: StopCondition, slots: list[Slot], memory: dict[str, Any]
) -> Callable[[], bool]:
    """Build the function that tells whether the condition has held for long enough.

    `memory` holds the time since when it is met.
    """
    live, index = (
        master.live[slots[0].kind],
        np.array([s.index for s in slots], np.intp),
    )
    # the row of an interval output began a step ago
    ago = int(slots[0].interval and master.algorithm == "gauss_seidel")
    if not ago and stop.met(live[index]):
        memory["since"] = master.start

    def met() -> bool:
        """Return whether the condition has held for long enough at the present step."""
        if not stop.met(live[index]):
            memory.clear()
            return False
        row = master.start + (master.k - ago) * master.step_size
        since: float = memory.setdefault("since", row)
        return row - since >= stop.held - 1e-9

    return met
