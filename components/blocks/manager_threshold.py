from __future__ import annotations

from collections.abc import Iterator
from math import copysign, floor, inf

from ..bases.dumping import DUMPING, IDLE, MomentumDumping
from ..contract.block import Output, Parameter, Table, Vec3
from ..laws import cross_product
from ..laws.blending import Split
from ..maths.vector import ZERO, add, clip, cross, norm, scale, sub

WHEELS, SUM = range(2)
THRUSTERS, COILS, BOTH = range(3)
WAITING = 2
THRUSTERS_HOLD = 1  # of `attitude_by`
# Lower bound of the torque of a sample, relative to `torque`: without it noise would
# keep a dump from its end; and the number of samples near the end after which a dump
# ends, whatever momentum accumulates meanwhile.
LAST, SAMPLES = 0.05, 10
WINDOWS = 32  # rows of the table of times in which a dump may be


class ManagerThreshold(MomentumDumping):
    """Dumping from one threshold to another, by thrusters or by magnetic torquers

    Momentum remains in the wheels until `fill` reaches `begin`; it is then dumped until
    `fill` is at `end`, with h the wheels' momentum less `h_target_body` and h_i that of
    each wheel:

        wheels:  fill = max |h_i - h_null n_i|            sum:  fill = |h|

    With `period` a dump also begins at each multiple of it since the first sample, where
    `fill` is above `end`: a calendar.

    With `windows` a dump fires within these times only, as at ground contacts or outside
    observations: one that is due waits for the next, and one that the end of a window
    cuts off goes on in the next and counts again. With `windows_period` they repeat.

    thrusters: the dumping torque is N = -torque h / |h|; the last sample is limited so
    that `fill` does not fall below `end`. Pairs about the body's axes give it with
    on-times of |N_x|, |N_y| and |N_z| over their levels. With `aligned` above 0 a dump
    waits until |h_x| + |h_y| + |h_z|, which is what it costs, is at most aligned |h| in
    the attitude of the craft, but no longer than `longest_wait`, and not once `fill` is
    at `latest`: a craft that does not turn may wait in vain. Thrusters fire whole
    pulses. With `pulse_body`, the angular impulse of the shortest pulse about each
    axis, N consists of whole pulses, and the remainder of an axis is added to its next
    sample. The wheels then absorb exactly what is fired, and noise about zero fires
    nothing.

    With `attitude_by` thrusters they also give the controller's torque in a dump, held
    over each sample, and the wheels take up the dumping torque alone.

    coils: M = gain (h x B) / |B|^2, each component within +-`m_limit`; N = M x B. None
    at a sample whose field is not valid.

    both: the coils work all the time, in dumps and between them, and thrusters dump
    what the coils do not keep below `begin`. `mode`, `dumps`, `dumping_time` and
    `dumped` are those of the thrusters.

    The wheels are commanded to give the body the controller's torque and to absorb,
    with `feedforward`, the dumping torque and, with `gyroscopic`, omega x h:

        tau_cmd_wheel = A^+ (N - tau_ctrl_body - omega x A h)        (paper 004, eq. 16)

    at each sample, or every `wheel_sample_time`, held in between. No dump removes
    momentum that the wheels hold against each other. With four wheels `null_gain` makes
    it decay; otherwise `fill` of the fullest wheel may never reach `end`.

    Source: ours.
    """

    no_law = "it lets momentum grow to its threshold"

    sample_time: float = Parameter(
        "s", "time between samples, a multiple of the step", start=10.0, min=0.0
    )
    by: int = Parameter(
        "1", "what dumps", choices=("thrusters", "coils", "both"), start="thrusters"
    )
    fill: int = Parameter(
        "1",
        "which momentum is held against the thresholds",
        choices=("wheels", "sum"),
        start="wheels",
    )
    begin: float = Parameter(
        "N.m.s",
        "momentum at which a dump begins",
        start=0.7,
        min=1e-9,
        needs=("h_wheel",),
    )
    end: float = Parameter(
        "N.m.s", "momentum at which it ends; below begin", start=0.1, min=0.0
    )
    period: float = Parameter(
        "s", "time between dumps by the calendar; 0: there is none", min=0.0
    )
    torque: float = Parameter(
        "N.m",
        "torque of a dump by thrusters, which the wheels take up",
        start=0.01,
        min=1e-9,
    )
    attitude_by: int = Parameter(
        "1",
        "what holds the attitude in a dump by thrusters",
        choices=("wheels", "thrusters"),
        start="wheels",
    )
    pulse_body: Vec3 = Parameter(
        "N.m.s",
        "impulse of the shortest pulse about each axis; 0: any is fired",
        min=0.0,
    )
    aligned: float = Parameter(
        "1",
        "a dump by thrusters waits until |h|_1 / |h| is at most this; 0: it does not",
        min=0.0,
        max=1.7320508075688772,
    )
    longest_wait: float = Parameter("s", "no dump waits longer", start=86400.0, min=0.0)
    latest: float = Parameter(
        "N.m.s",
        "momentum from which on no dump waits; above begin, 0: there is none",
        min=0.0,
    )
    windows: Table = Parameter(
        "s",
        "a row a window, in order: when it begins and ends; 0, 0 ends the table; empty: always",
        shape=(WINDOWS, 2),
        min=0.0,
    )
    windows_period: float = Parameter(
        "s", "time after which the windows repeat; 0: they do not", min=0.0
    )
    gain: float = Parameter("1/s", "gain of the coils' law", start=5e-3, min=0.0)
    m_limit: float = Parameter(
        "A.m2",
        "largest dipole of each axis",
        start=20.0,
        min=0.0,
        follows="torquers.m_limit",
    )

    mode: int = Output(
        "1",
        "what the manager does",
        interval=True,
        choices=("idle", "dumping", "waiting"),
    )
    dumps: int = Output("1", "dumps that have begun", interval=True)
    dumping_time: float = Output("s", "time of all dumps", interval=True)
    dumped: float = Output(
        "N.m.s",
        "size of the impulse that each dump has commanded in all, body, summed over dumps",
        interval=True,
    )

    def start(self) -> None:
        """Check the thresholds (N m s) and reset the counters of dumps."""
        super().start()
        if self.sample_time == 0.0:
            self.fail("sample_time = 0 s: a dump has samples")
        if self.end >= self.begin:
            self.fail(f"end = {self.end} N m s is not below begin = {self.begin} N m s")
        if 0.0 < self.aligned < 1.0:
            self.fail(
                f"aligned = {self.aligned}: |h|_1 / |h| is never below 1; 0 does not wait"
            )
        if 0.0 < self.latest <= self.begin:
            self.fail(
                f"latest = {self.latest} N m s is not above begin = {self.begin} N m s"
            )
        self._count_windows()
        self.dumps, self.dumping_time, self.dumped = 0, 0.0, 0.0
        self._since, self._next = 0.0, self.period
        self._rest: Vec3 = ZERO
        self._dumped_before = 0.0  # N m s, by earlier dumps
        self._dump_impulse: Vec3 = ZERO  # N m s, by the present dump
        self._last = 0

    def _count_windows(self) -> None:
        """Count the rows of `windows` and check their order."""
        count, last = 0, 0.0
        while count < WINDOWS and self.windows[2 * count + 1] > 0.0:
            begin, end = self.windows[2 * count], self.windows[2 * count + 1]
            if begin >= end or begin < last:
                self.fail(
                    f"windows: row {count + 1}, {begin} to {end} s, begins before "
                    "the one before it ends, or ends before it begins"
                )
            last = end
            count += 1
        if self.windows_period > 0.0 and last > self.windows_period:
            self.fail(
                f"windows: the last ends at {last} s, after windows_period = "
                f"{self.windows_period} s"
            )
        self._window_count = count

    def is_open(self, t: float) -> bool:
        """Return whether a dump may fire at a time (s)."""
        if self._window_count == 0:
            return True
        since = t
        if self.windows_period > 0.0:
            since = t - self.windows_period * floor(t / self.windows_period)
        is_open = False
        for i in range(self._window_count):
            begin, end = self.windows[2 * i], self.windows[2 * i + 1]
            is_open = is_open or begin <= since < end
        return is_open

    def next_open(self, t: float) -> float:
        """Return the first time (s), `t` or later, at which a dump may fire; inf: none."""
        if self.is_open(t):
            return t
        since, base = t, 0.0
        if self.windows_period > 0.0:
            base = self.windows_period * floor(t / self.windows_period)
            since = t - base
        for i in range(self._window_count):
            if self.windows[2 * i] > since:
                return base + self.windows[2 * i]
        if self.windows_period > 0.0:
            return base + self.windows_period + self.windows[0]
        return inf

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        """Yield the problems known before a run: windows that end, pulses too long.

        Raises
        ------
        BlockError
            If nothing that dumps is wired.
        """
        if self._window_count > 0 and self.windows_period == 0.0:
            last = self.windows[2 * self._window_count - 1]
            if last < end:
                yield (
                    f"windows: the last ends at {last:g} s, the run at {end:g} s: no dump "
                    "is after it"
                )
        for name, is_used in (
            ("tau_cmd_thruster_body", self.by != COILS),
            ("m_cmd_body", self.by != THRUSTERS),
        ):
            if is_used and name not in wired_names:
                by = ("thrusters", "coils", "both")[self.by]
                self.fail(f"by = {by}: {name} is unused")
        if 0.5 * max(self.pulse_body) >= self.begin - self.end:
            yield (
                f"pulse_body = {self.pulse_body} N m s: half a pulse is no less than begin - "
                f"end = {self.begin - self.end:.4g} N m s: a dump may fire nothing"
            )
        yield from super().foresee(begin, end, wired_names)

    def dump(self, t: float, elapsed_time: float, h: Vec3) -> tuple[Vec3, Split]:
        """Begin, continue or end a dump; return its torque (N m, body) and its split.

        A dump goes from the momentum `begin` down to `end` (N m s). Thrusters oppose h
        with at most `torque`, in pulses; coils follow the cross-product law, those of
        `both` at all times.
        """
        size = norm(h)
        fill = size
        if self.fill == WHEELS:
            beyond = zip(self.h_wheel, self._bias, strict=True)
            fill = max(abs(x - y) for x, y in beyond)
        self._choose_mode(t, elapsed_time, h, size, fill)
        is_dumping = self.mode == DUMPING
        m = n_coils = ZERO
        if self.valid_b and (self.by == BOTH or (self.by == COILS and is_dumping)):
            m = clip(cross_product.normalised(h, self.b_body, self.gain), self.m_limit)
            n_coils = cross(m, self.b_body)
        if not is_dumping:
            return n_coils, (m, ZERO)
        self.dumping_time += self.sample_time
        if self.by == COILS:
            self._count(n_coils)
            return n_coils, (m, ZERO)
        rest = size * (1.0 - self.end / fill) / self.sample_time
        self._last = self._last + 1 if rest <= self.torque else 0
        n = scale(-min(self.torque, max(rest, LAST * self.torque)) / size, h)
        remaining = scale(1.0 - self.end / fill, h)
        if self._is_done(remaining):
            self._last = SAMPLES
        n = self._in_pulses(n, remaining)
        self._count(n)
        return add(n, n_coils), (m, add(n, self._control_by_thrusters()))

    def _choose_mode(
        self, t: float, elapsed_time: float, h: Vec3, size: float, fill: float
    ) -> None:
        """Set `mode` at a sample: a dump is due, waits, begins, is cut off or ends."""
        due = fill >= self.begin
        if self.period > 0.0 and self._next <= elapsed_time:
            due = due or fill > self.end
            while self._next <= elapsed_time:
                self._next += self.period
        if self.mode == IDLE and due:
            self.mode, self._since = WAITING, t
        is_open = self.is_open(t)
        if self.mode == DUMPING and not is_open:
            self.mode, self._since = WAITING, t
        if self.mode == WAITING and is_open and self._goes(t, h, size, fill):
            self.mode, self._last, self._rest = DUMPING, 0, ZERO
            self._dumped_before, self._dump_impulse = self.dumped, ZERO
            self.dumps += 1
        if self.mode == DUMPING and (
            self._last >= SAMPLES or fill <= self.end or size == 0.0
        ):
            self.mode = IDLE

    def control_by_wheels(self) -> Vec3:
        """Return the controller's torque (N m, body) where no thrusters give it."""
        return sub(self.tau_ctrl_body, self._control_by_thrusters())

    def _control_by_thrusters(self) -> Vec3:
        """Return the controller's torque (N m, body) while thrusters give it."""
        is_theirs = self.attitude_by == THRUSTERS_HOLD and self.by != COILS
        return self.tau_ctrl_body if is_theirs and self.mode == DUMPING else ZERO

    def _count(self, n: Vec3) -> None:
        """Add the impulse of a torque (N m) over a sample to that of the dump."""
        self._dump_impulse = add(self._dump_impulse, scale(self.sample_time, n))
        self.dumped = self._dumped_before + norm(self._dump_impulse)

    def _is_done(self, remaining: Vec3) -> bool:
        """Return whether the remainder of a dump is below half a pulse about each axis.

        left in N m s.
        """
        a, b, c = self.pulse_body
        x, y, z = remaining
        return abs(x) < 0.5 * a and abs(y) < 0.5 * b and abs(z) < 0.5 * c

    def _in_pulses(self, n: Vec3, remaining: Vec3) -> Vec3:
        """Round a torque (N m) over a sample to whole pulses.

        They bring the remainder `remaining` of the dump (N m s) at most to within half a
        pulse. The rounding error is carried to the next sample.
        """
        impulses = add(scale(self.sample_time, n), self._rest)
        x, y, z = (
            copysign(
                size * int(min(abs(impulse), abs(rest) + 0.5 * size) / size), impulse
            )
            if size > 0.0
            else impulse
            for impulse, rest, size in zip(
                impulses, remaining, self.pulse_body, strict=True
            )
        )
        self._rest = sub(impulses, (x, y, z))
        return scale(1.0 / self.sample_time, (x, y, z))

    def _goes(self, t: float, h: Vec3, size: float, fill: float) -> bool:
        """Return whether a dump that is due begins at this sample."""
        if (
            self.by == COILS
            or self.aligned == 0.0
            or t - self._since >= self.longest_wait
            or 0.0 < self.latest <= fill
        ):
            return True
        return abs(h[0]) + abs(h[1]) + abs(h[2]) <= self.aligned * size
