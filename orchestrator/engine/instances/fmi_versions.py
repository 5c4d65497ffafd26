"""Wrap the functions of FMI 1.0, 2.0 and 3.0 behind one interface, a class per version.

Each call is prepared once, with its arguments, in the form that Python uses and in the
form that the compiled loop uses. FMI 3.0 transfers whole arrays of many types. Where
its values do not correspond one by one to those of the master, they pass through a
buffer of the FMU's type.
"""

from __future__ import annotations

import ctypes
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from fmpy import fmi1
from fmpy.fmi1 import (
    FMICallException,
    FMU1Slave,
    fmi1CallbackFunctions,
    fmi1CallbackLoggerTYPE,
)
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import FMU3Slave, fmi3IntermediateUpdateCallback, fmi3LogMessageCallback
from fmpy.logging import addLoggerProxy

from desat.components.contract.block import Scalar

from ...system.errors import plain
from ...system.interface import KINDS, Interface, Signal
from ...system.model import Fmu
from .base import Array

Way = Literal["Set", "Get"]
NOT_COMPILED = ""  # code of what the compiled loop does not have
_DISCARD, _ERROR = 2, 3
# Tolerance of the end time that a step of FMI 3.0 reports, as a share of the step. An
# FMU that accumulates its time has the rounding of the sum: after 10^7 steps of 0.1 s,
# 0.002 of a step.
NEAR = 0.01
_INT32 = np.iinfo(np.int32)

# Messages of each component environment, by its number, and how often each came.
_listeners: dict[int, tuple[list[str], dict[str, int]]] = {}
MOST_MESSAGES = 20  # that are collected, each once


def listen(environment: int, messages: list[str], counts: dict[str, int]) -> None:
    """Collect the log messages of a component environment, and count them."""
    _listeners[environment] = messages, counts


def forget(environment: int) -> None:
    """Stop collecting the log messages of a component environment."""
    _listeners.pop(environment, None)


def _hear(environment: int | None, status: int, message: bytes | None) -> None:
    """Collect a log message that is not "ok"; one that came before is counted."""
    listener = _listeners.get(environment or 0)
    if listener is None or status <= 0:
        return
    messages, counts = listener
    text = plain((message or b"").decode(errors="replace").strip())
    if text in counts:
        counts[text] += 1
    elif len(messages) < MOST_MESSAGES:
        messages.append(text)
        counts[text] = 1


class Prepared(NamedTuple):
    """A prepared operation that transfers values or makes a step.

    It has two forms: a call for Python, and an operation of loop.c with its code, its
    number of values and its pointers.
    """

    call: Callable[[], int]
    code: str
    n: int
    pointers: tuple[Any, ...]


class FmiFunctions(ABC):
    """The FMI functions of one instance.

    `c` is the handle by which the FMU knows the instance.
    """

    prefix: ClassVar[str]
    state: ClassVar[str]
    """Suffix of the functions that get, set and free a state."""
    deserialise: ClassVar[str]
    slave: ClassVar[Any]
    names: ClassVar[tuple[str, ...]]
    """Functions that are called without fmpy, including those of a step."""
    reset: ClassVar[str]
    terminate: ClassVar[str]
    free: ClassVar[str]
    version: ClassVar[str]
    """Pattern of the FMI version that the library must report."""

    def __init__(
        self, fmu: Any, calls: Mapping[str, Any], interface: Interface
    ) -> None:
        self.fmu, self._calls, self._interface = fmu, calls, interface
        self.c: int | None = None

    @abstractmethod
    def instantiate(self, fmu: Fmu, name: str, environment: int) -> None:
        """Create the instance; `c` is None if that fails."""

    @abstractmethod
    def begin(self, start: float) -> Sequence[tuple[Any, ...]]:
        """Return the calls, with arguments, that begin initialisation at `start` s."""

    def end(self) -> tuple[Any, ...]:
        """Return the call that leaves initialisation mode, with its arguments."""
        return (f"{self.prefix}ExitInitializationMode",)

    @abstractmethod
    def moves(
        self, way: Way, signals: Sequence[Signal], values: Array
    ) -> list[Prepared]:
        """Prepare to set or get all variables of one kind at once.

        The values come from, or go to, an array in the order of the variables.
        """

    def texts(self, way: Way, signals: Sequence[Signal], values: Array) -> Prepared:
        """Prepare to set or get Strings, from or to an array of texts.

        The compiled loop has no such operation.
        """
        n, references = len(signals), _references([s.reference for s in signals])
        buffer = (ctypes.c_char_p * n)()
        function = getattr(self.fmu, f"{self.prefix}{way}String")
        counts = (n,) if self.prefix == "fmi3" else ()  # of the values

        def call() -> int:
            if way == "Set":
                buffer[:] = [text.encode() for text in values]
            try:
                status = function(self.c, references, n, buffer, *counts)
            except FMICallException as error:
                status = error.status
            if way == "Get" and not status > 1:
                values[:] = [(b or b"").decode(errors="replace") for b in buffer]
            return int(status) % (1 << 32)

        return Prepared(call, NOT_COMPILED, n, ())

    @abstractmethod
    def step(self, t: Any, dt: Any, no_state_before: int) -> Prepared:
        """Prepare a step from `t` over `dt`.

        Both are ctypes doubles, which are read when the step is made.
        """

    def note_values(self, parameters: Iterable[tuple[Signal, Scalar]]) -> None:
        """Record parameter values that `enter` sets."""
        del parameters  # only FMI 3.0 needs them

    def bytes(self, of: Any) -> Any:
        """Convert the buffer of a serialised state to the type that fmpy takes."""
        return of

    def explain_status(self, status: int) -> str:
        """Explain a failed status beyond what the FMU has logged; empty if unknown."""
        return ""

    @staticmethod
    def exported(name: str, identifier: str) -> str:
        """Return the name under which the library exports an FMI function."""
        return name

    def _function(self, name: str, *arguments: Any) -> Callable[[], int]:
        """Bind the arguments of an FMI function."""
        return partial(self._calls[name], *arguments)

    def _address(self, name: str) -> int:
        """Return the address of an FMI function."""
        return ctypes.cast(self._calls[name], ctypes.c_void_p).value or 0


def _references(numbers: Sequence[int]) -> Any:
    """Convert value references to a C array."""
    return (ctypes.c_uint * len(numbers))(*numbers)


# --- FMI 2.0 --------------------------------------------------------------------------


def _log_2(
    environment: int | None,
    instance: bytes,
    status: int,
    category: bytes,
    message: bytes,
) -> None:
    """Collect a log message of FMI 2.0."""
    _hear(environment, status, message)


@cache
def _callbacks() -> fmi2CallbackFunctions:
    """Create the callbacks that all instances share.

    There is one logger, because fmpy's proxy, which formats C messages, knows only the
    most recent one.
    """
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(_log_2)
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    addLoggerProxy(ctypes.byref(callbacks))
    return callbacks


_LAST_SUCCESSFUL_TIME, _TERMINATED = 2, 3  # of fmi2StatusKind


class Fmi2(FmiFunctions):
    """FMI 2.0: scalars of three types."""

    prefix, state, deserialise, slave = (
        "fmi2",
        "FMUstate",
        "fmi2DeSerializeFMUstate",
        FMU2Slave,
    )
    reset, terminate, free = "fmi2Reset", "fmi2Terminate", "fmi2FreeInstance"
    version = r"2\.0(\.\d+)?"
    # fmi2GetReal(c, references, n, values) and so on; fmi2DoStep(c, t, dt, no set state
    # before)
    names = (
        *(f"fmi2{way}{kind}" for way in ("Get", "Set") for kind in KINDS),
        "fmi2DoStep",
    )

    def instantiate(self, fmu: Fmu, name: str, environment: int) -> None:
        self._callbacks = fmi2CallbackFunctions()
        ctypes.pointer(self._callbacks)[0] = _callbacks()
        self._callbacks.componentEnvironment = environment
        self.c = self.fmu.fmi2Instantiate(
            name.encode(),
            1,
            self.fmu.guid.encode(),
            (fmu.folder / "resources").as_uri().encode(),
            ctypes.byref(self._callbacks),
            0,
            1,
        )

    def begin(self, start: float) -> Sequence[tuple[Any, ...]]:
        return (
            ("fmi2SetupExperiment", 0, 0.0, start, 0, 0.0),
            ("fmi2EnterInitializationMode",),
        )

    def moves(
        self, way: Way, signals: Sequence[Signal], values: Array
    ) -> list[Prepared]:
        n, references = len(signals), _references([s.reference for s in signals])
        name, data = f"{self.prefix}{way}{signals[0].kind}", values.ctypes.data
        call = self._function(
            name,
            ctypes.c_void_p(self.c),
            references,
            ctypes.c_size_t(n),
            ctypes.c_void_p(data),
        )
        pointers = (self._address(name), self.c, references, data)
        return [Prepared(call, "TRANSFER", n, pointers)]

    def step(self, t: Any, dt: Any, no_state_before: int) -> Prepared:
        c = ctypes.c_void_p(self.c)
        name = f"{self.prefix}DoStep"
        call = self._function(name, c, t, dt, ctypes.c_int(no_state_before))
        return Prepared(call, "STEP", 1, (self._address(name), self.c, t, dt))

    def explain_status(self, status: int) -> str:
        ended, last = ctypes.c_int(0), ctypes.c_double(math.nan)
        if (
            status != _DISCARD
            or not self._ask("Boolean", _TERMINATED, ended)
            or not ended.value
        ):
            return ""
        self._ask("Real", _LAST_SUCCESSFUL_TIME, last)
        return f"it asks for the end of the simulation at t = {last.value:g} s"

    def _ask(self, kind: str, of: int, answer: Any) -> bool:
        """Read a status value of the last step into `answer`.

        Return whether the FMU provides that status value.
        """
        function = self.fmu.dll[f"fmi2Get{kind}Status"]
        return function(ctypes.c_void_p(self.c), of, ctypes.byref(answer)) in (0, 1)


# --- FMI 3.0 --------------------------------------------------------------------------


def _log_3(
    environment: int | None, status: int, category: bytes, message: bytes
) -> None:
    """Collect a log message of FMI 3.0."""
    _hear(environment, status, message)


_logger_3 = fmi3LogMessageCallback(_log_3)

# FMI 3.0 types: suffix of the functions and dtype, in the order of TYPES in loop.c.
TYPES: dict[str, tuple[str, Any]] = {
    "Float32": ("Float32", np.float32),
    "Float64": ("Float64", np.float64),
    "Int8": ("Int8", np.int8),
    "Int16": ("Int16", np.int16),
    "Int32": ("Int32", np.int32),
    "Int64": ("Int64", np.int64),
    "UInt8": ("UInt8", np.uint8),
    "UInt16": ("UInt16", np.uint16),
    "UInt32": ("UInt32", np.uint32),
    "UInt64": ("UInt64", np.uint64),
    "Enumeration": ("Int64", np.int64),
    "Boolean": ("Boolean", np.bool_),
}
_CODES = list(dict.fromkeys(values for _, values in TYPES.values()))


class _Done(ctypes.Structure):
    """The outputs of fmi3DoStep besides its status, in the layout of loop.c."""

    _fields_ = (
        ("event", ctypes.c_bool),
        ("terminate", ctypes.c_bool),
        ("early", ctypes.c_bool),
        ("is_complete", ctypes.c_bool),
        ("last", ctypes.c_double),
    )


class Fmi3(FmiFunctions):
    """FMI 3.0: arrays and more types.

    Event mode, early return and intermediate update are not supported.
    """

    prefix, state, deserialise, slave = (
        "fmi3",
        "FMUState",
        "fmi3DeserializeFMUState",
        FMU3Slave,
    )
    reset, terminate, free = "fmi3Reset", "fmi3Terminate", "fmi3FreeInstance"
    version = r"3\.0(\.\d+)?"
    # fmi3GetFloat64(c, references, n, values, n values) and so on
    names = (
        *(
            f"fmi3{way}{name}"
            for way in ("Get", "Set")
            for name in dict.fromkeys(name for name, _ in TYPES.values())
        ),
        "fmi3DoStep",
    )

    def __init__(
        self, fmu: Any, calls: Mapping[str, Any], interface: Interface
    ) -> None:
        """Bind the functions of an FMU of FMI 3.0 and collect the elements of its arrays."""
        super().__init__(fmu, calls, interface)
        self._done = _Done(is_complete=True)
        # elements of each variable, by its value reference
        self._arrays: dict[int, list[Signal]] = {}
        for s in interface.signals.values():
            elements = self._arrays.setdefault(_key(s)[0], [])
            if s.element == len(elements):  # an alias has no elements of its own
                elements.append(s)
        self._values = {_key(s): s.start for a in self._arrays.values() for s in a}
        self._filled: list[tuple[Array, list[Signal]]] = []
        self._checked: list[tuple[list[Signal], Array, Array, tuple[float, float]]] = []

    def instantiate(self, fmu: Fmu, name: str, environment: int) -> None:
        resources = fmu.folder / "resources"
        self.c = self.fmu.fmi3InstantiateCoSimulation(
            name.encode(),
            self.fmu.guid.encode(),
            f"{resources}/".encode() if resources.is_dir() else None,
            False,
            True,
            False,
            False,
            None,
            0,
            ctypes.c_void_p(environment),
            _logger_3,
            fmi3IntermediateUpdateCallback(),
        )

    def begin(self, start: float) -> Sequence[tuple[Any, ...]]:
        return (("fmi3EnterInitializationMode", False, 0.0, start, False, 0.0),)

    def note_values(self, parameters: Iterable[tuple[Signal, Scalar]]) -> None:
        self._values |= {_key(s): value for s, value in parameters}
        for buffer, elements in self._filled:
            buffer[:] = self._start(elements, buffer.dtype)

    def moves(
        self, way: Way, signals: Sequence[Signal], values: Array
    ) -> list[Prepared]:
        by_type: dict[str, list[int]] = {}
        for i, s in enumerate(signals):
            by_type.setdefault(TYPES[s.type][0], []).append(i)
        return [
            transfer
            for name, indices in by_type.items()
            for transfer in self._of_type(way, name, signals, indices, values)
        ]

    def _of_type(
        self,
        way: Way,
        name: str,
        signals: Sequence[Signal],
        indices: list[int],
        values: Array,
    ) -> list[Prepared]:
        """Prepare the transfer of the variables of one type, with all elements of each.

        The transfer works in place if the elements correspond one by one to the values,
        and otherwise through a buffer.
        """
        selected = [signals[i] for i in indices]
        variables = list(dict.fromkeys(_key(s)[0] for s in selected))
        elements = [e for v in variables for e in self._arrays[v]]
        keys, of = [_key(e) for e in elements], dict(TYPES.values())[name]
        if values.dtype == of and keys == [_key(s) for s in signals]:
            return [self._call(way, name, variables, values)]
        buffer = self._start(elements, np.dtype(of))
        at = {key: i for i, key in enumerate(keys)}
        there = np.array([at[_key(s)] for s in selected], np.int64)
        here = np.array(indices, np.int64)
        call = self._call(way, name, variables, buffer)
        code, limits = _CODES.index(of), _range(buffer.dtype)
        if way == "Set":
            self._filled.append((buffer, elements))
            self._checked.append((selected, values, here, limits))
            typed = partial(_moved, values, here, buffer, there, limits)
            return [
                Prepared(
                    typed, "TO_TYPE", len(here), (buffer, there, values, here, code)
                ),
                call,
            ]
        self._checked.append((selected, buffer, there, limits))
        typed = partial(_moved, buffer, there, values, here, limits)
        return [
            call,
            Prepared(
                typed, "FROM_TYPE", len(here), (values, here, buffer, there, code)
            ),
        ]

    def _start(self, elements: Sequence[Signal], of: Any) -> Array:
        """Return the values that elements were given, or their start values.

        A value beyond the range of the type is clipped to it, because it is refused
        when it is set.
        """
        values = [self._values[_key(e)] or 0 for e in elements]
        if of.kind not in "fb":
            info = np.iinfo(of)
            values = [min(max(int(x), info.min), info.max) for x in values]
        return np.array(values, of)

    def _call(
        self, way: Way, name: str, variables: list[int], values: Array
    ) -> Prepared:
        """Prepare the FMI call that sets or gets whole variables of one type."""
        function, references = f"fmi3{way}{name}", _references(variables)
        n, size, data = len(variables), len(values), values.ctypes.data
        call = self._function(
            function,
            ctypes.c_void_p(self.c),
            references,
            ctypes.c_size_t(n),
            ctypes.c_void_p(data),
            ctypes.c_size_t(size),
        )
        pointers = (self._address(function), self.c, references, values, size)
        return Prepared(call, "TRANSFER_3", n, pointers)

    def step(self, t: Any, dt: Any, no_state_before: int) -> Prepared:
        """Prepare the call of fmi3DoStep from t over dt (s)."""
        done, c = self._done, ctypes.c_void_p(self.c)
        call = self._function(
            "fmi3DoStep",
            c,
            t,
            dt,
            ctypes.c_bool(bool(no_state_before)),
            *(
                ctypes.c_void_p(ctypes.addressof(done) + getattr(_Done, f).offset)
                for f in ("event", "terminate", "early", "last")
            ),
        )

        def step() -> int:
            done.event = done.terminate = done.early = False
            done.last = end = t.value + dt.value
            status = call()
            done.is_complete = status > 1 or abs(done.last - end) <= NEAR * dt.value
            other = done.terminate or done.early or done.event or not done.is_complete
            return _ERROR if status <= 1 and other else status

        return Prepared(
            step, "STEP_3", 1, (self._address("fmi3DoStep"), self.c, t, dt, done)
        )

    def bytes(self, of: Any) -> Any:
        return ctypes.cast(of, ctypes.POINTER(ctypes.c_uint8))

    def explain_status(self, status: int) -> str:
        """Explain why a step did not reach its end; empty if the status alone says it."""
        if self._done.terminate:
            return f"it asks for the end of the simulation at t = {self._done.last:g} s"
        if self._done.early:
            return (
                f"it returned early, at t = {self._done.last:g} s, which desat does not offer "
                "(earlyReturnAllowed is false)"
            )
        if self._done.event:
            return (
                f"it wants an event handled at t = {self._done.last:g} s, which desat does not "
                "offer (eventModeUsed is false)"
            )
        if not self._done.is_complete:
            return f"it says ok, but came to t = {self._done.last:g} s (lastSuccessfulTime)"
        for signals, values, index, (low, high) in self._checked:
            for s, x in zip(signals, values[index], strict=True):
                if x < low or x > high:
                    return f"{s.name} = {x} is beyond {low:.0f} to {high:.0f}"
        return ""


def _key(s: Signal) -> tuple[int, int]:
    """Return the value reference of a variable and the index of its element."""
    return s.reference - s.element, s.element


def _range(of: Any) -> tuple[float, float]:
    """Return the range of values that the FMU's type and the master's type share."""
    if of.kind in "fb":
        return -np.inf, np.inf
    info = np.iinfo(of)
    return float(max(info.min, _INT32.min)), float(min(info.max, _INT32.max))


def _moved(
    source: Array, at: Array, target: Array, to: Array, limits: tuple[float, float]
) -> int:
    """Copy values into an array of another type and return an FMI status."""
    values = source[at]
    if ((values < limits[0]) | (values > limits[1])).any():
        return _ERROR
    target[to] = values
    return 0


# --- FMI 1.0 --------------------------------------------------------------------------


@cache
def _callbacks_1() -> fmi1CallbackFunctions:
    """Create the callbacks of FMI 1.0, which share the logger of FMI 2.0."""
    callbacks = fmi1CallbackFunctions()
    callbacks.logger = ctypes.cast(
        _callbacks().logger, fmi1CallbackLoggerTYPE
    )  # it has the same arguments
    callbacks.allocateMemory = fmi1.defaultCallbacks.allocateMemory
    callbacks.freeMemory = fmi1.defaultCallbacks.freeMemory
    callbacks.stepFinished = None
    return callbacks


class Fmi1(Fmi2):
    """FMI 1.0: no initialisation mode, Booleans of one byte, no serialised state."""

    prefix, slave, reset = "fmi1", FMU1Slave, "fmi1ResetSlave"
    terminate, free = "fmi1TerminateSlave", "fmi1FreeSlaveInstance"
    version = r"1\.0"
    names = (
        *(f"fmi1{way}{kind}" for way in ("Get", "Set") for kind in KINDS),
        "fmi1DoStep",
        "fmi1InitializeSlave",
    )

    @staticmethod
    def exported(name: str, identifier: str) -> str:
        return f"{identifier}_{name.replace('fmi1', 'fmi')}"

    def instantiate(self, fmu: Fmu, name: str, environment: int) -> None:
        self.c = self.fmu.fmi1InstantiateSlave(
            name.encode(),
            self.fmu.guid.encode(),
            fmu.folder.as_uri().encode(),
            b"application/x-fmu-sharedlibrary",
            0.0,
            b"\0",
            b"\0",
            _callbacks_1(),
            b"\1",
        )
        if self.c and environment in _listeners:  # the FMU passes its own handle only
            listen(self.c, *_listeners[environment])

    def begin(self, start: float) -> Sequence[tuple[Any, ...]]:
        self._start = start
        return ()

    def end(self) -> tuple[Any, ...]:
        no = ctypes.c_char(0)
        return (
            "fmi1InitializeSlave",
            ctypes.c_double(self._start),
            no,
            ctypes.c_double(0.0),
        )

    def explain_status(self, status: int) -> str:
        return ""  # FMI 1.0 cannot report the end of a simulation

    def moves(
        self, way: Way, signals: Sequence[Signal], values: Array
    ) -> list[Prepared]:
        """Prepare the calls that set or get values; a Boolean of FMI 1.0 is one byte."""
        if signals[0].kind != "Boolean":
            return super().moves(way, signals, values)
        bytes_, every = np.zeros(len(signals), np.bool_), np.arange(len(signals))
        (call,) = super().moves(way, signals, bytes_)
        ends = (bytes_, values) if way == "Set" else (values, bytes_)
        code, limits = _CODES.index(np.bool_), (-np.inf, np.inf)
        typed = partial(_moved, ends[1], every, ends[0], every, limits)
        name = "TO_TYPE" if way == "Set" else "FROM_TYPE"
        moved = Prepared(
            typed, name, len(every), (ends[0], every, ends[1], every, code)
        )
        return [moved, call] if way == "Set" else [call, moved]


FMI_VERSIONS: dict[str, type[FmiFunctions]] = {"1.0": Fmi1, "2.0": Fmi2, "3.0": Fmi3}
