from __future__ import annotations

from collections.abc import Callable
from math import ceil

from ..contract.block import Mat33, Parameter, Table, Vec3, Vec4
from ..contract.roles import Spacecraft, WheelInertias
from ..maths.attitude import normalised, product, propagated, rotate, rotate_back
from ..maths.vector import ZERO, add, cross, dot, mat_vec, norm, sub
from ..physics import torques
from ..physics.gyrostat import carrier_inertia, inverse_inertia, rate
from ..physics.orbit import EARTH_RATE, MU, lvlh_attitude
from ..physics.wheel_array import body_momentum

NONE, AREA, PLATES = range(3)

LARGEST_TURN = 0.025
"""Of the body in one integration step (rad): the local error is then 3e-12 rad."""
LARGEST_NUTATION = 0.25
"""Of the nutation in one integration step (rad)."""


class SpacecraftRigid(Spacecraft, WheelInertias):
    """Rigid body with up to four wheels about any axes

    The state is the attitude q and the total inertial angular momentum H, beside an own copy of the
    wheels' axial momenta h:

        q' = 1/2 Omega(omega) q,     H' = C(q)' tau_ext,     h' = tau_wheel
        omega = J_r^-1 (C(q) H - sum g h),     J_r = J - sum J_s g g'

    so that without external torque H is constant to the last bit, and what the wheels take the
    body gives. Wheel torque, dipole and thruster torque come as mean and slope over the step, the
    field as value, rate and second derivative. External torque:

        tau_ext = (m + m_residual) x B + 3 mu / r^3 u x J u + drag + radiation + thrusters
                  + tau_disturbance + tau_ext_body

    Integrated by RK4 with as many steps as turn and nutation need; drag and radiation are taken
    at the middle of each. `h_wheel` is read in
    initialisation mode only: the copy starts from it.

    Source: conservation of momentum; paper 004, eqs. 1-6; Wertz (1978), ch. 17 for the torques.
    """

    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(40.45, 0.0, 0.0, 0.0, 42.09, 0.0, 0.0, 0.0, 40.36),
        shared=True,
    )
    q_start_bi: Vec4 = Parameter(
        "1", "attitude at the start: body from eci, scalar last; normalised",
        start=(0.0, 0.0, 0.0, 1.0),
    )  # fmt: skip
    omega_start_body: Vec3 = Parameter("rad/s", "angular rate at the start, body")
    start_frame: int = Parameter(
        "1", "what q_start_bi and omega_start_body are relative to", choices=("eci", "lvlh"),
        start="eci", needs=("r_eci", "v_eci"),
    )  # fmt: skip
    gravity_gradient: bool = Parameter(
        "1", "true: gravity-gradient torque", start=True, needs=("r_eci", "v_eci")
    )
    residual_dipole_body: Vec3 = Parameter(
        "A.m2", "dipole of the craft itself, body", needs=("b_eci",)
    )
    aerodynamics: int = Parameter(
        "1", "drag torque", choices=("none", "area", "plates"), start="none",
        needs=("density", "r_eci", "v_eci"),
    )  # fmt: skip
    drag_coefficient: float = Parameter("1", "drag coefficient", start=2.2, min=0.0)
    area_drag: float = Parameter("m2", "projected area for `area`", start=1.0, min=0.0)
    centre_drag_body: Vec3 = Parameter("m", "centre of pressure for `area`, body")
    radiation: int = Parameter(
        "1", "solar torque", choices=("none", "area", "plates"), start="none",
        needs=("sun_eci", "sunlight"),
    )  # fmt: skip
    area_radiation: float = Parameter(
        "m2", "projected area times radiation coefficient for `area`", start=1.0, min=0.0
    )
    centre_radiation_body: Vec3 = Parameter("m", "centre of radiation pressure for `area`, body")
    plates: Table = Parameter(
        "1",
        "a row a plate: outward normal (3), area m2, centre (3) m, specular, diffuse share",
        shape=(6, torques.PLATE_COLUMNS),
    )
    tau_disturbance_body: Vec3 = Parameter("N.m", "a constant external torque, body")

    def start(self) -> None:
        carrier = carrier_inertia(self.inertia, self.axes_wheel, self.inertia_wheel)
        self._inverse = inverse_inertia(carrier)
        i = self._inverse
        self._stiffest = max(  # 1/(kg m2)
            abs(i[0]) + abs(i[1]) + abs(i[2]),
            abs(i[3]) + abs(i[4]) + abs(i[5]),
            abs(i[6]) + abs(i[7]) + abs(i[8]),
        )
        q, omega = normalised(self.q_start_bi), self.omega_start_body
        if self.start_frame == 1:
            q, omega = self._from_lvlh(q, omega)
        self._q, self._h = q, self.h_wheel
        self._momentum = rotate_back(
            q, add(mat_vec(carrier, omega), body_momentum(self.axes_wheel, self._h))
        )
        self._momentum_start = self._momentum

    def _from_lvlh(self, q_bo: Vec4, omega_bo: Vec3) -> tuple[Vec4, Vec3]:
        n = norm(cross(self.r_eci, self.v_eci)) / dot(self.r_eci, self.r_eci)
        q = product(q_bo, lvlh_attitude(self.r_eci, self.v_eci))
        return q, add(omega_bo, rotate(q_bo, (0.0, -n, 0.0)))

    def output(self, t: float) -> None:
        self.q_bi = self._q
        self.omega_bi_body = self._omega()
        self.h_copy_wheel = self._h
        self.impulse_eci = sub(self._momentum, self._momentum_start)

    def _omega(self) -> Vec3:
        wheels = body_momentum(self.axes_wheel, self._h)
        return rate(rotate(self._q, self._momentum), wheels, self._inverse)

    def advance(self, t: float, dt: float) -> None:
        omega = self._omega()
        size = norm(self._momentum) * self._stiffest
        n = max(
            1, ceil(norm(omega) * dt / LARGEST_TURN), ceil(size * dt / LARGEST_NUTATION)
        )  # fmt: skip
        de = 1.0 / n
        step, half = de * dt, 0.5 * de * dt
        surfaces, outer = self._surfaces(), ZERO
        slope = self._slopes(dt)
        y = (*self._q, *self._momentum)
        for i in range(n):
            e = i * de
            if surfaces is not None:
                outer = surfaces(propagated(y[:4], omega, half))
            k1 = slope(e, y, outer)
            k2 = slope(e + 0.5 * de, _moved(y, half, k1), outer)
            k3 = slope(e + 0.5 * de, _moved(y, half, k2), outer)
            k4 = slope(e + de, _moved(y, step, k3), outer)
            y = _combined(y, step / 6.0, k1, k2, k3, k4)
        self._q = normalised(y[:4])
        self._momentum = (y[4], y[5], y[6])
        h, mean = self._h, self.tau_mean_wheel
        self._h = (
            h[0] + dt * mean[0], h[1] + dt * mean[1], h[2] + dt * mean[2], h[3] + dt * mean[3],
        )  # fmt: skip

    def _slopes(self, dt: float) -> Callable[[float, _State, Vec3], _State]:
        """f(e, y, outer): the derivative of y = (q, H) per second, at the share e of the step and
        with the torque `outer` (N m, body) of the surfaces."""
        i11, i12, i13, i21, i22, i23, i31, i32, i33 = self._inverse
        mean, tilt = self.tau_mean_wheel, self.tau_slope_wheel
        axes = self.axes_wheel
        # the wheels' momentum in body, w0 + e (w1 + e w2)
        w0x, w0y, w0z = body_momentum(axes, self._h)
        ax, ay, az = body_momentum(axes, mean)
        bx, by, bz = body_momentum(axes, tilt)
        w2x, w2y, w2z = 0.5 * dt * bx, 0.5 * dt * by, 0.5 * dt * bz
        w1x, w1y, w1z = dt * ax - w2x, dt * ay - w2y, dt * az - w2z
        torque = self._torques(dt)

        def slope(e: float, y: _State, outer: Vec3) -> _State:
            x, v, z, w, hx, hy, hz = y
            xx, v2, zz, ww = x * x, v * v, z * z, w * w
            c11, c12, c13 = xx - v2 - zz + ww, 2.0 * (x * v + z * w), 2.0 * (x * z - v * w)
            c21, c22, c23 = 2.0 * (x * v - z * w), ww - xx + v2 - zz, 2.0 * (v * z + x * w)
            c31, c32, c33 = 2.0 * (x * z + v * w), 2.0 * (v * z - x * w), ww - xx - v2 + zz
            lx = c11 * hx + c12 * hy + c13 * hz - (w0x + e * (w1x + e * w2x))
            ly = c21 * hx + c22 * hy + c23 * hz - (w0y + e * (w1y + e * w2y))
            lz = c31 * hx + c32 * hy + c33 * hz - (w0z + e * (w1z + e * w2z))
            p = 0.5 * (i11 * lx + i12 * ly + i13 * lz)  # half the rate
            q = 0.5 * (i21 * lx + i22 * ly + i23 * lz)
            r = 0.5 * (i31 * lx + i32 * ly + i33 * lz)
            dx, dy = r * v - q * z + p * w, -r * x + p * z + q * w
            dz, dw = q * x - p * v + r * w, -p * x - q * v - r * z
            if torque is None:
                if outer is ZERO:
                    return (dx, dy, dz, dw, 0.0, 0.0, 0.0)
                tx, ty, tz = outer
            else:
                tx, ty, tz = torque(e, (c11, c12, c13, c21, c22, c23, c31, c32, c33), outer)
            return (
                dx, dy, dz, dw,
                c11 * tx + c21 * ty + c31 * tz,
                c12 * tx + c22 * ty + c32 * tz,
                c13 * tx + c23 * ty + c33 * tz,
            )  # fmt: skip

        return slope

    def _torques(self, dt: float) -> Callable[[float, Mat33, Vec3], Vec3] | None:
        """f(e, C, outer): `outer` and all other external torque (N m, body) at the share e of the
        step; None where there is no other."""
        constant = add(self.tau_disturbance_body, self.tau_ext_body)
        thrust, thrust_slope = self.tau_mean_thruster_body, self.tau_slope_thruster_body
        dipole = add(self.m_mean_body, self.residual_dipole_body)
        dipole_slope = self.m_slope_body
        magnetic = any(dipole) or any(dipole_slope)
        gravity = self.gravity_gradient
        if not (magnetic or gravity or any(constant) or any(thrust)
                or any(thrust_slope)):  # fmt: skip
            return None
        b, db, ddb = self.b_eci, self.b_rate_eci, self.b_accel_eci
        r, v, inertia = self.r_eci, self.v_eci, self.inertia
        fall = -0.5 * MU / norm(r) ** 3

        def torque(e: float, c: Mat33, outer: Vec3) -> Vec3:
            lead, s = e - 0.5, e * dt
            x = outer[0] + constant[0] + thrust[0] + lead * thrust_slope[0]
            y = outer[1] + constant[1] + thrust[1] + lead * thrust_slope[1]
            z = outer[2] + constant[2] + thrust[2] + lead * thrust_slope[2]
            if magnetic:
                half = 0.5 * s
                bx, by, bz = mat_vec(c, (
                    b[0] + s * (db[0] + half * ddb[0]),
                    b[1] + s * (db[1] + half * ddb[1]),
                    b[2] + s * (db[2] + half * ddb[2]),
                ))  # fmt: skip
                mx = dipole[0] + lead * dipole_slope[0]
                my = dipole[1] + lead * dipole_slope[1]
                mz = dipole[2] + lead * dipole_slope[2]
                x += my * bz - mz * by
                y += mz * bx - mx * bz
                z += mx * by - my * bx
            if gravity:
                k = 1.0 + fall * s * s
                place = (k * r[0] + s * v[0], k * r[1] + s * v[1], k * r[2] + s * v[2])
                gx, gy, gz = torques.gravity_gradient(mat_vec(c, place), inertia)
                x, y, z = x + gx, y + gy, z + gz
            return (x, y, z)

        return torque

    def _surfaces(self) -> Callable[[Vec4], Vec3] | None:
        """f(q): drag and radiation torque (N m, body), the surroundings as at the step's start."""
        drag = self.aerodynamics if self.density > 0.0 else NONE
        light = self.radiation if self.sunlight > 0.0 else NONE
        if drag == NONE and light == NONE:
            return None
        r, v = self.r_eci, self.v_eci
        wind = (v[0] + EARTH_RATE * r[1], v[1] - EARTH_RATE * r[0], v[2])
        pressure = self.sunlight * torques.SOLAR_PRESSURE
        cd, plates = self.drag_coefficient, self.plates

        def surfaces(q: Vec4) -> Vec3:
            total = ZERO
            if drag != NONE:
                flow = rotate(q, wind)
                total = (
                    torques.drag(flow, self.density, cd * self.area_drag, self.centre_drag_body)
                    if drag == AREA
                    else torques.drag_on_plates(flow, self.density, cd, plates)
                )
            if light == NONE:
                return total
            sun = rotate(q, self.sun_eci)
            return add(
                total,
                torques.radiation(sun, pressure, self.area_radiation, self.centre_radiation_body)
                if light == AREA
                else torques.radiation_on_plates(sun, pressure, plates),
            )

        return surfaces


_State = tuple[float, float, float, float, float, float, float]
"""Attitude and total inertial angular momentum."""


def _moved(y: _State, s: float, k: _State) -> _State:
    return (
        y[0] + s * k[0], y[1] + s * k[1], y[2] + s * k[2], y[3] + s * k[3],
        y[4] + s * k[4], y[5] + s * k[5], y[6] + s * k[6],
    )  # fmt: skip


def _combined(y: _State, s: float, a: _State, b: _State, c: _State, d: _State) -> _State:
    return (
        y[0] + s * (a[0] + 2.0 * (b[0] + c[0]) + d[0]),
        y[1] + s * (a[1] + 2.0 * (b[1] + c[1]) + d[1]),
        y[2] + s * (a[2] + 2.0 * (b[2] + c[2]) + d[2]),
        y[3] + s * (a[3] + 2.0 * (b[3] + c[3]) + d[3]),
        y[4] + s * (a[4] + 2.0 * (b[4] + c[4]) + d[4]),
        y[5] + s * (a[5] + 2.0 * (b[5] + c[5]) + d[5]),
        y[6] + s * (a[6] + 2.0 * (b[6] + c[6]) + d[6]),
    )
