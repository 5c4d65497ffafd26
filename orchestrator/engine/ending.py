"""What the stepping loops share: their names, and what may end a run before its stop
time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from .node import Slot

How = Literal["never", "below", "above", "reaches", "always"]


@dataclass(frozen=True)
class Ending:
    """Why a run ends here, asked between steps: `reason` gives it, or nothing.

    It may be asked after any step, and must be after each in which the watched outputs
    have met their condition, and after the one that follows: the size of every element
    `below` the limit, of any of them `above` it, or all of them equal to it
    (`reaches`); or after every step (`always`).
    """

    reason: Callable[[], str]
    how: How = "always"
    watched: Sequence[Slot] = ()
    limit: float = 0.0
    memory: dict[str, Any] = field(default_factory=dict)
    """What `reason` remembers from step to step, as JSON has it: a checkpoint keeps it.
    """


NEVER = Ending(lambda: "", "never")
"""Nothing ends a run before its stop time."""
