from __future__ import annotations

from ..block import Mat34, Parameter
from ..laws import cross_product
from ..roles import Manager
from ..vector import ZERO, clip, cross, norm, sub
from ..wheel_array import body_momentum, pseudo_inverse, wheel_torque

IDLE, DUMPING = range(2)


class ManagerCrossProduct(Manager):
    """Cross-product dumping by magnetic torquers

    At each sample, with h the wheels' momentum less `h_target_body` and B the measured field:

        normalised:  M = gain (h x B) / |B|^2        (gain in 1/s)
        ccpl:        M = gain (h x B) / |B|          (gain in 1/(T s); paper 000, eq. 31)

    each component within m_limit; no dipole while |h| is below `h_deadband`. The wheels are
    commanded to give the body what the controller wants and to absorb, with `feedforward`, the
    magnetic torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (M x B - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    Source: Camillo & Markley (1980) for the law; paper 000, eq. 31; paper 004, eq. 19.
    """

    law: int = Parameter("1", "form of the law", choices=("normalised", "ccpl"), start="normalised")
    gain: float = Parameter("1/s", "gain; for ccpl in 1/(T s)", start=5e-3, min=0.0)
    m_limit: float = Parameter("A.m2", "largest dipole of each axis", start=20.0, min=0.0)
    h_deadband: float = Parameter("N.m.s", "no dumping below this momentum", min=0.0)
    axes_wheel: Mat34 = Parameter(
        "1",
        "columns: the wheels' axes, body; zero where there is no wheel",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )
    feedforward: bool = Parameter(
        "1", "true: the wheels absorb the magnetic torque at once", start=True
    )
    gyroscopic: bool = Parameter(
        "1", "true: the wheels absorb the gyroscopic torque of their momentum", start=True
    )

    def start(self) -> None:
        super().start()
        self._to_wheels = pseudo_inverse(self.axes_wheel)
        self.tau_cmd_wheel = (0.0, 0.0, 0.0, 0.0)
        self.m_cmd_body = self.tau_cmd_thruster_body = self._torque = ZERO
        self.mode = IDLE

    def advance(self, t: float, dt: float) -> None:
        if self.due(t):
            h = sub(body_momentum(self.axes_wheel, self.h_wheel), self.h_target_body)
            if self.enable and norm(h) > self.h_deadband:
                law = (cross_product.normalised, cross_product.ccpl)[self.law]
                self.m_cmd_body = clip(law(h, self.b_body, self.gain), self.m_limit)
                self.mode = DUMPING
            else:
                self.m_cmd_body, self.mode = ZERO, IDLE
            self._torque = cross(self.m_cmd_body, self.b_body) if self.feedforward else ZERO
        self.tau_cmd_wheel = wheel_torque(
            self._to_wheels,
            self.axes_wheel,
            self._torque,
            self.tau_ctrl_body,
            self.omega_bi_body if self.gyroscopic else ZERO,
            self.h_wheel,
        )
