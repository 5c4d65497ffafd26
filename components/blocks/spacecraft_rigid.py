from __future__ import annotations

from math import ceil, isfinite

from ..contract.block import SPIN, Mat33, Parameter, Table, Vec3, Vec4
from ..contract.roles import Spacecraft, WheelInertias
from ..maths.attitude import normalise, product, rotate, rotate_back
from ..maths.runge_kutta import step4, step6, step8
from ..maths.vector import ZERO, add, cross, dot, mat_vec, norm, scale, sub
from ..physics import torques
from ..physics.gyrostat import (
    carrier_inertia,
    check_inertia,
    inverse_inertia,
    nutation,
    over_determinant,
    rate,
)
from ..physics.orbit import EARTH_RATE, MU, lvlh_attitude
from ..physics.rigid_body import (
    STILL,
    Torque,
    course,
    integrate_ramp,
    peak,
    ramp,
    slopes,
)
from ..physics.wheel_array import body_momentum

NONE, AREA, PLATES = range(3)

# rad: angles below which one step of RK4, RK6 or RK8 has about the same error relative
# to the angle.
ANGLE_4, ANGLE_6, ANGLE_8 = 0.009, 0.055, 0.3
MOST_PARTS = 100_000  # parts of a step; more indicate a mistake


class SpacecraftRigid(Spacecraft, WheelInertias):
    """Rigid body with up to four wheels about any axes

    The state is the attitude q, the total inertial angular momentum H and a copy of the
    wheels' axial momenta h:

        q' = 1/2 Omega(omega) q,     H' = C(q)' tau_ext,     h' = tau_wheel
        omega = J_r^-1 (C(q) H - sum g h),     J_r = J - sum J_s g g'

    so that without external torque H is constant to the last bit, and the body receives
    the opposite of the torque on the wheels. Wheel torque, dipole and thruster torque
    are given as mean and slope over the step, the field as value, rate and second
    derivative. The external torque is

        tau_ext = (m + m_residual) x B + 3 mu / r^3 u x J u + drag + radiation + thrusters
                  + tau_disturbance + tau_ext_body

    In a step of dt, body and nutation turn by about the angle a,

        a = dt (|omega| + sqrt(l . J_r l / det J_r)) + b
        b = dt^2 |J_r^-1| (|A tau_wheel| + |tau_ext|)
        c = dt^2 |J_r^-1| (change of these torques within the step)

    with l = C(q) H and the torques at their maximum. Up to a constant factor, the error
    of RK4 is a (a^2 + b)^2 + b c and that of RK6 a (a^2 + b)^3 + 2 b c^2, where c is
    large for a thruster pulse shorter than the step. Where that error is small, one
    step of RK4 or RK6 integrates the whole step; otherwise ceil((a + c / 2) /
    angle_limit) steps of order 8 do. The phase error is then a few 1e-12 of the angle
    turned, whatever the step. Without torque, the default angle_limit loses 1e-8 of the
    energy of a nutation of 1 rad/s in a day, half of that limit 3e-11. `h_wheel` is
    read in initialisation mode only: the copy starts from it.

    The air rotates with the Earth about the z axis of eci. If this is the axis of
    J2000, it is off by 0.15 deg in 2026, which changes drag by at most 3e-4 of itself.

    Source: conservation of momentum; paper 004, eqs. 1-6; Wertz (1978), ch. 17 for the
    torques.
    """

    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(40.45, 0.0, 0.0, 0.0, 42.09, 0.0, 0.0, 0.0, 40.36),
        shared=True,
    )
    q_start_bi: Vec4 = Parameter(
        "1",
        "attitude at the start: body from eci, scalar last; normalised",
        start=(0.0, 0.0, 0.0, 1.0),
    )
    omega_start_body: Vec3 = Parameter(
        "rad/s", "angular rate at the start, body", usual=SPIN
    )
    start_frame: int = Parameter(
        "1",
        "what q_start_bi and omega_start_body are relative to",
        choices=("eci", "lvlh"),
        start="eci",
        needs=("r_eci", "v_eci"),
    )
    gravity_gradient: bool = Parameter(
        "1", "true: gravity-gradient torque", start=True, needs=("r_eci", "v_eci")
    )
    mu: float = Parameter(
        "m3/s2",
        "gravitational parameter of what it orbits",
        start=MU,
        min=1e9,
        follows="environment.mu",
    )
    residual_dipole_body: Vec3 = Parameter(
        "A.m2", "dipole of the craft itself, body", needs=("b_eci",)
    )
    aerodynamics: int = Parameter(
        "1",
        "drag torque",
        choices=("none", "area", "plates"),
        start="none",
        needs=("density", "r_eci", "v_eci"),
    )
    drag_coefficient: float = Parameter("1", "drag coefficient", start=2.2, min=0.0)
    area_drag: float = Parameter("m2", "projected area for `area`", start=1.0, min=0.0)
    centre_drag_body: Vec3 = Parameter("m", "centre of pressure for `area`, body")
    radiation: int = Parameter(
        "1",
        "solar torque",
        choices=("none", "area", "plates"),
        start="none",
        needs=("sun_eci", "sunlight"),
    )
    area_radiation: float = Parameter(
        "m2",
        "projected area times radiation coefficient for `area`",
        start=1.0,
        min=0.0,
    )
    centre_radiation_body: Vec3 = Parameter(
        "m", "centre of radiation pressure for `area`, body"
    )
    plates: Table = Parameter(
        "1",
        "a row a plate: outward normal (3), area m2, centre (3) m, specular, diffuse share",
        shape=(16, torques.PLATE_COLUMNS),
    )
    drive_plate: Table = Parameter(
        "1",
        "a row a plate: the body axis about which it turns to face the Sun; 0: it is fixed",
        shape=(16, 3),
        needs=("sun_eci",),
    )
    offset_plates_body: Vec3 = Parameter(
        "m", "centre of pressure beside the centre of mass: added to all plates, body"
    )
    tau_disturbance_body: Vec3 = Parameter("N.m", "a constant external torque, body")
    angle_limit: float = Parameter(
        "rad",
        "largest angle of body and nutation in one integration step; half: 1/250 the error",
        start=ANGLE_8,
        min=0.01,
        max=0.5,
    )

    def start(self) -> None:
        """Set attitude (from eci) and momentum (N m s, eci) to their start values."""
        check_inertia(self.inertia)
        carrier = carrier_inertia(self.inertia, self.axes_wheel, self.inertia_wheel)
        self._inverse = inverse_inertia(carrier)
        self._half_inverse: Mat33 = tuple(0.5 * x for x in self._inverse)  # type: ignore[assignment]
        self._over_determinant = over_determinant(carrier)
        share = self.angle_limit / ANGLE_8
        self._limit4 = (ANGLE_4 * share**2) ** 5
        self._limit6 = (ANGLE_6 * share ** (4.0 / 3.0)) ** 7
        self._plates = torques.plates_of(self.plates, self.offset_plates_body)
        self._drives = torques.drives_of(self.plates, self.drive_plate)
        self._driven = any(self.drive_plate)
        self._sizes()
        q, omega = normalise(self.q_start_bi), self.omega_start_body
        if self.start_frame == 1:
            q, omega = self._from_lvlh(q, omega)
        self._q, self._h = q, self.h_wheel
        self._momentum = rotate_back(
            q, add(mat_vec(carrier, omega), body_momentum(self.axes_wheel, self._h))
        )
        self._momentum_start = self._momentum

    def _sizes(self) -> None:
        """Compute the bounds for `_angle` and `_largest_around` from the parameters."""
        i = self._inverse
        self._inverse_size = max(  # 1/(kg m2)
            abs(i[0]) + abs(i[1]) + abs(i[2]),
            abs(i[3]) + abs(i[4]) + abs(i[5]),
            abs(i[6]) + abs(i[7]) + abs(i[8]),
        )
        # Upper bounds: gravity 3 mu / r^3 times half the largest moment (N m times r^3);
        # drag with every surface facing the flow (N m over density speed^2); light with
        # every surface a mirror (N m).
        self._gravity_size = (
            1.5 * self.mu * max(self.inertia[0], self.inertia[4], self.inertia[8])
        )
        on_plates = torques.lever(self._plates)
        drag = self.area_drag * norm(self.centre_drag_body)
        drag = on_plates if self.aerodynamics == PLATES else drag
        self._drag_size = (
            0.0 if self.aerodynamics == NONE else 0.5 * self.drag_coefficient * drag
        )
        light = self.area_radiation * norm(self.centre_radiation_body)
        light = 2.0 * on_plates if self.radiation == PLATES else light
        self._light_size = (
            0.0 if self.radiation == NONE else torques.SOLAR_PRESSURE * light
        )

    def _from_lvlh(self, q_bo: Vec4, omega_bo: Vec3) -> tuple[Vec4, Vec3]:
        """Convert attitude and rate (rad/s, body) from lvlh to eci."""
        n = norm(cross(self.r_eci, self.v_eci)) / dot(self.r_eci, self.r_eci)
        q = product(q_bo, lvlh_attitude(self.r_eci, self.v_eci))
        return q, add(omega_bo, rotate(q_bo, (0.0, -n, 0.0)))

    def output(self, t: float) -> None:
        self.q_bi = self._q
        self.omega_bi_body = self._omega()
        self.h_copy_wheel = self._h
        self.impulse_eci = sub(self._momentum, self._momentum_start)

    def _omega(self) -> Vec3:
        """Compute the angular rate (rad/s, body)."""
        wheels = body_momentum(self.axes_wheel, self._h)
        return rate(rotate(self._q, self._momentum), wheels, self._inverse)

    def advance(self, t: float, dt: float) -> None:
        """Propagate attitude and momentum (N m s, eci) over dt (s) by Runge-Kutta.

        The order (4, 6 or 8) and the number of steps follow from the angle (rad) by
        which body and nutation turn, with `angle_limit` as its bound.

        Raises
        ------
        BlockError
            If the result is not finite.
        """
        axes, h, mean = self.axes_wheel, self._h, self.tau_mean_wheel
        wheels = body_momentum(axes, h)
        motors = ramp(
            body_momentum(axes, mean), body_momentum(axes, self.tau_slope_wheel)
        )
        external = ramp(
            add(
                self.tau_disturbance_body,
                add(self.tau_ext_body, self.tau_mean_thruster_body),
            ),
            self.tau_slope_thruster_body,
        )
        dipole = ramp(
            add(self.m_mean_body, self.residual_dipole_body), self.m_slope_body
        )
        magnetic = dipole != STILL
        torque = peak(motors) + peak(external) + self._largest_around()
        if magnetic:
            torque += peak(dipole) * norm(self.b_eci)
        bend = norm(motors[1]) + norm(external[1])
        if magnetic:
            bend += norm(dipole[1]) * norm(self.b_eci)
        turning = dt * dt * self._inverse_size
        torque_angle, bend = turning * torque, turning * bend
        angle = self._angle(dt, wheels, torque_angle)
        square = angle * angle + torque_angle
        field = place = None
        if magnetic:
            field = course(self.b_eci, self.b_rate_eci, self.b_accel_eci, dt)
        if self.gravity_gradient:
            place = course(self.r_eci, self.v_eci, self._fall(self.r_eci), dt)
        slope = slopes(
            self.inertia,
            self._half_inverse,
            integrate_ramp(wheels, motors, dt),
            external,
            dipole,
            field,
            place,
            self._surfaces(dt),
            self.mu,
        )
        y = (*self._q, *self._momentum)
        if angle * square * square + torque_angle * bend <= self._limit4:
            y = step4(slope, 0.0, y, 1.0, dt)
        elif (
            angle * square * square * square + 2.0 * torque_angle * bend * bend
            <= self._limit6
        ):
            y = step6(slope, 0.0, y, 1.0, dt)
        else:
            n = ceil((angle + 0.5 * bend) / self.angle_limit)
            for i in range(n):
                y = step8(slope, i / n, y, 1.0 / n, dt / n)
        if not isfinite(y[3] + y[4] + y[5] + y[6]):
            self.fail(
                f"attitude or momentum is not finite after a step of {dt:g} s: an input is not"
            )
        self._q = normalise(y[:4])
        self._momentum = (y[4], y[5], y[6])
        self._h = tuple(x + dt * y for x, y in zip(h, mean, strict=True))

    def _angle(self, dt: float, wheels: Vec3, torque_angle: float) -> float:
        """Estimate the angle (rad) by which body and nutation turn in dt.

        It takes the wheels' momentum (N m s, body) at the beginning and the largest
        contribution of the torques (rad).

        Raises
        ------
        BlockError
            If the angle is not finite or would take too many integration steps.
        """
        total = rotate(self._q, self._momentum)
        omega = rate(total, wheels, self._inverse)
        angle = (
            dt * (norm(omega) + nutation(total, self._over_determinant)) + torque_angle
        )
        if not angle <= MOST_PARTS * self.angle_limit:
            self.fail(
                f"in a step of {dt:g} s body and nutation turn by {angle:.3g} rad, more than "
                f"{MOST_PARTS * self.angle_limit:g}: take a shorter step, or look for an inertia, "
                "momentum or torque that is wrong"
            )
        return angle

    def _fall(self, r: Vec3) -> Vec3:
        """Compute the acceleration (m/s2) towards the centre at r (m)."""
        return scale(-self.mu / norm(r) ** 3, r)

    def _largest_around(self) -> float:
        """Compute an upper bound of the torque by gravity, air and light (N m)."""
        torque = self._light_size * self.sunlight
        if self.gravity_gradient:
            torque += self._gravity_size / norm(self.r_eci) ** 3
        if self._drag_size > 0.0:
            torque += self._drag_size * self.density * dot(self.v_eci, self.v_eci)
        return torque

    def _surfaces(self, dt: float) -> Torque | None:
        """Build f(e, C), the drag and radiation torque (N m, body); None without.

        Density and Sun are those at the step's start; the flow changes with the orbit.
        """
        drag = self.aerodynamics if self.density > 0.0 else NONE
        light = self.radiation if self.sunlight > 0.0 else NONE
        if drag == NONE and light == NONE:
            return None
        # velocity relative to the air, eci: a + e b
        r, v, spin = self.r_eci, self.v_eci, (0.0, 0.0, EARTH_RATE)
        ax, ay, az = sub(v, cross(spin, r))
        bx, by, bz = (
            scale(dt, sub(self._fall(r), cross(spin, v))) if drag != NONE else ZERO
        )
        density, sun_eci = self.density, self.sun_eci
        pressure = self.sunlight * torques.SOLAR_PRESSURE
        cd, fixed_plates, drives, driven = (
            self.drag_coefficient,
            self._plates,
            self._drives,
            self._driven,
        )

        def surfaces(e: float, c: Mat33) -> Vec3:
            """Compute the drag and radiation torque (N m, body)."""
            total = ZERO
            sun = mat_vec(c, sun_eci) if light != NONE or driven else ZERO
            plates = (
                torques.facing(fixed_plates, drives, sun) if driven else fixed_plates
            )
            if drag != NONE:
                flow = mat_vec(c, (ax + e * bx, ay + e * by, az + e * bz))
                total = (
                    torques.drag(
                        flow, density, cd * self.area_drag, self.centre_drag_body
                    )
                    if drag == AREA
                    else torques.drag_on_plates(flow, density, cd, plates, drives)
                )
            if light == NONE:
                return total
            return add(
                total,
                torques.radiation(
                    sun, pressure, self.area_radiation, self.centre_radiation_body
                )
                if light == AREA
                else torques.radiation_on_plates(sun, pressure, plates),
            )

        return surfaces
