"""Define what may end a run before its stop time; all stepping loops share it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from .node import Slot

EndingKind = Literal["never", "below", "above", "reaches", "always"]


@dataclass(frozen=True)
class Ending:
    """Condition that ends a run, evaluated between steps.

    `reason` returns why the run ends here, or an empty text. It may be called after any
    step. It must be called after each step in which the watched outputs have met their
    condition, and after the step that follows: the size of every element is `below` the
    limit, that of any of them `above` it, or all of them equal it (`reaches`); or after
    every step (`always`).
    """

    reason: Callable[[], str]
    kind: EndingKind = "always"
    watched: Sequence[Slot] = ()
    limit: float = 0.0
    # state of `reason` between steps, as JSON, which a checkpoint saves
    memory: dict[str, Any] = field(default_factory=dict)


NEVER = Ending(lambda: "", "never")  # nothing ends a run before its stop time
