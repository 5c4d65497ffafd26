from __future__ import annotations

from ..contract.block import Mat33, Parameter, Vec3, Vec4
from ..contract.roles import Spacecraft
from ..maths.attitude import normalise, product, propagate, rotate, rotate_back
from ..maths.vector import ZERO, add, cross, dot, mat_vec, norm, scale, sub
from ..physics.orbit import MU, lvlh_attitude


def constant_torque(inertia: Mat33, omega: Vec3, nadir: Vec3, radius: float) -> Vec3:
    """Compute N_con = -omega x J omega + 3 mu / r^3 u x J u (N m, body).

    Paper 000, eq. 3. Inertia in kg m2, inertial rate in rad/s, u the unit vector to
    nadir, all in body; r in m.
    """
    return sub(
        scale(3.0 * MU / radius**3, cross(nadir, mat_vec(inertia, nadir))),
        cross(omega, mat_vec(inertia, omega)),
    )


class SpacecraftFixedAttitude(Spacecraft):
    """Spacecraft with a fixed attitude in the orbital frame and ideal wheels inside

    The wheels absorb every torque, so the attitude never moves and the state is their
    momentum h (three ideal wheels along the body axes; `h_copy_wheel[4]` is 0):

        h' = -omega x h + N_T + M x B + N_con + tau_ext            (eq. 7; W h = -omega x h)
        N_con = -omega x J omega + 3 n^2 u x J u                   (eq. 3; u to nadir)
        omega = C(q_bo) (0, -n, 0)                                 (eq. 2)

    It is integrated by one RK4 step, with the field as b + b' t + b'' t^2 / 2 and
    torque and dipole as mean and slope. The orbit is assumed to be circular. `h_wheel`
    and the wheel torques are not read, as the block contains the wheels.

    Source: Chen & Steyn (paper 000), eqs. 1-9. Inertia: UoSAT-12, from the literature
    on the craft, not in the paper; it matters off nadir only.
    """

    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(40.45, 0.0, 0.0, 0.0, 42.09, 0.0, 0.0, 0.0, 40.36),
    )
    q_bo: Vec4 = Parameter(
        "1",
        "fixed attitude: body from lvlh, scalar last; normalised",
        start=(0.0, 0.0, 0.0, 1.0),
        needs=("r_eci", "v_eci"),
    )
    h_start_body: Vec3 = Parameter("N.m.s", "the wheels' momentum at the start, body")
    tau_disturbance_body: Vec3 = Parameter("N.m", "a constant external torque, body")

    def start(self) -> None:
        """Compute attitude, rate (rad/s) and constant torque (N m) from the orbit."""
        q_bo = normalise(self.q_bo)
        up = scale(1.0 / norm(self.r_eci), self.r_eci)
        n = norm(cross(self.r_eci, self.v_eci)) / dot(self.r_eci, self.r_eci)
        self._q = product(q_bo, lvlh_attitude(self.r_eci, self.v_eci))
        self._omega = rotate(q_bo, (0.0, -n, 0.0))
        nadir = rotate(self._q, scale(-1.0, up))
        self._n_con = constant_torque(
            self.inertia, self._omega, nadir, norm(self.r_eci)
        )
        self._spin = mat_vec(self.inertia, self._omega)
        self._h = self.h_start_body
        self._start_momentum = self._total()

    def _total(self) -> Vec3:
        """Return the total momentum (N m s, eci)."""
        return rotate_back(self._q, add(self._spin, self._h))

    def output(self, t: float) -> None:
        self.q_bi = self._q
        self.omega_bi_body = self._omega
        x, y, z = self._h
        momentum = [0.0] * len(self.h_copy_wheel)
        momentum[0], momentum[1], momentum[2] = x, y, z
        self.h_copy_wheel = tuple(momentum)
        self.impulse_eci = sub(self._total(), self._start_momentum)

    def advance(self, t: float, dt: float) -> None:
        """Integrate h' = N - omega x h (N m s, body) over dt (s) by RK4.

        N is the sum of constant torque, disturbances, thrusters and dipole x B, with
        the attitude turning at the constant rate omega.
        """
        omega = self._omega
        q = (
            self._q,
            propagate(self._q, omega, 0.5 * dt),
            propagate(self._q, omega, dt),
        )
        constant = add(add(self._n_con, self.tau_disturbance_body), self.tau_ext_body)

        def slope(i: int, h: Vec3) -> Vec3:
            """Return the derivative of the momentum (N m, body) at half step i."""
            s, lead = 0.5 * i, 0.5 * i - 0.5
            b_eci = add(
                add(self.b_eci, scale(s * dt, self.b_rate_eci)),
                scale(0.5 * (s * dt) ** 2, self.b_accel_eci),
            )
            dipole = add(self.m_mean_body, scale(lead, self.m_slope_body))
            thrust = add(
                self.tau_mean_thruster_body, scale(lead, self.tau_slope_thruster_body)
            )
            torque = add(add(constant, thrust), cross(dipole, rotate(q[i], b_eci)))
            return sub(torque, cross(omega, h))

        h = self._h
        k1 = slope(0, h)
        k2 = slope(1, add(h, scale(0.5 * dt, k1)))
        k3 = slope(1, add(h, scale(0.5 * dt, k2)))
        k4 = slope(2, add(h, scale(dt, k3)))
        change = add(add(k1, k4), scale(2.0, add(k2, k3))) if dt else ZERO
        self._h = add(h, scale(dt / 6.0, change))
        self._q = q[2]
