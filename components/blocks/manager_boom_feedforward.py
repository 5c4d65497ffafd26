from __future__ import annotations

from ..bases.boom import NOTHING, X_AXIS, Y_AXIS, Z_AXIS, Boom
from ..contract.block import SMALL_ANGLE, Mat33, Output, Parameter, Table, Vec3, Vec4
from ..laws import firing
from ..laws import gravity_gradient as laws
from ..maths.attitude import IDENTITY_Q, inverse, matrix, product, propagated, rotate
from ..maths.vector import ZERO, add, clip, cross, mat_vec, norm, scale, sub
from ..physics.gyrostat import check_inertia, inverse_inertia
from ..physics.wheel_array import body_momentum

WHEELS_Z, WHEELS_YZ, WHEELS_XYZ = range(3)
IDLE, CONTROLLING, FIRING = range(3)
TORQUE_LIMIT = 5
ENTRIES = 8
NONE = -1


class ManagerBoomFeedforward(Boom):
    """One to three wheels keep a boom upright, and take what a firing gives while it
    gives it

    The sample period is T = `sample_time`. With theta the rotation vector from the
    reference to the body, omega_o the rate relative to the reference, h the wheels'
    momentum less `h_target_body` and F the predicted mean torque of the firing over [t,
    t + T], the torque on the body about each axis that has a wheel is

        N = -J wn^2 (theta - lean) - 2 damping wn J omega_o - M x B - F + omega x h

    within +-torque_limit: the wheels absorb the firing, the coils' torque and the
    gyroscopic torque of their momentum. The coils follow eq. 16 of paper 002,

        M = e x B / |B|,   e_i = gain_dump h_i of an axis with a wheel, where |h| > h_deadband
                           e_i = gain_tilt tilt_i + gain_rate omega_oi of one without

    with no dipole while |e| is at most `deadband`; M is rounded to pulses of the coils.
    The gravity gradient dumps momentum, too: the craft leans by lean = gain_lean h,
    within +-lean_limit, about roll and pitch where they have wheels, so that the
    gravity-gradient torque opposes h.

    **Firings** are known as a schedule, one at a time, each from a sample on.
    `schedule_start`, `_duration` and `_tau_body` are those of the thrusters (`shared`);
    thrusters that deviate from them have their own errors (`thrusters_misaligned`).
    They are parameters, not a connector, since the schedule is known before the run and
    the role's interface does not change.

    **What is known better.** The rate comes from a Kalman filter for each axis: J omega
    + h is rotated against the body, with the impulses of gravity, coils and firing and
    the measured wheels, and corrected by the gyro (`gyro_noise`). Unknown torque is
    `torque_noise`, and also firing_uncertainty |F| during a firing. The corrections of
    J omega since the beginning of a firing are its impulse beyond the expected one.
    They correct F at every sample and, with `learning`, for later firings, in
    proportion to their size, once `learning_time` has passed after its end.

    Without a valid field, attitude or rate (see `reason`) the coils are off; the wheels
    hold the rate and still absorb the firing. Without a valid h nothing is dumped and
    the filter is not updated. `reason` is torque_limit where a wheel's torque would
    have to exceed torque_limit.

    Source: ours; eq. 16 of paper 002.
    """

    sample_time: float = Parameter(
        "s", "time between samples, a multiple of the step", start=10.0, min=1e-3
    )
    wheels: int = Parameter(
        "1",
        "about which body axes wheels give a torque",
        choices=("z", "y_z", "x_y_z"),
        start="x_y_z",
        needs=("q_ref_bi", "omega_ref_body"),
    )
    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(153.0, 0.25, -0.1, 0.25, 153.0, -0.0005, -0.1, -0.0005, 5.0),
        shared=True,
    )
    schedule_start: Table = Parameter(
        "s",
        "firings: when each begins, a multiple of sample_time",
        shape=(ENTRIES,),
        shared=True,
    )
    schedule_duration: Table = Parameter(
        "s", "firings: how long; 0: none", shape=(ENTRIES,), min=0.0, shared=True
    )
    schedule_tau_body: Table = Parameter(
        "N.m",
        "firings: torque of each on the body, body, as far as it is known",
        shape=(ENTRIES, 3),
        shared=True,
    )
    feedforward: bool = Parameter("1", "false: the firing is not known", start=True)
    learning: bool = Parameter("1", "true: a firing teaches of the next", start=True)
    learning_time: float = Parameter("s", "after a firing's end", start=300.0, min=0.0)
    firing_uncertainty: float = Parameter(
        "1",
        "deviation of a firing's torque, each axis, over its size",
        start=0.3,
        min=0.0,
    )
    gyro_noise: float = Parameter(
        "rad/s", "deviation of the measured rate, each axis", start=3.49e-5, min=1e-12
    )
    torque_noise: Vec3 = Parameter(
        "N.m", "deviation of the unknown torque over a sample", start=1e-5, min=0.0
    )
    attitude_gain: float = Parameter(
        "1",
        "share of the measured attitude that the estimate takes over at a sample",
        start=0.1,
        min=0.0,
        max=1.0,
    )
    bandwidth: Vec3 = Parameter(
        "rad/s", "wn of each axis", start=(0.02, 0.02, 0.04), min=0.0
    )
    damping: float = Parameter("1", "damping of the wheels' law", start=1.0, min=0.0)
    torque_limit: float = Parameter(
        "N.m",
        "of the wheels, each axis",
        start=5e-3,
        min=1e-9,
        follows="wheels.torque_limit",
    )
    gain_tilt: float = Parameter(
        "A.m2/rad",
        "of the tilt, without a wheel",
        start=25.0,
        min=0.0,
        needs=("b_body", "m_cmd_body"),
    )
    gain_rate: float = Parameter("A.m2.s/rad", "of its rate", start=8e4, min=0.0)
    gain_dump: Vec3 = Parameter(
        "1/(T.s)", "of the wheels' momentum", start=150.0, min=0.0
    )
    h_deadband: float = Parameter(
        "N.m.s", "no dumping by coils up to this |h|", start=5e-3, min=0.0
    )
    deadband: float = Parameter("A.m2", "no dipole up to this |e|", start=0.3, min=0.0)
    gain_lean: float = Parameter("rad/(N.m.s)", "of the lean", start=0.5, min=0.0)
    lean_limit: float = Parameter(
        "rad", "largest lean of each axis", start=4.4e-3, min=0.0, usual=SMALL_ANGLE
    )
    m_limit: float = Parameter(
        "A.m2", "dipole of each coil", start=3.604, min=1e-6, follows="torquers.m_limit"
    )
    duty_max: float = Parameter(
        "1",
        "largest share of the period",
        start=0.8,
        min=0.0,
        max=1.0,
        follows="torquers.duty_max",
    )
    least_pulse: float = Parameter(
        "s", "length of one pulse", start=0.2, min=1e-6, follows="torquers.least_pulse"
    )
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "controlling", "firing"),
    )
    reason: int = Output(
        "1",
        "what is lost at this sample, or short",
        interval=True,
        choices=(
            "nothing",
            "no_field",
            "no_attitude",
            "no_rate",
            "no_momentum",
            "torque_limit",
        ),
    )
    tau_firing_body: Vec3 = Output(
        "N.m",
        "torque of the firing that goes on or was the last, as far as it is known now, body",
        interval=True,
    )
    omega_est_body: Vec3 = Output(
        "rad/s", "the rate that the law takes, body", interval=True
    )

    def start(self) -> None:
        super().start()
        check_inertia(self.inertia)
        self._inverse = inverse_inertia(self.inertia)
        self._moments: Vec3 = (self.inertia[0], self.inertia[4], self.inertia[8])
        roll, pitch = self.wheels == WHEELS_XYZ, self.wheels != WHEELS_Z
        self._has: Vec3 = (1.0 if roll else 0.0, 1.0 if pitch else 0.0, 1.0)
        name = ("z", "y_z", "x_y_z")[self.wheels]
        for axis, has_wheel in ((X_AXIS, roll), (Y_AXIS, pitch), (Z_AXIS, True)):
            if has_wheel:
                self.need_wheel(axis, f"wheels = {name}")
        self._check_schedule()
        self._omega: Vec3 | None = None
        self._q: Vec4 = IDENTITY_Q
        self._variance = self._h_before = self._impulse = ZERO
        self._t_before = 0.0
        self._firing = NONE  # the latest that has begun
        self._found = ZERO  # N m s: its impulse beyond the expected one
        self._learnt = ZERO  # relative to a firing's size
        self._taught = NONE
        self._coil = ZERO
        self.tau_firing_body = self.omega_est_body = ZERO
        self.mode = IDLE

    def _check_schedule(self) -> None:
        """Refuse firings that do not begin at a sample or that overlap."""
        for i in range(ENTRIES):
            start, duration = self.schedule_start[i], self.schedule_duration[i]
            samples = start / self.sample_time
            if duration > 0.0 and abs(samples - round(samples)) > 1e-6:
                self.fail(
                    f"schedule_start[{i + 1}] = {start:g} s: not at a sample, a multiple of "
                    f"sample_time = {self.sample_time:g} s"
                )
            for j in range(i):
                if (
                    firing.overlap(
                        start,
                        duration,
                        self.schedule_start[j],
                        self.schedule_duration[j],
                    )
                    > 0.0
                ):
                    self.fail(
                        f"schedule_start[{i + 1}] = {start:g} s for {duration:g} s overlaps "
                        f"firing {j + 1}, from {self.schedule_start[j]:g} s for "
                        f"{self.schedule_duration[j]:g} s; one at a time"
                    )

    # --- estimation -------------------------------------------------------------------

    def _known(self, i: int) -> Vec3:
        """Return the expected torque (N m, body) of firing i before it begins."""
        x, y, z = self.schedule_tau_body[3 * i : 3 * i + 3]
        return add((x, y, z), scale(norm((x, y, z)), self._learnt))

    def _begin(self, t: float) -> float:
        """Select the firing that is on at t (s).

        Returns for how long (s) of this sample it is.
        """
        for i in range(ENTRIES):
            on = firing.overlap(
                self.schedule_start[i], self.schedule_duration[i], t, self.sample_time
            )
            if on > 0.0:
                if i != self._firing:
                    self._firing, self._found = i, ZERO
                    self.tau_firing_body = self._known(i)
                return on
        return 0.0

    def _learn(self, t: float) -> None:
        """Learn from the last firing for later ones, once its effect is complete."""
        i = self._firing
        if not self.learning or i == NONE or i == self._taught:
            return
        x, y, z = self.schedule_tau_body[3 * i : 3 * i + 3]
        size, duration = norm((x, y, z)), self.schedule_duration[i]
        ended = t >= self.schedule_start[i] + duration + self.learning_time
        if ended and size > 0.0:
            self._learnt = add(
                self._learnt, scale(1.0 / (size * duration), self._found)
            )
            self._taught = i

    def _expected(self, t: float, on: float) -> Vec3:
        """Predict the impulse (N m s) of the firing over this sample.

        The prediction uses the impulse observed so far.
        """
        if on <= 0.0 or not self.feedforward:
            return ZERO
        i = self._firing
        past = t - self.schedule_start[i]
        beyond = scale(1.0 / past, self._found) if past > 0.0 else ZERO
        self.tau_firing_body = add(self._known(i), beyond)
        # this part is expected now, so it counts as found already
        self._found = add(self._found, scale(on, beyond))
        return scale(on, self.tau_firing_body)

    def _estimate(self, t: float) -> Vec3:
        """Estimate the rate (rad/s, body) at this sample; also update `_q`."""
        h = body_momentum(self.axes_wheel, self.h_wheel)
        omega, noise = self._omega, self.gyro_noise
        if omega is None or not self.valid_h:
            estimate, self._q = self.omega_bi_body, self.q_bi
            self._variance = (noise * noise, noise * noise, noise * noise)
        else:
            elapsed = t - self._t_before
            predicted = firing.predicted_rate(
                omega,
                self._h_before,
                h,
                self._impulse,
                self.inertia,
                self._inverse,
                elapsed,
            )
            unknown = 0.0
            if self._firing != NONE:
                i = self._firing
                on = firing.overlap(
                    self.schedule_start[i],
                    self.schedule_duration[i],
                    self._t_before,
                    elapsed,
                )
                unknown = self.firing_uncertainty * on * norm(self.tau_firing_body)
            x, y, z = sub(self.omega_bi_body, predicted)
            a = self._corrected(0, x, unknown, elapsed)
            b = self._corrected(1, y, unknown, elapsed)
            c = self._corrected(2, z, unknown, elapsed)
            self._variance = (a[1], b[1], c[1])
            correction = (a[0], b[0], c[0])
            self._found = add(self._found, mat_vec(self.inertia, correction))
            self._learn(t)
            estimate = add(predicted, correction)
            q = propagated(self._q, scale(0.5, add(omega, predicted)), elapsed)
            error = laws.rotation_vector(product(self.q_bi, inverse(q)))
            self._q = propagated(q, scale(self.attitude_gain, error), 1.0)
        self._omega = self.omega_est_body = estimate
        self._h_before, self._t_before = h, t
        return estimate

    def _corrected(
        self, i: int, innovation: float, unknown: float, elapsed: float
    ) -> tuple[float, float]:
        """Correct axis i: return the change of its rate (rad/s) and its new variance.

        unknown: uncertainty of the firing's impulse (N m s).
        """
        steady, fired = (
            self.torque_noise[i] * elapsed / self._moments[i],
            unknown / self._moments[i],
        )
        variance = self._variance[i] + steady * steady + fired * fired
        gain = firing.kalman_gain(variance, self.gyro_noise)
        return gain * innovation, (1.0 - gain) * variance

    # --- control ----------------------------------------------------------------------

    def act(self, t: float) -> None:
        on = self._begin(t)
        omega = self._estimate(t)
        expected = self._expected(t, on)
        q = product(self._q, inverse(self.q_ref_bi))
        c = matrix(q)
        nadir: Vec3 = (c[2], c[5], c[8])
        turning = sub(omega, rotate(q, self.omega_ref_body))
        h = self.momentum()
        m = self._dipole(nadir, turning, h)
        coil = cross(m, self.b_body)
        gyroscopic = cross(omega, body_momentum(self.axes_wheel, self.h_wheel))
        taken = add(coil, scale(1.0 / self.sample_time, expected))
        if self.valid_h:
            taken = sub(taken, gyroscopic)
        lean = clip(scale(self.gain_lean, h), self.lean_limit)
        theta = sub(
            laws.rotation_vector(q),
            (lean[0] * self._has[0], lean[1] * self._has[1], 0.0),
        )
        self.mode = FIRING if on > 0.0 else CONTROLLING
        self.give(m, self._within(sub(self._pd(theta, turning), taken)))
        gravity = laws.gravity_vector_torque(
            nadir, self.inertia, norm(self.omega_ref_body)
        )
        self._impulse = add(scale(self.sample_time, add(coil, gravity)), expected)

    def hold(self, t: float) -> Vec3:
        self._omega = None
        self._taught = self._firing  # its impulse is not completely observed
        on = self._begin(t)
        expected = self._expected(t, on)
        self.mode = FIRING if on > 0.0 else IDLE
        reason = self.reason
        torque = self._within(
            sub(self._pd(ZERO, self._rate), scale(1.0 / self.sample_time, expected))
        )
        self.reason = reason
        return torque

    def _pd(self, theta: Vec3, rate: Vec3) -> Vec3:
        """Compute -J wn^2 theta - 2 damping wn J rate (N m) about each axis."""
        j, wn, double = self._moments, self.bandwidth, 2.0 * self.damping
        return (
            -j[0] * wn[0] * (wn[0] * theta[0] + double * rate[0]),
            -j[1] * wn[1] * (wn[1] * theta[1] + double * rate[1]),
            -j[2] * wn[2] * (wn[2] * theta[2] + double * rate[2]),
        )

    def _within(self, torque: Vec3) -> Vec3:
        """Limit the torque (N m) about the axes that have a wheel; the others are zero.

        It sets `reason` where the limit is reached.
        """
        has = self._has
        requested = (has[0] * torque[0], has[1] * torque[1], has[2] * torque[2])
        limited = clip(requested, self.torque_limit)
        if limited != requested and self.reason == NOTHING:
            self.reason = TORQUE_LIMIT
        return limited

    def _dipole(self, nadir: Vec3, rate: Vec3, h: Vec3) -> Vec3:
        """Compute the mean dipole (A m2, body) of the coils' pulses over the sample."""
        lean = laws.tilt(nadir)
        has = self._has
        full = norm((has[0] * h[0], has[1] * h[1], has[2] * h[2])) > self.h_deadband
        dump, tilt, damp = (
            self.gain_dump if full else ZERO,
            self.gain_tilt,
            self.gain_rate,
        )
        e = (
            dump[0] * h[0] if has[0] > 0.0 else tilt * lean[0] + damp * rate[0],
            dump[1] * h[1] if has[1] > 0.0 else tilt * lean[1] + damp * rate[1],
            dump[2] * h[2],
        )
        if not self.enable or norm(e) <= self.deadband:
            return ZERO
        m = laws.cross_product(e, self.b_body)
        return (self._pulsed(m[0]), self._pulsed(m[1]), self._pulsed(m[2]))

    def _pulsed(self, m: float) -> float:
        """Compute the mean dipole (A m2) of a pulsed coil for the command m (A m2)."""
        return firing.pulsed(
            m, self.m_limit, self.least_pulse, self.sample_time, self.duty_max
        )
