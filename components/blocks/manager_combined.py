from __future__ import annotations

from ..bases.dumping import DUMPING, NO_AXIS, ThrusterDumping
from ..contract.block import Parameter, Vec3
from ..contract.fitting import Law, Need
from ..laws import blending, dumping
from ..maths.vector import ZERO

ILQR, LQR, MEC = range(3)
DCT, CCCP, CRCP, OCDC, BOUNDED_QUADRATIC, BOUNDED_ONE_NORM = range(6)


class ManagerCombined(ThrusterDumping):
    """Combined dumping by magnetic torquers and thrusters

    At each sample `law` gives the dumping torque N on the wheels' momentum h - h_target

    - `ilqr`: N = -g_rate h + offset (infinite horizon, eq. 17);
    - `lqr`: N = -g_rate tanh(g_rate (horizon - t)) h + offset(t) (finite horizon, eq. 17);
    - `mec`: N = -exp(W t) p, open loop, least energy to zero at `horizon` (eq. 19);

    and `split` divides it, N = N_T + M x B, with the measured field B (eq. 20)

    - `dct`: thrusters only; `cccp`: M = -k_cross (N x B) / |B| (eq. 25);
    - `crcp`: M = -(N x B) / |B|^2 (eq. 26); `ocdc`: minimum of a |M|^2 + b |N_T|^2 (eq. 24);
    - `bounded_quadratic`: as ocdc, but within the limit of the dipole;
    - `bounded_one_norm`: minimum of |N_T|_1, the thrusters' on-time, within the limit of the dipole.

    With `saturation` each component of M stays within duty * m_limit and the thrusters
    compensate the remainder (eq. 34); the bounded splits stay within this limit in any
    case. No split uses `dead_axis`. At a sample whose field is not valid the thrusters
    give all of N. Where the momentum is not valid nothing is dumped. A rate that is not
    valid is taken as zero.

    The wheels are commanded to give the body the controller's torque and to absorb,
    with `feedforward`, the dumping torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (N - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    at each sample, or every `wheel_sample_time`, held in between.

    Source: Chen & Steyn (paper 000), eqs. 15-34; the bounded splits are not in the
    paper.
    """

    craft_needs = (Need.COILS,)
    offers = (
        Law(
            "ocdc",
            {
                "law": "ilqr",
                "split": "ocdc",
                "g_rate": "craft.rate",
                # a thruster's torque costs as much as the dipole that gives it across
                # the field
                "weight_ratio": "1 / craft.field / craft.field",
            },
        ),
        Law(
            "bounded 1-norm",
            {
                "law": "ilqr",
                "split": "bounded_one_norm",
                "g_rate": "craft.rate",
            },
        ),
    )

    law: int = Parameter(
        "1", "dumping law", choices=("ilqr", "lqr", "mec"), start="ilqr"
    )
    split: int = Parameter(
        "1",
        "division of the torque",
        choices=(
            "dct",
            "cccp",
            "crcp",
            "ocdc",
            "bounded_quadratic",
            "bounded_one_norm",
        ),
        start="ocdc",
        needs=("b_body",),
    )
    saturation: bool = Parameter("1", "true: bounded dipole, eq. 34", start=True)
    g_rate: float = Parameter(
        "1/s",
        "sqrt(F/R): closed-loop rate of ilqr and lqr",
        start=0.0077,
        min=0.0,
        needs=("h_wheel", "tau_cmd_thruster_body"),
    )
    horizon: float = Parameter(
        "s", "final time of lqr and mec after the start", start=600.0, min=1.0
    )
    k_cross: float = Parameter("1/T", "gain k of cccp", start=35000.0, min=0.0)
    weight_ratio: float = Parameter(
        "1/T2", "b/a of ocdc and bounded_quadratic", start=1e9, min=0.0
    )

    def start(self) -> None:
        super().start()
        self._offsets: tuple[float, ...] = ()
        self._costate = ZERO
        self._omega = self.omega_bi_body

    def dump(
        self, t: float, elapsed_time: float, h: Vec3
    ) -> tuple[Vec3, blending.Split]:
        if elapsed_time == 0.0:
            self._prepare(h)
        n = self._torque(elapsed_time, h)
        self.mode = DUMPING
        return n, self._split(n)

    def _split(self, n: Vec3) -> blending.Split:
        """Split the dumping torque n (N m, body) between torquers and thrusters.

        Returns the torquers' dipole (A m2) and the thrusters' torque (N m), by the law
        that `split` selects. Without a valid field the thrusters give all of it. The
        bounded laws contain the dipole's limits and a dead coil already.
        """
        b = self.b_body
        if not self.valid_b:
            return blending.dct(n, b)
        if self.split == BOUNDED_QUADRATIC:
            return blending.bounded_quadratic(n, b, self.weight_ratio, self.limits())
        if self.split == BOUNDED_ONE_NORM:
            return blending.bounded_one_norm(n, b, self.limits())
        if self.split == DCT:
            split = blending.dct(n, b)
        elif self.split == CCCP:
            split = blending.cccp(n, b, self.k_cross)
        elif self.split == CRCP:
            split = blending.crcp(n, b)
        else:
            split = blending.ocdc(n, b, self.weight_ratio)
        if self.saturation:
            split = blending.limit_dipole(split, b, self.duty * self.m_limit)
        if self.dead_axis != NO_AXIS:
            split = blending.without(split, b, self.dead_axis - 1)
        return split

    def _prepare(self, h: Vec3) -> None:
        """Compute offsets or costate at the first sample."""
        self._omega = self.rate()
        if self.law == LQR:
            self._offsets = dumping.lqr_offsets(
                self._omega,
                self.g_rate,
                self.n_con_body,
                self.horizon,
                self.sample_time,
            )
        elif self.law == MEC:
            self._costate = dumping.mec_costate(
                h, self._omega, self.n_con_body, self.horizon
            )

    def _torque(self, elapsed_time: float, h: Vec3) -> Vec3:
        """Compute the dumping torque (N m, body) of the law that is selected."""
        if self.law == ILQR:
            return dumping.ilqr(h, self.rate(), self.g_rate, self.n_con_body)
        if elapsed_time >= self.horizon:
            return ZERO
        if self.law == LQR:
            i = 3 * int(elapsed_time / self.sample_time + 0.5)
            x, y, z = self._offsets[i : i + 3]
            return dumping.lqr(h, self.g_rate, self.horizon - elapsed_time, (x, y, z))
        return dumping.mec(self._costate, self._omega, elapsed_time)
