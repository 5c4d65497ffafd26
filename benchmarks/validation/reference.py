"""The monolithic reference of a gyrostat: the uncut system, against which the cut one
is held.

One system of ordinary differential equations (`reference_plant.py`, which also says
what of systems it knows), integrated from event to event (`reference_events.py`),
without blocks, FMUs or exchange. Here is what happens at known times: samples of
computers and sensors, edges of firings, a failure.

With a `step` of delay it is the same system as a `jacobi` master with that step makes
it: an interval output reaches its consumer one step late.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise
from math import copysign, floor, inf
from typing import Any

import numpy as np

from desat.components.contract.block import Vec3, Vec4
from desat.components.laws import attitude_control, cross_product
from desat.components.maths import attitude, vector
from desat.components.physics import wheel_array
from desat.system.errors import DesatError
from desat.system.model import System

from .reference_events import Piece, advance
from .reference_plant import (
    LEARNT,
    MOTOR,
    NO_WHEEL,
    SAME_TIME,
    Array,
    H,
    Held,
    Late,
    M,
    Plant,
    Q,
    State,
    Values,
    part,
)

# ------------------------------------------------------------------------------------------------
# Magnetometer, controller and manager of the monolithic reference: what they do at their samples,
# and when these are


LIMITED, PULSED = 1, 2
"""Drives of the torquers, beside the ideal one."""


class Clock:
    """A component's samples, by the rule of the blocks; 0: at every time it is asked
    for."""

    def __init__(self, sample_time: float) -> None:
        self.sample_time = sample_time
        self._last = -1

    def due(self, t: float) -> bool:
        """True when there is a sample at t (s) that has not been taken."""
        if self.sample_time <= 0.0:
            return True
        sample = floor(t / self.sample_time + 1e-6)
        due, self._last = sample > self._last, sample
        return due


class Outbox:
    """Commands (in SI units) that leave a computer `delay` (s) after they are decided."""

    def __init__(self, delay: float, first: tuple[float, ...]) -> None:
        self.delay = delay
        self._waiting = [(-inf, first)]

    def decide(self, t: float, command: tuple[float, ...]) -> None:
        """What is decided at t (s)."""
        self._waiting.append((t + self.delay, command))

    def at(self, t: float) -> Any:
        """What has left last at t (s)."""
        while len(self._waiting) > 1 and self._waiting[1][0] <= t + SAME_TIME:
            del self._waiting[0]
        return self._waiting[0][1]


class Coils:
    """The torquers' samples: what each coil is driven to, from when to when."""

    def __init__(self, values: Values) -> None:
        one = values.one
        self.drive, self.limit = (
            int(one("torquers", "drive")),
            one("torquers", "m_limit"),
        )
        self._period, self._pulse = (
            one("torquers", "sample_time"),
            one("torquers", "least_pulse"),
        )
        self._most = floor(
            one("torquers", "duty_max") * self._period / self._pulse + 1e-9
        )
        self._late = one("torquers", "pulse_delay")
        self._pulses: tuple[tuple[float, float, float], ...] = ((-inf, inf, 0.0),) * 3
        """Of each coil: from when to when (s), and its dipole (A m2)."""

    def take(self, t: float, expected: Vec3) -> None:
        """A sample at t (s) of a dipole command (A m2)."""
        if self.drive == PULSED:
            begin = t + self._late
            self._pulses = tuple(
                (begin, begin + self._width(m), copysign(self.limit, m))
                for m in expected
            )
        else:
            most = self.limit if self.drive == LIMITED else inf
            self._pulses = tuple((t, inf, m) for m in vector.clip(expected, most))

    def _width(self, m: float) -> float:
        share = abs(m) / self.limit * self._period
        return min(floor(share / self._pulse + 0.5), self._most) * self._pulse

    def edges(self) -> list[float]:
        """When a coil is switched (s)."""
        return [
            t for begin, end, _ in self._pulses for t in (begin, end) if abs(t) < inf
        ]

    def at(self, t: float) -> Vec3:
        """The dipole (A m2) that the coils are driven to from t (s) on."""
        x, y, z = (
            m if begin <= t + SAME_TIME < end else 0.0 for begin, end, m in self._pulses
        )
        return (x, y, z)


class Computers:
    """Magnetometer, controller and manager: what they hold from sample to sample."""

    def __init__(self, values: Values, plant: Plant) -> None:
        self.plant = plant
        one, many = values.one, values.many
        roles = ("magnetometer", "controller", "manager", "torquers")
        self.clocks = {role: Clock(one(role, "sample_time")) for role in roles}
        self.clocks["wheels"] = Clock(
            one("manager", "wheel_sample_time") or one("manager", "sample_time")
        )
        self.pinv = wheel_array.pseudo_inverse(plant.axes)
        self.q_ref = attitude.normalise(many("guidance", "q_target_bi"))
        self.gains = tuple(one("controller", n) for n in ("kp", "kd", "ki"))
        self.gain_matrix = many("controller", "gain_matrix")
        self.integral_limit = one("controller", "integral_limit")
        self.control_limit = one("controller", "torque_limit")
        self.anti_windup = bool(one("controller", "anti_windup"))
        self.bias = many("magnetometer", "bias_body")
        self.dumping = bool(one("manager", "enable"))
        self.law = (cross_product.normalised, cross_product.ccpl)[
            int(one("manager", "law"))
        ]
        self.gain, self.deadband = one("manager", "gain"), one("manager", "h_deadband")
        self.target = many("manager", "h_target_body")
        self.dipole_limit = (
            one("manager", "m_limit") if one("manager", "saturation") else np.inf
        )
        self.feedforward = bool(one("manager", "feedforward"))
        self.gyroscopic = bool(one("manager", "gyroscopic"))
        self.coils = Coils(values)
        late = one("manager", "delay")
        self.torque = Outbox(one("controller", "delay"), vector.ZERO)
        self.dipole, self.command = Outbox(late, vector.ZERO), Outbox(late, (0.0,) * 4)
        self.xi = self.tau = self.absorbed = self.m = vector.ZERO

    def due(self, role: str, t: float) -> bool:
        """True when a role takes a sample at t (s)."""
        return self.clocks[role].due(t)

    def measure(self, t: float, y: State) -> Vec3:
        """The magnetometer's field (T, body)."""
        field = self.plant.field(t, self.plant.place(t))
        return vector.add(attitude.rotate(part(y, Q), field), self.bias)

    def control(self, y: State, omega: Vec3) -> Vec3:
        """The controller's sample: the torque (N m) that it wants on the body."""
        e, d_omega = attitude_control.tracking_error(
            part(y, Q), omega, self.q_ref, vector.ZERO
        )
        time = self.clocks["controller"].sample_time
        xi = attitude_control.integrate_error(self.xi, e, time, self.integral_limit)
        tau = self._pid(e, d_omega, xi)
        if self.anti_windup and tau != attitude_control.limit_torque(
            tau, self.control_limit
        ):
            xi = attitude_control.unwound(self.xi, xi)
            tau = self._pid(e, d_omega, xi)
        self.xi, self.tau = xi, attitude_control.limit_torque(tau, self.control_limit)
        return self.tau

    def _pid(self, e: Vec3, d_omega: Vec3, xi: Vec3) -> Vec3:
        kp, kd, ki = self.gains
        return attitude_control.pid_torque(e, d_omega, xi, kp, kd, ki, self.gain_matrix)

    def dump(self, h: Vec4, b: Vec3) -> Vec3:
        """The manager's sample: its dipole command (A m2)."""
        excess = vector.sub(wheel_array.body_momentum(self.plant.axes, h), self.target)
        self.m = vector.ZERO
        if self.dumping and vector.norm(excess) > self.deadband:
            self.m = vector.clip(self.law(excess, b, self.gain), self.dipole_limit)
        self.absorbed = vector.cross(self.m, b) if self.feedforward else vector.ZERO
        return self.m

    def wheels(self, omega: Vec3, h: Vec4, tau: Vec3) -> Vec4:
        """The torque command of each wheel (N m), as its motor takes it."""
        rate = omega if self.gyroscopic else vector.ZERO
        command = wheel_array.wheel_torque(
            self.pinv, self.plant.axes, self.absorbed, tau, rate, h
        )
        limit = self.plant.torque_limit
        a, b, c, d = (min(max(x, -limit), limit) for x in command)
        return (a, b, c, d)


@dataclass(frozen=True)
class Trajectory:
    """The reference at the controller's samples: times (n,), q (n, 4), omega (n, 3), h
    (n, 4)."""

    times: Array
    q: Array
    omega: Array
    h: Array


class Gyrostat:
    """The uncut system of a checked scenario. Raises DesatError for one that it does
    not know."""

    def __init__(self, system: System) -> None:
        values = Values(system)
        self._decimated = [
            c.name for c in system.components.values() if c.step_ratio != 1
        ]
        self.start, self.stop = system.start, system.stop
        self.sample = values.one("controller", "sample_time")
        self._values, self.plant = values, Plant(values)
        late = values.one("manager", "delay")
        self._delays = {
            "controller": values.one("controller", "delay"),
            "manager": late,
            "wheels": late,
        }
        self._failed = int(values.one("wheels", "failed")) - 1
        self._failed_from = values.one("wheels", "failed_from")
        self._firings: list[tuple[float, float, Vec3]] = []
        if "thrusters" in values.known:
            begins, seconds, torque = (
                values.many("thrusters", f"schedule_{n}")
                for n in ("start", "duration", "tau_body")
            )
            self._firings = [
                (begin, begin + long, torque[3 * i : 3 * i + 3])
                for i, (begin, long) in enumerate(zip(begins, seconds, strict=True))
                if long > 0.0
            ]

    # --- what happens at known times --------------------------------------------------

    def _edges(self) -> list[float]:
        """When firings begin and end, and when a wheel fails (s)."""
        edges = [t for begin, end, _ in self._firings for t in (begin, end)]
        return edges + ([self._failed_from] if self._failed != NO_WHEEL else [])

    def _thrust(self, t: float) -> Vec3:
        """The torque (N m, body) of the firings from t (s) on."""
        total = vector.ZERO
        for begin, end, torque in self._firings:
            if begin <= t + SAME_TIME and t + SAME_TIME < end:
                total = vector.add(total, torque)
        return total

    def _failure(self, t: float, y: State, held: Held) -> Held:
        """The motor of the wheel that fails gives no torque from then on."""
        i = self._failed
        if i == NO_WHEEL or held.dead == i or t + SAME_TIME < self._failed_from:
            return held
        y[MOTOR.start + i] = y[LEARNT.start + i] = 0.0
        return replace(held, dead=i)

    def _commanded(self, y: State, held: Held, command: Vec4, coils: Vec3) -> Held:
        """New commands; a motor or coil without lag follows at once."""
        if held.dead != NO_WHEEL:
            a, b, c, d = (0.0 if i == held.dead else x for i, x in enumerate(command))
            command = (a, b, c, d)
        if self.plant.motor_lag == 0.0:
            y[MOTOR] = command
        if self.plant.coil_lag == 0.0:
            y[M] = coils
        return replace(held, command=command, coils=coils)

    def _times(self, *grids: tuple[float, float]) -> list[float]:
        """The edges from start to stop, and of each grid (s) all multiples and the
        times so much (s) after them; each once."""
        times = [*self._edges(), self.start, self.stop]
        for step, late in grids:
            first, last = (floor(x / step + 1e-6) for x in (self.start, self.stop))
            samples = [k * step for k in range(first, last + 1)]
            times += [*samples, *(t + late for t in samples if late > 0.0)]
        return _once(times, self.start, self.stop)

    # --- its solution -----------------------------------------------------------------

    def ideal(self) -> Trajectory:
        """Without any delay: commands act from the sample they are computed from."""
        plant, computers = self.plant, Computers(self._values, self.plant)
        y, held, coils = plant.start_state(), plant.start_held(), computers.coils
        grids = [
            (clock.sample_time, self._delays.get(role, 0.0))
            for role, clock in computers.clocks.items()
            if clock.sample_time > 0.0
        ]
        rows = _Rows(plant, self.start, self.sample)
        rows.add(self.start, y, held)
        b = vector.ZERO
        for t, end in pairwise(self._times(*grids)):
            held = replace(self._failure(t, y, held), thrust=self._thrust(t))
            omega, h = plant.motion(t, y, held)
            if computers.due("magnetometer", t):
                b = computers.measure(t, y)
            if computers.due("controller", t):
                computers.torque.decide(t, computers.control(y, omega))
            if computers.due("manager", t):
                computers.dipole.decide(t, computers.dump(h, b))
            if computers.due("wheels", t):
                tau = computers.torque.at(t)
                computers.command.decide(t, computers.wheels(omega, h, tau))
            if computers.due("torquers", t):
                coils.take(t, computers.dipole.at(t))
            command = computers.command.at(t)
            for first, last in pairwise(_once([t, *coils.edges(), end], t, end)):
                held = self._commanded(y, held, command, coils.at(first))
                y, held, _ = advance(plant, first, last, y, held)
            rows.add(end, y, held)
        return rows.trajectory()

    def delayed(self, step: float) -> Trajectory:
        """As a `jacobi` master with this step (s) makes it.

        The controller's torque reaches the manager one step later, the manager's
        commands wheels and torquers one later again, the magnetometer's field the
        manager one later; what wheels, torquers and thrusters do reaches the body one
        step later. Raises DesatError where a wheel comes to its limit, for stiction,
        pulsed coils, computers with a delay of their own, and where components are
        decimated.
        """
        if self._decimated:
            raise DesatError(
                f"delays of decimated components: {', '.join(self._decimated)}"
            )
        one = self._values.one
        unknown = {
            "wheels.stiction": one("wheels", "stiction") > 0.0,
            "torquers.drive = pulsed": one("torquers", "drive") == PULSED,
            **{f"{role}.delay": late > 0.0 for role, late in self._delays.items()},
        }
        if names := [name for name, there in unknown.items() if there]:
            raise DesatError(
                f"the reference with the delays of another master does not know {', '.join(names)}"
            )
        plant, computers = self.plant, Computers(self._values, self.plant)
        y, held = plant.start_state(), Held()
        rows = _Rows(plant, self.start, self.sample)
        rows.add(self.start, y, held)
        count = round((self.stop - self.start) / step)
        grid = [self.start + k * step for k in range(count + 1)]
        b = computers.measure(self.start, y)
        seen_tau = expected = coils = vector.ZERO
        command = held.command
        past: list[Piece] = []
        h_start = part(y, H)
        for t, end in pairwise(grid):
            late = _Past(past, step, h_start)
            omega, h = plant.motion(t, y, held, late.at(t))
            tau, m = seen_tau, expected
            if computers.due("torquers", t):
                computers.coils.take(t, expected)
                coils = computers.coils.at(t)
            if computers.due("manager", t):
                m = computers.dump(h, b)
            next_command = command
            if computers.due("wheels", t):
                next_command = computers.wheels(omega, h, seen_tau)
            if computers.due("controller", t):
                tau = computers.control(y, omega)
            if computers.due("magnetometer", t):
                b = computers.measure(t, y)
            now: list[Piece] = []
            for first, last in pairwise(
                _once([*self._edges(), *late.edges(), t, end], t, end)
            ):
                held = replace(
                    self._failure(first, y, held), thrust=self._thrust(first)
                )
                held = self._commanded(y, held, command, coils)
                y, held, pieces = advance(plant, first, last, y, held, late.at(first))
                now += pieces
            past, command, expected, seen_tau = now, next_command, m, tau
            rows.add(end, y, held, _Past(past, step, h_start).at(end))
        return rows.trajectory()


def _once(times: Iterable[float], start: float, stop: float) -> list[float]:
    """The times from start to stop in order, those nearer than SAME_TIME once."""
    result: list[float] = []
    for t in sorted(times):
        after = not result or t - result[-1] >= SAME_TIME
        if after and start - SAME_TIME <= t <= stop + SAME_TIME:
            result.append(t)
    return result


class _Past:
    """What the body feels one step (s) after it was so."""

    def __init__(self, pieces: list[Piece], step: float, h_start: Vec4) -> None:
        self.pieces, self.step, self.h_start = pieces, step, h_start

    def edges(self) -> list[float]:
        """When something happens in what is felt (s)."""
        return [p.begin + self.step for p in self.pieces]

    def at(self, t: float) -> Late:
        """What is felt from t (s) to the next edge."""
        past = [p for p in self.pieces if p.begin + self.step <= t + SAME_TIME]
        if not past:
            return Late(lambda t: self.h_start, lambda t: vector.ZERO, vector.ZERO)
        piece, step = past[-1], self.step
        assert piece.at is not None
        solution: Any = piece.at
        return Late(
            lambda t: tuple(solution(t - step)[H].tolist()),
            lambda t: tuple(solution(t - step)[M].tolist()),
            piece.held.thrust,
        )


class _Rows:
    """The states at the controller's samples."""

    def __init__(self, plant: Plant, start: float, sample: float) -> None:
        self.plant, self.start, self.sample = plant, start, sample
        self.rows: list[tuple[float, Any, Vec3, Vec4]] = []

    def add(self, t: float, y: State, held: Held, late: Late | None = None) -> None:
        """Keep the state at t (s), where a sample stands."""
        count = round((t - self.start) / self.sample)
        if abs(t - self.start - count * self.sample) < SAME_TIME and count == len(
            self.rows
        ):
            self.rows.append((t, part(y, Q), *self.plant.motion(t, y, held, late)))

    def trajectory(self) -> Trajectory:
        """All of them."""
        times, q, omega, h = (np.array(x) for x in zip(*self.rows, strict=True))
        return Trajectory(times, q, omega, h)
