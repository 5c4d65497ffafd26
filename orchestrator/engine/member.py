"""A component within a running system: its instance, where its outputs are, what feeds its inputs.

All outputs of a system lie in one array a type, `live`, that everybody reads from. Components with
state outputs pull into a second one of the same layout, `fresh`, from where they are shown later.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal

import numpy as np

from ..system.interface import KINDS, Kind, Signal
from ..system.model import Component, Connection
from .instances import DTYPE, Array, Instance

Copy = tuple[Array, Array]
"""live, fresh: pieces of the same outputs"""


@dataclass
class Slot:
    """An output that is read, and its place in the array of its type."""

    component: str
    signal: Signal
    kind: Kind
    interval: bool
    index: int = -1


@dataclass
class Member:
    """A component of a running system."""

    component: Component
    instance: Instance
    slots: dict[Kind, list[Slot]]
    """Its outputs that are read, a list a type, interval class first."""
    direct: bool
    """It pulls straight into `live`."""
    incoming: dict[Kind, list[tuple[Slot, Connection]]] = field(default_factory=dict)
    """What feeds its inputs, by type, in the order of the inputs."""

    @property
    def decimation(self) -> int:
        """It steps once in so many steps of the master."""
        return self.component.decimation

    def place(self, kind: Kind, which: Literal["all", "interval", "state"] = "all") -> slice:
        """Where its outputs of a type, or of one class of them, lie: always in one piece."""
        wanted = {"all": (True, False), "interval": (True,), "state": (False,)}[which]
        places = [s.index for s in self.slots[kind] if s.interval in wanted]
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def gathers(
        self, live: dict[Kind, Array], moves: Callable[[Connection], bool]
    ) -> list[Callable[[], Any]]:
        """Functions that collect its inputs, one a type, from the live outputs of those
        connections that move."""
        functions = []
        for kind, feeds in self.incoming.items():
            moving = [(i, slot.index, c) for i, (slot, c) in enumerate(feeds) if moves(c)]
            if moving:
                functions.append(_gather(live[kind], self.instance.inputs[kind], moving))
        return functions


class Outputs:
    """The outputs of all members, placed: those that pull into `fresh` first, in one piece."""

    def __init__(self, members: Iterable[Member]) -> None:
        self.slots: list[Slot] = []
        self.live: dict[Kind, Array] = {}
        self.fresh: dict[Kind, Array] = {}
        self._fresh_until: dict[Kind, int] = {}
        ordered = sorted(members, key=lambda m: m.direct)
        for kind in KINDS:
            slots = [slot for m in ordered for slot in m.slots[kind]]
            for index, slot in enumerate(slots):
                slot.index = index
            self.slots += slots
            self._fresh_until[kind] = sum(len(m.slots[kind]) for m in ordered if not m.direct)
            self.live[kind] = np.zeros(len(slots), DTYPE[kind])
            self.fresh[kind] = np.zeros(len(slots), DTYPE[kind])

    def home(self, member: Member, kind: Kind) -> Array:
        """The piece of an array that a member pulls its outputs of a type into."""
        return (self.live if member.direct else self.fresh)[kind][member.place(kind)]

    def all_fresh(self) -> list[Copy]:
        """All that is pulled into `fresh`, a piece a type."""
        return self._copies((kind, slice(0, self._fresh_until[kind])) for kind in KINDS)

    def fresh_of(self, member: Member, which: Literal["all", "interval", "state"]) -> list[Copy]:
        """What a member pulls into `fresh`: all, or its outputs of one class."""
        if member.direct:
            return []
        return self._copies((kind, member.place(kind, which)) for kind in KINDS)

    def _copies(self, pieces: Iterable[tuple[Kind, slice]]) -> list[Copy]:
        return [(self.live[k][p], self.fresh[k][p]) for k, p in pieces if p.stop > p.start]


def _gather(
    live: Array, target: Array, moving: list[tuple[int, int, Connection]]
) -> Callable[[], Any]:
    """target[i] = factor * live[index] + offset for the connections (i, index, connection)."""
    index = np.array([index for _, index, _ in moving], np.intp)
    if len(moving) == len(target) and not any(_converts(c) for *_, c in moving):
        return partial(live.take, index, None, target, "clip")
    into = np.array([i for i, _, _ in moving], np.intp)
    if not any(_converts(c) for *_, c in moving):

        def gather() -> None:
            target[into] = live[index]

        return gather
    factor = np.array([c.factor for *_, c in moving])
    offset = np.array([c.offset for *_, c in moving])

    def gather_converted() -> None:
        target[into] = live[index] * factor + offset

    return gather_converted


def _converts(connection: Connection) -> bool:
    return (connection.factor, connection.offset) != (1.0, 0.0)
