from __future__ import annotations

from collections.abc import Iterator

from ..bases.dumping import TorquerDumping
from ..contract.block import SPIN, Parameter, Table, Vec3
from ..contract.fitting import Law, Need
from ..laws import magnetic

CAPACITY = 64
LQR, MEC = range(2)


class ManagerMagnetic(TorquerDumping):
    """Optimal dumping by magnetic torquers, from a design made beforehand

    At each sample, with B the measured field and t the time since the first sample with
    `enable`, until `horizon`:

        M = -R^-1 Q' p,        Q = -[B x], R = diag(dipole_weight)        (eqs. 11, 13)

    - `lqr`: p = K(t) h - g(t), with h the wheels' momentum less `h_target_body`: feedback that
      minimises 1/2 int h'F h + M'R M dt (eq. 10). K and g stand in tables whose first
      `table_nodes` rows lie evenly from 0 to `horizon`, linear in between;
    - `mec`: p = exp(W t) costate, W = -[omega_nominal_body x]: minimum of 1/2 int M'R M dt to a
      given end (eq. 12), in open loop: the momentum is not used.

    Tables and costate belong to one orbit, attitude and start; `desat design` computes
    them. Limit, wheels and invalid measurements are treated as in
    `manager_cross_product`.

    Source: Chen & Steyn (paper 000), eqs. 10-14.
    """

    craft_needs = (Need.DESIGN,)
    offers = (
        Law("optimal LQR", {"law": "lqr"}),
        Law("optimal, open loop", {"law": "mec"}),
    )

    law: int = Parameter("1", "dumping law", choices=("lqr", "mec"), start="lqr")
    horizon: float = Parameter("s", "final time after the start", start=3000.0, min=1.0)
    dipole_weight: Vec3 = Parameter("1", "diagonal of R", start=1.0, min=1e-9)
    table_nodes: int = Parameter(
        "1", "rows of the tables in use", start=2, min=2, max=CAPACITY
    )
    gain_table: Table = Parameter(
        "1/(T2.s)",
        "lqr: a row a node: K, its upper triangle xx, xy, xz, yy, yz, zz",
        shape=(CAPACITY, magnetic.UPPER),
        needs=("h_wheel",),
    )
    offset_table: Table = Parameter(
        "A.m2/T", "lqr: a row a node: g", shape=(CAPACITY, 3)
    )
    costate: Vec3 = Parameter("A.m2/T", "mec: p at the start, body")
    omega_nominal_body: Vec3 = Parameter(
        "rad/s", "mec: rate that the costate was computed for", usual=SPIN
    )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        law, name = ("mec", "costate") if self.law == MEC else ("lqr", "gain_table")
        if not any(getattr(self, name)):
            yield f"{name} = 0: law = {law} commands no dipole without it; `desat design` makes it"
        yield from super().foresee(begin, end, wired_names)

    def dipole(self, elapsed_time: float, h: Vec3) -> Vec3 | None:
        """Return the dipole (A m2, body) of MEC or LQR; None from `horizon` on.

        h is the momentum (N m s, body), elapsed_time (s) that since the first sample.
        """
        if elapsed_time >= self.horizon:
            return None
        if self.law == MEC:
            p = magnetic.mec_costate(
                self.costate, self.omega_nominal_body, elapsed_time
            )
        else:
            span = self.table_nodes, self.horizon, elapsed_time
            gain = magnetic.interpolate_rows(self.gain_table, magnetic.UPPER, *span)
            x, y, z = magnetic.interpolate_rows(self.offset_table, 3, *span)
            p = magnetic.lqr_costate(h, gain, (x, y, z))
        return magnetic.dipole(p, self.b_body, self.dipole_weight)
