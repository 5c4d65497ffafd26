"""The master: initialises a checked system and steps it, in one of two time semantics.

t_k = start + k step, from an integer k.

- `conserving`: at t_k the state outputs of all are exchanged; then components step in the
  schedule's order, each with the interval outputs of those before it. A row of results holds the
  states at t_k and the interval values over [t_k, t_k+1).
- `jacobi`: all step with held inputs, then all outputs move, as in libcosim and Ecos; a row holds
  all outputs at its time.

All outputs live in one array per type, `live`. A step of a component is: gather its inputs from
there, push, step, pull. A component whose outputs are all of the interval class pulls straight
into `live`; any other pulls into `fresh`, from where its interval outputs follow at once and its
state outputs when all have stepped.
"""

from __future__ import annotations

import ctypes
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from math import lcm
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from ..system.errors import DesatError
from ..system.interface import KINDS, Interface, Kind, Signal
from ..system.model import Connection, System
from ..system.schedule import Schedule
from .instances import DTYPE, Unit, UnitError, unit_for

Algorithm = Literal["conserving", "jacobi"]
ALGORITHMS: tuple[Algorithm, ...] = ("conserving", "jacobi")
Array = NDArray[Any]


@dataclass
class Slot:
    """An output that is read, and its place in the array of its type."""

    component: str
    signal: Signal
    kind: Kind
    interval: bool
    index: int = -1


_Copy = tuple[Array, Array]
_Call = Callable[[], int]
# unit, gathers, push, step, pull, copies
_Move = tuple[Unit, list[Callable[[], Any]], _Call, _Call, _Call, list[_Copy]]


class Master:
    """A running system. Use it as a context manager: leaving it frees the components.

    `watched` chooses the outputs that are read although nothing is connected to them:
    a function of component name and signal; default all.
    """

    def __init__(
        self,
        system: System,
        schedule: Schedule,
        *,
        algorithm: Algorithm = "conserving",
        blocks: bool = False,
        watched: Callable[[str, Signal], bool] = lambda component, signal: True,
    ) -> None:
        if algorithm not in ALGORITHMS:
            raise DesatError(f"algorithm {algorithm}: there is {', '.join(ALGORITHMS)}")
        assert system.step is not None
        self.system, self.schedule, self.algorithm = system, schedule, algorithm
        self.start, self.step_size, self.k = system.start, system.step, 0
        self.units: dict[str, Unit] = {}
        self.slots: list[Slot] = []
        self._clock = ctypes.c_double(self.start)
        self._decimation = {c.name: c.decimation for c in system.components.values()}
        try:
            for name in schedule.order:
                self.units[name] = unit_for(system.components[name], blocks)
            self._wire(watched)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        self._quiet = np.errstate(all="ignore")  # the check for NaN and infinity overflows
        self._quiet.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._quiet.__exit__(kind, error, trace)
        self.close()

    def close(self) -> None:
        """Free all components."""
        for unit in self.units.values():
            unit.close()
        self.units.clear()

    @property
    def t(self) -> float:
        """The communication point t_k (s)."""
        return self.start + self.k * self.step_size

    # --- wiring -------------------------------------------------------------------------------

    def _wire(self, watched: Callable[[str, Signal], bool]) -> None:
        incoming: dict[str, list[Connection]] = defaultdict(list)
        used = set()
        for c in self.system.connections:
            incoming[c.target].append(c)
            used.add((c.source, c.output))
        outputs: dict[str, dict[Kind, list[Slot]]] = {}
        for name in self.schedule.order:
            read = [
                s for s in self._signals(name, "output")
                if s.kind in KINDS and ((name, s.name) in used or watched(name, s))
            ]  # fmt: skip
            outputs[name] = {
                k: self._slots(name, k, [s for s in read if s.kind == k]) for k in KINDS
            }
        self._allocate(outputs)
        position = {(s.component, s.signal.name): s for s in self.slots}
        self._incoming: dict[str, dict[Kind, list[tuple[int, Connection]]]] = {}
        for name, unit in self.units.items():
            order = {s.name: i for i, s in enumerate(self._signals(name, "input"))}
            by_kind: dict[Kind, list[Connection]] = {k: [] for k in KINDS}
            for c in sorted(incoming[name], key=lambda c: order[c.input]):
                by_kind[position[c.source, c.output].kind].append(c)
            signals = self._interface(name).signals
            unit.wire(
                {k: [signals[c.input] for c in by_kind[k]] for k in KINDS},
                {k: [s.signal for s in outputs[name][k]] for k in KINDS},
                {k: self._home(name, k)[self._segments[name, k]] for k in KINDS},
                self._clock,
                self._decimation[name] * self.step_size,
            )
            self._incoming[name] = {
                kind: [(position[c.source, c.output].index, c) for c in connections]
                for kind, connections in by_kind.items() if connections
            }  # fmt: skip

    def _interface(self, name: str) -> Interface:
        interface = self.system.components[name].interface
        assert interface is not None, "check the system first"
        return interface

    def _signals(self, name: str, causality: str) -> list[Signal]:
        return list(self._interface(name).of(causality))

    def _slots(self, name: str, kind: Kind, signals: list[Signal]) -> list[Slot]:
        """The outputs of one type of a component, interval class first, not yet placed."""
        slots = [
            Slot(name, s, kind, self.schedule.classes[name, s.name] == "interval")
            for s in signals
        ]  # fmt: skip
        return sorted(slots, key=lambda s: not s.interval)

    def _allocate(self, outputs: dict[str, dict[Kind, list[Slot]]]) -> None:
        """Place all outputs: components that pull into `fresh` first, in one piece."""
        self._segments: dict[tuple[str, Kind], slice] = {}
        self._middle: dict[tuple[str, Kind], int] = {}
        self._fresh_until: dict[Kind, int] = {}
        self.live: dict[Kind, Array] = {}
        self._fresh: dict[Kind, Array] = {}
        self._direct = {
            name for name, of_kind in outputs.items()
            if self.algorithm == "conserving"
            and self._decimation[name] == 1
            and all(s.interval for slots in of_kind.values() for s in slots)
        }  # fmt: skip
        for kind in KINDS:
            count = 0
            self._fresh_until[kind] = 0
            for name in sorted(outputs, key=lambda n: n in self._direct):
                slots = outputs[name][kind]
                first = count
                for slot in slots:
                    slot.index = count
                    count += 1
                self.slots += slots
                self._segments[name, kind] = slice(first, count)
                self._middle[name, kind] = first + sum(s.interval for s in slots)
                if name not in self._direct:
                    self._fresh_until[kind] = count
            self.live[kind] = np.zeros(count, DTYPE[kind])
            self._fresh[kind] = np.zeros(count, DTYPE[kind])
        self._zeros = np.zeros(len(self.live["Real"]))

    def _home(self, name: str, kind: Kind) -> Array:
        """The array that a component pulls into."""
        return self.live[kind] if name in self._direct else self._fresh[kind]

    def _gathers(self, name: str, phase: int) -> list[Callable[[], Any]]:
        """Functions that collect a unit's inputs, one a type, from the live outputs.

        Under `jacobi` an output moves only when its source and its target are both due.
        """
        functions = []
        for kind, incoming in self._incoming[name].items():
            moving = [
                (i, index, c) for i, (index, c) in enumerate(incoming)
                if self.algorithm == "conserving" or phase % self._decimation[c.source] == 0
            ]  # fmt: skip
            if moving:
                target = self.units[name].inputs[kind]
                functions.append(_gather(self.live[kind], target, moving))
        return functions

    # --- initialisation -----------------------------------------------------------------------

    def initialise(self) -> None:
        """Set parameters and exchange in initialisation mode until nothing changes.

        Raises UnitError with a line for each component that cannot start.
        """
        _each(
            partial(unit.enter, self.start, self.system.components[name].parameters)
            for name, unit in self.units.items()
        )
        gathers = {name: self._gathers(name, 0) for name in self.units}
        for name in self.units:
            self._pull(name)
        for _ in range(len(self.units) + 2):
            before = {kind: values.copy() for kind, values in self.live.items()}
            for name, unit in self.units.items():
                for gather in gathers[name]:
                    gather()
                if gathers[name] and (status := unit.push()) > 1:
                    raise unit.failed("setting its inputs", status)
                self._pull(name)
            changed = [
                slot for slot in self.slots
                if before[slot.kind][slot.index].tobytes()
                != self.live[slot.kind][slot.index].tobytes()
            ]  # fmt: skip
            if not changed:
                break
        else:
            names = ", ".join(dict.fromkeys(f"{s.component}.{s.signal.name}" for s in changed))
            raise DesatError(
                f"{self.system.where}: initialisation does not settle: {names} keep changing"
            )
        _each(unit.exit for unit in self.units.values())
        for name in self.units:
            self._pull(name)
        self._check_finite()
        self._plan()

    def _pull(self, name: str) -> None:
        """Read a component's outputs and show them at once."""
        unit = self.units[name]
        if (status := unit.pull()) > 1:
            raise unit.failed("reading its outputs", status)
        for kind in KINDS:
            segment = self._segments[name, kind]
            self.live[kind][segment] = self._home(name, kind)[segment]

    # --- stepping -----------------------------------------------------------------------------

    def _plan(self) -> None:
        """Prepare what each step of the cycle of decimations does, and in which order."""
        self._cycle: list[tuple[list[_Move], list[_Copy]]] = []
        for phase in range(lcm(*self._decimation.values())):
            moves = [
                self._move(name, phase) for name in self.units
                if phase % self._decimation[name] == 0
            ]  # fmt: skip
            done = [n for n in self.units if (phase + 1) % self._decimation[n] == 0]
            self._cycle.append((moves, self._ends(done)))

    def _move(self, name: str, phase: int) -> _Move:
        unit = self.units[name]
        copies = []
        if self.algorithm == "conserving" and name not in self._direct:
            for kind in KINDS:
                part = slice(self._segments[name, kind].start, self._middle[name, kind])
                if part.stop > part.start:
                    copies.append((self.live[kind][part], self._fresh[kind][part]))
        gathers = self._gathers(name, phase)
        push = unit.push if self._incoming[name] else _nothing
        return unit, gathers, push, unit.step, unit.pull, copies

    def _ends(self, done: list[str]) -> list[_Copy]:
        """(live, fresh) pieces that become visible at the end of a step."""
        if len(done) == len(self.units):
            parts = [(kind, slice(0, self._fresh_until[kind])) for kind in KINDS]
        else:
            first = self._middle if self.algorithm == "conserving" else None
            parts = [
                (kind, slice(first[n, kind] if first else self._segments[n, kind].start,
                             self._segments[n, kind].stop))
                for n in done if n not in self._direct for kind in KINDS
            ]  # fmt: skip
        return [(self.live[k][p], self._fresh[k][p]) for k, p in parts if p.stop > p.start]

    def advance(self, record: Callable[[int, dict[Kind, Array]], None] | None = None) -> None:
        """One step. `record(k, outputs)` sees the row of this step: see the module's text."""
        k = self.k
        t = self.start + k * self.step_size
        self._clock.value = t
        moves, ends = self._cycle[k % len(self._cycle)]
        for unit, gathers, push, step, pull, copies in moves:
            for gather in gathers:
                gather()
            if (status := push()) > 1:
                raise unit.failed(f"setting its inputs at t = {t:g} s", status)
            if (status := step()) > 1:
                raise unit.failed(f"the step from t = {t:g} s", status)
            if (status := pull()) > 1:
                raise unit.failed(f"reading its outputs after t = {t:g} s", status)
            for live, fresh in copies:
                live[:] = fresh
        if record is not None and self.algorithm == "conserving":
            record(k, self.live)
        for live, fresh in ends:
            live[:] = fresh
        self.k = k + 1
        if record is not None and self.algorithm == "jacobi":
            record(k + 1, self.live)
        if self.live["Real"].dot(self._zeros) != 0.0:  # NaN or infinity times 0 is not 0
            self._check_finite()

    def _check_finite(self) -> None:
        for slot in self.slots:
            value = self.live[slot.kind][slot.index]
            if not np.isfinite(value):
                raise UnitError(
                    f"{slot.component}.{slot.signal.name} = {value} at t = {self.t:g} s"
                )


def _each(calls: Iterable[Callable[[], None]]) -> None:
    """Make all calls. Raises UnitError with what all of those said that failed."""
    failures = []
    for call in calls:
        try:
            call()
        except UnitError as error:
            failures.append(str(error))
    if failures:
        raise UnitError("\n".join(failures))


def _nothing() -> int:
    return 0


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
