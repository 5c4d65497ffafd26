"""Interpolate a rigid body between the rows of a run: attitude, momentum and rate.

The rows give attitude, rate and external impulse at both ends of a step, the wheels'
momentum at the start and their torque as mean and slope. The attitude is the polynomial
of degree 5 through values, first and second derivatives at both ends; it errs by
(nutation step)^6 / 46,080. The momentum follows the impulse, and the torque at both
ends where that is known.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from desat.components.physics.orbit import EARTH_RATE, MU
from desat.components.physics.torques import PLATE_COLUMNS, SOLAR_PRESSURE

from ..numbers.derived import cross, rotate, rotate_back
from ..system.model import Parameter, System

if TYPE_CHECKING:
    from ..engine.recording.results import Results

Array = NDArray[np.float64]

# f(e, q): N m, body (steps, 3), at the share e of every step, where the attitudes are
# q.
Torque = Callable[[float, Array], Array]

# Nodes and weights of Lobatto's quadrature of order 8 over a step, as shares of it. It
# uses both ends, where everything is known.
NODES = (0.0, 0.5 - 0.5 * sqrt(3.0 / 7.0), 0.5, 0.5 + 0.5 * sqrt(3.0 / 7.0), 1.0)
WEIGHTS = (1.0 / 20.0, 49.0 / 180.0, 16.0 / 45.0, 49.0 / 180.0, 1.0 / 20.0)


BEYOND = 1e10  # m: a body farther than this from its centre orbits the Sun


def period_of(
    r: Sequence[float] | Array, v: Sequence[float] | Array, mu: float = MU
) -> float:
    """Compute the period (s) of the orbit through r (m) with v (m/s) about mu (m3/s2).

    It is a day for an orbit about the Sun.
    """
    if float(np.linalg.norm(r)) > BEYOND:
        return 86400.0
    axis = 1.0 / (2.0 / float(np.linalg.norm(r)) - float(np.dot(v, v)) / mu)
    return 2.0 * pi * sqrt(axis**3 / mu)


def mu_of(system: System) -> float:
    """Return the gravitational parameter (m3/s2) of what a craft orbits."""
    craft = system.roles.get("spacecraft")
    return MU if craft is None else float(craft.values.get("mu", MU))


def _turned(q: Array, omega: Array) -> Array:
    """Compute the derivative 1/2 Omega(omega) q, row by row."""
    vector, scalar = q[:, :3], q[:, 3:]
    return 0.5 * np.hstack(
        [
            scalar * omega - cross(omega, vector),
            -(omega * vector).sum(axis=1, keepdims=True),
        ]
    )


@dataclass
class Steps:
    """All steps of a run at once.

    Arrays have a row per step, or one more where they say so.
    """

    dt: float | Array  # s; (steps, 1) where each step has its own
    carrier: Array  # J_r (3, 3), kg m2
    axes: Array  # (3, wheels)
    q: Array  # (steps + 1, 4)
    omega: Array  # (steps + 1, 3) rad/s, body
    impulse: Array  # (steps + 1, 3) N m s, eci: of the external torque since the start
    h: Array  # (steps + 1, wheels) N m s
    mean: Array  # (steps, wheels) N m: of the torque on each rotor
    slope: Array  # (steps, wheels) N m
    outer: Torque | None = None  # external torque; None: its mean, by the impulse

    def __post_init__(self) -> None:
        """Compute momentum (N m s, eci) and external torque (N m, body) of each step."""
        self.inverse = np.linalg.inv(self.carrier)
        self.gained = np.diff(self.impulse, axis=0)
        spin = self.omega @ self.carrier.T + self.h @ self.axes.T
        self.momentum = rotate_back(self.q, spin)
        # external torque (N m, body) at the start and at the end of every step
        self.ends = self.torque(0.0, self.q[:-1]), self.torque(1.0, self.q[1:])
        self._start = self._edge(0, self.q[:-1], self.omega[:-1], spin[:-1])
        self._end = self._edge(1, self.q[1:], self.omega[1:], spin[1:])
        # the same in eci
        self.turned = (
            rotate_back(self.q[:-1], self.ends[0]),
            rotate_back(self.q[1:], self.ends[1]),
        )
        self._bend = self.dt * (self.turned[1] - self.turned[0])

    def torque(self, e: float, q: Array) -> Array:
        """Compute the external torque (N m, body) at the share e of every step."""
        return self.outer(e, q) if self.outer else rotate(q, self.gained / self.dt)

    def motors(self, e: float) -> Array:
        """Compute the torque that the wheels' rotors take from the body (N m, body)."""
        return np.asarray((self.mean + (e - 0.5) * self.slope) @ self.axes.T)

    def _edge(
        self, e: int, q: Array, omega: Array, spin: Array
    ) -> tuple[Array, Array, Array]:
        """Compute q and its first and second derivative by the share of the step."""
        torque = self.ends[e] - self.motors(e) - cross(omega, spin)
        first = _turned(q, omega)
        second = _turned(q, torque @ self.inverse.T) + _turned(first, omega)
        return q, self.dt * first, self.dt**2 * second

    def attitude(self, e: float) -> Array:
        """Interpolate the attitude (steps, 4) at the share e of every step."""
        z = 1.0 - e

        def basis(s: float) -> tuple[float, float, float]:
            """Compute the quintic Hermite basis of value, slope and curvature at 0, at s.

            At s = 1 each function, its slope and its curvature are 0. No units.
            """
            c = (1.0 - s) ** 3
            return (
                c * (1.0 + s * (3.0 + 6.0 * s)),
                c * s * (1.0 + 3.0 * s),
                0.5 * c * s * s,
            )

        a, b, c = basis(e)
        f, g, h = basis(z)
        (q0, d0, s0), (q1, d1, s1) = self._start, self._end
        q = a * q0 + b * d0 + c * s0 + f * q1 - g * d1 + h * s1
        return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))

    def rate(self, e: float, q: Array) -> Array:
        """Compute the body's rate (rad/s, body) at attitude q, a share e into each step.

        It is J_r^-1 (C H - h): the total momentum H in body less that of the wheels h.
        """
        h = self.h[:-1] + self.dt * (e * self.mean + 0.5 * (e * e - e) * self.slope)
        total = rotate(
            q, self.momentum[:-1] + e * self.gained + 0.5 * (e * e - e) * self._bend
        )
        return np.asarray((total - h @ self.axes.T) @ self.inverse.T)


# --- External torque on a rigid body --------------------------------------------------
#
# It is computed outside the body from the series of the other components, without the
# body's code: only from its parameters, its attitude and its inputs.


# For each input the series that feeds it, or its values where none does.
Feeds = dict[str, str | list[Any]]

BLOCK, FIXED = "spacecraft_rigid", "spacecraft_fixed_attitude"
# Values for a body that lacks these parameters.
_ALWAYS: dict[str, Any] = {
    "residual_dipole_body": [0.0, 0.0, 0.0],
    "gravity_gradient": True,
    "plates": [],
    "offset_plates_body": [0.0, 0.0, 0.0],
    "drive_plate": [],
    "aerodynamics": "none",
    "radiation": "none",
}
INPUTS = (
    "r_eci",
    "v_eci",
    "b_eci",
    "b_rate_eci",
    "b_accel_eci",
    "sun_eci",
    "sunlight",
    "density",
    "m_mean_body",
    "m_slope_body",
    "tau_mean_thruster_body",
    "tau_slope_thruster_body",
    "tau_ext_body",
)


def is_known_body(system: System, body: str) -> bool:
    """Return whether a body is ours, so that its torques are known."""
    return system.components[body].model in (BLOCK, FIXED)


def feeds(system: System, body: str) -> Feeds | None:
    """Find what feeds each input of a body: a recorded series, or constant values.

    An input that is not wired has its constant values. None for a body that is no block
    of ours, and where an input arrives changed (factor, unit) or not at every step.
    """
    component = system.components[body]
    interface = component.interface
    if not is_known_body(system, body):
        return None
    feeds_found: Feeds = {}
    for name in INPUTS:
        signals = interface.arrays.get(name, ())
        wires = [
            c for c in system.connections if c.target == body and c.input_array == name
        ]
        if not wires:
            feeds_found[name] = [component.values[s.name] for s in signals]
            continue
        wire = wires[0]
        source = system.components[wire.source]
        series = {f"{c.source}.{c.output_array}" for c in wires}
        signal = source.interface.signals.get(wire.output) if source.interface else None
        same = all(c.factor == 1.0 and c.offset == 0.0 for c in wires)
        if not (
            same
            and signal
            and len(series) == 1
            and len(wires) == len(signals)
            and source.step_ratio == 1
            and signal.unit_name == signals[0].unit_name
        ):
            return None
        feeds_found[name] = series.pop()
    return feeds_found


def recorded_inputs(
    results: Results, feeds: Feeds, rows: slice
) -> dict[str, Array] | None:
    """Return the inputs of a body in these steps of a run, (steps, elements) each.

    None where a series is not recorded.
    """
    n = rows.stop - rows.start
    series_names = set(results.names())
    if not {x for x in feeds.values() if isinstance(x, str)} <= series_names:
        return None
    return {
        name: np.reshape(results.values(f, rows), (n, -1))
        if isinstance(f, str)
        else np.broadcast_to(np.array(f, dtype=float), (n, len(f)))
        for name, f in feeds.items()
    }


def torque(
    parameters: Mapping[str, Parameter], x: dict[str, Array], dt: float | Array
) -> Torque:
    """Build the function that computes the external torque on a body in steps of dt (s).

    The function takes a share of a step (0 to 1) and the attitudes there (steps, 4),
    and returns the torques (steps, 3; N m, body). The parameters are as a manifest has
    them, and x are the body's recorded inputs at each step.
    """
    values = _ALWAYS | {k: p.value for k, p in parameters.items()}
    return _ExternalTorque(values, x, dt)


class _ExternalTorque:
    """External torque on a body at a share of every step, from its inputs there.

    Inputs x have a row per step, of dt (s).
    """

    def __init__(
        self, values: Mapping[str, Any], x: dict[str, Array], dt: float | Array
    ) -> None:
        """Prepare gravity gradient and plates of a body over steps of dt (s)."""
        self._values = values
        self._x = x
        self._dt = dt
        self._inertia = np.reshape(values["inertia"], (3, 3))
        distance = np.linalg.norm(x["r_eci"], axis=1, keepdims=True)
        self._mu = float(values.get("mu", MU))
        self._fall = -self._mu * x["r_eci"] / distance**3  # m/s2, eci
        self._plates = np.array(values["plates"], float).reshape(-1, PLATE_COLUMNS)
        self._plates[:, 4:7] += values["offset_plates_body"]
        # plates that have an area
        self._used = [k for k in range(len(self._plates)) if self._plates[k, 3] > 0.0]
        drives = np.reshape(values["drive_plate"], (-1, 3))
        self._axes: dict[int, Array] = {}  # of the plates that have a drive
        for k in self._used:
            if k < len(drives) and (size := np.linalg.norm(drives[k])) > 0.0:
                self._axes[k] = drives[k] / size

    def __call__(self, e: float, q: Array) -> Array:
        """Compute the external torque (N m, body) at the share e of every step."""
        x, values = self._x, self._values
        t, lead = e * self._dt, e - 0.5
        b = x["b_eci"] + t * x["b_rate_eci"] + 0.5 * t * t * x["b_accel_eci"]
        dipole = (
            x["m_mean_body"] + lead * x["m_slope_body"] + values["residual_dipole_body"]
        )
        total = (
            x["tau_ext_body"]
            + values["tau_disturbance_body"]
            + cross(dipole, rotate(q, b))
        )
        total += x["tau_mean_thruster_body"] + lead * x["tau_slope_thruster_body"]
        if values["gravity_gradient"]:
            total += self._gravity_gradient(t, q)
        if values["aerodynamics"] != "none":
            total += self._drag(t, q)
        if values["radiation"] != "none":
            total += self._radiation(rotate(q, x["sun_eci"]))
        return np.asarray(total)

    def _gravity_gradient(self, t: float | Array, q: Array) -> Array:
        """Compute the gravity-gradient torque (N m, body) at t (s) after the starts."""
        x = self._x
        r = rotate(q, x["r_eci"] + t * x["v_eci"] + 0.5 * t * t * self._fall)
        size = np.linalg.norm(r, axis=1, keepdims=True)
        return np.asarray(3.0 * self._mu / size**5 * cross(r, r @ self._inertia.T))

    def _drag(self, t: float | Array, q: Array) -> Array:
        """Compute the drag torque (N m, body) at t (s) after the starts of the steps."""
        x, values = self._x, self._values
        wind = (
            x["v_eci"]
            + t * self._fall
            - cross([0.0, 0.0, EARTH_RATE], x["r_eci"] + t * x["v_eci"])
        )
        v = rotate(q, wind)
        head = -0.5 * x["density"] * values["drag_coefficient"]
        if values["aerodynamics"] == "area":
            speed = np.linalg.norm(v, axis=1, keepdims=True)
            force = head * values["area_drag"] * speed * v
            return cross(values["centre_drag_body"], force)
        sun = rotate(q, x["sun_eci"])
        total = np.zeros_like(v)
        for k in self._used:
            plate = self._plates[k]
            facing = (v * self._normal(k, sun)).sum(axis=1, keepdims=True)
            facing = np.abs(facing) if k in self._axes else np.maximum(facing, 0.0)
            total += cross(plate[4:7], head * plate[3] * facing * v)
        return total

    def _radiation(self, sun: Array) -> Array:
        """Compute the torque (N m, body) of sunlight.

        The direction to the Sun is a unit vector, body.
        """
        values = self._values
        pressure = SOLAR_PRESSURE * self._x["sunlight"]
        if values["radiation"] == "area":
            return cross(
                values["centre_radiation_body"],
                -pressure * values["area_radiation"] * sun,
            )
        total = np.zeros_like(sun)
        for k in self._used:
            plate = self._plates[k]
            normal = self._normal(k, sun)
            cosine = np.maximum((sun * normal).sum(axis=1), 0.0)[:, None]
            specular, diffuse = plate[7], plate[8]
            along = (1.0 - specular) * sun
            along = along + 2.0 * (specular * cosine + diffuse / 3.0) * normal
            total += cross(plate[4:7], -pressure * plate[3] * cosine * along)
        return total

    def _normal(self, k: int, sun: Array) -> Array:
        """Compute the normals (rows, 3) of a plate, body.

        Its drive turns it to the Sun (rows, 3), body, unless the Sun is along its axis.
        """
        normal = self._plates[k, :3]
        at_rest = np.broadcast_to(normal / np.linalg.norm(normal), sun.shape)
        if k not in self._axes:
            return at_rest
        axis = self._axes[k]
        across = sun - np.outer(sun @ axis, axis)
        size = np.linalg.norm(across, axis=1, keepdims=True)
        return np.where(size > 0.0, across / np.where(size > 0.0, size, 1.0), at_rest)
