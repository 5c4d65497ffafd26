"""What a master does in each part of its steps, prepared once: who steps, with which calls."""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, Literal, NamedTuple

from ..system.rates import Rates
from .instances import Array, Clock, Instance
from .member import Copy, Member, Outputs, Slot, Window, means
from .windows import Part, Whole

_Call = Callable[[], int]


class Move(NamedTuple):
    """What a member does in a part: its calls in their order, then what it shows at once and what
    it hands on to members of another rate."""

    instance: Instance
    gathers: list[Callable[[], Any]]
    push: _Call
    step: _Call
    pull: _Call
    copies: list[Copy]
    joins: list[Callable[[], None]]


@dataclass
class Phase:
    """A part of a step: its start as a share of it, whether it is the last, the clocks to set, the
    lengths that change, the moves, and what is shown when all have moved."""

    at: float
    last: bool
    clocks: list[ctypes.c_double]
    lengths: list[tuple[ctypes.c_double, float]]
    moves: list[Move]
    ends: list[Copy]


class Plan:
    """Prepares the phases of a cycle.

    Under `jacobi` (`conserving` false) nothing is joined or cut: an output moves only when its
    source and its target are both due.
    """

    def __init__(
        self, members: dict[str, Member], outputs: Outputs, rates: Rates, conserving: bool
    ) -> None:
        self._members, self._outputs, self._rates = members, outputs, rates
        self._conserving = conserving

    def clocks(self, start: float, step: float) -> dict[int, Clock]:
        """A clock for each rate."""
        inner = len(self._rates.parts)
        self._clocks = {
            m.every: Clock(start, step * self._rates.edge(m.every)) for m in self._members.values()
        }
        self._lengths = [w * step for _, w in self._rates.parts] if inner > 1 else []
        return self._clocks

    def windows(self) -> None:
        """Give each member the windows of means that it takes from members of another rate."""
        if not self._conserving:
            return
        for member in self._members.values():
            sources = {slot.component for slot, _ in member.incoming.get("Real", ())}
            for name in sorted(sources):
                source = self._members[name]
                wanted = {s.index for s, _ in member.incoming["Real"] if s.component == name}
                places = means(source.slots["Real"], wanted)
                if source.every != member.every and len(places.means):
                    member.windows.append(Window(name, places))
        self._outputs.make_room(w for m in self._members.values() for w in m.windows)

    def cycle(self) -> list[list[Phase]]:
        """The phases of each step of a cycle."""
        inner = len(self._rates.parts)
        self._whole = {
            (m.name, w.source): Whole(
                self._live, w.places, self._live, w.target,
                self._rates.window(self._members[w.source].every, m.every),
            )
            for m in self._members.values() for w in m.windows
            if self._members[w.source].every < m.every
        }  # fmt: skip
        phases = [self._phase(part) for part in range(self._rates.cycle * inner)]
        return [phases[i : i + inner] for i in range(0, len(phases), inner)]

    @property
    def _live(self) -> Array:
        return self._outputs.live["Real"]

    def _phase(self, part: int) -> Phase:
        members = list(self._members.values())
        inner = part % len(self._rates.parts)
        moves = [self._sample(m) for m in members if m.late and part % m.every == 0]
        stepping = [m for m in members if m.steps_at(part)]
        order = {m.name: i for i, m in enumerate(members)}
        moves += [self._move(m, part) for m in stepping]
        moves.sort(key=lambda move: order[move.instance.name])
        fast = self._clocks.get(1)
        return Phase(
            self._rates.parts[inner][0],
            inner == len(self._rates.parts) - 1,
            [clock.t for every, clock in self._clocks.items() if part % every == 0],
            [(fast.dt, self._lengths[inner])] if self._lengths and fast else [],
            moves,
            self._ends([m for m in members if (part + 1) % m.every == 0]),
        )

    def _sample(self, member: Member) -> Move:
        """The start of a late member's window: it takes those inputs that belong there."""
        gathers = member.gathers(self._outputs.live, lambda slot: not self._at_end(member, slot))
        return Move(member.instance, gathers, _nothing, _nothing, _nothing, [], [])

    def _at_end(self, member: Member, slot: Slot) -> bool:
        """Whether a late member takes an input at the end of its window: what is over the window
        is known there only."""
        source = self._members[slot.component]
        return slot.interval and (
            slot.index in {int(i) for w in member.windows for i, _ in w.moved()}
            or (source.every == member.every)
        )

    def _move(self, member: Member, part: int) -> Move:
        """A member's step."""
        instance, live = member.instance, self._outputs.live
        if member.late:
            gathers = member.gathers(live, lambda slot: self._at_end(member, slot))
        elif self._conserving:
            gathers = member.gathers(live, lambda slot: True)
        else:
            due = lambda slot: part % self._members[slot.component].every == 0  # noqa: E731
            gathers = member.gathers(live, due)
        return Move(
            instance,
            [*self._cuts(member, part), *gathers],
            instance.push if member.incoming else _nothing,
            instance.step,
            instance.pull,
            self._outputs.fresh_of(member, "interval") if self._conserving else [],
            self._joins(member, part),
        )

    def _cuts(self, member: Member, part: int) -> list[Callable[[], Any]]:
        """Cutting what a member takes from slower ones, for the window that ends with this step."""
        cuts: list[Callable[[], Any]] = []
        for window in member.windows:
            slow = self._members[window.source].every
            if slow > member.every:
                parts = self._rates.window(member.every, slow)
                cut = Part(self._live, window.places, window.target, parts)
                cuts.append(partial(cut, part % slow // member.every))
        return cuts

    def _joins(self, member: Member, part: int) -> list[Callable[[], None]]:
        """Joining what a member gives to slower ones."""
        return [
            partial(whole, part % self._members[target].every // member.every)
            for (target, source), whole in self._whole.items() if source == member.name
        ]  # fmt: skip

    def _ends(self, done: list[Member]) -> list[Copy]:
        """What is shown at the end of a part, where the members `done` have come to the end of
        their windows."""
        if len(done) == len(self._members):
            return self._outputs.all_fresh()
        which: Literal["state", "all"] = "state" if self._conserving else "all"
        return [copy for member in done for copy in self._outputs.fresh_of(member, which)]


class Row:
    """A row of results of a step with inner steps: states of t_k, means over the whole step, and of
    another interval value the last."""

    def __init__(self, outputs: Outputs, members: Iterable[Member], rates: Rates) -> None:
        self.values = {kind: values.copy() for kind, values in outputs.live.items()}
        self._live, self._last = outputs.live, len(rates.parts) - 1
        self._intervals = [
            (kind, [s.index for s in outputs.slots if s.kind == kind and s.interval])
            for kind in outputs.live
        ]
        places = means(s for m in members if m.every == 1 for s in m.slots["Real"])
        real = outputs.live["Real"], self.values["Real"]
        self._whole = Whole(real[0], places, real[1], places, rates.parts)

    def begin(self) -> None:
        """Take the states of t_k."""
        for kind, values in self._live.items():
            self.values[kind][:] = values

    def add(self, i: int) -> None:
        """Take part i, when all have moved; the last one completes the row."""
        if i == self._last:
            for kind, places in self._intervals:
                self.values[kind][places] = self._live[kind][places]
        self._whole(i)


def _nothing() -> int:
    return 0
