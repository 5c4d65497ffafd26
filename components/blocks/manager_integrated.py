from __future__ import annotations

from math import inf

from ..contract.block import SPIN, Output, Parameter, PerWheel, Vec3
from ..contract.fitting import Law, Need
from ..contract.roles import WheelManager
from ..laws import integrated
from ..maths.vector import ZERO, norm, scale
from ..physics.wheel_array import body_momentum, pseudo_inverse, to_wheels, wheel_torque

IDLE, DUMPING, _, _, EMERGENCY, VELOCITY_DUMPING = range(6)


class ManagerIntegrated(WheelManager):
    """Attitude control and magnetic momentum management in one loop

    The controller's torque tau is split by k = `magnetic_share`, and the wheels are
    commanded to give away momentum besides. With A = `axes_wheel` and B the measured
    field,

        tau_cmd_wheel = A^+ (t_DES - (1 - k) tau - omega x A h)       (eqs. 13, 14, 16, 21, 22)
        m_cmd_body = B x (k tau) / |B|^2                              (eqs. 17, 18)
        t_DES = -gain (A h')_perp, at most `torque_limit`             (eq. 19)

    where perp means across B. The controller reacts to t_DES with a tau that cancels
    it. The coils give the share k of this tau, so the wheels lose k t_DES. The whole
    dipole is scaled down where a component exceeds `m_limit`. t_DES, dipole and mode
    are set at each sample; the wheels are commanded then, or every `wheel_sample_time`.

    h' excludes the wheels near their target, so that no wheel is driven through zero
    speed: with e = h - A^+ h_target_body - h_null n, wheel i counts in A h' = sum g_i
    e_i from |e_i| = `threshold_on` h_limit on until it is below `threshold_off` h_limit
    (eq. 23). `paper_signed_threshold` uses e_i instead of |e_i|, as eq. 23 is printed;
    wheels that turn backwards are then never unloaded.

    **Emergency** (the paper names it without a law). From a wheel at `emergency_on`
    h_limit until all are below `emergency_off` h_limit, the coils leave the control
    loop (k = 0) and dump as much as they can: t_DES = -`gain_emergency` (A e)_perp, at
    most `m_limit` |B|, balanced at once by m_cmd_body = B x t_DES / |B|^2. A e does not
    contain momentum in the null space.

    **Velocity dumping** (section 4), where `velocity_dumping` is set: tau =
    -`gain_rate` omega (eqs. 24, 25) instead of the controller's torque, from |omega|
    above `rate_on` until it is below `rate_off`; both 0: always. While t_DES is
    saturated the craft continues to tumble at |omega| = torque_limit / gain_rate. Eq.
    26 (gain_rate ~ h_limit gain) has a wrong dimension; equal bandwidths mean gain_rate
    = gain times the inertia.

    **Null space** (not in the paper). n with A n = 0, for a pyramid (1, -1, 1, -1): A h
    does not contain momentum along it, so it remains. `null_gain` adds -null_gain (e.n
    / n.n) n to tau_cmd_wheel, limited to `null_torque_limit` in each wheel; `h_null`
    holds the wheels at h_null n, away from zero.

    `enable` false: no dumping, the wheels give all of tau. `mode` is 0 idle (no wheel
    to unload, the coils still give their share), 1 dumping, 4 emergency, or 5 velocity
    dumping, unless an emergency holds.

    A measurement that is not valid is not used. At a sample without `valid_h` no
    momentum is unloaded, and the selection of wheels to unload does not change. Without
    `valid_b` the wheels give all of tau, as no dipole is commanded. omega x A h is left
    out while `valid_omega` or `valid_h` is false. While `valid_omega` is false,
    velocity dumping neither begins nor ends, and gives no torque.

    Source: paper 004, eqs. 9 and 13-26.
    """

    passes_torque = True

    craft_needs = (Need.COILS, Need.CONTROLLER)
    offers = (
        # the wheels lose a quarter of t_DES; no dipole exceeds m_limit
        Law(
            "integrated",
            {
                "magnetic_share": "0.25",
                "gain": "4 * craft.rate",
                "gain_emergency": "4 * craft.rate",
                "torque_limit": "4 * torquers.m_limit * craft.field",
            },
        ),
    )

    magnetic_share: float = Parameter(
        "1",
        "k: share of the control torque that the coils give",
        start=0.25,
        min=0.0,
        max=1.0,
        needs=("b_body", "m_cmd_body"),
    )
    gain: float = Parameter(
        "1/s", "k_DES of eq. 19", start=0.05, min=0.0, needs=("h_wheel", "b_body")
    )
    torque_limit: float = Parameter(
        "N.m",
        "largest t_DES; the coils see k of it; 0: no limit",
        start=1.2e-5,
        min=0.0,
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each axis",
        start=0.3,
        min=0.0,
        follows="torquers.m_limit",
    )
    h_limit: float = Parameter(
        "N.m.s",
        "momentum capacity of a wheel",
        start=0.02,
        min=1e-9,
        follows="wheels.inertia_wheel * wheels.speed_limit",
    )
    threshold_off: float = Parameter(
        "1",
        "share of h_limit below which a wheel is not unloaded",
        start=0.1,
        min=0.0,
        max=1.0,
    )
    threshold_on: float = Parameter(
        "1", "share of h_limit from which on it is again", start=0.11, min=0.0, max=1.0
    )
    paper_signed_threshold: bool = Parameter(
        "1", "true: eq. 23 as printed, without |.|"
    )
    emergency_on: float = Parameter(
        "1", "share of h_limit of a wheel that begins the emergency", start=0.9, min=0.0
    )
    emergency_off: float = Parameter(
        "1", "share of h_limit below which all wheels end it", start=0.6, min=0.0
    )
    gain_emergency: float = Parameter(
        "1/s", "k_DES in the emergency", start=0.05, min=0.0
    )
    velocity_dumping: bool = Parameter(
        "1", "true: velocity dumping above the rates below", needs=("omega_bi_body",)
    )
    gain_rate: float = Parameter("N.m.s", "k_DMP of eq. 24", start=2e-3, min=0.0)
    rate_on: float = Parameter(
        "rad/s", "velocity dumping begins from this rate on", min=0.0, usual=SPIN
    )
    rate_off: float = Parameter("rad/s", "and ends below this one", min=0.0, usual=SPIN)
    null_gain: float = Parameter(
        "1/s", "rate at which null-space momentum decays", min=0.0, needs=("h_wheel",)
    )
    null_torque_limit: float = Parameter(
        "N.m", "largest torque of a wheel along the null space", start=1e-5, min=0.0
    )
    h_null: float = Parameter(
        "N.m.s",
        "wanted momentum along the null space: of the wheel whose element of n is 1",
    )
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "dumping", "-", "-", "emergency", "velocity_dumping"),
    )
    tau_des_body: Vec3 = Output("N.m", "t_DES, body: for the report", interval=True)

    def start(self) -> None:
        """Check the pairs of thresholds and set the state to its start values."""
        super().start()
        for on, off in (
            ("threshold_on", "threshold_off"),
            ("emergency_on", "emergency_off"),
            ("rate_on", "rate_off"),
        ):
            if getattr(self, on) < getattr(self, off):
                self.fail(
                    f"{on} = {getattr(self, on)} is below {off} = {getattr(self, off)}"
                )
        self._to_wheels = pseudo_inverse(self.axes_wheel)
        self._null = integrated.null_vector(self.axes_wheel)
        self._off = (0.0,) * len(self.h_wheel)
        self._unloading = (False,) * len(self.h_wheel)
        self._emergency = self._tumbling = False
        self._share = 0.0
        self.tau_des_body = ZERO
        self._null_torque = self.tau_cmd_wheel = self._off
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.mode = IDLE

    def compute(self, t: float, dt: float) -> None:
        is_sample = self.due(t)
        if is_sample:
            self._decide()
        if self.wheels_due(t, is_sample):
            self.tau_cmd_wheel = self._wheel_command()

    def _wheel_command(self) -> PerWheel:
        """Compute the torque to each rotor (N m)."""
        torque = wheel_torque(
            self._to_wheels,
            self.axes_wheel,
            self.tau_des_body,
            scale(1.0 - self._share, self._commanded_torque()),
            self.omega_bi_body if self.valid_omega else ZERO,
            self.h_wheel if self.valid_h else self._off,
        )
        return tuple(x + y for x, y in zip(torque, self._null_torque, strict=True))

    def _commanded_torque(self) -> Vec3:
        """Return tau (N m, body), the torque of wheels and coils on the body."""
        if self._tumbling and not self.valid_omega:
            return ZERO
        if self._tumbling:
            return integrated.velocity_torque(self.omega_bi_body, self.gain_rate)
        return self.tau_ctrl_body

    def _decide(self) -> None:
        """Set mode, t_DES and dipole at a sample."""
        if self.valid_omega:
            self._tumbling = self.velocity_dumping and integrated.hysteresis(
                self._tumbling, norm(self.omega_bi_body), self.rate_off, self.rate_on
            )
        if self.enable:
            self._manage()
        else:
            self._unloading, self._emergency = (False,) * len(self.h_wheel), False
            self._share, self.tau_des_body, self.m_cmd_body = 0.0, ZERO, ZERO
            self._null_torque = self._off
        if self._emergency:
            self.mode = EMERGENCY
        elif self._tumbling:
            self.mode = VELOCITY_DUMPING
        else:
            self.mode = (
                DUMPING
                if any(self._unloading) and self.valid_h and self.valid_b
                else IDLE
            )

    def _manage(self) -> None:
        """Compute t_DES, the coils' share and the dipole at a sample."""
        b = self.b_body
        excess = self._null_torque = self._off
        if self.valid_h:
            excess = self._excess(self.h_wheel)
            self._watch(excess)
        if not self.valid_b:
            self._share, self.tau_des_body, self.m_cmd_body = 0.0, ZERO, ZERO
            return
        if self._emergency:
            all_of_it = body_momentum(self.axes_wheel, excess)
            most = self.m_limit * norm(b)
            self.tau_des_body = integrated.desaturation(
                all_of_it, b, self.gain_emergency, most
            )
            self._share, by_coils = 0.0, self.tau_des_body
        else:
            k, on = self.magnetic_share, self._unloading
            counted_momentum = tuple(
                is_on * x for is_on, x in zip(on, excess, strict=True)
            )
            self.tau_des_body = integrated.desaturation(
                body_momentum(self.axes_wheel, counted_momentum),
                b,
                self.gain,
                self.torque_limit or inf,
            )
            self._share, by_coils = k, scale(k, self._commanded_torque())
        self.m_cmd_body = integrated.dipole(by_coils, b, self.m_limit)

    def _watch(self, excess: PerWheel) -> None:
        """Update emergency, wheels to unload and null-space torque.

        It needs a valid momentum.
        """
        capacity = self.h_limit
        self._emergency = integrated.hysteresis(
            self._emergency,
            max(map(abs, self.h_wheel)),
            self.emergency_off * capacity,
            self.emergency_on * capacity,
        )
        self._unloading = integrated.unloading(
            self._unloading,
            excess,
            self.threshold_off * capacity,
            self.threshold_on * capacity,
            self.paper_signed_threshold,
        )
        along = integrated.null_direction(
            excess, self.axes_wheel, self._to_wheels, self._null
        )
        self._null_torque = integrated.null_torque(
            excess, along, self.null_gain, self.null_torque_limit
        )

    def _excess(self, h: PerWheel) -> PerWheel:
        """Return the momentum of each wheel (N m s) beyond its target."""
        target = to_wheels(self._to_wheels, self.h_target_body)
        return tuple(
            x - y - self.h_null * z
            for x, y, z in zip(h, target, self._null, strict=True)
        )
