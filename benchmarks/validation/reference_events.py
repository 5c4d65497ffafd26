"""The monolithic reference between two known times: DOP853, cut where a wheel does
something.

A step that passes an event is made again up to it, so that no step of the integrator
goes across a bend: a wheel comes to its limit, leaves it, turns through zero speed,
stands there by stiction or breaks loose, or its motor comes to its limit with what it
has learnt. Times known beforehand (samples, edges of pulses, failures) are the
caller's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from desat.components.maths import attitude
from desat.system.errors import DesatError

from .reference_plant import (
    LEARNT,
    STANDING,
    Array,
    H,
    Held,
    Late,
    Plant,
    Q,
    State,
    part,
)

if (
    TYPE_CHECKING
):  # they take long to load, and all analyses are found by loading their modules
    from scipy.integrate import DOP853, OdeSolution

RTOL, ATOL = 1e-13, 1e-15
MOST_EVENTS = 1000
"""Between two known times; more are a wheel that chatters, which is not solved."""

Events = Callable[[float, State], list[float]]
"""At a time and state: numbers of which each is an event where it falls below zero."""


@dataclass(frozen=True)
class Piece:
    """The solution between two events: from and until when (s), the state at a time,
    what held."""

    begin: float
    end: float
    at: Callable[[float], Array] | None
    held: Held


def advance(
    plant: Plant, t0: float, t1: float, y: State, held: Held, late: Late | None = None
) -> tuple[State, Held, list[Piece]]:
    """The state at t1 and what holds then, from the state at t0; and the pieces on the
    way, with their solutions where the body's forces are `late`.

    Raises DesatError where the integration fails, a wheel chatters, or one comes to its
    limit while forces are late.
    """
    pieces: list[Piece] = []
    held = _settled(plant, t0, y, held)
    watch = _Watch(plant, t0, y, held)
    for _ in range(MOST_EVENTS):
        end, y, event, solution = _solve(
            lambda t, x, held=held: plant.derivative(t, x, held, late),  # type: ignore[misc]
            t0,
            t1,
            y,
            lambda t, x, held=held: watch.values(t, x, held, late),  # type: ignore[misc]
            dense=late is not None,
        )
        y[Q] = attitude.normalise(part(y, Q))
        y[H] = plant.motion(end, y, held, late)[1]
        pieces.append(Piece(t0, end, solution, held))
        if event is None:
            return y, held, pieces
        t0, held = end, _loose(plant, end, y, watch.happened(event, end, y, held))
        watch.turn(held)
        if late is not None and any(held.pinned):
            raise DesatError(
                f"a wheel is at its limit at t = {t0:g} s: the reference with the delays of "
                "another master does not know that"
            )
    raise DesatError(f"the reference: a wheel chatters at t = {t0:g} s")


def _settled(plant: Plant, t: float, y: State, held: Held) -> Held:
    """After new commands: a wheel at its limit stays there only if it is pushed beyond."""
    for i in plant.present:
        if abs(held.pinned[i]) == 1 and plant.push(i, t, y, held) <= 0.0:
            held = replace(held, pinned=_with(held.pinned, i, 0))
    return _loose(plant, t, y, held)


def _loose(plant: Plant, t: float, y: State, held: Held) -> Held:
    """With stiction a wheel that moves neither way stands, unless it is pulled loose."""
    if plant.stiction == 0.0:
        return held
    for i in plant.present:
        if held.way[i]:
            continue
        held = replace(held, pinned=_with(held.pinned, i, STANDING))
        pull = plant.pull(i, t, y, held)
        if abs(pull) > plant.stiction:
            way = _with(held.way, i, 1 if pull > 0.0 else -1)
            held = replace(held, pinned=_with(held.pinned, i, 0), way=way)
    return held


def _with(values: tuple[int, ...], i: int, value: int) -> tuple[int, ...]:
    return (*values[:i], value, *values[i + 1 :])


class _Watch:
    """What may happen to the wheels: three numbers each, see `values`."""

    def __init__(self, plant: Plant, t: float, y: State, held: Held) -> None:
        self.plant = plant
        omega, h = plant.motion(t, y, held)
        self.turning = [
            1.0 if i in plant.present and plant.speed(i, omega, h) >= 0.0 else -1.0
            for i in range(4)
        ]
        self.turn(held)
        self.within = [1.0 if self._spare(i, y) >= 0.0 else -1.0 for i in range(4)]

    def turn(self, held: Held) -> None:
        """Dry friction knows which way a wheel moves also where its speed is zero."""
        if self.plant.stiction > 0.0:
            self.turning = [float(x) for x in held.way]

    def _spare(self, i: int, y: State) -> float:
        """Torque (N m) that the motor has left."""
        return self.plant.torque_limit - abs(y[11 + i] + y[15 + i])

    def values(self, t: float, y: State, held: Held, late: Late | None) -> list[float]:
        """Of each wheel: the room to its limit, or where it is there the push beyond
        it, or where it stands what stiction has left; its speed with the sign it had;
        what its motor has left. Below zero each is an event."""
        plant = self.plant
        omega, h = plant.motion(t, y, held, late)
        values = []
        for i in plant.present:
            if held.pinned[i] == STANDING:
                margin = plant.stiction - abs(plant.pull(i, t, y, held))
            else:
                margin = (
                    plant.push(i, t, y, held)
                    if held.pinned[i]
                    else plant.margin(i, omega, h)
                )
            bends = (
                plant.friction[1] > 0.0 or plant.stiction > 0.0
            ) and not held.pinned[i]
            values += [
                margin,
                self.turning[i] * plant.speed(i, omega, h) if bends else 1.0,
                self.within[i] * self._spare(i, y) if plant.compensation > 0.0 else 1.0,
            ]
        return values

    def happened(self, event: int, t: float, y: State, held: Held) -> Held:
        """What holds after an event."""
        i, subject = self.plant.present[event // 3], event % 3
        if subject == 1 and self.plant.stiction > 0.0:
            y[LEARNT.start + i] = 0.0
            return replace(held, way=_with(held.way, i, 0))
        if subject == 1:
            self.turning[i] = -self.turning[i]
        elif subject == 2:
            self.within[i] = -self.within[i]
        elif held.pinned[i] == STANDING:
            way = 1 if self.plant.pull(i, t, y, held) > 0.0 else -1
            return replace(
                held, pinned=_with(held.pinned, i, 0), way=_with(held.way, i, way)
            )
        else:
            side = 0 if held.pinned[i] else (1 if y[7 + i] > 0.0 else -1)
            return replace(held, pinned=_with(held.pinned, i, side))
        return held


def _solve(
    slope: Callable[[float, State], State],
    t0: float,
    t1: float,
    y: State,
    events: Events,
    dense: bool,
) -> tuple[float, State, int | None, OdeSolution | None]:
    """Integrate to t1 or to the first event: time, state, its number, and the solution
    if dense."""
    from scipy.integrate import OdeSolution

    solver = _solver(slope, t0, t1, np.array(y))
    before, times, parts = events(t0, y), [t0], []
    while solver.status == "running":
        start, state = solver.t, solver.y
        _step(solver)
        after = events(solver.t, solver.y.tolist())
        event = None
        if min(after, default=1.0) < 0.0:
            end, event = _first(
                solver.dense_output(), events, start, solver.t, before, after
            )
            if end > start:
                # a step's interpolant is less accurate than the step: found again
                # without it
                end = _root(
                    lambda t, i=event, start=start, state=state: events(  # type: ignore[misc]
                        t, _there(slope, start, t, state)
                    )[i],
                    start,
                    solver.t,
                    before[event],
                    after[event],
                )
                solver = _solver(slope, start, end, state)
                while solver.status == "running":
                    _step(solver)
                    if dense:
                        times.append(solver.t)
                        parts.append(solver.dense_output())
            solution = OdeSolution(times, parts) if parts else None
            return (
                end,
                solver.y.tolist() if end > start else state.tolist(),
                event,
                solution,
            )
        if dense:
            times.append(solver.t)
            parts.append(solver.dense_output())
        before = after
    return t1, solver.y.tolist(), None, OdeSolution(times, parts) if parts else None


def _solver(
    slope: Callable[[float, State], State], t0: float, t1: float, y: Array
) -> DOP853:
    from scipy.integrate import DOP853

    return DOP853(
        lambda t, x: np.array(slope(t, x.tolist())),
        t0,
        y,
        t1,
        rtol=RTOL,
        atol=ATOL,
        max_step=t1 - t0,
    )


def _step(solver: DOP853) -> None:
    message = solver.step()
    if solver.status == "failed":
        raise DesatError(f"the reference fails at t = {solver.t:g} s: {message}")


def _there(
    slope: Callable[[float, State], State], start: float, end: float, y: Array
) -> State:
    """The state at the end."""
    solver = _solver(slope, start, end, y)
    while solver.status == "running":
        _step(solver)
    there: State = solver.y.tolist()
    return there


def _root(
    value: Callable[[float], float],
    start: float,
    end: float,
    at_start: float,
    at_end: float,
) -> float:
    """Where a value passes zero, its ends known: an interpolant's may round to the
    other side."""
    from scipy.optimize import brentq

    ends = {start: at_start, end: at_end}
    return float(
        brentq(
            lambda t: ends[t] if t in ends else value(t),
            start,
            end,
            xtol=1e-14 * max(1.0, abs(end)),
            rtol=1e-15,
        )
    )


def _first(
    between: Callable[[float], Array],
    events: Events,
    start: float,
    end: float,
    before: list[float],
    after: list[float],
) -> tuple[float, int]:
    """Time and number of the first of the events that a step from start to end has
    passed."""

    def time_of(i: int) -> float:
        if before[i] <= 0.0:
            return start

        def value(t: float) -> float:
            return events(t, between(t).tolist())[i]

        return _root(value, start, end, before[i], after[i])

    return min((time_of(i), i) for i, x in enumerate(after) if x < 0.0)
