from __future__ import annotations

from ..bases.acquisition import (
    DETUMBLING,
    DONE,
    MOMENTUM_DUMP,
    NO_ATTITUDE,
    NO_FIELD,
    NO_MOMENTUM,
    NO_RATE,
    PITCH_SPIN,
    START,
    THREE_AXIS,
    WHEEL_RAMP,
    Acquisition,
)
from ..contract.block import Parameter, Vec3
from ..laws import acquisition as laws
from ..maths.vector import ZERO, add

ALONE, CONVENTIONAL, PROPOSED = range(3)
B_DOT, WHEEL, WHEEL_PROPORTIONAL, WHEEL_RATE = range(4)


class ManagerStartUp(Acquisition):
    """Detumbling and wheel start-up as published

    With B the measured field, B' its rate (eq. 2), h the wheel's momentum along -y, T
    the wheel's torque on the body about +y:

        b_dot:               M = -gain_b_dot B'                                    (eq. 1)
        wheel:               T = wheel_torque sgn(B_3 B_1' - B_1 B_3')             (eq. 7)
        wheel_proportional:  T = gain_wheel_field (B_3 B_1' - B_1 B_3')            (eq. 6)
        wheel_rate:          T = -gain_wheel_rate omega_2                          (eq. 3)
        the three of them:   M = (0, -gain_pitch_coil B_2', 0)                     (eq. 8)
        pitch_spin:          M_1 = gain_spin (omega_2 - spin_target) sgn(B_3)      (eq. 9)
        wheel_ramp:          T = ramp_torque
        momentum_dump:       M = gain_dump (h - h_nominal) (-B_3, 0, B_1)          (eq. 11)
        three_axis:          T = -kp theta - kd theta'                             (eq. 10)

    Procedure `conventional`: detumbling by `detumbling`, pitch_spin, wheel_ramp,
    three_axis, done; `proposed`: detumbling, momentum_dump, three_axis, done;
    `detumbling`: detumbling, done. When done, the previous law continues. omega_2 in
    eq. 9, theta and theta' are relative to lvlh.

    The block deviates from the printed laws as follows. The coil of eq. 8 is on in
    every phase after detumbling, because M_1 of eq. 9 alone never reaches the target
    (`spin_coil_alone`: as printed), and eq. 1 on all three axes pumps the wheel when it
    holds the pitch angle (`b_dot_last`: as printed, with gain_pitch_coil). Eq. 11
    continues in three_axis, as otherwise nothing holds h. In momentum_dump, for which
    the paper gives the wheel no law, the wheel keeps the pitch rate by eq. 6: the
    constant torque of eq. 7 is less than the coils' 1e-4 N m of pitch torque, and the
    body would spin up.

    This block commands the wheel and does not use `tau_ctrl_body`: the phase selects
    eq. 10 among several laws of one wheel, and a separate controller would have to know
    the phase.

    Without a valid field the coils are off, and so is the wheel if its law needs the
    field. Where the law needs a rate or an attitude that is not valid, all coils follow
    eq. 1 and the wheel keeps its speed. Without a valid h there is neither a ramp nor
    eq. 11.

    Source: paper 003, eqs. 1-11, Figs. 5 and 6.
    """

    procedure: int = Parameter(
        "1",
        "which phases",
        choices=("detumbling", "conventional", "proposed"),
        start="proposed",
    )
    detumbling: int = Parameter(
        "1",
        "law of detumbling",
        choices=("b_dot", "wheel", "wheel_proportional", "wheel_rate"),
        start="wheel",
        needs=("b_body", "m_cmd_body"),
    )
    gain_b_dot: float = Parameter("A.m2.s/T", "K of eq. 1", start=5e5, min=0.0)
    gain_pitch_coil: float = Parameter("A.m2.s/T", "K of eq. 8", start=3e7, min=0.0)
    wheel_torque: float = Parameter("N.m", "K_w of eq. 7", start=5e-5, min=0.0)
    gain_wheel_field: float = Parameter("N.m.s/T2", "K_w of eq. 6", start=5e6, min=0.0)
    gain_wheel_rate: float = Parameter("N.m.s", "K_w of eq. 3", start=5e-3, min=0.0)
    gain_spin: float = Parameter("A.m2.s", "K_s of eq. 9", start=3e7, min=0.0)
    spin_coil_alone: bool = Parameter(
        "1", "true: eq. 9 as printed, without the pitch coil"
    )
    ramp_torque: float = Parameter(
        "N.m", "torque of the open-loop ramp", start=1e-3, min=1e-9
    )
    gain_dump: float = Parameter("1/(T2.s)", "K_ws of eq. 11", start=3e7, min=0.0)
    dump_reversed: bool = Parameter("1", "true: eq. 11 with h counted along +y")
    kp: float = Parameter("N.m", "K_p of eq. 10", start=9.1708e-4, min=0.0)
    kd: float = Parameter("N.m.s", "K_d of eq. 10", start=2.292e-2, min=0.0)
    b_dot_last: bool = Parameter(
        "1", "true: eq. 1 on all axes in three_axis, as printed"
    )

    def start(self) -> None:
        super().start()
        if self.detumbling == WHEEL and self.wheel_torque > self.torque_limit:
            self.fail(
                f"wheel_torque = {self.wheel_torque} N m is beyond torque_limit = "
                f"{self.torque_limit}"
            )

    def sequence(self) -> tuple[int, ...]:
        return (
            (DETUMBLING, DONE),
            (DETUMBLING, PITCH_SPIN, WHEEL_RAMP, THREE_AXIS, DONE),
            (DETUMBLING, MOMENTUM_DUMP, THREE_AXIS, DONE),
        )[self.procedure]

    def rate(self) -> Vec3 | None:
        return self.omega_bi_body if self.valid_omega else None

    def act(self, phase: int) -> int:
        law = (self._detumble, self._spin, self._ramp, self._dump, self._stabilise)[
            phase
        ]
        return law()

    def _detumble(self) -> int:
        """Command coils and wheel by the law of detumbling."""
        b, b_rate = self.b_body, self._b_rate
        if b_rate is None:
            return START if self.valid_b else NO_FIELD
        kind = self.detumbling
        if kind == B_DOT:
            self._b_dot(b_rate, self.gain_b_dot)
            # the condition of the phase needs the rate
            return START if self.valid_omega else NO_RATE
        if kind == WHEEL_RATE:
            if not self.valid_omega:
                self._b_dot(b_rate, self.gain_b_dot)
                return NO_RATE
            torque = laws.wheel_rate(self.omega_bi_body[1], self.gain_wheel_rate)
        elif kind == WHEEL:
            torque = laws.wheel_constant(b, b_rate, self.wheel_torque)
        else:
            torque = laws.wheel_proportional(b, b_rate, self.gain_wheel_field)
        self.give(self._pitch_coil(), torque)
        return START if self.valid_omega else NO_RATE

    def _spin(self) -> int:
        """Command the coils to spin the craft about pitch (eq. 9)."""
        if missing := self._without():
            return missing
        if not self.valid_b:
            return NO_FIELD
        rate = self.turning()[1]
        m = laws.pitch_spin(self.b_body, rate, self.spin_target, self.gain_spin)
        if not self.spin_coil_alone:
            m = add(m, self._pitch_coil())
        self.give(m, 0.0)
        return START

    def _ramp(self) -> int:
        """Command the wheel's constant torque."""
        self.give(self._pitch_coil(), self.ramp_torque if self.valid_h else 0.0)
        if not self.valid_h:
            return NO_MOMENTUM
        return START if self.valid_b else NO_FIELD

    def _dump(self) -> int:
        """Command the coils to fill the wheel (eq. 11), which keeps the pitch rate."""
        b, b_rate = self.b_body, self._b_rate
        if b_rate is None:
            return START if self.valid_b else NO_FIELD
        torque = laws.wheel_proportional(b, b_rate, self.gain_wheel_field)
        self.give(add(self._pitch_coil(), self._dump_dipole()), torque)
        if not self.valid_h:
            return NO_MOMENTUM
        return START if self.valid_omega else NO_RATE

    def _stabilise(self) -> int:
        """Command wheel and coils to point (eq. 10)."""
        if missing := self._without():
            return missing
        angle = laws.pitch_angle(self.of_reference((0.0, 0.0, 1.0)))
        torque = laws.pitch_pd(angle, self.turning()[1], self.kp, self.kd)
        if self.b_dot_last:
            m = (
                ZERO
                if self._b_rate is None
                else laws.b_dot(self._b_rate, self.gain_pitch_coil)
            )
        else:
            m = add(self._pitch_coil(), self._dump_dipole())
        self.give(m, torque)
        if not self.valid_b:
            return NO_FIELD
        return START if self.valid_h else NO_MOMENTUM

    def _without(self) -> int:
        """Command eq. 1 on all coils where rate or attitude are not valid.

        The wheel keeps its speed. Returns the missing measurement, or START.
        """
        if self.valid_omega and self.valid_q:
            return START
        if self._b_rate is not None:
            self._b_dot(self._b_rate, self.gain_b_dot)
        return NO_ATTITUDE if self.valid_omega else NO_RATE

    def _b_dot(self, b_rate: Vec3, gain: float) -> None:
        """Command the B-dot dipole (eq. 1) and no wheel torque."""
        self.give(laws.b_dot(b_rate, gain), 0.0)

    def _pitch_coil(self) -> Vec3:
        """Compute the dipole of the pitch coil (A m2, body), eq. 8."""
        if self._b_rate is None:
            return ZERO
        return laws.pitch_coil(self._b_rate, self.gain_pitch_coil)

    def _dump_dipole(self) -> Vec3:
        """Compute the dipole that fills the wheel (A m2, body), eq. 11."""
        if not (self.valid_h and self.valid_b):
            return ZERO
        h = -self.h() if self.dump_reversed else self.h()
        return laws.momentum_dump(self.b_body, h, self.h_nominal, self.gain_dump)
