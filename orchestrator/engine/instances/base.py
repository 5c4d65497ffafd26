"""Define instances: components that a master can initialise, feed, step and read.

The master fills `inputs[kind]`, calls `push`, `step` and `pull`, and finds the outputs
in the arrays that it passed to `wire`. These arrays stay the same objects from then on,
so that a step allocates nothing. `fmu.py` runs an FMU through prepared ctypes calls,
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
DTYPE: dict[Kind, Any] = {
    "Real": np.float64,
    "Integer": np.int32,
    "Boolean": np.int32,
    "String": object,
}


def blank(kind: Kind, count: int) -> Array:
    """Return an array of values of a kind: zeros, or empty texts."""
    return np.full(count, "" if kind == "String" else 0, DTYPE[kind])


class ComponentError(DesatError):
    """Failure of a component while it ran."""


class EndedError(ComponentError, RunError):
    """Failure of a component that ended its own process, or was ended with it."""


class Clock:
    """Start (s) and length (s) of the next step of components of one rate.

    The prepared calls read both in place.
    """

    def __init__(self, t: float, dt: float) -> None:
        self.t, self.dt = ctypes.c_double(t), ctypes.c_double(dt)


class Instance(Protocol):
    """One component in a running system.

    Functions that return an int return an FMI status.
    """

    name: str
    place: int  # PLACE times its place in the schedule's order, for `current_call`
    messages: list[str]  # warnings and errors that the component has logged
    counts: dict[str, int]  # how often it has logged each of them
    inputs: dict[Kind, Array]

    @property
    def push(self) -> Callable[[], int]:
        """Set the wired inputs from `inputs`."""

    @property
    def step(self) -> Callable[[], int]:
        """Make the step whose start and length `wire`'s clock holds."""

    @property
    def pull(self) -> Callable[[], int]:
        """Read the wired outputs into the arrays that `wire` received."""

    def wire(
        self,
        inputs: dict[Kind, list[Signal]],
        outputs: dict[Kind, list[Signal]],
        into: dict[Kind, Array],
        clock: Clock,
    ) -> None:
        """Select the inputs to push, the outputs to pull, their arrays, and the clock.

        The clock holds start and length of each step.
        """

    def enter(self, start: float, parameters: Mapping[str, Scalar]) -> None:
        """Set parameters and enter initialisation mode at time `start` (s)."""

    def exit(self) -> None:
        """Leave initialisation mode.

        Raises ComponentError if the component could not start.
        """

    def failed(self, call: str, status: int) -> ComponentError:
        """Build the error for a status, with the message of the component."""

    def save(self) -> bytes:
        """Return the serialised state between two steps.

        Raises ComponentError if the component cannot provide it.
        """

    def restore(self, state: bytes) -> None:
        """Restore a state that `save` returned, in a process like that one.

        Raises ComponentError if the state is not of this component.
        """

    def look(self) -> None:
        """Add to `messages` what the component changed in its own process.

        The changes are undone. Only an instance in a process of its own has any.
        """

    def terminate(self) -> None:
        """Terminate a simulation that has not failed.

        Raises ComponentError if the component does not terminate.
        """

    def close(self) -> None:
        """Free the component.

        It may be called at any time, and more than once.
        """


_WARNED = " returned warning"


def warn_of(instance: Instance, call: str, occasion: str = "") -> None:
    """Record once that a call returned a warning.

    A warning is no failure.
    """
    if not any(text.startswith(f"{call}{_WARNED}") for text in instance.messages):
        instance.messages.append(f"{call}{_WARNED}{occasion}")


def is_of_status(text: str) -> bool:
    """Return whether a message comes from `warn_of`, not from the component."""
    return _WARNED in text


def each(calls: Iterable[Callable[[], None]]) -> None:
    """Make all calls, even if some fail.

    Raises
    ------
    ComponentError
        If calls failed, with the messages of all of them.
    EndedError
        At once, if a component ended its process.
    """
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
