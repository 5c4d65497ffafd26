from __future__ import annotations

from collections.abc import Iterator
from math import cos, floor, inf, pi, sin

from ..contract.block import Parameter, PerWheel, Vec3, group_of
from ..contract.roles import WheelInertias
from ..contract.roles import Wheels as Role
from ..maths.noise import stream, uniform
from ..maths.vector import ZERO, add, cross, dot, norm, scale, sub, unit
from ..physics.rotor import AT_LIMIT, Motor, Rotor, step

TORQUE, SPEED = range(2)
FULL_TURN = 2.0 * pi
EDGE = 1e-6  # a time so near a step's end, relative to the step, is the step's end
FLAT = 1e-3  # Sine of the angle up to which axes count as parallel, or as in a plane.

# A speed loop: its last sample and the command (N m) of that sample.
Loop = tuple[int, float]


class Wheels(Role, WheelInertias):
    """Reaction wheels with motor lag, friction, limits and failures

    For each wheel, with g its axis and Omega = h / J_s - g.omega its speed relative to
    the body,

        h' = drive - friction(Omega),      drive = T + learnt, within +-torque_limit
        T' = (command - T) / lag,          learnt' = compensation (friction - learnt)
        friction = c_v Omega + c_c tanh(Omega / omega_eps)

    `command` is the torque command within +-torque_limit (`command_mode` torque), or
    speed_gain J_s (speed command - Omega) within it, sampled every `speed_sample_time`
    by the wheel's own electronics, whatever the step (`speed`). At |Omega| =
    speed_limit the wheel is saturated: it keeps that speed, also while the body turns,
    until its torque points inwards. The motor of a failed wheel gives no torque from
    `failed_from` on; this time may lie inside a step.

    With `stiction` friction is dry, c_v Omega +- c_c, and stops the rotor in a finite
    time. The rotor then stands still relative to the body until the motor's torque and
    that of the body's motion, J_s (g.omega)', differ by more than `stiction`, which is
    at least c_c.

    The outputs are the momentum that the rotors received: over a step from h0 to h1

        tau_mean = (h1 - h0) / H,     tau_slope = 12 (I1 - tau_mean / 2)
        I1 = (h1 - mean of h) / H

    The body's rate inside the step is extrapolated from its last two values.
    `speed_wheel` holds at the beginning of the step and uses the body rate at that
    time. `power` and `saturated_wheel` hold at its end and use the extrapolated rate,
    whose error is at most H^2 (g.omega)''.

    Unbalance is a product of inertia of the rotor, whose momentum across the axis turns
    with it:

        tau_jitter = -(p1 - p0) / H,     p = unbalance Omega e(phi),     phi' = Omega

    with e a unit vector across the axis and the initial phi drawn from the seed. The
    impulse is therefore exact for any step, and none accumulates. It is never part of
    tau_mean_wheel.

    Source: definition of the exchange in the project's design; friction as in Wertz
    (1978) and paper 004.
    """

    h_start_wheel: PerWheel = Parameter(
        "N.m.s", "axial momentum at the start, absolute"
    )
    command_mode: int = Parameter(
        "1",
        "which command counts",
        choices=("torque", "speed"),
        start="torque",
        needs=("speed_cmd_wheel", "omega_bi_body"),
    )
    torque_limit: float = Parameter(
        "N.m", "largest motor torque of a wheel", start=0.02, min=0.0, usual=(1e-6, 1.0)
    )
    speed_limit: float = Parameter(
        "rad/s",
        "speed at which a wheel is saturated",
        start=600.0,
        min=1e-3,
        usual=(1.0, 1100.0),
    )
    speed_gain: float = Parameter(
        "1/s",
        "speed mode: bandwidth of the loop",
        start=0.5,
        min=0.0,
        usual=(0.0, 20.0),
    )
    speed_sample_time: float = Parameter(
        "s", "speed mode: time between the loop's own samples", start=0.1, min=1e-3
    )
    motor_lag: float = Parameter(
        "s",
        "time constant of the motor; 0: none",
        min=0.0,
        usual=(0.0, 10.0),
    )
    viscous: float = Parameter(
        "N.m.s/rad",
        "viscous friction c_v",
        min=0.0,
        needs=("omega_bi_body",),
        usual=(0.0, 1e-2),
    )
    coulomb: float = Parameter(
        "N.m",
        "Coulomb friction c_c",
        min=0.0,
        needs=("omega_bi_body",),
        usual=(0.0, 0.1),
    )
    friction_speed: float = Parameter(
        "rad/s",
        "omega_eps: speed over which Coulomb friction turns",
        start=2.0,
        min=1e-6,
        usual=(1e-3, 100.0),
    )
    compensation: float = Parameter(
        "1/s",
        "bandwidth of the loop that compensates friction; 0: none",
        min=0.0,
        usual=(0.0, 100.0),
    )
    stiction: float = Parameter(
        "N.m",
        "torque that a standing rotor resists, no less than coulomb; 0: none",
        min=0.0,
        needs=("omega_bi_body",),
        usual=(0.0, 0.1),
    )
    failed: int = Parameter(
        "1",
        "which wheels fail",
        groups=True,
    )
    failed_from: float = Parameter("s", "when they fail", start=0.0)
    unbalance: float = Parameter(
        "kg.m2",
        "product of inertia of each rotor, whose turning makes the jitter",
        min=0.0,
        needs=("tau_jitter_body", "omega_bi_body"),
        usual=(0.0, 1e-3),
    )
    seed: int = Parameter(
        "1",
        "seed of the jitter's phase; instance name and variable key it as well",
        start=1,
    )
    idle_power: float = Parameter(
        "W",
        "power of the electronics of each wheel",
        min=0.0,
        usual=(0.0, 100.0),
    )
    motor_constant: float = Parameter(
        "N.m",
        "torque that costs 1 W of copper loss; 0: no copper loss",
        min=0.0,
        usual=(0.0, 10.0),
    )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: momentum of an absent wheel.

        Raises
        ------
        BlockError
            If the wheels cannot turn the craft about some axis.
        """
        for i in range(len(self.inertia_wheel)):
            self._check_absence(i)
            if self.inertia_wheel[i] == 0.0 and self.h_start_wheel[i] != 0.0:
                yield (
                    f"h_start_wheel[{i + 1}] = {self.h_start_wheel[i]:g} N m s is left out: there "
                    f"is no wheel {i + 1}"
                )
        axes = [self._axis(i) for i in self._present]
        normals = [cross(a, b) for a in axes for b in axes]
        normal = max(normals, key=norm, default=ZERO)
        if len(axes) > 2 and norm(normal) < FLAT:
            along = ", ".join(f"{x:.3g}" for x in axes[0])
            self.fail(
                f"axes_wheel: all are along ({along}): no wheel turns the craft about another"
            )
        elif len(axes) > 2 and all(abs(dot(unit(normal), a)) < FLAT for a in axes):
            about = ", ".join(f"{x:.3g}" for x in unit(normal))
            self.fail(
                f"axes_wheel: they lie in a plane: no wheel turns the craft about ({about})"
            )
        yield from super().foresee(begin, end, wired_names)

    def start(self) -> None:
        """Set rotors, speed loops and rotor angles (rad) to their start values."""
        self._nothing = (0.0,) * len(self.inertia_wheel)
        self._failing = group_of(self.failed, len(self.inertia_wheel))
        self._present = tuple(
            i for i in range(len(self.inertia_wheel)) if self.inertia_wheel[i] > 0.0
        )
        self._check_parameters()
        self._motors: tuple[Motor, ...] = tuple(
            (
                j,
                self.motor_lag,
                self.viscous,
                self.coulomb,
                self.friction_speed,
                self.compensation,
                self.stiction,
                self.torque_limit,
            )
            for j in self.inertia_wheel
        )
        self._rates = self._axial(self.omega_bi_body)
        # rates at the beginning of the last two steps, and their lengths (s)
        self._past: tuple[tuple[PerWheel, float], tuple[PerWheel, float]] = (
            (self._rates, 0.0),
        ) * 2
        self._last_command = self._nothing
        self._steps_since = 0
        self._rotors: tuple[Rotor, ...] = tuple(
            (h, 0.0, 0.0, 0.0) for h in self.h_start_wheel
        )
        self._check_speeds()
        self.speed_wheel = self._speeds()
        self._rotors = tuple(
            (h, 0.0, 0.0, float((speed > 0.0) - (speed < 0.0)))
            for h, speed in zip(self.h_start_wheel, self.speed_wheel, strict=True)
        )
        self._loops: tuple[Loop, ...] = ((-1, 0.0),) * len(self.inertia_wheel)
        self._rotor_angles: tuple[float, ...] = tuple(
            FULL_TURN
            * uniform(stream(self.instance, "tau_jitter_body", self.seed), 0, i)
            for i in range(len(self.inertia_wheel))
        )  # the rotors' angles, rad
        self._across_axes: tuple[tuple[Vec3, Vec3], ...] = tuple(
            self._across_axis(i) for i in range(len(self.inertia_wheel))
        )
        self._across = self._momentum_across(self.speed_wheel)
        self._has_failed = False
        self.tau_mean_wheel = self.tau_slope_wheel = self._nothing
        self.tau_jitter_body = ZERO

    def _check_parameters(self) -> None:
        """Refuse axes, stiction or gains that are invalid."""
        for i in self._present:
            if abs(norm(self._axis(i)) - 1.0) > 1e-6:
                self.fail(
                    f"axes_wheel: column {i + 1} = {self._axis(i)} is not a unit vector"
                )
        if 0.0 < self.stiction < self.coulomb:
            self.fail(
                f"stiction = {self.stiction} N m is below coulomb = {self.coulomb} N m"
            )
        if (
            self.command_mode == SPEED
            and self.speed_gain * self.speed_sample_time > 1.0
        ):
            self.fail(
                f"speed_gain = {self.speed_gain} 1/s is above 1 / speed_sample_time = "
                f"{1.0 / self.speed_sample_time} 1/s"
            )

    def _check_absence(self, i: int) -> None:
        """Refuse values of a wheel that does not exist: one whose spin inertia is 0."""
        if self.inertia_wheel[i] > 0.0:
            return
        if norm(self._axis(i)) > 0.0:
            self.fail(
                f"axes_wheel: column {i + 1} = {self._axis(i)}, but inertia_wheel[{i + 1}] = 0: "
                "a wheel that does not exist has a column of zeros, one that does a spin inertia"
            )
        if self._failing[i]:
            self.fail(f"failed: there is no wheel {i + 1}: inertia_wheel[{i + 1}] = 0")

    def _check_speeds(self) -> None:
        """Refuse initial speeds above the limit."""
        for i in self._present:
            if abs(self._speed(i)) > self.speed_limit * (1.0 + AT_LIMIT):
                self.fail(
                    f"h_start_wheel[{i + 1}] = {self.h_start_wheel[i]} N m s: a speed of "
                    f"{self._speed(i)} rad/s, above speed_limit = {self.speed_limit} rad/s"
                )

    def _axis(self, i: int) -> Vec3:
        """Return the axis of wheel i, body."""
        a, count = self.axes_wheel, len(self.inertia_wheel)
        return (a[i], a[count + i], a[2 * count + i])

    def _axial(self, omega: Vec3) -> PerWheel:
        """Compute g.omega of each wheel (rad/s)."""
        a, count, (x, y, z) = self.axes_wheel, len(self.inertia_wheel), omega
        return tuple(
            a[i] * x + a[count + i] * y + a[2 * count + i] * z for i in range(count)
        )

    def _speed(self, i: int) -> float:
        """Return the speed of rotor i relative to the body (rad/s)."""
        return self._rotors[i][0] / self.inertia_wheel[i] - self._rates[i]

    def _speeds(self) -> PerWheel:
        """Return the speed of each rotor relative to the body (rad/s)."""
        speed = [0.0] * len(self.inertia_wheel)
        for i in self._present:
            speed[i] = self._speed(i)
        return tuple(speed)

    def output(self, t: float) -> None:
        """Set momentum (N m s) and flags of each wheel, and the power (W).

        A wheel takes `idle_power`, its mechanical power where that is positive, and the
        copper loss (drive / motor_constant)^2.
        """
        h, is_saturated = (
            [0.0] * len(self.inertia_wheel),
            [False] * len(self.inertia_wheel),
        )
        rotors, inertia, rates = self._rotors, self.inertia_wheel, self._rates
        idle, constant = self.idle_power, self.motor_constant
        fastest = self.speed_limit * (1.0 - AT_LIMIT)
        power = 0.0
        for i in self._present:
            h[i], torque, learnt, _ = rotors[i]
            speed = h[i] / inertia[i] - rates[i]
            is_saturated[i] = abs(speed) >= fastest
            drive = self.driven(torque + learnt, speed)
            power += idle + max(0.0, drive * speed)
            if constant > 0.0:
                power += (drive / constant) ** 2
        self.h_wheel, self.saturated_wheel = tuple(h), tuple(is_saturated)
        self.failed_wheel = tuple(
            self._has_failed and self._failing[i]
            for i in range(len(self.inertia_wheel))
        )
        self.power = power

    def advance(self, t: float, dt: float) -> None:
        """Propagate the rotors over dt (s); set mean and slope of their torques (N m).

        Mean and slope preserve the change of the rotor's momentum and its integral over
        the step. `speed_wheel` (rad/s) is the speed at the beginning.
        """
        now = self._axial(self.omega_bi_body)
        then = self._ahead(now, dt)
        self._rates = now
        count = len(self.inertia_wheel)
        mean, slope, angles = [0.0] * count, [0.0] * count, list(self._rotor_angles)
        rotors, loops, speed = list(self._rotors), list(self._loops), [0.0] * count
        inertia, torque_mode = self.inertia_wheel, self.command_mode == TORQUE
        most = self.torque_limit
        for i in self._present:
            h0 = rotors[i][0]
            speed[i] = h0 / inertia[i] - now[i]
            if torque_mode and not self._failing[i]:
                command = min(max(self.tau_cmd_wheel[i], -most), most)
                rotors[i], integral = self.propagate_rotor(
                    self._motors[i],
                    rotors[i],
                    command,
                    now[i],
                    then[i],
                    dt,
                    self.speed_limit,
                )
            else:
                rotors[i], integral, loops[i] = self._in_pieces(
                    i, t, dt, now[i], then[i]
                )
            h1 = rotors[i][0]
            mean[i] = (h1 - h0) / dt
            slope[i] = 12.0 * ((h1 - integral / dt) / dt - 0.5 * mean[i])
            angles[i] += integral / inertia[i] - 0.5 * dt * (now[i] + then[i])
        self._rotors, self._loops = tuple(rotors), tuple(loops)
        self._rates = then  # for the next outputs
        self.speed_wheel = tuple(speed)
        self._has_failed = self.failed > 0 and t + dt >= self.failed_from - EDGE * dt
        self.tau_mean_wheel = tuple(mean)
        self.tau_slope_wheel = tuple(slope)
        if self.unbalance > 0.0:
            self._rotor_angles = tuple(x % FULL_TURN for x in angles)
            before, self._across = self._across, self._momentum_across(self._speeds())
            self.tau_jitter_body = scale(1.0 / dt, sub(before, self._across))

    def propagate_rotor(
        self,
        motor: Motor,
        rotor: Rotor,
        command: float,
        rate0: float,
        rate1: float,
        dt: float,
        fastest: float,
    ) -> tuple[Rotor, float]:
        """Propagate a rotor over dt (s); also return the integral of its h (N m s2).

        A block may override it with another model.
        """
        return step(motor, rotor, command, rate0, rate1, dt, fastest)

    def driven(self, torque: float, speed: float) -> float:
        """Limit a commanded torque to what the motor gives (N m) at a speed (rad/s)."""
        return min(max(torque, -self.torque_limit), self.torque_limit)

    def _ahead(self, now: PerWheel, dt: float) -> PerWheel:
        """Extrapolate the rates about the axes (rad/s) by a step dt (s).

        A parabola through the last three is used as long as the command stays, as a
        change of it bends their course; otherwise a line through two.
        """
        command = (
            self.tau_cmd_wheel if self.command_mode == TORQUE else self.speed_cmd_wheel
        )
        steps = self._steps_since + 1 if command == self._last_command else 0
        (a, long), (b, before) = self._past
        self._past, self._steps_since = ((now, dt), self._past[0]), steps
        self._last_command = command
        if long == 0.0:
            return now
        line = dt / long
        if steps < 2 or before == 0.0:
            return tuple(x + line * (x - y) for x, y in zip(now, a, strict=True))
        bend = dt * (dt + long) / (long + before)
        p, q = line + bend / long, bend / before
        return tuple(
            x + p * (x - y) - q * (y - z) for x, y, z in zip(now, a, b, strict=True)
        )

    def _in_pieces(
        self, i: int, t: float, dt: float, now: float, then: float
    ) -> tuple[Rotor, float, Loop]:
        """Propagate rotor i over the step in pieces.

        The step is divided where the wheel fails and where its speed loop takes a
        sample. Returns the rotor, the integral of its h (N m s2), and its speed loop.
        """
        motor, rotor, (sample, loop_torque) = (
            self._motors[i],
            self._rotors[i],
            self._loops[i],
        )
        fails = self.failed_from - t if self._failing[i] else inf
        total, begin, rate = 0.0, 0.0, now
        while begin < dt:
            end, command, fastest = min(dt, fails), 0.0, self.speed_limit
            if fails <= begin + EDGE * dt:
                end, fastest = dt, inf
                motor, rotor = (
                    (*motor[:5], 0.0, motor[6], 0.0),
                    (rotor[0], 0.0, 0.0, rotor[3]),
                )
            elif self.command_mode == TORQUE:
                command = self._limit_torque(self.tau_cmd_wheel[i])
            else:
                due = floor((t + begin) / self.speed_sample_time + EDGE)
                if due > sample:
                    sample, loop_torque = due, self._speed_command(i, rotor[0], rate)
                end, command = (
                    min(end, (due + 1) * self.speed_sample_time - t),
                    loop_torque,
                )
            end = dt if end > dt * (1.0 - EDGE) else end
            ahead = then if end == dt else now + (then - now) * end / dt
            rotor, integral = self.propagate_rotor(
                motor, rotor, command, rate, ahead, end - begin, fastest
            )
            total, begin, rate = total + integral, end, ahead
        return rotor, total, (sample, loop_torque)

    def _speed_command(self, i: int, h: float, rate: float) -> float:
        """Compute the torque (N m) of the speed loop of wheel i."""
        error = self.speed_cmd_wheel[i] - (h / self.inertia_wheel[i] - rate)
        return self._limit_torque(self.speed_gain * self.inertia_wheel[i] * error)

    def _limit_torque(self, torque: float) -> float:
        """Limit a torque (N m) to +-torque_limit."""
        return min(max(torque, -self.torque_limit), self.torque_limit)

    def _across_axis(self, i: int) -> tuple[Vec3, Vec3]:
        """Return two unit vectors across the axis of wheel i, and across each other."""
        axis = self._axis(i)
        if axis == ZERO:
            return ZERO, ZERO
        one = unit(
            cross(axis, (1.0, 0.0, 0.0) if abs(axis[0]) < 0.8 else (0.0, 1.0, 0.0))
        )
        return one, cross(axis, one)

    def _momentum_across(self, speeds: PerWheel) -> Vec3:
        """Sum the momentum of the rotors' products of inertia (N m s, body).

        It lies across their axes.
        """
        total = ZERO
        if self.unbalance == 0.0:
            return total
        for i in self._present:
            size, angle = self.unbalance * speeds[i], self._rotor_angles[i]
            one, other = self._across_axes[i]
            total = add(
                total,
                add(scale(size * cos(angle), one), scale(size * sin(angle), other)),
            )
        return total
