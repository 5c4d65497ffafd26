from __future__ import annotations

from collections.abc import Iterator
from math import acos, asin, cos, exp
from typing import Annotated

from ..bases.sensing import Sensor, gauss_markov
from ..contract.block import SMALL_ANGLE, SPIN, Output, Parameter, Vec3, Vec4
from ..contract.roles import UPRIGHT
from ..contract.roles import StarTracker as Role
from ..maths.attitude import propagate, rotate_back
from ..maths.noise import normal6, stream, uniform
from ..maths.vector import ZERO, add, dot, norm, scale, unit
from ..physics.orbit import EARTH_RADIUS

ON_THEIR_WAY = 16  # measurements that `delay` may hold back at a time
SUN, EARTH, RATE, DROPOUT, ACQUIRING, LATE = 1, 2, 3, 4, 5, 6


class StarTracker(Role, Sensor):
    """Star tracker

        q_meas = dq(a_k) (x) q_bi,      a_k = S (noise_cross, noise_about) n_k + x_k
        x_k = p x_(k-1) + sqrt(1 - p^2) S (drift_cross, drift_about) w_k
        S (c, d) v = c (v - (v.e) e) + d (v.e) e,       p = exp(-T / drift_time)

    at each sample, T = `sample_time` after the last one, held in between, and output
    `delay` later. dq(a) is the rotation by |a| about a, in body axes, e the boresight,
    n and w are standard normal numbers, x is the low-frequency error (a first-order
    Gauss-Markov process that starts from its stationary state).

    No stars are seen while the Sun is visible within `sun_exclusion` of the boresight,
    while the limb of the (spherical) Earth is within `earth_exclusion` of it, while the
    rate is above `rate_limit`, and in drop-outs, which occur at random. The measurement
    is valid again at the first sample that is `reacquisition_time` or more after the
    last one without stars. The errors and drop-outs are functions of seed, instance
    name and sample index. While it is invalid, the last valid attitude is held; before
    the first one it is (0, 0, 0, 1), that of eci.

    Source: Markley & Crassidis, Fundamentals of Spacecraft Attitude Determination and
    Control (2014), sec. 4.2; Gelb, Applied Optimal Estimation (1974), ch. 3.
    """

    boresight_body: Vec3 = Parameter(
        "1", "boresight, body; normalised", start=(0.0, 0.0, 1.0)
    )
    noise_cross: float = Parameter(
        "rad",
        "standard deviation of the white error, each of two axes across the boresight",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    noise_about: float = Parameter(
        "rad",
        "standard deviation of the white error about the boresight",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    drift_cross: float = Parameter(
        "rad",
        "standard deviation of the low-frequency error, each of two axes across",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    drift_about: float = Parameter(
        "rad",
        "standard deviation of the low-frequency error about the boresight",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    drift_time: float = Parameter(
        "s",
        "correlation time of the low-frequency error; 0: white",
        start=100.0,
        min=0.0,
        usual=(0.0, 1e5),
    )
    sun_exclusion: float = Parameter(
        "rad",
        "smallest angle from the boresight to the Sun; 0: not blinded",
        min=0.0,
        max=3.141592653589793,
    )
    earth_exclusion: float = Parameter(
        "rad",
        "smallest angle from the boresight to the Earth's limb; 0: not blinded",
        min=0.0,
        max=3.141592653589793,
    )
    rate_limit: float = Parameter(
        "rad/s",
        "largest angular rate at which stars are seen; 0: any",
        min=0.0,
        usual=SPIN,
    )
    dropout_interval: float = Parameter(
        "s",
        "mean time between drop-outs, which have no memory; 0: none",
        min=0.0,
        usual=(0.0, 1e7),
    )
    reacquisition_time: float = Parameter(
        "s",
        "from the last sample without stars to the next valid one",
        min=0.0,
        usual=(0.0, 1e4),
    )
    delay: float = Parameter(
        "s",
        f"from a sample to its output: up to {ON_THEIR_WAY} times sample_time",
        min=0.0,
    )

    white = ("noise_cross", "noise_about")

    lost_to: int = Output(
        "1",
        "why it is not valid: 0 it is, 1 Sun, 2 Earth, 3 rate, 4 drop-out, 5 reacquiring, "
        "6 nothing has come out yet; of a failed one the last reason",
        interval=True,
        starts_from=("q_bi", "omega_bi_body", "r_eci", "sun_eci", "sunlight"),
    )

    def foresee(
        self, begin: float, end: float, wired_names: frozenset[str]
    ) -> Iterator[str]:
        if self.sun_exclusion > 0.0 and "sun_eci" not in wired_names:
            self.fail(
                f"sun_exclusion = {self.sun_exclusion} rad needs sun_eci, which has no wire"
            )
        if self.earth_exclusion > 0.0 and "r_eci" not in wired_names:
            self.fail(
                f"earth_exclusion = {self.earth_exclusion} rad needs r_eci, which has no wire"
            )
        if self.rate_limit > 0.0 and "omega_bi_body" not in wired_names:
            self.fail(
                f"rate_limit = {self.rate_limit} rad/s needs omega_bi_body, which has no wire"
            )
        yield from super().foresee(begin, end, wired_names)

    def start(self) -> None:
        """Check boresight and delay; set drift and delay line to their start values."""
        if not any(self.boresight_body):
            self.fail("boresight_body is zero; it must be a direction")
        self._boresight = unit(self.boresight_body)
        self._late = 0
        if self.delay > 0.0:
            samples = self.delay / self.sample_time if self.sample_time > 0.0 else 0.5
            self._late = round(samples)
            if abs(samples - self._late) > 1e-6 or not 1 <= self._late <= ON_THEIR_WAY:
                self.fail(
                    f"delay = {self.delay} s is not 1 to {ON_THEIR_WAY} times "
                    f"sample_time = {self.sample_time} s"
                )
        self._noise = stream(self.instance, "q_meas_bi", self.seed)
        self._dropouts = stream(self.instance, "dropout", self.seed)
        _, drift = normal6(self._noise, 0)
        self._drift = self._scale_by_boresight(
            self.drift_cross, self.drift_about, drift
        )
        self._wait = 0.0
        self.q_meas_bi = UPRIGHT
        # (sample, reason for no stars, attitude), in order, including the newest one
        self._waiting: Annotated[
            tuple[tuple[float, float, float, float, float, float], ...],
            ON_THEIR_WAY + 1,
        ] = ()
        super().start()

    def measure(self, sample: int, elapsed_time: float) -> None:
        """Measure the attitude, or set `lost_to` to the reason why there are no stars.

        Stars are acquired for `reacquisition_time` (s) after a loss; the measurement
        leaves `delay` (s) later.
        """
        reason = self._blind(sample, elapsed_time)
        if reason:
            self._wait = self.reacquisition_time
        elif self._wait > 0.0:
            self._wait -= elapsed_time
            if self._wait > 1e-6:
                reason = ACQUIRING
        q = self._attitude(sample, elapsed_time)
        if self._late > 0:
            before = self._waiting if sample > 0 else ()
            self._waiting = (
                *before,
                (float(sample), float(reason), q[0], q[1], q[2], q[3]),
            )
            reason, q = self.lost_to if sample > 0 else LATE, self.q_meas_bi
            while self._waiting and self._waiting[0][0] + self._late <= sample:
                _, came, x, y, z, w = self._waiting[0]
                reason, q = int(came), (x, y, z, w)
                self._waiting = self._waiting[1:]
        self.valid, self.lost_to = reason == 0, reason
        if self.valid:
            self.q_meas_bi = q

    def _blind(self, sample: int, elapsed_time: float) -> int:
        """Return why no stars are seen; 0: they are."""
        if self._is_sun_near():
            return SUN
        if self._is_earth_near():
            return EARTH
        if self.rate_limit > 0.0 and norm(self.omega_bi_body) > self.rate_limit:
            return RATE
        if self.dropout_interval > 0.0 and elapsed_time > 0.0:
            stays = exp(-elapsed_time / self.dropout_interval)
            if uniform(self._dropouts, sample) > stays:
                return DROPOUT
        return 0

    def _is_sun_near(self) -> bool:
        """Return whether the lit Sun is within its exclusion angle."""
        if self.sun_exclusion <= 0.0:
            return False
        size = norm(self.sun_eci)
        if size == 0.0:
            self.fail(
                f"sun_exclusion = {self.sun_exclusion} rad needs sun_eci, which is zero: "
                "the environment has no Sun"
            )
        boresight = rotate_back(self.q_bi, self._boresight)
        near = dot(boresight, self.sun_eci) > size * cos(self.sun_exclusion)
        return near and self.sunlight > 0.0

    def _is_earth_near(self) -> bool:
        """Return whether the Earth's limb is within its exclusion angle."""
        if self.earth_exclusion <= 0.0:
            return False
        r = norm(self.r_eci)
        if r < EARTH_RADIUS:
            self.fail(
                f"earth_exclusion = {self.earth_exclusion} rad needs r_eci, which is "
                f"{r} m from the Earth's centre, below its surface"
            )
        boresight = rotate_back(self.q_bi, self._boresight)
        down = min(max(-dot(boresight, self.r_eci) / r, -1.0), 1.0)
        return acos(down) - asin(EARTH_RADIUS / r) < self.earth_exclusion

    def _attitude(self, sample: int, elapsed_time: float) -> Vec4:
        """Compute the measured attitude; the errors evolve also without stars."""
        white, drift = ZERO, ZERO
        if (
            self.noise_cross > 0.0
            or self.noise_about > 0.0
            or self.drift_cross > 0.0
            or self.drift_about > 0.0
        ):
            white, drift = normal6(self._noise, sample)
        if elapsed_time > 0.0:
            decay = (
                exp(-elapsed_time / self.drift_time) if self.drift_time > 0.0 else 0.0
            )
            n = self._scale_by_boresight(self.drift_cross, self.drift_about, drift)
            self._drift = gauss_markov(self._drift, decay, 1.0, n)
        white = self._scale_by_boresight(self.noise_cross, self.noise_about, white)
        return propagate(self.q_bi, add(white, self._drift), 1.0)

    def _scale_by_boresight(self, across: float, about: float, v: Vec3) -> Vec3:
        """Scale v by `across` across the boresight and by `about` about it."""
        e = self._boresight
        return add(scale(across, v), scale((about - across) * dot(v, e), e))
