from __future__ import annotations

from ..block import Mat34, Parameter, Vec3
from ..laws import blending, dumping
from ..roles import Manager
from ..vector import ZERO, sub
from ..wheel_array import body_momentum, pseudo_inverse, wheel_torque

IDLE, DUMPING = 0, 1


class ManagerCombined(Manager):
    """Combined dumping by magnetic torquers and thrusters

    At each sample `law` gives the dumping torque N on the wheels' momentum h - h_target

    - `ilqr`: N = -g_rate h + offset (infinite horizon, eq. 17);
    - `lqr`: N = -g_rate tanh(g_rate (horizon - t)) h + offset(t) (finite horizon, eq. 17);
    - `mec`: N = -exp(W t) p, open loop, least energy to zero at `horizon` (eq. 19);

    and `split` divides it, N = N_T + M x B, with the measured field B (eq. 20)

    - `dct`: thrusters only; `cccp`: M = -k_cross (N x B) / |B| (eq. 25);
    - `crcp`: M = -(N x B) / |B|^2 (eq. 26); `ocdc`: least a |M|^2 + b |N_T|^2 (eq. 24).

    With `saturation` each component of M stays within duty * m_limit and the thrusters make up
    for the rest (eq. 34).

    The wheels are commanded to give the body what the controller wants and to absorb, with
    `feedforward`, the dumping torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (N - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    Source: Chen & Steyn (paper 000), eqs. 15-34.
    """

    law: int = Parameter("1", "dumping law", choices=("ilqr", "lqr", "mec"), start="ilqr")
    split: int = Parameter(
        "1", "division of the torque", choices=("dct", "cccp", "crcp", "ocdc"), start="ocdc"
    )
    saturation: bool = Parameter("1", "true: bounded dipole, eq. 34", start=True)
    m_limit: float = Parameter("A.m2", "largest dipole of each coil", start=40.0, min=0.0)
    duty: float = Parameter("1", "share of the period that coils may be on", start=0.9, min=0.0,
                            max=1.0)  # fmt: skip
    g_rate: float = Parameter(
        "1/s", "sqrt(F/R): closed-loop rate of ilqr and lqr", start=0.0077, min=0.0
    )
    horizon: float = Parameter(
        "s", "final time of lqr and mec after the start", start=600.0, min=1.0
    )
    k_cross: float = Parameter("1/T", "gain k of cccp", start=35000.0, min=0.0)
    weight_ratio: float = Parameter("1/T2", "b/a of ocdc", start=1e9, min=0.0)
    n_con_body: Vec3 = Parameter("N.m", "known constant torque of an off-nadir attitude, body")
    axes_wheel: Mat34 = Parameter(
        "1", "columns: the wheels' axes, body; zero where there is no wheel",
        start=(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0),
        shared=True,
    )  # fmt: skip
    feedforward: bool = Parameter(
        "1", "true: the wheels absorb the dumping torque at once", start=True
    )
    gyroscopic: bool = Parameter(
        "1", "true: the wheels absorb the gyroscopic torque of their momentum", start=True
    )

    def start(self) -> None:
        super().start()
        self._to_wheels = pseudo_inverse(self.axes_wheel)
        self._offsets: tuple[float, ...] = ()
        self._costate = ZERO
        self._omega = self.omega_bi_body
        self._started = 0.0
        self.tau_cmd_wheel = (0.0, 0.0, 0.0, 0.0)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self._n = ZERO
        self.mode = IDLE

    def advance(self, t: float, dt: float) -> None:
        first = self._sample < 0
        if self.due(t):
            if self.enable:
                self._sample_now(t, first)
            else:
                self._n = self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
                self.mode = IDLE
        self.tau_cmd_wheel = wheel_torque(
            self._to_wheels,
            self.axes_wheel,
            self._n if self.feedforward else ZERO,
            self.tau_ctrl_body,
            self.omega_bi_body if self.gyroscopic else ZERO,
            self.h_wheel,
        )

    def _sample_now(self, t: float, first: bool) -> None:
        h = sub(body_momentum(self.axes_wheel, self.h_wheel), self.h_target_body)
        if first:
            self._prepare(t, h)
        self._n = n = self._torque(t - self._started, h)
        b = self.b_body
        if self.split == 0:
            split = blending.dct(n, b)
        elif self.split == 1:
            split = blending.cccp(n, b, self.k_cross)
        elif self.split == 2:
            split = blending.crcp(n, b)
        else:
            split = blending.ocdc(n, b, self.weight_ratio)
        if self.saturation:
            split = blending.saturated(split, b, self.duty * self.m_limit)
        self.m_cmd_body, self.tau_cmd_thruster_body = split
        self.mode = DUMPING

    def _prepare(self, t: float, h: Vec3) -> None:
        self._started, self._omega = t, self.omega_bi_body
        if self.law == 1:
            self._offsets = dumping.lqr_offsets(
                self._omega, self.g_rate, self.n_con_body, self.horizon, self.sample_time
            )
        elif self.law == 2:
            self._costate = dumping.mec_costate(h, self._omega, self.n_con_body, self.horizon)

    def _torque(self, elapsed: float, h: Vec3) -> Vec3:
        if self.law == 0:
            return dumping.ilqr(h, self.omega_bi_body, self.g_rate, self.n_con_body)
        if elapsed >= self.horizon:
            return ZERO
        if self.law == 1:
            i = 3 * int(elapsed / self.sample_time + 0.5)
            x, y, z = self._offsets[i : i + 3]
            return dumping.lqr(h, self.g_rate, self.horizon - elapsed, (x, y, z))
        return dumping.mec(self._costate, self._omega, elapsed)
