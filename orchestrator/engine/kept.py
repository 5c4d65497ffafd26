"""What reaches a component at each of its own steps, also of those within a step of the master.

A row of results has the means of several inner steps joined, and none of the steps of a component
that is slower; who needs them one by one (`analyses/along.py`) has them kept here until there is no
room for more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from .instances.base import Array
from .node import Member, Slot
from .operations import Keep

PIECE = 4096
"""Steps of the component that are taken at once: always the same ones together, whenever that is,
so that what is made of them has the same bits."""
_ROOM = 2 * PIECE


class Kept:
    """Rows of `outputs`, elements of components, at the start of each step of `component`, and of
    the Reals that it is then given."""

    def __init__(self, component: str, outputs: Sequence[tuple[str, str]]) -> None:
        self.component, self.outputs = component, tuple(outputs)
        self._taken = np.zeros(2, np.int64)

    def wire(
        self, members: Mapping[str, Member], slots: Mapping[tuple[str, str], Slot], live: Array,
        inner: int,
    ) -> None:  # fmt: skip
        """Say where values come from. `inner`: the parts of a step of the master."""
        member = members[self.component]
        self.inputs = [c.input for _, c in member.incoming.get("Real", ())]
        given = member.instance.inputs.get("Real", np.zeros(0))
        self.every, self._inner = member.every, inner
        room = _ROOM + 2 + inner
        index = np.array([slots[name].index for name in self.outputs], np.intp)
        self.starts = np.zeros((room, len(index)))
        """(room, outputs)"""
        self.given = np.zeros((room, len(given)))
        """(room, inputs)"""
        self._start = Keep(live, index, self.starts, self._taken[:1])
        self._given = Keep(given, np.arange(len(given)), self.given, self._taken[1:])
        self._steps = member.steps_at

    def at_start(self, part: int) -> list[Keep]:
        """What is kept at the start of a part."""
        return [self._start] if part % self.every == 0 else []

    def when_given(self, part: int) -> list[Keep]:
        """What is kept when all have moved in a part."""
        return [self._given] if self._steps(part) else []

    @property
    def room(self) -> int:
        """The steps of the master that there is room for."""
        return int((_ROOM - self._taken[0]) * self.every // self._inner)

    def end(self, k: int) -> None:
        """Take the start of the step that would begin with step k of the master, if one would."""
        if k * self._inner % self.every == 0:
            self._start()

    def take(self, rest: bool = False) -> tuple[Array, Array] | None:
        """Starts (n + 1, outputs) and inputs (n, inputs) of the next PIECE steps, which are kept no
        longer; None where there are not so many. `rest`: of those that there are, if any."""
        starts, given = self._taken.tolist()
        n = min(starts - 1, given, PIECE)
        if n < (1 if rest else PIECE):
            return None
        taken = self.starts[: n + 1].copy(), self.given[:n].copy()
        for rows, count in ((self.starts, starts), (self.given, given)):
            rows[: count - n] = rows[n:count].copy()
        self._taken -= n
        return taken

    def memory(self) -> dict[str, Array]:
        """All that it keeps, by name: it may be saved, and put back."""
        return {"kept starts": self.starts, "kept given": self.given,
                "kept taken": self._taken}  # fmt: skip
