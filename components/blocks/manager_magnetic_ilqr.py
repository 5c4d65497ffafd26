from __future__ import annotations

from ..bases.dumping import TorquerDumping
from ..contract.block import Parameter, Vec3
from ..contract.fitting import Law
from ..laws import magnetic, riccati
from ..maths.matrix import multiply, transpose
from ..maths.vector import mat_vec, sub


class ManagerMagneticIlqr(TorquerDumping):
    """Optimal dumping by magnetic torquers, solved at every sample

    The feedback is optimal for a field that stays constant (quasi-static LQR). At each
    sample, with h the wheels' momentum less `h_target_body`, B the measured field and
    omega the measured rate:

        M = -R^-1 Q' (K h - g),        Q = -[B x], W = -[omega x], S = Q R^-1 Q'        (eq. 11)
        W'K + K W - K S K + F = 0,     g = (W - S K)^-T K N_con

    with F = diag(momentum_weight), R = diag(dipole_weight) and K by doubling
    (`laws/riccati.py`). It needs neither tables nor knowledge of the orbit. There is no
    such K, and hence no dipole at that sample, where B is zero or along omega, or where
    B, h or omega is not valid. Limit and wheels are treated as in
    `manager_cross_product`.

    Source: Chen & Steyn (paper 000), eqs. 10-11 and section III.A.
    """

    offers = (
        # with a dipole's price of 1, momentum across the field decays at the rate
        Law(
            "quasi-static LQR",
            {
                "momentum_weight": "craft.rate * craft.rate / craft.field / craft.field",
            },
        ),
    )

    momentum_weight: Vec3 = Parameter(
        "1/(T2.s2)",
        "diagonal of F",
        start=3000.0,
        min=0.0,
        needs=("h_wheel", "omega_bi_body"),
    )
    dipole_weight: Vec3 = Parameter("1", "diagonal of R", start=1.0, min=1e-9)
    n_con_body: Vec3 = Parameter(
        "N.m", "known constant torque of an off-nadir attitude, body"
    )

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        """Compute the dipole (A m2) of the costate p = K h - g, K for an endless horizon.

        Paper 000, section III.A. None without a rate, or where there is no such K.
        """
        if not self.valid_omega:
            return None
        bx, by, bz = self.b_body
        x, y, z = self.omega_bi_body
        rx, ry, rz = self.dipole_weight
        fx, fy, fz = self.momentum_weight
        w = (0.0, z, -y, -z, 0.0, x, y, -x, 0.0)
        q = (0.0, bz, -by, -bz, 0.0, bx, by, -bx, 0.0)
        weighted_field = (
            0.0,
            bz / ry,
            -by / rz,
            -bz / rx,
            0.0,
            bx / rz,
            by / rx,
            -bx / ry,
            0.0,
        )
        s = multiply(weighted_field, transpose(q))
        k = riccati.infinite_gain(w, s, (fx, 0.0, 0.0, 0.0, fy, 0.0, 0.0, 0.0, fz))
        if k is None:
            return None
        p = mat_vec(k, h)
        if any(self.n_con_body):
            p = sub(p, riccati.infinite_offset(k, w, s, self.n_con_body))
        return magnetic.dipole(p, self.b_body, self.dipole_weight)
