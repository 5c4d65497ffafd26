from __future__ import annotations

from ..bases.dumping import TorquerDumping
from ..contract.block import Parameter, Vec3
from ..contract.fitting import Law
from ..laws import cross_product
from ..maths.vector import norm


class ManagerCrossProduct(TorquerDumping):
    """Cross-product dumping by magnetic torquers

    At each sample, with h the wheels' momentum less `h_target_body` and B the measured
    field:

        normalised:  M = gain (h x B) / |B|^2        (gain in 1/s)
        ccpl:        M = gain (h x B) / |B|          (gain in 1/(T s); paper 000, eq. 31)

    There is no dipole while |h| is below `h_deadband`, or at a sample whose B or h is
    not valid. With `saturation` each component of the dipole stays within `m_limit`.
    The wheels are commanded to give the body the controller's torque and to absorb,
    with `feedforward`, the magnetic torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (M x B - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    at each sample, or every `wheel_sample_time`, held in between.

    Source: Camillo & Markley (1980) for the law; paper 000, eq. 31; paper 004, eq. 19.
    """

    offers = (
        Law("cross product", {"law": "normalised", "gain": "craft.rate"}, rate="gain"),
        Law(
            "ccpl",
            {"law": "ccpl", "gain": "craft.rate / craft.field"},
            rate="gain",
            units={"gain": "1/(T.s)"},
        ),
    )

    law: int = Parameter(
        "1", "form of the law", choices=("normalised", "ccpl"), start="normalised"
    )
    gain: float = Parameter(
        "1/s",
        "gain; for ccpl in 1/(T s)",
        start=5e-3,
        min=0.0,
        needs=("h_wheel", "m_cmd_body"),
    )
    h_deadband: float = Parameter("N.m.s", "no dumping below this momentum", min=0.0)

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        if norm(h) <= self.h_deadband:
            return None
        law = (cross_product.normalised, cross_product.ccpl)[self.law]
        return law(h, self.b_body, self.gain)
