"""Prepare, once, what a master does in each part of its steps.

A plan says which components step, with which calls.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Literal

import numpy as np

from ..system.schedule import StepRates
from .instances.base import Array, Clock
from .node import Node, Outputs, Slot, StepRecording, Window, means
from .operations import (
    Accumulate,
    Call,
    Gather,
    Length,
    Operation,
    OperationPart,
    Publish,
    Split,
    Step,
    Tick,
    WindowMean,
)


class Plan:
    """Plan of the steps of a cycle.

    Under `jacobi` (`gauss_seidel` false) no means are joined or cut: an output moves
    only when both its source and its target are due.
    """

    def __init__(
        self,
        members: dict[str, Node],
        outputs: Outputs,
        rates: StepRates,
        gauss_seidel: bool,
    ) -> None:
        self._members, self._outputs, self._rates = members, outputs, rates
        self._gauss_seidel = gauss_seidel

    def clocks(self, start: float, step: float) -> dict[int, Clock]:
        """Create a clock for each rate, from start and step (s)."""
        self._start, self._step = start, step
        inner = len(self._rates.parts)
        self._clocks = {
            m.every: Clock(start, step * self._rates.edge(m.every))
            for m in self._members.values()
        }
        self._lengths = [w * step for _, w in self._rates.parts] if inner > 1 else []
        return self._clocks

    def rewind(self) -> None:
        """Reset the clocks to the start."""
        for every, clock in self._clocks.items():
            clock.t.value, clock.dt.value = (
                self._start,
                self._step * self._rates.edge(every),
            )

    def windows(self) -> None:
        """Create for each member the windows of means from members of another rate."""
        if not self._gauss_seidel:
            return
        for member in self._members.values():
            sources = {slot.component for slot, _ in member.incoming.get("Real", ())}
            for name in sorted(sources):
                source = self._members[name]
                indices = {
                    s.index
                    for s, _ in member.incoming["Real"]
                    if s.component == name and s.kind == "Real"
                }
                places = means(source.slots["Real"], indices)
                if source.every != member.every and len(places.means):
                    member.windows.append(Window(name, places))
        self._outputs.make_room(w for m in self._members.values() for w in m.windows)

    def cycle(
        self,
        recording: StepRecording | None = None,
        loops: Sequence[Operation] = (),
    ) -> list[Step]:
        """Return the operations of each step of a cycle.

        With `recording`, the inputs and start values of a component are recorded. At
        the end of each step `loops` are solved.
        """
        inner = len(self._rates.parts)
        self._recording, self._loops = recording, loops
        self._windows = {
            (m.name, w.source): WindowMean(
                self._live,
                w.places,
                self._live,
                w.target,
                self._rates.window(self._members[w.source].every, m.every),
            )
            for m in self._members.values()
            for w in m.windows
            if self._members[w.source].every < m.every
        }
        self.row = RowOperation(self._outputs, self._members.values(), self._rates)
        return [self._one(step * inner, inner) for step in range(self._rates.cycle)]

    def memory(self) -> dict[str, Array]:
        """Return by name what outlives a step: clocks and incomplete windows."""
        state: dict[str, Array] = {}
        for every, clock in self._clocks.items():
            state[f"clock {every} t"] = np.frombuffer(memoryview(clock.t), np.float64)
            state[f"clock {every} dt"] = np.frombuffer(memoryview(clock.dt), np.float64)
        for (target, source), window in self._windows.items():
            state[f"mean {source} for {target}"] = window.mean
            state[f"slope {source} for {target}"] = window.slope
        return state

    @property
    def _live(self) -> Array:
        return self._outputs.live["Real"]

    def _one(self, first: int, inner: int) -> Step:
        """Plan the step that consists of `inner` parts, from part `first` on."""
        before, after = self.row.begin(), list[Operation]()
        for i in range(inner):
            moves = self._moves(first + i)
            if self._recording is not None:
                moves[:0] = self._recording.at_start(first + i)
                moves += self._recording.when_given(first + i)
            before += [*moves, *self.row.add(i)]
            last = i == inner - 1 and self._gauss_seidel
            (after if last else before).extend(self._ends(first + i))
        after += self._loops
        return Step(before, after)

    def _moves(self, part: int) -> list[Operation]:
        """Plan the clocks of a part and its members' operations in their order."""
        inner, fast = part % len(self._rates.parts), self._clocks.get(1)
        due = [clock.t for every, clock in self._clocks.items() if part % every == 0]
        tick = Tick(self._start, self._step, self._rates.parts[inner][0], due)
        moves: list[Operation] = [tick]
        if self._lengths and fast:
            moves.append(Length(fast.dt, self._lengths[inner]))
        for member in self._members.values():
            if member.late and part % member.every == 0:
                moves += self._sample(member)
            if member.steps_at(part):
                moves += self._move(member, part, tick)
        return moves

    def _sample(self, member: Node) -> list[Gather]:
        """Collect the inputs that belong at the start of a late member's window."""
        return member.gathers(
            self._outputs.live, lambda slot: not self._at_end(member, slot)
        )

    def _at_end(self, member: Node, slot: Slot) -> bool:
        """Return whether a late member takes an input at the end of its window.

        It does so for values over the window, which are known only there.
        """
        source = self._members[slot.component]
        return slot.interval and (
            (
                slot.kind == "Real"
                and slot.index in {int(i) for w in member.windows for i, _ in w.moved()}
            )
            or (source.every == member.every)
        )

    def _move(self, member: Node, part: int, tick: Tick) -> list[Operation]:
        """Plan a member's step.

        Its calls come in their order, followed by what it publishes at once and what it
        hands on to members of another rate.
        """
        instance, live = member.instance, self._outputs.live
        if member.late:
            gathers = member.gathers(live, lambda slot: self._at_end(member, slot))
        elif self._gauss_seidel:
            gathers = member.gathers(live, lambda slot: True)
        else:
            due = lambda slot: part % self._members[slot.component].every == 0  # noqa: E731
            gathers = member.gathers(live, due)
        return [
            *self._cuts(member, part),
            *gathers,
            *([Call.of(instance, "push", tick)] if member.incoming else []),
            Call.of(instance, "step", tick),
            Call.of(instance, "pull", tick),
            *(self._outputs.fresh_of(member, "interval") if self._gauss_seidel else []),
            *self._joins(member, part),
        ]

    def _cuts(self, member: Node, part: int) -> list[Split]:
        """Cut means of slower members for the window that ends with this step."""
        cuts = []
        for window in member.windows:
            slow = self._members[window.source].every
            if slow > member.every:
                parts = self._rates.window(member.every, slow)
                cut = OperationPart(self._live, window.places, window.target, parts)
                cuts.append(Split(cut, part % slow // member.every))
        return cuts

    def _joins(self, member: Node, part: int) -> list[Accumulate]:
        """Add a member's means to the windows of slower receivers."""
        return [
            Accumulate(window, part % self._members[target].every // member.every)
            for (target, source), window in self._windows.items()
            if source == member.name
        ]

    def _ends(self, part: int) -> list[Publish]:
        """Return the operations that publish outputs at the end of a substep.

        They are of the components whose own step ends there: all outputs, or with
        Gauss-Seidel the states alone, as interval outputs were handed on before.
        """
        members_done = [m for m in self._members.values() if (part + 1) % m.every == 0]
        if len(members_done) == len(self._members):
            return self._outputs.all_fresh()
        output_class: Literal["state", "all"] = "state" if self._gauss_seidel else "all"
        return [
            show
            for member in members_done
            for show in self._outputs.fresh_of(member, output_class)
        ]


class RowOperation:
    """A row of results.

    For a step with substeps it has the states at t_k, means over the whole step, and
    the last of other interval values. Otherwise it has the outputs as they are.
    """

    def __init__(
        self, outputs: Outputs, members: Iterable[Node], rates: StepRates
    ) -> None:
        """Prepare to gather a row: states at t_k, and intervals over the whole step."""
        self.values = self._live = outputs.live
        self._last = len(rates.parts) - 1
        if not self._last:
            return
        self.values = {kind: values.copy() for kind, values in outputs.live.items()}
        self._intervals: list[Operation] = []
        for kind in outputs.live:
            places = [s.index for s in outputs.slots if s.kind == kind and s.interval]
            index = np.array(places, np.intp)
            gather = Gather(kind, self._live[kind], self.values[kind], index, index)
            self._intervals += [gather] if places else []
        joined = means(s for m in members if m.every == 1 for s in m.slots["Real"])
        real = self._live["Real"], self.values["Real"]
        self._windows = WindowMean(real[0], joined, real[1], joined, rates.parts)

    def begin(self) -> list[Operation]:
        """Take the states at t_k."""
        if not self._last:
            return []
        return [
            Publish(self.values[kind], values)
            for kind, values in self._live.items()
            if len(values)
        ]

    def add(self, i: int) -> list[Operation]:
        """Take part i, when all have moved; the last part completes the row."""
        if not self._last:
            return []
        return [
            *(self._intervals if i == self._last else []),
            Accumulate(self._windows, i),
        ]
