from __future__ import annotations

from ..bases.boom import Y_AXIS, Z_AXIS, Boom
from ..contract.block import SPIN, Output, Parameter, Vec3
from ..laws import gravity_gradient as laws
from ..maths.vector import ZERO, norm, scale

NO_WHEEL, WHEEL_Y, WHEEL_Z = range(3)
IDLE, CONTROLLING, RECOVERING = range(3)


class ManagerBoom(Boom):
    """Coils and at most one wheel keep a boom upright, as published

    With u nadir in body, tilt = (u_2, -u_1), omega the rate relative to lvlh, h the
    wheel's momentum less `h_target_body`, B the measured field, N the wheel's torque on
    the body:

        M = e x B / |B|                                                     (eq. 16)
        e_1 = gain_tilt tilt_1 + gain_rate omega_1
        e_2 = gain_tilt tilt_2 + gain_rate omega_2;   with a wheel along y: gain_dump h_2
        e_3 = gain_yaw yaw + gain_yaw_rate omega_3;   with a wheel along z: gain_dump h_3
        N   = -kp yaw - kd omega_3 about z, or -kp pitch - kd omega_2 about y

    so that the torque of the coils is -|B| e across B. Yaw and pitch are angles of the
    2-1-3 sequence (eq. 6). There is no dipole while |e| is at most `deadband`.

    **Recovery** (an option, of a wheel along y; ours). A craft that stands upside down
    is stable. Each time that nadir passes the boom's line, u_1 = 0, the wheel is driven
    to h_2 = -A sign(omega_2) with A = `recovery_momentum`. It thereby gives its 2 A to
    the body in the direction in which the body swings, until the craft turns over.
    Then, upright, it is driven to +A sign(omega_2), until the craft swings slower than
    `recovery_rate` there; below A / J_2 the wheel may never achieve that. Meanwhile the
    coils do not dump h_2 but damp omega_2: a craft that turns over repeatedly receives
    from the wheel on one side what the wheel takes on the other.

    Without a valid field, attitude or rate (see `reason`) the coils are off and the
    wheel holds the rate (-kd omega). Without a valid h there is no dumping.

    Source: paper 002, eqs. 6 and 16; the composition of e and all gains are not in it;
    they are ours, fitted to its figures.
    """

    wheel: int = Parameter("1", "which wheel there is", choices=("none", "y", "z"))
    gain_tilt: float = Parameter(
        "A.m2/rad",
        "of the tilt",
        start=25.0,
        min=0.0,
        needs=("b_body", "m_cmd_body", "q_ref_bi"),
    )
    gain_rate: float = Parameter("A.m2.s/rad", "of its rate", start=4.4e4, min=0.0)
    gain_yaw: float = Parameter("A.m2/rad", "of yaw, without a wheel along z", min=0.0)
    gain_yaw_rate: float = Parameter("A.m2.s/rad", "of its rate", min=0.0)
    gain_dump: float = Parameter(
        "1/(T.s)", "of the wheel's momentum", start=380.0, min=0.0
    )
    kp: float = Parameter("N.m/rad", "of the wheel's angle", start=8e-5, min=0.0)
    kd: float = Parameter("N.m.s/rad", "of the wheel's rate", start=1.5e-2, min=0.0)
    recovery: bool = Parameter("1", "true: turn a craft that is upside down")
    recovery_momentum: float = Parameter(
        "N.m.s",
        "by how much the wheel's momentum goes to either side of its target",
        start=0.1,
        min=1e-6,
    )
    recovery_rate: float = Parameter(
        "rad/s",
        "recovery ends below this rate through upright",
        start=1e-3,
        min=0.0,
        usual=SPIN,
    )
    recovery_torque: float = Parameter(
        "N.m", "largest torque of it", start=5e-3, min=1e-9
    )
    deadband: float = Parameter("A.m2", "no dipole up to this size of e", min=0.0)
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "controlling", "recovering"),
    )

    def start(self) -> None:
        super().start()
        if self.wheel != NO_WHEEL:
            axis, name = ((Y_AXIS, "y"), (Z_AXIS, "z"))[self.wheel - 1]
            self.need_wheel(axis, f"wheel = {name}")
        if self.recovery and self.wheel != WHEEL_Y:
            self.fail("recovery = true: it needs wheel = y")
        self._recovering, self._side, self._goal = False, 0.0, 0.0
        self.mode = IDLE

    def act(self, t: float) -> None:
        """Command the coils by eq. 16 with the composed e, and the wheel by a PD law.

        A recovery replaces both while the craft is turned over.
        """
        a, (x, y, z) = self._a, self._rate
        h = self.momentum()
        lean = laws.tilt((a[2], a[5], a[8]))
        _, pitch, yaw = laws.euler_angles(a)
        e_x = self.gain_tilt * lean[0] + self.gain_rate * x
        e_y = self.gain_tilt * lean[1] + self.gain_rate * y
        e_z = self.gain_yaw * yaw + self.gain_yaw_rate * z
        torque = ZERO
        if self.wheel == WHEEL_Y:
            e_y = self.gain_dump * h[1]
            torque = scale(laws.pd(pitch, y, self.kp, self.kd), Y_AXIS)
            if self.recovery and self.valid_h and self._turn((a[2], a[5], a[8]), y):
                most = self.recovery_torque
                e_x, e_y = self.gain_rate * x, self.gain_rate * y
                torque = scale(
                    min(max(0.05 * (h[1] - self._goal), -most), most), Y_AXIS
                )
        elif self.wheel == WHEEL_Z:
            e_z = self.gain_dump * h[2]
            torque = scale(laws.pd(yaw, z, self.kp, self.kd), Z_AXIS)
        e = (e_x, e_y, e_z)
        on = self.enable and norm(e) > self.deadband
        self.mode = RECOVERING if self._recovering else CONTROLLING if on else IDLE
        self.give(laws.cross_product(e, self.b_body) if on else ZERO, torque)

    def _turn(self, u: Vec3, rate: float) -> bool:
        """Return whether the craft is being turned over; set the wheel's goal."""
        upside_down, side = laws.is_inverted(u), 1.0 if u[0] >= 0.0 else -1.0
        has_crossed = side != self._side
        self._side = side
        if upside_down and not self._recovering:
            self._recovering = has_crossed = True
        if self._recovering and has_crossed:
            if not upside_down and abs(rate) < self.recovery_rate:
                self._recovering = False
            sense = self.recovery_momentum if rate >= 0.0 else -self.recovery_momentum
            self._goal = -sense if upside_down else sense
        return self._recovering

    def hold(self, t: float) -> Vec3:
        self.mode = IDLE
        if self.wheel == NO_WHEEL:
            return ZERO
        if self.wheel == WHEEL_Y:
            return scale(-self.kd * self._rate[1], Y_AXIS)
        return scale(-self.kd * self._rate[2], Z_AXIS)
