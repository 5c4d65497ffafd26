from __future__ import annotations

from collections.abc import Iterator

from ..contract.block import SPIN, Mat33, Output, Parameter, PerWheel, Vec3
from ..contract.roles import Manager, WheelInertias
from ..laws import craft_filter, rollout
from ..laws.acquisition import all_coils, within
from ..maths import kalman
from ..maths.vector import ZERO, clip, dot, inverse, mat_vec, sub
from ..physics.gyrostat import carrier_inertia, check_inertia, inverse_inertia
from ..physics.wheel_array import body_momentum

IDLE, BRAKING, PLANNED, DETUMBLED = range(4)
GYRO, FILTER = range(2)
# rad/s, of each axis: standard deviation with which the filter begins
UNKNOWN_RATE = 0.2
MOST_STEPS = 4000  # maximum number of steps in a simulation of the model
FRICTION_TIME = 5.0  # s over which a wheel's friction is averaged
# Consecutive samples at which a wheel does not follow, after which it is taken for
# dead.
MISSES = 5
# rad/s, of each axis: standard deviation from which on inertia, coils and coupling are
# estimated, and dipoles are commanded where the coupling is doubted
FAMILIAR_RATE = 0.02


def count_misses(before: int, torque: float, actual_torque: float, limit: float) -> int:
    """Count consecutive samples at which a wheel gave less than a fifth of a torque.

    Only a torque (N m) of more than 0.3 of the limit counts; smaller ones are no
    evidence.
    """
    if abs(torque) <= 0.3 * limit or limit == 0.0:
        return before
    return before + 1 if actual_torque * torque < 0.2 * torque * torque else 0


class ManagerDetumblingRollout(Manager, WheelInertias):
    """Detumbling with wheel torques that are chosen by simulating them in a model

    Every coil within its limit, and every wheel within its limit and outside of a
    sequence, follows

        M = gain omega x B,       u_i = gain_wheel g_i . omega

    with g_i the wheels' axes and u_i the torque to the rotor. Each `plan_time` the
    craft is simulated in a model, by Euler's equations with the field fixed in space.
    It flies `rounds` times `candidates` sequences of four torques of `segment` each,
    after which the law above continues (`components.laws.rollout`). The block follows
    the sequence after which every rate is soonest below `rate_limit`. The law alone is
    always among the candidates.

    It knows the craft's `inertia`, which may differ from the real one, but neither
    attitude nor orbit. Once every rate is below `rate_limit` only the law above acts,
    until a rate is above `rate_again`. After `hold_time` below the limit the craft is
    detumbled (`mode`).

    **Rate.** `gyro`, or `filter`: an extended Kalman filter of magnetometer and
    tachometers (`components.laws.craft_filter`), with which the craft counts as slow
    only where the covariance is small enough. Without a valid rate nothing is
    commanded. Without a valid field there is no dipole and no search, and the filter
    restarts. Without a valid h_wheel there is no search.

    **Doubt.** Where `inertia_spread`, `coil_spread` or `coupling_spread` is above 0, the
    filter also estimates the inertia, what each coil gives and the coils' field at the
    magnetometer, once every rate is known to 0.02 rad/s. With a gyro it uses its rate,
    too, with the deviation `gyro_noise`; the law still takes the measured rate. The model
    flies the inertia estimated, and a coil that turns out to be turned is commanded the
    other way. Where the coupling is doubted there is no dipole before.

    A filter that is lost starts anew (`filter_restarts`): its innovation is beyond six
    standard deviations five samples in a row, its covariance has a negative variance, or
    its inertia is not positive definite.

    **Wheels.** The difference between a wheel's command and the change of its momentum
    is taken for friction and added to the command. A wheel that gives less than a fifth
    of a torque above 0.3 of its limit, five samples in a row, is taken for dead
    (`wheels_dead`) until `enable` has been false. Without any wheel the coils use
    gain_alone / |B|^2 instead of `gain`. The wheels take up momentum, up to `h_limit`,
    and keep it.

    **Field.** `coil_coupling` times the last commanded dipole is subtracted from the
    measured field.

    One plan takes at most rounds candidates horizon / model_step steps of the model.
    Most plans take far fewer, as a sequence is dropped once it takes longer than the
    best.

    Source: ours; rollout: Bertsekas, Dynamic Programming and Optimal Control, vol. 1,
    sec. 2.4.
    """

    no_law = "it brakes a tumbling craft: no law for wheels that hold an attitude"
    brakes = True

    inertia: Mat33 = Parameter(
        "kg.m2",
        "inertia of the whole craft, wheels locked, body",
        start=(0.3078, 0.0, 0.0, 0.0, 0.2865, 0.0, 0.0, 0.0, 0.2747),
        shared=True,
    )
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each axis",
        start=2.0,
        min=0.0,
        follows="torquers.m_limit",
    )
    torque_limit: float = Parameter(
        "N.m",
        "largest torque command to a wheel",
        start=1e-3,
        min=0.0,
        follows="wheels.torque_limit",
    )
    h_limit: float = Parameter(
        "N.m.s",
        "momentum beyond which a wheel is not driven",
        start=0.18,
        min=1e-9,
        follows="wheels.inertia_wheel * wheels.speed_limit",
    )
    rate_from: int = Parameter(
        "1", "where the rate is from", choices=("gyro", "filter")
    )
    gyro_noise: float = Parameter(
        "rad/s",
        "deviation of a measured rate, each axis, with its bias; for what is doubted",
        start=1e-4,
        min=1e-9,
    )
    field_noise: float = Parameter(
        "T", "filter: of the magnetometer, each axis", start=3e-7, min=1e-12
    )
    rate_noise: float = Parameter(
        "rad/s",
        "filter: random walk of the rate over a root second",
        start=3e-5,
        min=0.0,
    )
    field_turn: float = Parameter(
        "T", "filter: random walk of the field over a root second", start=3e-7, min=0.0
    )
    inertia_spread: float = Parameter(
        "1",
        "standard deviation of a moment of inertia over their mean; a product's is "
        "a fifth of it; 0: certain",
        min=0.0,
        max=1.0,
    )
    coil_spread: float = Parameter(
        "1",
        "standard deviation of what a coil gives of its command; 0: certain",
        min=0.0,
        max=1.0,
    )
    coupling_spread: float = Parameter(
        "T/(A.m2)",
        "standard deviation of an element of coil_coupling; 0: certain",
        min=0.0,
        max=1e-3,
    )
    gain: float = Parameter(
        "A.m2.s/T", "of the coils", start=3e7, min=0.0, needs=("b_body", "m_cmd_body")
    )
    gain_wheel: float = Parameter("N.m.s", "of the wheels", start=1e-2, min=0.0)
    gain_alone: float = Parameter(
        "N.m.s",
        "of the coils on |B|^2, once no wheel follows: 2 n (1 + sin xi) J_min",
        start=1.2e-3,
        min=0.0,
    )
    coil_coupling: Mat33 = Parameter(
        "T/(A.m2)",
        "field that a commanded dipole leaves at the magnetometer's sample, taken off",
        start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    )
    rate_limit: float = Parameter(
        "rad/s", "detumbled: every rate below", start=3e-3, min=1e-9, usual=SPIN
    )
    margin: float = Parameter(
        "1",
        "of rate_limit, at which a flight of the model ends",
        start=0.9,
        min=1e-3,
        max=1.0,
    )
    hold_time: float = Parameter(
        "s", "so long, before it is detumbled", start=60.0, min=0.0
    )
    rate_again: float = Parameter(
        "rad/s", "detumbled no more: a rate above", start=6e-3, min=1e-9, usual=SPIN
    )
    plan_time: float = Parameter("s", "time between searches", start=10.0, min=0.0)
    segment: float = Parameter(
        "s", "each torque of a sequence is held", start=20.0, min=1e-3
    )
    horizon: float = Parameter(
        "s", "a flight of the model ends at the latest", start=900.0, min=1e-3
    )
    model_step: float = Parameter(
        "s", "of the model; at rates of 0.1 rad/s 2 s is too long", start=1.0, min=1e-3
    )
    rounds: int = Parameter(
        "1", "of a search, each closer about its best", start=4, min=0, max=16
    )
    candidates: int = Parameter("1", "sequences in a round", start=64, min=1, max=256)
    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "braking", "planned", "detumbled"),
    )
    coil_saturated: bool = Output(
        "1", "true: a dipole command is at its limit", interval=True
    )
    omega_est_body: Vec3 = Output(
        "rad/s", "the rate that the law takes, body", interval=True
    )
    wheels_dead: int = Output("1", "how many wheels are taken for dead", interval=True)
    time_left: float = Output(
        "s", "until detumbled, as the last search has it", interval=True
    )

    filter_restarts: int = Output(
        "1", "how often the filter was lost and started anew", interval=True
    )

    def start(self) -> None:
        """Check the parameters and set model, filter and plan to start values."""
        super().start()
        check_inertia(self.inertia)
        carrier = carrier_inertia(self.inertia, self.axes_wheel, self.inertia_wheel)
        self._carrier, self._inverse = carrier, inverse_inertia(carrier)
        if self.rate_again <= self.rate_limit:
            self.fail(
                f"rate_again = {self.rate_again} rad/s is not above rate_limit = "
                f"{self.rate_limit}: it would never be detumbled"
            )
        a = self.inertia
        doubts = craft_filter.Doubts(
            UNKNOWN_RATE,
            self.field_noise,
            self.inertia_spread * (a[0] + a[4] + a[8]) / 3.0,
            self.coil_spread,
            self.coupling_spread,
        )
        self._setting = craft_filter.Setting(
            doubts, carrier, self.rate_noise, self.field_turn
        )
        self._is_doubting = (
            max(self.inertia_spread, self.coil_spread, self.coupling_spread) > 0.0
        )
        self._is_learning = False
        self._craft, self._doubt = craft_filter.begin(ZERO, ZERO, self._setting)
        self._signs: Vec3 = (1.0, 1.0, 1.0)
        self._surprises = self.filter_restarts = 0
        self._trust()
        self._still = (0.0,) * len(self.h_wheel)
        self._friction = self._still
        self._was_valid_h = False
        self._b = ZERO
        self._length = max(1, int(self.segment / self.model_step + 0.999999))
        self._horizon = max(1, int(self.horizon / self.model_step + 0.999999))
        if self._horizon > MOST_STEPS:
            self.fail(
                f"horizon = {self.horizon} s is {self._horizon} steps of model_step = "
                f"{self.model_step} s; at most {MOST_STEPS} are allowed"
            )
        self._drop()
        self._searches = 0
        self._slow_since = -1.0
        self._is_slow = False
        self._omega: Vec3 | None = None
        self._h_before = self._still
        self._rates = craft_filter.rates_covariance(self._doubt)
        self._t_before = 0.0
        self.tau_cmd_wheel = self._still
        self.m_cmd_body = self.tau_cmd_thruster_body = self.omega_est_body = ZERO
        self.mode = IDLE
        self.coil_saturated = False
        self.time_left = 0.0

    def _model(self) -> rollout.Model:
        """Return the present model of the craft."""
        return rollout.Model(
            self._carrier,
            self._inverse,
            self.axes_wheel,
            self.m_limit,
            self._limits,
            self.h_limit,
            self.gain,
            self.gain_wheel,
            self.margin * self.rate_limit,
            self.model_step,
        )

    def _trust(self) -> None:
        """Take every existing wheel for one that works."""
        a, count = self.axes_wheel, len(self.h_wheel)
        self._limits: PerWheel = tuple(
            self.torque_limit if any((a[i], a[count + i], a[2 * count + i])) else 0.0
            for i in range(count)
        )
        self._misses = (0,) * count
        self.wheels_dead = 0

    def _drop(self) -> None:
        """Abandon the sequence and search at the next sample."""
        plan = rollout.none(self._model())
        self._plan_torques, self._segments, self._elapsed_steps = plan
        self._planned_at = -1.0

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        inputs = (
            ("h_wheel",) if self.rate_from == FILTER else ("omega_bi_body", "h_wheel")
        )
        for name in inputs:
            if name not in wired_names:
                yield f"{name} is not wired: the law of detumbling is of no use without it"
        yield from super().foresee(begin, end, wired_names)

    def compute(self, t: float, dt: float) -> None:
        """Estimate the rate at a sample, plan, and command coils and wheels."""
        if not self.due(t):
            return
        self._b = sub(self.b_body, mat_vec(self.coil_coupling, self.m_cmd_body))
        self._watch(t)
        self._sense(t)
        self._h_before, self._t_before = self.h_wheel, t
        omega = self._omega
        self.tau_cmd_wheel, self.m_cmd_body = self._still, ZERO
        self.coil_saturated = False
        self.omega_est_body = ZERO if omega is None else omega
        if not self.enable or omega is None:
            self.mode, self._slow_since = IDLE, -1.0
            self._drop()
            if not self.enable:
                self._trust()
            return
        self._judge(t, omega)
        if self._is_slow:
            # a sequence that is slow soonest would not keep the craft slow
            self.time_left = 0.0
            self._drop()
        else:
            self._plan(t, omega)
        if self.valid_b and not self._is_waiting():
            command = clip(all_coils(omega, self._b, self._coil_gain()), self.m_limit)
            signs = self._signs
            self.m_cmd_body = (
                signs[0] * command[0],
                signs[1] * command[1],
                signs[2] * command[2],
            )
        self.coil_saturated = any(abs(x) >= self.m_limit for x in self.m_cmd_body)
        self.tau_cmd_wheel = self._command(t, omega)

    def _watch(self, t: float) -> None:
        """Compare each wheel's momentum with its command: friction, or a dead wheel."""
        if not self.valid_h or not self._was_valid_h:
            self._was_valid_h = self.valid_h
            return
        elapsed_time = t - self._t_before
        h, before, u, limit = (
            self.h_wheel,
            self._h_before,
            self.tau_cmd_wheel,
            self._limits,
        )
        actual_torque = tuple(
            (x - y) / elapsed_time for x, y in zip(h, before, strict=True)
        )
        share, f = min(elapsed_time / FRICTION_TIME, 1.0), self._friction
        wheels = range(len(h))
        self._friction = tuple(
            within(f[i] + share * (u[i] - actual_torque[i] - f[i]), limit[i])
            for i in wheels
        )
        self._misses = tuple(
            count_misses(self._misses[i], u[i], actual_torque[i], limit[i])
            for i in wheels
        )
        limits = tuple(0.0 if self._misses[i] >= MISSES else limit[i] for i in wheels)
        if limits != limit:
            self._limits = limits
            self.wheels_dead += 1
            self._drop()

    def _coil_gain(self) -> float:
        """Return K of the coils (A m2 s/T).

        Without a working wheel it is one that lets the field turn.
        """
        size2 = dot(self._b, self._b)
        if any(self._limits) or size2 == 0.0:
            return self.gain
        return self.gain_alone / size2

    def _sense(self, t: float) -> None:
        """Estimate the rate at this sample; None where it is not observable."""
        if self.rate_from == GYRO:
            self._omega = self.omega_bi_body if self.valid_omega else None
            if self._is_doubting:
                self._learn(t, self.valid_b and self.valid_h and self.valid_omega)
                self._omega = self.omega_bi_body if self.valid_omega else None
            return
        self._omega = None
        self._learn(t, self.valid_b and self.valid_h)

    def _wheel_torque(self, elapsed_time: float) -> Vec3:
        """Compute the wheels' torque on the body since the last sample (N m, body).

        It follows from the change of their momentum, not from the command.
        """
        h, before = self.h_wheel, self._h_before
        u = tuple((y - x) / elapsed_time for x, y in zip(h, before, strict=True))
        return body_momentum(self.axes_wheel, u)

    def _learn(self, t: float, is_valid: bool) -> None:
        """Estimate the rate and what is doubted of the craft at this sample.

        is_valid: whether all measurements of this sample are.
        """
        was_learning, self._is_learning = self._is_learning, is_valid
        if not is_valid:
            return
        if not was_learning:
            self._begin_learning()
            return
        elapsed_time = t - self._t_before
        self._craft, self._doubt, surprise = craft_filter.update(
            self._craft,
            self._doubt,
            craft_filter.Interval(
                elapsed_time,
                self.m_cmd_body,
                self._wheel_torque(elapsed_time),
                body_momentum(self.axes_wheel, self._h_before),
                self._b,
                self.omega_bi_body,
                self.gyro_noise if self.rate_from == GYRO else 0.0,
            ),
            self._setting,
            self._is_familiar(),
        )
        self._surprises = kalman.count_surprises(self._surprises, surprise)
        if self._surprises >= kalman.SURPRISES:
            self.filter_restarts += 1
            self._begin_learning()
            return
        self._show()

    def _begin_learning(self) -> None:
        """Let the filter begin, with all of its doubts, at this sample's field."""
        self._craft, self._doubt = craft_filter.begin(
            self._b, self.m_cmd_body, self._setting
        )
        self._surprises = 0
        self._drop()
        self._show()

    def _show(self) -> None:
        """Take rate, field, inertia and signs of coils from the filter."""
        x = self._craft
        self._omega = craft_filter.rate_of(x)
        self._rates = craft_filter.rates_covariance(self._doubt)
        self._b = sub(self._b, craft_filter.coupled_field(x, self.m_cmd_body))
        self._carrier = craft_filter.carrier_of(x)
        self._inverse = inverse(self._carrier)
        self._signs = craft_filter.coil_signs(x, self._doubt)

    def _is_familiar(self) -> bool:
        """Return whether every rate is known to FAMILIAR_RATE (1 sigma)."""
        p, limit = self._rates, FAMILIAR_RATE * FAMILIAR_RATE
        return p[0] < limit and p[4] < limit and p[8] < limit

    def _is_waiting(self) -> bool:
        """Return whether no dipole may yet be commanded, as it would hide the rate."""
        waits = self._is_doubting and self.coupling_spread > 0.0
        return waits and not self._is_familiar()

    def _judge(self, t: float, omega: Vec3) -> None:
        """Decide whether the craft is slow, and for how long it has been."""
        size = rollout.largest(omega)
        if size > self.rate_again:
            self._is_slow = False
        elif size < self.rate_limit and self._is_sure():
            self._is_slow = True
        if size >= self.rate_limit or not self._is_sure():
            self._slow_since = -1.0
        elif self._slow_since < 0.0:
            self._slow_since = t
        is_held = (
            self._slow_since >= 0.0 and t - self._slow_since >= self.hold_time - 1e-6
        )
        if is_held or (self.mode == DETUMBLED and self._is_slow):
            self.mode = DETUMBLED
        else:
            self.mode = BRAKING

    def _is_sure(self) -> bool:
        """Return whether the rate is known within its limit (1 sigma)."""
        p, limit = self._rates, self.rate_limit * self.rate_limit
        return self.rate_from == GYRO or (
            p[0] < limit and p[4] < limit and p[8] < limit
        )

    def _plan(self, t: float, omega: Vec3) -> None:
        """Search for a sequence where a search is due."""
        since = t - self._planned_at
        if self._planned_at >= 0.0 and since < self.plan_time - 1e-6:
            return
        if not (self.valid_b and self.valid_h and any(self._limits)):
            self._drop()
            return
        elapsed_steps = self._elapsed_steps
        if self._planned_at >= 0.0:
            elapsed_steps += int(since / self.model_step + 0.5)
        is_over = elapsed_steps >= self._segments * self._length
        before = (
            rollout.none(self._model())
            if is_over
            else rollout.Sequence(self._plan_torques, self._segments, elapsed_steps)
        )
        sequence, cost = rollout.sought(
            self._model(),
            omega,
            self._b,
            self.h_wheel,
            before,
            self._searches,
            self.rounds,
            self.candidates,
            self._length,
            self._horizon,
        )
        self._plan_torques, self._segments, self._elapsed_steps = sequence
        self._searches += 1
        self._planned_at = t
        self.time_left = self.model_step * min(max(cost, 0.0), self.horizon)

    def _command(self, t: float, omega: Vec3) -> PerWheel:
        """Compute the torque to each rotor (N m), with compensation of friction."""
        u = rollout.by_law(self._model(), omega)
        if self._planned_at >= 0.0:
            elapsed_steps = self._elapsed_steps + int(
                (t - self._planned_at) / self.model_step + 1e-6
            )
            if elapsed_steps < self._segments * self._length:
                u = rollout.of_sequence(
                    self._model(), self._plan_torques, elapsed_steps // self._length
                )
                self.mode = PLANNED
        if not self.valid_h:
            return u
        f, limit = self._friction, self._limits
        u = tuple(within(u[i] + f[i], limit[i]) for i in range(len(u)))
        return rollout.stop_overspeed(u, self.h_wheel, self.h_limit)
