from __future__ import annotations

from ..bases.momentum_management import MomentumManagement, NominalProfile
from ..contract.block import Vec3
from ..contract.fitting import Law
from ..laws import momentum_management as laws
from ..maths.attitude import rotate


class ManagerMixedMode(MomentumManagement, NominalProfile):
    """Mixed-mode momentum management: closed loop along an open-loop profile

    At each sample, with D = `sample_time`, B the measured field and S = A A' the
    `weighting`,

        T_D = (H_NOM(t + D) - H(t)) / D - T_GG(t)                          (eq. 4)
        mu_M = (S B) x P,      P = T_D / (B'S B)                           (Table 1)

    H_NOM is the profile of half-orbit open-loop solutions, computed on the ground
    (`desat design`) for one orbit, attitude and span, in eci: it is cubic between rows,
    but not across the end of a desaturation period. Beyond the table there is no
    dipole, and `mode` is fallback.

    Coils, limits and invalid measurements: see `bases/momentum_management.py`.

    Source: Chen, Davenport & Sturch (paper 001), eq. 4, Table 1.
    """

    offers = (Law("mixed mode"),)

    def law(self, t: float, h: Vec3) -> Vec3 | None:
        nominal = self.nominal(t + self.sample_time)
        if nominal is None:
            return None
        target = rotate(self.q_bi, nominal)
        torque = laws.mixed_mode_torque(h, target, self.sample_time, self.gravity())
        self.tau_desired_body = torque
        return laws.closed_loop_dipole(torque, self.field(), self._s)
