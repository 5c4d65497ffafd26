from __future__ import annotations

import numpy as np

from ..bases.dumping import TorquerDumping
from ..contract.block import Parameter, Vec3
from ..laws import magnetic, riccati


class ManagerMagneticIlqr(TorquerDumping):
    """Optimal dumping by magnetic torquers, solved at every sample

    The best feedback for a field that would stay as it is (quasi-static LQR). At each sample, with
    h the wheels' momentum less `h_target_body`, B the measured field and omega the measured rate:

        M = -R^-1 Q' (K h - g),        Q = -[B x], W = -[omega x], S = Q R^-1 Q'        (eq. 11)
        W'K + K W - K S K + F = 0,     g = (W - S K)^-T K N_con

    with F = diag(momentum_weight), R = diag(dipole_weight) and K from the stable eigenvectors of
    the Hamiltonian matrix. No tables, no knowledge of the orbit. There is no such K, and so no
    dipole at that sample, where B is zero or along omega, or where B, h or omega is not valid.
    Limit and wheels as in `manager_cross_product`. This block needs numpy in its host.

    Source: Chen & Steyn (paper 000), eqs. 10-11 and section III.A.
    """

    momentum_weight: Vec3 = Parameter("1/(T2.s2)", "diagonal of F", start=3000.0, min=0.0,
                                      needs=("h_wheel", "omega_bi_body"))  # fmt: skip
    dipole_weight: Vec3 = Parameter("1", "diagonal of R", start=1.0, min=1e-9)
    n_con_body: Vec3 = Parameter("N.m", "known constant torque of an off-nadir attitude, body")

    def dipole(self, elapsed: float, h: Vec3) -> Vec3 | None:
        if not self.valid_omega:
            return None
        bx, by, bz = self.b_body
        x, y, z = self.omega_bi_body
        w = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])
        q = np.array([[0.0, bz, -by], [-bz, 0.0, bx], [by, -bx, 0.0]])
        s = (q / self.dipole_weight) @ q.T
        k = riccati.infinite_gain(w, s, np.diag(self.momentum_weight))
        if k is None:
            return None
        p = k @ h
        if any(self.n_con_body):
            p -= riccati.infinite_offset(k, w, s, np.array(self.n_con_body))
        px, py, pz = p.tolist()
        return magnetic.dipole((px, py, pz), self.b_body, self.dipole_weight)
