"""Take the law of dumps between thresholds (`manager_threshold`) from its own block.

It also computes what coils take that work all the time (by = both).

The momentum H (N m s, eci) of wheels and body grows by the impulse d of the disturbances
and that of the coils, which follow the law of the block within their limit, and falls to
`end` where its fill reaches `begin`:

    H' = d' + C'(t) (M x B),   M = clip(gain (h x B) / |B|^2, m_limit)

Many crafts are integrated side by side, with the rows of their flights as steps.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.components.blocks.manager_threshold import THRUSTERS, ManagerThreshold

from ..analyses.flight import Flight, Hardware, hardware_of
from ..numbers.derived import from_body, rotate
from ..system.model import System
from ..system.parameters import bare_block
from .momentum import smallest_wheel_capacity

Array = NDArray[Any]
COILS = "coils"  # name of their impulse among the sources of a flight
PASSES = 12  # of a flight that is repeated until its momentum grows alike each time
# Share of the growth, and of `begin`, by which that of two passes may differ; wheels
# that gain less than the second in a pass are held by the coils.
ALIKE, HELD = 0.01, 1e-3


class ThresholdLaw(NamedTuple):
    """A law that dumps between thresholds, with the values of its manager."""

    begin: float  # N m s, fill at which a dump begins
    end: float  # N m s
    target: Array  # (3,) N m s, body: desired sum of the wheels' momentum
    of_wheels: bool  # the fill is that of the fullest wheel, not of their sum
    pulse: float  # N m s, shortest pulse of the axis where it is largest
    sample_time: float  # s
    aligned: float  # |h|_1 / |h| up to which a dump begins; 0: it does not wait
    longest_wait: float  # s
    latest: float  # N m s, fill from which on no dump waits; inf: there is none
    reserve: float  # share (1) of the room above `begin` that is full at `latest`
    period: float  # s, between dumps by the calendar; inf: there is none
    gain: float  # 1/s, of coils that work all the time; 0: there are none
    coil_limit: float  # largest dipole that the law commands over that of a coil
    block: ManagerThreshold  # the manager's block, set to dump at once
    windows: ManagerThreshold | None  # the same with its windows; None: it has none

    def next_open(self, t: float) -> float:
        """Return the first time (s), `t` or later, at which a dump may be; inf: none."""
        return t if self.windows is None else self.windows.next_open(t)

    def is_calendar(self, times: Array) -> Array:
        """Return the rows (n,) at times (s) where the calendar has a dump."""
        count = np.floor(times / self.period)
        return np.diff(count, prepend=count[0] - (self.period < inf)) > 0.0

    def fullest(self, fills: Sequence[float]) -> float:
        """Return the largest fill (N m s) at which dumps begin: `begin` if none waits."""
        if self.aligned == 0.0 and self.windows is None:
            return self.begin
        return max(fills)

    def with_coils(
        self,
        flights: Sequence[Flight],
        hardware: Hardware,
        is_repeated: bool,
        fills: Sequence[float] | None = None,
    ) -> list[Flight]:
        """Return flights in whose impulse is what the coils take, if there are some.

        `fills` are the thresholds of each flight over those of the law.
        """
        if self.gain == 0.0 or COILS in flights[0].sources:
            return list(flights)
        shares = [1.0] * len(flights) if fills is None else fills
        return _with_coils(flights, hardware, self, shares, is_repeated)

    def between(self, begin: float, end: float, capacity: float) -> ThresholdLaw:
        """Return the law with other thresholds (N m s), of wheels of a capacity (N m s).

        A dump waits up to the same share of the room above `begin`.
        """
        latest = self.latest
        if latest < inf:
            latest = begin + self.reserve * (capacity - begin)
        return self._replace(begin=begin, end=end, latest=latest)

    def at_fill(self, share: float) -> ThresholdLaw:
        """Return the law with all its thresholds at a share of its own."""
        begin, end, latest = (share * x for x in (self.begin, self.end, self.latest))
        return self._replace(begin=begin, end=end, latest=latest)


def threshold_law(system: System) -> ThresholdLaw:
    """Return the law of a system's manager."""
    manager = system.components["manager"]
    block, values = bare_block(manager), manager.values
    gain = float(values["gain"]) if manager.choice("by") == "both" else 0.0
    block.aligned, block.delay, block.wheel_sample_time = 0.0, 0.0, 0.0
    block.latest = block.period = 0.0
    block.h_null = 0.0  # the momenta of the model are without the bias
    block.check()
    assert isinstance(block, ManagerThreshold)
    block.by = THRUSTERS
    windows = None
    if any(values["windows"]):
        windows = bare_block(manager)
        assert isinstance(windows, ManagerThreshold)
        windows.start()
        block.windows = (0.0,) * len(block.windows)
    begin, latest = float(values["begin"]), float(values["latest"]) or inf
    capacity = smallest_wheel_capacity(hardware_of(system))
    return ThresholdLaw(
        begin=begin,
        end=float(values["end"]),
        target=np.array(values["h_target_body"], float),
        of_wheels=manager.choice("fill") == "wheels",
        pulse=max(values["pulse_body"]),
        sample_time=float(values["sample_time"]),
        aligned=float(values["aligned"]),
        longest_wait=float(values["longest_wait"]),
        latest=latest,
        reserve=(latest - begin) / max(capacity - begin, 1e-300),
        period=float(values["period"]) or inf,
        gain=gain,
        coil_limit=_coil_limit(system) if gain > 0.0 else 1.0,
        block=block,
        windows=windows,
    )


def _coil_limit(system: System) -> float:
    """Return the largest dipole that the manager commands over that of a coil, or 1."""
    law, coils = (
        float(system.components[name].values["m_limit"])
        for name in ("manager", "torquers")
    )
    return min(1.0, law / coils)


def _with_coils(
    flights: Sequence[Flight],
    hardware: Hardware,
    law: ThresholdLaw,
    fills: Sequence[float],
    is_repeated: bool,
) -> list[Flight]:
    """Return flights whose impulse has that of the coils in it.

    Parameters
    ----------
    flights
        Flights with equally many rows, wheels at rest at the first of them.
    hardware, law
        Craft and law.
    fills
        Thresholds of each flight over those of the law.
    is_repeated
        A flight is flown until its momentum grows alike each time, as if it lasted.
    """
    shared = all(x.q is flights[0].q for x in flights)
    course = _CoilCourse(flights[:1] if shared else flights, hardware, law)
    impulses = np.stack([x.disturbance for x in flights], axis=1)
    begin, end = (x * np.array(fills, float) for x in (law.begin, law.end))
    total = course.rest()
    total = np.repeat(total, len(flights), axis=0) if shared else total
    growth = np.full(total.shape, np.inf)
    for _ in range(PASSES if is_repeated else 1):
        start, before = total, growth
        coils, total = course.fly(impulses, total, begin, end)
        growth = impulses[-1] - impulses[0] + coils[-1]
        changes = np.linalg.norm(growth - before, axis=1)
        size = np.linalg.norm(growth, axis=1)
        if (changes <= np.maximum(ALIKE * size, HELD * begin)).all():
            break
    if is_repeated:
        is_held = np.linalg.norm(total - start, axis=1) <= HELD * begin
        ramp = np.linspace(0.0, 1.0, len(coils))[:, None]
        for k in np.flatnonzero(
            is_held & (np.linalg.norm(growth, axis=1) <= HELD * begin)
        ):
            coils[:, k] -= ramp * growth[k]
    return [
        replace(
            x,
            disturbance=x.disturbance + coils[:, k],
            sources={**x.sources, COILS: coils[:, k]},
        )
        for k, x in enumerate(flights)
    ]


class _CoilCourse:
    """Field and attitude along flights, of which one may stand for all."""

    def __init__(
        self, flights: Sequence[Flight], hardware: Hardware, law: ThresholdLaw
    ) -> None:
        """Compute turns, fields and pushes at the rows of the flights."""
        steps = np.diff(flights[0].times)
        to_body, away, field, push = [], [], [], []
        for flight in flights:
            turn = from_body(flight.q)
            b = rotate(flight.q, flight.b)
            middle = 0.5 * (b[:-1] + b[1:])
            across = np.zeros((len(middle), 3, 3))  # h @ across = h x B
            for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                across[:, i, j], across[:, i, k] = -middle[:, k], middle[:, j]
            size2 = np.maximum((middle * middle).sum(axis=1), 1e-300)
            # a step is longer than a sample: what decays in it
            rate = -np.expm1(-law.gain * steps) / steps
            to_body.append(turn)
            away.append(flight.body + law.target)
            field.append(across * (rate / size2)[:, None, None])
            push.append(across * (hardware.open * steps)[:, None, None])
        self._turn, self._away, self._law, self._push = (
            np.stack(x, axis=1) for x in (to_body, away, field, push)
        )
        self._limit = hardware.m_limit * min(law.coil_limit, hardware.longest)
        self._target = law.target
        self._spread = hardware.spread().T if law.of_wheels else None
        since = flights[0].times - flights[0].times[0]
        self._calendar = law.is_calendar(since)
        self._open = [law.next_open(t) == t for t in since.tolist()]

    def rest(self) -> Array:
        """Return the momentum (flights, 3) N m s, eci, with the wheels at rest."""
        body = self._away[0] - self._target
        return np.asarray((self._turn[0] @ body[:, :, None])[:, :, 0])

    def fly(
        self, impulses: Array, total: Array, begin: Array, end: Array
    ) -> tuple[Array, Array]:
        """Follow the momentum `total` (n, 3) N m s, eci, through all rows.

        Returns the impulse of the coils (rows, n, 3) N m s, eci, and the momentum at
        the end. `impulses` (rows, n, 3) is the disturbances' impulse.
        """
        coils = np.zeros_like(impulses)
        impulse = np.diff(impulses, axis=0)
        total, is_due = total[:, None], np.zeros(len(begin), bool)
        for k in range(len(impulse)):
            turn = self._turn[k]
            excess = total @ turn - self._away[k][:, None]
            h = excess[:, 0]
            if self._spread is not None:
                fill = np.abs(h @ self._spread).max(axis=1)
            else:
                fill = np.linalg.norm(h, axis=1)
            is_due |= fill >= begin
            if self._calendar[k]:
                is_due |= fill > end
            if self._open[k] and is_due.any():
                shares = np.where(is_due, end / np.maximum(fill, 1e-300), 1.0)
                is_due[:] = False
                excess = excess * shares[:, None, None]
                away = self._away[k][:, None]
                total = (excess + away) @ turn.transpose(0, 2, 1)
            dipole = np.clip(excess @ self._law[k], -self._limit, self._limit)
            push = dipole @ self._push[k] @ turn.transpose(0, 2, 1)
            coils[k + 1] = coils[k] + push[:, 0]
            total = total + impulse[k][:, None] + push
        return coils, total[:, 0]
