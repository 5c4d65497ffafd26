"""Provide the base of managers that detumble and start up a pitch-bias wheel.

It holds the phases and the reasons for their changes, the field's rate, the treatment
of invalid measurements and the limits of the commands.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator

from ..contract.block import SPIN, TURN, Output, Parameter, Table, Vec3, WheelColumns
from ..contract.roles import Manager, WheelAxes
from ..laws import field_rate
from ..laws.acquisition import PITCH_BIAS, within
from ..laws.attitude_control import tracking_error
from ..maths.attitude import error_angle, inverse, product, rotate
from ..maths.vector import ZERO, clip

IDLE, DUMPING = range(2)
DETUMBLING, PITCH_SPIN, WHEEL_RAMP, MOMENTUM_DUMP, THREE_AXIS, DONE = range(6)
(
    START,
    CONDITION_MET,
    TIME_LIMIT,
    RATE_LOST,
    NO_FIELD,
    NO_RATE,
    NO_ATTITUDE,
    NO_MOMENTUM,
) = range(8)
DIFFERENCE, FILTERED = range(2)

# s; above it eq. 2 no longer follows a field that turns at 0.17 rad/s
LONGEST_SAMPLE_TIME = 2.0


class Acquisition(Manager, WheelAxes):
    """Base of managers with phases; a block adds `sequence`, `act` and `rate`.

    The wheel's axis is +y or -y of the body; its momentum h and `h_nominal` count along
    -y.

    **Phases** (`phase`, of which a block uses some) end when

    - detumbling: every rate is below `rate_limit`, for `hold_time`;
    - pitch_spin: the pitch rate is within `spin_error` of its target;
    - wheel_ramp, momentum_dump: h is at least `momentum_share` of h_nominal;
    - three_axis: the pointing error is below `pointing_limit`, for `hold_time`;

    or after their `time_limit`. A rate above `rate_lost` (of roll and yaw only, while
    the craft spins) leads back to the first phase. From there a wheel that is already
    full goes on without spin and ramp. `reason` says why the phase changed last. While
    a measurement that the phase needs is invalid, it names that measurement instead;
    the law then works without it, and no condition is met by invalid values.

    **Field rate.** `difference`: eq. 2 of paper 003, from two consecutive valid samples, so that the
    first gives none; `filtered`: a first-order low-pass of it, of `cut_off`.
    """

    no_law = "it brakes a craft and starts its pitch wheel up: no law for wheels about three axes"
    brakes = True

    sample_time: float = Parameter(
        "s",
        "time between samples, a multiple of the step; at most 2 s",
        start=1.0,
        min=0.0,
    )
    axes_wheel: WheelColumns = Parameter(
        "1",
        "columns: the wheels' axes, body; one along +y or -y, the others zero",
        start=(0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
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
        "largest torque command to the wheel",
        start=5e-3,
        min=0.0,
        follows="wheels.torque_limit",
    )
    h_limit: float = Parameter(
        "N.m.s",
        "momentum beyond which the wheel is not driven",
        start=0.18,
        min=1e-9,
        follows="wheels.inertia_wheel * wheels.speed_limit",
    )
    h_nominal: float = Parameter(
        "N.m.s", "wanted momentum of the wheel, along -y", start=0.09, min=0.0
    )
    field_rate: int = Parameter(
        "1",
        "how the field's rate is formed",
        choices=("difference", "filtered"),
        start="difference",
    )
    cut_off: float = Parameter(
        "rad/s", "filtered: of the low-pass", start=0.5, min=1e-6
    )
    rate_limit: float = Parameter(
        "rad/s", "detumbled: every rate below", start=3e-3, min=1e-9, usual=SPIN
    )
    hold_time: float = Parameter(
        "s", "so long, before detumbling or three_axis ends", min=0.0
    )
    spin_target: float = Parameter(
        "rad/s", "pitch rate of the spin", start=-0.31, usual=SPIN
    )
    spin_error: float = Parameter(
        "rad/s", "pitch spin: error of the rate", start=3e-3, min=1e-9, usual=SPIN
    )
    momentum_share: float = Parameter(
        "1", "of h_nominal, at which a wheel phase ends", start=0.995, min=0.0
    )
    pointing_limit: float = Parameter(
        "rad",
        "three_axis: pointing error below",
        start=0.17453292519943295,
        min=1e-6,
        usual=TURN,
    )
    rate_lost: float = Parameter(
        "rad/s", "lost: a rate above; 0: never", start=0.15, min=0.0, usual=SPIN
    )
    time_limit: Table = Parameter(
        "s",
        "of detumbling, pitch_spin, wheel_ramp, momentum_dump, three_axis; 0: none",
        shape=(5,),
        min=0.0,
    )
    experiment: bool = Parameter(
        "1", "true: a sample time at which the laws fail is accepted"
    )
    mode: int = Output(
        "1", "what the manager does", interval=True, choices=("idle", "dumping")
    )
    phase: int = Output(
        "1",
        "phase of the acquisition",
        interval=True,
        choices=(
            "detumbling",
            "pitch_spin",
            "wheel_ramp",
            "momentum_dump",
            "three_axis",
            "done",
        ),
    )
    reason: int = Output(
        "1",
        "why the phase changed, or what its law does without",
        interval=True,
        choices=(
            "start",
            "condition_met",
            "time_limit",
            "lost",
            "no_field",
            "no_rate",
            "no_attitude",
            "no_momentum",
        ),
    )
    coil_saturated: bool = Output(
        "1", "true: a dipole command is at its limit", interval=True
    )

    def start(self) -> None:
        """Check the parameters and set the state to its start values."""
        super().start()
        self._check()
        self._sequence = self.sequence()
        self.phase, self.reason = self._sequence[0], START
        self._change_reason = START
        self._phase_begin = self._held_since = -1.0
        self._b: Vec3 | None = None
        self._b_rate: Vec3 | None = None
        self._b_time = 0.0
        self.tau_cmd_wheel = (0.0,) * len(self.h_wheel)
        self.m_cmd_body = self.tau_cmd_thruster_body = ZERO
        self.coil_saturated = False
        self.mode = IDLE

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: also inputs that the phases need."""
        later = (
            ("q_bi", "q_ref_bi", "h_wheel", "tau_cmd_wheel")
            if len(self._sequence) > 2
            else ()
        )
        for name in dict.fromkeys((*self.for_rate(), *later)):
            if name not in wired_names:
                yield f"{name} is not wired: the law of {self._phases()} is of no use without it"
        yield from super().foresee(begin, end, wired_names)

    def _phases(self) -> str:
        """Return the name of the manager's task for a message."""
        return "detumbling" if len(self._sequence) <= 2 else "the start-up"

    def _check(self) -> None:
        """Refuse invalid parameters; also find the wheel and the sign of its axis."""
        if not 0.0 < self.sample_time <= LONGEST_SAMPLE_TIME and not self.experiment:
            self.fail(
                f"sample_time = {self.sample_time} s is outside (0, {LONGEST_SAMPLE_TIME:g}]: at "
                "5 s detumbling by the wheel takes three times as long, at 10 s it never "
                "converges; experiment = true accepts it"
            )
        count = len(self.h_wheel)
        present = tuple(i for i in range(count) if any(self.axes_wheel[i::count]))
        if len(present) != 1:
            self.fail(
                f"axes_wheel has {len(present)} wheels; one along +y or -y is needed"
            )
        self._wheel = present[0]
        axis = self.axes_wheel[self._wheel :: count]
        if axis not in ((0.0, 1.0, 0.0), (0.0, -1.0, 0.0)):
            self.fail(f"axes_wheel: the wheel's axis {axis} is not along +y or -y")
        self._along = -axis[1]  # +1: the wheel's momentum counts as h does
        if self.h_nominal > self.h_limit:
            self.fail(
                f"h_nominal = {self.h_nominal} N m s is beyond h_limit = {self.h_limit}"
            )
        if self.momentum_share * self.h_nominal > self.h_limit:
            self.fail(
                f"momentum_share = {self.momentum_share} of h_nominal is beyond h_limit = "
                f"{self.h_limit} N m s: it is never reached"
            )
        if 0.0 < self.rate_lost <= self.rate_limit:
            self.fail(
                f"rate_lost = {self.rate_lost} rad/s is not above rate_limit = "
                f"{self.rate_limit}: detumbling would never be over"
            )
        for phase in (DETUMBLING, THREE_AXIS):
            if 0.0 < self.time_limit[phase] <= self.hold_time:
                self.fail(
                    f"hold_time = {self.hold_time} s is not below time_limit[{phase + 1}] = "
                    f"{self.time_limit[phase]} s: it cannot be held so long"
                )

    @abstractmethod
    def sequence(self) -> tuple[int, ...]:
        """Return the phases of the manager in order, with DONE last."""

    @abstractmethod
    def act(self, phase: int) -> int:
        """Command the actuators by the law of a phase.

        Returns the missing measurement (NO_...), or START.
        """

    @abstractmethod
    def rate(self) -> Vec3 | None:
        """Return the body's rate (rad/s, body) that the conditions use.

        None where it is not known.
        """

    def for_rate(self) -> tuple[str, ...]:
        """Return the inputs that detumbling and the rate need, beside the field's."""
        return ("omega_bi_body",)

    def sense(self, t: float) -> None:
        """Process the measurements of a sample, before the phase is checked."""

    def compute(self, t: float, dt: float) -> None:
        """Follow the phases and command the actuators at a sample."""
        if not self.due(t):
            return
        self._take_field(t)
        self.sense(t)
        self.give(ZERO, 0.0)
        if not self.enable:
            self.mode = IDLE
            return
        self._follow(t)
        phase = self.phase
        missing = self.act(self._sequence[-2] if phase == DONE else phase)
        self.reason = missing or self._change_reason
        on = any(self.m_cmd_body) or any(self.tau_cmd_wheel)
        self.mode = DUMPING if on else IDLE

    def _take_field(self, t: float) -> None:
        """Store the field and compute its rate at this sample.

        No rate is computed from invalid samples, nor across them.
        """
        if not self.valid_b:
            self._b = self._b_rate = None
            return
        b, before, last = self.b_body, self._b, self._b_rate
        if before is not None:
            elapsed_time = t - self._b_time
            now = field_rate.difference(b, before, elapsed_time)
            if self.field_rate == FILTERED and last is not None:
                now = field_rate.low_pass(last, now, self.cut_off, elapsed_time)
            self._b_rate = now
        self._b, self._b_time = b, t

    # --- phases -----------------------------------------------------------------------

    def _follow(self, t: float) -> None:
        """Change the phase where a condition, a time limit or a loss requires it."""
        if self._phase_begin < 0.0:
            self._phase_begin = t
        phase = self.phase
        if phase != self._sequence[0] and self._is_lost(phase):
            self._enter(t, self._sequence[0], RATE_LOST)
        elif phase != DONE:
            if self._is_met(t, phase):
                self._enter(t, self._next(phase), CONDITION_MET)
            elif 0.0 < self.time_limit[phase] <= t - self._phase_begin:
                self._enter(t, self._next(phase), TIME_LIMIT)

    def _next(self, phase: int) -> int:
        """Return the phase after this one; a full wheel needs no spin."""
        following = self._sequence[self._sequence.index(phase) + 1]
        # after a loss the wheel may be full already and needs no spin
        return (
            THREE_AXIS if following == PITCH_SPIN and self._is_filled() else following
        )

    def _enter(self, t: float, phase: int, reason: int) -> None:
        """Enter a phase at t (s) for a reason."""
        self.phase, self._change_reason = phase, reason
        self._phase_begin, self._held_since = t, -1.0

    def _is_lost(self, phase: int) -> bool:
        """Return whether a rate is above `rate_lost`.

        Only roll and yaw count during the spin and the ramp.
        """
        omega = self.rate()
        if omega is None or self.rate_lost == 0.0:
            return False
        spinning = phase in (PITCH_SPIN, WHEEL_RAMP)
        largest = max(abs(omega[0]), abs(omega[2]), 0.0 if spinning else abs(omega[1]))
        return largest > self.rate_lost

    def _is_met(self, t: float, phase: int) -> bool:
        """Return whether the condition of a phase is met, for as long as required."""
        condition = (
            self._is_slow,
            self._is_spun,
            self._is_filled,
            self._is_filled,
            self._is_pointing,
        )[phase]
        if not condition():
            self._held_since = -1.0
            return False
        if self._held_since < 0.0:
            self._held_since = t
        holds = phase in (DETUMBLING, THREE_AXIS)
        return not holds or t - self._held_since >= self.hold_time - 1e-6

    def _is_slow(self) -> bool:
        """Return whether every rate is below `rate_limit`."""
        omega = self.rate()
        return omega is not None and max(map(abs, omega)) < self.rate_limit

    def _is_spun(self) -> bool:
        """Return whether the pitch rate is within `spin_error` of its target."""
        if not (self.valid_omega and self.valid_q):
            return False
        return abs(self.turning()[1] - self.spin_target) < self.spin_error

    def _is_filled(self) -> bool:
        """Return whether the wheel has at least `momentum_share` of h_nominal."""
        return self.valid_h and self.h() >= self.momentum_share * self.h_nominal

    def _is_pointing(self) -> bool:
        """Return whether the pointing error is below `pointing_limit`."""
        return (
            self.valid_q and error_angle(self.q_bi, self.q_ref_bi) < self.pointing_limit
        )

    # --- inputs and outputs of the laws -------------------------------------------

    def h(self) -> float:
        """Return the wheel's measured momentum along -y (N m s)."""
        return self._along * self.h_wheel[self._wheel]

    def turning(self) -> Vec3:
        """Return the measured rate relative to the reference frame (rad/s, body)."""
        return self.relative(self.omega_bi_body)

    def relative(self, omega: Vec3) -> Vec3:
        """Compute a rate (rad/s, body) relative to the reference frame.

        It uses the measured attitude.
        """
        _, rate = tracking_error(self.q_bi, omega, self.q_ref_bi, self.omega_ref_body)
        return rate

    def of_reference(self, v: Vec3) -> Vec3:
        """Rotate a vector of the reference frame (lvlh) into body.

        It uses the measured attitude.
        """
        return rotate(product(self.q_bi, inverse(self.q_ref_bi)), v)

    def normal(self) -> Vec3:
        """Return the orbit normal in body, by the measured attitude."""
        return self.of_reference(PITCH_BIAS)

    def give(self, m: Vec3, torque: float) -> None:
        """Command a dipole (A m2, body) and a torque of the wheel (N m).

        The torque is that on the body about +y. Both are limited; no torque drives the
        wheel further beyond `h_limit`.
        """
        self.m_cmd_body = clip(m, self.m_limit)
        self.coil_saturated = any(abs(x) >= self.m_limit for x in m)
        torque = within(torque, self.torque_limit)
        if self.valid_h and abs(self.h()) >= self.h_limit and torque * self.h() > 0.0:
            torque = 0.0
        u = self._along * torque
        self.tau_cmd_wheel = tuple(
            u if i == self._wheel else 0.0 for i in range(len(self.h_wheel))
        )
