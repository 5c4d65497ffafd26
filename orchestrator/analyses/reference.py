"""The monolithic reference of a gyrostat: the uncut system, against which the cut one is held.

Built from the functions of `components`, without blocks, FMUs or exchange: one system of ordinary
differential equations, scipy's DOP853, restarted at every sample of the controller. It knows the
components of `ssp/gyrostat`: environment_kepler (dipole or no field), spacecraft_rigid, wheels,
guidance_inertial, controller_pid, magnetometer (ideal), manager_cross_product, torquers (limited).

With a `delay` it is the same system as a `jacobi` master with that step makes it: an interval
output reaches its consumer one step late.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

from desat.components.contract.block import Vec3
from desat.components.laws import attitude_control, cross_product
from desat.components.maths import attitude, vector
from desat.components.physics import geomagnetic, torques, wheel_array
from desat.components.physics.earth import earth_angle
from desat.components.physics.gyrostat import carrier_inertia, rate
from desat.components.physics.orbit import Drift, Elements, drifting_state
from desat.components.physics.rotor import friction

from ..system.errors import DesatError
from ..system.model import System
from ..system.parameters import value_of

RTOL, ATOL = 1e-13, 1e-15
Array = NDArray[np.float64]
Force = Callable[[float], tuple[list[float], Vec3]]
"""At a time: torque on each rotor (N m), dipole (A m2)."""

Q, MOMENTUM, H, MOTOR, DIPOLE, COPY = (
    slice(0, 4), slice(4, 7), slice(7, 11), slice(11, 15), slice(15, 18), slice(18, 22)
)  # fmt: skip
"""Where attitude, total momentum, wheels' momenta, motor torques, dipole, and the body's copy of
the wheels' momenta stand in the state."""


def _part(y: list[float], where: slice) -> Any:
    return tuple(y[where])


@dataclass(frozen=True)
class Trajectory:
    """The reference at the samples: times (n,), q (n, 4), omega (n, 3), h (n, 4)."""

    times: Array
    q: Array
    omega: Array
    h: Array


NEEDED: dict[str, tuple[str, dict[str, Any]]] = {
    "environment": ("environment_kepler", {"j2": False, "eccentricity": 0.0}),
    "spacecraft": ("spacecraft_rigid", {"aerodynamics": 0, "radiation": 0, "start_frame": 0}),
    "wheels": ("wheels", {"command_mode": 0, "failed": 0, "stiction": 0.0, "unbalance": 0.0,
                          "compensation": 0.0}),
    "guidance": ("guidance_inertial", {}),
    "controller": ("controller_pid", {"anti_windup": False}),
    "magnetometer": ("magnetometer", {"noise": 0.0}),
    "manager": ("manager_cross_product", {"feedforward": False, "gyroscopic": False,
                                          "h_deadband": 0.0, "law": 0}),
    "torquers": ("torquers", {"drive": 1}),
}  # fmt: skip
"""Role -> block and the parameters that the reference takes as given."""


def _refuse(system: System) -> None:
    for role, (block, fixed) in NEEDED.items():
        component = system.components.get(role)
        model = component.interface.model if component and component.interface else None
        if component is None or model != block:
            raise DesatError(
                f"{system.where}: the reference needs {role} = {block}, there is {model or 'none'}"
            )
        for name, wanted in fixed.items():
            if (got := value_of(component, name)) != wanted:
                raise DesatError(
                    f"{system.where}: the reference needs {role}.{name} = {wanted}, it is {got}"
                )


FIELD_DIPOLE = 1


class Gyrostat:
    """The uncut system of a checked scenario. Raises DesatError for one that it does not know."""

    def __init__(self, system: System) -> None:
        _refuse(system)
        self._system = system
        self.sample = float(self._one("controller", "sample_time"))
        for role in ("magnetometer", "manager"):
            if self._one(role, "sample_time") != self.sample:
                raise DesatError(
                    f"{system.where}: the reference needs {role}.sample_time = {self.sample:g} s"
                )
        assert system.stop is not None
        self.count = round((system.stop - system.start) / self.sample)
        self.start = system.start
        self.inertia = self._many("spacecraft", "inertia")
        self.axes = self._many("spacecraft", "axes_wheel")
        self.spin = self._many("spacecraft", "inertia_wheel")
        self.carrier = carrier_inertia(self.inertia, self.axes, self.spin)
        self.inverse = vector.inverse(self.carrier)
        self.pinv = wheel_array.pseudo_inverse(self.axes)
        self.friction = tuple(
            self._one("wheels", n) for n in ("viscous", "coulomb", "friction_speed")
        )
        self.motor_lag = self._one("wheels", "motor_lag")
        self.torque_limit = self._one("wheels", "torque_limit")
        self.coil_lag = self._one("torquers", "lag")
        self.m_limit = min(self._one("torquers", "m_limit"), self._one("manager", "m_limit"))
        self.gravity_gradient = bool(self._one("spacecraft", "gravity_gradient"))
        self.q_ref = attitude.normalised(self._many("guidance", "q_target_bi"))
        self.gains = tuple(self._one("controller", n) for n in ("kp", "kd", "ki"))
        self.gain_matrix = self._many("controller", "gain_matrix")
        self.limits = tuple(self._one("controller", n) for n in ("integral_limit", "torque_limit"))
        self._elements = Elements(*(self._one("environment", n) for n in Elements._fields))
        self._mu = self._one("environment", "mu")
        given = bool(self._one("environment", "earth_angle"))
        self._angle0 = (
            self._one("environment", "earth_angle_start")
            if given
            else earth_angle(self._one("environment", "epoch_j2000"))
        )
        self._earth_rate = self._one("environment", "earth_rate")
        dipole = self._many("environment", "dipole_earth")
        has_field = self._one("environment", "field") == FIELD_DIPOLE
        self._dipole: Vec3 = dipole if has_field else vector.ZERO
        self.dumping = bool(self._one("manager", "enable"))
        self.gain = self._one("manager", "gain")

    def _many(self, role: str, name: str) -> Any:
        component = self._system.components[role]
        assert component.interface is not None
        values: list[Any] = [
            value_of(component, s.name) for s in component.interface.elements(name)
        ]
        return tuple(float(x) for x in values)

    def _one(self, role: str, name: str) -> float:
        value: float = self._many(role, name)[0]
        return value

    # --- what the system is ---------------------------------------------------------------------

    def _place(self, t: float) -> Vec3:
        """Position (m, eci) at t (s)."""
        return drifting_state(self._elements, Drift(0.0, 0.0, 0.0), t, self._mu)[0]

    def _field(self, t: float, r: Vec3) -> Vec3:
        """Geomagnetic field (T, eci) at t (s) and r (m)."""
        angle = self._angle0 + self._earth_rate * t
        turn = vector.rotation_about((0.0, 0.0, angle), 1.0)
        return geomagnetic.dipole(r, vector.mat_vec(turn, self._dipole))

    def start_state(self) -> list[float]:
        """The state at the start."""
        q = attitude.normalised(self._many("spacecraft", "q_start_bi"))
        h = self._many("wheels", "h_start_wheel")
        spin = vector.mat_vec(self.carrier, self._many("spacecraft", "omega_start_body"))
        momentum = vector.add(spin, wheel_array.body_momentum(self.axes, h))
        inertial = attitude.rotate_back(q, momentum)
        return [*q, *inertial, *h, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, *h]

    def omega(self, y: list[float]) -> Vec3:
        """The body's rate (rad/s) in a state."""
        q, momentum, copy = _part(y, Q), _part(y, MOMENTUM), _part(y, COPY)
        wheels = wheel_array.body_momentum(self.axes, copy)
        return rate(attitude.rotate(q, momentum), wheels, self.inverse)

    def forces(self, y: list[float]) -> tuple[list[float], Vec3]:
        """Torque on each rotor (N m) and dipole (A m2) in a state."""
        omega = self.omega(y)
        torque = [0.0] * 4
        for i, j in enumerate(self.spin):
            if j > 0.0:
                axial = sum(self.axes[4 * k + i] * omega[k] for k in range(3))
                torque[i] = y[MOTOR][i] - friction(y[H][i] / j - axial, *self.friction)
        mx, my, mz = y[DIPOLE]
        return torque, (mx, my, mz)

    def slope(
        self, t: float, y: list[float], command: tuple[float, ...], m_command: Vec3,
        late: Force | None,
    ) -> list[float]:  # fmt: skip
        """dy/dt with held commands; `late`: the body feels what was so one step ago."""
        own, dipole = self.forces(y)
        felt, felt_dipole = (own, dipole) if late is None else late(t)
        x, v, z, w = q = _part(y, Q)
        p, s, r = self.omega(y)
        place = self._place(t)
        body = attitude.rotate(q, place)
        torque = vector.ZERO
        if self.gravity_gradient:
            torque = torques.gravity_gradient(body, self.inertia)
        if any(felt_dipole):
            b = attitude.rotate(q, self._field(t, place))
            torque = vector.add(torque, vector.cross(felt_dipole, b))
        return [
            0.5 * (r * v - s * z + p * w),
            0.5 * (-r * x + p * z + s * w),
            0.5 * (s * x - p * v + r * w),
            0.5 * (-p * x - s * v - r * z),
            *attitude.rotate_back(q, torque),
            *own,
            *((c - m) / self.motor_lag for c, m in zip(command, y[MOTOR], strict=True)),
            *((c - m) / self.coil_lag for c, m in zip(m_command, dipole, strict=True)),
            *felt,
        ]

    def control(self, y: list[float], xi: Vec3) -> tuple[tuple[float, ...], Vec3]:
        """The wheels' torque command (N m) of a sample and the controller's new integral."""
        e, d_omega = attitude_control.tracking_error(
            _part(y, Q),
            self.omega(y),
            self.q_ref,
            vector.ZERO,
        )
        integral_limit, torque_limit = self.limits
        xi = attitude_control.integrated(xi, e, self.sample, integral_limit)
        kp, ki, kd = self.gains[0], self.gains[2], self.gains[1]
        torque = attitude_control.pid_torque(e, d_omega, xi, kp, kd, ki, self.gain_matrix)
        wanted = attitude_control.limited(torque, torque_limit)
        command = wheel_array.to_wheels(self.pinv, vector.scale(-1.0, wanted))
        limit = self.torque_limit
        return tuple(min(max(c, -limit), limit) for c in command), xi

    def measured_field(self, t: float, y: list[float]) -> Vec3:
        """The field in the body (T) at t (s) in a state."""
        return attitude.rotate(_part(y, Q), self._field(t, self._place(t)))

    def dump(self, y: list[float], b: Vec3) -> Vec3:
        """The dipole command (A m2) of a sample."""
        if not self.dumping:
            return vector.ZERO
        h = wheel_array.body_momentum(self.axes, _part(y, H))
        return vector.clip(cross_product.normalised(h, b, self.gain), self.m_limit)

    # --- its solution ---------------------------------------------------------------------------

    def ideal(self) -> Trajectory:
        """Without any delay: commands act from the sample they are computed from."""
        y, xi = self.start_state(), vector.ZERO
        rows = [(self.start, y)]
        for k in range(self.count):
            t = self.start + k * self.sample
            command, xi = self.control(y, xi)
            m_command = self.dump(y, self.measured_field(t, y))
            y, _ = self._solve(t, t + self.sample, y, command, m_command, None)
            rows.append((t + self.sample, y))
        return self._trajectory(rows)

    def delayed(self, step: float) -> Trajectory:
        """As a `jacobi` master with this step (s) makes it.

        The controller's sample reaches the wheels two steps later (controller, manager), the
        manager's dipole command the torquers one step later; the manager knows the field of its
        sample before; rotor torque and dipole reach the body one step later.
        """
        y, xi = self.start_state(), vector.ZERO
        rows = [(self.start, y)]
        per_sample = round(self.sample / step)
        commands: list[tuple[float, ...]] = [(0.0,) * 4] * 2
        m_command = vector.ZERO
        b = self.measured_field(self.start, y)
        past: Callable[[float], list[float]] | None = None
        for k in range(self.count * per_sample):
            t = self.start + k * step
            next_m = m_command
            if k % per_sample == 0:
                command, xi = self.control(y, xi)
                next_m = self.dump(y, b)
                b = self.measured_field(t, y)
            else:
                command = commands[-1]
            late = self._late(past, step)
            y, past = self._solve(t, t + step, y, commands[0], m_command, late)
            commands = [commands[1], command]
            m_command = next_m
            if (k + 1) % per_sample == 0:
                rows.append((self.start + (k + 1) * step, y))
        return self._trajectory(rows)

    def _late(self, past: Callable[[float], list[float]] | None, step: float) -> Force:
        if past is None:
            return lambda t: ([0.0] * 4, vector.ZERO)
        return lambda t: self.forces(past(t - step))

    def _solve(
        self, t0: float, t1: float, y: list[float], command: tuple[float, ...], m_command: Vec3,
        late: Force | None,
    ) -> tuple[list[float], Callable[[float], list[float]]]:  # fmt: skip
        """The state at t1 and the solution in between."""
        solver = DOP853(
            lambda t, x: np.array(self.slope(t, x.tolist(), command, m_command, late)),
            t0, np.array(y), t1, rtol=RTOL, atol=ATOL, max_step=t1 - t0,
        )  # fmt: skip
        ends, pieces = [t0], []
        while solver.status == "running":
            message = solver.step()
            if solver.status == "failed":
                raise DesatError(f"the reference fails at t = {solver.t:g} s: {message}")
            ends.append(solver.t)
            if late is not None:
                pieces.append(solver.dense_output())

        def between(t: float) -> list[float]:
            i = min(max(int(np.searchsorted(ends, t)) - 1, 0), len(pieces) - 1)
            return list(pieces[i](t).tolist())

        end = solver.y.tolist()
        end[Q] = attitude.normalised(_part(end, Q))
        return end, between

    def _trajectory(self, rows: list[tuple[float, list[float]]]) -> Trajectory:
        return Trajectory(
            times=np.array([t for t, _ in rows]),
            q=np.array([y[Q] for _, y in rows]),
            omega=np.array([self.omega(y) for _, y in rows]),
            h=np.array([y[H] for _, y in rows]),
        )
