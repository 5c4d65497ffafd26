from __future__ import annotations

from math import floor

from ..contract.block import Parameter, Vec3, Vec4
from ..contract.roles import WheelInertias
from ..contract.roles import Wheels as Role
from ..maths.noise import normal3
from ..maths.vector import cross, norm
from ..physics.rotor import step

TORQUE, SPEED = range(2)


class Wheels(Role, WheelInertias):
    """Reaction wheels, one to four, with motor lag, friction, limits and failures

    For each wheel, g its axis, Omega = h / J_s - g.omega its speed relative to the body:

        h' = T - friction(Omega) + learnt,     T' = (command - T) / lag
        friction = c_v Omega + c_c tanh(Omega / omega_eps)
        learnt' = compensation (friction - learnt)

    `command` is the torque command within +-torque_limit (`command_mode` torque), or
    speed_gain J_s (speed command - Omega) within it (`speed`). At |h| = J_s speed_limit the wheel
    is saturated and takes no more. Below omega_eps a motor torque under `stiction` leaves the
    rotor standing. A failed wheel's motor gives no torque from `failed_from` on.

    What leaves the block is what the rotors took: over a step from h0 to h1

        tau_mean = (h1 - h0) / H,     tau_slope = 12 (I1 - tau_mean / 2)
        I1 = (h1 - mean of h) / H

    The body's rate inside the step is extrapolated from its last two values. Unbalance is an
    equivalent noise torque on the body, tau_jitter = unbalance Omega^2 n (n a unit normal number
    across the axis, a new one each second), and never part of tau_mean_wheel.

    Source: definition of the exchange in the project's design; friction as in Wertz (1978) and
    paper 004.
    """

    h_start_wheel: Vec4 = Parameter("N.m.s", "axial momentum at the start, absolute")
    command_mode: int = Parameter(
        "1", "which command counts", choices=("torque", "speed"), start="torque",
        needs=("speed_cmd_wheel", "omega_bi_body"),
    )  # fmt: skip
    torque_limit: float = Parameter("N.m", "largest motor torque of a wheel", start=0.02, min=0.0)
    speed_limit: float = Parameter(
        "rad/s", "speed at which a wheel is saturated", start=600.0, min=1e-3
    )
    speed_gain: float = Parameter("1/s", "speed mode: bandwidth of the loop", start=0.5, min=0.0)
    motor_lag: float = Parameter("s", "time constant of the motor; 0: none", min=0.0)
    viscous: float = Parameter(
        "N.m.s/rad", "viscous friction c_v", min=0.0, needs=("omega_bi_body",)
    )
    coulomb: float = Parameter(
        "N.m", "Coulomb friction c_c", min=0.0, needs=("omega_bi_body",)
    )  # fmt: skip
    friction_speed: float = Parameter(
        "rad/s", "omega_eps: speed over which Coulomb friction turns", start=2.0, min=1e-6
    )
    compensation: float = Parameter(
        "1/s", "bandwidth of the loop that compensates friction; 0: none", min=0.0
    )
    stiction: float = Parameter("N.m", "torque that a standing rotor resists", min=0.0,
                                needs=("omega_bi_body",))  # fmt: skip
    failed: int = Parameter(
        "1", "which wheel fails", choices=("none", "1", "2", "3", "4"), start="none"
    )
    failed_from: float = Parameter("s", "when it fails", start=0.0)
    unbalance: float = Parameter(
        "kg.m2", "jitter: equivalent noise torque over squared speed", min=0.0,
        needs=("tau_jitter_body", "omega_bi_body"),
    )  # fmt: skip
    seed: int = Parameter("1", "seed of the jitter", start=1)
    idle_power: float = Parameter("W", "power of the electronics of each wheel", min=0.0)
    motor_constant: float = Parameter(
        "N.m", "torque that costs 1 W of copper loss; 0: no copper loss", min=0.0
    )

    def start(self) -> None:
        self._present = tuple(i for i in range(4) if self.inertia_wheel[i] > 0.0)
        self._motors = tuple(
            (j, self.motor_lag, self.viscous, self.coulomb, self.friction_speed,
             self.compensation, self.stiction)
            for j in self.inertia_wheel
        )  # fmt: skip
        self._rotors = tuple((h, 0.0, 0.0) for h in self.h_start_wheel)
        self._rates = self._last_rates = self._axial(self.omega_bi_body)
        self._last_dt = 0.0
        self.tau_mean_wheel = self.tau_slope_wheel = (0.0, 0.0, 0.0, 0.0)
        self.tau_jitter_body = (0.0, 0.0, 0.0)
        self._jitter_second = -1
        self._unit_jitter: tuple[Vec3, ...] = ()
        self._failed = False
        for i in self._present:
            if abs(norm(self._axis(i)) - 1.0) > 1e-6:
                self.fail(f"axes_wheel: column {i + 1} = {self._axis(i)} is not a unit vector")

    def _axis(self, i: int) -> Vec3:
        a = self.axes_wheel
        return (a[i], a[4 + i], a[8 + i])

    def _axial(self, omega: Vec3) -> Vec4:
        """g.omega of each wheel."""
        a, (x, y, z) = self.axes_wheel, omega
        return (
            a[0] * x + a[4] * y + a[8] * z,
            a[1] * x + a[5] * y + a[9] * z,
            a[2] * x + a[6] * y + a[10] * z,
            a[3] * x + a[7] * y + a[11] * z,
        )

    def _speed(self, i: int) -> float:
        return self._rotors[i][0] / self.inertia_wheel[i] - self._rates[i]

    def output(self, t: float) -> None:
        h, speed, saturated = [0.0] * 4, [0.0] * 4, [False] * 4
        rates, inertia, fastest = self._rates, self.inertia_wheel, self.speed_limit
        idle, constant = self.idle_power, self.motor_constant
        power = 0.0
        for i in self._present:
            momentum, torque, learnt = self._rotors[i]
            h[i] = momentum
            speed[i] = momentum / inertia[i] - rates[i]
            saturated[i] = abs(momentum) >= inertia[i] * fastest
            drive = torque + learnt
            power += idle + max(0.0, drive * speed[i])
            if constant > 0.0:
                power += (drive / constant) ** 2
        self.h_wheel = (h[0], h[1], h[2], h[3])
        self.speed_wheel = (speed[0], speed[1], speed[2], speed[3])
        self.saturated_wheel = (saturated[0], saturated[1], saturated[2], saturated[3])
        failed = self.failed if self._failed else 0
        self.failed_wheel = (failed == 1, failed == 2, failed == 3, failed == 4)
        self.power = power

    def _has_failed(self, i: int) -> bool:
        return self._failed and self.failed == i + 1

    def advance(self, t: float, dt: float) -> None:
        self._failed = t >= self.failed_from
        now = self._axial(self.omega_bi_body)
        ahead = dt / self._last_dt if self._last_dt > 0.0 else 0.0
        a, b = now, self._last_rates
        then = (
            a[0] + ahead * (a[0] - b[0]), a[1] + ahead * (a[1] - b[1]),
            a[2] + ahead * (a[2] - b[2]), a[3] + ahead * (a[3] - b[3]),
        )  # fmt: skip
        self._rates, self._last_rates, self._last_dt = now, now, dt
        if self.unbalance > 0.0:
            self.tau_jitter_body = self._jitter(t)
        mean, slope, rotors = [0.0] * 4, [0.0] * 4, list(self._rotors)
        for i in self._present:
            motor, rotor, command = self._motors[i], rotors[i], self._command(i)
            if self._has_failed(i):
                motor, rotor, command = (*motor[:5], 0.0, motor[6]), (rotor[0], 0.0, 0.0), 0.0
            limit = self.inertia_wheel[i] * self.speed_limit
            rotors[i], integral = step(motor, rotor, command, now[i], then[i], dt, limit)
            h0, h1 = rotor[0], rotors[i][0]
            mean[i] = (h1 - h0) / dt
            slope[i] = 12.0 * ((h1 - integral / dt) / dt - 0.5 * mean[i])
        self._rotors, self._rates = (
            tuple(rotors),
            then,
        )  # `then`: for the speeds until the next step
        self.tau_mean_wheel = (mean[0], mean[1], mean[2], mean[3])
        self.tau_slope_wheel = (slope[0], slope[1], slope[2], slope[3])

    def _command(self, i: int) -> float:
        if self.command_mode == TORQUE:
            wanted = self.tau_cmd_wheel[i]
        else:
            error = self.speed_cmd_wheel[i] - self._speed(i)
            wanted = self.speed_gain * self.inertia_wheel[i] * error
        return min(max(wanted, -self.torque_limit), self.torque_limit)

    def _jitter(self, t: float) -> Vec3:
        second = floor(t + 1e-6)
        if second != self._jitter_second:
            self._jitter_second = second
            self._unit_jitter = tuple(
                cross(self._axis(i), normal3(self.seed, second, 4 * i)) for i in self._present
            )
        x = y = z = 0.0
        for i, (jx, jy, jz) in zip(self._present, self._unit_jitter, strict=True):
            size = self.unbalance * self._speed(i) ** 2
            x, y, z = x + size * jx, y + size * jy, z + size * jz
        return (x, y, z)
