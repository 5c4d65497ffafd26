"""Adapt a block to FMI 2.0: everything between pythonfmu and any block.

An FMU carries this file, the block and the modules that the block imports, in a package
of a name of its own. Nothing here depends on what a block computes, and no block refers
to this file.

Noise is keyed by the name of the instance. A master that names instances differently
from the system's components gets other streams with the same statistics.

Two rules of pythonfmu's library shape this file. An exception that leaves an entry
point would end the host, so none does: it becomes a log message, the output `fault`,
and `do_step` returns False. Each instantiation releases the globals of the entry module
once too often, so each instance adds a reference.
"""

from __future__ import annotations

import math
import re
import struct
import sys
import traceback
from pathlib import Path
from typing import Any, ClassVar

from pythonfmu.enums import Fmi2Status
from pythonfmu.fmi2slave import Fmi2Slave

_PINNED: list[Any] = []

# phases of an instance
_INSTANTIATED, _INITIALISING, _STEPPING, _TERMINATED = range(4)

# value references, access to these values, whether a parameter is among them
_Selection = tuple[list[int], Any, bool]


class Slave(Fmi2Slave):  # type: ignore[misc]
    """A block behind FMI.

    The entry script of an FMU derives from it and sets `block_class`.
    """

    block_class: ClassVar[Any]

    def __init__(self, **kwargs: Any) -> None:
        """Create the block at its start values, before initialisation."""
        super().__init__(**kwargs)
        _PINNED.append(vars(sys.modules[type(self).__module__]))
        self.modelName = self.model_identifier()
        self._block = self.block_class()
        self._block.instance = _name(self.instance_name)
        self._values = vars(self._block)
        self._scalars = self._block.scalars()
        self._phase = _INSTANTIATED
        self._time = 0.0
        self._stop = math.inf
        self._set_starts()
        self._start_failed = False  # start() has failed, and nothing else
        self._stale = False  # inputs or parameters changed since the last start()
        # the last selection read and written of each type: masters repeat themselves
        nothing: _Selection = ([], self._block.access([]), False)
        self._reading = {"Real": nothing, "Integer": nothing, "Boolean": nothing}
        self._writing = dict(self._reading)

    def _set_starts(self) -> None:
        """Set the start values of a copy (`fmus/starts.py`), which are in a file."""
        try:
            text = Path(self.resources, "start.txt").read_text(encoding="utf-8")
        except (OSError, TypeError):  # there is none
            return
        for line in text.splitlines()[3:]:
            kind, reference, number = line.split()
            value: Any = int(number, 16 if kind == "R" else 10)
            if kind == "R":  # the bits of the number
                (value,) = struct.unpack(">d", value.to_bytes(8, "big"))
            value = bool(value) if kind == "B" else value
            self._block.access([int(reference)]).write([value])

    def model_identifier(self) -> str:
        """Return the FMU's name; the entry script overrides it."""
        return type(self).__name__

    # --- failures ---------------------------------------------------------------------

    def _fail(self, message: str, error: BaseException | str) -> None:
        """Set `fault` and log an error."""
        self._block.fault = True
        text = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
        frames = traceback.extract_tb(getattr(error, "__traceback__", None))
        if frames and type(error).__name__ != "BlockError":  # a bug: say where
            text = f"{Path(frames[-1].filename).name}:{frames[-1].lineno}: {text}"
        self.log(f"{self.instance_name}: {message}: {text}", Fmi2Status.error)

    # --- life -------------------------------------------------------------------------

    def setup_experiment(
        self, start_time: float, stop_time: Any, tolerance: Any
    ) -> None:
        """Set the start and stop time (s); None: there is no stop."""
        if self._phase != _INSTANTIATED:
            self._fail("set up the experiment", RuntimeError("it has begun"))
            return
        stop = math.inf if stop_time is None else stop_time
        if not math.isfinite(start_time):
            reason = f"a start at t = {start_time} s"
        elif not start_time <= stop:
            reason = f"a stop at t = {stop} s, with a start at t = {start_time} s"
        else:
            self._time, self._stop = start_time, stop
            return
        self._fail("set up the experiment", RuntimeError(reason))

    def enter_initialization_mode(self) -> None:
        """Enter initialisation mode."""
        if self._phase != _INSTANTIATED:
            self._fail("enter initialisation", RuntimeError("it was entered before"))
            return
        self._phase = _INITIALISING
        self._stale = True

    def exit_initialization_mode(self) -> None:
        """Compute the outputs at the start and enter step mode."""
        self._stale = self._stale or self._start_failed
        self._refresh(ends=True)
        self._phase = _STEPPING

    def terminate(self) -> None:
        """End the simulation; a second call fails."""
        if self._phase == _TERMINATED:
            self._fail("terminate", RuntimeError("it was before"))
        self._phase = _TERMINATED

    def _refresh(self, ends: bool = False) -> None:
        """Update the outputs in initialisation mode from inputs and parameters.

        A failing start is logged only when the mode ends, because inputs may arrive
        until then.
        """
        if not self._stale or self._phase != _INITIALISING:
            return
        self._stale = False
        if self._start_failed:  # the inputs may be complete by now
            self._block.fault = self._start_failed = False
        try:
            self._block.check()
            self._block.start()
            self._block.output(self._time)
        except BaseException as error:
            self._start_failed = not self._block.fault
            self._block.fault = True
            if ends:
                self._fail("start", error)

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Advance the block by `step_size` (s); return False where that fails."""
        if self._block.fault:
            return False
        try:
            if self._phase != _STEPPING:
                raise RuntimeError("a step outside step mode")
            if not 0.0 < step_size < math.inf:
                raise RuntimeError(f"a step of {step_size} s")
            if not abs(current_time - self._time) <= 1e-6 * step_size:
                raise RuntimeError(
                    f"a step from t = {current_time} s, but it is {self._time} s"
                )
            if current_time + step_size > self._stop + 1e-6 * step_size:
                raise RuntimeError(
                    f"a step to t = {current_time + step_size} s, beyond the stop at t = "
                    f"{self._stop} s"
                )
            block = self._block
            block.advance(current_time, step_size)
            self._time = end = current_time + step_size
            block.output(end)
            return True
        except BaseException as error:
            self._fail(f"step from t = {current_time} s", error)
            return False

    # --- values -----------------------------------------------------------------------

    def _select(self, vrs: list[int], kind: str) -> _Selection:
        """Return access to variables of one type, or raise TypeError."""
        variables = [self._scalars[vr][0] for vr in vrs]
        for vr, variable in zip(vrs, variables, strict=True):
            if variable.type != kind:
                raise TypeError(f"value reference {vr} ({variable.name}) is not {kind}")
        return (
            vrs,
            self._block.access(vrs),
            any(v.causality == "parameter" for v in variables),
        )

    def _get(self, vrs: list[int], kind: str, fallback: Any) -> list[Any]:
        """Return values, or `fallback` for each where reading fails."""
        try:
            if self._stale:
                self._refresh()
            last_vrs, access, _ = self._reading[kind]
            if vrs != last_vrs:
                self._reading[kind] = _, access, _ = self._select(vrs, kind)
            return access.read()  # type: ignore[no-any-return]
        except BaseException as error:
            self._fail(f"get {kind}", error)
            return [fallback] * len(vrs)

    def _name_of(self, vr: int) -> str:
        """Return the name of the element with a value reference."""
        variable, index = self._scalars[vr]
        return str(variable.elements()[index or 0])

    def _set(self, vrs: list[int], values: list[Any], kind: str) -> None:
        """Write values; log an error for an output, no number, or a fixed parameter."""
        try:
            last_vrs, access, parameter = self._writing[kind]
            if vrs != last_vrs:
                if outputs := [
                    vr for vr in vrs if self._scalars[vr][0].causality == "output"
                ]:
                    raise ValueError(
                        f"{self._name_of(outputs[0])}: an output is not set"
                    )
                self._writing[kind] = _, access, parameter = self._select(vrs, kind)
            for vr, value in zip(vrs, values, strict=True) if kind == "Real" else ():
                if not math.isfinite(value):
                    raise ValueError(f"{self._name_of(vr)}: {value} is no number")
            if parameter and self._phase >= _STEPPING:
                names = ", ".join(
                    dict.fromkeys(self._scalars[vr][0].name for vr in vrs)
                )
                raise RuntimeError(
                    f"{names}: a parameter is fixed once the simulation runs"
                )
            access.write(values)
            self._stale = self._phase == _INITIALISING
        except BaseException as error:
            self._fail(f"set {kind}", error)

    def get_real(self, vrs: list[int]) -> list[float]:
        return self._get(vrs, "Real", math.nan)

    def get_integer(self, vrs: list[int]) -> list[int]:
        return self._get(vrs, "Integer", 0)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return self._get(vrs, "Boolean", False)

    def get_string(self, vrs: list[int]) -> list[str]:
        self._fail("get String", "there are no strings here")
        return [""] * len(vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        self._set(vrs, values, "Real")

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set(vrs, values, "Integer")

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set(vrs, values, "Boolean")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._fail("set String", "there are no strings here")

    # --- state ------------------------------------------------------------------------

    def _get_fmu_state(self) -> dict[str, Any]:
        """Return the state: phase, time (s) and all values of the block."""
        return {
            "phase": self._phase,
            "time": self._time,
            "stale": self._stale,
            "values": dict(self._values),
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        """Restore a state, or log an error."""
        try:
            values = dict(state["values"])
            self._phase, self._time, self._stale = (
                state["phase"],
                state["time"],
                state["stale"],
            )
            self._values.clear()
            self._values.update(values)
        except BaseException as error:
            self._fail("set state", error)

    @classmethod
    def _fmu_state_to_bytes(cls, state: dict[str, Any]) -> bytes:
        return bytes(cls.block_class.encode(state))

    @classmethod
    def _fmu_state_from_bytes(cls, state: bytes) -> Any:
        try:
            return cls.block_class.decode(bytes(state))
        except BaseException:
            return {}  # refused, with a log message, when it is set


def _name(instance: str) -> str:
    """Return the name of the instance, by which noise is keyed.

    Of a file's name it is the stem: Ecos gives it with its path, and fmucontainer after
    the name of the container (c.wheels.fmu).
    """
    if not instance.endswith(".fmu"):
        return instance
    return re.split(r"[/\\.]", instance)[-2]
