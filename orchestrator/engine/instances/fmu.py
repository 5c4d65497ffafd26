"""An FMU as an instance: its library loaded once a process, its calls prepared once a run."""

from __future__ import annotations

import atexit
import ctypes
import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from desat.components.contract.block import Scalar

from ...files.fmu import description_of
from ...files.library import Fmu
from ...system.errors import DesatError, plain
from ...system.interface import KINDS, Kind, Signal
from ...system.model import Component
from .base import DTYPE, Array, Clock, ComponentError

# fmi2GetReal(c, references, n, values) and so on; fmi2DoStep(c, t, dt, no set state before)
_CALLS = (*(f"fmi2{verb}{kind}" for verb in ("Get", "Set") for kind in KINDS), "fmi2DoStep")
_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
_DISCARD = _STATUS.index("discard")


class _Library:
    """The loaded library of an FMU, for all its instances in this process."""

    def __init__(self, folder: Path, ours: bool) -> None:
        description = description_of(folder)
        self.once = description.coSimulation.canBeInstantiatedOnlyOncePerProcess
        self.instances = 0
        try:
            self.fmu = FMU2Slave(
                guid=description.guid,
                unzipDirectory=str(folder),
                modelIdentifier=description.coSimulation.modelIdentifier,
            )
        except Exception as error:  # fmpy raises plain Exception
            text = str(error).replace(f"{folder}/", "")
            raise DesatError(f"{description.modelName}: {text}") from error
        self.calls: dict[str, Any] = {}
        # Our FMUs never wait for another thread, so their calls may keep the GIL; a foreign FMU's
        # step might wait for a Python thread of its own. No argument types: what is passed is
        # ctypes objects already, which saves a third of a call. Unsigned: a status below 0, which
        # FMI does not know, is not ok.
        prototype = (ctypes.PYFUNCTYPE if ours else ctypes.CFUNCTYPE)(ctypes.c_uint)
        for name in _CALLS:
            address = ctypes.cast(self.fmu.dll[name], ctypes.c_void_p).value
            assert address is not None
            self.calls[name] = prototype(address)
        self.places: Any = None
        """Of our native FMUs: where values lie (fmi2.c)."""
        if ours and hasattr(self.fmu.dll, "desat_places"):
            self.places = self.fmu.dll.desat_places
            self.places.restype = ctypes.c_bool
        # pythonfmu's library must be told before the process ends, or it aborts
        finalise = getattr(self.fmu.dll, "finalizePythonInterpreter", None)
        if finalise is not None:
            atexit.register(finalise)


@cache
def _library(folder: Path, ours: bool) -> _Library:
    return _Library(folder, ours)


_listeners: dict[int, list[str]] = {}
"""Where the messages of each component environment go."""


def _log(
    environment: int | None, instance: bytes, status: int, category: bytes, message: bytes
) -> None:
    heard = _listeners.get(environment or 0)
    if heard is not None and status > 0 and len(heard) < 20:
        heard.append(plain((message or b"").decode(errors="replace").strip()))


@cache
def _callbacks() -> fmi2CallbackFunctions:
    """One logger for all: fmpy's proxy, which formats C messages, knows only the last one."""
    made = fmi2CallbackFunctions()
    made.logger = fmi2CallbackLoggerTYPE(_log)
    made.allocateMemory = defaultCallbacks.allocateMemory
    made.freeMemory = defaultCallbacks.freeMemory
    addLoggerProxy(ctypes.byref(made))
    return made


def _last(name: str, messages: Sequence[str]) -> str:
    said = messages[-1] if messages else ""
    return f": {said.removeprefix(f'{name}: ')}" if said else ""  # so our adapter begins


def failure(name: str, what: str, status: int, messages: Sequence[str]) -> ComponentError:
    """The error for a status, with what the component has said last."""
    of = _STATUS[status] if status < len(_STATUS) else str(ctypes.c_int(status).value)
    return ComponentError(f"{name}: {what} returned {of}{_last(name, messages)}")


class FmuInstance:
    """An FMI 2.0 co-simulation FMU."""

    def __init__(self, component: Component, fmu: Fmu) -> None:
        self.name, self.place = component.name, 0
        self._interface = fmu.interface
        self.messages: list[str] = []
        """What it has logged beside what is in order."""
        self.foreign, self._process = not fmu.interface.role, os.getpid()
        self._library = _library(fmu.folder, not self.foreign)
        if self._library.once and self._library.instances:
            raise DesatError(f"{self.name}: {fmu.path.name} allows one instance per process")
        self._before = ctypes.c_void_p()
        """Its state before a step that may be halved."""
        self._callbacks = fmi2CallbackFunctions()
        ctypes.pointer(self._callbacks)[0] = _callbacks()
        self._callbacks.componentEnvironment = id(self)
        _listeners[id(self)] = self.messages
        self._c = self._library.fmu.fmi2Instantiate(
            self.name.encode(), 1, self._library.fmu.guid.encode(),
            (fmu.folder / "resources").as_uri().encode(), ctypes.byref(self._callbacks), 0, 1,
        )  # fmt: skip
        self._back()
        if not self._c:
            raise ComponentError(f"{self.name}: cannot be instantiated{self._said()}")
        self._library.instances += 1

    def _said(self) -> str:
        return _last(self.name, self.messages)

    def failed(self, what: str, status: int) -> ComponentError:
        return failure(self.name, what, status, self.messages)

    def _call(self, name: str, *arguments: Any) -> None:
        try:
            getattr(self._library.fmu, name)(self._c, *arguments)
        except FMICallException as error:
            raise self.failed(name, error.status) from error
        finally:
            self._back()

    def _back(self, status: int = 0) -> int:
        """The status of a call that has come back; where the component has forked a process, and
        that comes back from the call, too, it ends here."""
        if self.foreign and os.getpid() != self._process:
            os._exit(0)
        return status

    def wire(
        self, inputs: dict[Kind, list[Signal]], outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array], clock: Clock,
    ) -> None:  # fmt: skip
        self.inputs = {k: np.zeros(len(inputs[k]), DTYPE[k]) for k in KINDS if inputs[k]}
        self._keep: list[Any] = [self.inputs, into]  # the calls hold bare addresses
        step = partial(
            self._library.calls["fmi2DoStep"],
            ctypes.c_void_p(self._c), clock.t, clock.dt, ctypes.c_int(1),
        )  # fmt: skip
        self.places = {"push": self._places(inputs), "pull": self._places(outputs)}
        """Of the calls that set and get, where the values lie in the FMU; None: unknown."""
        self.prepared = {
            "push": self._transfer("Set", inputs, self.inputs),
            "step": [step],
            "pull": self._transfer("Get", outputs, into),
        }
        """The calls of each verb, with their arguments."""
        self.push, self.step, self.pull = map(self._together, self.prepared.values())

    def halve(self, times: int) -> None:
        """Once wired: a step that is discarded is made anew from its state before, in 2, 4, …
        parts, `times` times at most."""
        t, dt, again = *self.prepared.pop("step")[0].args[1:3], ctypes.c_int(0)
        do, c, before = self._library.calls["fmi2DoStep"], ctypes.c_void_p(self._c), self._before

        def step() -> int:
            self._call("fmi2GetFMUstate", ctypes.byref(before))
            status: int = do(c, t, dt, again)
            for count in (2**n for n in range(1, times + 1)):
                if status != _DISCARD:
                    break
                self._call("fmi2SetFMUstate", before)
                part, status = dt.value / count, 0
                for i in range(count):
                    if status < _DISCARD:
                        at = ctypes.c_double(t.value + i * part)
                        status = max(status, do(c, at, ctypes.c_double(part), again))
                if status < _DISCARD and len(self.messages) < 20:
                    self.messages.append(f"the step from t = {t.value:g} s was discarded, and made "
                                         f"in {count} parts")  # fmt: skip
            return self._back(status)

        self.step = step

    def _transfer(
        self, verb: str, signals: dict[Kind, list[Signal]], arrays: dict[Kind, Array]
    ) -> list[partial[int]]:
        """One call per type that moves all values at once, its arguments prepared."""
        calls = []
        for kind in KINDS:
            if not (n := len(signals[kind])):
                continue
            references = (ctypes.c_uint * n)(*(s.reference for s in signals[kind]))
            self._keep.append(references)
            arguments = (
                ctypes.c_void_p(self._c), ctypes.c_void_p(ctypes.addressof(references)),
                ctypes.c_size_t(n), ctypes.c_void_p(arrays[kind].ctypes.data),
            )  # fmt: skip
            calls.append(partial(self._library.calls[f"fmi2{verb}{kind}"], *arguments))
        return calls

    def _places(self, signals: dict[Kind, list[Signal]]) -> list[tuple[str, Any] | None]:
        found: list[tuple[str, Any] | None] = []
        for kind in KINDS:
            if not (n := len(signals[kind])):
                continue
            references = (ctypes.c_uint * n)(*(s.reference for s in signals[kind]))
            places, find = (ctypes.c_void_p * n)(), self._library.places
            there = find is not None and find(
                ctypes.c_void_p(self._c), ctypes.c_char(kind[0].encode()), references,
                ctypes.c_size_t(n), places,
            )  # fmt: skip
            found.append((kind[0], places) if there else None)
        return found

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        by_kind: dict[str, list[tuple[Signal, Scalar]]] = {}
        for name, value in parameters.items():
            signal = self._interface.signals[name]
            by_kind.setdefault(signal.kind, []).append((signal, value))
        for kind, pairs in by_kind.items():
            n = len(pairs)
            element: Any = ctypes.c_double if kind == "Real" else ctypes.c_int
            references = (ctypes.c_uint * n)(*(s.reference for s, _ in pairs))
            values = (element * n)(*(v for _, v in pairs))
            status = self._back(self._library.calls[f"fmi2Set{kind}"](
                ctypes.c_void_p(self._c), references, ctypes.c_size_t(n), values
            ))  # fmt: skip
            if status > 1:
                raise self.failed(f"setting {pairs[0][0].name} …", status)
        self._call("fmi2SetupExperiment", 0, 0.0, start, 0, 0.0)
        self._call("fmi2EnterInitializationMode")

    def exit(self) -> None:
        self._call("fmi2ExitInitializationMode")
        fault = self._interface.signals.get("fault")
        if fault is not None and fault.kind == "Boolean" and fault.causality == "output":
            value, reference = ctypes.c_int(0), ctypes.c_uint(fault.reference)
            self._back(self._library.calls["fmi2GetBoolean"](
                ctypes.c_void_p(self._c), ctypes.byref(reference), ctypes.c_size_t(1),
                ctypes.byref(value),
            ))  # fmt: skip
            if value.value:
                raise ComponentError(f"{self.name}{self._said()}")

    def save(self) -> bytes:
        state = ctypes.c_void_p()
        self._call("fmi2GetFMUstate", ctypes.byref(state))
        try:
            size = ctypes.c_size_t()
            self._call("fmi2SerializedFMUstateSize", state, ctypes.byref(size))
            made = ctypes.create_string_buffer(size.value)
            self._call("fmi2SerializeFMUstate", state, made, size)
        finally:
            self._call("fmi2FreeFMUstate", ctypes.byref(state))
        return made.raw

    def restore(self, state: bytes) -> None:
        made = ctypes.c_void_p()
        given = ctypes.create_string_buffer(state, len(state))
        size = ctypes.c_size_t(len(state))
        self._call("fmi2DeSerializeFMUstate", given, size, ctypes.byref(made))
        try:
            self._call("fmi2SetFMUstate", made)
        finally:
            self._call("fmi2FreeFMUstate", ctypes.byref(made))

    def look(self) -> None:
        pass

    def close(self) -> None:
        if self._c:
            if self._before:
                self._library.fmu.fmi2FreeFMUstate(self._c, ctypes.byref(self._before))
            self._library.fmu.fmi2FreeInstance(self._c)
            self._library.instances -= 1
            self._back()
        self._c = None
        _listeners.pop(id(self), None)

    def _together(self, calls: list[partial[int]]) -> Callable[[], int]:
        """All calls as one, with the worst of their statuses."""
        if self.foreign:
            return lambda: self._back(max((call() for call in calls), default=0))
        return calls[0] if len(calls) == 1 else lambda: max((call() for call in calls), default=0)
