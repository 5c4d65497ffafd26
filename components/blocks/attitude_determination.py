from __future__ import annotations

from math import exp

from ..bases.sensing import Sensor, gauss_markov
from ..contract.block import SMALL_ANGLE, Parameter, Vec3
from ..contract.roles import AttitudeDetermination as Role
from ..maths.attitude import propagate
from ..maths.noise import normal3, normal6, stream
from ..maths.vector import ZERO, add, scale, unit

_MISALIGNMENT = 6  # its first noise channel in sample 0, after the six of all samples


class AttitudeDetermination(Role, Sensor):
    """Attitude determination: a performance model

        q_meas = dq(a_k) (x) q_bi
        a_k = misalignment + misalignment_norm u + x_k + noise n_k
        x_k = p x_(k-1) + markov_sigma sqrt(1 - p^2) w_k,       p = exp(-T / correlation_time)

    at each sample, T = `sample_time` after the last one, held in between. dq(a) is the
    rotation by |a| about a, in body axes. u is a unit vector drawn once, n and w are
    standard normal numbers of each axis, and x, a first-order Gauss-Markov process,
    starts from its stationary distribution. The errors are functions of seed, instance
    name and sample index.

    An *average determination error* E (paper 004: 3 deg) comes from either
    - `misalignment_norm` = E: constant, its direction drawn;
    - `markov_sigma` = E sqrt(pi / 8) = 0.62666 E: for 3 deg 0.032812 rad (the norm of x is Maxwell
      distributed); with `noise` as well, the root of the sum of their squares.

    Source: paper 004, sec. 3; Gelb, Applied Optimal Estimation (1974), ch. 3.
    """

    misalignment_body: Vec3 = Parameter(
        "rad", "constant error, a rotation vector, body", usual=SMALL_ANGLE
    )
    misalignment_norm: float = Parameter(
        "rad",
        "size of a further constant error, its direction drawn from the seed",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    markov_sigma: float = Parameter(
        "rad",
        "standard deviation of the Gauss-Markov error of each axis",
        min=0.0,
        usual=SMALL_ANGLE,
    )
    correlation_time: float = Parameter(
        "s",
        "correlation time of the Gauss-Markov error; 0: white",
        start=100.0,
        min=0.0,
        usual=(0.0, 1e6),
    )
    noise: float = Parameter(
        "rad",
        "standard deviation of the white error of each axis",
        min=0.0,
        usual=SMALL_ANGLE,
    )

    def start(self) -> None:
        self._noise = stream(self.instance, "q_meas_bi", self.seed)
        direction = unit(normal3(self._noise, 0, _MISALIGNMENT))
        self._constant = add(
            self.misalignment_body, scale(self.misalignment_norm, direction)
        )
        _, markov = normal6(self._noise, 0)
        self._markov = scale(self.markov_sigma, markov)
        super().start()

    def measure(self, sample: int, elapsed_time: float) -> None:
        white = ZERO
        if self.noise > 0.0 or self.markov_sigma > 0.0:
            white, markov = normal6(self._noise, sample)
            if elapsed_time > 0.0:
                decay = (
                    exp(-elapsed_time / self.correlation_time)
                    if self.correlation_time
                    else 0.0
                )
                self._markov = gauss_markov(
                    self._markov, decay, self.markov_sigma, markov
                )
        error = add(add(self._constant, self._markov), scale(self.noise, white))
        self.q_meas_bi = propagate(self.q_bi, error, 1.0)
