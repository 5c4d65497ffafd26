from __future__ import annotations

from math import exp, sqrt

from ..bases.sensing import Sensor, digital3, gauss_markov
from ..contract.block import SMALL_ANGLE, SPIN, Parameter, Vec3
from ..contract.roles import RateGyro as Role
from ..maths.noise import normal3, normal6, stream
from ..maths.vector import ZERO, add, cross, scale, sub

# Largest Allan deviation of a first-order Gauss-Markov process of standard deviation 1.
_PEAK = 0.61736


class RateGyro(Role, Sensor):
    """Three-axis rate gyro

        omega_meas = (1 + scale_error) (omega - a x omega) + b_k + d_k + sigma n_k
        b_k = b_(k-1) + bias_walk sqrt(T) w_k,      b_0 = bias
        d_k = e^(-T / instability_time) d_(k-1) + s_k
        sigma^2 = noise^2 + angle_random_walk^2 / T

    at each sample, T = `sample_time` after the last one, held in between; n and w are
    standard normal numbers of each axis. Then each axis is rounded to a multiple of
    `resolution` and limited to +-`full_scale`, where these are not 0. A limited value
    stays valid, as its sign is still right. The noise is a function of seed, instance
    name and sample index.

    a is `misalignment_body`, the small rotation of its axes. d is a first-order
    Gauss-Markov process that starts from its stationary state. It models the bias
    instability of a data sheet, the floor of the Allan deviation, which that of d alone
    reaches at 1.89 times `instability_time`.

    The random walks are specified by their deviation after one second, so the numbers
    are those of a data sheet in rad/sqrt(s) and rad/s/sqrt(s); 1 deg/sqrt(h) = 2.909e-4
    rad/sqrt(s).

    Source: Farrenkopf's gyro model, as in Markley & Crassidis, Fundamentals of
    Spacecraft Attitude Determination and Control (2014), sec. 4.7; the sample is the
    rate at its time, not the mean since the last one.
    """

    bias_body: Vec3 = Parameter("rad/s", "bias at the start, body", usual=SPIN)
    bias_walk: float = Parameter(
        "rad/s",
        "random walk of the bias: standard deviation of its change in 1 s, each axis",
        min=0.0,
        usual=(0.0, 1e-3),
    )
    bias_instability: float = Parameter(
        "rad/s",
        "bias instability: the floor of the Allan deviation, each axis",
        min=0.0,
        usual=(0.0, 1e-2),
    )
    instability_time: float = Parameter(
        "s",
        "correlation time of the bias instability; above 0",
        start=100.0,
        min=0.0,
        usual=(0.0, 1e6),
    )
    noise: float = Parameter(
        "rad/s",
        "standard deviation of the noise of each axis, whatever the sample time",
        min=0.0,
        usual=SPIN,
    )
    angle_random_walk: float = Parameter(
        "rad",
        "standard deviation of the angle that white rate noise sums up to in 1 s, each axis",
        min=0.0,
        usual=(0.0, 0.1),
    )
    scale_error: Vec3 = Parameter(
        "1",
        "scale-factor error of each axis",
        usual=(-0.3, 0.3),
    )
    misalignment_body: Vec3 = Parameter(
        "rad",
        "small rotation of its axes against the body's",
        usual=SMALL_ANGLE,
    )
    resolution: float = Parameter(
        "rad/s",
        "quantisation step of each axis; 0: none",
        min=0.0,
        usual=(0.0, 0.1),
    )
    full_scale: float = Parameter(
        "rad/s",
        "largest magnitude of each axis; 0: no limit",
        min=0.0,
        usual=(0.0, 100.0),
    )

    def start(self) -> None:
        """Set the noise of a sample (rad/s) and the bias to their start values."""
        self._sigma = self.noise
        if self.angle_random_walk > 0.0:
            if self.sample_time <= 0.0:
                self.fail("angle_random_walk needs a sample_time above 0 s")
            walk = self.angle_random_walk / sqrt(self.sample_time)
            self._sigma = sqrt(self.noise * self.noise + walk * walk)
        if self.bias_instability > 0.0 and self.instability_time <= 0.0:
            self.fail("bias_instability needs an instability_time above 0 s")
        self._bias, self._drift = self.bias_body, ZERO
        self._instability = stream(self.instance, "bias_instability", self.seed)
        self._noise = stream(self.instance, "omega_meas_body", self.seed)
        super().start()

    def measure(self, sample: int, elapsed_time: float) -> None:
        """Measure the rate (rad/s, body) with the errors of the gyro.

        These are misalignment, scale error, noise, and a bias that walks by `bias_walk`
        sqrt(elapsed_time). The instability is a Gauss-Markov process with the time
        constant `instability_time` (s).
        """
        white = ZERO
        if self._sigma > 0.0 or self.bias_walk > 0.0:
            white, walk = normal6(self._noise, sample)
            if elapsed_time > 0.0:
                self._bias = add(
                    self._bias, scale(self.bias_walk * sqrt(elapsed_time), walk)
                )
        omega, error, bias, s = (
            self.omega_bi_body,
            self.scale_error,
            self._bias,
            self._sigma,
        )
        if self.bias_instability > 0.0:
            n = normal3(self._instability, sample)
            sigma = self.bias_instability / _PEAK
            decay = (
                exp(-elapsed_time / self.instability_time)
                if elapsed_time > 0.0
                else 0.0
            )
            self._drift = gauss_markov(self._drift, decay, sigma, n)
            bias = add(bias, self._drift)
        if any(self.misalignment_body):
            omega = sub(omega, cross(self.misalignment_body, omega))
        omega_measured = (
            (1.0 + error[0]) * omega[0] + bias[0] + s * white[0],
            (1.0 + error[1]) * omega[1] + bias[1] + s * white[1],
            (1.0 + error[2]) * omega[2] + bias[2] + s * white[2],
        )
        self.omega_meas_body = digital3(
            omega_measured, self.resolution, self.full_scale
        )
