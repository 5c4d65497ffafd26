"""Run an FMU as an instance.

Its library is loaded once per process, and its calls are prepared once per run.
"""

from __future__ import annotations

import atexit
import ctypes
import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from fmpy.fmi1 import FMICallException

from desat.components.contract.block import Scalar

from ...system.errors import DesatError, plain
from ...system.interface import MOVED_KINDS, Kind, Signal
from ...system.model import Component, Fmu
from .base import DTYPE, Array, Clock, ComponentError, blank, is_of_status, warn_of
from .fmi_versions import FMI_VERSIONS, FmiFunctions, Prepared, forget, listen

_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_DISCARD = _STATUS.index("discard")
# A status below 0, which fmpy accepts as ok, is taken modulo this and thus a failure.
_UNSIGNED = 1 << 32


class _Library:
    """Loaded library of an FMU, shared by all its instances in this process."""

    def __init__(self, fmu: Fmu, ours: bool, functions: type[FmiFunctions]) -> None:
        """Load the library of an FMU and bind its functions."""
        folder, description = fmu.folder, fmu.description
        self.once = description.coSimulation.canBeInstantiatedOnlyOncePerProcess
        self.instances = 0
        try:
            self.fmu = functions.slave(
                guid=description.guid,
                unzipDirectory=str(folder),
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
            # Our FMUs never wait for another thread, so their calls may keep the GIL. A
            # foreign FMU's step might wait for a Python thread of its own. Argument
            # types are not declared, because all arguments are ctypes objects already;
            # that saves a third of a call. The result is unsigned, so that a status
            # below 0, which FMI does not define, is not ok.
            prototype = (ctypes.PYFUNCTYPE if ours else ctypes.CFUNCTYPE)(ctypes.c_uint)
            self.calls: dict[str, Any] = {
                name: prototype(
                    ctypes.cast(self.fmu.dll[called], ctypes.c_void_p).value or 0
                )
                for name in functions.names
                if (called := functions.exported(name, self.fmu.modelIdentifier))
            }
        except Exception as error:  # fmpy raises plain Exception
            text = str(error).replace(f"{folder}/", "")
            raise DesatError(f"{description.modelName}: {text}") from error
        version = getattr(self.fmu, f"{functions.prefix}GetVersion")()
        self.version = plain((version or b"none").decode(errors="replace"))
        # finds the addresses of values in our native FMUs (fmi2.c)
        self.places: Any = None
        if ours and hasattr(self.fmu.dll, "desat_places"):
            self.places = self.fmu.dll.desat_places
            self.places.restype = ctypes.c_bool
        # pythonfmu's library aborts unless it is finalised before the process ends
        finalise = getattr(self.fmu.dll, "finalizePythonInterpreter", None)
        if finalise is not None:
            atexit.register(finalise)


_LIBRARIES: dict[tuple[Path, bool, str], _Library] = {}


def _library(fmu: Fmu, ours: bool) -> _Library:
    """Load the library of an FMU, once per process and folder."""
    fmi = fmu.interface.fmi
    key = fmu.folder, ours, fmi
    if key not in _LIBRARIES:
        _LIBRARIES[key] = _Library(fmu, ours, FMI_VERSIONS[fmi])
    return _LIBRARIES[key]


class Moves(NamedTuple):
    """The prepared transfer of all variables of one kind."""

    calls: list[Prepared]
    kind: str
    values: int  # address of the master's array
    places: Any  # addresses of the values in the FMU; None if unknown


def _last(name: str, messages: Sequence[str]) -> str:
    """Format the last message of a component, as the end of an error message."""
    message = next((text for text in reversed(messages) if not is_of_status(text)), "")
    return (
        f": {message.removeprefix(f'{name}: ')}" if message else ""
    )  # our adapter begins its messages with the name


def failure(
    name: str, call: str, status: int, messages: Sequence[str]
) -> ComponentError:
    """Build the error for a status, with the last message of the component."""
    of = _STATUS[status] if status < len(_STATUS) else str(ctypes.c_int(status).value)
    return ComponentError(f"{name}: {call} returned {of}{_last(name, messages)}")


class FmuInstance:
    """A co-simulation FMU of FMI 1.0, 2.0 or 3.0.

    Its `FmiFunctions` cover the differences between the versions.
    """

    def __init__(self, component: Component, fmu: Fmu) -> None:
        """Load the FMU of a component and instantiate it.

        Raises DesatError if it cannot be loaded or allows no further instance.
        """
        self.name, self.place = component.name, 0
        self._interface = component.interface
        self.messages: list[str] = []  # logged messages whose status is not ok
        self.counts: dict[str, int] = {}  # how often each was logged
        self.foreign, self._process = not fmu.interface.role, os.getpid()
        self._library = _library(fmu, not self.foreign)
        if self._library.once and self._library.instances:
            raise DesatError(
                f"{self.name}: {fmu.path.name} allows one instance per process"
            )
        functions = FMI_VERSIONS[fmu.interface.fmi]
        if not re.fullmatch(functions.version, self._library.version):
            called = functions.exported(f"{functions.prefix}GetVersion", "")
            raise DesatError(
                f"{self.name}: {fmu.path.name}: its library says that it is of FMI "
                f"{self._library.version} ({called}), its "
                f"modelDescription.xml of FMI {fmu.interface.fmi}: both must be the same"
            )
        self._functions = functions(
            self._library.fmu, self._library.calls, component.interface
        )
        self._before = ctypes.c_void_p()  # state before a step that may be halved
        listen(id(self), self.messages, self.counts)
        self._functions.instantiate(fmu, self.name, id(self))
        self._c = self._functions.c
        self._back()
        self._structural = {
            name: value
            for name, value in component.parameters.items()
            if component.interface.signals[name].causality == "structuralParameter"
        }
        if not self._c:
            raise ComponentError(
                f"{self.name}: cannot be instantiated{self._last_message()}"
            )
        self._library.instances += 1
        self._configure()

    def _last_message(self) -> str:
        """Format the last message that the FMU logged."""
        return _last(self.name, self.messages)

    def failed(self, call: str, status: int) -> ComponentError:
        self.note(status)
        return failure(self.name, call, status, self.messages)

    def note(self, status: int) -> None:
        """Add what is known about a failure beyond the FMU's log to the messages."""
        if (
            explanation := self._functions.explain_status(status)
        ) and explanation not in self.messages[-1:]:
            self.messages.append(explanation)

    def _call(self, name: str, *arguments: Any) -> None:
        """Call an FMI function and raise the error of its status."""
        try:
            if (function := self._library.calls.get(name)) is not None:
                status = function(ctypes.c_void_p(self._c), *arguments)
            else:
                status = (
                    getattr(self._library.fmu, name)(self._c, *arguments) % _UNSIGNED
                )
        except FMICallException as error:
            status = error.status
        finally:
            self._back()
        self._judge(name, status)

    def _judge(self, call: str, status: int) -> None:
        """Raise the error of a failed status, or record a warning."""
        if status > 1:
            raise self.failed(call, status)
        if status:
            warn_of(self, call)

    def _back(self, status: int = 0) -> int:
        """Return the status of a call that has come back.

        A process that the component forked during the call, and that returns from it as
        well, ends here.
        """
        if self.foreign and os.getpid() != self._process:
            os._exit(0)
        return status

    def wire(
        self,
        inputs: dict[Kind, list[Signal]],
        outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array],
        clock: Clock,
    ) -> None:
        self.inputs = {
            k: blank(k, len(inputs[k])) for k in MOVED_KINDS if inputs.get(k)
        }
        self._keep: list[Any] = [self.inputs, into]  # the calls hold bare addresses
        self._clock = clock
        self.prepared = {
            "push": self._moves("Set", inputs, self.inputs),
            "step": [Moves([self._functions.step(clock.t, clock.dt, 1)], "", 0, None)],
            "pull": self._moves("Get", outputs, into),
        }
        self.push, self.step, self.pull = map(self._together, self.prepared.values())

    def halve(self, times: int) -> None:
        """Repeat a discarded step from the state before it in 2, 4, … parts.

        The number of parts is doubled at most `times` times. Call it after `wire`.
        """
        del self.prepared["step"]
        t, dt, before = self._clock.t, self._clock.dt, self._before
        full_step = self._functions.step(t, dt, 0).call

        def step() -> int:
            """Make a step, in ever smaller parts if the FMU discards it."""
            self._state("Get", ctypes.byref(before))
            status = full_step()
            for count in (2**n for n in range(1, times + 1)):
                if status != _DISCARD:
                    break
                self._state("Set", before)
                part, status = dt.value / count, 0
                for i in range(count):
                    if status < _DISCARD:
                        at = ctypes.c_double(t.value + i * part)
                        outcome = self._functions.step(at, ctypes.c_double(part), 0)
                        status = max(status, outcome.call())
                if status < _DISCARD and len(self.messages) < 20:
                    self.messages.append(
                        f"the step from t = {t.value:g} s was discarded, and made "
                        f"in {count} parts"
                    )
            return self._back(status)

        self.step = step

    def _state(self, way: str, *arguments: Any) -> None:
        """Get, set or free a state."""
        self._call(f"{self._functions.prefix}{way}{self._functions.state}", *arguments)

    def _moves(
        self,
        way: Literal["Set", "Get"],
        signals: dict[Kind, list[Signal]],
        arrays: dict[Kind, Array],
    ) -> list[Moves]:
        """Prepare the transfer of all values, one for each type that occurs."""
        transfers = []
        for kind in MOVED_KINDS:
            if signals.get(kind):
                calls = self._moved(way, signals[kind], arrays[kind])
                data, places = arrays[kind].ctypes.data, self._places(signals[kind])
                transfers.append(Moves(calls, kind[0], data, places))
        return transfers

    def _moved(
        self, way: Literal["Set", "Get"], signals: list[Signal], values: Array
    ) -> list[Prepared]:
        """Prepare the transfer of the values of one kind."""
        if signals[0].kind == "String":
            return [self._functions.texts(way, signals, values)]
        return self._functions.moves(way, signals, values)

    def _places(self, signals: list[Signal]) -> Any:
        """Find the addresses of values in a native FMU of ours; None if unknown."""
        n, find = len(signals), self._library.places
        references, places = (
            (ctypes.c_uint * n)(*(s.reference for s in signals)),
            (ctypes.c_void_p * n)(),
        )
        there = find is not None and find(
            ctypes.c_void_p(self._c),
            ctypes.c_char(signals[0].kind[0].encode()),
            references,
            ctypes.c_size_t(n),
            places,
        )
        return places if there else None

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        start_values = [
            (self._interface.signals[name], value)
            for name, value in parameters.items()
            if name not in self._structural
        ]
        self._functions.note_values(start_values)
        self._set(start_values)
        for name, *arguments in self._functions.begin(start):
            self._call(name, *arguments)

    def _configure(self) -> None:
        """Set structural parameters, from which the lengths of arrays follow."""
        if self._structural:
            self._call("fmi3EnterConfigurationMode")
            signals = self._interface.signals
            self._set([(signals[name], x) for name, x in self._structural.items()])
            self._call("fmi3ExitConfigurationMode")

    def _set(self, start_values: Sequence[tuple[Signal, Scalar]]) -> None:
        """Set variables to their start values, a kind at a time."""
        for kind in dict.fromkeys(s.kind for s, _ in start_values):
            pairs = [(s, value) for s, value in start_values if s.kind == kind]
            for s, value in pairs:
                if kind == "Integer" and not -(1 << 31) <= value < 1 << 31:
                    raise ComponentError(
                        f"{self.name}: {s.name} = {value} is beyond 32 bits"
                    )
            values = np.array([value for _, value in pairs], DTYPE[kind])  # type: ignore[index]
            status = self._now("Set", [s for s, _ in pairs], values)
            self._judge(f"setting {pairs[0][0].name} …", status)

    def exit(self) -> None:
        name, *arguments = self._functions.end()
        self._call(name, *arguments)
        fault = self._interface.signals.get("fault")
        if (
            fault is not None
            and fault.kind == "Boolean"
            and fault.causality == "output"
        ):
            value = np.zeros(1, DTYPE["Boolean"])
            self._judge("reading fault", self._now("Get", [fault], value))
            if value[0]:
                raise ComponentError(f"{self.name}{self._last_message()}")

    def _now(
        self, way: Literal["Set", "Get"], signals: list[Signal], values: Array
    ) -> int:
        """Set or get variables of one kind once."""
        calls = self._moved(way, signals, values)
        return self._back(max(prepared.call() for prepared in calls))

    @property
    def places_known(self) -> bool:
        """Return whether this is one of our native FMUs (`places`)."""
        return self._library.places is not None

    def reset(self) -> None:
        """Return to the state after construction and wiring, except for the inputs."""
        self._call(self._functions.reset)
        self._configure()
        self.messages.clear()
        self.counts.clear()

    def save(self) -> bytes:
        """Return the state of the FMU as bytes."""
        state, of = ctypes.c_void_p(), self._functions
        self._state("Get", ctypes.byref(state))
        try:
            size = ctypes.c_size_t()
            self._call(
                f"{of.prefix}Serialized{of.state}Size", state, ctypes.byref(size)
            )
            buffer = ctypes.create_string_buffer(size.value)
            self._call(f"{of.prefix}Serialize{of.state}", state, of.bytes(buffer), size)
        finally:
            self._state("Free", ctypes.byref(state))
        return buffer.raw

    def restore(self, state: bytes) -> None:
        pointer = ctypes.c_void_p()
        buffer = ctypes.create_string_buffer(state, len(state))
        size = ctypes.c_size_t(len(state))
        self._call(
            self._functions.deserialise,
            self._functions.bytes(buffer),
            size,
            ctypes.byref(pointer),
        )
        try:
            self._state("Set", pointer)
        finally:
            self._state("Free", ctypes.byref(pointer))

    def look(self) -> None:
        pass

    def terminate(self) -> None:
        self._call(self._functions.terminate)

    def close(self) -> None:
        """Free the instance and its saved state."""
        if self._c:
            if self._before:
                self._state("Free", ctypes.byref(self._before))
            getattr(self._library.fmu, self._functions.free)(self._c)
            self._library.instances -= 1
            self._back()
            forget(self._c)
        self._c = None
        forget(id(self))

    def _together(self, moves: list[Moves]) -> Callable[[], int]:
        """Combine all calls into one that returns the worst of their statuses."""
        calls = [prepared.call for of in moves for prepared in of.calls]
        if self.foreign:
            return lambda: self._back(max((call() for call in calls), default=0))
        return (
            calls[0]
            if len(calls) == 1
            else lambda: max((call() for call in calls), default=0)
        )


def rows_of(
    component: Component,
    times: Sequence[float],
    outputs: Sequence[Signal],
    inputs: Sequence[Signal] = (),
    values: Array | None = None,
) -> Array | None:
    """Step a component's FMU through successive times (s).

    Returns its Real outputs (times, outputs).

    Without `inputs` the outputs are those at the times. With `inputs`, which have
    `values` (times, inputs), they are those of the step from each time to the next, and
    the last step is as long as the one before. None where a call fails.
    """
    assert component.fmu is not None
    clock = Clock(times[0], 0.0)
    into: dict[Kind, Array] = {"Real": np.zeros(len(outputs))}
    nothing: dict[Kind, list[Signal]] = {kind: [] for kind in MOVED_KINDS}
    rows = np.empty((len(times), len(outputs)))
    instance = FmuInstance(component, component.fmu)
    try:
        instance.wire(
            {**nothing, "Real": list(inputs)},
            {**nothing, "Real": list(outputs)},
            into,
            clock,
        )
        instance.enter(times[0], component.parameters)
        instance.exit()
        for k, t in enumerate(times):
            if values is None:
                clock.dt.value = t - clock.t.value
                failed = (k > 0 and instance.step() > 1) or instance.pull() > 1
                clock.t.value = t
            else:
                clock.t.value = t
                if k + 1 < len(times):
                    clock.dt.value = times[k + 1] - t
                instance.inputs["Real"][:] = values[k]
                failed = instance.push() > 1 or instance.step() > 1
                failed = failed or instance.pull() > 1
            if failed:
                return None
            rows[k] = into["Real"]
    except ComponentError:
        return None
    finally:
        instance.close()
    return rows
