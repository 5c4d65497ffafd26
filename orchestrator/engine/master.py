"""Initialise a checked system and step it, in one of two time semantics.

t_k = start + k step, from an integer k.

- `gauss_seidel`: at t_k the state outputs of all components are exchanged. Then components step in
  the schedule's order, each with the interval outputs of those before it. A row of results holds
  the states at t_k and the interval values over [t_k, t_k+1).
- `jacobi`: all components step with constant inputs, then all outputs move, as in libcosim and
  Ecos. A row holds all outputs at its time.

Under `gauss_seidel` a step may have substeps, and components may be slower than the
master (`system/schedule.py`). `plan.py` prepares what happens in each part of a step.

All outputs are in one array per type, `live`. A step of a component gathers its inputs
from there, pushes, steps and pulls. A component whose outputs are all of the interval
class pulls straight into `live`. Any other pulls into `fresh`, from where its interval
outputs are copied at once and its state outputs when all have stepped.
"""

from __future__ import annotations

import weakref
from collections import defaultdict
from collections.abc import Callable, Collection
from functools import partial
from math import inf
from types import TracebackType
from typing import Any, Self, cast

import numpy as np

from ..system.choices import Algorithm
from ..system.errors import DesatError
from ..system.interface import KINDS, MOVED_KINDS, Kind, Signal
from ..system.model import Component, Connection, System, Values
from ..system.options import ALGORITHMS
from ..system.schedule import Schedule, StepRates, graded
from .algebraic_loop import AlgebraicLoop
from .current_call import (
    ENTER,
    EXIT,
    FREE,
    INSTANTIATE,
    PLACE,
    PULL,
    PUSH,
    TERMINATE,
    VERBS,
    time,
    word,
)
from .instances.base import (
    Array,
    ComponentError,
    EndedError,
    Instance,
    each,
    is_of_status,
    warn_of,
)
from .instances.block import BlockInstance
from .instances.fmu import FmuInstance
from .instances.isolated import IsolatedInstance
from .node import Node, Outputs, Slot, StepRecording
from .operations import Publish
from .plan import Plan

Rows = Callable[[int, dict[Kind, Array]], None]


def instance_for(component: Component) -> Instance:
    """Create the instance of a component: its FMU, or its bare block."""
    if component.fmu is None:
        return BlockInstance(component)
    return FmuInstance(component, component.fmu)


class Master:
    """A running system.

    Use it as a context manager: leaving it frees the components.

    Parameters
    ----------
    watched
        Function of component name and signal: whether the output is read although
        nothing is connected to it. By default all are.
    solve_loops
        Whether algebraic loops are solved at each communication point; at the start
        they always are.
    halvings
        Maximum number of times that a step which a foreign FMU discards is halved.
    isolated
        FMUs that run in processes of their own. Each of their calls may take
        `limit` s.
    recording
        Recorder of the values that reach a component. Its outputs must be watched.
    """

    def __init__(
        self,
        system: System,
        schedule: Schedule,
        *,
        algorithm: Algorithm = "gauss_seidel",
        solve_loops: bool = False,
        watched: Callable[[str, Signal], bool] = lambda component, signal: True,
        halvings: int = 0,
        isolated: Collection[str] = (),
        limit: float = inf,
        recording: StepRecording | None = None,
    ) -> None:
        """Make the instances of a system and plan their exchange in the schedule's order.

        `watched` selects the outputs whose values are kept, `limit` (s) ends a call that does
        not return, and `recording` keeps states at each substep. Raises DesatError if a
        component cannot be instantiated.
        """
        if algorithm not in ALGORITHMS:
            raise DesatError(f"algorithm {algorithm}: there is {', '.join(ALGORITHMS)}")
        self.system, self.schedule, self.algorithm = system, schedule, algorithm
        self._gauss_seidel = algorithm == "gauss_seidel"
        # offset of a row's number from that of its step
        self.ahead = int(not self._gauss_seidel)
        self.start, self.step_size, self.k = system.start, system.step, 0
        self.members: dict[str, Node] = {}
        # errors of components that ended their process when they were freed
        self.unfreed: list[EndedError] = []
        # a `MasterPool` keeps the master for another run, and closes it
        self.spared = False
        self._rates = schedule.rates
        if not self._gauss_seidel:
            every = {name: c.step_ratio for name, c in system.components.items()}
            self._rates = StepRates(graded(1), every, frozenset())
        try:
            places = {name: PLACE * i for i, name in enumerate(schedule.order)}
            for name in sorted(
                places, key=lambda n: n not in isolated
            ):  # isolated FMUs are forked before any other is loaded
                word[0], component = places[name] + INSTANTIATE, system.components[name]
                instance: Instance
                if name in isolated and component.fmu is not None:
                    instance = IsolatedInstance(component, component.fmu, limit)
                else:
                    instance = instance_for(component)
                instance.place = places[name]
                self.members[name] = self._member(component, instance, watched)
            self.members = {name: self.members[name] for name in schedule.order}
            self._outputs = Outputs(self.members.values())
            self._plan = Plan(
                self.members, self._outputs, self._rates, self._gauss_seidel
            )
            self._wire()
            for member in self.members.values() if halvings else ():
                foreign = not member.component.interface.role
                if foreign and isinstance(
                    member.instance, FmuInstance | IsolatedInstance
                ):
                    member.instance.halve(halvings)
            loops = {
                loop: AlgebraicLoop(
                    [self.members[name] for name in loop],
                    self._outputs.live,
                    self.shown,
                    self._judged,
                )
                for loop in {*schedule.loops, *schedule.start_loops}
            }
            self._start_loops = [loops[loop] for loop in schedule.start_loops]
            self._loops = [loops[loop] for loop in schedule.loops if solve_loops]
        except BaseException:
            self.close()
            raise
        self.slots, self.live = self._outputs.slots, self._outputs.live
        self._zeros = np.zeros(len(self.live["Real"]))
        self._planned(recording)

    def _planned(self, recording: StepRecording | None) -> None:
        """Plan the steps, with or without recording what reaches a component."""
        self._recording = recording
        if recording is not None:
            by_name = {(s.component, s.signal.name): s for s in self.slots}
            recording.wire(
                self.members, by_name, self.live["Real"], len(self._rates.parts)
            )
        self.cycle = self._plan.cycle(recording, self._loops)
        self.row = self._plan.row.values

    @property
    def renewable(self) -> bool:
        """Return whether the master can begin anew.

        All its components must be our own native FMUs in this process, which are known
        to start from a reset as they do when they are made.
        """
        instances = (member.instance for member in self.members.values())
        return all(isinstance(i, FmuInstance) and i.places_known for i in instances)

    def renew(self, system: System, recording: StepRecording | None) -> None:
        """Reset the master as if it were made anew, with other parameter values.

        `system` may differ from its own only in values of parameters. The master must
        be renewable.
        """
        self.system, self.k = system, 0
        for name, member in self.members.items():
            assert isinstance(member.instance, FmuInstance)
            member.component = system.components[name]
            word[0] = member.instance.place + INSTANTIATE
            member.instance.reset()
        for values in self.memory().values():
            values[...] = 0
        self._plan.rewind()
        if recording is not self._recording:
            self._planned(recording)

    def __enter__(self) -> Self:
        self._quiet = np.errstate(
            all="ignore"
        )  # the check for NaN and infinity may overflow
        self._quiet.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._quiet.__exit__(kind, error, trace)
        if not self.spared:
            self.close()

    def close(self) -> None:
        """Free all components."""
        for member in self.members.values():
            word[0] = member.instance.place + FREE
            try:
                member.instance.close()
            except EndedError as error:
                self.unfreed.append(error)
        word[0] = 0
        self.members.clear()

    @property
    def t(self) -> float:
        """Return the communication point t_k (s)."""
        return self.start + self.k * self.step_size

    # --- wiring -----------------------------------------------------------------------

    def _member(
        self,
        component: Component,
        instance: Instance,
        watched: Callable[[str, Signal], bool],
    ) -> Node:
        """Build the node of a component, with the outputs that are read from it."""
        name = component.name
        read = {c.output for c in self.system.connections if c.source == name}
        pairs = [(s.name, s.slope) for s in component.interface.outputs if s.slope]
        read |= {end for pair in pairs if read & set(pair) for end in pair}
        slots: dict[Kind, list[Slot]] = {kind: [] for kind in MOVED_KINDS}
        for s in component.interface.outputs:
            is_recorded = s.kind in KINDS and watched(name, s)
            if s.kind in MOVED_KINDS and (s.name in read or is_recorded):
                interval = self.schedule.classes[name, s.name] == "interval"
                slots[s.kind].append(Slot(name, s, s.kind, interval))
        for of_kind in slots.values():
            of_kind.sort(key=lambda slot: not slot.interval)
        every = self._rates.every[name]
        direct = (
            self._gauss_seidel
            and every == 1
            and all(slot.interval for of_kind in slots.values() for slot in of_kind)
        )
        return Node(component, instance, slots, every, name in self._rates.late, direct)

    def _wire(self) -> None:
        """Connect the inputs of all members and prepare their instances' calls."""
        clocks = self._plan.clocks(self.start, self.step_size)
        slots = {(s.component, s.signal.name): s for s in self._outputs.slots}
        incoming: dict[str, list[Connection]] = defaultdict(list)
        for c in self.system.connections:
            incoming[c.target].append(c)
        for name, member in self.members.items():
            signals = member.component.interface.signals
            order = {signal: i for i, signal in enumerate(signals)}
            for c in sorted(incoming[name], key=lambda c: order[c.input]):
                slot = slots[c.source, c.output]
                kind = cast("Kind", signals[c.input].kind)
                member.incoming.setdefault(kind, []).append((slot, c))
        self._plan.windows()
        for member in self.members.values():
            signals = member.component.interface.signals
            member.instance.wire(
                {
                    k: [signals[c.input] for _, c in member.incoming.get(k, ())]
                    for k in MOVED_KINDS
                },
                {k: [slot.signal for slot in member.slots[k]] for k in MOVED_KINDS},
                {k: self._outputs.home(member, k) for k in MOVED_KINDS},
                clocks[member.every],
            )

    def parameters(self, member: Node) -> Values:
        """Return a component's parameters.

        With substeps, a sample time of zero (a sample at every step) becomes the whole
        step.
        """
        values = member.component.parameters
        inner = len(self._rates.parts) > 1 and member.every == 1
        if not inner or "sample_time" not in member.component.interface.signals:
            return values
        return {
            **values,
            "sample_time": member.component.values["sample_time"] or self.step_size,
        }

    def home(self, member: Node, kind: Kind) -> Array:
        """Return the array into which a member pulls its outputs of a type."""
        return self._outputs.home(member, kind)

    def shown(self, member: Node) -> list[Publish]:
        """Prepare to publish all that a member has pulled."""
        return self._outputs.fresh_of(member, "all")

    def length(self, member: Node) -> float:
        """Return the length of a step of a member (s).

        For a member with substeps it is the length of the first one.
        """
        return self.step_size * self._rates.edge(member.every)

    # --- initialisation ---------------------------------------------------------------

    def initialise(self) -> None:
        """Set parameters and exchange in initialisation mode until nothing changes.

        Raises
        ------
        ComponentError
            If components cannot start, with a line for each.
        """
        members = self.members.values()
        time[0], start = self.start, self.start
        each(
            self._within(m, ENTER, partial(m.instance.enter, start, self.parameters(m)))
            for m in members
        )
        for member in members:
            self._pull(member)
        self._settle()
        each(self._within(m, EXIT, m.instance.exit) for m in members)
        for member in members:
            self._pull(member)
        self.check_finite()
        word[0] = 0

    def _within(
        self, member: Node, verb: int, call: Callable[[], None]
    ) -> Callable[[], None]:
        """Mark a call as in progress and return it."""
        word[0] = member.instance.place + verb
        return call

    def _settle(self) -> None:
        """Exchange values until nothing changes, and solve algebraic loops.

        Raises DesatError if the values do not settle.
        """
        gathers = {
            name: member.gathers(self.live, lambda slot: True, started=False)
            for name, member in self.members.items()
        }
        before: dict[Kind, Array] = {}
        for _ in range(len(self.members) + 2):
            before = {kind: values.copy() for kind, values in self.live.items()}
            for name, member in self.members.items():
                for gather in gathers[name]:
                    gather()
                if gathers[name]:
                    self._judged(member, PUSH, member.instance.push)
                self._pull(member)
            for loop in self._start_loops:
                loop.solve()
            if all(_same(before[kind], values) for kind, values in self.live.items()):
                return
        if self._start_loops and all(
            _close_to(before[kind], values) for kind, values in self.live.items()
        ):
            return
        changed = [
            slot
            for slot in self.slots
            if not _same(
                before[slot.kind][slot.index :][:1],
                self.live[slot.kind][slot.index :][:1],
            )
        ]
        names = ", ".join(
            dict.fromkeys(f"{s.component}.{s.signal.name}" for s in changed)
        )
        raise DesatError(
            f"{self.system.place}: initialisation does not settle: {names} keep changing"
        )

    def _pull(self, member: Node) -> None:
        """Read a component's outputs and publish them at once."""
        self._judged(member, PULL, member.instance.pull)
        for show in self.shown(member):
            show()

    def _judged(self, member: Node, verb: int, call: Callable[[], int]) -> None:
        """Make a call of a component.

        Raises ComponentError if its status is a failure.
        """
        word[0] = member.instance.place + verb
        if (status := call()) > 1:
            raise member.instance.failed(VERBS[verb], status)
        if status:
            warn_of(
                member.instance,
                VERBS[verb],
                f", the first time at t = {self.start:g} s",
            )

    # --- stepping ---------------------------------------------------------------------

    def advance(self, record: Rows | None = None) -> None:
        """Make one step.

        `record(k, outputs)` receives the row of this step, as the module's docstring
        defines it.
        """
        k, step = self.k, self.cycle[self.k % len(self.cycle)]
        for operation in step.before:
            operation(k)
        if record is not None:
            record(k + self.ahead, self.row)
        for operation in step.after:
            operation(k)
        word[0] = 0
        self.k = k + 1
        if (
            self.live["Real"].dot(self._zeros) != 0.0
        ):  # NaN or infinity times 0 is not 0
            self.check_finite()

    def terminate(self) -> None:
        """Tell all components that a simulation that has not failed is over.

        Raises ComponentError with a line for each that does not terminate.
        """
        each(
            self._within(m, TERMINATE, m.instance.terminate)
            for m in self.members.values()
        )
        word[0] = 0

    def memory(self) -> dict[str, Array]:
        """Return by name all arrays on which the next step depends.

        The master must be initialised. The contents may be saved and restored; the
        states of the components are saved separately.
        """
        state = self._plan.memory() | (
            {} if self._recording is None else self._recording.memory()
        )
        for kind in KINDS:
            state[f"live {kind}"] = self.live[kind]
            state[f"fresh {kind}"] = self._outputs.fresh[kind]
        for name, member in self.members.items():
            for kind, values in member.instance.inputs.items():
                state[f"inputs {kind} of {name}"] = values
        return state

    def messages(self) -> list[str]:
        """Return a line for each message that the components have logged.

        One that came more than once has its count.
        Lines for calls that returned a warning come after a component's own messages,
        so that the order is the same with either loop.
        """
        for member in self.members.values():
            member.instance.look()
        lines = [
            f"{name}: {text}{_times(member.instance.counts.get(text, 1))}"
            for name, member in self.members.items()
            for text in sorted(
                member.instance.messages, key=lambda m: m * is_of_status(m)
            )
        ]
        return list(dict.fromkeys(lines))

    def check_finite(self) -> None:
        """Raise ComponentError if an output is NaN or infinite."""
        for slot in self.slots:
            value = self.live[slot.kind][slot.index]
            if slot.kind != "String" and not np.isfinite(value):
                raise ComponentError(
                    f"{slot.component}.{slot.signal.name} = {value} at t = {self.t:g} s"
                )


def _times(count: int) -> str:
    """Return how often a message came, for its line; empty for once."""
    return f" ({count} times)" if count > 1 else ""


def _close_to(a: Array, b: Array) -> bool:
    """Return whether two arrays differ by what the solution of a loop may."""
    if a.dtype != np.float64:
        return _same(a, b)
    return bool(np.allclose(a, b, rtol=1e-8, atol=1e-8, equal_nan=True))


def _same(a: Array, b: Array) -> bool:
    """Return whether two arrays have the same bits, or the same texts."""
    return a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes()


class MasterPool:
    """Pool that keeps the master of a successful run for the next similar run.

    The runs may differ only in values of parameters. Making a master takes a third of a
    short run.
    """

    def __init__(self) -> None:
        self._key: Any = None
        self._masters: list[Master] = []
        weakref.finalize(self, _close, self._masters)

    def take(
        self,
        key: Any,
        system: System,
        recording: StepRecording | None,
        make: Callable[[], Master],
    ) -> Master:
        """Return the kept master, renewed, if it has this key; otherwise make one."""
        if not self._masters or self._key != key:
            _close(self._masters)
            self._key = key
            return make()
        master = self._masters.pop()
        master.spared = False
        try:
            master.renew(system, recording)
        except BaseException:
            master.close()
            raise
        return master

    def keep(self, master: Master) -> None:
        """Keep a master that was taken, if it can begin anew."""
        if master.renewable:
            master.spared = True
            self._masters.append(master)


def _close(masters: list[Master]) -> None:
    """Close all masters of a list and empty it."""
    while masters:
        masters.pop().close()
