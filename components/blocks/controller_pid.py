from __future__ import annotations

from ..contract.block import Mat33, Parameter, Vec3
from ..contract.roles import Controller
from ..laws.attitude_control import (
    integrate_error,
    limit_torque,
    pid_torque,
    tracking_error,
    unwound,
)
from ..maths.vector import IDENTITY, ZERO, add, mat_vec, scale, sub


class ControllerPid(Controller):
    """Quaternion PID attitude controller

        dq = q_bi (x) q_ref_bi^-1,      e = sign(dq_4) dq_1:3                       (eq. 7)
        delta omega = omega_bi_body - C(dq) omega_ref_body                          (eq. 8)
        xi = clip(xi + T e, integral_limit)
        tau_ctrl_body = -G (kp e + kd delta omega + ki xi)                          (eqs. 10, 11)

    at each sample, T = `sample_time` (or the step) after the last one, held in between,
    each axis within +-`torque_limit`. e is half the angle for small errors. Eq. 8
    subtracts the rates without naming the frame; here the reference rate is transformed
    into the body frame.

    With `anti_windup` the integral does not grow at a sample whose torque is limited.
    It is zero while the controller is disabled. At a sample whose attitude or rate is
    not valid there is no torque, and the integral is held.

    With `feedforward` tau_ctrl_body has also G times the change of omega_ref_body
    since the last sample over T, as a reference that slews needs it.

    The paper's tuning with G the inertia is kp >= beta, kd >= 3 beta, ki <= beta / 500
    (eq. 12), beta 1e-3 to 1e-2; at equality the phase margin is 3 to 22 deg. The
    defaults, beta = 1e-2 and kd = 10 beta, have 65 deg, less the crossover of 0.11
    rad/s times all delays.

    Source: paper 004, eqs. 7-12.
    """

    kp: float = Parameter(
        "N.m",
        "gain on e; 1/s2 where G is an inertia",
        start=1e-2,
        min=0.0,
        needs=("q_bi", "tau_ctrl_body"),
    )
    kd: float = Parameter(
        "N.m.s",
        "gain on delta omega; 1/s where G is",
        start=0.1,
        min=0.0,
        needs=("omega_bi_body", "tau_ctrl_body"),
    )
    ki: float = Parameter("N.m/s", "gain on xi; 1/s3 where G is", start=2e-5, min=0.0)
    gain_matrix: Mat33 = Parameter(
        "1",
        "G, body: the identity, or the inertia matrix in kg.m2 (eq. 11)",
        start=IDENTITY,
        follows="spacecraft.inertia",
    )
    integral_limit: float = Parameter(
        "s", "largest magnitude of each component of xi; 0: no limit", min=0.0
    )
    torque_limit: float = Parameter(
        "N.m", "largest torque of each axis; 0: no limit", min=0.0
    )
    anti_windup: bool = Parameter(
        "1", "true: the integral does not grow while torque is limited"
    )
    feedforward: bool = Parameter(
        "1", "true: G times the reference's acceleration is added; G an inertia"
    )

    def start(self) -> None:
        super().start()
        self._xi = self.tau_ctrl_body = self._ahead = ZERO
        self._rate_before: Vec3 | None = None

    def compute(self, t: float, dt: float) -> None:
        """Command the PID torque (N m, body) at a sample.

        Eq. 10 of paper 004, within `torque_limit`; zero while off or while a
        measurement is invalid. With `anti_windup` the integral (s) of a limited command
        only shrinks.
        """
        if not self.due(t):
            return
        self._foresee_reference(self.sample_time or dt)
        if not self.enable:
            self._xi = self.tau_ctrl_body = ZERO
            return
        if not (self.valid_q and self.valid_omega):
            self.tau_ctrl_body = ZERO
            return
        e, d_omega = tracking_error(
            self.q_bi, self.omega_bi_body, self.q_ref_bi, self.omega_ref_body
        )
        xi = integrate_error(self._xi, e, self.sample_time or dt, self.integral_limit)
        tau = self._torque(e, d_omega, xi)
        if self.anti_windup and tau != limit_torque(tau, self.torque_limit):
            xi = unwound(self._xi, xi)
            tau = self._torque(e, d_omega, xi)
        self._xi = xi
        self.tau_ctrl_body = limit_torque(tau, self.torque_limit)

    def _torque(self, e: Vec3, d_omega: Vec3, xi: Vec3) -> Vec3:
        """Compute the torque (3,) N m, body, before its limit."""
        tau = pid_torque(e, d_omega, xi, self.kp, self.kd, self.ki, self.gain_matrix)
        return add(tau, self._ahead) if self.feedforward else tau

    def _foresee_reference(self, period: float) -> None:
        """Set the torque (N m) of the reference's acceleration since the last sample."""
        before = self._rate_before
        if self.feedforward and before is not None and period > 0.0:
            change = scale(1.0 / period, sub(self.omega_ref_body, before))
            self._ahead = mat_vec(self.gain_matrix, change)
        self._rate_before = self.omega_ref_body
