"""Solve algebraic loops: outputs of components that depend on each other at once.

At a communication point the outputs x of a loop satisfy x = f(x), where f sets the
inputs that they feed and reads the outputs again, without a step. Newton's method on
x - f(x) with a Jacobian by differences solves it, as OpenModelica and OMSimulator do;
the Jacobian is kept as long as it converges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..system.interface import Kind, Signal
from .current_call import PULL, PUSH
from .instances.base import Array, ComponentError
from .node import Node, Slot
from .operations import Gather, Publish

# Upper bound of x - f(x), as a share of the largest |x|, or of 1 if that is less; and the
# share below which no iteration is made.
TOLERANCE, ROUNDING = 1e-10, 1e-14
MOST_ITERATIONS = 50
_DIFFERENCE = 2.0**-20  # of a value, for the Jacobian; as a share of it, at least of 1
_NO_ANSWER = 1e-6  # a derivative of an output by an input below this is none
_SLOW = 0.1  # a residual that shrinks less than to this asks for a new Jacobian

# judge(member, verb, call): makes a call of a component and raises if it fails
Judge = Callable[[Node, int, Callable[[], int]], None]


def _share(residual: NDArray[np.float64], x: NDArray[np.float64]) -> float:
    """Return the size of a residual as a share of that of x, or of 1 if that is less."""
    size = float(np.abs(residual).max(initial=0.0))
    return size / max(1.0, float(np.abs(x).max(initial=0.0)))


def _declared_inputs(member: Node, signal: Signal) -> set[str] | None:
    """Return the inputs on which an output depends; None if that is not declared."""
    if signal.output_class == "undeclared":
        return None
    fmu = member.component.fmu
    for unknown in () if fmu is None else fmu.description.outputs:
        if unknown.variable.name in (signal.name, signal.array):
            elements = member.component.interface.elements
            names = {v.name for v in unknown.dependencies or ()}
            return {s.name for name in names for s in elements.get(name, ())}
    return {s.name for s in member.component.interface.inputs}


class AlgebraicLoop:
    """The components of a loop, and the outputs that circle among them.

    Parameters
    ----------
    members
        The components of the loop.
    live
        The outputs of all components.
    shown
        Function of a component: the operations that publish all its outputs.
    judge
        Makes a call of a component and raises ComponentError if it fails.
    """

    def __init__(
        self,
        members: Sequence[Node],
        live: dict[Kind, Array],
        shown: Callable[[Node], list[Publish]],
        judge: Judge,
    ) -> None:
        """Collect the outputs of the members that feed members, the unknowns of the loop."""
        names = {member.name for member in members}
        slots: dict[int, Slot] = {}
        for member in members:
            for slot, _ in member.incoming.get("Real", ()):
                if slot.component in names and slot.kind == "Real":
                    slots[slot.index] = slot
        self._outputs = list(slots.values())
        self._places = np.array(list(slots), np.intp)
        self._members, self._live, self._judge = members, live, judge
        self._gathers: list[list[Gather]] = [
            member.gathers(live, lambda slot: True) for member in members
        ]
        self._shown = [shown(member) for member in members]
        self._jacobian: NDArray[np.float64] | None = None
        # outputs at the last point, and those whose components are known to answer to
        # inputs between steps, or were named because they do not
        self._solution: NDArray[np.float64] | None = None
        self._known = np.zeros(len(slots), bool)

    def __call__(self, k: int = 0) -> None:
        """Solve the loop at the end of a step, as `solve` does.

        Raises
        ------
        ComponentError
            If Newton's method does not converge, or a component computes an output of
            the loop in steps alone, so that no solution can be found between them.
        """
        self._check_answers()
        self.solve()

    def _check_answers(self) -> None:
        """Find components whose outputs a step has changed, but no input between steps.

        Between steps their outputs fit any input, so that the loop seems to be solved.
        Raises ComponentError for outputs that declare that they depend on these inputs;
        what declares nothing may be a state, and gets a warning.
        """
        x = self._live["Real"][self._places]
        if self._solution is None:
            return
        scale = np.maximum(1.0, np.abs(self._solution))
        doubtful = (np.abs(x - self._solution) > TOLERANCE * scale) & ~self._known
        if not doubtful.any():
            return
        feedthrough = np.eye(len(x)) - self._differences(x, self._residual(x))
        self._residual(x)
        is_silent = (np.abs(feedthrough) < _NO_ANSWER).all(axis=1)
        self._known |= doubtful
        self._report_silent(
            [self._outputs[i] for i in np.flatnonzero(doubtful & is_silent)]
        )

    def _report_silent(self, outputs: Iterable[Slot]) -> None:
        """Report outputs that do not follow the loop's inputs between steps."""
        members = {member.name: member for member in self._members}
        declared: list[str] = []
        for slot in outputs:
            member, name = members[slot.component], slot.signal.name
            inputs = {
                c.input
                for source, c in member.incoming.get("Real", ())
                if source.component in members
            }
            declared_inputs = _declared_inputs(member, slot.signal)
            if declared_inputs is None:
                member.instance.messages.append(
                    f"{name} does not answer to {', '.join(sorted(inputs))} between two "
                    "steps: it is taken as a state, and its algebraic loop is not solved "
                    "where it is none"
                )
            elif declared_inputs & inputs:
                declared.append(f"{slot.component}.{name}")
        if declared:
            names = ", ".join(sorted(declared))
            raise ComponentError(
                f"algebraic loop of {', '.join(sorted(members))}: it cannot be solved, "
                "because what declares that it depends on the others does not answer to "
                f"them between two steps: {names}; --output-class {min(declared)}=state "
                "takes it a step late"
            )

    def solve(self) -> None:
        """Solve the loop, so that inputs and outputs of its components fit.

        Raises
        ------
        ComponentError
            If Newton's method does not converge.
        """
        self._iterate()
        self._solution = self._live["Real"][self._places]

    def _iterate(self) -> None:
        """Iterate by Newton's method until the residual is small enough."""
        x = self._live["Real"][self._places]
        residual = self._residual(x)
        for _ in range(MOST_ITERATIONS):
            size = _share(residual, x)
            if size <= ROUNDING:
                return
            fresh = self._jacobian is None
            if self._jacobian is None:
                self._jacobian = self._differences(x, residual)
            try:
                x_next = x - np.linalg.solve(self._jacobian, residual)
            except np.linalg.LinAlgError:
                break
            residual_next = self._residual(x_next)
            shrinks = _share(residual_next, x_next) < size
            if not shrinks and size <= TOLERANCE:  # nothing but rounding is left
                self._residual(x)
                return
            if not (shrinks or (not fresh and np.isfinite(residual_next).all())):
                break
            x, residual = x_next, residual_next
            if not fresh and _share(residual, x) > _SLOW * size:
                self._jacobian = None
        raise ComponentError(self._unsolved(residual))

    def _residual(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return x - f(x)."""
        self._live["Real"][self._places] = x
        for gathers in self._gathers:
            for gather in gathers:
                gather()
        for member in self._members:
            self._judge(member, PUSH, member.instance.push)
        for member, shown in zip(self._members, self._shown, strict=True):
            self._judge(member, PULL, member.instance.pull)
            for show in shown:
                show()
        return x - self._live["Real"][self._places]

    def _differences(
        self, x: NDArray[np.float64], residual: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Compute the Jacobian of x - f(x) (n, n) by differences."""
        jacobian = np.empty((len(x), len(x)))
        for i, value in enumerate(x):
            difference = _DIFFERENCE * max(1.0, abs(float(value)))
            moved = x.copy()
            moved[i] += difference
            jacobian[:, i] = (self._residual(moved) - residual) / difference
        return jacobian

    def _unsolved(self, residual: NDArray[np.float64]) -> str:
        """Return the line for a loop that could not be solved."""
        worst = int(np.nanargmax(np.abs(residual))) if len(residual) else 0
        names = ", ".join(f"{s.component}.{s.signal.name}" for s in self._outputs[:5])
        return (
            f"algebraic loop of {names}: no solution after {MOST_ITERATIONS} iterations at "
            f"most; {self._outputs[worst].component}.{self._outputs[worst].signal.name} "
            f"is off by {abs(float(residual[worst])):.3g}"
        )
