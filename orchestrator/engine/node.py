"""A component within a running system: its instance, where its outputs are, what feeds
its inputs.

All outputs of a system lie in one array a type, `live`, that everybody reads from.
Components with state outputs pull into a second one of the same layout, `fresh`, from
where they are shown later.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..system.interface import KINDS, Kind, Signal
from ..system.model import Component, Connection
from .instances.base import DTYPE, Array, Instance
from .operations import Gather, KeepRow, Places, Publish


@dataclass
class Slot:
    """An output that is read, and its place in the array of its type."""

    component: str
    signal: Signal
    kind: Kind
    interval: bool
    index: int = -1


@dataclass
class Node:
    """A component of a running system."""

    component: Component
    instance: Instance
    slots: dict[Kind, list[Slot]]
    """Its outputs that are read, a list a type, interval class first."""
    every: int
    """It steps once in so many parts of the master's step."""
    late: bool
    """It steps at the end of its window."""
    direct: bool
    """It pulls straight into `live`."""
    incoming: dict[Kind, list[tuple[Slot, Connection]]] = field(default_factory=dict)
    """What feeds its inputs, by type, in the order of the inputs."""
    windows: list[Window] = field(default_factory=list)
    """The means that it takes from members of another rate."""

    @property
    def name(self) -> str:
        """Of the component."""
        return self.component.name

    def steps_at(self, part: int) -> bool:
        """Whether it steps in this part of the cycle."""
        return (part + self.late) % self.every == 0

    def place(
        self, kind: Kind, which: Literal["all", "interval", "state"] = "all"
    ) -> slice:
        """Where its outputs of a type, or of one class of them, lie: always in one
        piece."""
        wanted = {"all": (True, False), "interval": (True,), "state": (False,)}[which]
        places = [s.index for s in self.slots[kind] if s.interval in wanted]
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def gathers(
        self,
        live: dict[Kind, Array],
        moves: Callable[[Slot], bool],
        started: bool = True,
    ) -> list[Gather]:
        """What collects its inputs, one a type, from those outputs that move; once
        `started`, means of another rate from where they are joined or cut."""
        elsewhere = (
            {} if not started else {p: i for w in self.windows for p, i in w.moved()}
        )
        gathers = []
        for kind, feeds in self.incoming.items():
            moving = [
                (
                    i,
                    elsewhere.get(slot.index, slot.index)
                    if kind == "Real"
                    else slot.index,
                    c,
                )
                for i, (slot, c) in enumerate(feeds)
                if moves(slot)
            ]
            if moving:
                gathers.append(
                    _gather(kind, live[kind], self.instance.inputs[kind], moving)
                )
        return gathers


@dataclass
class Window:
    """Means that a member takes from one of another rate, and their places once they
    are joined, or cut, for it."""

    source: str
    places: Places
    target: Places = field(init=False)

    def moved(self) -> Iterable[tuple[int, int]]:
        """Of each value its place among the outputs, and its place for the receiver."""
        for old, new in (
            (self.places.means, self.target.means),
            (self.places.slopes, self.target.slopes),
        ):
            yield from (
                (p, i)
                for p, i in zip(old.tolist(), new.tolist(), strict=True)
                if p >= 0
            )


def means(slots: Iterable[Slot], only: Container[int] | None = None) -> Places:
    """The places of the means among placed outputs, and of their slopes; `only` those
    of which the mean or the slope is at one of these places."""
    slots = list(slots)
    index = {(s.component, s.signal.name): s.index for s in slots if s.interval}
    pairs = [
        (s.index, index.get((s.component, s.signal.slope), -1))
        for s in slots
        if s.interval and s.signal.mean
    ]
    if only is not None:
        pairs = [(m, p) for m, p in pairs if m in only or p in only]
    return Places.of([m for m, _ in pairs], [p for _, p in pairs])


class Outputs:
    """The outputs of all members, placed: those that pull into `fresh` first, in one
    piece.

    After them `live["Real"]` has places for means that are joined or cut for receivers
    of another rate.
    """

    def __init__(self, members: Iterable[Node]) -> None:
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
            self._fresh_until[kind] = sum(
                len(m.slots[kind]) for m in ordered if not m.direct
            )
            self.live[kind] = np.zeros(len(slots), DTYPE[kind])
            self.fresh[kind] = np.zeros(len(slots), DTYPE[kind])

    def make_room(self, windows: Iterable[Window]) -> None:
        """Give the means of windows their places for the receivers."""
        count = len(self.live["Real"])
        for window in windows:
            size = len(window.places.means)
            window.target = Places(
                np.arange(count, count + size),
                np.arange(count + size, count + 2 * size),
            )
            count += 2 * size
        self.live["Real"] = np.zeros(count)

    def home(self, member: Node, kind: Kind) -> Array:
        """The piece of an array that a member pulls its outputs of a type into."""
        return (self.live if member.direct else self.fresh)[kind][member.place(kind)]

    def all_fresh(self) -> list[Publish]:
        """All that is pulled into `fresh`, a piece a type."""
        return self._copies((kind, slice(0, self._fresh_until[kind])) for kind in KINDS)

    def fresh_of(
        self, member: Node, which: Literal["all", "interval", "state"]
    ) -> list[Publish]:
        """What a member pulls into `fresh`: all, or its outputs of one class."""
        if member.direct:
            return []
        return self._copies((kind, member.place(kind, which)) for kind in KINDS)

    def _copies(self, pieces: Iterable[tuple[Kind, slice]]) -> list[Publish]:
        return [
            Publish(self.live[k][p], self.fresh[k][p])
            for k, p in pieces
            if p.stop > p.start
        ]


def _gather(
    kind: Kind, live: Array, target: Array, moving: list[tuple[int, int, Connection]]
) -> Gather:
    """target[i] = factor * live[index] + offset for the connections (i, index,
    connection)."""
    index = np.array([index for _, index, _ in moving], np.intp)
    converts = any((c.factor, c.offset) != (1.0, 0.0) for *_, c in moving)
    if len(moving) == len(target) and not converts:
        return Gather(kind, live, target, index)
    into = np.array([i for i, _, _ in moving], np.intp)
    if not converts:
        return Gather(kind, live, target, index, into)
    factor = np.array([c.factor for *_, c in moving])
    offset = np.array([c.offset for *_, c in moving])
    return Gather(kind, live, target, index, into, (factor, offset))


# ------------------------------------------------------------------------------------------------
# What reaches a component at each of its own steps, also of those within a step of the master. A
# row of results has the means of several substeps joined, and none of the steps of a component
# that is slower; who needs them one by one (`analyses/energy.py`) has them kept here until there is
# no room for more.


PIECE = 4096
"""Steps of the component that are taken at once: always the same ones together,
whenever that is, so that what is made of them has the same bits."""
_ROOM = 2 * PIECE


class Kept:
    """Rows of `outputs`, elements of components, at the start of each step of
    `component`, and of the Reals that it is then given."""

    def __init__(self, component: str, outputs: Sequence[tuple[str, str]]) -> None:
        self.component, self.outputs = component, tuple(outputs)
        self._taken = np.zeros(2, np.int64)

    def wire(
        self,
        members: Mapping[str, Node],
        slots: Mapping[tuple[str, str], Slot],
        live: Array,
        inner: int,
    ) -> None:
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
        self._start = KeepRow(live, index, self.starts, self._taken[:1])
        self._given = KeepRow(given, np.arange(len(given)), self.given, self._taken[1:])
        self._steps = member.steps_at

    def at_start(self, part: int) -> list[KeepRow]:
        """What is kept at the start of a part."""
        return [self._start] if part % self.every == 0 else []

    def when_given(self, part: int) -> list[KeepRow]:
        """What is kept when all have moved in a part."""
        return [self._given] if self._steps(part) else []

    @property
    def room(self) -> int:
        """The steps of the master that there is room for."""
        return int((_ROOM - self._taken[0]) * self.every // self._inner)

    def end(self, k: int) -> None:
        """Take the start of the step that would begin with step k of the master, if one
        would."""
        if k * self._inner % self.every == 0:
            self._start()

    def take(self, rest: bool = False) -> tuple[Array, Array] | None:
        """Starts (n + 1, outputs) and inputs (n, inputs) of the next PIECE steps, which
        are kept no longer; None where there are not so many. `rest`: of those that
        there are, if any."""
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
        return {
            "kept starts": self.starts,
            "kept given": self.given,
            "kept taken": self._taken,
        }
