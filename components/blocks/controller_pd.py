from __future__ import annotations

from ..contract.block import Mat33, Parameter
from ..contract.roles import Controller
from ..laws.attitude_control import limit_torque, pd_torque, tracking_error
from ..maths.vector import IDENTITY, ZERO


class ControllerPd(Controller):
    """Quaternion PD attitude controller

        dq = q_bi (x) q_ref_bi^-1,      e = sign(dq_4) dq_1:3                       (eq. 7)
        delta omega = omega_bi_body - C(dq) omega_ref_body                          (eq. 8)
        tau_ctrl_body = -G (kp e + kd delta omega)                                  (eqs. 10, 11)

    at each sample, held in between, each axis within +-`torque_limit`; `controller_pid`
    without its integral. No torque at a sample whose attitude or rate is not valid. e
    is half the angle for small errors. Eq. 8 subtracts the rates without naming the
    frame; here the reference rate is transformed into the body frame.

    Source: paper 004, eqs. 7-11.
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
    gain_matrix: Mat33 = Parameter(
        "1",
        "G, body: the identity, or the inertia matrix in kg.m2 (eq. 11)",
        start=IDENTITY,
        follows="spacecraft.inertia",
    )
    torque_limit: float = Parameter(
        "N.m", "largest torque of each axis; 0: no limit", min=0.0
    )

    def start(self) -> None:
        super().start()
        self.tau_ctrl_body = ZERO

    def compute(self, t: float, dt: float) -> None:
        """Command the PD torque (N m, body) at a sample.

        Eq. 10 of paper 004 without its integral, within `torque_limit`; zero while off
        or while a measurement is invalid.
        """
        if not self.due(t):
            return
        if not self.enable:
            self.tau_ctrl_body = ZERO
            return
        if not (self.valid_q and self.valid_omega):
            self.tau_ctrl_body = ZERO
            return
        e, d_omega = tracking_error(
            self.q_bi, self.omega_bi_body, self.q_ref_bi, self.omega_ref_body
        )
        tau = pd_torque(e, d_omega, self.kp, self.kd, self.gain_matrix)
        self.tau_ctrl_body = limit_torque(tau, self.torque_limit)
