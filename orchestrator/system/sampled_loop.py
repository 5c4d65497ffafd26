"""Analyse the attitude loop of a craft with wheel momentum as a linear sampled system.

About rest, with H the wheels' momentum (constant, body), J_r the inertia without the
rotors' axial part and theta the small rotation from the target attitude,

    theta' = omega,      J_r omega' = T - omega x H,      T' = (u - T) / lag

so that the body nutates at |H| / sqrt(J_a J_b), J_a and J_b the moments of inertia
across H. The computers see theta and omega at the samples of their sensors and hold
their commands between their own samples:

    tau = -G (kp theta / 2 + kd omega + ki xi),  xi += sample theta / 2     (paper 004, eqs. 10, 11)
    u = tau + omega x H                                                     (paper 004, eq. 16)

Held for a sample, the second term lags behind the nutation that it should cancel. The
eigenvalues of the map over one common period of all samples give the stability of the
loop.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import product
from math import inf, lcm

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAST_DAMPING = 0.1  # lower bound of the damping ratio of a well damped loop
ROUNDING = 1e-6  # growth per period of a double eigenvalue 1 by rounding
MOST_STEPS = 10_000  # upper bound of the steps of a common period
SAMPLE_TIMES = (
    10.0,
    5.0,
    2.0,
    1.0,
    0.5,
    0.2,
    0.1,
    0.05,
    0.02,
    0.01,
)  # s: sample times to propose

# Indices of the state: motion of the body, then memory of the computers.
ANGLE, RATE, TORQUE = slice(0, 3), slice(3, 6), slice(6, 9)
INTEGRAL, CONTROL, COMMAND = slice(9, 12), slice(12, 15), slice(15, 18)
SEEN_ANGLE, SEEN_RATE, DECIDED, REST = slice(18, 21), slice(21, 24), slice(24, 27), 27


@dataclass(frozen=True)
class AttitudeLoop:
    """Body, wheels, sensors, controller and manager of an attitude loop."""

    inertia: Array  # (3, 3) kg m2, without the rotors' axial part
    gain_matrix: Array  # (3, 3) G
    kp: float
    kd: float
    ki: float
    actuated: Array  # (3, 3), share of a commanded body torque that the wheels produce
    motor_lag: float  # s
    gyroscopic: bool  # the manager's command includes omega x H
    step: float  # s, of the exchange between components
    gyro_sample: float  # s, as the next three
    attitude_sample: float
    controller_sample: float
    wheel_sample: float
    controller_delay: float = 0.0  # s
    manager_delay: float = 0.0  # s

    def at(self, sample: float) -> AttitudeLoop:
        """Return the loop with one sample time (s) everywhere.

        Its steps are no longer than that.
        """
        step = min(self.step, sample)
        return replace(
            self,
            step=step,
            gyro_sample=sample,
            attitude_sample=sample,
            controller_sample=sample,
            wheel_sample=sample,
            controller_delay=step * round(self.controller_delay / step),
            manager_delay=step * round(self.manager_delay / step),
        )

    def sample(self) -> float:
        """Return the longest sample time of the loop (s)."""
        samples = (
            self.gyro_sample,
            self.attitude_sample,
            self.controller_sample,
            self.wheel_sample,
        )
        return max(self.step, *samples)

    def nutation(self, momentum: Array) -> float:
        """Return the nutation rate (rad/s) with wheel momentum (3,) N m s, body."""
        curved = momentum @ self.inertia @ momentum / np.linalg.det(self.inertia)
        return float(np.sqrt(max(curved, 0.0)))


@dataclass(frozen=True)
class Stability:
    """Stability of a sampled loop, from its eigenvalues."""

    growth: float  # 1/s, real part of the least damped mode
    damping: float  # smallest damping ratio of an oscillation
    stable: bool  # no mode grows

    @property
    def well_damped(self) -> bool:
        """Return whether each oscillation has at least LEAST_DAMPING."""
        return self.stable and self.damping >= LEAST_DAMPING


def stability(loop: AttitudeLoop, momentum: Array) -> Stability:
    """Compute the stability of a loop with constant wheel momentum (3,) N m s, body.

    A mode without oscillation counts as having a damping ratio of 1. A mode whose
    eigenvalue is a negative number rotates by half a turn per period, the highest
    frequency that samples show. A loop that overflows within a period is unstable.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        period, transition = _map_over_period(loop, momentum)
    if not np.isfinite(transition).all():
        return Stability(growth=inf, damping=-1.0, stable=False)
    values = np.linalg.eigvals(transition)
    values = values[np.abs(values) > 1e-12]
    turns = np.log(values.astype(complex))  # of a period
    oscillates = np.abs(turns.imag) > 1e-6
    damping = np.where(oscillates, -turns.real / np.maximum(np.abs(turns), 1e-300), 1.0)
    return Stability(
        float(turns.real.max(initial=-inf)) / period,
        float(damping.min(initial=1.0)),
        bool((turns.real <= ROUNDING).all()),
    )


def worst_momentum(
    loop: AttitudeLoop, axes: Array, each: Array
) -> tuple[Array, Stability]:
    """Find the wheel momentum with the smallest damping of the loop.

    Parameters
    ----------
    loop
        The attitude loop.
    axes
        (3, n), axes of the wheels that exist, body.
    each
        (n,) N m s, momentum of each wheel, of either sign.

    Returns
    -------
    tuple
        Total wheel momentum (3,) N m s, body, for the worst signs, and its stability.
    """
    signs = [(1.0, *rest) for rest in product((1.0, -1.0), repeat=len(each) - 1)]
    sums = [axes @ (each * np.array(sign)) for sign in signs] if len(each) else []
    stabilities = [(h, stability(loop, h)) for h in sums]
    if not stabilities:
        return np.zeros(3), stability(loop, np.zeros(3))
    return min(stabilities, key=lambda pair: pair[1].damping)


def longest_sample(
    loop: AttitudeLoop,
    axes: Array,
    each: Array,
    samples: Sequence[float] = SAMPLE_TIMES,
) -> float | None:
    """Return the longest of `samples` (s) at which the loop is well damped, or None.

    The loop is evaluated with wheels at rest and with momenta `each` (n,) N m s of any
    signs about `axes` (3, n), body. Samples longer than the loop's own are left out.
    """
    for sample in sorted(samples, reverse=True):
        if sample > loop.sample() * (1.0 + 1e-9):
            continue
        there = loop.at(sample)
        if not stability(there, np.zeros(3)).well_damped:
            continue
        if worst_momentum(there, axes, each)[1].well_damped:
            return sample
    return None


def _map_over_period(loop: AttitudeLoop, momentum: Array) -> tuple[float, Array]:
    """Compute the common period (s) of all samples and the map (n, n) over it.

    The map takes the state from the beginning of the period to its end.
    """
    counts = {
        name: max(1, round(getattr(loop, name) / loop.step))
        for name in (
            "gyro_sample",
            "attitude_sample",
            "controller_sample",
            "wheel_sample",
        )
    }
    steps = min(lcm(*counts.values()), MOST_STEPS)
    waits = [round(x / loop.step) for x in (loop.controller_delay, loop.manager_delay)]
    size = REST + 3 * sum(waits)
    cross = _cross(momentum)
    moves = _moves(loop, cross, size)
    transition = np.eye(size)
    maps: dict[tuple[bool, ...], Array] = {}
    for k in range(steps):
        due = tuple(k % count == 0 for count in counts.values())
        if due not in maps:
            maps[due] = moves @ _samples(loop, cross, due, waits, size)
        transition = maps[due] @ transition
    return steps * loop.step, transition


def _cross(a: Array) -> Array:
    """Return the matrix (3, 3) that maps b to a x b."""
    x, y, z = a.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _moves(loop: AttitudeLoop, cross: Array, size: int) -> Array:
    """Compute the map (size, size) of the state over a step between samples."""
    inverse = np.linalg.inv(loop.inertia)
    flow = np.zeros((REST, REST))
    flow[ANGLE, RATE] = np.eye(3)
    flow[RATE, RATE] = inverse @ cross  # -omega x H = H x omega
    torque = TORQUE if loop.motor_lag > 0.0 else COMMAND
    flow[RATE, torque] = inverse @ loop.actuated
    if loop.motor_lag > 0.0:
        flow[TORQUE, TORQUE] = -np.eye(3) / loop.motor_lag
        flow[TORQUE, COMMAND] = np.eye(3) / loop.motor_lag
    transition = np.eye(size)
    transition[:REST, :REST] = _exponential(flow * loop.step)
    return transition


def _exponential(a: Array) -> Array:
    """Compute exp(a) by scaling and squaring.

    scipy.linalg.expm does the same; its import alone takes longer than all of a check.
    """
    norm = float(np.abs(a).sum(axis=1).max())
    halvings = max(0, int(np.ceil(np.log2(max(norm, 1e-300)))) + 2)
    small, term = a / 2.0**halvings, np.eye(len(a))
    terms = [term := term @ small / k for k in range(1, 14)]
    series: Array = np.eye(len(a)) + np.sum(terms, axis=0)
    return reduce(lambda x, _: x @ x, range(halvings), series)


def _samples(
    loop: AttitudeLoop,
    cross: Array,
    due: Sequence[bool],
    waits: Sequence[int],
    size: int,
) -> Array:
    """Compute the map of the state at samples: sensors, controller, then manager.

    `due` says which of gyro, attitude, controller and manager sample. `waits` gives the
    delays, in steps, of commands of controller and manager, which are stored behind
    REST.
    """
    gyro, attitude, controller, manager = due
    total = np.eye(size)

    def pick(source: slice) -> Array:
        row = np.zeros((3, size))
        row[:, source] = np.eye(3)
        return row

    if gyro:
        total[SEEN_RATE] = total[RATE]
    if attitude:
        total[SEEN_ANGLE] = total[ANGLE]
    if controller:
        total[INTEGRAL] += 0.5 * loop.controller_sample * total[SEEN_ANGLE]
        gains = loop.kp * 0.5 * pick(SEEN_ANGLE)
        gains += loop.kd * pick(SEEN_RATE) + loop.ki * pick(INTEGRAL)
        total[CONTROL] = -loop.gain_matrix @ gains @ total
    queues = _queues(waits)
    if manager:
        row = pick(queues[0][-1])
        if loop.gyroscopic:
            row[:, SEEN_RATE] -= cross  # omega x H = -H x omega
        total[DECIDED] = row @ total
    total[COMMAND] = total[queues[1][-1]]
    for queue in queues:
        for older, newer in zip(queue[:0:-1], queue[-2::-1], strict=True):
            total[older] = total[newer]
    return total


def _queues(waits: Sequence[int]) -> list[list[slice]]:
    """Return the places of delayed commands of controller and manager, newest first."""
    queues, place = [], REST
    for decided, wait in zip((CONTROL, DECIDED), waits, strict=True):
        places = [slice(place + 3 * k, place + 3 * k + 3) for k in range(wait)]
        queues.append([decided, *places])
        place += 3 * wait
    return queues
