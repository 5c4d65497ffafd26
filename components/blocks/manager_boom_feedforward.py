from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

from ..bases.boom import NOTHING, X_AXIS, Y_AXIS, Z_AXIS, Boom
from ..bases.earth_field import EarthField
from ..contract.block import SMALL_ANGLE, Mat33, Output, Parameter, Table, Vec3, Vec4
from ..laws import attitude_error, boom_filter, firing, orbit_momentum
from ..laws import gravity_gradient as laws
from ..maths import kalman
from ..maths.attitude import (
    IDENTITY_Q,
    inverse,
    matrix,
    product,
    propagate,
    rotate,
    rotate_back,
)
from ..maths.vector import ZERO, add, clip, cross, mat_vec, norm, scale, sub
from ..physics.gyrostat import check_inertia, inverse_inertia
from ..physics.wheel_array import body_momentum

WHEELS_Z, WHEELS_YZ, WHEELS_XYZ = range(3)
IDLE, CONTROLLING, FIRING = range(3)
SEPARATE_AXES, JOINT = range(2)
NO_MODEL, DIPOLE, IGRF = range(3)
TORQUE_LIMIT, LEAN_LIMIT, CAPACITY = 5, 6, 7
ENTRIES = 8
NONE = -1
TWO_PI = 6.283185307179586
NADIR: Vec3 = (0.0, 0.0, 1.0)  # of a craft that is aligned with the orbit, body


class ManagerBoomFeedforward(Boom, EarthField):
    """One to three wheels keep a boom upright, with feedforward of each firing

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

    **Unknown torque.** With `estimator` = joint one filter of 15 states
    (`components.laws.boom_filter`) also estimates the gyro's bias, a constant torque d
    and the craft's residual dipole m_r from attitude and rate, and the wheels take what
    is known of the torque at once,

        N = -J wn^2 (theta - lean) - 2 damping wn J omega_o + omega x h
            - M x B - F - 3 n^2 u x J u - d - m_r x B.

    The field over an orbit is learnt, which gives the torque t of d and m_r over an orbit
    and the momentum h_eq that the wheels exchange with it periodically
    (`components.laws.orbit_momentum`). Only the excess s = h - h_eq is dumped:

        lean_i = clip(t0_i / K_i + clip(gain_lean s_i, lean_limit), lean_total_limit)
        M_i = -(g_i less +-dump_threshold B_rms) / (|B|^2 dump_time),   g = B x s

    in place of eq. 16 for axes that have wheels. Until the filter has run for
    `settling_time`, h_eq and t0 count as zero and no momentum is dumped by coils. A filter
    that is lost starts anew (`filter_restarts`): its innovation is beyond six standard
    deviations five samples in a row, or its covariance is not that of anything.
    `attitude_gain`, `h_deadband` and `gain_dump` of axes with wheels have no effect then.

    **A second reference.** A constant attitude error acts like a constant torque. With
    `field_model` the direction of the measured field against that of a model of the
    Earth's field shows the error, and the magnetometer's bias
    (`components.laws.attitude_error`); both are taken away. A model that does not fit the
    field teaches next to nothing. Where the error is known so, the lean is zero within
    `upright_time` of a known firing, since the error that the firing causes would add to it.

    Without a valid field, attitude or rate (see `reason`) the coils are off; the wheels
    hold the rate and still absorb the firing. Without a valid h nothing is dumped and
    the filter is not updated. `reason` is torque_limit where a wheel's torque would
    have to exceed torque_limit; with the joint estimator also capacity where h_eq,
    `dump_threshold` and the largest firing to come exceed `h_limit`, and lean_limit where
    |t0_i| / K_i has exceeded `lean_total_limit` for an orbit, so that gravity cannot hold
    the craft and coils must.

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
    estimator: int = Parameter(
        "1",
        "how the state is estimated: each axis by itself, or jointly with unknown torque",
        choices=("separate_axes", "joint"),
        start="separate_axes",
        needs=("b_body", "q_ref_bi", "omega_ref_body"),
    )
    attitude_noise: float = Parameter(
        "rad",
        "deviation of the measured attitude, each axis; joint estimator",
        start=0.0017453292519943296,
        min=1e-9,
        max=0.5,
        follows="determination.noise",
    )
    bias_spread: float = Parameter(
        "rad/s",
        "deviation of the gyro's bias at the start, each axis; joint estimator",
        start=2e-4,
        min=0.0,
        max=0.1,
    )
    bias_walk: float = Parameter(
        "rad/s",
        "random walk of the gyro's bias: deviation of its change in 1 s, each axis",
        start=1e-9,
        min=0.0,
        max=1e-3,
    )
    disturbance_spread: float = Parameter(
        "N.m",
        "deviation of the constant torque at the start, each axis; joint estimator",
        start=1e-5,
        min=0.0,
        max=1.0,
    )
    disturbance_walk: float = Parameter(
        "N.m",
        "random walk of the constant torque: deviation of its change in 1 s, each axis",
        start=2e-10,
        min=0.0,
        max=1e-3,
    )
    dipole_spread: float = Parameter(
        "A.m2",
        "deviation of the residual dipole at the start, each axis; joint estimator",
        start=1.0,
        min=0.0,
        max=1e3,
    )
    dipole_walk: float = Parameter(
        "A.m2",
        "random walk of the residual dipole: deviation of its change in 1 s, each axis",
        start=1e-5,
        min=0.0,
        max=1.0,
    )
    field_memory: float = Parameter(
        "s",
        "time constant with which the field of an orbit is forgotten; joint estimator",
        start=9000.0,
        min=1.0,
        max=1e7,
    )
    settling_time: float = Parameter(
        "s",
        "time from the filter's start until its torque decides what is dumped",
        start=3000.0,
        min=0.0,
        max=1e7,
    )
    lean_total_limit: float = Parameter(
        "rad",
        "largest lean of each axis with that against the mean torque; joint estimator",
        start=5.4e-3,
        min=0.0,
        max=0.5,
        usual=SMALL_ANGLE,
    )
    h_limit: float = Parameter(
        "N.m.s",
        "momentum capacity of a wheel, joint estimator; 0: not known",
        min=0.0,
        follows="wheels.inertia_wheel * wheels.speed_limit",
    )
    upright_time: float = Parameter(
        "s",
        "how long before and after a known firing the craft does not lean; with a field model",
        start=250.0,
        min=0.0,
        max=1e5,
    )
    dump_threshold: float = Parameter(
        "N.m.s",
        "excess momentum across the field up to which no coil runs; joint estimator",
        start=0.025,
        min=0.0,
        max=1e3,
    )
    dump_time: float = Parameter(
        "s",
        "time constant of the dumping beyond it; joint estimator",
        start=300.0,
        min=1.0,
        max=1e6,
    )
    field_model: int = Parameter(
        "1",
        "model of the field that finds a constant attitude error; joint estimator",
        choices=("none", "dipole", "igrf"),
        start="none",
        needs=("b_body", "r_eci"),
    )
    field_noise: float = Parameter(
        "T",
        "deviation of a measured field from that of a model that fits, each axis",
        start=1e-6,
        min=1e-12,
        max=1e-3,
    )
    field_bias_spread: float = Parameter(
        "T",
        "deviation of the magnetometer's bias, each axis; with a field model",
        start=1e-6,
        min=0.0,
        max=1e-3,
    )
    offset_spread: float = Parameter(
        "rad",
        "deviation of the constant attitude error, each axis; with a field model",
        start=8.726646259971648e-3,
        min=0.0,
        max=0.5,
        usual=SMALL_ANGLE,
    )
    offset_walk: float = Parameter(
        "rad",
        "random walk of the attitude error: deviation of its change in 1 s, each axis",
        start=1e-6,
        min=0.0,
        max=1e-2,
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
            "lean_limit",
            "capacity",
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
    bias_est_body: Vec3 = Output(
        "rad/s", "estimated bias of the gyro, body; joint estimator", interval=True
    )
    tau_est_body: Vec3 = Output(
        "N.m", "estimated constant torque, body; joint estimator", interval=True
    )
    dipole_est_body: Vec3 = Output(
        "A.m2", "estimated residual dipole, body; joint estimator", interval=True
    )
    offset_est_body: Vec3 = Output(
        "rad",
        "estimated constant error of the measured attitude, body; with a field model",
        interval=True,
    )
    h_excess_body: Vec3 = Output(
        "N.m.s",
        "wheels' momentum that does not return to zero by itself, body; joint estimator",
        interval=True,
    )
    filter_restarts: int = Output(
        "1", "how often the joint filter was lost and started anew", interval=True
    )

    def start(self) -> None:
        """Check wheels, schedule and inertia; set the estimates to start values."""
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
        self._extra_impulse = ZERO  # N m s: its impulse beyond the expected one
        self._learnt = ZERO  # relative to a firing's size
        self._taught = NONE
        self._coil = ZERO
        self.tau_firing_body = self.omega_est_body = ZERO
        self.mode = IDLE
        self._start_joint()

    def _start_joint(self) -> None:
        """Set the joint estimator to its start, and check its parameters."""
        self._setting = boom_filter.Setting(
            self.attitude_noise,
            self.gyro_noise,
            boom_filter.Deviations(
                self.bias_spread, self.disturbance_spread, self.dipole_spread
            ),
            boom_filter.Deviations(
                self.bias_walk, self.disturbance_walk, self.dipole_walk
            ),
            self.inertia,
            self._inverse,
        )
        if self.estimator == JOINT:
            self._check_joint()
        self._state, self._covariance = boom_filter.begin(ZERO, self._setting)
        self._error: Table = (0.0,) * attitude_error.STATES
        self._error_covariance = attitude_error.first_covariance(
            self.offset_spread, self.field_bias_spread
        )
        self._field_remainder: Table = (0.0, 0.0)
        self.start_field(igrf=self.field_model == IGRF)
        self._field, self._field_variance = orbit_momentum.first_field()
        self._is_filtering = False  # whether the filter has had a measurement
        self._filter_time = 0.0  # s: how long it has run
        self._phase = 0.0  # rad: place in the orbit, from the first sample
        self._field_before = self._dipole_before = self._firing_before = ZERO
        self._nadir_before = NADIR
        self._surprises = self.filter_restarts = 0
        self._unbalanced_time = 0.0  # s: how long gravity has not taken the mean torque
        self.bias_est_body = self.tau_est_body = self.dipole_est_body = ZERO
        self.h_excess_body = self.offset_est_body = ZERO

    def _check_joint(self) -> None:
        """Refuse parameters of the joint estimator that make no sense together."""
        if self.lean_total_limit < self.lean_limit:
            self.fail(
                f"lean_total_limit = {self.lean_total_limit:g} rad is below lean_limit = "
                f"{self.lean_limit:g} rad, which is a part of it"
            )
        least = min(self.torque_noise[0], self.torque_noise[1], self.torque_noise[2])
        if least <= 0.0:
            self.fail(
                "estimator = joint: torque_noise must be above 0 about each axis, else "
                "the filter no longer follows the rate"
            )
        for spread, walk, name in (
            (self.bias_spread, self.bias_walk, "bias"),
            (self.disturbance_spread, self.disturbance_walk, "disturbance"),
            (self.dipole_spread, self.dipole_walk, "dipole"),
        ):
            if spread <= 0.0:
                self.fail(f"estimator = joint: {name}_spread = 0: it must be above 0")
            if walk > spread:
                self.fail(
                    f"{name}_walk = {walk:g} is above {name}_spread = {spread:g}: it "
                    "would be forgotten within a second"
                )
        if self.field_model != NO_MODEL and self.offset_spread <= 0.0:
            self.fail(
                "field_model is given and offset_spread = 0: it must be above 0, else no "
                "attitude error is looked for"
            )
        if self.field_memory < 10.0 * self.sample_time:
            self.fail(
                f"field_memory = {self.field_memory:g} s is below ten samples of "
                f"{self.sample_time:g} s, from which no orbit is learnt"
            )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: also a wheel that is too small."""
        if self.estimator == JOINT:
            self.check_igrf_years(begin, end, self.field_model == IGRF)
            capacity = self._required_capacity(begin, ZERO)
            if 0.0 < self.h_limit < capacity:
                yield (
                    f"h_limit = {self.h_limit:g} N m s: the largest firing, the bias and "
                    f"dump_threshold need {capacity:.2g} N m s, without what an orbit gives "
                    "and takes back"
                )
        elif self.field_model != NO_MODEL:
            yield "field_model has no effect: estimator = separate_axes takes none"
        yield from super().foresee(begin, end, wired_names)

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

    def _expected_torque(self, i: int) -> Vec3:
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
                    self._firing, self._extra_impulse = i, ZERO
                    self.tau_firing_body = self._expected_torque(i)
                return on
        return 0.0

    def _learn(self, t: float) -> None:
        """Learn from the last firing for later ones, once its effect is complete."""
        i = self._firing
        if not self.learning or i == NONE or i == self._taught:
            return
        x, y, z = self.schedule_tau_body[3 * i : 3 * i + 3]
        size, duration = norm((x, y, z)), self.schedule_duration[i]
        is_complete = t >= self.schedule_start[i] + duration + self.learning_time
        if is_complete and size > 0.0:
            self._learnt = add(
                self._learnt, scale(1.0 / (size * duration), self._extra_impulse)
            )
            self._taught = i

    def _expected_impulse(self, t: float, on: float) -> Vec3:
        """Predict the impulse (N m s) of the firing over this sample.

        The prediction uses the impulse observed so far.
        """
        if on <= 0.0 or not self.feedforward:
            return ZERO
        i = self._firing
        past = t - self.schedule_start[i]
        beyond = scale(1.0 / past, self._extra_impulse) if past > 0.0 else ZERO
        self.tau_firing_body = add(self._expected_torque(i), beyond)
        # this part is expected now, so it counts as found already
        self._extra_impulse = add(self._extra_impulse, scale(on, beyond))
        return scale(on, self.tau_firing_body)

    def _estimate(self, t: float) -> Vec3:
        """Estimate the rate (rad/s, body) at this sample; also update `_q`."""
        h = body_momentum(self.axes_wheel, self.h_wheel)
        omega, noise = self._omega, self.gyro_noise
        if omega is None or not self.valid_h:
            estimate, self._q = self.omega_bi_body, self.q_bi
            self._variance = (noise * noise, noise * noise, noise * noise)
        else:
            elapsed_time = t - self._t_before
            predicted_omega = firing.predicted_rate(
                omega,
                self._h_before,
                h,
                self._impulse,
                self.inertia,
                self._inverse,
                elapsed_time,
            )
            unknown = self._unknown_impulse(elapsed_time)
            x, y, z = sub(self.omega_bi_body, predicted_omega)
            a = self._correct_axis(0, x, unknown, elapsed_time)
            b = self._correct_axis(1, y, unknown, elapsed_time)
            c = self._correct_axis(2, z, unknown, elapsed_time)
            self._variance = (a[1], b[1], c[1])
            correction = (a[0], b[0], c[0])
            self._extra_impulse = add(
                self._extra_impulse, mat_vec(self.inertia, correction)
            )
            self._learn(t)
            estimate = add(predicted_omega, correction)
            q = propagate(
                self._q, scale(0.5, add(omega, predicted_omega)), elapsed_time
            )
            error = laws.rotation_vector(product(self.q_bi, inverse(q)))
            self._q = propagate(q, scale(self.attitude_gain, error), 1.0)
        self._omega = self.omega_est_body = estimate
        self._h_before, self._t_before = h, t
        return estimate

    def _correct_axis(
        self, i: int, innovation: float, unknown: float, elapsed_time: float
    ) -> tuple[float, float]:
        """Correct axis i: return the change of its rate (rad/s) and its new variance.

        unknown: uncertainty of the firing's impulse (N m s).
        """
        steady_rate, firing_rate = (
            self.torque_noise[i] * elapsed_time / self._moments[i],
            unknown / self._moments[i],
        )
        variance = (
            self._variance[i] + steady_rate * steady_rate + firing_rate * firing_rate
        )
        gain = firing.kalman_gain(variance, self.gyro_noise)
        return gain * innovation, (1.0 - gain) * variance

    def _estimate_jointly(self, t: float) -> Vec3:
        """Estimate the rate (rad/s, body) by the joint filter; also update `_q`."""
        h = body_momentum(self.axes_wheel, self.h_wheel)
        if self._omega is None or not self.valid_h:
            self._resume()
        else:
            elapsed_time = t - self._t_before
            self._q, self._state, self._covariance, correction, surprise = (
                boom_filter.update(
                    self._q,
                    self._state,
                    self._covariance,
                    self._interval(h, elapsed_time),
                    self._q_measured(),
                    self.omega_bi_body,
                    self._setting,
                )
            )
            self._extra_impulse = add(
                self._extra_impulse, mat_vec(self.inertia, correction)
            )
            self._learn(t)
            self._filter_time += elapsed_time
            self._surprises = kalman.count_surprises(self._surprises, surprise)
            if self._surprises >= kalman.SURPRISES:
                self.filter_restarts += 1
                self._is_filtering = False
                self._resume()
            if self.field_model != NO_MODEL:
                self._find_offset(t, elapsed_time)
        x = self._state
        self.bias_est_body = boom_filter.bias_of(x)
        self.tau_est_body = boom_filter.torque_of(x)
        self.dipole_est_body = boom_filter.dipole_of(x)
        self._omega = self.omega_est_body = boom_filter.rate_of(x)
        self._h_before, self._t_before = h, t
        return self.omega_est_body

    def _resume(self) -> None:
        """Begin at this sample's attitude and rate; what is constant is known on."""
        if not self._is_filtering:
            self._state, self._covariance = boom_filter.begin(
                self.omega_bi_body, self._setting
            )
            self._is_filtering, self._filter_time, self._surprises = True, 0.0, 0
        else:
            self._state, self._covariance = boom_filter.resume(
                self._state, self._covariance, self.omega_bi_body, self._setting
            )
        self._q = self._q_measured()

    def _q_measured(self) -> Vec4:
        """Return the measured attitude less its estimated error."""
        if self.field_model == NO_MODEL:
            return self.q_bi
        return propagate(self.q_bi, scale(-1.0, self.offset_est_body), 1.0)

    def _b_measured(self) -> Vec3:
        """Return the measured field (T, body) less the magnetometer's estimated bias."""
        return sub(self.b_body, attitude_error.field_error_of(self._error))

    def _find_offset(self, t: float, elapsed_time: float) -> None:
        """Find the attitude's constant error at t (s) by the field, and take it away.

        elapsed_time: time (s) since the last sample.
        """
        model_field = rotate(
            self._q, self.field_eci(self.r_eci, t, igrf=self.field_model == IGRF)
        )
        variance, self._field_remainder = attitude_error.variance_of(
            self._error,
            self._field_remainder,
            self.b_body,
            model_field,
            self.field_noise,
            elapsed_time,
            self.field_memory,
        )
        self._error, self._error_covariance, _ = attitude_error.update(
            self._error,
            attitude_error.add_walk(
                self._error_covariance, self.offset_walk, elapsed_time
            ),
            self.b_body,
            model_field,
            variance,
            attitude_error.STATES,
        )
        offset = scale(-1.0, attitude_error.angles_of(self._error))
        c = matrix(product(self._q, inverse(self.q_ref_bi)))
        self._q, self._state = boom_filter.turn(
            self._q,
            self._state,
            sub(offset, self.offset_est_body),
            (c[2], c[5], c[8]),
            norm(self.omega_ref_body),
            self.inertia,
        )
        self.offset_est_body = offset

    def _interval(self, h: Vec3, elapsed_time: float) -> boom_filter.Interval:
        """Return the conditions since the last sample, elapsed_time (s) ago.

        h: the wheels' momentum (N m s, body).
        """
        unknown = self._unknown_impulse(elapsed_time)
        x, y, z = scale(elapsed_time, self.torque_noise)
        return boom_filter.Interval(
            elapsed_time,
            self._dipole_before,
            scale(0.5, add(self._field_before, self._b_measured())),
            self._nadir_before,
            norm(self.omega_ref_body),
            self._h_before,
            h,
            self._firing_before,
            (
                sqrt(x * x + unknown * unknown),
                sqrt(y * y + unknown * unknown),
                sqrt(z * z + unknown * unknown),
            ),
        )

    def _unknown_impulse(self, elapsed_time: float) -> float:
        """Return the deviation of a firing's impulse (N m s) since the last sample."""
        if self._firing == NONE:
            return 0.0
        i = self._firing
        on = firing.overlap(
            self.schedule_start[i],
            self.schedule_duration[i],
            self._t_before,
            elapsed_time,
        )
        return self.firing_uncertainty * on * norm(self.tau_firing_body)

    # --- what the orbit gives back ----------------------------------------------------

    def _follow_orbit(self, q: Vec4, elapsed_time: float) -> None:
        """Learn the field of the orbit; q: attitude relative to it; elapsed_time in s."""
        self._phase += norm(self.omega_ref_body) * elapsed_time
        retention = orbit_momentum.retention_of(elapsed_time, self.field_memory)
        self._field, self._field_variance = orbit_momentum.learn_field(
            self._field,
            self._field_variance,
            rotate_back(q, self._b_measured()),
            self._phase,
            retention,
        )

    def _must_be_upright(self, t: float) -> bool:
        """Return whether the lean is to be zero at t (s): a known firing is near.

        Without a field model the lean may be what corrects the attitude's error.
        """
        if not self.feedforward or self.field_model == NO_MODEL:
            return False
        for i in range(ENTRIES):
            start, duration = self.schedule_start[i], self.schedule_duration[i]
            begin, end = start - self.upright_time, start + duration + self.upright_time
            if duration > 0.0 and begin <= t < end:
                return True
        return False

    def _orbit_torque(self, n: float) -> orbit_momentum.OrbitTorque:
        """Return the torque that is known over an orbit; n: its rate (rad/s)."""
        aligned_rate: Vec3 = (0.0, -n, 0.0)
        aligned_torque = sub(
            laws.gravity_vector_torque(NADIR, self.inertia, n),
            cross(aligned_rate, mat_vec(self.inertia, aligned_rate)),
        )
        return orbit_momentum.torque_over_orbit(
            self._field,
            add(self.tau_est_body, aligned_torque),
            self.dipole_est_body,
        )

    def _check_balance(
        self,
        t: float,
        is_lean_limited: bool,
        torque: orbit_momentum.OrbitTorque,
        n: float,
    ) -> None:
        """Set `reason` where leans or wheels do not suffice for what is known at t (s).

        is_lean_limited: whether the lean is; torque: over an orbit, less what a lean takes of it;
        n: rate of the orbit (rad/s).
        """
        self._unbalanced_time = (
            self._unbalanced_time + self.sample_time if is_lean_limited else 0.0
        )
        if self.reason != NOTHING:
            return
        periodic = orbit_momentum.periodic_size(torque, n, self._has[0] > 0.0)
        if 0.0 < self.h_limit < self._required_capacity(t, periodic):
            self.reason = CAPACITY
        elif self._unbalanced_time * n > TWO_PI:
            self.reason = LEAN_LIMIT

    def _required_capacity(self, t: float, periodic: Vec3) -> float:
        """Return the momentum (N m s) that a wheel must be able to hold from t (s) on.

        It has what the coils leave, the bias, the periodic momentum (N m s, body) and the
        largest firing to come.
        """
        x, y, z = ZERO
        for i in range(ENTRIES):
            duration = self.schedule_duration[i]
            if self.schedule_start[i] + duration > t:
                a, b, c = self.schedule_tau_body[3 * i : 3 * i + 3]
                x, y, z = (
                    max(x, abs(a) * duration),
                    max(y, abs(b) * duration),
                    max(z, abs(c) * duration),
                )
        largest = 1.0 + self.firing_uncertainty
        has, bias, threshold = self._has, self.h_target_body, self.dump_threshold
        x = has[0] * (largest * x + periodic[0] + abs(bias[0]) + threshold)
        y = has[1] * (largest * y + periodic[1] + abs(bias[1]) + threshold)
        z = has[2] * (largest * z + periodic[2] + abs(bias[2]) + threshold)
        capacity = 0.0
        for i in range(4):
            p, q, r = self._to_wheels[3 * i : 3 * i + 3]
            capacity = max(capacity, abs(p) * x + abs(q) * y + abs(r) * z)
        return capacity

    def _lean_and_excess(self, t: float, h: Vec3) -> Vec3:
        """Return the lean (rad) of each axis at t (s); also set `h_excess_body`.

        h: the wheels' momentum less its target (N m s, body).
        """
        n, has = norm(self.omega_ref_body), self._has
        equilibrium = ZERO
        periodic = ZERO
        if self._filter_time >= self.settling_time and n > 0.0:
            torque = self._orbit_torque(n)
            k = orbit_momentum.stiffness(self.inertia, n)
            mean = torque.mean
            equilibrium = (
                has[0] * mean[0] / k[0] if k[0] > 0.0 else 0.0,
                has[1] * mean[1] / k[1] if k[1] > 0.0 else 0.0,
                0.0,
            )
            mean_lean = clip(equilibrium, self.lean_total_limit)
            remaining = orbit_momentum.OrbitTorque(
                orbit_momentum.compute_net_torque(mean, k, mean_lean),
                torque.cosine,
                torque.sine,
            )
            periodic = orbit_momentum.periodic_momentum(
                remaining, self._phase, n, has[0] > 0.0
            )
            self._check_balance(t, mean_lean != equilibrium, remaining, n)
        x, y, z = sub(h, periodic) if self.valid_h else ZERO
        self.h_excess_body = (has[0] * x, has[1] * y, has[2] * z)
        if self._must_be_upright(t):
            return ZERO
        x, y, _ = clip(scale(self.gain_lean, self.h_excess_body), self.lean_limit)
        return clip(
            (equilibrium[0] + x, equilibrium[1] + y, 0.0), self.lean_total_limit
        )

    def _economical_dipole(self) -> Vec3:
        """Compute the dipole (A m2, body) that dumps the excess where it pays."""
        if self._filter_time < self.settling_time or not self.enable:
            return ZERO
        return orbit_momentum.dump_dipole(
            self.h_excess_body,
            self._b_measured(),
            self.dump_threshold,
            orbit_momentum.field_size(self._field),
            self.dump_time,
        )

    # --- control ----------------------------------------------------------------------

    def act(self, t: float) -> None:
        """Command wheels by the PD law less known torques, and coils by eq. 16.

        The known torques (N m, body) are those of coils and firing, less omega x h
        where h is valid; gravity enters the rate's estimate alone.
        """
        if self.estimator == JOINT:
            self._act_jointly(t)
            return
        on = self._begin(t)
        omega = self._estimate(t)
        firing_impulse = self._expected_impulse(t, on)
        q = product(self._q, inverse(self.q_ref_bi))
        c = matrix(q)
        nadir: Vec3 = (c[2], c[5], c[8])
        turning = sub(omega, rotate(q, self.omega_ref_body))
        h = self.momentum()
        m = self._dipole(nadir, turning, h)
        coil = cross(m, self.b_body)
        gyroscopic = cross(omega, body_momentum(self.axes_wheel, self.h_wheel))
        compensation = add(coil, scale(1.0 / self.sample_time, firing_impulse))
        if self.valid_h:
            compensation = sub(compensation, gyroscopic)
        lean = clip(scale(self.gain_lean, h), self.lean_limit)
        theta = sub(
            laws.rotation_vector(q),
            (lean[0] * self._has[0], lean[1] * self._has[1], 0.0),
        )
        self.mode = FIRING if on > 0.0 else CONTROLLING
        self.give(m, self._within(sub(self._pd(theta, turning), compensation)))
        gravity = laws.gravity_vector_torque(
            nadir, self.inertia, norm(self.omega_ref_body)
        )
        self._impulse = add(scale(self.sample_time, add(coil, gravity)), firing_impulse)

    def _act_jointly(self, t: float) -> None:
        """Command wheels and coils with what the joint filter knows."""
        on = self._begin(t)
        elapsed_time = t - self._t_before
        omega = self._estimate_jointly(t)
        firing_impulse = self._expected_impulse(t, on)
        q = product(self._q, inverse(self.q_ref_bi))
        c = matrix(q)
        nadir: Vec3 = (c[2], c[5], c[8])
        turning = sub(omega, rotate(q, self.omega_ref_body))
        self._follow_orbit(q, elapsed_time)
        lean = self._lean_and_excess(t, self.momentum())
        x, y, z = add(self._dipole(nadir, turning, ZERO), self._economical_dipole())
        m: Vec3 = (self._pulse_dipole(x), self._pulse_dipole(y), self._pulse_dipole(z))
        magnetic = cross(add(m, self.dipole_est_body), self._b_measured())
        gravity = laws.gravity_vector_torque(
            nadir, self.inertia, norm(self.omega_ref_body)
        )
        compensation = add(add(magnetic, gravity), self.tau_est_body)
        compensation = add(compensation, scale(1.0 / self.sample_time, firing_impulse))
        if self.valid_h:
            h = body_momentum(self.axes_wheel, self.h_wheel)
            compensation = sub(compensation, cross(omega, h))
        theta = sub(laws.rotation_vector(q), lean)
        self.mode = FIRING if on > 0.0 else CONTROLLING
        self.give(m, self._within(sub(self._pd(theta, turning), compensation)))
        self._field_before, self._dipole_before = self._b_measured(), m
        self._nadir_before, self._firing_before = nadir, firing_impulse

    def hold(self, t: float) -> Vec3:
        """Return the torque (N m, body) that brakes the rate without an attitude.

        The expected impulse of a firing is still taken.
        """
        self._omega = None
        self._taught = self._firing  # its impulse is not completely observed
        on = self._begin(t)
        firing_impulse = self._expected_impulse(t, on)
        self.mode = FIRING if on > 0.0 else IDLE
        reason = self.reason
        rate = sub(self._rate, self.bias_est_body)
        feedback = sub(self._pd(ZERO, rate), self.tau_est_body)
        torque = self._within(
            sub(feedback, scale(1.0 / self.sample_time, firing_impulse))
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
        demand = (has[0] * torque[0], has[1] * torque[1], has[2] * torque[2])
        wheel_torque = clip(demand, self.torque_limit)
        if wheel_torque != demand and self.reason == NOTHING:
            self.reason = TORQUE_LIMIT
        return wheel_torque

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
        return (
            self._pulse_dipole(m[0]),
            self._pulse_dipole(m[1]),
            self._pulse_dipole(m[2]),
        )

    def _pulse_dipole(self, m: float) -> float:
        """Compute the mean dipole (A m2) of a pulsed coil for the command m (A m2)."""
        return firing.pulse_dipole(
            m, self.m_limit, self.least_pulse, self.sample_time, self.duty_max
        )
