"""The FMI 2.0 adapter: everything between pythonfmu and a block, for every block.

An FMU carries this file, the block and what the block imports, in a package of a name of its own.
Nothing here knows what a block computes; a block knows nothing of this file.

Two rules of pythonfmu's library shape it: an exception that leaves an entry point takes the host
down, so none does (it becomes a log message, the output `fault`, and `do_step` returning False);
and each instantiation releases the entry module's globals once too often, so each instance adds
a reference.
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any, ClassVar

from pythonfmu.enums import Fmi2Status
from pythonfmu.fmi2slave import Fmi2Slave

_PINNED: list[Any] = []

# phases of an instance
_INSTANTIATED, _INITIALISING, _STEPPING, _TERMINATED = range(4)


class Slave(Fmi2Slave):  # type: ignore[misc]
    """A block behind FMI. The entry script of an FMU derives from it and sets `block_class`."""

    block_class: ClassVar[Any]

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        _PINNED.append(vars(sys.modules[type(self).__module__]))
        self.modelName = self.model_identifier()
        self._block = self.block_class()
        self._values = vars(self._block)
        self._scalars = [
            (v, i if v.shape else None) for v in self._block.variables for i in range(v.size)
        ]
        self._phase = _INSTANTIATED
        self._time = 0.0
        self._stale = False  # inputs or parameters changed since the last start()
        self._real_get: tuple[list[int], list[Any]] = ([], [])
        self._real_set: tuple[list[int], list[Any], bool] = ([], [], False)

    def model_identifier(self) -> str:
        """The FMU's name; the entry script overrides it."""
        return type(self).__name__

    # --- failures -----------------------------------------------------------------------------

    def _fail(self, what: str, error: BaseException | str) -> None:
        self._block.fault = True
        text = error if isinstance(error, str) else f"{type(error).__name__}: {error}"
        self.log(f"{self.instance_name}: {what}: {text}", Fmi2Status.error)

    # --- life ---------------------------------------------------------------------------------

    def setup_experiment(self, start_time: float, stop_time: Any, tolerance: Any) -> None:
        self._time = start_time

    def enter_initialization_mode(self) -> None:
        self._phase = _INITIALISING
        self._stale = True

    def exit_initialization_mode(self) -> None:
        self._refresh()
        self._phase = _STEPPING

    def terminate(self) -> None:
        self._phase = _TERMINATED

    def _refresh(self) -> None:
        """Initialisation mode: bring the outputs up to date with inputs and parameters."""
        if not self._stale or self._phase != _INITIALISING:
            return
        self._stale = False
        try:
            self._block.check()
            self._block.start()
            self._block.output(self._time)
        except BaseException as error:
            self._fail("start", error)

    def do_step(self, current_time: float, step_size: float) -> bool:
        if self._block.fault:
            return False
        try:
            if self._phase != _STEPPING:
                raise RuntimeError("a step outside step mode")
            if not 0.0 < step_size < math.inf:
                raise RuntimeError(f"a step of {step_size} s")
            if not abs(current_time - self._time) <= 1e-6 * step_size:
                raise RuntimeError(f"a step from t = {current_time} s, but it is {self._time} s")
            block = self._block
            block.advance(current_time, step_size)
            self._time = end = current_time + step_size
            block.output(end)
            return True
        except BaseException as error:
            self._fail(f"step from t = {current_time} s", error)
            return False

    # --- values -------------------------------------------------------------------------------

    def _variables(self, vrs: list[int], kind: str) -> list[Any]:
        """(variable, index) of each value reference; raises where the type is not `kind`."""
        found = []
        for vr in vrs:
            variable, index = self._scalars[vr]
            if variable.type != kind:
                raise TypeError(f"value reference {vr} ({variable.name}) is not {kind}")
            found.append((variable, index))
        return found

    def _reading_plan(self, vrs: list[int], kind: str) -> list[Any]:
        """Steps (name, index): whole vector where index is None, scalar where it is -1."""
        found = self._variables(vrs, kind)
        plan: list[Any] = []
        k = 0
        while k < len(found):
            variable, index = found[k]
            whole = [(variable, i) for i in range(variable.size)]
            if index is None:
                plan.append((variable.name, -1))
            elif index == 0 and found[k : k + variable.size] == whole:
                plan.append((variable.name, None))
                k += variable.size - 1
            else:
                plan.append((variable.name, index))
            k += 1
        return plan

    def _read(self, plan: list[Any]) -> list[Any]:
        values = self._values
        result: list[Any] = []
        for name, index in plan:
            if index is None:
                result += values[name]
            elif index < 0:
                result.append(values[name])
            else:
                result.append(values[name][index])
        return result

    def get_real(self, vrs: list[int]) -> list[float]:
        try:
            if self._stale:
                self._refresh()
            known, plan = self._real_get
            if vrs != known:
                plan = self._reading_plan(vrs, "Real")
                self._real_get = (vrs, plan)
            result = self._read(plan)
            if len(result) == len(vrs):
                return result
            raise ValueError("a vector has lost its length")
        except BaseException as error:
            self._fail("get_real", error)
            return [math.nan] * len(vrs)

    def get_integer(self, vrs: list[int]) -> list[int]:
        try:
            self._refresh()
            return [int(x) for x in self._read(self._reading_plan(vrs, "Integer"))]
        except BaseException as error:
            self._fail("get_integer", error)
            return [0] * len(vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        try:
            self._refresh()
            return [bool(x) for x in self._read(self._reading_plan(vrs, "Boolean"))]
        except BaseException as error:
            self._fail("get_boolean", error)
            return [False] * len(vrs)

    def get_string(self, vrs: list[int]) -> list[str]:
        self._fail("get_string", "there are no strings here")
        return [""] * len(vrs)

    def _writing_plan(self, vrs: list[int], kind: str) -> tuple[list[Any], bool]:
        """Steps (name, index, first, last) into the values, and whether a parameter is among them."""
        found = self._variables(vrs, kind)
        plan: list[Any] = []
        k = 0
        for name, index in self._reading_plan(vrs, kind):
            size = found[k][0].size if index is None else 1
            plan.append((name, index, k, k + size))
            k += size
        return plan, any(v.causality == "parameter" for v, _ in found)

    def _write(self, plan: list[Any], values: list[Any]) -> None:
        target = self._values
        for name, index, first, last in plan:
            if index is None:
                target[name] = tuple(values[first:last])
            elif index < 0:
                target[name] = values[first]
            else:
                old = target[name]
                target[name] = (*old[:index], values[first], *old[index + 1 :])
        self._stale = self._phase == _INITIALISING

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        try:
            known, plan, parameter = self._real_set
            if vrs != known:
                plan, parameter = self._writing_plan(vrs, "Real")
                self._real_set = (vrs, plan, parameter)
            if parameter and self._phase >= _STEPPING:
                self._refuse(plan)
            self._write(plan, values)
        except BaseException as error:
            self._fail("set_real", error)

    def _set_discrete(self, vrs: list[int], values: list[Any], kind: str) -> None:
        try:
            plan, parameter = self._writing_plan(vrs, kind)
            if parameter and self._phase >= _STEPPING:
                self._refuse(plan)
            self._write(plan, values)
        except BaseException as error:
            self._fail(f"set {kind}", error)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set_discrete(vrs, values, "Integer")

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set_discrete(vrs, values, "Boolean")

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._fail("set_string", "there are no strings here")

    def _refuse(self, plan: list[Any]) -> None:
        names = ", ".join(dict.fromkeys(name for name, *_ in plan))
        raise RuntimeError(f"{names}: a parameter is fixed once the simulation runs")

    # --- state --------------------------------------------------------------------------------

    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "phase": self._phase,
            "time": self._time,
            "stale": self._stale,
            "values": dict(self._values),
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        try:
            values = {name: _frozen(x) for name, x in state["values"].items()}
            self._phase, self._time, self._stale = state["phase"], state["time"], state["stale"]
            self._values.clear()
            self._values.update(values)
        except BaseException as error:
            self._fail("set state", error)

    @staticmethod
    def _fmu_state_to_bytes(state: dict[str, Any]) -> bytes:
        return json.dumps(state).encode()

    @staticmethod
    def _fmu_state_from_bytes(state: bytes) -> Any:
        try:
            return json.loads(bytes(state).decode())
        except BaseException:
            return {}  # refused, with a log message, when it is set


def _frozen(value: Any) -> Any:
    return tuple(_frozen(x) for x in value) if isinstance(value, (list, tuple)) else value
