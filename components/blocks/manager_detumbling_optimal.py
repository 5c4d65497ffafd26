from __future__ import annotations

from math import cos

from ..bases.acquisition import (
    DETUMBLING,
    DONE,
    MOMENTUM_DUMP,
    NO_ATTITUDE,
    NO_FIELD,
    NO_MOMENTUM,
    NO_RATE,
    START,
    THREE_AXIS,
    Acquisition,
)
from ..contract.block import SPIN, TURN, Mat33, Output, Parameter, PerWheel, Vec3
from ..laws import acquisition as laws
from ..laws import rate_observer
from ..laws.field_rate import rate_across
from ..maths.attitude import rotate
from ..maths.vector import ZERO, dot, mat_vec, scale, unit
from ..physics.gyrostat import carrier_inertia, inverse_inertia

ALONE, START_UP = range(2)
GYRO, FIELD, OBSERVER = range(3)
SATURATED, EVEN_DECAY, LOOK_AHEAD = range(3)


class ManagerDetumblingOptimal(Acquisition):
    """Detumbling and wheel start-up with all coils at their limit

    Detumbling, with omega the rate by `rate_from`, B the field, T the wheel's torque on
    the body:

        M = gain omega x B,   each coil within +-m_limit;      T = -gain_wheel omega_2

    (M x B).omega = -M.(omega x B): with a large gain, each coil is at its limit with
    the sign of (omega x B)_i, and kinetic energy falls as fast as the coils allow.

    `start_up` acts from the first second on, where attitude and momentum are valid.
    With a the wheel's axis along -y, n the orbit normal and omega_o the rate relative
    to lvlh:

        M = gain_start_up e x B / |B|^2
        e = J omega + beta J omega_o + (h - h_nominal) a - gamma h_nominal (n - a)
        T = -gain_wheel omega_o2, or -kp theta - kd theta' where the angle between a and n is below
            `upright_angle` and every rate below `upright_rate`

    e drives the momentum of craft and wheel to that of the pointing craft. gamma weighs
    turning the wheel's axis to the normal against filling the wheel first. From gamma 1
    on some attitudes stay inverted; 0 needs no attitude.

    The phases of `start_up` only report its progress: detumbling, momentum_dump,
    three_axis, done.

    **Rate.** `gyro`; `field`: -B x B' / |B|^2, the part across the field, by the field's
    rate; `observer`: Euler's equations with the commanded dipole and the wheel's
    measured momentum, corrected by the field (`bandwidth`), from magnetometer and
    tachometer alone. While the gyro is not valid, `field` replaces it, and no condition
    is met. Without a valid field there is no dipole, and the observer restarts. Without
    a valid attitude or momentum the block detumbles.

    For comparison, `law` offers two published laws of the detumbling dipole:
    `even_decay`, M = 2 n (1 + sin xi) J_min (omega x B) / |B|^2 (Avanzini & Giulietti
    2012), and `look_ahead`, which also weighs, by `alpha`, the momentum that remains in
    the field after `horizon` (Willis et al. 2024). The latter needs attitude, position
    and velocity; while the attitude is not valid, our law replaces it.

    This block commands the wheel itself, as `manager_start_up` does, and not through
    `tau_ctrl_body`.

    Source: ours; eq. 10 of paper 003 for the pitch angle.
    """

    task: int = Parameter(
        "1", "detumbling alone, or start-up", choices=("detumbling", "start_up")
    )
    law: int = Parameter(
        "1",
        "law of detumbling's dipole",
        choices=("saturated", "even_decay", "look_ahead"),
    )
    rate_from: int = Parameter(
        "1", "where the rate is from", choices=("gyro", "field", "observer")
    )
    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(0.3078, 0.0, 0.0, 0.0, 0.2865, 0.0, 0.0, 0.0, 0.2747),
        shared=True,
    )
    inertia_wheel: PerWheel = Parameter(
        "kg.m2",
        "spin inertia of each wheel",
        start=(3.43774677e-4, 0.0, 0.0, 0.0),
        min=0.0,
        shared=True,
    )
    gain: float = Parameter(
        "A.m2.s/T", "of detumbling", start=3e7, min=0.0, needs=("b_body", "m_cmd_body")
    )
    gain_wheel: float = Parameter(
        "N.m.s", "of the wheel's rate law", start=1e-2, min=0.0
    )
    orbit_rate: float = Parameter("rad/s", "even_decay: n", start=1.0716e-3, min=0.0)
    field_inclination: float = Parameter(
        "rad",
        "even_decay: xi, of the orbit to the geomagnetic equator",
        start=1.4,
        min=0.0,
        usual=TURN,
    )
    gain_ahead: float = Parameter(
        "1/(T.s)", "look_ahead: of the dipole", start=1e4, min=0.0
    )
    horizon: float = Parameter("s", "look_ahead: how far", start=600.0, min=0.0)
    alpha: float = Parameter(
        "1", "look_ahead: weight of what will be left", start=10.0, min=0.0
    )
    gain_start_up: float = Parameter("1/s", "of start-up", start=0.01, min=0.0)
    beta: float = Parameter(
        "1", "of start-up: weight of the rate relative to lvlh", start=1.0, min=0.0
    )
    gamma: float = Parameter(
        "1",
        "of start-up: weight of the axis' angle to the orbit normal",
        start=0.3,
        min=0.0,
    )
    upright_angle: float = Parameter(
        "rad", "eq. 10 below this angle", start=0.6435, min=0.0, usual=TURN
    )
    upright_rate: float = Parameter(
        "rad/s", "eq. 10 below these rates", start=0.01, min=0.0, usual=SPIN
    )
    kp: float = Parameter("N.m", "K_p of eq. 10", start=9.1708e-4, min=0.0)
    kd: float = Parameter("N.m.s", "K_d of eq. 10", start=2.292e-2, min=0.0)
    bandwidth: float = Parameter("rad/s", "of the observer", start=0.1, min=1e-6)
    omega_est_body: Vec3 = Output(
        "rad/s", "the rate that the law takes, body", interval=True
    )

    def start(self) -> None:
        """Compute the carrier's inertia (kg m2) and reset the estimated rate."""
        super().start()
        self._carrier = carrier_inertia(
            self.inertia, self.axes_wheel, self.inertia_wheel
        )
        self._inverse = inverse_inertia(self._carrier)
        self._least = min(self.inertia[0], self.inertia[4], self.inertia[8])
        self._omega: Vec3 | None = None
        self._b_model: Vec3 | None = None
        self._h_before = 0.0
        self.omega_est_body = ZERO
        self._t_before = 0.0

    def sequence(self) -> tuple[int, ...]:
        return (
            (DETUMBLING, DONE),
            (DETUMBLING, MOMENTUM_DUMP, THREE_AXIS, DONE),
        )[self.task]

    def rate(self) -> Vec3 | None:
        return None if self.rate_from == GYRO and not self.valid_omega else self._omega

    def for_rate(self) -> tuple[str, ...]:
        inputs = (("omega_bi_body",), (), ("h_wheel",))[self.rate_from]
        return (*inputs, "q_bi", "r_eci", "v_eci") if self.law == LOOK_AHEAD else inputs

    def sense(self, t: float) -> None:
        """Estimate the rate at this sample; None where it is not observable."""
        if self.rate_from == GYRO and self.valid_omega:
            self._omega = self.omega_bi_body
        elif self.rate_from == OBSERVER:
            self._observe(t)
        else:
            b_rate = self._b_rate
            self._omega = None if b_rate is None else rate_across(self.b_body, b_rate)
        self.omega_est_body = ZERO if self._omega is None else self._omega

    def _observe(self, t: float) -> None:
        """Update the observer by the measured field and wheel momentum."""
        if not (self.valid_b and self.valid_h):
            self._omega = self._b_model = None
            return
        b, h = self.b_body, self.h()
        omega, model = self._omega, self._b_model
        if omega is None or model is None:
            self._omega, self._b_model = ZERO, b
        else:
            elapsed_time = t - self._t_before
            # the wheel's torque follows from the change of its momentum, not from the
            # command
            torque = (h - self._h_before) / elapsed_time
            omega, model = rate_observer.predict(
                omega,
                model,
                self.m_cmd_body,
                (0.0, torque, 0.0),
                scale(self._h_before, laws.PITCH_BIAS),
                self._carrier,
                self._inverse,
                elapsed_time,
            )
            self._omega, self._b_model = rate_observer.correct(
                omega, model, b, self.bandwidth, elapsed_time
            )
        self._h_before, self._t_before = h, t

    def act(self, phase: int) -> int:
        """Command detumbling or start-up with the estimated rate.

        Returns the missing measurement (NO_...), or START.
        """
        missing = START
        if self.rate_from == GYRO and not self.valid_omega:
            missing = NO_RATE
        omega = self._omega
        if not self.valid_b:
            missing = NO_FIELD
        if omega is not None:
            if (
                self.task == START_UP
                and self.valid_q
                and self.valid_h
                and missing == START
            ):
                self._start_up(omega)
            else:
                self._detumble(omega)
                if self.task == START_UP and missing == START:
                    missing = NO_MOMENTUM if self.valid_q else NO_ATTITUDE
        return missing

    def _detumble(self, omega: Vec3) -> None:
        """Command coils and wheel to damp the rate omega (rad/s, body)."""
        m = ZERO
        if self.valid_b:
            b, gain = self.b_body, self.gain
            if self.law == EVEN_DECAY:
                size2 = dot(b, b)
                k = laws.even_decay_gain(
                    self._least, self.orbit_rate, self.field_inclination
                )
                gain = k / size2 if size2 > 0.0 else 0.0
            if self.law == LOOK_AHEAD and self.valid_q and any(b):
                later = rotate(
                    self.q_bi, laws.field_ahead(self.r_eci, self.v_eci, self.horizon)
                )
                h = mat_vec(self.inertia, omega)
                m = scale(
                    self.gain_ahead, laws.look_ahead(h, unit(b), later, self.alpha)
                )
            else:
                m = laws.all_coils(omega, b, gain)
        self.give(m, laws.wheel_rate(omega[1], self.gain_wheel))

    def _start_up(self, omega: Vec3) -> None:
        """Command coils and wheel by the start-up law."""
        normal, h = self.normal(), self.h()
        rate = self.relative(omega)
        e = laws.start_up_error(
            mat_vec(self.inertia, omega),
            self.inertia,
            rate,
            h,
            self.h_nominal,
            normal,
            self.beta,
            self.gamma,
        )
        upright = dot(normal, laws.PITCH_BIAS) > cos(self.upright_angle)
        if upright and max(map(abs, rate)) < self.upright_rate:
            angle = laws.pitch_angle(self.of_reference((0.0, 0.0, 1.0)))
            torque = laws.pitch_pd(angle, rate[1], self.kp, self.kd)
        else:
            torque = laws.wheel_rate(rate[1], self.gain_wheel)
        self.give(laws.dipole_against(e, self.b_body, self.gain_start_up), torque)
