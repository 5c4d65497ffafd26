"""Run a bare block as an instance without FMI.

It serves for debugging and as reference for the FMUs.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from desat.components.contract.block import Access, Scalar
from desat.fmus.registry import block_class

from ...system.interface import KINDS, Kind, Signal
from ...system.model import Component
from .base import DTYPE, Array, Clock, ComponentError


class BlockInstance:
    """A bare block without FMI, for debugging and as reference for FMUs."""

    def __init__(self, component: Component) -> None:
        """Make the bare block of a component."""
        self.name, self.place = component.name, 0
        self.messages: list[str] = []
        self.counts: dict[str, int] = {}
        self._interface = component.interface
        self._block = block_class(component.model, component.interface.sizes)()
        self._block.instance = self.name
        self._initialising = self._stale = False
        self._start = 0.0
        self._error: ComponentError | None = None

    def wire(
        self,
        inputs: dict[Kind, list[Signal]],
        outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array],
        clock: Clock,
    ) -> None:
        self._clock = clock

        def access(signals: list[Signal]) -> Access:
            return self._block.access([s.reference for s in signals])

        self.inputs = {
            k: np.zeros(len(inputs[k]), DTYPE[k]) for k in KINDS if inputs[k]
        }
        self._writes = [
            (a, access(inputs[k]), k == "Boolean") for k, a in self.inputs.items()
        ]
        self._reads = [(into[k], access(outputs[k])) for k in KINDS if outputs[k]]

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        for name, value in parameters.items():
            self._block.access([self._interface.signals[name].reference]).write([value])
        self._start, self._initialising, self._stale = start, True, True

    def exit(self) -> None:
        self._refresh()
        self._initialising = False
        if self._error is not None:
            raise self._error

    def _refresh(self) -> None:
        """Start the block and compute its outputs if inputs changed while initialising.

        An error is stored, because the inputs may not have settled yet.
        """
        if self._initialising and self._stale:
            self._stale, self._error = False, None
            try:
                self._block.check()
                self._block.start()
                self._block.output(self._start)
            except Exception as error:  # the inputs may not have settled yet
                self._error = ComponentError(
                    f"{self.name}: start: {type(error).__name__}: {error}"
                )

    def push(self) -> int:
        for array, access, boolean in self._writes:
            values = array.tolist()
            access.write([x != 0 for x in values] if boolean else values)
        self._stale = True
        return 0

    def pull(self) -> int:
        self._refresh()
        for array, access in self._reads:
            array[:] = access.read()
        return 0

    def step(self) -> int:
        t, dt = self._clock.t.value, self._clock.dt.value
        try:
            self._block.advance(t, dt)
            self._block.output(t + dt)
            return 0
        except Exception as error:
            text = f"step from t = {t} s: {type(error).__name__}: {error}"
            raise ComponentError(f"{self.name}: {text}") from error

    def failed(self, call: str, status: int) -> ComponentError:
        return ComponentError(f"{self.name}: {call} failed")

    def save(self) -> bytes:
        return self._block.encode(vars(self._block))

    def restore(self, state: bytes) -> None:
        values = self._block.decode(state)
        vars(self._block).clear()
        vars(self._block).update(values)

    def look(self) -> None:
        pass

    def terminate(self) -> None:
        pass

    def close(self) -> None:
        pass
