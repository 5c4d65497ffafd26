from __future__ import annotations

from ..bases.momentum_management import CAPACITY, GroundTables, MomentumManagement
from ..contract.block import Parameter, Table, Vec3
from ..contract.fitting import Law
from ..laws import momentum_management as laws
from ..maths.attitude import rotate, rotate_back
from ..maths.vector import cross


class ManagerPreview(MomentumManagement, GroundTables):
    """Momentum management by state feedback that knows what comes

    At each sample, with B the measured field and S = A A' the `weighting`,

        mu_M = S (B x P),      P = -(K(t) H + g(t))                (Table 1, open loop)

    The costate depends on the momentum, so the law needs no field model and no integral
    onboard, and has no singular periods. K and g are tables that the ground computes
    (`desat design`) for one orbit, attitude and span, in eci, linear between rows. They
    are those of the cheapest course over the predicted field and gravity gradient, in
    coil energy, momentum and, with a weight on it, the largest wheel speed, and of the
    stiffness with which the course is held. Beyond the tables there is no dipole, and
    `mode` is fallback.

    The law is not in paper 001. Related laws: Psiaki, J. Guidance 24 (2001) 386; Lovera
    & Varga, IEEE CDC (2005), periodic linear-quadratic laws of magnetic attitude
    control; Chen & Steyn (paper 000), eq. 13, over one dumping.

    Coils, limits and invalid measurements: see `bases/momentum_management.py`.
    """

    offers = (Law("preview"),)

    feedback_table: Table = Parameter(
        "1/(T2.s)",
        "a row a node: K, eci, its upper triangle xx, xy, xz, yy, yz, zz",
        shape=(CAPACITY, laws.GAIN),
        needs=("h_wheel",),
    )
    costate_table: Table = Parameter(
        "A.m2/T", "a row a node: g, eci", shape=(CAPACITY, 3)
    )

    def law(self, t: float, h: Vec3) -> Vec3 | None:
        """Return the dipole (A m2, body) of the feedback; None outside the tables.

        The costate P = -(K h + g) (A m2/T) has K and g from the tables, h in eci.
        """
        place = self.place(t)
        if place is None:
            return None
        i, share = place
        gain = laws.between6(self.feedback_table, i, share)
        costate = laws.preview_costate(
            gain, self.offset(i, share), rotate_back(self.q_bi, h)
        )
        p = rotate(self.q_bi, costate)
        m = laws.open_loop_dipole(p, self.field(), self._s)
        self.tau_desired_body = cross(m, self.field())
        return m

    def offset(self, i: int, share: float) -> Vec3:
        """Interpolate g (A m2/T, eci) between rows i and i + 1."""
        return laws.between3(self.costate_table, i, share)
