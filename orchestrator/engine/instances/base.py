"""Instances: one component that a master can initialise, feed, step and read.

The master fills `inputs[kind]`, calls `push`, `step`, `pull`, and has the outputs in
the arrays that it gave to `wire`; the arrays stay the same objects from then on, so
nothing is allocated in a step. `fmu.py` is an FMU through prepared ctypes calls,
`isolated.py` one in a process of its own, `block.py` the bare block.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import Scalar

from ...system.errors import DesatError, RunError
from ...system.interface import Kind, Signal

Array = NDArray[Any]
DTYPE: dict[Kind, Any] = {"Real": np.float64, "Integer": np.int32, "Boolean": np.int32}


class ComponentError(DesatError):
    """A component failed while it ran."""


class EndedError(ComponentError, RunError):
    """A component ended the process that it has of its own, or was ended with it."""


class Clock:
    """The start (s) and the length (s) of the step that components of one rate are
    about to make: the prepared calls read them where they are."""

    def __init__(self, t: float, dt: float) -> None:
        self.t, self.dt = ctypes.c_double(t), ctypes.c_double(dt)


class Instance(Protocol):
    """One component in a running system. Functions that return an int return an FMI
    status."""

    name: str
    place: int
    """PLACE times its place in the order of the schedule: what `current_call` has of
    it."""
    messages: list[str]
    """What the component has logged: warnings, errors."""
    inputs: dict[Kind, Array]

    @property
    def push(self) -> Callable[[], int]:
        """Set the wired inputs from `inputs`."""

    @property
    def step(self) -> Callable[[], int]:
        """Make the step that `wire`'s clock tells."""

    @property
    def pull(self) -> Callable[[], int]:
        """Read the wired outputs into the arrays that `wire` was given."""

    def wire(
        self,
        inputs: dict[Kind, list[Signal]],
        outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array],
        clock: Clock,
    ) -> None:
        """Choose which inputs are pushed, which outputs are pulled and where to, and
        the clock that tells each step's start and length."""

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        """Set parameters and enter initialisation mode at time `start` (s)."""

    def exit(self) -> None:
        """Leave initialisation mode. Raises ComponentError where the component could
        not start."""

    def failed(self, what: str, status: int) -> ComponentError:
        """The error for a status, with what the component has said."""

    def save(self) -> bytes:
        """Its state between two steps. Raises ComponentError where it cannot be had."""

    def restore(self, state: bytes) -> None:
        """Go on from a state that `save` gave, in a process like that one. Raises
        ComponentError for one that is not of this component."""

    def look(self) -> None:
        """Of one in a process of its own: add to `messages` what the component has
        changed there, which is put back."""

    def terminate(self) -> None:
        """End a simulation that has not failed. Raises ComponentError where it does not
        end."""

    def close(self) -> None:
        """Free the component. May be called at any time, also twice."""


_WARNED = " returned warning"


def warn_of(instance: Instance, call: str, when: str = "") -> None:
    """Have an instance say once that a call returned a warning, which is no failure."""
    if not any(text.startswith(f"{call}{_WARNED}") for text in instance.messages):
        instance.messages.append(f"{call}{_WARNED}{when}")


def is_of_status(text: str) -> bool:
    """Whether a message is one of `warn_of`, and not the component's own."""
    return _WARNED in text


def each(calls: Iterable[Callable[[], None]]) -> None:
    """Make all calls. Raises ComponentError with what all of those said that failed,
    and EndedError at once."""
    failures = []
    for call in calls:
        try:
            call()
        except EndedError:
            raise
        except ComponentError as error:
            failures.append(str(error))
    if failures:
        raise ComponentError("\n".join(failures))
