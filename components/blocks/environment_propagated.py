from __future__ import annotations

from math import ceil, floor, sqrt

from ..bases.near_earth import NO_AIR, NODE_TIME, NODES, NearEarth, derivatives
from ..bases.orbit_start import OSCULATING, STATE, OrbitStart
from ..bases.pulses import STANDARD_GRAVITY
from ..contract.block import Output, Parameter, Vec3
from ..maths.attitude import propagate, rotate_back
from ..maths.runge_kutta import State, step8
from ..maths.vector import norm
from ..physics import earth
from ..physics.orbit import gravity, state_from_elements

_BEFORE = NODES // 2 - 1  # nodes of the arc before the interval that the block is in

_Vec6 = tuple[float, float, float, float, float, float]
# Data of one interval between nodes: its number, and the polynomial of each component
# of r.
_Path = tuple[int, tuple[_Vec6, _Vec6, _Vec6]]
_Arc = tuple[State, State, State, State, State, State]


class EnvironmentPropagated(NearEarth, OrbitStart):
    """Integrated orbit with the Earth's field, Sun, eclipse and atmosphere

        r'' = g(r) - 1/2 rho C_d A / m |w| w + C(q_bi)' F / m,    w = v - omega_earth x r

    from mean or osculating elements, or from position and velocity. g is the Earth's
    gravity with the zonal harmonics J2 to J4 (EGM-96), drag is that of `area_drag`, F
    the thrusters' force. Osculating elements are computed from mean ones so that their
    average over a revolution is the mean ones.

    The orbit is integrated between nodes at the multiples of 10 s by the Runge-Kutta
    method of order 8 of Dormand and Prince (Hairer, Norsett, Wanner, Solving Ordinary
    Differential Equations I); its step does not depend on the master's. In between r is
    the polynomial of fifth degree through position, velocity and acceleration of both
    nodes, 1e-9 m from the solution; v its derivative.

    With `firings` the mean force of a step acts over the step, fixed to the body, which
    turns on from q_bi with omega_bi_body; the orbit continues from the resulting state.
    `environment.force_mean_thruster_body`, `q_bi` and `omega_bi_body` are to be wired
    from the thrusters and the spacecraft in the craft file. With `specific_impulse` the
    craft's mass falls by what that force takes,

        m' = -|force_mean_thruster_body| / (g0 specific_impulse)

    which does not include propellant of thrusters whose forces cancel; without it
    `mass` is constant.

    It is a separate block, not an option of environment_kepler, because it has a state,
    which firings change, whereas that one is a function of time.
    """

    _first: int
    _arc: _Arc
    _path: _Path

    zonals: int = Parameter(
        "1",
        "highest zonal harmonic of gravity",
        choices=("none", "j2", "j3", "j4"),
        start="j4",
    )
    mass: float = Parameter("kg", "mass, for drag and firings", start=100.0, min=1e-3)
    area_drag: float = Parameter(
        "m2", "projected area; 0: no drag on the orbit", min=0.0
    )
    drag_coefficient: float = Parameter("1", "drag coefficient", start=2.2, min=0.0)
    firings: bool = Parameter(
        "1",
        "true: the thrusters' force acts on the orbit",
        needs=("force_mean_thruster_body", "q_bi", "omega_bi_body"),
    )

    specific_impulse: float = Parameter(
        "s",
        "of the thrusters, by which their force takes mass; 0: none, the mass is constant",
        min=0.0,
        needs=("force_mean_thruster_body",),
    )
    mass_left: float = Output("kg", "mass of the craft")

    def start(self) -> None:
        """Check the parameters and begin the first arc at the start of the orbit."""
        super().start()
        self._mass, self._flow = self.mass, 0.0
        if self.specific_impulse > 0.0 and not self.firings:
            self.fail(
                f"specific_impulse = {self.specific_impulse:g} s needs firings = true: no "
                "force acts on the orbit"
            )
        if self.area_drag > 0.0 and self.atmosphere == NO_AIR:
            self.fail(
                f"area_drag = {self.area_drag:g} m2 needs an atmosphere, which is none"
            )
        elements = self.start_elements(self.zonals + 1, OSCULATING)
        r, v = state_from_elements(elements, self.mu)
        if self.orbit_start == STATE:
            r, v = self.start_state()
        self._new_arc(0.0, (*r, *v, 0.0))

    def output(self, t: float) -> None:
        super().output(t)
        self.mass_left = self._mass

    def size(self) -> tuple[float, float]:
        return self.start_size()

    def motion(self, t: float) -> tuple[Vec3, Vec3]:
        """Return position (m) and velocity (m/s) at t (s).

        They are in the mean equator and equinox of date. Between the nodes they are
        those of the interval's polynomials.
        """
        interval = floor(t / NODE_TIME)
        s = t - NODE_TIME * interval
        if s == 0.0:
            x, y, z, vx, vy, vz, _ = self._node(interval)
            return (x, y, z), (vx, vy, vz)
        number, path = self._path
        if number != interval:
            _, path = self._path_of(interval)
        (x, vx, _), (y, vy, _), (z, vz, _) = [derivatives(c, s) for c in path]
        return (x, y, z), (vx, vy, vz)

    def advance(self, t: float, dt: float) -> None:
        """Move the orbit on by dt (s) from t (s).

        The arc of equidistant nodes (m, m/s, eci) is extended ahead of the new time,
        and the polynomial path of its interval is fitted.
        """
        after = t + dt
        interval = floor(after / NODE_TIME)
        if self.firings and any(self.force_mean_thruster_body):
            self._fire(t, dt)
        while self._first + _BEFORE < interval:
            latest = self._step(
                NODE_TIME * (self._first + NODES - 1), self._arc[-1], NODE_TIME
            )
            _, b, c, d, e, f = self._arc
            self._first, self._arc = self._first + 1, (b, c, d, e, f, latest)
        if self._path[0] != interval:
            self._path = self._path_of(interval)
        super().advance(t, dt)

    def _fire(self, t: float, dt: float) -> None:
        """Integrate the thrusters' force over the step of dt (s) from t (s) on.

        The orbit then continues from the new state; the propellant is subtracted.
        """
        r, v = self.motion(t)
        y: State = (*r, *v, 0.0)
        if self.specific_impulse > 0.0:
            exhaust = STANDARD_GRAVITY * self.specific_impulse
            self._flow = norm(self.force_mean_thruster_body) / exhaust
            if self._flow * dt >= self._mass:
                self.fail(
                    f"at {t:g} s the thrusters take {self._flow * dt:.3g} kg in a step, and the "
                    f"craft has {self._mass:.3g} kg left of mass = {self.mass:g} kg"
                )
        parts = ceil(dt / NODE_TIME)
        for k in range(parts):
            share = k / parts
            y = self._step(t + share * dt, y, dt / parts, firing_since=share * dt)
        self._mass -= self._flow * dt
        self._new_arc(t + dt, y)
        self._piece = None  # its field belongs to the old path

    def _new_arc(self, t: float, y: State) -> None:
        """Integrate the nodes around t (s) of the orbit through y at t.

        It also sets the path between them.
        """
        interval = floor(t / NODE_TIME)
        s = t - NODE_TIME * interval
        at = self._step(t, y, -s) if s > 0.0 else y
        here = NODE_TIME * interval
        b = self._step(here, at, -NODE_TIME)
        a = self._step(here - NODE_TIME, b, -NODE_TIME)
        c = self._step(t, y, NODE_TIME - s)
        d = self._step(here + NODE_TIME, c, NODE_TIME)
        e = self._step(here + 2.0 * NODE_TIME, d, NODE_TIME)
        self._first, self._arc = interval - _BEFORE, (a, b, at, c, d, e)
        self._path = self._path_of(interval)

    def _node(self, k: int) -> State:
        """Return the state at node k.

        Outside of the arc it is integrated and not stored.
        """
        index = k - self._first
        if 0 <= index < NODES:
            return self._arc[index]
        forward = index >= NODES
        at = self._first + NODES - 1 if forward else self._first
        y = self._arc[-1] if forward else self._arc[0]
        while at != k:
            y = self._step(NODE_TIME * at, y, NODE_TIME if forward else -NODE_TIME)
            at += 1 if forward else -1
        return y

    def _path_of(self, interval: int) -> _Path:
        """Compute the polynomial of the position (m) between two nodes."""
        begin, end = self._node(interval), self._node(interval + 1)
        t = NODE_TIME * interval
        a = self._acceleration(t, begin, self._sun(t))
        b = self._acceleration(t + NODE_TIME, end, self._sun(t + NODE_TIME))
        x, y, z = (
            hermite(begin[i], begin[i + 3], a[i], end[i], end[i + 3], b[i])
            for i in range(3)
        )
        return interval, (x, y, z)

    def _step(self, t: float, y: State, dt: float, firing_since: float = -1.0) -> State:
        """Integrate the state y at t (s) over dt (s).

        No force acts where `firing_since` is negative. Otherwise the force is that of
        the master's step that began so long (s) before t.
        """
        sun = self._sun(t + 0.5 * dt)

        def slope(e: float, y: State) -> State:
            """Return the derivative of position and velocity: m/s and m/s2."""
            ax, ay, az = self._acceleration(t + e * dt, y, sun)
            if firing_since >= 0.0:
                q = propagate(self.q_bi, self.omega_bi_body, firing_since + e * dt)
                fx, fy, fz = rotate_back(q, self.force_mean_thruster_body)
                mass = self._mass - self._flow * (firing_since + e * dt)
                ax, ay, az = ax + fx / mass, ay + fy / mass, az + fz / mass
            return (y[3], y[4], y[5], ax, ay, az, 0.0)

        return step8(slope, 0.0, y, 1.0, dt)

    def _acceleration(self, t: float, y: State, sun: Vec3) -> Vec3:
        """Compute the acceleration (m/s2) by gravity and drag."""
        r = (y[0], y[1], y[2])
        gx, gy, gz = gravity(r, self.zonals + 1, self.mu)
        if self.area_drag == 0.0:
            return (gx, gy, gz)
        wx, wy, wz = y[3] + self.earth_rate * y[1], y[4] - self.earth_rate * y[0], y[5]
        k = (
            0.5
            * self.density_at(r, t, sun)
            * self.drag_coefficient
            * self.area_drag
            / self._mass
        )
        k *= sqrt(wx * wx + wy * wy + wz * wz)
        return (gx - k * wx, gy - k * wy, gz - k * wz)

    def _sun(self, t: float) -> Vec3:
        """Return the direction of the Sun (unit vector, date), for drag.

        It moves by 2e-6 rad in an interval.
        """
        return earth.sun(self.epoch_j2000 + t)[0]


def hermite(r0: float, v0: float, a0: float, r1: float, v1: float, a1: float) -> _Vec6:
    """Compute the coefficients c0 to c5 of a polynomial: the sum of c_n s^n.

    It has value, derivative and second derivative r0, v0, a0 at s = 0 and r1, v1, a1 at
    s = NODE_TIME.
    """
    h = NODE_TIME
    c2 = 0.5 * a0
    r = (r1 - r0 - (v0 + c2 * h) * h) / h**3
    v = (v1 - v0 - a0 * h) / h**2
    a = (a1 - a0) / h
    return (
        r0,
        v0,
        c2,
        10.0 * r - 4.0 * v + 0.5 * a,
        (-15.0 * r + 7.0 * v - a) / h,
        (6.0 * r - 3.0 * v + 0.5 * a) / h**2,
    )
