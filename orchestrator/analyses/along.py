"""The balances of `energy.py` made while a run goes on.

So where its rows do not have every step of the body: with inner steps, decimation, rows left out.

The balances need what reaches the body at each of its own steps, which `engine/node.py` keeps for
some thousands of them at a time: so they take no more memory however long the run is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from ..engine.master import Master
from ..engine.node import Kept
from ..system.interface import Signal, base_name
from ..system.model import System
from ..system.parameters import value_of
from ..system.rates import graded
from . import energy, outside, residual
from .within import Array, Steps

_STATES = ("q_bi", "omega_bi_body", "impulse_eci")


class Along:
    """Balances of a system's rigid body; `parts` as `energy.applies` has them, `parameters` as a
    manifest has them."""

    def __init__(
        self, system: System, parts: Mapping[str, Any], parameters: Mapping[str, Any]
    ) -> None:  # fmt: skip
        assert isinstance(system.inner, int), "it is chosen when a run begins"
        self._step, self._inner = system.step, system.inner
        self._parameters = parameters[parts["spacecraft"]]
        self._body = system.components[parts["spacecraft"]]
        self._carrier, self._axes = residual.carrier_of(
            {"parameters": parameters}, parts["spacecraft"]
        )
        wheels, _, momentum = parts["wheels"].partition(".")
        names = [(self._body.name, n) for n in _STATES] + [(wheels, momentum)]
        outputs = [
            (owner, s.name) for owner, n in names
            for s in system.components[owner].interface.elements(n)
        ]  # fmt: skip
        self.kept = Kept(self._body.name, outputs)
        self._known = outside.known(system, self._body.name)
        self._totals, self._steps = energy.Totals(), 0

    def needs(self, component: str, signal: Signal) -> bool:
        """Whether an output must be read."""
        return (component, signal.name) in self.kept.outputs

    @property
    def room(self) -> int:
        """Steps of the master that may be made before it has to look."""
        return self.kept.room

    def look(self) -> None:
        """Add the steps that were made, as far as they fill a piece."""
        while piece := self.kept.take():
            self._add(*piece)

    def _add(self, starts: Array, given: Array) -> None:
        q, omega, impulse, h = np.split(starts, (4, 7, 10), axis=1)
        x = self._inputs(given)
        dt = self._lengths(len(given))
        mean, slope = (x[name] for name in energy.PAIR)
        torque = outside.torque(self._parameters, x, dt) if self._known else None
        self._totals.add(
            Steps(dt, self._carrier, self._axes, q, omega, impulse, h, mean, slope, torque)
        )
        self._steps += len(given)

    def _inputs(self, given: Array) -> dict[str, Array]:
        """The body's inputs, (steps, elements) each: what it is given, and the values of others."""
        columns = {name: i for i, name in enumerate(self.kept.inputs)}
        made: dict[str, Array] = {}
        for name in dict.fromkeys(base_name(s.name) for s in self._body.interface.of("input")):
            elements = [s.name for s in self._body.interface.elements(name)]
            if self._body.interface.signals[elements[0]].kind != "Real":
                continue
            columns_of_it = [
                given[:, columns[e]] if e in columns
                else np.full(len(given), value_of(self._body, e), float)
                for e in elements
            ]  # fmt: skip
            made[name] = np.column_stack(columns_of_it)
        return made

    def _lengths(self, n: int) -> Array:
        """Of the next n steps of the body (s), (n, 1)."""
        step, inner = self._step, self._inner
        if self.kept.every > 1 or inner == 1:
            return np.full((n, 1), step * self.kept.every / inner)
        parts = np.array([w * step for _, w in graded(inner)])
        return parts[(self._steps + np.arange(n)) % inner][:, None]

    def finish(self, master: Master, failed: bool) -> dict[str, Any] | None:
        """The totals at the end of a run, which `failed` within a step or ended after one; None
        where it has not made a step of the body."""
        if not failed:
            self.kept.end(master.k)
        self.look()
        if rest := self.kept.take(rest=True):
            self._add(*rest)
        return None if self._totals.start is None else asdict(self._totals)

    def state(self) -> dict[str, Any]:
        """As JSON what goes on from here, beside what is kept, depends on."""
        return {"totals": asdict(self._totals), "steps": self._steps}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Go on from there."""
        self._totals, self._steps = energy.Totals(**state["totals"]), state["steps"]
