"""In how little time the craft of a detumbling run could have been slowed: a search
that knows.

A run's field, place and start are taken as given, as are the limits of its coils and of
its one wheel. Laws of one form, which knows the state without error,

    dipole:  m_limit   sat(c (W omega) x B/|B|)
    torque:  tau_limit sat(k . (omega, omega_x omega_z, omega_x omega_y, omega_y omega_z, h - h_0))

are searched for the W and k (cross-entropy: samples, of which the best give mean and
spread of the next) with which this very craft is slow soonest, for as long as the run
had to show it. The best is flown with finer steps before it counts. Its time is one
that is possible with these limits, by who knows the run ahead: an upper bound of the
least time, since other schedules may be quicker. A lower bound that is proven is beside
it, and coarse: the momentum that has to go, over the most torque that wheel and coils
have together.

Euler's equations with the momentum L of craft and wheel (body), the wheel's h along its
axis g:

    L' = m x B - omega x L + 3 mu/r^5 r x J r,   h' = tau,   J_r omega = L - h g
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from desat.analyses.manifest import Manifest
from desat.components.physics.orbit import MU
from desat.engine.recording.results import Results
from desat.system.errors import DesatError

Array = NDArray[np.float64]

SIGNALS = (
    "spacecraft.q_bi",
    "spacecraft.omega_bi_body",
    "environment.b_eci",
    "environment.r_eci",
    "wheels.h_wheel",
)
SAMPLES, BEST, ROUNDS = 64, 8, 20
"""Laws a round, those that the next is made from, rounds."""
SHARP, RATE, MOMENTUM = 200.0, 0.02, 0.02
"""Gain of the dipole (s/rad); sizes of rate (rad/s) and momentum (N m s) that k counts
in."""
PARTS = 10
"""Finer steps in a sample, with which the best is flown once more."""


@dataclass(frozen=True)
class LeastTime:
    """When a run's craft is slow (s), and when it could be."""

    law: float
    """by the run's own law"""
    found: float
    """by a law that was searched for it: the least time is not above it"""
    floor: float
    """no law is below it"""


class OneWheelPlant(NamedTuple):
    """What acts on a craft in a run, and its limits; times from 0 on in steps of the
    run."""

    inertia: Array
    carrier: Array
    axis: Array
    field: Array
    """(rows, 3), T, eci"""
    place: Array
    """(rows, 3), m, eci"""
    step: float
    start: Array
    """q_bi (4), L (3; N m s, body), h (N m s)"""
    dipole: float
    torque: float
    momentum: float
    """the largest of the wheel (N m s)"""

    def at(self, t: Any) -> tuple[Any, Any]:
        """Field (3, ...) and place (3, ...) at times (s), linear between the rows and
        beyond."""
        at = np.asarray(t) / self.step
        row = np.minimum(at.astype(int), len(self.field) - 2)
        share = (at - row)[..., None]
        b, r = (
            v[row] + share * (v[row + 1] - v[row]) for v in (self.field, self.place)
        )
        return np.moveaxis(b, -1, 0), np.moveaxis(r, -1, 0)

    def rates(self, y: Array) -> Array:
        """omega (3, ...; rad/s, body) of states (8, ...)."""
        inverse = np.linalg.inv(self.carrier)
        return np.asarray(
            np.tensordot(inverse, y[4:7], 1)
            - np.multiply.outer(inverse @ self.axis, y[7])
        )

    def change(self, y: Array, u: Array, b: Array, r: Array) -> Array:
        """y' of states (8, ...) with u (4, ...): the dipole and the wheel's torque, of
        their limits; b and r (3, ...)."""
        v, w, momentum = y[:3], y[3], y[4:7]
        omega = self.rates(y)
        distance2 = (r * r).sum(axis=0)
        field, place = _to_body(v, w, b), _to_body(v, w, r)
        pull = 3.0 * MU / distance2**2.5 * place
        torque = (
            _cross(self.dipole * u[:3], field)
            - _cross(omega, momentum)
            + _cross(pull, np.tensordot(self.inertia, place, 1))
        )
        turn = (w * omega - _cross(omega, v)) / 2.0
        return np.concatenate(
            [turn, -(v * omega).sum(axis=0)[None] / 2.0, torque, self.torque * u[3:]]
        )

    def held(self, y: Array, u: Array, start: Any, length: float, parts: int) -> Array:
        """States (8, ...) after `length` (s) with u (4, ...), from times (s), by RK4 in
        so many steps."""
        h = length / parts
        both = self.at(np.add.outer(np.arange(2 * parts + 1) * h / 2.0, start))
        ends = [(b, r) for b, r in zip(*(x.swapaxes(0, 1) for x in both), strict=True)]
        lead = (slice(None), *(None,) * (y.ndim - ends[0][0].ndim))
        for k in range(parts):
            (b0, r0), (b1, r1), (b2, r2) = (
                (b[lead], r[lead]) for b, r in ends[2 * k : 2 * k + 3]
            )
            k1 = self.change(y, u, b0, r0)
            k2 = self.change(y + h / 2.0 * k1, u, b1, r1)
            k3 = self.change(y + h / 2.0 * k2, u, b1, r1)
            y = y + h / 6.0 * (
                k1 + 2.0 * k2 + 2.0 * k3 + self.change(y + h * k3, u, b2, r2)
            )
        return y


def plant_of(manifest: Manifest, results: Results) -> OneWheelPlant:
    """The plant of a run. Raises DesatError where it has not one wheel, or a series is
    not recorded."""
    if missing := [s for s in SIGNALS if s not in results.names()]:
        raise DesatError(
            f"{manifest.scenario}: {missing[0]} is not recorded; the least time "
            "needs it"
        )
    inputs = {c: manifest.values_of(c) for c in manifest.parameters}
    spin = np.asarray(inputs["wheels"]["inertia_wheel"])
    axes = np.reshape(inputs["wheels"]["axes_wheel"], (3, 4))
    if (places := np.flatnonzero(axes.any(axis=0))).size != 1:
        raise DesatError(
            f"{manifest.scenario}: {places.size} wheels; the least time is of one"
        )
    wheel = int(places[0])
    inertia, axis = np.reshape(inputs["spacecraft"]["inertia"], (3, 3)), axes[:, wheel]
    carrier = inertia - spin[wheel] * np.outer(axis, axis)
    q, omega, field, place, h = (results.values(s) for s in SIGNALS)
    start = np.r_[q[0], carrier @ omega[0] + h[0, wheel] * axis, h[0, wheel]]
    torque = min(inputs["manager"]["torque_limit"], inputs["wheels"]["torque_limit"])
    return OneWheelPlant(
        inertia,
        carrier,
        axis,
        field,
        place,
        manifest.step,
        start,
        inputs["torquers"]["m_limit"],
        torque,
        inputs["manager"]["h_limit"],
    )


def floor_of(plant: OneWheelPlant, limit: float) -> float:
    """A time (s) that no law is below: the momentum of the body that has to go, at the
    most torque of three coils across the strongest field and of the wheel, as if it
    worked about all axes."""
    begin = float(np.linalg.norm(plant.carrier @ plant.rates(plant.start)))
    remaining = limit * float(np.linalg.norm(np.abs(plant.carrier).sum(axis=1)))
    most = float(np.linalg.norm(plant.field, axis=1).max()) * sqrt(3.0) * plant.dipole
    return max(begin - remaining, 0.0) / (most + plant.torque)


def of_run(
    manifest: Manifest,
    results: Results,
    detumbled: float,
    held: float,
    rounds: int = ROUNDS,
) -> LeastTime:
    """The least time of a run whose law was done after `detumbled` (s) and slow for
    `held` (s)."""
    plant = plant_of(manifest, results)
    limit = float(manifest.values_of("manager")["rate_limit"])
    random = np.random.default_rng(1)
    mean = np.r_[np.eye(3).ravel(), 20.0 * RATE * plant.axis, np.zeros(4)]
    spread = np.full(mean.size, 0.5)
    best, until = mean, detumbled
    for _ in range(rounds):
        laws = mean + spread * random.normal(size=(SAMPLES, mean.size))
        laws[0] = best
        times = slow_after(plant, laws, limit, until, held)
        order = np.argsort(times, kind="stable")[:BEST]
        best, until = laws[order[0]], min(until, float(np.ceil(times[order[0]])))
        mean = 0.3 * mean + 0.7 * laws[order].mean(axis=0)
        spread = 0.3 * spread + 0.7 * laws[order].std(axis=0)
    best_time = float(slow_after(plant, best[None], limit, until, held, PARTS)[0])
    return LeastTime(
        detumbled,
        best_time if best_time <= until else detumbled,
        floor_of(plant, limit),
    )


def slow_after(
    plant: OneWheelPlant,
    laws: Array,
    limit: float,
    until: float,
    held: float,
    parts: int = 1,
) -> Array:
    """Of laws (n, 16) the times (s) after which every rate is below the limit, for
    `held` (s); above `until` for those that are not by then, the more the faster they
    still are."""
    w, k = laws[:, :9].T.reshape(3, 3, -1), laws[:, 9:].T
    y = np.repeat(plant.start[:, None], len(laws), axis=1)
    since = np.full(len(laws), np.inf)
    least = np.full(len(laws), np.inf)
    step = plant.step
    for row in range(int((until + held) / step) + 1):
        t = row * step
        omega = plant.rates(y)
        largest = np.abs(omega).max(axis=0)
        if t <= until:
            least = np.minimum(least, largest)
        # slow for long enough stays counted, whatever comes after
        done = t - since >= held
        since = np.where(
            done, since, np.where(largest < limit, np.minimum(since, t), np.inf)
        )
        if (t > until and not np.isfinite(since).any()) or done.all():
            break
        field, _ = plant.at(t)
        across = _to_body(y[:3], y[3], np.repeat(field[:, None], len(laws), axis=1))
        across /= np.linalg.norm(across, axis=0)
        dipole = SHARP * _cross(np.einsum("ijn,jn->in", w, omega), across)
        x, y_, z = omega / RATE
        features = np.stack(
            [x, y_, z, x * z, x * y_, y_ * z, (y[7] - plant.start[7]) / MOMENTUM]
        )
        torque = (k * features).sum(axis=0)
        # no torque that drives a full wheel further
        torque = np.where(
            (np.abs(y[7]) >= plant.momentum) & (torque * y[7] > 0.0), 0.0, torque
        )
        u = np.clip(np.concatenate([dipole, torque[None]]), -1.0, 1.0)
        y = plant.held(y, u, t, step, parts)
        y[:4] /= np.linalg.norm(y[:4], axis=0)
    return np.where(since <= until, since, until + least / limit)


def _cross(a: Array, b: Array) -> Array:
    """a x b of (3, ...): np.cross takes several times as long for small ones."""
    return np.stack(
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    )


def _to_body(v: Array, w: Array, x: Array) -> Array:
    """x (3, ...; eci) in body, of q_bi = (v, w)."""
    across = _cross(np.broadcast_to(x, v.shape), v)
    return x + 2.0 * (w * across + _cross(across, v))
