from __future__ import annotations

from ..bases.momentum_management import MomentumManagement
from ..contract.block import Output, Parameter, Vec3
from ..contract.fitting import Law
from ..laws import momentum_management as laws
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import ZERO, add, scale


class ManagerClosedLoop(MomentumManagement):
    """Closed-loop momentum management

    At each sample, with B the measured field and S = A A' the `weighting`,

        T_D = -gain (H + H_B) - T_GG                                       (eq. 5)
        mu_M = (S B) x P,      P = T_D / (B'S B)                           (Table 1)

    so that T_M = mu_M x B is the torque across B that is nearest to T_D, in the norm of
    S^-1. With weighting `wheels` and four skewed wheels this is the cross-product (CP)
    law of 1980.

    H_B keeps the wheels' centre speed at zero. The paper gives no law for it. Ours is
    the centre loop: at the end of each `centre_period` H_B grows by `centre_gain` times
    the mean of the largest and the smallest H in that period, separately for each axis
    of eci.

    Coils, limits and invalid measurements: see `bases/momentum_management.py`.

    Source: Chen, Davenport & Sturch (paper 001), eqs. 5 and 6, Table 1.
    """

    offers = (
        Law(
            "CP with gravity",
            {"gain": "craft.rate", "weighting": "identity"},
            rate="gain",
        ),
    )

    gain: float = Parameter("1/s", "K_M of eq. 5", start=1e-3, min=1e-9)
    centre_gain: float = Parameter("1", "of the centre loop; 0: none", min=0.0, max=1.0)
    centre_period: float = Parameter("s", "of the centre loop", start=5677.0, min=1.0)
    h_bias_eci: Vec3 = Output("N.m.s", "H_B, eci: for the report", interval=True)

    def start(self) -> None:
        super().start()
        self.h_bias_eci = self._least = self._most = ZERO
        self._since = -1.0

    def law(self, t: float, h: Vec3) -> Vec3 | None:
        if self.centre_gain > 0.0:
            self._centre(t, rotate_back(self.q_bi, h))
        bias = rotate(self.q_bi, self.h_bias_eci)
        torque = laws.closed_loop_torque(h, bias, self.gain, self.gravity())
        self.tau_desired_body = torque
        return laws.closed_loop_dipole(torque, self.field(), self._s)

    def _centre(self, t: float, h_eci: Vec3) -> None:
        """Update the bias from the extremes of the momentum (N m s, eci)."""
        if self._since < 0.0 or t - self._since >= self.centre_period * (1.0 - 1e-9):
            if self._since >= 0.0:
                middle = scale(0.5, add(self._least, self._most))
                self.h_bias_eci = add(self.h_bias_eci, scale(self.centre_gain, middle))
            self._since, self._least, self._most = t, h_eci, h_eci
        x, y, z = h_eci
        a, b, c = self._least
        self._least = (min(a, x), min(b, y), min(c, z))
        a, b, c = self._most
        self._most = (max(a, x), max(b, y), max(c, z))
