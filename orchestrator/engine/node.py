"""Represent a component in a running system: its instance, outputs and input sources.

All outputs of a system are in one array per type, `live`, from which all components
read. Components with state outputs pull into a second array of the same layout,
`fresh`, whose values are published later.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ..system.interface import MOVED_KINDS, Kind, Signal
from ..system.model import Component, Connection
from .instances.base import Array, Instance, blank
from .operations import Gather, KeepRow, Places, Publish


@dataclass
class Slot:
    """An output that is read, and its index in the array of its type."""

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
    slots: dict[Kind, list[Slot]]  # outputs that are read, interval class first
    every: int  # parts of the master's step for each step of the component
    late: bool  # it steps at the end of its window
    direct: bool  # it pulls straight into `live`
    incoming: dict[Kind, list[tuple[Slot, Connection]]] = field(default_factory=dict)
    """Sources of its inputs, by type, in the order of the inputs."""
    windows: list[Window] = field(default_factory=list)
    """Means that it takes from members of another rate."""

    @property
    def name(self) -> str:
        """Return the name of the component."""
        return self.component.name

    def steps_at(self, part: int) -> bool:
        """Return whether the component steps in this part of the cycle."""
        return (part + self.late) % self.every == 0

    def place(
        self, kind: Kind, output_class: Literal["all", "interval", "state"] = "all"
    ) -> slice:
        """Return where its outputs of a type, or of one class of them, are.

        They are always contiguous.
        """
        classes = {"all": (True, False), "interval": (True,), "state": (False,)}[
            output_class
        ]
        places = [s.index for s in self.slots[kind] if s.interval in classes]
        return slice(places[0], places[-1] + 1) if places else slice(0, 0)

    def gathers(
        self,
        live: dict[Kind, Array],
        moves: Callable[[Slot], bool],
        started: bool = True,
    ) -> list[Gather]:
        """Prepare to collect the inputs from those outputs that `moves` selects.

        There is one operation per type of source and input. Once `started`, means of another rate are read
        from where they are joined or cut.
        """
        elsewhere = (
            {} if not started else {p: i for w in self.windows for p, i in w.moved()}
        )
        gathers = []
        for kind, feeds in self.incoming.items():
            moving: dict[Kind, list[tuple[int, int, Connection]]] = {}
            for i, (slot, c) in enumerate(feeds):
                if moves(slot):
                    index = slot.index
                    if slot.kind == "Real":
                        index = elsewhere.get(index, index)
                    moving.setdefault(slot.kind, []).append((i, index, c))
            target = self.instance.inputs[kind]
            gathers += [
                _gather(kind, live[of], target, of_kind, widens=of != kind)
                for of, of_kind in moving.items()
            ]
        return gathers


@dataclass
class Window:
    """Means that a component takes from one of another rate.

    `target` holds their places once they are joined, or cut, for this component.
    """

    source: str
    places: Places
    target: Places = field(init=False)

    def moved(self) -> Iterable[tuple[int, int]]:
        """Yield the index of each value among the outputs and that for the receiver."""
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
    """Return the places of the means among placed outputs, and of their slopes.

    With `only`, either the mean or its slope must have one of these indices.
    """
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
    """The outputs of all components, with their indices.

    Those that are pulled into `fresh` come first, contiguously. After all outputs
    `live["Real"]` has places for means that are joined or cut for receivers of another
    rate.
    """

    def __init__(self, members: Iterable[Node]) -> None:
        """Allot an array to each kind of output, and a number in it to each slot."""
        self.slots: list[Slot] = []
        self.live: dict[Kind, Array] = {}
        self.fresh: dict[Kind, Array] = {}
        self._fresh_until: dict[Kind, int] = {}
        ordered = sorted(members, key=lambda m: m.direct)
        for kind in MOVED_KINDS:
            slots = [slot for m in ordered for slot in m.slots[kind]]
            for index, slot in enumerate(slots):
                slot.index = index
            self.slots += slots
            self._fresh_until[kind] = sum(
                len(m.slots[kind]) for m in ordered if not m.direct
            )
            self.live[kind] = blank(kind, len(slots))
            self.fresh[kind] = blank(kind, len(slots))

    def make_room(self, windows: Iterable[Window]) -> None:
        """Allocate places for the means of windows, for their receivers."""
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
        """Return the slice of the array into which a member pulls outputs of a type."""
        return (self.live if member.direct else self.fresh)[kind][member.place(kind)]

    def all_fresh(self) -> list[Publish]:
        """Prepare to publish all that is pulled into `fresh`, one copy per type."""
        return self._copies(
            (kind, slice(0, self._fresh_until[kind])) for kind in MOVED_KINDS
        )

    def fresh_of(
        self, member: Node, output_class: Literal["all", "interval", "state"]
    ) -> list[Publish]:
        """Prepare to publish a member's fresh outputs: all, or those of one class."""
        if member.direct:
            return []
        return self._copies(
            (kind, member.place(kind, output_class)) for kind in MOVED_KINDS
        )

    def _copies(self, pieces: Iterable[tuple[Kind, slice]]) -> list[Publish]:
        """Prepare copies from `fresh` to `live`, leaving out empty slices."""
        return [
            Publish(self.live[k][p], self.fresh[k][p])
            for k, p in pieces
            if p.stop > p.start
        ]


def _gather(
    kind: Kind,
    live: Array,
    target: Array,
    moving: list[tuple[int, int, Connection]],
    widens: bool,
) -> Gather:
    """Prepare target[i] = factor * live[index] + offset.

    `moving` lists (i, index, connection). With `widens`, Integers become Reals.
    """
    index = np.array([index for _, index, _ in moving], np.intp)
    converts = widens or any((c.factor, c.offset) != (1.0, 0.0) for *_, c in moving)
    if len(moving) == len(target) and not converts:
        return Gather(kind, live, target, index)
    into = np.array([i for i, _, _ in moving], np.intp)
    if not converts:
        return Gather(kind, live, target, index, into)
    factor = np.array([c.factor for *_, c in moving])
    offset = np.array([c.offset for *_, c in moving])
    return Gather(kind, live, target, index, into, (factor, offset))


# ------------------------------------------------------------------------------------------------
# Values that reach a component at each of its own steps, including substeps. A row of results
# joins the means of several substeps, and does not resolve the steps of a slower component. An
# analysis that needs them one by one (`analyses/energy.py`) records them here until the room is
# used up.


# Steps of the component that are taken at once. The pieces are the same whenever they are
# taken, so that results derived from them have the same bits.
PIECE = 4096
_CAPACITY = 2 * PIECE


class StepRecording:
    """Recorded values at each step of `component`.

    They are rows of `outputs`, elements of components, at the start of the step, and
    the Reals that the component then receives.
    """

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
        """Locate the sources of the values.

        `inner` is the number of parts of a step of the master.
        """
        member = members[self.component]
        self.inputs = [c.input for _, c in member.incoming.get("Real", ())]
        inputs = member.instance.inputs.get("Real", np.zeros(0))
        self.every, self._inner = member.every, inner
        capacity = _CAPACITY + 2 + inner
        index = np.array([slots[name].index for name in self.outputs], np.intp)
        self.starts = np.zeros((capacity, len(index)))  # (room, outputs)
        self.input_rows = np.zeros((capacity, len(inputs)))  # (room, inputs)
        self._start = KeepRow(live, index, self.starts, self._taken[:1])
        self._keep_inputs = KeepRow(
            inputs, np.arange(len(inputs)), self.input_rows, self._taken[1:]
        )
        self._steps = member.steps_at

    def at_start(self, part: int) -> list[KeepRow]:
        """Return the operations that record values at the start of a part."""
        return [self._start] if part % self.every == 0 else []

    def when_given(self, part: int) -> list[KeepRow]:
        """Return the operations that record inputs after all have moved in a part."""
        return [self._keep_inputs] if self._steps(part) else []

    @property
    def steps_before_look(self) -> int:
        """Return the number of master steps for which there is room."""
        return int((_CAPACITY - self._taken[0]) * self.every // self._inner)

    def end(self, k: int) -> None:
        """Record the start of the step that would begin with step k of the master.

        If none would begin there, nothing is recorded.
        """
        if k * self._inner % self.every == 0:
            self._start()

    def take(self, rest: bool = False) -> tuple[Array, Array] | None:
        """Remove and return the recorded values of the next PIECE steps.

        They are starts (n + 1, outputs) and inputs (n, inputs), or None if there are
        fewer steps than PIECE. With `rest`, fewer steps are returned, if there are any.
        """
        starts, inputs = self._taken.tolist()
        n = min(starts - 1, inputs, PIECE)
        if n < (1 if rest else PIECE):
            return None
        taken = self.starts[: n + 1].copy(), self.input_rows[:n].copy()
        for rows, count in ((self.starts, starts), (self.input_rows, inputs)):
            rows[: count - n] = rows[n:count].copy()
        self._taken -= n
        return taken

    def memory(self) -> dict[str, Array]:
        """Return all arrays by name, so that they can be saved and restored."""
        return {
            "kept starts": self.starts,
            "kept given": self.input_rows,
            "kept taken": self._taken,
        }
