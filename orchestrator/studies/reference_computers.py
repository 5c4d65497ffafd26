"""Magnetometer, controller and manager of the monolithic reference: what they do at their samples,
and when these are."""

from __future__ import annotations

from math import copysign, floor, inf
from typing import Any

import numpy as np

from desat.components.contract.block import Vec3, Vec4
from desat.components.laws import attitude_control, cross_product
from desat.components.maths import attitude, vector
from desat.components.physics import wheel_array

from .reference_plant import SAME_TIME, Plant, Q, State, part
from .reference_scope import Values

LIMITED, PULSED = 1, 2
"""Drives of the torquers, beside the ideal one."""


class Clock:
    """A component's samples, by the rule of the blocks; 0: at every time it is asked for."""

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
        self.drive, self.limit = int(one("torquers", "drive")), one("torquers", "m_limit")
        self._period, self._pulse = one("torquers", "sample_time"), one("torquers", "least_pulse")
        self._most = floor(one("torquers", "duty_max") * self._period / self._pulse + 1e-9)
        self._late = one("torquers", "pulse_delay")
        self._pulses: tuple[tuple[float, float, float], ...] = ((-inf, inf, 0.0),) * 3
        """Of each coil: from when to when (s), and its dipole (A m2)."""

    def take(self, t: float, wanted: Vec3) -> None:
        """A sample at t (s) of a dipole command (A m2)."""
        if self.drive == PULSED:
            begin = t + self._late
            self._pulses = tuple(
                (begin, begin + self._width(m), copysign(self.limit, m)) for m in wanted
            )
        else:
            most = self.limit if self.drive == LIMITED else inf
            self._pulses = tuple((t, inf, m) for m in vector.clip(wanted, most))

    def _width(self, m: float) -> float:
        share = abs(m) / self.limit * self._period
        return min(floor(share / self._pulse + 0.5), self._most) * self._pulse

    def edges(self) -> list[float]:
        """When a coil is switched (s)."""
        return [t for begin, end, _ in self._pulses for t in (begin, end) if abs(t) < inf]

    def at(self, t: float) -> Vec3:
        """The dipole (A m2) that the coils are driven to from t (s) on."""
        x, y, z = (
            m if begin <= t + SAME_TIME < end else 0.0 for begin, end, m in self._pulses
        )  # fmt: skip
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
        self.q_ref = attitude.normalised(many("guidance", "q_target_bi"))
        self.gains = tuple(one("controller", n) for n in ("kp", "kd", "ki"))
        self.gain_matrix = many("controller", "gain_matrix")
        self.integral_limit = one("controller", "integral_limit")
        self.control_limit = one("controller", "torque_limit")
        self.anti_windup = bool(one("controller", "anti_windup"))
        self.bias = many("magnetometer", "bias_body")
        self.dumping = bool(one("manager", "enable"))
        self.law = (cross_product.normalised, cross_product.ccpl)[int(one("manager", "law"))]
        self.gain, self.deadband = one("manager", "gain"), one("manager", "h_deadband")
        self.target = many("manager", "h_target_body")
        self.dipole_limit = one("manager", "m_limit") if one("manager", "saturation") else np.inf
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
        e, d_omega = attitude_control.tracking_error(part(y, Q), omega, self.q_ref, vector.ZERO)
        time = self.clocks["controller"].sample_time
        xi = attitude_control.integrated(self.xi, e, time, self.integral_limit)
        tau = self._pid(e, d_omega, xi)
        if self.anti_windup and tau != attitude_control.limited(tau, self.control_limit):
            xi = attitude_control.unwound(self.xi, xi)
            tau = self._pid(e, d_omega, xi)
        self.xi, self.tau = xi, attitude_control.limited(tau, self.control_limit)
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
        command = wheel_array.wheel_torque(self.pinv, self.plant.axes, self.absorbed, tau, rate, h)
        limit = self.plant.torque_limit
        a, b, c, d = (min(max(x, -limit), limit) for x in command)
        return (a, b, c, d)
