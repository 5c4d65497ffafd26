"""The continuous part of the monolithic reference: a gyrostat on an orbit, as one
system of ordinary differential equations.

The state, in the order of the slices below: attitude q; total angular momentum L (N m
s, body); of the wheels the momenta h (N m s), motor torques T (N m) and learnt friction
(N m); dipole m (A m2).

    q' = 1/2 Omega(omega) q,     L' = torque - omega x L,     omega = J_r^-1 (L - A h)
    h' = T + learnt - friction(Omega),     T' = (command - T) / lag,     m' = (command - m) / lag
    learnt' = compensation (friction - learnt),     Omega = h / J_s - g.omega

A wheel at its limit is pinned: Omega = +-speed_limit, as long as its torque would go
beyond it. With stiction friction is dry, c_v Omega +- c_c, and a wheel that it has
stopped is pinned at Omega = 0 as long as |T - J_s (g.omega)'| <= stiction.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from desat.components.contract.block import Vec3, Vec4
from desat.components.maths import attitude, vector
from desat.components.physics import geomagnetic, torques, wheel_array
from desat.components.physics.earth import earth_angle
from desat.components.physics.gyrostat import carrier_inertia
from desat.components.physics.orbit import ellipse_state, mean_motion, perifocal_axes
from desat.components.physics.rotor import friction
from desat.system.errors import DesatError
from desat.system.model import System

# ------------------------------------------------------------------------------------------------
# What the monolithic reference knows: blocks, parameters, wires; all else it refuses by name
# A parameter that is neither used, nor fixed, nor without effect on the motion must stand at the
# start value of its declaration, so what a block learns later is refused until it is known here.


@dataclass(frozen=True)
class Known:
    """A role: its block, the parameters (and given inputs) used, fixed ones, those
    without effect on the motion, and how its inputs must be wired."""

    block: str
    used: str
    fixed: dict[str, Any]
    idle: str = ""
    wires: str = ""


KNOWN = {
    "environment": Known(
        "environment_kepler",
        "semi_major_axis eccentricity inclination raan argument_of_perigee mean_anomaly mu field "
        "dipole_earth earth_rate earth_angle earth_angle_start epoch_j2000",
        {"j2": False},
        "atmosphere density_base altitude_base scale_height atmosphere_radius igrf_degree",
    ),
    "spacecraft": Known(
        "spacecraft_rigid",
        "inertia axes_wheel inertia_wheel q_start_bi omega_start_body gravity_gradient "
        "residual_dipole_body tau_disturbance_body",
        {"aerodynamics": 0, "radiation": 0, "start_frame": 0},
        "drag_coefficient area_drag centre_drag_body area_radiation centre_radiation_body plates",
        "environment.r_eci environment.v_eci environment.b_eci environment.b_rate_eci "
        "environment.b_accel_eci wheels.h_wheel wheels.tau_mean_wheel wheels.tau_slope_wheel "
        "torquers.m_mean_body torquers.m_slope_body",
    ),
    "wheels": Known(
        "wheels",
        "axes_wheel inertia_wheel h_start_wheel torque_limit speed_limit motor_lag viscous coulomb "
        "friction_speed compensation stiction failed failed_from",
        {"command_mode": 0, "unbalance": 0.0},
        "speed_gain seed idle_power motor_constant",
        "manager.tau_cmd_wheel spacecraft.omega_bi_body",
    ),
    "guidance": Known("guidance_inertial", "q_target_bi", {}, "sample_time"),
    "controller": Known(
        "controller_pid",
        "sample_time delay kp kd ki gain_matrix integral_limit torque_limit anti_windup",
        {},
        "",
        "spacecraft.q_bi spacecraft.omega_bi_body guidance.q_ref_bi guidance.omega_ref_body",
    ),
    "magnetometer": Known(
        "magnetometer",
        "sample_time bias_body",
        {"noise": 0.0},
        "seed",
        "environment.b_eci spacecraft.q_bi",
    ),
    "manager": Known(
        "manager_cross_product",
        "sample_time wheel_sample_time delay axes_wheel feedforward gyroscopic saturation m_limit "
        "law gain h_deadband enable h_target_body",
        {},
        "",
        "magnetometer.b_body wheels.h_wheel controller.tau_ctrl_body",
    ),
    "torquers": Known(
        "torquers",
        "sample_time drive m_limit lag least_pulse duty_max pulse_delay",
        {},
        "resistance area_turns failed_from failure_known",
        "manager.m_cmd_body",
    ),
}
THRUSTERS = Known(
    "thrusters",
    "schedule_start schedule_duration schedule_tau_body",
    {},
    "tau_level arm sample_time least_pulse least_on_time placement specific_impulse",
)
"""May be missing. The manager of torquers alone never commands them: they fire by
schedule."""
THRUSTER_WIRES = " thrusters.tau_mean_thruster_body thrusters.tau_slope_thruster_body"

NO_FIELD, DIPOLE = range(2)


class Values:
    """The parameters of a system that the reference knows.

    Raises DesatError, a line for each thing that it does not know.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self.known = KNOWN | (
            {"thrusters": THRUSTERS} if "thrusters" in system.components else {}
        )
        problems = [*self._components()] or [*self._parameters(), *self._wires()]
        problems = problems or [*self._choices()]
        if problems:
            raise DesatError(
                "\n".join(f"{system.place}: the reference {p}" for p in problems)
            )

    def many(self, role: str, name: str) -> Any:
        """The values of a parameter, or of an input's start, as floats in a tuple."""
        value = self._system.components[role].values.get(name, ())
        return tuple(
            float(x) for x in (value if isinstance(value, (list, tuple)) else [value])
        )

    def has(self, role: str, name: str) -> bool:
        """True when a role's block declares a variable."""
        component = self._system.components[role]
        return component.interface is not None and name in component.interface.arrays

    def one(self, role: str, name: str) -> float:
        """The value of a scalar parameter; of a choice its number."""
        value: float = self.many(role, name)[0]
        return value

    def _components(self) -> Iterator[str]:
        components = self._system.components
        for role, known in self.known.items():
            component = components.get(role)
            model = (
                component.interface.model if component and component.interface else None
            )
            if model != known.block:
                yield f"needs {role} = {known.block}, there is {model or 'none'}"
        for name in components.keys() - self.known.keys():
            yield f"does not know the component {name}"

    def _parameters(self) -> Iterator[str]:
        for role, known in self.known.items():
            component = self._system.components[role]
            assert component.interface is not None
            free = {*known.used.split(), *known.idle.split()}
            for signal in component.interface.signals.values():
                name = signal.array
                inputs = (
                    signal.causality == "parameter"
                    or signal.name in component.parameters
                )
                if not inputs or name in free:
                    continue
                expected, value = (
                    known.fixed.get(name, signal.start),
                    component.values[signal.name],
                )
                if value != expected:
                    yield f"needs {role}.{signal.name} = {expected}, it is {value}"

    def _wires(self) -> Iterator[str]:
        connections = self._system.connections
        wired = {(c.target, f"{c.source}.{c.output_array}") for c in connections}
        for role, known in self.known.items():
            wires = known.wires + (
                THRUSTER_WIRES
                if role == "spacecraft" and "thrusters" in self.known
                else ""
            )
            for wire in wires.split():
                if (role, wire) not in wired:
                    yield f"needs {wire} wired to {role}"
        if self.one("manager", "gyroscopic") and (
            ("manager", "spacecraft.omega_bi_body") not in wired
        ):
            yield "needs spacecraft.omega_bi_body wired to manager, for gyroscopic = true"
        for c in connections:
            if (c.factor, c.offset) != (1.0, 0.0):
                yield f"needs {c} as it is, not scaled"

    def _choices(self) -> Iterator[str]:
        if self.one("environment", "field") not in (NO_FIELD, DIPOLE):
            yield "needs environment.field = none or dipole"
        for role in ("controller", "manager"):
            if self.one(role, "sample_time") <= 0.0:
                yield f"needs {role}.sample_time above 0 s: it has no step of its own"


Array = NDArray[np.float64]
State = list[float]

Q, L, H, MOTOR, LEARNT, M = (
    slice(0, 4),
    slice(4, 7),
    slice(7, 11),
    slice(11, 15),
    slice(15, 19),
    slice(19, 22),
)
SAME_TIME = 1e-9
"""Times nearer than this (s) are one."""
NO_WHEEL = -1
STANDING = 2
WHEELS = range(4)


def part(y: State, place: slice) -> Any:
    """A part of the state as a tuple."""
    return tuple(y[place])


@dataclass(frozen=True)
class Held:
    """What stays from one event to the next."""

    command: Vec4 = (0.0, 0.0, 0.0, 0.0)
    """Torque commands of the wheels (N m)."""
    coils: Vec3 = vector.ZERO
    """Dipole command (A m2)."""
    thrust: Vec3 = vector.ZERO
    """Torque of the thrusters (N m, body)."""
    dead: int = NO_WHEEL
    """The wheel that has failed."""
    pinned: tuple[int, ...] = (0, 0, 0, 0)
    """Of each wheel: +1 or -1 at its limit, STANDING by stiction, 0 free."""
    way: tuple[int, ...] = (0, 0, 0, 0)
    """Of each wheel: which way dry friction takes it to move, +1 or -1; 0: it stands.
    """


@dataclass(frozen=True)
class Late:
    """What the body feels where it is not what is so now: functions of the time (s)."""

    h: Callable[[float], Vec4]
    dipole: Callable[[float], Vec3]
    thrust: Vec3


class Plant:
    """The equations for one system's parameters."""

    def __init__(self, values: Values) -> None:
        one, many = values.one, values.many
        self.inertia = many("spacecraft", "inertia")
        self.axes = many("spacecraft", "axes_wheel")
        self.spin = many("spacecraft", "inertia_wheel")
        self.carrier = carrier_inertia(self.inertia, self.axes, self.spin)
        self.columns = tuple(
            (self.axes[i], self.axes[4 + i], self.axes[8 + i]) for i in WHEELS
        )
        self.present = tuple(i for i in WHEELS if self.spin[i] > 0.0)
        self.h_limit = tuple(j * one("wheels", "speed_limit") for j in self.spin)
        self.friction = (
            one("wheels", "viscous"),
            one("wheels", "coulomb"),
            one("wheels", "friction_speed"),
        )
        self.compensation = one("wheels", "compensation")
        self.stiction = one("wheels", "stiction")
        self.torque_limit = one("wheels", "torque_limit")
        self.motor_lag, self.coil_lag = (
            one("wheels", "motor_lag"),
            one("torquers", "lag"),
        )
        self.gravity_gradient = bool(one("spacecraft", "gravity_gradient"))
        self.constant = many("spacecraft", "tau_disturbance_body")
        self.residual_dipole = many("spacecraft", "residual_dipole_body")
        self._inverse: dict[tuple[int, ...], Any] = {
            (0, 0, 0, 0): vector.inverse(self.carrier)
        }
        self._orbit(values)
        self._q = attitude.normalise(many("spacecraft", "q_start_bi"))
        self._omega = many("spacecraft", "omega_start_body")
        self._h = many("wheels", "h_start_wheel")

    def _orbit(self, values: Values) -> None:
        def of(name: str) -> float:
            return values.one("environment", name)

        self._a, self._e, self._mean_anomaly = (
            of("semi_major_axis"),
            of("eccentricity"),
            of("mean_anomaly"),
        )
        self._n = mean_motion(self._a, of("mu"))
        self._plane = perifocal_axes(
            of("inclination"), of("raan"), of("argument_of_perigee")
        )
        inputs = bool(of("earth_angle"))
        self._angle = (
            of("earth_angle_start") if inputs else earth_angle(of("epoch_j2000"))
        )
        self._earth_rate = of("earth_rate")
        dipole = values.many("environment", "dipole_earth")
        self._dipole: Vec3 = dipole if of("field") == DIPOLE else vector.ZERO

    def place(self, t: float) -> Vec3:
        """Position (m, eci) at t (s)."""
        anomaly = self._mean_anomaly + self._n * t
        return ellipse_state(self._a, self._e, anomaly, self._n, *self._plane)[0]

    def field(self, t: float, r: Vec3) -> Vec3:
        """Geomagnetic field (T, eci) at t (s) and r (m)."""
        turn = vector.rotation_about(
            (0.0, 0.0, self._angle + self._earth_rate * t), 1.0
        )
        return geomagnetic.dipole(r, vector.mat_vec(turn, self._dipole))

    def start_state(self) -> State:
        """The state at the start, without motor torques and dipole."""
        spin = vector.mat_vec(self.carrier, self._omega)
        momentum = vector.add(spin, wheel_array.body_momentum(self.axes, self._h))
        return [*self._q, *momentum, *self._h, *[0.0] * 11]

    def start_held(self) -> Held:
        """What holds at the start."""
        y = self.start_state()
        omega, h = self.motion(0.0, y, Held())
        speeds = [self.speed(i, omega, h) if i in self.present else 0.0 for i in WHEELS]
        return Held(way=tuple((x > 0.0) - (x < 0.0) for x in speeds))

    def inverse(self, pinned: tuple[int, ...]) -> Any:
        """The inverse of the inertia that turns with the body, pinned wheels included."""
        if pinned not in self._inverse:
            held = tuple(
                -j if p else 0.0 for p, j in zip(pinned, self.spin, strict=True)
            )
            turning = carrier_inertia(self.carrier, self.axes, held)
            self._inverse[pinned] = vector.inverse(turning)
        return self._inverse[pinned]

    def motion(
        self, t: float, y: State, held: Held, late: Late | None = None
    ) -> tuple[Vec3, Vec4]:
        """The body's rate (rad/s) and the wheels' momentum (N m s) in a state."""
        h, pinned = part(y, H), held.pinned
        if late is not None:
            omega = vector.sub(
                part(y, L), wheel_array.body_momentum(self.axes, late.h(t))
            )
            return vector.mat_vec(self.inverse((0, 0, 0, 0)), omega), h
        if any(pinned):
            h = tuple(self._pinned(i, pinned[i]) if pinned[i] else h[i] for i in WHEELS)
        remaining = vector.sub(part(y, L), wheel_array.body_momentum(self.axes, h))
        omega = vector.mat_vec(self.inverse(pinned), remaining)
        if any(pinned):
            h = tuple(
                h[i]
                + (
                    self.spin[i] * vector.dot(self.columns[i], omega)
                    if pinned[i]
                    else 0.0
                )
                for i in WHEELS
            )
        return omega, h

    def _pinned(self, i: int, manner: int) -> float:
        """The momentum (N m s) of a pinned wheel relative to the body."""
        limit: float = self.h_limit[i]
        return 0.0 if manner == STANDING else manner * limit

    def speed(self, i: int, omega: Vec3, h: Vec4) -> float:
        """The speed (rad/s) of wheel i relative to the body."""
        speed: float = h[i] / self.spin[i] - vector.dot(self.columns[i], omega)
        return speed

    def rotor(
        self, i: int, y: State, omega: Vec3, h: Vec4, held: Held
    ) -> tuple[float, float]:
        """The torque (N m) on a free rotor, and the slope of what its loop has learnt
        (N m/s)."""
        speed, (viscous, coulomb, _) = self.speed(i, omega, h), self.friction
        drag = (
            viscous * speed + coulomb * held.way[i]
            if self.stiction > 0.0
            else friction(speed, *self.friction)
        )
        torque, learnt = y[11 + i], y[15 + i]
        drive = torque
        if self.compensation > 0.0:
            drive = min(max(torque + learnt, -self.torque_limit), self.torque_limit)
        return drive - drag, self.compensation * (drag - learnt)

    def derivative(
        self, t: float, y: State, held: Held, late: Late | None = None
    ) -> State:
        """dy/dt."""
        omega, h = self.motion(t, y, held, late)
        x, v, z, w = q = part(y, Q)
        p, s, r = omega
        dipole = own_dipole = part(y, M)
        thrust = held.thrust
        if late is not None:
            dipole, thrust = late.dipole(t), late.thrust
        torque = vector.add(self.constant, thrust)
        dipole = vector.add(dipole, self.residual_dipole)
        if self.gravity_gradient or any(dipole):
            place = self.place(t)
            if self.gravity_gradient:
                body = attitude.rotate(q, place)
                torque = vector.add(
                    torque, torques.gravity_gradient(body, self.inertia)
                )
            if any(dipole):
                b = attitude.rotate(q, self.field(t, place))
                torque = vector.add(torque, vector.cross(dipole, b))
        dh, d_learnt, d_motor = [0.0] * 4, [0.0] * 4, [0.0] * 4
        for i in self.present:
            dh[i], d_learnt[i] = self.rotor(i, y, omega, h, held)
            if self.motor_lag > 0.0:
                d_motor[i] = (held.command[i] - y[11 + i]) / self.motor_lag
            if held.dead == i or held.pinned[i]:
                d_learnt[i] = 0.0  # the loop rests
            if held.pinned[i]:
                dh[i] = 0.0
        lag = self.coil_lag
        return [
            0.5 * (r * v - s * z + p * w),
            0.5 * (-r * x + p * z + s * w),
            0.5 * (s * x - p * v + r * w),
            0.5 * (-p * x - s * v - r * z),
            *vector.sub(torque, vector.cross(omega, part(y, L))),
            *dh,
            *d_motor,
            *d_learnt,
            *(
                (c - m) / lag if lag > 0.0 else 0.0
                for c, m in zip(held.coils, own_dipole, strict=True)
            ),
        ]

    def push(self, i: int, t: float, y: State, held: Held) -> float:
        """The torque (N m) with which a wheel at its limit would go beyond it."""
        omega, h = self.motion(t, y, held)
        torque = self.rotor(i, y, omega, h, held)[0] - self._turning(i, t, y, held)
        return float(held.pinned[i] * torque)

    def pull(self, i: int, t: float, y: State, held: Held) -> float:
        """The torque (N m) that stiction resists in a standing wheel."""
        return y[11 + i] - self._turning(i, t, y, held)

    def _turning(self, i: int, t: float, y: State, held: Held) -> float:
        """The torque (N m) that turns rotor i with the body, J_s (g.omega)'."""
        rates = self.derivative(t, y, held)
        remaining = vector.sub(
            part(rates, L), wheel_array.body_momentum(self.axes, part(rates, H))
        )
        turning = vector.mat_vec(self.inverse(held.pinned), remaining)
        torque: float = self.spin[i] * vector.dot(self.columns[i], turning)
        return torque

    def margin(self, i: int, omega: Vec3, h: Vec4) -> float:
        """The momentum (N m s) that wheel i may still take before it is at its limit."""
        body = self.spin[i] * vector.dot(self.columns[i], omega)
        margin: float = self.h_limit[i] - abs(h[i] - body)
        return margin
